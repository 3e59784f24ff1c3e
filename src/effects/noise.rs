//! Calibrated camera noise over virtual pixels: Fischer 2006, §Noise.
//!
//! σ depends on channel and intensity (camera/noise.rs). The pattern is a counter-based hash of
//! (seed, frame, pixel, channel), so that frames are independent. A mixed pixel already has the
//! noise of its camera part; only the missing variance is added. `scale` multiplies σ of the
//! virtual share of a pixel. A real pixel in a virtual shadow regains the noise that the shadow
//! removed, at any scale but 0.
//!
//! Pattern: white normal noise, filtered by (a, 1, a) along each axis to the measured neighbour
//! correlation ρ = 2a/(1 + 2a²), keeping its variance; channels are mixed by the Cholesky factor of
//! their correlation. `magnification` enlarges patches further by interpolation, and restores the
//! variance that interpolation removes.
//!
//! `iso` and `film_width_mm` put the picture on another film (camera/grain.rs): σ and patches grow
//! with the speed relative to the profile's own (`camera.exposure.iso`), patches also with a
//! smaller format and a larger picture. At the profile's own speed and format it is the calibrated
//! noise, bit for bit. Patches finer than calibrated are not drawn: slower film has less noise, not
//! finer.
//!
//! A frame recorded at another speed than the profile's (by its EXIF ISO, or the gain that the
//! recording lists) has that speed's variance, in virtual and real pixels alike. Patches stay,
//! since this is a sensor's noise and not film's.
//!
//! Not modelled: correlation in time of the pattern other than `animation_delay`, fixed-pattern
//! noise, row and column noise, correlation beyond two pixels, covariance of mixed neighbours.

mod pattern;

pub use pattern::pattern_key;
use pattern::{NORMAL_TABLE, Pattern, TABLE_UNIT, pcg3d};

use super::{Case, Effect, EffectError, ExampleNoise, FrameContext, LayerRun, MixedPart};
use crate::camera::grain::{GrainRatios, read_light};
use crate::camera::{Camera, Geometry, side_tap};
use crate::coding::PictureCoding;
use crate::example_noise::NoiseModelFile;
use crate::example_noise::model_coding::CodingDifference;
use crate::example_noise::persistence::FrameKeys;
use crate::fit::cholesky::correlation_factor;
use crate::gpu::Shader;
use crate::memo::ByAddress;
use crate::params::Value;
use crate::pixels::Rect;

crate::choices! {
    /// Method of the noise.
    pub enum NoiseMethod { Example = "example", Parametric = "parametric", Pattern = "pattern", White = "white" }
}

impl NoiseMethod {
    /// Those that draw by a model of the camera's noise.
    pub const BY_MODEL: [Self; 2] = [Self::Example, Self::Parametric];
}

crate::params! {
    /// Parameters of the noise.
    pub struct Noise in "noise" at Mix {
        "example: the camera's own residuals; parametric: normal noise of their amplitudes; pattern: by the table; white: uncorrelated"
        method: NoiseMethod = NoiseMethod::Example => scale isnt "0";
        "factor on the calibrated standard deviation of virtual pixels; 0 is off"
        scale as "Amount": f32 = 1.0, "1", 0.0..=8.0;
        "size of a patch of noise; 1 is as measured"
        magnification as "Grain size": f32 = 1.0, "px", 1.0..=16.0 => scale isnt "0";
        "number of frames for which a pattern stays"
        animation_delay as "Change every": u32 = 1, "frames", 1.0..=1000.0, by_ratio => scale isnt "0";
        "film speed of the grain; needs camera.exposure.iso, at which the noise was measured; none: as recorded"
        iso as "ISO": Option<f64> = None, "1", 100.0..=25600.0, by_ratio => scale isnt "0";
        "film width for the grain's size; none: the camera's"
        film_width_mm: Option<f64> = None, "mm", 0.1..=1000.0, by_ratio => scale isnt "0";
    }
}

impl Noise {
    fn is_grain(&self) -> bool {
        self.iso.is_some() || self.film_width_mm.is_some()
    }

    /// Ratios of film and picture to the calibrated ones.
    pub fn ratios(&self, context: &FrameContext<'_>) -> GrainRatios {
        let capture = context.capture;
        if capture.film.is_none() && !self.is_grain() {
            return GrainRatios::default();
        }
        let over = |new: Option<f64>, old: Option<f64>| new.zip(old).map_or(1.0, |(new, old)| new / old);
        let calibrated = &capture.recorded.intrinsics;
        let film_width_mm = capture.film.map(|film| film.width_mm).or(self.film_width_mm);
        GrainRatios {
            iso: capture.film.map_or_else(|| over(self.iso, context.camera.exposure.iso), |film| film.speed),
            film_width: over(film_width_mm, Some(calibrated.film_width_mm)),
            picture_width: f64::from(context.picture.intrinsics.width_px) / f64::from(calibrated.width_px),
        }
    }

