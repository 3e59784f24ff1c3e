//! Composites frames: the picture is a pure function of a frame, the poses around it, the scene,
//! the camera and the settings.
//!
//! The phases of [`Compositor::submit`]: plan (plan.rs), occlusion (occlusion.rs), draw (the
//! renderer), effects on the layer, mix (mix.rs).

mod clipped;
mod dirty_tiles;
mod exposure_time;
mod foreground_matte;
mod job;
mod mix;
mod occlusion;
mod paste;
mod plan;
mod real;
mod rgba;
mod run;
mod settings;
mod shade;
mod work_rects;

use std::sync::Arc;

use crate::camera::{Camera, Response};
use crate::effects::LayerRun;
use crate::frame::Frame;
use crate::gpu::{Gpu, GpuError, PartTime, PendingTimes, Readback, ReadbackSet, Recorder};
use crate::pixels::{LayerImage, Rect};
use crate::quality::Quality;
use crate::render::{Layer, Occlusion, Renderer, View};
use crate::scene::{Object, Scene};
use crate::shadow::{LazyRadiance, Lightmaps, Room, ShadowMap, Shadows};

pub use clipped::CLIP_LEVEL;
pub use exposure_time::{ExposureSource, ExposureTime};
pub use job::{Composited, FrameStats, Job, RealDepth, SubmitError, Target};
pub use mix::module as mixed_module;
pub use occlusion::project_rolling;
pub use plan::poses_within_s;
pub use run::{IN_FLIGHT, Input, Run, RunError, Stream};
pub use settings::{DepthSettings, ON, Settings, SettingsError, ShadowSettings};

use clipped::FrameRadiance;
use mix::{CameraUpload, Piece, mix};
use occlusion::FrameOcclusion;
use paste::{fill_noise, paste, paste_fringe, paste_layer, paste_shade};
use plan::{FrameView, Plan, frame_context};

/// Draws a scene into frames. Final frames are those of a new compositor: the state between them is
/// memoized. Previews may reuse earlier results.
#[derive(Debug)]
pub struct Compositor {
    renderer: Renderer,
    shadows: Shadows,
    lightmaps: Lightmaps,
    recorder: Recorder,
    depth: occlusion::DepthState,
    radiance: Option<Arc<LazyRadiance>>,
    readbacks: ReadbackSet,
    allow_preview: bool,
}

/// A frame whose work is on the GPU.
#[derive(Debug)]
pub struct Pending {
    frame: Frame,
    stats: FrameStats,
    want_layer: bool,
    work: Option<Work>,
    /// Earlier submissions of the frame, in order, without the last.
    parts: Vec<wgpu::SubmissionIndex>,
    /// `None` if nothing had to be drawn.
    last: Option<wgpu::SubmissionIndex>,
    timed: Vec<PendingTimes>,
    is_preview: bool,
}

impl Pending {
    pub fn stats(&self) -> &FrameStats {
        &self.stats
    }

    /// True if shadows or occlusion have preview quality ([`Compositor::allow_preview`]).
    pub fn is_preview(&self) -> bool {
        self.is_preview
    }

    /// Waits until the GPU has finished; callable from any thread. A picture in a
    /// [`Target::View`] is complete then.
    pub fn await_drawn(&self, gpu: &Gpu) -> Result<(), GpuError> {
        self.last.clone().map_or(Ok(()), |last| gpu.wait(Some(last)))
    }

    /// Waits and returns the GPU time of each part, if timing was requested
    /// ([`Compositor::time_next`]): `depth`, `shadow`, `objects`, each effect by its table, and
    /// `mix`, with the effects of the mixed stage.
    pub fn times(&self, gpu: &Gpu) -> Result<Vec<PartTime>, GpuError> {
        PendingTimes::times(&self.timed, gpu)
    }
}

#[derive(Debug, Default)]
struct Work {
    /// Empty if the picture went into a view.
    codes: Vec<(Piece, Readback)>,
    layer: Option<LayerReadback>,
}

#[derive(Debug)]
struct LayerReadback {
    drawn: Rect,
    over_seam: bool,
    light_alone: bool,
    opacity: f32,
    parts: [Readback; 2],
    fringe: Option<Readback>,
    shaded: Rect,
    shade: Option<Readback>,
    response: Response,
}

