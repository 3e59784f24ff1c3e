//! The free camera of a scan's view: orbits about a point, moves sideways, and zooms to a point.

use glam::{DQuat, DVec2, DVec3};

use locard_engine::camera::Geometry;
use locard_engine::pose::Pose;
use locard_engine::site::SiteScan;

/// Focal length in larger sides of the view: 58° across.
const FOCAL_LENGTH: f64 = 0.9;
/// Rotation of a drag across the view, rad.
const RAD_PER_VIEW: f64 = 3.5;
/// Smallest angle between the view direction and the vertical, rad.
const MIN_ANGLE_TO_UP_RAD: f64 = 0.02;
/// Elevation of the first view over the horizon, rad.
const FIRST_ELEVATION_RAD: f64 = 0.6;

/// A camera in the axes of a scan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrbitCamera {
    eye_m: DVec3,
    /// Axes x right, y down, z ahead.
    scan_from_camera: DQuat,
    up: DVec3,
    /// Distance of the point that the last motion was about.
    pivot_distance_m: f64,
}

impl OrbitCamera {
    /// Shows a whole scan obliquely from above, in a view of an aspect ratio (width by height).
    pub fn fitted(scan: &SiteScan, aspect: f64) -> Self {
        let up = scan.up.unwrap_or(DVec3::Z);
        let aside = up.any_orthonormal_vector();
        let (sine, cosine) = FIRST_ELEVATION_RAD.sin_cos();
        let radius_m = (0.5 * scan.bounds_m[0].distance(scan.bounds_m[1])).max(1e-3);
        // The sphere around the scan touches the shorter side of the view.
        let half_angle_rad = (0.5 * aspect.min(aspect.recip()) / FOCAL_LENGTH).atan();
        let distance_m = radius_m / half_angle_rad.sin();
        let center_m = scan.center_m();
        let eye_m = center_m + distance_m * (cosine * aside + sine * up);
        let pose = Pose::look_at(eye_m, center_m, up).unwrap_or(Pose::IDENTITY);
        Self { eye_m, scan_from_camera: pose.world_from_camera_rotation(), up, pivot_distance_m: distance_m }
    }

    /// Takes the place of a camera of the footage.
    pub fn take_pose(&mut self, camera_from_scan: &Pose) {
        self.eye_m = camera_from_scan.position_in_world_m();
        self.scan_from_camera = camera_from_scan.world_from_camera_rotation();
    }

    pub fn pose(&self) -> Pose {
        Pose::from_camera_in_world(self.eye_m, self.scan_from_camera)
    }

    /// The camera of a picture of the view.
    pub fn geometry([width_px, height_px]: [u32; 2]) -> Geometry {
        Geometry::pinhole(width_px, height_px, FOCAL_LENGTH * f64::from(width_px.max(height_px)))
    }

    /// The point that motions are about: `surface`, or one ahead at the last distance.
    fn pivot_m(&mut self, surface: Option<DVec3>) -> DVec3 {
        if let Some(surface) = surface {
            self.pivot_distance_m = surface.distance(self.eye_m);
        }
        surface.unwrap_or(self.eye_m + self.pivot_distance_m * (self.scan_from_camera * DVec3::Z))
    }

    /// Orbits by a drag, in larger sides of the view. Up stays up.
    pub fn orbit(&mut self, drag: DVec2, surface: Option<DVec3>) {
        let pivot_m = self.pivot_m(surface);
        let right = self.scan_from_camera * DVec3::X;
        let pitch_rad = -RAD_PER_VIEW * drag.y;
        let to_up_rad = (self.scan_from_camera * DVec3::Z).angle_between(self.up);
        let pitch_rad = pitch_rad.clamp(
            (MIN_ANGLE_TO_UP_RAD + to_up_rad - std::f64::consts::PI).min(0.0),
            (to_up_rad - MIN_ANGLE_TO_UP_RAD).max(0.0),
        );
        let turn = DQuat::from_axis_angle(self.up, -RAD_PER_VIEW * drag.x) * DQuat::from_axis_angle(right, pitch_rad);
        self.eye_m = pivot_m + turn * (self.eye_m - pivot_m);
        self.scan_from_camera = (turn * self.scan_from_camera).normalize();
    }

    /// Moves sideways by a drag, in larger sides of the view: the point below the pointer follows
    /// it.
    pub fn shift(&mut self, drag: DVec2, surface: Option<DVec3>) {
        let pivot_m = self.pivot_m(surface);
        let depth_m = (pivot_m - self.eye_m).dot(self.scan_from_camera * DVec3::Z);
        let moved = -drag / FOCAL_LENGTH * depth_m;
        self.eye_m += self.scan_from_camera * moved.extend(0.0);
    }

    /// Approaches a point by a factor of its distance. The point stays in its place in the view.
    pub fn zoom(&mut self, factor: f64, surface: Option<DVec3>) {
        let pivot_m = self.pivot_m(surface);
        self.eye_m = pivot_m + (self.eye_m - pivot_m) / factor;
        self.pivot_distance_m /= factor;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const EYE: DVec3 = DVec3::new(4.0, -3.0, 2.0);

    fn camera() -> OrbitCamera {
        let pose = Pose::look_at(EYE, DVec3::new(0.5, 0.2, 0.3), DVec3::Z).unwrap();
        let scan_from_camera = pose.world_from_camera_rotation();
        OrbitCamera { eye_m: EYE, scan_from_camera, up: DVec3::Z, pivot_distance_m: 5.0 }
    }

    fn projected(camera: &OrbitCamera, point_m: DVec3) -> DVec2 {
        OrbitCamera::geometry([200, 100]).project(camera.pose().transform_point(point_m)).unwrap() / 200.0
    }

    #[test]
    fn the_pivot_keeps_its_place_and_a_shift_follows_the_pointer() {
        let pivot = DVec3::new(0.3, 0.6, 0.1);
        let at = projected(&camera(), pivot);
        let mut zoomed = camera();
        zoomed.zoom(2.0, Some(pivot));
        assert!(projected(&zoomed, pivot).distance(at) < 1e-9);
        assert!((zoomed.eye_m.distance(pivot) / EYE.distance(pivot) - 0.5).abs() < 1e-9);
        let mut shifted = camera();
        shifted.shift(DVec2::new(0.1, -0.05), Some(pivot));
        assert!(projected(&shifted, pivot).distance(at + DVec2::new(0.1, -0.05)) < 1e-9);
        let mut orbited = camera();
        orbited.orbit(DVec2::new(0.2, 0.1), Some(pivot));
        assert!((orbited.eye_m.distance(pivot) - EYE.distance(pivot)).abs() < 1e-9 && orbited != camera());
    }

    #[test]
    fn up_stays_up_however_far_it_is_orbited() {
        let mut camera = camera();
        for drag in [DVec2::new(0.3, 0.9), DVec2::new(-0.7, 0.9), DVec2::new(0.1, -5.0), DVec2::new(2.0, -5.0)] {
            camera.orbit(drag, None);
            let [right, down] = [DVec3::X, DVec3::Y].map(|axis| camera.scan_from_camera * axis);
            assert!(right.z.abs() < 1e-9 && down.z <= 1e-9, "{drag}: {right} {down}");
        }
    }
}
