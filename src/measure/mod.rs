//! Measurements in pictures: positions, edge widths, similarity.
//!
//! Uses plain slices and [`Pixels`], independent of the pictures' origin.

pub mod across;
pub mod displacement;
pub mod edge;
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
    #[error("{what} has {} where {expected} are expected", crate::text::count(*found, "value"))]
    Length { what: &'static str, found: usize, expected: usize },
    #[error("one picture has 8, the other 16 bits a channel; give both with one depth")]
    Depths,
    #[error("nothing to measure: {0}")]
    Nothing(&'static str),
    #[error("{what} = {found} is refused: accepted is {accepted}")]
    Option { what: &'static str, found: f64, accepted: &'static str },
}

/// A grey picture, row by row from the top left.
#[derive(Clone, Debug, PartialEq)]
pub struct Grey {
    pub width: usize,
    pub height: usize,
    /// `width * height` values, any unit.
    pub values: Vec<f64>,
}

impl Grey {
    /// `None` if the length is not `width * height`.
    pub fn new(width: usize, height: usize, values: Vec<f64>) -> Option<Self> {
        (width.checked_mul(height) == Some(values.len())).then_some(Self { width, height, values })
    }

    /// Luma of encoded codes (BT.709 weights), on the 8-bit scale.
    pub fn luma(pixels: &Pixels) -> Self {
        let scale = 255.0 / f64::from(pixels.max_code());
        let (width, height) = (pixels.width as usize, pixels.height as usize);
        let values = (0..pixels.height)
            .flat_map(|y| (0..pixels.width).map(move |x| pixels.at(x, y).map(f64::from)))
            .map(|[r, g, b]| scale * (0.2126 * r + 0.7152 * g + 0.0722 * b))
            .collect();
        Self { width, height, values }
    }

    /// The value of a pixel. The border is repeated beyond it. 0 for an empty picture.
    pub fn at(&self, x: i64, y: i64) -> f64 {
        let inside = |v: i64, n: usize| v.clamp(0, n as i64 - 1).max(0) as usize;
        self.values.get(inside(y, self.height) * self.width + inside(x, self.width)).copied().unwrap_or(0.0)
    }

    fn size(&self) -> String {
        format!("{}x{}", self.width, self.height)
    }
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
            Err(MeasureError::Length { what: "the mask", found: mask.len(), expected: pixels })
        }
        _ => Ok(()),
    }
}
