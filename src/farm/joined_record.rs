//! The record of a joined output: the first part's, with all frames and inputs.

use std::collections::HashSet;
use std::path::Path;

use serde_json::{Value, json};

use super::part_record::RecordedPart;

/// Merges the records of parts in order of their frames. `video_sha256` is the hash of a joined
/// video.
pub fn joined_record(parts: &[RecordedPart], out: &Path, command: &Value, video_sha256: Option<&str>) -> Value {
    let mut record = parts.first().map(|part| part.value.clone()).unwrap_or_default();
    let start = parts.first().map(|part| part.range().start);
    let end = parts.last().map(|part| part.range().end);
    // The command of the first part makes each frame again.
    record["join"] = command.clone();
    record["range"] = json!([start, end]);
    record["inputs"] = merged_inputs(parts);
    record["pictures"] = parts.iter().flat_map(|part| array(&part.value, "pictures")).cloned().collect();
    record["parts"] = parts.iter().map(|part| json!(part.record.range)).collect();
    let output = &mut record["output"];
    output["path"] = json!(out);
    match (video_sha256, output.as_object_mut()) {
        (Some(sha256), Some(fields)) => _ = fields.insert("sha256".to_owned(), sha256.into()),
        (None, Some(fields)) => _ = fields.remove("sha256"),
        (_, None) => {}
    }
    record
}

/// The inputs of all parts, each once, in the order of their first use.
fn merged_inputs(parts: &[RecordedPart]) -> Value {
    let mut texts = HashSet::new();
    let inputs = parts.iter().flat_map(|part| array(&part.value, "inputs"));
    inputs.filter(|input| texts.insert(input.to_string())).cloned().collect()
}

fn array<'a>(value: &'a Value, key: &str) -> impl Iterator<Item = &'a Value> {
    value.get(key).and_then(Value::as_array).into_iter().flatten()
}

#[cfg(test)]
mod tests {
    use super::super::part_record::parts_at;
    use super::super::part_record::tests::folder_part;
    use super::*;
    use crate::provenance::record_path;

    #[test]
    fn joined_record_has_the_whole_range_and_each_input_once() {
        let temp = tempfile::tempdir().unwrap();
        for range in [4..6, 6..7] {
            folder_part(temp.path(), range);
        }
        let parts = parts_at(&[temp.path().to_owned()]).unwrap();
        let command = json!({ "arguments": ["join"], "folder": "/a" });
        let record = joined_record(&parts, &temp.path().join("out"), &command, None);
        assert_eq!(
            (&record["range"], &record["join"], &record["parts"]),
            (&json!([4, 7]), &command, &json!([[4, 6], [6, 7]]))
        );
        assert_eq!(record["command"], parts[0].value["command"]);
        let frames: Vec<_> = record["pictures"].as_array().unwrap().iter().map(|picture| &picture["frame"]).collect();
        assert_eq!(frames, [4, 5, 6]);
        let paths: Vec<_> = record["inputs"].as_array().unwrap().iter().map(|input| &input["path"]).collect();
        assert_eq!(paths, ["s.toml", "4.png", "6.png"]);
        // It is a record itself.
        std::fs::create_dir(temp.path().join("out")).unwrap();
        std::fs::write(record_path(&temp.path().join("out")), record.to_string()).unwrap();
        assert_eq!(parts_at(&[temp.path().join("out")]).unwrap()[0].range(), 4..7);
    }
}
