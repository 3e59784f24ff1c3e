//! Noise calibration (Fischer 2006): from frames of static scenes, σ of the variations by channel
//! and intensity.
//!
//! a_i = mean picture of scene i, v_ij = f_ij − a_i, binned by a_i (never by f_ij: that would put
//! bright noise into bright bins). μ and σ are maximum-likelihood estimates for a normal
//! distribution. They are corrected for the small number of frames, integer codes and clipping, and
//! exclude moving content. docs/calibration.md derives each.
//!
//! Not modelled: noise correlated over time, fixed patterns (they belong to the mean), noise that
//! is not normally distributed, correlation beyond that of the nearest neighbours.

use super::bins::{BinReport, BinRules, Pool};
use super::blocks::judge;
use super::example::ExampleSampler;
use super::rounding::{CODES16_PER_CODE8, Rounding};
use super::scene_sums::{MAX_FRAMES, MAX_PIXELS, SceneSums};
use super::unsteady::{Unsteady, unsteady};
use super::warning::Warning;
use crate::camera::{NoiseBin, NoiseProfile};
use crate::pixels::Pixels;
use crate::source::SourceError;
use crate::text::count;
use std::path::PathBuf;

/// Options of a noise calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseOptions {
    /// Intensity bins over the code range, 1 to 256.
    pub bins: usize,
    /// Bins with fewer independent samples are filled from their neighbours.
    pub min_independent: f64,
    /// Leaves out blocks that move or drift, and refuses scenes in which everything does.
    pub leave_out_motion: bool,
    /// Calibrates noise by example too.
    pub with_example: bool,
}

impl Default for NoiseOptions {
    fn default() -> Self {
        Self { bins: 16, min_independent: 1000.0, leave_out_motion: true, with_example: false }
    }
}

/// How the frames were taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SceneMotion {
    /// Scenes at rest: noise is the variation from frame to frame.
    Resting,
    /// A moving camera: noise is the deviation from a plane in textureless areas.
    Moving,
}

/// The result of a calibration; prints as a table.
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseCalibration {
    pub profile: NoiseProfile,
    /// Bins of R, G, B, ascending.
    pub bins: [Vec<BinReport>; 3],
    pub motion: SceneMotion,
    /// 1 for a moving camera.
    pub scenes: usize,
    pub frames: usize,
    /// Share left out, 0 to 1. At rest: of pixels, because they moved or drifted. With a moving
    /// camera: of blocks, because of texture, clipping or too little noise.
    pub excluded_share: f64,
    /// Remarks on the reliability of the table.
    pub warnings: Vec<Warning>,
}

/// Reason why a calibration failed.
#[derive(Debug, thiserror::Error)]
pub enum CalibrateError {
    #[error("no frames were given; give two or more frames of a static scene, or one frame and its mean")]
    NoFrames,
    #[error(
        "scene {scene} has one frame; noise shows in the difference of frames: give two or more (ten are good), the scene's known mean (--mean IMAGE), or --moving, which takes it from textureless places"
    )]
    OneFrame { scene: usize },
    #[error("scene {scene} has more than {MAX_FRAMES} frames; leave some out")]
    TooManyFrames { scene: usize },
    #[error(
        "a frame is {actual} pixels where {expected} are expected; all frames of a scene and its mean must have one size"
    )]
    Size { expected: String, actual: String },
    #[error("a picture has {actual} bits a channel where the frames before have {expected}; give frames of one depth")]
    Depth { expected: u32, actual: u32 },
    #[error("a picture without pixels")]
    Empty,
    #[error(
        "a picture is {actual}; its sums would not fit into memory: expected up to {MAX_PIXELS} pixels; cut the same \
         part out of all pictures of the scene"
    )]
    TooLarge { actual: String },
    #[error("stopped before it was done")]
    Stopped,
    #[error("bins = {actual}: expected 1 to 256")]
    Bins { actual: usize },
    #[error("either all scenes have a known mean or none has")]
    MeansMixed,
    #[error(
        "{} for {} of frames; give one mean for all, or one for each, in the same order",
        count(*means, "mean"),
        count(*entries, "argument")
    )]
    MeansCount { means: usize, entries: usize },
    #[error(
        "channel {channel} has no bin with {needed} independent samples (the fullest has {best:.0}); give more frames, larger pictures or more scenes"
    )]
    TooFew { channel: &'static str, needed: f64, best: f64 },
    #[error(
        "channel {channel}: texture is almost everywhere in {} (the fullest intensity has {best:.0} independent \
         samples in uniform areas; {needed} are needed); give pictures with uniform, evenly lit areas (a wall, the sky, \
         something out of focus) and leave the others out: fewer pictures may give a better result. Scenes at rest \
         need no uniform areas",
        count(*frames, "picture")
    )]
    Textured { channel: &'static str, needed: f64, best: f64, frames: usize },
    #[error(
        "scene {scene} is not at rest: the whole picture moves from frame to frame (one common motion explains \
         {percent:.0} % of the change; it would explain none of pure noise); put the camera on a tripod and give \
         frames in which nothing moves, or give --moving, which takes the noise from textureless places"
    )]
    CameraMoves { scene: usize, percent: f64 },
    #[error(
        "scene {scene} is not at rest: half of the picture or more changes in whole patches ({percent:.0} % of the \
         change; less than 25 % if it were noise); give frames from one place, in one light, in which nothing moves, \
         and each scene as a folder of its own, or --moving, which takes the noise from textureless places"
    )]
    SceneChanges { scene: usize, percent: f64 },
    #[error(
        "scene {scene}: the frames differ from the given mean by more than noise ({percent:.0} % of the difference is \
         a common motion or whole patches); the mean is probably of another scene, place or light, unless something \
         moves in the frames: give the mean of this scene, or omit --mean and give ten frames"
    )]
    WrongMean { scene: usize, percent: f64 },
    #[error(
        "no scene at rest was found ({needed} or more consecutive frames without motion); hold the camera still for two \
         seconds, or give --moving, which takes the noise from textureless places"
    )]
    NeverAtRest { needed: usize },
    #[error("{path}: {reason}")]
    Read { path: PathBuf, reason: String },
    #[error(transparent)]
    Picture(#[from] SourceError),
    #[error("{path}: {source}")]
    InFile { path: PathBuf, source: Box<CalibrateError> },
}

