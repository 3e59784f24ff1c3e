//! Places that a person picked to measure noise in, and what is said of them.

use super::noise::{CalibrateError, NoiseCalibration, SceneMotion};
use super::plane::SIDE;
use super::points::NoisePoint;
use crate::pixels::{Codes, Pixels, Rect};

/// Blocks that make a place.
pub(super) const FEWEST_BLOCKS: usize = 4;

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

/// A rectangle that a person picked, with what each frame shows in it: of a frame nothing else is held.
#[derive(Clone, Debug)]
pub struct Place {
    at: Rect,
    /// Of the frames.
    frame_px: Option<(u32, u32)>,
    frames: Vec<Pixels>,
}

impl Place {
    /// A rectangle, px. What lies beyond the picture is left out.
    pub fn new(at: Rect) -> Self {
        Self { at, frame_px: None, frames: Vec::new() }
    }

    /// Takes what a frame shows there. Fails if it is of another size than those before.
    pub fn add(&mut self, frame: &Pixels) -> Result<(), PickedError> {
        let (width, height) = *self.frame_px.get_or_insert((frame.width, frame.height));
        if (frame.width, frame.height) != (width, height) {
            let (expected, found) = (format!("{width}x{height}"), format!("{}x{}", frame.width, frame.height));
            return Err(PickedError::Calibrate(CalibrateError::Size { expected, found }));
        }
        self.frames.push(cut(frame, &self.at.intersection(&Rect::full(width, height))));
        Ok(())
    }

    pub(super) fn frames(&self) -> &[Pixels] {
        &self.frames
    }

    /// Within its frames.
    pub(super) fn size_px(&self) -> (u32, u32) {
        self.frames.first().map_or((0, 0), |frame| (frame.width, frame.height))
    }
}

/// A part of a picture.
fn cut(frame: &Pixels, place: &Rect) -> Pixels {
    let width = place.width() as usize;
    let rows = (place.y0..place.y1).map(|y| 3 * (y as usize * frame.width as usize + place.x0 as usize));
    let codes = match &frame.codes {
        Codes::U8(codes) => Codes::U8(rows.flat_map(|start| codes[start..start + 3 * width].iter().copied()).collect()),
        Codes::U16(codes) => {
            Codes::U16(rows.flat_map(|start| codes[start..start + 3 * width].iter().copied()).collect())
        }
    };
    Pixels { width: place.width(), height: place.height(), codes }
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

/// What the places that are good say.
pub(super) struct Found {
    pub points: [Vec<NoisePoint>; 3],
    pub channel_correlation: [f64; 3],
    pub neighbour_correlation: [f64; 2],
}
