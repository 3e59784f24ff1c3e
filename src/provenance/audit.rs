//! Audit of an output: its inputs and files against its record, and its recomputed frames.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::mpsc;

use super::digests::{file_digest, pixels_digest};
use super::mask::{FrameMask, MaskRecord};
use super::pictures::{PictureDifference, difference, read_picture, video_digests};
use super::record::{OutputKind, PictureRecord, Record};
use crate::pixels::Pixels;
use crate::sink::folder::frame_of_name;
use crate::sink::{Sink, SinkError};
use crate::source::still;
use crate::text::reason;

/// Number of frames of a lossy video that are decoded and compared, for information. Each is
/// decoded from the start of the video.
const MAX_DECODED_FRAMES: usize = 100;

/// An input or an output file that is not the recorded one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChangedFile {
    pub path: PathBuf,
    /// Role of an input; `output` or `mask` of a written file.
    pub role: String,
    pub problem: String,
}

impl std::fmt::Display for ChangedFile {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} ({}): {}", self.path.display(), self.role, self.problem)
    }
}

/// Inputs that differ from the recorded ones. Relative paths start at `folder`.
pub fn changed_inputs(record: &Record, folder: &Path) -> Vec<ChangedFile> {
    let change = |input: &super::InputRecord| {
        let problem = match file_digest(&folder.join(&input.path)) {
            Ok(digest) if digest.sha256 == input.sha256 => return None,
            Ok(digest) if digest.bytes != input.bytes => {
                format!("has changed: {} bytes, {} were read", digest.bytes, input.bytes)
            }
            Ok(_) => "has changed: other contents of the same length".to_owned(),
            Err(error) => format!("cannot be read: {}", reason(&error)),
        };
        Some(ChangedFile { path: input.path.clone(), role: input.role.clone(), problem })
    };
    record.work.inputs.iter().filter_map(change).collect()
}

/// Files of the output that differ from the recorded ones: a video as a whole, of a folder the
/// pictures of these frames.
pub fn changed_outputs(record: &Record, output: &Path, frames: &[usize]) -> Vec<ChangedFile> {
    let changed = |path: PathBuf, problem: String| ChangedFile { path, role: "output".to_owned(), problem };
    if record.output.kind == OutputKind::Video {
        let problem = match file_digest(output) {
            Ok(digest) if Some(&digest.sha256) == record.output.sha256.as_ref() => {
                match changed_video_pictures(record, output, frames) {
                    Some(problem) => problem,
                    None => return Vec::new(),
                }
            }
            Ok(_) => "has changed since it was written".to_owned(),
            Err(error) => format!("cannot be read: {}", reason(&error)),
        };
        return vec![changed(output.to_owned(), problem)];
    }
    let frames: HashSet<usize> = frames.iter().copied().collect();
    let sampled = record.pictures.iter().enumerate().filter(|(_, picture)| frames.contains(&picture.frame));
    let change = |(number, picture): (usize, &super::PictureRecord)| {
        let file = record.output.picture_file(output, picture.file.as_deref());
        match read_picture(output, &record.output, picture.file.as_deref(), number) {
            Ok(pixels) if pixels_digest(&pixels) == picture.pixels_sha256 => match &picture.file_sha256 {
                Some(sha256) if file_digest(&file).is_ok_and(|digest| digest.sha256 != *sha256) => {
                    Some(changed(file, "its pixels are as they were written, but other data has changed".to_owned()))
                }
                _ => None,
            },
            Ok(_) => Some(changed(file, "its pixels have changed since it was written".to_owned())),
            Err(error) => {
                let problem = without_path(&error, &file);
                Some(changed(file, problem))
            }
        }
    };
    sampled.filter_map(change).chain(unlisted(record, output)).collect()
}

/// A message without the path that it begins with.
fn without_path(error: &dyn std::error::Error, file: &Path) -> String {
    let text = error.to_string();
    text.strip_prefix(&format!("{}: ", file.display())).unwrap_or(&text).to_owned()
}

/// The problem of the file of a frame's mask, if it is not the recorded mask.
pub fn changed_mask(picture: &PictureRecord, file: &Path) -> Option<ChangedFile> {
    let recorded = picture.mask.as_ref()?;
    let problem = match still::read_pixels(file) {
        Ok(pixels) if FrameMask::of_picture(&pixels).record() == *recorded => return None,
        Ok(_) => "is not the recorded mask".to_owned(),
        Err(error) => without_path(&error, file),
    };
    Some(ChangedFile { path: file.to_owned(), role: "mask".to_owned(), problem })
}

