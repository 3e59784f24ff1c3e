//! Codes of the processor beside those of the shaders, for all decoders, with and without noise.

use std::sync::Arc;

use super::on_cpu::{CpuCoding, RegionPlace, UncodedTexel, UncodedTexels};
use super::*;
use crate::coding::{BlockQuantization, ChromaSiting, YcbcrColor};
use crate::compositor::example_noise::CONTENT_REACH_PX;
use crate::example_noise::persistence::FrameKeys;
use crate::example_noise::tests::model;
use crate::gpu::{Gpu, ReadbackSet};
use crate::memo::ByAddress;
use crate::pixels::Pixels;

const PICTURE: (u32, u32) = (235, 150);
/// The changed pixels.
const CHANGED: Rect = Rect { x0: 70, y0: 20, x1: 235, y1: 131 };

fn codings() -> Vec<PictureCoding> {
    let steps = |factor: i32| std::array::from_fn(|i| (2 + factor + (i / BLOCK + i % BLOCK) as i32) as u16);
    let jpeg = |decoder, factor: [u32; 2], origin| PictureCoding {
        color: YcbcrColor::JFIF,
        chroma: Some(ChromaSampling::centered(factor)),
        quantization: Some(BlockQuantization { steps: [steps(1), steps(3), steps(4)], origin }),
        decoder,
    };
    let unquantized =
        |decoder, chroma| PictureCoding { color: YcbcrColor::JFIF, chroma: Some(chroma), quantization: None, decoder };
    let swscale = Decoder::Swscale { siting: [ChromaSiting::Centered; 2] };
    vec![
        jpeg(Decoder::ZuneJpeg, [2, 2], [0, 0]),
        jpeg(Decoder::Libjpeg, [2, 2], [-8, -3]),
        jpeg(Decoder::ZuneJpeg, [1, 2], [0, -1]),
        jpeg(Decoder::Libjpeg, [2, 1], [-5, 0]),
        jpeg(Decoder::ZuneJpeg, [1, 1], [0, 0]),
        unquantized(swscale, ChromaSampling::left([2, 2])),
        unquantized(Decoder::Nearest, ChromaSampling::centered([2, 1])),
        PictureCoding::UNROUNDED,
    ]
}

/// R'G'B' codes with the changed share, and the amplitude factor: dark and bright parts beyond the
/// codes, colours, stripes, and pixels that are real in part.
fn uncoded(x: i32, y: i32) -> (UncodedTexel, f32) {
    let stripe = if (x / 3 + y / 5) % 7 == 0 { 40.3 } else { 0.0 };
    let base = -10.0 + 1.21 * x as f32 + 0.33 * y as f32;
    let [share, factor] = if CHANGED.contains(x, y) {
        [if x % 11 == 0 { 0.5 } else { 1.0 }, if x % 13 == 0 { 0.25 } else { 1.0 }]
    } else {
        [0.0; 2]
    };
    ([base + stripe, base, 0.47 * base + 60.1, share], factor)
}

/// A region of a picture, with its uncoded texels and amplitude factors.
struct Uncoded<'a> {
    region: CodedRegion<'a>,
    tiles: Vec<Rect>,
    texels: Vec<UncodedTexel>,
    factors: Vec<f32>,
}

impl<'a> Uncoded<'a> {
    fn new(coding: &'a PictureCoding) -> Self {
        let picture = Rect::full(PICTURE.0, PICTURE.1);
        let region = CodedRegion::new(coding, CHANGED, picture, CONTENT_REACH_PX);
        let Rect { x0, y0, x1, y1 } = region.rect;
        let inside = |at: i32, side: u32| at.clamp(0, side as i32 - 1);
        let places = (y0..y1).flat_map(|y| (x0..x1).map(move |x| (inside(x, PICTURE.0), inside(y, PICTURE.1))));
        let (texels, factors) = places.map(|(x, y)| uncoded(x, y)).unzip();
        Self { tiles: region.tiles(&[CHANGED]), region, texels, factors }
    }

    fn size(&self) -> (u32, u32) {
        (self.region.rect.width(), self.region.rect.height())
    }

    fn by_shaders(&self, recorder: &mut PassRecorder, pixels: &Pixels, noise: Option<&ExampleNoise>) -> Vec<u8> {
        let (gpu, size) = (recorder.gpu.clone(), self.size());
        let codes = recorder.pool.lend_to_write(&gpu, size, UNCODED);
        codes.write(&gpu, size.0, size.1, &self.texels);
        let amplitude_factor = recorder.pool.lend_to_write(&gpu, size, AMPLITUDE_FACTOR);
        amplitude_factor.write(&gpu, size.0, size.1, &self.factors);
        let piece = CompositePiece { rect: CHANGED, drawn: CHANGED, shadowed: CHANGED };
        let coded = CodedPiece { region: &self.region, piece: &piece, changed: &[CHANGED], parts: &[], noise };
        let uncoded = UncodedRegion { codes, amplitude_factor: noise.map(|_| amplitude_factor) };
        let upload = CameraUpload::new(recorder, pixels, Rect::full(PICTURE.0, PICTURE.1));
        let out = code_region(recorder, &coded, &upload, &self.tiles, &uncoded);
        let mut readback = recorder.read_back(&mut ReadbackSet::default(), &out, (CHANGED.width(), CHANGED.height()));
        readback.submitted(recorder.submit());
        readback.bytes(&gpu).expect("read back")
    }

    fn on_cpu(&self, noise: Option<&ExampleNoise>) -> Vec<u8> {
        let size = self.size();
        let place = RegionPlace { size: [size.0 as usize, size.1 as usize], extent: self.region.extent() };
        let corners = corners_in(&self.tiles, self.region.rect);
        let coding = CpuCoding::new(self.region.coding, self.region.uniform(0, 1), place, &corners, noise);
        let codes = coding.code(&UncodedTexels { codes: &self.texels, amplitude_factors: &self.factors });
        let Rect { x0, y0, .. } = self.region.rect;
        let at = |x: i32, y: i32| codes[(y - y0) as usize * size.0 as usize + (x - x0) as usize];
        (CHANGED.y0..CHANGED.y1).flat_map(|y| (CHANGED.x0..CHANGED.x1).flat_map(move |x| at(x, y))).collect()
    }
}

#[test]
fn codes_of_the_processor_equal_those_of_the_shaders() {
    let mut recorder = PassRecorder::new(Gpu::open().expect("an adapter"));
    let pixels = Pixels::from_u8(PICTURE.0, PICTURE.1, vec![120; 3 * (PICTURE.0 * PICTURE.1) as usize]).unwrap();
    for coding in codings() {
        let uncoded = Uncoded::new(&coding);
        let factor = coding.chroma_factor();
        let noise = ExampleNoise { model: ByAddress(Arc::new(model(factor))), keys: FrameKeys::single([3, 500, 77]) };
        for noise in [None, Some(&noise)] {
            let [shaders, cpu] = [uncoded.by_shaders(&mut recorder, &pixels, noise), uncoded.on_cpu(noise)];
            let differing = shaders.iter().zip(&cpu).filter(|(a, b)| a != b).count();
            let share = differing as f64 / shaders.len() as f64;
            // A coefficient next to a half of its step changes up to 64 codes: half floats in the
            // shaders' atlas and fused products move some across.
            let largest_share = if noise.is_some() { 0.02 } else { 0.001 };
            assert!(share <= largest_share, "{coding}, {:?}, noise {}: {share}", coding.decoder, noise.is_some());
        }
    }
}
