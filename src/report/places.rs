//! Places of a frame that are worth following: textured ones, by which one sees where they are, and flat ones, by which one sees
//! how bright they are.

use glam::DVec2;

use crate::analyse::Plane;
use crate::frame::Frame;
use crate::pixels::{DepthMap, Pixels};

/// Every so many pixels is looked at; the best of each square of `CELL` px is kept.
const STEP: usize = 4;
const CELL: usize = 32;
/// So far from the picture's rim, px.
const RIM: usize = 40;
/// Texture counts within this radius, px, flatness within that.
const TEXTURED: usize = 6;
const FLAT: usize = 28;
/// Flat places differ by at most this, σ of codes of 255, and lie between these codes.
const MOST_SIGMA: f64 = 9.0;
const CODES: (f64, f64) = (45.0, 215.0);
/// Depth is known so far about a place, px, and differs there by at most this share.
const SMOOTH: i64 = 5;
const ALIKE: f64 = 0.03;

/// A place on a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    pub at: DVec2,
    /// Along the optical axis.
    pub depth_m: f64,
    /// How textured or how flat it is, above 0.
    pub score: f64,
}

/// Places whose texture tells both directions: the smaller eigenvalue of Σ∇I∇Iᵀ (Shi and Tomasi 1994), codes² per px².
pub fn textured(frame: &Frame) -> Vec<Place> {
    let luma = Plane::of(&frame.pixels);
    best(frame, |x, y| {
        Some(smaller_eigenvalue(&luma.values, frame.pixels.width as usize, x, y)).filter(|score| *score > 0.0)
    })
}

/// Places of one colour: the inverse of σ over the channels.
pub fn flat(frame: &Frame) -> Vec<Place> {
    best(frame, |x, y| {
        let sigma = (0..3).map(|c| even(&frame.pixels, x, y, c)).try_fold(0.0, |most: f64, s| Some(most.max(s?)))?;
        (sigma <= MOST_SIGMA).then_some(1.0 / (1.0 + sigma))
    })
}

/// The best of each cell where depth is smooth.
fn best(frame: &Frame, score: impl Fn(usize, usize) -> Option<f64>) -> Vec<Place> {
    let Some(depth) = &frame.depth else { return Vec::new() };
    let (width, height) = (frame.pixels.width as usize, frame.pixels.height as usize);
    if (depth.width as usize, depth.height as usize) != (width, height) {
        return Vec::new();
    }
    let mut found = Vec::new();
    for top in (RIM..height.saturating_sub(RIM)).step_by(CELL) {
        for left in (RIM..width.saturating_sub(RIM)).step_by(CELL) {
            let mut of_cell: Option<Place> = None;
            for y in (top..(top + CELL).min(height - RIM)).step_by(STEP) {
                for x in (left..(left + CELL).min(width - RIM)).step_by(STEP) {
                    let Some(depth_m) = smooth(depth, x, y) else { continue };
                    let Some(score) = score(x, y) else { continue };
                    if of_cell.is_none_or(|best| score > best.score) {
                        of_cell = Some(Place { at: DVec2::new(x as f64 + 0.5, y as f64 + 0.5), depth_m, score });
                    }
                }
            }
            found.extend(of_cell);
        }
    }
    found
}

/// The depth of a surface that reaches a little about a place.
pub fn smooth(depth: &DepthMap, x: usize, y: usize) -> Option<f64> {
    let (width, height) = (i64::from(depth.width), i64::from(depth.height));
    let at = |dx: i64, dy: i64| {
        let (x, y) = (x as i64 + dx, y as i64 + dy);
        let is_inside = x >= 0 && y >= 0 && x < width && y < height;
        is_inside.then(|| f64::from(depth.depth_m[(y * width + x) as usize]))
    };
    let here = at(0, 0).filter(|z| *z > 0.0)?;
    let about = (0..9).map(|n| at(SMOOTH * (n % 3 - 1), SMOOTH * (n / 3 - 1)));
    about.into_iter().all(|z| z.is_some_and(|z| z > 0.0 && (z - here).abs() < ALIKE * here)).then_some(here)
}

