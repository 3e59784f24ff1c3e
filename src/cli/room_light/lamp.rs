//! Lamps at which a person points: where each is.

use anyhow::{Context, Result, anyhow, bail};
use glam::{DVec2, DVec3, Vec3};

use crate::cli::pick::{numbers, of_view, view};
use locard_engine::analyse::{self, Analysis, Environment, LightFindings, MAX_LAMPS};
use locard_engine::parallel::processors;
use locard_engine::shadow::WhiteRadiance;
use locard_engine::shot::{FramePoint, Shot, SurfaceError};
use locard_engine::text::number;

/// How far away a lamp may be, m.
const NEAREST_M: f64 = 0.1;
const FARTHEST_M: f64 = 50.0;
/// A lamp that brings less than this share of the light hardly shines.
const HARDLY: f32 = 0.03;
const AS_IN: &str = "FRAME:X,Y, and where depth says nothing how far away it is in metres, as in 30:320,12,2.4, or where another frame \
                     shows it, as in 30:320,12+45:310,20";

/// A lamp in a frame's picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Pointed {
    view: FramePoint,
    /// From the camera, m.
    far_m: Option<f64>,
    also: Vec<FramePoint>,
}

impl Pointed {
    /// From `FRAME:X,Y`, `FRAME:X,Y,M` or `FRAME:X,Y+FRAME:X,Y` with as many more as show it.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut parts = text.split('+');
        let first = parts.next().unwrap_or_default();
        let also = parts.map(|part| view(part, AS_IN)).collect::<Result<Vec<_>, _>>()?;
        let (frame, at) = first.split_once(':').ok_or_else(|| format!("{text}: expected {AS_IN}"))?;
        let Ok([x, y, far_m]) = numbers::<3>(at) else {
            return Ok(Self { view: view(first, AS_IN)?, far_m: None, also });
        };
        let frame = frame.trim().parse().map_err(|_| format!("{text}: expected {AS_IN}"))?;
        if !also.is_empty() {
            return Err(format!("{text}: a distance, or where other frames show it; not both"));
        }
        if !(NEAREST_M..=FARTHEST_M).contains(&far_m) {
            return Err(format!("{text}: accepted is a distance of {NEAREST_M} to {FARTHEST_M} metres"));
        }
        Ok(Self { view: FramePoint { frame, at_px: DVec2::new(x, y) }, far_m: Some(far_m), also })
    }

    /// Where it is, world axes, m.
    pub fn place(&self, shot: &Shot) -> Result<DVec3> {
        self.place_in(shot).with_context(|| format!("--lamp {self}"))
    }

    fn place_in(&self, shot: &Shot) -> Result<DVec3> {
        let FramePoint { frame, at_px } = self.view;
        if !self.also.is_empty() {
            let views: Vec<FramePoint> = std::iter::once(self.view).chain(self.also.iter().copied()).collect();
            return Ok(shot.triangulate(&views)?.point_m);
        }
        let picture = shot.read(frame)?;
        let (width, height) = (picture.pixels.width, picture.pixels.height);
        if !(at_px.cmpge(DVec2::ZERO).all() && at_px.cmplt(DVec2::new(width.into(), height.into())).all()) {
            return Err(SurfaceError::Outside { at_px: at_px.to_array(), width, height }.into());
        }
        if let Some(far_m) = self.far_m {
            let ray = shot.posed_camera(frame)?.ray(at_px).ok_or(SurfaceError::NoRay { at_px: at_px.to_array() })?;
            return Ok(ray.at(far_m));
        }
        match shot.surface_at(&picture, at_px) {
            Ok(surface) => Ok(surface.point_m),
            Err(SurfaceError::NoDepth { .. } | SurfaceError::NotMeasured { .. }) => {
                let at = of_view(&self.view);
                bail!(
                    "no depth was measured there: say how far it is from the camera in metres, as in --lamp {at},2.4, or where \
                     another frame shows it, as in --lamp {at}+45:310,20"
                )
            }
            Err(other) => Err(other.into()),
        }
    }
}

/// The light of the room with lamps that a person has seen; `None` where there are none. They come first among its lamps.
pub fn lit_anew(shot: &Shot, found: &Analysis, lamps: &[Pointed]) -> Result<Option<(LightFindings, Environment)>> {
    if lamps.is_empty() {
        return Ok(None);
    }
    if lamps.len() > MAX_LAMPS {
        bail!("--lamp is given {} times: accepted is up to {MAX_LAMPS}", lamps.len());
    }
    let places = lamps.iter().map(|lamp| lamp.place(shot)).collect::<Result<Vec<_>>>()?;
    let lit = analyse::relight(&shot.recording, &shot.camera().response, found, &places, processors())?;
    lit.map(Some).map_err(|why| anyhow!("--lamp: the footage does not tell how bright it is: {why}"))
}

/// Lines about lamps that bring hardly any light to the middle of what was looked at, `by` which white matt is lit there. They come first
/// among its lamps.
pub fn odd(lamps: &[Pointed], by: &WhiteRadiance) -> Vec<(&'static str, String)> {
    let whole = by.light().element_sum();
    let is_dark = |(_, (light, _)): &(&Pointed, &(Vec3, f32))| light.element_sum() < HARDLY * whole;
    let dark = lamps.iter().zip(&by.lamps).filter(is_dark);
    dark.map(|(lamp, _)| ("odd", format!("--lamp {lamp}: surfaces hardly show its light: is it there, and on?")))
        .collect()
}

impl std::fmt::Display for Pointed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", of_view(&self.view))?;
        self.far_m.iter().try_for_each(|far_m| write!(f, ",{}", number(*far_m)))?;
        self.also.iter().try_for_each(|view| write!(f, "+{}", of_view(view)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lamp_that_brings_hardly_any_light_is_told() {
        let lamps = ["1:2,3", "4:5,6"].map(|text| Pointed::parse(text).unwrap());
        let by =
            WhiteRadiance { far: Vec3::splat(0.5), lamps: vec![(Vec3::splat(0.4), 1.0), (Vec3::splat(0.02), 1.0)] };
        let told = odd(&lamps, &by);
        assert!(told.len() == 1 && told[0].1.contains("4:5,6"), "{told:?}");
    }

    #[test]
    fn lamps_are_read_as_they_are_written() {
        for text in ["30:320,12", "30:320,12.5,2.4", "30:320,12+45:310,20+50:1,2"] {
            assert_eq!(Pointed::parse(text).unwrap().to_string(), text);
        }
        assert_eq!(Pointed::parse("3:1,2,2.5").unwrap().far_m, Some(2.5));
        for wrong in ["", "320,12", "3:1", "3:1,2,0", "3:1,2,99", "3:1,2,3,4", "x:1,2,3", "3:1,2,2+4:5,6", "3:1,2+5,6"]
        {
            assert!(Pointed::parse(wrong).is_err(), "{wrong}");
        }
    }
}
