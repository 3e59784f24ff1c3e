//! Frames whose work is on the GPU, and how their pictures are read back.

use std::sync::Arc;

use super::coded::PendingCoding;
use super::frame_inputs::FrameInputs;
use super::mix::CompositePiece;
use super::paste::{fill_noise, paste, paste_fringe, paste_layer, paste_shadow_mask};
use super::{Composited, Compositor, FrameStats};
use crate::camera::Response;
use crate::frame::Frame;
use crate::gpu::{Gpu, GpuError, PartTime, PassRecorder, PendingTimes, Readback, ReadbackSet, Texture};
use crate::pixels::{LayerImage, Pixels, Rect};
use crate::render::Layer;
use crate::stage::Stage;

/// A frame whose work is on the GPU.
#[derive(Debug)]
pub struct Pending {
    pub(super) frame: Frame,
    pub(super) stats: FrameStats,
    pub(super) want_layer: bool,
    pub(super) readbacks: Option<FrameReadbacks>,
    /// Earlier submissions of the frame, in order, without the last.
    pub(super) parts: Vec<wgpu::SubmissionIndex>,
    /// `None` if nothing had to be drawn.
    pub(super) last: Option<wgpu::SubmissionIndex>,
    pub(super) timed: Vec<PendingTimes>,
    pub(super) is_preview: bool,
    pub(super) stages: Vec<Stage>,
}

/// The readbacks of a frame.
#[derive(Debug, Default)]
pub struct FrameReadbacks {
    /// Empty if the picture went into a view.
    pub codes: Vec<(CompositePiece, Readback)>,
    /// Pieces that are coded on the processor.
    pub coded: Vec<PendingCoding>,
    pub layer: Option<LayerReadback>,
}

/// The readbacks of a frame's layer.
#[derive(Debug)]
pub struct LayerReadback {
    drawn: Rect,
    over_seam: bool,
    light_alone: bool,
    opacity: f32,
    parts: [Readback; 2],
    fringe: Option<Readback>,
    shadowed: Rect,
    shadow_mask: Option<Readback>,
    response: Response,
}

impl LayerReadback {
    pub fn new(
        recorder: &mut PassRecorder,
        readbacks: &mut ReadbackSet,
        inputs: &FrameInputs<'_>,
        layer: &Layer,
        shadow_mask: Option<&Texture>,
    ) -> Self {
        let pieces = &inputs.work_rects.pieces;
        let shadowed = &inputs.work_rects.shadowed;
        let mut read_back = |texture, size| recorder.read_back(readbacks, texture, size);
        Self {
            drawn: pieces[0].drawn,
            over_seam: pieces.len() > 1,
            light_alone: layer.light_alone,
            opacity: inputs.job.frame.opacity as f32,
            parts: [&layer.color, &layer.geometry].map(|texture| read_back(texture, layer.size)),
            fringe: layer.fringe.as_ref().map(|texture| read_back(texture, layer.size)),
            shadowed: pieces[0].shadowed,
            response: inputs.camera.response.clone(),
            shadow_mask: shadow_mask.map(|texture| read_back(texture, (shadowed.width(), shadowed.height()))),
        }
    }

    /// Adds the layer to an empty image. `camera` and `composite` are the picture before and after
    /// compositing.
    fn paste(&self, gpu: &Gpu, camera: &Pixels, composite: &Pixels, image: &mut LayerImage) -> Result<(), GpuError> {
        let [color, geometry] = &self.parts;
        image.light_alone = self.light_alone;
        paste_layer(gpu, [color, geometry], self.drawn, self.over_seam, image)?;
        image.fade(self.opacity);
        if let Some(shadow_mask) = &self.shadow_mask {
            paste_shadow_mask(gpu, shadow_mask, self.shadowed, self.over_seam, image)?;
        }
        if let Some(fringe) = &self.fringe {
            paste_fringe(gpu, fringe, self.drawn, self.over_seam, image)?;
        }
        fill_noise(camera, composite, &self.response, image);
        Ok(())
    }

    fn readbacks(&self) -> impl Iterator<Item = &Readback> {
        self.parts.iter().chain(&self.shadow_mask).chain(&self.fringe)
    }

    fn readbacks_mut(&mut self) -> impl Iterator<Item = &mut Readback> {
        self.parts.iter_mut().chain(&mut self.shadow_mask).chain(&mut self.fringe)
    }

