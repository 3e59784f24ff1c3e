//! From a point before the camera to a place in the picture and back.

use glam::{DVec2, DVec3};

use super::Distortion;

crate::params! {
    /// Size of the picture, focal lengths and principal point in pixels, film width, readout.
    pub struct Intrinsics in "camera" {
        "width of the picture" width_px: u32 = 640, "px", 1.0..=65536.0;
        "height of the picture" height_px: u32 = 480, "px", 1.0..=65536.0;
        "focal length in pixel widths" fx_px: f64 = 525.0, "px", 1e-3..=1e7;
        "focal length in pixel heights" fy_px: f64 = 525.0, "px", 1e-3..=1e7;
        "principal point from the left edge; pixel centres at +0.5" cx_px: f64 = 320.0, "px", -1e6..=1e6;
        "principal point from the upper edge; pixel centres at +0.5" cy_px: f64 = 240.0, "px", -1e6..=1e6;
        "width of the film or sensor" film_width_mm: f64 = 36.0, "mm", 0.1..=1000.0;
        "from the first row's exposure to the last row's, top to bottom; 0 is a global shutter" readout_time_s: f64 = 0.0, "s", 0.0..=1.0;
    }
}

/// Intrinsics and distortion: always on, no effect.
/// Raster axes: x right, y down, the upper left corner at (0, 0), pixel centres at +0.5.
#[derive(Clone, Debug, PartialEq)]
pub struct Geometry {
    pub intrinsics: Intrinsics,
    pub distortion: Distortion,
    valid_radius: f64,
}

impl Geometry {
    pub fn new(intrinsics: Intrinsics, distortion: Distortion) -> Self {
        let valid_radius = distortion.valid_radius();
        Self { intrinsics, distortion, valid_radius }
    }

    /// The normalised radius (of a fisheye the angle, rad) beyond which the distortion is carried on along its tangent.
    pub fn valid_radius(&self) -> f64 {
        self.valid_radius
    }

    /// How fast the distorted radius grows at the valid radius.
    pub fn rim_slope(&self) -> f64 {
        self.distortion.slope(self.valid_radius)
    }

    /// Where a point before the camera (OpenCV axes, metres) lands, px.
    /// `None` at or behind the camera's plane, z ≤ 0; of a fisheye, beyond what it sees.
    pub fn project(&self, point_in_camera: DVec3) -> Option<DVec2> {
        self.distortion.project(point_in_camera, self.valid_radius).map(|d| self.raster_px(d))
    }

    fn raster_px(&self, d: DVec2) -> DVec2 {
        let i = &self.intrinsics;
        DVec2::new(i.fx_px * d.x + i.cx_px, i.fy_px * d.y + i.cy_px)
    }

    /// Where a ray with normalised coordinates (x/z, y/z) lands, px.
    pub fn distorted_px(&self, normalised: DVec2) -> DVec2 {
        self.raster_px(self.distortion.distort(normalised, self.valid_radius))
    }

    /// The direction (unit length) that is seen at a place in the picture; of a fisheye it may point backwards.
    /// `None` where the distortion has no inverse there.
    pub fn direction(&self, at_px: DVec2) -> Option<DVec3> {
        let i = &self.intrinsics;
        let d = DVec2::new((at_px.x - i.cx_px) / i.fx_px, (at_px.y - i.cy_px) / i.fy_px);
        self.distortion.unproject(d, self.valid_radius)
    }

    /// The ray through a place in the picture, scaled to z = 1; times a depth it is the point.
    /// `None` where the distortion has no inverse there, and where a fisheye looks sideways or back.
    pub fn unproject(&self, at_px: DVec2) -> Option<DVec3> {
        self.direction(at_px).filter(|d| d.z > 1e-9).map(|d| d / d.z)
    }

    /// The same camera at another picture size (pixel for pixel the same view).
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

    /// When the row at height `y_px` is read, relative to the frame's timestamp (the middle
    /// of the middle row's exposure), seconds. Rows beyond the picture go on at the same rate.
    pub fn row_time_s(&self, y_px: f64) -> f64 {
        (y_px / f64::from(self.intrinsics.height_px) - 0.5) * self.intrinsics.readout_time_s
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
    fn pinhole_worked_by_hand() {
        let g = Geometry::new(Intrinsics { cx_px: 300.0, ..Default::default() }, Distortion::default());
        assert_eq!(g.project(DVec3::new(0.2, -0.4, 2.0)), Some(DVec2::new(352.5, 135.0)));
        assert_eq!(g.project(DVec3::new(0.2, -0.4, -2.0)), None);
        assert_eq!(g.project(DVec3::new(0.0, 0.0, f64::NAN)), None);
    }

    #[test]
    fn rows_are_read_around_the_timestamp() {
        let mut g = fr1();
        g.intrinsics.readout_time_s = 0.02;
        assert!((g.row_time_s(0.0) + 0.01).abs() < 1e-12);
        assert!(g.row_time_s(240.0).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn round_trip_over_the_whole_picture(x in 0.0f64..640.0, y in 0.0f64..480.0, z in 0.1f64..50.0) {
            let g = fr1();
            let ray = g.unproject(DVec2::new(x, y)).unwrap();
            let back = g.project(ray * z).unwrap();
            prop_assert!((back - DVec2::new(x, y)).length() < 1e-6, "{back}");
        }
    }
}
