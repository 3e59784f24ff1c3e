//! The coding of a picture to which an orientation was applied.

use super::orientation::Orientation;
use crate::coding::dct::BLOCK_LEN;
use crate::coding::{BLOCK, BlockQuantization, ChromaSampling, ChromaSiting, PictureCoding};

/// Chroma sampling of frames to which an orientation was applied. `None` if chroma samples then lie
/// at the second of two luma samples, which is not modelled.
pub(super) fn oriented_sampling(
    chroma: Option<ChromaSampling>,
    orientation: Orientation,
    size: [u32; 2],
) -> Option<Option<ChromaSampling>> {
    let Some(ChromaSampling { factor, siting }) = chroma else { return Some(None) };
    // Rows: the axis of the stored frame that becomes each axis, with its sign.
    let [a, b, c, d] = orientation.matrix().map(f64::round);
    let axis_sampling = |x: f64, y: f64| {
        let (axis, sign) = if x == 0.0 { (1, y) } else { (0, x) };
        // Against the axis the pairs of luma samples are the same only of an even number.
        let is_symmetric = siting[axis] == ChromaSiting::Centered && size[axis].is_multiple_of(factor[axis]);
        let is_representable = sign > 0.0 || factor[axis] == 1 || is_symmetric;
        is_representable.then_some((factor[axis], siting[axis]))
    };
    let (across, down) = (axis_sampling(a, c)?, axis_sampling(b, d)?);
    Some(Some(ChromaSampling { factor: [across.0, down.0], siting: [across.1, down.1] }))
}

/// The coding after an orientation was applied to a picture of `size` px as stored. The transform
/// of a mirrored block has the same coefficients up to their signs, that of a transposed block the
/// transposed ones. `None` where chroma is then not represented.
pub(super) fn oriented_coding(
    coding: &PictureCoding,
    orientation: Orientation,
    size: [u32; 2],
) -> Option<PictureCoding> {
    if orientation == Orientation::default() {
        return Some(coding.clone());
    }
    let chroma = oriented_sampling(coding.chroma, orientation, size)?;
    let oriented = PictureCoding { chroma, ..coding.clone() };
    let [a, b, c, d] = orientation.matrix().map(f64::round);
    let is_transposed = a == 0.0;
    let size = if is_transposed { [size[1], size[0]] } else { size };
    // Along a mirrored axis the grid begins with the padding of the stored picture.
    let padding = |axis: usize, sign: f64| {
        let unit = oriented.unit_px()[axis];
        if sign < 0.0 { -((size[axis].next_multiple_of(unit) - size[axis]) as i32) } else { 0 }
    };
    let origin = [padding(0, a + c), padding(1, b + d)];
    let transposed = |steps: [u16; BLOCK_LEN]| std::array::from_fn(|i| steps[i % BLOCK * BLOCK + i / BLOCK]);
    let quantization = coding.quantization.as_ref().map(|quantization| BlockQuantization {
        steps: if is_transposed { quantization.steps.map(transposed) } else { quantization.steps },
        origin,
    });
    Some(PictureCoding { quantization, ..oriented })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coding::{Decoder, YcbcrColor};

    /// 30×20 px, 4:2:2, each step another number.
    const SIZE: [u32; 2] = [30, 20];

    fn jpeg() -> PictureCoding {
        PictureCoding {
            color: YcbcrColor::JFIF,
            chroma: Some(ChromaSampling::centered([2, 1])),
            quantization: Some(BlockQuantization { steps: [std::array::from_fn(|i| i as u16 + 1); 3], origin: [0, 0] }),
            decoder: Decoder::ZuneJpeg,
        }
    }

    /// Units are 16×8 px: the padding is 2 px across and 4 px down.
    #[test]
    fn grid_and_steps_follow_each_orientation() {
        let stored = jpeg().quantization.unwrap().steps[0];
        for (exif, factor, origin) in [
            (1, [2, 1], [0, 0]),
            (2, [2, 1], [-2, 0]),
            (3, [2, 1], [-2, -4]),
            (4, [2, 1], [0, -4]),
            (5, [1, 2], [0, 0]),
            (6, [1, 2], [-4, 0]),
            (7, [1, 2], [-4, -2]),
            (8, [1, 2], [0, -2]),
        ] {
            let coding = oriented_coding(&jpeg(), Orientation::of_exif(exif), SIZE).unwrap();
            let BlockQuantization { steps, origin: grid } = coding.quantization.unwrap();
            assert_eq!((coding.chroma.unwrap().factor, grid), (factor, origin), "{exif}");
            let is_transposed = exif > 4;
            assert_eq!([steps[0][1], steps[2][8]], if is_transposed { [9, 2] } else { [2, 9] }, "{exif}");
            assert_eq!([steps[1][0], steps[1][63]], [stored[0], stored[63]]);
        }
    }

    #[test]
    fn odd_width_mirrored_with_halved_chroma_is_not_represented() {
        let mirrored = Orientation::of_exif(2);
        assert_eq!(oriented_coding(&jpeg(), mirrored, [31, 20]), None);
        let grey = PictureCoding { chroma: None, ..jpeg() };
        let origin = oriented_coding(&grey, mirrored, [31, 20]).unwrap().quantization.unwrap().origin;
        assert_eq!(origin, [-1, 0]);
    }
}
