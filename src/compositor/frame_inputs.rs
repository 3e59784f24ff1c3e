//! The inputs that the stages of a frame share.

use super::plan::{FrameView, Plan};
use super::work_rects::WorkRects;
use super::{Job, Settings};
use crate::camera::Camera;
use crate::depth::Proxies;
use crate::effects::FrameContext;
use crate::quality::Quality;
use crate::stage::Stage;

/// The inputs that a frame's stages share.
#[derive(Clone, Copy, Debug)]
pub struct FrameInputs<'a> {
    pub job: &'a Job<'a>,
    pub camera: &'a Camera,
    pub settings: &'a Settings,
    pub view: &'a FrameView,
    pub context: &'a FrameContext<'a>,
    pub plan: &'a Plan<'a>,
    pub work_rects: &'a WorkRects,
    /// Proxy models of real objects.
    pub proxies: &'a Proxies,
    pub requested: Quality,
    /// Whether stages' results are retained for the next frame.
    pub is_retained: bool,
}

impl FrameInputs<'_> {
    /// Whether the resulting layer's geometry is read: with the layer, or by an effect on code
    /// values.
    pub fn geometry_is_read_by_mix(&self) -> bool {
        let mut mixed = self.plan.active.iter().filter(|effect| effect.stage() == Stage::Mix);
        self.job.want_layer || mixed.any(|effect| effect.reads_geometry())
    }
}
