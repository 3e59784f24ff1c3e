//! Errors of taking photographs.

use super::framing::FramingError;
use super::take::TakeError;
use crate::camera::LensError;
use crate::effects::EffectError;
use crate::export::ExportError;
use crate::gpu::GpuError;
use crate::recording::RecordingError;
use crate::shot::ShotError;
use crate::sink::SinkError;
use crate::tracking::NoPose;

/// Why no photograph could be taken or written.
#[derive(Debug, thiserror::Error)]
pub enum PhotoError {
    #[error(transparent)]
    Shot(#[from] ShotError),
    #[error(transparent)]
    Recording(#[from] RecordingError),
    #[error(transparent)]
    NoPose(#[from] NoPose),
    #[error(transparent)]
    Lens(#[from] LensError),
    #[error(transparent)]
    Effect(#[from] EffectError),
    #[error(transparent)]
    Framing(#[from] FramingError),
    #[error(transparent)]
    Export(#[from] ExportError),
    #[error(transparent)]
    Sink(#[from] SinkError),
    #[error(transparent)]
    Gpu(#[from] GpuError),
    #[error(transparent)]
    Take(#[from] TakeError),
    /// Invalid or contradicting settings, named as on the command line.
    #[error("{0}")]
    Refused(String),
}

/// An error of refused settings.
pub fn refused<T>(text: String) -> Result<T, PhotoError> {
    Err(PhotoError::Refused(text))
}
