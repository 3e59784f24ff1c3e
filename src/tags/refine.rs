//! Refines a tag's corners to a few hundredths of a pixel, from all pixels along its outer edges.
//!
//! Across an edge light rises from black to white. For any symmetric blur the integral of light
//! from −h to h equals that of a sharp edge at e: ∫ L = B (h + e) + W (h − e), B and W the light
//! well inside and well outside. This holds for linear light; gamma-encoded codes would enlarge
//! black squares. A line is fitted to the positions along each edge, and the crossings of
//! neighbouring lines are the corners.
//!
//! A lens bends edges. If its distortion is known, so is the bend. Otherwise the bend is estimated
//! from the positions: over its short length an edge bends as a parabola.

use glam::{DMat3, DVec2, DVec3};

use super::detect::DetectedTag;
use super::luma_codes::LumaCodes;
use crate::camera::Geometry;
use crate::fit::quantile::upper_median;

/// Half length of the profiles as a share of a cell, so that they contain no other edge...
const REACH_CELLS: f64 = 0.8;
/// ... limited to this, px.
const MAX_REACH_PX: f64 = 3.5;
/// Smallest half length of a profile, px.
const MIN_REACH_PX: f64 = 1.2;
/// Largest accepted correction of a corner without a known lens, as a share of a cell: the detector
/// assumes straight edges...
const MAX_CORRECTION_CELLS: f64 = 0.5;
/// ... and in all cases, px.
const MAX_CORRECTION_PX: f64 = 1.5;
/// Largest bend of an edge as a share of its length.
const MAX_BEND_SHARE: f64 = 0.1;
/// Step along a profile, px.
const STEP_PX: f64 = 0.5;
/// Length of the ends of a profile that determine black and white, px.
const END_PX: f64 = 0.75;
/// Largest number of profiles along an edge.
const MAX_PROFILES: usize = 24;
/// Smallest contrast of a profile, as a share of full scale.
const MIN_CONTRAST: f64 = 0.02;
/// Number of line fits. Each one omits points farther from the previous line than
/// [`OUTLIER_DISTANCE`] median distances.
const LINE_FITS: usize = 3;
const OUTLIER_DISTANCE: f64 = 3.0;
/// Smallest number of points of a line.
const MIN_POINTS: usize = 4;

/// Refines a tag's corners. A tag with unreadable edges is unchanged. `cells` is the number along a
/// side.
pub fn refine_corners(grey: &LumaCodes, geometry: &Geometry, cells: u32, tag: &DetectedTag) -> DetectedTag {
    // Straight edges of the world are bent by the lens.
    let bulges = |corners: [DVec2; 4]| {
        let rays = corners.map(|corner| geometry.unproject(corner));
        std::array::from_fn(|i| {
            let middle = rays[i].zip(rays[(i + 1) % 4]).and_then(|(a, b)| geometry.project(0.5 * (a + b)));
            middle.map_or(DVec2::ZERO, |at| at - 0.5 * (corners[i] + corners[(i + 1) % 4]))
        })
    };
    let once = |corners: [DVec2; 4]| {
        let crossed = crossed(corners, edges(grey, corners, bulges(corners), cells, MAX_REACH_PX), MAX_CORRECTION_PX);
        std::array::from_fn(|i| crossed[i].unwrap_or(corners[i]))
    };
    // The second pass starts on the edge, so that black and white have equal weight, whatever the
    // light farther away.
    DetectedTag { id: tag.id, corners_px: once(once(tag.corners_px)) }
}

