//! The camera of one frame with its poses: projection of points of the world, and rays of pixels.
//!
//! As in shaders/raster.wgsl: distortion, and a pose for each row (rolling shutter). Not modelled:
//! the lens's aperture and the exposure, which spread the image of a point around its projection.

use glam::{DVec2, DVec3};

use super::{Shot, SurfaceError};
use crate::camera::Geometry;
use crate::render::{Shutter, ViewKeys};
use crate::scene::Heading;

/// A frame's camera with the poses of its rows.
#[derive(Clone, Debug)]
pub struct PosedCamera {
    geometry: Geometry,
    keys: ViewKeys,
}

/// The ray of a pixel, in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewRay {
    /// The camera's position when the row was read, m.
    pub origin_m: DVec3,
    /// Unit length.
    pub direction: DVec3,
}

impl ViewRay {
    pub fn at(&self, distance_m: f64) -> DVec3 {
        self.origin_m + distance_m * self.direction
    }
}

impl Shot {
    /// The camera of a frame with its poses.
    pub fn posed_camera(&self, frame: usize) -> Result<PosedCamera, SurfaceError> {
        let geometry = self.geometry_at(frame).map_err(Box::new)?;
        let middle = self.recording.pose_at_frame(frame)?;
        let time_s = self.recording.timestamps_s[frame];
        let readout_time_s = geometry.intrinsics.readout_time_s;
        let shutter = Shutter { exposure_time_s: 0.0, readout_time_s, beyond_s: 0.0 };
        let at = |offset_s: f64| self.recording.track.at_or_nearest(time_s + offset_s).unwrap_or(middle);
        Ok(PosedCamera { keys: ViewKeys::new(shutter, at), geometry })
    }
}

/// Largest angle between the view direction and the vertical at which an object faces the picture's
/// lower edge instead of the camera, degrees.
const MAX_STEEP_DEG: f64 = 10.0;

impl Shot {
    /// The heading at which an object at a point of the world faces the camera of a frame, plus a
    /// rotation in degrees. Without a camera, the rotation alone.
    pub fn heading_to_camera(&self, frame: usize, point_m: DVec3, up: DVec3, turned_deg: f64) -> Heading {
        let direction = self.posed_camera(frame).ok().and_then(|camera| camera.horizontal_towards_camera(point_m, up));
        direction.map_or(Heading::Deg(turned_deg), |direction| Heading::Towards { direction, turned_deg })
    }
}

impl PosedCamera {
    /// The horizontal direction from a point to the camera, unit length. Right below the camera,
    /// towards the picture's lower edge. `None` if neither is defined.
    pub fn horizontal_towards_camera(&self, point_m: DVec3, up: DVec3) -> Option<DVec3> {
        let to_camera = (self.position_m() - point_m).normalize_or_zero();
        let level = to_camera.reject_from_normalized(up);
        if level.length() > MAX_STEEP_DEG.to_radians().sin() {
            return level.try_normalize();
        }
        let px = self.project(point_m)?;
        let (here, below) = (self.ray(px)?, self.ray(px + DVec2::Y)?);
        (below.direction - here.direction).reject_from_normalized(up).try_normalize()
    }

    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// The camera's position at the frame's time, m.
    pub fn position_m(&self) -> DVec3 {
        self.keys.origin_in_world_m
    }

    /// The vector from the camera to a point of the world, in the camera's axes (x right, y down, z
    /// ahead), m, at the frame's time. Also defined for points behind the camera.
    pub fn vector_to(&self, point_m: DVec3) -> DVec3 {
        let (rotation, position_m) = self.keys.at(0.0);
        rotation * (point_m - self.keys.origin_in_world_m - position_m)
    }

    /// Projects a point of the world, px from the picture's upper left; the result may lie outside
    /// the picture. `None` behind the camera, and outside the lens's field of view.
    pub fn project(&self, point_m: DVec3) -> Option<DVec2> {
        Some(self.at_and_point(point_m)?.0)
    }

    /// A point of the world in the camera's axes, m, by the pose of the row that shows it.
    pub fn in_camera(&self, point_m: DVec3) -> Option<DVec3> {
        Some(self.at_and_point(point_m)?.1)
    }

    /// The projection, px, and the point in the camera's axes, m.
    fn at_and_point(&self, point_m: DVec3) -> Option<(DVec2, DVec3)> {
        let from_origin = point_m - self.keys.origin_in_world_m;
        self.geometry.project_rolling(|time_s| {
            let (rotation, position_m) = self.keys.at(time_s);
            rotation * (from_origin - position_m)
        })
    }

