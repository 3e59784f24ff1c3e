//! Changed pixels take the path of the camera's picture, as the processor's reference has it.

use crate::board::{FOCAL_PX, board, merge_scenes, panel, sideways};
use crate::gpu;
use locard::camera::{NoiseBin, NoiseProfile};
use locard::coding::{
    BlockQuantization, ChromaSampling, ChromaSiting, ColorMatrix, ColorRange, Decoder, PictureCoding, YcbcrColor,
};
use locard::compositor::Composited;
use locard::example_noise::calibration::{CalibrationFrame, calibrate};
use locard::example_noise::path::{codes, padded};
use locard::example_noise::persistence::FrameKeys;
use locard::example_noise::synthesis::NoiseContent;
use locard::example_noise::{NoiseModel, NoiseModelFile};
use locard::grey_image::GreyImage;
use locard::hash::pcg3d;
use locard::memo::ByAddress;
use locard::params::Value;
use locard::pixels::{Codes, Pixels};
use locard::scene::Scene;
use std::sync::Arc;

const WIDTH: u32 = 90;
const HEIGHT: u32 = 70;

/// Steps that grow with the frequency, as a camera's do.
fn steps(scale: u16) -> [[u16; 64]; 3] {
    let table = |base: u16| std::array::from_fn(|i| base + scale * (i / 8 + i % 8) as u16);
    [table(3), table(4), table(5)]
}

fn jpeg(factor: [u32; 2], decoder: Decoder, origin: [i32; 2]) -> PictureCoding {
    PictureCoding {
        color: YcbcrColor::JFIF,
        chroma: Some(ChromaSampling::centered(factor)),
        quantization: Some(BlockQuantization { steps: steps(2), origin }),
        decoder,
    }
}

/// A picture with gradients of all channels.
fn camera_code(i: u32) -> [u16; 3] {
    let (x, y) = (i % WIDTH, i / WIDTH);
    [40 + 2 * x as u16, 60 + 2 * y as u16, 200 - (x + y) as u16 + 9 * (x as u16 / 5 % 2)]
}

/// Composites a board into the picture.
fn composite(coding: Option<PictureCoding>, noise: f64) -> Composited {
    composite_scene(board([21.3, 17.8], 0.4), coding, noise, None)
}

/// Composites a scene into the picture at 8 bits with a coding, or at 16 bits without.
fn composite_scene(
    scene: Scene,
    coding: Option<PictureCoding>,
    noise: f64,
    example: Option<&NoiseModelFile>,
) -> Composited {
    let codes = (0..WIDTH * HEIGHT).flat_map(camera_code);
    let pixels = match coding {
        Some(coding) => {
            let pixels = Pixels::from_u8(WIDTH, HEIGHT, codes.map(|code| code as u8).collect()).unwrap();
            Pixels { coding: Some(Arc::new(coding)).filter(|coding| coding.decoder != Decoder::Unrounded), ..pixels }
        }
        None => Pixels::from_u16(WIDTH, HEIGHT, codes.map(|code| 257 * code).collect()).unwrap(),
    };
    let mut camera = gpu::camera(&gpu::pinhole(WIDTH, HEIGHT, FOCAL_PX), 0.0);
    let bins = vec![NoiseBin { code: 0.0, sigma: 6.0 }, NoiseBin { code: 255.0, sigma: 6.0 }];
    camera.noise = Some(NoiseProfile {
        example: example.cloned(),
        bins: [bins.clone(), bins.clone(), bins],
        channel_correlation: [0.0; 3],
        neighbour_correlation: [0.3, 0.2],
    });
    let settings = gpu::settings(&[("noise", "scale", Value::Number(noise))]);
    gpu::composite(&gpu::gpu(), &camera, settings, scene, &sideways([3.0, 2.0]), gpu::frame(0, 0.0, pixels))
}

/// The reference: the composite without rounding through the path.
fn reference(coding: &PictureCoding, noise: f64) -> Vec<u8> {
    let Codes::U16(fine) = composite(None, noise).pixels.codes else { panic!("16 bits are kept") };
    let rgb: Vec<[f32; 3]> = fine.as_chunks::<3>().0.iter().map(|code| code.map(|c| f32::from(c) / 257.0)).collect();
    let size = [WIDTH as usize, HEIGHT as usize];
    coding.decode(&coding.quantized(&coding.planes(&rgb, size)), size)
}

