//! Dominant planes of the room: floor, tables, walls, and which way is up by them.
//!
//! A small neighbourhood tilts with the sensor's waves, a systematic error of millimetres over
//! centimetres, and a ledge mixes two surfaces. A plane measured over a metre is known to a tenth
//! of a degree. So a dominant plane replaces a local fit if it explains nearly as many of the
//! points around.
//!
//! The planes are found one after another, each among the points of no earlier one (sequential
//! RANSAC; Fischler and Bolles 1981). The three points of a sample lie in one cell of a coarse
//! grid, so that small tables are found in large rooms (Myatt et al. 2002, NAPSAC).
//!
//! Not modelled: planes that end. A table's plane goes on beyond its rim.

use std::collections::{HashMap, HashSet};

use glam::{DVec3, IVec3};

use super::plane_fit::plane_through;
use super::ransac::{MeasuredPoint, best_hypothesis, random_index};
use crate::fit::quantile::upper_median;
use crate::plane::HessePlane;

/// Largest number of planes of a room.
const MAX_PLANES: usize = 8;
/// Smallest share of the room's points that makes a plane.
const MIN_PLANE_SHARE: f64 = 0.015;
/// Largest number of points to which planes are fitted.
const MAX_POINTS: usize = 20_000;
/// RANSAC iterations for each plane.
const ITERATIONS: usize = 600;
/// Least-squares fits to the largest connected component of the inliers of the one before.
const REFITS: usize = 4;
/// Largest number of searches for planes, including those that are too small.
const MAX_SEARCHES: usize = 24;
/// Side of the cells that contain a RANSAC sample's points, m.
const SAMPLE_CELL_M: f64 = 0.4;
/// Side of the cells by which a plane's points are connected, m.
const LINK_CELL_M: f64 = 0.1;
/// Smallest number of points that a dominant plane must explain to replace a local fit, as a share
/// of the local fit's inliers.
const MIN_OF_LOCAL: f64 = 0.85;
/// Smallest number of those points as a share of all points around.
const MIN_OF_ALL: f64 = 0.3;
/// Cosine of the largest angle between the normal of a level surface and the cameras' own up: 50°,
/// since people point cameras downwards.
const LEVEL_COSINE: f64 = 0.643;
/// The camera is upside down if surfaces that face against the guess have this many times the
/// points of those that face along it, and the largest of all is one of them: within 30°
/// (`OVERHEAD_COSINE`), or if no other surface that may be the ground of an upright camera has a
/// quarter of its points. A wall before a camera that points steeply downwards faces against the
/// guess, too.
const UPSIDE_DOWN_RATIO: usize = 4;
const OVERHEAD_COSINE: f64 = 0.866;
/// Smallest cosine between the guess and the normal of a possible ground.
const POSSIBLE_GROUND_COSINE: f64 = 0.3;

/// The planes of a room, in order of decreasing size, each with its number of points. Normals point
/// to the cameras that measured them.
#[derive(Clone, Debug, Default)]
pub struct RoomPlanes(Vec<(HessePlane, usize)>);

impl RoomPlanes {
    pub fn of(points: &[MeasuredPoint]) -> Self {
        let step = points.len().div_ceil(MAX_POINTS).max(1);
        let mut rest: Vec<MeasuredPoint> = points.iter().step_by(step).copied().collect();
        let min_points = ((MIN_PLANE_SHARE * rest.len() as f64) as usize).max(3);
        let mut planes = Vec::new();
        for _ in 0..MAX_SEARCHES {
            if planes.len() == MAX_PLANES || rest.len() < min_points {
                break;
            }
            let Some((plane, members)) = largest(&rest) else { break };
            if members.len() >= min_points {
                let towards_cameras: DVec3 =
                    members.iter().map(|n| (rest[*n].camera_m - rest[*n].at_m).normalize_or_zero()).sum();
                planes.push((plane.facing(towards_cameras), members.len()));
            }
            let members: HashSet<usize> = members.into_iter().collect();
            rest = rest.into_iter().enumerate().filter(|(n, _)| !members.contains(n)).map(|(_, point)| point).collect();
        }
        planes.sort_by_key(|(_, members)| std::cmp::Reverse(*members));
        Self(planes)
    }

