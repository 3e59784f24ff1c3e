//! Copies read-back textures into pictures and layer images.

use half::f16;

use crate::camera::Response;
use crate::gpu::{Gpu, GpuError, Readback};
use crate::pixels::{Codes, LayerImage, Pixels, Rect};

/// Writes rows of RGBA texels into a rectangle of a picture.
pub fn paste(gpu: &Gpu, readback: &Readback, rect: Rect, pixels: &mut Pixels) -> Result<(), GpuError> {
    let width = pixels.width as usize;
    let start = |row: usize| 3 * ((rect.y0 as usize + row) * width + rect.x0 as usize);
    let columns = rect.width() as usize;
    match &mut pixels.codes {
        Codes::U8(codes) => readback.rows(gpu, |row, bytes| {
            let out = &mut codes[start(row)..start(row) + 3 * columns];
            for (rgb, rgba) in out.chunks_exact_mut(3).zip(bytes.chunks_exact(4)) {
                rgb.copy_from_slice(&rgba[..3]);
            }
        }),
        Codes::U16(codes) => readback.rows(gpu, |row, bytes| {
            let out = &mut codes[start(row)..start(row) + 3 * columns];
            for (rgb, rgba) in out.chunks_exact_mut(3).zip(bytes.chunks_exact(8)) {
                for (code, pair) in rgb.iter_mut().zip(rgba.chunks_exact(2)) {
                    *code = u16::from_le_bytes([pair[0], pair[1]]);
                }
            }
        }),
    }
}

/// Copies a layer that was drawn over `rect`, which may extend beyond the picture. With `over_seam`
/// it continues at the opposite rim.
pub fn paste_layer(
    gpu: &Gpu,
    [color, geometry]: [&Readback; 2],
    rect: Rect,
    over_seam: bool,
    out: &mut LayerImage,
) -> Result<(), GpuError> {
    let light_alone = out.light_alone;
    let at = indices(rect, over_seam, out);
    color.rows(gpu, |row, bytes| {
        for (column, t) in bytes.chunks_exact(8).enumerate() {
            // Light whose coverage was rounded to 0 is dropped, as in the composite.
            if let Some(i) = at(row, column).filter(|_| light_alone || half(&t[6..]) > 0.0) {
                out.rgba[i] = texel(t);
            }
        }
    })?;
    geometry.rows(gpu, |row, bytes| {
        for (column, t) in bytes.chunks_exact(8).enumerate() {
            if let Some(i) = at(row, column).filter(|&i| out.rgba[i][3] > 0.0) {
                out.depth_m[i] = f32::from_le_bytes([t[0], t[1], t[2], t[3]]);
                out.velocity[i] = [half(&t[4..]), half(&t[6..])];
            }
        }
    })
}

/// Copies the shadow ratio over `rect`, from the fraction of light that is removed.
pub fn paste_shadow_mask(
    gpu: &Gpu,
    shadow_mask: &Readback,
    rect: Rect,
    over_seam: bool,
    out: &mut LayerImage,
) -> Result<(), GpuError> {
    let at = indices(rect, over_seam, out);
    shadow_mask.rows(gpu, |row, bytes| {
        for (column, t) in bytes.chunks_exact(8).enumerate() {
            if let Some(i) = at(row, column) {
                let [r, g, b, _] = texel(t);
                out.left[i] = [r, g, b].map(shadow_ratio);
            }
        }
    })
}

/// Adds the fringe of real foreground edges (`foreground_matte.rs`), after [`paste_shadow_mask`].
pub fn paste_fringe(
    gpu: &Gpu,
    fringe: &Readback,
    rect: Rect,
    over_seam: bool,
    out: &mut LayerImage,
) -> Result<(), GpuError> {
    let at = indices(rect, over_seam, out);
    fringe.rows(gpu, |row, bytes| {
        for (column, t) in bytes.chunks_exact(8).enumerate() {
            if let Some(i) = at(row, column) {
                let coverage = out.rgba[i][3];
                for ((light, left), fringe) in out.rgba[i].iter_mut().zip(out.left[i]).zip(texel(t)) {
                    *light += coverage * left * fringe;
                }
            }
        }
    })
}

