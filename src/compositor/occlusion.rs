//! Second phase of a frame: the depth of the real scene, and when it occludes objects.

use std::sync::Arc;

use glam::DVec3;

use super::foreground_matte::{ForegroundMatte, max_depth_within};
use super::plan::{FrameView, Plan};
use super::shade::dark_bounds;
use super::work_rects::WorkRects;
use super::{Job, RealDepth, Settings};
use crate::camera::Geometry;
use crate::depth::{
    DepthRequest, LastRepair, MattePixel, ProjectedPoint, Proxies, RayCache, Rays, Repair, RepairedDepth,
    SecondSurface, measured_from, neighbours,
};
use crate::effects::FrameContext;
use crate::gpu::{Recorder, Texture, half_texels};
use crate::pixels::Rect;
use crate::pose::Pose;
use crate::quality::Quality;
use crate::render::{COLOR, GridPlacement, grid_depth, real_depth};

/// Depth of the real scene (m, 0 unknown) in the forms that later phases read. Rectangles are those
/// of the drawn layer unless noted.
#[derive(Debug, Default)]
pub struct FrameOcclusion {
    /// Depth for the depth test as objects are drawn, and its grid if that is not the picture's.
    pub depth_test: Option<(Texture, Option<GridPlacement>)>,
    /// The number of active effects after which the matte occludes the layer, and the matte.
    pub foreground: Option<(usize, ForegroundMatte)>,
    /// Full depth over the bounds of the drawn and the shaded rectangle. `None` without shadows.
    pub scene_depth: Option<(Texture, Rect)>,
    /// The same depth in memory.
    pub repaired: Option<(Arc<RepairedDepth>, Rect)>,
    /// The second surface of edge pixels, where a shadow is dark.
    pub receiver_matte: Option<(Texture, Rect)>,
    /// Why the frame's depth occludes nothing, although it exists and occlusion is on.
    pub failure: Option<String>,
    /// True if the depth was made without the neighbouring frames, with ragged edges.
    pub is_preview: bool,
}

/// State between frames: caches, and inputs of the next frame.
#[derive(Debug, Default)]
pub struct DepthState {
    pub rays: RayCache,
    last: LastRepair,
    /// Proxy models of real objects.
    pub proxies: Proxies,
    /// Whether the next frame's depth may be made without the neighbouring frames.
    pub allow_preview: bool,
}

