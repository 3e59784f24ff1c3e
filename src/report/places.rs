//! Selects places of a frame for tracking: textured ones for position, and flat ones for
//! brightness.

use glam::DVec2;

use crate::frame::Frame;
use crate::grey_image::GreyImage;
use crate::pixels::{DepthMap, Pixels};

/// Step between candidates, px, and side of the cells of which the best is kept, px.
const STEP_PX: usize = 4;
const CELL_PX: usize = 32;
/// Smallest distance from the picture's border, px.
const MARGIN_PX: usize = 40;
/// Radii of the windows for texture and for flatness, px.
const TEXTURE_RADIUS_PX: usize = 6;
const FLAT_RADIUS_PX: usize = 28;
/// Largest σ of a flat place, and range of its codes, of 255.
const MAX_FLAT_SIGMA: f64 = 9.0;
const CODES: (f64, f64) = (45.0, 215.0);
/// Radius around a place with known depth, px, and largest relative depth difference there.
const DEPTH_RADIUS_PX: i64 = 5;
const MAX_DEPTH_DIFFERENCE: f64 = 0.03;

/// A place on a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    pub at: DVec2,
    /// Along the optical axis.
    pub depth_m: f64,
    /// Measure of texture or flatness, above 0.
    pub score: f64,
}

/// Corners: places by the smaller eigenvalue of Σ∇I∇Iᵀ (Shi and Tomasi 1994), codes² per px².
pub fn textured(frame: &Frame) -> Vec<Place> {
    let luma = GreyImage::luma_601(&frame.pixels);
    best(frame, |x, y| {
        Some(smaller_eigenvalue(&luma.values, frame.pixels.width as usize, x, y)).filter(|score| *score > 0.0)
    })
}

/// Places of uniform colour, by the inverse of the largest σ of the channels.
pub fn flat(frame: &Frame) -> Vec<Place> {
    best(frame, |x, y| {
        let sigma =
            (0..3).map(|c| even(&frame.pixels, x, y, c)).try_fold(0.0, |largest: f64, s| Some(largest.max(s?)))?;
        (sigma <= MAX_FLAT_SIGMA).then_some(1.0 / (1.0 + sigma))
    })
}

/// The best place of each cell with smooth depth.
fn best(frame: &Frame, score: impl Fn(usize, usize) -> Option<f64>) -> Vec<Place> {
    let Some(depth) = &frame.depth else { return Vec::new() };
    let (width, height) = (frame.pixels.width as usize, frame.pixels.height as usize);
    if (depth.width as usize, depth.height as usize) != (width, height) {
        return Vec::new();
    }
    let mut places = Vec::new();
    for top in (MARGIN_PX..height.saturating_sub(MARGIN_PX)).step_by(CELL_PX) {
        for left in (MARGIN_PX..width.saturating_sub(MARGIN_PX)).step_by(CELL_PX) {
            let mut of_cell: Option<Place> = None;
            for y in (top..(top + CELL_PX).min(height - MARGIN_PX)).step_by(STEP_PX) {
                for x in (left..(left + CELL_PX).min(width - MARGIN_PX)).step_by(STEP_PX) {
                    let Some(depth_m) = smooth(depth, x, y) else { continue };
                    let Some(score) = score(x, y) else { continue };
                    if of_cell.is_none_or(|best| score > best.score) {
                        of_cell = Some(Place { at: DVec2::new(x as f64 + 0.5, y as f64 + 0.5), depth_m, score });
                    }
                }
            }
            places.extend(of_cell);
        }
    }
    places
}

/// Depth of a place; `None` if it is unknown or not smooth around it.
pub fn smooth(depth: &DepthMap, x: usize, y: usize) -> Option<f64> {
    let (width, height) = (i64::from(depth.width), i64::from(depth.height));
    let at = |dx: i64, dy: i64| {
        let (x, y) = (x as i64 + dx, y as i64 + dy);
        let is_inside = x >= 0 && y >= 0 && x < width && y < height;
        is_inside.then(|| f64::from(depth.depth_m[(y * width + x) as usize]))
    };
    let here = at(0, 0).filter(|z| *z > 0.0)?;
    let about = (0..9).map(|n| at(DEPTH_RADIUS_PX * (n % 3 - 1), DEPTH_RADIUS_PX * (n / 3 - 1)));
    about
        .into_iter()
        .all(|z| z.is_some_and(|z| z > 0.0 && (z - here).abs() < MAX_DEPTH_DIFFERENCE * here))
        .then_some(here)
}