    /// The ray of a position in the picture, px from its upper left. `None` outside the lens's
    /// field of view.
    pub fn ray(&self, at_px: DVec2) -> Option<ViewRay> {
        let readout_s = self.geometry.intrinsics.readout_time_s;
        let direction = self.geometry.direction(at_px)?;
        let (rotation, position_m) = self.keys.at(self.geometry.row_time_s(at_px.y).clamp(-readout_s, readout_s));
        let origin_m = self.keys.origin_in_world_m + position_m;
        Some(ViewRay { origin_m, direction: (rotation.inverse() * direction).normalize() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::OpenOptions;
    use crate::shot::ShotOptions;
    use std::path::Path;

    #[test]
    fn ray_projects_back_to_its_pixel_with_the_pose_of_its_row() {
        let open = |sets: &[&str]| {
            let sets = sets.iter().map(ToString::to_string).collect();
            Shot::open(
                Path::new("recordings/demo"),
                &OpenOptions::default(),
                &ShotOptions { sets, ..ShotOptions::default() },
            )
            .unwrap()
        };
        let shot = open(&[]);
        let camera = shot.posed_camera(30).unwrap();
        for at in [(1.0, 2.0), (320.0, 240.0), (600.5, 470.5), (40.0, 400.0)].map(DVec2::from) {
            let ray = camera.ray(at).unwrap();
            assert!((ray.direction.length() - 1.0).abs() < 1e-12);
            for distance_m in [0.3, 1.0, 20.0] {
                let back = camera.project(ray.at(distance_m)).unwrap();
                // Four steps of a contraction: its factor is the motion per row's share of the
                // readout.
                assert!(back.distance(at) < 1e-3, "{at}: {back}");
            }
            assert_eq!(camera.project(ray.at(-1.0)), None);
        }
        // Rows at the rims have other poses: a global shutter shows the points elsewhere.
        let rigid = open(&["camera.readout_time_s=0"]).posed_camera(30).unwrap();
        let (top, middle) = (DVec2::new(320.0, 4.0), DVec2::new(320.0, 240.0));
        let moved = |at: DVec2| rigid.project(camera.ray(at).unwrap().at(1.0)).unwrap().distance(at);
        assert!(moved(top) > 0.5 && moved(middle) < 1e-6, "{} {}", moved(top), moved(middle));
    }

    #[test]
    fn vector_to_a_point_behind_the_camera_is_defined() {
        let shot = Shot::open(Path::new("recordings/demo"), &OpenOptions::default(), &ShotOptions::default()).unwrap();
        let camera = shot.posed_camera(30).unwrap();
        // In the middle row the time is the frame's.
        let ray = camera.ray(DVec2::new(500.0, 240.0)).unwrap();
        let [ahead, behind] = [2.0, -2.0].map(|m| camera.vector_to(ray.at(m)));
        assert!((ahead.length() - 2.0).abs() < 1e-9 && ahead.abs_diff_eq(-behind, 1e-9), "{ahead} {behind}");
        assert!(ahead.z > 1.5 && ahead.x > 0.3 && camera.project(ray.at(-2.0)).is_none(), "{ahead}");
        assert!(camera.in_camera(ray.at(2.0)).unwrap().abs_diff_eq(ahead, 1e-6));
    }

    #[test]
    fn heading_is_towards_the_camera_and_from_right_above_towards_the_lower_edge() {
        let shot = Shot::open(Path::new("recordings/demo"), &OpenOptions::default(), &ShotOptions::default()).unwrap();
        let camera = shot.posed_camera(30).unwrap();
        let point = DVec3::new(0.1, -0.1, 0.0);
        let Heading::Towards { direction, turned_deg: 5.0 } = shot.heading_to_camera(30, point, DVec3::Z, 5.0) else {
            panic!()
        };
        let to_camera = camera.position_m() - point;
        assert!(direction.z.abs() < 1e-12 && (direction.length() - 1.0).abs() < 1e-12);
        assert!((direction.dot(to_camera) - to_camera.truncate().length()).abs() < 1e-9);
        // With "up" towards the camera, the camera is right above the point.
        let up = to_camera.normalize();
        let down = camera.horizontal_towards_camera(point, up).unwrap();
        let (here, there) = (camera.project(point).unwrap(), camera.project(point + 0.01 * down).unwrap());
        let way = (there - here).normalize();
        assert!(down.dot(up).abs() < 1e-9 && way.y > 0.99, "{way}");
        assert_eq!(shot.heading_to_camera(9999, point, DVec3::Z, 7.0), Heading::Deg(7.0));
    }
}
