//! Joins video parts by ffmpeg's concat demuxer, which copies the encoded frames.
//!
//! Containers round the duration of a part: Matroska to 1 ms, 0.33 ms too short for 10 frames at
//! 30 per second, so that after fifty parts a frame would be missing. Each part therefore gets its
//! exact duration, and each frame of a steady rate its exact time.

use std::ffi::OsString;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

use super::error::FarmError;
use super::join_options::{FrameTimes, JoinOptions};
use super::part_record::RecordedPart;
use crate::label::{SourceLabel, append_box};
use crate::program;
use crate::provenance::remove_record;
use crate::sink::atomic::Partial;
use crate::sink::rotation;
use crate::sink::video::sound_arguments;
use crate::sink::{SinkError, label_metadata};
use crate::source::ffmpeg;
use crate::text::{count, fixed, quoted};

/// Largest deviation of a frame's time in a file, s: twice the tick of Matroska's clock.
const MAX_TIME_ERROR_S: f64 = 2e-3;
/// Properties of a stream that joined parts share and the joined file keeps, and all times.
const PROBED: &str = "stream=codec_type,codec_name,profile,codec_tag_string,width,height,pix_fmt,color_range,\
                      color_space,color_transfer,color_primaries,sample_aspect_ratio,extradata_hash:\
                      stream_tags=timecode:format_tags=timecode:packet=codec_type,pts_time";

/// Writes the joined video. The file gets its name when it is complete and its frames are at the
/// right times.
pub fn join_videos(parts: &[RecordedPart], options: &JoinOptions) -> Result<(), FarmError> {
    let Some(first) = parts.first() else { return Ok(()) };
    let fps = first.record.output.fps;
    if !(fps.is_finite() && fps > 0.0) {
        return Err(FarmError::refused(&first.path, "its record has no frame rate; recreate the part"));
    }
    let properties = VideoProperties::of(&first.path)?;
    let mut list = "ffconcat version 1.0\n".to_owned();
    for part in parts {
        check_part(part, &properties, fps, options)?;
        _ = writeln!(list, "file {}\nduration {:.6}", list_entry(&part.path)?, duration_s(part, parts, fps, options));
    }
    let failed = |source| FarmError::Sink(SinkError::Write { path: options.out.clone(), source });
    let mut list_file = tempfile::Builder::new().suffix(".ffconcat").tempfile().map_err(failed)?;
    list_file.write_all(list.as_bytes()).map_err(failed)?;
    let partial = Partial::create(&options.out).map_err(failed)?;
    let label = label_of(parts);
    let files = (list_file.path(), partial.path());
    let arguments = arguments(files, fps, &properties, label.as_ref(), options)?;
    program::output("ffmpeg", &arguments).map_err(|source| SinkError::Encoder { path: options.out.clone(), source })?;
    if !is_mkv(&options.out) {
        rotation::copy(&first.path, partial.path()).map_err(failed)?;
    }
    if let Some(label) = label.filter(|_| has_ending(&options.out, "mp4")) {
        append_box(partial.path(), &label.xmp()).map_err(failed)?;
    }
    check_joined(parts, partial.path(), &properties, fps, options)?;
    if options.force {
        remove_record(&options.out)?;
    }
    Ok(partial.finish(options.force).map_err(|source| SinkError::of_writing(&options.out, source))?)
}

fn is_mkv(path: &Path) -> bool {
    has_ending(path, "mkv")
}

fn has_ending(path: &Path, ending: &str) -> bool {
    path.extension().is_some_and(|own| own.eq_ignore_ascii_case(ending))
}

/// The label of the joined video, which ffmpeg does not copy from the parts; `None` if they have
/// none. It names the recording, the first argument of `locard composite`, and the frames.
fn label_of(parts: &[RecordedPart]) -> Option<SourceLabel> {
    let (first, last) = (parts.first()?, parts.last()?);
    let work = first.work();
    let recording = work.command.arguments.get(1).filter(|argument| !argument.starts_with('-'));
    let recording = recording.map(|argument| work.command.folder.join(argument)).unwrap_or_default();
    let frames = first.range().start..last.range().end;
    (!work.settings.unlabelled).then(|| SourceLabel::composite(&recording).of_frames(frames))
}

/// Properties of a video file.
#[derive(Clone, Debug, PartialEq)]
struct VideoProperties {
    /// `name=value` of the first video stream.
    stream: Vec<String>,
    timecode: Option<String>,
    has_sound: bool,
    /// Presentation times of the frames, ascending, s.
    times_s: Vec<f64>,
}

