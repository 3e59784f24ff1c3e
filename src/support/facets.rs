//! Facets: flat parts of real objects beside a virtual object, which may receive its shadow: a
//! box's side and top, a wall, a monitor.
//!
//! They are found by sequential RANSAC among the points around the object, without those of its
//! support plane (ransac.rs). Round surfaces are rejected. A facet that faces away from the object
//! receives no shadow; its front is the side of the cameras that measured it.

use std::collections::HashSet;

use glam::{DVec2, DVec3};

use super::footprint::bounds;
use super::plane_fit::rounded_normal;
use super::ransac::{MeasuredPoint, ransac_plane};
use crate::depth::{MIN_HEIGHT_OVER_PLANE_M, PLANE_TOLERANCE_M};
use crate::plane::{HessePlane, Plane};
use crate::scene::{Facet, Object, Scene};

/// Largest number of facets of an object.
const MAX_FACETS: usize = 4;
/// Radius of the search for facets, as a multiple of the object's longest side, with its limits.
const REACH_PER_SIZE: f64 = 1.5;
const MIN_REACH_M: f64 = 0.1;
const MAX_REACH_M: f64 = 0.5;
/// Smallest side of a facet.
const MIN_SIDE_M: f64 = 0.04;
/// Smallest share of a facet's rectangle that contains points, by cells.
const MIN_FILLED_SHARE: f64 = 0.4;
/// Side of those cells.
const CELL_M: f64 = 0.02;
/// Share of a facet's points that may lie beyond each side of its rectangle.
const OUTSIDE_SHARE: f64 = 0.01;
/// Smallest distance to which the object extends in front of a facet.
const MIN_IN_FRONT_M: f64 = 0.005;
/// Largest depth to which the object may penetrate a facet.
const MAX_PENETRATION_M: f64 = PLANE_TOLERANCE_M;
/// Largest bulge of a facet's middle against its rims, relative to the tolerance of its points. For
/// a facet on a ball it is 0.9.
const MAX_BULGE: f64 = 0.35;
/// Cosine between two segments' normals from which on the points of one count as strays of the
/// other. Points of no segment and of round ones are strays too.
const SIMILAR_COSINE: f64 = 0.5;
/// Largest number of strays within `STRAY_DISTANCE_M` of a facet, relative to its own points.
const MAX_STRAYS: f64 = 0.3;
const STRAY_DISTANCE_M: f64 = 0.05;
/// Rotations of the rectangle that are tried over a right angle.
const ROTATIONS: usize = 36;

/// Facets around an object that stands on `support`.
pub fn facets(scene: &Scene, object: &Object, support: &Plane, points: &[MeasuredPoint]) -> Vec<Facet> {
    if object.shadowless {
        return Vec::new();
    }
    let (low, high) = bounds(object.points_m(scene));
    if !(low.is_finite() && high.is_finite()) {
        return Vec::new();
    }
    let reach_m = (REACH_PER_SIZE * (high - low).max_element()).clamp(MIN_REACH_M, MAX_REACH_M);
    let height_m = |at_m: DVec3| support.height_m(at_m);
    let top_m = object.points_m(scene).map(height_m).fold(0.0, f64::max);
    // Light comes from above: surfaces far above the object receive no shadow of it.
    let heights_m = MIN_HEIGHT_OVER_PLANE_M..top_m + 0.5 * reach_m;
    let is_near = |at_m: DVec3| at_m.distance(at_m.clamp(low, high)) < reach_m;
    let near = points.iter().filter(|point| is_near(point.at_m) && heights_m.contains(&height_m(point.at_m)));
    let mut rest: Vec<MeasuredPoint> = near.copied().collect();
    let mut segments = Vec::new();
    for _ in 0..MAX_FACETS {
        let Some(plane) = ransac_plane(&rest, |_| true) else { break };
        let (members, others): (Vec<_>, Vec<_>) = rest.iter().partition(|point| point.is_inlier(&plane));
        segments.push(PlaneSegment { shape: shape(&plane, &members), normal: plane.normal, members });
        rest = others;
    }
    let is_in_front = |facet: &Facet| {
        let Plane { point_m, normal } = facet.plane;
        let (mut farthest_m, mut penetrates) = (0.0f64, false);
        for off in object.points_m(scene).map(|at_m| at_m - point_m) {
            farthest_m = farthest_m.max(normal.dot(off));
            penetrates |= normal.dot(off) < -MAX_PENETRATION_M && facet.contains(off);
        }
        farthest_m > MIN_IN_FRONT_M && !penetrates
    };
    // Small segments of a round surface may pass for flat, at small angles to each other. The faces
    // of a box meet at larger angles.
    let is_isolated = |segment: &PlaneSegment, facet: &Facet| {
        let is_continued = |other: &&PlaneSegment| {
            !std::ptr::eq(*other, segment)
                && (matches!(other.shape, Some(SegmentShape::Round))
                    || other.normal.dot(segment.normal).abs() > SIMILAR_COSINE)
        };
        let strays = segments.iter().filter(is_continued).flat_map(|other| &other.members).chain(&rest);
        let is_close = |off: &DVec3| facet.plane.normal.dot(*off).abs() < STRAY_DISTANCE_M && facet.contains(*off);
        let strays = strays.map(|point| point.at_m - facet.plane.point_m).filter(is_close).count();
        (strays as f64) < MAX_STRAYS * segment.members.len() as f64
    };
    let facet = |segment: &PlaneSegment| match segment.shape {
        Some(SegmentShape::Flat(facet)) if is_isolated(segment, &facet) => Some(facet),
        _ => None,
    };
    segments.iter().filter_map(facet).filter(is_in_front).collect()
}

