//! The plan of a frame: objects in view, active effects, and the rectangles of work.

use glam::{DVec2, DVec3};

use super::shadow_mask::{VisibleShadow, union_of_rects, visible_shadows};
use super::work_rects::{WorkRects, WorkRequest};
use super::{Compositor, ExposureTime, FrameStats, Job, RealDepth, Settings, SubmitError};
use crate::camera::{Camera, Geometry};
use crate::coding::PictureCoding;
use crate::depth::{DepthGrid, Proxies, Surfaces};
use crate::effects::{Effect, ExampleNoise, FrameContext, ObjectMotion, OnReal, Reach};
use crate::example_noise::model_coding::CodingDifference;
use crate::example_noise::persistence::MAX_PERSISTENCE_FRAMES;
use crate::example_noise::source_picture::{PictureMismatch, SourcePicture};
use crate::frame::Frame;
use crate::gpu::{Gpu, TexturePool};
use crate::pixels::Rect;
use crate::plane::Plane;
use crate::pose::Pose;
use crate::render::{Footprint, Renderer, SamplePlan, Shutter, ViewKeys, largest_sum_px};
use crate::scene::Scene;
use crate::shadow::PlanarShadow;

/// Largest motion of an object at rest, px.
const MAX_REST_PX: f64 = 0.5;

/// The parts of the scene in view while the shutter is open.
#[derive(Debug)]
pub struct FrameView {
    pub shutter: Shutter,
    pub keys: ViewKeys,
    pub footprint: Footprint,
    pub objects: Vec<ObjectMotion>,
    /// Number of frames before this one in which the objects are at rest.
    pub resting_frames: usize,
    /// Planar shadows in the picture.
    pub shadows: Vec<VisibleShadow>,
    /// Support planes of the objects.
    pub planes: Vec<Plane>,
}

impl FrameView {
    pub fn new(renderer: &Renderer, planar_shadows: Vec<PlanarShadow>, job: &Job<'_>, settings: &Settings) -> Self {
        let capture = &job.capture;
        let exposure_time_s = capture.exposure_time_s;
        let summed_to_s = capture.summed.iter().map(|f| f.time_s.abs() + 0.5 * (f.exposure_s - exposure_time_s));
        let summed_to_s = summed_to_s.fold(0.0, f64::max);
        let shutter = shutter(settings, exposure_time_s, job.picture.intrinsics.readout_time_s, summed_to_s);
        let time_s = job.frame.timestamp_s;
        let pose_at = |t: f64| job.track.at_or_nearest(t).unwrap_or(Pose::IDENTITY);
        let keys = ViewKeys::new(shutter, |offset_s| pose_at(time_s + offset_s));
        let footprint = renderer.footprint(job.picture, &keys, shutter);
        let centres = renderer.object_centres();
        let objects = motions(&centres, job.picture, &keys.middle(), &pose_at(time_s + job.interval_s));
        let shadows = visible_shadows(planar_shadows, job.picture, &keys);
        let planes = support_planes(renderer.scene());
        let resting_frames = resting_frames(&centres, job, &keys.middle());
        Self { shutter, keys, footprint, objects, resting_frames, shadows, planes }
    }
}

impl Compositor {
    /// Triangles of the proxy models of real objects, in the world.
    pub fn proxies(&self) -> Proxies {
        let scene = self.renderer.scene();
        let real = scene.objects.iter().filter(|object| object.occluder);
        let corners: Vec<DVec3> = real.flat_map(|object| object.points_m(scene)).collect();
        Proxies { triangles: corners.as_chunks().0.to_vec() }
    }

    /// The support planes of the scene's objects.
    pub fn support_planes(&self) -> Vec<Plane> {
        support_planes(self.renderer.scene())
    }
}

/// The distinct support planes of a scene's objects.
pub fn support_planes(scene: &Scene) -> Vec<Plane> {
    let mut planes: Vec<Plane> = Vec::new();
    for support in scene.objects.iter().filter_map(|object| object.support) {
        let plane = support.normal.try_normalize().map(|normal| Plane { normal, ..support });
        planes.extend(plane.filter(|plane| !planes.contains(plane)));
    }
    planes
}

fn shutter(settings: &Settings, exposure_time_s: f64, readout_time_s: f64, summed_to_s: f64) -> Shutter {
    let planned_s = settings.on().map(|effect| effect.beyond_s(exposure_time_s));
    Shutter { exposure_time_s, readout_time_s, beyond_s: planned_s.fold(summed_to_s, f64::max) }
}

