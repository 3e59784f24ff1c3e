//! What the displacement of patches reads of exact poses.
//!
//! A frame and its twin, drawn into that frame by its own pose, show the same things in the same places. Both get noise of their
//! own, as much as the camera's: as much as two frames at rest differ by. The displacement that remains is the floor f of the
//! measurement: noise, lack of texture, and what drawing a picture again does to it. Noise adds to a displacement b in quadrature,
//! so that of a measured m
//!
//!   b = √max(m² − f², 0)
//!
//! The pair at rest keeps the frame's own noise in both pictures as if it were texture, so that the floor is, if anything, too low.
//! Not modelled: depth that errs, blur that differs between frames; they stay in b.

use crate::analyse::unit_noise;
use crate::camera::NoiseProfile;
use crate::measure::Grey;

/// Luma of BT.709, as [`Grey::luma`] has it.
const LUMA: [f64; 3] = [0.2126, 0.7152, 0.0722];
/// Patches that lie half over each other in both directions: so many count as one.
const OVERLAP: f64 = 4.0;

/// A picture with noise of the camera added, which follows from the seed.
pub fn with_noise(picture: &Grey, profile: &NoiseProfile, seed: u64) -> Grey {
    let sigma: Vec<f64> = (0..256u32).map(|code| luma_sigma(profile, code.into())).collect();
    let noise = unit_noise(picture.width, picture.height, seed, profile.neighbour_correlation);
    let with = |(value, noise): (&f64, &f32)| value + sigma[value.clamp(0.0, 255.0) as usize] * f64::from(*noise);
    Grey { values: picture.values.iter().zip(&noise.values).map(with).collect(), ..*picture }
}

/// σ of luma where all channels have one code.
pub fn luma_sigma(profile: &NoiseProfile, code: f64) -> f64 {
    let [r, g, b] = [0, 1, 2].map(|c| LUMA[c] * profile.sigma(c, code));
    let [red_green, red_blue, green_blue] = profile.channel_correlation;
    let across = red_green * r * g + red_blue * r * b + green_blue * g * b;
    (r * r + g * g + b * b + 2.0 * across).max(0.0).sqrt()
}

/// Lengths of patches' displacements, px: what poses miss by, and the measurement's floor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Displaced {
    /// As measured: median and 90 %.
    pub measured: (f64, f64),
    /// The floor, median and 90 %, as two frames at rest would measure. `None` without the camera's
    /// noise, or where no patch counts at rest.
    pub floor: Option<(f64, f64)>,
    /// Without the floor: median and 90 %. As measured where the floor is not known.
    pub px: (f64, f64),
    /// One standard deviation of the median without the floor.
    pub sigma_px: f64,
}

impl Displaced {
    /// Of all patches of all pairs, and of those at rest. `None` without patches.
    pub fn of(measured: &mut [f64], at_rest: &mut [f64]) -> Option<Self> {
        let (of_pairs, sigma) = summary(measured)?;
        let Some((floor, floor_sigma)) = summary(at_rest) else {
            return Some(Self { measured: of_pairs, floor: None, px: of_pairs, sigma_px: sigma });
        };
        let square = of_pairs.0.powi(2) - floor.0.powi(2);
        // σ of m² − f².
        let square_sigma = 2.0 * (of_pairs.0 * sigma).hypot(floor.0 * floor_sigma);
        let px = square.max(0.0).sqrt();
        let sigma_px = (square.max(0.0) + square_sigma).sqrt() - px;
        let ninety = (of_pairs.1.powi(2) - floor.1.powi(2)).max(0.0).sqrt().max(px);
        Some(Self { measured: of_pairs, floor: Some(floor), px: (px, ninety), sigma_px })
    }
}

/// Median and 90 %, and one standard deviation of the median by the values of the ranks beside it.
fn summary(values: &mut [f64]) -> Option<((f64, f64), f64)> {
    values.sort_by(f64::total_cmp);
    let last = values.len().checked_sub(1)? as f64;
    let at = |share: f64| values[(last * share.clamp(0.0, 1.0)).round() as usize];
    // Ranks of a median scatter by √n / 2 of n.
    let ranks = 0.5 * (OVERLAP / values.len() as f64).sqrt();
    Some(((at(0.5), at(0.9)), 0.5 * (at(0.5 + ranks) - at(0.5 - ranks))))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lengths of errors of σ 0.3 px along each axis about a displacement.
    fn lengths(count: usize, by_px: f64, seed: u64) -> Vec<f64> {
        let noise = unit_noise(2 * count, 1, seed, [0.0; 2]).values;
        noise.chunks(2).map(|xy| (by_px + 0.3 * f64::from(xy[0])).hypot(0.3 * f64::from(xy[1]))).collect()
    }

    #[test]
    fn floor_is_taken_off_exact_poses_and_leaves_a_pixel_a_pixel() {
        let of = |by_px: f64| Displaced::of(&mut lengths(800, by_px, 1), &mut lengths(800, 0.0, 2)).unwrap();
        let (exact, moved) = (of(0.0), of(1.0));
        // Rayleigh: the median is 1.177 σ.
        assert!((exact.measured.0 - 0.353).abs() < 0.03, "{exact:?}");
        assert!(exact.px.0 < 2.0 * exact.sigma_px && exact.px.0 < 0.15, "{exact:?}");
        assert!((moved.px.0 - 1.0).abs() < 0.05 && moved.px.0 > 2.0 * moved.sigma_px, "{moved:?}");
        assert!(moved.px.1 >= moved.px.0 && moved.px.1 < moved.measured.1, "{moved:?}");
    }

    #[test]
    fn unknown_noise_takes_nothing_off() {
        let told = Displaced::of(&mut lengths(100, 0.0, 1), &mut []).unwrap();
        assert_eq!((told.px, told.floor), (told.measured, None));
        assert_eq!(Displaced::of(&mut [], &mut [0.3]), None);
    }
}
