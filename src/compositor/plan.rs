//! A frame's first phase: what is in view, which effects act, where work takes place.

use glam::DVec3;

use super::places::{Asked, Places};
use super::shade::{Seen, around, seen};
use super::{Compositor, Job, RealDepth, Settings, SubmitError, exposure_time_s};
use crate::camera::{Camera, Geometry};
use crate::depth::{DepthGrid, Plane, Proxies, Surfaces};
use crate::effects::{Effect, Moment, ObjectMotion, OnReal, Reach};
use crate::frame::Frame;
use crate::gpu::{Gpu, TexturePool};
use crate::pixels::Rect;
use crate::pose::Pose;
use crate::render::{Footprint, Renderer, SamplePlan, Shutter, ViewKeys, largest_sum_px};
use crate::scene::Scene;
use crate::shadow::ShadowMap;

/// The parts of the scene in view while the shutter is open.
#[derive(Debug)]
pub struct Sight {
    pub shutter: Shutter,
    pub keys: ViewKeys,
    pub footprint: Footprint,
    pub objects: Vec<ObjectMotion>,
    /// What they shade.
    pub shades: Vec<Seen>,
    /// What they stand on.
    pub planes: Vec<Plane>,
}

impl Sight {
    /// `shadow_maps`: those of the planes on which the objects stand.
    pub fn new(renderer: &Renderer, shadow_maps: Vec<ShadowMap>, job: &Job<'_>, settings: &Settings) -> Self {
        let capture = &job.capture;
        let exposure_time_s = capture.exposure_time_s;
        let summed_to_s = capture.summed.iter().map(|f| f.time_s.abs() + 0.5 * (f.exposure_s - exposure_time_s));
        let summed_to_s = summed_to_s.fold(0.0, f64::max);
        let shutter = shutter(settings, exposure_time_s, job.picture.intrinsics.readout_time_s, summed_to_s);
        let time_s = job.frame.timestamp_s + job.time_offset_s;
        let pose_at = |t: f64| job.track.at_or_nearest(t).unwrap_or(Pose::IDENTITY);
        let keys = ViewKeys::new(shutter, |offset_s| pose_at(time_s + offset_s));
        let footprint = renderer.footprint(job.picture, &keys, shutter);
        let objects = motions(renderer, job.picture, &keys.middle(), &pose_at(time_s + job.interval_s));
        let shades = seen(shadow_maps, job.picture, &keys);
        let planes = support_planes(renderer.scene());
        Self { shutter, keys, footprint, objects, shades, planes }
    }
}

impl Compositor {
    /// What stands in for real things, as it is placed.
    pub fn proxies(&self) -> Proxies {
        let scene = self.renderer.scene();
        let real = scene.objects.iter().filter(|object| object.occluder);
        let corners: Vec<DVec3> = real.flat_map(|object| object.points_m(scene)).collect();
        Proxies { triangles: corners.as_chunks().0.to_vec() }
    }

    /// The planes on which objects stand.
    pub fn support_planes(&self) -> Vec<Plane> {
        support_planes(self.renderer.scene())
    }
}

/// The planes on which a scene's objects stand, each once.
pub fn support_planes(scene: &Scene) -> Vec<Plane> {
    let mut planes: Vec<Plane> = Vec::new();
    for support in scene.objects.iter().filter_map(|object| object.support) {
        let plane = support.normal.try_normalize().map(|normal| Plane { point_m: support.point_m, normal });
        planes.extend(plane.filter(|plane| !planes.contains(plane)));
    }
    planes
}

fn shutter(settings: &Settings, exposure_time_s: f64, readout_time_s: f64, summed_to_s: f64) -> Shutter {
    let planned_s = settings.on().map(|effect| effect.beyond_s(exposure_time_s));
    Shutter { exposure_time_s, readout_time_s, beyond_s: planned_s.fold(summed_to_s, f64::max) }
}

/// How far before and after a frame's time poses decide on its picture, seconds. Poses beyond change nothing.
pub fn poses_within_s(
    frame: &Frame,
    camera: &Camera,
    settings: &Settings,
    geometry: &Geometry,
    interval_s: f64,
) -> (f64, f64) {
    let exposure_s = exposure_time_s(camera, settings, frame, interval_s);
    let reach_s = shutter(settings, exposure_s, geometry.intrinsics.readout_time_s, 0.0).reach_s();
    let looks_on = settings.on().any(|effect| effect.reads_next_pose());
    (reach_s, if looks_on { reach_s.max(interval_s) } else { reach_s })
}

/// How far each object's centre moves across the picture until the next frame.
fn motions(renderer: &Renderer, geometry: &Geometry, now: &Pose, next: &Pose) -> Vec<ObjectMotion> {
    let seen = |pose: &Pose, c| geometry.project(pose.transform_point(c));
    renderer
        .object_centres()
        .into_iter()
        .map(|centre| {
            let moved = centre.and_then(|c| Some(geometry.way_px(seen(now, c)?, seen(next, c)?)));
            moved.map_or(ObjectMotion::default(), |v| ObjectMotion { per_frame_px: v.as_vec2().to_array() })
        })
        .collect()
}

