//! Video files, probed by the `ffprobe` program. Colour range and matrix are always passed to
//! ffmpeg for decoding, so that its defaults do not determine the meaning of a code value.

use std::ffi::OsString;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Deserialize;

use super::ffmpeg;
use super::index::{Index, IndexEntry};
use super::orientation::Orientation;
use super::oriented_coding::oriented_sampling;
use super::presentation::{Presentation, ProbedPresentation};
use super::timecode::Timecode;
use super::{SourceError, file as plain, motion_jpeg, unsupported};
use crate::coding::{ChromaSampling, ChromaSiting, ColorMatrix, ColorRange, Decoder, PictureCoding, YcbcrColor};
use crate::program::{self, ProgramError};
use crate::text::{count, fixed};

/// Advice about a damaged file.
pub(super) const MEND: &str =
    "copy it again from its source (ffmpeg -i FILE -c:v ffv1 NEW.mkv recovers the readable part)";

/// Scaling flags for every conversion between Y'CbCr and R'G'B': full chroma at both ends and exact
/// rounding. Without them swscale's fast paths are off by several code values.
pub(crate) const CONVERSION_FLAGS: &str = "bicubic+accurate_rnd+full_chroma_int+full_chroma_inp";

/// The user's statements about a file; they override the file's own.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Overrides {
    pub fps: Option<f64>,
    pub range: Option<ColorRange>,
    pub matrix: Option<ColorMatrix>,
    /// True if the frames are read as stored, whatever rotation the file states.
    pub as_stored: bool,
}

/// A video file that has been probed.
#[derive(Clone, Debug)]
pub struct Video {
    pub file: PathBuf,
    /// Size of the frames that are read.
    pub width: u32,
    pub height: u32,
    /// Applied to each stored frame on reading, by quarter turns.
    pub applied_orientation: Orientation,
    /// 8 or 16: depth of the result of [`Video::read`]; 16 for sources of more than 8 bits.
    pub bits: u32,
    pub range: ColorRange,
    pub matrix: ColorMatrix,
    /// `None` for R'G'B' and for more than 8 bits. If [`Video::is_jpeg`], that of the first frame:
    /// each has its own.
    pub coding: Option<Arc<PictureCoding>>,
    pub presentation: Presentation,
    /// One per frame, in display order; the first is at 0.
    pub timestamps_s: Vec<f64>,
    pub warnings: Vec<String>,
    /// True if the user's rate replaces the file's times.
    pub is_retimed: bool,
    /// Time of the first frame after the file's start, which is that of its sound, seconds.
    pub start_s: f64,
    /// True if the packets are JPEG files that are decoded here, not by ffmpeg.
    pub(super) is_jpeg: bool,
    /// `None` if the times do not distinguish the frames.
    pub(super) index: Option<Arc<Index>>,
}

/// A part of a file's sound.
#[derive(Clone, Debug, PartialEq)]
pub struct Soundtrack {
    pub file: PathBuf,
    /// Start after the file's start, and length, seconds.
    pub start_s: f64,
    pub length_s: f64,
}

/// ffprobe's JSON output for a video.
#[derive(Deserialize)]
struct Probe {
    #[serde(default)]
    streams: Vec<ProbedStream>,
    #[serde(default)]
    packets: Vec<VideoPacket>,
    #[serde(default)]
    format: Container,
}

/// A stream in ffprobe's JSON output.
#[derive(Deserialize)]
struct ProbedStream {
    /// The number of packets in the container's index (MP4).
    nb_frames: Option<String>,
    tags: Option<Tags>,
    codec_name: Option<String>,
    width: Option<u32>,
    height: Option<u32>,
    pix_fmt: Option<String>,
    chroma_location: Option<String>,
    color_range: Option<String>,
    color_space: Option<String>,
    avg_frame_rate: Option<String>,
    /// The unit of the packets' `pts`, seconds.
    time_base: Option<String>,
    field_order: Option<String>,
    #[serde(flatten)]
    presentation: ProbedPresentation,
}

/// A stream's tags in ffprobe's JSON output.
#[derive(Deserialize)]
struct Tags {
    /// The time when the stream ends, hours:minutes:seconds (Matroska).
    #[serde(rename = "DURATION")]
    duration: Option<String>,
    #[serde(alias = "TIMECODE")]
    timecode: Option<String>,
}