    /// Replaces a local fit at `at_m` by the dominant plane that explains nearly as many of the
    /// points around, if it passes the position within their error. The plane is moved along its
    /// normal to their median: a rug on the floor is a few millimetres higher. Returns the local
    /// fit if there is none. `accepts` filters normals, independent of their sign.
    pub fn or_dominant(
        &self,
        local: HessePlane,
        at_m: DVec3,
        around: &[MeasuredPoint],
        accepts: impl Fn(DVec3) -> bool,
    ) -> HessePlane {
        let explained = |plane: &HessePlane| around.iter().filter(|point| point.is_inlier(plane)).count();
        let mean_error_m = around.iter().map(|point| point.tolerance_m).sum::<f64>() / around.len().max(1) as f64;
        let min_count = (MIN_OF_LOCAL * explained(&local) as f64).max(MIN_OF_ALL * around.len() as f64).max(1.0);
        let passes = |plane: &HessePlane| plane.height_m(at_m).abs() < mean_error_m;
        let candidates = self.0.iter().map(|(plane, _)| plane).filter(|plane| passes(plane) && accepts(plane.normal));
        let counted = candidates.map(|plane| (explained(plane), plane)).filter(|(count, _)| *count as f64 >= min_count);
        // The largest among those that explain equally many.
        let Some((_, plane)) = counted.rev().max_by_key(|(count, _)| *count) else { return local };
        let on = around.iter().filter(|point| point.is_inlier(plane));
        let offset_m = upper_median(on.map(|point| plane.normal.dot(point.at_m))).unwrap_or(plane.offset_m);
        HessePlane { offset_m, ..*plane }.facing(local.normal)
    }

    /// Up by the largest level surface; `guess` is the cameras' own up. Cameras see floors and
    /// tables rather than ceilings, so that surfaces against the guess mean an upside-down camera.
    /// `None` without level surfaces.
    pub fn up(&self, guess: DVec3) -> Option<DVec3> {
        let level = |up: DVec3| self.0.iter().filter(move |(plane, _)| plane.normal.dot(up) > LEVEL_COSINE);
        let count = |up: DVec3| level(up).map(|(_, members)| members).sum::<usize>();
        let is_overhead = self.0.first().is_some_and(|(largest, members)| {
            let against = largest.normal.dot(-guess);
            let may_be_ground = |(plane, count): &(HessePlane, usize)| {
                plane.normal.dot(guess) > POSSIBLE_GROUND_COSINE && UPSIDE_DOWN_RATIO * count > *members
            };
            against > OVERHEAD_COSINE || (against > LEVEL_COSINE && !self.0.iter().any(may_be_ground))
        });
        let is_upside_down = is_overhead && count(-guess) > UPSIDE_DOWN_RATIO * count(guess);
        let up = if is_upside_down { -guess } else { guess };
        // Planes are sorted by size.
        level(up).next().map(|(plane, _)| plane.normal)
    }
}

/// Up by a single surface: its normal if it is nearly level, else `guess`, the cameras' own up.
pub fn up_on_surface(normal: Option<DVec3>, guess: DVec3) -> DVec3 {
    let is_ground = |normal: &DVec3| normal.dot(guess) > LEVEL_COSINE || normal.dot(guess) < -OVERHEAD_COSINE;
    normal.filter(is_ground).unwrap_or(guess)
}

/// The plane with most inliers, fitted to its largest connected component: distant strays would
/// tilt a small table's. Also returns the indices of that component's points.
fn largest(points: &[MeasuredPoint]) -> Option<(HessePlane, Vec<usize>)> {
    let cells = by_cell(points, 0..points.len(), SAMPLE_CELL_M);
    let sample = |n: usize| {
        let a = points[random_index(3 * n, points.len())].at_m;
        let cell = &cells[&cell_of(a, SAMPLE_CELL_M)];
        let [b, c] = [1, 2].map(|k| points[cell[random_index(3 * n + k, cell.len())]].at_m);
        [a, b, c]
    };
    let mut plane = best_hypothesis(points, (0..ITERATIONS).map(sample), |_| true, 0)?;
    let mut members = Vec::new();
    for _ in 0..REFITS {
        members = largest_component(points, (0..points.len()).filter(|n| points[*n].is_inlier(&plane)));
        let places: Vec<DVec3> = members.iter().map(|n| points[*n].at_m).collect();
        plane = plane_through(&places).ok()?.plane.facing(plane.normal);
    }
    Some((plane, members))
}

