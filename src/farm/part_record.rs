//! The record beside a composited output, as far as joining reads it.

use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::error::FarmError;
use crate::provenance::{RECORD_ENDING, RECORD_VERSION, file_digest, record_path};
use crate::source::file::{self, MAX_TEXT_BYTES};

/// The record of an output. Fields that joining does not need are left out.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct PartRecord {
    pub version: u32,
    pub program: PartProgram,
    #[serde(default)]
    pub command: PartCommand,
    pub device: PartDevice,
    /// Seed of the noise.
    #[serde(default)]
    pub seed: u64,
    /// Start and exclusive end, in frames of the recording.
    pub range: [usize; 2],
    #[serde(default)]
    pub inputs: Vec<PartInput>,
    /// Profile, scene and effects, in any form; compared as a whole.
    #[serde(default)]
    pub settings: serde_json::Value,
    pub output: PartOutput,
    #[serde(default)]
    pub pictures: Vec<PartPicture>,
}

/// The program that composited the output.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
pub struct PartProgram {
    pub name: String,
    pub version: String,
    /// Identifier of the build, hexadecimal.
    pub build: String,
}

/// The command line.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
pub struct PartCommand {
    #[serde(default)]
    pub arguments: Vec<String>,
    /// Working folder, absolute.
    #[serde(default)]
    pub folder: PathBuf,
}

/// The graphics adapter.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
pub struct PartDevice {
    pub adapter: String,
    pub driver: String,
    /// `Cpu`, `DiscreteGpu`, `IntegratedGpu` and so on.
    pub kind: String,
}

/// A file that was read.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct PartInput {
    pub role: String,
    /// Absolute, or relative to the command's folder.
    pub path: String,
    #[serde(default)]
    pub bytes: u64,
    /// Hexadecimal.
    pub sha256: String,
}

/// Format of the output.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct PartOutput {
    /// `frames` or `video`.
    pub kind: String,
    pub width: u32,
    pub height: u32,
    /// 8 or 16.
    pub bits: u32,
    #[serde(default)]
    pub codec: String,
    /// Frames per second; of a video.
    #[serde(default)]
    pub fps: Option<f64>,
    /// Of a video's file, hexadecimal.
    #[serde(default)]
    pub sha256: Option<String>,
}

/// A frame of the output.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct PartPicture {
    pub frame: usize,
    /// Name in the output's folder; absent in a video.
    #[serde(default)]
    pub file: Option<String>,
    /// Hexadecimal.
    #[serde(default)]
    pub file_sha256: Option<String>,
}

impl PartOutput {
    pub fn is_video(&self) -> bool {
        self.kind == "video"
    }
}

/// An output with its record.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedPart {
    /// The folder or video file.
    pub path: PathBuf,
    pub record: PartRecord,
    /// The whole record, with fields that [`PartRecord`] leaves out.
    pub value: serde_json::Value,
}

impl RecordedPart {
    /// Reads the record beside an output. Fails if the record is missing, has another version, or
    /// contradicts itself.
    pub fn read(output: &Path) -> Result<Self, FarmError> {
        let path = record_path(output);
        let text = file::read_text(&path, MAX_TEXT_BYTES).map_err(|source| FarmError::reading(&path, source))?;
        let invalid = |error: serde_json::Error| {
            FarmError::refused(&path, format!("is not a record of `locard composite`: {error}; make the part again"))
        };
        let value: serde_json::Value = serde_json::from_str(&text).map_err(invalid)?;
        let version = value.get("version").and_then(serde_json::Value::as_u64);
        if version != Some(RECORD_VERSION.into()) {
            let version = version.map_or("no version".to_owned(), |version| format!("version {version}"));
            let problem =
                format!("has {version}, expected version {RECORD_VERSION}; join with the program of the parts");
            return Err(FarmError::refused(&path, problem));
        }
        let record: PartRecord = serde_json::from_value(value.clone()).map_err(invalid)?;
        let part = Self { path: output.to_owned(), record, value };
        match part.contradiction() {
            Some(problem) => Err(FarmError::refused(&path, format!("{problem}; make the part again"))),
            None => Ok(part),
        }
    }

