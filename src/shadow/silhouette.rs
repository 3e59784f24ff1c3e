//! Silhouettes of shadows: the triangles of occluders and the edges between them.
//!
//! The outline of a shadow consists of silhouette edges: those with a triangle that faces the light
//! on one side, and on the other side one that does not or none (Crow 1977, "Shadow algorithms for
//! computer graphics"). Each starts a layer of the shadow or ends one. The number of layers at a
//! place on the plane is the number that start to its left minus the number that end. A fine mesh
//! thus costs little more to fill than a coarse one, and a mesh need not be closed.

use std::collections::HashMap;

use glam::{Vec2, Vec3};

use super::occluders::Occluders;

/// Triangles of occluders, with the edges between them.
#[derive(Debug)]
pub struct SilhouetteMesh {
    /// m; without duplicates.
    corners: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    edges: Vec<SilhouetteEdge>,
}

/// An edge between two corners, the one with the lower index first.
#[derive(Clone, Copy, Debug)]
struct SilhouetteEdge {
    corners: [u32; 2],
    /// The triangle that contains it in this direction, and the one in the opposite direction; one
    /// past the last for none.
    triangles: [u32; 2],
}

/// Reusable buffers for a projected shadow.
#[derive(Debug, Default)]
pub struct CastBuffers {
    places: Vec<Vec2>,
    /// Orientation of each triangle's shadow: 1, −1 if it is flipped, 0 if it has no area.
    orientations: Vec<i8>,
}

impl SilhouetteMesh {
    pub fn of(occluders: &Occluders) -> Self {
        let mut at_place = HashMap::with_capacity(occluders.corners.len());
        let mut corners = Vec::new();
        // Adding 0 converts −0 to 0.
        let index_of = |corner: &Vec3| {
            *at_place.entry((*corner + 0.0).to_array().map(f32::to_bits)).or_insert_with(|| {
                corners.push(*corner);
                corners.len() as u32 - 1
            })
        };
        let numbers: Vec<u32> = occluders.corners.iter().map(index_of).collect();
        let triangles: Vec<[u32; 3]> = occluders.triangles.iter().map(|t| t.map(|i| numbers[i as usize])).collect();
        let edges = edges(&triangles);
        Self { corners, triangles, edges }
    }

    /// Calls `each` with the silhouette edges of the shadow: both ends, and the difference in
    /// layers between its sides. `place_of` returns the position of a corner's shadow. Triangles
    /// with a corner without a shadow are skipped.
    pub fn for_each_edge(
        &self,
        cast: &mut CastBuffers,
        place_of: impl Fn(Vec3) -> Option<Vec2>,
        mut each: impl FnMut(Vec2, Vec2, i32),
    ) {
        let CastBuffers { places, orientations } = cast;
        places.clear();
        places.extend(self.corners.iter().map(|corner| place_of(*corner).unwrap_or(Vec2::NAN)));
        orientations.clear();
        // `array::map` is not inlined in a development build, whose units are optimised apart.
        orientations.extend(self.triangles.iter().map(|&[a, b, c]| {
            let (a, b, c) = (places[a as usize], places[b as usize], places[c as usize]);
            let area = (b - a).perp_dot(c - a);
            i8::from(area > 0.0) - i8::from(area < 0.0)
        }));
        orientations.push(0);
        for SilhouetteEdge { corners: [from, to], triangles: [along, against] } in &self.edges {
            let (along, against) = (orientations[*along as usize], orientations[*against as usize]);
            if along != against {
                each(places[*from as usize], places[*to as usize], i32::from(along - against));
            }
        }
    }
}

/// The edges of triangles. If more than two triangles share an edge they are paired.
fn edges(triangles: &[[u32; 3]]) -> Vec<SilhouetteEdge> {
    let none = triangles.len() as u32;
    let mut uses: Vec<([u32; 2], bool, u32)> = (0..none)
        .zip(triangles)
        .flat_map(|(n, [a, b, c])| {
            [(a, b), (b, c), (c, a)].map(|(from, to)| ([*from.min(to), *from.max(to)], from > to, n))
        })
        .filter(|([low, high], ..)| low != high)
        .collect();
    uses.sort_unstable();
    let mut edges = Vec::with_capacity(uses.len() / 2 + 1);
    for of_one in uses.chunk_by(|a, b| a.0 == b.0) {
        let (along, against) = of_one.split_at(of_one.partition_point(|(_, is_against, _)| !is_against));
        for n in 0..along.len().max(against.len()) {
            let triangle_of = |list: &[([u32; 2], bool, u32)]| list.get(n).map_or(none, |(.., triangle)| *triangle);
            edges.push(SilhouetteEdge { corners: of_one[0].0, triangles: [triangle_of(along), triangle_of(against)] });
        }
    }
    edges
}
