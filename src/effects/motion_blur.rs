//! Motion blur from the poses.
//!
//! - `velocity` (default): the layer is drawn once; each pixel gathers along its motion during the
//!   exposure (a box shutter). Silhouettes dissolve over the camera's pixels, because times without
//!   a surface are empty.
//! - `copies`: Fischer 2006, §Motion blur: semi-transparent copies of each object along the blur
//!   vector of its centre, centred on it, above a threshold. The paper's vector spans a whole frame
//!   interval; here it is scaled by exposure time over interval.
//! - `accumulation`: vSLRcam (13) and (14), the recursive accumulation of frames written as a
//!   finite sum (camera/accumulation.rs): n + 1 frames spread over the exposure time, the newest
//!   with the largest weight. In the paper the newest is at the end of the exposure. Here the
//!   weighted mean of the times is the exposure's middle, at which the camera recorded the object,
//!   and the oldest frame precedes the exposure. The blur trails off instead of being a box, and
//!   the few frames are individually visible.
//! - `reference`: the layer drawn at many times and summed, two for each pixel of blur. Slow; the
//!   ground truth of the other methods.
//!
//! Not modelled by `velocity`: disocclusion, the background of a surface that is hidden at the
//! middle of the exposure and visible at its ends (neighbouring pixels are used), curved motion
//! within one exposure, and surfaces that enter the picture from farther away than half of its
//! diagonal.

use super::{Case, Effect, EffectError, FrameContext, LayerRun, OnReal, Reach};
use crate::camera::accumulation::{self, MAX_STEPS};
use crate::camera::{Camera, Geometry, SummedExposure};
use crate::gpu::Shader;
use crate::params::Value;
use crate::render::{COLOR, GEOMETRY, Layer, RenderSample, SamplePlan};

crate::choices! {
    /// Method of motion blur.
    pub enum MotionBlurMethod { Velocity = "velocity", Copies = "copies", Accumulation = "accumulation", Reference = "reference" }
}

crate::params! {
    /// Parameters of the motion blur.
    pub struct MotionBlur in "motion_blur" at Draw {
        "velocity: smooth blur along each pixel's motion; copies: transparent copies of each object; accumulation: a trail of a few pictures; reference: many samples, accurate and slow"
        method at Depth: MotionBlurMethod = MotionBlurMethod::Velocity;
        "shortest blur that is drawn"
        threshold_px as "Shortest blur": f32 = 0.5, "px", 0.0..=64.0;
        "number of copies of the method copies"
        copies: u32 = 8, "1", 2.0..=64.0 => method is "copies";
        "rate at which the method accumulation draws within the exposure"
        frames_per_s as "Rate" at Depth: f64 = 80.0, "1/s", 1.0..=10000.0, by_ratio => method is "accumulation";
    }
}

crate::uniform! {
    struct TilesUniform { size: [i32; 2], side_px: i32, exposure_s: f32 }
}

crate::uniform! {
    struct MotionBlurUniform {
        size: [i32; 2],
        texel: [f32; 2],
        side_px: i32,
        exposure_s: f32,
        threshold_px: f32,
        longest_px: f32,
    }
}

impl MotionBlur {
    /// The method in use. A shutter slower than the frame interval records more than one motion:
    /// then the reference replaces `velocity`.
    fn effective_method(&self, context: &FrameContext<'_>) -> MotionBlurMethod {
        let slow = context.capture.whole && context.capture.exposure_time_s > context.interval_s;
        if slow && self.method == MotionBlurMethod::Velocity { MotionBlurMethod::Reference } else { self.method }
    }

    /// Longest blur of this frame, px: at most the picture's diagonal. Of a faster surface close to
    /// the camera, only the part of its path within half of that is drawn.
    fn longest_px(context: &FrameContext<'_>) -> f32 {
        let intrinsics = &context.picture.intrinsics;
        let diagonal_px = (intrinsics.width_px as f32).hypot(intrinsics.height_px as f32);
        (context.fastest_px_per_s * context.capture.exposure_time_s as f32).min(diagonal_px)
    }

    /// Largest distance of blurred light from its source, px: half the longest blur, and a margin.
    fn half_px(context: &FrameContext<'_>) -> f32 {
        0.5 * Self::longest_px(context) + 2.0
    }