    /// Frames of the recording.
    pub fn range(&self) -> Range<usize> {
        let [start, end] = self.record.range;
        start..end
    }

    /// The frame files with their hashes, in order; empty for a video.
    pub fn frame_files(&self) -> impl Iterator<Item = (PathBuf, &PartPicture)> {
        let of = |picture: &PartPicture| picture.file.as_ref().map(|name| self.path.join(name));
        self.record.pictures.iter().filter_map(move |picture| Some((of(picture)?, picture)))
    }

    /// A field that contradicts another one.
    fn contradiction(&self) -> Option<String> {
        let PartRecord { output, pictures, .. } = &self.record;
        let range = self.range();
        if range.is_empty() {
            return Some(format!("its range {}..{} is empty", range.start, range.end));
        }
        let is_unlisted = output.is_video() && pictures.is_empty();
        if !is_unlisted && !pictures.iter().map(|picture| picture.frame).eq(range.clone()) {
            return Some(format!("its pictures are not the frames {}..{} in order", range.start, range.end));
        }
        if output.is_video() {
            return output.sha256.is_none().then(|| "it has no hash of its video".to_owned());
        }
        // A name with a separator would lead out of the folder.
        let is_plain = |name: &str| !name.is_empty() && Path::new(name).file_name().is_some_and(|file| file == name);
        let is_odd =
            |picture: &&PartPicture| !picture.file.as_deref().is_some_and(is_plain) || picture.file_sha256.is_none();
        let odd = pictures.iter().find(is_odd)?;
        Some(format!("its frame {} has no file name or no hash", odd.frame))
    }
}

/// The parts that arguments name, in order of their frames: outputs with a record beside them,
/// their records, or folders that hold such outputs.
pub fn parts_at(arguments: &[PathBuf]) -> Result<Vec<RecordedPart>, FarmError> {
    let mut parts = Vec::new();
    for argument in arguments {
        if let Some(output) = output_of_record(argument) {
            parts.push(RecordedPart::read(&output)?);
        } else if record_path(argument).is_file() {
            parts.push(RecordedPart::read(argument)?);
        } else if argument.is_dir() {
            let outputs = outputs_in(argument)?;
            if outputs.is_empty() {
                return Err(FarmError::refused(argument, missing_record(argument)));
            }
            for output in outputs {
                parts.push(RecordedPart::read(&output)?);
            }
        } else if argument.exists() {
            return Err(FarmError::refused(argument, missing_record(argument)));
        } else {
            return Err(FarmError::reading(argument, std::io::ErrorKind::NotFound.into()));
        }
    }
    parts.sort_by_key(|part| part.record.range);
    Ok(parts)
}

fn missing_record(output: &Path) -> String {
    format!(
        "has no record {} beside it, and holds no outputs that have one; expected outputs of `locard composite`",
        record_path(output).display()
    )
}

fn output_of_record(path: &Path) -> Option<PathBuf> {
    let name = path.file_name()?.to_str()?.strip_suffix(RECORD_ENDING)?;
    Some(path.with_file_name(name))
}

/// Outputs in a folder that have a record, sorted by name.
fn outputs_in(folder: &Path) -> Result<Vec<PathBuf>, FarmError> {
    let failed = |source| FarmError::reading(folder, source);
    let mut outputs = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        outputs.extend(output_of_record(&entry.map_err(failed)?.path()));
    }
    outputs.sort();
    Ok(outputs)
}

