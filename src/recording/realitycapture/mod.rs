//! RealityCapture (RealityScan): the CSV of "Internal/External camera parameters", and XMP sidecars
//! (`picture.xmp` beside `picture.jpg`) of the namespace `xcr`. Sources:
//! "RealityCapture XMP Camera Math" (Epic's knowledge base, vzwB),
//! <https://rshelp.capturingreality.com/en-US/tools/xmpalign.htm>, and the export templates of the
//! program (`calibration.xml`).
//!
//! Lengths in the picture are in units of its longer side: one unit is max(width, height) px, and
//! 36 mm. The principal point is relative to the picture's centre, in these units in both forms;
//! the focal length is in mm. x' = x(1 + k1 r² + k2 r⁴ + k3 r⁶ + k4 r⁸) + t1(r² + 2x²) + 2 t2 x y,
//! so t1 is OpenCV's p2, and t2 is p1 (the program's own export for OpenCV exchanges them).
//!
//! `xcr:Rotation` is world to camera, row by row, with OpenCV's axes; `xcr:Position` is the
//! camera's centre. In the CSV, heading is clockwise from north (y) to the direction of the
//! picture's up, pitch its elevation, and roll turns about it: with all 0 the camera faces straight
//! down. World z is up.

mod csv;
mod exported_camera;
mod xmp;

use std::io::Read;
use std::path::{Path, PathBuf};

use glam::DVec3;

use super::parts::{Parts, RecordingFormat, folder_of};
use super::{OpenOptions, RecordingError};
use crate::source::file;

pub static FORMAT: RecordingFormat =
    RecordingFormat { name: "RealityCapture", has_times: false, is_metric: false, find, open };

/// Bytes at a file's start that identify it.
const HEAD_BYTES: u64 = 4096;

/// The start of a plain file as text.
fn head(path: &Path) -> String {
    let mut start = Vec::new();
    // An unreadable file is not one of this format.
    let _ = file::open(path).map(|file| file.take(HEAD_BYTES).read_to_end(&mut start));
    String::from_utf8_lossy(&start).into_owned()
}

fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|own| own.eq_ignore_ascii_case(extension))
}

/// The files of a folder with an extension, in the order of their names.
fn files_with(folder: &Path, extension: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut files: Vec<PathBuf> = entries.filter(|file| has_extension(file, extension) && file.is_file()).collect();
    files.sort();
    files
}

/// The CSV, or the folder with the sidecars.
fn find(path: &Path) -> Option<PathBuf> {
    if path.is_file() {
        let is_table = has_extension(path, "csv") && csv::is_export(&head(path));
        let is_sidecar = has_extension(path, "xmp") && xmp::is_sidecar(&head(path));
        return if is_table { Some(path.to_owned()) } else { is_sidecar.then(|| folder_of(path)) };
    }
    let table = files_with(path, "csv").into_iter().find(|file| csv::is_export(&head(file)));
    let sidecars = || {
        let folders = [path.to_owned(), path.join("images")];
        // Other programs write sidecars, too.
        folders.into_iter().find(|folder| files_with(folder, "xmp").iter().any(|file| xmp::is_sidecar(&head(file))))
    };
    table.or_else(sidecars)
}

fn open(source: &Path, path: &Path, options: &OpenOptions) -> Result<Parts, RecordingError> {
    let mut parts = if source.is_dir() { xmp::open(source, path, options)? } else { csv::open(source, path, options)? };
    parts.up = Some(DVec3::Z);
    Ok(parts)
}
