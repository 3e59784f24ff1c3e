//! An output with its record, as it is signed.

use std::path::{Path, PathBuf};

use anyhow::{Result, anyhow};

use locard_engine::pixels::Rect;
use locard_engine::provenance::{
    OutputKind, OutputRecord, PictureRecord, Record, WorkRecord, bytes_digest, output_of_record, record_path,
};
use locard_engine::sink::mark::VisibleMark;
use locard_engine::source::file::{MAX_TEXT_BYTES, read_text};
use locard_engine::text::reason;

/// A file of an output.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedFile {
    pub path: PathBuf,
    /// Its digest in the record.
    pub sha256: String,
    /// Index of the frame in the recording; `None` for a video or a photograph.
    pub frame: Option<usize>,
    /// Bounds of the changed pixels, of a video those of all frames.
    pub changed_px: Option<Rect>,
}

/// An output with its record.
#[derive(Clone, Debug)]
pub struct RecordedOutput {
    pub path: PathBuf,
    pub work: WorkRecord,
    pub files: Vec<RecordedFile>,
    /// Width and height of its pictures, px.
    size_px: (u32, u32),
    /// The record's text.
    text: String,
}

impl RecordedOutput {
    /// Reads the record of an output; the record's own path stands for the output.
    pub fn read(path: &Path) -> Result<Self> {
        let path = output_of_record(path).unwrap_or_else(|| path.to_owned());
        let record_file = record_path(&path);
        let text = read_text(&record_file, MAX_TEXT_BYTES).map_err(|error| {
            anyhow!(
                "{}: cannot be read: {}; a signature covers an output with its record, which `locard composite`, \
                 `locard photo` and `locard case-card` write",
                record_file.display(),
                reason(&error)
            )
        })?;
        let record = Record::read(&path)?;
        let files = files(&record, &path)?;
        let OutputRecord { width, height, .. } = record.output;
        Ok(Self { path, work: record.work, files, size_px: (width, height), text })
    }

    /// Bounds of the visible mark on each picture.
    pub fn mark_px(&self) -> Option<Rect> {
        let (width, height) = self.size_px;
        self.work.settings.mark.as_ref().map(|text| VisibleMark::new(text, width, height).bounds(height))
    }

    /// Digest of the record without the digests of the output's files: signing changes those.
    pub fn digest(&self) -> String {
        bytes_digest(self.text_with_digests(|_| "").as_bytes())
    }

    /// The record's text with other digests of the files; `digest` gives that of each file by its
    /// index.
    pub fn text_with_digests<'a>(&self, digest: impl Fn(usize) -> &'a str) -> String {
        with_replaced_digests(&self.text, &self.files, digest)
    }
}

fn files(record: &Record, output: &Path) -> Result<Vec<RecordedFile>> {
    let without_digest = |what: String| anyhow!("{}: lacks the digest of {what}", record_path(output).display());
    let rect = |px: [i32; 4]| Rect::new(px[0], px[1], px[2], px[3]);
    if record.output.kind == OutputKind::Video {
        let sha256 = record.output.sha256.clone().ok_or_else(|| without_digest("the video".to_owned()))?;
        let rects = record.pictures.iter().filter_map(|picture| picture.rect_px).map(rect);
        let changed_px = rects.reduce(|all, rect| all.union(&rect));
        return Ok(vec![RecordedFile { path: output.to_owned(), sha256, frame: None, changed_px }]);
    }
    let file = |picture: &PictureRecord| {
        let sha256 = picture.file_sha256.clone().ok_or_else(|| without_digest(format!("frame {}", picture.frame)))?;
        let path = record.output.picture_file(output, picture.file.as_deref());
        let frame = (record.output.kind == OutputKind::Frames).then_some(picture.frame);
        Ok(RecordedFile { path, sha256, frame, changed_px: picture.rect_px.map(rect) })
    };
    record.pictures.iter().map(file).collect()
}

/// A record's text with other digests of the files, which it lists in this order. A digest is the
/// value of `file_sha256`, of a video's file that of `sha256`.
fn with_replaced_digests<'a>(text: &str, files: &[RecordedFile], digest: impl Fn(usize) -> &'a str) -> String {
    let mut replaced = String::with_capacity(text.len());
    let mut file = 0;
    // Between quotation marks: a key, a separator, its value.
    let mut before = ["", ""];
    for (i, part) in text.split('"').enumerate() {
        if i > 0 {
            replaced.push('"');
        }
        let is_digest = matches!(before[0], "file_sha256" | "sha256") && before[1].trim() == ":";
        if is_digest && files.get(file).is_some_and(|file| file.sha256 == part) {
            replaced.push_str(digest(file));
            file += 1;
        } else {
            replaced.push_str(part);
        }
        before = [before[1], part];
    }
    replaced
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digests_of_files_are_replaced_in_order_and_others_kept() {
        let digit = |digit: &str| digit.repeat(64);
        let file =
            |sha256: &str| RecordedFile { path: PathBuf::new(), sha256: digit(sha256), frame: None, changed_px: None };
        // Two frames with the same bytes.
        let files = [file("a"), file("a"), file("b")];
        let text = |[w, x, y, z]: [&str; 4]| {
            format!(r#"{{"pixels_sha256": "{w}", "file_sha256": "{x}", "file_sha256":"{y}", "sha256": "{z}"}}"#)
        };
        let [a, b] = [digit("a"), digit("b")];
        let before = text([&a, &a, &a, &b]);
        assert_eq!(with_replaced_digests(&before, &files, |i| ["1", "2", "3"][i]), text([&a, "1", "2", "3"]));
        assert_eq!(with_replaced_digests(&before, &[], |_| "1"), before);
    }
}
