//! Pairs of places from ST maps, in Nuke's convention: the centre of the pixel in column x of w is
//! at (x + 0.5)/w, and T counts upwards. Maps whose T counts downwards are recognised.
//!
//! Places without a value are -1, 0 or 1 in a channel, by the writer's custom. The pixels beside
//! them are left out, because filters mix them. From the middle of the picture, the map is used as
//! far as it is one-to-one: beyond the field of view the formulas of some lenses fold back.

use glam::DVec2;

use crate::camera::MapSample;
use crate::source::st_map::StPicture;

/// The picture whose places the pixels of a map have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// Pixels of the undistorted picture, places of the recorded one.
    Undistort,
    /// Pixels of the recorded picture, places of the undistorted one.
    Redistort,
}

/// Largest number of means of pixels that are used.
const MAX_NODES: f64 = 150_000.0;
/// Largest side of the blocks of pixels whose mean is a node, px. The curvature of a lens moves the
/// mean of a block by less than 10⁻³ px.
const MAX_BLOCK_PX: usize = 4;
/// Distance from missing pixels within which filters mix them, px.
const FILTER_PX: usize = 2;
/// Largest value of a map of places. Maps in pixels have larger ones.
const MAX_VALUE: f32 = 8.0;
/// Smallest extent of the values of a map of places. Maps of offsets have smaller ones.
const MIN_EXTENT: f64 = 0.1;
/// Places so far outside of the recorded picture are used, as a fraction of its size.
const MARGIN: f64 = 0.1;
/// Folds so far inside the recorded picture are errors, as a fraction of its size.
const RIM: f64 = 0.02;

/// The means of blocks of a map's pixels, at equal steps and at the far borders.
struct Nodes {
    width: usize,
    height: usize,
    /// Step to the next node, and side of the blocks, px.
    step_px: usize,
    block_px: usize,
    /// Upper left corner of the pixels, and their number across and down.
    corner_px: DVec2,
    pixels: [usize; 2],
    /// The values as fractions of the other picture's size, T downwards.
    places: Vec<Option<DVec2>>,
}

fn is_missing([s, t]: [f32; 2]) -> bool {
    [s, t].iter().any(|value| [-1.0, 0.0, 1.0].contains(value))
}

/// Checks that the values are places.
fn check_values(map: &StPicture) -> Result<(), String> {
    let pixel = |at: usize| format!("column {}, row {}", at % map.width, at / map.width);
    if map.size_px.contains(&0) || map.st.is_empty() {
        return Err("is empty".to_owned());
    }
    if let Some(at) = map.st.iter().position(|st| st.iter().any(|value| !value.is_finite())) {
        return Err(format!("holds no number at {}: pixels without a place must be -1 in both channels", pixel(at)));
    }
    if let Some(at) = map.st.iter().position(|st| st.iter().any(|value| value.abs() > MAX_VALUE)) {
        let [s, t] = map.st[at];
        return Err(format!(
            "has the place {s}, {t} at {}: S and T go from 0 to 1 across the picture; divide a map in pixels by its \
             width and height",
            pixel(at)
        ));
    }
    Ok(())
}

/// The mean of a block, unless a pixel in it or near it is missing.
fn mean(map: &StPicture, [x, y]: [usize; 2], block_px: usize) -> Option<DVec2> {
    let around =
        |first: usize, length: usize| first.saturating_sub(FILTER_PX)..(first + block_px + FILTER_PX).min(length);
    let columns = around(x, map.width);
    let is_near_missing =
        around(y, map.height).any(|row| map.st[row * map.width..][columns.clone()].iter().any(|st| is_missing(*st)));
    if is_near_missing {
        return None;
    }
    let rows = (y..y + block_px).flat_map(|row| &map.st[row * map.width + x..][..block_px]);
    let sum: DVec2 = rows.map(|[s, t]| DVec2::new(f64::from(*s), f64::from(*t))).sum();
    Some(sum / (block_px * block_px) as f64)
}

impl Nodes {
    fn new(map: &StPicture) -> Self {
        let step_px = ((map.st.len() as f64 / MAX_NODES).sqrt().ceil() as usize).max(1);
        let block_px = step_px.min(MAX_BLOCK_PX).min(map.width).min(map.height);
        let [width, height] = [map.width, map.height].map(|length| (length - block_px).div_ceil(step_px) + 1);
        let corner_px = DVec2::new(map.corner_px[0].into(), map.corner_px[1].into());
        let pixels = [map.width, map.height];
        let mut nodes = Self { width, height, step_px, block_px, corner_px, pixels, places: Vec::new() };
        nodes.places = (0..width * height).map(|node| mean(map, nodes.pixel(node), block_px)).collect();
        nodes
    }

    /// The first pixel of a node's block.
    fn pixel(&self, node: usize) -> [usize; 2] {
        let at = |n: usize, axis: usize| (n * self.step_px).min(self.pixels[axis] - self.block_px);
        [at(node % self.width, 0), at(node / self.width, 1)]
    }

    /// The place of a node in the map's own picture.
    fn at_px(&self, node: usize) -> DVec2 {
        let [x, y] = self.pixel(node);
        self.corner_px + DVec2::new(x as f64, y as f64) + 0.5 * self.block_px as f64
    }