impl VideoProperties {
    fn of(file: &Path) -> Result<Self, FarmError> {
        let options = ["-v", "error", "-of", "compact", "-show_data_hash", "sha256", "-show_entries", PROBED];
        let arguments: Vec<OsString> = options.into_iter().map(OsString::from).chain(ffmpeg::input(file)).collect();
        let written = program::output("ffprobe", &arguments)?.written;
        Ok(Self::of_text(&String::from_utf8_lossy(&written)))
    }

    /// Parses ffprobe's text: a line for each packet, each stream and the file, with its kind and
    /// fields between bars.
    fn of_text(text: &str) -> Self {
        let mut properties = Self { stream: Vec::new(), timecode: None, has_sound: false, times_s: Vec::new() };
        for line in text.lines() {
            let Some((kind, fields)) = line.trim().split_once('|') else { continue };
            let value = |name: &str| fields.split('|').find_map(|field| field.strip_prefix(name)?.strip_prefix('='));
            let is_video = value("codec_type") == Some("video");
            properties.has_sound |= value("codec_type") == Some("audio");
            if kind == "packet" {
                properties
                    .times_s
                    .extend(value("pts_time").filter(|_| is_video).and_then(|time| time.parse::<f64>().ok()));
                continue;
            }
            if is_video && properties.stream.is_empty() {
                properties.stream =
                    fields.split('|').filter(|field| !field.starts_with("tag:")).map(str::to_owned).collect();
            }
            let timecode = value("tag:timecode").or(value("tag:TIMECODE"));
            properties.timecode = properties.timecode.or(timecode.map(str::to_owned));
        }
        properties.times_s.sort_by(f64::total_cmp);
        properties
    }

    /// A property that differs, with both values.
    fn difference(&self, other: &Self) -> Option<String> {
        let pair = self.stream.iter().zip(&other.stream).find(|(a, b)| a != b);
        if pair.is_none() && self.stream.len() != other.stream.len() {
            return Some("the number of properties".to_owned());
        }
        pair.map(|(a, b)| format!("{} and {}", quoted(a), quoted(b)))
    }

    fn tag(&self) -> Option<&str> {
        let tag = self.stream.iter().find_map(|line| line.strip_prefix("codec_tag_string="))?;
        tag.bytes().all(|byte| byte.is_ascii_alphanumeric()).then_some(tag)
    }
}

/// Checks that a part has the format of the first one, no sound, and its frames at their times.
fn check_part(
    part: &RecordedPart,
    properties: &VideoProperties,
    fps: f64,
    options: &JoinOptions,
) -> Result<(), FarmError> {
    let own = VideoProperties::of(&part.path)?;
    if let Some(difference) = properties.difference(&own) {
        let problem = format!("differs from the first part in {difference}; recreate one of them");
        return Err(FarmError::refused(&part.path, problem));
    }
    if own.has_sound {
        let problem = "has sound, whose blocks do not end with the frames; make the parts with --no-sound, and name the \
                       recording, whose sound is then added (--recording)";
        return Err(FarmError::refused(&part.path, problem));
    }
    let expected_s: Vec<f64> = part.range().map(|frame| time_s(frame, part.range().start, fps, options)).collect();
    check_times(&part.path, &own.times_s, &expected_s, options)
}

/// Time of a frame after the start frame, s.
fn time_s(frame: usize, start: usize, fps: f64, options: &JoinOptions) -> f64 {
    match &options.times {
        FrameTimes::Steady => frame.saturating_sub(start) as f64 / fps,
        FrameTimes::Variable(times_s) => {
            let time_s = |frame: usize| times_s.get(frame).copied().unwrap_or_default();
            time_s(frame) - time_s(start)
        }
    }
}

/// Checks the times of a file's frames relative to the first one.
fn check_times(file: &Path, times_s: &[f64], expected_s: &[f64], options: &JoinOptions) -> Result<(), FarmError> {
    if times_s.len() != expected_s.len() {
        let problem = format!("has {}, expected {}", count(times_s.len(), "frame"), expected_s.len());
        return Err(FarmError::refused(file, problem + "; recreate the part"));
    }
    let first_s = times_s.first().copied().unwrap_or_default();
    let pairs = times_s.iter().map(|time_s| time_s - first_s).zip(expected_s);
    let Some((number, (time_s, expected_s))) =
        pairs.enumerate().find(|(_, (time_s, expected_s))| (time_s - **expected_s).abs() > MAX_TIME_ERROR_S)
    else {
        return Ok(());
    };
    let advice = match options.times {
        FrameTimes::Steady => "name the recording (--recording), whose rate is probably variable",
        FrameTimes::Variable(_) => "check that the recording is the one that the parts were made of",
    };
    let (time_s, expected_s) = (fixed(time_s, 3), fixed(*expected_s, 3));
    Err(FarmError::refused(
        file,
        format!("shows its picture {number} at {time_s} s, expected {expected_s} s; {advice}"),
    ))
}

