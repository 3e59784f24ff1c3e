//! The contents of a record, and its file.

use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::mask::MaskRecord;
use super::work::WorkRecord;
use crate::sink::SinkError;
use crate::sink::atomic::write_atomically;
use crate::source::file::{self, MAX_TEXT_BYTES};
use crate::text::{quoted, reason};

/// Version of the format.
pub const RECORD_VERSION: u32 = 1;

/// Everything needed to recompute an output.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    pub version: u32,
    #[serde(flatten)]
    pub work: WorkRecord,
    /// Half-open range of frames of the recording.
    pub range: [usize; 2],
    pub output: OutputRecord,
    pub pictures: Vec<PictureRecord>,
}

/// Kind of an output.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum OutputKind {
    Frames,
    Video,
    /// A photograph or a case card: one picture file.
    Photograph,
}

/// The output.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OutputRecord {
    pub kind: OutputKind,
    pub path: PathBuf,
    pub width: u32,
    pub height: u32,
    /// Bits of a code value, 8 or 16.
    pub bits: u32,
    /// `png`, `h264`, `hevc`, `prores`, `ffv1` or `h264rgb`, of a photograph `png` or `jpeg`.
    pub codec: String,
    /// Frames per second; 0 of a photograph.
    pub fps: f64,
    /// Digest of a video's file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sha256: Option<String>,
}

impl OutputRecord {
    /// True if stored pictures decode to the codes that were hashed: lossless codecs, and
    /// photographs, which are hashed after decoding.
    pub fn stores_digested_codes(&self) -> bool {
        self.kind == OutputKind::Photograph || matches!(self.codec.as_str(), "png" | "ffv1" | "h264rgb")
    }

    /// The file of a picture that is no part of a video; `name` is its name in a folder.
    pub fn picture_file(&self, output: &Path, name: Option<&str>) -> PathBuf {
        match self.kind {
            OutputKind::Frames => output.join(name.unwrap_or_default()),
            OutputKind::Photograph | OutputKind::Video => output.to_owned(),
        }
    }
}

/// A written picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PictureRecord {
    /// Index of the frame in the recording.
    pub frame: usize,
    /// File name in the output's folder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// Digest of the code values.
    pub pixels_sha256: String,
    /// Digest of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file_sha256: Option<String>,
    /// Bounds of the changed pixels: x0, y0, x1, y1. All others are the camera's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rect_px: Option<[i32; 4]>,
    /// If masks or layers were written.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask: Option<MaskRecord>,
}

/// Why a record cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ProvenanceError {
    #[error(
        "{}: has no record {}: it was written with --no-record, or the record was not copied with it; an output \
         without a record cannot be checked",
        output.display(), path.display()
    )]
    Missing { output: PathBuf, path: PathBuf },
    #[error("{}: {}", path.display(), reason(source))]
    Read { path: PathBuf, source: std::io::Error },
    #[error("{}: is not a record of an output: {problem}; expected the file that `locard composite` or `locard photo` wrote", path.display())]
    Format { path: PathBuf, problem: String },
    #[error(
        "{}: is a record of version {actual}; this program reads version {RECORD_VERSION}: use the program that wrote it",
        path.display()
    )]
    Version { path: PathBuf, actual: u64 },
}

/// The pictures of a record as lines of text in a temporary file, so that memory does not grow with
/// their number.
#[derive(Debug, Default)]
pub struct PictureLines {
    file: Option<std::fs::File>,
}

impl PictureLines {
    pub fn push(&mut self, picture: &PictureRecord) -> io::Result<()> {
        let is_first = self.file.is_none();
        let file = match &mut self.file {
            Some(file) => file,
            none => none.insert(tempfile::tempfile()?),
        };
        let mut line = if is_first { b"\n    ".to_vec() } else { b",\n    ".to_vec() };
        serde_json::to_writer(&mut line, picture)?;
        file.write_all(&line)
    }

    /// Reads the pictures back.
    pub fn read(&mut self) -> io::Result<Vec<PictureRecord>> {
        let mut text = b"[".to_vec();
        self.copy_to(&mut text)?;
        text.push(b']');
        Ok(serde_json::from_slice(&text)?)
    }

    fn copy_to(&mut self, out: &mut dyn Write) -> io::Result<()> {
        let Some(file) = &mut self.file else { return Ok(()) };
        file.seek(SeekFrom::Start(0))?;
        io::copy(file, &mut { out })?;
        Ok(())
    }
}

/// A value as it is read from a record: the reader of JSON may round numbers by a last digit.
pub fn as_read<T: Clone + Serialize + serde::de::DeserializeOwned>(value: &T) -> T {
    let text = serde_json::to_string(value).ok();
    text.and_then(|text| serde_json::from_str(&text).ok()).unwrap_or_else(|| value.clone())
}

/// End of the name of a record, behind the name of its output.
pub const RECORD_ENDING: &str = ".record.json";

