//! A box, for tests.

use glam::Vec3;

use crate::scene::{Mesh, Vertex};

/// A box around the origin with half extents in m, of the first material.
pub fn block(half: Vec3) -> Mesh {
    let corner = |i: usize| {
        let sign = |bit: usize| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
        let position = (half * Vec3::new(sign(0), sign(1), sign(2))).to_array();
        Vertex { position, normal: [0.0, 0.0, 1.0], color: [1.0; 4], ..bytemuck::Zeroable::zeroed() }
    };
    let sides = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
    let indices = sides.iter().flat_map(|[a, b, c, d]| [*a, *b, *c, *a, *c, *d]).collect();
    Mesh { vertices: (0..8).map(corner).collect(), indices, material: 0 }
}
