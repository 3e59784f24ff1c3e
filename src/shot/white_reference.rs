//! White references: matt surfaces of known reflectance that the user picks, and the
//! factors that they imply for the estimated lighting.
//!
//! Reflectance and lighting share a factor that a recording does not determine
//! ([`crate::analyse`]). White paper and paint have a reflectance ρ of about 0.8. If the surface
//! shows the light B, and white would show W under the estimated lighting ([`white_radiance`]), the
//! lighting is to be multiplied by B / (ρ·W), channel by channel.
//!
//! B is the median of a patch of a few pixels, through the camera's response, divided by the
//! frame's gain relative to the usual one. Refused are: clipped pixels, which are only a lower
//! bound; edges, in the picture or in depth; nearly black surfaces; penumbrae of lamps. Not
//! modelled: specular and emissive surfaces.

use glam::{DVec3, Vec3};

use super::{FramePoint, Shot, SurfaceError};
use crate::camera::Response;
use crate::fit::quantile::nearest_quantile;
use crate::frame::Frame;
use crate::scene::{Lighting, PointLight};
use crate::shadow::{WhiteRadiance, white_radiance};

/// Radius of the patch, px at a width of 640.
const PATCH_RADIUS_PX: f64 = 2.0;
/// Largest accepted share of clipped pixels in the patch.
const MAX_CLIPPED_SHARE: f64 = 0.1;
/// Largest accepted difference between the patch's tenth and ninetieth percentile, relative to the
/// median: larger differences are an edge or a pattern, not noise.
const MAX_UNEVENNESS: f64 = 0.4;
/// Radius of the depth around the patch, px at a width of 640.
const DEPTH_RADIUS_PX: f64 = 4.0;
/// Largest accepted relative difference of measured depths from the surface's.
const MAX_DEPTH_DIFFERENCE: f64 = 0.05;
/// Smallest accepted light: darker surfaces are dominated by the sensor's noise.
const MIN_LIGHT: f64 = 0.01;
/// Accepted factors on all light. Other values mean that the surface is no such reference.
pub const ACCEPTED_FACTORS: [f64; 2] = [0.125, 8.0];
/// Largest accepted ratio between the factors of two channels.
const MAX_TINT: f64 = 3.0;
/// Share of the light from which on a partly visible lamp makes a penumbra.
const MIN_PENUMBRA_SHARE: f32 = 0.05;
/// Lamps wider than this have penumbrae that are as even as the light of an open sky, m.
const SMOOTH_PENUMBRA_M: f64 = 1.0;

/// A picked position of a neutral matt surface of known reflectance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReferencePick {
    pub view: FramePoint,
    pub reflectance: f64,
}

/// A neutral reference surface and its implication for the estimated light.
#[derive(Clone, Debug, PartialEq)]
pub struct WhiteReference {
    /// Factors on the lighting: red, green, blue.
    pub factors: [f64; 3],
    /// Position and normal of the surface in the world, m.
    pub point_m: DVec3,
    pub normal: DVec3,
    /// Its linear light in a frame of usual exposure: red, green, blue.
    pub shown: [f64; 3],
    /// The light of a white matt surface there under the estimated lighting.
    pub comes: WhiteRadiance,
}

/// Why a picked surface is no reference.
#[derive(Debug, thiserror::Error)]
pub enum WhiteReferenceError {
    #[error(
        "it is clipped there ({percent:.0} % of the surrounding pixels), so its brightness is unknown; pick a darker \
         part of it, or a darker frame"
    )]
    Clipped { percent: f64 },
    #[error(
        "there is an edge or a pattern: light differs by {percent:.0} % within a few pixels; pick an even part of it"
    )]
    Uneven { percent: f64 },
    #[error("the edge of an object is within a few pixels, according to depth; pick the middle of it")]
    Edge,
    #[error("it is nearly black there ({shown:.4} of the camera's white): it is not white, or no light falls on it")]
    Dark { shown: f64 },
    #[error("depth is missing around it, so its orientation is unknown; pick another part of it, or another frame")]
    NoDepth,
    #[error(
        "it lies at the edge of a lamp's shadow ({percent:.0} % of lamp {lamp} is visible from there); pick a part in \
         the light"
    )]
    HalfShadow { lamp: usize, percent: f64 },
    #[error("no light falls on it, according to the estimated lighting")]
    Unlit,
    #[error(
        "all light would become {factor:.3} times as bright; expected {} to {}: its reflectance is not \
         {reflectance}, or it emits light",
        ACCEPTED_FACTORS[0], ACCEPTED_FACTORS[1]
    )]
    Implausible { factor: f64, reflectance: f64 },
    #[error(
        "one colour of the light would change {ratio:.1} times as much as another, and at most {MAX_TINT} times is \
         accepted: it is coloured"
    )]
    Coloured { ratio: f64 },
    #[error(transparent)]
    Surface(#[from] SurfaceError),
}