/// Path of the record of an output.
pub fn record_path(output: &Path) -> PathBuf {
    // `out/`, `.` and `out/..` have no name of their own.
    let named = output.components().as_path();
    let real = if named.file_name().is_none() { named.canonicalize().ok() } else { None };
    let mut name = real.unwrap_or_else(|| named.to_owned()).into_os_string();
    name.push(RECORD_ENDING);
    name.into()
}

/// Removes the record of an output that is replaced.
pub fn remove_record(output: &Path) -> Result<(), SinkError> {
    let path = record_path(output);
    match std::fs::remove_file(&path) {
        Err(source) if source.kind() != io::ErrorKind::NotFound => Err(SinkError::Write { path, source }),
        _ => Ok(()),
    }
}

/// The output beside which a record lies; `None` for any other file.
pub fn output_of_record(record: &Path) -> Option<PathBuf> {
    let name = record.file_name()?.to_str()?.strip_suffix(RECORD_ENDING)?;
    Some(record.with_file_name(name))
}

impl Record {
    /// Reads the record of an output.
    pub fn read(output: &Path) -> Result<Self, ProvenanceError> {
        let path = record_path(output);
        let text = file::read_text(&path, MAX_TEXT_BYTES).map_err(|source| match source.kind() {
            std::io::ErrorKind::NotFound => ProvenanceError::Missing { output: output.to_owned(), path: path.clone() },
            _ => ProvenanceError::Read { path: path.clone(), source },
        })?;
        let wrong = |problem: String| ProvenanceError::Format { path: path.clone(), problem: quoted(&problem) };
        let value: serde_json::Value = serde_json::from_str(&text).map_err(|error| wrong(error.to_string()))?;
        match value.get("version").and_then(serde_json::Value::as_u64) {
            Some(version) if version != u64::from(RECORD_VERSION) => {
                return Err(ProvenanceError::Version { path, actual: version });
            }
            _ => {}
        }
        let record: Self = serde_json::from_value(value).map_err(|error| wrong(error.to_string()))?;
        record.contradiction().map_or(Ok(record), |problem| Err(wrong(problem)))
    }

    /// A value that no written record has.
    fn contradiction(&self) -> Option<String> {
        let OutputRecord { kind, width, height, bits, .. } = self.output;
        if !matches!(bits, 8 | 16) || width == 0 || height == 0 {
            return Some(format!("its output has {width}x{height} pixels of {bits} bits"));
        }
        let [start, end] = self.range;
        if !self.pictures.is_sorted_by(|a, b| a.frame < b.frame) {
            return Some("its pictures are not in order of their frames".to_owned());
        }
        if let Some(outside) = self.pictures.iter().find(|picture| !(start..end).contains(&picture.frame)) {
            return Some(format!("its frame {} is outside of its range {start}..{end}", outside.frame));
        }
        // A name with a separator would lead out of the folder.
        let is_plain = |name: &str| Path::new(name).file_name().is_some_and(|file| file == name);
        let is_named = |picture: &PictureRecord| picture.file.as_deref().is_some_and(is_plain);
        let unnamed = self.pictures.iter().find(|picture| kind == OutputKind::Frames && !is_named(picture))?;
        Some(format!("its frame {} has no plain file name", unnamed.frame))
    }

    /// Writes the record beside its output, replacing an older one.
    pub fn write(&self, output: &Path) -> Result<(), SinkError> {
        let mut lines = PictureLines::default();
        let listed = self.pictures.iter().try_for_each(|picture| lines.push(picture));
        listed.map_err(|source| SinkError::Write { path: record_path(output), source })?;
        self.write_with_pictures(output, lines)
    }

    /// Like [`Record::write`], with these pictures instead of its own.
    pub fn write_with_pictures(&self, output: &Path, mut pictures: PictureLines) -> Result<(), SinkError> {
        let path = record_path(output);
        let Self { version, work, range, output: written, pictures: _ } = self;
        let (work, written) = (work.clone(), written.clone());
        let head = Self { version: *version, work, range: *range, output: written, pictures: Vec::new() };
        let head = serde_json::to_string_pretty(&head);
        let head = head.map_err(|error| SinkError::Write { path: path.clone(), source: error.into() })?;
        let head = head.strip_suffix("]\n}").unwrap_or(&head);
        write_atomically(&path, true, |file| {
            file.write_all(head.as_bytes())?;
            pictures.copy_to(file)?;
            file.write_all(b"\n  ]\n}\n")
        })
    }

    /// True if two records differ in nothing but their frames: parts of the same work.
    pub fn is_same_work(&self, other: &Self) -> bool {
        let output = |record: &Self| OutputRecord { sha256: None, path: PathBuf::new(), ..record.output.clone() };
        let work = |record: &Self| WorkRecord { command: self.work.command.clone(), ..record.work.clone() };
        as_read(&work(self)) == as_read(&work(other)) && as_read(&output(self)) == as_read(&output(other))
    }

    /// Adds the pictures of an earlier part of the same work, except frames that were written
    /// again.
    pub fn add_pictures(&mut self, earlier: Self) {
        let frames: std::collections::HashSet<usize> = self.pictures.iter().map(|picture| picture.frame).collect();
        self.pictures.extend(earlier.pictures.into_iter().filter(|picture| !frames.contains(&picture.frame)));
        self.pictures.sort_by_key(|picture| picture.frame);
        self.range = [self.range[0].min(earlier.range[0]), self.range[1].max(earlier.range[1])];
    }
}