    /// Relative speed of the recorded frame, if no other film is set. Unlike film grain, a sensor's
    /// noise does not get coarser with speed: patches stay.
    fn recorded_speed(&self, context: &FrameContext<'_>) -> f64 {
        if self.iso.is_some() && context.capture.film.is_none() { 1.0 } else { context.recorded_speed() }
    }

    /// Whether patches and film are the calibrated ones.
    fn is_as_calibrated(&self, context: &FrameContext<'_>) -> bool {
        self.magnification <= 1.0 && !self.is_grain() && context.capture.film.is_none()
    }

    /// Size of the patches, px.
    fn patch_px(&self, ratios: &GrainRatios) -> f32 {
        (self.magnification * ratios.size() as f32).max(1.0)
    }
}

crate::uniform! {
    struct NoiseUniform {
        neighbours: [f32; 2],
        origin: [i32; 2],
        read: [f32; 4],
        patch_px: f32,
        in_patch: f32,
        scale: f32,
        speed: f32,
        recorded: f32,
        recorded_speed: f32,
    }
}

impl Noise {
    /// The lattice points needed for the pixels of a rectangle.
    fn lattice(m: f32, shown: Rect) -> Rect {
        if m <= 1.0 {
            // A margin of 1, which a patch of one pixel reads with weight 0.
            return Rect { x1: shown.x1 + 1, y1: shown.y1 + 1, ..shown };
        }
        let first = |pixel: i32| ((pixel as f32 + 0.5) / m).floor() as i32;
        // Both neighbours, and a margin of 1 for rounding.
        let (x, y) = ([shown.x0, shown.x1].map(first), [shown.y0, shown.y1].map(first));
        Rect::new(x[0] - 1, y[0] - 1, x[1] + 3, y[1] + 3)
    }
}

impl Effect for Noise {
    fn summary(&self) -> &'static str {
        "gives virtual pixels the camera's noise"
    }
    fn check(&self, camera: &Camera, _: &Geometry) -> Result<(), EffectError> {
        if self.iso.is_some() && camera.noise.is_some() && camera.exposure.iso.is_none() {
            let reason = "the film speed at which the noise was measured is not known: expected none, or any of 100 \
                          to 25600 with camera.exposure.iso given";
            return Err(EffectError { parameter: "noise.iso", reason });
        }
        Ok(())
    }
    fn neutral_hint(&self) -> &'static str {
        "its amount is 0, or the camera's noise is unknown; a larger amount, a profile with the camera's noise, or measuring \
         it (the tab Calibrate) enables it"
    }
    fn is_neutral(&self, context: &FrameContext<'_>) -> bool {
        self.scale == 0.0 || context.camera.noise.is_none()
    }
    fn cases(&self) -> Vec<Case> {
        vec![
            ("", Vec::new()),
            ("white", vec![("method", Value::Text("white".to_owned()))]),
            ("magnified", vec![("magnification", Value::Number(2.0))]),
            ("grain", vec![("iso", Value::Number(1600.0))]),
        ]
    }
    fn ineffective_setting(&self, camera: &Camera) -> Option<&'static str> {
        if self.iso.is_some() && camera.noise.is_none() {
            return Some(
                "noise.iso does nothing: the camera's profile has no table [camera.noise], so no noise is drawn at any speed",
            );
        }
        let lacks_model = camera.noise.as_ref().is_some_and(|noise| noise.example.is_none());
        (self.method == NoiseMethod::Parametric && lacks_model).then_some(
            "noise.method = \"parametric\" draws the pattern: the camera has no noise by example, which gives its amplitudes; \
             `locard calibrate noise` or `locard analyse` makes it",
        )
    }

    fn example_noise(
        &self,
        context: &FrameContext<'_>,
        coding: Option<&PictureCoding>,
    ) -> Result<Option<ExampleNoise>, CodingDifference> {
        let example = context.camera.noise.as_ref().and_then(|noise| noise.example.as_ref());
        let is_drawn =
            NoiseMethod::BY_MODEL.contains(&self.method) && self.is_as_calibrated(context) && !context.capture.whole;
        let Some(NoiseModelFile { model, .. }) = example.filter(|_| is_drawn) else { return Ok(None) };
        if context.max_code != 255 {
            return Err(CodingDifference::Depth);
        }
        match model.numbers.coding.difference(coding.unwrap_or(&PictureCoding::UNROUNDED)) {
            Some(difference) => Err(difference),
            None => {
                let key_before =
                    |frames: usize| pattern_key(context.seed, context.frame - frames, self.animation_delay);
                let keys = FrameKeys::new(
                    model.numbers.frame_correlation,
                    context.resting_frames.min(context.frame),
                    key_before,
                );
                let model = match self.method {
                    NoiseMethod::Parametric => ByAddress(model.parametric()),
                    _ => model.clone(),
                };
                Ok(Some(ExampleNoise { model, keys }))
            }
        }
    }

    fn mix(&self, run: &mut LayerRun<'_>, shown: Rect) -> Option<MixedPart> {
        let context = run.context;
        let ratios = self.ratios(context);
        let recorded = self.recorded_speed(context);
        let patch_px = self.patch_px(&ratios);
        let lattice = Self::lattice(patch_px, shown);
        let Camera { noise, response, .. } = context.camera;
        let correlated = noise.as_ref().filter(|_| self.method != NoiseMethod::White);
        let pattern = Pattern::new(correlated, context.seed, context.frame, self.animation_delay);
        let neighbours = pattern.achieved_correlation();
        let read = |c| noise.as_ref().map_or(0.0, |noise| read_light(noise, response, c) as f32);
        let uniform = NoiseUniform {
            neighbours,
            origin: [lattice.x0, lattice.y0],
            read: [read(0), read(1), read(2), 0.0],
            patch_px,
            in_patch: if patch_px <= 1.0 { 0.5 } else { 0.0 },
            scale: self.scale,
            // A photograph's film has its own ratio.
            speed: (ratios.iso * if context.capture.film.is_some() { 1.0 } else { recorded }) as f32,
            recorded: if recorded == 1.0 { 0.0 } else { 1.0 },
            recorded_speed: recorded as f32,
        };
        if let Ok(Some(_)) = self.example_noise(context, run.coding) {
            return Some(MixedPart::new(Shader::ExampleNoise, "noise", &uniform));
        }
        let pattern = pattern.texture(run.recorder, lattice);
        let is_calibrated_speed = self.is_as_calibrated(context) && recorded == 1.0;
        let shader = if is_calibrated_speed { Shader::Noise } else { Shader::NoiseGrain };
        Some(MixedPart::new(shader, "noise", &uniform).texture("noise_pattern", pattern))
    }
}

