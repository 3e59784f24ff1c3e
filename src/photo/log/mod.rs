//! Photo log: a table of the photographs of a series with their settings, subject and scale, and
//! checks that name each fault with its numbers and its remedy. Read from the records beside the
//! photographs, written as CSV and as an HTML page. docs/photo-log.md has limits and sources.

mod checks;
mod entry;
mod finding;
mod items;
mod page;
mod shot_class;
mod table;
#[cfg(test)]
mod tests;

pub use checks::{MIN_LENGTH_PX, MIN_SUBJECT_SHARE, view_findings};
pub use entry::{LogEntry, PhotoLog, log_files, photographs, recorded_photographs, unrecorded_pictures};
pub use finding::{Check, Finding};
pub use items::{ItemCoverage, item_coverage};
pub use page::html;
pub use shot_class::{ShotClass, field_m};
pub use table::{COLUMNS, csv};
