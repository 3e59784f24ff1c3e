//! Assembles crossings into a chessboard's grid.
//!
//! Two neighbours on a board are connected by an edge with one side bright and the other dark along
//! its whole length. So an edge starts at one corner with bright on its left and ends at its
//! neighbour with bright on the same side. Beyond a corner the colours change sides, so no corner
//! can be skipped. Corners that are linked this way are numbered from any one of them.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::f64::consts::TAU;

use glam::DVec2;

use super::corners::{Corner, corner_near};
use crate::grey_image::GreyImage;

/// Corners by column and row. Columns run along one axis of the board, and rows a quarter turn from
/// it, in the sense from x towards y.
pub type Grid = BTreeMap<(i32, i32), Corner>;

/// Grid steps to the neighbours, in the order of the edges (ascending by angle).
const DIRECTIONS: [(i32, i32); 4] = [(1, 0), (0, 1), (-1, 0), (0, -1)];
/// Number of nearest corners that are candidates for neighbours, also on a foreshortened board.
const NEIGHBOUR_CANDIDATES: usize = 32;
/// Largest angle between an edge and the direction to the neighbour, rad.
const MAX_AIM_ERROR_RAD: f64 = 0.30;
/// Positions at which the two sides of an edge are compared, as shares of its length.
const EDGE_POSITIONS: [f64; 5] = [0.2, 0.35, 0.5, 0.65, 0.8];
/// Smallest number of positions with the right sign.
const MIN_AGREEING: usize = 4;
/// Smallest mean difference of the two sides, as a share of the corners' contrast.
const MIN_EDGE_STEP: f64 = 0.25;
/// Range of the distance of the samples from the edge, px.
const SAMPLE_OFFSET_PX: (f64, f64) = (1.5, 3.0);
/// Largest distance of a corner from the midpoint of its two neighbours, as a share of their
/// distance.
const MAX_MIDPOINT_ERROR: f64 = 0.15;
/// Largest distance of a corner from the extrapolation of two neighbours in a row, as a share of
/// their distance.
const MAX_EXTRAPOLATION_ERROR: f64 = 0.45;
/// Smallest ratio of two neighbours' contrasts: light changes little over a square.
const MIN_CONTRAST_RATIO: f64 = 0.35;
/// Search radius for a missed corner around its predicted position, as a share of the distance to
/// the nearest neighbour.
const SEARCH_RADIUS_SHARE: f64 = 0.25;

/// The largest grid of these corners; empty if there is none.
pub fn largest_grid(blurred: &GreyImage, corners: &[Corner]) -> Grid {
    let links = links(blurred, corners);
    let mut visited = vec![false; corners.len()];
    let mut best = Grid::new();
    for start in 0..corners.len() {
        if visited[start] {
            continue;
        }
        let mut grid = number_component(start, corners, &links, &mut visited);
        if grid.len() > best.len() {
            prune(&mut grid);
            if grid.len() > best.len() {
                best = grid;
            }
        }
    }
    add_missed_corners(blurred, &mut best);
    prune(&mut best);
    best
}

/// The corner linked at each of a corner's four edges, and the index of that corner's edge.
type CornerLinks = Vec<[Option<(usize, usize)>; 4]>;

fn links(blurred: &GreyImage, corners: &[Corner]) -> CornerLinks {
    let mut nearest_to = Vec::new();
    let chosen: CornerLinks = (0..corners.len())
        .map(|own| {
            nearest_to.clear();
            nearest_to.extend((0..corners.len()).filter(|&n| n != own));
            let far = |&n: &usize| corners[n].at.distance_squared(corners[own].at);
            let order = |a: &usize, b: &usize| far(a).total_cmp(&far(b)).then(a.cmp(b));
            if nearest_to.len() > NEIGHBOUR_CANDIDATES {
                nearest_to.select_nth_unstable_by(NEIGHBOUR_CANDIDATES, order);
                nearest_to.truncate(NEIGHBOUR_CANDIDATES);
            }
            nearest_to.sort_by(order);
            std::array::from_fn(|edge| {
                nearest_to.iter().find_map(|&n| {
                    let (from, to) = joined(blurred, &corners[own], &corners[n])?;
                    (from == edge).then_some((n, to))
                })
            })
        })
        .collect();
    let mutual = |own: usize, edge: usize| chosen[own][edge].filter(|&(n, to)| chosen[n][to] == Some((own, edge)));
    (0..corners.len()).map(|own| std::array::from_fn(|edge| mutual(own, edge))).collect()
}

