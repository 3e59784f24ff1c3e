//! A matt surface of known reflectance that a person points at, and the factors that it implies for
//! the estimated light.
//!
//! Reflectance and light share a factor that a recording does not tell ([`crate::analyse`]). White
//! paper and paint reflect about ρ = 0.8. Where the surface shows the light B, and white would show
//! W by the estimated light ([`on_white`]), that light is to be multiplied
//! by B / (ρ·W), channel by channel.
//!
//! B is the median of a patch of a few pixels, through the camera's response, with what the frame is brighter than usual taken out.
//! Refused is what cannot tell: clipped pixels, which are a lower bound alone; an edge, in the picture or in depth; what is nearly
//! black; half a lamp's shadow. Not modelled: things that shine or glow.

use glam::{DVec3, Vec3};

use super::{Shot, SurfaceError, View};
use crate::camera::Response;
use crate::frame::Frame;
use crate::scene::{Lighting, PointLight, Support};
use crate::shadow::{OnWhite, on_white};

/// The patch reaches so far around the place, px of 640 across.
const REACH_PX: f64 = 2.0;
/// From this share of the largest code on a colour is clipped; patches with more than this share of such pixels are refused.
const CLIPPED: f64 = 250.0 / 255.0;
const MOST_CLIPPED: f64 = 0.1;
/// From the patch's tenth to its ninetieth percentile light differs by less than this share of its median: more is an edge or a
/// pattern, not noise.
const UNEVEN: f64 = 0.4;
/// Depth around the patch, px of 640 across, lies within this share of the surface's, wherever it was measured.
const DEPTH_PX: f64 = 4.0;
const NEAR: f64 = 0.05;
/// Darker things are the sensor's noise.
const DARKEST: f64 = 0.01;
/// Factors on all light that are accepted, and the largest ratio between those of two channels:
/// beyond them the surface is not what the person takes it for.
pub const FACTORS: [f64; 2] = [0.125, 8.0];
const MOST_TINT: f64 = 3.0;
/// A lamp of which some is seen counts as half a shadow where it brings at least this share of the light.
const MATTERS: f32 = 0.05;
/// Lamps wider than this have penumbrae that are as even as the light of an open sky, m.
const SMOOTH_PENUMBRA_M: f64 = 1.0;

/// A place in a frame's picture where a neutral matt surface of known reflectance is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReferencePick {
    pub view: View,
    pub reflectance: f64,
}

/// A neutral reference surface and what it implies for the estimated light.
#[derive(Clone, Debug, PartialEq)]
pub struct White {
    /// By which the light is to be multiplied: red, green, blue.
    pub factors: [f64; 3],
    /// In the world, metres, and what is across the surface there.
    pub point_m: DVec3,
    pub normal: DVec3,
    /// What it shows, linear, as the frame of usual brightness would: red, green, blue.
    pub shown: [f64; 3],
    /// What white matt would show there by the light that was found.
    pub comes: OnWhite,
}

/// Why a place tells nothing.
#[derive(Debug, thiserror::Error)]
pub enum WhiteError {
    #[error(
        "it is clipped there ({percent:.0} % of the pixels around): how bright it is has no upper bound; point at a part of \
         it that is darker, or take a frame that is"
    )]
    Clipped { percent: f64 },
    #[error(
        "there is an edge or a pattern: light differs by {percent:.0} % within a few pixels; point at an even part of it"
    )]
    Uneven { percent: f64 },
    #[error("the edge of a thing is within a few pixels, by its depth; point at the middle of it")]
    Edge,
    #[error(
        "it is nearly black there ({shown:.4} of the camera's white): that is nothing white, or no light falls on it"
    )]
    Dark { shown: f64 },
    #[error(
        "depth says nothing around it, so that which way it faces is not known; point at another part of it, or take another frame"
    )]
    NoDepth,
    #[error(
        "it lies at the edge of a lamp's shadow ({percent:.0} % of lamp {lamp} is seen from there); point at a part in the light"
    )]
    HalfShadow { lamp: usize, percent: f64 },
    #[error("no light falls on it, by what was found")]
    Unlit,
    #[error(
        "all light would become {factor:.3} times as bright; accepted is {} to {}: it does not reflect {reflectance}, or it \
         shines",
        FACTORS[0], FACTORS[1]
    )]
    Implausible { factor: f64, reflectance: f64 },
    #[error(
        "by it one colour of the light would change {ratio:.1} times as much as another, and at most {MOST_TINT} times is \
         accepted: it is coloured"
    )]
    Coloured { ratio: f64 },
    #[error(transparent)]
    Surface(#[from] SurfaceError),
}

