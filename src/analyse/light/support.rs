//! Candidate places for virtual objects: the middles of large level surfaces.

use crate::fit::quantile::upper_median;
use std::collections::{BTreeMap, BTreeSet};

use glam::{DQuat, DVec3, IVec3};

use super::voxels::{SIDE_M, Voxel};

/// Cells of connected surfaces: sides along the surface and height, m.
const CELL_M: f64 = 0.1;
const CELL_HEIGHT_M: f64 = 0.05;
/// Smallest number of voxels in a cell.
const MIN_VOXELS_PER_CELL: usize = 4;
/// Smallest cosine of a level surface's normal with up.
const MIN_LEVEL_COS: f64 = 0.9;
/// Smallest area of supports besides the largest, m², and largest number of supports.
const MIN_SUPPORT_M2: f64 = 0.25;
const MAX_SUPPORTS: usize = 4;

/// A point on each support, the largest first. Without level surfaces, one in the middle of all
/// surfaces.
pub fn places(voxels: &[Voxel], up: DVec3) -> Vec<DVec3> {
    let turn = DQuat::from_rotation_arc(up, DVec3::Z);
    let scale = DVec3::new(CELL_M, CELL_M, CELL_HEIGHT_M);
    let mut cells: BTreeMap<[i32; 3], Vec<DVec3>> = BTreeMap::new();
    for voxel in voxels.iter().filter(|voxel| voxel.normal.dot(up) > MIN_LEVEL_COS) {
        let cell = ((turn * voxel.position_m) / scale).floor().as_ivec3();
        cells.entry(cell.to_array()).or_default().push(voxel.position_m);
    }
    cells.retain(|_, points| points.len() >= MIN_VOXELS_PER_CELL);
    let mut supports: Vec<Vec<DVec3>> = Vec::new();
    let mut unvisited: BTreeSet<[i32; 3]> = cells.keys().copied().collect();
    while let Some(first) = unvisited.pop_first() {
        let (mut open, mut support) = (vec![first], Vec::new());
        while let Some(cell) = open.pop() {
            support.extend(&cells[&cell]);
            open.extend(neighbours(cell).filter(|next| unvisited.remove(next)));
        }
        supports.push(support);
    }
    supports.sort_by_key(|support| std::cmp::Reverse(support.len()));
    let is_large = |support: &Vec<DVec3>| support.len() as f64 * SIDE_M * SIDE_M >= MIN_SUPPORT_M2;
    let kept = 1 + supports.iter().skip(1).take(MAX_SUPPORTS - 1).take_while(|support| is_large(support)).count();
    supports.truncate(kept);
    if supports.is_empty() {
        supports.push(voxels.iter().map(|voxel| voxel.position_m).collect());
    }
    supports.iter().filter_map(|support| middle(support)).collect()
}

/// The point nearest to the median. The median itself can lie outside of a concave surface.
fn middle(points: &[DVec3]) -> Option<DVec3> {
    let median_coordinate = |axis: usize| upper_median(points.iter().map(|at| at[axis]));
    let middle = DVec3::new(median_coordinate(0)?, median_coordinate(1)?, median_coordinate(2)?);
    points.iter().copied().min_by(|a, b| a.distance_squared(middle).total_cmp(&b.distance_squared(middle)))
}

fn neighbours(cell: [i32; 3]) -> impl Iterator<Item = [i32; 3]> {
    (0..27).map(move |n| (IVec3::from(cell) + IVec3::new(n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1)).to_array())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_on_large_levels_the_largest_first() {
        let level = |count: i32, at: DVec3| {
            let place = move |n: i32| at + 0.02 * DVec3::new(f64::from(n % count), f64::from(n / count), 0.0);
            (0..count * count).map(move |n| Voxel::of_surface(place(n), DVec3::Z, [0.5; 3]))
        };
        // The smallest is 0.3 m wide.
        let (small, large) = (DVec3::new(0.0, 3.0, 0.0), DVec3::new(2.0, 0.0, 0.7));
        let voxels: Vec<Voxel> = level(15, small).chain(level(40, DVec3::ZERO)).chain(level(60, large)).collect();
        let on_levels = places(&voxels, DVec3::Z);
        assert_eq!(on_levels.len(), 2, "{on_levels:?}");
        let expected = [DVec3::new(2.6, 0.6, 0.7), DVec3::new(0.4, 0.4, 0.0)];
        assert!(on_levels.iter().zip(expected).all(|(on_levels, at)| on_levels.distance(at) < 0.03), "{on_levels:?}");
        assert!(places(&[], DVec3::Z).is_empty());
        // Of a wall alone, its middle.
        let wall: Vec<Voxel> = level(10, DVec3::ZERO).map(|voxel| Voxel { normal: DVec3::X, ..voxel }).collect();
        let on_wall = places(&wall, DVec3::Z);
        assert!(on_wall.len() == 1 && on_wall[0].distance(DVec3::new(0.1, 0.1, 0.0)) < 0.02, "{on_wall:?}");
    }
}