#[test]
fn changed_pixels_take_the_path_of_the_cameras_picture() {
    for (factor, decoder, origin) in [
        ([2, 2], Decoder::ZuneJpeg, [0, 0]),
        ([2, 1], Decoder::ZuneJpeg, [0, 0]),
        ([1, 1], Decoder::ZuneJpeg, [0, 0]),
        ([2, 2], Decoder::Libjpeg, [-8, -3]),
        ([2, 1], Decoder::Libjpeg, [-5, 0]),
        ([1, 2], Decoder::Libjpeg, [0, 0]),
    ] {
        assert_follows_reference(jpeg(factor, decoder, origin));
    }
    for decoder in [Decoder::Nearest, Decoder::Swscale { siting: [ChromaSiting::Centered; 2] }] {
        for (chroma, color) in [
            (ChromaSampling::left([2, 2]), YcbcrColor { matrix: ColorMatrix::Bt709, range: ColorRange::Limited }),
            (ChromaSampling::left([2, 1]), YcbcrColor { matrix: ColorMatrix::Bt601, range: ColorRange::Full }),
            (ChromaSampling::FULL, YcbcrColor { matrix: ColorMatrix::Bt2020, range: ColorRange::Limited }),
        ] {
            assert_follows_reference(PictureCoding { color, chroma: Some(chroma), quantization: None, decoder });
        }
    }
    let grey = PictureCoding { chroma: None, ..jpeg([1, 1], Decoder::ZuneJpeg, [0, 0]) };
    assert_follows_reference(grey);
    let rgb = YcbcrColor { matrix: ColorMatrix::Rgb, range: ColorRange::Full };
    assert_follows_reference(PictureCoding { color: rgb, ..jpeg([1, 1], Decoder::ZuneJpeg, [0, 0]) });
}

fn assert_follows_reference(coding: PictureCoding) {
    let what = format!("{:?} {:?} {:?}", coding.color, coding.chroma, coding.decoder);
    let expected = reference(&coding, 1.0);
    let done = composite(Some(coding.clone()), 1.0);
    let (actual, layer) = (done.pixels.codes.eight_bit().unwrap(), &done.layer.as_ref().unwrap().rgba);
    let (mut covered, mut differing) = (0, 0);
    for (i, (actual, expected)) in actual.iter().zip(&expected).enumerate() {
        let coverage = layer[i / 3][3];
        if coverage == 0.0 {
            assert_eq!(u16::from(*actual), camera_code(i as u32 / 3)[i % 3], "a pixel without the layer");
        } else if coverage == 1.0 {
            covered += 1;
            differing += usize::from(actual != expected);
        }
    }
    // The reference's 16-bit picture is rounded, which moves a few samples and, in a few blocks, a
    // coefficient over a threshold.
    let tolerated = if coding.quantization.is_some() { covered / 10 } else { covered / 100 };
    assert!(covered > 3000 && differing <= tolerated, "{what}: {differing} of {covered}");
}

/// A panel's pixels are the same beside another panel: regions of any extent join up.
#[test]
fn coded_pixels_do_not_depend_on_the_rectangle() {
    let near = || panel([-33.0, -26.0], [-14.0, -9.0], 0.5);
    let far = panel([15.0, 12.0], [39.0, 31.0], 0.2);
    for coding in [jpeg([2, 2], Decoder::ZuneJpeg, [-8, -5]), jpeg([1, 2], Decoder::Libjpeg, [0, 0])] {
        let alone = composite_scene(near(), Some(coding.clone()), 1.0, None).pixels;
        let both = composite_scene(merge_scenes(near(), far.clone()), Some(coding), 1.0, None).pixels;
        assert_ne!(alone, both);
        for (x, y) in (0..34).flat_map(|y| (0..44).map(move |x| (x, y))) {
            assert_eq!(alone.at(x, y), both.at(x, y), "({x}, {y})");
        }
    }
}

/// Noise by example of σ 6 to 8 in all channels.
fn example(coding: &PictureCoding) -> NoiseModelFile {
    const SIDE: usize = 288;
    let mean = GreyImage::from_fn(SIDE, SIDE, |x, y| 40.0 + 0.5 * x as f32 + 0.15 * y as f32);
    let noise = |i: usize, c: u32| f32::from(pcg3d([i as u32, c, 9])[0] as u16) / 65_535.0 - 0.5;
    let sigma = |i: usize| (6.0 + 2.0 * mean.values[i] / 255.0) * 12.0f32.sqrt();
    let noisy =
        (0..SIDE * SIDE).flat_map(|i| [0, 1, 2].map(|c| (mean.values[i] + sigma(i) * noise(i, c)).round() as u8));
    let frame = CalibrationFrame {
        noisy: noisy.collect(),
        mean: [mean.clone(), mean.clone(), mean.clone()],
        mask: vec![true; SIDE * SIDE],
        variance_gain: 1.0,
    };
    let model = calibrate(&[frame], coding, 3).expect("enough tiles");
    NoiseModelFile { file: "test.locnoise".into(), model: ByAddress(Arc::new(model)) }
}

/// A panel whose edges are those of pixels.
fn whole_pixels() -> Scene {
    panel([-30.0, -24.0], [30.0, 24.0], 0.4)
}

