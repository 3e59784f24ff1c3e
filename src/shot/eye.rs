//! The camera of one frame for points of the world: where they are seen, and along which ray a place looks.
//!
//! As in shaders/raster.wgsl: distortion, and each row with the pose of its own moment. Not modelled: the lens's opening
//! and the exposure, which spread a point around the place that is given here.

use glam::{DVec2, DVec3};

use super::{Shot, SurfaceError};
use crate::camera::Geometry;
use crate::render::{Shutter, ViewKeys};
use crate::scene::Heading;

/// A frame's camera with the poses of its rows.
#[derive(Clone, Debug)]
pub struct Eye {
    geometry: Geometry,
    keys: ViewKeys,
}

/// The line of sight of a place in the picture, in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// The camera's position when the place was read, metres.
    pub origin_m: DVec3,
    /// Unit length.
    pub direction: DVec3,
}

impl Ray {
    pub fn at(&self, distance_m: f64) -> DVec3 {
        self.origin_m + distance_m * self.direction
    }
}

impl Shot {
    /// The camera of a frame.
    pub fn eye(&self, frame: usize) -> Result<Eye, SurfaceError> {
        let geometry = self.geometry_at(frame).map_err(Box::new)?;
        let middle = self.recording.pose_at_frame(frame)?;
        let time_s = self.recording.timestamps_s[frame] + self.recording.time_offset_s;
        let readout_time_s = geometry.intrinsics.readout_time_s;
        let shutter = Shutter { exposure_time_s: 0.0, readout_time_s, beyond_s: 0.0 };
        let at = |offset_s: f64| self.recording.track.at_or_nearest(time_s + offset_s).unwrap_or(middle);
        Ok(Eye { keys: ViewKeys::new(shutter, at), geometry })
    }
}

/// Seen more steeply than this from above, a thing faces the picture's lower edge: degrees from the vertical.
const STEEP_DEG: f64 = 10.0;

impl Shot {
    /// The heading by which something at a point of the world faces whoever looks at a frame, turned further by degrees. Where
    /// the frame has no camera it stands as it comes.
    pub fn facing(&self, frame: usize, point_m: DVec3, up: DVec3, turned_deg: f64) -> Heading {
        let direction = self.eye(frame).ok().and_then(|eye| eye.level_to_viewer(point_m, up));
        direction.map_or(Heading::Deg(turned_deg), |direction| Heading::Towards { direction, turned_deg })
    }
}

impl Eye {
    /// The level direction from a point to whoever looks, unit length; `None` where nothing tells it.
    pub fn level_to_viewer(&self, point_m: DVec3, up: DVec3) -> Option<DVec3> {
        let to_camera = (self.position_m() - point_m).normalize_or_zero();
        let level = to_camera.reject_from_normalized(up);
        if level.length() > STEEP_DEG.to_radians().sin() {
            return level.try_normalize();
        }
        let px = self.project(point_m)?;
        let (here, below) = (self.ray(px)?, self.ray(px + DVec2::Y)?);
        (below.direction - here.direction).reject_from_normalized(up).try_normalize()
    }

    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// The camera's position at the frame's time, metres.
    pub fn position_m(&self) -> DVec3 {
        self.keys.origin_in_world_m
    }

    /// The way from the camera to a point of the world in the camera's axes (x right, y down, z ahead), metres, at the frame's time:
    /// to what is behind it, too.
    pub fn way_to(&self, point_m: DVec3) -> DVec3 {
        let (rotation, position_m) = self.keys.at(0.0);
        rotation * (point_m - self.keys.origin_in_world_m - position_m)
    }

    /// Where a point of the world is seen, px from the picture's upper left; it may lie outside. `None` behind the camera,
    /// and where the lens sees nothing.
    pub fn project(&self, point_m: DVec3) -> Option<DVec2> {
        Some(self.at_and_point(point_m)?.0)
    }

    /// A point of the world in the camera's axes (metres) at the moment of the row in which it is seen.
    pub fn in_camera(&self, point_m: DVec3) -> Option<DVec3> {
        Some(self.at_and_point(point_m)?.1)
    }

    /// Both: the place, px, and the point in the camera's axes.
    fn at_and_point(&self, point_m: DVec3) -> Option<(DVec2, DVec3)> {
        let from_origin = point_m - self.keys.origin_in_world_m;
        self.geometry.seen_by_row(|time_s| {
            let (rotation, position_m) = self.keys.at(time_s);
            rotation * (from_origin - position_m)
        })
    }

