//! Outline of a figure that is made of triangles in the plane.
//!
//! The triangles are rasterized into a grid of cells, and the border of the filled cells is traced.
//! So the outline is that of the union of all triangles, independent of order, winding and gaps, at
//! the resolution of a cell.

use glam::DVec2;

use crate::pixels::Rect;

/// Largest side of the grid, approximately, cells.
const MAX_SIDE_CELLS: f64 = 768.0;
/// Highest resolution, cells per px.
const MAX_CELLS_PER_PX: f64 = 4.0;
/// Tolerance of the polygon simplification, cells.
const SIMPLIFY_CELLS: f64 = 0.75;

/// Closed polygons, px, around the part of the triangles that lies in `within`, and around its
/// holes.
pub fn outline(triangles: &[[DVec2; 3]], within: &Rect) -> Vec<Vec<DVec2>> {
    let (low, high) = triangles
        .iter()
        .flatten()
        .fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), p| (low.min(*p), high.max(*p)));
    let low = low.max(DVec2::new(within.x0.into(), within.y0.into()));
    let high = high.min(DVec2::new(within.x1.into(), within.y1.into()));
    if !(low.cmple(high).all() && low.is_finite() && high.is_finite()) {
        return Vec::new();
    }
    let per_px = (MAX_SIDE_CELLS / (high - low).max_element().max(1.0)).min(MAX_CELLS_PER_PX);
    // A margin of empty cells, so that every border closes.
    let size = ((high - low) * per_px).ceil() + 3.0;
    let mut grid = FilledGrid { width: size.x as usize, height: size.y as usize, filled: Vec::new() };
    grid.filled = vec![false; grid.width * grid.height];
    for triangle in triangles {
        grid.fill(triangle.map(|p| (p - low) * per_px + 1.0));
    }
    grid.clear_rim();
    let polygons = grid.borders().into_iter().map(|border| simplified(&border));
    polygons.map(|polygon| polygon.into_iter().map(|p| (p - 1.0) / per_px + low).collect()).collect()
}

struct FilledGrid {
    width: usize,
    height: usize,
    filled: Vec<bool>,
}

impl FilledGrid {
    fn is_filled(&self, x: i64, y: i64) -> bool {
        let inside = x >= 0 && y >= 0 && x < self.width as i64 && y < self.height as i64;
        inside && self.filled[y as usize * self.width + x as usize]
    }

    /// Fills the cells whose middle lies in the triangle, and those on its sides, so that thin
    /// triangles are visible.
    fn fill(&mut self, triangle: [DVec2; 3]) {
        let [a, b, c] = triangle;
        let low = a.min(b).min(c).max(DVec2::ZERO);
        let high = a.max(b).max(c).min(DVec2::new(self.width as f64, self.height as f64) - 1.0);
        for y in low.y as usize..=high.y.max(0.0) as usize {
            let middle = y as f64 + 0.5;
            let sides = [(a, b), (b, c), (c, a)].into_iter();
            let crossed = sides.filter(|(p, q)| (p.y <= middle) != (q.y <= middle));
            let crossings = crossed.map(|(p, q)| p.x + (middle - p.y) / (q.y - p.y) * (q.x - p.x));
            let (from, to) = crossings.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
            let (from, to) = ((from - 0.5).ceil().max(0.0), (to - 0.5).floor().min(high.x));
            if from <= to && y < self.height {
                self.filled[y * self.width + from as usize..=y * self.width + to as usize].fill(true);
            }
        }
        for (p, q) in [(a, b), (b, c), (c, a)] {
            self.line(p, q);
        }
    }

