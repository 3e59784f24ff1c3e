//! Composites frames: the picture is a pure function of a frame, the poses around it, the scene,
//! the camera and the settings.
//!
//! [`Compositor::submit`] plans a frame (plan.rs) and runs its stages (stages.rs):
//!
//! shadow maps and lightmaps (shadow/) → depth (occlusion.rs) → shade (shade.rs) → draw (render/) →
//! effects (effects/) → mix (mix.rs).

mod clipped;
mod coded;
mod dirty_tiles;
mod example_noise;
mod exposure_time;
mod foreground_matte;
mod frame_inputs;
mod frame_stream;
mod job;
mod mix;
mod occlusion;
mod paste;
mod pending;
mod plan;
mod ray_grid;
mod real;
mod retained;
mod rgba;
mod settings;
mod shade;
mod stage_log;
mod stages;
mod work_rects;

use std::sync::Arc;

use crate::camera::Camera;
use crate::gpu::{Gpu, ReadbackSet, Recorder};
use crate::pixels::Rect;
use crate::quality::Quality;
use crate::render::{Lightmap, Renderer};
use crate::scene::{Object, Scene};
use crate::shadow::{LazyRadiance, Lightmaps, Room, ShadowMap, Shadows};
use crate::stage::Stage;

pub use exposure_time::{ExposureSource, ExposureTime};
pub use frame_stream::{FrameStream, FrameStreamError, IN_FLIGHT, StreamFrame, StreamInputs};
pub use job::{Composited, FrameStats, Job, RealDepth, SubmitError, Target};
pub use mix::mixed_module;
pub use occlusion::project_rolling;
pub use pending::Pending;
pub use plan::poses_within_s;
pub use settings::{DepthSettings, ON, Settings, SettingsError, ShadowSettings};

use frame_inputs::FrameInputs;
use mix::CameraUpload;
use pending::FrameReadbacks;
use plan::{FrameView, Plan, frame_context};
use retained::{LightmapsKey, ShadowMapsKey, StageMemos};
use stage_log::StageLog;

/// Draws a scene into frames. Final frames are those of a new compositor: the state between them is
/// memoized. Previews may reuse earlier results.
#[derive(Debug)]
pub struct Compositor {
    renderer: Renderer,
    shadows: Shadows,
    lightmaps: Lightmaps,
    recorder: Recorder,
    depth: occlusion::DepthMemos,
    radiance: Option<Arc<LazyRadiance>>,
    readbacks: ReadbackSet,
    /// Quality of the next frame.
    requested: Quality,
    retained: StageMemos,
}

