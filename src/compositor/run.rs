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
pub struct Stream<'a> {
    pub camera: Cow<'a, Camera>,
    pub settings: &'a Settings,
    pub track: &'a PoseTrack,
    pub want_layers: bool,
    /// Frames to submit before waiting for the first. 0 means 1.
    pub in_flight: usize,
}

/// A frame with its geometry and interval.
#[derive(Clone, Debug)]
pub struct Input {
    pub frame: Frame,
    pub geometry: Geometry,
    /// Seconds to the next frame.
    pub interval_s: f64,
}

/// Why a stream ended early.
#[derive(Debug, thiserror::Error)]
pub enum RunError<E: std::error::Error> {
    #[error(transparent)]
    Source(E),
    #[error("frame {frame}: {source}")]
    Gpu { frame: usize, source: GpuError },
    #[error("frame {frame}: {source}")]
    Submit { frame: usize, source: SubmitError },
}

/// Iterator over composited frames, in order, from [`Compositor::run`]. It ends after an error.
#[derive(Debug)]
pub struct Run<'a, I> {
    compositor: &'a mut Compositor,
    stream: Stream<'a>,
    frames: Fuse<I>,
    pending: VecDeque<(usize, Pending)>,
    failed: bool,
}

impl Compositor {
    /// Composites each frame of `frames`. Memory does not grow with the length of the stream.
    pub fn run<'a, E, I>(&'a mut self, stream: Stream<'a>, frames: I) -> Run<'a, I::IntoIter>
    where
        E: std::error::Error,
        I: IntoIterator<Item = Result<Input, E>>,
    {
        Run { compositor: self, stream, frames: frames.into_iter().fuse(), pending: VecDeque::new(), failed: false }
    }
}

impl<E: std::error::Error, I: Iterator<Item = Result<Input, E>>> Run<'_, I> {
    fn submit(&mut self, input: Input) -> Result<(), RunError<E>> {
        let Stream { camera, settings, track, want_layers, .. } = &self.stream;
        let Input { frame, geometry, interval_s } = input;
        let index = frame.index;
        let failed = |source| RunError::Submit { frame: index, source };
        let job = Job::of_frame(frame, camera, settings, &geometry, track, interval_s);
        let job = job.map_err(|lens| failed(lens.into()))?;
        let job = Job { want_layer: *want_layers, ..job };
        let work = self.compositor.submit(job, camera, settings, Target::Pixels).map_err(failed)?;
        self.pending.push_back((index, work));
        Ok(())
    }

    fn step(&mut self) -> Result<Option<Composited>, RunError<E>> {
        while self.pending.len() < self.stream.in_flight.max(1) {
            let Some(input) = self.frames.next() else { break };
            self.submit(input.map_err(RunError::Source)?)?;
        }
        let Some((frame, work)) = self.pending.pop_front() else { return Ok(None) };
        self.compositor.collect(work).map(Some).map_err(|source| RunError::Gpu { frame, source })
    }
}

impl<E: std::error::Error, I: Iterator<Item = Result<Input, E>>> Iterator for Run<'_, I> {
    type Item = Result<Composited, RunError<E>>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.failed {
            return None;
        }
        let done = self.step().transpose();
        self.failed = matches!(done, Some(Err(_)));
        done
    }
}