/// The container in ffprobe's JSON output.
#[derive(Default, Deserialize)]
struct Container {
    #[serde(default)]
    format_name: String,
    /// Of the earliest stream, seconds.
    start_time: Option<String>,
    #[serde(default)]
    tags: ContainerTags,
}

/// The container's tags in ffprobe's JSON output.
#[derive(Default, Deserialize)]
struct ContainerTags {
    /// The timecode is the container's in Matroska and MXF.
    #[serde(alias = "TIMECODE")]
    timecode: Option<String>,
}

/// A packet of the video stream in ffprobe's JSON output.
#[derive(Deserialize)]
struct VideoPacket {
    pts: Option<i64>,
    pts_time: Option<String>,
    dts_time: Option<String>,
    flags: Option<String>,
}

impl VideoPacket {
    fn has_flag(&self, flag: char) -> bool {
        self.flags.as_ref().is_some_and(|flags| flags.contains(flag))
    }

    /// `None` without a time.
    fn entry(&self) -> Option<IndexEntry> {
        let time_s = self.pts_time.as_deref()?.parse().ok()?;
        Some(IndexEntry { ticks: self.pts?, time_s, is_keyframe: self.has_flag('K'), is_shown: self.is_shown() })
    }

    /// D marks packets that an edit list discards.
    fn is_shown(&self) -> bool {
        !self.has_flag('D')
    }
}

/// Length of the signatures of still pictures, bytes.
const MAX_SIGNATURE_BYTES: u64 = 16;

/// Probes a video file with `ffprobe`: size, colour, and the time of every frame. Packets are
/// listed, not decoded, so this is fast.
pub fn probe(file: &Path, overrides: &Overrides) -> Result<Video, SourceError> {
    // ffprobe's own message for a missing file is less clear, and it would wait for a pipe.
    let failed = |source| SourceError::Read { file: file.to_owned(), source };
    let mut start = Vec::new();
    plain::open(file).map_err(failed)?.take(MAX_SIGNATURE_BYTES).read_to_end(&mut start).map_err(failed)?;
    if let Some(kind) = unsupported::by_content(&start) {
        return Err(SourceError::content(file, kind.refusal()));
    }
    let entries = "stream=codec_name,width,height,pix_fmt,chroma_location,color_range,color_space,color_transfer,color_primaries,\
                   sample_aspect_ratio,avg_frame_rate,time_base,field_order,nb_frames:\
                   stream_tags=DURATION,timecode:stream_side_data=rotation,displaymatrix:packet=pts,pts_time,dts_time,flags:\
                   format=format_name,start_time:format_tags=timecode";
    let mut arguments: Vec<OsString> =
        ["-v", "error", "-select_streams", "v:0", "-show_entries", entries, "-of", "json"].map(OsString::from).into();
    arguments.extend(ffmpeg::input(file));
    let output = program::output("ffprobe", &arguments).map_err(|error| match error {
        // An MP4's index is usually at its end.
        ProgramError::Failed { problem, .. } => {
            let is_text = !start.is_empty() && start.iter().all(|byte| matches!(byte, b'\t' | b'\n' | b'\r' | 32..127));
            let cut = || {
                if is_text {
                    return "is not a video but text; expected a video such as .mp4, .mov or .mkv".to_owned();
                }
                format!("is not a video, or is truncated before its index; ffprobe reports: {problem}; {MEND}")
            };
            SourceError::content(file, ffmpeg::container_refusal(&problem).unwrap_or_else(cut))
        }
        other => other.into(),
    })?;
    let video = parse_probe(&output.written, file, overrides)?;
    if output.complaints.is_empty() {
        return Ok(video.with_jpeg_coding());
    }
    // If a container is damaged, frames are left out, and those after them would be mistaken for
    // others.
    Err(SourceError::content(file, format!("is damaged: ffprobe reports: {}; {MEND}", output.complaints)))
}

