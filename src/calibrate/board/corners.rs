//! Chessboard corners as saddle points: where four squares meet.
//!
//! At a corner brightness has a saddle: it rises into two opposite squares and falls into the other
//! two. The determinant of its Hessian has a minimum there, whatever the board's rotation, blur and
//! lighting. Chance saddles are rejected by a ring around the point: on a board it has two bright
//! and two dark arcs, whose ends lie opposite each other because two lines cross.

use std::f64::consts::{PI, TAU};

use glam::DVec2;

use crate::grey_image::GreyImage;

/// A crossing of two edges, in the picture in which it was detected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// px, pixel centres at +0.5.
    pub at: DVec2,
    /// Directions of the four edges: angles from x towards y, rad, in −π..π, ascending.
    pub edges: [f64; 4],
    /// True if the arc from the first edge to the second is bright.
    pub bright_first: bool,
    /// Difference of bright and dark, in the picture's values.
    pub contrast: f64,
}

impl Corner {
    /// True if the arc after an edge is bright.
    pub fn bright_after(&self, edge: usize) -> bool {
        self.bright_first == edge.is_multiple_of(2)
    }
}

/// Blur before the detection, px: less than a square, more than a pixel's noise.
pub const BLUR_PX: f64 = 1.4;
/// Non-maximum suppression: of two closer saddles the stronger one is kept, px.
const MIN_DISTANCE_PX: i64 = 3;
/// Smallest strength of a saddle above noise: minus the determinant, (values/px²)².
const MIN_STRENGTH: f32 = 0.02;
/// Smallest contrast of a crossing, 8-bit codes; weaker ones are texture.
const MIN_CONTRAST: f64 = 10.0;
/// Radii of the rings, px. The smaller one is for distant boards.
const RINGS_PX: [f64; 2] = [5.0, 3.5];
/// Samples on a ring.
const RING_SAMPLES: usize = 32;
/// Largest deviation of opposite edges from a straight line, rad.
const MAX_BEND_RAD: f64 = 0.40;
/// Smallest angle between the two lines, rad.
const MIN_CROSSING_RAD: f64 = 0.22;
/// Largest number of candidates; the strongest are kept.
const MAX_CANDIDATES: usize = 4000;

/// Detects the crossings in a picture that was blurred by [`BLUR_PX`].
pub fn detect(blurred: &GreyImage) -> Vec<Corner> {
    let (width, height) = (blurred.width, blurred.height);
    let strength = saddle_strengths(blurred);
    let mut peaks = Vec::new();
    for y in 2..height.saturating_sub(2) {
        for x in 2..width.saturating_sub(2) {
            let own = strength[y * width + x];
            if own > MIN_STRENGTH && is_peak(&strength, width, height, x, y) {
                peaks.push((own, x, y));
            }
        }
    }
    peaks.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.2, a.1).cmp(&(b.2, b.1))));
    peaks.truncate(MAX_CANDIDATES);
    let place = |(_, x, y): (f32, usize, usize)| DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
    peaks.into_iter().filter_map(|peak| corner_near(blurred, place(peak), 1.5)).collect()
}

/// Minus the determinant of the Hessian: positive at saddles.
fn saddle_strengths(blurred: &GreyImage) -> Vec<f32> {
    let (width, height) = (blurred.width, blurred.height);
    let mut strength = vec![0.0; width * height];
    for y in 1..height.saturating_sub(1) {
        let [above, own, below] = [y - 1, y, y + 1].map(|row| &blurred.values[row * width..(row + 1) * width]);
        for x in 1..width.saturating_sub(1) {
            let xx = own[x - 1] - 2.0 * own[x] + own[x + 1];
            let yy = above[x] - 2.0 * own[x] + below[x];
            let xy = 0.25 * (above[x - 1] + below[x + 1] - above[x + 1] - below[x - 1]);
            strength[y * width + x] = xy * xy - xx * yy;
        }
    }
    strength
}

