//! The record beside a photograph: `NAME.jpg.record.json`, whose value `photograph` holds its
//! [`Particulars`].

use std::io::{self, Write};
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::particulars::Particulars;
pub use crate::provenance::record_path;
use crate::provenance::{RECORD_VERSION, WorkRecord, file_digest, output_of_record};
use crate::sink::SinkError;
use crate::sink::atomic::write_atomically;
use crate::source::file as plain;
use crate::text::reason;

/// Largest record that is read, bytes: ten thousand objects in view.
const MAX_RECORD_BYTES: u64 = 4 << 20;

/// The part of a record that this module writes and reads. Other values are ignored.
#[derive(Debug, Deserialize, Serialize)]
struct PhotoRecord {
    version: u32,
    #[serde(flatten, default, skip_serializing_if = "Option::is_none")]
    work: Option<WorkRecord>,
    /// Digest of the photograph's file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    file_sha256: Option<String>,
    photograph: Option<Particulars>,
}

/// Writes the record of a photograph; an existing one belongs to an earlier photograph of that name
/// and is replaced. A case card has no `work`.
pub fn write_record(photograph: &Path, particulars: &Particulars, work: Option<&WorkRecord>) -> Result<(), SinkError> {
    let record = PhotoRecord {
        version: RECORD_VERSION,
        work: work.cloned(),
        file_sha256: file_digest(photograph).ok().map(|digest| digest.sha256),
        photograph: Some(particulars.clone()),
    };
    write_atomically(&record_path(photograph), true, |out| {
        serde_json::to_writer_pretty(&mut *out, &record).map_err(io::Error::from)?;
        out.write_all(b"\n")
    })
}

/// The particulars in the record of a photograph. `Ok(None)` for a record of something else. The
/// error names the file and the problem.
pub fn read_record(photograph: &Path) -> Result<Option<Particulars>, String> {
    let path = record_path(photograph);
    let bytes = plain::read(&path, MAX_RECORD_BYTES).map_err(|error| {
        format!(
            "{}: cannot be read: {}; `locard photo` and `locard case-card` write it beside the photograph",
            path.display(),
            reason(&error)
        )
    })?;
    let record: PhotoRecord = serde_json::from_slice(&bytes)
        .map_err(|error| format!("{}: is no record of a photograph: {error}", path.display()))?;
    if record.version != RECORD_VERSION {
        return Err(format!("{}: version {}: expected {RECORD_VERSION}", path.display(), record.version));
    }
    match (&record.file_sha256, file_digest(photograph)) {
        (Some(sha256), Ok(digest)) if digest.sha256 != *sha256 => {
            Err(format!("{}: has changed since its record was written", photograph.display()))
        }
        _ => Ok(record.photograph),
    }
}

/// Number of the next photograph in a folder: that of the photograph at `path` if it is replaced,
/// otherwise one more than the largest number of a record there. Unreadable records are skipped.
pub fn next_number(path: &Path) -> u32 {
    if let Ok(Some(replaced)) = read_record(path) {
        return replaced.number;
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let photographs = entries.filter_map(|entry| output_of_record(&entry.path()));
    let numbers = photographs.filter_map(|photograph| read_record(&photograph).ok().flatten()).map(|p| p.number);
    numbers.max().unwrap_or(0).saturating_add(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::photo::card::CaseCard;
    use crate::photo::particulars::PhotoContent;

    fn card(number: u32) -> Particulars {
        Particulars {
            number,
            taken: "2026-11-30 12:00:00".to_owned(),
            content: PhotoContent::Card(CaseCard::default()),
        }
    }

    #[test]
    fn written_record_reads_back_equal_and_numbers_continue() {
        let temp = tempfile::tempdir().unwrap();
        let at = |name: &str| temp.path().join(name);
        assert_eq!(next_number(&at("a.jpg")), 1);
        write_record(&at("a.jpg"), &card(1), None).unwrap();
        write_record(&at("b.jpg"), &card(7), None).unwrap();
        std::fs::write(at("c.jpg.record.json"), "{").unwrap();
        assert_eq!(read_record(&at("b.jpg")), Ok(Some(card(7))));
        assert_eq!((next_number(&at("a.jpg")), next_number(&at("d.jpg"))), (1, 8));
    }

    #[test]
    fn other_values_of_a_record_are_ignored_and_bad_ones_refused() {
        let temp = tempfile::tempdir().unwrap();
        let photograph = temp.path().join("a.jpg");
        let read = |text: &str| {
            std::fs::write(record_path(&photograph), text).unwrap();
            read_record(&photograph)
        };
        assert_eq!(read(r#"{"version":1,"program":"locard"}"#), Ok(None));
        let mut value = serde_json::json!({"version": 1, "inputs": [1, 2]});
        value["photograph"] = serde_json::to_value(card(3)).unwrap();
        assert_eq!(read(&value.to_string()), Ok(Some(card(3))));
        assert!(read(r#"{"version":2}"#).unwrap_err().contains("expected 1"));
        assert!(read("[]").unwrap_err().contains("a.jpg.record.json: is no record"));
        std::fs::remove_file(record_path(&photograph)).unwrap();
        assert!(read_record(&photograph).unwrap_err().contains("locard photo"));
    }
}
