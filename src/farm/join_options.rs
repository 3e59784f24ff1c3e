//! Options of a join, and the removal of an earlier record.

use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::error::FarmError;
use crate::provenance::record_path;
use crate::sink::SinkError;
use crate::source::video::Soundtrack;

/// Output and conditions of a join.
#[derive(Clone, Debug)]
pub struct JoinOptions {
    /// A folder, or a video file with the extension of the parts.
    pub out: PathBuf,
    /// The frames that the parts must cover together; `None`: from the first part's to the last
    /// one's.
    pub frames: Option<Range<usize>>,
    /// Replaces existing output.
    pub force: bool,
    /// Accepts parts of several adapters of one kind.
    pub any_driver: bool,
    /// Sound for a joined video.
    pub soundtrack: Option<Soundtrack>,
    /// When the frames of a video are shown.
    pub times: FrameTimes,
    /// `join` of the joined output's record.
    pub command: serde_json::Value,
}

/// When the frames of a joined video are shown.
#[derive(Clone, Debug, PartialEq)]
pub enum FrameTimes {
    /// By the rate in the record.
    Steady,
    /// Time of each frame by its index in the recording, s.
    Variable(Arc<[f64]>),
}

/// Removes the record of an earlier output, which would not fit a half-written one.
pub(super) fn remove_record(out: &Path) -> Result<(), FarmError> {
    let path = record_path(out);
    match std::fs::remove_file(&path) {
        Err(source) if source.kind() != io::ErrorKind::NotFound => Err(SinkError::Write { path, source }.into()),
        _ => Ok(()),
    }
}
