//! Why a recording could not be verified.

use crate::measure::MeasureError;
use crate::recording::RecordingError;
use crate::shot::ShotError;

/// Why no difference could be measured.
#[derive(Debug, thiserror::Error)]
pub enum VerifyError {
    #[error(transparent)]
    Shot(#[from] ShotError),
    #[error(transparent)]
    Measure(#[from] MeasureError),
    #[error(transparent)]
    Recording(#[from] RecordingError),
}
