//! Compares the motion blur of virtual objects with that of real ones.
//!
//! A slow frame is composited as an object ([`frame_scene`](super::frame_scene())) into a fast one
//! near it, at several multiples of the pipeline's exposure time. Blur attenuates fine detail,
//! so the multiple at which virtual and real detail are equal is the ratio of real to virtual blur.
//! Detail is the band power of luma between two Gaussians over the squared mean luma; it does not
//! depend on registration. Resampling attenuates detail, too: compositing the slow frame into
//! itself measures by how much, and the result is corrected. The slow frame's own motion blur
//! remains in the virtual picture: 0.3 of the fast frame's lengthens it by 4 %.
//!
//! The camera's noise is detail, too. With the profile's power N in the band, the kept share k of
//! drawing, and the powers R of the real picture, M₀ of the virtual one without blur and M of it
//! with blur, the multiple is sought at which
//!
//!   M·(1 − kN/M₀) = k·(R − N)
//!
//! since the slow frame's noise is blurred with its texture. Areas count if M·(1 − kN/M₀) ≥ 2·kN at
//! the pipeline's own exposure.

use std::sync::Arc;

use glam::DVec3;

use super::error::VerifyError;
use super::frame_scene::{frame_scene, without_near_triangles};
use super::noise_floor::luma_sigma;
use crate::analyse::unit_noise;
use crate::camera::NoiseProfile;
use crate::compositor::Compositor;
use crate::fit::quantile::{nearest_quantile, upper_median};
use crate::grey_image::{GreyImage, gaussian};
use crate::params::Value;
use crate::shot::Shot;

/// Depth at which blur lengths are computed, m; smallest blur of a fast frame, px; largest blur of
/// its slow frame, by that.
const BLUR_DEPTH_M: f64 = 1.5;
const MIN_FAST_PX: f64 = 3.0;
const MAX_SLOW_SHARE: f64 = 0.3;
/// Largest distance between the frames of a pair, and largest number of pairs.
const MAX_GAP: usize = 10;
pub const MAX_PAIRS: usize = 5;
/// Multiples of the exposure at which the virtual picture is rendered.
const EXPOSURE_FACTORS: [f64; 5] = [0.5, 0.71, 1.0, 1.41, 2.0];
/// σ of the two Gaussians of the band-pass, px; side of an area, px; largest number of areas in a
/// pair: those with the most detail.
const BAND_SIGMAS_PX: (f32, f32) = (1.5, 4.0);
const AREA_PX: usize = 64;
const MAX_AREAS: usize = 12;
/// Smallest number of areas for a result.
const MIN_AREAS: usize = 10;
/// Smallest band power of an area in the blurred virtual picture, by the noise's.
const MIN_SIGNAL_TO_NOISE: f64 = 2.0;
/// Side of the field by which the noise's power in the band is measured, px.
const NOISE_FIELD_PX: usize = 256;

/// Length of virtual motion blur by that of real motion blur.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlurRatio {
    /// The median of the areas, and their quartiles.
    pub ratio: f64,
    pub between: (f64, f64),
    /// Number of measured pairs, and the median length of their virtual blur, px.
    pub pairs: usize,
    pub length_px: f64,
}

/// Measures the ratio. `None` without a fast frame near a slow one, or if the pictures lack detail.
/// `blur_px`: blur of each frame ([`lengths_px`]). `progress` is called before each of up to
/// [`MAX_PAIRS`] pairs.
pub fn blur(
    shot: &Shot,
    compositor: &mut Compositor,
    blur_px: &[Option<f64>],
    progress: &mut dyn FnMut(usize),
) -> Result<Option<BlurRatio>, VerifyError> {
    let mut shot = shot.clone();
    shot.settings.plain();
    for effect in ["exposure", "motion_blur"] {
        let _ = shot.settings.switch(effect, true);
    }
    let noise = shot.camera().noise.map(BandNoise::new);
    let (mut ratios, mut lengths) = (Vec::new(), Vec::new());
    for (done, (fast, slow, length_px)) in chosen(blur_px).into_iter().enumerate() {
        progress(done);
        let time_s = shot.recording.timestamps_s[fast];
        let (Ok(pose), Ok(geometry)) = (shot.recording.track.at(time_s), shot.geometry_at(fast)) else { continue };
        let Some(scene) = frame_scene(&shot, &shot.read(slow)?) else { continue };
        let scene = if geometry.needs_cube_map() { scene } else { without_near_triangles(scene, &pose) };
        compositor.set_scene(scene.clone());
        shot.scene = Arc::new(scene);
        let Some(power_ratio) = band_power_ratio(&shot, compositor, slow)? else { continue };
        let real = band(&GreyImage::luma_601(&shot.read(fast)?.pixels));
        let usual_s = exposure_s(&shot, fast)?;
        let mut still = shot.clone();
        let _ = still.settings.switch("motion_blur", false);
        let Some((unblurred, _)) = rendered(still, compositor, fast)? else { continue };
        let mut made = Vec::new();
        for by in EXPOSURE_FACTORS {
            let deg = 360.0 * by * usual_s / shot.interval_s(fast);
            let mut shot = shot.clone();
            let table = shot.rig.set(&mut shot.settings, "camera.exposure", "shutter_angle_deg", &Value::Number(deg));
            if !matches!(table, Some(Ok(()))) {
                continue;
            }
            made.extend(rendered(shot, compositor, fast)?.map(|(band, whole)| BlurredRender { by, band, whole }));
        }
        let area_ratios = areas(&real, power_ratio, &unblurred, &made, noise.as_ref());
        if !area_ratios.is_empty() {
            lengths.push(length_px);
        }
        ratios.extend(area_ratios);
    }
    if ratios.len() < MIN_AREAS {
        return Ok(None);
    }
    let [low, ratio, high] = [0.25, 0.5, 0.75].map(|share| nearest_quantile(&mut ratios, share).unwrap_or(0.0));
    let (pairs, length_px) = (lengths.len(), upper_median(lengths).unwrap_or(0.0));
    Ok(Some(BlurRatio { ratio, between: (low, high), pairs, length_px }))
}

