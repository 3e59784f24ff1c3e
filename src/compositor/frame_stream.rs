//! A stream of frames through the compositor: decoding, GPU work and encoding overlap.

use std::borrow::Cow;
use std::collections::VecDeque;
use std::iter::Fuse;

use super::{Composited, Compositor, Job, Pending, Settings, SubmitError, Target};
use crate::camera::{Camera, Geometry};
use crate::frame::Frame;
use crate::gpu::GpuError;
use crate::tracking::PoseTrack;

/// Default number of frames in flight: one is drawn while another is read back.
pub const IN_FLIGHT: usize = 2;

/// Inputs that all frames of a stream share.
#[derive(Clone, Debug)]
pub struct StreamInputs<'a> {
    pub camera: Cow<'a, Camera>,
    pub settings: &'a Settings,
    pub track: &'a PoseTrack,
    pub want_layers: bool,
    /// Frames to submit before waiting for the first. 0 means 1.
    pub in_flight: usize,
}

/// A frame with its geometry and interval.
#[derive(Clone, Debug)]
pub struct StreamFrame {
    pub frame: Frame,
    pub geometry: Geometry,
    /// Seconds to the next frame.
    pub interval_s: f64,
}

/// Why a stream ended early.
#[derive(Debug, thiserror::Error)]
pub enum FrameStreamError<E: std::error::Error> {
    #[error(transparent)]
    Source(E),
    #[error("frame {frame}: {source}")]
    Gpu { frame: usize, source: GpuError },
    #[error("frame {frame}: {source}")]
    Submit { frame: usize, source: SubmitError },
}

/// The composited frames of [`Compositor::composite_stream`], in order. It ends after an error.
#[derive(Debug)]
pub struct FrameStream<'a, I> {
    compositor: &'a mut Compositor,
    shared: StreamInputs<'a>,
    frames: Fuse<I>,
    pending: VecDeque<(usize, Pending)>,
    failed: bool,
}

impl Compositor {
    /// Composites each frame of `frames`. Memory does not grow with the length of the stream.
    pub fn composite_stream<'a, E, I>(&'a mut self, shared: StreamInputs<'a>, frames: I) -> FrameStream<'a, I::IntoIter>
    where
        E: std::error::Error,
        I: IntoIterator<Item = Result<StreamFrame, E>>,
    {
        FrameStream {
            compositor: self,
            shared,
            frames: frames.into_iter().fuse(),
            pending: VecDeque::new(),
            failed: false,
        }
    }
}

impl<E: std::error::Error, I: Iterator<Item = Result<StreamFrame, E>>> FrameStream<'_, I> {
    fn submit(&mut self, input: StreamFrame) -> Result<(), FrameStreamError<E>> {
        let StreamInputs { camera, settings, track, want_layers, .. } = &self.shared;
        let StreamFrame { frame, geometry, interval_s } = input;
        let index = frame.index;
        let failed = |source| FrameStreamError::Submit { frame: index, source };
        let job = Job::of_frame(frame, camera, settings, &geometry, track, interval_s);
        let job = job.map_err(|lens| failed(lens.into()))?;
        let job = Job { want_layer: *want_layers, ..job };
        let pending = self.compositor.submit(job, camera, settings, Target::Pixels).map_err(failed)?;
        self.pending.push_back((index, pending));
        Ok(())
    }

    fn step(&mut self) -> Result<Option<Composited>, FrameStreamError<E>> {
        while self.pending.len() < self.shared.in_flight.max(1) {
            let Some(input) = self.frames.next() else { break };
            self.submit(input.map_err(FrameStreamError::Source)?)?;
        }
        let Some((frame, pending)) = self.pending.pop_front() else { return Ok(None) };
        self.compositor.collect(pending).map(Some).map_err(|source| FrameStreamError::Gpu { frame, source })
    }
}

impl<E: std::error::Error, I: Iterator<Item = Result<StreamFrame, E>>> Iterator for FrameStream<'_, I> {
    type Item = Result<Composited, FrameStreamError<E>>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.failed {
            return None;
        }
        let done = self.step().transpose();
        self.failed = matches!(done, Some(Err(_)));
        done
    }
}
