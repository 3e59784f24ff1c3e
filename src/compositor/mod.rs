//! The per-frame loop: a pure function of a frame, the poses around it, the scene and the
//! settings.

mod behind_real;
pub mod bench;
mod mix;
mod places;
mod real;
mod run;
mod settings;

use crate::camera::{Camera, Framed, Geometry, Intrinsics, LensError, Opening, Response};
use crate::depth::{RayCache, Surfaces, enlarged, measured_from};
use crate::effects::{Effect, EffectError, FrameContext, ObjectMotion, Photograph, Stage, Summed};
use crate::frame::Frame;
use crate::gpu::{Gpu, GpuError, Readback, ReadbackSet, TexturePool};
use crate::image::{Codes, LayerImage, Pixels, Rect};
use crate::pose::Pose;
use crate::render::{LayerRun, Renderer, SamplePlan, Shutter, View, ViewKeys, largest_sum_px};
use crate::scene::Scene;
use crate::tracking::PoseTrack;

pub use mix::shader as mixed_shader;
pub use run::{RunError, Stream};
pub use settings::{Depth, Settings, SettingsError};

use behind_real::{BehindReal, deep_within};
use mix::{MixedEffect, Mixer, Piece};
use places::{Asked, Places};
use real::RealPart;

/// A frame with all that its picture depends on.
#[derive(Debug)]
pub struct Job<'a> {
    pub frame: Frame,
    pub geometry: &'a Geometry,
    pub track: &'a PoseTrack,
    /// Added to the frame's timestamp when a pose is asked for, seconds.
    pub time_offset_s: f64,
    /// To the next frame, seconds.
    pub interval_s: f64,
    /// Whether the virtual layer is wanted too.
    pub want_layer: bool,
    /// None where virtual things are added to the recording and nothing else is changed.
    pub photograph: Option<Part<'a>>,
}

/// A part of a photograph. The job's frame holds the real pixels of the whole, exposed as the photograph is; its
/// geometry is the photograph's.
#[derive(Clone, Copy, Debug)]
pub struct Part<'a> {
    /// Which columns and rows are made; the others stay as they are.
    pub region: Rect,
    pub photograph: Photograph,
    /// The virtual camera's; none for a pinhole.
    pub opening: Option<Opening>,
    pub exposure_time_s: f64,
    /// The recording's frames that its real part sums; empty for one.
    pub summed: &'a [Summed],
    /// The recording's camera, and where in its pictures the photograph lies.
    pub recorded: &'a Geometry,
    pub framed: Framed,
    /// Of that camera's picture, at the frame's moment, metres; 0 where nothing is known. It hides virtual things.
    pub depth_m: Option<&'a [f32]>,
    /// The same, filled: with it effects act on the real part too.
    pub surfaces: Option<&'a Surfaces>,
}

/// A composited frame.
#[derive(Debug)]
pub struct Composited {
    pub frame: usize,
    pub pixels: Pixels,
    /// Over the whole picture, where it was asked for.
    pub layer: Option<LayerImage>,
    pub stats: FrameStats,
}

/// What was found and done for a frame.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct FrameStats {
    pub frame: usize,
    pub timestamp_s: f64,
    /// Why nothing was drawn: no pose at this time.
    pub no_pose: Option<String>,
    /// Why the frame's depth, though there is some and it is asked for, hid nothing.
    pub no_occlusion: Option<String>,
    /// Columns and rows that were looked at: x0, y0, x1, y1.
    pub rect_px: Option<[i32; 4]>,
    /// Whether objects can be in what was made of the picture; a photograph is made where there are none, too.
    pub objects_in_sight: bool,
    pub exposure_time_s: f64,
    /// No point of the objects moves faster.
    pub fastest_px_per_s: f32,
    pub effects: Vec<&'static str>,
}

/// Draws a scene into frames.
#[derive(Debug)]
pub struct Compositor {
    gpu: Gpu,
    camera: Camera,
    settings: Settings,
    renderer: Renderer,
    mixer: Mixer,
    rays: RayCache,
    real: RealPart,
    behind_real: BehindReal,
    pool: TexturePool,
    readbacks: ReadbackSet,
}