fn exposure_s(shot: &Shot, n: usize) -> Result<f64, VerifyError> {
    Ok(shot.exposure_time(&shot.read(n)?).s)
}

/// Fast frames, each with the slowest frame near it, and the fast one's blur, px; the longest blur
/// first.
fn chosen(ways: &[Option<f64>]) -> Vec<(usize, usize, f64)> {
    let count = ways.len();
    let mut pairs = Vec::new();
    for fast in 0..count {
        let Some(way) = ways[fast].filter(|way| *way >= MIN_FAST_PX) else { continue };
        let near = fast.saturating_sub(MAX_GAP)..(fast + MAX_GAP + 1).min(count);
        let slow = near.filter_map(|n| Some((n, ways[n]?))).min_by(|a, b| a.1.total_cmp(&b.1));
        pairs.extend(slow.filter(|slow| slow.1 <= MAX_SLOW_SHARE * way).map(|slow| (fast, slow.0, way)));
    }
    pairs.sort_by(|a, b| b.2.total_cmp(&a.2).then(a.0.cmp(&b.0)));
    pairs.truncate(MAX_PAIRS);
    pairs
}

/// Length of each frame's motion blur, px. `None` where exposure or poses are unknown.
pub fn lengths_px(shot: &Shot) -> Vec<Option<f64>> {
    let length_px = |n| displacement_px(shot, n, exposure_s(shot, n).ok().filter(|s| *s > 0.0)?);
    (0..shot.recording.frame_count()).map(length_px).collect()
}

/// Displacement of the picture during an exposure, root mean square of five points, px.
fn displacement_px(shot: &Shot, n: usize, exposure_s: f64) -> Option<f64> {
    let geometry = shot.geometry_at(n).ok()?;
    let time_s = shot.recording.timestamps_s[n];
    let at = |by: f64| shot.recording.track.at(time_s + by * exposure_s).ok();
    let (here, before, after) = (at(0.0)?, at(-0.5)?, at(0.5)?);
    let mut sum = 0.0;
    let places = [(0.0, 0.0), (0.25, 0.2), (-0.25, 0.2), (0.25, -0.2), (-0.25, -0.2)];
    for (x, y) in places {
        let world = here.inverse_transform_point(BLUR_DEPTH_M * DVec3::new(x, y, 1.0));
        let project = |pose: &crate::pose::Pose| geometry.project(pose.transform_point(world));
        sum += (project(&after)? - project(&before)?).length_squared();
    }
    Some((sum / places.len() as f64).sqrt())
}

/// Band of a frame with the scene composited into it, and mask of the scene.
fn rendered(
    shot: Shot,
    compositor: &mut Compositor,
    n: usize,
) -> Result<Option<(BandPassImage, Vec<bool>)>, VerifyError> {
    let Some(made) = shot.frames(compositor, n..n + 1, true, 1)?.next().transpose()? else { return Ok(None) };
    let whole = made.layer.map(|layer| layer.rgba.iter().map(|p| p[3] > 0.999).collect());
    Ok(whole.map(|whole| (band(&GreyImage::luma_601(&made.pixels)), whole)))
}