/// The edges that link two corners, if an edge of a board connects them.
fn joined(blurred: &GreyImage, one: &Corner, other: &Corner) -> Option<(usize, usize)> {
    let way = other.at - one.at;
    let aimed = |corner: &Corner, way: DVec2| {
        let angle_to_way = |edge: usize| {
            let turn = (corner.edges[edge] - way.to_angle()).rem_euclid(TAU);
            turn.min(TAU - turn)
        };
        (0..4)
            .min_by(|a, b| angle_to_way(*a).total_cmp(&angle_to_way(*b)))
            .filter(|edge| angle_to_way(*edge) < MAX_AIM_ERROR_RAD)
    };
    let (from, to) = (aimed(one, way)?, aimed(other, -way)?);
    let fainter = one.contrast.min(other.contrast);
    if fainter < MIN_CONTRAST_RATIO * one.contrast.max(other.contrast) {
        return None;
    }
    // The side after the edge at one end is the side before it at the other.
    let bright = one.bright_after(from);
    if bright == other.bright_after(to) {
        return None;
    }
    let length = way.length();
    let beside = way.perp() / length * (0.12 * length).clamp(SAMPLE_OFFSET_PX.0, SAMPLE_OFFSET_PX.1);
    let sign = if bright { 1.0 } else { -1.0 };
    let steps = EDGE_POSITIONS.map(|share| {
        let at = one.at + share * way;
        sign * (blurred.sample(at + beside) - blurred.sample(at - beside))
    });
    let agree = steps.iter().filter(|step| **step > 0.0).count() >= MIN_AGREEING;
    let mean = steps.iter().sum::<f64>() / steps.len() as f64;
    (agree && mean > MIN_EDGE_STEP * fainter).then_some((from, to))
}

/// Numbers the connected component of a corner.
fn number_component(start: usize, corners: &[Corner], links: &CornerLinks, visited: &mut [bool]) -> Grid {
    let mut grid = Grid::from([((0, 0), corners[start])]);
    visited[start] = true;
    // Corner, its grid position, and the direction of its first edge.
    let mut queue = VecDeque::from([(start, (0, 0), 0)]);
    while let Some((own, place, turned)) = queue.pop_front() {
        for (edge, link) in links[own].iter().enumerate() {
            let Some((next, back)) = *link else { continue };
            let way = (edge + turned) % 4;
            let there = (place.0 + DIRECTIONS[way].0, place.1 + DIRECTIONS[way].1);
            if !visited[next] && !grid.contains_key(&there) {
                visited[next] = true;
                grid.insert(there, corners[next]);
                // Its edge back points in the opposite direction.
                queue.push_back((next, there, (way + 2 + 4 - back) % 4));
            }
        }
    }
    grid
}

fn neighbour(grid: &Grid, place: (i32, i32), way: usize, steps: i32) -> Option<&Corner> {
    grid.get(&(place.0 + steps * DIRECTIONS[way].0, place.1 + steps * DIRECTIONS[way].1))
}