impl Compositor {
    pub fn new(gpu: Gpu, scene: Scene) -> Self {
        Self {
            shadows: Shadows::new(&scene),
            lightmaps: Lightmaps::new(&scene),
            renderer: Renderer::new(&gpu, scene),
            recorder: Recorder::new(gpu),
            depth: occlusion::DepthState::default(),
            radiance: None,
            readbacks: ReadbackSet::default(),
            allow_preview: false,
        }
    }

    /// Replaces the scene. Compiled pipelines stay: the cost is that of the upload.
    pub fn set_scene(&mut self, scene: Scene) {
        // Shadow maps and lightmaps stay valid for the same geometry under the same lights.
        let before = self.renderer.scene();
        if !before.has_same_resources(&scene) {
            self.shadows = Shadows::new(&scene);
            self.lightmaps = Lightmaps::new(&scene);
        } else if before.lighting != scene.lighting {
            self.shadows.set_lighting(&scene);
            self.lightmaps.set_lighting(&scene);
        }
        self.renderer.set_scene(&self.recorder.gpu, scene);
    }

    /// Places the scene's objects from the next frame on. An object without parts is not drawn.
    ///
    /// # Panics
    /// If a part's mesh is not one of the scene's.
    pub fn place(&mut self, objects: &[Object]) {
        self.renderer.place(objects);
    }

    /// Sets the real room. From the next frame on its surfaces block light from the floors, so that
    /// virtual objects do not block the same light again.
    pub fn set_room(&mut self, room: Option<Arc<Room>>) {
        self.shadows.set_room(room);
    }

    /// Sets the estimated radiance of the room's surfaces, which clipped pixels need, from the next
    /// frame on.
    pub fn set_surface_radiance(&mut self, radiance: Option<Arc<LazyRadiance>>) {
        self.radiance = radiance;
    }

    pub fn gpu(&self) -> &Gpu {
        &self.recorder.gpu
    }

    /// Times the parts of the next frame on the GPU, if it has timestamps ([`Pending::times`]).
    pub fn time_next(&mut self) {
        self.recorder.time();
    }

    /// Allows preview quality for the next frame: shadows that are not cached yet are coarse, and
    /// occlusion uses the frame's own depth without its neighbours. All other frames are the same
    /// as a new compositor's.
    pub fn allow_preview(&mut self) {
        self.allow_preview = true;
    }

    /// Features of the scene that are not drawn.
    pub fn warnings(&self) -> Vec<String> {
        self.renderer.warnings()
    }

