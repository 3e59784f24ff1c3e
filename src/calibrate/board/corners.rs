//! Where four squares of a chessboard meet.
//!
//! Brightness is a saddle there: it rises from the point into two opposite squares and falls into the other two. The
//! determinant of its second derivatives is least at such points, whatever way the board is turned, blurred or lit.
//! What is a saddle by chance is told by a ring around it: of a board it has two bright and two dark arcs, and their
//! ends lie opposite each other, for two lines cross.

use std::f64::consts::{PI, TAU};

use glam::DVec2;

use super::plane::Plane;

/// A place where two edges cross, in the picture that it was found in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// px, pixel centres at +0.5.
    pub at: DVec2,
    /// The four edges that leave it: angles from x towards y, rad, in −π..π, ascending.
    pub edges: [f64; 4],
    /// Whether the arc from the first edge to the second is bright.
    pub bright_first: bool,
    /// Bright minus dark, in the picture's values.
    pub contrast: f64,
}

impl Corner {
    /// Whether the arc that follows an edge is bright.
    pub fn bright_after(&self, edge: usize) -> bool {
        self.bright_first == edge.is_multiple_of(2)
    }
}

/// The blur before the search, px: less than a square, more than a pixel's noise.
pub const BLUR_PX: f64 = 1.4;
/// Of two saddles closer than this the deeper one is taken, px.
const APART_PX: i64 = 3;
/// A saddle is no deeper than noise below this: the determinant, (values/px²)².
const LEAST_DEPTH: f32 = 0.02;
/// Fainter crossings are texture, of 255 codes.
const LEAST_CONTRAST: f64 = 10.0;
/// Radii of the rings, px. The smaller serves boards far away.
const RINGS_PX: [f64; 2] = [5.0, 3.5];
/// Places on a ring.
const PLACES: usize = 32;
/// Edges that are one line differ from opposite by less than this, rad.
const BENT: f64 = 0.40;
/// Two lines cross at this angle at least, rad.
const CROSSES: f64 = 0.22;
/// More candidates are texture; the deepest are kept.
const MOST: usize = 4000;

/// The crossings in a picture that was blurred by [`BLUR_PX`].
pub fn corners(blurred: &Plane) -> Vec<Corner> {
    let (width, height) = (blurred.width, blurred.height);
    let depth = depths(blurred);
    let mut peaks = Vec::new();
    for y in 2..height.saturating_sub(2) {
        for x in 2..width.saturating_sub(2) {
            let own = depth[y * width + x];
            if own > LEAST_DEPTH && is_peak(&depth, width, height, x, y) {
                peaks.push((own, x, y));
            }
        }
    }
    peaks.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.2, a.1).cmp(&(b.2, b.1))));
    peaks.truncate(MOST);
    let place = |(_, x, y): (f32, usize, usize)| DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
    peaks.into_iter().filter_map(|peak| corner_near(blurred, place(peak), 1.5)).collect()
}

/// Minus the determinant of the second derivatives: positive at saddles.
fn depths(blurred: &Plane) -> Vec<f32> {
    let (width, height) = (blurred.width, blurred.height);
    let mut depth = vec![0.0; width * height];
    for y in 1..height.saturating_sub(1) {
        let [above, own, below] = [y - 1, y, y + 1].map(|row| &blurred.values[row * width..(row + 1) * width]);
        for x in 1..width.saturating_sub(1) {
            let xx = own[x - 1] - 2.0 * own[x] + own[x + 1];
            let yy = above[x] - 2.0 * own[x] + below[x];
            let xy = 0.25 * (above[x - 1] + below[x + 1] - above[x + 1] - below[x - 1]);
            depth[y * width + x] = xy * xy - xx * yy;
        }
    }
    depth
}

fn is_peak(depth: &[f32], width: usize, height: usize, x: usize, y: usize) -> bool {
    let own = depth[y * width + x];
    let r = APART_PX as usize;
    let rows = y.saturating_sub(r)..(y + r + 1).min(height);
    rows.flat_map(|j| (x.saturating_sub(r)..(x + r + 1).min(width)).map(move |i| (i, j)))
        // Of two alike the first one counts.
        .all(|(i, j)| depth[j * width + i] < own || (depth[j * width + i] == own && (j, i) >= (y, x)))
}

/// The crossing whose saddle lies within `reach` px of a place.
pub fn corner_near(blurred: &Plane, near: DVec2, reach: f64) -> Option<Corner> {
    let at = saddle(blurred, near, reach)?;
    RINGS_PX.into_iter().find_map(|radius| ring(blurred, at, radius))
}

/// Newton's steps to where brightness neither rises nor falls.
fn saddle(blurred: &Plane, near: DVec2, reach: f64) -> Option<DVec2> {
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

/// Reads a ring around a saddle: `None` if it is not that of two crossing lines.
fn ring(blurred: &Plane, at: DVec2, radius: f64) -> Option<Corner> {
    if !blurred.holds(at, radius + 1.0) {
        return None;
    }
    let angle = |i: f64| -PI + TAU * (i + 0.5) / PLACES as f64;
    let values: [f64; PLACES] =
        std::array::from_fn(|i| blurred.sample(at + radius * DVec2::from_angle(angle(i as f64))));
    let mut sorted = values;
    sorted.sort_by(f64::total_cmp);
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    let (dark, bright) = (mean(&sorted[..4]), mean(&sorted[PLACES - 4..]));
    let (middle, contrast) = (0.5 * (dark + bright), bright - dark);
    let own = blurred.sample(at);
    if contrast < LEAST_CONTRAST || (own - middle).abs() > 0.35 * contrast {
        return None;
    }
    let mut edges = Vec::with_capacity(4);
    let mut first_rises = false;
    for i in 0..PLACES {
        let (here, next) = (values[i] - middle, values[(i + 1) % PLACES] - middle);
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
        // The arc after what is now the first edge is the one before the former first.
        first_rises = !first_rises;
    }
    let gap = |i: usize, j: usize| (edges[j % 4] - edges[i]).rem_euclid(TAU);
    let straight = (0..2).all(|i| (gap(i, i + 2) - PI).abs() < BENT);
    let crosses = (0..4).all(|i| gap(i, i + 1) > CROSSES);
    (straight && crosses).then_some(Corner { at, edges, bright_first: first_rises, contrast })
}