/// Removes corners that are not where their neighbours predict, worst first, and corners with a
/// single link. Keeps the largest connected component.
pub fn prune(grid: &mut Grid) {
    let uneven = |grid: &Grid, place: (i32, i32), corner: &Corner| {
        let at = |way: usize, steps: i32| neighbour(grid, place, way, steps).map(|other| other.at);
        let between = (0..2).filter_map(|way| {
            let (a, b) = (at(way, -1)?, at(way, 1)?);
            Some(corner.at.distance(0.5 * (a + b)) / a.distance(b).max(1e-9) / MAX_MIDPOINT_ERROR)
        });
        let after = (0..4).filter_map(|way| {
            let (one, two) = (at(way, 1)?, at(way, 2)?);
            Some(corner.at.distance(2.0 * one - two) / one.distance(two).max(1e-9) / MAX_EXTRAPOLATION_ERROR)
        });
        between.chain(after).fold(0.0, f64::max)
    };
    loop {
        let worst = grid.iter().map(|(place, corner)| (uneven(grid, *place, corner), *place));
        let worst = worst.max_by(|a, b| a.0.total_cmp(&b.0)).filter(|(off, _)| *off > 1.0);
        let hanging = |place: (i32, i32)| (0..4).filter(|way| neighbour(grid, place, *way, 1).is_some()).count() < 2;
        let gone = worst.map(|(_, place)| place).or_else(|| grid.keys().copied().find(|place| hanging(*place)));
        let Some(place) = gone else { break };
        grid.remove(&place);
    }
    let mut best = Vec::new();
    let mut left: BTreeSet<(i32, i32)> = grid.keys().copied().collect();
    while let Some(first) = left.pop_first() {
        let mut part = vec![first];
        let mut next = 0;
        while let Some((column, row)) = part.get(next).copied() {
            next += 1;
            part.extend(
                DIRECTIONS.map(|way| (column + way.0, row + way.1)).into_iter().filter(|place| left.remove(place)),
            );
        }
        if part.len() > best.len() {
            best = part;
        }
    }
    grid.retain(|place, _| best.contains(place));
}

/// Adds missed corners at the positions that their neighbours predict, until there are no more.
fn add_missed_corners(blurred: &GreyImage, grid: &mut Grid) {
    loop {
        let mut candidates: Vec<(i32, i32)> = grid
            .keys()
            .flat_map(|(column, row)| DIRECTIONS.map(|way| (column + way.0, row + way.1)))
            .filter(|place| !grid.contains_key(place))
            .collect();
        candidates.sort_unstable();
        candidates.dedup();
        let before = grid.len();
        for place in candidates {
            if let Some(corner) = find_missed(blurred, grid, place) {
                grid.insert(place, corner);
            }
        }
        if grid.len() == before {
            return;
        }
    }
}

fn find_missed(blurred: &GreyImage, grid: &Grid, place: (i32, i32)) -> Option<Corner> {
    let at = |way: usize, steps: i32| neighbour(grid, place, way, steps).map(|corner| corner.at);
    let straight = (0..4).filter_map(|way| {
        let (one, two) = (at(way, 1)?, at(way, 2)?);
        Some(at(way, 3).map_or(2.0 * one - two, |three| 3.0 * (one - two) + three))
    });
    let across = (0..4).filter_map(|way| {
        let side = DIRECTIONS[(way + 1) % 4];
        let diagonal = grid.get(&(place.0 + DIRECTIONS[way].0 + side.0, place.1 + DIRECTIONS[way].1 + side.1))?;
        Some(at(way, 1)? + at((way + 1) % 4, 1)? - diagonal.at)
    });
    let predicted: Vec<DVec2> = straight.chain(across).collect();
    if predicted.len() < 2 {
        return None;
    }
    let expected = predicted.iter().sum::<DVec2>() / predicted.len() as f64;
    let beside: Vec<&Corner> = (0..4).filter_map(|way| neighbour(grid, place, way, 1)).collect();
    let nearest = beside.iter().map(|corner| corner.at.distance(expected)).fold(f64::INFINITY, f64::min);
    let corner = corner_near(blurred, expected, (SEARCH_RADIUS_SHARE * nearest).max(1.5))?;
    beside.iter().all(|other| joined(blurred, &corner, other).is_some()).then_some(corner)
}

