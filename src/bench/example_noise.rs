//! Cost of noise by example with the format that it goes through, over the plain composite.

use std::path::PathBuf;
use std::sync::Arc;

use super::{BenchTable, Load, median_frame_ms};
use crate::coding::PictureCoding;
use crate::compositor::{Settings, SubmitError};
use crate::example_noise::calibration::{CalibrationFrame, calibrate};
use crate::example_noise::{NoiseModel, NoiseModelFile};
use crate::grey_image::GreyImage;
use crate::hash::pcg3d;
use crate::memo::ByAddress;
use crate::pixels::Pixels;

const NAME: &str = "plain + noise by example and format";
/// Side of the calibration's picture, px.
const SIDE: usize = 320;

/// Adds the row.
pub fn time(table: &mut BenchTable<'_>, load: &Load, pixels: &Pixels) -> Result<(), SubmitError> {
    let Some(model) = pixels.coding.as_deref().filter(|_| table.includes(NAME)).and_then(model) else { return Ok(()) };
    let mut load = load.clone();
    let example = NoiseModelFile { file: PathBuf::new(), model: ByAddress(Arc::new(model)) };
    load.camera.noise.iter_mut().for_each(|noise| noise.example = Some(example.clone()));
    let mut settings = Settings::default();
    settings.plain();
    let are_effects = ["noise", "format"].iter().all(|name| settings.switch(name, true).is_ok());
    debug_assert!(are_effects, "noise and format are effects");
    let ms = median_frame_ms(table.gpu, &load, &load.scene, (pixels, None), &settings, &mut |_| ())?;
    Ok(table.push(NAME.to_owned(), ms)?)
}

/// A model of white noise on a ramp of grey.
fn model(coding: &PictureCoding) -> Option<NoiseModel> {
    let mean = GreyImage::from_fn(SIDE, SIDE, |x, y| 20.0 + 0.4 * x as f32 + 0.25 * y as f32);
    let noise = |i: usize, c: u32| 20.0 * (pcg3d([i as u32, c, 0])[0] as f32 / u32::MAX as f32 - 0.5);
    let noisy = |i: usize| [0, 1, 2].map(|c| (mean.values[i] + noise(i, c)).round() as u8);
    let frame = CalibrationFrame {
        noisy: (0..SIDE * SIDE).flat_map(noisy).collect(),
        mean: [mean.clone(), mean.clone(), mean.clone()],
        mask: vec![true; SIDE * SIDE],
        variance_gain: 1.0,
    };
    calibrate(&[frame], coding, 0).ok()
}