fn parse_probe(json: &[u8], file: &Path, overrides: &Overrides) -> Result<Video, SourceError> {
    let refuse = |problem: String| SourceError::content(file, problem);
    let probe: Probe =
        serde_json::from_slice(json).map_err(|e| refuse(format!("ffprobe's output cannot be parsed: {e}")))?;
    let stream = probe.streams.first().ok_or_else(|| refuse("holds no video".to_owned()))?;
    let (Some(width @ 1..=65536), Some(height @ 1..=65536), Some(format)) =
        (stream.width, stream.height, stream.pix_fmt.as_deref())
    else {
        return Err(refuse("ffprobe finds no picture size or pixel format in it".to_owned()));
    };
    check_frame_count(stream, &probe.packets, &probe.format).map_err(refuse)?;
    let matrix = match (overrides.matrix, stream.color_space.as_deref()) {
        _ if is_rgb(format) => ColorMatrix::Rgb,
        (Some(matrix), _) => matrix,
        (None, None | Some("unknown" | "reserved")) => ColorMatrix::usual(height),
        (None, Some("bt470bg" | "smpte170m")) => ColorMatrix::Bt601,
        (None, Some("bt709")) => ColorMatrix::Bt709,
        (None, Some("bt2020nc")) => ColorMatrix::Bt2020,
        (None, Some(other)) => {
            let accepted = "bt601 (bt470bg, smpte170m), bt709 or bt2020 (bt2020nc)";
            return Err(refuse(format!("its colour matrix is {other}; expected {accepted}, or give `matrix`")));
        }
    };
    let range = match (overrides.range, stream.color_range.as_deref()) {
        (Some(range), _) => range,
        (None, Some("pc" | "jpeg" | "full")) => ColorRange::Full,
        // Grey and yuvj are full range by their definition in ffmpeg.
        _ if format.starts_with("yuvj") || format.starts_with("gray") || is_rgb(format) => ColorRange::Full,
        _ => ColorRange::Limited,
    };
    let stated = Presentation::of(&stream.presentation);
    let (mut presentation, applied_orientation) = stated.applied(overrides.as_stored);
    const MATRICES: [&str; 4] = ["bt709", "smpte170m", "bt470bg", "bt2020nc"];
    presentation.matrix = MATRICES.into_iter().find(|name| stream.color_space.as_deref() == Some(name));
    let of_stream = stream.tags.as_ref().and_then(|tags| tags.timecode.as_deref());
    presentation.timecode = of_stream.or(probe.format.tags.timecode.as_deref()).and_then(Timecode::parse);
    let mut warnings: Vec<String> = presentation
        .warnings()
        .iter()
        .chain(&stream.presentation.unknown_tags(&presentation))
        .map(|warning| format!("{}: {warning}", file.display()))
        .collect();
    if matches!(stream.field_order.as_deref(), Some("tt" | "bb" | "tb" | "bt")) {
        warnings.push(format!("{}: is interlaced; its fields are not separated", file.display()));
    }
    let fps = match overrides.fps {
        Some(fps) if fps.is_finite() && fps > 0.0 => Some(fps),
        Some(fps) => return Err(refuse(format!("fps = {fps}: expected a finite number above 0"))),
        None => None,
    };
    let stated = stream.avg_frame_rate.as_deref().and_then(ratio);
    let timestamps_s = timestamps(&probe.packets, fps, stated, file, &mut warnings)?;
    let bits = if more_than_8_bits(format) { 16 } else { 8 };
    let entries: Option<Vec<IndexEntry>> = probe.packets.iter().map(VideoPacket::entry).collect();
    let index = Index::new(stream.time_base.as_deref().unwrap_or_default(), &entries.unwrap_or_default());
    let index = index.map(Arc::new);
    let chroma = chroma_sampling(format, stream.chroma_location.as_deref()).filter(|_| bits == 8 && !is_rgb(format));
    let coding = chroma.and_then(|chroma| {
        Some(Arc::new(coding(
            oriented_sampling(chroma, applied_orientation, [width, height])?,
            YcbcrColor { matrix, range },
        )))
    });
    if applied_orientation != Orientation::default() {
        warnings.push(format!(
            "{}: its frames are {applied_orientation} on reading, as it is tagged ([frames] rotation = \"stored\" in a \
             recording.toml reads them as stored); the sensor's rows are then not the picture's, so a readout time does not \
             apply",
            file.display()
        ));
    }
    let (file, (width, height)) = (file.to_owned(), applied_orientation.oriented_size((width, height)));
    Ok(Video {
        file,
        width,
        height,
        applied_orientation,
        bits,
        range,
        matrix,
        coding,
        presentation,
        timestamps_s,
        warnings,
        is_retimed: fps.is_some(),
        start_s: start_s(&probe),
        is_jpeg: stream.codec_name.as_deref() == Some("mjpeg") && bits == 8 && has_display_order(&probe.packets),
        index,
    })
}

