//! Parts: composited outputs with the records beside them.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::error::FarmError;
use crate::provenance::{
    InputRecord, OutputKind, PictureRecord, Record, WorkRecord, file_digest, has_signature, output_of_record,
    record_path,
};

/// An output with its record.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedPart {
    /// The folder or video file.
    pub path: PathBuf,
    /// The record without its inputs.
    pub record: Record,
    /// The files that were read. Parts of one recording share the list, which has all of its
    /// frames.
    pub inputs: Arc<[InputRecord]>,
}

impl RecordedPart {
    /// Reads the record beside an output. Fails if the record is missing, has another version, or
    /// contradicts itself.
    pub fn read(output: &Path) -> Result<Self, FarmError> {
        let mut record = Record::read(output)?;
        if record.output.kind == OutputKind::Photograph {
            let problem = "is a photograph, and no part of frames; leave it out";
            return Err(FarmError::refused(output, problem));
        }
        let inputs = std::mem::take(&mut record.work.inputs).into();
        let part = Self { path: output.to_owned(), record, inputs };
        match part.contradiction() {
            Some(problem) => Err(FarmError::refused(&record_path(output), format!("{problem}; recreate the part"))),
            None => Ok(part),
        }
    }

    /// The program, its command and its settings, without the inputs.
    pub fn work(&self) -> &WorkRecord {
        &self.record.work
    }

    pub fn is_video(&self) -> bool {
        self.record.output.kind == OutputKind::Video
    }

    /// Frames of the recording.
    pub fn range(&self) -> Range<usize> {
        let [start, end] = self.record.range;
        start..end
    }

    /// The frame files with their hashes, in order; empty for a video.
    pub fn frame_files(&self) -> impl Iterator<Item = (PathBuf, &PictureRecord)> {
        let picture_path = |picture: &PictureRecord| picture.file.as_ref().map(|name| self.path.join(name));
        self.record.pictures.iter().filter_map(move |picture| Some((picture_path(picture)?, picture)))
    }

    /// True if its video or a frame has a C2PA signature, valid or not.
    pub fn is_signed(&self) -> bool {
        if self.is_video() {
            has_signature(&self.path)
        } else {
            self.frame_files().any(|(file, _)| has_signature(&file))
        }
    }

    /// A field that contradicts another one.
    fn contradiction(&self) -> Option<String> {
        let Record { output, pictures, .. } = &self.record;
        let range = self.range();
        if range.is_empty() {
            return Some(format!("its range {}..{} is empty", range.start, range.end));
        }
        let is_unlisted = self.is_video() && pictures.is_empty();
        if !is_unlisted && !pictures.iter().map(|picture| picture.frame).eq(range.clone()) {
            return Some(format!("its pictures are not the frames {}..{} in order", range.start, range.end));
        }
        if self.is_video() {
            return output.sha256.is_none().then(|| "it has no hash of its video".to_owned());
        }
        let odd = pictures.iter().find(|picture| picture.file_sha256.is_none())?;
        Some(format!("its frame {} has no hash of its file", odd.frame))
    }
}

/// The parts that arguments name, in order of their frames: outputs with a record beside them,
/// their records, or folders that hold such outputs.
pub fn parts_at(arguments: &[PathBuf]) -> Result<Vec<RecordedPart>, FarmError> {
    let mut outputs = Vec::new();
    for argument in arguments {
        outputs.extend(outputs_at(argument)?);
    }
    let mut parts: Vec<RecordedPart> = Vec::new();
    for output in outputs {
        let mut part = RecordedPart::read(&output)?;
        if let Some(first) = parts.first().filter(|first| first.inputs == part.inputs) {
            part.inputs = Arc::clone(&first.inputs);
        }
        parts.push(part);
    }
    parts.sort_by_key(|part| part.record.range);
    Ok(parts)
}

/// The outputs that one argument names.
fn outputs_at(argument: &Path) -> Result<Vec<PathBuf>, FarmError> {
    if let Some(output) = output_of_record(argument) {
        return Ok(vec![output]);
    }
    if record_path(argument).is_file() {
        return Ok(vec![argument.to_owned()]);
    }
    if !argument.exists() {
        return Err(FarmError::reading(argument, std::io::ErrorKind::NotFound.into()));
    }
    let outputs = if argument.is_dir() { outputs_in(argument)? } else { Vec::new() };
    if outputs.is_empty() { Err(FarmError::refused(argument, missing_record(argument))) } else { Ok(outputs) }
}

fn missing_record(output: &Path) -> String {
    format!(
        "has no record {} beside it, and holds no outputs that have one; expected outputs of `locard composite`",
        record_path(output).display()
    )
}

/// Outputs in a folder that have a record, sorted by name. The unfinished file of an encoder that
/// was killed has none.
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
                let sha256 = file_sha256(&output.join(&name)).unwrap();
                json!({ "frame": frame, "file": name, "pixels_sha256": format!("{frame:064x}"), "file_sha256": sha256 })
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

    /// A record with an output and pictures, in the format of [`Record`].
    pub(crate) fn record(
        range: Range<usize>,
        output: serde_json::Value,
        pictures: &[serde_json::Value],
    ) -> serde_json::Value {
        let fields = json!({
            "version": 1,
            "program": { "name": "locard", "version": "0.1.0", "build": "b1" },
            "command": { "arguments": ["composite", "/r/take"], "folder": "/" },
            "device": { "adapter": "llvmpipe", "driver": "Mesa", "kind": "Cpu" },
            "seed": 0,
            "range": [range.start, range.end],
            "inputs": [
                { "role": "scene", "path": "s.toml", "bytes": 1, "sha256": "aa" },
                { "role": "recording", "path": "0.png", "bytes": 1, "sha256": "f0" },
            ],
            "settings": { "parameters": { "noise": { "scale": 0.5 } }, "without": [] },
            "output": output,
            "pictures": pictures,
        });
        serde_json::to_value(serde_json::from_value::<Record>(fields).unwrap()).unwrap()
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
        let parts = parts_at(&[temp.path().to_owned()]).unwrap();
        assert!(Arc::ptr_eq(&parts[0].inputs, &parts[1].inputs));
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
        assert!(version.contains("record.json") && version.contains("version 2"), "{version}");
        let empty = refusal(|value| value["range"] = json!([2, 2]));
        assert!(empty.contains("record.json: "), "{empty}");
        let short = refusal(|value| _ = value["pictures"].as_array_mut().unwrap().pop());
        assert!(short.contains("its pictures are not the frames 0..2 in order; recreate the part"), "{short}");
        let outside = refusal(|value| value["pictures"][1]["file"] = "../frame.png".into());
        assert!(outside.contains("record.json: "), "{outside}");
        let unhashed = refusal(|value| _ = value["pictures"][1].as_object_mut().unwrap().remove("file_sha256"));
        assert!(unhashed.contains("its frame 1 has no hash of its file"), "{unhashed}");
        let other = refusal(|value| *value = json!({ "version": 1 }));
        assert!(other.contains("record.json: is not a record of an output: missing field"), "{other}");
        let none = parts_at(&[output.join("frame_000000.png")]).unwrap_err().to_string();
        assert!(none.contains("has no record") && none.contains("expected outputs of `locard composite`"), "{none}");
    }
}
