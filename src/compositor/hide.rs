//! The second phase: what real things hide, and when it is cut off.

use super::behind_real::deep_within;
use super::plan::{Plan, Sight};
use super::{Job, RealDepth, Settings};
use crate::depth::{RayCache, Repair, measured_from};
use crate::effects::Moment;
use crate::gpu::{Recorder, Texture};
use crate::render::real_depth;

/// The real scene's depth over the drawn rectangle (metres, 0 unknown).
#[derive(Debug, Default)]
pub struct Hidden {
    /// Hides objects as they are drawn.
    pub first: Option<Texture>,
    /// The index among the active effects after which objects are cut off as well, and by what.
    pub then: Option<(usize, Texture)>,
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
        let depth = job.frame.depth.as_ref();
        let measured = depth.map(|depth| measured_from(depth, job.picture, job.track, job.time_offset_s));
        let nothing_because = measured.as_ref().and_then(|pose| pose.as_ref().err().cloned());
        let texels = match job.real {
            RealDepth::OfFrame => depth.zip(measured.and_then(Result::ok)).map(|(depth, measured)| {
                let (rays, pixels, response) = (rays.of(job.picture), &job.frame.pixels, &moment.camera.response);
                Repair { rays, depth, measured: &measured, frame: &sight.keys.middle(), pixels, response }.over(drawn)
            }),
            RealDepth::Known { moments, .. } if plan.hides_itself() && moments.is_empty() => None,
            RealDepth::Known { grid, .. } => grid.map(|grid| grid.over(drawn)),
        };
        let Some(texels) = texels else { return Self { nothing_because, ..Self::default() } };
        // If objects are cut off after the blur, only what stays hidden when blurred is hidden before.
        let after = plan.active.iter().rposition(|effect| !job.capture.whole && effect.on_real().blurs_behind());
        let Some(after) = after else {
            return Self { first: Some(real_depth(recorder, &texels, drawn)), then: None, nothing_because };
        };
        let reach_px = plan.active[after].reach(moment).look_px.ceil() as usize;
        let deep = deep_within(&texels, drawn.width() as usize, reach_px);
        Self {
            first: Some(real_depth(recorder, &deep, drawn)),
            then: Some((after, real_depth(recorder, &texels, drawn))),
            nothing_because,
        }
    }
}
