//! Export of a range of a shot's frames: obstacles are reported before it starts; decoding,
//! compositing and writing overlap; an unfinished export leaves nothing behind. [`camera`] exports
//! the camera and the evidence to other programs.
//!
//! The program and the window use the same [`Export`] and write identical files.

pub mod camera;
mod check;
mod error;
mod inputs;
mod record;
mod run;

use std::ops::Range;
use std::path::PathBuf;

pub use error::ExportError;
pub use inputs::{Inputs, resolved};
pub use run::{ExportSummary, mask_name};

use crate::sink::{OutPath, VideoCodec};

/// Range, outputs and options of an export.
#[derive(Clone, Debug, PartialEq)]
pub struct Export {
    /// Frames of the recording, counted from 0.
    pub range: Range<usize>,
    pub out: OutPath,
    /// Lossless video.
    pub lossless: bool,
    /// Codec of a video that is not lossless; `None`: by the file's extension.
    pub codec: Option<VideoCodec>,
    /// Frames of each closed group of pictures; see [`SinkOptions`](crate::sink::SinkOptions).
    pub closed_groups: Option<u32>,
    /// Converts to standard dynamic range.
    pub sdr: bool,
    /// Copies the sound of the recording's video into a video.
    pub sound: bool,
    /// Replaces existing outputs.
    pub force: bool,
    /// A folder for the virtual layer of each frame, as OpenEXR.
    pub layers: Option<PathBuf>,
    /// A folder for the mask of each frame, as PNG.
    pub masks: Option<PathBuf>,
    /// A file, or `-`, for the report of all frames.
    pub report: Option<PathBuf>,
    /// Labels the files as composites ([`crate::label`]).
    pub labelled: bool,
    /// Text of a visible mark on each frame.
    pub mark: Option<String>,
    /// Writes the provenance record beside files ([`crate::provenance`]).
    pub recorded: bool,
}

impl Export {
    /// An export of the frames only.
    pub fn new(range: Range<usize>, out: OutPath) -> Self {
        Self {
            range,
            out,
            lossless: false,
            codec: None,
            closed_groups: None,
            sdr: false,
            sound: true,
            force: false,
            layers: None,
            masks: None,
            report: None,
            labelled: true,
            mark: None,
            recorded: true,
        }
    }
}
