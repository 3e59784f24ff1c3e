//! Detects straight, isolated edges of a picture, the steepest first.
//!
//! At a ridge of the gradient of smoothed light (Canny 1986) a line is fitted to the centroids of
//! the gradient in rows across it.

use crate::grey_image::{GreyImage, dilated, gaussian};

/// Half of the window of an edge, along it and across, px.
pub const ALONG: f32 = 8.0;
pub const ACROSS: f32 = 6.0;
/// Half-width of the square around an edge without other edges, px.
const SUPPRESSION_RADIUS_PX: usize = 6;
/// Smallest distance of an edge from the picture's border, px.
const MARGIN_PX: usize = 16;
/// σ of the smoothing, px.
const SMOOTHING_SIGMA_PX: f32 = 1.0;
/// Smallest gradient of smoothed light, of full scale per px.
const MIN_GRADIENT: f32 = 0.015;
/// Largest number of tested ridge points.
const MAX_CANDIDATES: usize = 4000;
/// Distance of the samples across an edge, px.
const PITCH_PX: f32 = 0.5;
/// Centroid of the gradient: window across the edge, px, and threshold by the row's maximum.
const CENTROID_RADIUS_PX: f32 = 2.6;
const CENTROID_THRESHOLD: f32 = 0.3;
/// Largest root mean square distance of the centroids from the line, px.
const MAX_RESIDUAL_PX: f32 = 0.15;
/// Largest slope of the line against the edge direction at its middle, px per px.
const MAX_TILT: f32 = 0.25;

/// A straight piece of an edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeLine {
    /// The pixel in its middle.
    pub x: usize,
    pub y: usize,
    /// The direction of its normal from x to y, radians; the brighter side lies there.
    pub angle: f32,
    /// Offset from the pixel's middle along the normal, px.
    pub offset_px: f32,
}

/// The edges of a picture of linear light, at most `max_lines`, none of them near a clipped pixel.
/// `is_candidate` preselects them by their middle and normal.
pub fn edges(
    light: &GreyImage,
    is_clipped: &[bool],
    max_lines: usize,
    is_candidate: impl Fn(usize, usize, [f32; 2]) -> bool,
) -> Vec<EdgeLine> {
    let (w, h) = (light.width, light.height);
    let (along, down) = light.filtered(&gaussian(SMOOTHING_SIGMA_PX)).sobel();
    let slope: Vec<f32> = along.values.iter().zip(&down.values).map(|(x, y)| x.hypot(*y)).collect();
    let slope = GreyImage { width: w, height: h, values: slope };
    let clipped: Vec<f32> = is_clipped.iter().map(|clipped| f32::from(u8::from(*clipped))).collect();
    let near_clipped = dilated(&clipped, w, ACROSS as usize + 1);
    let mut ridge: Vec<(usize, [f32; 2])> = Vec::new();
    for y in MARGIN_PX..h.saturating_sub(MARGIN_PX) {
        for x in MARGIN_PX..w.saturating_sub(MARGIN_PX) {
            let i = y * w + x;
            let steep = slope.values[i];
            if steep <= MIN_GRADIENT || near_clipped[i] > 0.0 {
                continue;
            }
            let n = [along.values[i] / steep, down.values[i] / steep];
            let slope_across =
                |by: f32| slope.sample_inside(x as f32 + by * n[0], y as f32 + by * n[1]).unwrap_or(f32::MAX);
            if steep >= slope_across(1.0) && steep > slope_across(-1.0) {
                ridge.push((i, n));
            }
        }
    }
    ridge.sort_by(|a, b| slope.values[b.0].total_cmp(&slope.values[a.0]).then(a.0.cmp(&b.0)));
    let mut is_taken = vec![false; w * h];
    let mut lines = Vec::new();
    let mut looked = 0;
    for (i, n) in ridge {
        let (x, y) = (i % w, i / w);
        if lines.len() == max_lines || looked == MAX_CANDIDATES {
            break;
        }
        if is_taken[i] || !is_candidate(x, y, n) {
            continue;
        }
        looked += 1;
        let Some(line) = line(&slope, x, y, n) else { continue };
        for row in is_taken.chunks_mut(w).skip(y - SUPPRESSION_RADIUS_PX).take(2 * SUPPRESSION_RADIUS_PX + 1) {
            row[x - SUPPRESSION_RADIUS_PX..=x + SUPPRESSION_RADIUS_PX].fill(true);
        }
        lines.push(line);
    }
    lines
}

/// Fits a line at a ridge point; `None` if the edge is not straight.
fn line(slope: &GreyImage, x: usize, y: usize, n: [f32; 2]) -> Option<EdgeLine> {
    let t = [-n[1], n[0]];
    let across: Vec<f32> = steps(ACROSS, PITCH_PX);
    let rows = steps(ALONG, 1.0);
    let mut centroids = Vec::with_capacity(rows.len());
    for v in &rows {
        let at = |u: &f32| slope.sample_inside(x as f32 + u * n[0] + v * t[0], y as f32 + u * n[1] + v * t[1]);
        let values: Vec<f32> = across.iter().map(at).collect::<Option<_>>()?;
        let floor = CENTROID_THRESHOLD * values.iter().copied().fold(0.0, f32::max);
        let (mut sum, mut moment) = (0.0, 0.0);
        for (u, value) in across.iter().zip(&values) {
            let inside = if u.abs() < CENTROID_RADIUS_PX { *value } else { 0.0 };
            let over = (inside - floor).max(0.0);
            (sum, moment) = (sum + over, moment + over * u);
        }
        if sum <= 0.0 {
            return None;
        }
        centroids.push(moment / sum);
    }
    // Rows are symmetric about the middle, so mean and tilt are independent.
    let count = rows.len() as f32;
    let middle = centroids.iter().sum::<f32>() / count;
    let tilt = rows.iter().zip(&centroids).map(|(v, c)| v * c).sum::<f32>() / rows.iter().map(|v| v * v).sum::<f32>();
    let off: f32 = rows.iter().zip(&centroids).map(|(v, c)| (c - middle - tilt * v).powi(2)).sum();
    if (off / count).sqrt() > MAX_RESIDUAL_PX || tilt.abs() > MAX_TILT {
        return None;
    }
    // u = middle + tilt·v, of which (1, −tilt) in (u, v) is the normal.
    let angle = n[1].atan2(n[0]) - tilt.atan();
    Some(EdgeLine { x, y, angle, offset_px: middle * tilt.atan().cos() })
}

/// The values from −`to` to `to`.
fn steps(to: f32, pitch: f32) -> Vec<f32> {
    let half = (to / pitch) as i32;
    (-half..=half).map(|k| k as f32 * pitch).collect()
}