/// A plane with its inliers.
struct PlaneSegment {
    shape: Option<SegmentShape>,
    normal: DVec3,
    members: Vec<MeasuredPoint>,
}

enum SegmentShape {
    Flat(Facet),
    Round,
}

/// Classifies the inliers of a plane. `None` if they are too sparse or too small.
fn shape(plane: &HessePlane, members: &[MeasuredPoint]) -> Option<SegmentShape> {
    let middle = members.iter().map(|point| point.at_m).sum::<DVec3>() / members.len() as f64;
    let towards_cameras: f64 = members.iter().map(|point| plane.normal.dot(point.camera_m - point.at_m).signum()).sum();
    let normal = rounded_normal(plane.normal * towards_cameras.signum())?;
    let x = normal.any_orthonormal_vector();
    let y = normal.cross(x);
    let places: Vec<DVec2> =
        members.iter().map(|point| point.at_m - middle).map(|off| DVec2::new(x.dot(off), y.dot(off))).collect();
    let rotated = |n: usize| {
        let turn = DVec2::from_angle(std::f64::consts::FRAC_PI_2 * n as f64 / ROTATIONS as f64);
        let [low, high] = extent(places.iter().map(|place| turn.rotate(*place)).collect());
        (turn, low, high)
    };
    let area = |(_, low, high): &(DVec2, DVec2, DVec2)| (*high - *low).element_product();
    let (turn, low_m, high_m) = (0..ROTATIONS).map(rotated).min_by(|a, b| area(a).total_cmp(&area(b)))?;
    let cells: HashSet<_> = places.iter().map(|place| (turn.rotate(*place) / CELL_M).floor().as_ivec2()).collect();
    let is_filled = cells.len() as f64 > MIN_FILLED_SHARE * area(&(turn, low_m, high_m)) / (CELL_M * CELL_M);
    // The axis of the rotated x.
    let along = (turn.x * x - turn.y * y).normalize();
    let facet = Facet { plane: Plane { point_m: middle, normal }, along, low_m, high_m };
    let tolerance_m = members.iter().map(|point| point.tolerance_m).sum::<f64>() / members.len() as f64;
    let is_flat = [0, 1].into_iter().all(|axis| {
        let at = places.iter().zip(members).map(|(place, point)| {
            let share = (turn.rotate(*place)[axis] - low_m[axis]) / (high_m - low_m)[axis];
            (share, normal.dot(point.at_m - middle))
        });
        bulge_m(at) < MAX_BULGE * tolerance_m
    });
    let is_large = (high_m - low_m).min_element() > MIN_SIDE_M;
    (is_filled && is_large).then_some(if is_flat { SegmentShape::Flat(facet) } else { SegmentShape::Round })
}

