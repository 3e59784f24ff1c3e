//! Noise estimated from textureless places of the recording, if no profile gives the camera's
//! (calibrate/textureless.rs).

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::calibrate::NoiseOptions;
use crate::calibrate::textureless::TexturelessCalibrator;
use crate::camera::{NoiseBin, NoiseProfile};
use crate::pixels::Pixels;
use crate::text::{count, fixed};

/// Number of evenly spaced frames that are measured.
const FRAMES: usize = 64;
/// Largest plausible σ of a camera's noise, 8-bit codes. Where even the flattest places vary more,
/// they are texture.
const MAX_SIGMA: f64 = 16.0;

/// Noise of the camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NoiseFindings {
    /// The reason for which it is unknown.
    pub why: Option<String>,
    /// Number of measured frames.
    pub frames: usize,
    pub table: Option<NoiseTable>,
}

/// A noise profile with the same codes for all channels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NoiseTable {
    /// Middles of the bins, 8-bit codes, ascending.
    code: Vec<f64>,
    /// Standard deviation of R, G and B at each of them, 8-bit codes.
    sigma: [Vec<f64>; 3],
    channel_correlation: [f64; 3],
    neighbour_correlation: [f64; 2],
}

impl NoiseTable {
    fn of(profile: &NoiseProfile) -> Self {
        Self {
            code: profile.bins[0].iter().map(|bin| bin.code).collect(),
            sigma: profile.bins.each_ref().map(|bins| bins.iter().map(|bin| bin.sigma).collect()),
            channel_correlation: profile.channel_correlation,
            neighbour_correlation: profile.neighbour_correlation,
        }
    }

    fn profile(&self) -> NoiseProfile {
        let bins = |sigma: &Vec<f64>| {
            self.code.iter().zip(sigma).map(|(&code, &sigma)| NoiseBin { code, sigma }).collect::<Vec<_>>()
        };
        NoiseProfile {
            example: None,
            bins: self.sigma.each_ref().map(bins),
            channel_correlation: self.channel_correlation,
            neighbour_correlation: self.neighbour_correlation,
        }
    }

    /// Whether it has values that a measurement can have.
    fn is_valid(&self) -> bool {
        let ascends = self.code.is_sorted_by(|a, b| a < b) && !self.code.is_empty();
        let is_code = |code: &f64| (0.0..=255.0).contains(code);
        let is_sigma = |sigma: &f64| (0.0..=255.0).contains(sigma);
        let sigmas = self.sigma.iter().all(|sigma| sigma.len() == self.code.len() && sigma.iter().all(is_sigma));
        let correlations = self.channel_correlation.iter().all(|r| (-1.0..=1.0).contains(r))
            && self.neighbour_correlation.iter().all(|r| (0.0..=1.0).contains(r));
        ascends && self.code.iter().all(is_code) && sigmas && correlations
    }
}

impl NoiseFindings {
    /// `None` if it is unknown.
    pub fn profile(&self) -> Option<NoiseProfile> {
        self.table.as_ref().map(NoiseTable::profile)
    }

    /// Checks the values of a file.
    pub fn check(&self) -> Result<(), String> {
        match &self.table {
            Some(table) if !table.is_valid() => {
                Err("[noise.table] has values that no measurement has; analyse the recording anew".to_owned())
            }
            _ => Ok(()),
        }
    }
}

impl fmt::Display for NoiseFindings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(profile) = self.profile() else {
            return write!(f, "unknown: {}", self.why.as_deref().unwrap_or("no reason is given"));
        };
        let sigma = |code: f64| fixed((0..3).map(|c| profile.sigma(c, code)).sum::<f64>() / 3.0, 1);
        let [dark, middle, bright] = [32.0, 128.0, 224.0].map(sigma);
        write!(
            f,
            "σ {dark}, {middle} and {bright} codes in shadows, middle tones and highlights, from textureless places of {}",
            count(self.frames, "frame")
        )
    }
}

/// A measurement in progress.
#[derive(Debug)]
pub struct NoiseSampler {
    calibrator: Option<TexturelessCalibrator>,
    frame_count: usize,
    frames: usize,
    why: Option<String>,
}

impl NoiseSampler {
    /// A sampler of a recording. If the camera's noise is known, nothing is measured.
    pub fn new(profile: Option<&NoiseProfile>, frame_count: usize) -> Self {
        let calibrator = match profile {
            None => TexturelessCalibrator::new(NoiseOptions::default()).ok(),
            Some(_) => None,
        };
        Self { calibrator, frame_count, frames: 0, why: None }
    }

