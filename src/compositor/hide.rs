//! The second phase: what real things hide, and when it is cut off.

use std::borrow::Cow;

use super::behind_real::deep_within;
use super::plan::{Plan, Sight};
use super::{Job, RealDepth, Settings};
use crate::depth::{RayCache, Repair, measured_from};
use crate::effects::Moment;
use crate::gpu::{Recorder, Texture};
use crate::pixels::Rect;
use crate::render::real_depth;

/// The real scene's depth (metres, 0 unknown), over the drawn rectangle where nothing else is said.
#[derive(Debug, Default)]
pub struct Hidden {
    /// Hides objects as they are drawn.
    pub first: Option<Texture>,
    /// The index among the active effects after which objects are cut off as well, and by what.
    pub then: Option<(usize, Texture)>,
    /// The depth itself, of everything that is known, and its rectangle: around what is drawn and what is shaded.
    pub real: Option<(Texture, Rect)>,
    /// Why the frame's depth hides nothing although it exists and is asked for.
    pub nothing_because: Option<String>,
}

impl Hidden {
    pub fn new(
        recorder: &mut Recorder,
        rays: &mut RayCache,
        job: &Job<'_>,
        settings: &Settings,
        sight: &Sight,
        plan: &Plan<'_>,
        moment: &Moment<'_>,
    ) -> Self {
        let Some(places) = plan.places.as_ref().filter(|_| settings.depth.occlusion) else { return Self::default() };
        let drawn = places.drawn;
        let around = drawn.union(&places.shaded);
        let depth = job.frame.depth.as_ref();
        let measured = depth.map(|depth| measured_from(depth, job.picture, job.track, job.time_offset_s));
        let nothing_because = measured.as_ref().and_then(|pose| pose.as_ref().err().cloned());
        let texels = match job.real {
            RealDepth::OfFrame => depth.zip(measured.and_then(Result::ok)).map(|(depth, measured)| {
                let (rays, pixels, response) = (rays.of(job.picture), &job.frame.pixels, &moment.camera.response);
                Repair { rays, depth, measured: &measured, frame: &sight.keys.middle(), pixels, response }.over(around)
            }),
            RealDepth::Known { moments, grid, .. } if plan.hides_itself() && moments.is_empty() => {
                let real = grid.map(|grid| (real_depth(recorder, &grid.over(around), around), around));
                return Self { real, nothing_because, ..Self::default() };
            }
            RealDepth::Known { grid, .. } => grid.map(|grid| grid.over(around)),
        };
        let Some(texels) = texels else { return Self { nothing_because, ..Self::default() } };
        // If objects are cut off after the blur, only what stays hidden when blurred is hidden before.
        let after = plan.active.iter().rposition(|effect| !job.capture.whole && effect.on_real().blurs_behind());
        let beneath = part(&texels, around, drawn);
        let beside = (around != drawn).then(|| real_depth(recorder, &texels, around));
        let real = |own: &Texture| Some((beside.clone().unwrap_or_else(|| own.clone()), around));
        let own = real_depth(recorder, &beneath, drawn);
        let Some(after) = after else {
            return Self { real: real(&own), first: Some(own), then: None, nothing_because };
        };
        let reach_px = plan.active[after].reach(moment).look_px.ceil() as usize;
        let deep = deep_within(&beneath, drawn.width() as usize, reach_px);
        Self {
            first: Some(real_depth(recorder, &deep, drawn)),
            real: real(&own),
            then: Some((after, own)),
            nothing_because,
        }
    }
}

/// A part of a rectangle's texels.
fn part(texels: &[f32], around: Rect, rect: Rect) -> Cow<'_, [f32]> {
    if rect == around {
        return Cow::Borrowed(texels);
    }
    let rows = texels.chunks_exact(around.width() as usize).skip((rect.y0 - around.y0) as usize);
    let columns = (rect.x0 - around.x0) as usize..(rect.x1 - around.x0) as usize;
    rows.take(rect.height() as usize).flat_map(|row| &row[columns.clone()]).copied().collect()
}
