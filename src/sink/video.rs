//! A video file, encoded by the `ffmpeg` program through a pipe.

use std::ffi::OsString;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ChildStdin;
use std::sync::Arc;

use super::atomic::Partial;
use super::{Sink, SinkError, SinkOptions, VideoCodec, little_endian, rotation, timed};
use crate::cleanup::MadeFolder;
use crate::coding::ColorMatrix;
use crate::label::{PROGRAM, SourceLabel, append_box};
use crate::pixels::Pixels;
use crate::program::{self, ProgramError, Running};
use crate::source::ffmpeg;
use crate::source::orientation::Orientation;
use crate::source::video::{CONVERSION_FLAGS, Soundtrack};

const ENDED_EARLY: &str = "ffmpeg ended before it received all frames, without a message; check that the program \
                           `ffmpeg` is FFmpeg";

/// Writes under a temporary name and renames once ffmpeg has succeeded; otherwise no file is left.
#[derive(Debug)]
pub struct VideoSink {
    path: PathBuf,
    options: SinkOptions,
    /// `None` once ended. Dropped before its file.
    running: Option<(Running, ChildStdin)>,
    partial: Partial,
    /// The parent folder. Dropped after the file.
    made: Option<MadeFolder>,
    /// Number of frames passed to ffmpeg.
    frames: usize,
    /// Clock of frames with a variable rate.
    clock: Option<PresentationClock>,
}

/// Presentation times of the written frames.
#[derive(Debug)]
struct PresentationClock {
    times_s: Arc<[f64]>,
    /// The first frame's time, seconds, and the last written one in the file, microseconds.
    first_and_last: Option<(f64, u64)>,
}

/// Minimum step between two frames, microseconds: a tick of the file's clock, rounded up.
const MIN_STEP_US: u64 = 12;

impl PresentationClock {
    /// Presentation time of a frame in the file, microseconds: ascending from 0.
    fn time_us(&mut self, frame: usize) -> u64 {
        let time_s = self.times_s.get(frame).copied().unwrap_or_default();
        let time_us = match self.first_and_last {
            None => 0,
            Some((first_s, last_us)) => (((time_s - first_s) * 1e6).round() as u64).max(last_us + MIN_STEP_US),
        };
        self.first_and_last = Some((self.first_and_last.map_or(time_s, |first_and_last| first_and_last.0), time_us));
        time_us
    }
}

impl VideoSink {
    pub fn open(path: &Path, options: &SinkOptions) -> Result<Self, SinkError> {
        let refuse = |problem: &str| SinkError::Refused { path: path.to_owned(), problem: problem.to_owned() };
        if !(options.fps.is_finite() && options.fps > 0.0) {
            return Err(refuse("frames a second must be finite and above 0"));
        }
        if options.lossless && options.bits == 16 && !is_mkv(path) {
            return Err(refuse("lossless video with 16 bits goes into .mkv only"));
        }
        if options.codec == Some(VideoCodec::ProRes) && has_extension(path, "mp4") {
            return Err(refuse("ProRes goes into .mov or .mkv"));
        }
        let made = path.parent().map(|folder| {
            MadeFolder::make(folder).map_err(|source| SinkError::Write { path: folder.to_owned(), source })
        });
        let made = made.transpose()?;
        let partial = Partial::create(path).map_err(|source| SinkError::Write { path: path.to_owned(), source })?;
        let mut running = Running::start("ffmpeg", &arguments(options, path, partial.path())?)?;
        // ffmpeg's stdout is not read; closed, it cannot block.
        drop(running.take_stdout());
        let running = running.take_stdin().map(|stdin| (running, stdin));
        let clock = options.times_s.clone().map(|times_s| PresentationClock { times_s, first_and_last: None });
        Ok(Self { path: path.to_owned(), options: options.clone(), running, partial, made, frames: 0, clock })
    }

    /// Waits for ffmpeg and returns its error message on failure.
    fn end(&mut self) -> Result<(), SinkError> {
        let Some((running, stdin)) = self.running.take() else { return Ok(()) };
        drop(stdin);
        running.finish().map(drop).map_err(|source| SinkError::Encoder { path: self.path.clone(), source })
    }

    fn refuse(&self, problem: &str) -> SinkError {
        SinkError::Refused { path: self.path.clone(), problem: problem.to_owned() }
    }
}

fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case(extension))
}

fn is_mkv(path: &Path) -> bool {
    has_extension(path, "mkv")
}