    /// Turns T downwards, whichever way it counts.
    fn turned_down(mut self) -> Result<Self, String> {
        let valid = || self.places.iter().flatten();
        let (low, high) = valid().fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(l, h), at| (l.min(*at), h.max(*at)));
        let extent = high - low;
        if extent.is_nan() || extent.min_element() < MIN_EXTENT {
            return Err(
                "covers less than a tenth of the picture: it must have places from 0 to 1, not offsets".to_owned()
            );
        }
        let mean_t = |nodes: &[Option<DVec2>]| {
            let (sum, count) = nodes.iter().flatten().fold((0.0, 0u32), |(sum, n), at| (sum + at.y, n + 1));
            sum / f64::from(count.max(1))
        };
        let (upper, lower) = self.places.split_at(self.places.len() / 2);
        if mean_t(upper) > mean_t(lower) {
            self.places.iter_mut().flatten().for_each(|at| at.y = 1.0 - at.y);
        }
        Ok(self)
    }

    /// The corners of a cell's places, if all have one.
    fn cell(&self, column: usize, row: usize) -> Option<[DVec2; 4]> {
        let first = row * self.width + column;
        let [a, b, c, d] = [0, 1, self.width, self.width + 1].map(|offset| self.places[first + offset]);
        Some([a?, b?, c?, d?])
    }

    /// The nodes that are connected with the middle of the picture by cells of the right
    /// orientation.
    fn one_to_one(&self, direction: Direction) -> Result<Vec<bool>, String> {
        let (columns, rows) = (self.width.saturating_sub(1), self.height.saturating_sub(1));
        let start = self.middle(direction).ok_or("has no places")?;
        let start =
            [(start % self.width).min(columns.saturating_sub(1)), (start / self.width).min(rows.saturating_sub(1))];
        if columns == 0 || rows == 0 || !self.cell(start[0], start[1]).is_some_and(is_upright) {
            return Err("has no one-to-one places in the middle of the picture: S must grow to the right".to_owned());
        }
        let mut is_reached = vec![false; columns * rows];
        let mut is_connected = vec![false; self.places.len()];
        let mut pending = vec![start];
        is_reached[start[1] * columns + start[0]] = true;
        while let Some([x, y]) = pending.pop() {
            for offset in [0, 1, self.width, self.width + 1] {
                is_connected[y * self.width + x + offset] = true;
            }
            let beside = [[x.wrapping_sub(1), y], [x + 1, y], [x, y.wrapping_sub(1)], [x, y + 1]];
            for [x, y] in beside.into_iter().filter(|[x, y]| *x < columns && *y < rows) {
                let Some(cell) = self.cell(x, y).filter(|_| !is_reached[y * columns + x]) else { continue };
                if is_upright(cell) {
                    is_reached[y * columns + x] = true;
                    pending.push([x, y]);
                } else if direction == Direction::Redistort || cell.iter().all(|at| is_within(*at, -RIM)) {
                    let at_px = self.at_px(y * self.width + x);
                    return Err(format!("is not one-to-one: it folds at column {:.0}, row {:.0}", at_px.x, at_px.y));
                }
            }
        }
        Ok(is_connected)
    }

    /// The node in the middle of the recorded picture.
    fn middle(&self, direction: Direction) -> Option<usize> {
        let middle_px = self.corner_px + 0.5 * DVec2::new(self.pixels[0] as f64, self.pixels[1] as f64);
        let distance = |node: usize| {
            let place = self.places[node]?;
            Some(match direction {
                Direction::Undistort => place.distance(DVec2::splat(0.5)),
                Direction::Redistort => self.at_px(node).distance(middle_px),
            })
        };
        let distances = (0..self.places.len()).filter_map(|node| Some((node, distance(node)?)));
        distances.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(node, _)| node)
    }
}

/// True if both triangles of a cell keep their orientation.
fn is_upright([a, b, c, d]: [DVec2; 4]) -> bool {
    (b - a).perp_dot(c - a) > 0.0 && (c - d).perp_dot(b - d) > 0.0
}

/// True within the recorded picture and a margin.
fn is_within(at: DVec2, margin: f64) -> bool {
    at.min_element() >= -margin && at.max_element() <= 1.0 + margin
}

/// The pairs of a map. `undistorted_px` is the undistorted picture's size, to which the places of a
/// map from the recorded picture refer.
pub fn samples(map: &StPicture, direction: Direction, undistorted_px: [u32; 2]) -> Result<Vec<MapSample>, String> {
    check_values(map)?;
    let mut nodes = Nodes::new(map).turned_down()?;
    if direction == Direction::Undistort {
        nodes.places.iter_mut().for_each(|place| *place = place.filter(|at| is_within(*at, MARGIN)));
    }
    let is_connected = nodes.one_to_one(direction)?;
    let undistorted_px = DVec2::new(undistorted_px[0].into(), undistorted_px[1].into());
    let recorded_px = DVec2::new(map.size_px[0].into(), map.size_px[1].into());
    let pair = |node: usize| {
        let (place, at_px) = (nodes.places[node].filter(|_| is_connected[node])?, nodes.at_px(node));
        Some(match direction {
            Direction::Undistort => MapSample { undistorted_px: at_px, recorded: place },
            Direction::Redistort => MapSample { undistorted_px: place * undistorted_px, recorded: at_px / recorded_px },
        })
    };
    Ok((0..nodes.places.len()).filter_map(pair).collect())
}