/// Time from a part's first frame to the next part's, s.
fn duration_s(part: &RecordedPart, parts: &[RecordedPart], fps: f64, options: &JoinOptions) -> f64 {
    let range = part.range();
    let has_next = parts.last().is_some_and(|last| last.range().end > range.end);
    if has_next || options.times == FrameTimes::Steady {
        return time_s(range.end, range.start, fps, options);
    }
    time_s(range.end - 1, range.start, fps, options) + 1.0 / fps
}

/// A file in ffmpeg's list, in quotes.
fn list_entry(path: &Path) -> Result<String, FarmError> {
    let path = path.canonicalize().map_err(|source| FarmError::reading(path, source))?;
    match path.to_str().filter(|text| !text.contains(['\n', '\r'])) {
        Some(text) => Ok(format!("'file:{}'", text.replace('\'', r"'\''"))),
        None => Err(FarmError::refused(&path, "has a name that ffmpeg's list cannot hold; rename it")),
    }
}

/// ffmpeg's arguments, from a list of the parts to a partial file.
fn arguments(
    (list, partial): (&Path, &Path),
    fps: f64,
    properties: &VideoProperties,
    label: Option<&SourceLabel>,
    options: &JoinOptions,
) -> Result<Vec<OsString>, FarmError> {
    let input = ["-v", "error", "-xerror", "-y", "-f", "concat", "-safe", "0", "-protocol_whitelist", "file", "-i"];
    let mut arguments: Vec<OsString> = input.map(OsString::from).to_vec();
    arguments.push(ffmpeg::file_argument(list));
    let mut text = vec!["-map".to_owned(), "0:v:0".to_owned(), "-c:v".to_owned(), "copy".to_owned()];
    match &options.soundtrack {
        Some(soundtrack) => {
            let sound = sound_arguments(soundtrack, &options.out)?;
            arguments.extend(sound.input);
            text.extend(["-map", "1:a:0?", "-c:a", sound.codec].map(str::to_owned));
        }
        None => text.push("-an".to_owned()),
    }
    let is_mkv = is_mkv(&options.out);
    if options.times == FrameTimes::Steady {
        let exact = |stamp: &str| format!("round({stamp}*TB*{fps})/{fps}/TB");
        text.extend(["-bsf:v".to_owned(), format!("setts=pts={}:dts={}", exact("PTS"), exact("DTS"))]);
    } else if !is_mkv {
        text.extend(["-video_track_timescale", "90000"].map(str::to_owned));
    }
    if let Some(timecode) = &properties.timecode {
        text.extend(["-timecode".to_owned(), timecode.clone()]);
    }
    let metadata = label.map_or_else(Vec::new, |label| label_metadata(label, &options.out));
    text.extend(metadata.into_iter().flat_map(|entry| ["-metadata".to_owned(), entry]));
    if is_mkv {
        // Without random identifiers.
        text.extend(["-fflags", "+bitexact"].map(str::to_owned));
    } else {
        text.extend(properties.tag().into_iter().flat_map(|tag| ["-tag:v".to_owned(), tag.to_owned()]));
        text.extend(["-movflags", "+faststart"].map(str::to_owned));
    }
    arguments.extend(text.into_iter().map(OsString::from));
    arguments.push(ffmpeg::file_argument(partial));
    Ok(arguments)
}

/// Checks that the joined file has all frames at their times, and the format of the parts.
fn check_joined(
    parts: &[RecordedPart],
    file: &Path,
    properties: &VideoProperties,
    fps: f64,
    options: &JoinOptions,
) -> Result<(), FarmError> {
    let joined = VideoProperties::of(file)?;
    let difference = properties.difference(&joined);
    if let Some(difference) = difference.filter(|text| !text.contains("extradata_hash")) {
        let problem = format!("ffmpeg changed the format: {difference}; join the parts as folders of frames");
        return Err(FarmError::refused(&options.out, problem));
    }
    let start = parts.first().map_or(0, |part| part.range().start);
    let frames = parts.iter().flat_map(RecordedPart::range);
    let expected_s: Vec<f64> = frames.map(|frame| time_s(frame, start, fps, options)).collect();
    check_times(&options.out, &joined.times_s, &expected_s, options)
}

