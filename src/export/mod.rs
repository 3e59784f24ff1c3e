//! A range of a shot's frames, composited into files: what is in the way is told before anything is begun, decoding,
//! drawing and writing overlap, and what was not finished leaves nothing behind.
//!
//! The program and the window write by the same [`Export`], so that they write the same.

mod apart;
mod error;
mod inputs;
mod run;

use std::ops::Range;
use std::path::PathBuf;

pub use error::ExportError;
pub use inputs::{Inputs, resolved};
pub use run::Exported;

use crate::sink::OutPath;

/// What is to be written, and where.
#[derive(Clone, Debug, PartialEq)]
pub struct Export {
    /// Frames of the recording, counted from 0.
    pub range: Range<usize>,
    pub out: OutPath,
    /// Whether a video keeps every code value.
    pub lossless: bool,
    /// Whether existing output may be replaced.
    pub force: bool,
    /// A folder for one OpenEXR a frame with the virtual layer.
    pub layers: Option<PathBuf>,
    /// A file, or `-`, for what was found and done for each frame.
    pub report: Option<PathBuf>,
}

impl Export {
    /// The frames of a range, and nothing beside them.
    pub fn new(range: Range<usize>, out: OutPath) -> Self {
        Self { range, out, lossless: false, force: false, layers: None, report: None }
    }
}
