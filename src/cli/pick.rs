//! Picked points: their world coordinates, distances and plane.

use std::cell::OnceCell;
use std::io::Write;

use anyhow::{Context, Result, bail};
use glam::{DVec2, DVec3};

use locard_engine::frame::Frame;
use locard_engine::plane::Plane;
use locard_engine::shot::{FramePoint, Shot, Surface, SurfaceError, TriangulatedPoint, metres_per_unit};
use locard_engine::support::{PlaneFit, plane_through};
use locard_engine::text::{fixed, number};

/// A position in a frame's picture, and positions of the same point in other frames.
#[derive(Clone, Debug, PartialEq)]
pub struct Pick {
    at_px: DVec2,
    also: Vec<FramePoint>,
}

impl Pick {
    /// From `X,Y`, or `X,Y+FRAME:X,Y` with any number of other frames.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut parts = text.split('+');
        let at_px = pixel(parts.next().unwrap_or_default())?.into();
        let also = |part| view(part, "FRAME:X,Y after +, as in 320,300+45:310,290");
        Ok(Self { at_px, also: parts.map(also).collect::<Result<_, String>>()? })
    }
}

/// A position in a frame, from `FRAME:X,Y`. `expected` describes the format in the error.
pub fn view(text: &str, expected: &str) -> Result<FramePoint, String> {
    let wrong = || format!("{text}: expected {expected}");
    let (frame, at) = text.split_once(':').ok_or_else(wrong)?;
    let frame = frame.trim().parse().map_err(|_| wrong())?;
    Ok(FramePoint { frame, at_px: pixel(at)?.into() })
}

/// The text that [`view`] parses.
pub fn of_view(view: &FramePoint) -> String {
    format!("{}:{}", view.frame, view.at_px.to_array().map(number).join(","))
}

impl std::fmt::Display for Pick {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.at_px.to_array().map(number).join(","))?;
        let mut also = self.also.iter();
        also.try_for_each(|view| write!(f, "+{}", of_view(view)))
    }
}

/// Column and row from the upper left, px.
fn pixel(text: &str) -> Result<[f64; 2], String> {
    numbers(text, "320,240.5")
}

/// The coefficients a, b, c and d of the plane a·x + b·y + c·z = d.
pub fn plane(text: &str) -> Result<[f64; 4], String> {
    numbers(text, "0,0,1,0.75")
}

/// Parses finite numbers separated by commas. Errors quote the example.
pub fn numbers<const N: usize>(text: &str, example: &str) -> Result<[f64; N], String> {
    let parsed: Option<Vec<f64>> =
        text.split(',').map(|t| t.trim().parse().ok().filter(|v: &f64| v.is_finite())).collect();
    let numbers = parsed.and_then(|v| v.try_into().ok());
    numbers.ok_or_else(|| format!("{text}: expected {N} numbers with commas between, as in {example}"))
}

/// The source of a picked point.
pub enum PointSource {
    Depth(Surface),
    Plane { normal: DVec3 },
    Views(TriangulatedPoint),
}

/// A point of the room in world axes, m, and its measurement.
pub struct PickedPoint {
    pub point_m: DVec3,
    pub source: PointSource,
}

impl PickedPoint {
    /// The normal of the surface, if it is known.
    pub fn normal(&self) -> Option<DVec3> {
        match &self.source {
            PointSource::Depth(surface) => Some(surface.plane.normal),
            PointSource::Plane { normal } => Some(*normal),
            PointSource::Views(_) => None,
        }
    }

    /// A support at the point. For a triangulated point it is a level surface.
    pub fn support(&self, up: DVec3) -> Plane {
        Plane { point_m: self.point_m, normal: self.normal().unwrap_or(up) }
    }
}

/// Finds the surface at a position in a frame's picture, px.
pub type SurfaceAt = fn(&Shot, &Frame, DVec2) -> Result<Surface, SurfaceError>;

