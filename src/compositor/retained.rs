//! Results of the last shown frame, by stage. While a user drags a slider, the same frame is shown
//! repeatedly with one parameter changed: stages before the first one that reads it are not
//! repeated.
//!
//! Inputs are compared by value, large ones by their addresses. Textures among the inputs are kept
//! with them, so that the pool cannot lend them to other work in the meantime.

use std::sync::Arc;

use super::foreground_matte::ForegroundMatte;
use super::frame_inputs::FrameInputs;
use super::occlusion::{DepthKey, FrameOcclusion};
use super::settings::ShadowSettings;
use super::shadow_mask::{ShadowMask, VisibleShadow};
use crate::camera::{Camera, Capture, Geometry, Primaries, Response};
use crate::effects::{Effect, ObjectMotion};
use crate::frame::{FrameExposure, FrameIdentity, RelativeBrightness};
use crate::gpu::Texture;
use crate::memo::{ByAddress, Memo};
use crate::pixels::Rect;
use crate::render::{GridPlacement, Layer, SamplePlan, Shutter, ViewKeys};
use crate::shadow::LazyRadiance;
use crate::stage::Stage;

/// The last result of each stage from [`Stage::Depth`] on, with its inputs. Planar shadows and
/// lightmaps have memos of their own (shadow/).
#[derive(Debug, Default)]
pub struct StageMemos {
    pub depth: Memo<DepthKey, FrameOcclusion>,
    pub shadow_mask: Memo<ShadowMaskKey, Option<ShadowMask>>,
    pub drawn: Memo<DrawKey, Layer>,
    pub layer: Memo<EffectsKey, Layer>,
}

/// Inputs of the shadow mask.
#[derive(Debug, PartialEq)]
pub struct ShadowMaskKey {
    shadows: Vec<VisibleShadow>,
    geometry: Geometry,
    keys: ViewKeys,
    shutter: Shutter,
    part: Rect,
    depth: Option<(Texture, Rect)>,
    matte: Option<(Texture, Rect)>,
    settings: ShadowSettings,
    opacity: f64,
    frame: FrameIdentity,
    response: Response,
    radiance: Option<ByAddress<LazyRadiance>>,
    brightness: Option<RelativeBrightness>,
}

impl ShadowMaskKey {
    pub fn new(inputs: &FrameInputs<'_>, occlusion: &FrameOcclusion, radiance: Option<&Arc<LazyRadiance>>) -> Self {
        let FrameInputs { job, view, .. } = *inputs;
        Self {
            shadows: view.shadows.clone(),
            geometry: job.picture.clone(),
            keys: view.keys.clone(),
            shutter: view.shutter,
            part: inputs.work_rects.shadowed,
            depth: occlusion.scene_depth.clone(),
            matte: occlusion.receiver_matte.clone(),
            settings: inputs.settings.shadow.clone(),
            opacity: job.frame.opacity,
            frame: job.frame.identity(),
            response: inputs.context.camera.response.clone(),
            radiance: radiance.cloned().map(ByAddress),
            brightness: job.frame.exposure.brightness,
        }
    }
}

/// Inputs of the drawn layer. The revision of the renderer stands for its scene and lightmaps.
#[derive(Debug, PartialEq)]
pub struct DrawKey {
    renderer_revision: u64,
    geometry: Geometry,
    keys: ViewKeys,
    shutter: Shutter,
    depths_m: [f64; 2],
    rect: Rect,
    depth_test: Option<(Texture, Option<GridPlacement>)>,
    tolerance_m: f32,
    samples: SamplePlan,
    primaries: Primaries,
}

impl DrawKey {
    pub fn new(inputs: &FrameInputs<'_>, occlusion: &FrameOcclusion, renderer_revision: u64) -> Self {
        let FrameInputs { job, view, .. } = *inputs;
        Self {
            renderer_revision,
            geometry: job.picture.clone(),
            keys: view.keys.clone(),
            shutter: view.shutter,
            depths_m: view.footprint.depths_m,
            rect: inputs.work_rects.drawn,
            depth_test: occlusion.depth_test.clone(),
            tolerance_m: inputs.settings.depth.tolerance_m,
            samples: inputs.plan.samples.clone(),
            primaries: inputs.camera.response.primaries,
        }
    }
}

/// A camera without the film speed of its noise, which effects of the mix alone read.
fn without_film_speed(camera: &Camera) -> Camera {
    let mut camera = camera.clone();
    camera.exposure.iso = None;
    camera
}

/// Inputs of the effects on the layer.
#[derive(Debug, PartialEq)]
pub struct EffectsKey {
    drawn: Layer,
    effects: Vec<Box<dyn Effect>>,
    foreground: Option<(usize, ForegroundMatte)>,
    tolerance_m: f32,
    /// Whether the resulting geometry is read, because the layer is requested. Effects of the mix
    /// do not read it.
    geometry_is_read: bool,
    drawn_rect: Rect,
    objects_px: Rect,
    camera: Camera,
    picture: Geometry,
    capture: Capture,
    frame: usize,
    seed: u64,
    recorded: FrameExposure,
    interval_s: f64,
    fastest_px_per_s: f32,
    depths_m: [f64; 2],
    real_depths_m: Option<[f64; 2]>,
    objects: Vec<ObjectMotion>,
}

impl EffectsKey {
    pub fn new(inputs: &FrameInputs<'_>, occlusion: &FrameOcclusion, drawn: &Layer) -> Self {
        let FrameInputs { plan, work_rects, context, .. } = *inputs;
        let on_layer = plan.active.iter().filter(|effect| effect.stage() == Stage::Effects);
        Self {
            drawn: drawn.clone(),
            effects: on_layer.map(|effect| effect.boxed()).collect(),
            foreground: occlusion.foreground.clone(),
            tolerance_m: inputs.settings.depth.tolerance_m,
            geometry_is_read: inputs.geometry_is_read_by_mix(),
            drawn_rect: work_rects.drawn,
            objects_px: work_rects.objects_px,
            camera: without_film_speed(context.camera),
            picture: context.picture.clone(),
            capture: context.capture.clone(),
            frame: context.frame,
            seed: context.seed,
            recorded: context.recorded,
            interval_s: context.interval_s,
            fastest_px_per_s: context.fastest_px_per_s,
            depths_m: context.depths_m,
            real_depths_m: context.real_depths_m,
            objects: context.objects.to_vec(),
        }
    }
}