    /// Copies of each object along the blur vector of its centre (Fischer, §Motion blur).
    fn copy_samples(&self, context: &FrameContext<'_>) -> Vec<RenderSample> {
        let n = self.copies;
        let share = (context.capture.exposure_time_s / context.interval_s) as f32;
        (0..n)
            .map(|i| {
                let along = (i as f32 + 0.5) / n as f32 - 0.5;
                let offsets_px = context
                    .objects
                    .iter()
                    .map(|object| {
                        let v = object.per_frame_px.map(|c| c * share);
                        let drawn = v[0].hypot(v[1]) > self.threshold_px;
                        v.map(|c| if drawn { c * along } else { 0.0 })
                    })
                    .collect();
                RenderSample { offsets_px, ..RenderSample::plain(1.0 / n as f32) }
            })
            .collect()
    }

    /// Times (s from the middle of the exposure) and weights of the accumulated frames by vSLRcam
    /// (13), newest first; at most 10,000. The weighted mean of the times is 0.
    fn accumulated_times(&self, exposure_time_s: f64) -> Vec<(f64, f64)> {
        let n = accumulation::steps(exposure_time_s, self.frames_per_s).unwrap_or(MAX_STEPS);
        let weights = accumulation::weights(n);
        let back = exposure_time_s / n.max(1) as f64;
        let mean: f64 = weights.iter().enumerate().map(|(i, w)| i as f64 * w).sum();
        weights.into_iter().enumerate().map(|(i, w)| ((mean - i as f64) * back, w)).collect()
    }

    /// Times evenly over the exposure, two for each pixel of the longest blur: at least 32 and at
    /// most 4096 (above 2048 px they are farther apart), for a whole picture 1024 (above 512 px:
    /// seconds of a hand-held shutter). For summed frames, the times are within their exposures.
    /// Fewer would be visible: an edge has only four samples per time.
    fn reference(context: &FrameContext<'_>) -> Vec<RenderSample> {
        let max_count = if context.capture.whole { 1024 } else { 4096 };
        let n = ((2.0 * Self::longest_px(context)).ceil() as u32).clamp(32, max_count);
        let frames = &context.capture.summed;
        let each = n.div_ceil(frames.len() as u32);
        let samples_of = |frame: &SummedExposure| {
            let SummedExposure { time_s, exposure_s, weight } = *frame;
            (0..each).map(move |i| RenderSample {
                time_s: time_s + ((f64::from(i) + 0.5) / f64::from(each) - 0.5) * exposure_s,
                ..RenderSample::plain((weight / f64::from(each)) as f32)
            })
        };
        frames.iter().flat_map(samples_of).collect()
    }
}