/// Why the pictures of a lossless video are not those that were written. Those of a lossy one are
/// known by the digest of its file alone.
fn changed_video_pictures(record: &Record, output: &Path, frames: &[usize]) -> Option<String> {
    if !record.output.stores_digested_codes() {
        return None;
    }
    let frames: HashSet<usize> = frames.iter().copied().collect();
    let last = record.pictures.iter().rposition(|picture| frames.contains(&picture.frame))?;
    let (mut count, mut first_changed) = (0, None);
    let read = video_digests(output, &record.output, |number, sha256| {
        count = number + 1;
        let picture = record.pictures.get(number).filter(|picture| frames.contains(&picture.frame));
        first_changed = picture.filter(|picture| picture.pixels_sha256 != sha256).map(|picture| picture.frame);
        first_changed.is_none() && number < last
    });
    match (read, first_changed) {
        (Err(error), _) => Some(format!("its pictures cannot be read: {error}")),
        (_, Some(frame)) => Some(format!("the pixels of frame {frame} have changed since it was written")),
        _ if count <= last => Some(format!("it has {count} pictures of {}", record.pictures.len())),
        _ => None,
    }
}

/// Frames in an output's folder that are not in its record.
fn unlisted(record: &Record, output: &Path) -> impl Iterator<Item = ChangedFile> {
    let listed: HashSet<&str> = record.pictures.iter().filter_map(|picture| picture.file.as_deref()).collect();
    let entries = std::fs::read_dir(output).into_iter().flatten().flatten().map(|entry| entry.file_name());
    let is_unlisted = |name: &std::ffi::OsString| {
        name.to_str().is_some_and(|name| frame_of_name(name).is_some() && !listed.contains(name))
    };
    let mut names: Vec<_> = entries.filter(is_unlisted).collect();
    names.sort();
    let problem = "is not in the record: it was added, or written by another run";
    let change = |name| ChangedFile { path: output.join(name), role: "output".to_owned(), problem: problem.to_owned() };
    names.into_iter().map(change).collect::<Vec<_>>().into_iter()
}

/// A recomputed frame, compared with the written one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecomputedFrame {
    pub frame: usize,
    pub outcome: RecomputedOutcome,
    /// Bounds of the changed pixels, if they are not the recorded ones.
    pub other_bounds: Option<OtherBounds>,
    /// Number of pixels where the mask differs from the recorded one; `None` if none was recorded.
    pub mask_px: Option<usize>,
}

impl RecomputedFrame {
    /// True if codes and bounds are the recorded ones.
    pub fn is_equal(&self) -> bool {
        self.outcome == RecomputedOutcome::Equal && self.other_bounds.is_none()
    }
}

/// Differing bounds of a frame's changed pixels: left, top, right, bottom. `None` if no pixel
/// changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OtherBounds {
    pub recomputed: Option<[i32; 4]>,
    pub recorded: Option<[i32; 4]>,
}

/// How a recomputed frame compares with the written one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum RecomputedOutcome {
    /// Bit for bit.
    Equal,
    Differs(PictureDifference),
    /// Not equal, by an unknown difference, for this reason.
    Unequal(String),
}

/// Compares recomputed frames with a record.
pub struct FrameAudit<'a> {
    record: &'a Record,
    output: &'a Path,
    /// Position of each frame in the record.
    position: HashMap<usize, usize>,
}

impl<'a> FrameAudit<'a> {
    pub fn new(record: &'a Record, output: &'a Path) -> Self {
        let position = record.pictures.iter().enumerate().map(|(number, picture)| (picture.frame, number)).collect();
        Self { record, output, position }
    }

    /// The record of a frame.
    fn picture(&self, frame: usize) -> Option<&PictureRecord> {
        self.position.get(&frame).map(|number| &self.record.pictures[*number])
    }

