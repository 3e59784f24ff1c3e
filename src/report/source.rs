//! The inputs of a page, and the reasons for its absence.

use crate::analyse::{Analysis, Times};
use crate::camera::{Geometry, Response};
use crate::measure::MeasureError;
use crate::recording::{Recording, RecordingError};
use crate::support::SupportReport;
use crate::verify::NoiseComparison;

/// The inputs of a page.
#[derive(Clone, Copy)]
pub struct ReportSource<'a> {
    /// The recording without its analysis.
    pub recording: &'a Recording,
    /// The camera as it was given.
    pub camera: &'a Geometry,
    pub response: &'a Response,
    /// The analysis of this recording and camera ([`Analysis::fits`]).
    pub analysis: &'a Analysis,
    /// Support reports of a scene's objects; empty without a scene.
    pub grounds: &'a [SupportReport],
    /// How long it took, if that is known.
    pub times: Option<&'a Times>,
    /// Virtual noise beside the camera's, if it was compared.
    pub noise: Option<&'a NoiseComparison>,
}

/// Marker by which a page of this program is recognized.
pub const MADE_BY: &str = "<meta name=\"generator\" content=\"locard analyse\" />";

/// Why there is no page.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    #[error(transparent)]
    Recording(#[from] RecordingError),
    #[error("a slide cannot be measured: {0}")]
    Slide(#[from] MeasureError),
    #[error("a picture cannot be encoded: {0}")]
    Picture(#[from] image::ImageError),
    #[error("a plot cannot be drawn: {0}")]
    Plot(String),
    #[error("the page cannot be put together: {0}")]
    Page(#[from] minijinja::Error),
}
