//! The stages of a frame after its plan, each with the inputs that its retained result depends on.

use super::clipped::{self, FrameRadiance};
use super::coded::{CHROMA_REACH_PX, CodedPiece, CodedRegion, PendingCoding, composite_uncoded, mix_coded};
use super::example_noise::CONTENT_REACH_PX;
use super::foreground_matte;
use super::frame_inputs::FrameInputs;
use super::mix::{CameraUpload, MixInputs, mix};
use super::occlusion::FrameOcclusion;
use super::pending::{FrameReadbacks, LayerReadback};
use super::real;
use super::retained::{DrawKey, EffectsKey, ShadowMaskKey};
use super::shadow_mask::{self, ShadowMask};
use super::stage_log::StageLog;
use super::{Compositor, Target};
use crate::coding::PictureCoding;
use crate::effects::LayerRun;
use crate::frame::Frame;
use crate::gpu::{GpuError, PassRecorder, ReadbackSet, Texture};
use crate::pixels::{Codes, Pixels, Rect};
use crate::render::{Layer, Occlusion, View};
use crate::stage::Stage;

impl Compositor {
    /// The stage [`Stage::Depth`].
    pub(super) fn occlusion(&mut self, inputs: &FrameInputs<'_>, log: &mut StageLog) -> FrameOcclusion {
        FrameOcclusion::new(&mut self.recorder, &self.depth, inputs, &self.retained.depth, log)
    }

    /// The stage [`Stage::ShadowMask`]. `None` without shadows.
    pub(super) fn shadow_mask(
        &mut self,
        inputs: &FrameInputs<'_>,
        occlusion: &FrameOcclusion,
        log: &mut StageLog,
    ) -> Option<ShadowMask> {
        let key = inputs.is_retained.then(|| ShadowMaskKey::new(inputs, occlusion, self.radiance.as_ref()));
        let FrameInputs { job, view, work_rects, .. } = *inputs;
        log.run(Stage::ShadowMask, &self.retained.shadow_mask, key, || {
            let recorder = &mut self.recorder;
            recorder.part("shadow");
            let request = shadow_mask::ShadowMaskRequest {
                geometry: job.picture,
                keys: &view.keys,
                shutter: view.shutter,
                part: work_rects.shadowed,
                depth: occlusion.scene_depth.as_ref().map(|(depth, rect)| (depth, *rect)),
                matte: occlusion.receiver_matte.as_ref().map(|(matte, rect)| (matte, *rect)),
                settings: &inputs.settings.shadow,
                opacity: job.frame.opacity,
            };
            let image = shadow_mask::shadow_mask(recorder, &view.shadows, &request)?;
            let pose_at = |offset_s| view.keys.pose_at(offset_s);
            let rays = self.depth.rays(job.picture);
            let radiance_inputs =
                self.radiance.as_deref().zip(occlusion.repaired.as_ref()).zip(job.frame.exposure.brightness);
            let radiance = radiance_inputs.map(|((radiance, (repaired, rect)), brightness)| FrameRadiance {
                radiance,
                depth_m: (&repaired.depth_m, *rect),
                rays: &rays,
                pose_at: &pose_at,
                brightness,
            });
            let camera_light = (&*job.frame.pixels, &inputs.camera.response, job.picture);
            let part = work_rects.shadowed;
            Some(clipped::limit_clipped_shadow(recorder, image, part, camera_light, radiance.as_ref()))
        })
    }

    /// The stage [`Stage::Draw`].
    pub(super) fn draw(
        &mut self,
        inputs: &FrameInputs<'_>,
        occlusion: &FrameOcclusion,
        shadow_mask: Option<&ShadowMask>,
        log: &mut StageLog,
    ) -> Layer {
        let key = inputs.is_retained.then(|| DrawKey::new(inputs, occlusion, self.renderer.revision()));
        let FrameInputs { job, view, plan, work_rects, settings, .. } = *inputs;
        let tolerance_m = settings.depth.tolerance_m;
        log.run(Stage::Draw, &self.retained.drawn, key, || {
            let recorder = &mut self.recorder;
            recorder.part("objects");
            let view = View {
                geometry: job.picture,
                keys: &view.keys,
                shutter: view.shutter,
                depths_m: view.footprint.depths_m,
                rect: work_rects.drawn,
                occlusion: occlusion.depth_test.as_ref().map(|(depth, grid_placement)| Occlusion {
                    depth,
                    grid_placement: *grid_placement,
                    tolerance_m,
                    moments: job.real.moments(),
                }),
                parallel_to_m: None,
                primaries: inputs.camera.response.primaries,
                outer: None,
            };
            let mut layer = self.renderer.draw(recorder, &view, &plan.samples);
            layer.real = plan.surfaces.map(|surfaces| {
                // With summed exposures, the layer was occluded exposure by exposure.
                let hides = settings.depth.occlusion && job.real.moments().is_empty();
                let (pixels, response) = (&job.frame.pixels, &inputs.camera.response);
                let shadow_mask = shadow_mask.map(|image| &image.texture);
                let tolerance_m = hides.then_some(tolerance_m);
                real::real_layer(recorder, pixels, surfaces, work_rects.drawn, tolerance_m, response, shadow_mask)
            });
            layer
        })
    }

