//! The relevant edge of a depth map at each pixel: the nearest one, and of several close ones the
//! one with the largest step.

use super::discontinuity::is_step;

/// Bonus of an edge per unit of the log of its depth ratio: it counts as this much nearer, px.
const BONUS_PER_LOG_RATIO_PX: f32 = 10.0;
/// Largest bonus, px.
pub const MAX_BONUS_PX: f32 = 4.0;
/// Pixels of a row that are tested for work at a time.
const BLOCK: usize = 32;

/// An edge of the map.
#[derive(Clone, Copy, Debug)]
pub struct DepthEdge {
    pub distance_px: f32,
    /// Depths on either side.
    pub near_m: f32,
    pub far_m: f32,
}

impl DepthEdge {
    /// The depths of the nearer and the farther surface at a pixel with the depth `own_m`.
    pub fn surface_depths_m(&self, own_m: f32) -> [f32; 2] {
        let Self { near_m, far_m, .. } = *self;
        if is_near(own_m, [near_m, far_m]) { [own_m, far_m] } else { [near_m, own_m] }
    }
}

/// True if a depth belongs to the nearer of two surfaces: it is less than their geometric mean.
pub fn is_near(z_m: f32, [near_m, far_m]: [f32; 2]) -> bool {
    z_m * z_m < near_m * far_m
}

/// The relevant edge of each pixel, by straight and diagonal steps (a chamfer distance, Borgefors
/// 1986). Edges at `within_px` or farther may be missing: their distance is then infinite.
pub fn edges(depth_m: &[f32], width: usize, within_px: f32) -> Vec<DepthEdge> {
    // Edges with the bonus of their steps, px. The first stands for no edge, at an infinite
    // distance.
    let none = DepthEdge { distance_px: f32::INFINITY, near_m: 0.0, far_m: 0.0 };
    let mut nearest = vec![(none, f32::INFINITY)];
    let mut paths = CheapestPaths::new(depth_m.len(), width, within_px);
    let is_edge = |a: f32, b: f32| (a.min(b) > 0.0) & is_step(a, b);
    each_edge(depth_m, width, is_edge, |[i, beside], [a, b]| {
        let (near_m, far_m) = (a.min(b), a.max(b));
        let bonus_px = (BONUS_PER_LOG_RATIO_PX * (far_m / near_m).ln()).min(MAX_BONUS_PX);
        [i, beside].into_iter().for_each(|at| paths.set_seed(at, 0.5 - bonus_px, nearest.len() as u32));
        nearest.push((DepthEdge { distance_px: 0.5, near_m, far_m }, bonus_px));
    });
    if nearest.len() == 1 {
        return vec![none; depth_m.len()];
    }
    paths.propagate();
    let edge = |(cost, from): (f32, u32)| {
        let (edge, bonus_px) = nearest[from as usize];
        DepthEdge { distance_px: cost + bonus_px, ..edge }
    };
    let mut out = Vec::with_capacity(depth_m.len());
    paths.rows().for_each(|(cost, from)| out.extend(cost.iter().copied().zip(from.iter().copied()).map(edge)));
    out
}

/// Chamfer distance from each pixel's centre to the nearest edge, px; at most `within_px`.
pub fn distances_px(depth_m: &[f32], width: usize, within_px: f32, is_edge: impl Fn(f32, f32) -> bool) -> Vec<f32> {
    let mut paths = CheapestPaths::new(depth_m.len(), width, within_px);
    each_edge(depth_m, width, is_edge, |at, _| at.into_iter().for_each(|at| paths.set_seed(at, 0.5, 0)));
    paths.propagate();
    let mut out = Vec::with_capacity(depth_m.len());
    paths.rows().for_each(|(cost, _)| out.extend_from_slice(cost));
    out
}

/// Calls `of` with the indices and depths of all pairs of neighbours with an edge between them.
pub fn each_edge(
    depth_m: &[f32],
    width: usize,
    is_edge: impl Fn(f32, f32) -> bool,
    mut of: impl FnMut([usize; 2], [f32; 2]),
) {
    // Tests many pairs at a time. Most blocks have no edge.
    let any = |a: &[f32], b: &[f32]| a.iter().zip(b).fold(false, |any, (a, b)| any | is_edge(*a, *b));
    for (y, row) in depth_m.chunks_exact(width.max(1)).enumerate() {
        let first = y * width;
        let below = depth_m.get(first + width..first + 2 * width).unwrap_or(&[]);
        for x0 in (0..width).step_by(BLOCK) {
            let x1 = (x0 + BLOCK).min(width);
            if !any(&row[x0..x1], &row[x0 + 1..(x1 + 1).min(width)])
                && !any(&row[x0..x1], below.get(x0..x1).unwrap_or(&[]))
            {
                continue;
            }
            for x in x0..x1 {
                if x + 1 < width && is_edge(row[x], row[x + 1]) {
                    of([first + x, first + x + 1], [row[x], row[x + 1]]);
                }
                if let Some(below) = below.get(x).filter(|below| is_edge(row[x], **below)) {
                    of([first + x, first + x + width], [row[x], *below]);
                }
            }
        }
    }
}

