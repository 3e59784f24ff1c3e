//! Fills unseen texels of the panorama so that its upward irradiance equals the white level.
//!
//! The irradiance of matt surfaces follows E(n)/E(up) = 0.4 + 0.6·(1 + n·up)/2, as measured on
//! pillars, cartons, books and paper on walls (0.55 to 0.85 of E(up) where n is level). Radiance
//! that is linear in the elevation has exactly this irradiance: L(d) = W·(0.4 + 0.3 + 0.45·d·up),
//! since ∫ (d·up)·cos θ dω / π = (2/3)·n·up.

use crate::fit::quantile::upper_median;
use std::f64::consts::PI;

use super::panorama::{HEIGHT, PartialPanorama, WIDTH, direction, solid_sr, upward};

/// Uniform and elevation-dependent part of the irradiance.
const UNIFORM_SHARE: f64 = 0.4;
const ELEVATION_SHARE: f64 = 0.6;
/// Largest radiance of unseen directions above the horizon, by the white level: more contradicts
/// it.
const MAX_FILL: f64 = 4.0;
/// Smallest projected solid angle that can be filled, by π.
const MIN_OPEN: f64 = 1e-6;

/// A panorama that depends on the elevation only.
pub fn even(white: [f64; 3]) -> Vec<[f32; 3]> {
    let at = |n: usize| UNIFORM_SHARE + 0.5 * ELEVATION_SHARE + 0.75 * ELEVATION_SHARE * direction(n).y;
    (0..WIDTH * HEIGHT).map(|n| white.map(|white| (at(n) * white) as f32)).collect()
}

/// The panorama with unseen texels filled: above the horizon so that matt white that faces up shows
/// `white`, below it with the median of all seen texels. Where even the darkest or the brightest
/// fill misses `white`, the whole panorama is scaled to it.
///
/// # Errors
///
/// The reason, if the panorama contradicts the white level: if with `by_lamps`, the lamps' part of
/// it, a channel would miss the whole white level by a factor outside of `between`, its interval.
pub fn filled(
    panorama: &PartialPanorama,
    white: [f64; 3],
    by_lamps: [f64; 3],
    between: [f64; 2],
) -> Result<Vec<[f32; 3]>, String> {
    let by_seen = upward(&panorama.iter().map(|light| light.unwrap_or_default()).collect::<Vec<_>>());
    let is_open = |n: &usize| panorama[*n].is_none() && direction(*n).y > 0.0;
    let open: f64 = (0..panorama.len()).filter(is_open).map(|n| direction(n).y * solid_sr(n) / PI).sum();
    let above = [0, 1, 2].map(|c| ((white[c] - by_seen[c]) / open.max(MIN_OPEN)).clamp(0.0, MAX_FILL * white[c]));
    // White level by the filled panorama, by the intended one.
    let ratio = [0, 1, 2].map(|c| (by_seen[c] + above[c] * open) / white[c].max(f64::MIN_POSITIVE));
    let of_all =
        [0, 1, 2].map(|c| (ratio[c] * white[c] + by_lamps[c]) / (white[c] + by_lamps[c]).max(f64::MIN_POSITIVE));
    if let Some(ratio) = of_all.into_iter().find(|ratio| !(between[0]..=between[1]).contains(ratio)) {
        return Err(format!("upward-facing white would have {ratio:.2} times the white level"));
    }
    let below = [0, 1, 2].map(|c| {
        let measured = panorama.iter().flatten().map(|light| f64::from(light[c]));
        upper_median(measured).unwrap_or(UNIFORM_SHARE * white[c])
    });
    let unseen = |n: usize| (if direction(n).y > 0.0 { above } else { below }).map(|light| light as f32);
    let scaled = |light: [f32; 3]| [0, 1, 2].map(|c| light[c] / ratio[c] as f32);
    Ok(panorama.iter().enumerate().map(|(n, light)| scaled(light.unwrap_or_else(|| unseen(n)))).collect())
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    /// An interval that allows rounding errors only.
    const EXACT: [f64; 2] = [1.0 - 1e-6, 1.0 + 1e-6];

    /// Light of matt white with this normal.
    fn shown(rgb: &[[f32; 3]], normal: DVec3) -> f64 {
        let of =
            |(n, light): (usize, &[f32; 3])| f64::from(light[1]) * direction(n).dot(normal).max(0.0) * solid_sr(n) / PI;
        rgb.iter().enumerate().map(of).sum()
    }

    #[test]
    fn even_light_falls_off_by_its_formula() {
        let rgb = even([0.5, 1.0, 2.0]);
        for (normal, expected) in [(DVec3::Y, 1.0), (DVec3::X, 0.7), (DVec3::NEG_Y, 0.4)] {
            assert!((shown(&rgb, normal) - expected).abs() < 2e-3, "{normal}: {}", shown(&rgb, normal));
        }
    }

    #[test]
    fn unseen_light_above_completes_the_white_level() {
        // All below the horizon shows 0.3. Above it half of the directions show 0.2: by hand the
        // other half shows 2 − 0.2.
        let half = |n: usize| n % WIDTH < WIDTH / 2;
        let light = |n: usize| match direction(n).y > 0.0 {
            true => half(n).then_some([0.2; 3]),
            false => half(n).then_some([0.3; 3]),
        };
        let panorama: PartialPanorama = (0..WIDTH * HEIGHT).map(light).collect();
        let rgb = filled(&panorama, [1.0; 3], [0.0; 3], EXACT).unwrap();
        assert!((shown(&rgb, DVec3::Y) - 1.0).abs() < 1e-3);
        assert!((rgb[WIDTH - 1][1] - 1.8).abs() < 0.01, "{:?}", rgb[WIDTH - 1]);
        assert_eq!(rgb[WIDTH * HEIGHT - 1][1], 0.3, "median of as many of 0.2 as of 0.3, the upper one");
    }

    #[test]
    fn panorama_that_misses_the_white_level_is_scaled_within_its_interval_or_refused() {
        // All of the sky is seen and sends 1.2.
        let panorama: PartialPanorama = (0..WIDTH * HEIGHT).map(|_| Some([1.2; 3])).collect();
        let rgb = filled(&panorama, [1.0; 3], [0.0; 3], [0.8, 1.25]).unwrap();
        assert!((shown(&rgb, DVec3::Y) - 1.0).abs() < 1e-3 && (rgb[0][1] - 1.0).abs() < 2e-3, "{:?}", rgb[0]);
        let refused = filled(&panorama, [1.0; 3], [0.0; 3], [0.8, 1.15]).unwrap_err();
        assert!(refused.contains("1.20 times"), "{refused}");
        // With 3 of 4 by lamps it misses a twentieth.
        assert!(filled(&panorama, [1.0; 3], [3.0; 3], [0.8, 1.15]).is_ok());
        // An eighth of it is open; four times the white level from there sends half of it.
        let narrow: PartialPanorama =
            (0..WIDTH * HEIGHT).map(|n| (n % WIDTH >= WIDTH / 8).then_some([0.0; 3])).collect();
        let refused = filled(&narrow, [1.0; 3], [0.0; 3], [0.8, 1.25]).unwrap_err();
        assert!(refused.contains("0.50 times"), "{refused}");
        let rgb = filled(&narrow, [1.0; 3], [0.0; 3], [0.4, 1.25]).unwrap();
        assert!((shown(&rgb, DVec3::Y) - 1.0).abs() < 1e-3, "{}", shown(&rgb, DVec3::Y));
    }
}