#[cfg(test)]
pub mod tests {
    use std::collections::BTreeMap;

    use super::super::work::{CommandRecord, DeviceRecord, InputRecord, ProgramRecord, SettingsRecord};
    use super::*;
    use crate::params::Value;

    /// A record of two frames.
    pub fn record() -> Record {
        let picture = |frame: usize| PictureRecord {
            frame,
            file: Some(format!("frame_{frame:06}.png")),
            pixels_sha256: format!("{frame:064}"),
            file_sha256: None,
            rect_px: Some([1, 2, 3, 4]),
            mask: None,
        };
        let input = InputRecord { role: "scene".to_owned(), path: "s.toml".into(), bytes: 3, sha256: "ab".to_owned() };
        let parameters =
            BTreeMap::from([("noise".to_owned(), BTreeMap::from([("scale".to_owned(), Value::Number(0.1))]))]);
        Record {
            version: RECORD_VERSION,
            work: WorkRecord {
                program: ProgramRecord {
                    name: "locard".to_owned(),
                    version: "0.1.0".to_owned(),
                    build: "cd".to_owned(),
                },
                programs: BTreeMap::new(),
                command: CommandRecord { arguments: vec!["composite".to_owned()], folder: "/".into() },
                device: DeviceRecord { adapter: "a".to_owned(), driver: "d".to_owned(), kind: "Cpu".to_owned() },
                seed: 7,
                inputs: vec![input],
                settings: SettingsRecord { parameters, ..SettingsRecord::default() },
            },
            range: [4, 6],
            output: OutputRecord {
                kind: OutputKind::Frames,
                path: "out".into(),
                width: 8,
                height: 6,
                bits: 8,
                codec: "png".to_owned(),
                fps: 29.97,
                sha256: None,
            },
            pictures: vec![picture(4), picture(5)],
        }
    }

    #[test]
    fn record_reads_back_as_written_with_one_picture_a_line() {
        let folder = tempfile::tempdir().unwrap();
        let output = folder.path().join("out/");
        assert_eq!(record_path(&output), folder.path().join("out.record.json"));
        record().write(&output).unwrap();
        assert_eq!(Record::read(&output).unwrap(), record());
        let text = std::fs::read_to_string(record_path(&output)).unwrap();
        assert_eq!(text.lines().filter(|line| line.contains("pixels_sha256")).count(), 2);
        let none = Record { pictures: Vec::new(), ..record() };
        none.write(&output).unwrap();
        assert_eq!(Record::read(&output).unwrap(), none);
    }

    #[test]
    fn unreadable_records_name_the_cause_and_the_remedy() {
        let folder = tempfile::tempdir().unwrap();
        let output = folder.path().join("out");
        let error = || Record::read(&output).unwrap_err().to_string();
        assert!(error().contains("has no record") && error().contains("cannot be checked"));
        std::fs::write(record_path(&output), "{}").unwrap();
        assert!(error().contains("is not a record of an output: missing field `version`"), "{}", error());
        std::fs::write(record_path(&output), "{\"version\": 9}").unwrap();
        assert!(error().contains("version 9; this program reads version 1"), "{}", error());
        std::fs::write(record_path(&output), [0xff, 0xfe]).unwrap();
        assert!(error().contains("not text in UTF-8"), "{}", error());
    }

    #[test]
    fn contradicting_records_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let output = folder.path().join("out");
        let refusal = |change: fn(&mut Record)| {
            let mut record = record();
            change(&mut record);
            record.write(&output).unwrap();
            Record::read(&output).unwrap_err().to_string()
        };
        assert!(refusal(|record| record.output.bits = 12).contains("pixels of 12 bits"));
        assert!(refusal(|record| record.pictures.swap(0, 1)).contains("not in order"));
        assert!(refusal(|record| record.pictures[1].frame = usize::MAX).contains("outside of its range 4..6"));
        let outside = refusal(|record| record.pictures[0].file = Some("../a.png".to_owned()));
        assert!(outside.contains("its frame 4 has no plain file name"), "{outside}");
        assert_eq!(output_of_record(&record_path(&output)), Some(output));
    }

    #[test]
    fn parts_of_the_same_work_are_joined_and_frames_made_again_replace_earlier_ones() {
        let (mut later, mut earlier) = (record(), record());
        earlier.range = [3, 5];
        earlier.pictures[0].frame = 3;
        earlier.pictures[1].frame = 4;
        earlier.pictures[1].pixels_sha256 = "old".to_owned();
        assert!(later.is_same_work(&earlier));
        later.add_pictures(earlier.clone());
        assert_eq!(later.range, [3, 6]);
        assert_eq!(later.pictures.iter().map(|picture| picture.frame).collect::<Vec<_>>(), [3, 4, 5]);
        assert_ne!(later.pictures[1].pixels_sha256, "old");
        earlier.work.seed = 8;
        assert!(!later.is_same_work(&earlier));
    }
}
