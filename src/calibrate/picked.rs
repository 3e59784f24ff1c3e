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

use super::bins::chi_square_interval;
use super::noise::{CHANNELS, CalibrateError, NoiseCalibrator, NoiseOptions, SceneMotion, round4};
use super::places::{Found, NoisePoint, PickedError, Place, Unfit, within};
use super::plane::SIDE;
use super::single::in_frames;
use super::warning::Warning;
use crate::camera::{NoiseBin, NoiseProfile};
use crate::pixels::{Codes, Pixels, Rect};

/// Independent samples that make a point: σ within 7 %.
const NEEDED: f64 = 400.0;
/// At rest, where clipping is corrected for, a place may have this share of its pixels at an end of the code range.
const MOST_CLIPPED: f64 = 0.5;
/// Points nearer than this become one, 8-bit codes.
const NEAR: f64 = 8.0;

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
pub fn picked_noise(places: &[Place<'_>], motion: SceneMotion, present: Option<&NoiseProfile>) -> Picked {
    let (mut verdicts, mut warnings) = (Vec::new(), Vec::new());
    let found = match motion {
        _ if places.is_empty() => Err(PickedError::NoPlace),
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
    places: &[Place<'_>],
    verdicts: &mut Vec<Result<f64, Unfit>>,
    warnings: &mut Vec<Warning>,
) -> Result<Found, PickedError> {
    if places.iter().any(|place| place.frames.len() < 2) {
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
        let at = within(place)?;
        let (width, height, least) = (at.width(), at.height(), SIDE as u32);
        if width.min(height) < least {
            verdicts.push(Err(Unfit::Small { width, height, least }));
            continue;
        }
        let frames: Vec<Pixels> = place.frames.iter().map(|frame| cut(frame, &at)).collect();
        let (code, clipped) = told(&frames);
        if clipped > MOST_CLIPPED {
            verdicts.push(Err(Unfit::Clipped));
            continue;
        }
        // First by itself: a scene that is refused would end them all.
        match add(&mut calibrator()?, &frames) {
            Ok(()) => {}
            Err(CalibrateError::CameraMoves { .. } | CalibrateError::SceneChanges { .. }) => {
                verdicts.push(Err(Unfit::Changes));
                continue;
            }
            Err(error) => return Err(failed(error)),
        }
        add(&mut all, &frames).map_err(failed)?;
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

/// Ascending, with those that lie close together as one.
fn merged(mut points: Vec<NoisePoint>) -> Vec<NoisePoint> {
    points.sort_by(|a, b| a.code.total_cmp(&b.code));
    let mut out: Vec<NoisePoint> = Vec::new();
    for point in points {
        match out.last_mut() {
            Some(last) if point.code - last.code < NEAR => {
                let total = last.independent_count + point.independent_count;
                let mean = |a: f64, b: f64| (a * last.independent_count + b * point.independent_count) / total;
                let (code, variance) = (mean(last.code, point.code), mean(last.sigma.powi(2), point.sigma.powi(2)));
                let sigma = variance.sqrt();
                // What chance alone leaves, but no less than how far the two lie apart.
                let chance = chi_square_interval(total).unwrap_or([0.0, 2.0]).map(|factor| sigma * factor.sqrt());
                let sigma_ci95 =
                    [chance[0].min(last.sigma).min(point.sigma), chance[1].max(last.sigma).max(point.sigma)];
                *last = NoisePoint { code, sigma, sigma_ci95, independent_count: total };
            }
            _ => out.push(point),
        }
    }
    out
}

/// A channel's bins: the points, and beyond and between them the present profile, scaled to meet them.
fn continued(points: &[NoisePoint], present: Option<(&NoiseProfile, usize)>) -> Vec<NoiseBin> {
    let bin = |code: f64, sigma: f64| NoiseBin { code: round4(code), sigma: round4(sigma) };
    let mut bins: Vec<NoiseBin> = points.iter().map(|point| bin(point.code, point.sigma)).collect();
    if let Some((present, channel)) = present {
        let ratio = |point: &NoisePoint| point.sigma / present.sigma(channel, point.code).max(1e-3);
        for of_present in &present.bins[channel] {
            let after = points.partition_point(|point| point.code <= of_present.code);
            let (below, above) = (points.get(after.wrapping_sub(1)), points.get(after));
            if [below, above].into_iter().flatten().any(|point| (point.code - of_present.code).abs() < NEAR) {
                continue;
            }
            let ratio = match (below, above) {
                (Some(a), Some(b)) => {
                    let share = (of_present.code - a.code) / (b.code - a.code);
                    ratio(a) + share * (ratio(b) - ratio(a))
                }
                (Some(only), None) | (None, Some(only)) => ratio(only),
                (None, None) => 1.0,
            };
            bins.push(bin(of_present.code, of_present.sigma * ratio));
        }
    }
    bins.sort_by(|a, b| a.code.total_cmp(&b.code));
    bins
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(code: f64, sigma: f64) -> NoisePoint {
        NoisePoint { code, sigma, sigma_ci95: [0.9 * sigma, 1.1 * sigma], independent_count: 500.0 }
    }

    #[test]
    fn beyond_the_points_the_present_profile_goes_on_scaled() {
        let present =
            [0.0, 50.0, 100.0, 150.0, 200.0].map(|code| NoiseBin { code, sigma: 1.0 + code / 100.0 }).to_vec();
        let present = NoiseProfile {
            bins: [present.clone(), present.clone(), present],
            channel_correlation: [0.0; 3],
            neighbour_correlation: [0.0; 2],
        };
        // At 50 it says 1.5 and 3 is found: twice. At 150 2.5 and 2.5: once. Between them 1.5 times.
        let bins = continued(&[point(50.0, 3.0), point(150.0, 2.5)], Some((&present, 1)));
        let expected = [(0.0, 2.0), (50.0, 3.0), (100.0, 3.0), (150.0, 2.5), (200.0, 3.0)];
        assert_eq!(bins.iter().map(|b| (b.code, b.sigma)).collect::<Vec<_>>(), expected);
        assert_eq!(continued(&[point(50.0, 3.0)], None), [NoiseBin { code: 50.0, sigma: 3.0 }]);
    }

    #[test]
    fn points_that_lie_close_become_one() {
        let all = merged(vec![point(90.0, 1.0), point(20.0, 2.0), point(24.0, 3.0)]);
        assert_eq!(all.len(), 2);
        assert!((all[0].code - 22.0).abs() < 1e-12 && (all[0].sigma - 6.5f64.sqrt()).abs() < 1e-12, "{all:?}");
        assert!(all[0].sigma_ci95[0] <= 2.0 && all[0].sigma_ci95[1] >= 3.0 && all[0].independent_count == 1000.0);
    }
}
