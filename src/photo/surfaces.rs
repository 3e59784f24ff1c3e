//! The surfaces of a photograph's real part, made once from its picture and the recorded depth.

use glam::DVec2;

use crate::camera::{Intrinsics, Response};
use crate::compositor::Surfaces;
use crate::image::Pixels;

use super::{Framing, behind, edges, holes};

/// Depths beside each other that differ by more than this factor belong to two surfaces; a floor seen under 15° from 4 m
/// changes by 1 % from row to row.
pub const JUMP: f32 = 1.04;
/// What is made up behind a surface reaches at most so far, pixels of the grid.
const MOST_BEHIND_PX: f64 = 96.0;
/// How far the depth's edges may lie beside the picture's, as a share of its width: those of a Kinect do by up to 8 of 640 px.
const MOST_OFF: f64 = 8.0 / 640.0;
/// The grid has no more pixels.
const MOST_PIXELS: f64 = 2.0e6;

/// How far apart two colours are (square roots of light).
pub fn apart(a: &[f32; 3], b: &[f32; 3]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f32>().sqrt()
}

/// By the recorded camera's depth (`depth_m`, its picture's size, 0 where nothing is known). Circles are at most
/// `reach_px` of the photograph in radius. `None` where the depth is of another size, or nothing was measured in what the photograph shows.
pub fn made(
    pixels: &Pixels,
    recorded: &Intrinsics,
    depth_m: &[f32],
    framing: &Framing,
    response: &Response,
    reach_px: f64,
) -> Option<Surfaces> {
    let (whole_width, whole_height) = (recorded.width_px as usize, recorded.height_px as usize);
    if depth_m.len() != whole_width * whole_height {
        return None;
    }
    // A pixel of the grid for one of the recording, or of the photograph where that is coarser.
    let area = f64::from(pixels.width) * f64::from(pixels.height);
    let enlargement = framing.enlargement().max((area / MOST_PIXELS).sqrt()).max(1.0);
    let side = |pixels: u32| (f64::from(pixels) / enlargement).ceil().max(1.0) as u32;
    let (width, height) = (side(pixels.width), side(pixels.height));
    let places =
        || (0..height).flat_map(|y| (0..width).map(move |x| DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)));
    let place = |at: f64, side: usize| at.clamp(0.0, side as f64 - 1.0) as usize;
    let measured = |at: DVec2| {
        let from = framing.framed.source_px(enlargement * at);
        depth_m[place(from.y, whole_height) * whole_width + place(from.x, whole_width)]
    };
    let most = f64::from(pixels.max_code());
    let seen = |at: DVec2| {
        let at = enlargement * at;
        let (x, y) = (place(at.x, pixels.width as usize), place(at.y, pixels.height as usize));
        pixels.at(x as u32, y as u32).map(|code| response.decode(f64::from(code) / most) as f32)
    };
    let mut depth_m: Vec<f32> = places().map(measured).collect();
    let light: Vec<[f32; 3]> = places().map(seen).collect();
    let looks: Vec<[f32; 3]> = light.iter().map(|l| l.map(|c| c.max(0.0).sqrt())).collect();
    let columns = width as usize;
    let of_recorded = framing.framed.step * enlargement;
    let guessed = holes::fill(&mut depth_m, &looks, columns, (recorded.fx_px / of_recorded) as f32)?;
    let off_px = (f64::from(recorded.width_px) * MOST_OFF / of_recorded).round() as usize;
    let depth_m = if edges::are_off(&depth_m, &looks, columns, off_px) {
        let on_colors = edges::on_colors(&depth_m, &guessed, &looks, columns, off_px);
        edges::widened(&on_colors, Some(&looks), columns)
    } else {
        edges::widened(&depth_m, None, columns)
    };
    let reach = (1.3 * reach_px / enlargement + 3.0).min(MOST_BEHIND_PX) as usize;
    let (behind_m, behind_light) = behind::made_up(&depth_m, &light, columns, reach);
    Some(Surfaces { width, height, enlargement, depth_m, behind_m, light, behind_light })
}
