//! Noise of places that a person picked: rectangles of plain colour, in frames at rest or in any.
//!
//! At rest each rectangle is a scene (noise.rs): noise is what varies from frame to frame, texture does no harm. In a single
//! frame, or while the camera moves, noise is what blocks of 12×12 pixels show beside a plane (single.rs). Other than
//! moving.rs it is not searched for among texture: all blocks count, and a place whose blocks differ by more than noise does
//! is left out. (Texture that is alike all over a place counts as noise here too.)
//!
//! Each place has a verdict of its own; those that are good make the noise, whatever the others are.
//!
//! Few intensities are picked. Beyond and between them the profile goes on as the present one does, scaled by the ratio of
//! what was measured to what it says there.

use super::noise::{CHANNELS, CalibrateError, NoiseCalibrator, NoiseOptions, SceneMotion};
use super::places::{Found, PickedError, Place, Unfit};
use super::plane::SIDE;
use super::points::{NoisePoint, continued, merged};
use super::single::in_frames;
use super::warning::Warning;
use crate::camera::NoiseProfile;
use crate::pixels::Pixels;

/// Independent samples that make a point: σ within 7 %.
const NEEDED: f64 = 400.0;
/// At rest, where clipping is corrected for, a place may have this share of its pixels at an end of the code range.
const MOST_CLIPPED: f64 = 0.5;

/// What picked places tell.
#[derive(Debug)]
pub struct Picked {
    /// Of each place its mean code value (8 bits, of R, G and B together), or why it tells nothing.
    pub places: Vec<Result<f64, Unfit>>,
    /// By all that are good.
    pub noise: Result<PickedNoise, PickedError>,
}

/// The noise that picked places have.
#[derive(Clone, Debug, PartialEq)]
pub struct PickedNoise {
    pub profile: NoiseProfile,
    /// What was measured, ascending, of R, G, B.
    pub points: [Vec<NoisePoint>; 3],
    pub motion: SceneMotion,
    /// Things a person should know before taking it.
    pub warnings: Vec<Warning>,
}

impl PickedNoise {
    /// The intensities that were measured, 8-bit codes.
    pub fn covered(&self) -> [f64; 2] {
        let codes = || self.points.iter().flatten().map(|point| point.code);
        [codes().fold(255.0, f64::min), codes().fold(0.0, f64::max)]
    }
}

/// Noise of places. `present` is the profile beyond what was measured; without one σ is constant there.
pub fn picked_noise(places: &[Place], motion: SceneMotion, present: Option<&NoiseProfile>) -> Picked {
    let (mut verdicts, mut warnings) = (Vec::new(), Vec::new());
    let found = match motion {
        _ if places.is_empty() => Err(PickedError::NoPlace),
        _ if places.iter().any(|place| place.frames().is_empty()) => {
            Err(PickedError::Calibrate(CalibrateError::NoFrames))
        }
        SceneMotion::Resting => at_rest(places, &mut verdicts, &mut warnings),
        SceneMotion::Moving => in_frames(places, &mut verdicts, &mut warnings),
    };
    let noise = found.and_then(|Found { points, channel_correlation, neighbour_correlation }| {
        let points = points.map(merged);
        if let Some(missing) = (0..3).find(|c| points[*c].is_empty()) {
            return Err(PickedError::Channel(CHANNELS[missing]));
        }
        let bins = [0, 1, 2].map(|c| continued(&points[c], present.map(|present| (present, c))));
        let profile = NoiseProfile { bins, channel_correlation, neighbour_correlation };
        Ok(PickedNoise { profile, points, motion, warnings })
    });
    Picked { places: verdicts, noise }
}

fn at_rest(
    places: &[Place],
    verdicts: &mut Vec<Result<f64, Unfit>>,
    warnings: &mut Vec<Warning>,
) -> Result<Found, PickedError> {
    if places.iter().any(|place| place.frames().len() < 2) {
        return Err(PickedError::OneFrame);
    }
    let failed = |error| match error {
        CalibrateError::TooFew { .. } => PickedError::Few,
        error => PickedError::Calibrate(error),
    };
    let options = NoiseOptions { min_independent: NEEDED, ..NoiseOptions::default() };
    let calibrator = || NoiseCalibrator::new(options.clone()).map_err(failed);
    let add = |calibrator: &mut NoiseCalibrator, frames: &[Pixels]| -> Result<(), CalibrateError> {
        calibrator.begin_scene(None)?;
        frames.iter().try_for_each(|frame| calibrator.add_frame(frame))?;
        calibrator.end_scene()
    };
    let (mut all, mut is_any) = (calibrator()?, false);
    for place in places {
        let ((width, height), least) = (place.size_px(), SIDE as u32);
        if width.min(height) < least {
            verdicts.push(Err(Unfit::Small { width, height, least }));
            continue;
        }
        let (code, clipped) = told(place.frames());
        if clipped > MOST_CLIPPED {
            verdicts.push(Err(Unfit::Clipped));
            continue;
        }
        // First by itself: a scene that is refused would end them all.
        match add(&mut calibrator()?, place.frames()) {
            Ok(()) => {}
            Err(CalibrateError::CameraMoves { .. } | CalibrateError::SceneChanges { .. }) => {
                verdicts.push(Err(Unfit::Changes));
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
    // Which bins are filled from others is plain from the range that is covered.
    let points = calibration.points();
    warnings.extend(calibration.warnings.into_iter().filter(|warning| !matches!(warning, Warning::Filled { .. })));
    let NoiseProfile { channel_correlation, neighbour_correlation, .. } = calibration.profile;
    Ok(Found { points, channel_correlation, neighbour_correlation })
}

/// The mean code of pictures, 8 bits, and the share of pixels with a channel at an end of the code range.
fn told(pictures: &[Pixels]) -> (f64, f64) {
    let (mut sum, mut clipped, mut count) = (0.0, 0.0, 0.0);
    for picture in pictures {
        let most = picture.max_code();
        for codes in (0..picture.height).flat_map(|y| (0..picture.width).map(move |x| picture.at(x, y))) {
            sum += codes.map(f64::from).iter().sum::<f64>() / 3.0 * 255.0 / f64::from(most);
            clipped += f64::from(u8::from(codes.iter().any(|code| *code == 0 || *code == most)));
            count += 1.0;
        }
    }
    (sum / count, clipped / count)
}
