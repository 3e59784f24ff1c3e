//! Entries of a photo log: photographs in a folder with their records.

use std::path::{Path, PathBuf};

use image::RgbImage;

use super::checks::view_findings;
use super::finding::{Check, Finding};
use super::items::{ItemCoverage, item_coverage};
use crate::photo::card::CaseCard;
use crate::photo::particulars::{Particulars, PhotoContent, ViewParticulars};
use crate::photo::record::read_record;
use crate::provenance::{output_of_record, record_path};
use crate::sink::photograph::is_photograph_name;
use crate::source::file as plain;
use crate::text::reason;

/// Largest photograph that is read for its thumbnail, bytes.
const MAX_PHOTOGRAPH_BYTES: u64 = 1 << 28;
/// Longest side of a thumbnail, px.
const THUMBNAIL_PX: u32 = 360;

/// A photograph of a log.
#[derive(Clone, Debug, PartialEq)]
pub struct LogEntry {
    pub photograph: PathBuf,
    /// `None` if its record cannot be read; the findings have the reason.
    pub particulars: Option<Particulars>,
    pub findings: Vec<Finding>,
}

/// A photo log.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PhotoLog {
    /// By number, then time, then name. Photographs without a record come last.
    pub entries: Vec<LogEntry>,
    pub items: Vec<ItemCoverage>,
    /// Faults of the series as a whole, besides those of the items.
    pub findings: Vec<Finding>,
}

impl LogEntry {
    /// The entry of a photograph.
    pub fn new(photograph: PathBuf, record: Result<Option<Particulars>, String>) -> Self {
        let no_record = |fault: String| {
            let remedy =
                "take it again with `locard photo`, or leave it out; the log identifies a photograph by its record";
            (None, vec![Finding::new(Check::NoRecord, fault, remedy)])
        };
        let (particulars, findings) = match record {
            Ok(Some(particulars)) => {
                let findings = match &particulars.content {
                    PhotoContent::Card(_) => Vec::new(),
                    PhotoContent::View(view) => view_findings(view),
                };
                (Some(particulars), findings)
            }
            Ok(None) => no_record("its record is not that of a photograph".to_owned()),
            Err(problem) => no_record(problem),
        };
        Self { photograph, particulars, findings }
    }

    pub fn name(&self) -> String {
        self.photograph.file_name().unwrap_or_default().to_string_lossy().into_owned()
    }

    pub fn number(&self) -> Option<u32> {
        self.particulars.as_ref().map(|particulars| particulars.number)
    }

    /// `None` for a card, and without a record.
    pub fn view(&self) -> Option<&ViewParticulars> {
        match &self.particulars.as_ref()?.content {
            PhotoContent::View(view) => Some(view),
            PhotoContent::Card(_) => None,
        }
    }

    pub fn card(&self) -> Option<&CaseCard> {
        match &self.particulars.as_ref()?.content {
            PhotoContent::View(_) => None,
            PhotoContent::Card(card) => Some(card),
        }
    }

    /// The photograph, reduced to at most 360 px. The error is a description.
    pub fn thumbnail(&self) -> Result<RgbImage, String> {
        let bytes = plain::read(&self.photograph, MAX_PHOTOGRAPH_BYTES).map_err(|error| reason(&error))?;
        let picture = image::load_from_memory(&bytes).map_err(|error| error.to_string())?;
        Ok(picture.thumbnail(THUMBNAIL_PX, THUMBNAIL_PX).to_rgb8())
    }
}

/// Photographs of the records in a folder, by name.
pub fn recorded_photographs(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    // Videos and folders of frames have records, too.
    let outputs = std::fs::read_dir(folder)?.flatten().filter_map(|entry| output_of_record(&entry.path()));
    let mut photographs: Vec<PathBuf> = outputs.filter(|output| is_photograph_name(output)).collect();
    photographs.sort();
    Ok(photographs)
}

/// Pictures in a folder that have no record, by name. Contact sheets never have one.
pub fn unrecorded_pictures(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let is_sheet = |path: &Path| path.file_stem().is_some_and(|stem| stem.to_string_lossy().ends_with("-sheet"));
    let files = std::fs::read_dir(folder)?.flatten().map(|entry| entry.path());
    let pictures = files.filter(|path| is_photograph_name(path) && !is_sheet(path));
    let mut unrecorded: Vec<PathBuf> = pictures.filter(|path| !record_path(path).exists()).collect();
    unrecorded.sort();
    Ok(unrecorded)
}

