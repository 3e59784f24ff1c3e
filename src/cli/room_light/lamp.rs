//! Lamps that the user points at: their positions.

use anyhow::{Context, Result, anyhow, bail};
use glam::{DVec2, DVec3, Vec3};

use crate::cli::pick::{numbers, of_view, view};
use locard_engine::analyse::{self, Analysis, EnvironmentFit, LightFindings, MAX_LAMPS};
use locard_engine::parallel::processors;
use locard_engine::shadow::WhiteRadiance;
use locard_engine::shot::{FramePoint, Shot, SurfaceError};
use locard_engine::text::number;

/// Range of a lamp's distance from the camera, m.
const MIN_DISTANCE_M: f64 = 0.1;
const MAX_DISTANCE_M: f64 = 50.0;
/// Smallest fraction of the light from a lamp that is lit.
const MIN_LIGHT_FRACTION: f32 = 0.03;
const EXPECTED_FORMAT: &str = "FRAME:X,Y, without depth there also its distance in metres, as in 30:320,12,2.4, or its \
                               place in another frame, as in 30:320,12+45:310,20";

/// The position of a lamp in a frame's picture.
#[derive(Clone, Debug, PartialEq)]
pub struct MarkedLamp {
    view: FramePoint,
    /// Distance from the camera, m.
    distance_m: Option<f64>,
    also: Vec<FramePoint>,
}

impl MarkedLamp {
    /// From `FRAME:X,Y`, `FRAME:X,Y,M` or `FRAME:X,Y+FRAME:X,Y` with any number of other frames.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut parts = text.split('+');
        let first = parts.next().unwrap_or_default();
        let also = parts.map(|part| view(part, EXPECTED_FORMAT)).collect::<Result<Vec<_>, _>>()?;
        let (frame, at) = first.split_once(':').ok_or_else(|| format!("{text}: expected {EXPECTED_FORMAT}"))?;
        let Ok([x, y, distance_m]) = numbers(at, "320,10,1.5") else {
            return Ok(Self { view: view(first, EXPECTED_FORMAT)?, distance_m: None, also });
        };
        let frame = frame.trim().parse().map_err(|_| format!("{text}: expected {EXPECTED_FORMAT}"))?;
        if !also.is_empty() {
            return Err(format!("{text}: give a distance or its place in other frames, not both"));
        }
        if !(MIN_DISTANCE_M..=MAX_DISTANCE_M).contains(&distance_m) {
            return Err(format!("{text}: expected a distance of {MIN_DISTANCE_M} to {MAX_DISTANCE_M} metres"));
        }
        Ok(Self { view: FramePoint { frame, at_px: DVec2::new(x, y) }, distance_m: Some(distance_m), also })
    }

    /// World position, m.
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
        if let Some(distance_m) = self.distance_m {
            let ray = shot.posed_camera(frame)?.ray(at_px).ok_or(SurfaceError::NoRay { at_px: at_px.to_array() })?;
            return Ok(ray.at(distance_m));
        }
        match shot.surface_at(&picture, at_px) {
            Ok(surface) => Ok(surface.plane.point_m),
            Err(SurfaceError::NoDepth { .. } | SurfaceError::NotMeasured { .. }) => {
                let at = of_view(&self.view);
                bail!(
                    "no depth was measured there: add its distance from the camera in metres, as in --lamp {at},2.4, \
                     or its place in another frame, as in --lamp {at}+45:310,20"
                )
            }
            Err(other) => Err(other.into()),
        }
    }
}

/// The room's light with the lamps that the user pointed at, which come first among its lamps.
/// `None` without such lamps.
pub fn relit(
    shot: &Shot,
    analysis: &Analysis,
    lamps: &[MarkedLamp],
) -> Result<Option<(LightFindings, EnvironmentFit)>> {
    if lamps.is_empty() {
        return Ok(None);
    }
    if lamps.len() > MAX_LAMPS {
        bail!("--lamp is given {} times: expected up to {MAX_LAMPS}", lamps.len());
    }
    let places = lamps.iter().map(|lamp| lamp.place(shot)).collect::<Result<Vec<_>>>()?;
    let lit = analyse::relight(&shot.recording, &shot.camera().response, analysis, &places, processors())?;
    lit.map(Some).map_err(|why| anyhow!("--lamp: its brightness cannot be estimated from the footage: {why}"))
}

/// Warnings about lamps with hardly any light at the centre of the analysed surfaces. `white` is
/// the radiance of white there, with these lamps first.
pub fn dark_lamp_warnings(lamps: &[MarkedLamp], white: &WhiteRadiance) -> Vec<(&'static str, String)> {
    let whole = white.light().element_sum();
    let is_dark = |(_, (light, _)): &(&MarkedLamp, &(Vec3, f32))| light.element_sum() < MIN_LIGHT_FRACTION * whole;
    let dark = lamps.iter().zip(&white.lamps).filter(is_dark);
    dark.map(|(lamp, _)| ("odd", format!("--lamp {lamp}: surfaces hardly show its light: is it there, and on?")))
        .collect()
}

impl std::fmt::Display for MarkedLamp {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", of_view(&self.view))?;
        self.distance_m.iter().try_for_each(|distance_m| write!(f, ",{}", number(*distance_m)))?;
        self.also.iter().try_for_each(|view| write!(f, "+{}", of_view(view)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lamp_with_hardly_any_light_is_reported() {
        let lamps = ["1:2,3", "4:5,6"].map(|text| MarkedLamp::parse(text).unwrap());
        let by =
            WhiteRadiance { far: Vec3::splat(0.5), lamps: vec![(Vec3::splat(0.4), 1.0), (Vec3::splat(0.02), 1.0)] };
        let warnings = dark_lamp_warnings(&lamps, &by);
        assert!(warnings.len() == 1 && warnings[0].1.contains("4:5,6"), "{warnings:?}");
    }

    #[test]
    fn lamp_survives_a_round_trip_through_text() {
        for text in ["30:320,12", "30:320,12.5,2.4", "30:320,12+45:310,20+50:1,2"] {
            assert_eq!(MarkedLamp::parse(text).unwrap().to_string(), text);
        }
        assert_eq!(MarkedLamp::parse("3:1,2,2.5").unwrap().distance_m, Some(2.5));
        for wrong in ["", "320,12", "3:1", "3:1,2,0", "3:1,2,99", "3:1,2,3,4", "x:1,2,3", "3:1,2,2+4:5,6", "3:1,2+5,6"]
        {
            assert!(MarkedLamp::parse(wrong).is_err(), "{wrong}");
        }
    }
}