impl Shot {
    /// The factors that each reference surface implies for a lighting of the room. The first
    /// refused one is the error, with its index.
    pub fn white_references(
        &self,
        picks: &[ReferencePick],
        lighting: &Lighting,
    ) -> Result<Vec<WhiteReference>, (usize, WhiteReferenceError)> {
        if picks.is_empty() {
            return Ok(Vec::new());
        }
        let room = self.solids();
        let white_reference = |ReferencePick { view, reflectance }: &ReferencePick| {
            let frame = self.read(view.frame).map_err(|error| SurfaceError::from(Box::new(error)))?;
            let surface = self.surface_at(&frame, view.at_px).map_err(|error| match error {
                SurfaceError::NoDepth { .. } | SurfaceError::NotMeasured { .. } => WhiteReferenceError::NoDepth,
                other => other.into(),
            })?;
            let shown = median_light(&frame, view, &self.camera().response)?;
            if crosses_an_edge(&frame, view, surface.depth_m) {
                return Err(WhiteReferenceError::Edge);
            }
            let plane = surface.plane;
            let comes = white_radiance(lighting, &room, &plane);
            let factors = factors(shown, *reflectance, &comes, &lighting.points)?;
            Ok(WhiteReference { factors, point_m: plane.point_m, normal: plane.normal, shown, comes })
        };
        picks.iter().enumerate().map(|(n, pick)| white_reference(pick).map_err(|error| (n, error))).collect()
    }
}

/// B / (ρ·W) of each channel.
fn factors(
    shown: [f64; 3],
    reflectance: f64,
    comes: &WhiteRadiance,
    lamps: &[PointLight],
) -> Result<[f64; 3], WhiteReferenceError> {
    let light = comes.light();
    for (n, (by, visibility)) in comes.lamps.iter().enumerate() {
        let is_wide = lamps.get(n).is_some_and(|lamp| f64::from(lamp.diameter_m) > SMOOTH_PENUMBRA_M);
        let matters = !is_wide && mean(*by) > MIN_PENUMBRA_SHARE * mean(light + *by);
        if matters && *visibility > 0.0 && *visibility < 1.0 {
            return Err(WhiteReferenceError::HalfShadow { lamp: n + 1, percent: 100.0 * f64::from(*visibility) });
        }
    }
    if light.min_element() <= 0.0 {
        return Err(WhiteReferenceError::Unlit);
    }
    let factor = shown.iter().sum::<f64>() / 3.0 / (reflectance * f64::from(mean(light)));
    if !(ACCEPTED_FACTORS[0]..=ACCEPTED_FACTORS[1]).contains(&factor) {
        return Err(WhiteReferenceError::Implausible { factor, reflectance });
    }
    let factors = [0, 1, 2].map(|c| shown[c] / (reflectance * f64::from(light[c])));
    let ends = factors.iter().fold((f64::INFINITY, 0.0), |(low, high): (f64, f64), f| (low.min(*f), high.max(*f)));
    let ratio = ends.1 / ends.0;
    if ratio > MAX_TINT { Err(WhiteReferenceError::Coloured { ratio }) } else { Ok(factors) }
}

fn mean(light: Vec3) -> f32 {
    light.element_sum() / 3.0
}

/// A radius at a width of 640, in pixels of a picture.
fn scaled_px(of_640_px: f64, width: u32) -> u32 {
    (of_640_px * f64::from(width) / 640.0).round().max(1.0) as u32
}

/// The pixels around a picked position.
fn around(view: &FramePoint, radius: u32, width: u32, height: u32) -> impl Iterator<Item = (u32, u32)> {
    let span = |at: f64, size: u32| {
        let middle = (at.max(0.0) as u32).min(size.saturating_sub(1));
        middle.saturating_sub(radius)..(middle + radius + 1).min(size)
    };
    let columns = span(view.at_px.x, width);
    span(view.at_px.y, height).flat_map(move |y| columns.clone().map(move |x| (x, y)))
}