impl CalibrateError {
    /// True if the frames contain no scene at rest. Their textureless places may still be usable.
    pub fn lacks_scene_at_rest(&self) -> bool {
        match self {
            Self::OneFrame { .. }
            | Self::CameraMoves { .. }
            | Self::SceneChanges { .. }
            | Self::Size { .. }
            | Self::NeverAtRest { .. } => true,
            Self::InFile { source, .. } => source.lacks_scene_at_rest(),
            _ => false,
        }
    }
}

pub(super) const CHANNELS: [&str; 3] = ["R", "G", "B"];

/// A calibration in progress: scenes one after another, frame by frame. Memory: the sums of one
/// picture, and a little (0.2 MB) for each finished scene.
#[derive(Debug)]
pub struct NoiseCalibrator {
    options: NoiseOptions,
    pools: Vec<Pool>,
    scene: Option<SceneSums>,
    mean: Option<Pixels>,
    frame_bits: Option<u32>,
    mean_bits: Option<Option<u32>>,
    scenes: usize,
    frames: usize,
    pixels: u64,
    moving: u64,
    drifting: u64,
    warnings: Vec<Warning>,
    /// Samples frames for noise by example, if it is enabled.
    sampler: Option<ExampleSampler>,
}

fn bits(pixels: &Pixels) -> u32 {
    if pixels.max_code() == 255 { 8 } else { 16 }
}

fn code_step(bits: u32) -> f64 {
    if bits == 8 { 1.0 } else { 1.0 / CODES16_PER_CODE8 as f64 }
}

impl NoiseCalibrator {
    pub fn new(options: NoiseOptions) -> Result<Self, CalibrateError> {
        if options.bins == 0 || options.bins > 256 {
            return Err(CalibrateError::Bins { actual: options.bins });
        }
        Ok(Self {
            options,
            pools: Vec::new(),
            scene: None,
            mean: None,
            frame_bits: None,
            mean_bits: None,
            scenes: 0,
            frames: 0,
            pixels: 0,
            moving: 0,
            drifting: 0,
            warnings: Vec::new(),
            sampler: None,
        })
    }

    /// Sets the sampler of frames for noise by example.
    pub(super) fn sample_examples(&mut self, sampler: Option<ExampleSampler>) {
        self.sampler = sampler;
    }

    /// Number of frames of the next scene, for [`Self::sample_examples`].
    pub(super) fn expect_frames(&mut self, frames: usize) {
        if let Some(sampler) = &mut self.sampler {
            sampler.begin_scene(frames);
        }
    }

    /// The frames for noise by example, after the last scene.
    pub(super) fn take_sampler(&mut self) -> Option<ExampleSampler> {
        self.sampler.take()
    }

    /// Starts a scene, which the following frames show. `mean` is its noise-free picture, if known.
    pub fn begin_scene(&mut self, mean: Option<Pixels>) -> Result<(), CalibrateError> {
        self.end_scene()?;
        let mean_bits = mean.as_ref().map(bits);
        if *self.mean_bits.get_or_insert(mean_bits) != mean_bits {
            return Err(CalibrateError::MeansMixed);
        }
        self.mean = mean;
        self.scenes += 1;
        Ok(())
    }

