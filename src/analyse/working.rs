//! Passes over the recording, with how far it is and how long they take.

use std::time::Instant;

use super::depth_clock::{DepthClock, DepthLater};
use super::depths::Depths;
use super::eye::Eye;
use super::interrupted::Interrupted;
use super::links::{Links, Pass, links};
use super::part::Part;
use super::reading;
use super::registered::RegistrationError;
use super::state::State;
use super::times::{self, Times};
use crate::camera::NoiseProfile;
use crate::recording::{Recording, RecordingError};

/// Frames that are looked at for depth's clock.
const DEPTH_FRAMES: usize = 200;

pub struct Work<'a> {
    pub recording: &'a Recording,
    /// The camera's, if that was calibrated.
    pub noise: Option<&'a NoiseProfile>,
    pub threads: usize,
    pub part: &'a mut Part,
    /// Frames looked at, and all that will be.
    pub done: usize,
    pub whole: usize,
    pub times: &'a mut Times,
    pub told: &'a mut dyn FnMut(usize, usize) -> Result<(), Interrupted>,
}

impl Work<'_> {
    /// The links of a pass, a part of that name.
    pub fn links(
        &mut self,
        name: &'static str,
        eye: &Eye,
        states: &[Option<State>],
        depth_later_s: f64,
        pass: Pass<'_>,
    ) -> Result<Links, RegistrationError> {
        let Self { recording, noise, threads, part, done, whole, times, told } = self;
        let frames = recording.frame_count().div_ceil(pass.every);
        let found = part.stage(|| -> Result<Links, RegistrationError> {
            let begun = Instant::now();
            let mut ended = Ok(());
            let mut depths = Depths::new(eye, recording, states, depth_later_s, *threads)?;
            let found = links(eye, recording, states, &mut depths, pass, *noise, *threads, &mut |seen: usize| {
                ended = told(*done + (seen + 1) * frames / recording.frame_count(), *whole);
                ended.is_ok()
            })?;
            ended?;
            times.add(name, begun.elapsed().saturating_sub(found.waited));
            times.add(times::READING, found.waited);
            Ok(found)
        })?;
        *done += frames;
        Ok(found)
    }

    /// One per frame: whether its picture has the code values of the one before.
    pub fn repeats(&mut self) -> Result<Vec<bool>, RegistrationError> {
        let Self { recording, part, times, .. } = self;
        part.stage(|| {
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

    /// By how much depth was measured later than it says.
    pub fn depth_clock(&mut self, eye: &Eye, states: &[Option<State>]) -> Result<Option<DepthLater>, RecordingError> {
        let Self { recording, threads, part, times, .. } = self;
        part.stage(|| {
            let mut clock = DepthClock::default();
            let frames = recording.frame_count();
            let every = frames.div_ceil(DEPTH_FRAMES).max(1);
            let mut coming = reading::frames(recording, (0..frames).step_by(every));
            while let Some(frame) = times.of(times::READING, || coming.next()) {
                let frame = frame?;
                if let Some(state) = states[frame.index].as_ref().filter(|_| frame.index.is_multiple_of(every)) {
                    times.of(times::DEPTH, || clock.add(eye, &frame, state, *threads));
                }
            }
            Ok(times.of(times::DEPTH, || clock.finish()))
        })
    }
}