/// Ratio of the band power after compositing a frame into itself to that before, median of the
/// areas with the most detail.
fn band_power_ratio(shot: &Shot, compositor: &mut Compositor, n: usize) -> Result<Option<f64>, VerifyError> {
    let mut plain = shot.clone();
    let _ = plain.settings.switch("motion_blur", false);
    let Some((made, whole)) = rendered(plain, compositor, n)? else { return Ok(None) };
    let real = band(&GreyImage::luma_601(&shot.read(n)?.pixels));
    let kept = places(&real, &[&whole]).into_iter().map(|(x, y)| made.power(x, y) / real.power(x, y).max(1e-12));
    Ok(upper_median(kept))
}

/// The virtual picture at one multiple of the exposure.
struct BlurredRender {
    by: f64,
    band: BandPassImage,
    whole: Vec<bool>,
}

/// Ratios of virtual to real blur in the areas with the most detail. `unblurred`: the virtual
/// picture without motion blur.
fn areas(
    real: &BandPassImage,
    kept: f64,
    unblurred: &BandPassImage,
    made: &[BlurredRender],
    noise: Option<&BandNoise>,
) -> Vec<f64> {
    let Some(sharpest) = made.first() else { return Vec::new() };
    let masks: Vec<&[bool]> = made.iter().map(|made| made.whole.as_slice()).collect();
    let ratio = |(x, y): (usize, usize)| {
        let noise = noise.map_or(0.0, |noise| noise.power(real, x, y));
        let texture = (1.0 - kept * noise / unblurred.power(x, y).max(1e-12)).max(0.0);
        let powers: Vec<(f64, f64)> = made.iter().map(|made| (made.by, texture * made.band.power(x, y))).collect();
        let usual = powers.iter().find(|(by, _)| *by == 1.0)?.1;
        if usual < MIN_SIGNAL_TO_NOISE * kept * noise {
            return None;
        }
        crossing(&powers, kept * (real.power(x, y) - noise).max(1e-12)).map(|by| 1.0 / by)
    };
    places(&sharpest.band, &masks).into_iter().filter_map(ratio).collect()
}

/// Corners of the areas with the most detail that lie within all masks.
fn places(band: &BandPassImage, masks: &[&[bool]]) -> Vec<(usize, usize)> {
    let (w, h) = (band.detail.width, band.detail.height);
    let mut areas = Vec::new();
    for y in (0..h.saturating_sub(AREA_PX - 1)).step_by(AREA_PX / 2) {
        for x in (0..w.saturating_sub(AREA_PX - 1)).step_by(AREA_PX / 2) {
            let is_whole = |mask: &&[bool]| {
                (y..y + AREA_PX).all(|y| mask[y * w + x..y * w + x + AREA_PX].iter().all(|inside| *inside))
            };
            if masks.iter().all(is_whole) {
                areas.push((band.power(x, y), (x, y)));
            }
        }
    }
    areas.sort_by(|a, b| b.0.total_cmp(&a.0));
    areas.truncate(MAX_AREAS);
    areas.into_iter().map(|(_, at)| at).collect()
}

/// Abscissa at which a falling curve has a value, with logarithmic interpolation; clamped to its
/// ends. `None` if blur hardly reduces the power.
fn crossing(powers: &[(f64, f64)], value: f64) -> Option<f64> {
    /// Largest ratio of the last to the first power.
    const MAX_POWER_RATIO: f64 = 0.75;
    let (first, last) = (powers.first()?, powers.last()?);
    if !(last.1 < MAX_POWER_RATIO * first.1 && last.1 > 0.0 && value > 0.0) {
        return None;
    }
    if value >= first.1 {
        return Some(first.0);
    }
    let step = powers.windows(2).find(|pair| pair[0].1 >= value && value > pair[1].1);
    let Some([a, b]) = step.and_then(|pair| <[(f64, f64); 2]>::try_from(pair).ok()) else { return Some(last.0) };
    let share = (a.1 / value).ln() / (a.1 / b.1).ln();
    Some((a.0.ln() + share * (b.0 / a.0).ln()).exp())
}

/// The camera's noise in a [`BandPassImage`].
struct BandNoise {
    profile: NoiseProfile,
    /// Variance of unit noise after the band-pass.
    share: f64,
}

impl BandNoise {
    fn new(profile: NoiseProfile) -> Self {
        let field = band(&unit_noise(NOISE_FIELD_PX, NOISE_FIELD_PX, 0, profile.neighbour_correlation));
        let share =
            field.detail.values.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>() / field.detail.values.len() as f64;
        Self { profile, share }
    }

    /// The noise's part of [`BandPassImage::power`].
    fn power(&self, of: &BandPassImage, x: usize, y: usize) -> f64 {
        let code = of.mean_code(x, y);
        let area = (AREA_PX * AREA_PX) as f64;
        area * self.share * (luma_sigma(&self.profile, code) / code).powi(2)
    }
}

/// Band-passed luma, and its local mean.
struct BandPassImage {
    detail: GreyImage,
    mean: GreyImage,
}