/// Cost and source of the cheapest path to each pixel, if it costs less than `max_cost`. The arrays
/// have a border of one pixel.
struct CheapestPaths {
    width: usize,
    max_cost: f32,
    cost: Vec<f32>,
    from: Vec<u32>,
}

impl CheapestPaths {
    fn new(count: usize, width: usize, max_cost: f32) -> Self {
        let all = (width + 2) * (count / width.max(1) + 2);
        Self { width, max_cost, cost: vec![max_cost; all], from: vec![0; all] }
    }

    fn set_seed(&mut self, i: usize, cost: f32, from: u32) {
        let at = (i / self.width + 1) * (self.width + 2) + i % self.width + 1;
        if cost < self.cost[at] {
            (self.cost[at], self.from[at]) = (cost, from);
        }
    }

    /// Propagates the cheapest paths to all pixels: from the left and above, then from the right
    /// and below. A reversed array is the picture turned by 180°.
    fn propagate(&mut self) {
        for _ in 0..2 {
            self.propagate_forward();
            self.cost.reverse();
            self.from.reverse();
        }
    }

    fn propagate_forward(&mut self) {
        let (wide, diagonal, max_cost) = (self.width + 2, std::f32::consts::SQRT_2, self.max_cost);
        for y in 1..self.cost.len() / wide {
            let (cost_above, cost) = self.cost[(y - 1) * wide..(y + 1) * wide].split_at_mut(wide);
            let (from_above, from) = self.from[(y - 1) * wide..(y + 1) * wide].split_at_mut(wide);
            for x0 in (1..wide - 1).step_by(BLOCK) {
                let x1 = (x0 + BLOCK).min(wide - 1);
                // One of the three neighbours above for a whole block at a time, as vectors.
                if cost_above[x0 - 1..x1 + 1].iter().fold(false, |any, above| any | (*above < max_cost)) {
                    for (dx, step) in [(0, diagonal), (1, 1.0), (2, diagonal)] {
                        let beside = cost_above[x0 + dx - 1..].iter().zip(&from_above[x0 + dx - 1..]);
                        for ((cost, from), (above, from_there)) in
                            cost[x0..x1].iter_mut().zip(&mut from[x0..x1]).zip(beside)
                        {
                            let is_less = above + step < *cost;
                            *cost = if is_less { above + step } else { *cost };
                            *from = if is_less { *from_there } else { *from };
                        }
                    }
                }
                // Along the row, if any pixel of the block has a cheaper path by its left
                // neighbour.
                let pairs = cost[x0 - 1..x1].iter().zip(&cost[x0..x1]);
                if pairs.fold(false, |any, (before, cost)| any | (before + 1.0 < *cost)) {
                    for x in x0..x1 {
                        if cost[x - 1] + 1.0 < cost[x] {
                            (cost[x], from[x]) = (cost[x - 1] + 1.0, from[x - 1]);
                        }
                    }
                }
            }
        }
    }