impl Video {
    /// The video with the coding of its first JPEG, which is read for this. If it cannot be
    /// represented, ffmpeg decodes the frames.
    fn with_jpeg_coding(self) -> Self {
        if !self.is_jpeg {
            return self;
        }
        let size = self.applied_orientation.oriented_size((self.width, self.height));
        let color = YcbcrColor { matrix: self.matrix, range: self.range };
        let coding = motion_jpeg::first_coding(&self.file, size, self.applied_orientation, color);
        Self { is_jpeg: coding.is_some(), coding: coding.map(Arc::new).or(self.coding), ..self }
    }
}

/// True if the n-th packet of the file is the n-th frame: all are shown, in the order of their
/// times if they have any.
fn has_display_order(packets: &[VideoPacket]) -> bool {
    let ascends = |pair: &[VideoPacket]| match (pair[0].pts, pair[1].pts) {
        (Some(before), Some(after)) => before < after,
        (before, after) => before == after,
    };
    packets.iter().all(VideoPacket::is_shown) && packets.windows(2).all(ascends)
}

/// Checks that there are as many frames as the container promises: by their number (MP4), or by
/// when the last one ends (Matroska, AVI; more than two and a half frames short is too little,
/// since containers round). An AVI's number counts the empty chunks that ffmpeg writes between
/// frames, so it is a length.
fn check_frame_count(stream: &ProbedStream, packets: &[VideoPacket], container: &Container) -> Result<(), String> {
    const WHAT_TO_DO: &str = "is it truncated? Copy it again from its source, or cut it off there: ffmpeg -i FILE -c \
                              copy NEW.mkv";
    let there = packets.len();
    let promised = stream.nb_frames.as_deref().and_then(|n| n.parse::<usize>().ok());
    let is_avi = container.format_name == "avi";
    if let Some(promised) = promised.filter(|promised| !is_avi && there < *promised) {
        return Err(format!("holds {there} frames, and its index has {promised}: {WHAT_TO_DO}"));
    }
    let slot_s = stream.avg_frame_rate.as_deref().and_then(ratio).map(|fps| 1.0 / fps);
    let times: Vec<f64> = times(packets, |_| true).into_iter().flatten().collect();
    let last_s = times.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let of_tags = || stream.tags.as_ref().and_then(|tags| seconds(tags.duration.as_deref()?));
    let (promised_s, interval_s) = match is_avi {
        true => (promised.zip(slot_s).map(|(count, slot_s)| count as f64 * slot_s), mean_interval_s(&times).or(slot_s)),
        false => (of_tags(), slot_s),
    };
    if let (Some(promised_s), Some(interval_s)) = (promised_s, interval_s)
        && last_s.is_finite()
        && promised_s - (last_s + interval_s) > 2.5 * interval_s
    {
        let end_s = last_s + interval_s;
        return Err(format!(
            "ends after {} s ({}), but its header gives {} s: {WHAT_TO_DO}",
            fixed(end_s, 3),
            count(there, "frame"),
            fixed(promised_s, 3)
        ));
    }
    Ok(())
}

/// Mean interval. `None` for fewer than two times.
fn mean_interval_s(times_s: &[f64]) -> Option<f64> {
    let first_s = times_s.iter().copied().fold(f64::INFINITY, f64::min);
    let last_s = times_s.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    (times_s.len() > 1).then(|| (last_s - first_s) / (times_s.len() - 1) as f64)
}

/// `hours:minutes:seconds` in seconds.
fn seconds(text: &str) -> Option<f64> {
    text.split(':').try_fold(0.0, |sum, part| Some(60.0 * sum + part.trim().parse::<f64>().ok()?))
}

/// Presentation times of the selected packets. If no packet has one (an AVI of a codec with
/// reordered frames), the decoding times: frames are displayed at regular intervals.
fn times(packets: &[VideoPacket], is_selected: impl Fn(&VideoPacket) -> bool) -> Vec<Option<f64>> {
    let has_shown = packets.iter().any(|packet| packet.pts_time.is_some());
    let time = |packet: &VideoPacket| {
        let text = if has_shown { &packet.pts_time } else { &packet.dts_time };
        text.as_deref()?.parse().ok()
    };
    packets.iter().filter(|packet| is_selected(packet)).map(time).collect()
}