    fn line(&mut self, p: DVec2, q: DVec2) {
        let size = DVec2::new(self.width as f64, self.height as f64);
        // Clipping to the grid (Liang and Barsky 1984).
        let (mut from, mut to) = (0.0f64, 1.0f64);
        for (start, along, end) in [(p.x, q.x - p.x, size.x), (p.y, q.y - p.y, size.y)] {
            if along == 0.0 && !(0.0..end).contains(&start) {
                return;
            }
            if along != 0.0 {
                let (enters, leaves) = (-start / along, (end - start) / along);
                (from, to) = (from.max(enters.min(leaves)), to.min(enters.max(leaves)));
            }
        }
        if from > to {
            return;
        }
        let (p, q) = (p.lerp(q, from), p.lerp(q, to));
        // Steps of half a cell, so that no cell is skipped.
        let steps = (2.0 * (q - p).abs().max_element()).ceil().max(1.0) as usize;
        for n in 0..=steps {
            let at = p.lerp(q, n as f64 / steps as f64);
            let (x, y) = ((at.x as usize).min(self.width - 1), (at.y as usize).min(self.height - 1));
            self.filled[y * self.width + x] = true;
        }
    }

    fn clear_rim(&mut self) {
        let (width, height) = (self.width, self.height);
        self.filled[..width].fill(false);
        self.filled[(height - 1) * width..].fill(false);
        for y in 0..height {
            self.filled[y * width] = false;
            self.filled[y * width + width - 1] = false;
        }
    }

    /// Traces the middles of the sides between filled and empty cells in order, with the filled
    /// cells on the right.
    fn borders(&self) -> Vec<Vec<DVec2>> {
        const RIGHT: (i64, i64) = (1, 0);
        let mut visited = vec![false; self.filled.len()];
        let mut borders = Vec::new();
        for (x, y) in (0..self.height as i64).flat_map(|y| (0..self.width as i64).map(move |x| (x, y))) {
            // Every border has a side along the top of a filled cell. It begins at the first of
            // them.
            if !self.is_filled(x, y) || self.is_filled(x, y - 1) || visited[y as usize * self.width + x as usize] {
                continue;
            }
            let (mut corner, mut way) = ((x, y), RIGHT);
            let mut border = Vec::new();
            loop {
                if way == RIGHT {
                    let cell = &mut visited[corner.1 as usize * self.width + corner.0 as usize];
                    if *cell {
                        break;
                    }
                    *cell = true;
                }
                border.push(DVec2::new(corner.0 as f64 + 0.5 * way.0 as f64, corner.1 as f64 + 0.5 * way.1 as f64));
                corner = (corner.0 + way.0, corner.1 + way.1);
                // The cells ahead on the right and on the left of the direction; y points down.
                let right = (-way.1, way.0);
                let ahead = |side: i64| {
                    let middle = |at: i64, way: i64, right: i64| (2 * at + way + side * right).div_euclid(2);
                    self.is_filled(middle(corner.0, way.0, right.0), middle(corner.1, way.1, right.1))
                };
                way = match (ahead(1), ahead(-1)) {
                    // Filled cells that touch at a corner are connected.
                    (_, true) => (-right.0, -right.1),
                    (true, false) => way,
                    (false, false) => right,
                };
            }
            borders.push(border);
        }
        borders
    }
}

