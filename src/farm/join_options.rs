//! Options of a join.

use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;

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
    /// Times follow from the rate in the record.
    Steady,
    /// Time of each frame by its index in the recording, s.
    Variable(Arc<[f64]>),
}
