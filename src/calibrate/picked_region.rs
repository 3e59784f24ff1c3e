//! Regions that the user picked to measure noise in, and the verdict on each.

use super::noise::{CalibrateError, NoiseCalibration, SceneMotion};
use super::plane::SIDE;
use super::points::NoisePoint;
use crate::pixels::{Codes, Pixels, Rect};

/// Smallest number of blocks in a usable region.
pub(super) const MIN_BLOCKS: usize = 4;

impl NoiseCalibration {
    /// Measured noise of R, G and B, ascending by code, without interpolated bins.
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

/// A picked rectangle, with its crop of each frame.
#[derive(Clone, Debug)]
pub struct PickedRegion {
    rect: Rect,
    /// Size of the frames, px.
    frame_px: Option<(u32, u32)>,
    frames: Vec<Pixels>,
}

impl PickedRegion {
    /// A rectangle, px. It is clipped to the picture.
    pub fn new(rect: Rect) -> Self {
        Self { rect, frame_px: None, frames: Vec::new() }
    }

    /// Adds the crop of a frame. Fails if the frame's size differs from those before.
    pub fn add(&mut self, frame: &Pixels) -> Result<(), PickedError> {
        let (width, height) = *self.frame_px.get_or_insert((frame.width, frame.height));
        if (frame.width, frame.height) != (width, height) {
            let (expected, actual) = (format!("{width}x{height}"), format!("{}x{}", frame.width, frame.height));
            return Err(PickedError::Calibrate(CalibrateError::Size { expected, actual }));
        }
        self.frames.push(crop(frame, &self.rect.intersection(&Rect::full(width, height))));
        Ok(())
    }

    pub(super) fn frames(&self) -> &[Pixels] {
        &self.frames
    }

    /// Size of the crops, px.
    pub(super) fn size_px(&self) -> (u32, u32) {
        self.frames.first().map_or((0, 0), |frame| (frame.width, frame.height))
    }
}

/// Crops a picture.
fn crop(frame: &Pixels, place: &Rect) -> Pixels {
    let width = place.width() as usize;
    let rows = (place.y0..place.y1).map(|y| 3 * (y as usize * frame.width as usize + place.x0 as usize));
    let codes = match &frame.codes {
        Codes::U8(codes) => Codes::U8(rows.flat_map(|start| codes[start..start + 3 * width].iter().copied()).collect()),
        Codes::U16(codes) => {
            Codes::U16(rows.flat_map(|start| codes[start..start + 3 * width].iter().copied()).collect())
        }
    };
    Pixels::uncoded(place.width(), place.height(), codes)
}

/// Reason why a region gives no noise.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RegionError {
    #[error("too small: {width} × {height} px; {min_side_px} × {min_side_px} px and more are needed")]
    Small { width: u32, height: u32, min_side_px: u32 },
    #[error("over- or underexposed: the code values end there")]
    Clipped,
    #[error("too quiet: the code values show no noise there")]
    Quiet,
    #[error("not plain: its parts differ {times:.1} times as much as noise does, by texture or shadows")]
    Textured { times: f64 },
    #[error("it moves or changes from frame to frame")]
    Changes,
}

/// Reason why the picked regions give no noise.
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

/// Smallest side of a square region that is large enough, px.
pub fn min_side_px(motion: SceneMotion) -> u32 {
    match motion {
        SceneMotion::Resting => SIDE as u32,
        // Two by two blocks are `MIN_BLOCKS`.
        SceneMotion::Moving => 2 * SIDE as u32,
    }
}

/// Noise of the usable regions.
pub(super) struct RegionNoise {
    pub points: [Vec<NoisePoint>; 3],
    pub channel_correlation: [f64; 3],
    pub neighbour_correlation: [f64; 2],
}