/// Reference of the pattern (R, G, B; mean 0, variance 1) at a pixel of the picture, by the
/// formulas above in double precision.
pub fn twin_pattern(params: &Noise, context: &FrameContext<'_>, x: i32, y: i32) -> [f64; 3] {
    let (rho, channels) = context
        .camera
        .noise
        .as_ref()
        .map_or(([0.0; 2], [0.0; 3]), |n| (n.neighbour_correlation, n.channel_correlation));
    let key = pattern_key(context.seed, context.frame, params.animation_delay);
    let white = |x: i32, y: i32| {
        let h = pcg3d([(x as u32).wrapping_add(key[0]), (y as u32).wrapping_add(key[1]), key[2]]);
        h.map(|w| f64::from(NORMAL_TABLE[(w >> 20) as usize]) * TABLE_UNIT)
    };
    let taps = rho.map(side_tap);
    let kernel = |a: f64| {
        let norm = (1.0 + 2.0 * a * a).sqrt();
        [a / norm, 1.0 / norm, a / norm]
    };
    let (kx, ky) = (kernel(taps[0]), kernel(taps[1]));
    let filtered = |x: i32, y: i32| {
        let mut sum = [0.0; 3];
        for (j, wy) in ky.iter().enumerate() {
            for (i, wx) in kx.iter().enumerate() {
                let w = white(x + i as i32 - 1, y + j as i32 - 1);
                (0..3).for_each(|c| sum[c] += wx * wy * w[c]);
            }
        }
        sum
    };
    let m = f64::from(params.patch_px(&params.ratios(context)));
    let independent = if m <= 1.0 {
        filtered(x, y)
    } else {
        let (u, v) = ((f64::from(x) + 0.5) / m, (f64::from(y) + 0.5) / m);
        let (fu, fv) = (u - u.floor(), v - v.floor());
        let mut sum = [0.0; 3];
        let mut variance = 0.0;
        let corners = [(0, 0), (1, 0), (0, 1), (1, 1)];
        let weight = |(i, j): (i32, i32)| (if i == 1 { fu } else { 1.0 - fu }) * (if j == 1 { fv } else { 1.0 - fv });
        let lag = taps.map(|a| 2.0 * a / (1.0 + 2.0 * a * a));
        for a in corners {
            let value = filtered(u.floor() as i32 + a.0, v.floor() as i32 + a.1);
            (0..3).for_each(|c| sum[c] += weight(a) * value[c]);
            for b in corners {
                let rx = if a.0 == b.0 { 1.0 } else { lag[0] };
                let ry = if a.1 == b.1 { 1.0 } else { lag[1] };
                variance += weight(a) * weight(b) * rx * ry;
            }
        }
        sum.map(|s| s / variance.sqrt())
    };
    let l = correlation_factor(channels);
    let [r, g, b] = independent;
    [r, l[0] * r + l[1] * g, l[2] * r + l[3] * g + l[4] * b]
}

/// Reference of a mixed pixel's code value (8-bit scale) with noise: σ at its own value, minus the
/// variance of its camera part.
pub fn twin(code: f64, sigma: f64, scale: f64, camera_variance: f64, pattern: f64) -> f64 {
    code + ((scale * sigma).powi(2) - camera_variance).max(0.0).sqrt() * pattern
}