/// ffmpeg's option value of a transfer function. ffprobe reports two of them by the standard's
/// name.
fn transfer_option(name: &'static str) -> &'static str {
    match name {
        "bt470m" => "gamma22",
        "bt470bg" => "gamma28",
        other => other,
    }
}

/// Offset of sound against pictures that is not noticed, s: half a frame at 25 per second.
const MAX_SOUND_OFFSET_S: f64 = 0.02;
/// Codecs of sound that MP4 and QuickTime files take. QuickTime also takes all of PCM.
const MP4_SOUND: [&str; 6] = ["aac", "mp3", "ac3", "eac3", "alac", "opus"];
const QUICKTIME_SOUND: [&str; 5] = ["aac", "mp3", "ac3", "eac3", "alac"];

/// ffmpeg's name of the codec of a file's first sound; empty if it has none.
fn recorded_sound_codec(file: &Path) -> Result<String, ProgramError> {
    let options = ["-v", "error", "-select_streams", "a:0", "-show_entries", "stream=codec_name", "-of", "csv=p=0"];
    let arguments: Vec<OsString> = options.into_iter().map(OsString::from).chain(ffmpeg::input(file)).collect();
    let codec = program::output("ffprobe", &arguments)?.written;
    // The stream of an MPEG-TS is listed twice.
    Ok(String::from_utf8_lossy(&codec).lines().next().unwrap_or_default().trim().to_owned())
}

/// ffmpeg's name of the codec for a file's sound from `start_s` on: a copy where the written file
/// takes it. Copied sound begins at a keyframe of the source's pictures; MP4 and QuickTime hide the
/// part before the start by an edit list, which Matroska lacks.
fn sound_codec(file: &Path, written: &Path, start_s: f64) -> Result<&'static str, ProgramError> {
    if is_mkv(written) {
        return Ok(if start_s > MAX_SOUND_OFFSET_S { "flac" } else { "copy" });
    }
    let recorded = recorded_sound_codec(file)?;
    let recorded = recorded.as_str();
    if has_extension(written, "mp4") {
        let copies = recorded.is_empty() || MP4_SOUND.contains(&recorded);
        return Ok(if copies { "copy" } else { "aac" });
    }
    let copies = recorded.is_empty() || recorded.starts_with("pcm_") || QUICKTIME_SOUND.contains(&recorded);
    Ok(if copies { "copy" } else { "pcm_s16le" })
}

/// The codec of a video that is not lossless, by its file's extension.
pub fn default_codec(path: &Path) -> VideoCodec {
    if has_extension(path, "mov") { VideoCodec::ProRes } else { VideoCodec::H264 }
}

/// ffmpeg's arguments for the sound of a video.
pub(crate) struct SoundArguments {
    /// The recording's file as the next input.
    pub input: Vec<OsString>,
    /// Value of the option `-c:a`.
    pub codec: &'static str,
}

/// Arguments that put a soundtrack into a video at a path.
pub(crate) fn sound_arguments(soundtrack: &Soundtrack, path: &Path) -> Result<SoundArguments, ProgramError> {
    let Soundtrack { file, start_s, length_s } = soundtrack;
    let part = ["-ss", &format!("{start_s:.6}"), "-t", &format!("{length_s:.6}")].map(OsString::from);
    let input = part.into_iter().chain(ffmpeg::input(file)).collect();
    Ok(SoundArguments { input, codec: sound_codec(file, path, *start_s)? })
}

/// Arguments of the encoder: options and pixel format.
fn encoder(options: &SinkOptions, codec: VideoCodec) -> (Vec<String>, &'static str) {
    let is_even = options.width.is_multiple_of(2) && options.height.is_multiple_of(2);
    // 8-bit quantization is visible in a high dynamic range and on logarithmic curves. Chroma
    // subsampling requires even sizes, but the picture's size must not change.
    let is_ten_bit = (options.presentation.is_hdr() || options.presentation.matrix.is_some()) && options.bits == 16;
    let (words, format): (&[&str], _) = match codec {
        VideoCodec::H264 => {
            let format = match (is_even, is_ten_bit) {
                (true, false) => "yuv420p",
                (true, true) => "yuv420p10le",
                (false, false) => "yuv444p",
                (false, true) => "yuv444p10le",
            };
            (&["-c:v", "libx264", "-preset", "veryfast"], format)
        }
        VideoCodec::Hevc => {
            let format = if is_even { "yuv420p10le" } else { "yuv444p10le" };
            // Players of Apple identify HEVC by this tag.
            (&["-c:v", "libx265", "-preset", "fast", "-tag:v", "hvc1"], format)
        }
        VideoCodec::ProRes => {
            let (profile, format) = if is_even { ("hq", "yuv422p10le") } else { ("4444", "yuv444p10le") };
            (&["-c:v", "prores_ks", "-vendor", "apl0", "-profile:v", profile], format)
        }
    };
    let words = words.iter().map(|word| (*word).to_owned());
    (words.chain(quality(codec, options.closed_groups)).collect(), format)
}