    fn into_readbacks(self) -> impl Iterator<Item = Readback> {
        self.parts.into_iter().chain(self.shadow_mask).chain(self.fringe)
    }
}

impl FrameReadbacks {
    fn readbacks(&self) -> impl Iterator<Item = &Readback> {
        let codes = self.codes.iter().map(|(_, readback)| readback);
        let coded = self.coded.iter().flat_map(PendingCoding::readbacks);
        codes.chain(coded).chain(self.layer.iter().flat_map(LayerReadback::readbacks))
    }

    pub fn submitted(&mut self, submission: &wgpu::SubmissionIndex) {
        let codes = self.codes.iter_mut().map(|(_, readback)| readback);
        let layer = self.layer.iter_mut().flat_map(LayerReadback::readbacks_mut);
        let coded = self.coded.iter_mut().flat_map(PendingCoding::readbacks_mut);
        codes.chain(coded).chain(layer).for_each(|readback| readback.submitted(submission.clone()));
    }
}

impl Pending {
    pub fn stats(&self) -> &FrameStats {
        &self.stats
    }

    /// True if shadows or occlusion have preview quality ([`Compositor::allow_preview`]).
    pub fn is_preview(&self) -> bool {
        self.is_preview
    }

    /// The stages that were computed, in order ([`Compositor::submit`]). Single textures, lightmaps
    /// or the repaired depth of such a stage may still come from a memo of the process.
    pub fn stages(&self) -> &[Stage] {
        &self.stages
    }

    /// Waits until the GPU has finished; callable from any thread. A picture in a
    /// [`Target::View`](super::Target::View) is complete then.
    pub fn await_drawn(&self, gpu: &Gpu) -> Result<(), GpuError> {
        self.last.clone().map_or(Ok(()), |last| gpu.wait(Some(last)))
    }

    /// Waits and returns the GPU time of each part, if timing was requested
    /// ([`Compositor::time_next`]): `depth`, `shadow`, `objects`, each effect by its table, and
    /// `mix`, with the effects of the mixed stage. Parts of retained stages are missing.
    pub fn times(&self, gpu: &Gpu) -> Result<Vec<PartTime>, GpuError> {
        PendingTimes::times(&self.timed, gpu)
    }
}

impl Compositor {
    /// True if [`Compositor::collect`] would return without waiting.
    pub fn is_done(&self, pending: &Pending) -> Result<bool, GpuError> {
        for readback in pending.readbacks.iter().flat_map(FrameReadbacks::readbacks) {
            if !readback.is_ready(self.gpu())? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Waits for the earlier submissions of a frame; after each, `done` receives the finished
    /// fraction. [`Compositor::collect`] waits for the last.
    pub fn await_parts(&self, pending: &Pending, mut done: impl FnMut(f64)) -> Result<(), GpuError> {
        for (n, part) in pending.parts.iter().enumerate() {
            self.gpu().wait(Some(part.clone()))?;
            done((n + 1) as f64 / (pending.parts.len() + 1) as f64);
        }
        Ok(())
    }

    /// Waits for a frame and returns its picture: the camera's pixels, with the composited
    /// rectangles pasted in.
    pub fn collect(&mut self, pending: Pending) -> Result<Composited, GpuError> {
        let Pending { frame, stats, want_layer, readbacks, .. } = pending;
        let index = frame.index;
        let mut pixels = Arc::unwrap_or_clone(frame.pixels);
        let mut layer = want_layer.then(|| LayerImage::empty(pixels.width, pixels.height));
        let FrameReadbacks { codes, coded, layer: layer_readback } = readbacks.unwrap_or_default();
        let camera = layer_readback.is_some().then(|| pixels.clone());
        for (piece, codes) in codes {
            paste(self.gpu(), &codes, piece.rect, &mut pixels)?;
            self.readbacks.give_back(codes);
        }
        for piece in coded {
            piece.paste(self.gpu(), &mut pixels)?;
            piece.into_readbacks().into_iter().for_each(|readback| self.readbacks.give_back(readback));
        }
        if let ((Some(image), Some(camera)), Some(readback)) = ((&mut layer, &camera), layer_readback) {
            readback.paste(self.gpu(), camera, &pixels, image)?;
            readback.into_readbacks().for_each(|readback| self.readbacks.give_back(readback));
        }
        Ok(Composited { frame: index, pixels, layer, stats })
    }
}
