//! Projection between points in front of the camera and pixel positions.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3};

use super::{Distortion, Intrinsics, LensModel};

/// Fixed-point iterations for rolling shutter: row time and position depend on each other, and each
/// step contracts by readout · speed / height.
const ROW_ITERATIONS: usize = 4;

/// Intrinsics and distortion: always applied, not an effect. Raster axes: x right, y down, the
/// upper left corner at (0, 0), pixel centres at +0.5.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(from = "SerializedGeometry", into = "SerializedGeometry")]
pub struct Geometry {
    pub intrinsics: Intrinsics,
    pub distortion: Distortion,
    valid_radius: f64,
}

/// The serialised parts of a geometry.
#[derive(serde::Serialize, serde::Deserialize)]
struct SerializedGeometry {
    intrinsics: Intrinsics,
    distortion: Distortion,
}

impl From<SerializedGeometry> for Geometry {
    fn from(SerializedGeometry { intrinsics, distortion }: SerializedGeometry) -> Self {
        Self::new(intrinsics, distortion)
    }
}

impl From<Geometry> for SerializedGeometry {
    fn from(Geometry { intrinsics, distortion, .. }: Geometry) -> Self {
        Self { intrinsics, distortion }
    }
}

/// Maximum angle off the axis of a fisheye that is projected onto a plane in front of the camera.
const MAX_PLANE_ANGLE_RAD: f64 = 85.0 * PI / 180.0;

impl Geometry {
    /// Square pixels, the principal point in the picture's centre, no distortion, a global shutter.
    pub fn pinhole(width_px: u32, height_px: u32, focal_px: f64) -> Self {
        let intrinsics = Intrinsics {
            width_px,
            height_px,
            fx_px: focal_px,
            fy_px: focal_px,
            cx_px: 0.5 * f64::from(width_px),
            cy_px: 0.5 * f64::from(height_px),
            ..Intrinsics::default()
        };
        Self::new(intrinsics, Distortion::default())
    }

    /// A 360° picture's focal lengths (px per radian) and centre follow from its size, regardless
    /// of the intrinsics. A lens's table without a camera is bound to this one.
    pub fn new(mut intrinsics: Intrinsics, mut distortion: Distortion) -> Self {
        if distortion.model == LensModel::Equirectangular {
            let (width, height) = (f64::from(intrinsics.width_px), f64::from(intrinsics.height_px));
            (intrinsics.fx_px, intrinsics.fy_px) = (width / TAU, height / PI);
            (intrinsics.cx_px, intrinsics.cy_px) = (0.5 * width, 0.5 * height);
        }
        if let Some(map) = &mut distortion.map {
            map.bind(&intrinsics);
        }
        let valid_radius = distortion.valid_radius();
        Self { intrinsics, distortion, valid_radius }
    }

    /// The normalised radius (a fisheye's angle, rad) beyond which the distortion continues along
    /// its tangent.
    pub fn valid_radius(&self) -> f64 {
        self.valid_radius
    }

    /// Derivative of the distorted radius at the valid radius.
    pub fn rim_slope(&self) -> f64 {
        self.distortion.slope(self.valid_radius)
    }

    /// The pixel position of a point in front of the camera (OpenCV axes, metres). `None` at or
    /// behind the camera's plane, z ≤ 0; for a fisheye, outside its field of view.
    #[inline]
    pub fn project(&self, point_in_camera: DVec3) -> Option<DVec2> {
        if self.distortion.is_none() {
            let z = point_in_camera.z;
            return (z > 0.0).then(|| self.raster_px(point_in_camera.truncate() / z));
        }
        self.distortion.project(point_in_camera, self.valid_radius).map(|d| self.raster_px(d))
    }

    /// Like [`Geometry::project`], extended beyond a fisheye's field of view: to the side of and
    /// behind its picture.
    pub fn project_extended_px(&self, point_in_camera: DVec3) -> DVec2 {
        self.raster_px(self.distortion.project_extended(point_in_camera, self.valid_radius))
    }

    fn raster_px(&self, d: DVec2) -> DVec2 {
        let i = &self.intrinsics;
        DVec2::new(i.fx_px * d.x + i.cx_px, i.fy_px * d.y + i.cy_px)
    }

    /// The pixel position of a ray with normalised coordinates (x/z, y/z).
    pub fn distorted_px(&self, normalised: DVec2) -> DVec2 {
        self.raster_px(self.distortion.distort(normalised, self.valid_radius))
    }

