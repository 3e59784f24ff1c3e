//! File of the reports on a scene's supports: `supports.toml` in an analysis's folder.
//!
//! It is for people and other programs, in the scene's world, whose gauge and unit can differ from
//! the recording's. Compositing does not read it, because objects can be moved.

use std::io::Write;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::artefact::{AnalysisError, SUPPORTS};
use crate::document::TomlDocument;
use crate::sink::atomic::write_atomically;
use crate::support::SupportReport;
use crate::text::count;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct SupportFile {
    /// The scene's file, without its folders.
    scene: String,
    object: Vec<SupportReport>,
}

/// Writes the reports to an analysis's folder.
pub fn write_support_reports(folder: &Path, scene: &Path, grounds: &[SupportReport]) -> Result<(), AnalysisError> {
    let path = folder.join(SUPPORTS);
    let name = scene.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let document = TomlDocument::new(SupportFile { scene: name, object: grounds.to_vec() })
        .map_err(|problem| AnalysisError::Content { file: path.clone(), problem: problem.to_string() })?;
    let head = format!(
        "# Support surfaces and shadow receivers of {} of a scene, in the scene's world, metres. By `locard analyse \
         --scene`; not used for compositing.\n",
        count(grounds.len(), "object")
    );
    write_atomically(&path, true, |out| out.write_all(format!("{head}{document}").as_bytes()))
        .map_err(|error| AnalysisError::Unwritten { folder: folder.to_owned(), reason: error.to_string() })?;
    Ok(())
}
