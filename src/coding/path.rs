//! The path of a picture through its coding, on the processor: the reference of the shaders.

use super::chroma::ChromaFilters;
use super::conversion::IntegerConversion;
use super::dct::{self, BLOCK_LEN, InverseDct};
use super::yuv::Table;
use super::{BLOCK, BlockQuantization, ColorMatrix, Decoder, PictureCoding, SamplePlane};
use super::{swscale, upsampling};

/// Corrections of recovered chroma samples.
const RECOVERY_PASSES: usize = 2;

/// Pixels that the coded planes cover.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CodedExtent {
    /// Pixels of the picture, across and down.
    pub size: [usize; 2],
    /// Left and upper pixels of the planes outside the picture.
    pub before: [usize; 2],
    /// Luma samples, across and down.
    pub padded: [usize; 2],
}

impl PictureCoding {
    /// Extent of the planes of a picture: whole coded units, or whole chroma samples where there
    /// are no units.
    pub fn extent(&self, size: [usize; 2]) -> CodedExtent {
        let (origin, unit) = match &self.quantization {
            Some(quantization) => (quantization.origin, self.unit_px()),
            None => ([0, 0], self.chroma_factor()),
        };
        let before = origin.map(|at| at.min(0).unsigned_abs() as usize);
        let padded = [0, 1].map(|axis| (size[axis] + before[axis]).next_multiple_of(unit[axis] as usize));
        CodedExtent { size, before, padded }
    }

    /// Planes of rendered R'G'B' codes, which need be neither whole nor between 0 and 255. Chroma
    /// samples are means of pixels. The picture's edge pixels repeat up to the planes' ends, as in
    /// encoders.
    pub fn planes(&self, rgb: &[[f32; 3]], size: [usize; 2]) -> Vec<SamplePlane<f32>> {
        let full = self.full_planes(|x, y| rgb[y * size[0] + x], size);
        let Some(chroma) = self.chroma else { return full };
        let filters = ChromaFilters::mean(chroma);
        full.iter().enumerate().map(|(i, plane)| if i == 0 { plane.clone() } else { filters.apply(plane) }).collect()
    }

    /// Planes that decode to given R'G'B' codes: those of the camera, up to the rounding of codes
    /// and to clipped ones.
    ///
    /// Luma of a decoded picture is whole, and of JPEG also each pixel's interpolated chroma: both
    /// are rounded. Chroma samples are their least-squares solution. It is improved by means of the
    /// decoder's own interpolation of the rounded samples, whose rounding depends on them.
    pub fn recovered_planes(&self, codes: &[u8], size: [usize; 2]) -> Vec<SamplePlane<f32>> {
        let pixels = codes.as_chunks::<3>().0;
        let mut planes = self.full_planes(|x, y| pixels[y * size[0] + x].map(f32::from), size);
        let Some(chroma) = self.chroma else { return planes };
        let filters = ChromaFilters::recovery(chroma, self.decoder);
        for plane in &mut planes[1..] {
            let interpolated = match self.decoder {
                Decoder::Swscale { .. } => plane.clone(),
                Decoder::ZuneJpeg | Decoder::Libjpeg | Decoder::Nearest => plane.map(|sample| sample.round()),
                Decoder::Unrounded => continue,
            };
            let mut samples = filters.apply(&interpolated);
            for _ in 0..RECOVERY_PASSES {
                let Some(again) = self.upsampled(&samples.map(|sample| sample.round() as u8)) else { break };
                let missing = SamplePlane::new(interpolated.width, interpolated.height, |x, y| {
                    interpolated.at(x, y) - f32::from(again.at(x, y))
                });
                let correction = filters.apply(&missing);
                samples = SamplePlane::new(samples.width, samples.height, |x, y| {
                    samples.at(x, y).round() + correction.at(x, y)
                });
            }
            *plane = samples;
        }
        planes
    }

    /// Planes of R'G'B' codes that went through this coding before they were averaged or corrected.
    pub fn recovered_planes_of_floats(&self, rgb: &[[f32; 3]], size: [usize; 2]) -> Vec<SamplePlane<f32>> {
        let mut planes = self.full_planes(|x, y| rgb[y * size[0] + x], size);
        let Some(chroma) = self.chroma else { return planes };
        let filters = ChromaFilters::recovery(chroma, self.decoder);
        planes[1..].iter_mut().for_each(|plane| *plane = filters.apply(plane));
        planes
    }