impl BandPassImage {
    /// Power of an area by the square of its mean.
    fn power(&self, x: usize, y: usize) -> f64 {
        let power: f64 = self.rows(x, y).flat_map(|row| &self.detail.values[row]).map(|v| f64::from(*v).powi(2)).sum();
        power / self.mean_code(x, y).powi(2)
    }

    /// Mean of an area, codes; 1 or more.
    fn mean_code(&self, x: usize, y: usize) -> f64 {
        let sum: f64 = self.rows(x, y).flat_map(|row| &self.mean.values[row]).map(|v| f64::from(*v)).sum();
        (sum / (AREA_PX * AREA_PX) as f64).max(1.0)
    }

    fn rows(&self, x: usize, y: usize) -> impl Iterator<Item = std::ops::Range<usize>> {
        let width = self.detail.width;
        (y..y + AREA_PX).map(move |y| y * width + x..y * width + x + AREA_PX)
    }
}

fn band(luma: &GreyImage) -> BandPassImage {
    let (fine, coarse) = (luma.filtered(&gaussian(BAND_SIGMAS_PX.0)), luma.filtered(&gaussian(BAND_SIGMAS_PX.1)));
    let values = fine.values.iter().zip(&coarse.values).map(|(a, b)| a - b).collect();
    BandPassImage { detail: GreyImage { values, ..fine }, mean: coarse }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::NoiseBin;

    #[test]
    fn crossing_is_interpolated_logarithmically() {
        let powers = [(0.5, 8.0), (1.0, 4.0), (2.0, 1.0)];
        // Half way down by logarithms from 4 to 1: half way by logarithms from 1 to 2.
        assert!((crossing(&powers, 2.0).unwrap() - 2f64.sqrt()).abs() < 1e-12);
        assert_eq!((crossing(&powers, 9.0), crossing(&powers, 0.5)), (Some(0.5), Some(2.0)));
        assert_eq!(crossing(&[(0.5, 8.0), (2.0, 7.0)], 7.5), None, "blur hardly reduces the power");
    }

    #[test]
    fn power_does_not_change_with_brightness() {
        let stripes = |by: f32| {
            let values = (0..96 * 96).map(|i| by * (100.0 + 20.0 * ((i % 96) as f32 * 0.6).sin())).collect();
            band(&GreyImage { width: 96, height: 96, values }).power(16, 16)
        };
        assert!((stripes(0.5) / stripes(1.0) - 1.0).abs() < 1e-5 && stripes(1.0) > 0.0);
    }

    #[test]
    fn ratio_is_virtual_blur_by_real_blur() {
        const PIXELS: usize = AREA_PX * AREA_PX;
        let detail = |power: f64| {
            let values = vec![power.sqrt() as f32; PIXELS];
            BandPassImage {
                detail: GreyImage { width: AREA_PX, height: AREA_PX, values },
                mean: GreyImage::uniform(AREA_PX, AREA_PX, 1.0),
            }
        };
        // The power of detail is inverse to the exposure; drawing keeps four fifths of it.
        let drawn = 0.8;
        let made = EXPOSURE_FACTORS.map(|by| BlurredRender { by, band: detail(drawn / by), whole: vec![true; PIXELS] });
        let unblurred = detail(4.0);
        // A frame whose real exposure is that multiple of the virtual picture's.
        for exposure in [0.625, 1.0, 1.6] {
            let ratios = areas(&detail(1.0 / exposure), drawn, &unblurred, &made, None);
            assert_eq!(ratios.len(), 1);
            assert!((ratios[0] * exposure - 1.0).abs() < 1e-4, "{} for {exposure}", ratios[0]);
        }
        // Noise of power 0.2 in the real picture; the slow frame's is blurred with its texture.
        let noise = |power: f64| {
            let bins = vec![NoiseBin { code: 1.0, sigma: 1.0 }];
            let profile = NoiseProfile {
                example: None,
                bins: [bins.clone(), bins.clone(), bins],
                channel_correlation: [1.0; 3],
                neighbour_correlation: [0.0; 2],
            };
            BandNoise { profile, share: power }
        };
        let made =
            EXPOSURE_FACTORS.map(|by| BlurredRender { by, band: detail(drawn * 1.05 / by), whole: vec![true; PIXELS] });
        let unblurred = detail(drawn * 4.2);
        let by_noise =
            |exposure: f64, power| areas(&detail(1.0 / exposure + 0.2), drawn, &unblurred, &made, Some(&noise(power)));
        for exposure in [0.625, 1.0, 1.6] {
            let ratios = by_noise(exposure, 0.2);
            assert!((ratios[0] * exposure - 1.0).abs() < 1e-4, "{ratios:?} for {exposure}");
        }
        assert!(by_noise(1.0, 0.6).is_empty(), "blurred detail of power 0.9 is not twice the noise");
    }
}