/// Time before and after a frame within which poses affect its picture, s.
pub fn poses_within_s(
    frame: &Frame,
    camera: &Camera,
    settings: &Settings,
    geometry: &Geometry,
    interval_s: f64,
) -> (f64, f64) {
    let exposure = ExposureTime::of_frame(camera, settings, &frame.exposure, interval_s);
    let reach_s = shutter(settings, exposure.s, geometry.intrinsics.readout_time_s, 0.0).reach_s();
    let reads_next = settings.on().any(|effect| effect.reads_next_pose());
    (reach_s, if reads_next { reach_s.max(interval_s) } else { reach_s })
}

/// Displacement of a point of the world in the picture between two poses, px; 0 if it is not in
/// view.
fn displacement_px(geometry: &Geometry, centre: Option<DVec3>, from: &Pose, to: &Pose) -> DVec2 {
    let project = |pose: &Pose, point| geometry.project(pose.transform_point(point));
    let displacement = centre.and_then(|c| Some(geometry.displacement_px(project(from, c)?, project(to, c)?)));
    displacement.unwrap_or_default()
}

/// Motion of each object's centre across the picture until the next frame.
fn motions(centres: &[Option<DVec3>], geometry: &Geometry, now: &Pose, next: &Pose) -> Vec<ObjectMotion> {
    let motion = |centre: &Option<DVec3>| ObjectMotion {
        per_frame_px: displacement_px(geometry, *centre, now, next).as_vec2().to_array(),
    };
    centres.iter().map(motion).collect()
}

/// Number of preceding frames without motion: all objects' centres project to within half a pixel
/// of their places in this frame. Counted as far as noise may persist.
fn resting_frames(centres: &[Option<DVec3>], job: &Job<'_>, now: &Pose) -> usize {
    let is_at_rest = |frames: &usize| {
        let earlier = job.track.at(job.frame.timestamp_s - *frames as f64 * job.interval_s);
        earlier.is_ok_and(|earlier| {
            centres.iter().all(|centre| displacement_px(job.picture, *centre, now, &earlier).length() < MAX_REST_PX)
        })
    };
    (1..MAX_PERSISTENCE_FRAMES).take_while(is_at_rest).count()
}

/// The inputs of effects.
pub fn frame_context<'a>(
    job: &'a Job<'_>,
    camera: &'a Camera,
    settings: &Settings,
    frame_view: &'a FrameView,
) -> FrameContext<'a> {
    let real_depths_m = job.real.surfaces().map(Surfaces::range_m);
    let footprint = &frame_view.footprint;
    FrameContext {
        camera,
        picture: job.picture,
        capture: &job.capture,
        frame: job.frame.index,
        seed: settings.seed,
        coding: job.frame.pixels.coding.as_deref(),
        max_code: job.frame.pixels.max_code(),
        recorded: job.frame.exposure,
        interval_s: job.interval_s,
        resting_frames: frame_view.resting_frames,
        fastest_px_per_s: footprint.fastest_px_per_s,
        // Without objects, the depths are those of the real part.
        depths_m: real_depths_m.filter(|_| footprint.rect.is_empty()).unwrap_or(footprint.depths_m),
        real_depths_m,
        objects: &frame_view.objects,
    }
}

impl<'a> RealDepth<'a> {
    pub fn surfaces(&self) -> Option<&'a Surfaces> {
        match self {
            Self::OfFrame => None,
            Self::Known { surfaces, .. } => *surfaces,
        }
    }

    /// The depth of each of the frames that the picture sums.
    pub fn moments(&self) -> &'a [(f64, DepthGrid)] {
        match self {
            Self::OfFrame => &[],
            Self::Known { moments, .. } => moments,
        }
    }
}

/// The active effects of a frame, the samples to draw and the rectangles of work.
#[derive(Debug)]
pub struct Plan<'a> {
    /// The effects that are not neutral, in order.
    pub active: Vec<&'a dyn Effect>,
    pub samples: SamplePlan,
    /// The coding that changed pixels follow. `None`: they are rounded to codes.
    pub coding: Option<PictureCoding>,
    /// Noise by example, if it is drawn.
    pub noise: Option<ExampleNoise>,
    /// Why noise by example is replaced by the pattern.
    pub no_example_noise: Option<CodingDifference>,
    /// The frame's mismatch with the pictures of the noise by example that is drawn.
    pub example_mismatch: Option<PictureMismatch>,
    /// Surfaces of the real part, if an effect acts on it.
    pub surfaces: Option<&'a Surfaces>,
    /// `None` if the frame does not change.
    pub work_rects: Option<WorkRects>,
}