    /// Y', Cb and Cr at every pixel of the planes' extent, or Y' alone.
    fn full_planes(&self, rgb: impl Fn(usize, usize) -> [f32; 3], size: [usize; 2]) -> Vec<SamplePlane<f32>> {
        let extent = self.extent(size);
        let (rows, black) = self.color.forward();
        let inner_index = |at: usize, axis: usize| at.saturating_sub(extent.before[axis]).min(size[axis] - 1);
        let plane = |plane: usize| {
            let row = rows[plane].map(|weight| weight as f32);
            SamplePlane::new(extent.padded[0], extent.padded[1], |x, y| {
                let [r, g, b] = rgb(inner_index(x, 0), inner_index(y, 1));
                black[plane] as f32 + row[0] * r + row[1] * g + row[2] * b
            })
        };
        (0..self.plane_count()).map(plane).collect()
    }

    /// A chroma plane at the resolution of luma, in the decoder's whole samples. `None` of a
    /// decoder whose interpolated samples have fractions.
    fn upsampled(&self, plane: &SamplePlane<u8>) -> Option<SamplePlane<u8>> {
        let factor = self.chroma_factor();
        match self.decoder {
            Decoder::ZuneJpeg => Some(upsampling::zune(plane, factor)),
            Decoder::Libjpeg => Some(upsampling::libjpeg(plane, factor)),
            Decoder::Nearest => Some(upsampling::repeated(plane, factor)),
            Decoder::Swscale { .. } | Decoder::Unrounded => None,
        }
    }

    /// Samples as the decoder has them after the inverse DCT. Samples are rounded to 8 bits first,
    /// as in encoders; without [`BlockQuantization`] that is all.
    pub fn quantized(&self, planes: &[SamplePlane<f32>]) -> Vec<SamplePlane<u8>> {
        let rounded = planes.iter().map(|plane| plane.map(|sample| sample.round() as u8));
        let Some(quantization) = &self.quantization else { return rounded.collect() };
        let inverse = match self.decoder {
            Decoder::Libjpeg => InverseDct::LIBJPEG,
            Decoder::ZuneJpeg | Decoder::Swscale { .. } | Decoder::Nearest | Decoder::Unrounded => InverseDct::ZUNE,
        };
        let by_plane = rounded.zip(&quantization.steps);
        let decoded = |(plane, steps): (SamplePlane<u8>, _)| {
            decoded_samples(&coefficients(&plane.map(|&sample| f32::from(sample)), steps), plane.width, inverse)
        };
        by_plane.map(decoded).collect()
    }

    /// R'G'B' codes of a picture, interleaved, from its decoded samples.
    pub fn decode(&self, planes: &[SamplePlane<u8>], size: [usize; 2]) -> Vec<u8> {
        let extent = self.extent(size);
        let [width, height] = extent.padded;
        let factor = self.chroma_factor();
        let [luma, cb, cr] = planes else { return crop(&extent, |x, y| [planes[0].at(x, y); 3]) };
        if self.color.matrix == ColorMatrix::Rgb {
            return crop(&extent, |x, y| [luma, cb, cr].map(|plane| plane.at(x, y)));
        }
        let converted = |chroma: [SamplePlane<u8>; 2], rgb: &dyn Fn([u8; 3]) -> [u8; 3]| {
            crop(&extent, |x, y| rgb([luma.at(x, y), chroma[0].at(x, y), chroma[1].at(x, y)]))
        };
        match self.decoder {
            Decoder::ZuneJpeg => {
                let chroma = [cb, cr].map(|plane| upsampling::zune(plane, factor));
                converted(chroma, &|sample| IntegerConversion::ZUNE.rgb(sample))
            }
            Decoder::Libjpeg => {
                // Its planes end with the picture.
                let inside = [0, 1].map(|axis| (extent.before[axis] + size[axis]).div_ceil(factor[axis] as usize));
                let chroma = [cb, cr].map(|plane| upsampling::libjpeg(&plane.cropped(inside[0], inside[1]), factor));
                converted(chroma, &|sample| IntegerConversion::LIBJPEG.rgb(sample))
            }
            Decoder::Nearest | Decoder::Unrounded => {
                let table = Table::new(self.color.matrix, self.color.range);
                let chroma = [cb, cr].map(|plane| upsampling::repeated(plane, factor));
                converted(chroma, &|sample| table.rgb(sample))
            }
            Decoder::Swscale { siting } => {
                let planes = [luma.clone(), cb.clone(), cr.clone()];
                let codes = swscale::rgb(&planes, [width, height], factor, siting, self.color);
                crop(&extent, |x, y| {
                    let at = 3 * (y * width + x);
                    [codes[at], codes[at + 1], codes[at + 2]]
                })
            }
        }
    }