/// Arguments of an encoder's quality and of its groups of pictures.
fn quality(codec: VideoCodec, closed_groups: Option<u32>) -> Vec<String> {
    let words = match (codec, closed_groups) {
        (VideoCodec::ProRes, _) => String::new(),
        (VideoCodec::H264, None) => "-crf 16".to_owned(),
        (VideoCodec::Hevc, None) => "-crf 14 -x265-params log-level=error".to_owned(),
        // Rate control carries its state from group to group, and encoding on several threads
        // depends on their number.
        (VideoCodec::H264, Some(n)) => {
            format!("-qp 16 -threads 1 -g {n} -keyint_min {n} -sc_threshold 0 -x264-params open-gop=0")
        }
        (VideoCodec::Hevc, Some(n)) => format!(
            "-qp 14 -x265-params log-level=error:frame-threads=1:keyint={n}:min-keyint={n}:scenecut=0:open-gop=0"
        ),
    };
    words.split_whitespace().map(str::to_owned).collect()
}

/// A label as ffmpeg's metadata, `key=value`. QuickTime files have a place for XMP, Matroska has
/// tags of any name; MP4 gets a box of its own at the end.
pub(crate) fn metadata(label: &SourceLabel, path: &Path) -> Vec<String> {
    let mut entries = vec![format!("comment={}; {PROGRAM}", label.source_type.description())];
    if is_mkv(path) {
        entries.push(format!("DIGITAL_SOURCE_TYPE={}", label.source_type.uri()));
    }
    if !has_extension(path, "mp4") {
        entries.push(format!("xmp={}", label.xmp()));
    }
    entries
}

fn arguments(options: &SinkOptions, path: &Path, partial: &Path) -> Result<Vec<OsString>, ProgramError> {
    let SinkOptions { fps, lossless, width, height, bits, presentation, .. } = *options;
    let (is_timed, is_mkv) = (options.times_s.is_some(), is_mkv(path));
    let input = if bits == 16 { "rgb48le" } else { "rgb24" };
    let (size, rate) = (format!("{width}x{height}"), fps.to_string());
    let mut text: Vec<&str> = vec!["-v", "error", "-xerror", "-y"];
    if is_timed {
        text.extend(["-f", "matroska", "-i", "pipe:0"]);
    } else {
        text.extend(["-f", "rawvideo", "-pix_fmt", input, "-s", &size, "-framerate", &rate, "-i", "pipe:0"]);
    }
    let mut arguments: Vec<OsString> = text.drain(..).map(OsString::from).collect();
    match &options.soundtrack {
        Some(soundtrack) => {
            let sound = sound_arguments(soundtrack, path)?;
            arguments.extend(sound.input);
            // One track: others may have codecs that no container takes.
            text.extend(["-map", "0:v:0", "-map", "1:a:0?", "-c:a", sound.codec]);
        }
        None => text.push("-an"),
    }
    let (matrix, tag) = match (presentation.matrix, ColorMatrix::usual(height)) {
        (Some("bt709"), _) => ("bt709", "bt709"),
        (Some(name @ ("smpte170m" | "bt470bg")), _) => ("bt601", name),
        (stated, _) if stated.or(presentation.primaries).is_some_and(|name| name.starts_with("bt2020")) => {
            ("bt2020", "bt2020nc")
        }
        (_, ColorMatrix::Bt601) => ("bt601", "smpte170m"),
        _ => ("bt709", "bt709"),
    };
    let (encoder, format) = encoder(options, options.codec.unwrap_or_else(|| default_codec(path)));
    // By default setsar rounds to a ratio of numbers up to 100.
    let aspect =
        presentation.pixel_aspect.map(|(width, height)| format!("setsar={width}/{height}:max={}", width.max(height)));
    // Tags that a recorded video leaves open stay open.
    let usual = (!lossless && presentation.matrix.is_none()).then_some(tag);
    let primaries = presentation.primaries.or(usual);
    let usual_transfer = usual.map(|tag| if tag == "bt2020nc" { "bt2020-10" } else { tag });
    let transfer = presentation.transfer.or(usual_transfer);
    // The encoder of ProRes writes the tags of frames, the others those of the stream.
    let tags = [("color_primaries", primaries), ("color_trc", transfer), ("colorspace", Some(tag))];
    let tags: Vec<String> = tags.iter().filter_map(|(key, value)| Some(format!("{key}={}", (*value)?))).collect();
    let convert = format!(
        "scale=out_color_matrix={matrix}:out_range=limited:flags={CONVERSION_FLAGS},format={format},setparams={}",
        tags.join(":")
    );
    let filters: Vec<&str> = (!lossless).then_some(convert.as_str()).into_iter().chain(aspect.as_deref()).collect();
    let filters = filters.join(",");
    if !filters.is_empty() {
        text.extend(["-vf", &filters]);
    }
    match (lossless, bits) {
        // Each frame alone, so that parts join to the bits of one run.
        (true, 16) => text.extend(["-c:v", "ffv1", "-level", "3", "-g", "1", "-pix_fmt", "gbrp16le"]),
        (true, _) => text.extend(["-c:v", "libx264rgb", "-preset", "veryfast", "-qp", "0", "-pix_fmt", "rgb24"]),
        (false, _) => {
            text.extend(encoder.iter().map(String::as_str));
            text.extend(["-color_range", "tv", "-colorspace", tag]);
        }
    }
    text.extend(primaries.into_iter().flat_map(|name| ["-color_primaries", name]));
    text.extend(transfer.map(transfer_option).into_iter().flat_map(|name| ["-color_trc", name]));
    let metadata = options.label.as_ref().map_or_else(Vec::new, |label| metadata(label, path));
    text.extend(metadata.iter().flat_map(|entry| ["-metadata", entry]));
    let timecode = presentation.timecode.map(|timecode| timecode.to_string());
    text.extend(timecode.iter().flat_map(|timecode| ["-timecode", timecode]));
    if is_timed {
        text.extend(["-vsync", "vfr", "-enc_time_base", "1:90000"]);
        if !(lossless && bits == 16) {
            // Reordered frames would shorten the file's duration.
            text.extend(["-bf", "0"]);
        }
        if !is_mkv {
            text.extend(["-video_track_timescale", "90000"]);
        }
    }
    if is_mkv {
        // Without random identifiers.
        text.extend(["-fflags", "+bitexact"]);
    } else {
        text.extend(["-movflags", "+faststart"]);
    }
    arguments.extend(text.into_iter().map(OsString::from));
    arguments.push(ffmpeg::file_argument(partial));
    Ok(arguments)
}

