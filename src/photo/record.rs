//! The record beside a photograph: `NAME.jpg.record.json`, whose value `photograph` holds its
//! [`Particulars`].

use std::io::{self, Write};
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::particulars::{Particulars, PhotoContent};
pub use crate::provenance::record_path;
use crate::provenance::{
    OutputKind, OutputRecord, PictureRecord, RECORD_VERSION, Record, WorkRecord, file_digest, output_of_record,
    pixels_digest,
};
use crate::sink::atomic::write_atomically;
use crate::sink::{SinkError, photograph as files};
use crate::source::{file as plain, still};
use crate::text::reason;

/// Largest record that is read, bytes: ten thousand objects in view.
const MAX_RECORD_BYTES: u64 = 4 << 20;

/// The record of an output with one picture, and the particulars.
#[derive(Serialize)]
struct PhotoRecord<'a> {
    #[serde(flatten)]
    record: Record,
    photograph: &'a Particulars,
}

/// The part of a record that this module reads. Other values are ignored.
#[derive(Deserialize)]
struct ReadRecord {
    version: u32,
    #[serde(default)]
    pictures: Vec<ReadPicture>,
    photograph: Option<Particulars>,
}

#[derive(Deserialize)]
struct ReadPicture {
    file_sha256: Option<String>,
}

/// Writes the record of a photograph that has been written; an existing one belongs to an earlier
/// photograph of that name and is replaced.
pub fn write_record(path: &Path, particulars: &Particulars, work: WorkRecord) -> Result<(), SinkError> {
    let unread = |source: io::Error| SinkError::Read { path: path.to_owned(), source };
    let pixels = still::read_pixels(path).map_err(|error| unread(io::Error::other(error)))?;
    let frame = match &particulars.content {
        PhotoContent::View(view) => view.frame,
        PhotoContent::Card(_) => 0,
    };
    let record = Record {
        version: RECORD_VERSION,
        work,
        range: [frame, frame + 1],
        output: OutputRecord {
            kind: OutputKind::Photograph,
            path: path.to_owned(),
            width: pixels.width,
            height: pixels.height,
            bits: 8,
            codec: files::codec(path).to_owned(),
            fps: 0.0,
            sha256: None,
        },
        pictures: vec![PictureRecord {
            frame,
            file: None,
            pixels_sha256: pixels_digest(&pixels),
            file_sha256: Some(file_digest(path).map_err(unread)?.sha256),
            rect_px: None,
            mask: None,
        }],
    };
    write_atomically(&record_path(path), true, |out| {
        serde_json::to_writer_pretty(&mut *out, &PhotoRecord { record, photograph: particulars })
            .map_err(io::Error::from)?;
        out.write_all(b"\n")
    })
}

/// The particulars in the record of a photograph that is as it was written. `Ok(None)` for a record
/// of something else. The error names the file and the problem.
pub fn read_record(photograph: &Path) -> Result<Option<Particulars>, String> {
    let record = read(photograph)?;
    let stated = record.pictures.first().and_then(|picture| picture.file_sha256.as_ref());
    match (stated, file_digest(photograph)) {
        (Some(sha256), Ok(digest)) if record.photograph.is_some() && digest.sha256 != *sha256 => {
            Err(format!("{}: has changed since its record was written", photograph.display()))
        }
        _ => Ok(record.photograph),
    }
}

/// Like [`read_record`], also of a photograph that has changed.
pub fn read_particulars(photograph: &Path) -> Result<Option<Particulars>, String> {
    Ok(read(photograph)?.photograph)
}

fn read(photograph: &Path) -> Result<ReadRecord, String> {
    let path = record_path(photograph);
    let bytes = plain::read(&path, MAX_RECORD_BYTES).map_err(|error| {
        format!(
            "{}: cannot be read: {}; `locard photo` and `locard case-card` write it beside the photograph",
            path.display(),
            reason(&error)
        )
    })?;
    let record: ReadRecord = serde_json::from_slice(&bytes)
        .map_err(|error| format!("{}: is no record of a photograph: {error}", path.display()))?;
    if record.version != RECORD_VERSION {
        return Err(format!("{}: version {}: expected {RECORD_VERSION}", path.display(), record.version));
    }
    Ok(record)
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
    use crate::pixels::Pixels;
    use crate::provenance::audit::changed_outputs;

    fn card(number: u32) -> Particulars {
        Particulars {
            number,
            taken: "2026-11-30 12:00:00".to_owned(),
            content: PhotoContent::Card(CaseCard::default()),
        }
    }

    /// A tiny photograph with its record.
    fn write_card(path: &Path, number: u32) {
        files::write(path, &Pixels::from_u8(8, 8, vec![90; 192]).unwrap(), None, None, false).unwrap();
        write_record(path, &card(number), WorkRecord::without_shot(Vec::new())).unwrap();
    }

    #[test]
    fn written_record_reads_back_equal_and_numbers_continue() {
        let temp = tempfile::tempdir().unwrap();
        let at = |name: &str| temp.path().join(name);
        assert_eq!(next_number(&at("a.jpg")), 1);
        write_card(&at("a.jpg"), 1);
        write_card(&at("b.jpg"), 7);
        std::fs::write(at("c.jpg.record.json"), "{").unwrap();
        assert_eq!(read_record(&at("b.jpg")), Ok(Some(card(7))));
        assert_eq!((next_number(&at("a.jpg")), next_number(&at("d.jpg"))), (1, 8));
        // It is a record of an output, too.
        let record = Record::read(&at("b.jpg")).unwrap();
        assert_eq!((record.output.kind, record.output.codec.as_str()), (OutputKind::Photograph, "jpeg"));
        assert_eq!(changed_outputs(&record, &at("b.jpg"), &[0]), []);
        std::fs::write(at("b.jpg"), std::fs::read(at("a.jpg")).unwrap().repeat(2)).unwrap();
        assert!(read_record(&at("b.jpg")).unwrap_err().contains("has changed since its record was written"));
        assert_eq!(read_particulars(&at("b.jpg")), Ok(Some(card(7))));
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