/// Photographs of folders and files: in a folder all that have a record. The error names the path,
/// and the remedy.
pub fn photographs(paths: &[PathBuf]) -> Result<Vec<PathBuf>, String> {
    let mut photographs = Vec::new();
    for path in paths {
        if !path.is_dir() {
            photographs.push(output_of_record(path).unwrap_or_else(|| path.clone()));
            continue;
        }
        let listed = recorded_photographs(path)
            .map_err(|error| format!("{}: cannot be read: {}", path.display(), reason(&error)))?;
        photographs.extend(listed);
    }
    photographs.sort();
    photographs.dedup();
    match photographs.iter().find(|path| !path.exists()) {
        Some(missing) => Err(format!(
            "{}: does not exist; a photograph of a series is not deleted: bring it back, or delete its record, too",
            missing.display()
        )),
        None if photographs.is_empty() => Err(format!(
            "{}: no photograph with a record there; `locard photo` and `locard case-card` write them",
            paths.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ")
        )),
        None => Ok(photographs),
    }
}

impl PhotoLog {
    /// Reads the records beside photographs, and checks photographs and series.
    pub fn read(photographs: &[PathBuf]) -> Self {
        let entry = |path: &PathBuf| LogEntry::new(path.clone(), read_record(path));
        Self::of_entries(photographs.iter().map(entry).collect())
    }

    /// The log of entries in any order.
    pub fn of_entries(mut entries: Vec<LogEntry>) -> Self {
        let key = |entry: &LogEntry| {
            let taken = entry.particulars.as_ref().map(|particulars| particulars.taken.clone());
            (entry.number().unwrap_or(u32::MAX), taken.unwrap_or_default(), entry.photograph.clone())
        };
        entries.sort_by_cached_key(key);
        let views: Vec<(u32, &ViewParticulars)> =
            entries.iter().filter_map(|entry| Some((entry.number()?, entry.view()?))).collect();
        let items = item_coverage(&views);
        let findings = card_finding(&entries).into_iter().chain(number_findings(&entries)).collect();
        Self { entries, items, findings }
    }

    /// The case card that comes first, or any other one.
    pub fn card(&self) -> Option<&CaseCard> {
        self.entries.iter().find_map(LogEntry::card)
    }

    /// Number of faults.
    pub fn finding_count(&self) -> usize {
        let of_entries = self.entries.iter().map(|entry| entry.findings.len()).sum::<usize>();
        of_entries + self.items.iter().map(|item| item.findings.len()).sum::<usize>() + self.findings.len()
    }
}

fn card_finding(entries: &[LogEntry]) -> Option<Finding> {
    let first = entries.first().filter(|first| first.card().is_none())?;
    let name = first.number().map_or_else(|| first.name(), |number| format!("number {number}"));
    Some(Finding::new(
        Check::NoCaseCard,
        format!("the first frame, {name}, is no case card"),
        "begin a series with the card (`locard case-card CASE.toml -o 001.jpg --number 1`): it names case, place and \
         photographer, and its patches show the colours of the light",
    ))
}

fn number_findings(entries: &[LogEntry]) -> Vec<Finding> {
    let numbers: Vec<u32> = entries.iter().filter_map(LogEntry::number).collect();
    let of_pair = |pair: &[u32]| {
        let fault = if pair[0] == pair[1] {
            format!("number {} occurs twice", pair[0])
        } else if pair[1] > pair[0] + 1 {
            format!("numbers between {} and {} are missing", pair[0], pair[1])
        } else {
            return None;
        };
        let remedy = "no frame of a series is deleted or renamed, bad ones included: account for it in the notes";
        Some(Finding::new(Check::Numbers, fault, remedy))
    };
    numbers.windows(2).filter_map(of_pair).collect()
}

/// The log's files for an output name: `NAME.csv` and `NAME.html`, whichever of both endings the
/// name has.
pub fn log_files(output: &Path) -> [PathBuf; 2] {
    let ending = output.extension().unwrap_or_default().to_ascii_lowercase();
    let stem = if ending == "csv" || ending == "html" { output.with_extension("") } else { output.to_owned() };
    ["csv", "html"].map(|ending| {
        let mut path = stem.as_os_str().to_owned();
        path.push(format!(".{ending}"));
        path.into()
    })
}
