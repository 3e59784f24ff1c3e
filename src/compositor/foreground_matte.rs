//! Occlusion of the layer by real objects, after the effects that blur.
//!
//! A real object in focus occludes whole pixels: all points of the lens see it through each.
//! A blurred virtual object behind it is hidden there. Next to the edge, the virtual object is as
//! blurred as without an occluder. So it is drawn behind the edge as far as its blur reaches,
//! blurred, and occluded afterwards by the real object's alpha matte (`depth::MattePixel`).
//!
//! A pixel at the edge shows I = α·F + (1 − α)·B, with the foreground's light F and the
//! background's B. With an object of light V and coverage A between the two it shows
//! α·F + (1 − α)·(V + (1 − A)·B). The occluded layer is V' = (1 − α)·V and A' = (1 − α)·A, so that
//! mixing gives V' + (1 − A')·I, with a halo of B. The fringe, A'·α·(F − B), is added and removes
//! the halo: α²·F + α·(1 − α)·F̄ of the foreground remains, with F̄ its mean light nearby, and
//! nothing of B where A is 1. The share of the camera's noise that remains is the same as without
//! the fringe.
//!
//! Not modelled: real objects that are out of focus themselves (the recording shows them as the
//! camera saw them).

use crate::depth::MattePixel;
use crate::gpu::{PassRecorder, Shader, Texture, half_texels};
use crate::grey_image::dilated;
use crate::pixels::Rect;
use crate::render::{COLOR, GEOMETRY, Layer};

crate::uniform! {
    struct RealUniform { size: [i32; 2], tolerance_m: f32 }
}

/// Matte of the real foreground over the layer's rectangle, on the GPU.
#[derive(Clone, Debug, PartialEq)]
pub struct ForegroundMatte {
    /// Depths of the nearer and the farther surface (m, 0 unknown), and the nearer one's alpha.
    surfaces: Texture,
    fringe: Texture,
}

impl ForegroundMatte {
    pub fn new(recorder: &PassRecorder, matte: &[MattePixel], drawn: Rect) -> Self {
        let texels: Vec<[f32; 4]> = matte.iter().map(|s| [s.near_m, s.far_m, s.alpha, 0.0]).collect();
        let fringe: Vec<[f32; 4]> = matte.iter().map(|s| [s.fringe[0], s.fringe[1], s.fringe[2], 0.0]).collect();
        let size = (drawn.width(), drawn.height());
        let texture = recorder.pool.lend_to_write(&recorder.gpu, size, COLOR);
        texture.write(&recorder.gpu, size.0, size.1, &half_texels(&fringe));
        let surfaces = recorder.pool.lend_to_write(&recorder.gpu, size, wgpu::TextureFormat::Rgba32Float);
        surfaces.write(&recorder.gpu, size.0, size.1, &texels);
        Self { surfaces, fringe: texture }
    }
}

/// Removes the parts of the layer that lie more than the tolerance behind real surfaces.
pub fn occlude(recorder: &mut PassRecorder, layer: Layer, matte: &ForegroundMatte, tolerance_m: f32) -> Layer {
    let real = RealUniform { size: [layer.size.0 as i32, layer.size.1 as i32], tolerance_m };
    let pass = recorder.pass(Shader::ForegroundMatte, "main").uniform("real", &real).texture("color", &layer.color);
    let pass = pass.texture("geometry", &layer.geometry).texture("surfaces", &matte.surfaces);
    let pass = pass.texture("fringes", &matte.fringe);
    let [color, geometry, fringe] = pass.draw([COLOR, GEOMETRY, COLOR], layer.size);
    Layer { color, geometry, fringe: Some(fringe), ..layer }
}

/// Depths behind which an object is hidden even when blurred over `reach_px`: the maximum over the
/// square around each pixel. 0 if one of its depths is unknown.
pub fn max_depth_within(depth_m: &[f32], width: usize, reach_px: usize) -> Vec<f32> {
    let or_infinite = |m: &f32| if *m > 0.0 { *m } else { f32::INFINITY };
    let depth_or_infinite: Vec<f32> = depth_m.iter().map(or_infinite).collect();
    dilated(&depth_or_infinite, width, reach_px).into_iter().map(|m| if m.is_finite() { m } else { 0.0 }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn max_depth_within_a_square_matches_a_hand_computed_example() {
        // 4 × 3, a step at the third column; one is unknown.
        let depth = [1.0, 1.0, 2.0, 2.0, 1.0, 1.0, 2.0, 2.0, 0.0, 1.0, 2.0, 2.0];
        assert_eq!(max_depth_within(&depth, 4, 0), depth);
        assert_eq!(max_depth_within(&depth, 4, 1), [1.0, 2.0, 2.0, 2.0, 0.0, 0.0, 2.0, 2.0, 0.0, 0.0, 2.0, 2.0]);
        // A reach wider than the picture.
        assert_eq!(max_depth_within(&depth[..4], 4, 9), [2.0; 4]);
        assert!(max_depth_within(&[], 0, 3).is_empty());
    }

    #[test]
    fn max_depth_within_equals_a_direct_search() {
        let (width, height) = (23, 17);
        let depth: Vec<f32> = (0..width * height).map(|i| (i * 37 % 101) as f32 / 10.0).collect();
        for reach in 0..8 {
            let max_depth_around = |i: usize| {
                let (x, y) = (i % width, i / width);
                let rows = y.saturating_sub(reach)..(y + reach + 1).min(height);
                let all = rows.flat_map(|y| &depth[y * width..][x.saturating_sub(reach)..(x + reach + 1).min(width)]);
                all.copied().reduce(|a, b| if a.min(b) > 0.0 { a.max(b) } else { 0.0 }).unwrap()
            };
            let expected: Vec<f32> = (0..depth.len()).map(max_depth_around).collect();
            assert_eq!(max_depth_within(&depth, width, reach), expected, "{reach}");
        }
    }
}
