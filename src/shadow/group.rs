//! Objects on one plane whose shadows may overlap share a shadow map, so that blocked light is subtracted once.

use glam::{Mat3, Vec3};

use super::extent::Extent;
use super::floor::Floor;

/// Planes that differ less are one: cosine of their tilt (2°), and metres.
const ONE_TILT: f64 = 0.9994;
const ONE_HEIGHT_M: f64 = 0.005;

/// Things that share a floor.
pub struct Group {
    pub floor: Floor,
    pub extent: Extent,
    /// Indices into [`crate::scene::Scene::objects`].
    pub objects: Vec<usize>,
}

impl Group {
    /// Whether they stand on one floor, and their shadows may fall together.
    pub fn meets(&self, other: &Self) -> bool {
        is_one_floor(&self.floor, &other.floor) && self.extent.meets(&other.seen_from(&self.floor))
    }

    /// With another one's, on its own floor.
    #[must_use]
    pub fn joined(mut self, other: Self) -> Self {
        self.extent = self.extent.union(other.seen_from(&self.floor));
        self.objects.extend(other.objects);
        self
    }

    /// The extent in a floor's axes: a rectangle around it, turned.
    fn seen_from(&self, floor: &Floor) -> Extent {
        let turn: Mat3 = (floor.axes.transpose() * self.floor.axes).as_mat3();
        let offset = floor.floor_from_world().transform_point3(self.floor.origin_m).as_vec3().truncate();
        let Extent { low, high } = self.extent;
        let corners = [(low.x, low.y), (high.x, low.y), (low.x, high.y), (high.x, high.y)]
            .map(|(x, y)| (turn * Vec3::new(x, y, 0.0)).truncate() + offset);
        let [a, b, c, d] = corners;
        Extent { low: a.min(b).min(c).min(d), high: a.max(b).max(c).max(d) }
    }
}

fn is_one_floor(a: &Floor, b: &Floor) -> bool {
    a.normal().dot(b.normal()) > ONE_TILT
        && a.height_m(b.origin_m).abs() < ONE_HEIGHT_M
        && b.height_m(a.origin_m).abs() < ONE_HEIGHT_M
}
