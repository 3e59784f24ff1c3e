use super::dct::{BLOCK_LEN, InverseDct, ZIGZAG};
use super::jpeg_writer::JpegPlanes;
use super::path::decoded_samples;
use super::*;

const FACTORS: [[u32; 2]; 4] = [[1, 1], [2, 1], [2, 2], [1, 2]];

/// A hash as a pseudorandom number from 0 up to `count`.
fn hashed(seed: u32, count: u32) -> u32 {
    let mut x = seed.wrapping_mul(0x9e37_79b9) ^ 0x85eb_ca6b;
    for _ in 0..2 {
        x = (x ^ x >> 16).wrapping_mul(0x7feb_352d);
        x = (x ^ x >> 15).wrapping_mul(0x846c_a68b);
    }
    (x ^ x >> 16) % count
}

/// Quantised coefficients: blocks of a DC alone, of the lowest ten frequencies, of all, and of
/// extreme values.
fn quantized_blocks(count: usize, seed: u32) -> Vec<[i32; BLOCK_LEN]> {
    let block = |i: u32| {
        let of = |k: u32, count: u32| hashed(seed.wrapping_add(i * 977 + k * 13), count) as i32;
        let kind = of(99, 5);
        let length = [1, 10, 64, 64, 30][kind as usize];
        let mut block = [0; BLOCK_LEN];
        for (k, &at) in ZIGZAG.iter().enumerate().take(length) {
            let k = k as u32;
            block[at] = match (k, kind) {
                (0, _) => of(0, 120) - 60,
                (_, 3) => of(k, 401) - 200,
                _ if of(k + 64, 3) == 0 => of(k, 21) - 10,
                _ => 0,
            };
        }
        block
    };
    (0..count as u32).map(block).collect()
}

fn steps(first: u16) -> [u16; BLOCK_LEN] {
    std::array::from_fn(|i| first + (i / 8 + i % 8) as u16)
}

fn coding(factor: [u32; 2], decoder: Decoder) -> PictureCoding {
    PictureCoding {
        color: YcbcrColor::JFIF,
        chroma: Some(ChromaSampling::centered(factor)),
        quantization: Some(BlockQuantization::at_corner([steps(3), steps(5), steps(4)])),
        decoder,
    }
}

/// Blocks of each plane of a picture, and its file.
fn file(coding: &PictureCoding, size: [usize; 2], adobe: Option<u8>) -> (Vec<Vec<[i32; BLOCK_LEN]>>, Vec<u8>) {
    let padded = coding.extent(size).padded;
    let factor = coding.chroma_factor().map(|f| f as usize);
    let blocks: Vec<_> = (0..coding.plane_count())
        .map(|plane| {
            let [h, v] = if plane == 0 { [1, 1] } else { factor };
            quantized_blocks(padded[0] / h / 8 * (padded[1] / v / 8), 1000 * plane as u32 + size[0] as u32)
        })
        .collect();
    let steps = &coding.quantization.as_ref().unwrap().steps[..blocks.len()];
    let written = JpegPlanes {
        size: size.map(|side| side as u16),
        factor: coding.chroma_factor().map(|f| f as u8),
        steps,
        blocks: &blocks,
        adobe,
    };
    let bytes = written.file();
    (blocks, bytes)
}

fn decoded(coding: &PictureCoding, blocks: &[Vec<[i32; BLOCK_LEN]>], size: [usize; 2], inverse: InverseDct) -> Vec<u8> {
    let padded = coding.extent(size).padded;
    let planes: Vec<_> = blocks
        .iter()
        .enumerate()
        .map(|(plane, blocks)| {
            let steps = coding.quantization.as_ref().unwrap().steps[plane];
            let dequantized: Vec<[i32; BLOCK_LEN]> =
                blocks.iter().map(|block| std::array::from_fn(|i| block[i] * i32::from(steps[i]))).collect();
            let width = if plane == 0 { padded[0] } else { padded[0] / coding.chroma_factor()[0] as usize };
            decoded_samples(&dequantized, width, inverse)
        })
        .collect();
    coding.decode(&planes, size)
}

#[test]
fn decoding_equals_the_image_crates_bit_for_bit() {
    for factor in FACTORS {
        for size in [[16, 16], [37, 29], [64, 48], [3, 5], [17, 33], [96, 7], [1, 1]] {
            let coding = coding(factor, Decoder::ZuneJpeg);
            let (blocks, bytes) = file(&coding, size, None);
            let image = image::load_from_memory_with_format(&bytes, image::ImageFormat::Jpeg).unwrap().to_rgb8();
            assert_eq!(image.dimensions(), (size[0] as u32, size[1] as u32));
            let codes = decoded(&coding, &blocks, size, InverseDct::ZUNE);
            let differing = codes.iter().zip(image.as_raw()).filter(|(a, b)| a != b).count();
            assert_eq!(differing, 0, "{factor:?} {size:?}: of {} codes", codes.len());
        }
    }
}

#[test]
fn grey_and_rgb_files_decode_as_the_image_crate_does() {
    let size = [37, 29];
    let mut grey = coding([1, 1], Decoder::ZuneJpeg);
    grey.chroma = None;
    let mut rgb = coding([1, 1], Decoder::ZuneJpeg);
    rgb.color.matrix = ColorMatrix::Rgb;
    for (coding, adobe) in [(grey, None), (rgb, Some(0))] {
        let (blocks, bytes) = file(&coding, size, adobe);
        let image = image::load_from_memory_with_format(&bytes, image::ImageFormat::Jpeg).unwrap().to_rgb8();
        assert!(decoded(&coding, &blocks, size, InverseDct::ZUNE) == *image.as_raw(), "{adobe:?}");
    }
}
