//! Places that a person picked to measure noise in, and what is said of them.

use super::noise::{CalibrateError, NoiseCalibration, SceneMotion};
use super::plane::SIDE;
use crate::pixels::{Pixels, Rect};

/// Blocks that make a place.
pub(super) const FEWEST_BLOCKS: usize = 4;

/// σ at an intensity, 8-bit codes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoisePoint {
    pub code: f64,
    pub sigma: f64,
    /// 95 % confidence interval (χ²).
    pub sigma_ci95: [f64; 2],
    pub independent_count: f64,
}

impl NoiseCalibration {
    /// What was measured, without what is filled from neighbours; of R, G, B, ascending.
    pub fn points(&self) -> [Vec<NoisePoint>; 3] {
        self.bins.each_ref().map(|bins| {
            let measured = bins.iter().filter(|bin| !bin.filled_from_neighbours);
            let point = measured.filter_map(|bin| {
                let sigma_ci95 = bin.sigma_ci95?;
                let (code, sigma, independent_count) = (bin.code, bin.sigma, bin.independent_count);
                Some(NoisePoint { code, sigma, sigma_ci95, independent_count })
            });
            point.collect()
        })
    }
}

/// A rectangle that a person picked, and the frames that it is looked at in.
#[derive(Clone, Copy, Debug)]
pub struct Place<'a> {
    /// Of one size.
    pub frames: &'a [&'a Pixels],
    /// px. What lies beyond the picture is left out.
    pub at: Rect,
}

/// Why a place tells nothing of the noise.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Unfit {
    #[error("too small: {width} × {height} px; {least} × {least} px and more are needed")]
    Small { width: u32, height: u32, least: u32 },
    #[error("over- or underexposed: the code values end there")]
    Clipped,
    #[error("too quiet: the code values show no noise there")]
    Quiet,
    #[error("not plain: its parts differ {times:.1} times as much as noise does, by texture or shadows")]
    Textured { times: f64 },
    #[error("it moves or changes from frame to frame")]
    Changes,
}

/// Why picked places give no noise.
#[derive(Debug, thiserror::Error)]
pub enum PickedError {
    #[error("no place is picked: choose one or more rectangles of plain colour")]
    NoPlace,
    #[error("none of the places can be used")]
    NoneFit,
    #[error("noise at rest shows in the difference of frames: choose two or more")]
    OneFrame,
    #[error("the places are too small together, or the frames too few: pick larger ones, or more")]
    Few,
    #[error("{0} was not measured: its noise is too quiet, or clipped")]
    Channel(&'static str),
    #[error(transparent)]
    Calibrate(CalibrateError),
}

/// The side of a square that is large enough for a place, px.
pub fn least_px(motion: SceneMotion) -> u32 {
    match motion {
        SceneMotion::Resting => SIDE as u32,
        // `FEWEST_BLOCKS` of them, two and two.
        SceneMotion::Moving => 2 * SIDE as u32,
    }
}

/// A place within its frames. Fails if they differ in size, or if there is none.
pub(super) fn within(place: &Place<'_>) -> Result<Rect, PickedError> {
    let first = place.frames.first().ok_or(PickedError::Calibrate(CalibrateError::NoFrames))?;
    let wrong = place.frames.iter().find(|frame| (frame.width, frame.height) != (first.width, first.height));
    if let Some(frame) = wrong {
        let size = |p: &Pixels| format!("{}x{}", p.width, p.height);
        let (expected, found) = (size(first), size(frame));
        return Err(PickedError::Calibrate(CalibrateError::Size { expected, found }));
    }
    Ok(place.at.intersection(&Rect::full(first.width, first.height)))
}

/// What the places that are good say.
pub(super) struct Found {
    pub points: [Vec<NoisePoint>; 3],
    pub channel_correlation: [f64; 3],
    pub neighbour_correlation: [f64; 2],
}
