//! A stream of frames through the compositor: decoding, GPU work and encoding overlap.

use std::collections::VecDeque;

use super::{Composited, Compositor, Job, Pending, Settings, SubmitError, Target};
use crate::camera::{Camera, Geometry};
use crate::frame::Frame;
use crate::gpu::GpuError;
use crate::tracking::PoseTrack;

/// How many frames are on the GPU before the first of them is waited for.
const IN_FLIGHT: usize = 2;

/// What all frames of a stream share.
#[derive(Debug)]
pub struct Stream<'a> {
    pub camera: &'a Camera,
    pub settings: &'a Settings,
    pub track: &'a PoseTrack,
    pub time_offset_s: f64,
    pub want_layers: bool,
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
    #[error(transparent)]
    Taker(E),
}

impl Compositor {
    /// Composites each frame that `frames` gives and hands it to `take`, in order. `about`
    /// gives a frame's geometry and the time to its next one. Memory does not grow with the
    /// length of the stream.
    pub fn run<'g, E: std::error::Error>(
        &mut self,
        stream: &Stream<'_>,
        frames: impl Iterator<Item = Result<Frame, E>>,
        about: impl Fn(usize) -> (&'g Geometry, f64),
        mut take: impl FnMut(Composited) -> Result<(), E>,
    ) -> Result<(), RunError<E>> {
        let mut pending: VecDeque<(usize, Pending)> = VecDeque::new();
        let mut finish = |compositor: &mut Self, (frame, work): (usize, Pending)| {
            let done = compositor.collect(work).map_err(|source| RunError::Gpu { frame, source })?;
            take(done).map_err(RunError::Taker)
        };
        for frame in frames {
            let frame = frame.map_err(RunError::Source)?;
            let index = frame.index;
            let (geometry, interval_s) = about(index);
            let work = self.submit_of(stream, frame, geometry, interval_s);
            pending.push_back((index, work.map_err(|source| RunError::Submit { frame: index, source })?));
            if pending.len() >= IN_FLIGHT
                && let Some(oldest) = pending.pop_front()
            {
                finish(self, oldest)?;
            }
        }
        for oldest in pending {
            finish(self, oldest)?;
        }
        Ok(())
    }

    fn submit_of(
        &mut self,
        stream: &Stream<'_>,
        frame: Frame,
        geometry: &Geometry,
        interval_s: f64,
    ) -> Result<Pending, SubmitError> {
        let Stream { camera, settings, track, time_offset_s, want_layers } = *stream;
        let job = Job::of_frame(frame, camera, settings, geometry, track, interval_s)?;
        let job = Job { time_offset_s, want_layer: want_layers, ..job };
        self.submit(job, camera, settings, Target::Pixels)
    }
}