/// The moment: all that effects may know of a picture.
pub fn moment<'a>(job: &'a Job<'_>, camera: &'a Camera, settings: &Settings, sight: &'a Sight) -> Moment<'a> {
    let real_depths_m = job.real.surfaces().map(Surfaces::range_m);
    let footprint = &sight.footprint;
    Moment {
        camera,
        picture: job.picture,
        capture: &job.capture,
        frame: job.frame.index,
        seed: settings.seed,
        recorded: job.frame.exposure,
        interval_s: job.interval_s,
        fastest_px_per_s: footprint.fastest_px_per_s,
        // Without objects, the depths are those of the real part.
        depths_m: real_depths_m.filter(|_| footprint.rect.is_empty()).unwrap_or(footprint.depths_m),
        real_depths_m,
        objects: &sight.objects,
    }
}

impl<'a> RealDepth<'a> {
    pub fn surfaces(&self) -> Option<&'a Surfaces> {
        match self {
            Self::OfFrame => None,
            Self::Known { surfaces, .. } => *surfaces,
        }
    }

    /// What hides in each of the frames that the picture sums.
    pub fn moments(&self) -> &'a [(f64, DepthGrid)] {
        match self {
            Self::OfFrame => &[],
            Self::Known { moments, .. } => moments,
        }
    }
}

/// A frame's plan: what is to be done, and where.
#[derive(Debug)]
pub struct Plan<'a> {
    /// The effects that are not neutral, in order.
    pub active: Vec<&'a dyn Effect>,
    pub samples: SamplePlan,
    /// Only if an effect acts on them.
    pub surfaces: Option<&'a Surfaces>,
    /// `None` if there is nothing to do.
    pub places: Option<Places>,
}

impl<'a> Plan<'a> {
    pub fn new(
        gpu: &Gpu,
        job: &Job<'a>,
        camera: &Camera,
        settings: &'a Settings,
        moment: &Moment<'_>,
        sight: &Sight,
    ) -> Result<Self, SubmitError> {
        let active = settings.active(moment);
        for effect in &active {
            effect.check(camera, job.picture)?;
        }
        let acts = active.iter().any(|effect| effect.on_real().acts());
        let surfaces = job.real.surfaces().filter(|_| acts);
        let picture = Rect::full(job.frame.pixels.width, job.frame.pixels.height);
        let total = |px: fn(Reach) -> f32| {
            let sum: f32 = active.iter().map(|effect| px(effect.reach(moment))).sum();
            (sum.ceil() as i32).saturating_add(1)
        };
        let places = Places::of(&Asked {
            region: job.capture.region.intersection(&picture),
            footprint: sight.footprint.rect,
            shaded: around(&sight.shades),
            reach_px: total(|reach| reach.look_px),
            spread_px: total(|reach| reach.spread_px),
            round: job.picture.is_round(),
            whole: job.capture.whole,
            real_too: surfaces.is_some(),
        });
        let samples = match places {
            Some(_) => active.iter().fold(SamplePlan::single(), |samples, effect| effect.plan(moment, samples)),
            None => SamplePlan::single(),
        };
        let plan = Self { active, samples, surfaces, places };
        plan.check_size(gpu, moment)?;
        Ok(plan)
    }

    fn check_size(&self, gpu: &Gpu, moment: &Moment<'_>) -> Result<(), SubmitError> {
        let Some(drawn) = self.places.as_ref().map(|places| places.drawn) else { return Ok(()) };
        let [side_px, mut area_px] = [TexturePool::largest_side_px(gpu), TexturePool::largest_area_px(gpu)];
        if self.samples.samples.len() > 1 {
            area_px = area_px.min(largest_sum_px(gpu));
        }
        let (width_px, height_px) = (drawn.width(), drawn.height());
        if width_px.max(height_px) > side_px || u64::from(width_px) * u64::from(height_px) > u64::from(area_px) {
            let reach = |effect: &&dyn Effect| effect.reach(moment).look_px;
            let widest = self.active.iter().copied().max_by(|a, b| reach(a).total_cmp(&reach(b)));
            let widest = widest.filter(|effect| reach(effect) >= 1.0).map(|effect| effect.table());
            return Err(SubmitError::TooLarge { width_px, height_px, side_px, area_px, widest });
        }
        Ok(())
    }

    /// Whether an effect itself hides virtual things behind real ones, so that they are not hidden before it.
    pub fn hides_itself(&self) -> bool {
        self.surfaces.is_some() && self.active.iter().any(|effect| effect.on_real() == OnReal::ActsAndHides)
    }
}
