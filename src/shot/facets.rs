//! Flat pieces of the real things beside an object, on which its shadow may fall: a box's side and its top, a wall, a monitor.
//!
//! Of the points around the object, but for those of what it stands on, the plane that most agree on is one (planes.rs), then that of
//! the rest, and so on. What is round is none. A piece that faces away from the object gets none of its shadow; to which side it
//! faces the cameras say that saw it.

use std::collections::HashSet;

use glam::{DVec2, DVec3};

use super::planes::{Point, agreed};
use super::points::FittedPlane;
use crate::scene::{Facet, Object, Scene, Support};

/// Pieces of an object's surroundings.
const MOST: usize = 4;
/// How far a shadow is looked after: times the object's longest side, at least and at most, metres.
const REACH: f64 = 1.5;
const LEAST_REACH_M: f64 = 0.1;
const MOST_REACH_M: f64 = 0.5;
/// Lower than this over what the object stands on is that, metres: there its own shadow is drawn (`TOLERANCE_M` of
/// shadow/receiver_mask.rs, twice).
const ABOVE_M: f64 = 0.03;
/// A piece is as large as this in both directions, metres, and so much of its rectangle was seen, in cells.
const LEAST_M: f64 = 0.04;
const FILLED: f64 = 0.4;
const CELL_M: f64 = 0.02;
/// So many of a piece's points may lie beyond each side of its rectangle.
const BEYOND: f64 = 0.01;
/// The object comes out before it as far as this, and does not reach through it farther than that, metres.
const LEAST_BEFORE_M: f64 = 0.005;
const DEEPEST_M: f64 = 0.015;
/// Its middle does not stand out before its rims, or lie behind them, by more than this share of what points may be off. Of a ball the
/// piece that is taken for flat does by 0.9.
const BULGE: f64 = 0.35;
/// Strays are points of no piece, of a round one, and of one whose normal has a larger cosine with a piece's own than this.
const LEANING: f64 = 0.5;
/// Of strays so many, as a share of a piece's points, may be this near before or behind its rectangle, metres.
const STRAYS: f64 = 0.3;
const BESIDE_M: f64 = 0.05;
/// Turns of the rectangle that are tried over a right angle.
const TURNS: usize = 36;
/// Normals are told apart in steps of this, as those of floors are.
const NORMAL_STEP: f64 = 1.0 / 512.0;

/// Those of an object that stands on `support`.
pub fn facets(scene: &Scene, object: &Object, support: &Support, points: &[Point]) -> Vec<Facet> {
    if object.shadowless {
        return Vec::new();
    }
    let (low, high) =
        object.points_m(scene).fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
    if !(low.is_finite() && high.is_finite()) {
        return Vec::new();
    }
    let reach_m = (REACH * (high - low).max_element()).clamp(LEAST_REACH_M, MOST_REACH_M);
    let height_m = |at_m: DVec3| support.normal.dot(at_m - support.point_m);
    let top_m = object.points_m(scene).map(height_m).fold(0.0, f64::max);
    // Light comes from above: what is far over the object gets no shadow of it.
    let heights_m = ABOVE_M..top_m + 0.5 * reach_m;
    let is_near = |at_m: DVec3| at_m.distance(at_m.clamp(low, high)) < reach_m;
    let near = points.iter().filter(|point| is_near(point.at_m) && heights_m.contains(&height_m(point.at_m)));
    let mut rest: Vec<Point> = near.copied().collect();
    let mut pieces = Vec::new();
    for _ in 0..MOST {
        let Some(plane) = agreed(&rest, |_| true) else { break };
        let (members, others): (Vec<_>, Vec<_>) = rest.iter().partition(|point| point.is_on(plane.normal, plane.d_m));
        pieces.push(Piece { shape: shape(&plane, &members), normal: plane.normal, members });
        rest = others;
    }
    let is_before = |facet: &Facet| {
        let Support { point_m, normal } = facet.plane;
        let (mut farthest_m, mut pierced) = (0.0f64, false);
        for off in object.points_m(scene).map(|at_m| at_m - point_m) {
            farthest_m = farthest_m.max(normal.dot(off));
            pierced |= normal.dot(off) < -DEEPEST_M && facet.contains(off);
        }
        farthest_m > LEAST_BEFORE_M && !pierced
    };
    // Small pieces of something round may pass for flat, and lean a little against each other. A box's faces lean by more.
    let is_whole = |piece: &Piece, facet: &Facet| {
        let bent = |other: &&Piece| {
            !std::ptr::eq(*other, piece)
                && (matches!(other.shape, Some(Shape::Round)) || other.normal.dot(piece.normal).abs() > LEANING)
        };
        let strays = pieces.iter().filter(bent).flat_map(|other| &other.members).chain(&rest);
        let is_close = |off: &DVec3| facet.plane.normal.dot(*off).abs() < BESIDE_M && facet.contains(*off);
        let strays = strays.map(|point| point.at_m - facet.plane.point_m).filter(is_close).count();
        (strays as f64) < STRAYS * piece.members.len() as f64
    };
    let facet = |piece: &Piece| match piece.shape {
        Some(Shape::Flat(facet)) if is_whole(piece, &facet) => Some(facet),
        _ => None,
    };
    pieces.iter().filter_map(facet).filter(is_before).collect()
}