/// Finds points in a frame of a recording.
pub struct Picker<'a> {
    pub shot: &'a Shot,
    pub frame: usize,
    /// Overrides depth.
    pub plane: Option<[f64; 4]>,
    surface_at: SurfaceAt,
    /// The frame, decoded for the first point. No memo: a picker has one frame.
    picture: OnceCell<Frame>,
}

impl<'a> Picker<'a> {
    /// `surface_at`: [`Shot::surface_at`] for measurements, [`Shot::placement_surface`] for placing
    /// objects.
    pub fn new(shot: &'a Shot, frame: usize, plane: Option<[f64; 4]>, surface_at: SurfaceAt) -> Result<Self> {
        super::check_frame(frame, shot.recording.frame_count())?;
        Ok(Self { shot, frame, plane, surface_at, picture: OnceCell::new() })
    }

    pub fn find(&self, pick: &Pick) -> Result<PickedPoint> {
        if !pick.also.is_empty() {
            let views: Vec<FramePoint> = std::iter::once(FramePoint { frame: self.frame, at_px: pick.at_px })
                .chain(pick.also.iter().copied())
                .collect();
            views.iter().try_for_each(|view| super::check_frame(view.frame, self.shot.recording.frame_count()))?;
            let triangulated = self.shot.triangulate(&views)?;
            return Ok(PickedPoint { point_m: triangulated.point_m, source: PointSource::Views(triangulated) });
        }
        let on = |plane| {
            let support = self.shot.support_on_plane(self.frame, pick.at_px, plane);
            let Plane { point_m, normal } = support.map_err(|error| match error {
                SurfaceError::Plane { .. } => anyhow::Error::from(error).context("--plane"),
                other => other.into(),
            })?;
            Ok(PickedPoint { point_m, source: PointSource::Plane { normal } })
        };
        if let Some(plane) = self.plane {
            return on(plane);
        }
        let picture = match self.picture.get() {
            Some(picture) => picture,
            None => {
                let picture = self.shot.read(self.frame)?;
                self.picture.get_or_init(|| picture)
            }
        };
        if let Some(floor) = self.shot.floor().filter(|_| picture.depth.is_none()) {
            return on(floor.coefficients());
        }
        let surface = (self.surface_at)(self.shot, picture, pick.at_px)?;
        Ok(PickedPoint { point_m: surface.plane.point_m, source: PointSource::Depth(surface) })
    }
}

/// A query of `inspect` about picked points.
pub struct PointQuery<'a> {
    pub picks: &'a [Pick],
    /// The true distance between two of them, m.
    pub distance_m: Option<f64>,
    /// `None` if it was not given and the recording is not in metres.
    pub metres_per_unit: Option<f64>,
}

