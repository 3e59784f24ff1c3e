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
        let random = |k: u32, count: u32| hashed(seed.wrapping_add(i * 977 + k * 13), count) as i32;
        let kind = random(99, 5);
        let length = [1, 10, 64, 64, 30][kind as usize];
        let mut block = [0; BLOCK_LEN];
        for (k, &at) in ZIGZAG.iter().enumerate().take(length) {
            let k = k as u32;
            block[at] = match (k, kind) {
                (0, _) => random(0, 120) - 60,
                (_, 3) => random(k, 61) - 30,
                _ if random(k + 64, 3) == 0 => random(k, 21) - 10,
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

/// Checksums of the R'G'B' codes that Pillow 13.0 (libjpeg-turbo 3) decodes from [`file`], by
/// factor and size.
const LIBJPEG_CHECKSUMS: [([u32; 2], [usize; 2], u32); 12] = [
    ([1, 1], [37, 29], 0x0b12_5098),
    ([1, 1], [64, 48], 0xd329_56f6),
    ([2, 1], [37, 29], 0x1ad0_f249),
    ([2, 1], [64, 48], 0x0c15_0b34),
    ([2, 1], [96, 7], 0x8112_33d0),
    ([2, 1], [3, 5], 0x3f27_8a58),
    ([2, 2], [37, 29], 0x1688_54bf),
    ([2, 2], [64, 48], 0xece9_1494),
    ([2, 2], [96, 7], 0xe75f_492c),
    ([2, 2], [3, 5], 0x2482_23b9),
    ([1, 2], [37, 29], 0xb039_d7e9),
    ([1, 2], [64, 48], 0x1359_5764),
];

#[test]
fn decoding_equals_libjpegs_bit_for_bit() {
    let mut failed = Vec::new();
    for (factor, size, checksum) in LIBJPEG_CHECKSUMS {
        let coding = coding(factor, Decoder::Libjpeg);
        let (blocks, _) = file(&coding, size, None);
        let crc = crc32fast::hash(&decoded(&coding, &blocks, size, InverseDct::LIBJPEG));
        if crc != checksum {
            failed.push(format!("{factor:?} {size:?} {crc:#010x}"));
        }
    }
    assert!(failed.is_empty(), "{failed:#?}");
}

const fn color(matrix: ColorMatrix, range: ColorRange) -> YcbcrColor {
    YcbcrColor { matrix, range }
}

/// Checksums of the R'G'B' codes that ffmpeg 5.1 makes of planes of [`hashed`] samples, by factor
/// and size.
const SWSCALE_CHECKSUMS: [([u32; 2], [usize; 2], YcbcrColor, u32); 6] = [
    ([2, 2], [64, 48], color(ColorMatrix::Bt601, ColorRange::Limited), 0x90a3_62af),
    ([2, 2], [64, 48], color(ColorMatrix::Bt709, ColorRange::Limited), 0x1d29_9268),
    ([2, 2], [96, 34], color(ColorMatrix::Bt601, ColorRange::Full), 0x925d_9499),
    ([2, 1], [64, 48], color(ColorMatrix::Bt709, ColorRange::Full), 0xdda6_b10e),
    ([1, 1], [64, 48], color(ColorMatrix::Bt2020, ColorRange::Limited), 0x24cb_a213),
    ([2, 2], [322, 18], color(ColorMatrix::Bt2020, ColorRange::Full), 0xfd8d_b8b4),
];

#[test]
fn decoding_equals_swscales_bit_for_bit() {
    let mut failed = Vec::new();
    for (factor, size, color, checksum) in SWSCALE_CHECKSUMS {
        let decoder = Decoder::Swscale { siting: [ChromaSiting::Centered; 2] };
        let coding = PictureCoding { color, chroma: Some(ChromaSampling::left(factor)), quantization: None, decoder };
        let plane = |plane: u32| {
            let [across, down] = if plane == 0 { [1, 1] } else { factor.map(|f| f as usize) };
            let width = size[0] / across;
            SamplePlane::new(width, size[1] / down, |x, y| hashed((y * width + x) as u32 + 100_000 * plane, 256) as u8)
        };
        let crc = crc32fast::hash(&coding.decode(&[plane(0), plane(1), plane(2)], size));
        if crc != checksum {
            failed.push(format!("{factor:?} {size:?} {color:?} {crc:#010x}"));
        }
    }
    assert!(failed.is_empty(), "{failed:#?}");
}

/// A picture of smooth content without clipped codes, in R'G'B' codes.
fn smooth_picture(size: [usize; 2]) -> Vec<[f32; 3]> {
    let wave = |x: f32, y: f32, a: f32| 60.0 * (x * 0.11 + a).sin() * (y * 0.07 + 2.0 * a).cos();
    let pixel = |x: usize, y: usize| {
        let noise = |plane: u32| hashed((y * size[0] + x) as u32 * 3 + plane, 17) as f32 - 8.0;
        [0.0, 0.4, 0.8].map(|a| 128.0 + wave(x as f32, y as f32, a)).map(|code| code + noise(1))
    };
    (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| pixel(x, y))).collect()
}

#[test]
fn decoded_picture_returns_unchanged_from_its_path() {
    let size = [96, 64];
    for decoder in [Decoder::ZuneJpeg, Decoder::Libjpeg] {
        for factor in FACTORS {
            let coding = coding(factor, decoder);
            let first = coding.decode(&coding.quantized(&coding.planes(&smooth_picture(size), size)), size);
            let again = coding.recode(&first, size);
            let equal = first.iter().zip(&again).filter(|(a, b)| a == b).count();
            assert!(equal * 1000 >= first.len() * 998, "{decoder:?} {factor:?}: {equal} of {}", first.len());
        }
    }
}

#[test]
fn cropped_picture_returns_unchanged_from_a_shifted_grid() {
    let size = [96, 64];
    let whole = coding([2, 2], Decoder::Libjpeg);
    let first = whole.decode(&whole.quantized(&whole.planes(&smooth_picture(size), size)), size);
    let (left, top) = (5, 10);
    let cropped_size = [size[0] - left, size[1] - top];
    let cropped: Vec<u8> =
        (top..size[1]).flat_map(|y| first[3 * (y * size[0] + left)..3 * (y + 1) * size[0]].to_vec()).collect();
    let mut shifted = whole.clone();
    shifted.quantization.as_mut().unwrap().origin = [-(left as i32), -(top as i32)];
    let equal_inside = |coding: &PictureCoding| {
        let again = coding.recode(&cropped, cropped_size);
        let is_inside = |i: &usize| {
            let (x, y) = (i / 3 % cropped_size[0], i / 3 / cropped_size[0]);
            x >= 32 && y >= 32
        };
        let places: Vec<usize> = (0..again.len()).filter(is_inside).collect();
        places.iter().filter(|&&i| again[i] == cropped[i]).count() as f64 / places.len() as f64
    };
    assert!(equal_inside(&shifted) > 0.99, "{}", equal_inside(&shifted));
    assert!(equal_inside(&whole) < 0.8, "{}", equal_inside(&whole));
}

/// One pixel's B' is higher by 80, so its Cb by 40. Centred: a quarter of it, 10, from any pixel of
/// the unit. Cosited: ½ · ½ · 40 = 10 at the sample, ¼ · ½ · 40 = 5 from the pixel beside it.
#[test]
fn chroma_is_the_mean_about_its_siting() {
    let size = [8, 8];
    let picture = |x: usize, y: usize| {
        let mut rgb = vec![[100.0; 3]; 64];
        rgb[y * 8 + x][2] += 80.0;
        rgb
    };
    let mut coding = coding([2, 2], Decoder::Nearest);
    coding.quantization = None;
    let mut cb = |siting: ChromaSampling, x: usize, y: usize| {
        coding.chroma = Some(siting);
        coding.planes(&picture(x, y), size)[1].at(1, 1)
    };
    let near = |a: f32, b: f32| assert!((a - b).abs() < 1e-3, "{a} is not {b}");
    let centered = ChromaSampling::centered([2, 2]);
    near(cb(centered, 2, 2), 138.0);
    near(cb(centered, 3, 3), 138.0);
    near(cb(centered, 1, 2), 128.0);
    let left = ChromaSampling::left([2, 2]);
    near(cb(left, 2, 2), 138.0);
    near(cb(left, 1, 2), 133.0);
    near(cb(left, 3, 3), 133.0);
}

#[test]
fn colours_below_black_stay_in_the_planes() {
    let mut coding = coding([1, 1], Decoder::Libjpeg);
    coding.quantization = None;
    let planes = coding.planes(&[[-20.0; 3]; 64], [8, 8]);
    assert!((planes[0].at(3, 3) + 20.0).abs() < 1e-4 && (planes[1].at(3, 3) - 128.0).abs() < 1e-4);
}
