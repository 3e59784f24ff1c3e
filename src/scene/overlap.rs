//! Finds objects that intersect each other.
//!
//! The intersection of both bounding boxes is sampled by a grid of lines along each axis in turn,
//! and the intervals inside both solids are compared on each line. Surface orientation determines
//! whether a line enters or leaves, which is robust to gaps and duplicate faces (winding numbers;
//! for volumes see Jacobson, Kavan and Sorkine-Hornung 2013). The depth of an overlap is the
//! minimum over the axes of the longest interval inside both: objects that touch or lean against
//! each other have none.
//!
//! Not detected: surfaces without an inside (sheets, open shells), and overlaps narrower than the
//! grid cells.

use glam::{DVec2, DVec3};

use super::{Object, Scene};
use crate::text::{millimetres, shown};

/// Two intersecting objects.
#[derive(Clone, Debug, PartialEq)]
pub struct Overlap {
    /// Indices into [`Scene::objects`], the lower one first.
    pub objects: [usize; 2],
    /// Minimum translation along a world axis that would separate them, metres.
    pub depth_m: f64,
}

impl Overlap {
    /// Message for the user.
    pub fn message(&self, scene: &Scene) -> String {
        let [a, b] = self.objects.map(|object| shown(&scene.objects[object].name));
        format!("{a} and {b} overlap by {}", millimetres(self.depth_m))
    }
}

/// Lines across the intersection of the boxes, per side.
const LINES_PER_SIDE: usize = 48;
/// Largest overlap that counts as contact: vertices are rounded, and positions are written to a
/// tenth of a millimetre.
const MAX_CONTACT_DEPTH_M: f64 = 5e-4;
/// Maximum number of tested pairs.
const MAX_PAIRS: usize = 4096;

type TriangleCorners = [DVec3; 3];

struct Solid {
    low: DVec3,
    high: DVec3,
    triangles: Vec<TriangleCorners>,
}

/// All pairs of intersecting objects, in order.
pub fn overlaps(scene: &Scene) -> Vec<Overlap> {
    let solids: Vec<Option<Solid>> = scene.objects.iter().map(|object| solid(scene, object)).collect();
    let mut order: Vec<(usize, &Solid)> =
        solids.iter().enumerate().filter_map(|(i, s)| Some((i, s.as_ref()?))).collect();
    order.sort_by(|a, b| a.1.low.x.total_cmp(&b.1.low.x));
    let near = order.iter().enumerate().flat_map(|(n, (i, a))| {
        order[n + 1..]
            .iter()
            .take_while(|(_, b)| b.low.x < a.high.x - MAX_CONTACT_DEPTH_M)
            .map(move |(j, b)| (*i, *a, *j, *b))
    });
    let pairs = near.take(MAX_PAIRS).filter_map(|(i, a, j, b)| {
        let depth_m = intersection_depth(a, b)?;
        Some(Overlap { objects: [i.min(j), i.max(j)], depth_m })
    });
    let mut pairs: Vec<_> = pairs.collect();
    pairs.sort_by_key(|overlap| overlap.objects);
    pairs
}

fn solid(scene: &Scene, object: &Object) -> Option<Solid> {
    let triangles: Vec<TriangleCorners> = object
        .parts
        .iter()
        .flat_map(|part| {
            let mesh = &scene.meshes[part.mesh];
            let corner = |i: u32| {
                let position = mesh.vertices[i as usize].position.map(f64::from);
                part.world_from_mesh.transform_point3(DVec3::from(position))
            };
            // A mirrored mesh is inside out.
            let mirrored = part.world_from_mesh.matrix3.determinant() < 0.0;
            mesh.indices.chunks_exact(3).map(move |t| {
                let [a, b, c] = [corner(t[0]), corner(t[1]), corner(t[2])];
                if mirrored { [a, c, b] } else { [a, b, c] }
            })
        })
        .collect();
    let (low, high) = triangles
        .iter()
        .flatten()
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(*p), high.max(*p)));
    low.is_finite().then_some(Solid { low, high, triangles })
}