/// Refines a tag's corners without a known lens; the bend of the edges is estimated. `None` if an
/// edge is unreadable, because the detected corners are not the crossings of straight edges.
pub fn refine_corners_without_lens(grey: &LumaCodes, cells: u32, tag: &DetectedTag) -> Option<DetectedTag> {
    let (mut corners_px, mut bulges) = (tag.corners_px, [DVec2::ZERO; 4]);
    let off_px = MAX_CORRECTION_PX
        .max(MAX_CORRECTION_CELLS * corners_px[0].distance(corners_px[2]) / (2f64.sqrt() * f64::from(cells)));
    // At first the points may be far from a straight edge.
    for widest_px in [f64::INFINITY, MAX_REACH_PX, MAX_REACH_PX] {
        let edges = edges(grey, corners_px, bulges, cells, widest_px);
        for (i, edge) in edges.iter().enumerate() {
            let max_bulge_px = MAX_BEND_SHARE * corners_px[i].distance(corners_px[(i + 1) % 4]);
            let more = edge.as_ref().map_or(DVec2::ZERO, |edge| edge.bend);
            bulges[i] = (bulges[i] + more).clamp_length_max(max_bulge_px);
        }
        let [a, b, c, d] = crossed(corners_px, edges, off_px);
        corners_px = [a?, b?, c?, d?];
    }
    Some(DetectedTag { id: tag.id, corners_px })
}

fn edges(
    grey: &LumaCodes,
    corners: [DVec2; 4],
    bulges: [DVec2; 4],
    cells: u32,
    widest_px: f64,
) -> [Option<TagEdge>; 4] {
    std::array::from_fn(|i| edge(grey, [3, 0, 1, 2].map(|n| corners[(i + n) % 4]), bulges[i], cells, widest_px))
}

/// Crossings of the edges near the corners.
fn crossed(corners: [DVec2; 4], edges: [Option<TagEdge>; 4], off_px: f64) -> [Option<DVec2>; 4] {
    std::array::from_fn(|i| {
        let crossing = edges[(i + 3) % 4].as_ref().zip(edges[i].as_ref());
        let crossing = crossing.and_then(|(before, after)| before.line.crossing(&after.line));
        crossing.filter(|at| at.distance(corners[i]) < off_px)
    })
}

/// An edge without the lens's bend, and the remaining bend at its middle beyond the assumed one.
struct TagEdge {
    line: ImageLine,
    bend: DVec2,
}

struct ImageLine {
    through: DVec2,
    /// Unit length.
    along: DVec2,
}

impl ImageLine {
    fn crossing(&self, other: &Self) -> Option<DVec2> {
        let turn = self.along.perp_dot(other.along);
        (turn.abs() > 0.1)
            .then(|| self.through + self.along * ((other.through - self.through).perp_dot(other.along) / turn))
    }

    /// Least-squares line.
    fn through(places: &[DVec2]) -> Self {
        let through = places.iter().sum::<DVec2>() / places.len().max(1) as f64;
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for p in places.iter().map(|p| *p - through) {
            (xx, xy, yy) = (xx + p.x * p.x, xy + p.x * p.y, yy + p.y * p.y);
        }
        Self { through, along: DVec2::from_angle(0.5 * (2.0 * xy).atan2(xx - yy)) }
    }

    fn distance(&self, at: DVec2) -> f64 {
        (at - self.through).perp_dot(self.along).abs()
    }
}