/// The median of the light around a picked position, in a frame of usual exposure.
fn median_light(frame: &Frame, view: &FramePoint, response: &Response) -> Result<[f64; 3], WhiteReferenceError> {
    let pixels = &frame.pixels;
    let (width, height, max_code) = (pixels.width, pixels.height, pixels.max_code());
    let codes: Vec<[u32; 3]> =
        around(view, scaled_px(PATCH_RADIUS_PX, width), width, height).map(|(x, y)| pixels.at(x, y)).collect();
    let is_clipped = |codes: &&[u32; 3]| codes.iter().any(|code| *code >= pixels.clip_code());
    let clipped = codes.iter().filter(is_clipped).count() as f64 / codes.len() as f64;
    if clipped > MAX_CLIPPED_SHARE {
        return Err(WhiteReferenceError::Clipped { percent: 100.0 * clipped });
    }
    let sorted = |of: &dyn Fn([f64; 3]) -> f64| {
        let light = |codes: &[u32; 3]| codes.map(|code| response.decode(f64::from(code) / f64::from(max_code)));
        let mut values: Vec<f64> = codes.iter().map(|codes| of(light(codes))).collect();
        move |share: f64| nearest_quantile(&mut values, share).unwrap_or(0.0)
    };
    let mut all = sorted(&|light| light.iter().sum::<f64>() / 3.0);
    let (middle, differs) = (all(0.5), all(0.9) - all(0.1));
    // The frame's gain relative to the usual one.
    let gain = gain(frame, view);
    let usual = middle / (gain.iter().sum::<f64>() / 3.0);
    if usual < MIN_LIGHT || middle < MIN_LIGHT {
        return Err(WhiteReferenceError::Dark { shown: usual });
    }
    if differs > MAX_UNEVENNESS * middle {
        return Err(WhiteReferenceError::Uneven { percent: 100.0 * differs / middle });
    }
    Ok([0, 1, 2].map(|c| sorted(&|light| light[c])(0.5) / gain[c]))
}

/// Gain of a frame at a position, relative to the usual one: factors on linear light.
fn gain(frame: &Frame, view: &FramePoint) -> [f64; 3] {
    let Some(brightness) = frame.exposure.brightness else { return [1.0; 3] };
    let share = |at: f64, size: u32| (at / f64::from(size.max(1))) as f32;
    let at = [share(view.at_px.x, frame.pixels.width), share(view.at_px.y, frame.pixels.height)];
    let here = f64::from(brightness.spatial_gain.at(at)).exp2();
    brightness.factors.map(|factor| factor * here)
}

