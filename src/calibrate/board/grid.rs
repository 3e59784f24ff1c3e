//! From crossings to a chessboard's grid.
//!
//! Two neighbours on a board see each other along an edge: one side of it is bright all the way, the other dark. So an
//! edge leaves one corner with bright on its left and comes to its neighbour with bright on the same side; past a corner
//! the colours change sides, so none can be skipped. Corners that are joined this way are numbered from any of them.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::f64::consts::TAU;

use glam::DVec2;

use super::corners::{Corner, corner_near};
use super::plane::Plane;

/// Corners by column and row; from any of them columns count along its board's one axis, rows a quarter turn from x
/// towards y.
pub type Grid = BTreeMap<(i32, i32), Corner>;

/// The ways to the neighbours: the edges' order, ascending by angle.
const WAYS: [(i32, i32); 4] = [(1, 0), (0, 1), (-1, 0), (0, -1)];
/// Neighbours are among this many nearest corners, also on a board seen from the side.
const NEAREST: usize = 32;
/// An edge points to its neighbour to this angle, rad.
const AIMS: f64 = 0.30;
/// Where the two sides of an edge are compared, as shares of its length.
const ALONG: [f64; 5] = [0.2, 0.35, 0.5, 0.65, 0.8];
/// As many of those must differ the right way.
const AGREE: usize = 4;
/// And by this share of the corners' contrast in the mean.
const STEP: f64 = 0.25;
/// How far beside the edge they lie, px.
const BESIDE_PX: (f64, f64) = (1.5, 3.0);
/// A corner lies this close to the middle of its two neighbours, as a share of the way between them.
const UNEVEN: f64 = 0.15;
/// And this close to where two neighbours in a row say it comes next, as a share of the way between those.
const RAGGED: f64 = 0.45;
/// Of two neighbours the fainter has this share of the other's contrast: light changes little over a square.
const ALIKE: f64 = 0.35;
/// A corner that was missed lies this close to where its neighbours say, as a share of the way to the nearest.
const EXPECTED: f64 = 0.25;

/// The largest grid that these corners make; empty if there is none.
pub fn largest(blurred: &Plane, corners: &[Corner]) -> Grid {
    let links = links(blurred, corners);
    let mut seen = vec![false; corners.len()];
    let mut best = Grid::new();
    for start in 0..corners.len() {
        if seen[start] {
            continue;
        }
        let mut grid = numbered(start, corners, &links, &mut seen);
        if grid.len() > best.len() {
            prune(&mut grid);
            if grid.len() > best.len() {
                best = grid;
            }
        }
    }
    complete(blurred, &mut best);
    prune(&mut best);
    best
}

/// Of each corner's four edges, the corner that it leads to and by which of that one's edges.
type Links = Vec<[Option<(usize, usize)>; 4]>;