impl Compositor {
    pub fn new(gpu: Gpu, scene: Scene) -> Self {
        Self {
            shadows: Shadows::new(&scene),
            lightmaps: Lightmaps::new(&scene),
            renderer: Renderer::new(&gpu, scene),
            recorder: Recorder::new(gpu),
            depth: occlusion::DepthMemos::default(),
            radiance: None,
            readbacks: ReadbackSet::default(),
            requested: Quality::Final,
            retained: StageMemos::default(),
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
        self.requested = Quality::Preview;
    }

    /// Drops the retained results of shown frames. To be called after a frame whose submission or
    /// work on the GPU failed: its results were recorded, and may never have been computed.
    pub fn forget_results(&mut self) {
        self.retained = StageMemos::default();
    }

    /// Features of the scene that are not drawn.
    pub fn warnings(&self) -> Vec<String> {
        self.renderer.warnings()
    }

    /// Starts a frame's work. Frames may be started before earlier ones are collected.
    ///
    /// A frame that is shown ([`Target::View`]) retains the results of its stages. If it is shown
    /// again, the stages whose inputs are the same are not repeated ([`Pending::stages`]).
    pub fn submit(
        &mut self,
        job: Job<'_>,
        camera: &Camera,
        settings: &Settings,
        target: Target<'_>,
    ) -> Result<Pending, SubmitError> {
        let requested = std::mem::take(&mut self.requested);
        target.check_size(&job.frame)?;
        let mut stats = FrameStats::of(&job);
        // A photograph is composited even if the layer is invisible.
        let is_invisible = job.frame.opacity <= 0.0 && !job.capture.whole;
        if stats.no_pose.is_some() || is_invisible {
            return Ok(self.pass_through(job, stats, target));
        }
        let is_retained = matches!(target, Target::View(..)) && matches!(job.real, RealDepth::OfFrame);
        let mut log = StageLog::default();
        let (shadow_maps, quality) = self.update_shadows(&settings.shadow, requested, is_retained, &mut log);
        let frame_view = FrameView::new(&self.renderer, shadow_maps, &job, settings);
        let context = frame_context(&job, camera, settings, &frame_view);
        let plan = Plan::new(self.gpu(), &job, camera, settings, &context, &frame_view)?;
        stats.add_plan(&job, &frame_view, &plan);
        let Some(work_rects) = &plan.work_rects else { return Ok(self.pass_through(job, stats, target)) };
        let proxies = self.proxies();
        let inputs = FrameInputs {
            job: &job,
            camera,
            settings,
            view: &frame_view,
            context: &context,
            plan: &plan,
            work_rects,
            proxies: &proxies,
            requested,
            is_retained,
        };

        let occlusion = self.occlusion(&inputs, &mut log);
        let shade = self.shade(&inputs, &occlusion, &mut log);
        let drawn = self.draw(&inputs, &occlusion, shade.as_ref(), &mut log);
        let layer = self.apply_effects(&inputs, &occlusion, drawn, &mut log);
        let readbacks = self.mix(&inputs, &layer, shade.as_ref(), target, &mut log);

        stats.no_occlusion = occlusion.failure;
        let is_preview = quality.is_preview() || occlusion.is_preview;
        Ok(self.finish(job, stats, readbacks, is_preview, log))
    }

    /// Submits the recorded work of a frame.
    fn finish(
        &mut self,
        job: Job<'_>,
        stats: FrameStats,
        mut readbacks: FrameReadbacks,
        is_preview: bool,
        log: StageLog,
    ) -> Pending {
        let submission = self.recorder.submit();
        readbacks.submitted(&submission);
        Pending {
            frame: job.frame,
            stats,
            want_layer: job.want_layer,
            readbacks: Some(readbacks),
            timed: self.recorder.timed(),
            parts: self.recorder.parts(),
            last: Some(submission),
            is_preview,
            stages: log.into_stages(),
        }
    }

    /// Computes shadow maps and lightmaps ahead of the first frame.
    pub fn prepare(&mut self, settings: &Settings) {
        self.update_shadows(&settings.shadow, Quality::Final, false, &mut StageLog::default());
    }

    /// The stages [`Stage::ShadowMaps`] and [`Stage::Lightmaps`], which are memoized for the whole
    /// process. Returns the shadow maps, and the lower quality of the two. Lightmaps go to the
    /// renderer.
    fn update_shadows(
        &mut self,
        settings: &ShadowSettings,
        requested: Quality,
        is_retained: bool,
        log: &mut StageLog,
    ) -> (Vec<ShadowMap>, Quality) {
        let (shadow_maps, lightmaps, quality) = if settings.cast && settings.strength > 0.0 {
            self.shadow_maps_and_lightmaps(settings, requested)
        } else {
            (Vec::new(), Vec::new(), Quality::Final)
        };
        // Logged by results: a preview's depend on the memos' content, and so are no function of a
        // key.
        let key = is_retained.then(|| ShadowMapsKey::new(&shadow_maps));
        log.run(Stage::ShadowMaps, &self.retained.shadow_maps, key, || ());
        let key = is_retained.then(|| LightmapsKey::new(&lightmaps));
        log.run(Stage::Lightmaps, &self.retained.lightmaps, key, || ());
        self.renderer.set_lightmaps(&self.recorder.gpu, &lightmaps, settings.strength);
        (shadow_maps, quality)
    }

    fn shadow_maps_and_lightmaps(
        &mut self,
        settings: &ShadowSettings,
        requested: Quality,
    ) -> (Vec<ShadowMap>, Vec<Option<Arc<Lightmap>>>, Quality) {
        let (shadow_maps, quality) = self.shadows.shadow_maps(self.renderer.scene(), requested);
        if !settings.on_things {
            let lightmaps = self.shadows.light_visibility(self.renderer.scene());
            return (shadow_maps, lightmaps, quality);
        }
        if requested.is_preview() {
            let (lightmaps, of_lightmaps) = self.lightmaps.preview(self.renderer.scene());
            return (shadow_maps, lightmaps, quality.min(of_lightmaps));
        }
        self.renderer.unwrap(&self.recorder.gpu);
        let visibility = self.shadows.light_visibility(self.renderer.scene());
        // Receiver planes beside the support reflect no light onto objects.
        let floors = shadow_maps.iter().filter(|shadow_map| !shadow_map.is_beside);
        let floors: Vec<ShadowMap> = floors.cloned().collect();
        let (scene, unwrapped) = (self.renderer.scene(), self.renderer.unwrapped());
        let lightmaps = self.lightmaps.lightmaps(scene, unwrapped, &floors, &visibility);
        (shadow_maps, lightmaps, quality)
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
        let (frame, want_layer, is_preview) = (job.frame, job.want_layer, false);
        let (readbacks, parts, stages) = (None, Vec::new(), Vec::new());
        Pending { frame, stats, want_layer, readbacks, parts, last, timed, is_preview, stages }
    }
}