/// Why a frame's work was not begun.
#[derive(Debug, thiserror::Error)]
pub enum SubmitError {
    #[error(transparent)]
    Lens(#[from] LensError),
    #[error(transparent)]
    Effect(#[from] EffectError),
    #[error(
        "the objects, as far as they are blurred, take {width_px}x{height_px} px; this adapter draws up to {side_px} px \
         a side and {area_px} in all: accepted are a shorter exposure, less blur{}, or smaller frames",
        widest.map_or_else(String::new, |effect| format!(" ({effect} reaches farthest)"))
    )]
    TooLarge { width_px: u32, height_px: u32, side_px: u32, area_px: u32, widest: Option<&'static str> },
    #[error(transparent)]
    Gpu(#[from] GpuError),
}

/// A frame whose work is on the GPU.
#[derive(Debug)]
pub struct Pending {
    frame: Frame,
    stats: FrameStats,
    want_layer: bool,
    work: Option<Work>,
}

#[derive(Debug)]
struct Work {
    pieces: Vec<Piece>,
    codes: Vec<Readback>,
    layer: Option<[Readback; 2]>,
}

impl Compositor {
    pub fn new(gpu: Gpu, camera: Camera, settings: Settings, scene: Scene) -> Self {
        let renderer = Renderer::new(&gpu, scene);
        let mixer = Mixer::new(&gpu, &camera);
        let real = RealPart::new(&camera.response);
        Self {
            gpu,
            camera,
            settings,
            renderer,
            mixer,
            rays: RayCache::default(),
            real,
            behind_real: BehindReal::default(),
            pool: TexturePool::default(),
            readbacks: ReadbackSet::default(),
        }
    }

    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// The camera's response.
    pub fn response(&self) -> &Response {
        &self.camera.response
    }

    /// What the scene asks for and is not drawn.
    pub fn warnings(&self) -> Vec<String> {
        self.renderer.warnings()
    }

    /// The exposure of a frame, seconds: the camera's shutter angle, what the recording says
    /// of the frame (unless the settings overrule it), the camera's time, half the interval.
    pub fn exposure_time_s(&self, frame: &Frame, interval_s: f64) -> f64 {
        let camera = &self.camera.exposure;
        let angle = |deg: f64| deg / 360.0 * interval_s;
        let recorded = frame.exposure.time_s.filter(|_| !self.settings.overrule_recorded_exposure);
        camera.shutter_angle_deg.map(angle).or(recorded).or(camera.time_s).unwrap_or(0.5 * interval_s)
    }

    /// Starts a frame's work. Frames may be started before earlier ones are collected.
    pub fn submit(&mut self, job: Job<'_>) -> Result<Pending, SubmitError> {
        let frame = job.frame;
        let time_s = frame.timestamp_s + job.time_offset_s;
        let exposure_time_s = match &job.photograph {
            Some(part) => part.exposure_time_s,
            None => self.exposure_time_s(&frame, job.interval_s),
        };
        let mut stats = FrameStats {
            frame: frame.index,
            timestamp_s: frame.timestamp_s,
            no_pose: None,
            no_occlusion: None,
            rect_px: None,
            objects_in_sight: false,
            exposure_time_s,
            fastest_px_per_s: 0.0,
            effects: Vec::new(),
        };
        if let Err(reason) = job.track.at(time_s) {
            stats.no_pose = Some(reason.to_string());
            return Ok(Pending { frame, stats, want_layer: job.want_layer, work: None });
        }
        let intrinsics = &job.geometry.intrinsics;
        let opening = match &job.photograph {
            Some(part) => part.opening,
            None => self.camera.lens.opening(job.geometry)?,
        };
        let summed = job.photograph.map_or(&[][..], |part| part.summed);
        let summed_to_s = summed.iter().map(|f| f.time_s.abs() + 0.5 * (f.exposure_s - exposure_time_s));
        let beyond_s = self.settings.effects.iter().map(|e| e.beyond_s(exposure_time_s));
        let beyond_s = beyond_s.chain(summed_to_s).fold(0.0, f64::max);
        let shutter = Shutter { exposure_time_s, readout_time_s: intrinsics.readout_time_s, beyond_s };
        let pose_at = |t: f64| job.track.at_or_nearest(t).unwrap_or(Pose::IDENTITY);
        let keys = ViewKeys::new(shutter, |offset_s| pose_at(time_s + offset_s));
        let footprint = self.renderer.footprint(job.geometry, &keys, shutter);
        stats.fastest_px_per_s = footprint.fastest_px_per_s;

        let objects = self.object_motions(job.geometry, &keys.middle(), &pose_at(time_s + job.interval_s));
        let real_depths_m = job.photograph.and_then(|part| part.surfaces).map(Surfaces::range_m);
        let context = FrameContext {
            camera: &self.camera,
            geometry: job.geometry,
            frame: frame.index,
            seed: self.settings.seed,
            exposure_time_s,
            recorded: frame.exposure,
            interval_s: job.interval_s,
            fastest_px_per_s: footprint.fastest_px_per_s,
            opening,
            photograph: job.photograph.map(|part| part.photograph),
            summed,
            // Where there are no objects all that lies between depths is real.
            depths_m: real_depths_m.filter(|_| footprint.rect.is_empty()).unwrap_or(footprint.depths_m),
            real_depths_m,
            objects_px: Rect::new(0, 0, 0, 0),
            drawn: Rect::new(0, 0, 0, 0),
            objects: &objects,
        };
        let active: Vec<usize> =
            (0..self.settings.effects.len()).filter(|&i| self.settings.is_active(i, &context)).collect();
        stats.effects = active.iter().map(|&i| self.settings.effects[i].params().table()).collect();
        for &i in &active {
            self.settings.effects[i].check(&self.camera, job.geometry)?;
        }
        let total = |px: fn(&dyn Effect, &FrameContext<'_>) -> f32| {
            let sum: f32 = active.iter().map(|&i| px(self.settings.effects[i].as_ref(), &context)).sum();
            (sum.ceil() as i32).saturating_add(1)
        };
        let picture = Rect::full(frame.pixels.width, frame.pixels.height);
        let region = job.photograph.map_or(picture, |part| part.region.intersection(&picture));
        let is_any = |is: fn(&dyn Effect) -> bool| active.iter().any(|&i| is(self.settings.effects[i].as_ref()));
        let surfaces = job.photograph.and_then(|part| part.surfaces).filter(|_| is_any(|e| e.acts_on_real()));
        let asked = Asked {
            region,
            footprint: footprint.rect,
            reach_px: total(|e, c| e.reach_px(c)),
            spread_px: total(|e, c| e.spread_px(c)),
            round: job.geometry.is_round(),
            photograph: job.photograph.is_some(),
            real_too: surfaces.is_some(),
        };
        let Some(Places { drawn, objects_px, pieces, looked_at }) = Places::of(&asked) else {
            return Ok(Pending { frame, stats, want_layer: job.want_layer, work: None });
        };
        let plan = active.iter().fold(SamplePlan::single(), |plan, &i| self.settings.effects[i].plan(&context, plan));
        let [side_px, mut area_px] = [TexturePool::largest_side_px(&self.gpu), TexturePool::largest_area_px(&self.gpu)];
        if plan.samples.len() > 1 {
            area_px = area_px.min(largest_sum_px(&self.gpu));
        }
        let (width_px, height_px) = (drawn.width(), drawn.height());
        if width_px.max(height_px) > side_px || u64::from(width_px) * u64::from(height_px) > u64::from(area_px) {
            let reach = |i: &&usize| self.settings.effects[**i].reach_px(&context);
            let widest = active.iter().max_by(|a, b| reach(a).total_cmp(&reach(b))).filter(|i| reach(i) >= 1.0);
            let widest = widest.map(|&i| self.settings.effects[i].params().table());
            return Err(SubmitError::TooLarge { width_px, height_px, side_px, area_px, widest });
        }
        let context = FrameContext { drawn, objects_px, ..context };
        stats.objects_in_sight = !footprint.rect.intersection(&region).is_empty();
        stats.rect_px = Some([looked_at.x0, looked_at.y0, looked_at.x1, looked_at.y1]);

        let gpu = self.gpu.clone();
        let recorded = job.photograph.map_or(job.geometry, |part| part.recorded);
        let depth = frame.depth.as_ref().filter(|_| self.settings.depth.occlusion);
        let measured = depth.map(|depth| measured_from(depth, recorded, job.track, job.time_offset_s));
        stats.no_occlusion = measured.as_ref().and_then(|pose| pose.as_ref().err().cloned());
        let occludes = self.settings.depth.occlusion && !(surfaces.is_some() && is_any(|e| e.hides_behind_real()));
        let texels = match &job.photograph {
            None => depth
                .zip(measured.and_then(Result::ok))
                .map(|(depth, measured)| self.rays.of(job.geometry).reproject(depth, &measured, &keys.middle(), drawn)),
            Some(part) => part.depth_m.filter(|_| occludes).map(|depth_m| {
                let Intrinsics { width_px, height_px, .. } = part.recorded.intrinsics;
                enlarged(depth_m, (width_px, height_px), &part.framed, drawn)
            }),
        };
        // Hidden before it is blurred is what is hidden however far it is blurred, if it is cut off after that.
        let cuts = |i: &usize| job.photograph.is_none() && self.settings.effects[*i].blurs_behind_real();
        let cut_after = active.iter().copied().rfind(cuts).filter(|_| texels.is_some());
        let size = (drawn.width(), drawn.height());
        let mut real_depth = |slot, texels: &[f32]| {
            let texture = self.pool.get(&gpu, "real depth", slot, size, wgpu::TextureFormat::R32Float, 1);
            texture.write(&gpu, size.0, size.1, texels);
            texture
        };
        let hidden_first = texels.as_ref().map(|texels| match cut_after {
            Some(i) => {
                let reach_px = self.settings.effects[i].reach_px(&context).ceil() as usize;
                real_depth(0, &deep_within(texels, size.0 as usize, reach_px))
            }
            None => real_depth(0, texels),
        });
        let hidden_then = cut_after.and(texels.as_ref()).map(|texels| real_depth(1, texels));
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let mut run =
            LayerRun { gpu: &gpu, encoder: &mut encoder, pool: &mut self.pool, geometry_is_read: job.want_layer };
        let view = View {
            geometry: job.geometry,
            keys: &keys,
            shutter,
            depths_m: footprint.depths_m,
            rect: drawn,
            occlusion: hidden_first.as_ref().map(|t| (t, self.settings.depth.tolerance_m)),
            parallel_to_m: None,
            outer: None,
        };
        let mut layer = self.renderer.draw(&mut run, &view, &plan);
        layer.real = surfaces.map(|surfaces| {
            let tolerance_m = self.settings.depth.occlusion.then_some(self.settings.depth.tolerance_m);
            self.real.make(&mut run, &frame.pixels, surfaces, drawn, tolerance_m)
        });
        for (n, &i) in active.iter().enumerate() {
            if self.settings.effects[i].stage() == Stage::Layer {
                let later = &active[n + 1..];
                let cut_here = hidden_then.as_ref().filter(|_| cut_after == Some(i));
                run.geometry_is_read = job.want_layer
                    || cut_here.is_some()
                    || later.iter().any(|&k| self.settings.effects[k].reads_geometry());
                layer = self.settings.effects[i].run(&mut run, &context, layer);
                if let Some(real_depth) = cut_here {
                    layer = self.behind_real.cut(&mut run, layer, real_depth, self.settings.depth.tolerance_m);
                }
            }
        }
        let composites = |i: &&usize| {
            let effect = &self.settings.effects[**i];
            effect.stage() == Stage::Layer && effect.mixed_wgsl(false).is_some()
        };
        debug_assert!(active.iter().filter(composites).count() <= 1, "one effect at most takes the composite's place");
        let photograph = context.photograph.as_ref();
        let other_film = photograph.is_some() || context.recorded_speed() != 1.0;
        let mut codes = Vec::new();
        for piece in &pieces {
            let mut mixed = Vec::new();
            for &i in &active {
                let effect = &mut self.settings.effects[i];
                if let Some(wgsl) = effect.mixed_wgsl(other_film) {
                    let inputs = effect.mixed_inputs(&mut run, &context, piece.shown);
                    mixed.push(MixedEffect { name: effect.params().table(), wgsl, inputs });
                }
            }
            let out = self.mixer.mix(&mut run, &frame.pixels, &layer, piece, &mixed, photograph);
            let size = (piece.shown.width(), piece.shown.height());
            codes.push(self.readbacks.copy(&gpu, run.encoder, &out, size));
        }
        let mut layer_back = job.want_layer.then(|| {
            [&layer.color, &layer.geometry]
                .map(|t| self.readbacks.copy(&gpu, &mut encoder, t, (drawn.width(), drawn.height())))
        });
        let submission = gpu.queue.submit([encoder.finish()]);
        for readback in codes.iter_mut().chain(layer_back.iter_mut().flatten()) {
            readback.submitted(submission.clone());
        }
        let work = Work { pieces, codes, layer: layer_back };
        Ok(Pending { frame, stats, want_layer: job.want_layer, work: Some(work) })
    }

    /// Waits for a frame and gives its picture: the camera's own, and within the rectangle
    /// what came back from the GPU.
    pub fn collect(&mut self, pending: Pending) -> Result<Composited, GpuError> {
        let Pending { frame, stats, want_layer, work } = pending;
        let index = frame.index;
        let mut pixels = frame.pixels;
        let mut layer = want_layer.then(|| LayerImage::empty(pixels.width, pixels.height));
        if let Some(work) = work {
            for (piece, codes) in work.pieces.iter().zip(work.codes) {
                paste(&self.gpu, &codes, piece.shown, &mut pixels)?;
                self.readbacks.give_back(codes);
            }
            if let (Some(image), Some([color, geometry])) = (&mut layer, work.layer) {
                if let Some(first) = work.pieces.first() {
                    paste_layer(&self.gpu, &color, &geometry, first.drawn, work.pieces.len() > 1, image)?;
                }
                self.readbacks.give_back(color);
                self.readbacks.give_back(geometry);
            }
        }
        Ok(Composited { frame: index, pixels, layer, stats })
    }

    /// How far each object's centre moves across the picture until the next frame.
    fn object_motions(&self, geometry: &Geometry, now: &Pose, next: &Pose) -> Vec<ObjectMotion> {
        let seen = |pose: &Pose, c| geometry.project(pose.transform_point(c));
        self.renderer
            .object_centres()
            .into_iter()
            .map(|centre| {
                let moved = centre.and_then(|c| Some(geometry.way_px(seen(now, c)?, seen(next, c)?)));
                moved.map_or(ObjectMotion::default(), |v| ObjectMotion { per_frame_px: v.as_vec2().to_array() })
            })
            .collect()
    }
}

/// Writes rows of RGBA texels into the rectangle of a picture.
fn paste(gpu: &Gpu, readback: &Readback, rect: Rect, pixels: &mut Pixels) -> Result<(), GpuError> {
    let width = pixels.width as usize;
    let start = |row: usize| 3 * ((rect.y0 as usize + row) * width + rect.x0 as usize);
    let columns = rect.width() as usize;
    match &mut pixels.codes {
        Codes::U8(codes) => readback.rows(gpu, |row, bytes| {
            let out = &mut codes[start(row)..start(row) + 3 * columns];
            for (rgb, rgba) in out.chunks_exact_mut(3).zip(bytes.chunks_exact(4)) {
                rgb.copy_from_slice(&rgba[..3]);
            }
        }),
        Codes::U16(codes) => readback.rows(gpu, |row, bytes| {
            let out = &mut codes[start(row)..start(row) + 3 * columns];
            for (rgb, rgba) in out.chunks_exact_mut(3).zip(bytes.chunks_exact(8)) {
                for (code, pair) in rgb.iter_mut().zip(rgba.chunks_exact(2)) {
                    *code = u16::from_le_bytes([pair[0], pair[1]]);
                }
            }
        }),
    }
}

/// Fills in a layer that was drawn over `rect`, which may reach beyond the picture; over the seam it goes on at the other
/// rim.
fn paste_layer(
    gpu: &Gpu,
    color: &Readback,
    geometry: &Readback,
    rect: Rect,
    over_seam: bool,
    out: &mut LayerImage,
) -> Result<(), GpuError> {
    let (width, height) = (out.width as i32, out.height as i32);
    let half = |b: &[u8]| half::f16::from_le_bytes([b[0], b[1]]).to_f32();
    let at = |row: usize, column: usize| {
        let (x, y) = (rect.x0 + column as i32, rect.y0 + row as i32);
        let x = if over_seam { x.rem_euclid(width) } else { x };
        (x >= 0 && y >= 0 && x < width && y < height).then_some((y * width + x) as usize)
    };
    let texel = |t: &[u8]| [half(&t[0..]), half(&t[2..]), half(&t[4..]), half(&t[6..])];
    color.rows(gpu, |row, bytes| {
        for (column, t) in bytes.chunks_exact(8).enumerate() {
            // Light that rounding left without coverage is nothing, as in the composite.
            if let Some(i) = at(row, column).filter(|_| half(&t[6..]) > 0.0) {
                out.rgba[i] = texel(t);
            }
        }
    })?;
    geometry.rows(gpu, |row, bytes| {
        for (column, t) in bytes.chunks_exact(8).enumerate() {
            if let Some(i) = at(row, column).filter(|&i| out.rgba[i][3] > 0.0) {
                out.depth_m[i] = f32::from_le_bytes([t[0], t[1], t[2], t[3]]);
                out.velocity[i] = [half(&t[4..]), half(&t[6..])];
            }
        }
    })
}
