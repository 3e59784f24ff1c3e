//! The receiver plane below objects, with its axes.

use glam::{DAffine3, DMat3, DVec2, DVec3};

use crate::digest::digestible;
use crate::plane::Plane;

/// A plane with a coordinate system: x and y in the plane, z along the normal, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReceiverPlane {
    pub origin_m: DVec3,
    /// World from plane: the columns are its x, its y and its normal.
    pub axes: DMat3,
}

digestible! { ReceiverPlane { origin_m, axes } }

impl ReceiverPlane {
    /// `normal` has unit length. The axes depend on it alone.
    pub fn new(origin_m: DVec3, normal: DVec3) -> Self {
        let aside = DVec3::AXES.into_iter().min_by(|a, b| a.dot(normal).abs().total_cmp(&b.dot(normal).abs()));
        let x = aside.unwrap_or(DVec3::X).reject_from_normalized(normal).normalize();
        Self { origin_m, axes: DMat3::from_cols(x, normal.cross(x), normal) }
    }

    /// The support plane of an object, with its origin below the object's first part.
    pub fn below(support: &Plane, first: &DAffine3) -> Option<Self> {
        let through = Self::new(support.point_m, support.normal.try_normalize()?);
        let below = first.translation - through.height_m(first.translation) * through.normal();
        Some(Self { origin_m: below, ..through })
    }

    pub fn normal(&self) -> DVec3 {
        self.axes.z_axis
    }

    pub fn plane(&self) -> Plane {
        Plane { point_m: self.origin_m, normal: self.normal() }
    }

    pub fn plane_from_world(&self) -> DAffine3 {
        let turn = self.axes.transpose();
        DAffine3 { matrix3: turn, translation: turn * -self.origin_m }
    }

    /// World position of a place on the plane.
    pub fn at(&self, place_m: DVec2) -> DVec3 {
        self.origin_m + self.axes * place_m.extend(0.0)
    }

    /// Height of a point above the plane, m.
    pub fn height_m(&self, point: DVec3) -> f64 {
        self.plane().height_m(point)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_right_handed_and_a_place_comes_back() {
        for normal in [DVec3::Z, DVec3::NEG_Y, DVec3::new(0.3, -0.5, 0.8).normalize()] {
            let plane = ReceiverPlane::new(DVec3::new(1.0, 2.0, 3.0), normal);
            assert!((plane.axes.determinant() - 1.0).abs() < 1e-12);
            let point = plane.at(DVec2::new(0.4, -0.7)) + 0.2 * normal;
            let back = plane.plane_from_world().transform_point3(point);
            assert!(back.abs_diff_eq(DVec3::new(0.4, -0.7, 0.2), 1e-12), "{back}");
            assert!((plane.height_m(point) - 0.2).abs() < 1e-12);
        }
    }
}