/// Points that a plane goes through.
struct Piece {
    shape: Option<Shape>,
    normal: DVec3,
    members: Vec<Point>,
}

enum Shape {
    Flat(Facet),
    Round,
}

/// What points of a plane are, if they are one piece and large enough.
fn shape(plane: &FittedPlane, members: &[Point]) -> Option<Shape> {
    let middle = members.iter().map(|point| point.at_m).sum::<DVec3>() / members.len() as f64;
    let towards_eyes: f64 = members.iter().map(|point| plane.normal.dot(point.eye_m - point.at_m).signum()).sum();
    let normal = ((plane.normal * towards_eyes.signum() / NORMAL_STEP).round() * NORMAL_STEP).try_normalize()?;
    let x = normal.any_orthonormal_vector();
    let y = normal.cross(x);
    let places: Vec<DVec2> =
        members.iter().map(|point| point.at_m - middle).map(|off| DVec2::new(x.dot(off), y.dot(off))).collect();
    let turned = |n: usize| {
        let turn = DVec2::from_angle(std::f64::consts::FRAC_PI_2 * n as f64 / TURNS as f64);
        let [low, high] = extent(places.iter().map(|place| turn.rotate(*place)).collect());
        (turn, low, high)
    };
    let area = |(_, low, high): &(DVec2, DVec2, DVec2)| (*high - *low).element_product();
    let (turn, low_m, high_m) = (0..TURNS).map(turned).min_by(|a, b| area(a).total_cmp(&area(b)))?;
    let seen: HashSet<_> = places.iter().map(|place| (turn.rotate(*place) / CELL_M).floor().as_ivec2()).collect();
    let is_filled = seen.len() as f64 > FILLED * area(&(turn, low_m, high_m)) / (CELL_M * CELL_M);
    // The axis along which the turned x is counted.
    let along = (turn.x * x - turn.y * y).normalize();
    let facet = Facet { plane: Support { point_m: middle, normal }, along, low_m, high_m };
    let off_m = members.iter().map(|point| point.off_m).sum::<f64>() / members.len() as f64;
    let is_flat = [0, 1].into_iter().all(|axis| {
        let at = places.iter().zip(members).map(|(place, point)| {
            let share = (turn.rotate(*place)[axis] - low_m[axis]) / (high_m - low_m)[axis];
            (share, normal.dot(point.at_m - middle))
        });
        bulge_m(at) < BULGE * off_m
    });
    let is_large = (high_m - low_m).min_element() > LEAST_M;
    (is_filled && is_large).then_some(if is_flat { Shape::Flat(facet) } else { Shape::Round })
}

/// How far the middle third of heights over a line stands out before both others, or lies behind them.
fn bulge_m(heights: impl Iterator<Item = (f64, f64)>) -> f64 {
    let mut sums = [(0.0, 0.0); 2];
    for (share, height_m) in heights {
        let (sum, count) = &mut sums[usize::from((1.0 / 3.0..2.0 / 3.0).contains(&share))];
        (*sum, *count) = (*sum + height_m, *count + 1.0);
    }
    let [outer, middle] = sums.map(|(sum, count): (f64, f64)| sum / count.max(1.0));
    (middle - outer).abs()
}

