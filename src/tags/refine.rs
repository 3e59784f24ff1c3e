//! A tag's corners to a few hundredths of a pixel, from all of its outer edges' pixels.
//!
//! Across an edge light goes from black to white. However it is blurred, as long as it is blurred alike to both sides, the
//! light that is gathered from −h to h is what a sharp edge at e would give: ∫ L = B (h + e) + W (h − e), B and W the light
//! well inside and well outside. That holds in light; codes are curved, and would make black squares larger. A line
//! through the edge's places, where it crosses its neighbours', is the corner.
//!
//! A lens bends edges. Where its distortion is known, so is by how much. Where it is not, the places themselves tell: an
//! edge is short before the picture, so it bends as a parabola.

use glam::{DMat3, DVec2, DVec3};

use super::detect::Found;
use super::grey::Grey;
use crate::camera::Geometry;

/// Profiles reach this share of a cell to both sides: no other edge lies in it...
const REACH: f64 = 0.8;
/// ... and at most so many px,
const WIDEST_PX: f64 = 3.5;
/// and at least so many: a narrower one holds no edge.
const NARROWEST_PX: f64 = 1.2;
/// A search that knows of no lens is off by this share of a cell at most: it takes bent edges for straight ones...
const OFF_CELLS: f64 = 0.5;
/// ... and any other by so many px.
const OFF_PX: f64 = 1.5;
/// An edge bends by this share of its length at most.
const MOST_BENT: f64 = 0.1;
/// Steps along a profile, px.
const STEP_PX: f64 = 0.5;
/// At its ends so many px tell how bright black and white are.
const END_PX: f64 = 0.75;
/// Profiles along an edge.
const MOST_PROFILES: usize = 24;
/// A profile with less contrast than this, in light of full scale, tells nothing.
const FAINT: f64 = 0.02;
/// Lines are fitted so often, each time without what lies farther from the last one than this many median distances.
const FITS: usize = 3;
const FAR: f64 = 3.0;
/// Fewer places make no line.
const LEAST_PLACES: usize = 4;

/// Refines a tag's corners. One whose edges cannot be read stays as it was found. `cells` are those along a side.
pub fn refined(grey: &Grey, geometry: &Geometry, cells: u32, tag: &Found) -> Found {
    // What is straight in the world is bent by the lens.
    let bulges = |corners: [DVec2; 4]| {
        let rays = corners.map(|corner| geometry.unproject(corner));
        std::array::from_fn(|i| {
            let middle = rays[i].zip(rays[(i + 1) % 4]).and_then(|(a, b)| geometry.project(0.5 * (a + b)));
            middle.map_or(DVec2::ZERO, |at| at - 0.5 * (corners[i] + corners[(i + 1) % 4]))
        })
    };
    let once = |corners: [DVec2; 4]| {
        let crossed = crossed(corners, edges(grey, corners, bulges(corners), cells, WIDEST_PX), OFF_PX);
        std::array::from_fn(|i| crossed[i].unwrap_or(corners[i]))
    };
    // A profile that begins on the edge sees as much of black as of white, whatever the light does farther away.
    Found { id: tag.id, corners_px: once(once(tag.corners_px)) }
}

/// The same where the lens is not known: how far edges are bent is read off them. `None` if they cannot be read all, for
/// what was found is not where straight edges would cross.
pub fn refined_of_any_lens(grey: &Grey, cells: u32, tag: &Found) -> Option<Found> {
    let (mut corners_px, mut bulges) = (tag.corners_px, [DVec2::ZERO; 4]);
    let off_px = OFF_PX.max(OFF_CELLS * corners_px[0].distance(corners_px[2]) / (2f64.sqrt() * f64::from(cells)));
    // At first the places may lie far from a straight edge.
    for widest_px in [f64::INFINITY, WIDEST_PX, WIDEST_PX] {
        let edges = edges(grey, corners_px, bulges, cells, widest_px);
        for (i, edge) in edges.iter().enumerate() {
            let most = MOST_BENT * corners_px[i].distance(corners_px[(i + 1) % 4]);
            let more = edge.as_ref().map_or(DVec2::ZERO, |edge| edge.bend);
            bulges[i] = (bulges[i] + more).clamp_length_max(most);
        }
        let [a, b, c, d] = crossed(corners_px, edges, off_px);
        corners_px = [a?, b?, c?, d?];
    }
    Some(Found { id: tag.id, corners_px })
}

fn edges(grey: &Grey, corners: [DVec2; 4], bulges: [DVec2; 4], cells: u32, widest_px: f64) -> [Option<Edge>; 4] {
    std::array::from_fn(|i| edge(grey, [3, 0, 1, 2].map(|n| corners[(i + n) % 4]), bulges[i], cells, widest_px))
}

/// Where edges cross near the corners.
fn crossed(corners: [DVec2; 4], edges: [Option<Edge>; 4], off_px: f64) -> [Option<DVec2>; 4] {
    std::array::from_fn(|i| {
        let crossing = edges[(i + 3) % 4].as_ref().zip(edges[i].as_ref());
        let crossing = crossing.and_then(|(before, after)| before.line.crossing(&after.line));
        crossing.filter(|at| at.distance(corners[i]) < off_px)
    })
}

