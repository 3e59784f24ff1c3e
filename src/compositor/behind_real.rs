//! Occlusion of a layer by real things.
//!
//! A thing in focus hides whole pixels: all points of the lens see it through each of them. A blurred object behind it
//! is hidden there. Next to it, the object is as blurred as if nothing stood in front of it. So the object is drawn
//! behind the edge as far as its blur reaches, blurred, and cut off afterwards: by the share of each pixel that the thing
//! has (`depth::MattePixel`).
//!
//! A pixel at the edge shows I = α·F + (1 − α)·B of the thing's light F and of B behind it. With an object of light V and
//! coverage A between the two it shows α·F + (1 − α)·(V + (1 − A)·B). What the layer is left with is V' = (1 − α)·V and
//! A' = (1 − α)·A, so mixing gives V' + (1 − A')·I, which would leave a halo of B. Adding the fringe, A'·α·(F − B), takes it
//! away: α²·F + α·(1 − α)·F̄ of the thing is left, with F̄ its mean light around, and nothing of B where A is 1. The share of
//! the camera's noise that is left is the same as without.
//!
//! Not modelled: real things that are blurred themselves by the lens (the recording shows them as it saw them).

use crate::depth::MattePixel;
use crate::gpu::{Recorder, Shader, Texture, half_texels};
use crate::pixels::Rect;
use crate::render::{COLOR, GEOMETRY, Layer};

crate::uniform! {
    struct Real { size: [i32; 2], tolerance_m: f32 }
}

/// What stands before a layer, on the GPU, over the layer's rectangle.
#[derive(Debug)]
pub struct Before {
    /// Depths of the nearer and the farther surface (metres, 0 unknown) and the nearer one's share.
    surfaces: Texture,
    fringe: Texture,
}

impl Before {
    pub fn new(recorder: &Recorder, shared: &[MattePixel], drawn: Rect) -> Self {
        let texels: Vec<[f32; 4]> = shared.iter().map(|s| [s.near_m, s.far_m, s.share, 0.0]).collect();
        let fringe: Vec<[f32; 4]> = shared.iter().map(|s| [s.fringe[0], s.fringe[1], s.fringe[2], 0.0]).collect();
        let size = (drawn.width(), drawn.height());
        let texture = recorder.pool.lend_to_write(&recorder.gpu, size, COLOR);
        texture.write(&recorder.gpu, size.0, size.1, &half_texels(&fringe));
        let surfaces = recorder.pool.lend_to_write(&recorder.gpu, size, wgpu::TextureFormat::Rgba32Float);
        surfaces.write(&recorder.gpu, size.0, size.1, &texels);
        Self { surfaces, fringe: texture }
    }
}

/// Cuts off what lies more than the tolerance behind real surfaces.
pub fn cut(recorder: &mut Recorder, layer: Layer, before: &Before, tolerance_m: f32) -> Layer {
    let real = Real { size: [layer.size.0 as i32, layer.size.1 as i32], tolerance_m };
    let pass = recorder.pass(Shader::BehindReal, "main").uniform("real", &real).texture("color", &layer.color);
    let pass = pass.texture("geometry", &layer.geometry).texture("surfaces", &before.surfaces);
    let pass = pass.texture("fringes", &before.fringe);
    let [color, geometry, fringe] = pass.draw([COLOR, GEOMETRY, COLOR], layer.size);
    Layer { color, geometry, fringe: Some(fringe), ..layer }
}

/// The depths behind which something is hidden even when blurred over `reach_px`: the farthest of the square around
/// each pixel. 0 if one of them is unknown.
pub fn deep_within(depth_m: &[f32], width: usize, reach_px: usize) -> Vec<f32> {
    // Unknown depths are the farthest of all.
    let known = |m: &f32| if *m > 0.0 { *m } else { f32::INFINITY };
    let width = width.max(1);
    let mut rows = Vec::with_capacity(depth_m.len());
    for row in depth_m.chunks_exact(width) {
        rows.extend(farthest(row.iter().map(known).collect(), 1, reach_px));
    }
    farthest(rows, width, reach_px).into_iter().map(|m| if m.is_finite() { m } else { 0.0 }).collect()
}

/// Sliding maximum over ±`reach` lines of `length` values each. The window grows by doubling; two of the last size that overlap make
/// the whole one.
fn farthest(lines: Vec<f32>, length: usize, reach: usize) -> Vec<f32> {
    let reach = reach.min(lines.len() / length);
    let beside = vec![f32::NEG_INFINITY; reach * length];
    let mut most = [beside.as_slice(), &lines, &beside].concat();
    let of_two = |most: &[f32], apart: usize| -> Vec<f32> {
        most.iter().zip(&most[apart * length..]).map(|(a, b)| if a > b { *a } else { *b }).collect()
    };
    let (window, mut covers) = (2 * reach + 1, 1);
    while 2 * covers <= window {
        (most, covers) = (of_two(&most, covers), 2 * covers);
    }
    of_two(&most, window - covers)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_farthest_around_by_hand() {
        // 4 × 3, a step at the third column; one is unknown.
        let depth = [1.0, 1.0, 2.0, 2.0, 1.0, 1.0, 2.0, 2.0, 0.0, 1.0, 2.0, 2.0];
        assert_eq!(deep_within(&depth, 4, 0), depth);
        assert_eq!(deep_within(&depth, 4, 1), [1.0, 2.0, 2.0, 2.0, 0.0, 0.0, 2.0, 2.0, 0.0, 0.0, 2.0, 2.0]);
        // A reach wider than the picture.
        assert_eq!(deep_within(&depth[..4], 4, 9), [2.0; 4]);
        assert!(deep_within(&[], 0, 3).is_empty());
    }

    #[test]
    fn it_is_what_each_pixel_asks_of_all_around() {
        let (width, height) = (23, 17);
        let depth: Vec<f32> = (0..width * height).map(|i| (i * 37 % 101) as f32 / 10.0).collect();
        for reach in 0..8 {
            let around = |i: usize| {
                let (x, y) = (i % width, i / width);
                let rows = y.saturating_sub(reach)..(y + reach + 1).min(height);
                let all = rows.flat_map(|y| &depth[y * width..][x.saturating_sub(reach)..(x + reach + 1).min(width)]);
                all.copied().reduce(|a, b| if a.min(b) > 0.0 { a.max(b) } else { 0.0 }).unwrap()
            };
            let expected: Vec<f32> = (0..depth.len()).map(around).collect();
            assert_eq!(deep_within(&depth, width, reach), expected, "{reach}");
        }
    }
}
