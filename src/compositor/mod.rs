//! The frame loop: a pure function of a frame, the poses around it, the scene, the camera and the settings.
//!
//! [`Compositor::submit`] reads as its phases: plan (plan.rs), hide (hide.rs), draw (the renderer), affect (the
//! effects), mix (mix.rs).

mod behind_real;
mod clipped;
mod hide;
mod job;
mod mix;
mod paste;
mod places;
mod plan;
mod real;
mod rgba;
mod run;
mod settings;
mod shade;
mod touched;

use std::sync::Arc;

use crate::camera::{Camera, Response};
use crate::effects::LayerRun;
use crate::frame::Frame;
use crate::gpu::{Gpu, GpuError, PartTime, Readback, ReadbackSet, Recorder, Timed};
use crate::pixels::{LayerImage, Rect};
use crate::quality::Quality;
use crate::render::{Layer, Occlusion, Renderer, View};
use crate::scene::{Object, Scene};
use crate::shadow::{LazyRadiance, Lightmaps, Room, ShadowMap, Shadows};

pub use clipped::WHITE;
pub use hide::seen_by_row;
pub use job::{Composited, FrameStats, Job, RealDepth, SubmitError, Target, exposure_time_s};
pub use mix::module as mixed_module;
pub use plan::poses_within_s;
pub use run::{IN_FLIGHT, Input, Run, RunError, Stream};
pub use settings::{Depth, ON, Settings, SettingsError, Shade};

use clipped::KnownRadiance;
use hide::Hidden;
use mix::{Piece, Sent, mix};
use paste::{fill_noise, paste, paste_fringe, paste_layer, paste_shade};
use plan::{Plan, Sight, moment};

/// Draws a scene into frames. All that it keeps between frames are caches: each call returns what a new compositor
/// would.
#[derive(Debug)]
pub struct Compositor {
    renderer: Renderer,
    shadows: Shadows,
    lightmaps: Lightmaps,
    recorder: Recorder,
    depth: hide::Known,
    radiance: Option<Arc<LazyRadiance>>,
    readbacks: ReadbackSet,
    may_be_rough: bool,
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
    /// `None` where nothing had to be drawn.
    last: Option<wgpu::SubmissionIndex>,
    timed: Vec<Timed>,
    is_rough: bool,
}

impl Pending {
    pub fn stats(&self) -> &FrameStats {
        &self.stats
    }

    /// Whether shadows in it are rough or real edges torn, as was allowed ([`Compositor::may_be_rough`]).
    pub fn is_rough(&self) -> bool {
        self.is_rough
    }

    /// Waits until all of it is drawn, on whatever thread. Of a picture that went into a view nothing else comes.
    pub fn await_drawn(&self, gpu: &Gpu) -> Result<(), GpuError> {
        self.last.clone().map_or(Ok(()), |last| gpu.wait(Some(last)))
    }

    /// Waits, then gives the GPU's time for each part, if it was asked for ([`Compositor::time_next`]): `depth`, `objects`, each effect by its table, `mix` (with the effects that act while
    /// objects are mixed into the picture).
    pub fn times(&self, gpu: &Gpu) -> Result<Vec<PartTime>, GpuError> {
        Timed::times(&self.timed, gpu)
    }
}

#[derive(Debug, Default)]
struct Work {
    /// Empty if the picture went into a view.
    codes: Vec<(Piece, Readback)>,
    layer: Option<LayerBack>,
}