impl FrameOcclusion {
    pub fn new(
        recorder: &mut Recorder,
        DepthState { rays, last, proxies, allow_preview }: &mut DepthState,
        job: &Job<'_>,
        settings: &Settings,
        frame_view: &FrameView,
        plan: &Plan<'_>,
        context: &FrameContext<'_>,
    ) -> Self {
        let Some(work_rects) = plan.work_rects.as_ref().filter(|_| settings.depth.occlusion) else {
            return Self::default();
        };
        let drawn = work_rects.drawn;
        let around = drawn.union(&work_rects.shaded);
        if let RealDepth::Known { grid, moments, .. } = job.real {
            let by_effect = plan.effect_occludes() && moments.is_empty();
            return grid.map_or_else(Self::default, |grid| {
                let scene_depth = (!frame_view.shadows.is_empty())
                    .then(|| (real_depth(recorder, &grid.over(around), around), around));
                let depth_test = (!by_effect).then(|| grid_depth(recorder, grid, drawn, job.picture.needs_cube_map()));
                Self { depth_test, scene_depth, ..Self::default() }
            });
        }
        let depth = job.frame.depth.as_deref();
        let measured = depth.map(|depth| measured_from(depth, job.picture, job.track));
        let failure = measured.as_ref().and_then(|pose| pose.as_ref().err().cloned());
        let measured = measured.and_then(Result::ok);
        let measured = depth.zip(measured.as_ref());
        if measured.is_none() && proxies.is_empty() {
            return Self { failure, ..Self::default() };
        }
        let (rays, pixels, response) = (rays.of(job.picture), &job.frame.pixels, &context.camera.response);
        let half_s = 0.5 * frame_view.shutter.exposure_time_s;
        let [opened, closed] = [-half_s, half_s].map(|offset_s| frame_view.keys.pose_at(offset_s));
        let (frame, shutter) = (frame_view.keys.middle(), [&opened, &closed]);
        let neighbours = neighbours(&job.frame, job.picture, job.track);
        let (frame, neighbours, planes) = (&frame, &neighbours, &frame_view.planes);
        let seen = |point: DVec3| project_rolling(job.picture, |time_s| frame_view.keys.pose_at(time_s), point);
        let proxies = (!proxies.is_empty()).then_some((&*proxies, &seen as &dyn Fn(DVec3) -> ProjectedPoint));
        let surfels = &job.frame.surfels[..];
        let repair = Repair { rays, measured, frame, shutter, pixels, response, planes, proxies, neighbours, surfels };
        // Under faint shadows, the receiver is found by the measured depth alone.
        let dark = dark_bounds(&frame_view.shadows).intersection(&work_rects.shaded);
        let depth_request = depth_request(frame_view, work_rects, dark, rays);
        let rects = [around, drawn.union(&dark), drawn];
        let quality = if *allow_preview { Quality::Preview } else { Quality::Final };
        let (repaired, quality) = last.over(&job.frame, &repair, rects, &depth_request, quality);
        let is_preview = quality.is_preview();
        // Only shadows read it.
        let scene_depth =
            (!frame_view.shadows.is_empty()).then(|| (real_depth(recorder, &repaired.depth_m, around), around));
        // The matte occludes the layer after the last effect that blurs. The depth test before it
        // removes only parts that stay hidden when blurred.
        let after = plan.active.iter().rposition(|effect| effect.on_real().blurs()).map_or(0, |last| last + 1);
        let read_px = plan.active[..after].iter().map(|effect| effect.reach(context));
        let reach_px = read_px.map(|reach| reach.read_px.max(reach.spread_px)).sum::<f32>().ceil() as usize;
        let farthest: Vec<f32> = repaired.mattes.iter().map(|shared: &MattePixel| shared.far_m).collect();
        let deep = max_depth_within(&farthest, drawn.width() as usize, reach_px);
        let foreground = Some((after, ForegroundMatte::new(recorder, &repaired.mattes, drawn)));
        let depth_test = Some((real_depth(recorder, &deep, drawn), None));
        let receiver_matte =
            (!dark.is_empty()).then(|| (upload_receiver(recorder, &repaired.second_surfaces, dark), dark));
        let repaired = Some((repaired, around));
        Self { depth_test, foreground, scene_depth, repaired, receiver_matte, failure, is_preview }
    }
}

/// Uploads the second surfaces of a rectangle's pixels: their share of each channel's light, and
/// their depth.
fn upload_receiver(recorder: &Recorder, receiver: &[SecondSurface], rect: Rect) -> Texture {
    let texel = |of: &SecondSurface| [of.light_fraction[0], of.light_fraction[1], of.light_fraction[2], of.depth_m];
    let texels: Vec<[f32; 4]> = receiver.iter().map(texel).collect();
    let texture = recorder.pool.lend_to_write(&recorder.gpu, (rect.width(), rect.height()), COLOR);
    texture.write(&recorder.gpu, rect.width(), rect.height(), &half_texels(&texels));
    texture
}

/// Projection and depth of a point of the world, by the pose of its row (rolling shutter).
pub fn project_rolling(geometry: &Geometry, pose_at: impl Fn(f64) -> Pose, point: DVec3) -> ProjectedPoint {
    let (at, in_camera) = geometry.project_rolling(|time_s| pose_at(time_s).transform_point(point))?;
    Some((at, if geometry.needs_cube_map() { in_camera.length() } else { in_camera.z }))
}

/// Where real depth matters to a frame: nearer than an object, and under dark shadows.
fn depth_request(frame_view: &FrameView, work_rects: &WorkRects, dark: Rect, rays: &Rays) -> DepthRequest {
    let object = |(rect, farthest_m): &(Rect, f64)| (rect.grown(work_rects.spread_px), *farthest_m as f32);
    let mut objects: Vec<_> = frame_view.footprint.parts.iter().map(object).collect();
    if rays.geometry().is_equirectangular() {
        // An object across the seam is visible at both rims.
        let width = rays.full().x1;
        let moved = |by_px: i32| objects.iter().map(move |(rect, farthest_m)| (rect.moved(by_px, 0), *farthest_m));
        let others: Vec<_> = moved(-width).chain(moved(width)).collect();
        objects.extend(others);
    }
    DepthRequest { objects, full_depth_rect: dark, receiver_rect: dark }
}