/// Whether depth around a position differs from the surface's.
fn crosses_an_edge(frame: &Frame, view: &FramePoint, far_m: f64) -> bool {
    let Some(depth) = &frame.depth else { return false };
    let mut places = around(view, scaled_px(DEPTH_RADIUS_PX, depth.width), depth.width, depth.height);
    places.any(|(x, y)| {
        let z = f64::from(depth.depth_m[(y * depth.width + x) as usize]);
        z > 0.0 && (z / far_m - 1.0).abs() > MAX_DEPTH_DIFFERENCE
    })
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;
    use crate::camera::Curve;
    use crate::frame::{FrameExposure, NODES, RelativeBrightness, SpatialGain};
    use crate::pixels::{DepthMap, Pixels};

    const VIEW: FramePoint = FramePoint { frame: 0, at_px: DVec2::new(320.5, 240.5) };

    fn frame(code: impl Fn(u32, u32) -> [u8; 3], brightness: Option<RelativeBrightness>) -> Frame {
        let places = (0..480).flat_map(|y| (0..640).map(move |x| (x, y)));
        let pixels = Pixels::from_u8(640, 480, places.flat_map(|(x, y)| code(x, y)).collect()).unwrap();
        let exposure = FrameExposure { brightness, ..FrameExposure::default() };
        Frame { exposure, ..Frame::new(0, 0.0, pixels) }
    }

    fn linear() -> Response {
        Response { curve: Curve::Linear, ..Response::default() }
    }

    #[test]
    fn factors_are_the_ratio_of_the_measured_to_the_expected_light() {
        // WhiteReference shows 0.5 by the sky and 0.25 by a lamp: 0.8 · 0.75 = 0.6. Measured is
        // 0.72: a factor of 1.2.
        let lamp = (Vec3::splat(0.25), 1.0);
        let comes = WhiteRadiance { far: Vec3::new(0.4, 0.5, 0.6), lamps: vec![lamp] };
        let is_about = |actual: [f64; 3], expected: [f64; 3]| {
            assert!(actual.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{actual:?} {expected:?}");
        };
        is_about(factors([0.78, 0.72, 0.51], 0.8, &comes, &[]).unwrap(), [1.5, 1.2, 0.75]);
        // A grey card of 0.3.
        is_about(factors([0.195, 0.225, 0.255], 0.3, &comes, &[]).unwrap(), [1.0; 3]);
        // With an occluded lamp, only the sky's light counts.
        let hidden = WhiteRadiance { lamps: vec![(lamp.0, 0.0)], ..comes.clone() };
        is_about(factors([0.32, 0.72, 0.48], 0.8, &hidden, &[]).unwrap(), [1.0, 1.8, 1.0]);
        let half = WhiteRadiance { lamps: vec![(lamp.0, 0.5)], ..comes.clone() };
        assert!(matches!(factors([0.72; 3], 0.8, &half, &[]), Err(WhiteReferenceError::HalfShadow { lamp: 1, .. })));
        // A lamp of little light may be partly visible.
        let weak = WhiteRadiance { lamps: vec![lamp, (Vec3::splat(0.02), 0.5)], ..comes };
        assert!(factors([0.72; 3], 0.8, &weak, &[]).is_ok());
        let dark = WhiteRadiance { far: Vec3::ZERO, lamps: Vec::new() };
        assert!(matches!(factors([0.72; 3], 0.8, &dark, &[]), Err(WhiteReferenceError::Unlit)));
    }

    #[test]
    fn implausible_and_coloured_factors_are_refused() {
        let comes = WhiteRadiance { far: Vec3::ONE, lamps: Vec::new() };
        for shown in [0.8 * 0.12, 0.8 * 8.1] {
            assert!(
                matches!(factors([shown; 3], 0.8, &comes, &[]), Err(WhiteReferenceError::Implausible { .. })),
                "{shown}"
            );
        }
        assert!(
            factors([0.8 * 0.13; 3], 0.8, &comes, &[]).is_ok() && factors([0.8 * 7.9; 3], 0.8, &comes, &[]).is_ok()
        );
        let red = factors([0.9, 0.28, 0.6], 0.8, &comes, &[]);
        assert!(
            matches!(red, Err(WhiteReferenceError::Coloured { ratio }) if (ratio - 0.9 / 0.28).abs() < 1e-9),
            "{red:?}"
        );
    }

    #[test]
    fn patch_light_is_divided_by_the_frames_gain() {
        // Factor 2 in red, and one stop more everywhere by the spatial gain: 102 of 255 is 0.4.
        let spatial_gain = SpatialGain([1.0; NODES]);
        let brightness = RelativeBrightness { factors: [2.0, 1.0, 0.5], median_s: None, spatial_gain };
        let even = |_, _| [102u8; 3];
        let light = median_light(&frame(even, Some(brightness)), &VIEW, &linear()).unwrap();
        assert!(light.iter().zip([0.1, 0.2, 0.4]).all(|(a, b)| (a - b).abs() < 1e-6), "{light:?}");
        // Without a gain. A single different pixel does not change the median; pixels farther than
        // 2 px do not count.
        let speck = |x: u32, y: u32| if (x, y) == (321, 240) { [60; 3] } else { [102; 3] };
        assert_eq!(median_light(&frame(speck, None), &VIEW, &linear()).unwrap(), [0.4; 3]);
        let code = |x: u32, _| if x > 322 { [20; 3] } else { [102; 3] };
        assert_eq!(median_light(&frame(code, None), &VIEW, &linear()).unwrap(), [0.4; 3]);
    }

    #[test]
    fn clipped_uneven_and_black_patches_are_refused() {
        let light_of = |code: &dyn Fn(u32, u32) -> [u8; 3]| median_light(&frame(code, None), &VIEW, &linear());
        // Three pixels of 25 are 12 %.
        let clipped = |x: u32, y: u32| if y == 240 && (320..323).contains(&x) { [200, 251, 200] } else { [200; 3] };
        assert!(
            matches!(light_of(&clipped), Err(WhiteReferenceError::Clipped { percent }) if (percent - 12.0).abs() < 1e-9)
        );
        let edge = |x: u32, _| if x > 320 { [40; 3] } else { [102; 3] };
        assert!(matches!(light_of(&edge), Err(WhiteReferenceError::Uneven { .. })));
        assert!(matches!(light_of(&|_, _| [2; 3]), Err(WhiteReferenceError::Dark { .. })));
    }

    #[test]
    fn depth_edge_is_detected_within_the_radius() {
        let with = |depth: &dyn Fn(u32) -> f32| {
            let depth_m = (0..480).flat_map(|_| (0..640).map(depth)).collect();
            let depth = DepthMap { width: 640, height: 480, depth_m, timestamp_s: 0.0 };
            Frame { depth: Some(depth.into()), ..frame(|_, _| [102; 3], None) }
        };
        assert!(crosses_an_edge(&with(&|x| if x > 323 { 2.3 } else { 2.0 }), &VIEW, 2.0));
        assert!(!crosses_an_edge(&with(&|x| if x > 330 { 2.3 } else { 2.0 }), &VIEW, 2.0));
        // Gaps are ignored.
        assert!(!crosses_an_edge(&with(&|x| if x % 2 == 0 { 0.0 } else { 2.04 }), &VIEW, 2.0));
    }
}