/// Smaller eigenvalue of the structure tensor of luma, codes of 255.
fn smaller_eigenvalue(grey: &[f32], width: usize, x: usize, y: usize) -> f64 {
    let (mut xx, mut xy, mut yy) = (0.0f64, 0.0f64, 0.0f64);
    for v in y - TEXTURE_RADIUS_PX..=y + TEXTURE_RADIUS_PX {
        for i in v * width + x - TEXTURE_RADIUS_PX..=v * width + x + TEXTURE_RADIUS_PX {
            let along = f64::from(grey[i + 1] - grey[i - 1]) / 2.0;
            let down = f64::from(grey[i + width] - grey[i - width]) / 2.0;
            (xx, xy, yy) = (xx + along * along, xy + along * down, yy + down * down);
        }
    }
    0.5 * (xx + yy - (xx - yy).hypot(2.0 * xy)) / (2 * TEXTURE_RADIUS_PX + 1).pow(2) as f64
}

/// σ of a channel about a place; `None` if it is dark or bright.
fn even(pixels: &Pixels, x: usize, y: usize, channel: usize) -> Option<f64> {
    let (mut sum, mut squares, mut count) = (0.0, 0.0, 0.0);
    for v in (y - FLAT_RADIUS_PX..=y + FLAT_RADIUS_PX).step_by(4) {
        for u in (x - FLAT_RADIUS_PX..=x + FLAT_RADIUS_PX).step_by(4) {
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

    /// Grey, with a chessboard of 8 px about (100, 60); depth 2 m, and a step at column 160.
    fn frame() -> Frame {
        let code = |n: u32| {
            let (x, y) = (n % 240, n / 240);
            let is_board = (84..116).contains(&x) && (44..76).contains(&y);
            if is_board { 60 + 100 * (((x / 8) + (y / 8)) % 2) as u8 } else { 100 }
        };
        let codes = (0..240 * 160).flat_map(|n| [code(n); 3]).collect();
        let depth_m = (0..240 * 160).map(|n| if n % 240 < 160 { 2.0 } else { 3.0 }).collect();
        let depth = DepthMap { width: 240, height: 160, depth_m, timestamp_s: 0.0 };
        Frame { depth: Some(depth.into()), ..Frame::new(0, 0.0, Pixels::from_u8(240, 160, codes).unwrap()) }
    }

    #[test]
    fn texture_is_found_on_the_chessboard_and_flat_places_beside_it() {
        let frame = frame();
        let best = textured(&frame).into_iter().max_by(|a, b| a.score.total_cmp(&b.score)).unwrap();
        assert!((best.at - DVec2::new(100.0, 60.0)).abs().max_element() < 12.0, "{best:?}");
        assert_eq!(best.depth_m, 2.0);
        let flat = flat(&frame);
        assert!(!flat.is_empty());
        for place in &flat {
            // Farther from the board than the place is wide, or only its rim touches it; never on
            // the step of depth.
            let off = (place.at - DVec2::new(100.0, 60.0)).abs().max_element();
            assert!(off > 38.0 && (place.at.x - 160.0).abs() > 4.0, "{place:?}");
        }
    }

    #[test]
    fn edges_are_no_texture_and_places_need_depth() {
        let mut frame = frame();
        let codes = (0..240 * 160).flat_map(|n| [if n % 240 < 100 { 50 } else { 150 }; 3]).collect();
        frame.pixels = Pixels::from_u8(240, 160, codes).unwrap().into();
        assert!(textured(&frame).iter().all(|place| place.score < 1e-3));
        frame.depth = None;
        assert!(textured(&frame).is_empty() && flat(&frame).is_empty());
    }
}