    /// Compares one frame, the bounds of its changed pixels, and its mask if it was recomputed.
    pub fn compare(
        &self,
        frame: usize,
        pixels: &Pixels,
        rect_px: Option<[i32; 4]>,
        mask: Option<&MaskRecord>,
    ) -> RecomputedFrame {
        let outcome = match self.position.get(&frame) {
            None => RecomputedOutcome::Unequal("it is not in the record".to_owned()),
            Some(number) => self.outcome(*number, pixels),
        };
        let picture = self.picture(frame);
        let other_bounds = picture.filter(|picture| picture.rect_px != rect_px);
        let other_bounds = other_bounds.map(|picture| OtherBounds { recomputed: rect_px, recorded: picture.rect_px });
        let recorded = picture.and_then(|picture| picture.mask.as_ref());
        let mask_px = mask.zip(recorded).map(|(mask, recorded)| mask.differing_px(recorded));
        RecomputedFrame { frame, outcome, other_bounds, mask_px }
    }

    /// Why a frame of a lossy video is not compared exactly, and the difference from its decoded
    /// picture.
    fn lossy_difference(&self, number: usize, pixels: &Pixels) -> String {
        let output = &self.record.output;
        let stored = (number < MAX_DECODED_FRAMES).then(|| read_picture(self.output, output, None, number).ok());
        let difference = stored.flatten().and_then(|stored| difference(pixels, &stored).ok().flatten());
        let decoded = difference.map(|difference| format!("; the decoded picture differs {difference}"));
        format!("{} is lossy, so the written codes are not stored{}", output.codec, decoded.unwrap_or_default())
    }

    fn outcome(&self, number: usize, pixels: &Pixels) -> RecomputedOutcome {
        let picture = &self.record.pictures[number];
        if pixels_digest(pixels) == picture.pixels_sha256 {
            return RecomputedOutcome::Equal;
        }
        if !self.record.output.stores_digested_codes() {
            return RecomputedOutcome::Unequal(self.lossy_difference(number, pixels));
        }
        match read_picture(self.output, &self.record.output, picture.file.as_deref(), number) {
            Ok(stored) if pixels_digest(&stored) != picture.pixels_sha256 => {
                RecomputedOutcome::Unequal("the stored picture is not the recorded one".to_owned())
            }
            Ok(stored) => match difference(pixels, &stored) {
                Ok(Some(difference)) => RecomputedOutcome::Differs(difference),
                Ok(None) => RecomputedOutcome::Equal,
                Err(sizes) => RecomputedOutcome::Unequal(format!("its sizes differ: {sizes}")),
            },
            Err(error) => RecomputedOutcome::Unequal(error.to_string()),
        }
    }
}

/// Passes on the pictures that reach it.
pub struct ForwardSink(pub mpsc::Sender<(usize, Pixels)>);

impl Sink for ForwardSink {
    fn write(&mut self, frame_index: usize, pixels: &Pixels) -> Result<(), SinkError> {
        // The receiver lives as long as the sink is written to.
        let _ = self.0.send((frame_index, pixels.clone()));
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<(), SinkError> {
        Ok(())
    }
}

/// Positions of `count` frames spread evenly over `of`, with the first and, from two on, the last.
pub fn spread(count: usize, of: usize) -> Vec<usize> {
    let count = count.clamp(1, of.max(1)).min(of);
    let last = count.saturating_sub(1).max(1);
    (0..count).map(|i| (i * (of - 1) + last / 2) / last).collect()
}

#[cfg(test)]
mod tests {
    use super::super::record::tests::record;
    use super::*;
    use crate::pixels::Rect;
    use crate::program;
    use crate::sink::folder::write_frame;
    use crate::source::ffmpeg;

    #[test]
    fn spread_covers_both_ends_evenly() {
        assert_eq!(spread(1, 9), [0]);
        assert_eq!(spread(3, 9), [0, 4, 8]);
        assert_eq!(spread(20, 4), [0, 1, 2, 3]);
        assert_eq!(spread(2, 2), [0, 1]);
        assert!(spread(3, 0).is_empty());
    }

    #[test]
    fn changed_missing_and_equal_inputs_are_distinguished() {
        let folder = tempfile::tempdir().unwrap();
        let mut record = record();
        let write = |text: &str| std::fs::write(folder.path().join("s.toml"), text).unwrap();
        write("abc");
        record.work.inputs[0].sha256 = file_digest(&folder.path().join("s.toml")).unwrap().sha256;
        assert_eq!(changed_inputs(&record, folder.path()), []);
        write("xyz");
        let text = changed_inputs(&record, folder.path())[0].to_string();
        assert_eq!(text, "s.toml (scene): has changed: other contents of the same length");
        write("abcd");
        let text = changed_inputs(&record, folder.path())[0].to_string();
        assert_eq!(text, "s.toml (scene): has changed: 4 bytes, 3 were read");
        std::fs::remove_file(folder.path().join("s.toml")).unwrap();
        assert!(changed_inputs(&record, folder.path())[0].problem.contains("no such file"));
    }