#[cfg(test)]
mod tests {
    use std::ops::Range;
    use std::path::PathBuf;

    use serde_json::json;

    use super::super::join::join;
    use super::super::join::tests::options;
    use super::super::part_record::tests::{edit, record};
    use super::super::part_record::{file_sha256, parts_at};
    use super::*;
    use crate::provenance::record_path;

    /// A video of the frames of a range of a test pattern, with its record.
    fn video_part(folder: &Path, range: Range<usize>, name: &str, encoder: &[&str]) -> PathBuf {
        let output = folder.join(name);
        let pattern = format!(
            "testsrc2=s=64x48:r=30,trim=start_frame={}:end_frame={},setpts=PTS-STARTPTS",
            range.start, range.end
        );
        let mut arguments: Vec<OsString> =
            ["-v", "error", "-y", "-f", "lavfi", "-i", &pattern].map(OsString::from).to_vec();
        arguments.extend(encoder.iter().map(OsString::from));
        arguments.push(ffmpeg::file_argument(&output));
        program::output("ffmpeg", &arguments).unwrap();
        let fields = json!({ "kind": "video", "path": output, "width": 64, "height": 48, "bits": 8, "codec": "ffv1",
            "fps": 30.0, "sha256": file_sha256(&output).unwrap() });
        std::fs::write(record_path(&output), record(range, fields, &[]).to_string()).unwrap();
        output
    }

    /// Hashes of a video's packets, or of its decoded pictures.
    fn hashes(file: &Path, is_decoded: bool) -> Vec<String> {
        let codec: &[&str] = if is_decoded { &["-pix_fmt", "gbrp"] } else { &["-c", "copy"] };
        let mut arguments: Vec<OsString> = ["-v", "error"].map(OsString::from).to_vec();
        arguments.extend(ffmpeg::input(file));
        arguments.extend(["-map", "0:v"].iter().chain(codec).chain(&["-f", "framemd5", "-"]).map(OsString::from));
        let text = String::from_utf8(program::output("ffmpeg", &arguments).unwrap().written).unwrap();
        text.lines().filter(|line| !line.starts_with('#')).map(str::to_owned).collect()
    }

    /// True if a file has a text.
    fn contains(file: &Path, text: &str) -> bool {
        std::fs::read(file).unwrap().windows(text.len()).any(|window| window == text.as_bytes())
    }

    const FFV1: [&str; 8] = ["-c:v", "ffv1", "-level", "3", "-g", "1", "-fflags", "+bitexact"];

    #[test]
    fn joined_ffv1_has_the_packets_and_times_of_one_run() {
        let temp = tempfile::tempdir().unwrap();
        let whole = video_part(temp.path(), 0..67, "whole.mkv", &FFV1);
        let parts = temp.path().join("parts");
        std::fs::create_dir(&parts).unwrap();
        // Ten frames last 333.3 ms, of which Matroska keeps 333.
        for start in (0..67).step_by(10) {
            let range = start..(start + 10).min(67);
            video_part(&parts, range.clone(), &format!("it's {:03}.mkv", range.start), &FFV1);
        }
        let out = temp.path().join("joined.mkv");
        join(&parts_at(&[parts]).unwrap(), &options(&out)).unwrap();
        assert_eq!(hashes(&out, false), hashes(&whole, false));
        // A join of one part, the whole, is the same file.
        let again = temp.path().join("again.mkv");
        join(&parts_at(&[whole]).unwrap(), &options(&again)).unwrap();
        assert_eq!(std::fs::read(&out).unwrap(), std::fs::read(&again).unwrap());
        let joined = parts_at(std::slice::from_ref(&out)).unwrap();
        assert_eq!(joined[0].record.output.sha256, Some(file_sha256(&out).unwrap()));
        assert_eq!(joined[0].range(), 0..67);
        assert!(contains(&out, "compositeSynthetic") && contains(&out, "locard:recording"));
        assert!(contains(&out, "locard:frames=\"0..67\""));
    }

    #[test]
    fn video_of_unlabelled_parts_has_no_label() {
        let temp = tempfile::tempdir().unwrap();
        let part = video_part(temp.path(), 0..3, "part.mkv", &FFV1);
        edit(&part, |value| value["settings"]["unlabelled"] = true.into());
        let out = temp.path().join("joined.mkv");
        join(&parts_at(&[part]).unwrap(), &options(&out)).unwrap();
        assert!(!contains(&out, "compositeSynthetic"));
    }