impl Sink for VideoSink {
    fn write(&mut self, frame_index: usize, pixels: &Pixels) -> Result<(), SinkError> {
        self.options.check(frame_index, pixels)?;
        let Some((_, stdin)) = &mut self.running else {
            return Err(self.refuse("the video has ended already"));
        };
        let codes = little_endian(&pixels.codes);
        let head = self.clock.as_mut().map_or_else(Vec::new, |clock| {
            let mut head = if self.frames == 0 { timed::head(&self.options) } else { Vec::new() };
            head.extend(timed::frame_head(clock.time_us(frame_index), codes.len()));
            head
        });
        self.frames += 1;
        let Err(source) = stdin.write_all(&head).and_then(|()| stdin.write_all(&codes)) else { return Ok(()) };
        // A broken pipe means that ffmpeg ended; its messages may contain the reason.
        self.end()?;
        match source.kind() {
            std::io::ErrorKind::BrokenPipe => Err(self.refuse(ENDED_EARLY)),
            _ => Err(SinkError::Write { path: self.path.clone(), source }),
        }
    }

    fn finish(mut self: Box<Self>) -> Result<(), SinkError> {
        self.end()?;
        let is_empty = std::fs::metadata(self.partial.path()).is_ok_and(|file| file.len() == 0);
        if is_empty && self.frames > 0 {
            return Err(self.refuse(ENDED_EARLY));
        }
        let Self { path, partial, made, options, .. } = *self;
        let orientation = options.presentation.orientation;
        if orientation != Orientation::default() && !is_mkv(&path) {
            rotation::write(partial.path(), orientation, (options.width, options.height))
                .map_err(|source| SinkError::of_writing(&path, source))?;
        }
        if let Some(label) = options.label.as_ref().filter(|_| has_extension(&path, "mp4")) {
            append_box(partial.path(), &label.xmp()).map_err(|source| SinkError::of_writing(&path, source))?;
        }
        partial.finish(options.force).map_err(|source| SinkError::of_writing(&path, source))?;
        made.into_iter().for_each(MadeFolder::keep);
        Ok(())
    }
}
