//! Reference noise: residual noise after lossy encoding, and static scenes for calibration.

use crate::camera::{NoiseBin, NoiseProfile};
use crate::pixels::Pixels;

use super::sensor::ROUNDING_VARIANCE;
use super::{Motion, Options, SimulateError, Simulation};

/// Number of noise realisations measured after lossy encoding.
const NOISE_REALISATIONS: u64 = 12;
const FIRST_NOISE_KEY: u64 = 1 << 40;
/// Minimum number of values for a σ.
const MIN_VALUES: f64 = 2000.0;

/// A static scene with and without noise.
#[derive(Clone, Debug)]
pub struct StaticScene {
    /// Factor on the light.
    pub gain: f64,
    /// Noise-free code values, not rounded, three per pixel; above 255 where clipped.
    pub clean: Vec<f32>,
    pub frames: Vec<Pixels>,
}

/// Static scenes of one sensor and its exact noise.
#[derive(Clone, Debug)]
pub struct StaticScenes {
    /// Noise before rounding and clipping.
    pub noise: NoiseProfile,
    pub scenes: Vec<StaticScene>,
}

/// The site from a camera at rest under several exposures (`gains`, factors on the light), with
/// `frames` noisy frames each. The motion, frames and format of `options` are ignored.
pub fn static_scenes(options: &Options, gains: &[f64], frames: usize) -> Result<StaticScenes, SimulateError> {
    let options = Options { motion: Motion::Static, frames: 1, ..options.clone() };
    Ok(Simulation::new(&options)?.static_scenes(gains, frames))
}

impl Simulation {
    /// The simulation's first picture as [`static_scenes`].
    pub fn static_scenes(&self, gains: &[f64], frames: usize) -> StaticScenes {
        let picture = self.picture(0);
        let (width, height) = (picture.width, picture.height);
        let scene = |(scene, gain): (usize, &f64)| {
            let clean = self.sensor.clean(&picture, *gain);
            let frame = |frame: usize| {
                let key = FIRST_NOISE_KEY + ((scene as u64) << 20) + frame as u64;
                Pixels::from_u8(width, height, self.sensor.sense(&clean, width as usize, key, self.threads))
            };
            StaticScene { gain: *gain, frames: (0..frames).filter_map(frame).collect(), clean }
        };
        StaticScenes { noise: self.sensor.profile(), scenes: gains.iter().enumerate().map(scene).collect() }
    }
}

/// Running sums for the correlation of two quantities.
#[derive(Clone, Copy, Default)]
struct ResidualCorrelation {
    products: f64,
    squares: f64,
}

impl ResidualCorrelation {
    fn add(&mut self, a: f64, b: f64) {
        self.products += a * b;
        self.squares += 0.5 * (a * a + b * b);
    }

    fn correlation(&self) -> f64 {
        if self.squares > 0.0 { self.products / self.squares } else { 0.0 }
    }
}

