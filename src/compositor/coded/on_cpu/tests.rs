//! Noise and codes of a whole picture beside the reference (coding/path.rs, example_noise/).

use std::sync::Arc;

use super::super::CodedRegion;
use super::*;
use crate::coding::{BLOCK, BlockQuantization, ChromaSampling, Decoder, YcbcrColor};
use crate::example_noise::path::Planes;
use crate::example_noise::persistence::FrameKeys;
use crate::example_noise::synthesis::NoiseContent;
use crate::example_noise::tests::model;
use crate::grey_image::GreyImage;
use crate::memo::ByAddress;
use crate::pixels::Rect;

const SIZE: [usize; 2] = [240, 160];

/// A dark, a bright and a coloured part with stripes, partly beyond the codes.
fn content(x: usize, y: usize) -> [f32; 3] {
    let stripe = if (x / 3 + y / 5).is_multiple_of(7) { 40.3 } else { 0.0 };
    let base = -10.0 + 1.21 * x as f32 + 0.33 * y as f32;
    [base + stripe, base, 0.47 * base + 60.1]
}

/// Share and amplitude factor.
fn weights(x: usize, y: usize) -> [f32; 2] {
    if (40..=200).contains(&x) && (10..=120).contains(&y) {
        return [if x.is_multiple_of(11) { 0.5 } else { 1.0 }, if x.is_multiple_of(13) { 0.25 } else { 1.0 }];
    }
    [0.0; 2]
}

fn coding(factor: [u32; 2], decoder: Decoder) -> PictureCoding {
    let steps = std::array::from_fn(|i| (4 + i / BLOCK + i % BLOCK) as u16);
    let is_jpeg = matches!(decoder, Decoder::ZuneJpeg | Decoder::Libjpeg);
    PictureCoding {
        color: YcbcrColor::JFIF,
        chroma: Some(ChromaSampling::centered(factor)),
        quantization: is_jpeg.then(|| BlockQuantization::at_corner([steps; 3])),
        decoder,
    }
}

/// The coding of a picture that is its own region.
fn of_picture(coding: &PictureCoding, noise: Option<&ExampleNoise>) -> CpuCoding {
    let rect = Rect::new(0, 0, SIZE[0] as i32, SIZE[1] as i32);
    let region = CodedRegion::new(coding, rect, rect, 0);
    let place = RegionPlace { size: SIZE, extent: region.extent() };
    let rows = (0..rect.y1).step_by(TILE);
    let tiles: Vec<_> = rows.map(|y| [0, y, rect.x1, y + TILE_PX]).collect();
    CpuCoding::new(coding, region.uniform(0, 1), place, &tiles, noise)
}

fn plane(value: impl Fn(usize, usize) -> f32) -> GreyImage {
    GreyImage::from_fn(SIZE[0], SIZE[1], value)
}

fn places() -> impl Iterator<Item = (usize, usize)> {
    (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| (x, y)))
}

fn example(factor: [u32; 2]) -> ExampleNoise {
    ExampleNoise {
        model: ByAddress(Arc::new(model(factor))),
        keys: FrameKeys::new(0.6, 9, |before| [3, 500 - before as u32, 77]),
    }
}

#[test]
fn noise_equals_that_of_the_reference() {
    for factor in [[2, 2], [2, 1], [1, 2], [1, 1]] {
        let noise = example(factor);
        let region = of_picture(&coding(factor, Decoder::Libjpeg), Some(&noise));
        let codes: Vec<UncodedTexel> = places()
            .map(|(x, y)| {
                let [r, g, b] = content(x, y);
                [r, g, b, weights(x, y)[0]]
            })
            .collect();
        let factors: Vec<f32> = places().map(|(x, y)| weights(x, y)[1]).collect();
        let texels = UncodedTexels { codes: &codes, amplitude_factors: &factors };
        let parts = NoiseSynthesis::new(&noise, region.place, region.content(&texels));
        let planes = region.coded_planes(&texels, Some(&(parts, LatentLookup::new(&noise.model.numbers.latent))));

        let rgb: Planes = std::array::from_fn(|c| plane(|x, y| content(x, y)[c].clamp(0.0, 255.0)));
        let [share, factor_plane] = [0, 1].map(|i| plane(|x, y| weights(x, y)[i]));
        let content = NoiseContent { rgb: &rgb, share: Some(&share), factor: Some(&factor_plane) };
        let expected = noise.model.noise(&content, &noise.keys);
        for (actual, expected) in planes.noise.iter().zip(&expected) {
            let energy = expected.values.iter().map(|v| v * v).sum::<f32>();
            assert!(energy / expected.values.len() as f32 > 0.3, "there is noise: {energy}");
            for (i, (actual, expected)) in actual.iter().zip(&expected.values).enumerate() {
                let tolerance = 1e-3 + 1e-3 * expected.abs();
                assert!((actual - expected).abs() < tolerance, "{factor:?}, sample {i}: {actual} {expected}");
            }
        }
    }
}

#[test]
fn codes_equal_those_of_the_reference() {
    let rgb: Vec<[f32; 3]> = places().map(|(x, y)| content(x, y)).collect();
    let codes: Vec<UncodedTexel> = rgb.iter().map(|[r, g, b]| [*r, *g, *b, 1.0]).collect();
    let factors = vec![1.0; codes.len()];
    let texels = UncodedTexels { codes: &codes, amplitude_factors: &factors };
    let jpeg =
        [[2, 2], [2, 1], [1, 2], [1, 1]].map(|factor| [Decoder::ZuneJpeg, Decoder::Libjpeg].map(|d| (factor, d)));
    let others = [([2, 2], Decoder::Nearest), ([1, 1], Decoder::Unrounded)];
    for (factor, decoder) in jpeg.into_iter().flatten().chain(others) {
        let (coding, noise) = (coding(factor, decoder), example(factor));
        let actual = of_picture(&coding, Some(&noise)).code(&texels);

        let clipped: Planes = std::array::from_fn(|c| plane(|x, y| content(x, y)[c].clamp(0.0, 255.0)));
        let added = noise.model.noise(&NoiseContent { rgb: &clipped, share: None, factor: None }, &noise.keys);
        let latent = |c: usize, code: f32| {
            let value = noise.model.numbers.latent.at(c, code.clamp(0.0, 255.0));
            if code > 255.0 { value.max(code) } else { value }
        };
        let latent: Vec<[f32; 3]> = rgb.iter().map(|pixel| std::array::from_fn(|c| latent(c, pixel[c]))).collect();
        let mut planes = coding.planes(&latent, SIZE);
        for (plane, added) in planes.iter_mut().zip(&added) {
            plane.samples.iter_mut().zip(&added.values).for_each(|(sample, noise)| *sample += noise);
        }
        let expected = match <[_; 3]>::try_from(planes) {
            Ok(planes) if decoder == Decoder::Unrounded => coding.unrounded_codes(&planes),
            Ok(planes) => coding.decode(&coding.quantized(&planes), SIZE),
            Err(_) => unreachable!("a colour picture has three planes"),
        };
        let differing = actual.iter().zip(expected.as_chunks::<3>().0).filter(|(a, b)| a[..3] != b[..]).count();
        // A coefficient next to a half of its step changes up to 64 px, with chroma 256.
        assert!(differing <= 512, "{factor:?}, {decoder:?}: {differing} of {} px", codes.len());
    }
}
