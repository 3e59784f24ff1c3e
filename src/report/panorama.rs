//! Figure of the room's light: the panorama, with rings around lamps.

use glam::DVec3;

use super::page::{Body, Figure};
use super::tile::png_uri;
use super::{ReportError, ReportSource};
use crate::analyse::{EnvironmentFit, LampEstimate};
use crate::camera::Response;
use crate::fit::quantile::lower_quantile;
use crate::render::panorama::texel_coordinates;
use crate::scene::world_from_panorama;
use crate::text::{count, fixed};

/// Magnification of the texels.
const MAGNIFICATION: u32 = 3;
/// Quantile of the texels that is shown as white.
const WHITE_QUANTILE: f64 = 0.99;
/// Radii of a lamp's ring, px of the enlarged picture, and width of its dark border.
const RING: std::ops::Range<f64> = 6.0..8.5;
const RIM_PX: f64 = 1.5;
const RING_COLOUR: [u8; 3] = [255, 214, 10];
const RIM_COLOUR: [u8; 3] = [20, 20, 20];

pub fn panorama(source: &ReportSource<'_>) -> Result<Figure, ReportError> {
    let title = "The light of the room";
    let analysis = source.analysis;
    let (Some(light), Some(around)) = (&analysis.findings.light, &analysis.environment) else {
        let why = analysis.findings.light.as_ref().and_then(|light| light.why.clone());
        return Ok(Figure::left_out(title, why.unwrap_or_else(|| "it was not estimated".to_owned())));
    };
    let (middle_m, up) = (light.middle_m.map_or(DVec3::ZERO, DVec3::from), light.up.map_or(DVec3::Z, DVec3::from));
    let lamps = light.lamps.iter().filter(|lamp| !lamp.is_bounce());
    let lamps: Vec<_> = lamps.map(|lamp| seen_from(lamp, middle_m, up, around)).collect();
    let (width, height) = (MAGNIFICATION * around.width, MAGNIFICATION * around.height);
    let picture = png_uri(&drawn(around, &lamps), width, height)?;
    let percent = |share: Option<f64>| fixed(100.0 * share.unwrap_or_default(), 0);
    let ringed = match lamps.len() {
        0 => "No lamp is claimed.".to_owned(),
        lamps => format!("A ring marks each lamp: {}.", count(lamps, "lamp")),
    };
    let caption = format!(
        "All directions around the middle of the observed scene, the horizon half-way down. {} % of them were seen; \
         elsewhere the light is inferred from surfaces. {ringed}",
        percent(light.coverage)
    );
    Ok(Figure { title, caption, legend: Vec::new(), body: Body::Panorama { picture, width, height } })
}

/// Position of a lamp in the panorama, texels from the upper left.
fn seen_from(lamp: &LampEstimate, middle_m: DVec3, up: DVec3, around: &EnvironmentFit) -> [f64; 2] {
    let towards = world_from_panorama(up.normalize_or(DVec3::Z)).conjugate() * (DVec3::from(lamp.at_m) - middle_m);
    texel_coordinates(towards.normalize_or(DVec3::Y).as_vec3(), around.width, around.height).as_dvec2().to_array()
}

/// The enlarged panorama with its rings, 8 bits, row by row.
fn drawn(around: &EnvironmentFit, lamps: &[[f64; 2]]) -> Vec<[u8; 3]> {
    let mut brightest: Vec<f32> =
        around.rgb.iter().map(|rgb| rgb.iter().fold(0.0, |largest, v| v.max(largest))).collect();
    let white = lower_quantile(&mut brightest, WHITE_QUANTILE).unwrap_or(0.0).max(f32::MIN_POSITIVE);
    let response = Response::default();
    let code = |light: f32| (255.0 * response.encode(f64::from(light / white))).round() as u8;
    let wide = MAGNIFICATION * around.width;
    let tile_pixel = |n: u32| {
        let (x, y) = (n % wide, n / wide);
        let at = |[u, v]: &[f64; 2]| {
            let [dx, dy] = [(x, u, around.width), (y, v, 0)].map(|(at, lamp, round)| {
                let off = f64::from(at) + 0.5 - f64::from(MAGNIFICATION) * lamp;
                // The panorama continues at either rim.
                let round = f64::from(MAGNIFICATION * round);
                if round > 0.0 { off - round * (off / round).round() } else { off }
            });
            dx.hypot(dy)
        };
        let ring_px = lamps.iter().map(at).filter(|far| *far < RING.end + RIM_PX && *far >= RING.start - RIM_PX);
        match ring_px.reduce(f64::min) {
            Some(far) if RING.contains(&far) => RING_COLOUR,
            Some(_) => RIM_COLOUR,
            None => around.rgb[(y / MAGNIFICATION * around.width + x / MAGNIFICATION) as usize].map(code),
        }
    };
    (0..wide * MAGNIFICATION * around.height).map(tile_pixel).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rings_are_drawn_around_lamps_and_wrap_at_the_border() {
        let rgb: Vec<[f32; 3]> = (0..64 * 32).map(|n| [if n / 64 < 16 { 1.0 } else { 0.214 }; 3]).collect();
        let around = EnvironmentFit { width: 64, height: 32, rgb: rgb.into(), hdr: [].into() };
        // 45° above the panorama's middle, which is upright's −z.
        let towards = world_from_panorama(DVec3::Z) * DVec3::new(0.0, 1.0, -1.0);
        let lamp =
            LampEstimate { at_m: (2.0 * towards + DVec3::X).to_array(), shown_at_1_m: [1.0; 3], diameter_m: 0.25 };
        let [x, y] = seen_from(&lamp, DVec3::X, DVec3::Z, &around);
        assert!((x - 32.0).abs() < 1e-3 && (y - 8.0).abs() < 1e-3, "{x} {y}");
        let rgb = drawn(&around, &[[x, y], [0.0, 24.0]]);
        let at = |x: usize, y: usize| rgb[y * 192 + x];
        assert_eq!((at(96, 24), at(96, 17), at(96, 15)), ([255; 3], RING_COLOUR, RIM_COLOUR));
        // sRGB of 0.214 is half.
        assert_eq!((at(50, 60)[0], at(7, 72), at(184, 72)), (127, RING_COLOUR, RING_COLOUR));
    }
}