/// Of luma, codes of 255.
fn smaller_eigenvalue(grey: &[f32], width: usize, x: usize, y: usize) -> f64 {
    let (mut xx, mut xy, mut yy) = (0.0f64, 0.0f64, 0.0f64);
    for v in y - TEXTURED..=y + TEXTURED {
        for i in v * width + x - TEXTURED..=v * width + x + TEXTURED {
            let along = f64::from(grey[i + 1] - grey[i - 1]) / 2.0;
            let down = f64::from(grey[i + width] - grey[i - width]) / 2.0;
            (xx, xy, yy) = (xx + along * along, xy + along * down, yy + down * down);
        }
    }
    0.5 * (xx + yy - (xx - yy).hypot(2.0 * xy)) / (2 * TEXTURED + 1).pow(2) as f64
}

/// σ of a channel about a place; `None` if it is dark or bright.
fn even(pixels: &Pixels, x: usize, y: usize, channel: usize) -> Option<f64> {
    let (mut sum, mut squares, mut count) = (0.0, 0.0, 0.0);
    for v in (y - FLAT..=y + FLAT).step_by(4) {
        for u in (x - FLAT..=x + FLAT).step_by(4) {
            let code = f64::from(pixels.eight_bits_at(u as u32, v as u32)[channel]);
            (sum, squares, count) = (sum + code, squares + code * code, count + 1.0);
        }
    }
    let mean: f64 = sum / count;
    (mean > CODES.0 && mean < CODES.1).then(|| (squares / count - mean * mean).max(0.0).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::FrameExposure;

    /// Grey, with a chessboard of 8 px about (100, 60); depth 2 m, and a step at column 160.
    fn frame() -> Frame {
        let code = |n: u32| {
            let (x, y) = (n % 240, n / 240);
            let is_board = (84..116).contains(&x) && (44..76).contains(&y);
            if is_board { 60 + 100 * (((x / 8) + (y / 8)) % 2) as u8 } else { 100 }
        };
        let codes = (0..240 * 160).flat_map(|n| [code(n); 3]).collect();
        let depth_m = (0..240 * 160).map(|n| if n % 240 < 160 { 2.0 } else { 3.0 }).collect();
        Frame {
            index: 0,
            timestamp_s: 0.0,
            pixels: Pixels::from_u8(240, 160, codes).unwrap(),
            depth: Some(DepthMap { width: 240, height: 160, depth_m, timestamp_s: 0.0 }),
            exposure: FrameExposure::default(),
            presence: 1.0,
            beside: Vec::new(),
            surfels: Default::default(),
        }
    }

    #[test]
    fn texture_is_found_where_it_is_and_flat_places_elsewhere() {
        let frame = frame();
        let most = textured(&frame).into_iter().max_by(|a, b| a.score.total_cmp(&b.score)).unwrap();
        assert!((most.at - DVec2::new(100.0, 60.0)).abs().max_element() < 12.0, "{most:?}");
        assert_eq!(most.depth_m, 2.0);
        let flat = flat(&frame);
        assert!(!flat.is_empty());
        for place in &flat {
            // Farther from the board than the place is wide, or only its rim touches it; never on the step of depth.
            let off = (place.at - DVec2::new(100.0, 60.0)).abs().max_element();
            assert!(off > 38.0 && (place.at.x - 160.0).abs() > 4.0, "{place:?}");
        }
    }

    #[test]
    fn an_edge_is_no_texture_and_no_depth_is_no_place() {
        let mut frame = frame();
        let codes = (0..240 * 160).flat_map(|n| [if n % 240 < 100 { 50 } else { 150 }; 3]).collect();
        frame.pixels = Pixels::from_u8(240, 160, codes).unwrap();
        assert!(textured(&frame).iter().all(|place| place.score < 1e-3));
        frame.depth = None;
        assert!(textured(&frame).is_empty() && flat(&frame).is_empty());
    }
}