    /// R'G'B' codes nearest to planes of [`Decoder::Unrounded`], interleaved.
    pub fn unrounded_codes(&self, planes: &[SamplePlane<f32>; 3]) -> Vec<u8> {
        let back = self.color.inverse().map(|row| row.map(|factor| factor as f32));
        let black = self.color.forward().1.map(|level| level as f32);
        let samples = planes[0].samples.iter().zip(&planes[1].samples).zip(&planes[2].samples);
        let code = |((y, cb), cr): ((&f32, &f32), &f32)| {
            let centred = [y - black[0], cb - black[1], cr - black[2]];
            back.map(|row| (row[0] * centred[0] + row[1] * centred[1] + row[2] * centred[2]).round() as u8)
        };
        samples.flat_map(code).collect()
    }

    /// A decoded picture, coded and decoded once more. The result equals the picture where its
    /// codes determine the camera's samples.
    pub fn recode(&self, codes: &[u8], size: [usize; 2]) -> Vec<u8> {
        self.decode(&self.quantized(&self.recovered_planes(codes, size)), size)
    }
}

/// The picture's part of a padded picture.
fn crop(extent: &CodedExtent, rgb: impl Fn(usize, usize) -> [u8; 3]) -> Vec<u8> {
    let [width, height] = extent.size;
    let [left, top] = extent.before;
    let rgb = &rgb;
    (top..top + height).flat_map(|y| (left..left + width).flat_map(move |x| rgb(x, y))).collect()
}

/// Dequantised coefficients of a plane, block by block in rows. Its sides are multiples of 8.
pub fn coefficients(plane: &SamplePlane<f32>, steps: &[u16; BLOCK_LEN]) -> Vec<[i32; BLOCK_LEN]> {
    unquantized_coefficients(plane).map(|block| dct::quantize(&block, steps)).collect()
}

/// Coefficients of a plane's samples − 128, block by block in rows.
pub fn unquantized_coefficients(plane: &SamplePlane<f32>) -> impl Iterator<Item = [f32; BLOCK_LEN]> {
    let across = plane.width / BLOCK;
    (0..across * (plane.height / BLOCK)).map(move |block| {
        let [left, top] = [block % across * BLOCK, block / across * BLOCK];
        dct::forward(&std::array::from_fn(|i| plane.at(left + i % BLOCK, top + i / BLOCK) - 128.0))
    })
}

/// Samples of dequantised coefficients, block by block in rows, of a plane of given width.
pub fn decoded_samples(blocks: &[[i32; BLOCK_LEN]], width: usize, inverse: InverseDct) -> SamplePlane<u8> {
    let across = (width / BLOCK).max(1);
    let mut plane = SamplePlane::new(width, blocks.len() / across * BLOCK, |_, _| 0);
    for (i, block) in blocks.iter().enumerate() {
        let [left, top] = [i % across * BLOCK, i / across * BLOCK];
        for (y, row) in inverse.samples(block).as_chunks::<BLOCK>().0.iter().enumerate() {
            let start = (top + y) * width + left;
            plane.samples[start..start + BLOCK].copy_from_slice(row);
        }
    }
    plane
}

impl BlockQuantization {
    /// Tables at the top left corner of the picture.
    pub fn at_corner(steps: [[u16; BLOCK_LEN]; 3]) -> Self {
        Self { steps, origin: [0, 0] }
    }
}