/// Residual noise after encoding: noise-free pictures (code values, three per pixel) with several
/// noise realisations each are passed `through_file`, and the result is measured.
pub(super) fn noise_through_file<E>(
    simulation: &Simulation,
    pictures: &[Vec<f32>],
    mut through_file: impl FnMut(Vec<u8>) -> Result<Vec<u8>, E>,
) -> Result<NoiseProfile, E> {
    let width = simulation.geometry().intrinsics.width_px as usize;
    let mut bins = [[(0.0f64, 0.0f64, 0.0f64); 16]; 3];
    let (mut right, mut below, mut channels) =
        (ResidualCorrelation::default(), ResidualCorrelation::default(), [ResidualCorrelation::default(); 3]);
    for (scene, clean) in pictures.iter().enumerate() {
        let mut takes = Vec::new();
        for take in 0..NOISE_REALISATIONS {
            let key = FIRST_NOISE_KEY + scene as u64 * NOISE_REALISATIONS + take;
            takes.push(through_file(simulation.sensor.sense(clean, width, key, simulation.threads))?);
        }
        let n = takes.len() as f64;
        let value = |take: &Vec<u8>, i: usize| take.get(i).map_or(0.0, |v| f64::from(*v));
        let mean: Vec<f64> =
            (0..clean.len()).map(|i| takes.iter().map(|take| value(take, i)).sum::<f64>() / n).collect();
        for take in &takes {
            let deviation = |i: usize| value(take, i) - mean[i];
            for i in (0..clean.len()).step_by(3) {
                // Clipping hides the noise of these values.
                if (i..i + 3).any(|i| !(12.0..=243.0).contains(&mean[i])) {
                    continue;
                }
                for c in 0..3 {
                    let bin = &mut bins[c][((mean[i + c] / 16.0) as usize).min(15)];
                    *bin = (bin.0 + 1.0, bin.1 + mean[i + c], bin.2 + deviation(i + c).powi(2) * n / (n - 1.0));
                }
                for (pair, (a, b)) in channels.iter_mut().zip([(0, 1), (0, 2), (1, 2)]) {
                    pair.add(deviation(i + a), deviation(i + b));
                }
                if (i / 3 + 1) % width != 0 {
                    right.add(deviation(i + 1), deviation(i + 4));
                }
                if i + 3 * width < clean.len() {
                    below.add(deviation(i + 1), deviation(i + 3 * width + 1));
                }
            }
        }
    }
    let before_rounding = |variance: f64| (variance - ROUNDING_VARIANCE).max(0.0).sqrt();
    let measured = |channel: &[(f64, f64, f64); 16]| {
        let full = channel.iter().filter(|bin| bin.0 >= MIN_VALUES);
        let list: Vec<_> =
            full.map(|bin| NoiseBin { code: bin.1 / bin.0, sigma: before_rounding(bin.2 / bin.0) }).collect();
        if list.is_empty() { vec![NoiseBin { code: 128.0, sigma: 0.0 }] } else { list }
    };
    let bins = [0, 1, 2].map(|c| resampled(&measured(&bins[c])));
    Ok(NoiseProfile {
        example: None,
        bins,
        channel_correlation: channels.map(|pair| pair.correlation().clamp(-1.0, 1.0)),
        neighbour_correlation: [right, below].map(|pair| pair.correlation().clamp(0.0, 0.99)),
    })
}

/// σ at the centres of the sixteen bins: interpolated linearly between measured values, constant
/// beyond.
fn resampled(measured: &[NoiseBin]) -> Vec<NoiseBin> {
    let sigma = |code: f64| {
        let after = measured.partition_point(|bin| bin.code <= code);
        match (after.checked_sub(1).and_then(|i| measured.get(i)), measured.get(after)) {
            (Some(a), Some(b)) => a.sigma + (b.sigma - a.sigma) * (code - a.code) / (b.code - a.code),
            (Some(bin), None) | (None, Some(bin)) => bin.sigma,
            (None, None) => 0.0,
        }
    };
    (0..16).map(|bin| 16.0 * f64::from(bin) + 8.0).map(|code| NoiseBin { code, sigma: sigma(code) }).collect()
}

#[cfg(test)]
mod tests {
    use super::super::site::Detail;
    use super::*;

    /// A lossless file must reproduce the sensor's own table: 3·12·30,000 values in three pictures
    /// determine a bin's σ to 1 %, a correlation to 0.01.
    #[test]
    fn lossless_encoding_preserves_the_noise_profile() {
        let options = Options { width_px: 320, height_px: 240, focal_px: 20.0, k1: 0.0, ..Options::default() };
        let simulation = Simulation::with_detail(&options, Detail::for_focal_px(20.0), 2).unwrap();
        let picture = |first: f32| (0..3 * 320 * 240).map(|i| first + (i / 9600) as f32 * 3.0).collect::<Vec<_>>();
        let pictures = [picture(20.0), picture(90.0), picture(160.0)];
        let noise = noise_through_file(&simulation, &pictures, Ok::<_, ()>).unwrap();
        for (c, bins) in noise.bins.iter().enumerate() {
            for bin in &bins[2..14] {
                let relative = bin.sigma / simulation.sensor.sigma(c, bin.code);
                assert!((relative - 1.0).abs() < 0.03, "{c} {bin:?} {relative}");
            }
        }
        // Rounding is independent and lowers a correlation by up to 1/12 over 6.
        for (actual, with_final_path) in noise.channel_correlation.iter().zip([0.45; 3]) {
            assert!((actual - with_final_path).abs() < 0.03, "{actual}");
        }
        for (actual, with_final_path) in noise.neighbour_correlation.iter().zip([0.6; 2]) {
            assert!((actual - with_final_path).abs() < 0.03, "{actual}");
        }
    }
}
