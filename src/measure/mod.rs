//! Measurements in pictures: positions, edge widths, similarity.
//!
//! Uses plain slices and [`Pixels`], independent of the pictures' origin.

pub mod detectors;
pub mod displacement;
pub mod edge;
pub mod edge_profile;
pub mod histogram;
pub mod slanted;
pub(crate) mod spread;
pub mod stats;

use crate::pixels::Pixels;

/// Errors of measurements.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
pub enum MeasureError {
    #[error("the pictures are {a} and {b}; both must have one size")]
    Sizes { a: String, b: String },
    #[error("{what} has {} where {expected} are expected", crate::text::count(*actual, "value"))]
    Length { what: &'static str, actual: usize, expected: usize },
    #[error("one picture has 8, the other 16 bits a channel; give both with one depth")]
    Depths,
    #[error("nothing to measure: {0}")]
    Nothing(&'static str),
    #[error("{what} = {actual}: expected {accepted}")]
    Option { what: &'static str, actual: f64, accepted: &'static str },
    #[error(
        "{side}: {actual} of the {needed} patches of 32x32 pixels that are needed lie in its mask; \
         use larger or more pictures, or a wider mask"
    )]
    TooFewPatches { side: &'static str, actual: usize, needed: usize },
}

/// Refuses pictures that cannot be compared value by value.
fn comparable(a: &Pixels, b: &Pixels) -> Result<(), MeasureError> {
    if (a.width, a.height) != (b.width, b.height) {
        let size = |p: &Pixels| format!("{}x{}", p.width, p.height);
        return Err(MeasureError::Sizes { a: size(a), b: size(b) });
    }
    Ok(())
}

/// Refuses a mask without exactly one value per pixel.
fn check_mask(mask: Option<&[bool]>, pixels: usize) -> Result<(), MeasureError> {
    match mask {
        Some(mask) if mask.len() != pixels => {
            Err(MeasureError::Length { what: "the mask", actual: mask.len(), expected: pixels })
        }
        _ => Ok(()),
    }
}
