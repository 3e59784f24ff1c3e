//! The second phase: what real things hide, and when it is cut off.

use std::sync::Arc;

use glam::DVec3;

use super::behind_real::{Before, deep_within};
use super::places::Places;
use super::plan::{Plan, Sight};
use super::shade::dark;
use super::{Job, RealDepth, Settings};
use crate::camera::Geometry;
use crate::depth::{
    LastRepair, MattePixel, Proxies, RayCache, Rays, Repair, Repaired, SecondSurface, Seen, Wanted, measured_from,
    neighbours,
};
use crate::effects::Moment;
use crate::gpu::{Recorder, Texture, half_texels};
use crate::pixels::Rect;
use crate::pose::Pose;
use crate::render::{COLOR, GridPlacement, grid_depth, real_depth};

/// The real scene's depth (metres, 0 unknown), over the drawn rectangle where nothing else is said.
#[derive(Debug, Default)]
pub struct Hidden {
    /// Hides objects as they are drawn, and where its pixels lie if they are not the picture's.
    pub first: Option<(Texture, Option<GridPlacement>)>,
    /// After how many of the active effects objects are cut off as well, and by what.
    pub then: Option<(usize, Before)>,
    /// The depth itself, of everything that is known, and its rectangle: around what is drawn and what is shaded. `None` where
    /// nothing is shaded.
    pub real: Option<(Texture, Rect)>,
    /// The same as plain values.
    pub repaired: Option<(Arc<Repaired>, Rect)>,
    /// The second surface of pixels at edges, where a shadow is dark.
    pub matte: Option<(Texture, Rect)>,
    /// Why the frame's depth hides nothing although it exists and is asked for.
    pub nothing_because: Option<String>,
    /// Whether edges are torn because the neighbours were not asked.
    pub is_rough: bool,
}

/// What is known from picture to picture.
#[derive(Debug, Default)]
pub struct Known {
    pub rays: RayCache,
    last: LastRepair,
    /// Models that stand in for real things.
    pub proxies: Proxies,
    /// Whether the next picture may do without the neighbours.
    pub may_be_rough: bool,
}