fn links(blurred: &Plane, corners: &[Corner]) -> Links {
    let mut nearest_to = Vec::new();
    let chosen: Links = (0..corners.len())
        .map(|own| {
            nearest_to.clear();
            nearest_to.extend((0..corners.len()).filter(|&n| n != own));
            let far = |&n: &usize| corners[n].at.distance_squared(corners[own].at);
            let order = |a: &usize, b: &usize| far(a).total_cmp(&far(b)).then(a.cmp(b));
            if nearest_to.len() > NEAREST {
                nearest_to.select_nth_unstable_by(NEAREST, order);
                nearest_to.truncate(NEAREST);
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

/// The edges by which two corners see each other, if an edge of a board joins them.
fn joined(blurred: &Plane, one: &Corner, other: &Corner) -> Option<(usize, usize)> {
    let way = other.at - one.at;
    let aimed = |corner: &Corner, way: DVec2| {
        let off = |edge: usize| {
            let turn = (corner.edges[edge] - way.to_angle()).rem_euclid(TAU);
            turn.min(TAU - turn)
        };
        (0..4).min_by(|a, b| off(*a).total_cmp(&off(*b))).filter(|edge| off(*edge) < AIMS)
    };
    let (from, to) = (aimed(one, way)?, aimed(other, -way)?);
    let fainter = one.contrast.min(other.contrast);
    if fainter < ALIKE * one.contrast.max(other.contrast) {
        return None;
    }
    // What lies after the edge as seen from one end lies before it as seen from the other.
    let bright = one.bright_after(from);
    if bright == other.bright_after(to) {
        return None;
    }
    let length = way.length();
    let beside = way.perp() / length * (0.12 * length).clamp(BESIDE_PX.0, BESIDE_PX.1);
    let sign = if bright { 1.0 } else { -1.0 };
    let steps = ALONG.map(|share| {
        let at = one.at + share * way;
        sign * (blurred.sample(at + beside) - blurred.sample(at - beside))
    });
    let agree = steps.iter().filter(|step| **step > 0.0).count() >= AGREE;
    let mean = steps.iter().sum::<f64>() / steps.len() as f64;
    (agree && mean > STEP * fainter).then_some((from, to))
}

/// Numbers all corners that are joined to one, over as many steps as it takes.
fn numbered(start: usize, corners: &[Corner], links: &Links, seen: &mut [bool]) -> Grid {
    let mut grid = Grid::from([((0, 0), corners[start])]);
    seen[start] = true;
    // Corner, its place, and the way in which its first edge leads.
    let mut queue = VecDeque::from([(start, (0, 0), 0)]);
    while let Some((own, place, turned)) = queue.pop_front() {
        for (edge, link) in links[own].iter().enumerate() {
            let Some((next, back)) = *link else { continue };
            let way = (edge + turned) % 4;
            let there = (place.0 + WAYS[way].0, place.1 + WAYS[way].1);
            if !seen[next] && !grid.contains_key(&there) {
                seen[next] = true;
                grid.insert(there, corners[next]);
                // Its edge back leads the opposite way.
                queue.push_back((next, there, (way + 2 + 4 - back) % 4));
            }
        }
    }
    grid
}

fn neighbour(grid: &Grid, place: (i32, i32), way: usize, steps: i32) -> Option<&Corner> {
    grid.get(&(place.0 + steps * WAYS[way].0, place.1 + steps * WAYS[way].1))
}

/// Takes out what does not lie where its neighbours say, worst first, what hangs by one edge, and what is then cut off
/// from the largest part.
pub fn prune(grid: &mut Grid) {
    let uneven = |grid: &Grid, place: (i32, i32), corner: &Corner| {
        let at = |way: usize, steps: i32| neighbour(grid, place, way, steps).map(|other| other.at);
        let between = (0..2).filter_map(|way| {
            let (a, b) = (at(way, -1)?, at(way, 1)?);
            Some(corner.at.distance(0.5 * (a + b)) / a.distance(b).max(1e-9) / UNEVEN)
        });
        let after = (0..4).filter_map(|way| {
            let (one, two) = (at(way, 1)?, at(way, 2)?);
            Some(corner.at.distance(2.0 * one - two) / one.distance(two).max(1e-9) / RAGGED)
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
            part.extend(WAYS.map(|way| (column + way.0, row + way.1)).into_iter().filter(|place| left.remove(place)));
        }
        if part.len() > best.len() {
            best = part;
        }
    }
    grid.retain(|place, _| best.contains(place));
}

/// Adds corners that were missed, where their neighbours say they are, until there are no more.
fn complete(blurred: &Plane, grid: &mut Grid) {
    loop {
        let mut wanted: Vec<(i32, i32)> = grid
            .keys()
            .flat_map(|(column, row)| WAYS.map(|way| (column + way.0, row + way.1)))
            .filter(|place| !grid.contains_key(place))
            .collect();
        wanted.sort_unstable();
        wanted.dedup();
        let before = grid.len();
        for place in wanted {
            if let Some(corner) = missed(blurred, grid, place) {
                grid.insert(place, corner);
            }
        }
        if grid.len() == before {
            return;
        }
    }
}

fn missed(blurred: &Plane, grid: &Grid, place: (i32, i32)) -> Option<Corner> {
    let at = |way: usize, steps: i32| neighbour(grid, place, way, steps).map(|corner| corner.at);
    let straight = (0..4).filter_map(|way| {
        let (one, two) = (at(way, 1)?, at(way, 2)?);
        Some(at(way, 3).map_or(2.0 * one - two, |three| 3.0 * (one - two) + three))
    });
    let across = (0..4).filter_map(|way| {
        let side = WAYS[(way + 1) % 4];
        let diagonal = grid.get(&(place.0 + WAYS[way].0 + side.0, place.1 + WAYS[way].1 + side.1))?;
        Some(at(way, 1)? + at((way + 1) % 4, 1)? - diagonal.at)
    });
    let said: Vec<DVec2> = straight.chain(across).collect();
    if said.len() < 2 {
        return None;
    }
    let expected = said.iter().sum::<DVec2>() / said.len() as f64;
    let beside: Vec<&Corner> = (0..4).filter_map(|way| neighbour(grid, place, way, 1)).collect();
    let nearest = beside.iter().map(|corner| corner.at.distance(expected)).fold(f64::INFINITY, f64::min);
    let corner = corner_near(blurred, expected, (EXPECTED * nearest).max(1.5))?;
    beside.iter().all(|other| joined(blurred, &corner, other).is_some()).then_some(corner)
}

/// The way to the nearest line of the board beside a corner, px; `None` for a corner alone.
pub fn room_px(grid: &Grid, place: (i32, i32)) -> Option<f64> {
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

    /// A board of squares `side` px wide, turned, with soft edges.
    fn board(columns: i32, rows: i32, side: f64, turn: f64) -> Plane {
        let x_axis = DVec2::from_angle(turn);
        Plane::new(400, 300, |x, y| {
            let p = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - DVec2::new(200.0, 150.0);
            let (u, v) =
                (p.dot(x_axis) / side + 0.5 * f64::from(columns), p.dot(x_axis.perp()) / side + 0.5 * f64::from(rows));
            let inside = u > -0.5 && v > -0.5 && u < f64::from(columns) + 0.5 && v < f64::from(rows) + 0.5;
            let soft = |t: f64| ((PI * t).sin() * side).clamp(-1.0, 1.0);
            if inside { 120.0 + 80.0 * (soft(u) * soft(v)) as f32 } else { 200.0 }
        })
    }

    /// Things beside a board may have crossings too: what is left of them after they were cut off is no part of it.
    #[test]
    fn what_hangs_together_with_nothing_is_left_out() {
        let corner = |column: i32, row: i32| {
            let at = 20.0 * DVec2::new(f64::from(column), f64::from(row));
            ((column, row), Corner { at, edges: [-1.6, 0.0, 1.6, 3.1], bright_first: true, contrast: 90.0 })
        };
        let square = |from: i32, to: i32| (from..to).flat_map(move |c| (from..to).map(move |r| corner(c, r)));
        // An island of four, and one corner that hangs by an edge.
        let mut grid: Grid = square(0, 4).chain(square(7, 9)).chain([corner(4, 2)]).collect();
        // One that lies elsewhere than its neighbours say, at the rim.
        grid.get_mut(&(3, 0)).unwrap().at += DVec2::new(14.0, 0.0);
        prune(&mut grid);
        let expected: Grid = square(0, 4).filter(|(place, _)| *place != (3, 0)).collect();
        assert_eq!(grid.keys().collect::<Vec<_>>(), expected.keys().collect::<Vec<_>>());
    }

    #[test]
    fn a_board_is_numbered_whichever_way_it_is_turned() {
        for step in 0..12 {
            let turn = f64::from(step) * TAU / 12.0 + 0.05;
            let picture = board(7, 5, 24.0, turn).blurred(super::super::corners::BLUR_PX);
            let corners = super::super::corners::corners(&picture);
            let grid = largest(&picture, &corners);
            let (mut low, mut high) = ((0, 0), (0, 0));
            for (column, row) in grid.keys() {
                low = (low.0.min(*column), low.1.min(*row));
                high = (high.0.max(*column), high.1.max(*row));
            }
            let size = (high.0 - low.0 + 1, high.1 - low.1 + 1);
            assert!(grid.len() == 48 && (size == (8, 6) || size == (6, 8)), "{turn}: {} of {size:?}", grid.len());
            // Rows come a quarter turn after columns, and neighbours are a square apart.
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
