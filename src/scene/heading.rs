//! Heading of an object: its rotation about the world's up.
//!
//! A model's front is its +z (glTF). A model lying on its back is viewed like a page on a table:
//! its front is the foot of the page, −y.

use glam::{DQuat, DVec3};

use super::document::{Entry, SceneFile};
use super::place::shortest_rotation;

/// Heading of an object being placed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Heading {
    /// Relative to the model's default, degrees, counter-clockwise seen from above.
    Deg(f64),
    /// Relative to facing the horizontal part of a world direction; 0 degrees faces it.
    Towards { direction: DVec3, turned_deg: f64 },
}

/// Decimal factor for rounding computed headings, degrees.
const DEGREE_ROUNDING: f64 = 10.0;
/// Minimum length of the horizontal part of a unit direction that has a heading.
const MIN_HORIZONTAL_LENGTH: f64 = 0.05;

impl Heading {
    /// Value for the scene file.
    pub(super) fn degrees(self, model_up: DVec3, world_up: DVec3) -> f64 {
        match self {
            Self::Deg(degrees) => degrees,
            Self::Towards { direction, turned_deg } => {
                let unturned = shortest_rotation(model_up, world_up) * model_front(model_up);
                let angle_deg = horizontal_angle_deg(unturned, direction, world_up).unwrap_or(0.0);
                (wrapped_degrees(angle_deg + turned_deg) * DEGREE_ROUNDING).round() / DEGREE_ROUNDING
            }
        }
    }
}

impl SceneFile {
    /// Rotation of an object about the world's up, by heading and rotation combined, in (−180°,
    /// 180°]. `None` if there is no such entry.
    pub fn heading_deg(&self, entry: Entry, world_up: DVec3) -> Option<f64> {
        let placement = self.placement(entry)?;
        let model_up = match self.objects[entry.object].up {
            Some(up) => up.axis(std::path::Path::new(""), "up").ok()?,
            None => DVec3::Y,
        };
        let unturned = shortest_rotation(model_up, world_up);
        let rotated =
            DQuat::from_axis_angle(world_up, placement.heading_deg.to_radians()) * placement.rotation * unturned;
        // If the front is vertical, the side axis, which is then horizontal, is used.
        [model_front(model_up), DVec3::X, model_up]
            .into_iter()
            .find_map(|side| horizontal_angle_deg(unturned * side, rotated * side, world_up))
            .map(wrapped_degrees)
    }
}

/// Front in the model's axes.
fn model_front(model_up: DVec3) -> DVec3 {
    if model_up.z.abs() > 0.7 { DVec3::NEG_Y } else { DVec3::Z }
}

/// Angle about `up` between the horizontal parts of two directions, degrees. `None` if one has
/// none.
fn horizontal_angle_deg(from: DVec3, to: DVec3, up: DVec3) -> Option<f64> {
    let level = |v: DVec3| {
        Some(v.normalize_or_zero().reject_from_normalized(up)).filter(|v| v.length() > MIN_HORIZONTAL_LENGTH)
    };
    let (from, to) = (level(from)?, level(to)?);
    Some(up.dot(from.cross(to)).atan2(from.dot(to)).to_degrees())
}

/// Wrapped to (−180°, 180°].
pub(super) fn wrapped_degrees(degrees: f64) -> f64 {
    180.0 - (180.0 - degrees).rem_euclid(360.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn front_faces_the_viewer() {
        // Y up to z up: the front turns to −y.
        let facing =
            |direction: DVec3, turned_deg| Heading::Towards { direction, turned_deg }.degrees(DVec3::Y, DVec3::Z);
        assert_eq!(facing(DVec3::new(0.0, -3.0, 2.0), 0.0), 0.0);
        assert_eq!(facing(DVec3::new(1.0, 0.0, 9.0), 0.0), 90.0);
        assert_eq!(facing(DVec3::new(0.0, 1.0, 0.5), 0.0), 180.0);
        assert_eq!(facing(DVec3::new(-1.0, -1.0, 0.5), 30.0), -15.0);
        // On its back its foot faces −y: −y stays −y.
        let page = Heading::Towards { direction: DVec3::new(1.0, 0.0, 1.0), turned_deg: 0.0 };
        assert_eq!(page.degrees(DVec3::Z, DVec3::Z), 90.0);
        // Seen from directly above there is no heading.
        assert_eq!(facing(DVec3::Z, 0.0), 0.0);
        assert_eq!(Heading::Deg(270.0).degrees(DVec3::Y, DVec3::Z), 270.0);
    }

    #[test]
    fn heading_combines_rotation_and_heading() {
        let text = "version = 1\n[[objects]]\nmodel = \"a.glb\"\nheading_deg = 10\n\
                    [[objects.instances]]\nrotation_deg = [0, 0, 35]\n\
                    [[objects.instances]]\nrotation_deg = [90, 0, 35]\n\
                    [[objects.instances]]\nquaternion = [0, 0, 0.70710678, 0.70710678]\nheading_deg = 100\n\
                    [[objects]]\nmodel = \"b.glb\"\nup = \"z\"\nrotation_deg = [12, 0, -170]\nheading_deg = -20\n\
                    [[objects]]\nmodel = \"c.glb\"\n";
        let file = super::super::Document::parse(text).unwrap().value().clone();
        let heading_deg = |object, instance| file.heading_deg(Entry { object, instance }, DVec3::Z);
        let headings = [
            heading_deg(0, Some(0)),
            heading_deg(0, Some(1)),
            heading_deg(0, Some(2)),
            heading_deg(1, None),
            heading_deg(2, None),
        ];
        for (actual, expected) in headings.into_iter().zip([45.0, 45.0, -170.0, 170.0, 0.0]) {
            assert!((actual.unwrap() - expected).abs() < 1e-5, "{headings:?}");
        }
        assert_eq!(heading_deg(7, None), None);
    }
}
