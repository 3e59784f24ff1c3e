//! A tag's corners to a few hundredths of a pixel, from all of its outer edges' pixels.
//!
//! Across an edge light goes from black to white. However it is blurred, as long as it is blurred alike to both sides, the
//! light that is gathered from −h to h is what a sharp edge at e would give: ∫ L = B (h + e) + W (h − e), B and W the light
//! well inside and well outside. That holds in light; codes are curved, and would make black squares larger. A line
//! through the edge's places, where it crosses its neighbours', is the corner.

use glam::DVec2;

use super::detect::Found;
use super::grey::Grey;
use crate::camera::Geometry;

/// Profiles reach this share of a cell to both sides: no other edge lies in it...
const REACH: f64 = 0.8;
/// ... and at most so many px,
const WIDEST_PX: f64 = 3.5;
/// and at least so many: a narrower one holds no edge.
const NARROWEST_PX: f64 = 1.2;
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
    // A profile that begins on the edge sees as much of black as of white, whatever the light does farther away.
    once(grey, geometry, cells, &once(grey, geometry, cells, tag))
}

fn once(grey: &Grey, geometry: &Geometry, cells: u32, tag: &Found) -> Found {
    let corners = tag.corners_px;
    let rays = corners.map(|corner| geometry.unproject(corner));
    let lines: [Option<Line>; 4] = std::array::from_fn(|i| {
        let four = [3, 0, 1, 2].map(|n| corners[(i + n) % 4]);
        let bulge = match (rays[i], rays[(i + 1) % 4]) {
            // What is straight in the world is bent by the lens.
            (Some(a), Some(b)) => {
                geometry.project(0.5 * (a + b)).map_or(DVec2::ZERO, |at| at - 0.5 * (four[1] + four[2]))
            }
            _ => DVec2::ZERO,
        };
        edge(grey, four, bulge, cells)
    });
    let corners_px = std::array::from_fn(|i| {
        let crossing =
            lines[(i + 3) % 4].as_ref().zip(lines[i].as_ref()).and_then(|(before, after)| before.crossing(after));
        // A pixel and a half is more than the search is ever off.
        crossing.filter(|at| at.distance(corners[i]) < 1.5).unwrap_or(corners[i])
    });
    Found { id: tag.id, corners_px }
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

/// The line of the edge between the inner two of four corners, as if the lens did not bend it by `bulge` in its middle.
fn edge(grey: &Grey, [before, from, to, after]: [DVec2; 4], bulge: DVec2, cells: u32) -> Option<Line> {
    let length = from.distance(to);
    let along = (to - from).try_normalize()?;
    let inside = 0.5 * (before + after) - 0.5 * (from + to);
    let outwards = -along.perp() * inside.dot(along.perp()).signum();
    // Seen aslant a cell is narrower across the edge than along it.
    let cell = inside.dot(outwards).abs() / f64::from(cells);
    let reach = (REACH * cell).min(WIDEST_PX);
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
    let mut places: Vec<DVec2> = (0..count)
        .filter_map(|i| {
            let t = (begins + free * (i as f64 + 0.5) / count as f64) / length;
            let bent = bulge * (4.0 * t * (1.0 - t));
            let at = from.lerp(to, t) + bent;
            Some(at + outwards * crossing(grey, at, outwards, reach)? - bent)
        })
        .collect();
    let mut line = None;
    for _ in 0..FITS {
        if places.len() < LEAST_PLACES {
            return None;
        }
        let fitted = Line::through(&places);
        let mut distances: Vec<f64> = places.iter().map(|place| fitted.distance(*place)).collect();
        distances.sort_by(f64::total_cmp);
        let far = FAR * distances[distances.len() / 2].max(0.02);
        places.retain(|place| fitted.distance(*place) <= far);
        line = Some(fitted);
    }
    line
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
