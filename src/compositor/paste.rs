//! Puts what comes back from the GPU into pictures.

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

/// Fills in a layer that was drawn over `rect`, which may extend beyond the picture. With `over_seam` it continues at
/// the opposite rim.
pub fn paste_layer(
    gpu: &Gpu,
    color: &Readback,
    geometry: &Readback,
    rect: Rect,
    over_seam: bool,
    out: &mut LayerImage,
) -> Result<(), GpuError> {
    let (light_alone, width, height) = (out.light_alone, out.width as i32, out.height as i32);
    let half = |b: &[u8]| half::f16::from_le_bytes([b[0], b[1]]).to_f32();
    let at = |row: usize, column: usize| {
        let (x, y) = (rect.x0 + column as i32, rect.y0 + row as i32);
        let x = if over_seam { x.rem_euclid(width) } else { x };
        (x >= 0 && y >= 0 && x < width && y < height).then_some((y * width + x) as usize)
    };
    let texel = |t: &[u8]| [half(&t[0..]), half(&t[2..]), half(&t[4..]), half(&t[6..])];
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