    /// Starts a frame's work. Frames may be started before earlier ones are collected.
    pub fn submit(
        &mut self,
        job: Job<'_>,
        camera: &Camera,
        settings: &Settings,
        target: Target<'_>,
    ) -> Result<Pending, SubmitError> {
        let allow_preview = std::mem::take(&mut self.allow_preview);
        if let Target::View(view, _) = target {
            let (size, pixels) = (view.texture().size(), &job.frame.pixels);
            let (view_px, picture_px) = ((size.width, size.height), (pixels.width, pixels.height));
            if view_px != picture_px {
                return Err(SubmitError::TargetSize { view_px, picture_px });
            }
        }
        let mut stats = FrameStats::of(&job);
        if let Err(reason) = job.track.at(job.frame.timestamp_s) {
            stats.no_pose = Some(reason.to_string());
            return Ok(self.pass_through(job, stats, target));
        }
        // A photograph is composited even if the layer is invisible.
        if job.frame.opacity <= 0.0 && !job.capture.whole {
            return Ok(self.pass_through(job, stats, target));
        }
        let (shadow_maps, mut is_preview) = self.update_shadows(&settings.shadow, allow_preview);
        let frame_view = FrameView::new(&self.renderer, shadow_maps, &job, settings);
        let context = frame_context(&job, camera, settings, &frame_view);
        let plan = Plan::new(self.gpu(), &job, camera, settings, &context, &frame_view)?;
        stats.fastest_px_per_s = frame_view.footprint.fastest_px_per_s;
        stats.effects = plan.active.iter().map(|effect| effect.table()).collect();
        let Some(work_rects) = &plan.work_rects else { return Ok(self.pass_through(job, stats, target)) };
        stats.objects_in_sight = !frame_view.footprint.rect.intersection(&job.capture.region).is_empty();
        let bounds = work_rects.bounds;
        stats.rect_px = Some([bounds.x0, bounds.y0, bounds.x1, bounds.y1]);

        self.recorder.part("depth");
        self.depth.allow_preview = allow_preview;
        self.depth.proxies = self.proxies();
        let occlusion =
            FrameOcclusion::new(&mut self.recorder, &mut self.depth, &job, settings, &frame_view, &plan, &context);
        stats.no_occlusion = occlusion.failure.clone();
        is_preview |= occlusion.is_preview;
        let tolerance_m = settings.depth.tolerance_m;
        let view = View {
            geometry: job.picture,
            keys: &frame_view.keys,
            shutter: frame_view.shutter,
            depths_m: frame_view.footprint.depths_m,
            rect: work_rects.drawn,
            occlusion: occlusion.depth_test.as_ref().map(|(depth, grid_placement)| Occlusion {
                depth,
                grid_placement: *grid_placement,
                tolerance_m,
                moments: job.real.moments(),
            }),
            parallel_to_m: None,
            outer: None,
        };
        self.recorder.part("shadow");
        let request = shade::ShadeRequest {
            geometry: job.picture,
            keys: &frame_view.keys,
            shutter: frame_view.shutter,
            part: work_rects.shaded,
            depth: occlusion.scene_depth.as_ref().map(|(depth, rect)| (depth, *rect)),
            matte: occlusion.receiver_matte.as_ref().map(|(matte, rect)| (matte, *rect)),
            settings: &settings.shadow,
            opacity: job.frame.opacity,
        };
        let shade_image = shade::shade(&mut self.recorder, &frame_view.shadows, &request);
        let pose_at = |offset_s| frame_view.keys.pose_at(offset_s);
        let rays = self.depth.rays.of(job.picture);
        let radiance = self.radiance.as_deref().zip(occlusion.repaired.as_ref()).zip(job.frame.exposure.brightness);
        let radiance = radiance.map(|((radiance, (repaired, rect)), brightness)| FrameRadiance {
            radiance,
            depth_m: (&repaired.depth_m, *rect),
            rays,
            pose_at: &pose_at,
            brightness,
        });
        let camera_light = (&*job.frame.pixels, &camera.response, job.picture);
        let shade_image = shade_image.map(|image| {
            clipped::limit_clipped_shadow(&mut self.recorder, image, work_rects.shaded, camera_light, radiance.as_ref())
        });
        let shade = shade_image.as_ref().map(|image| &image.texture);
        self.recorder.part("objects");
        let mut layer = self.renderer.draw(&mut self.recorder, &view, &plan.samples);
        layer.real = plan.surfaces.map(|surfaces| {
            // With summed exposures, the layer was occluded exposure by exposure.
            let hides = settings.depth.occlusion && job.real.moments().is_empty();
            let tolerance_m = hides.then_some(tolerance_m);
            let pixels = &job.frame.pixels;
            real::real_layer(
                &mut self.recorder,
                pixels,
                surfaces,
                work_rects.drawn,
                tolerance_m,
                &camera.response,
                shade,
            )
        });
        let mut run = LayerRun {
            recorder: &mut self.recorder,
            context: &context,
            drawn: work_rects.drawn,
            objects_px: work_rects.objects_px,
            geometry_is_read: true,
        };
        let layer = run_effects(&mut run, layer, &plan, &occlusion, job.want_layer, tolerance_m);

        run.recorder.part("mix");
        let upload_px = match target {
            Target::Pixels => upload_rects(&work_rects.pieces, &job.frame),
            Target::View(..) => whole(&job.frame),
        };
        let uploads: Vec<_> =
            upload_px.into_iter().map(|rect| CameraUpload::new(run.recorder, &job.frame.pixels, rect)).collect();
        // Effects on real pixels and layers across a seam change pixels everywhere.
        let parts = frame_view.footprint.parts.iter().map(|(rect, _)| rect.grown(work_rects.spread_px));
        let parts = parts.chain(shade_image.iter().flat_map(|image| image.pieces.iter().copied()));
        let is_whole = job.capture.whole
            || layer.real.is_some()
            || job.picture.is_equirectangular()
            || work_rects.pieces.len() > 1;
        let mut work = Work::default();
        let changed: Vec<Rect> =
            if is_whole { work_rects.pieces.iter().map(|piece| piece.shown).collect() } else { parts.collect() };
        for (i, piece) in work_rects.pieces.iter().enumerate() {
            let parts: Vec<_> = plan.active.iter().filter_map(|effect| effect.mix(&mut run, piece.shown)).collect();
            let upload = uploads.get(i).unwrap_or(&uploads[0]);
            let made = mix(run.recorder, camera, &job, upload, (&layer, shade), (piece, &changed), parts);
            match target {
                Target::Pixels => {
                    let size = (piece.shown.width(), piece.shown.height());
                    work.codes.push((*piece, run.recorder.read_back(&mut self.readbacks, &made, size)));
                }
                Target::View(..) => upload.put(run.recorder, &made, piece.shown),
            }
        }
        if let (Target::View(view, format), Some(upload)) = (target, uploads.first()) {
            upload.show(run.recorder, view, format);
        }
        let first = work_rects.pieces[0];
        work.layer = job.want_layer.then(|| LayerReadback {
            drawn: first.drawn,
            over_seam: work_rects.pieces.len() > 1,
            light_alone: layer.light_alone,
            opacity: job.frame.opacity as f32,
            parts: [&layer.color, &layer.geometry].map(|t| run.recorder.read_back(&mut self.readbacks, t, layer.size)),
            fringe: layer.fringe.as_ref().map(|t| run.recorder.read_back(&mut self.readbacks, t, layer.size)),
            shaded: first.shaded,
            response: camera.response.clone(),
            shade: shade.map(|t| {
                let size = (work_rects.shaded.width(), work_rects.shaded.height());
                run.recorder.read_back(&mut self.readbacks, t, size)
            }),
        });
        let submission = self.recorder.submit();
        let codes = work.codes.iter_mut().map(|(_, readback)| readback);
        let layers = work
            .layer
            .iter_mut()
            .flat_map(|layer| layer.parts.iter_mut().chain(&mut layer.shade).chain(&mut layer.fringe));
        for readback in codes.chain(layers) {
            readback.submitted(submission.clone());
        }
        let last = Some(submission);
        let timed = self.recorder.timed();
        Ok(Pending {
            frame: job.frame,
            stats,
            want_layer: job.want_layer,
            work: Some(work),
            parts: self.recorder.parts(),
            last,
            timed,
            is_preview,
        })
    }