    /// The ray of a place in the picture, px from its upper left. `None` where the lens sees nothing.
    pub fn ray(&self, at_px: DVec2) -> Option<Ray> {
        let readout_s = self.geometry.intrinsics.readout_time_s;
        let direction = self.geometry.direction(at_px)?;
        let (rotation, position_m) = self.keys.at(self.geometry.row_time_s(at_px.y).clamp(-readout_s, readout_s));
        let origin_m = self.keys.origin_in_world_m + position_m;
        Some(Ray { origin_m, direction: (rotation.inverse() * direction).normalize() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::OpenOptions;
    use crate::shot::Given;
    use std::path::Path;

    #[test]
    fn a_ray_is_seen_where_it_comes_from_in_the_row_of_its_own_moment() {
        let open = |sets: &[&str]| {
            let sets = sets.iter().map(ToString::to_string).collect();
            Shot::open(Path::new("recordings/demo"), &OpenOptions::default(), &Given { sets, ..Given::default() })
                .unwrap()
        };
        let shot = open(&[]);
        let eye = shot.eye(30).unwrap();
        for at in [(1.0, 2.0), (320.0, 240.0), (600.5, 470.5), (40.0, 400.0)].map(DVec2::from) {
            let ray = eye.ray(at).unwrap();
            assert!((ray.direction.length() - 1.0).abs() < 1e-12);
            for distance_m in [0.3, 1.0, 20.0] {
                let back = eye.project(ray.at(distance_m)).unwrap();
                // Four steps of a contraction by the motion within a row's share of the readout.
                assert!(back.distance(at) < 1e-3, "{at}: {back}");
            }
            assert_eq!(eye.project(ray.at(-1.0)), None);
        }
        // Rows at the rims have times of their own: a rigid picture would show them elsewhere.
        let rigid = open(&["camera.readout_time_s=0"]).eye(30).unwrap();
        let (top, middle) = (DVec2::new(320.0, 4.0), DVec2::new(320.0, 240.0));
        let moved = |at: DVec2| rigid.project(eye.ray(at).unwrap().at(1.0)).unwrap().distance(at);
        assert!(moved(top) > 0.5 && moved(middle) < 1e-6, "{} {}", moved(top), moved(middle));
    }

    #[test]
    fn the_way_to_what_is_behind_is_known_too() {
        let shot = Shot::open(Path::new("recordings/demo"), &OpenOptions::default(), &Given::default()).unwrap();
        let eye = shot.eye(30).unwrap();
        // In the middle row the time is the frame's.
        let ray = eye.ray(DVec2::new(500.0, 240.0)).unwrap();
        let [ahead, behind] = [2.0, -2.0].map(|m| eye.way_to(ray.at(m)));
        assert!((ahead.length() - 2.0).abs() < 1e-9 && ahead.abs_diff_eq(-behind, 1e-9), "{ahead} {behind}");
        assert!(ahead.z > 1.5 && ahead.x > 0.3 && eye.project(ray.at(-2.0)).is_none(), "{ahead}");
        assert!(eye.in_camera(ray.at(2.0)).unwrap().abs_diff_eq(ahead, 1e-6));
    }

    #[test]
    fn things_face_whoever_looks_and_from_right_above_the_lower_edge() {
        let shot = Shot::open(Path::new("recordings/demo"), &OpenOptions::default(), &Given::default()).unwrap();
        let eye = shot.eye(30).unwrap();
        let point = DVec3::new(0.1, -0.1, 0.0);
        let Heading::Towards { direction, turned_deg: 5.0 } = shot.facing(30, point, DVec3::Z, 5.0) else { panic!() };
        let to_camera = eye.position_m() - point;
        assert!(direction.z.abs() < 1e-12 && (direction.length() - 1.0).abs() < 1e-12);
        assert!((direction.dot(to_camera) - to_camera.truncate().length()).abs() < 1e-9);
        // "Up" is towards the camera: it is right above.
        let up = to_camera.normalize();
        let down = eye.level_to_viewer(point, up).unwrap();
        let (here, there) = (eye.project(point).unwrap(), eye.project(point + 0.01 * down).unwrap());
        let way = (there - here).normalize();
        assert!(down.dot(up).abs() < 1e-9 && way.y > 0.99, "{way}");
        assert_eq!(shot.facing(9999, point, DVec3::Z, 7.0), Heading::Deg(7.0));
    }
}
