//! Report on the supports of a scene's objects and on the surfaces beside them that receive their
//! shadows.

use std::fmt;

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use crate::plane::Plane;
use crate::scene::Facet;
use crate::text::{fixed, shown};

/// Smaller heights over a plane are taken for 0, m.
const MIN_HEIGHT_M: f64 = 5e-5;

/// Origin of a support plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PlaneSource {
    /// Fitted to the depth around the object.
    Depth,
    /// The floor that the recording states.
    Recording,
    /// Assumed: a level plane through the object's lowest point.
    Foot,
}

/// Support plane of an object, in the scene's world.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SupportReport {
    /// Name of the object.
    pub name: String,
    pub known_by: PlaneSource,
    pub point_m: [f64; 3],
    pub normal: [f64; 3],
    /// Angle between the plane's normal and up, degrees.
    pub tilt_deg: f64,
    /// Height of the object's lowest point over the plane, m.
    pub height_m: f64,
    /// Flat pieces of real surfaces near the object that can receive its shadow.
    #[serde(rename = "receiver", default, skip_serializing_if = "Vec::is_empty")]
    pub receivers: Vec<ShadowReceiver>,
}

/// A rectangle that receives an object's shadow.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShadowReceiver {
    /// Corners, counter-clockwise as seen from the side that receives the shadow.
    pub corners_m: [[f64; 3]; 4],
    /// Towards that side, unit length.
    pub normal: [f64; 3],
    pub tilt_deg: f64,
    /// Distance from the object, m.
    pub away_m: f64,
}

impl SupportReport {
    /// Report of an object with these points.
    pub fn new(name: &str, (known_by, plane): (PlaneSource, &Plane), up: DVec3, points_m: &[DVec3]) -> Self {
        let height_m = points_m.iter().map(|at_m| plane.height_m(*at_m)).reduce(f64::min).unwrap_or_default();
        Self {
            name: name.to_owned(),
            known_by,
            point_m: plane.point_m.to_array(),
            normal: plane.normal.to_array(),
            tilt_deg: plane.tilt_deg(up),
            height_m,
            receivers: Vec::new(),
        }
    }

    /// True if the height has the same sign as a gap, so that the gap need not be reported.
    pub fn includes_gap(&self, gap_m: f64) -> bool {
        self.height_m.abs() > MIN_HEIGHT_M && (self.height_m > 0.0) == (gap_m > 0.0)
    }

    /// Adds a shadow receiver.
    pub fn add_receiver(&mut self, facet: &Facet, up: DVec3, points_m: &[DVec3]) {
        let Facet { plane: Plane { point_m, normal }, along, low_m, high_m } = *facet;
        let across = normal.cross(along);
        let at = |off_m: DVec2| point_m + off_m.x * along + off_m.y * across;
        let corners_m = [low_m, DVec2::new(high_m.x, low_m.y), high_m, DVec2::new(low_m.x, high_m.y)];
        let away_m = |from_m: &DVec3| {
            let off = *from_m - point_m;
            at(DVec2::new(along.dot(off), across.dot(off)).clamp(low_m, high_m)).distance(*from_m)
        };
        self.receivers.push(ShadowReceiver {
            corners_m: corners_m.map(|off_m| at(off_m).to_array()),
            normal: normal.to_array(),
            tilt_deg: facet.plane.tilt_deg(up),
            away_m: points_m.iter().map(away_m).reduce(f64::min).unwrap_or_default(),
        });
    }

    /// Labelled lines for display.
    pub fn lines(&self) -> Vec<(&'static str, String)> {
        let name = shown(&self.name);
        let receiver = |receiver: &ShadowReceiver| ("receiver", format!("of {name}'s shadow: {receiver}"));
        std::iter::once(("stands", format!("{name}: {self}"))).chain(self.receivers.iter().map(receiver)).collect()
    }
}

impl fmt::Display for SupportReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mm = |length_m: f64| fixed(1e3 * length_m, 1);
        match self.height_m {
            height_m if height_m > MIN_HEIGHT_M => write!(f, "{} mm over ", mm(height_m))?,
            height_m if height_m < -MIN_HEIGHT_M => write!(f, "{} mm deep in ", mm(-height_m))?,
            _ => write!(f, "on ")?,
        }
        match self.known_by {
            PlaneSource::Depth => write!(f, "a plane that depth shows")?,
            PlaneSource::Recording => write!(f, "the recording's floor")?,
            PlaneSource::Foot => return write!(f, "a level plane through its foot: no surface is known below it"),
        }
        write!(f, ", {}° from level", fixed(self.tilt_deg, 1))
    }
}

impl fmt::Display for ShadowReceiver {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [a, b, _, d] = self.corners_m.map(DVec3::from);
        let [wide, high, away] = [a.distance(b), a.distance(d), self.away_m].map(|m| fixed(m, 2));
        write!(f, "flat, {wide} × {high} m, {away} m away, {}° from level", fixed(self.tilt_deg, 0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hovering_box_beside_a_wall_is_reported_with_its_receiver() {
        // Corners of a box of 0.1 m, 20 mm over z = 0, and a wall at x = 0.25 that faces it, 0.4 m
        // wide and 0.3 m high.
        let corner = |n: u32| DVec3::new(f64::from(n & 1), f64::from(n >> 1 & 1), f64::from(n >> 2)) * 0.1;
        let points_m: Vec<DVec3> = (0..8).map(|n| corner(n) + DVec3::new(-0.05, -0.05, 0.02)).collect();
        let floor = Plane { point_m: DVec3::new(3.0, 1.0, 0.0), normal: DVec3::Z };
        let mut ground = SupportReport::new("box", (PlaneSource::Depth, &floor), DVec3::Z, &points_m);
        let plane = Plane { point_m: DVec3::new(0.25, 0.0, 0.0), normal: DVec3::NEG_X };
        let (low_m, high_m) = (DVec2::new(-0.2, -0.3), DVec2::new(0.2, 0.0));
        // The other side is −x × y = −z.
        ground.add_receiver(&Facet { plane, along: DVec3::Y, low_m, high_m }, DVec3::Z, &points_m);
        let [(_, stands), (_, receiver)] = <[_; 2]>::try_from(ground.lines()).unwrap();
        assert!(ground.includes_gap(0.03) && !ground.includes_gap(-0.02));
        assert_eq!(stands, "box: 20.0 mm over a plane that depth shows, 0.0° from level");
        assert_eq!(receiver, "of box's shadow: flat, 0.40 × 0.30 m, 0.20 m away, 90° from level");
        let [a, b, c, _] = ground.receivers[0].corners_m.map(DVec3::from);
        assert!((b - a).cross(c - a).dot(DVec3::NEG_X) > 0.0, "counter-clockwise");
        ground.height_m = -0.012;
        ground.known_by = PlaneSource::Recording;
        assert_eq!(ground.to_string(), "12.0 mm deep in the recording's floor, 0.0° from level");
    }
}