    #[test]
    fn joined_closed_groups_of_h264_have_the_pictures_of_one_run() {
        let encoder = "-c:v libx264 -preset veryfast -qp 16 -threads 1 -g 12 -keyint_min 12 -sc_threshold 0 \
                       -x264-params open-gop=0 -pix_fmt yuv420p";
        let encoder: Vec<&str> = encoder.split_whitespace().collect();
        let temp = tempfile::tempdir().unwrap();
        let whole = video_part(temp.path(), 0..60, "whole.mp4", &encoder);
        let parts = temp.path().join("parts");
        std::fs::create_dir(&parts).unwrap();
        for range in [0..24, 24..36, 36..60] {
            video_part(&parts, range.clone(), &format!("{:03}.mp4", range.start), &encoder);
        }
        let out = temp.path().join("joined.mp4");
        join(&parts_at(&[parts]).unwrap(), &options(&out)).unwrap();
        assert_eq!(hashes(&out, true), hashes(&whole, true));
        assert!(contains(&out, "locard:recording=\"take\"") && contains(&out, "Composite with synthetic elements"));
        let file = std::fs::read(&out).unwrap();
        assert!(file.ends_with(b"<?xpacket end=\"r\"?>"));
    }

    #[test]
    fn part_with_sound_another_format_or_lost_frames_is_refused() {
        let temp = tempfile::tempdir().unwrap();
        let first = video_part(temp.path(), 0..5, "first.mkv", &FFV1);
        let refusal = |range: Range<usize>, encoder: &[&str], out: &str| {
            let second = video_part(temp.path(), range.clone(), "second.mkv", encoder);
            let parts = parts_at(&[first.clone(), second]).unwrap();
            join(&parts, &options(&temp.path().join(out))).unwrap_err().to_string()
        };
        let format = refusal(5..9, &[&FFV1[..], &["-pix_fmt", "yuv444p"]].concat(), "a.mkv");
        assert!(format.contains("second.mkv: differs from the first part in pix_fmt="), "{format}");
        let frames = refusal(5..9, &[&FFV1[..], &["-frames:v", "3"]].concat(), "a.mkv");
        assert!(frames.contains("second.mkv: has 3 frames, expected 4; recreate the part"), "{frames}");
        let rate = refusal(5..9, &[&FFV1[..], &["-vf", "setpts=2*PTS", "-vsync", "vfr"]].concat(), "a.mkv");
        assert!(rate.contains("shows its picture 1 at") && rate.contains("name the recording"), "{rate}");
        let sound = ["-f", "lavfi", "-i", "sine=d=0.1", "-shortest"];
        let sound = refusal(5..9, &[&sound[..], &FFV1].concat(), "a.mkv");
        assert!(sound.contains("has sound") && sound.contains("--no-sound"), "{sound}");
        let ending = refusal(5..9, &FFV1, "a.mp4");
        assert!(ending.contains("a.mp4: must end in .mkv, as the part"), "{ending}");
        assert!(!temp.path().join("a.mkv").exists() && !temp.path().join("a.mp4").exists());
    }

    #[test]
    fn variable_times_are_those_of_the_recording() {
        let temp = tempfile::tempdir().unwrap();
        let times_s: Vec<f64> = (0..8).map(|i| 0.04 * f64::from(i * i)).collect();
        let encoder = [
            &FFV1[..],
            &[
                "-vf",
                "settb=1/1000,setpts=40*(pow(N+START\\,2)-pow(START\\,2))",
                "-vsync",
                "vfr",
                "-enc_time_base",
                "1:90000",
            ],
        ]
        .concat();
        let mut parts = Vec::new();
        for range in [0..3, 3..8] {
            let encoder: Vec<String> =
                encoder.iter().map(|word| word.replace("START", &range.start.to_string())).collect();
            let encoder: Vec<&str> = encoder.iter().map(String::as_str).collect();
            parts.push(video_part(temp.path(), range.clone(), &format!("{}.mkv", range.start), &encoder));
        }
        let parts = parts_at(&parts).unwrap();
        let out = temp.path().join("out.mkv");
        let steady = join(&parts, &options(&out)).unwrap_err().to_string();
        assert!(steady.contains("whose rate is probably variable"), "{steady}");
        let times = FrameTimes::Variable(times_s.clone().into());
        join(&parts, &JoinOptions { times, ..options(&out) }).unwrap();
        let joined_s = VideoProperties::of(&out).unwrap().times_s;
        assert_eq!(joined_s.len(), 8);
        assert!(joined_s.iter().zip(&times_s).all(|(a, b)| (a - b).abs() < MAX_TIME_ERROR_S), "{joined_s:?}");
    }
}