    /// The direction (unit length) of a pixel position. A fisheye's may point backwards. `None` if
    /// the distortion has no inverse there.
    pub fn direction(&self, at_px: DVec2) -> Option<DVec3> {
        let i = &self.intrinsics;
        let d = DVec2::new((at_px.x - i.cx_px) / i.fx_px, (at_px.y - i.cy_px) / i.fy_px);
        self.distortion.unproject(d, self.valid_radius)
    }

    /// The ray of a pixel position, scaled to z = 1: multiplied by a depth it is the point. `None`
    /// if the distortion has no inverse there, and where a fisheye's ray points sideways or back.
    pub fn unproject(&self, at_px: DVec2) -> Option<DVec3> {
        self.direction(at_px).filter(|d| d.z > 1e-9).map(|d| d / d.z)
    }

    /// The ray of a pixel position, scaled so that multiplied by a recorded depth it is the point.
    /// Depth is distance in a 360° picture, z in any other. `None` if there is none.
    pub fn depth_ray(&self, at_px: DVec2) -> Option<DVec3> {
        if self.is_equirectangular() { self.direction(at_px) } else { self.unproject(at_px) }
    }

    /// True if the left and right borders are the same direction: a 360° picture.
    pub fn is_equirectangular(&self) -> bool {
        self.distortion.model == LensModel::Equirectangular
    }

    /// True if the field of view exceeds a plane in front of the camera, so that the picture is
    /// assembled from several views.
    pub fn needs_cube_map(&self) -> bool {
        let (w, h) = (f64::from(self.intrinsics.width_px), f64::from(self.intrinsics.height_px));
        let wide = |at: DVec2| self.direction(at).is_none_or(|d| d.angle_between(DVec3::Z) > MAX_PLANE_ANGLE_RAD);
        match self.distortion.model {
            LensModel::Opencv | LensModel::OpencvRational | LensModel::Fov | LensModel::StMap => false,
            // A corner is farthest from the axis. One without a direction is outside the lens's
            // field of view.
            LensModel::OpencvFisheye | LensModel::ThinPrismFisheye => {
                [(0.0, 0.0), (w, 0.0), (0.0, h), (w, h)].into_iter().any(|at| wide(at.into()))
            }
            LensModel::Equirectangular => true,
        }
    }

    /// The displacement from one pixel position to another, px. In a 360° picture it is the shorter
    /// one, possibly across the seam.
    pub fn displacement_px(&self, from: DVec2, to: DVec2) -> DVec2 {
        let width = f64::from(self.intrinsics.width_px);
        let way = to - from;
        if self.is_equirectangular() { DVec2::new(way.x - width * (way.x / width).round(), way.y) } else { way }
    }

    /// The camera with another picture size and the same view.
    pub fn resized(&self, width_px: u32, height_px: u32) -> Self {
        let i = &self.intrinsics;
        let (sx, sy) = (f64::from(width_px) / f64::from(i.width_px), f64::from(height_px) / f64::from(i.height_px));
        let intrinsics = Intrinsics {
            width_px,
            height_px,
            fx_px: i.fx_px * sx,
            fy_px: i.fy_px * sy,
            cx_px: i.cx_px * sx,
            cy_px: i.cy_px * sy,
            ..i.clone()
        };
        Self { intrinsics, distortion: self.distortion.clone(), valid_radius: self.valid_radius }
    }

    /// Readout time of the row at height `y_px`, relative to the frame's timestamp (the middle of
    /// the middle row's exposure), seconds. Rows outside the picture continue at the same rate.
    pub fn row_time_s(&self, y_px: f64) -> f64 {
        (y_px / f64::from(self.intrinsics.height_px) - 0.5) * self.intrinsics.readout_time_s
    }

