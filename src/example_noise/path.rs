//! Pictures in the planes of their coding.

use super::ModelError;
use crate::coding::{BLOCK, BlockQuantization, Decoder, PictureCoding, SamplePlane, dct};
use crate::grey_image::GreyImage;

/// Planes of pixels or of samples: R', G', B' or Y', Cb, Cr.
pub type Planes = [GreyImage; 3];

/// A picture with its border repeated over the coded planes' extent.
pub fn padded(rgb: &Planes, coding: &PictureCoding) -> Planes {
    let extent = coding.extent([rgb[0].width, rgb[0].height]);
    rgb.each_ref().map(|plane| {
        GreyImage::from_fn(extent.padded[0], extent.padded[1], |x, y| {
            plane.clamped(x as i64 - extent.before[0] as i64, y as i64 - extent.before[1] as i64)
        })
    })
}

fn pixels(rgb: &Planes) -> Vec<[f32; 3]> {
    let [r, g, b] = rgb.each_ref().map(|plane| plane.values.iter());
    r.zip(g).zip(b).map(|((&r, &g), &b)| [r, g, b]).collect()
}

fn three(planes: Vec<SamplePlane<f32>>) -> Result<Planes, ModelError> {
    let planes = planes.into_iter().map(|p| GreyImage { width: p.width, height: p.height, values: p.samples });
    planes.collect::<Vec<_>>().try_into().map_err(|_| ModelError::Grey)
}

/// Planes of a picture that the camera coded, before quantisation. Codes need not be whole.
pub fn content_planes(rgb: &Planes, coding: &PictureCoding) -> Result<Planes, ModelError> {
    three(coding.recovered_planes_of_floats(&pixels(rgb), [rgb[0].width, rgb[0].height]))
}

/// Planes of a decoded picture with coefficients at the nearest multiples of their quantisation
/// steps, neither rounded nor clamped: those of the camera before its decoder.
pub fn decoded_planes(rgb: &Planes, coding: &PictureCoding) -> Result<Planes, ModelError> {
    let planes = content_planes(rgb, coding)?;
    let Some(quantization) = &coding.quantization else { return Ok(planes) };
    Ok(std::array::from_fn(|index| snapped(&planes[index], quantization, index)))
}

fn snapped(plane: &GreyImage, quantization: &BlockQuantization, index: usize) -> GreyImage {
    let (width, height) = (plane.width, plane.height);
    let mut out = GreyImage::uniform(width, height, 0.0);
    for top in (0..height).step_by(BLOCK) {
        for left in (0..width).step_by(BLOCK) {
            let at = |i: usize| (top + i / BLOCK) * width + left + i % BLOCK;
            let coefficients = dct::forward(&std::array::from_fn(|i| plane.values[at(i)] - 128.0));
            let quantized = dct::quantize(&coefficients, &quantization.steps[index]);
            for (i, sample) in dct::inverse(&quantized.map(|c| c as f32)).into_iter().enumerate() {
                out.values[at(i)] = sample + 128.0;
            }
        }
    }
    out
}

/// R'G'B' codes, interleaved, of planes that go through the coding and its decoder.
pub fn codes(planes: Planes, coding: &PictureCoding, size: [usize; 2]) -> Vec<u8> {
    let planes = planes.map(|p| SamplePlane { width: p.width, height: p.height, samples: p.values });
    if coding.decoder == Decoder::Unrounded {
        return coding.unrounded_codes(&planes);
    }
    coding.decode(&coding.quantized(&planes), size)
}

/// Codes as planes.
pub fn rgb_of_codes(codes: &[u8], [width, height]: [usize; 2]) -> Planes {
    let pixels = codes.as_chunks::<3>().0;
    std::array::from_fn(|c| GreyImage { width, height, values: pixels.iter().map(|p| f32::from(p[c])).collect() })
}