impl Shot {
    /// The factors that each reference surface implies for a light of the room. The first that
    /// implies none is the error, with its number.
    pub fn white_at(&self, picks: &[ReferencePick], lighting: &Lighting) -> Result<Vec<White>, (usize, WhiteError)> {
        if picks.is_empty() {
            return Ok(Vec::new());
        }
        let room = self.solids();
        let of = |ReferencePick { view, reflectance }: &ReferencePick| {
            let frame = self.read(view.frame).map_err(|error| SurfaceError::from(Box::new(error)))?;
            let surface = self.surface_at(&frame, view.at_px).map_err(|error| match error {
                SurfaceError::NoDepth { .. } | SurfaceError::NotMeasured { .. } => WhiteError::NoDepth,
                other => other.into(),
            })?;
            let shown = shown(&frame, view, &self.camera().response)?;
            if crosses_an_edge(&frame, view, surface.depth_m) {
                return Err(WhiteError::Edge);
            }
            let support = Support { point_m: surface.point_m, normal: surface.normal_in_world };
            let comes = on_white(lighting, &room, &support);
            let factors = factors(shown, *reflectance, &comes, &lighting.points)?;
            Ok(White { factors, point_m: support.point_m, normal: support.normal, shown, comes })
        };
        picks.iter().enumerate().map(|(n, pick)| of(pick).map_err(|error| (n, error))).collect()
    }
}

/// B / (ρ·W) of each channel.
fn factors(shown: [f64; 3], reflectance: f64, comes: &OnWhite, lamps: &[PointLight]) -> Result<[f64; 3], WhiteError> {
    let light = comes.light();
    for (n, (by, seen)) in comes.lamps.iter().enumerate() {
        let is_wide = lamps.get(n).is_some_and(|lamp| f64::from(lamp.diameter_m) > SMOOTH_PENUMBRA_M);
        let matters = !is_wide && mean(*by) > MATTERS * mean(light + *by);
        if matters && *seen > 0.0 && *seen < 1.0 {
            return Err(WhiteError::HalfShadow { lamp: n + 1, percent: 100.0 * f64::from(*seen) });
        }
    }
    if light.min_element() <= 0.0 {
        return Err(WhiteError::Unlit);
    }
    let factor = shown.iter().sum::<f64>() / 3.0 / (reflectance * f64::from(mean(light)));
    if !(FACTORS[0]..=FACTORS[1]).contains(&factor) {
        return Err(WhiteError::Implausible { factor, reflectance });
    }
    let factors = [0, 1, 2].map(|c| shown[c] / (reflectance * f64::from(light[c])));
    let ends = factors.iter().fold((f64::INFINITY, 0.0), |(low, high): (f64, f64), f| (low.min(*f), high.max(*f)));
    let ratio = ends.1 / ends.0;
    if ratio > MOST_TINT { Err(WhiteError::Coloured { ratio }) } else { Ok(factors) }
}

fn mean(light: Vec3) -> f32 {
    light.element_sum() / 3.0
}

/// How far around a place is looked, px.
fn reach(of_640_px: f64, width: u32) -> u32 {
    (of_640_px * f64::from(width) / 640.0).round().max(1.0) as u32
}

/// The columns and rows around a place of a picture.
fn around(view: &View, reach: u32, width: u32, height: u32) -> impl Iterator<Item = (u32, u32)> {
    let span = |at: f64, size: u32| {
        let middle = (at.max(0.0) as u32).min(size.saturating_sub(1));
        middle.saturating_sub(reach)..(middle + reach + 1).min(size)
    };
    let columns = span(view.at_px.x, width);
    span(view.at_px.y, height).flat_map(move |y| columns.clone().map(move |x| (x, y)))
}