    #[test]
    fn pictures_of_an_output_are_compared_with_the_record_and_with_recomputed_frames() {
        let folder = tempfile::tempdir().unwrap();
        let mut record = record();
        let written = Pixels::from_u8(8, 6, vec![100; 144]).unwrap();
        for picture in &mut record.pictures {
            let path = folder.path().join(picture.file.as_deref().unwrap());
            write_frame(&path, &written, None, None, false).unwrap();
            picture.pixels_sha256 = pixels_digest(&written);
        }
        assert_eq!(changed_outputs(&record, folder.path(), &[4, 5]), []);
        let audit = FrameAudit::new(&record, folder.path());
        let bounds = record.pictures[0].rect_px;
        assert!(audit.compare(4, &written, bounds, None).is_equal());
        // Other bounds are a difference of their own.
        let moved = audit.compare(4, &written, None, None);
        assert_eq!(moved.outcome, RecomputedOutcome::Equal);
        assert_eq!(moved.other_bounds, Some(OtherBounds { recomputed: None, recorded: bounds }));
        assert!(bounds.is_some() && !moved.is_equal());
        let mut codes = vec![100; 144];
        codes[3] = 102;
        let other = Pixels::from_u8(8, 6, codes).unwrap();
        let expected = PictureDifference { max_codes: 2, p99_codes: 2, pixels: 1, bounds: Rect::new(1, 0, 2, 1) };
        assert_eq!(audit.compare(4, &other, bounds, None).outcome, RecomputedOutcome::Differs(expected));
        assert!(matches!(audit.compare(9, &other, bounds, None).outcome, RecomputedOutcome::Unequal(_)));
        // Somebody retouches a picture.
        let file = folder.path().join("frame_000005.png");
        write_frame(&file, &other, None, None, true).unwrap();
        let changed = changed_outputs(&record, folder.path(), &[4, 5]);
        assert_eq!(changed.len(), 1);
        assert!(
            changed[0].to_string().ends_with("frame_000005.png (output): its pixels have changed since it was written")
        );
        assert_eq!(changed_outputs(&record, folder.path(), &[4]), [], "a sample without it");
        std::fs::write(folder.path().join("frame_000009.png"), "").unwrap();
        let added = changed_outputs(&record, folder.path(), &[4]);
        assert!(
            added[0]
                .to_string()
                .ends_with("frame_000009.png (output): is not in the record: it was added, or written by another run")
        );
        std::fs::remove_file(folder.path().join("frame_000009.png")).unwrap();
        let retouched = audit.compare(5, &other, bounds, None).outcome;
        assert_eq!(retouched, RecomputedOutcome::Unequal("the stored picture is not the recorded one".to_owned()));
    }

    #[test]
    fn frame_of_a_lossy_video_is_compared_with_its_decoded_picture() {
        let folder = tempfile::tempdir().unwrap();
        let video = folder.path().join("a.mp4");
        let encode = "-v error -f lavfi -i color=black:s=8x6:r=5:d=1 -c:v libx264 -pix_fmt yuv420p";
        let arguments: Vec<_> = encode.split(' ').map(Into::into).chain([ffmpeg::file_argument(&video)]).collect();
        program::output("ffmpeg", &arguments).unwrap();
        let mut record = record();
        (record.output.kind, record.output.codec) = (OutputKind::Video, "h264".to_owned());
        (record.output.width, record.output.height, record.output.bits) = (8, 6, 8);
        let grey = Pixels::from_u8(8, 6, vec![100; 144]).unwrap();
        let outcome = FrameAudit::new(&record, &video).compare(4, &grey, None, None).outcome;
        let RecomputedOutcome::Unequal(why) = outcome else { panic!("{outcome:?}") };
        assert!(why.starts_with("h264 is lossy, so the written codes are not stored; "), "{why}");
        assert!(why.contains("differs by up to ") && why.ends_with("in columns 0..8, rows 0..6"), "{why}");
    }
}
