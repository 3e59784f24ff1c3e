//! Objects on one plane whose shadows may overlap share a planar shadow, so that blocked light is
//! subtracted once.

use glam::{Mat3, Vec3};

use super::extent::Extent;
use super::receiver_plane::ReceiverPlane;

/// Smallest cosine of the tilt between two planes that count as one: 2°.
const MIN_TILT_COSINE: f64 = 0.9994;
/// Largest distance between two planes that count as one, m.
const MAX_OFFSET_M: f64 = 0.005;

/// Objects that share a receiver plane.
pub struct ShadowGroup {
    pub plane: ReceiverPlane,
    pub extent: Extent,
    /// Indices into [`crate::scene::Scene::objects`].
    pub objects: Vec<usize>,
}

impl ShadowGroup {
    /// True if both are on one plane and their shadows may overlap.
    pub fn overlaps(&self, other: &Self) -> bool {
        is_same_plane(&self.plane, &other.plane) && self.extent.overlaps(&other.extent_on(&self.plane))
    }

    /// This group with the objects of another, on this group's plane.
    #[must_use]
    pub fn joined(mut self, other: Self) -> Self {
        self.extent = self.extent.union(other.extent_on(&self.plane));
        self.objects.extend(other.objects);
        self
    }

    /// The bounding rectangle of the extent in another plane's axes.
    fn extent_on(&self, plane: &ReceiverPlane) -> Extent {
        let turn: Mat3 = (plane.axes.transpose() * self.plane.axes).as_mat3();
        let offset = plane.plane_from_world().transform_point3(self.plane.origin_m).as_vec3().truncate();
        let Extent { low, high } = self.extent;
        let corners = [(low.x, low.y), (high.x, low.y), (low.x, high.y), (high.x, high.y)]
            .map(|(x, y)| (turn * Vec3::new(x, y, 0.0)).truncate() + offset);
        let [a, b, c, d] = corners;
        Extent { low: a.min(b).min(c).min(d), high: a.max(b).max(c).max(d) }
    }
}

fn is_same_plane(a: &ReceiverPlane, b: &ReceiverPlane) -> bool {
    a.normal().dot(b.normal()) > MIN_TILT_COSINE
        && a.height_m(b.origin_m).abs() < MAX_OFFSET_M
        && b.height_m(a.origin_m).abs() < MAX_OFFSET_M
}