/// The largest set of points, by index, whose cells are connected.
fn largest_component(points: &[MeasuredPoint], members: impl Iterator<Item = usize>) -> Vec<usize> {
    let mut cells = by_cell(points, members, LINK_CELL_M);
    let mut keys: Vec<IVec3> = cells.keys().copied().collect();
    keys.sort_by_key(|cell| cell.to_array());
    let mut best = Vec::new();
    for start in keys {
        let (mut component, mut open) = (cells.remove(&start).unwrap_or_default(), vec![start]);
        while let Some(cell) = open.pop() {
            let around = (0..27).map(|k| cell + IVec3::new(k % 3, k / 3 % 3, k / 9) - 1);
            for next in around {
                if let Some(more) = cells.remove(&next) {
                    component.extend(more);
                    open.push(next);
                }
            }
        }
        if component.len() > best.len() {
            best = component;
        }
    }
    best
}

fn cell_of(at_m: DVec3, side_m: f64) -> IVec3 {
    (at_m / side_m).floor().as_ivec3()
}

/// Points, by index, in the cells of a grid.
fn by_cell(points: &[MeasuredPoint], members: impl Iterator<Item = usize>, side_m: f64) -> HashMap<IVec3, Vec<usize>> {
    let mut cells: HashMap<IVec3, Vec<usize>> = HashMap::new();
    for n in members {
        cells.entry(cell_of(points[n].at_m, side_m)).or_default().push(n);
    }
    cells
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA_M: DVec3 = DVec3::new(0.0, -1.0, 1.2);

    /// Measured with a tolerance of 5 mm.
    fn point(at_m: DVec3) -> MeasuredPoint {
        MeasuredPoint { at_m, tolerance_m: 0.005, camera_m: CAMERA_M }
    }

    /// A floor of 2 m by 2 m with waves of 4 mm, 0.5 m long, every 2 cm, and a wall behind it.
    fn room() -> Vec<MeasuredPoint> {
        let wave = |x: f64| 0.004 * (std::f64::consts::TAU * x / 0.5).sin();
        let at = |n: i32| 0.02 * f64::from(n) - 1.0;
        let floor = (0..10_000).map(|n| (at(n % 100), at(n / 100))).map(|(x, y)| DVec3::new(x, y, wave(x)));
        let wall = (0..4000).map(|n| DVec3::new(at(n % 100), 1.0, 0.02 * f64::from(n / 100)));
        floor.chain(wall).map(point).collect()
    }

    const AROUND_M: f64 = 0.1;

    fn around(points: &[MeasuredPoint], at_m: DVec3) -> Vec<MeasuredPoint> {
        points.iter().filter(|point| point.at_m.distance(at_m) < AROUND_M).copied().collect()
    }

    fn local_fit(points: &[MeasuredPoint]) -> HessePlane {
        plane_through(&points.iter().map(|point| point.at_m).collect::<Vec<_>>()).unwrap().plane.facing(DVec3::Z)
    }

    #[test]
    fn room_planes_are_its_floor_and_its_wall() {
        let RoomPlanes(planes) = RoomPlanes::of(&room());
        let [(floor, on_floor), (wall, on_wall)] = planes[..] else { panic!("{planes:?}") };
        assert!(floor.normal.z > 0.99999 && floor.offset_m.abs() < 1e-3 && on_floor >= 10_000, "{floor:?} {on_floor}");
        assert!(wall.normal.y < -0.9999 && on_wall > 3500, "{wall:?} {on_wall}");
    }

    #[test]
    fn local_fit_on_a_wave_is_replaced_by_the_floor() {
        let room = room();
        let planes = RoomPlanes::of(&room);
        // At the wave's steepest point: 0.004·2π/0.5 is a slope of 2.9°.
        let near = around(&room, DVec3::ZERO);
        let local = local_fit(&near);
        assert!(local.normal.angle_between(DVec3::Z).to_degrees() > 2.0, "{local:?}");
        let or_dominant = planes.or_dominant(local, DVec3::ZERO, &near, |_| true);
        assert!(or_dominant.normal.angle_between(DVec3::Z).to_degrees() < 0.2, "{or_dominant:?}");
        assert!(or_dominant.offset_m.abs() < 1e-3, "{or_dominant:?}");
        // A rug of 3 mm gets the floor's plane, at its own height.
        let rug: Vec<MeasuredPoint> = near.iter().map(|p| MeasuredPoint { at_m: p.at_m.with_z(0.003), ..*p }).collect();
        let or_dominant = planes.or_dominant(local_fit(&rug), DVec3::new(0.0, 0.0, 0.003), &rug, |_| true);
        assert!((or_dominant.offset_m - 0.003).abs() < 5e-4, "{or_dominant:?}");
    }

    #[test]
    fn small_table_is_not_tilted_by_strays_at_its_height() {
        let mut room = room();
        let at = |n: i32| 0.02 * f64::from(n) - 0.2;
        let table = (0..400).map(|n| point(DVec3::new(at(n % 20), at(n / 20), 0.4)));
        // As many on a cupboard 1 m away, up to 4 cm higher.
        let cupboard = (0..400).map(|n| point(DVec3::new(0.9, at(n % 20), 0.4 + 1e-4 * f64::from(n))));
        room.extend(table.chain(cupboard));
        let RoomPlanes(planes) = RoomPlanes::of(&room);
        let table = planes.iter().find(|(plane, _)| plane.normal.z > 0.99 && (plane.offset_m - 0.4).abs() < 0.01);
        let tilt_deg = table.unwrap().0.normal.angle_between(DVec3::Z).to_degrees();
        assert!(tilt_deg < 0.1, "{tilt_deg}");
    }

    #[test]
    fn book_and_ramp_keep_their_own_planes() {
        let mut room = room();
        // 2 cm high and 14 cm wide, and a ramp of 12°.
        let is_on_book = |at: &DVec3| at.x.abs() < 0.07 && at.y.abs() < 0.07;
        room.iter_mut().filter(|p| is_on_book(&p.at_m)).for_each(|p| p.at_m.z = 0.02);
        let planes = RoomPlanes::of(&room);
        let near = around(&room, DVec3::new(0.0, 0.0, 0.02));
        let book = HessePlane { normal: DVec3::Z, offset_m: 0.02 };
        assert_eq!(planes.or_dominant(book, DVec3::new(0.0, 0.0, 0.02), &near, |_| true), book);
        let is_on_ramp = |at: &DVec3| (at.x - 0.5).abs() < 0.2 && at.y.abs() < 0.2;
        room.iter_mut()
            .filter(|p| is_on_ramp(&p.at_m))
            .for_each(|p| p.at_m.z = (p.at_m.x - 0.5) * 12f64.to_radians().tan());
        let near = around(&room, DVec3::new(0.5, 0.0, 0.0));
        let ramp = local_fit(&near);
        assert_eq!(planes.or_dominant(ramp, DVec3::new(0.5, 0.0, 0.0), &near, |_| true), ramp);
    }

    #[test]
    fn up_is_the_largest_level_planes_normal_even_for_an_upside_down_camera() {
        let planes = RoomPlanes::of(&room());
        for lean_deg in [-40f64, 0.0, 30.0] {
            let guess = DVec3::new(lean_deg.to_radians().sin(), 0.0, lean_deg.to_radians().cos());
            for guess in [guess, -guess] {
                let up = planes.up(guess).unwrap();
                assert!(up.angle_between(DVec3::Z).to_degrees() < 0.2, "{guess}: {up}");
            }
        }
        // A camera pitched down by 45° to 65°, towards floor and wall: its up leans to the wall.
        for pitch_deg in [45f64, 55.0, 65.0] {
            let guess = DVec3::new(0.0, pitch_deg.to_radians().sin(), pitch_deg.to_radians().cos());
            assert!(planes.up(guess).is_none_or(|up| up.z > 0.9999), "{pitch_deg}: {:?}", planes.up(guess));
        }
        let wall: Vec<MeasuredPoint> = room().into_iter().filter(|point| point.at_m.y == 1.0).collect();
        assert_eq!(RoomPlanes::of(&wall).up(DVec3::Z), None);
    }
}
