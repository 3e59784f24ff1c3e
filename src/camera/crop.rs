//! Crop of a camera's picture, enlarged: the view of a longer lens or a smaller film from the same
//! position.

use glam::DVec2;

use super::{Geometry, Intrinsics};

/// Crop of another picture: left and upper edge there, and the size of one of its pixels in the
/// other's pixels, above 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crop {
    pub left_px: f64,
    pub top_px: f64,
    pub step: f64,
}

impl Crop {
    /// The corresponding position in the other picture.
    pub fn source_px(&self, at_px: DVec2) -> DVec2 {
        DVec2::new(self.left_px, self.top_px) + self.step * at_px
    }

    /// True if pixels coincide with pixels, so that nothing is interpolated.
    pub fn is_exact(&self) -> bool {
        self.step == 1.0 && self.left_px.fract() == 0.0 && self.top_px.fract() == 0.0
    }

    /// The camera of the crop, with a size in pixels and a film width. The lens and its distortion
    /// are the same. Rows are read at the whole picture's rate, and the middle row at the same time
    /// if the crop is centred.
    pub fn geometry(&self, whole: &Geometry, width_px: u32, height_px: u32, film_width_mm: f64) -> Geometry {
        let i = &whole.intrinsics;
        let intrinsics = Intrinsics {
            width_px,
            height_px,
            fx_px: i.fx_px / self.step,
            fy_px: i.fy_px / self.step,
            cx_px: (i.cx_px - self.left_px) / self.step,
            cy_px: (i.cy_px - self.top_px) / self.step,
            film_width_mm,
            readout_time_s: i.readout_time_s * f64::from(height_px) * self.step / f64::from(i.height_px),
        };
        Geometry::new(intrinsics, whole.distortion.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Distortion;
    use glam::DVec3;

    #[test]
    fn crop_sees_the_same_directions_as_the_whole() {
        let distortion =
            Distortion { k1: 0.2624, k2: -0.9531, p1: -0.0054, p2: 0.0026, k3: 1.1633, ..Default::default() };
        let whole = Intrinsics {
            fx_px: 517.3,
            fy_px: 516.5,
            cx_px: 318.6,
            cy_px: 255.3,
            readout_time_s: 0.02,
            ..Default::default()
        };
        let whole = Geometry::new(whole, distortion);
        // The middle half of 640×480, enlarged three times.
        let framed = Crop { left_px: 160.0, top_px: 120.0, step: 1.0 / 3.0 };
        let part = framed.geometry(&whole, 960, 720, 24.0);
        for point in [DVec3::new(0.1, 0.05, 1.0), DVec3::new(-0.2, 0.1, 1.3)] {
            let (of_part, of_whole) = (part.project(point).unwrap(), whole.project(point).unwrap());
            assert!((framed.source_px(of_part) - of_whole).length() < 1e-9, "{of_part}");
            assert!((part.row_time_s(of_part.y) - whole.row_time_s(of_whole.y)).abs() < 1e-12);
        }
        assert!(!framed.is_exact() && Crop { step: 1.0, ..framed }.is_exact());
    }
}