/// The rectangle around most places.
fn extent(places: Vec<DVec2>) -> [DVec2; 2] {
    let beyond = (BEYOND * places.len() as f64) as usize;
    let of = |axis: usize| {
        let mut along: Vec<f64> = places.iter().map(|place| place[axis]).collect();
        let last = along.len() - 1 - beyond;
        [beyond, last].map(|n| *along.select_nth_unstable_by(n, f64::total_cmp).1)
    };
    let ([left, right], [low, high]) = (of(0), of(1));
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

    const FLOOR: Support = Support { point_m: DVec3::ZERO, normal: DVec3::Z };
    const EYE_M: DVec3 = DVec3::new(-1.0, -0.3, 1.0);

    /// Points of a rectangle, every 7 mm.
    fn rectangle(corner: DVec3, along: DVec3, up: DVec3) -> Vec<Point> {
        let steps = |side: DVec3| (side.length() / 0.007) as usize + 1;
        let at =
            |i: usize, j: usize| corner + along.normalize() * (0.007 * i as f64) + up.normalize() * (0.007 * j as f64);
        let places = (0..steps(along)).flat_map(|i| (0..steps(up)).map(move |j| (i, j)));
        places.map(|(i, j)| Point { at_m: at(i, j), off_m: 0.004, eye_m: EYE_M }).collect()
    }

    #[test]
    fn a_wall_and_a_box_s_top_are_found_with_their_sides_and_the_floor_is_not() {
        let floor = rectangle(DVec3::new(-0.3, -0.3, 0.0), 0.6 * DVec3::X, 0.6 * DVec3::Y);
        // A wall to the right, turned by 30°, and the top of a low box to the left.
        let along = DVec3::new(-0.5, 0.75f64.sqrt(), 0.0);
        let wall = rectangle(DVec3::new(0.18, -0.1, 0.0), 0.2 * along, 0.3 * DVec3::Z);
        let top = rectangle(DVec3::new(-0.2, -0.05, 0.05), 0.1 * DVec3::X, 0.12 * DVec3::Y);
        let scene = cube();
        let found = facets(&scene, &scene.objects[0], &FLOOR, &[floor, wall, top].concat());
        assert_eq!(found.len(), 2, "{found:?}");
        let (wall, top) = (found[0], found[1]);
        let towards = DVec3::new(-(0.75f64.sqrt()), -0.5, 0.0);
        assert!(wall.plane.normal.dot(towards) > 0.9999, "{wall:?}");
        // One side of its rectangle is upright, and it goes from 3 cm up to 17.5, half of the reach over the cube.
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

    /// Two sides and the top of a low carton, near the cube: each belongs to the others' rims.
    #[test]
    fn a_low_box_has_its_front_its_side_and_its_top() {
        let scene = cube();
        for high_m in [0.09, 0.1, 0.15] {
            let corner = DVec3::new(0.13, -0.1, 0.0);
            let (wide, deep, up) = (0.2 * DVec3::Y, 0.15 * DVec3::X, high_m * DVec3::Z);
            let parts = [(corner, wide, up), (corner, deep, up), (corner + up, deep, wide)];
            let points: Vec<Point> = parts.into_iter().flat_map(|(at, a, b)| rectangle(at, a, b)).collect();
            let found = facets(&scene, &scene.objects[0], &FLOOR, &points);
            let faces = |normal: DVec3| found.iter().any(|facet| facet.plane.normal.dot(normal) > 0.999);
            assert!(faces(DVec3::NEG_X), "{high_m}: {found:?}");
            // From its side and its top the cube is seen where it stands before them, or over them.
            assert_eq!((faces(DVec3::NEG_Y), faces(DVec3::Z)), (false, high_m < 0.1 - 0.005), "{high_m}: {found:?}");
        }
    }

    #[test]
    fn what_faces_away_is_far_or_is_hardly_there_gets_none() {
        let scene = cube();
        let of = |points: &[Point]| facets(&scene, &scene.objects[0], &FLOOR, points);
        let wall = |x: f64| rectangle(DVec3::new(x, -0.1, 0.0), 0.2 * DVec3::Y, 0.3 * DVec3::Z);
        assert_eq!(of(&wall(0.15)).len(), 1);
        assert_eq!(of(&wall(0.5)), [], "far away");
        assert_eq!(of(&wall(-0.15)), [], "its back was seen");
        let narrow = rectangle(DVec3::new(0.15, -0.1, 0.0), 0.2 * DVec3::Y, 0.04 * DVec3::Z);
        assert_eq!(of(&narrow), [], "a strip of a centimetre over the floor");
        let wall_into_it = rectangle(DVec3::new(0.02, -0.1, 0.0), 0.2 * DVec3::Y, 0.3 * DVec3::Z);
        assert_eq!(of(&wall_into_it), [], "the cube reaches through it");
        // A ball and a cup of 12 cm and 9 cm: pieces of them are flat within what points may be off.
        let round = |radius_m: f64, is_ball: bool| -> Vec<Point> {
            let at = |i: usize, j: usize| {
                let (around, up) = (0.05 * i as f64, 0.05 * j as f64 - 1.5);
                let wide = if is_ball { up.cos() } else { 1.0 };
                let high = if is_ball { up.sin() } else { up };
                let middle = DVec3::new(0.06 + radius_m, 0.0, 1.2 * radius_m);
                let at_m = middle - radius_m * DVec3::new(wide * around.cos(), wide * around.sin(), -high);
                Point { at_m, off_m: 0.006, eye_m: EYE_M }
            };
            (0..60).flat_map(|i| (0..60).map(move |j| at(i, j))).collect()
        };
        assert_eq!((of(&round(0.12, true)), of(&round(0.09, false))), (Vec::new(), Vec::new()));
        let bare = Object { shadowless: true, ..scene.objects[0].clone() };
        assert_eq!(facets(&scene, &bare, &FLOOR, &wall(0.15)), []);
    }
}
