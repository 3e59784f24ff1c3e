//! The triangles of what stands on a floor, and the edges between them: where the edge of a shadow may lie.
//!
//! A shadow's edge is the shadow of an edge with a triangle that faces the light on one side, and on the other one that does not
//! or none (Crow 1977, "Shadow algorithms for computer graphics"). Each begins a layer of the
//! shadow or ends one. A place on the floor lies under as many layers as have begun to its left and not ended. So a fine mesh costs
//! little more filling than a coarse one, and a mesh need not be closed.

use std::collections::HashMap;

use glam::{Vec2, Vec3};

use super::occluders::Occluders;

#[derive(Debug)]
pub struct Outline {
    /// Metres; those at one place are one.
    corners: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    edges: Vec<Edge>,
}

/// Between two corners, the one with the lower number first.
#[derive(Clone, Copy, Debug)]
struct Edge {
    corners: [u32; 2],
    /// The triangle that it goes along, and the one that it goes against; one past the last where there is none.
    triangles: [u32; 2],
}

/// A thing's shadow as it is worked out.
#[derive(Debug, Default)]
pub struct Cast {
    places: Vec<Vec2>,
    /// By triangle: 1 where its shadow lies as it does in space, −1 where it is turned over, 0 where it has none.
    sides: Vec<i8>,
}

impl Outline {
    pub fn of(occluders: &Occluders) -> Self {
        let mut at_place = HashMap::with_capacity(occluders.corners.len());
        let mut corners = Vec::new();
        // Adding 0 makes −0 and 0 one.
        let one_of_place = |corner: &Vec3| {
            *at_place.entry((*corner + 0.0).to_array().map(f32::to_bits)).or_insert_with(|| {
                corners.push(*corner);
                corners.len() as u32 - 1
            })
        };
        let numbers: Vec<u32> = occluders.corners.iter().map(one_of_place).collect();
        let triangles: Vec<[u32; 3]> = occluders.triangles.iter().map(|t| t.map(|i| numbers[i as usize])).collect();
        let edges = edges(&triangles);
        Self { corners, triangles, edges }
    }

    /// Gives `each` edge of the shadow: from which place to which it runs, and by how many layers its two sides differ. `place_of`
    /// says where a corner's shadow falls; a triangle with a corner that has none is left out.
    pub fn cast(
        &self,
        cast: &mut Cast,
        place_of: impl Fn(Vec3) -> Option<Vec2>,
        mut each: impl FnMut(Vec2, Vec2, i32),
    ) {
        let Cast { places, sides } = cast;
        places.clear();
        places.extend(self.corners.iter().map(|corner| place_of(*corner).unwrap_or(Vec2::NAN)));
        sides.clear();
        // `array::map` is not inlined in a development build, whose units are optimised apart.
        sides.extend(self.triangles.iter().map(|&[a, b, c]| {
            let (a, b, c) = (places[a as usize], places[b as usize], places[c as usize]);
            let area = (b - a).perp_dot(c - a);
            i8::from(area > 0.0) - i8::from(area < 0.0)
        }));
        sides.push(0);
        for Edge { corners: [from, to], triangles: [along, against] } in &self.edges {
            let (along, against) = (sides[*along as usize], sides[*against as usize]);
            if along != against {
                each(places[*from as usize], places[*to as usize], i32::from(along - against));
            }
        }
    }
}

/// The edges of triangles. Where more than two meet in one they are taken two by two.
fn edges(triangles: &[[u32; 3]]) -> Vec<Edge> {
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
            let of = |list: &[([u32; 2], bool, u32)]| list.get(n).map_or(none, |(.., triangle)| *triangle);
            edges.push(Edge { corners: of_one[0].0, triangles: [of(along), of(against)] });
        }
    }
    edges
}