    /// The stage [`Stage::Effects`]: the effects over the layer, in order. After the last effect
    /// that blurs, occlusion is applied with the matte.
    pub(super) fn apply_effects(
        &mut self,
        inputs: &FrameInputs<'_>,
        occlusion: &FrameOcclusion,
        drawn: Layer,
        log: &mut StageLog,
    ) -> Layer {
        let key = inputs.is_retained.then(|| EffectsKey::new(inputs, occlusion, &drawn));
        let (active, tolerance_m) = (&inputs.plan.active, inputs.settings.depth.tolerance_m);
        log.run(Stage::Effects, &self.retained.layer, key, || {
            let (after, matte) =
                occlusion.foreground.as_ref().map_or((0, None), |(after, matte)| (*after, Some(matte)));
            let occlude = |run: &mut LayerRun<'_>, layer: Layer, done: usize| match matte.filter(|_| after == done) {
                Some(matte) => foreground_matte::occlude(run.recorder, layer, matte, tolerance_m),
                None => layer,
            };
            let mut run = layer_run(&mut self.recorder, inputs);
            run.recorder.part("objects");
            let mut layer = occlude(&mut run, drawn, 0);
            for (n, effect) in active.iter().enumerate() {
                if effect.stage() == Stage::Effects {
                    let is_read_later = active[n + 1..].iter().any(|effect| effect.reads_geometry());
                    run.geometry_is_read = after > n || inputs.job.want_layer || is_read_later;
                    run.recorder.part(effect.table());
                    layer = effect.run(&mut run, layer);
                }
                layer = occlude(&mut run, layer, n + 1);
            }
            layer
        })
    }

    /// The stage [`Stage::Mix`]: the composite of each piece, and the readbacks.
    pub(super) fn mix(
        &mut self,
        inputs: &FrameInputs<'_>,
        layer: &Layer,
        shadow_mask: Option<&ShadowMask>,
        target: Target<'_>,
        log: &mut StageLog,
    ) -> FrameReadbacks {
        let FrameInputs { job, work_rects, plan, .. } = *inputs;
        log.run_always(Stage::Mix);
        let mut run = layer_run(&mut self.recorder, inputs);
        run.recorder.part("mix");
        let pixels = &job.frame.pixels;
        let regions: Vec<_> = work_rects.pieces.iter().map(|piece| coded_region(inputs, piece.rect)).collect();
        let composited = |i: usize| regions[i].as_ref().map_or(work_rects.pieces[i].rect, |region| region.rect);
        let upload_px = match target {
            Target::Pixels => (0..regions.len()).map(|i| upload_rect(composited(i), &job.frame)).collect(),
            Target::View(..) => vec![frame_rect(&job.frame)],
        };
        let uploads: Vec<_> = upload_px.into_iter().map(|rect| CameraUpload::new(run.recorder, pixels, rect)).collect();
        let changed = changed_rects(inputs, layer, shadow_mask);
        let mask_texture = shadow_mask.map(|image| &image.texture);
        let mut readbacks = FrameReadbacks::default();
        for (i, piece) in work_rects.pieces.iter().enumerate() {
            let parts: Vec<_> = plan.active.iter().filter_map(|effect| effect.mix(&mut run, composited(i))).collect();
            let upload = uploads.get(i).unwrap_or(&uploads[0]);
            let mixed = MixInputs { camera: inputs.camera, job, upload, layer, shadow_mask: mask_texture };
            let noise = plan.noise.as_ref();
            let made = match &regions[i] {
                Some(region) if is_coded_on_cpu(run.recorder, pixels) => {
                    let coded = CodedPiece { region, piece, changed: &changed, parts: &parts, noise };
                    let Some(coding) = composite_uncoded(run.recorder, &mut self.readbacks, &mixed, &coded) else {
                        continue;
                    };
                    if let Target::Pixels = target {
                        readbacks.coded.push(coding);
                        continue;
                    }
                    // After a failure the frame's own wait returns the error.
                    let Ok(made) = coded_texture(run.recorder, &mut self.readbacks, coding, pixels) else { continue };
                    made
                }
                Some(region) => {
                    let coded = CodedPiece { region, piece, changed: &changed, parts: &parts, noise };
                    mix_coded(run.recorder, &mixed, &coded)
                }
                None => mix(run.recorder, &mixed, piece, &changed, &parts),
            };
            match target {
                Target::Pixels => {
                    let size = (piece.rect.width(), piece.rect.height());
                    readbacks.codes.push((*piece, run.recorder.read_back(&mut self.readbacks, &made, size)));
                }
                Target::View(..) => upload.copy_piece(run.recorder, &made, piece.rect),
            }
        }
        if let (Target::View(view, format), Some(upload)) = (target, uploads.first()) {
            upload.show(run.recorder, view, format);
        }
        readbacks.layer = job.want_layer.then(|| {
            let readbacks = &mut self.readbacks;
            LayerReadback::new(run.recorder, readbacks, inputs, layer, mask_texture)
        });
        readbacks
    }
}