/// Prints the points' coordinates, distances, and the plane through three or more.
pub fn print_points(picker: &Picker<'_>, query: &PointQuery<'_>, out: &mut impl Write) -> Result<()> {
    let PointQuery { picks, distance_m, .. } = *query;
    if let Some(distance_m) = distance_m {
        match picks.len() {
            2 if distance_m > 0.0 => {}
            2 => bail!("--distance {distance_m}: expected a distance above 0"),
            count => bail!("--distance is that of two points: give --pick twice ({count} given)"),
        }
    }
    let shot = picker.shot;
    let is_metric = shot.recording.kind.is_metric();
    let unit = if is_metric || query.metres_per_unit.is_some() { "m" } else { "units" };
    let mut points = Vec::new();
    for (i, pick) in picks.iter().enumerate() {
        let picked = picker.find(pick).with_context(|| format!("--pick {pick}"))?;
        let which = if picks.len() > 1 { format!(" {}", i + 1) } else { String::new() };
        write!(out, "{:<11}{} {unit}", format!("world{which}"), triple(picked.point_m))?;
        match &picked.source {
            PointSource::Depth(surface) => {
                writeln!(out, " (depth {} {unit})", fixed(surface.depth_m, 4))?;
                let n = surface.plane.normal;
                write!(out, "{:<11}normal {:.3} {:.3} {:.3}", format!("surface{which}"), n.x, n.y, n.z)?;
                if let Some(up) = shot.recording.up {
                    write!(out, ", tilted by {:.1}°", surface.plane.tilt_deg(up))?;
                }
                let on = 100.0 * surface.share;
                writeln!(out, ", uneven by {} {unit}, {on:.0} % of the surroundings", fixed(surface.sigma_m, 5))?;
            }
            PointSource::Plane { .. } => {
                let depth = shot.recording.pose_at_frame(picker.frame)?.transform_point(picked.point_m).z;
                writeln!(out, " (on the plane, depth {} {unit})", fixed(depth, 4))?;
            }
            PointSource::Views(views) => writeln!(
                out,
                " (± {} {unit}; rays at {}°, {} px off)",
                fixed(views.sigma_m, 4),
                fixed(views.angle_deg, 1),
                fixed(views.rms_px, 2)
            )?,
        }
        points.push(picked.point_m);
    }
    // Successive points, and the last side of a triangle.
    let pairs = (1..points.len()).map(|i| (i - 1, i)).chain((points.len() == 3).then_some((0, 2)));
    for (from, to) in pairs {
        let apart = points[from].distance(points[to]);
        writeln!(out, "distance   {} {unit}, {} to {}", fixed(apart, 4), from + 1, to + 1)?;
    }
    if points.len() > 2 {
        let eye = shot.recording.pose_at_frame(picker.frame)?.position_in_world_m();
        let PlaneFit { plane, rms_m, max_m } = plane_through(&points)?;
        let plane = plane.facing(shot.recording.up.unwrap_or(eye - points[0]));
        let numbers = plane.coefficients().map(|n| fixed(n, 6)).join(",");
        write!(out, "plane      --plane {numbers}")?;
        match points.len() {
            3 => writeln!(out)?,
            _ => writeln!(out, " (points off by {} {unit}, {} at most)", fixed(rms_m, 4), fixed(max_m, 4))?,
        }
    }
    if let (Some(distance_m), [a, b]) = (distance_m, points.as_slice()) {
        let measured_m = a.distance(*b);
        let now = query.metres_per_unit.unwrap_or(1.0);
        let Some(scale) = metres_per_unit(*a, *b, distance_m, now) else {
            bail!("--distance {distance_m}: the two points are one and the same");
        };
        let percent = 100.0 * (measured_m / distance_m - 1.0);
        if is_metric {
            writeln!(out, "scale      {} % off: the recording is in metres already", fixed(percent, 1))?;
        } else {
            let scale = short(scale);
            writeln!(out, "scale      --metres-per-unit {scale}, or metres_per_unit = {scale} in the scene file")?;
        }
    }
    Ok(())
}

/// A number with six significant digits.
fn short(n: f64) -> String {
    let digits = (5.0 - n.abs().log10().floor()).clamp(0.0, 17.0) as usize;
    number(fixed(n, digits).parse().unwrap_or(n))
}

pub fn triple(point: DVec3) -> String {
    point.to_array().map(|c| fixed(c, 4)).join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pick_survives_a_round_trip_through_text() {
        let pick = Pick::parse("320,300+45:310.5,290+50:1,2").unwrap();
        assert_eq!(pick.to_string(), "320,300+45:310.5,290+50:1,2");
        assert_eq!((pick.at_px, pick.also.len()), (DVec2::new(320.0, 300.0), 2));
        assert!(Pick::parse("3,4").unwrap().also.is_empty());
        for wrong in ["", "3", "3,4,5", "3,4+5,6", "3,4+x:5,6", "3,4+-1:5,6", "nan,4"] {
            assert!(Pick::parse(wrong).is_err(), "{wrong}");
        }
        assert_eq!(
            (short(0.123456789), short(12.3456789), short(4321.0)),
            ("0.123457".into(), "12.3457".into(), "4321".into())
        );
    }
}