impl<'a> Plan<'a> {
    pub fn new(
        gpu: &Gpu,
        job: &Job<'a>,
        camera: &Camera,
        settings: &'a Settings,
        context: &FrameContext<'_>,
        frame_view: &FrameView,
    ) -> Result<Self, SubmitError> {
        let active = settings.active(context);
        for effect in &active {
            effect.check(camera, job.picture)?;
        }
        let acts = active.iter().any(|effect| effect.on_real().acts());
        let surfaces = job.real.surfaces().filter(|_| acts);
        let picture = Rect::full(job.frame.pixels.width, job.frame.pixels.height);
        let total = |px: fn(Reach) -> f32| {
            let sum: f32 = active.iter().map(|effect| px(effect.reach(context))).sum();
            (sum.ceil() as i32).saturating_add(1)
        };
        let work_rects = WorkRects::of(&WorkRequest {
            region: job.capture.region.intersection(&picture),
            footprint: frame_view.footprint.rect,
            shadowed: union_of_rects(&frame_view.shadows),
            reach_px: total(|reach| reach.read_px),
            spread_px: total(|reach| reach.spread_px),
            is_equirectangular: job.picture.is_equirectangular(),
            is_whole: job.capture.whole,
            acts_on_real: surfaces.is_some(),
        });
        let samples = match work_rects {
            Some(_) => active.iter().fold(SamplePlan::single(), |samples, effect| effect.plan(context, samples)),
            None => SamplePlan::single(),
        };
        let coding = active.iter().find_map(|effect| effect.coding(context));
        let noise: Result<Vec<_>, _> =
            active.iter().map(|effect| effect.example_noise(context, coding.as_ref())).collect();
        let (noise, no_example_noise) = match noise {
            Ok(noise) => (noise.into_iter().flatten().next(), None),
            Err(difference) => (None, Some(difference)),
        };
        let example_mismatch = noise.as_ref().and_then(|_| example_mismatch(job, context.camera, coding.as_ref()));
        let plan = Self { active, samples, coding, noise, no_example_noise, example_mismatch, surfaces, work_rects };
        plan.check_size(gpu, context)?;
        Ok(plan)
    }

    fn check_size(&self, gpu: &Gpu, context: &FrameContext<'_>) -> Result<(), SubmitError> {
        let Some(drawn) = self.work_rects.as_ref().map(|rects| rects.drawn) else { return Ok(()) };
        let [side_px, mut area_px] = [TexturePool::max_side_px(gpu), TexturePool::max_area_px(gpu)];
        if self.samples.samples.len() > 1 {
            area_px = area_px.min(largest_sum_px(gpu));
        }
        let (width_px, height_px) = (drawn.width(), drawn.height());
        if width_px.max(height_px) > side_px || u64::from(width_px) * u64::from(height_px) > u64::from(area_px) {
            let reach = |effect: &&dyn Effect| effect.reach(context).read_px;
            let widest = self.active.iter().copied().max_by(|a, b| reach(a).total_cmp(&reach(b)));
            let widest = widest.filter(|effect| reach(effect) >= 1.0).map(|effect| effect.table());
            return Err(SubmitError::TooLarge { width_px, height_px, side_px, area_px, widest });
        }
        Ok(())
    }

    /// Whether an effect occludes virtual objects by real ones itself, which replaces the depth
    /// test.
    pub fn effect_occludes(&self) -> bool {
        self.surfaces.is_some() && self.active.iter().any(|effect| effect.on_real() == OnReal::ActsAndOccludes)
    }
}

/// The mismatch of a frame with the pictures of the camera's noise by example. A parametric field
/// holds no pictures, so that the model of which it is derived counts.
fn example_mismatch(job: &Job<'_>, camera: &Camera, coding: Option<&PictureCoding>) -> Option<PictureMismatch> {
    let example = camera.noise.as_ref()?.example.as_ref()?;
    let size_px = [job.frame.pixels.width as usize, job.frame.pixels.height as usize];
    let picture = SourcePicture::new(size_px, coding.unwrap_or(&PictureCoding::UNROUNDED));
    example.model.mismatch(picture)
}

impl FrameStats {
    /// Adds the results of the frame's plan.
    pub(super) fn add_plan(&mut self, job: &Job<'_>, view: &FrameView, plan: &Plan<'_>) {
        self.fastest_px_per_s = view.footprint.fastest_px_per_s;
        self.effects = plan.active.iter().map(|effect| effect.table()).collect();
        let Some(work_rects) = &plan.work_rects else { return };
        self.no_example_noise = plan.no_example_noise.map(|difference| difference.to_string());
        self.example_mismatch = plan.example_mismatch.map(|mismatch| mismatch.to_string());
        self.objects_in_sight = !view.footprint.rect.intersection(&job.capture.region).is_empty();
        let bounds = work_rects.bounds;
        self.rect_px = Some([bounds.x0, bounds.y0, bounds.x1, bounds.y1]);
    }
}