/// Depth of the intersection of two solids; `None` for contact or separation.
fn intersection_depth(a: &Solid, b: &Solid) -> Option<f64> {
    let (low, high) = (a.low.max(b.low), a.high.min(b.high));
    if !(high - low).cmpgt(DVec3::splat(MAX_CONTACT_DEPTH_M)).all() {
        return None;
    }
    let mut shortest = f64::INFINITY;
    for axis in 0..3 {
        let longest = along_axis(a, b, low, high, axis);
        if longest <= MAX_CONTACT_DEPTH_M {
            return None;
        }
        shortest = shortest.min(longest);
    }
    Some(shortest)
}

/// Longest interval along an axis that is inside both.
fn along_axis(a: &Solid, b: &Solid, low: DVec3, high: DVec3, axis: usize) -> f64 {
    let turned = |p: DVec3| DVec3::new(p[(axis + 1) % 3], p[(axis + 2) % 3], p[axis]);
    let (low, high) = (turned(low), turned(high));
    let step = (high - low).truncate() / LINES_PER_SIDE as f64;
    let lines = [a, b].map(|solid| {
        let mut lines: Vec<Vec<(f64, i32)>> = vec![Vec::new(); LINES_PER_SIDE * LINES_PER_SIDE];
        for triangle in &solid.triangles {
            add_crossings(triangle.map(turned), low.truncate(), step, &mut lines);
        }
        lines
    });
    let [in_a, in_b] = lines;
    in_a.into_iter()
        .zip(in_b)
        .map(|(a, b)| longest_common_interval(&inside_intervals(a), &inside_intervals(b)))
        .fold(0.0, f64::max)
}

/// Records where a triangle crosses lines along z, and whether they enter.
fn add_crossings([a, b, c]: TriangleCorners, low: DVec2, step: DVec2, lines: &mut [Vec<(f64, i32)>]) {
    let [p, q, r] = [a, b, c].map(|corner| corner.truncate());
    let area = (q - p).perp_dot(r - p);
    // Lines are offset from the cell centres, so that none runs along an edge shared by two
    // triangles.
    let first = low + step * DVec2::new(0.4871, 0.5237);
    let from = ((p.min(q).min(r) - first) / step).ceil().max(DVec2::ZERO);
    let to = ((p.max(q).max(r) - first) / step).floor().min(DVec2::splat(LINES_PER_SIDE as f64 - 1.0));
    if area == 0.0 || !(from.cmple(to).all()) {
        return;
    }
    for y in from.y as usize..=to.y as usize {
        for x in from.x as usize..=to.x as usize {
            let at = first + step * DVec2::new(x as f64, y as f64);
            let u = (r - q).perp_dot(at - q) / area;
            let v = (p - r).perp_dot(at - r) / area;
            let w = 1.0 - u - v;
            if u >= 0.0 && v >= 0.0 && w >= 0.0 {
                // Counter-clockwise seen from +z: the outside is above, and the line leaves.
                lines[y * LINES_PER_SIDE + x].push((u * a.z + v * b.z + w * c.z, if area > 0.0 { -1 } else { 1 }));
            }
        }
    }
}

/// Intervals of a line inside the solid. Unbalanced crossings give none.
fn inside_intervals(mut crossings: Vec<(f64, i32)>) -> Vec<[f64; 2]> {
    if crossings.iter().map(|(_, way)| way).sum::<i32>() != 0 {
        return Vec::new();
    }
    crossings.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut winding, mut entered) = (0, 0.0);
    let mut stretches = Vec::new();
    for (at, way) in crossings {
        let before = winding;
        winding += way;
        match (before, winding) {
            (0, _) => entered = at,
            (_, 0) => stretches.push([entered, at]),
            _ => {}
        }
    }
    stretches
}