/// The median of the light around a place, as the frame of usual brightness would show it.
fn shown(frame: &Frame, view: &View, response: &Response) -> Result<[f64; 3], WhiteError> {
    let pixels = &frame.pixels;
    let (width, height, most) = (pixels.width, pixels.height, pixels.max_code());
    let codes: Vec<[u32; 3]> =
        around(view, reach(REACH_PX, width), width, height).map(|(x, y)| pixels.at(x, y)).collect();
    let is_clipped = |codes: &&[u32; 3]| codes.iter().any(|code| f64::from(*code) >= CLIPPED * f64::from(most));
    let clipped = codes.iter().filter(is_clipped).count() as f64 / codes.len() as f64;
    if clipped > MOST_CLIPPED {
        return Err(WhiteError::Clipped { percent: 100.0 * clipped });
    }
    let sorted = |of: &dyn Fn([f64; 3]) -> f64| {
        let light = |codes: &[u32; 3]| codes.map(|code| response.decode(f64::from(code) / f64::from(most)));
        let mut values: Vec<f64> = codes.iter().map(|codes| of(light(codes))).collect();
        values.sort_by(f64::total_cmp);
        move |share: f64| values[((values.len() - 1) as f64 * share).round() as usize]
    };
    let all = sorted(&|light| light.iter().sum::<f64>() / 3.0);
    let (middle, differs) = (all(0.5), all(0.9) - all(0.1));
    // What the frame's own gain makes of the usual one.
    let gain = gain(frame, view);
    let usual = middle / (gain.iter().sum::<f64>() / 3.0);
    if usual < DARKEST || middle < DARKEST {
        return Err(WhiteError::Dark { shown: usual });
    }
    if differs > UNEVEN * middle {
        return Err(WhiteError::Uneven { percent: 100.0 * differs / middle });
    }
    Ok([0, 1, 2].map(|c| sorted(&|light| light[c])(0.5) / gain[c]))
}

/// How much brighter a place of a frame is shown than usual: factors on light.
fn gain(frame: &Frame, view: &View) -> [f64; 3] {
    let Some(seen) = frame.exposure.seen else { return [1.0; 3] };
    let share = |at: f64, size: u32| (at / f64::from(size.max(1))) as f32;
    let at = [share(view.at_px.x, frame.pixels.width), share(view.at_px.y, frame.pixels.height)];
    let here = f64::from(seen.across.at(at)).exp2();
    seen.factors.map(|factor| factor * here)
}

