//! The stage [`Stage::Depth`] of a frame: the depth of the real scene, and its forms for occlusion.

use std::sync::Arc;

use glam::DVec3;

use super::RealDepth;
use super::foreground_matte::{ForegroundMatte, max_depth_within};
use super::frame_inputs::FrameInputs;
use super::plan::FrameView;
use super::shadow_mask::union_of_dark_rects;
use super::stage_log::StageLog;
use super::work_rects::WorkRects;
use crate::camera::Geometry;
use crate::depth::{
    DepthGrid, DepthRequest, LastRepair, MattePixel, ProjectedPoint, ProxyView, Rays, Repair, RepairedDepth,
    SecondSurface, measured_from, neighbours,
};
use crate::gpu::{PassRecorder, Texture, half_texels};
use crate::memo::{ByAddress, Memo};
use crate::pixels::Rect;
use crate::pose::Pose;
use crate::quality::Quality;
use crate::render::{COLOR, GridPlacement, grid_depth, real_depth};
use crate::stage::Stage;

/// Depth of the real scene (m, 0 unknown) in the forms that later stages read. Rectangles are those
/// of the drawn layer unless noted.
#[derive(Clone, Debug, Default)]
pub struct FrameOcclusion {
    /// Depth for the depth test as objects are drawn, and its grid if that is not the picture's.
    pub depth_test: Option<(Texture, Option<GridPlacement>)>,
    /// The number of active effects after which the matte occludes the layer, and the matte.
    pub foreground: Option<(usize, ForegroundMatte)>,
    /// Full depth over the bounds of the drawn and the shadowed rectangle. `None` without shadows.
    pub scene_depth: Option<(Texture, Rect)>,
    /// `scene_depth` in memory.
    pub repaired: Option<(Arc<RepairedDepth>, Rect)>,
    /// The second surface of edge pixels, where a shadow is dark.
    pub receiver_matte: Option<(Texture, Rect)>,
    /// Why the frame's depth occludes nothing, although it exists and occlusion is on.
    pub failure: Option<String>,
    /// True if the depth was made without the neighbouring frames, with ragged edges.
    pub is_preview: bool,
}

/// Memos of depth repair.
#[derive(Debug, Default)]
pub struct DepthMemos {
    rays: Memo<Geometry, Arc<Rays>>,
    last: LastRepair,
}

impl DepthMemos {
    /// The rays of a camera's pixels.
    pub fn rays(&self, geometry: &Geometry) -> Arc<Rays> {
        self.rays.get_or_insert_with(geometry.clone(), |geometry| Arc::new(Rays::new(geometry)))
    }
}

/// Rectangles for which depth is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DepthRects {
    /// Rectangle of the drawn layer.
    pub drawn: Rect,
    /// Bounds of dark shadows. Under faint ones, the receiver is found by the measured depth alone.
    pub dark: Rect,
    /// Bounds of the drawn and the shadowed rectangle.
    pub around: Rect,
}

/// Inputs of a frame's occlusion.
#[derive(Debug, PartialEq)]
pub enum DepthKey {
    /// Nothing real occludes, with the reason if there is one.
    Nothing(Option<String>),
    Repaired {
        repaired: ByAddress<RepairedDepth>,
        rects: DepthRects,
        has_shadows: bool,
        /// The number of effects before the matte.
        effects: usize,
        /// The distance to which they blur, px.
        reach_px: usize,
    },
}

impl FrameOcclusion {
    /// The stage [`Stage::Depth`].
    pub fn new(
        recorder: &mut PassRecorder,
        memos: &DepthMemos,
        inputs: &FrameInputs<'_>,
        retained: &Memo<DepthKey, Self>,
        log: &mut StageLog,
    ) -> Self {
        let FrameInputs { job, settings, view, plan, work_rects, .. } = *inputs;
        let nothing = |log: &mut StageLog, failure: Option<String>| {
            let key = inputs.is_retained.then(|| DepthKey::Nothing(failure.clone()));
            log.run(Stage::Depth, retained, key, || Self { failure, ..Self::default() })
        };
        if !settings.depth.occlusion {
            return nothing(log, None);
        }
        let dark = union_of_dark_rects(&view.shadows).intersection(&work_rects.shadowed);
        let rects = DepthRects { drawn: work_rects.drawn, dark, around: work_rects.drawn.union(&work_rects.shadowed) };
        if let RealDepth::Known { grid, .. } = job.real {
            let compute = || grid.map_or_else(Self::default, |grid| Self::of_grid(recorder, grid, inputs, rects));
            return log.run(Stage::Depth, retained, None, compute);
        }
        let (repaired, quality) = match repair(memos, inputs, rects) {
            Ok(repaired) => repaired,
            Err(failure) => return nothing(log, failure),
        };
        // The matte occludes the layer after the last effect that blurs. The depth test before it
        // removes only parts that stay hidden when blurred.
        let effects = plan.active.iter().rposition(|effect| effect.on_real().blurs()).map_or(0, |last| last + 1);
        let reach = plan.active[..effects].iter().map(|effect| effect.reach(inputs.context));
        let reach_px = reach.map(|reach| reach.read_px.max(reach.spread_px)).sum::<f32>().ceil() as usize;
        let has_shadows = !view.shadows.is_empty();
        let key = inputs.is_retained.then(|| {
            let repaired = ByAddress(Arc::clone(&repaired));
            DepthKey::Repaired { repaired, rects, has_shadows, effects, reach_px }
        });
        let is_preview = quality.is_preview();
        log.run(Stage::Depth, retained, key, || {
            recorder.part("depth");
            let occlusion = Self::of_repaired(recorder, repaired, rects, has_shadows, (effects, reach_px));
            Self { is_preview, ..occlusion }
        })
    }

