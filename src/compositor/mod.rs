//! Composites frames: the picture is a pure function of a frame, the poses around it, the scene,
//! the camera and the settings.
//!
//! [`Compositor::submit`] plans a frame (plan.rs) and runs its stages (stages.rs):
//!
//! planar shadows and lightmaps (shadow/) → depth (occlusion.rs) → shadow mask (shadow_mask.rs) →
//! draw (render/) → effects (effects/) → mix (mix.rs).

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
mod shadow_mask;
mod stage_log;
mod stages;
mod work_rects;

use std::sync::Arc;

use crate::camera::Camera;
use crate::gpu::{Gpu, PassRecorder, ReadbackSet};
use crate::pixels::Rect;
use crate::quality::Quality;
use crate::render::{Lightmap, Renderer};
use crate::scene::{Object, Scene};
use crate::shadow::{LazyRadiance, Lightmaps, PlanarShadow, Room, Shadows};
use crate::stage::Stage;

pub use exposure_time::{ExposureSource, ExposureTime};
pub use frame_stream::{FrameStream, FrameStreamError, IN_FLIGHT, StreamFrame, StreamInputs};
pub use job::{Composited, FrameStats, Job, RealDepth, SubmitError, Target};
pub use mix::mixed_module;
pub use occlusion::project_rolling;
pub use pending::Pending;
pub use plan::poses_within_s;
pub use settings::{DepthSettings, ON, Settings, SettingsError, ShadowSettings, current_name};

use frame_inputs::FrameInputs;
use mix::CameraUpload;
use pending::FrameReadbacks;
use plan::{FrameView, Plan, frame_context};
use retained::StageMemos;
use stage_log::StageLog;

/// Draws a scene into frames. Final frames are those of a new compositor: the state between them is
/// memoized. Previews may reuse earlier results.
#[derive(Debug)]
pub struct Compositor {
    renderer: Renderer,
    shadows: Shadows,
    lightmaps: Lightmaps,
    recorder: PassRecorder,
    depth: occlusion::DepthMemos,
    radiance: Option<Arc<LazyRadiance>>,
    readbacks: ReadbackSet,
    /// Quality of the next frame.
    requested: Quality,
    retained: StageMemos,
}

impl Compositor {
    pub fn new(gpu: Gpu, scene: Scene) -> Self {
        let shadows = Shadows::new(&scene);
        Self {
            lightmaps: Lightmaps::new(&scene, shadows.environment()),
            shadows,
            renderer: Renderer::new(&gpu, scene),
            recorder: PassRecorder::new(gpu),
            depth: occlusion::DepthMemos::default(),
            radiance: None,
            readbacks: ReadbackSet::default(),
            requested: Quality::Final,
            retained: StageMemos::default(),
        }
    }

    /// Replaces the scene. Compiled pipelines stay: the cost is that of the upload.
    pub fn set_scene(&mut self, scene: Scene) {
        // Planar shadows and lightmaps stay valid for the same geometry under the same lights.
        let before = self.renderer.scene();
        if !before.has_same_resources(&scene) {
            self.shadows = Shadows::new(&scene);
            self.lightmaps = Lightmaps::new(&scene, self.shadows.environment());
        } else if before.lighting != scene.lighting {
            self.shadows.set_lighting(&scene);
            self.lightmaps.set_lighting(&scene, self.shadows.environment());
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

    /// Sets the real room. From the next frame on, real surfaces block light on its way to receiver
    /// planes, so that virtual objects do not block the same light again.
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
        let (planar_shadows, quality) = self.update_shadows(&settings.shadow, requested, &mut log);
        let frame_view = FrameView::new(&self.renderer, planar_shadows, &job, settings);
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
        let shadow_mask = self.shadow_mask(&inputs, &occlusion, &mut log);
        let drawn = self.draw(&inputs, &occlusion, shadow_mask.as_ref(), &mut log);
        let layer = self.apply_effects(&inputs, &occlusion, drawn, &mut log);
        let readbacks = self.mix(&inputs, &layer, shadow_mask.as_ref(), target, &mut log);

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

    /// Computes planar shadows and lightmaps ahead of the first frame.
    pub fn prepare(&mut self, settings: &Settings) {
        self.update_shadows(&settings.shadow, Quality::Final, &mut StageLog::default());
    }

    /// Runs the stages [`Stage::PlanarShadows`] and [`Stage::Lightmaps`] unless their results are
    /// memoized. Returns the planar shadows, and the lower quality of the
    /// two. Lightmaps go to the renderer.
    fn update_shadows(
        &mut self,
        settings: &ShadowSettings,
        requested: Quality,
        log: &mut StageLog,
    ) -> (Vec<PlanarShadow>, Quality) {
        let before = self.shadow_runs();
        // With strength 0 they are computed too, so that a change of strength repeats no stage
        // before the shadow mask.
        let (planar_shadows, lightmaps, quality) = if settings.cast {
            self.planar_shadows_and_lightmaps(settings, requested)
        } else {
            (Vec::new(), Vec::new(), Quality::Final)
        };
        let runs = before.into_iter().zip(self.shadow_runs());
        runs.filter(|(before, after)| before != after).for_each(|((stage, _), _)| log.run_always(stage));
        let drawn = if settings.strength > 0.0 { &lightmaps[..] } else { &[] };
        self.renderer.set_lightmaps(&self.recorder.gpu, drawn, settings.strength);
        (planar_shadows, quality)
    }

    /// Number of computations of planar shadows and of lightmaps since the light was set.
    fn shadow_runs(&self) -> [(Stage, u64); 2] {
        let lightmap_runs = self.shadows.visibility_runs() + self.lightmaps.runs();
        [(Stage::PlanarShadows, self.shadows.runs()), (Stage::Lightmaps, lightmap_runs)]
    }

    fn planar_shadows_and_lightmaps(
        &mut self,
        settings: &ShadowSettings,
        requested: Quality,
    ) -> (Vec<PlanarShadow>, Vec<Option<Arc<Lightmap>>>, Quality) {
        let (planar_shadows, quality) = self.shadows.planar_shadows(self.renderer.scene(), requested);
        if !settings.on_evidence {
            let lightmaps = self.shadows.light_visibility(self.renderer.scene());
            return (planar_shadows, lightmaps, quality);
        }
        if requested.is_preview() {
            let (lightmaps, of_lightmaps) = self.lightmaps.preview(self.renderer.scene());
            return (planar_shadows, lightmaps, quality.min(of_lightmaps));
        }
        self.renderer.unwrap(&self.recorder.gpu);
        let visibility = self.shadows.light_visibility(self.renderer.scene());
        // Receiver planes beside the support reflect no light onto objects.
        let floors = planar_shadows.iter().filter(|planar_shadow| !planar_shadow.is_beside);
        let floors: Vec<PlanarShadow> = floors.cloned().collect();
        let (scene, unwrapped) = (self.renderer.scene(), self.renderer.unwrapped());
        let lightmaps = self.lightmaps.lightmaps(scene, unwrapped, &floors, &visibility);
        (planar_shadows, lightmaps, quality)
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