/// Fits the edge between the inner two of four corners. `bulge` is the assumed bend at its middle.
/// The profiles' half length is at most `widest_px`.
fn edge(
    grey: &LumaCodes,
    [before, from, to, after]: [DVec2; 4],
    bulge: DVec2,
    cells: u32,
    widest_px: f64,
) -> Option<TagEdge> {
    let length = from.distance(to);
    let along = (to - from).try_normalize()?;
    let inside = 0.5 * (before + after) - 0.5 * (from + to);
    let outwards = -along.perp() * inside.dot(along.perp()).signum();
    // In a foreshortened view a cell is narrower across the edge than along it.
    let cell = inside.dot(outwards).abs() / f64::from(cells);
    let reach = (REACH_CELLS * cell).min(widest_px);
    if reach < MIN_REACH_PX {
        return None;
    }
    // Closer to a corner the profile contains light of the neighbouring edge.
    let spare = |corner: DVec2, along: DVec2, next: DVec2| {
        let next = (next - corner).normalize_or_zero();
        (1.5 + reach * along.dot(next).max(0.0)) / along.perp_dot(next).abs().max(0.1)
    };
    let (begins, ends) = (spare(from, along, before), spare(to, -along, after));
    let free = length - begins - ends;
    if free <= 1.0 {
        return None;
    }
    let count = (free.ceil() as usize).clamp(MIN_POINTS, MAX_PROFILES);
    let mut places: Vec<(f64, DVec2)> = (0..count)
        .filter_map(|i| {
            let t = (begins + free * (i as f64 + 0.5) / count as f64) / length;
            let bent = bulge * parabola(t);
            let at = from.lerp(to, t) + bent;
            Some((t, at + outwards * crossing(grey, at, outwards, reach)? - bent))
        })
        .collect();
    let mut line = None;
    for _ in 0..LINE_FITS {
        if places.len() < MIN_POINTS {
            return None;
        }
        let fitted = ImageLine::through(&places.iter().map(|(_, place)| *place).collect::<Vec<_>>());
        let distances = places.iter().map(|(_, place)| fitted.distance(*place));
        let far = OUTLIER_DISTANCE * upper_median(distances)?.max(0.02);
        places.retain(|(_, place)| fitted.distance(*place) <= far);
        line = Some(fitted);
    }
    let beside: Vec<(f64, f64)> = places.iter().map(|(t, place)| (*t, (*place - from).dot(outwards))).collect();
    line.map(|line| TagEdge { line, bend: outwards * bend(&beside) })
}

/// 0 at an edge's ends, 1 in its middle.
fn parabola(t: f64) -> f64 {
    4.0 * t * (1.0 - t)
}

/// Bend of an edge at its middle: c of the least-squares fit a + b t + c 4t(1 − t). 0 if it is not
/// determined.
fn bend(places: &[(f64, f64)]) -> f64 {
    let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for (t, off) in places {
        let by = DVec3::new(1.0, *t, parabola(*t));
        normal += DMat3::from_cols(by * by.x, by * by.y, by * by.z);
        right += by * *off;
    }
    // Points all along an edge have a determinant of about 0.007 N³.
    let is_determined = places.len() > MIN_POINTS && normal.determinant() > 1e-4 * (places.len() as f64).powi(3);
    if is_determined { (normal.inverse() * right).z } else { 0.0 }
}

/// Distance of the edge outwards from a point, px.
fn crossing(grey: &LumaCodes, at: DVec2, outwards: DVec2, reach: f64) -> Option<f64> {
    if !grey.codes.holds(at, reach + 1.0) {
        return None;
    }
    let count = (2.0 * reach / STEP_PX).ceil() as usize;
    let step = 2.0 * reach / count as f64;
    let (mut sum, mut inside, mut outside, mut at_ends) = (0.0, 0.0, 0.0, 0.0);
    let ends = ((END_PX / step).round() as usize).max(1);
    for i in 0..count {
        let light = grey.light_at(at + outwards * (step * (i as f64 + 0.5) - reach));
        sum += light;
        if i < ends {
            inside += light;
            at_ends += 1.0;
        }
        if i + ends >= count {
            outside += light;
        }
    }
    let (black, white) = (inside / at_ends, outside / at_ends);
    let contrast = white - black;
    let e = (reach * (black + white) - sum * step) / contrast;
    (contrast > MIN_CONTRAST && e.abs() < reach).then_some(e)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bend_matches_the_computed_value() {
        // 0, 1.5, 2, 1.5, 0 on a slope: 2 in the middle.
        let parabola_samples = |count: i32| -> Vec<(f64, f64)> {
            let places = (0..count).map(|i| f64::from(i) / 4.0);
            places.map(|t| (t, 5.0 - 3.0 * t + 2.0 * parabola(t))).collect()
        };
        assert!((bend(&parabola_samples(5)) - 2.0).abs() < 1e-9, "{}", bend(&parabola_samples(5)));
        assert_eq!((bend(&parabola_samples(4)), bend(&[]), bend(&[(0.5, 1.0); 9])), (0.0, 0.0, 0.0));
    }
}