    /// Costs and sources of the pixels without the border, row by row.
    fn rows(&self) -> impl Iterator<Item = (&[f32], &[u32])> {
        let (wide, width) = (self.width + 2, self.width);
        let rows = self.cost.chunks_exact(wide).zip(self.from.chunks_exact(wide)).skip(1);
        let rows = rows.take((self.cost.len() / wide).saturating_sub(2));
        rows.map(move |(cost, from)| (&cost[1..=width], &from[1..=width]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn relevant_edge_is_the_nearest_or_the_larger_of_close_ones() {
        // 1 m, then 1.06 m from column 10 on, then 2 m from column 13 on.
        let row: Vec<f32> = (0..30)
            .map(|x| {
                if x < 10 {
                    1.0
                } else if x < 13 {
                    1.06
                } else {
                    2.0
                }
            })
            .collect();
        let row_edges = edges(&row.repeat(5), 30, 99.0);
        let at = |x: usize| (row_edges[60 + x].distance_px, row_edges[60 + x].near_m, row_edges[60 + x].far_m);
        assert_eq!(at(13), (0.5, 1.06, 2.0));
        assert_eq!(at(20), (7.5, 1.06, 2.0));
        // The step to 2 m is 3 px farther away from here, and worth more than that.
        assert_eq!(at(9), (3.5, 1.06, 2.0));
        assert_eq!(row_edges[60 + 9].surface_depths_m(1.0), [1.0, 2.0]);
        assert_eq!(row_edges[60 + 15].surface_depths_m(1.99), [1.06, 1.99]);
        assert!(edges(&[1.0; 20], 5, 9.0).iter().all(|edge| edge.distance_px.is_infinite()));
        assert!(edges(&[], 0, 9.0).is_empty());
    }

    /// A receding floor with boxes of many sizes in front of it, and holes.
    fn boxes_on_a_floor(width: usize, height: usize) -> Vec<f32> {
        let object =
            |n: usize| (n * 71 % width, n * 57 % height, 3 + n * 7 % 11, 2 + n * 5 % 9, 0.8 + 0.1 * (n % 13) as f32);
        let at = |i: usize| {
            let (x, y) = (i % width, i / width);
            let is_on = |(left, top, wide, high, _): &(usize, usize, usize, usize, f32)| {
                (*left..left + wide).contains(&x) && (*top..top + high).contains(&y)
            };
            let floor_m = 4.0 - 2.0 * y as f32 / height as f32;
            (0..7).map(object).find(is_on).map_or(floor_m, |object| if object.0 % 5 == 0 { 0.0 } else { object.4 })
        };
        (0..width * height).map(at).collect()
    }

    /// Reference: distances relaxed step by step until nothing changes.
    fn relaxed_distances(depth_m: &[f32], width: usize, is_edge: impl Fn(f32, f32) -> bool) -> Vec<f32> {
        let size = [width as i32, (depth_m.len() / width) as i32];
        let neighbours = |i: usize| {
            let (x, y) = (i as i32 % size[0], i as i32 / size[0]);
            let all = (-1..=1).flat_map(move |dy| (-1..=1).map(move |dx| (x + dx, y + dy, dx * dx + dy * dy)));
            let is_inside = move |(x, y, _): &(i32, i32, i32)| (0..size[0]).contains(x) && (0..size[1]).contains(y);
            all.filter(is_inside).map(move |(x, y, far2)| ((y * size[0] + x) as usize, (far2 as f32).sqrt()))
        };
        let begins = |i: usize| neighbours(i).any(|(n, far)| far == 1.0 && is_edge(depth_m[i], depth_m[n]));
        let mut far: Vec<f32> = (0..depth_m.len()).map(|i| if begins(i) { 0.5 } else { f32::INFINITY }).collect();
        loop {
            let nearer = |i: usize| neighbours(i).map(|(n, step)| far[n] + step).fold(far[i], f32::min);
            let next: Vec<f32> = (0..far.len()).map(nearer).collect();
            if next == far {
                return far;
            }
            far = next;
        }
    }

    #[test]
    fn distances_match_a_relaxation_pixel_by_pixel() {
        // An object that begins at each position of a block.
        let object = |left: usize| -> Vec<f32> {
            let is_on = |x: usize, y: usize| (left..left + 9).contains(&x) && (8..17).contains(&y);
            (0..96 * 24).map(|i| if is_on(i % 96, i / 96) { 1.0 } else { 2.0 }).collect()
        };
        let objects = (BLOCK..2 * BLOCK).map(|left| (object(left), 96));
        for (depth_m, width) in objects.chain([(boxes_on_a_floor(151, 61), 151)]) {
            let distances = distances_px(&depth_m, width, f32::INFINITY, is_step);
            let expected = relaxed_distances(&depth_m, width, is_step);
            let off = distances.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(off < 1e-4, "{off}");
        }
    }

    #[test]
    fn near_edges_do_not_depend_on_the_search_distance() {
        let width = 151;
        let depth_m = boxes_on_a_floor(width, 61);
        let all = edges(&depth_m, width, f32::INFINITY);
        let (mut near, mut none) = (0, 0);
        for within_px in [1.0, 4.0, 9.5] {
            for (nearest, all) in edges(&depth_m, width, within_px).iter().zip(&all) {
                let fields = |edge: &DepthEdge| (edge.distance_px, edge.near_m, edge.far_m);
                if all.distance_px < within_px {
                    assert_eq!(fields(nearest), fields(all));
                    near += 1;
                }
                // A larger edge may be found although it is farther away.
                assert!(nearest.distance_px.is_infinite() || fields(nearest) == fields(all));
                none += usize::from(nearest.distance_px.is_infinite());
            }
        }
        assert!(near > 1000 && none > 1000, "{near} {none}");
    }
}