fn longest_common_interval(a: &[[f64; 2]], b: &[[f64; 2]]) -> f64 {
    let pairs = a.iter().flat_map(|a| b.iter().map(move |b| a[1].min(b[1]) - a[0].max(b[0])));
    pairs.fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Mesh, Part, Vertex};
    use glam::{DAffine3, DQuat};

    /// Cubes of 1 m around their origins, each with a transform.
    fn cubes(placed: &[DAffine3]) -> Scene {
        let vertex = |i: u32| {
            let side = |bit: u32| if i >> bit & 1 == 1 { 0.5 } else { -0.5 };
            Vertex { position: [side(0), side(1), side(2)], ..bytemuck::Zeroable::zeroed() }
        };
        // Counter-clockwise seen from outside.
        let squares = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let indices = squares.iter().flat_map(|s: &[u32; 4]| [s[0], s[1], s[2], s[0], s[2], s[3]]).collect();
        let mesh = Mesh { vertices: (0..8).map(vertex).collect(), indices, material: 0 };
        let object =
            |at: &DAffine3| Object { parts: vec![Part { mesh: 0, world_from_mesh: *at }], ..Object::default() };
        Scene { meshes: vec![mesh.into()], objects: placed.iter().map(object).collect(), ..Scene::default() }
    }

    fn at(x: f64, y: f64, z: f64) -> DAffine3 {
        DAffine3::from_translation(DVec3::new(x, y, z))
    }

    fn sized(size: [f64; 3], place: DAffine3) -> DAffine3 {
        place * DAffine3::from_scale(size.into())
    }

    #[test]
    fn overlap_depth_is_found_for_intersecting_solids() {
        let pairs = overlaps(&cubes(&[at(0.0, 0.0, 0.0), at(5.0, 0.0, 0.0), at(0.2, 0.3, 0.9)]));
        assert_eq!(pairs.iter().map(|o| o.objects).collect::<Vec<_>>(), [[0, 2]]);
        assert!((pairs[0].depth_m - 0.1).abs() < 1e-9, "{pairs:?}");
        // Entirely inside, mirrored, and rotated: a bar through a slab, without a vertex in it.
        let inside = overlaps(&cubes(&[at(0.0, 0.0, 0.0), sized([-0.1, 0.2, 0.3], at(0.1, 0.0, 0.0))]));
        assert!((inside[0].depth_m - 0.1).abs() < 1e-9, "{inside:?}");
        let bar = DAffine3::from_quat(DQuat::from_rotation_z(0.7)) * sized([3.0, 0.05, 0.05], at(0.0, 0.0, 0.0));
        let through = overlaps(&cubes(&[sized([1.0, 1.0, 0.02], at(0.0, 0.0, 0.0)), bar]));
        assert!((through[0].depth_m - 0.02).abs() < 1e-9, "{through:?}");
    }

    #[test]
    fn solids_in_contact_do_not_overlap() {
        let turn = DAffine3::from_quat(DQuat::from_rotation_z(std::f64::consts::FRAC_PI_4));
        let beside = turn * at(1.0, 0.0, 0.0) * turn.inverse() * turn;
        let cases = [
            // On top, and a tenth of a millimetre into it; side by side along a diagonal; corners;
            // within a box's empty corner.
            vec![at(0.0, 0.0, 0.0), at(0.1, -0.2, 1.0)],
            vec![at(0.0, 0.0, 0.0), at(0.1, -0.2, 0.9999)],
            vec![turn, beside],
            vec![at(0.0, 0.0, 0.0), at(1.0, 1.0, 1.0)],
            vec![turn, sized([0.2, 0.2, 0.2], at(0.6, 0.6, 0.0))],
        ];
        for placed in cases {
            assert_eq!(overlaps(&cubes(&placed)), [], "{placed:?}");
        }
        // A shell with a missing side has no inside.
        let mut open = cubes(&[at(0.0, 0.0, 0.0), at(0.2, 0.0, 0.3)]);
        std::sync::Arc::make_mut(&mut open.meshes[0]).indices.truncate(30);
        assert_eq!(overlaps(&open), []);
        assert_eq!(overlaps(&Scene::default()), []);
    }
}