/// SHA-256 of a file, hexadecimal, as `sha256sum` gives it.
pub fn file_sha256(path: &Path) -> Result<String, FarmError> {
    Ok(file_digest(path).map_err(|source| FarmError::reading(path, source))?.sha256)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use serde_json::json;

    /// The record of a folder with a file `frame_N.png` of the text `frame N` for each frame.
    pub(crate) fn folder_part(folder: &Path, range: Range<usize>) -> PathBuf {
        let output = folder.join(format!("part_{:06}_{:06}", range.start, range.end));
        std::fs::create_dir_all(&output).unwrap();
        let pictures: Vec<_> = range
            .clone()
            .map(|frame| {
                let name = format!("frame_{frame:06}.png");
                std::fs::write(output.join(&name), format!("frame {frame}")).unwrap();
                json!({ "frame": frame, "file": name, "file_sha256": file_sha256(&output.join(&name)).unwrap() })
            })
            .collect();
        let record = record(
            range,
            json!({ "kind": "frames", "path": output, "width": 2, "height": 1, "bits": 8,
            "codec": "png", "fps": 30.0 }),
            &pictures,
        );
        std::fs::write(record_path(&output), record.to_string()).unwrap();
        output
    }

    /// A record with an output and pictures.
    pub(crate) fn record(
        range: Range<usize>,
        output: serde_json::Value,
        pictures: &[serde_json::Value],
    ) -> serde_json::Value {
        json!({
            "version": 1,
            "program": { "name": "locard", "version": "0.1.0", "build": "b1" },
            "command": { "arguments": ["composite"], "folder": "/" },
            "device": { "adapter": "llvmpipe", "driver": "Mesa", "kind": "Cpu" },
            "seed": 0,
            "range": [range.start, range.end],
            "inputs": [
                { "role": "scene", "path": "s.toml", "bytes": 1, "sha256": "aa" },
                { "role": "frames", "path": format!("{}.png", range.start), "bytes": 1, "sha256": "f0" },
            ],
            "settings": { "profile": "", "scene": "", "effects": "all" },
            "output": output,
            "pictures": pictures,
        })
    }

    /// Changes a part's record on disk.
    pub(crate) fn edit(output: &Path, change: impl FnOnce(&mut serde_json::Value)) {
        let path = record_path(output);
        let mut value: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
        change(&mut value);
        std::fs::write(path, value.to_string()).unwrap();
    }

    #[test]
    fn parts_of_a_folder_come_in_order_of_their_frames() {
        let temp = tempfile::tempdir().unwrap();
        let second = folder_part(temp.path(), 10..12);
        let first = folder_part(temp.path(), 2..10);
        let ranges = |arguments: &[PathBuf]| -> Vec<Range<usize>> {
            parts_at(arguments).unwrap().iter().map(RecordedPart::range).collect()
        };
        assert_eq!(ranges(&[temp.path().to_owned()]), [2..10, 10..12]);
        assert_eq!(ranges(&[record_path(&second), first]), [2..10, 10..12]);
    }

    #[test]
    fn unusable_record_is_refused_with_its_path_and_advice() {
        let temp = tempfile::tempdir().unwrap();
        let output = folder_part(temp.path(), 0..2);
        let refusal = |change: fn(&mut serde_json::Value)| {
            folder_part(temp.path(), 0..2);
            edit(&output, change);
            RecordedPart::read(&output).unwrap_err().to_string()
        };
        let version = refusal(|value| value["version"] = 2.into());
        assert!(version.contains("record.json: has version 2, expected version 1; join with"), "{version}");
        let empty = refusal(|value| value["range"] = json!([2, 2]));
        assert!(empty.contains("its range 2..2 is empty; make the part again"), "{empty}");
        let short = refusal(|value| _ = value["pictures"].as_array_mut().unwrap().pop());
        assert!(short.contains("its pictures are not the frames 0..2 in order"), "{short}");
        let outside = refusal(|value| value["pictures"][1]["file"] = "../frame.png".into());
        assert!(outside.contains("its frame 1 has no file name or no hash"), "{outside}");
        let other = refusal(|value| *value = json!({ "version": 1 }));
        assert!(other.contains("is not a record of `locard composite`: missing field"), "{other}");
        let none = parts_at(&[output.join("frame_000000.png")]).unwrap_err().to_string();
        assert!(none.contains("has no record") && none.contains("expected outputs of `locard composite`"), "{none}");
    }
}
