//! Passes over the recording, with progress, checkpoints and timing.

use std::time::Instant;

use super::camera_model::CameraModel;
use super::checkpoint::Checkpoints;
use super::depth_clock::{DepthClock, DepthOffset};
use super::depth_source::DepthSource;
use super::interrupted::Interrupted;
use super::links::{LinkPass, LinkRequest, Links};
use super::registration_result::RegistrationError;
use super::sparse_frames;
use super::state::CameraState;
use super::times::{self, Times};
use crate::camera::NoiseProfile;
use crate::recording::{Recording, RecordingError};

/// Largest number of frames from which depth's clock is estimated.
const MAX_DEPTH_CLOCK_FRAMES: usize = 200;

/// State of an analysis, shared by its passes.
pub struct PassRunner<'a> {
    pub recording: &'a Recording,
    /// The camera's, if calibrated.
    pub noise: Option<&'a NoiseProfile>,
    pub threads: usize,
    pub checkpoints: &'a mut Checkpoints,
    /// Frames processed so far, and in total.
    pub done: usize,
    pub total: usize,
    pub times: &'a mut Times,
    pub report: &'a mut dyn FnMut(usize, usize) -> Result<(), Interrupted>,
}

impl PassRunner<'_> {
    /// The links of a pass. `name`: the entry of [`Times`] for its duration.
    pub fn links(
        &mut self,
        name: &'static str,
        model: &CameraModel,
        states: &[Option<CameraState>],
        depth_later_s: f64,
        pass: LinkPass<'_>,
    ) -> Result<Links, RegistrationError> {
        let Self { recording, noise, threads, checkpoints, done, total, times, report } = self;
        let frames = recording.frame_count().div_ceil(pass.stride);
        let links = checkpoints.stage(|| -> Result<Links, RegistrationError> {
            let begun = Instant::now();
            let mut ended = Ok(());
            let mut depths = DepthSource::new(model, recording, states, depth_later_s, *threads)?;
            let request = LinkRequest { recording, model, states, pass, noise: *noise, threads: *threads };
            let links = request.links(&mut depths, &mut |frame: usize| {
                ended = report(*done + (frame + 1) * frames / recording.frame_count(), *total);
                ended.is_ok()
            })?;
            ended?;
            times.add(name, begun.elapsed().saturating_sub(links.waited));
            times.add(times::READING, links.waited);
            Ok(links)
        })?;
        *done += frames;
        Ok(links)
    }

    /// One per frame: whether its picture has the code values of the one before.
    pub fn repeats(&mut self) -> Result<Vec<bool>, RegistrationError> {
        let Self { recording, checkpoints, times, .. } = self;
        checkpoints.stage(|| {
            let (mut repeats, mut before) = (Vec::new(), None);
            let mut coming = recording.frames(0..recording.frame_count())?;
            while let Some(frame) = times.of(times::READING, || coming.next()) {
                let pixels = Some(frame?.pixels);
                repeats.push(before == pixels);
                before = pixels;
            }
            Ok(repeats)
        })
    }

    /// Estimates the offset of depth's clock.
    pub fn depth_clock(
        &mut self,
        model: &CameraModel,
        states: &[Option<CameraState>],
    ) -> Result<Option<DepthOffset>, RecordingError> {
        let Self { recording, threads, checkpoints, times, .. } = self;
        if !recording.has_measured_depth() {
            return Ok(None);
        }
        checkpoints.stage(|| {
            let mut clock = DepthClock::default();
            let frames = recording.frame_count();
            let every = frames.div_ceil(MAX_DEPTH_CLOCK_FRAMES).max(1);
            let mut coming = sparse_frames::frames(recording, (0..frames).step_by(every));
            while let Some(frame) = times.of(times::READING, || coming.next()) {
                let frame = frame?;
                if let Some(state) = states[frame.index].as_ref().filter(|_| frame.index.is_multiple_of(every)) {
                    times.of(times::DEPTH, || clock.add(model, &frame, state, *threads));
                }
            }
            Ok(times.of(times::DEPTH, || clock.finish()))
        })
    }
}
