//! Noise of picked regions: rectangles of plain colour, in frames at rest or in any.
//!
//! At rest each rectangle is a scene (noise.rs): noise is the variation from frame to frame, and
//! texture does no harm. In a single frame, or while the camera moves, noise is the deviation from
//! a plane in blocks of 12×12 pixels (single.rs). Unlike textureless.rs, which selects textureless
//! blocks, it uses all of them, and rejects a region if its blocks differ by more than noise.
//! Texture that is uniform over a region counts as noise in both.
//!
//! Each region has a verdict of its own. The usable ones determine the noise, whatever the others
//! are.
//!
//! Regions cover few intensities. Beyond and between them the present profile is used, scaled by
//! the ratio of the measured σ to the profile's.

use super::noise::{CHANNELS, CalibrateError, NoiseCalibrator, NoiseOptions, SceneMotion};
use super::picked_region::{PickedError, PickedRegion, RegionError, RegionNoise};
use super::plane::SIDE;
use super::points::{NoisePoint, extend_by_profile, merge_close};
use super::single::from_single_frames;
use super::warning::Warning;
use crate::camera::NoiseProfile;
use crate::pixels::Pixels;

/// Independent samples of a usable point: σ within 7 %.
const MIN_SAMPLES: f64 = 400.0;
/// Largest share of pixels at an end of the code range, at rest, where clipping is corrected for.
const MAX_CLIPPED_SHARE: f64 = 0.5;

/// Result of measuring picked regions.
#[derive(Debug)]
pub struct PickedResult {
    /// Mean code value of each region (8 bits, mean of R, G and B), or the reason for its
    /// rejection.
    pub places: Vec<Result<f64, RegionError>>,
    /// Noise of all usable regions.
    pub noise: Result<PickedNoise, PickedError>,
}

/// Noise of the picked regions.
#[derive(Clone, Debug, PartialEq)]
pub struct PickedNoise {
    pub profile: NoiseProfile,
    /// Measured σ of R, G, B, ascending by code.
    pub points: [Vec<NoisePoint>; 3],
    pub motion: SceneMotion,
    /// Remarks for the user.
    pub warnings: Vec<Warning>,
}

impl PickedNoise {
    /// Range of the measured intensities, 8-bit codes.
    pub fn covered(&self) -> [f64; 2] {
        let codes = || self.points.iter().flatten().map(|point| point.code);
        [codes().fold(255.0, f64::min), codes().fold(0.0, f64::max)]
    }
}

/// Measures the noise of regions. `present` is the profile used beyond the measured intensities;
/// without one σ is constant there.
pub fn picked_noise(places: &[PickedRegion], motion: SceneMotion, present: Option<&NoiseProfile>) -> PickedResult {
    let (mut verdicts, mut warnings) = (Vec::new(), Vec::new());
    let estimate = match motion {
        _ if places.is_empty() => Err(PickedError::NoPlace),
        _ if places.iter().any(|place| place.frames().is_empty()) => {
            Err(PickedError::Calibrate(CalibrateError::NoFrames))
        }
        SceneMotion::Resting => from_resting_frames(places, &mut verdicts, &mut warnings),
        SceneMotion::Moving => from_single_frames(places, &mut verdicts, &mut warnings),
    };
    let noise = estimate.and_then(|RegionNoise { points, channel_correlation, neighbour_correlation }| {
        let points = points.map(merge_close);
        if let Some(missing) = (0..3).find(|c| points[*c].is_empty()) {
            return Err(PickedError::Channel(CHANNELS[missing]));
        }
        let bins = [0, 1, 2].map(|c| extend_by_profile(&points[c], present.map(|present| (present, c))));
        let profile = NoiseProfile { example: None, bins, channel_correlation, neighbour_correlation };
        Ok(PickedNoise { profile, points, motion, warnings })
    });
    PickedResult { places: verdicts, noise }
}

fn from_resting_frames(
    places: &[PickedRegion],
    verdicts: &mut Vec<Result<f64, RegionError>>,
    warnings: &mut Vec<Warning>,
) -> Result<RegionNoise, PickedError> {
    if places.iter().any(|place| place.frames().len() < 2) {
        return Err(PickedError::OneFrame);
    }
    let failed = |error| match error {
        CalibrateError::TooFew { .. } => PickedError::Few,
        error => PickedError::Calibrate(error),
    };
    let options = NoiseOptions { min_independent: MIN_SAMPLES, ..NoiseOptions::default() };
    let calibrator = || NoiseCalibrator::new(options.clone()).map_err(failed);
    let add = |calibrator: &mut NoiseCalibrator, frames: &[Pixels]| -> Result<(), CalibrateError> {
        calibrator.begin_scene(None)?;
        frames.iter().try_for_each(|frame| calibrator.add_frame(frame))?;
        calibrator.end_scene()
    };
    let mut all = calibrator()?;
    let mut is_any = false;
    for place in places {
        let (width, height) = place.size_px();
        let min_side_px = SIDE as u32;
        if width.min(height) < min_side_px {
            verdicts.push(Err(RegionError::Small { width, height, min_side_px }));
            continue;
        }
        let (code, clipped) = mean_and_clipped_share(place.frames());
        if clipped > MAX_CLIPPED_SHARE {
            verdicts.push(Err(RegionError::Clipped));
            continue;
        }
        // Tried alone first: an error in one scene would fail the whole calibration.
        match add(&mut calibrator()?, place.frames()) {
            Ok(()) => {}
            Err(CalibrateError::CameraMoves { .. } | CalibrateError::SceneChanges { .. }) => {
                verdicts.push(Err(RegionError::Changes));
                continue;
            }
            Err(error) => return Err(failed(error)),
        }
        add(&mut all, place.frames()).map_err(failed)?;
        is_any = true;
        verdicts.push(Ok(code));
    }
    if !is_any {
        return Err(PickedError::NoneFit);
    }
    let calibration = all.finish().map_err(failed)?;
    // Interpolated bins are evident from the covered range.
    let points = calibration.points();
    warnings.extend(calibration.warnings.into_iter().filter(|warning| !matches!(warning, Warning::Filled { .. })));
    let NoiseProfile { channel_correlation, neighbour_correlation, .. } = calibration.profile;
    Ok(RegionNoise { points, channel_correlation, neighbour_correlation })
}

/// Mean code of pictures, 8 bits, and the share of pixels with a channel at an end of the code
/// range.
fn mean_and_clipped_share(pictures: &[Pixels]) -> (f64, f64) {
    let (mut sum, mut clipped, mut count) = (0.0, 0.0, 0.0);
    for picture in pictures {
        let max_code = picture.max_code();
        for codes in (0..picture.height).flat_map(|y| (0..picture.width).map(move |x| picture.at(x, y))) {
            sum += codes.map(f64::from).iter().sum::<f64>() / 3.0 * 255.0 / f64::from(max_code);
            clipped += f64::from(u8::from(codes.iter().any(|code| *code == 0 || *code == max_code)));
            count += 1.0;
        }
    }
    (sum / count, clipped / count)
}