    /// Adds a frame of the scene.
    pub fn add_frame(&mut self, frame: &Pixels) -> Result<(), CalibrateError> {
        if frame.width == 0 || frame.height == 0 {
            return Err(CalibrateError::Empty);
        }
        if self.scenes == 0 {
            self.begin_scene(None)?;
        }
        let (actual, expected) = (bits(frame), *self.frame_bits.get_or_insert(bits(frame)));
        if actual != expected {
            return Err(CalibrateError::Depth { expected, actual });
        }
        let size = |w: usize, h: usize| format!("{w}x{h}");
        let size_px = (frame.width as usize, frame.height as usize);
        let expected = match (&self.scene, &self.mean) {
            (Some(scene), _) => (scene.width, scene.height),
            (None, Some(mean)) => (mean.width as usize, mean.height as usize),
            (None, None) => size_px,
        };
        if size_px != expected {
            return Err(CalibrateError::Size {
                expected: size(expected.0, expected.1),
                actual: size(size_px.0, size_px.1),
            });
        }
        if size_px.0 * size_px.1 > MAX_PIXELS {
            return Err(CalibrateError::TooLarge { actual: size(size_px.0, size_px.1) });
        }
        let scene = self.scene.get_or_insert_with(|| SceneSums::new(frame, self.mean.as_ref()));
        if scene.frames >= MAX_FRAMES {
            return Err(CalibrateError::TooManyFrames { scene: self.scenes });
        }
        scene.add(frame);
        if let Some(sampler) = &mut self.sampler {
            sampler.add_frame(frame);
        }
        self.frames += 1;
        Ok(())
    }

    fn rounding(&self) -> Rounding {
        let frame_step = code_step(self.frame_bits.unwrap_or(8));
        Rounding { frame_step, mean_step: self.mean_bits.flatten().map(code_step) }
    }

    /// Judges and sums up the scene. The next may begin.
    pub fn end_scene(&mut self) -> Result<(), CalibrateError> {
        let number = self.scenes;
        let Some(scene) = self.scene.take() else {
            return if self.pools.len() == number { Ok(()) } else { Err(CalibrateError::NoFrames) };
        };
        if scene.frames < 2 && !scene.known_mean {
            return Err(CalibrateError::OneFrame { scene: number });
        }
        match unsteady(&scene).filter(|_| self.options.leave_out_motion) {
            Some(Unsteady::Moves(share) | Unsteady::Patches(share)) if scene.known_mean => {
                return Err(CalibrateError::WrongMean { scene: number, percent: 100.0 * share });
            }
            Some(Unsteady::Moves(share)) => {
                return Err(CalibrateError::CameraMoves { scene: number, percent: 100.0 * share });
            }
            Some(Unsteady::Patches(share)) => {
                return Err(CalibrateError::SceneChanges { scene: number, percent: 100.0 * share });
            }
            Some(Unsteady::Doubtful(share)) => {
                let known_mean = scene.known_mean;
                self.warnings.push(Warning::Unsteady { scene: number, percent: 100.0 * share, known_mean });
            }
            None => {}
        }
        let rounding = self.rounding();
        let mut verdict = judge(&scene, rounding.frame_step);
        if !self.options.leave_out_motion {
            verdict.still.fill(true);
            (verdict.moving_pixels, verdict.drifting_pixels) = (0, 0);
        }
        let all = (scene.width * scene.height) as u64;
        self.pixels += all;
        self.moving += verdict.moving_pixels;
        self.drifting += verdict.drifting_pixels;
        let out = (verdict.moving_pixels + verdict.drifting_pixels) as f64 / all as f64;
        if out > 0.25 {
            self.warnings.push(Warning::Moving { scene: number, percent: 100.0 * out });
        }
        if verdict.median_drift > 0.05 {
            self.warnings.push(Warning::Filtered { scene: number, percent: 100.0 * verdict.median_drift });
        }
        let flicker = scene.flicker();
        if flicker > 0.1 {
            self.warnings.push(Warning::Flicker { scene: number, codes: flicker });
        }
        if let Some(sampler) = &mut self.sampler {
            sampler.end_scene(&scene, &verdict);
        }
        self.pools.push(Pool::new(&scene, &verdict.still, &verdict.scales, &rounding));
        Ok(())
    }