/// Distance between the mean height of the middle third of a profile and that of its outer thirds.
fn bulge_m(heights: impl Iterator<Item = (f64, f64)>) -> f64 {
    let mut sums = [(0.0, 0.0); 2];
    for (share, height_m) in heights {
        let (sum, count) = &mut sums[usize::from((1.0 / 3.0..2.0 / 3.0).contains(&share))];
        (*sum, *count) = (*sum + height_m, *count + 1.0);
    }
    let [outer, middle] = sums.map(|(sum, count): (f64, f64)| sum / count.max(1.0));
    (middle - outer).abs()
}

/// The rectangle around most of the points.
fn extent(places: Vec<DVec2>) -> [DVec2; 2] {
    let beyond = (OUTSIDE_SHARE * places.len() as f64) as usize;
    let axis_extent = |axis: usize| {
        let mut along: Vec<f64> = places.iter().map(|place| place[axis]).collect();
        let last = along.len() - 1 - beyond;
        [beyond, last].map(|n| *along.select_nth_unstable_by(n, f64::total_cmp).1)
    };
    let ([left, right], [low, high]) = (axis_extent(0), axis_extent(1));
    [DVec2::new(left, low), DVec2::new(right, high)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Mesh, Part, Vertex};
    use glam::DAffine3;

    /// A cube of 10 cm that stands on z = 0 in the middle of the world.
    fn cube() -> Scene {
        let at = |i: u32| [0, 1, 2].map(|axis| if i >> axis & 1 == 1 { 0.05f32 } else { -0.05 });
        let vertices = (0..8).map(|i| Vertex { position: at(i), ..bytemuck::Zeroable::zeroed() }).collect();
        let mesh = Mesh { vertices, indices: (0..8).chain([0]).collect(), material: 0 };
        let part = Part { mesh: 0, world_from_mesh: DAffine3::from_translation(DVec3::new(0.0, 0.0, 0.05)) };
        Scene {
            meshes: vec![mesh.into()],
            objects: vec![Object { parts: vec![part], ..Object::default() }],
            ..Scene::default()
        }
    }

    const FLOOR: Plane = Plane { point_m: DVec3::ZERO, normal: DVec3::Z };
    const CAMERA_M: DVec3 = DVec3::new(-1.0, -0.3, 1.0);

    /// Points of a rectangle, every 7 mm.
    fn rectangle(corner: DVec3, along: DVec3, up: DVec3) -> Vec<MeasuredPoint> {
        let steps = |side: DVec3| (side.length() / 0.007) as usize + 1;
        let at =
            |i: usize, j: usize| corner + along.normalize() * (0.007 * i as f64) + up.normalize() * (0.007 * j as f64);
        let places = (0..steps(along)).flat_map(|i| (0..steps(up)).map(move |j| (i, j)));
        places.map(|(i, j)| MeasuredPoint { at_m: at(i, j), tolerance_m: 0.004, camera_m: CAMERA_M }).collect()
    }

    #[test]
    fn facets_of_a_wall_and_a_box_have_the_right_planes_and_sides() {
        let floor = rectangle(DVec3::new(-0.3, -0.3, 0.0), 0.6 * DVec3::X, 0.6 * DVec3::Y);
        // A wall to the right, turned by 30°, and the top of a low box to the left.
        let along = DVec3::new(-0.5, 0.75f64.sqrt(), 0.0);
        let wall = rectangle(DVec3::new(0.18, -0.1, 0.0), 0.2 * along, 0.3 * DVec3::Z);
        let top = rectangle(DVec3::new(-0.2, -0.05, 0.05), 0.1 * DVec3::X, 0.12 * DVec3::Y);
        let scene = cube();
        let facets = facets(&scene, &scene.objects[0], &FLOOR, &[floor, wall, top].concat());
        assert_eq!(facets.len(), 2, "{facets:?}");
        let (wall, top) = (facets[0], facets[1]);
        let towards = DVec3::new(-(0.75f64.sqrt()), -0.5, 0.0);
        assert!(wall.plane.normal.dot(towards) > 0.9999, "{wall:?}");
        // One side of its rectangle is upright, and it goes from 3 cm up to 17.5, half of the reach
        // over the cube.
        let upright = wall.along.z.abs().max(wall.plane.normal.cross(wall.along).z.abs());
        let size = wall.high_m - wall.low_m;
        assert!(upright > 0.999 && (size.max_element() - 0.2).abs() < 0.01, "{wall:?}");
        assert!((size.min_element() - 0.145).abs() < 0.012, "{wall:?}");
        assert!(top.plane.normal.z > 0.999 && (top.plane.point_m.z - 0.05).abs() < 0.001, "{top:?}");
        let corner = |x: f64, y: f64| {
            let at = DVec2::new(x, y);
            top.plane.point_m + at.x * top.along + at.y * top.plane.normal.cross(top.along)
        };
        for at in [corner(top.low_m.x, top.low_m.y), corner(top.high_m.x, top.high_m.y)] {
            let off = [(at.x + 0.2).abs().min((at.x + 0.1).abs()), (at.y + 0.05).abs().min((at.y - 0.07).abs())];
            assert!(off[0] < 0.008 && off[1] < 0.008, "{at}");
        }
    }

    /// Two sides and the top of a low carton near the cube: each meets the others at its rims.
    #[test]
    fn facets_of_a_low_box_are_its_faces_that_the_object_is_in_front_of() {
        let scene = cube();
        for high_m in [0.09, 0.1, 0.15] {
            let corner = DVec3::new(0.13, -0.1, 0.0);
            let (wide, deep, up) = (0.2 * DVec3::Y, 0.15 * DVec3::X, high_m * DVec3::Z);
            let parts = [(corner, wide, up), (corner, deep, up), (corner + up, deep, wide)];
            let points: Vec<MeasuredPoint> = parts.into_iter().flat_map(|(at, a, b)| rectangle(at, a, b)).collect();
            let facets = facets(&scene, &scene.objects[0], &FLOOR, &points);
            let faces = |normal: DVec3| facets.iter().any(|facet| facet.plane.normal.dot(normal) > 0.999);
            assert!(faces(DVec3::NEG_X), "{high_m}: {facets:?}");
            // The cube must be in front of a face, or above it.
            assert_eq!((faces(DVec3::NEG_Y), faces(DVec3::Z)), (false, high_m < 0.1 - 0.005), "{high_m}: {facets:?}");
        }
    }

    #[test]
    fn surface_that_faces_away_is_far_small_pierced_or_round_is_no_facet() {
        let scene = cube();
        let facets_of = |points: &[MeasuredPoint]| facets(&scene, &scene.objects[0], &FLOOR, points);
        let wall = |x: f64| rectangle(DVec3::new(x, -0.1, 0.0), 0.2 * DVec3::Y, 0.3 * DVec3::Z);
        assert_eq!(facets_of(&wall(0.15)).len(), 1);
        assert_eq!(facets_of(&wall(0.5)), [], "far away");
        assert_eq!(facets_of(&wall(-0.15)), [], "it faces away");
        let narrow = rectangle(DVec3::new(0.15, -0.1, 0.0), 0.2 * DVec3::Y, 0.04 * DVec3::Z);
        assert_eq!(facets_of(&narrow), [], "a strip of a centimetre over the floor");
        let wall_into_it = rectangle(DVec3::new(0.02, -0.1, 0.0), 0.2 * DVec3::Y, 0.3 * DVec3::Z);
        assert_eq!(facets_of(&wall_into_it), [], "the cube reaches through it");
        // A ball of 12 cm and a cup of 9 cm: parts of them are flat within the tolerance of the
        // points.
        let round = |radius_m: f64, is_ball: bool| -> Vec<MeasuredPoint> {
            let at = |i: usize, j: usize| {
                let (around, up) = (0.05 * i as f64, 0.05 * j as f64 - 1.5);
                let wide = if is_ball { up.cos() } else { 1.0 };
                let high = if is_ball { up.sin() } else { up };
                let middle = DVec3::new(0.06 + radius_m, 0.0, 1.2 * radius_m);
                let at_m = middle - radius_m * DVec3::new(wide * around.cos(), wide * around.sin(), -high);
                MeasuredPoint { at_m, tolerance_m: 0.006, camera_m: CAMERA_M }
            };
            (0..60).flat_map(|i| (0..60).map(move |j| at(i, j))).collect()
        };
        assert_eq!((facets_of(&round(0.12, true)), facets_of(&round(0.09, false))), (Vec::new(), Vec::new()));
        let bare = Object { shadowless: true, ..scene.objects[0].clone() };
        assert_eq!(facets(&scene, &bare, &FLOOR, &wall(0.15)), []);
    }
}