    /// Computes shadow maps and lightmaps ahead of the first frame.
    pub fn prepare(&mut self, settings: &Settings) {
        self.update_shadows(&settings.shadow, false);
    }

    /// Computes the shadow maps and lightmaps. Returns the shadow maps, and whether any of either
    /// has preview quality. Lightmaps go to the renderer.
    fn update_shadows(&mut self, settings: &ShadowSettings, allow_preview: bool) -> (Vec<ShadowMap>, bool) {
        let (gpu, strength) = (&self.recorder.gpu, settings.strength);
        if !settings.cast || strength <= 0.0 {
            self.renderer.set_lightmaps(gpu, &[], strength);
            return (Vec::new(), false);
        }
        let requested = if allow_preview { Quality::Preview } else { Quality::Final };
        let (shadow_maps, mut quality) = self.shadows.shadow_maps(self.renderer.scene(), requested);
        let lightmaps = match (settings.on_things, requested) {
            (false, _) => self.shadows.light_visibility(self.renderer.scene()),
            (true, Quality::Preview) => {
                let (lightmaps, of_lightmaps) = self.lightmaps.preview(self.renderer.scene());
                quality = quality.min(of_lightmaps);
                lightmaps
            }
            (true, Quality::Final) => {
                self.renderer.unwrap(gpu);
                let visibility = self.shadows.light_visibility(self.renderer.scene());
                // Receiver planes beside the support reflect no light onto objects.
                let floors = shadow_maps.iter().filter(|shadow_map| !shadow_map.is_beside);
                let floors: Vec<ShadowMap> = floors.cloned().collect();
                self.lightmaps.lightmaps(self.renderer.scene(), self.renderer.unwrapped(), &floors, &visibility)
            }
        };
        self.renderer.set_lightmaps(gpu, &lightmaps, strength);
        (shadow_maps, quality.is_preview())
    }

    /// Passes a frame through unchanged.
    fn pass_through(&mut self, job: Job<'_>, stats: FrameStats, target: Target<'_>) -> Pending {
        let mut last = None;
        if let Target::View(view, format) = target {
            let pixels = &job.frame.pixels;
            let upload = CameraUpload::new(&self.recorder, pixels, Rect::full(pixels.width, pixels.height));
            self.recorder.part("mix");
            upload.show(&mut self.recorder, view, format);
            last = Some(self.recorder.submit());
        }
        let timed = self.recorder.timed();
        let (frame, want_layer) = (job.frame, job.want_layer);
        Pending { frame, stats, want_layer, work: None, parts: Vec::new(), last, timed, is_preview: false }
    }