/// Whether something nearer or farther than the surface is around a place.
fn crosses_an_edge(frame: &Frame, view: &View, far_m: f64) -> bool {
    let Some(depth) = &frame.depth else { return false };
    let mut places = around(view, reach(DEPTH_PX, depth.width), depth.width, depth.height);
    places.any(|(x, y)| {
        let z = f64::from(depth.depth_m[(y * depth.width + x) as usize]);
        z > 0.0 && (z / far_m - 1.0).abs() > NEAR
    })
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;
    use crate::camera::Curve;
    use crate::frame::{Across, FrameExposure, NODES, SeenBrightness};
    use crate::pixels::{DepthMap, Pixels};

    const VIEW: View = View { frame: 0, at_px: DVec2::new(320.5, 240.5) };

    fn frame(code: impl Fn(u32, u32) -> [u8; 3], seen: Option<SeenBrightness>) -> Frame {
        let places = (0..480).flat_map(|y| (0..640).map(move |x| (x, y)));
        let pixels = Pixels::from_u8(640, 480, places.flat_map(|(x, y)| code(x, y)).collect()).unwrap();
        let exposure = FrameExposure { seen, ..FrameExposure::default() };
        Frame {
            index: 0,
            timestamp_s: 0.0,
            pixels,
            depth: None,
            exposure,
            presence: 1.0,
            beside: Vec::new(),
            surfels: Default::default(),
        }
    }

    fn linear() -> Response {
        Response { curve: Curve::Linear, ..Response::default() }
    }

    #[test]
    fn factors_are_the_light_shown_by_the_light_expected_of_the_reflectance() {
        // Of white 0.5 by the sky and 0.25 by a lamp: 0.8 · 0.75 = 0.6. It shows 0.72: a factor of 1.2.
        let lamp = (Vec3::splat(0.25), 1.0);
        let comes = OnWhite { far: Vec3::new(0.4, 0.5, 0.6), lamps: vec![lamp] };
        let is_about = |found: [f64; 3], expected: [f64; 3]| {
            assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?} {expected:?}");
        };
        is_about(factors([0.78, 0.72, 0.51], 0.8, &comes, &[]).unwrap(), [1.5, 1.2, 0.75]);
        // A grey card of 0.3.
        is_about(factors([0.195, 0.225, 0.255], 0.3, &comes, &[]).unwrap(), [1.0; 3]);
        // Behind something it has the sky's alone.
        let hidden = OnWhite { lamps: vec![(lamp.0, 0.0)], ..comes.clone() };
        is_about(factors([0.32, 0.72, 0.48], 0.8, &hidden, &[]).unwrap(), [1.0, 1.8, 1.0]);
        let half = OnWhite { lamps: vec![(lamp.0, 0.5)], ..comes.clone() };
        assert!(matches!(factors([0.72; 3], 0.8, &half, &[]), Err(WhiteError::HalfShadow { lamp: 1, .. })));
        // A lamp that hardly counts may be half seen.
        let weak = OnWhite { lamps: vec![lamp, (Vec3::splat(0.02), 0.5)], ..comes };
        assert!(factors([0.72; 3], 0.8, &weak, &[]).is_ok());
        let dark = OnWhite { far: Vec3::ZERO, lamps: Vec::new() };
        assert!(matches!(factors([0.72; 3], 0.8, &dark, &[]), Err(WhiteError::Unlit)));
    }

    #[test]
    fn factors_that_no_white_implies_are_refused() {
        let comes = OnWhite { far: Vec3::ONE, lamps: Vec::new() };
        for shown in [0.8 * 0.12, 0.8 * 8.1] {
            assert!(matches!(factors([shown; 3], 0.8, &comes, &[]), Err(WhiteError::Implausible { .. })), "{shown}");
        }
        assert!(
            factors([0.8 * 0.13; 3], 0.8, &comes, &[]).is_ok() && factors([0.8 * 7.9; 3], 0.8, &comes, &[]).is_ok()
        );
        let red = factors([0.9, 0.28, 0.6], 0.8, &comes, &[]);
        assert!(matches!(red, Err(WhiteError::Coloured { ratio }) if (ratio - 0.9 / 0.28).abs() < 1e-9), "{red:?}");
    }

    #[test]
    fn the_frames_own_gain_is_taken_out_of_what_a_patch_shows() {
        // Twice as bright in red, and everywhere a stop brighter by its part of the picture: 102 of 255 is 0.4.
        let across = Across([1.0; NODES]);
        let seen = SeenBrightness { factors: [2.0, 1.0, 0.5], usual_s: None, across };
        let even = |_, _| [102u8; 3];
        let found = shown(&frame(even, Some(seen)), &VIEW, &linear()).unwrap();
        assert!(found.iter().zip([0.1, 0.2, 0.4]).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?}");
        // Alone, as it is: a pixel that differs is nothing to the median, and none counts that is farther than 2 px.
        let speck = |x: u32, y: u32| if (x, y) == (321, 240) { [60; 3] } else { [102; 3] };
        assert_eq!(shown(&frame(speck, None), &VIEW, &linear()).unwrap(), [0.4; 3]);
        let beside = |x: u32, _| if x > 322 { [20; 3] } else { [102; 3] };
        assert_eq!(shown(&frame(beside, None), &VIEW, &linear()).unwrap(), [0.4; 3]);
    }

    #[test]
    fn what_is_clipped_uneven_or_black_tells_nothing() {
        let of = |code: &dyn Fn(u32, u32) -> [u8; 3]| shown(&frame(code, None), &VIEW, &linear());
        // Three pixels of 25 are 12 %.
        let clipped = |x: u32, y: u32| if y == 240 && (320..323).contains(&x) { [200, 251, 200] } else { [200; 3] };
        assert!(matches!(of(&clipped), Err(WhiteError::Clipped { percent }) if (percent - 12.0).abs() < 1e-9));
        let edge = |x: u32, _| if x > 320 { [40; 3] } else { [102; 3] };
        assert!(matches!(of(&edge), Err(WhiteError::Uneven { .. })));
        assert!(matches!(of(&|_, _| [2; 3]), Err(WhiteError::Dark { .. })));
    }

    #[test]
    fn an_edge_in_depth_is_told_where_it_is_near() {
        let with = |depth: &dyn Fn(u32) -> f32| {
            let depth_m = (0..480).flat_map(|_| (0..640).map(depth)).collect();
            let depth = DepthMap { width: 640, height: 480, depth_m, timestamp_s: 0.0 };
            Frame { depth: Some(depth), ..frame(|_, _| [102; 3], None) }
        };
        assert!(crosses_an_edge(&with(&|x| if x > 323 { 2.3 } else { 2.0 }), &VIEW, 2.0));
        assert!(!crosses_an_edge(&with(&|x| if x > 330 { 2.3 } else { 2.0 }), &VIEW, 2.0));
        // Gaps say nothing.
        assert!(!crosses_an_edge(&with(&|x| if x % 2 == 0 { 0.0 } else { 2.04 }), &VIEW, 2.0));
    }
}