/// Computes the noise: the composite minus the layer over the camera's picture, in linear light.
/// The layer's values are rounded to 16-bit floats first, as in its file; where one is too large
/// for those, the noise is 0. All pictures have the same size.
pub fn fill_noise(camera: &Pixels, composite: &Pixels, response: &Response, out: &mut LayerImage) {
    let max = composite.max_code();
    let light: Vec<f32> = response.table(max).into_iter().map(|light| light as f32).collect();
    let rounded = |value: f32| f16::from_f32(value).to_f32();
    let [own, made] = [camera, composite].map(|pixels| pixels.each(|codes| codes));
    for (i, (own, made)) in own.into_iter().zip(made).enumerate() {
        let (rgba, left) = (out.rgba[i].map(rounded), out.left[i].map(rounded));
        if own == made && rgba == [0.0; 4] && left == [1.0; 3] {
            continue;
        }
        for c in 0..3 {
            let layered = rgba[c] + (1.0 - rgba[3]) * left[c] * light[own[c] as usize];
            let is_clipped = made[c] == max && layered >= 1.0;
            let is_known = !is_clipped && layered.is_finite();
            out.noise[i][c] = if is_known { light[made[c] as usize] - layered } else { 0.0 };
        }
    }
}

/// Fractions of light removed and added that count as none: `LARGEST_UNSEEN_LOSS` and
/// `LARGEST_UNSEEN_GAIN` of shaders/shared/shadow_ratio.wgsl.
const LARGEST_UNSEEN_LOSS: f32 = 1.0 / 4096.0;
const LARGEST_UNSEEN_GAIN: f32 = 1.0 / 2048.0;

/// Shadow ratio from the fraction of light removed, as the composite has it.
fn shadow_ratio(removed: f32) -> f32 {
    if (-LARGEST_UNSEEN_GAIN..=LARGEST_UNSEEN_LOSS).contains(&removed) { 1.0 } else { 1.0 - removed }
}

fn half(bytes: &[u8]) -> f32 {
    f16::from_le_bytes([bytes[0], bytes[1]]).to_f32()
}

fn texel(bytes: &[u8]) -> [f32; 4] {
    [half(&bytes[0..]), half(&bytes[2..]), half(&bytes[4..]), half(&bytes[6..])]
}

/// The pixel index in a layer of a rectangle's row and column.
fn indices(rect: Rect, over_seam: bool, out: &LayerImage) -> impl Fn(usize, usize) -> Option<usize> + use<> {
    let (width, height) = (out.width as i32, out.height as i32);
    move |row, column| {
        let (x, y) = (rect.x0 + column as i32, rect.y0 + row as i32);
        let x = if over_seam { x.rem_euclid(width) } else { x };
        (x >= 0 && y >= 0 && x < width && y < height).then_some((y * width + x) as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shadow_ratio_is_1_exactly_where_a_16_bit_float_rounds_it_to_1() {
        for removed in (-80..=80).map(|n| n as f32 * 1e-5).chain([LARGEST_UNSEEN_LOSS, -LARGEST_UNSEEN_GAIN]) {
            let is_1_in_the_file = f16::from_f32(1.0 - removed) == f16::ONE;
            assert_eq!(shadow_ratio(removed) == 1.0, is_1_in_the_file, "{removed}");
        }
    }

    #[test]
    fn shadow_ratio_has_the_constants_of_its_shader() {
        let shader = include_str!("../../shaders/shared/shadow_ratio.wgsl");
        for (name, value) in
            [("LARGEST_UNSEEN_LOSS", LARGEST_UNSEEN_LOSS), ("LARGEST_UNSEEN_GAIN", LARGEST_UNSEEN_GAIN)]
        {
            assert!(shader.contains(&format!("const {name}: f32 = 1.0 / {:?};", 1.0 / value)), "{name}");
        }
    }
}