impl Hidden {
    pub fn new(
        recorder: &mut Recorder,
        Known { rays, last, proxies, may_be_rough }: &mut Known,
        job: &Job<'_>,
        settings: &Settings,
        sight: &Sight,
        plan: &Plan<'_>,
        moment: &Moment<'_>,
    ) -> Self {
        let Some(places) = plan.places.as_ref().filter(|_| settings.depth.occlusion) else { return Self::default() };
        let drawn = places.drawn;
        let around = drawn.union(&places.shaded);
        if let RealDepth::Known { grid, moments, .. } = job.real {
            let itself = plan.hides_itself() && moments.is_empty();
            return grid.map_or_else(Self::default, |grid| {
                let real =
                    (!sight.shades.is_empty()).then(|| (real_depth(recorder, &grid.over(around), around), around));
                let first = (!itself).then(|| grid_depth(recorder, grid, drawn, job.picture.sees_around()));
                Self { first, real, ..Self::default() }
            });
        }
        let depth = job.frame.depth.as_ref();
        let measured = depth.map(|depth| measured_from(depth, job.picture, job.track, job.time_offset_s));
        let nothing_because = measured.as_ref().and_then(|pose| pose.as_ref().err().cloned());
        let measured = measured.and_then(Result::ok);
        let measured = depth.zip(measured.as_ref());
        if measured.is_none() && proxies.is_empty() {
            return Self { nothing_because, ..Self::default() };
        }
        let (rays, pixels, response) = (rays.of(job.picture), &job.frame.pixels, &moment.camera.response);
        let half_s = 0.5 * sight.shutter.exposure_time_s;
        let [opened, closed] = [-half_s, half_s].map(|offset_s| sight.keys.pose_at(offset_s));
        let (frame, shutter) = (sight.keys.middle(), [&opened, &closed]);
        let neighbours = neighbours(&job.frame, job.picture, (job.track, job.time_offset_s));
        let (frame, neighbours, planes) = (&frame, &neighbours, &sight.planes);
        let seen = |point: DVec3| seen_by_row(job.picture, |time_s| sight.keys.pose_at(time_s), point);
        let proxies = (!proxies.is_empty()).then_some((&*proxies, &seen as &dyn Fn(DVec3) -> Seen));
        let surfels = &job.frame.surfels[..];
        let repair = Repair { rays, measured, frame, shutter, pixels, response, planes, proxies, neighbours, surfels };
        // Where a shadow is faint, what it lies on is judged by what was measured.
        let dark = dark(&sight.shades).intersection(&places.shaded);
        let asked = wanted(sight, places, dark, rays);
        let rects = [around, drawn.union(&dark), drawn];
        let (repaired, is_rough) = last.over(&job.frame, &repair, rects, &asked, *may_be_rough);
        // Nothing else asks for it.
        let real = (!sight.shades.is_empty()).then(|| (real_depth(recorder, &repaired.depth_m, around), around));
        // Objects are cut off after the last effect that blurs. Only what stays hidden when blurred is hidden before.
        let after = plan.active.iter().rposition(|effect| effect.on_real().blurs()).map_or(0, |last| last + 1);
        let look_px = plan.active[..after].iter().map(|effect| effect.reach(moment));
        let reach_px = look_px.map(|reach| reach.look_px.max(reach.spread_px)).sum::<f32>().ceil() as usize;
        let farthest: Vec<f32> = repaired.shared.iter().map(|shared: &MattePixel| shared.far_m).collect();
        let deep = deep_within(&farthest, drawn.width() as usize, reach_px);
        let before = Before::new(recorder, &repaired.shared, drawn);
        let first = Some((real_depth(recorder, &deep, drawn), None));
        let matte = (!dark.is_empty()).then(|| (receiver_matte(recorder, &repaired.receiver, dark), dark));
        let repaired = Some((repaired, around));
        Self { first, real, repaired, matte, then: Some((after, before)), nothing_because, is_rough }
    }
}

/// Uploads the second surfaces of a rectangle's pixels: their share of each colour's light, and their depth.
fn receiver_matte(recorder: &Recorder, receiver: &[SecondSurface], rect: Rect) -> Texture {
    let texel = |of: &SecondSurface| [of.light_share[0], of.light_share[1], of.light_share[2], of.depth_m];
    let texels: Vec<[f32; 4]> = receiver.iter().map(texel).collect();
    let texture = recorder.pool.lend_to_write(&recorder.gpu, (rect.width(), rect.height()), COLOR);
    texture.write(&recorder.gpu, rect.width(), rect.height(), &half_texels(&texels));
    texture
}

/// Where a point of the world is seen by the pose of its row, and its depth.
pub fn seen_by_row(geometry: &Geometry, pose_at: impl Fn(f64) -> Pose, point: DVec3) -> Seen {
    let (at, in_camera) = geometry.seen_by_row(|time_s| pose_at(time_s).transform_point(point))?;
    Some((at, if geometry.sees_around() { in_camera.length() } else { in_camera.z }))
}

/// Where real depth matters to a picture: nearer than an object, and before what a shadow is dark on.
fn wanted(sight: &Sight, places: &Places, dark: Rect, rays: &Rays) -> Wanted {
    let object = |(rect, farthest_m): &(Rect, f64)| (rect.grown(places.spread_px), *farthest_m as f32);
    let mut objects: Vec<_> = sight.footprint.parts.iter().map(object).collect();
    if rays.geometry().is_round() {
        // What lies across the seam is seen at both rims.
        let width = rays.full().x1;
        let turned = |turn: i32| objects.iter().map(move |(rect, farthest_m)| (rect.moved(turn, 0), *farthest_m));
        let others: Vec<_> = turned(-width).chain(turned(width)).collect();
        objects.extend(others);
    }
    Wanted { objects, all_of: dark, receiver: dark }
}
