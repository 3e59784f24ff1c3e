//! The record of a joined output: the first part's, with all frames and inputs.

use std::collections::HashSet;
use std::path::Path;
use std::sync::Arc;

use serde_json::{Value, json};

use super::agreement::input_key;
use super::error::FarmError;
use super::part_record::RecordedPart;
use crate::provenance::{InputRecord, record_path};

/// Merges the records of parts in order of their frames. `video_sha256` is the hash of a joined
/// video. Fails if a path has no text.
pub fn joined_record(
    parts: &[RecordedPart],
    out: &Path,
    command: &Value,
    video_sha256: Option<&str>,
) -> Result<Value, FarmError> {
    let (Some(first), Some(last)) = (parts.first(), parts.last()) else {
        return Err(FarmError::Plan("there are no parts to join".to_owned()));
    };
    // The command of the first part recomputes each frame.
    let mut record = first.record.clone();
    record.range = [first.range().start, last.range().end];
    record.work.inputs = merged_inputs(parts);
    record.pictures.extend(parts.iter().skip(1).flat_map(|part| part.record.pictures.iter().cloned()));
    record.output.path = out.to_owned();
    record.output.sha256 = video_sha256.map(str::to_owned);
    let unwritable = |error: serde_json::Error| {
        FarmError::refused(&record_path(out), format!("cannot be written: {error}; rename the file or folder"))
    };
    let mut value = serde_json::to_value(record).map_err(unwritable)?;
    if let Some(fields) = value.as_object_mut() {
        fields.insert("join".to_owned(), command.clone());
        fields.insert("parts".to_owned(), parts.iter().map(|part| json!(part.record.range)).collect());
    }
    Ok(value)
}

/// The inputs of all parts, each content under a name once, in the order of their first use, with
/// absolute paths.
fn merged_inputs(parts: &[RecordedPart]) -> Vec<InputRecord> {
    let (mut keys, mut inputs) = (HashSet::new(), Vec::new());
    let mut earlier: Option<&RecordedPart> = None;
    for part in parts {
        if earlier.is_some_and(|earlier| Arc::ptr_eq(&earlier.inputs, &part.inputs)) {
            continue;
        }
        let folder = &part.work().command.folder;
        let others = part.inputs.iter().filter(|input| keys.insert(input_key(input)));
        inputs.extend(others.map(|input| InputRecord { path: folder.join(&input.path), ..input.clone() }));
        earlier = Some(part);
    }
    inputs
}

#[cfg(test)]
mod tests {
    use super::super::part_record::parts_at;
    use super::super::part_record::tests::{edit, folder_part};
    use super::*;

    #[test]
    fn joined_record_has_the_whole_range_and_each_input_once() {
        let temp = tempfile::tempdir().unwrap();
        folder_part(temp.path(), 4..6);
        // Another machine has the recording elsewhere.
        edit(&folder_part(temp.path(), 6..7), |value| value["inputs"][1]["path"] = "/other/0.png".into());
        let parts = parts_at(&[temp.path().to_owned()]).unwrap();
        let command = json!({ "arguments": ["join"], "folder": "/a" });
        let record = joined_record(&parts, &temp.path().join("out"), &command, None).unwrap();
        assert_eq!(
            (&record["range"], &record["join"], &record["parts"]),
            (&json!([4, 7]), &command, &json!([[4, 6], [6, 7]]))
        );
        assert_eq!(record["command"], json!(parts[0].work().command));
        let frames: Vec<_> = record["pictures"].as_array().unwrap().iter().map(|picture| &picture["frame"]).collect();
        assert_eq!(frames, [4, 5, 6]);
        let paths: Vec<_> = record["inputs"].as_array().unwrap().iter().map(|input| &input["path"]).collect();
        assert_eq!(paths, ["/s.toml", "/0.png"]);
        // It is a record itself.
        std::fs::create_dir(temp.path().join("out")).unwrap();
        std::fs::write(record_path(&temp.path().join("out")), record.to_string()).unwrap();
        assert_eq!(parts_at(&[temp.path().join("out")]).unwrap()[0].range(), 4..7);
    }
}