impl Effect for MotionBlur {
    fn summary(&self) -> &'static str {
        "blurs objects by the camera's motion during the exposure"
    }
    fn check(&self, _: &Camera, geometry: &Geometry) -> Result<(), EffectError> {
        if self.method == MotionBlurMethod::Copies && geometry.needs_cube_map() {
            return Err(EffectError {
                parameter: "motion_blur.method",
                reason: "copies moves objects along a line, and in a picture of 170° and more nothing moves along one: \
                         expected velocity, accumulation or reference",
            });
        }
        Ok(())
    }
    fn neutral_hint(&self) -> &'static str {
        "nothing moves by more than its shortest blur while the shutter is open; a longer exposure of the camera, a frame in \
         which it moves, or a smaller shortest blur enables it"
    }
    fn is_neutral(&self, context: &FrameContext<'_>) -> bool {
        context.capture.exposure_time_s == 0.0 || Self::longest_px(context) <= self.threshold_px
    }
    fn reach(&self, context: &FrameContext<'_>) -> Reach {
        let half_px = Self::half_px(context);
        match self.effective_method(context) {
            // The renderer's rectangle already covers the motion.
            MotionBlurMethod::Velocity => Reach { read_px: half_px, spread_px: 1.0 },
            // Copies are shifted as they are drawn.
            MotionBlurMethod::Copies => Reach { read_px: 0.0, spread_px: half_px },
            MotionBlurMethod::Accumulation | MotionBlurMethod::Reference => Reach { read_px: 0.0, spread_px: 1.0 },
        }
    }
    fn beyond_s(&self, exposure_time_s: f64) -> f64 {
        if self.method != MotionBlurMethod::Accumulation {
            return 0.0;
        }
        let oldest_s = self.accumulated_times(exposure_time_s).last().map_or(0.0, |(time_s, _)| -time_s);
        (oldest_s - 0.5 * exposure_time_s).max(0.0)
    }
    fn reads_next_pose(&self) -> bool {
        self.method == MotionBlurMethod::Copies
    }
    fn cases(&self) -> Vec<Case> {
        ["velocity", "copies", "accumulation", "reference"]
            .map(|m| (m, vec![("method", Value::Text(m.to_owned()))]))
            .to_vec()
    }

    fn on_real(&self) -> OnReal {
        OnReal::BlursVirtual
    }

    fn plan(&self, context: &FrameContext<'_>, plan: SamplePlan) -> SamplePlan {
        match self.effective_method(context) {
            MotionBlurMethod::Velocity => plan,
            MotionBlurMethod::Copies => SamplePlan { samples: self.copy_samples(context), ..plan },
            MotionBlurMethod::Accumulation => {
                let times = self.accumulated_times(context.capture.exposure_time_s).into_iter();
                let samples =
                    times.map(|(time_s, w)| RenderSample { time_s, ..RenderSample::plain(w as f32) }).collect();
                SamplePlan { samples, ..plan }
            }
            MotionBlurMethod::Reference => SamplePlan { samples: Self::reference(context), ..plan },
        }
    }

    fn reads_geometry(&self) -> bool {
        true
    }

    fn run(&self, run: &mut LayerRun<'_>, layer: Layer) -> Layer {
        let context = run.context;
        if self.effective_method(context) != MotionBlurMethod::Velocity {
            return layer;
        }
        let (width, height) = layer.size;
        // 3×3 tiles must reach half the longest blur.
        let side = ((0.5 * Self::longest_px(context)).ceil() as u32 + 1).clamp(8, 1 << 14);
        let tiles = (width.div_ceil(side), height.div_ceil(side));
        let (size, side_px) = ([width as i32, height as i32], side as i32);
        let exposure_s = context.capture.exposure_time_s as f32;

        let uniform = TilesUniform { size, side_px, exposure_s };
        let recorder = &mut *run.recorder;
        let pass = recorder.pass(Shader::MotionBlurTiles, "over_pixels").uniform("tiles", &uniform);
        let [fastest, range] = pass.texture("geometry", &layer.geometry).draw([COLOR; 2], tiles);
        let pass = recorder.pass(Shader::MotionBlurTiles, "over_tiles").uniform("tiles", &uniform);
        let [near] = pass.texture("first", &fastest).texture("second", &range).draw([COLOR], tiles);

        let texel = [layer.color.width, layer.color.height].map(|side| 1.0 / side as f32);
        let (threshold_px, longest_px) = (self.threshold_px, Self::longest_px(context));
        let blur = MotionBlurUniform { size, texel, side_px, exposure_s, threshold_px, longest_px };
        let mut pass = |entry, format| {
            let pass = recorder.pass(Shader::MotionBlur, entry).uniform("blur", &blur).texture("fastest", &near);
            let [out] =
                pass.texture("geometry", &layer.geometry).texture("color", &layer.color).draw([format], layer.size);
            out
        };
        let color = pass("blurred", COLOR);
        if !run.geometry_is_read {
            return Layer { color, ..layer };
        }
        let geometry = pass("passing", GEOMETRY);
        Layer { color, geometry, ..layer }
    }
}

/// Reference of a uniform motion: the mean of the layer over the shutter, shifted for each time by
/// its part of `motion_px` and sampled bilinearly. `rgba` has `width * height` premultiplied
/// pixels; outside is empty.
pub fn twin(rgba: &[[f64; 4]], width: usize, height: usize, motion_px: [f64; 2]) -> Vec<[f64; 4]> {
    let at = |x: i64, y: i64| {
        if x < 0 || y < 0 || x >= width as i64 || y >= height as i64 {
            [0.0; 4]
        } else {
            rgba[y as usize * width + x as usize]
        }
    };
    let times = 64 * (motion_px[0].hypot(motion_px[1]).ceil() as usize).max(1);
    let mut out = vec![[0.0; 4]; rgba.len()];
    for (i, pixel) in out.iter_mut().enumerate() {
        let (x, y) = ((i % width) as f64, (i / width) as f64);
        for m in 0..times {
            let s = (m as f64 + 0.5) / times as f64 - 0.5;
            let (u, v) = (x - motion_px[0] * s, y - motion_px[1] * s);
            let (u0, v0) = (u.floor(), v.floor());
            for (du, dv) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let w = (1.0 - (u - u0 - f64::from(du)).abs()) * (1.0 - (v - v0 - f64::from(dv)).abs());
                let texel = at(u0 as i64 + i64::from(du), v0 as i64 + i64::from(dv));
                (0..4).for_each(|c| pixel[c] += w * texel[c] / times as f64);
            }
        }
    }
    out
}