/// The reference: the composite without noise or rounding, with noise in its planes.
fn example_reference(coding: &PictureCoding, model: &NoiseModel, alpha: &[f32]) -> Vec<u8> {
    let Codes::U16(fine) = composite_scene(whole_pixels(), None, 0.0, None).pixels.codes else {
        panic!("16 bits are kept")
    };
    let size = [WIDTH as usize, HEIGHT as usize];
    let plane = |value: &dyn Fn(usize) -> f32| {
        let values = (0..size[0] * size[1]).map(value).collect();
        GreyImage { width: size[0], height: size[1], values }
    };
    let rgb: [GreyImage; 3] = std::array::from_fn(|c| plane(&|i| f32::from(fine[3 * i + c]) / 257.0));
    let share = plane(&|i| (2.0 * alpha[i]).min(1.0));
    let factor = plane(&|i| (1.0 - (1.0 - alpha[i]).powi(2)).sqrt());
    let content = padded(&rgb, coding);
    let [share, factor, _] = padded(&[share.clone(), factor, share], coding);
    let key = locard::effects::noise::pattern_key(0, 0, 1);
    let noise = model
        .noise(&NoiseContent { rgb: &content, share: Some(&share), factor: Some(&factor) }, &FrameKeys::single(key));
    let pixels = (0..size[0] * size[1]).map(|i| [0, 1, 2].map(|c: usize| rgb[c].values[i])).collect::<Vec<_>>();
    let mut planes: [GreyImage; 3] = coding
        .planes(&pixels, size)
        .into_iter()
        .map(|p| GreyImage { width: p.width, height: p.height, values: p.samples })
        .collect::<Vec<_>>()
        .try_into()
        .unwrap();
    for (plane, noise) in planes.iter_mut().zip(&noise) {
        plane.values.iter_mut().zip(&noise.values).for_each(|(v, n)| *v += n);
    }
    codes(planes, coding, size)
}

#[test]
fn noise_by_example_goes_through_the_coding() {
    for (coding, tolerated) in [
        (jpeg([2, 2], Decoder::ZuneJpeg, [-8, -5]), 0.06),
        (PictureCoding { quantization: None, ..jpeg([2, 1], Decoder::Nearest, [0, 0]) }, 0.005),
        (PictureCoding::UNROUNDED, 0.005),
    ] {
        let example = example(&coding);
        let done = composite_scene(whole_pixels(), Some(coding.clone()), 1.0, Some(&example));
        // The calibration's picture is larger.
        let mismatch = done.stats.example_mismatch.as_deref().expect("another size");
        assert!(mismatch.contains("288x288 px") && mismatch.contains(&format!("{WIDTH}x{HEIGHT} px")), "{mismatch}");
        let layer = &done.layer.as_ref().unwrap().rgba;
        let alpha: Vec<f32> = layer.iter().map(|texel| texel[3]).collect();
        let expected = example_reference(&coding, &example.model, &alpha);
        let codes = done.pixels.codes.eight_bit().unwrap();
        let (mut covered, mut differing, mut noisy) = (0, 0, 0);
        let plain = composite_scene(whole_pixels(), None, 0.0, None).pixels;
        for (i, (codes, expected)) in codes.iter().zip(&expected).enumerate() {
            let at = (i as u32 / 3 % WIDTH, i as u32 / 3 / WIDTH);
            if alpha[i / 3] == 0.0 {
                assert_eq!(u16::from(*codes), camera_code(i as u32 / 3)[i % 3], "a pixel without the layer");
            } else if alpha[i / 3] == 1.0 {
                covered += 1;
                differing += usize::from(codes.abs_diff(*expected) > 1);
                noisy += usize::from(codes.abs_diff(plain.eight_bits_at(at.0, at.1)[i % 3]) > 3);
            }
        }
        let share = differing as f32 / covered as f32;
        assert!(covered > 3000 && share <= tolerated, "{:?}: {differing} of {covered}", coding.decoder);
        assert!(noisy > covered / 3, "there is noise: {noisy} of {covered}");
    }
}

#[test]
fn noise_by_example_does_not_depend_on_the_rectangle() {
    let near = || panel([-33.0, -26.0], [-14.0, -9.0], 0.5);
    let far = panel([36.0, 28.0], [44.0, 34.0], 0.2);
    let coding = jpeg([2, 2], Decoder::ZuneJpeg, [-8, -5]);
    let example = example(&coding);
    // The other panel is in another cell, therefore it changes no source.
    let alone = composite_scene(near(), Some(coding.clone()), 1.0, Some(&example)).pixels;
    let both = composite_scene(merge_scenes(near(), far), Some(coding), 1.0, Some(&example)).pixels;
    assert_ne!(alone, both);
    for (x, y) in (0..34).flat_map(|y| (0..44).map(move |x| (x, y))) {
        assert_eq!(alone.at(x, y), both.at(x, y), "({x}, {y})");
    }
}

#[test]
fn noise_by_example_of_another_sampling_falls_back_to_the_pattern() {
    let coding = || Some(jpeg([2, 2], Decoder::ZuneJpeg, [0, 0]));
    let scene = || board([21.3, 17.8], 0.4);
    let other = example(&jpeg([2, 1], Decoder::ZuneJpeg, [0, 0]));
    let [of_pattern, refused] = [None, Some(&other)].map(|example| composite_scene(scene(), coding(), 1.0, example));
    assert_eq!(of_pattern.pixels, refused.pixels);
    assert_eq!(of_pattern.stats.no_example_noise, None);
    assert_eq!(refused.stats.example_mismatch, None);
    let because = refused.stats.no_example_noise.expect("a reason");
    assert!(because.contains("chroma"), "{because}");
}