fn is_peak(strength: &[f32], width: usize, height: usize, x: usize, y: usize) -> bool {
    let own = strength[y * width + x];
    let r = MIN_DISTANCE_PX as usize;
    let rows = y.saturating_sub(r)..(y + r + 1).min(height);
    rows.flat_map(|j| (x.saturating_sub(r)..(x + r + 1).min(width)).map(move |i| (i, j)))
        // The first of two equal values wins.
        .all(|(i, j)| strength[j * width + i] < own || (strength[j * width + i] == own && (j, i) >= (y, x)))
}

/// The crossing whose saddle is within `reach` px of a point.
pub fn corner_near(blurred: &GreyImage, near: DVec2, reach: f64) -> Option<Corner> {
    let at = saddle(blurred, near, reach)?;
    RINGS_PX.into_iter().find_map(|radius| ring(blurred, at, radius))
}

/// Newton's method for the zero of the gradient.
fn saddle(blurred: &GreyImage, near: DVec2, reach: f64) -> Option<DVec2> {
    let mut at = near;
    for _ in 0..8 {
        if !blurred.holds(at, 2.0) {
            return None;
        }
        let value = |dx: f64, dy: f64| blurred.sample(at + DVec2::new(dx, dy));
        let (middle, left, right, up, down) =
            (value(0.0, 0.0), value(-1.0, 0.0), value(1.0, 0.0), value(0.0, -1.0), value(0.0, 1.0));
        let slope = 0.5 * DVec2::new(right - left, down - up);
        let (xx, yy) = (left - 2.0 * middle + right, up - 2.0 * middle + down);
        let xy = 0.25 * (value(-1.0, -1.0) + value(1.0, 1.0) - value(1.0, -1.0) - value(-1.0, 1.0));
        let determinant = xx * yy - xy * xy;
        if determinant >= 0.0 {
            return None;
        }
        let step = DVec2::new(xy * slope.y - yy * slope.x, xy * slope.x - xx * slope.y) / determinant;
        at += step.clamp_length_max(1.0);
        if at.distance(near) > reach {
            return None;
        }
        if step.length() < 0.02 {
            break;
        }
    }
    Some(at)
}

/// Evaluates a ring around a saddle. `None` if it does not show two crossing lines.
fn ring(blurred: &GreyImage, at: DVec2, radius: f64) -> Option<Corner> {
    if !blurred.holds(at, radius + 1.0) {
        return None;
    }
    let angle = |i: f64| -PI + TAU * (i + 0.5) / RING_SAMPLES as f64;
    let values: [f64; RING_SAMPLES] =
        std::array::from_fn(|i| blurred.sample(at + radius * DVec2::from_angle(angle(i as f64))));
    let mut sorted = values;
    sorted.sort_by(f64::total_cmp);
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    let (dark, bright) = (mean(&sorted[..4]), mean(&sorted[RING_SAMPLES - 4..]));
    let (middle, contrast) = (0.5 * (dark + bright), bright - dark);
    let own = blurred.sample(at);
    if contrast < MIN_CONTRAST || (own - middle).abs() > 0.35 * contrast {
        return None;
    }
    let mut edges = Vec::with_capacity(4);
    let mut first_rises = false;
    for i in 0..RING_SAMPLES {
        let (here, next) = (values[i] - middle, values[(i + 1) % RING_SAMPLES] - middle);
        if (here < 0.0) != (next < 0.0) {
            let turned = angle(i as f64 + here / (here - next));
            // The last edge may lie beyond π.
            edges.push(if turned >= PI { turned - TAU } else { turned });
            if edges.len() == 1 {
                first_rises = here < 0.0;
            }
        }
    }
    let mut edges: [f64; 4] = edges.try_into().ok()?;
    if edges[3] < edges[2] {
        edges.rotate_right(1);
        // The arc after the new first edge was the one before the former first edge.
        first_rises = !first_rises;
    }
    let gap = |i: usize, j: usize| (edges[j % 4] - edges[i]).rem_euclid(TAU);
    let straight = (0..2).all(|i| (gap(i, i + 2) - PI).abs() < MAX_BEND_RAD);
    let crosses = (0..4).all(|i| gap(i, i + 1) > MIN_CROSSING_RAD);
    (straight && crosses).then_some(Corner { at, edges, bright_first: first_rises, contrast })
}
