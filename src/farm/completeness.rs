//! Whether a part is there already, so that it need not be recreated.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use super::error::FarmError;
use super::part_record::{RecordedPart, file_sha256};
use crate::parallel::{over_items, processors};
use crate::provenance::record_path;

/// State of a part on disk.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PartState {
    /// There is no record.
    Absent,
    /// Record, inputs and output fit.
    Complete,
    /// It must be recreated, for this reason.
    Outdated(String),
}

/// State of the output at a path, compared with the output of this build's command with these
/// arguments, on an adapter of this kind (`None`: of any).
pub fn part_state(output: &Path, arguments: &[String], build: &str, adapter_kind: Option<&str>) -> PartState {
    if !record_path(output).exists() {
        return PartState::Absent;
    }
    let outdated = |reason: &str| PartState::Outdated(reason.to_owned());
    let part = match RecordedPart::read(output) {
        Ok(part) => part,
        Err(error) => return PartState::Outdated(error.to_string()),
    };
    if part.work().program.build != build {
        return outdated("another build of the program made it");
    }
    if adapter_kind.is_some_and(|kind| kind != part.work().device.kind) {
        return outdated("an adapter of another kind made it");
    }
    if part.work().command.arguments != arguments {
        return outdated("other arguments made it");
    }
    match check_inputs(&part).and_then(|()| check_outputs(std::slice::from_ref(&part))) {
        Ok(()) => PartState::Complete,
        Err(error) => PartState::Outdated(error.to_string()),
    }
}

/// Checks that the files that a part was made from are unchanged.
fn check_inputs(part: &RecordedPart) -> Result<(), FarmError> {
    let folder = &part.work().command.folder;
    let files: Vec<_> = part.inputs.iter().map(|input| (folder.join(&input.path), &*input.sha256)).collect();
    check_hashes(&files, "changed since a part was made of it; recreate the part")
}

/// Checks that the files of parts are those that their records name.
pub(super) fn check_outputs(parts: &[RecordedPart]) -> Result<(), FarmError> {
    let mut files: Vec<(PathBuf, &str)> = Vec::new();
    for part in parts {
        if let Some(sha256) = part.record.output.sha256.as_deref().filter(|_| part.is_video()) {
            files.push((part.path.clone(), sha256));
        }
        files.extend(part.frame_files().filter_map(|(path, picture)| Some((path, picture.file_sha256.as_deref()?))));
    }
    check_hashes(&files, "differs from the record of its part; recreate the part")
}

/// Checks the SHA-256 of files, on all processors. Reports the first file that differs.
fn check_hashes(files: &[(PathBuf, &str)], problem: &str) -> Result<(), FarmError> {
    // No memo: the first failure of this check.
    let failure: Mutex<Option<(usize, FarmError)>> = Mutex::new(None);
    let lock = || failure.lock().unwrap_or_else(PoisonError::into_inner);
    over_items(files.iter().enumerate().collect(), processors(), |(index, (path, sha256))| {
        // Files after a failure need no check.
        if lock().as_ref().is_some_and(|(first, _)| *first < index) {
            return;
        }
        let error = match file_sha256(path) {
            Ok(actual) if actual == *sha256 => return,
            Ok(_) => FarmError::refused(path, problem),
            Err(error) => error,
        };
        let mut failure = lock();
        if failure.as_ref().is_none_or(|(first, _)| index < *first) {
            *failure = Some((index, error));
        }
    });
    let failure = failure.into_inner().unwrap_or_else(PoisonError::into_inner);
    failure.map_or(Ok(()), |(_, error)| Err(error))
}

#[cfg(test)]
mod tests {
    use super::super::part_record::tests::{edit, folder_part};
    use super::*;
    use serde_json::json;

    #[test]
    fn part_is_complete_only_while_record_inputs_and_files_fit() {
        let temp = tempfile::tempdir().unwrap();
        let input = temp.path().join("scene.toml");
        std::fs::write(&input, "a").unwrap();
        let make = || {
            std::fs::write(&input, "a").unwrap();
            let output = folder_part(temp.path(), 0..3);
            edit(&output, |value| {
                value["command"] = json!({ "arguments": ["composite", "r"], "folder": temp.path() });
                value["inputs"] = json!([{ "role": "scene", "path": "scene.toml", "bytes": 1, "sha256": file_sha256(&input).unwrap() }]);
            });
            output
        };
        let output = make();
        let arguments = ["composite", "r"].map(str::to_owned);
        let state = |build: &str, arguments: &[String]| part_state(&output, arguments, build, Some("Cpu"));
        assert_eq!(state("b1", &arguments), PartState::Complete);
        let reason = |state: PartState| match state {
            PartState::Outdated(reason) => reason,
            other => panic!("{other:?}"),
        };
        assert_eq!(reason(state("b2", &arguments)), "another build of the program made it");
        let on_a_card = part_state(&output, &arguments, "b1", Some("DiscreteGpu"));
        assert_eq!(reason(on_a_card), "an adapter of another kind made it");
        assert_eq!(part_state(&output, &arguments, "b1", None), PartState::Complete);
        assert_eq!(reason(state("b1", &arguments[..1])), "other arguments made it");
        std::fs::write(&input, "b").unwrap();
        assert!(reason(state("b1", &arguments)).contains("scene.toml: changed since a part was made of it"));
        make();
        std::fs::write(output.join("frame_000001.png"), "half").unwrap();
        assert!(reason(state("b1", &arguments)).contains("frame_000001.png: differs from the record of its part"));
        std::fs::remove_file(output.join("frame_000001.png")).unwrap();
        assert!(reason(state("b1", &arguments)).contains("frame_000001.png: cannot be read"));
        std::fs::remove_file(record_path(&output)).unwrap();
        assert_eq!(state("b1", &arguments), PartState::Absent);
    }
}
