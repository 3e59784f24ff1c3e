//! Which way a thing faces: its heading, about the world's up.
//!
//! A model's front is its +z, as glTF has it. One that lies on its back is looked at like a page on a table: then its front is
//! the page's foot, −y.

use glam::{DQuat, DVec3};

use super::document::{Entry, SceneFile};
use super::place::turn_up;

/// How a thing is turned when it is laid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Heading {
    /// From how it comes, degrees, counter-clockwise seen from above.
    Deg(f64),
    /// From facing a direction of the world, whose level part counts; 0 degrees: it faces it.
    Towards { direction: DVec3, turned_deg: f64 },
}

/// Of a heading that is found, degrees.
const DIGITS: f64 = 10.0;
/// What looks up or down more steeply than this has no heading: the sine.
const STEEP: f64 = 0.05;

impl Heading {
    /// As a scene file has it.
    pub(super) fn degrees(self, model_up: DVec3, world_up: DVec3) -> f64 {
        match self {
            Self::Deg(degrees) => degrees,
            Self::Towards { direction, turned_deg } => {
                let unturned = turn_up(model_up, world_up) * front(model_up);
                let found = turn(unturned, direction, world_up).unwrap_or(0.0);
                (within_a_turn(found + turned_deg) * DIGITS).round() / DIGITS
            }
        }
    }
}

impl SceneFile {
    /// How far a thing is turned about the world's up, by its heading and its rotation together: above −180° to 180°. `None` if
    /// there is no such entry.
    pub fn heading_deg(&self, entry: Entry, world_up: DVec3) -> Option<f64> {
        let stance = self.stance(entry)?;
        let model_up = match self.objects[entry.object].up {
            Some(up) => up.axis(std::path::Path::new(""), "up").ok()?,
            None => DVec3::Y,
        };
        let unturned = turn_up(model_up, world_up);
        let rotated = DQuat::from_axis_angle(world_up, stance.heading_deg.to_radians()) * stance.rotation * unturned;
        // What looks up or down is told by its side, which is level then.
        [front(model_up), DVec3::X, model_up]
            .into_iter()
            .find_map(|side| turn(unturned * side, rotated * side, world_up))
            .map(within_a_turn)
    }
}

/// In a model's axes.
fn front(model_up: DVec3) -> DVec3 {
    if model_up.z.abs() > 0.7 { DVec3::NEG_Y } else { DVec3::Z }
}

/// The turn about `up` that takes one direction's level part to another's, degrees. `None` where one has none.
fn turn(from: DVec3, to: DVec3, up: DVec3) -> Option<f64> {
    let level = |v: DVec3| Some(v.normalize_or_zero().reject_from_normalized(up)).filter(|v| v.length() > STEEP);
    let (from, to) = (level(from)?, level(to)?);
    Some(up.dot(from.cross(to)).atan2(from.dot(to)).to_degrees())
}

/// Above −180°, up to 180°, as people give it.
pub(super) fn within_a_turn(degrees: f64) -> f64 {
    180.0 - (180.0 - degrees).rem_euclid(360.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_front_turns_to_whoever_looks() {
        // Y up to z up: the front comes to look along −y.
        let facing =
            |direction: DVec3, turned_deg| Heading::Towards { direction, turned_deg }.degrees(DVec3::Y, DVec3::Z);
        assert_eq!(facing(DVec3::new(0.0, -3.0, 2.0), 0.0), 0.0);
        assert_eq!(facing(DVec3::new(1.0, 0.0, 9.0), 0.0), 90.0);
        assert_eq!(facing(DVec3::new(0.0, 1.0, 0.5), 0.0), 180.0);
        assert_eq!(facing(DVec3::new(-1.0, -1.0, 0.5), 30.0), -15.0);
        // On its back its foot does: −y stays −y.
        let page = Heading::Towards { direction: DVec3::new(1.0, 0.0, 1.0), turned_deg: 0.0 };
        assert_eq!(page.degrees(DVec3::Z, DVec3::Z), 90.0);
        // From right above there is none.
        assert_eq!(facing(DVec3::Z, 0.0), 0.0);
        assert_eq!(Heading::Deg(270.0).degrees(DVec3::Y, DVec3::Z), 270.0);
    }

    #[test]
    fn the_heading_is_that_of_rotation_and_heading_together() {
        let text = "version = 1\n[[objects]]\nmodel = \"a.glb\"\nheading_deg = 10\n\
                    [[objects.instances]]\nrotation_deg = [0, 0, 35]\n\
                    [[objects.instances]]\nrotation_deg = [90, 0, 35]\n\
                    [[objects.instances]]\nquaternion = [0, 0, 0.70710678, 0.70710678]\nheading_deg = 100\n\
                    [[objects]]\nmodel = \"b.glb\"\nup = \"z\"\nrotation_deg = [12, 0, -170]\nheading_deg = -20\n\
                    [[objects]]\nmodel = \"c.glb\"\n";
        let file = super::super::Document::parse(text).unwrap().value().clone();
        let of = |object, instance| file.heading_deg(Entry { object, instance }, DVec3::Z);
        let told = [of(0, Some(0)), of(0, Some(1)), of(0, Some(2)), of(1, None), of(2, None)];
        for (found, expected) in told.into_iter().zip([45.0, 45.0, -170.0, 170.0, 0.0]) {
            assert!((found.unwrap() - expected).abs() < 1e-5, "{told:?}");
        }
        assert_eq!(of(7, None), None);
    }
}