    /// Rolling-shutter projection: a point's pixel position, and the point in the camera's axes,
    /// metres, at the time of the row in which it appears. `in_camera_at` is the latter at a time
    /// relative to the middle row's, seconds. `None` outside the field of view.
    pub fn project_rolling(&self, in_camera_at: impl Fn(f64) -> DVec3) -> Option<(DVec2, DVec3)> {
        let readout_s = self.intrinsics.readout_time_s;
        let mut point = in_camera_at(0.0);
        let mut at = self.project(point)?;
        if readout_s > 0.0 {
            for _ in 0..ROW_ITERATIONS {
                // Rows far outside the picture do not exist; their time is clamped to near the
                // picture's.
                point = in_camera_at(self.row_time_s(at.y).clamp(-readout_s, readout_s));
                at = self.project(point)?;
            }
        }
        Some((at, point))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn fr1() -> Geometry {
        Geometry::new(
            Intrinsics { fx_px: 517.3, fy_px: 516.5, cx_px: 319.1, cy_px: 255.8, ..Default::default() },
            Distortion { k1: 0.2624, k2: -0.9531, p1: -0.0054, p2: 0.0026, k3: 1.1633, ..Default::default() },
        )
    }

    #[test]
    fn pinhole_projection_matches_hand_calculation() {
        let g = Geometry::new(Intrinsics { cx_px: 300.0, ..Default::default() }, Distortion::default());
        assert_eq!(g.project(DVec3::new(0.2, -0.4, 2.0)), Some(DVec2::new(352.5, 135.0)));
        assert_eq!(g.project(DVec3::new(0.2, -0.4, -2.0)), None);
        assert_eq!(g.project(DVec3::new(0.0, 0.0, f64::NAN)), None);
    }

    #[test]
    fn row_times_are_centred_on_the_timestamp() {
        let mut g = fr1();
        g.intrinsics.readout_time_s = 0.02;
        assert!((g.row_time_s(0.0) + 0.01).abs() < 1e-12);
        assert!(g.row_time_s(240.0).abs() < 1e-12);
    }

    fn around(width_px: u32, height_px: u32) -> Geometry {
        let intrinsics = Intrinsics { width_px, height_px, ..Default::default() };
        Geometry::new(intrinsics, Distortion { model: LensModel::Equirectangular, ..Default::default() })
    }

    #[test]
    fn equirectangular_projection_matches_hand_calculation() {
        // Two px per degree, whatever focal length is given.
        let g = around(720, 360);
        let at = |d: DVec3| g.project(d).unwrap();
        assert!((at(DVec3::X * 3.0) - DVec2::new(540.0, 180.0)).length() < 1e-9);
        assert!((at(DVec3::new(-1.0, 2f64.sqrt(), -1.0)) - DVec2::new(90.0, 270.0)).length() < 1e-9);
        assert!((g.direction(DVec2::new(0.0, 180.0)).unwrap() - DVec3::NEG_Z).length() < 1e-12);
        assert!((g.direction(DVec2::new(99.0, 360.0)).unwrap() - DVec3::Y).length() < 1e-12, "down is at the bottom");
        assert_eq!(g.displacement_px(DVec2::new(715.0, 9.0), DVec2::new(4.0, 7.0)), DVec2::new(9.0, -2.0));
        assert_eq!(fr1().displacement_px(DVec2::new(715.0, 9.0), DVec2::new(4.0, 7.0)), DVec2::new(-711.0, -2.0));
        assert_eq!(g.project(DVec3::ZERO), None);
    }

    #[test]
    fn wide_fisheye_needs_a_cube_map() {
        let fisheye = |focal_px: f64, k1: f64| {
            let intrinsics = Intrinsics { fx_px: focal_px, fy_px: focal_px, ..Default::default() };
            Geometry::new(intrinsics, Distortion { model: LensModel::OpencvFisheye, k1, ..Default::default() })
        };
        // The corner is 400 px out: 1 rad at 400 px, 1.6 rad at 250 px.
        assert!(!fisheye(400.0, 0.0).needs_cube_map() && fisheye(250.0, 0.0).needs_cube_map());
        // k1 = −0.1 folds at 1.8 rad, which is imaged at 1.2 rad: the corners are empty.
        assert!(fisheye(250.0, -0.1).needs_cube_map());
        assert!(around(64, 32).needs_cube_map() && !fr1().needs_cube_map());
    }

    proptest! {
        #[test]
        fn round_trip_of_a_360_picture(x in 0.0f64..720.0, y in 0.01f64..359.99, far in 0.01f64..1e4) {
            let g = around(720, 360);
            let at = DVec2::new(x, y);
            let back = g.project(g.direction(at).unwrap() * far).unwrap();
            prop_assert!(g.displacement_px(at, back).length() < 1e-6, "{back}");
        }

        #[test]
        fn round_trip_over_the_whole_picture(x in 0.0f64..640.0, y in 0.0f64..480.0, z in 0.1f64..50.0) {
            let g = fr1();
            let ray = g.unproject(DVec2::new(x, y)).unwrap();
            let back = g.project(ray * z).unwrap();
            prop_assert!((back - DVec2::new(x, y)).length() < 1e-6, "{back}");
        }
    }
}