/// Distance from a corner to the nearest other line of the board, px; `None` for a corner alone.
pub fn clearance_px(grid: &Grid, place: (i32, i32)) -> Option<f64> {
    let own = grid.get(&place)?.at;
    let way = |way: usize| neighbour(grid, place, way, 1).map(|other| other.at - own);
    let nearest = (0..4).filter_map(way).map(DVec2::length).reduce(f64::min)?;
    let corners = (0..4).filter_map(|edge| {
        let (a, b) = (way(edge)?, way((edge + 1) % 4)?);
        Some(a.perp_dot(b).abs() / a.length().max(b.length()))
    });
    Some(corners.fold(nearest, f64::min))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// A rotated board of squares `side` px wide, with soft edges.
    fn board(columns: i32, rows: i32, side: f64, turn: f64) -> GreyImage {
        let x_axis = DVec2::from_angle(turn);
        GreyImage::from_fn(400, 300, |x, y| {
            let p = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - DVec2::new(200.0, 150.0);
            let (u, v) =
                (p.dot(x_axis) / side + 0.5 * f64::from(columns), p.dot(x_axis.perp()) / side + 0.5 * f64::from(rows));
            let inside = u > -0.5 && v > -0.5 && u < f64::from(columns) + 0.5 && v < f64::from(rows) + 0.5;
            let soft = |t: f64| ((PI * t).sin() * side).clamp(-1.0, 1.0);
            if inside { 120.0 + 80.0 * (soft(u) * soft(v)) as f32 } else { 200.0 }
        })
    }

    /// Objects beside a board may have crossings too. They are not part of the grid once they are
    /// disconnected.
    #[test]
    fn disconnected_corners_are_pruned() {
        let corner = |column: i32, row: i32| {
            let at = 20.0 * DVec2::new(f64::from(column), f64::from(row));
            ((column, row), Corner { at, edges: [-1.6, 0.0, 1.6, 3.1], bright_first: true, contrast: 90.0 })
        };
        let square = |from: i32, to: i32| (from..to).flat_map(move |c| (from..to).map(move |r| corner(c, r)));
        // A separate component of four corners, and a corner with a single link.
        let mut grid: Grid = square(0, 4).chain(square(7, 9)).chain([corner(4, 2)]).collect();
        // A corner at the border that is not where its neighbours predict.
        grid.get_mut(&(3, 0)).unwrap().at += DVec2::new(14.0, 0.0);
        prune(&mut grid);
        let expected: Grid = square(0, 4).filter(|(place, _)| *place != (3, 0)).collect();
        assert_eq!(grid.keys().collect::<Vec<_>>(), expected.keys().collect::<Vec<_>>());
    }

    #[test]
    fn board_is_numbered_at_any_rotation() {
        for step in 0..12 {
            let turn = f64::from(step) * TAU / 12.0 + 0.05;
            let picture = board(7, 5, 24.0, turn).blurred(super::super::corners::BLUR_PX);
            let corners = super::super::corners::detect(&picture);
            let grid = largest_grid(&picture, &corners);
            let (mut low, mut high) = ((0, 0), (0, 0));
            for (column, row) in grid.keys() {
                low = (low.0.min(*column), low.1.min(*row));
                high = (high.0.max(*column), high.1.max(*row));
            }
            let size = (high.0 - low.0 + 1, high.1 - low.1 + 1);
            assert!(grid.len() == 48 && (size == (8, 6) || size == (6, 8)), "{turn}: {} of {size:?}", grid.len());
            // Rows are a quarter turn from columns, and neighbours are a square apart.
            for (place, corner) in &grid {
                let way = |way: usize| neighbour(&grid, *place, way, 1).map(|other| other.at - corner.at);
                for length in (0..4).filter_map(way).map(DVec2::length) {
                    assert!((length - 24.0).abs() < 0.5, "{length}");
                }
                if let (Some(column), Some(row)) = (way(0), way(1)) {
                    assert!(column.perp_dot(row) > 500.0);
                }
            }
        }
    }
}