/// Simplifies a closed polygon (Douglas and Peucker 1973).
fn simplified(points: &[DVec2]) -> Vec<DVec2> {
    let Some(first) = points.first() else { return Vec::new() };
    let far = |a: &(usize, &DVec2), b: &(usize, &DVec2)| a.1.distance(*first).total_cmp(&b.1.distance(*first));
    let opposite = points.iter().enumerate().max_by(far).map_or(0, |(i, _)| i);
    let mut kept = vec![false; points.len()];
    let mut stretches = vec![(0, opposite), (opposite, points.len())];
    while let Some((from, to)) = stretches.pop() {
        kept[from % points.len()] = true;
        let (a, b) = (points[from], points[to % points.len()]);
        let along = (b - a).normalize_or_zero();
        let distance = |p: DVec2| if along == DVec2::ZERO { p.distance(a) } else { (p - a).perp_dot(along).abs() };
        let farthest = (from + 1..to).map(|i| (i, distance(points[i]))).max_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((i, _)) = farthest.filter(|(_, far)| *far > SIMPLIFY_CELLS) {
            stretches.extend([(from, i), (i, to)]);
        }
    }
    points.iter().zip(kept).filter(|(_, kept)| *kept).map(|(p, _)| *p).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const PICTURE: Rect = Rect { x0: 0, y0: 0, x1: 640, y1: 480 };

    fn square(low: f64, high: f64) -> [[DVec2; 3]; 2] {
        let [a, b, c, d] = [(low, low), (high, low), (high, high), (low, high)].map(DVec2::from);
        [[a, b, c], [a, c, d]]
    }

    /// Twice the area, signed by the winding.
    fn area(polygon: &[DVec2]) -> f64 {
        polygon.iter().zip(polygon.iter().cycle().skip(1)).map(|(a, b)| a.perp_dot(*b)).sum()
    }

    #[test]
    fn outline_of_a_square_has_four_corners_and_overlapping_figures_share_one() {
        let borders = outline(&square(100.0, 140.0), &PICTURE);
        assert_eq!(borders.len(), 1);
        for corner in [(100.0, 100.0), (140.0, 100.0), (140.0, 140.0), (100.0, 140.0)].map(DVec2::from) {
            // Within a cell, at 4 cells/px, and the cell's corner that is cut off.
            assert!(borders[0].iter().any(|p| p.distance(corner) < 0.5), "{corner}: {borders:?}");
        }
        assert!((0.5 * area(&borders[0]) - 1600.0).abs() < 0.25 * 4.0 * 40.0 + 1.0, "{}", area(&borders[0]));
        // Overlapping squares have one border; separate ones have their own; a hole has one of
        // opposite winding.
        let pieces = [square(100.0, 120.0), square(110.0, 140.0), square(200.0, 210.0)].concat();
        assert_eq!(outline(&pieces, &PICTURE).len(), 2);
        let at = |x: f64, y: f64| DVec2::new(x, y);
        let ring: Vec<_> =
            [(0.0, 0.0, 30.0, 10.0), (0.0, 20.0, 30.0, 30.0), (0.0, 0.0, 10.0, 30.0), (20.0, 0.0, 30.0, 30.0)]
                .into_iter()
                .flat_map(|(x0, y0, x1, y1)| {
                    [[at(x0, y0), at(x1, y0), at(x1, y1)], [at(x0, y0), at(x1, y1), at(x0, y1)]]
                })
                .map(|triangle| triangle.map(|p| p + 50.0))
                .collect();
        let borders = outline(&ring, &PICTURE);
        assert!(borders.len() == 2 && area(&borders[0]) > 0.0 && area(&borders[1]) < 0.0, "{borders:?}");
        assert!((0.5 * area(&borders[1]) + 100.0).abs() < 0.25 * 40.0 + 1.0, "{}", area(&borders[1]));
    }

    #[test]
    fn outline_includes_thin_triangles_and_is_clipped_to_the_picture() {
        let line = [DVec2::new(10.0, 10.0), DVec2::new(90.0, 37.0), DVec2::new(10.0, 10.0)];
        let borders = outline(&[line], &PICTURE);
        assert!(borders.len() == 1 && borders[0].iter().any(|p| p.distance(line[1]) < 0.6), "{borders:?}");
        assert!(outline(&square(-90.0, -20.0), &PICTURE).is_empty() && outline(&[], &PICTURE).is_empty());
        // Larger than the picture: the picture's border.
        let all = outline(&square(-1e5, 1e5), &PICTURE);
        assert!((0.5 * area(&all[0]) - 640.0 * 480.0).abs() < 2e3, "{all:?}");
        let bad = [[DVec2::NAN; 3], [DVec2::splat(1e300), DVec2::ZERO, DVec2::X]];
        assert!(outline(&bad[..1], &PICTURE).is_empty());
        outline(&bad, &PICTURE);
    }
}