/// Display time of each frame: computed if a rate is given, otherwise from the packets.
fn timestamps(
    packets: &[VideoPacket],
    given_fps: Option<f64>,
    stated_fps: Option<f64>,
    file: &Path,
    warnings: &mut Vec<String>,
) -> Result<Vec<f64>, SourceError> {
    let times = times(packets, VideoPacket::is_shown);
    if times.is_empty() {
        return Err(SourceError::content(file, "holds no frames"));
    }
    let counted = |fps: f64| (0..times.len()).map(|i| i as f64 / fps).collect();
    if let Some(fps) = given_fps {
        return Ok(counted(fps));
    }
    let Some(mut stated_s) = times.iter().copied().collect::<Option<Vec<f64>>>() else {
        let problem = "has no timestamps for its frames; give `fps`";
        return stated_fps.map(counted).ok_or_else(|| SourceError::content(file, problem));
    };
    stated_s.sort_by(f64::total_cmp);
    let first = stated_s.first().copied().unwrap_or_default();
    stated_s.iter_mut().for_each(|time_s| *time_s -= first);
    // Containers round to a millisecond or so; a steady rate is restored exactly.
    if let Some(fps) = stated_fps {
        let steady: Vec<f64> = counted(fps);
        if steady.iter().zip(&stated_s).all(|(a, b)| (a - b).abs() < 2e-3) {
            return Ok(steady);
        }
    }
    if let Some(i) = stated_s.windows(2).position(|pair| pair[1] <= pair[0]) {
        warnings.push(format!("{}: frames {i} and {} are shown at the same time", file.display(), i + 1));
    }
    Ok(stated_s)
}

/// Time of the first frame after the file's start, seconds.
fn start_s(probe: &Probe) -> f64 {
    let first_s = times(&probe.packets, VideoPacket::is_shown).into_iter().flatten().fold(f64::INFINITY, f64::min);
    let file_s: Option<f64> = probe.format.start_time.as_deref().and_then(|text| text.parse().ok());
    file_s.map(|file_s| first_s - file_s).filter(|start_s| start_s.is_finite()).unwrap_or_default().max(0.0)
}

fn ratio(text: &str) -> Option<f64> {
    let (above, below) = text.split_once('/')?;
    let ratio = above.parse::<f64>().ok()? / below.parse::<f64>().ok()?;
    (ratio.is_finite() && ratio > 0.0).then_some(ratio)
}

fn is_rgb(format: &str) -> bool {
    ["rgb", "bgr", "gbr", "argb", "abgr", "0rgb", "0bgr", "x2rgb", "x2bgr", "pal8"]
        .iter()
        .any(|s| format.starts_with(s))
}

/// Chroma of ffmpeg's pixel formats; grey has none. `None` for other formats. If the file does not
/// state its position, it is that of H.264 and MPEG-2, or of JPEG for full range by definition.
fn chroma_sampling(format: &str, location: Option<&str>) -> Option<Option<ChromaSampling>> {
    use ChromaSiting::{Centered, Cosited};
    if format.starts_with("gray") {
        return Some(None);
    }
    let sampled = |name: &str| format.contains(name);
    let factor = if sampled("420") || sampled("nv12") || sampled("nv21") {
        [2, 2]
    } else if sampled("422") {
        [2, 1]
    } else if sampled("440") {
        [1, 2]
    } else if sampled("444") {
        [1, 1]
    } else {
        return None;
    };
    let siting = match location {
        Some("center") => [Centered, Centered],
        Some("top") => [Centered, Cosited],
        Some("topleft") => [Cosited, Cosited],
        None | Some("unspecified") if format.starts_with("yuvj") => [Centered, Centered],
        _ => [Cosited, Centered],
    };
    Some(Some(ChromaSampling { factor, siting }))
}

/// Coding of a video's frames. Their quantisation is not known, and varies.
fn coding(chroma: Option<ChromaSampling>, color: YcbcrColor) -> PictureCoding {
    // The scaler's own assumption.
    let siting = [ChromaSiting::Centered; 2];
    PictureCoding { color, chroma, quantization: None, decoder: Decoder::Swscale { siting } }
}

/// ffmpeg names the byte order of every format whose components need more than a byte, and of the
/// packed ones with 4 to 6 bits.
fn more_than_8_bits(format: &str) -> bool {
    let packed = ["444le", "444be", "555le", "555be", "565le", "565be"].iter().any(|s| format.ends_with(s));
    (format.ends_with("le") || format.ends_with("be")) && !(packed && is_rgb(format))
}

#[cfg(test)]
mod tests;
