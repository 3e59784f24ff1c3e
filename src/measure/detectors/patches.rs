//! Square patches of a picture, on a grid that is aligned with the 8×8 blocks.

use super::PatchSource;
use crate::coding::{BLOCK, YcbcrColor};
use crate::grey_image::GreyImage;
use crate::pixels::Pixels;

/// Side of a patch, px.
pub const PATCH_PX: usize = 32;
/// Side of the blocks of a DCT, px.
pub(super) const BLOCK_PX: usize = BLOCK;

/// Codes on the 8-bit scale, or differences of them.
pub(super) type Planes = [GreyImage; 3];

/// A patch that lies in the mask.
#[derive(Clone, Debug)]
pub(super) struct DetectorPatch {
    /// Index of the picture in the list.
    pub picture: usize,
    /// Column and row in the grid of patches.
    pub cell: [usize; 2],
    /// Upper left pixel.
    pub origin_px: [usize; 2],
    /// R, G, B.
    pub rgb: Planes,
    /// Y', Cb, Cr.
    pub ycbcr: Planes,
}

/// R, G, B of a picture on the 8-bit scale.
pub(super) fn rgb_planes(pixels: &Pixels) -> Planes {
    let scale = 255.0 / pixels.max_code() as f32;
    let plane = |channel: usize| GreyImage {
        width: pixels.width as usize,
        height: pixels.height as usize,
        values: pixels.each(|codes| scale * codes[channel] as f32),
    };
    [plane(0), plane(1), plane(2)]
}

/// Y', Cb and Cr of R, G, B on the 8-bit scale, Cb and Cr around 0.
pub(super) fn ycbcr(rgb: &Planes) -> Planes {
    let (rows, _) = YcbcrColor::JFIF.forward();
    let [red, green, blue] = rgb;
    rows.map(|row| {
        let [r_weight, g_weight, b_weight] = row.map(|weight| weight as f32);
        let channels = red.values.iter().zip(&green.values).zip(&blue.values);
        let values = channels.map(|((r, g), b)| r_weight * r + g_weight * g + b_weight * b).collect();
        GreyImage { width: red.width, height: red.height, values }
    })
}

/// The part of a plane from a left upper pixel on.
pub(super) fn cropped(plane: &GreyImage, [x0, y0]: [usize; 2]) -> GreyImage {
    GreyImage::from_fn(PATCH_PX, PATCH_PX, |x, y| plane.values[(y0 + y) * plane.width + x0 + x])
}

/// The patches of pictures that lie in the masks completely, picture by picture, row by row.
pub(super) fn patches(sources: &[PatchSource]) -> Vec<DetectorPatch> {
    let mut patches = Vec::new();
    for (picture, source) in sources.iter().enumerate() {
        let (width, height) = (source.pixels.width as usize, source.pixels.height as usize);
        let rgb = rgb_planes(source.pixels);
        let [left, top] = source.block_origin_px.map(|origin| origin as usize % BLOCK_PX);
        for (row, y0) in (top..(height + 1).saturating_sub(PATCH_PX)).step_by(PATCH_PX).enumerate() {
            for (column, x0) in (left..(width + 1).saturating_sub(PATCH_PX)).step_by(PATCH_PX).enumerate() {
                let is_row_usable = |y: usize| {
                    source.mask.is_none_or(|mask| mask[y * width + x0..y * width + x0 + PATCH_PX].iter().all(|m| *m))
                };
                if (y0..y0 + PATCH_PX).all(is_row_usable) {
                    let rgb = [0, 1, 2].map(|channel: usize| cropped(&rgb[channel], [x0, y0]));
                    let ycbcr = ycbcr(&rgb);
                    patches.push(DetectorPatch { picture, cell: [column, row], origin_px: [x0, y0], rgb, ycbcr });
                }
            }
        }
    }
    patches
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patches_start_on_a_block_and_lie_in_the_mask() {
        let (width, height) = (104, 69);
        let pixels =
            Pixels::from_u8(width, height, (0..3 * width * height).map(|i| (i % 251) as u8).collect()).unwrap();
        let mut mask = vec![true; (width * height) as usize];
        let source = |mask| PatchSource { mask, block_origin_px: [10, 5], ..PatchSource::new(&pixels) };
        // Columns from 2: 2, 34, 66 (to 98); rows from 5: 5, 37 (to 69).
        let all = patches(&[source(None)]);
        let origins: Vec<_> = all.iter().map(|patch| patch.origin_px).collect();
        assert_eq!(origins, [[2, 5], [34, 5], [66, 5], [2, 37], [34, 37], [66, 37]]);
        assert_eq!(all[4].rgb[1].values[33] as u32, pixels.each(|c| c[1])[38 * 104 + 35]);
        mask[68 * 104 + 65] = false;
        let left: Vec<_> = patches(&[source(Some(&mask))]).iter().map(|patch| patch.cell).collect();
        assert_eq!(left, [[0, 0], [1, 0], [2, 0], [0, 1], [2, 1]]);
    }

    #[test]
    fn picture_smaller_than_a_patch_has_none() {
        let pixels = Pixels::from_u8(31, 32, vec![0; 3 * 31 * 32]).unwrap();
        assert!(patches(&[PatchSource::new(&pixels)]).is_empty());
        let pixels = Pixels::from_u8(0, 0, Vec::new()).unwrap();
        assert!(patches(&[PatchSource::new(&pixels)]).is_empty());
    }

    #[test]
    fn ycbcr_of_primaries_matches_t_871() {
        // Rows of T.871 §7 for red, green and blue of 255, without 128.
        for (rgb, expected) in [
            ([255.0, 0.0, 0.0], [76.245, -43.0277, 127.5]),
            ([0.0, 255.0, 0.0], [149.685, -84.4723, -106.7653]),
            ([0.0, 0.0, 255.0], [29.07, 127.5, -20.7347]),
        ] {
            let planes = ycbcr(&rgb.map(|v| GreyImage::from_fn(1, 1, |_, _| v)));
            for (plane, expected) in planes.iter().zip(expected) {
                assert!((plane.values[0] - expected).abs() < 2e-4, "{rgb:?}: {} {expected}", plane.values[0]);
            }
        }
    }
}