    /// Occlusion by depth that is known at the picture's time.
    fn of_grid(recorder: &mut PassRecorder, grid: &DepthGrid, inputs: &FrameInputs<'_>, rects: DepthRects) -> Self {
        recorder.part("depth");
        let FrameInputs { job, view, plan, .. } = *inputs;
        let around = rects.around;
        let by_effect = plan.effect_occludes() && job.real.moments().is_empty();
        let scene_depth =
            (!view.shadows.is_empty()).then(|| (real_depth(recorder, &grid.depth_m_in(around), around), around));
        let depth_test = (!by_effect).then(|| grid_depth(recorder, grid, rects.drawn, job.picture.needs_cube_map()));
        Self { depth_test, scene_depth, ..Self::default() }
    }

    /// Uploads a frame's repaired depth. The matte applies after a number of effects, which blur up
    /// to a distance in px.
    fn of_repaired(
        recorder: &PassRecorder,
        repaired: Arc<RepairedDepth>,
        DepthRects { drawn, dark, around }: DepthRects,
        has_shadows: bool,
        (effects, reach_px): (usize, usize),
    ) -> Self {
        // Only shadows read it.
        let scene_depth = has_shadows.then(|| (real_depth(recorder, &repaired.depth_m, around), around));
        let farthest: Vec<f32> = repaired.mattes.iter().map(|shared: &MattePixel| shared.far_m).collect();
        let deep = max_depth_within(&farthest, drawn.width() as usize, reach_px);
        let foreground = Some((effects, ForegroundMatte::new(recorder, &repaired.mattes, drawn)));
        let depth_test = Some((real_depth(recorder, &deep, drawn), None));
        let receiver_matte =
            (!dark.is_empty()).then(|| (upload_receiver(recorder, &repaired.second_surfaces, dark), dark));
        let repaired = Some((repaired, around));
        Self { depth_test, foreground, scene_depth, repaired, receiver_matte, ..Self::default() }
    }
}

/// A frame's repaired depth, from its own map, its neighbours and proxy models. An error, with the
/// reason if there is one, without any of them.
fn repair(
    memos: &DepthMemos,
    inputs: &FrameInputs<'_>,
    DepthRects { drawn, dark, around }: DepthRects,
) -> Result<(Arc<RepairedDepth>, Quality), Option<String>> {
    let FrameInputs { job, view, work_rects, proxies, .. } = *inputs;
    let depth = job.frame.depth.as_deref();
    let measured = depth.map(|depth| measured_from(depth, job.picture, job.track));
    let failure = measured.as_ref().and_then(|pose| pose.as_ref().err().cloned());
    let measured = measured.and_then(Result::ok);
    let measured = depth.zip(measured.as_ref());
    if measured.is_none() && proxies.is_empty() {
        return Err(failure);
    }
    let rays = &*memos.rays(job.picture);
    let (pixels, response) = (&job.frame.pixels, &inputs.camera.response);
    let half_s = 0.5 * view.shutter.exposure_time_s;
    let [opened, closed] = [-half_s, half_s].map(|offset_s| view.keys.pose_at(offset_s));
    let (frame, shutter) = (view.keys.middle(), [&opened, &closed]);
    let neighbours = neighbours(&job.frame, job.picture, job.track);
    let (frame, neighbours, planes) = (&frame, &neighbours, &view.planes);
    let project = |point: DVec3| project_rolling(job.picture, |time_s| view.keys.pose_at(time_s), point);
    let poses = (&view.keys.poses[..], view.keys.reach_s);
    let proxies = (!proxies.is_empty()).then_some(ProxyView { proxies, project: &project, poses });
    let surfels = &job.frame.surfels[..];
    let repair = Repair { rays, measured, frame, shutter, pixels, response, planes, proxies, neighbours, surfels };
    let request = depth_request(view, work_rects, dark, rays);
    Ok(memos.last.repaired_depth(&job.frame, &repair, [around, drawn.union(&dark), drawn], &request, inputs.requested))
}

/// Uploads the second surfaces of a rectangle's pixels: their share of each channel's light, and
/// their depth.
fn upload_receiver(recorder: &PassRecorder, receiver: &[SecondSurface], rect: Rect) -> Texture {
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

/// The pixels whose real depth matters to a frame: nearer than an object, and under dark shadows.
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