    /// True if [`Compositor::collect`] would return without waiting.
    pub fn is_done(&self, pending: &Pending) -> Result<bool, GpuError> {
        let Some(work) = &pending.work else { return Ok(true) };
        let layer = work.layer.iter().flat_map(|layer| layer.parts.iter().chain(&layer.shade).chain(&layer.fringe));
        for readback in work.codes.iter().map(|(_, readback)| readback).chain(layer) {
            if !readback.is_ready(self.gpu())? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Waits for the earlier submissions of a frame; after each, `done` receives the finished
    /// fraction. [`Compositor::collect`] waits for the last.
    pub fn await_parts(&self, pending: &Pending, mut done: impl FnMut(f64)) -> Result<(), GpuError> {
        for (n, part) in pending.parts.iter().enumerate() {
            self.gpu().wait(Some(part.clone()))?;
            done((n + 1) as f64 / (pending.parts.len() + 1) as f64);
        }
        Ok(())
    }

    /// Waits for a frame and returns its picture: the camera's pixels, with the composited
    /// rectangles pasted in.
    pub fn collect(&mut self, pending: Pending) -> Result<Composited, GpuError> {
        let Pending { frame, stats, want_layer, work, .. } = pending;
        let index = frame.index;
        let mut pixels = Arc::unwrap_or_clone(frame.pixels);
        let mut layer = want_layer.then(|| LayerImage::empty(pixels.width, pixels.height));
        let Work { codes, layer: back } = work.unwrap_or_default();
        let camera = back.is_some().then(|| pixels.clone());
        for (piece, codes) in codes {
            paste(self.gpu(), &codes, piece.shown, &mut pixels)?;
            self.readbacks.give_back(codes);
        }
        if let (Some(image), Some(back)) = (&mut layer, back) {
            let LayerReadback { drawn, over_seam, light_alone, opacity, parts: [color, geometry], .. } = back;
            image.light_alone = light_alone;
            paste_layer(self.gpu(), [&color, &geometry], drawn, over_seam, image)?;
            image.fade(opacity);
            if let Some(shade) = &back.shade {
                paste_shade(self.gpu(), shade, back.shaded, over_seam, image)?;
            }
            if let Some(fringe) = &back.fringe {
                paste_fringe(self.gpu(), fringe, drawn, over_seam, image)?;
            }
            if let Some(camera) = &camera {
                fill_noise(camera, &pixels, &back.response, image);
            }
            [Some(color), Some(geometry), back.shade, back.fringe]
                .into_iter()
                .flatten()
                .for_each(|back| self.readbacks.give_back(back));
        }
        Ok(Composited { frame: index, pixels, layer, stats })
    }
}

/// The rectangle of the camera's picture that each piece reads, with a margin of 1 px for effects
/// that read neighbours.
fn upload_rects(pieces: &[Piece], frame: &Frame) -> Vec<Rect> {
    let picture = Rect::full(frame.pixels.width, frame.pixels.height);
    pieces.iter().map(|piece| piece.shown.grown(1).intersection(&picture)).collect()
}

fn whole(frame: &Frame) -> Vec<Rect> {
    vec![Rect::full(frame.pixels.width, frame.pixels.height)]
}

/// Runs the effects over the layer, in order. After the last effect that blurs, occlusion is
/// applied with the matte.
fn run_effects(
    run: &mut LayerRun<'_>,
    mut layer: Layer,
    plan: &Plan<'_>,
    occlusion: &FrameOcclusion,
    want_layer: bool,
    tolerance_m: f32,
) -> Layer {
    let (after, matte) = occlusion.foreground.as_ref().map_or((0, None), |(after, matte)| (*after, Some(matte)));
    let occlude = |run: &mut LayerRun<'_>, layer: Layer, done: usize| match matte.filter(|_| after == done) {
        Some(matte) => foreground_matte::occlude(run.recorder, layer, matte, tolerance_m),
        None => layer,
    };
    layer = occlude(run, layer, 0);
    for (n, effect) in plan.active.iter().enumerate() {
        let later = &plan.active[n + 1..];
        run.geometry_is_read = want_layer || after > n || later.iter().any(|effect| effect.reads_geometry());
        run.recorder.part(effect.table());
        layer = effect.run(run, layer);
        layer = occlude(run, layer, n + 1);
    }
    layer
}