/// Whether coding and noise by example run on the processor: 8-bit pictures on a software adapter.
fn is_coded_on_cpu(recorder: &PassRecorder, pixels: &Pixels) -> bool {
    recorder.gpu.software() && matches!(pixels.codes, Codes::U8(_))
}

/// Submits the recorded work, waits for it and codes a piece of the picture.
fn coded_texture(
    recorder: &mut PassRecorder,
    readbacks: &mut ReadbackSet,
    mut coding: PendingCoding,
    pixels: &Pixels,
) -> Result<Texture, GpuError> {
    let submission = recorder.submit_part();
    coding.readbacks_mut().iter_mut().for_each(|readback| readback.submitted(submission.clone()));
    let texture = coding.texture(recorder, pixels)?;
    coding.into_readbacks().into_iter().for_each(|readback| readbacks.give_back(readback));
    Ok(texture)
}

/// Context of the passes of effects.
fn layer_run<'a>(recorder: &'a mut PassRecorder, inputs: &FrameInputs<'a>) -> LayerRun<'a> {
    let FrameInputs { context, plan, work_rects, .. } = *inputs;
    let (drawn, objects_px) = (work_rects.drawn, work_rects.objects_px);
    LayerRun { recorder, context, coding: plan.coding.as_ref(), drawn, objects_px, geometry_is_read: true }
}

/// The rectangles of the picture in which pixels may change.
fn changed_rects(inputs: &FrameInputs<'_>, layer: &Layer, shadow_mask: Option<&ShadowMask>) -> Vec<Rect> {
    let FrameInputs { job, view, work_rects, .. } = *inputs;
    let pieces = &work_rects.pieces;
    // Effects on real pixels and layers across a seam change pixels everywhere.
    let is_whole = job.capture.whole || layer.real.is_some() || job.picture.is_equirectangular() || pieces.len() > 1;
    if is_whole {
        return pieces.iter().map(|piece| piece.rect).collect();
    }
    let objects = view.footprint.parts.iter().map(|(rect, _)| rect.grown(work_rects.spread_px));
    objects.chain(shadow_mask.iter().flat_map(|image| image.pieces.iter().copied())).collect()
}

/// The region that is coded with a piece, if the frame's format is to be followed, or noise is
/// added to planes.
fn coded_region<'a>(inputs: &FrameInputs<'a>, piece: Rect) -> Option<CodedRegion<'a>> {
    let has_noise = inputs.plan.noise.is_some();
    let unrounded = || has_noise.then_some(&PictureCoding::UNROUNDED);
    let coding = inputs.plan.coding.as_ref().or_else(unrounded)?;
    let reach_px = if has_noise { CONTENT_REACH_PX } else { CHROMA_REACH_PX };
    Some(CodedRegion::new(coding, piece, frame_rect(&inputs.job.frame), reach_px))
}

/// The rectangle of the camera's picture that the composite of `rect` reads, with a margin of 1 px
/// for effects that read neighbours.
fn upload_rect(rect: Rect, frame: &Frame) -> Rect {
    rect.grown(1).intersection(&frame_rect(frame))
}

fn frame_rect(frame: &Frame) -> Rect {
    Rect::full(frame.pixels.width, frame.pixels.height)
}
