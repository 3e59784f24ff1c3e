//! Planes in the world, in two forms.
//!
//! Surfaces on which objects stand have a point and a normal ([`Plane`]). Fits to points give the
//! Hesse normal form ([`HessePlane`]), whose distances need no subtraction of points. Both stay
//! apart, because a conversion rounds.

use glam::DVec3;

/// A plane through a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    pub point_m: DVec3,
    /// Unit length; out of the surface, if it is one of a real object.
    pub normal: DVec3,
}

impl Plane {
    /// Signed distance of a point, positive on the normal's side, m.
    pub fn height_m(&self, at_m: DVec3) -> f64 {
        self.normal.dot(at_m - self.point_m)
    }

    /// Distance from a point to the plane along a unit vector, negative against it, m. Not finite
    /// if they are parallel.
    pub fn distance_along_m(&self, from_m: DVec3, direction: DVec3) -> f64 {
        (self.point_m - from_m).dot(self.normal) / direction.dot(self.normal)
    }

    /// Angle between the normal and a unit vector, degrees.
    pub fn tilt_deg(&self, up: DVec3) -> f64 {
        self.normal.dot(up).clamp(-1.0, 1.0).acos().to_degrees()
    }
}

/// A plane normal · X = offset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HessePlane {
    /// Unit length.
    pub normal: DVec3,
    pub offset_m: f64,
}

impl HessePlane {
    /// Signed distance of a point, positive on the normal's side, m.
    pub fn height_m(&self, at_m: DVec3) -> f64 {
        self.normal.dot(at_m) - self.offset_m
    }

    /// The plane with its normal on the side of `towards`.
    pub fn facing(self, towards: DVec3) -> Self {
        let sign = if self.normal.dot(towards) < 0.0 { -1.0 } else { 1.0 };
        Self { normal: sign * self.normal, offset_m: sign * self.offset_m }
    }

    /// The coefficients a, b, c and d of a·x + b·y + c·z = d.
    pub fn coefficients(&self) -> [f64; 4] {
        [self.normal.x, self.normal.y, self.normal.z, self.offset_m]
    }
}

impl From<Plane> for HessePlane {
    fn from(Plane { point_m, normal }: Plane) -> Self {
        Self { normal, offset_m: normal.dot(point_m) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heights_of_both_forms_agree_and_a_ray_ends_on_the_plane() {
        let plane = Plane { point_m: DVec3::new(0.0, 1.0, 1.0), normal: DVec3::new(0.0, -0.6, 0.8) };
        let at_m = DVec3::new(3.0, -2.0, 5.0);
        assert!((plane.height_m(at_m) - 5.0).abs() < 1e-12, "{}", plane.height_m(at_m));
        let hesse = HessePlane::from(plane);
        assert!((hesse.height_m(at_m) - 5.0).abs() < 1e-12 && (hesse.offset_m - 0.2).abs() < 1e-12, "{hesse:?}");
        assert!((hesse.facing(DVec3::NEG_Z).height_m(at_m) + 5.0).abs() < 1e-12);
        assert!((plane.distance_along_m(at_m, DVec3::Z) + 6.25).abs() < 1e-12);
        assert!(!plane.distance_along_m(at_m, DVec3::X).is_finite());
        assert!((plane.tilt_deg(DVec3::Z) - 36.869_897_645).abs() < 1e-6, "{}", plane.tilt_deg(DVec3::Z));
    }
}
