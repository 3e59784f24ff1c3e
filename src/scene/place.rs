//! Placement of a model in the world.

use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};

use super::{Object, Part, Scene};

/// Size of a placed model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Size {
    /// Scale factors along the model's own axes.
    Scale(DVec3),
    /// The model's largest extent, metres.
    LargestM(f64),
}

/// The shortest rotation between two unit vectors. For opposite ones: half a turn about x, or about
/// z if they lie along x.
pub(super) fn shortest_rotation(from: DVec3, to: DVec3) -> DQuat {
    if from.dot(to) > -1.0 + 1e-12 {
        return DQuat::from_rotation_arc(from, to);
    }
    let axis = if from.x.abs() < 0.9 { DVec3::X } else { DVec3::Z };
    DQuat::from_axis_angle(axis.reject_from_normalized(from).normalize(), std::f64::consts::PI)
}

/// Placement of a model without its size.
pub(super) struct FilePlacement {
    pub world_up: DVec3,
    pub model_up: DVec3,
    pub position_m: DVec3,
    pub rotation: DQuat,
    /// True if the position is that of the model's lowest point.
    pub ground: bool,
}

impl FilePlacement {
    /// position · rotation · rotation of the model's up to the world's · scale. `None` if that is
    /// not finite, or if the model has no extent to scale by.
    pub fn world_from_model(&self, scene: &Scene, parts: &[Part], size: Size) -> Option<DAffine3> {
        let scale = match size {
            Size::Scale(scale) => scale,
            Size::LargestM(size_m) => {
                let (low, high) = bounds(scene, parts, DAffine3::IDENTITY)?;
                DVec3::splat(size_m / (high - low).max_element())
            }
        };
        let turn = self.rotation * shortest_rotation(self.model_up, self.world_up);
        let matrix3 = DMat3::from_quat(turn) * DMat3::from_diagonal(scale);
        let mut placed = DAffine3 { matrix3, translation: self.position_m };
        if self.ground {
            let min_along = min_along(scene, parts, matrix3.transpose() * self.world_up)?;
            placed.translation -= self.world_up * min_along;
        }
        (placed.is_finite() && matrix3.determinant() != 0.0).then_some(placed)
    }
}

/// Smallest dot product of a direction with a model's points.
pub(super) fn min_along(scene: &Scene, parts: &[Part], direction: DVec3) -> Option<f64> {
    points(scene, parts).map(|p| p.dot(direction)).reduce(f64::min)
}

/// Bounding box of `parts`, after a further transform; `None` without points.
pub(super) fn bounds(scene: &Scene, parts: &[Part], world_from_parts: DAffine3) -> Option<(DVec3, DVec3)> {
    let moved = points(scene, parts).map(|p| world_from_parts.transform_point3(p));
    moved.map(|p| (p, p)).reduce(|(low, high), (p, _)| (low.min(p), high.max(p)))
}

impl Object {
    /// Corners of the object's bounding box along its model's own axes, in the world, metres: bit 0
    /// of an index is x, bit 1 y, bit 2 z; 0 low, 1 high. `None` without parts.
    pub fn corners_m(&self, scene: &Scene) -> Option<[DVec3; 8]> {
        let parts: Vec<Part> = self.placed().copied().collect();
        let (low, high) = bounds(scene, &parts, self.world_from_model.inverse())?;
        let sides = [low, high];
        Some(std::array::from_fn(|i| {
            let corner = DVec3::new(sides[i & 1].x, sides[i >> 1 & 1].y, sides[i >> 2 & 1].z);
            self.world_from_model.transform_point3(corner)
        }))
    }

    /// Triangle vertices in the world, metres.
    pub fn points_m<'a>(&'a self, scene: &'a Scene) -> impl Iterator<Item = DVec3> + 'a {
        points(scene, self.placed())
    }

    /// All its parts, drawn or occluding.
    pub fn placed(&self) -> impl Iterator<Item = &Part> {
        self.parts.iter().chain(&self.occluder_parts)
    }

    /// Transforms it in the world; its meshes stay.
    pub fn move_by(&mut self, by: DAffine3) {
        self.world_from_model = by * self.world_from_model;
        self.position_m = by.transform_point3(self.position_m);
        let parts = self.parts.iter_mut().chain(&mut self.occluder_parts);
        parts.for_each(|part| part.world_from_mesh = by * part.world_from_mesh);
    }
}

/// Vertices of all triangles, transformed by their parts.
fn points<'a>(scene: &'a Scene, parts: impl IntoIterator<Item = &'a Part> + 'a) -> impl Iterator<Item = DVec3> + 'a {
    parts.into_iter().flat_map(|part| {
        let mesh = &scene.meshes[part.mesh];
        mesh.indices
            .iter()
            .map(|&i| part.world_from_mesh.transform_point3(Vec3::from(mesh.vertices[i as usize].position).as_dvec3()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Mesh, Vertex};

    #[test]
    fn model_up_becomes_world_up_and_the_front_is_as_documented() {
        for (from, to, front) in
            [(DVec3::Y, DVec3::Z, DVec3::NEG_Y), (DVec3::Y, DVec3::Y, DVec3::Z), (DVec3::Y, DVec3::NEG_Y, DVec3::NEG_Z)]
        {
            let turn = shortest_rotation(from, to);
            assert!((turn * from).abs_diff_eq(to, 1e-12), "{from} to {to}: {}", turn * from);
            assert!((turn * DVec3::Z).abs_diff_eq(front, 1e-12), "{from} to {to}: {}", turn * DVec3::Z);
        }
        assert!((shortest_rotation(DVec3::X, DVec3::NEG_X) * DVec3::X).abs_diff_eq(DVec3::NEG_X, 1e-12));
    }

    #[test]
    fn largest_extent_along_any_axis_becomes_the_size() {
        let upright = FilePlacement {
            world_up: DVec3::Y,
            model_up: DVec3::Y,
            position_m: DVec3::ZERO,
            rotation: DQuat::IDENTITY,
            ground: false,
        };
        let parts = [Part { mesh: 0, world_from_mesh: DAffine3::IDENTITY }];
        // The largest extent is 4, along each axis in turn.
        for extent in [[4.0, 1.0, 2.0], [1.0, 4.0, 2.0], [1.0, 2.0, 4.0]] {
            let vertex = |position| Vertex { position, ..bytemuck::Zeroable::zeroed() };
            let vertices = vec![vertex([0.0; 3]), vertex(extent)];
            let mesh = Mesh { vertices, indices: vec![0, 1, 0], material: 0 };
            let scene = Scene { meshes: vec![mesh.into()], ..Scene::default() };
            let placed = upright.world_from_model(&scene, &parts, Size::LargestM(0.2)).unwrap();
            let expected = DAffine3::from_scale(DVec3::splat(0.2 / 4.0));
            assert!(placed.abs_diff_eq(expected, 1e-12), "{extent:?}: {placed}");
        }
    }
}