#[derive(Debug)]
struct LayerBack {
    drawn: Rect,
    over_seam: bool,
    light_alone: bool,
    presence: f32,
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
            depth: hide::Known::default(),
            radiance: None,
            readbacks: ReadbackSet::default(),
            may_be_rough: false,
        }
    }

    /// Replaces the scene. Compiled pipelines stay, so that this costs no more than uploading the scene.
    pub fn set_scene(&mut self, scene: Scene) {
        // Charts that are known hold for the same things in the same light.
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

    /// Real things take light from the floors from the next frame on, which virtual ones do not take a second time.
    pub fn stand_in(&mut self, room: Option<Arc<Room>>) {
        self.shadows.set_room(room);
    }

    /// Sets how bright the room's surfaces are where a frame shows them clipped. It holds from the next frame on.
    pub fn set_surface_radiance(&mut self, radiance: Option<Arc<LazyRadiance>>) {
        self.radiance = radiance;
    }

    pub fn gpu(&self) -> &Gpu {
        &self.recorder.gpu
    }

    /// Has the next frame's parts timed by the GPU, if it has a clock ([`Pending::times`]).
    pub fn time_next(&mut self) {
        self.recorder.time();
    }

    /// The next picture may come sooner: with shadows that are rough where they are not known yet, and hidden by the frame's own
    /// depth alone where its neighbours were not asked yet. All other pictures are what a new compositor would make.
    pub fn may_be_rough(&mut self) {
        self.may_be_rough = true;
    }

    /// Things that the scene asks for but that are not drawn.
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
        let may_be_rough = std::mem::take(&mut self.may_be_rough);
        if let Target::View(view, _) = target {
            let (size, pixels) = (view.texture().size(), &job.frame.pixels);
            let (view_px, picture_px) = ((size.width, size.height), (pixels.width, pixels.height));
            if view_px != picture_px {
                return Err(SubmitError::TargetSize { view_px, picture_px });
            }
        }
        let mut stats = FrameStats::of(&job);
        if let Err(reason) = job.track.at(job.frame.timestamp_s + job.time_offset_s) {
            stats.no_pose = Some(reason.to_string());
            return Ok(self.untouched(job, stats, target));
        }
        // A photograph is made even without any of it.
        if job.frame.presence <= 0.0 && !job.capture.whole {
            return Ok(self.untouched(job, stats, target));
        }
        let (shadow_maps, mut is_rough) = self.shaded(&settings.shadow, may_be_rough);
        let sight = Sight::new(&self.renderer, shadow_maps, &job, settings);
        let moment = moment(&job, camera, settings, &sight);
        let plan = Plan::new(self.gpu(), &job, camera, settings, &moment, &sight)?;
        stats.fastest_px_per_s = sight.footprint.fastest_px_per_s;
        stats.effects = plan.active.iter().map(|effect| effect.table()).collect();
        let Some(places) = &plan.places else { return Ok(self.untouched(job, stats, target)) };
        stats.objects_in_sight = !sight.footprint.rect.intersection(&job.capture.region).is_empty();
        let looked_at = places.looked_at;
        stats.rect_px = Some([looked_at.x0, looked_at.y0, looked_at.x1, looked_at.y1]);

        self.recorder.part("depth");
        self.depth.may_be_rough = may_be_rough;
        self.depth.proxies = self.proxies();
        let hidden = Hidden::new(&mut self.recorder, &mut self.depth, &job, settings, &sight, &plan, &moment);
        stats.no_occlusion = hidden.nothing_because.clone();
        is_rough |= hidden.is_rough;
        let tolerance_m = settings.depth.tolerance_m;
        let view = View {
            geometry: job.picture,
            keys: &sight.keys,
            shutter: sight.shutter,
            depths_m: sight.footprint.depths_m,
            rect: places.drawn,
            occlusion: hidden.first.as_ref().map(|(depth, grid_placement)| Occlusion {
                depth,
                grid_placement: *grid_placement,
                tolerance_m,
                moments: job.real.moments(),
            }),
            parallel_to_m: None,
            outer: None,
        };
        self.recorder.part("shadow");
        let asked = shade::Asked {
            geometry: job.picture,
            keys: &sight.keys,
            shutter: sight.shutter,
            part: places.shaded,
            depth: hidden.real.as_ref().map(|(depth, rect)| (depth, *rect)),
            matte: hidden.matte.as_ref().map(|(matte, rect)| (matte, *rect)),
            settings: &settings.shadow,
            presence: job.frame.presence,
        };
        let shaded = shade::shade(&mut self.recorder, &sight.shades, &asked);
        let pose_at = |offset_s| sight.keys.pose_at(offset_s);
        let rays = self.depth.rays.of(job.picture);
        let known = self.radiance.as_deref().zip(hidden.repaired.as_ref()).zip(job.frame.exposure.seen);
        let known = known.map(|((radiance, (repaired, rect)), brightness)| KnownRadiance {
            radiance,
            depth_m: (&repaired.depth_m, *rect),
            rays,
            pose_at: &pose_at,
            brightness,
        });
        let camera_light = (&job.frame.pixels, &camera.response, job.picture);
        let shaded = shaded
            .map(|shaded| clipped::bounded(&mut self.recorder, shaded, places.shaded, camera_light, known.as_ref()));
        let shade = shaded.as_ref().map(|shaded| &shaded.texture);
        self.recorder.part("objects");
        let mut layer = self.renderer.draw(&mut self.recorder, &view, &plan.samples);
        layer.real = plan.surfaces.map(|surfaces| {
            // What is hidden moment by moment is hidden already.
            let hides = settings.depth.occlusion && job.real.moments().is_empty();
            let tolerance_m = hides.then_some(tolerance_m);
            let pixels = &job.frame.pixels;
            real::real_layer(&mut self.recorder, pixels, surfaces, places.drawn, tolerance_m, &camera.response, shade)
        });
        let mut run = LayerRun {
            recorder: &mut self.recorder,
            moment: &moment,
            drawn: places.drawn,
            objects_px: places.objects_px,
            geometry_is_read: true,
        };
        let layer = affect(&mut run, layer, &plan, &hidden, job.want_layer, tolerance_m);

        run.recorder.part("mix");
        let sent = match target {
            Target::Pixels => looked_at_by(&places.pieces, &job.frame),
            Target::View(..) => whole(&job.frame),
        };
        let sent: Vec<_> = sent.into_iter().map(|rect| Sent::new(run.recorder, &job.frame.pixels, rect)).collect();
        // What acts on real pixels, and what lies across a seam, changes the picture anywhere.
        let parts = sight.footprint.parts.iter().map(|(rect, _)| rect.grown(places.spread_px));
        let parts = parts.chain(shaded.iter().flat_map(|shaded| shaded.pieces.iter().copied()));
        let is_whole = job.capture.whole || layer.real.is_some() || job.picture.is_round() || places.pieces.len() > 1;
        let mut work = Work::default();
        let changed: Vec<Rect> =
            if is_whole { places.pieces.iter().map(|piece| piece.shown).collect() } else { parts.collect() };
        for (i, piece) in places.pieces.iter().enumerate() {
            let parts: Vec<_> = plan.active.iter().filter_map(|effect| effect.mix(&mut run, piece.shown)).collect();
            let sent = sent.get(i).unwrap_or(&sent[0]);
            let made = mix(run.recorder, camera, &job, sent, (&layer, shade), (piece, &changed), parts);
            match target {
                Target::Pixels => {
                    let size = (piece.shown.width(), piece.shown.height());
                    work.codes.push((*piece, run.recorder.read_back(&mut self.readbacks, &made, size)));
                }
                Target::View(..) => sent.put(run.recorder, &made, piece.shown),
            }
        }
        if let (Target::View(view, format), Some(sent)) = (target, sent.first()) {
            sent.show(run.recorder, view, format);
        }
        let first = places.pieces[0];
        work.layer = job.want_layer.then(|| LayerBack {
            drawn: first.drawn,
            over_seam: places.pieces.len() > 1,
            light_alone: layer.light_alone,
            presence: job.frame.presence as f32,
            parts: [&layer.color, &layer.geometry].map(|t| run.recorder.read_back(&mut self.readbacks, t, layer.size)),
            fringe: layer.fringe.as_ref().map(|t| run.recorder.read_back(&mut self.readbacks, t, layer.size)),
            shaded: first.shaded,
            response: camera.response.clone(),
            shade: shade.map(|t| {
                let size = (places.shaded.width(), places.shaded.height());
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
            is_rough,
        })
    }

    /// Works out, before frames come that wait for nobody, what things take of the floors' light and of each other's.
    pub fn prepare(&mut self, settings: &Settings) {
        self.shaded(&settings.shadow, false);
    }

    /// What things take of the floors' light, and whether any of it is rough. The renderer is told what they take of each other's.
    fn shaded(&mut self, settings: &Shade, may_be_rough: bool) -> (Vec<ShadowMap>, bool) {
        let (gpu, strength) = (&self.recorder.gpu, settings.strength);
        if !settings.cast || strength <= 0.0 {
            self.renderer.set_lightmaps(gpu, &[], strength);
            return (Vec::new(), false);
        }
        let requested = if may_be_rough { Quality::Preview } else { Quality::Final };
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
                // Planes beside objects reflect nothing onto them.
                let floors = shadow_maps.iter().filter(|shadow_map| !shadow_map.is_beside);
                let floors: Vec<ShadowMap> = floors.cloned().collect();
                self.lightmaps.lightmaps(self.renderer.scene(), self.renderer.unwrapped(), &floors, &visibility)
            }
        };
        self.renderer.set_lightmaps(gpu, &lightmaps, strength);
        (shadow_maps, quality.is_preview())
    }

    /// Passes a frame through to which nothing is added.
    fn untouched(&mut self, job: Job<'_>, stats: FrameStats, target: Target<'_>) -> Pending {
        let mut last = None;
        if let Target::View(view, format) = target {
            let pixels = &job.frame.pixels;
            let sent = Sent::new(&self.recorder, pixels, Rect::full(pixels.width, pixels.height));
            self.recorder.part("mix");
            sent.show(&mut self.recorder, view, format);
            last = Some(self.recorder.submit());
        }
        let timed = self.recorder.timed();
        let (frame, want_layer) = (job.frame, job.want_layer);
        Pending { frame, stats, want_layer, work: None, parts: Vec::new(), last, timed, is_rough: false }
    }

    /// Whether [`Compositor::collect`] would return without waiting.
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

    /// Waits for the parts of a frame that takes long, and calls `done` with the finished share after each.
    /// [`Compositor::collect`] waits for the last.
    pub fn await_parts(&self, pending: &Pending, mut done: impl FnMut(f64)) -> Result<(), GpuError> {
        for (n, part) in pending.parts.iter().enumerate() {
            self.gpu().wait(Some(part.clone()))?;
            done((n + 1) as f64 / (pending.parts.len() + 1) as f64);
        }
        Ok(())
    }

    /// Waits for a frame and returns its picture: the camera's pixels, and within the rectangle what came back from the
    /// GPU.
    pub fn collect(&mut self, pending: Pending) -> Result<Composited, GpuError> {
        let Pending { frame, stats, want_layer, work, .. } = pending;
        let index = frame.index;
        let mut pixels = frame.pixels;
        let mut layer = want_layer.then(|| LayerImage::empty(pixels.width, pixels.height));
        let Work { codes, layer: back } = work.unwrap_or_default();
        let camera = back.is_some().then(|| pixels.clone());
        for (piece, codes) in codes {
            paste(self.gpu(), &codes, piece.shown, &mut pixels)?;
            self.readbacks.give_back(codes);
        }
        if let (Some(image), Some(back)) = (&mut layer, back) {
            let LayerBack { drawn, over_seam, light_alone, presence, parts: [color, geometry], .. } = back;
            image.light_alone = light_alone;
            paste_layer(self.gpu(), [&color, &geometry], drawn, over_seam, image)?;
            image.fade(presence);
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

/// The part of the camera's picture that each piece reads: one more pixel on each side, for effects that read
/// neighbours.
fn looked_at_by(pieces: &[Piece], frame: &Frame) -> Vec<Rect> {
    let picture = Rect::full(frame.pixels.width, frame.pixels.height);
    pieces.iter().map(|piece| piece.shown.grown(1).intersection(&picture)).collect()
}

fn whole(frame: &Frame) -> Vec<Rect> {
    vec![Rect::full(frame.pixels.width, frame.pixels.height)]
}

/// Runs the effects over the layer, in order, and cuts off blurred parts that real things hide.
fn affect(
    run: &mut LayerRun<'_>,
    mut layer: Layer,
    plan: &Plan<'_>,
    hidden: &Hidden,
    want_layer: bool,
    tolerance_m: f32,
) -> Layer {
    let (after, before) = hidden.then.as_ref().map_or((0, None), |(after, before)| (*after, Some(before)));
    let cut = |run: &mut LayerRun<'_>, layer: Layer, done: usize| match before.filter(|_| after == done) {
        Some(before) => behind_real::cut(run.recorder, layer, before, tolerance_m),
        None => layer,
    };
    layer = cut(run, layer, 0);
    for (n, effect) in plan.active.iter().enumerate() {
        let later = &plan.active[n + 1..];
        run.geometry_is_read = want_layer || after > n || later.iter().any(|effect| effect.reads_geometry());
        run.recorder.part(effect.table());
        layer = effect.run(run, layer);
        layer = cut(run, layer, n + 1);
    }
    layer
}