/// An edge as it would be if the lens did not bend it, and by how much more than assumed its middle is bent.
struct Edge {
    line: Line,
    bend: DVec2,
}

struct Line {
    through: DVec2,
    /// Unit length.
    along: DVec2,
}

impl Line {
    fn crossing(&self, other: &Self) -> Option<DVec2> {
        let turn = self.along.perp_dot(other.along);
        (turn.abs() > 0.1)
            .then(|| self.through + self.along * ((other.through - self.through).perp_dot(other.along) / turn))
    }

    /// With the least squares of the distances to it.
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

/// The edge between the inner two of four corners, of which it is assumed that the lens bends its middle by `bulge`. Profiles
/// reach `widest_px` at most.
fn edge(grey: &Grey, [before, from, to, after]: [DVec2; 4], bulge: DVec2, cells: u32, widest_px: f64) -> Option<Edge> {
    let length = from.distance(to);
    let along = (to - from).try_normalize()?;
    let inside = 0.5 * (before + after) - 0.5 * (from + to);
    let outwards = -along.perp() * inside.dot(along.perp()).signum();
    // Seen aslant a cell is narrower across the edge than along it.
    let cell = inside.dot(outwards).abs() / f64::from(cells);
    let reach = (REACH * cell).min(widest_px);
    if reach < NARROWEST_PX {
        return None;
    }
    // Nearer to a corner the neighbouring edge's light comes in.
    let spare = |corner: DVec2, along: DVec2, next: DVec2| {
        let next = (next - corner).normalize_or_zero();
        (1.5 + reach * along.dot(next).max(0.0)) / along.perp_dot(next).abs().max(0.1)
    };
    let (begins, ends) = (spare(from, along, before), spare(to, -along, after));
    let free = length - begins - ends;
    if free <= 1.0 {
        return None;
    }
    let count = (free.ceil() as usize).clamp(LEAST_PLACES, MOST_PROFILES);
    let mut places: Vec<(f64, DVec2)> = (0..count)
        .filter_map(|i| {
            let t = (begins + free * (i as f64 + 0.5) / count as f64) / length;
            let bent = bulge * parabola(t);
            let at = from.lerp(to, t) + bent;
            Some((t, at + outwards * crossing(grey, at, outwards, reach)? - bent))
        })
        .collect();
    let mut line = None;
    for _ in 0..FITS {
        if places.len() < LEAST_PLACES {
            return None;
        }
        let fitted = Line::through(&places.iter().map(|(_, place)| *place).collect::<Vec<_>>());
        let mut distances: Vec<f64> = places.iter().map(|(_, place)| fitted.distance(*place)).collect();
        distances.sort_by(f64::total_cmp);
        let far = FAR * distances[distances.len() / 2].max(0.02);
        places.retain(|(_, place)| fitted.distance(*place) <= far);
        line = Some(fitted);
    }
    let beside: Vec<(f64, f64)> = places.iter().map(|(t, place)| (*t, (*place - from).dot(outwards))).collect();
    line.map(|line| Edge { line, bend: outwards * bend(&beside) })
}

/// 0 at an edge's ends, 1 in its middle.
fn parabola(t: f64) -> f64 {
    4.0 * t * (1.0 - t)
}

/// How far the middle of an edge lies off the way between its ends: c of the least squares' a + b t + c 4t(1 − t). 0 if the
/// places do not tell.
fn bend(places: &[(f64, f64)]) -> f64 {
    let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for (t, off) in places {
        let by = DVec3::new(1.0, *t, parabola(*t));
        normal += DMat3::from_cols(by * by.x, by * by.y, by * by.z);
        right += by * *off;
    }
    // Places all along an edge have a determinant of about 0.007 N³.
    let told = places.len() > LEAST_PLACES && normal.determinant() > 1e-4 * (places.len() as f64).powi(3);
    if told { (normal.inverse() * right).z } else { 0.0 }
}

/// How far outwards of a place the edge is, px.
fn crossing(grey: &Grey, at: DVec2, outwards: DVec2, reach: f64) -> Option<f64> {
    if !grey.holds(at, reach + 1.0) {
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
    (contrast > FAINT && e.abs() < reach).then_some(e)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bend_worked_by_hand() {
        // 0, 1.5, 2, 1.5, 0 on a slope: 2 in the middle.
        let of = |count: i32| -> Vec<(f64, f64)> {
            let places = (0..count).map(|i| f64::from(i) / 4.0);
            places.map(|t| (t, 5.0 - 3.0 * t + 2.0 * parabola(t))).collect()
        };
        assert!((bend(&of(5)) - 2.0).abs() < 1e-9, "{}", bend(&of(5)));
        assert_eq!((bend(&of(4)), bend(&[]), bend(&[(0.5, 1.0); 9])), (0.0, 0.0, 0.0));
    }
}