    /// The profile and its table.
    pub fn finish(mut self) -> Result<NoiseCalibration, CalibrateError> {
        if self.scenes == 0 {
            return Err(CalibrateError::NoFrames);
        }
        self.end_scene()?;
        let rounding = self.rounding();
        let mut warnings = std::mem::take(&mut self.warnings);
        let mut reported = |value, name, low| reported_correlation(value, name, low, &mut warnings);
        let [rg, rb, gb] = Pool::channel_correlation(&self.pools);
        let channel_correlation = [reported(rg, "R-G", -1.0), reported(rb, "R-B", -1.0), reported(gb, "G-B", -1.0)];
        let [right, below] = Pool::neighbour_correlation(&self.pools);
        let neighbour_correlation = [reported(right, "to the right", 0.0), reported(below, "below", 0.0)];
        let needed = self.options.min_independent;
        let independent_share = independent_share(neighbour_correlation);
        let rules = BinRules { bins: self.options.bins, rounding, needed, independent_share };
        let bins = [0, 1, 2].map(|c| Pool::bins(&self.pools, c, &rules));
        for (channel, bins) in CHANNELS.into_iter().zip(&bins) {
            check_bins(channel, bins, needed, &mut warnings)?;
        }
        let profile = NoiseProfile {
            example: None,
            bins: [0, 1, 2]
                .map(|c| bins[c].iter().map(|b| NoiseBin { code: b.code, sigma: round4(b.sigma) }).collect::<Vec<_>>()),
            channel_correlation,
            neighbour_correlation,
        };
        let excluded_share = (self.moving + self.drifting) as f64 / self.pixels.max(1) as f64;
        let (motion, scenes, frames) = (SceneMotion::Resting, self.scenes, self.frames);
        Ok(NoiseCalibration { profile, bins, motion, scenes, frames, excluded_share, warnings })
    }
}

/// Warns of filled and biased bins. Fails if none is good.
pub(super) fn check_bins(
    channel: &'static str,
    bins: &[BinReport],
    needed: f64,
    warnings: &mut Vec<Warning>,
) -> Result<(), CalibrateError> {
    let filled = bins.iter().filter(|b| b.filled_from_neighbours).count();
    if filled == bins.len() {
        let best = bins.iter().map(|b| b.independent_count).fold(0.0, f64::max);
        return Err(CalibrateError::TooFew { channel, needed, best });
    }
    if filled > 0 {
        warnings.push(Warning::Filled { channel, needed, filled, bins: bins.len() });
    }
    if let Some(bin) = bins.iter().find(|b| !b.filled_from_neighbours && b.mu.abs() > 0.5 && b.mu.abs() > 0.2 * b.sigma)
    {
        warnings.push(Warning::OffMean { channel, code: bin.code, off: bin.mu });
    }
    Ok(())
}

/// A correlation as written to the profile: 0 if it could not be measured, and at least `low`.
/// Either case adds a warning.
pub(crate) fn reported_correlation(
    measured: Option<f64>,
    of: &'static str,
    low: f64,
    warnings: &mut Vec<Warning>,
) -> f64 {
    let value = measured.unwrap_or(0.0);
    if measured.is_none() {
        warnings.push(Warning::NoCorrelation(of));
    } else if value < low - 0.02 {
        warnings.push(Warning::LowCorrelation { of, measured: value, written: low });
    }
    round4(value.clamp(low, 1.0))
}

pub(super) fn round4(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}

/// The weight of one sample's square among correlated neighbours: 1/Σρ², if ρ falls by the same
/// factor with each pixel in a row and in a column (so that Σρ² = (1+r²)/(1−r²) for each
/// direction).
fn independent_share(neighbour_correlation: [f64; 2]) -> f64 {
    neighbour_correlation.iter().map(|r| r.min(0.99)).map(|r| (1.0 - r * r) / (1.0 + r * r)).product()
}

/// Calibrates from scenes in memory, each with several frames of something static.
pub fn from_scenes(scenes: &[Vec<Pixels>], options: &NoiseOptions) -> Result<NoiseCalibration, CalibrateError> {
    let mut calibrator = NoiseCalibrator::new(options.clone())?;
    for scene in scenes {
        calibrator.begin_scene(None)?;
        for frame in scene {
            calibrator.add_frame(frame)?;
        }
    }
    calibrator.finish()
}

/// Calibrates from scenes whose noise-free mean is known, each with one or more noisy frames.
pub fn from_known_means(
    scenes: &[(Pixels, Vec<Pixels>)],
    options: &NoiseOptions,
) -> Result<NoiseCalibration, CalibrateError> {
    let mut calibrator = NoiseCalibrator::new(options.clone())?;
    for (mean, frames) in scenes {
        calibrator.begin_scene(Some(mean.clone()))?;
        for frame in frames {
            calibrator.add_frame(frame)?;
        }
    }
    calibrator.finish()
}