    /// Adds a frame if it is one of those that are measured.
    pub fn add(&mut self, index: usize, pixels: &Pixels) {
        let slot = |index: usize| index * FRAMES / self.frame_count.max(1);
        let is_measured = self.frame_count <= FRAMES || index == 0 || slot(index) != slot(index - 1);
        let Some(calibrator) = self.calibrator.as_mut().filter(|_| is_measured) else { return };
        match calibrator.add_frame(pixels) {
            Ok(()) => self.frames += 1,
            Err(error) => self.why = Some(error.to_string()),
        }
    }

    /// `None` if nothing was to be measured.
    pub fn finish(self) -> Option<NoiseFindings> {
        let Self { calibrator, frames, why, .. } = self;
        let measured = calibrator?.finish();
        Some(match (why, measured) {
            (None, Ok(measured)) if largest_sigma(&measured.profile) > MAX_SIGMA => {
                let why = "even the flattest places vary by more than a camera's noise: they are texture".to_owned();
                NoiseFindings { why: Some(why), frames, table: None }
            }
            (None, Ok(measured)) => NoiseFindings { why: None, frames, table: Some(NoiseTable::of(&measured.profile)) },
            (Some(why), _) => NoiseFindings { why: Some(why), frames, table: None },
            (None, Err(error)) => NoiseFindings { why: Some(error.to_string()), frames, table: None },
        })
    }
}

fn largest_sigma(profile: &NoiseProfile) -> f64 {
    profile.bins.iter().flatten().map(|bin| bin.sigma).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A grey wall with white noise of 3 codes.
    fn wall(frame: u64) -> Pixels {
        let mut state = 1 + frame;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f64 / f64::from(1u32 << 24)
        };
        // Twelve uniform numbers less 6 have the variance 1.
        let mut code = || (120.0 + 3.0 * ((0..12).map(|_| random()).sum::<f64>() - 6.0)).round() as u8;
        Pixels::from_u8(160, 120, (0..3 * 160 * 120).map(|_| code()).collect()).unwrap()
    }

    fn measured() -> NoiseFindings {
        let mut sampler = NoiseSampler::new(None, 10);
        (0..10).for_each(|frame| sampler.add(frame, &wall(frame as u64)));
        sampler.finish().unwrap()
    }

    #[test]
    fn noise_of_a_wall_is_found_and_read_back() {
        let findings = measured();
        let profile = findings.profile().unwrap();
        assert!((0..3).all(|c| (profile.sigma(c, 120.0) - 3.0).abs() < 0.15), "{findings}");
        let text = toml::to_string(&findings).unwrap();
        assert_eq!(toml::from_str::<NoiseFindings>(&text).unwrap(), findings);
        findings.check().unwrap();
    }

    #[test]
    fn known_noise_is_not_measured_again() {
        let profile = measured().profile();
        let mut sampler = NoiseSampler::new(profile.as_ref(), 10);
        sampler.add(0, &wall(0));
        assert_eq!(sampler.finish(), None);
    }

    #[test]
    fn texture_everywhere_leaves_noise_unknown() {
        let code = |i: usize| ((i / 3 * 7919) % 251) as u8;
        let texture = Pixels::from_u8(160, 120, (0..3 * 160 * 120).map(code).collect()).unwrap();
        let mut sampler = NoiseSampler::new(None, 1);
        sampler.add(0, &texture);
        let findings = sampler.finish().unwrap();
        assert!(findings.table.is_none() && findings.why.is_some(), "{findings}");
    }

    #[test]
    fn frames_are_evenly_spaced() {
        let small = Pixels::from_u8(32, 32, vec![100; 3 * 32 * 32]).unwrap();
        for (count, measured) in [(10, 10), (64, 64), (65, 64), (1000, 64)] {
            let mut sampler = NoiseSampler::new(None, count);
            (0..count).for_each(|frame| sampler.add(frame, &small));
            assert_eq!(sampler.frames, measured, "{count}");
        }
    }

    #[test]
    fn impossible_values_are_refused() {
        let valid = measured();
        let table = || valid.table.clone().unwrap();
        let broken = [
            NoiseTable { code: Vec::new(), sigma: Default::default(), ..table() },
            NoiseTable { code: table().code.into_iter().rev().collect(), ..table() },
            NoiseTable { sigma: [vec![f64::NAN; 16], vec![1.0; 16], vec![1.0; 16]], ..table() },
            NoiseTable { sigma: [vec![1.0; 15], vec![1.0; 16], vec![1.0; 16]], ..table() },
            NoiseTable { neighbour_correlation: [1.5, 0.0], ..table() },
        ];
        for table in broken {
            let findings = NoiseFindings { table: Some(table), ..valid.clone() };
            assert!(findings.check().is_err(), "{:?}", findings.table);
        }
    }
}
