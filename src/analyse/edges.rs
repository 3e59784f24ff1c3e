//! Straight, isolated edges of a picture, the steepest first.
//!
//! A ridge of the slope of smoothed light (Canny 1986) is followed along a straight piece: in each
//! row across it the centroid of the slope, and a line through those.

use super::depth_at_frame::window_extreme;
use super::pyramid::{Plane, gaussian};

/// Half of the piece of an edge that is looked at, along it and across, px.
pub const ALONG: f32 = 8.0;
pub const ACROSS: f32 = 6.0;
/// The square around an edge that no other may begin in, half of its side, px.
const APART: usize = 6;
/// No edge begins nearer to the picture's rim, px.
const RIM: usize = 16;
/// σ of the smoothing, px.
const SMOOTH_PX: f32 = 1.0;
/// The least slope of smoothed light, of full scale per px.
const STEEP: f32 = 0.015;
/// Places that are looked at, at most.
const MOST_PLACES: usize = 4000;
/// Across an edge places are this far apart, px.
const PITCH: f32 = 0.5;
/// The slope's centroid is taken within, px, of what exceeds this share of the row's most.
const WITHIN: f32 = 2.6;
const OVER: f32 = 0.3;
/// Rows may lie beside the line by this much, root mean square, px.
const STRAIGHT_PX: f32 = 0.15;
/// The line may be turned by this much against the slope's direction in its middle, px per px.
const TURNED: f32 = 0.25;

/// A piece of a straight edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// The pixel in its middle.
    pub x: usize,
    pub y: usize,
    /// The direction of its normal from x to y, radians; the brighter side lies there.
    pub angle: f32,
    /// How far it lies from the pixel's middle along the normal, px.
    pub offset_px: f32,
}

/// The edges of a picture of linear light, none of them near a place that `is_clipped`. Edges that
/// `wanted` refuses, given their middle and normal, are left out before they are looked at.
pub fn edges(
    light: &Plane,
    is_clipped: &[bool],
    most: usize,
    wanted: impl Fn(usize, usize, [f32; 2]) -> bool,
) -> Vec<Line> {
    let (w, h) = (light.width, light.height);
    let (along, down) = light.filtered(&gaussian(SMOOTH_PX)).slopes();
    let slope: Vec<f32> = along.values.iter().zip(&down.values).map(|(x, y)| x.hypot(*y)).collect();
    let slope = Plane { width: w, height: h, values: slope };
    let clipped: Vec<f32> = is_clipped.iter().map(|clipped| f32::from(u8::from(*clipped))).collect();
    let near_clipped = window_extreme(&clipped, w, ACROSS as usize + 1, f32::max);
    let mut ridge: Vec<(usize, [f32; 2])> = Vec::new();
    for y in RIM..h.saturating_sub(RIM) {
        for x in RIM..w.saturating_sub(RIM) {
            let i = y * w + x;
            let steep = slope.values[i];
            if steep <= STEEP || near_clipped[i] > 0.0 {
                continue;
            }
            let n = [along.values[i] / steep, down.values[i] / steep];
            let beside = |by: f32| slope.at(x as f32 + by * n[0], y as f32 + by * n[1]).unwrap_or(f32::MAX);
            if steep >= beside(1.0) && steep > beside(-1.0) {
                ridge.push((i, n));
            }
        }
    }
    ridge.sort_by(|a, b| slope.values[b.0].total_cmp(&slope.values[a.0]).then(a.0.cmp(&b.0)));
    let mut is_taken = vec![false; w * h];
    let mut found = Vec::new();
    let mut looked = 0;
    for (i, n) in ridge {
        let (x, y) = (i % w, i / w);
        if found.len() == most || looked == MOST_PLACES {
            break;
        }
        if is_taken[i] || !wanted(x, y, n) {
            continue;
        }
        looked += 1;
        let Some(line) = line(&slope, x, y, n) else { continue };
        for row in is_taken.chunks_mut(w).skip(y - APART).take(2 * APART + 1) {
            row[x - APART..=x + APART].fill(true);
        }
        found.push(line);
    }
    found
}

/// The line along a ridge, if it is one.
fn line(slope: &Plane, x: usize, y: usize, n: [f32; 2]) -> Option<Line> {
    let t = [-n[1], n[0]];
    let across: Vec<f32> = steps(ACROSS, PITCH);
    let rows = steps(ALONG, 1.0);
    let mut centroids = Vec::with_capacity(rows.len());
    for v in &rows {
        let at = |u: &f32| slope.at(x as f32 + u * n[0] + v * t[0], y as f32 + u * n[1] + v * t[1]);
        let values: Vec<f32> = across.iter().map(at).collect::<Option<_>>()?;
        let floor = OVER * values.iter().copied().fold(0.0, f32::max);
        let (mut sum, mut moment) = (0.0, 0.0);
        for (u, value) in across.iter().zip(&values) {
            let inside = if u.abs() < WITHIN { *value } else { 0.0 };
            let over = (inside - floor).max(0.0);
            (sum, moment) = (sum + over, moment + over * u);
        }
        if sum <= 0.0 {
            return None;
        }
        centroids.push(moment / sum);
    }
    // Rows are even about the middle, so mean and tilt do not mix.
    let count = rows.len() as f32;
    let middle = centroids.iter().sum::<f32>() / count;
    let tilt = rows.iter().zip(&centroids).map(|(v, c)| v * c).sum::<f32>() / rows.iter().map(|v| v * v).sum::<f32>();
    let off: f32 = rows.iter().zip(&centroids).map(|(v, c)| (c - middle - tilt * v).powi(2)).sum();
    if (off / count).sqrt() > STRAIGHT_PX || tilt.abs() > TURNED {
        return None;
    }
    // u = middle + tilt·v, of which (1, −tilt) in (u, v) is the normal.
    let angle = n[1].atan2(n[0]) - tilt.atan();
    Some(Line { x, y, angle, offset_px: middle * tilt.atan().cos() })
}

/// From −`to` to `to`.
fn steps(to: f32, pitch: f32) -> Vec<f32> {
    let half = (to / pitch) as i32;
    (-half..=half).map(|k| k as f32 * pitch).collect()
}
