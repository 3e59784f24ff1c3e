//! A shot whose frames come one by one.

use std::sync::Arc;

use super::error::LiveError;
use super::intake::{Arrived, Came, Intake};
use super::lenses::Lenses;
use super::track::{PoseTaken, Tracking};
use super::waiting::Counts;
use super::watched::Watched;
use super::writer::Writer;
use crate::camera::{Camera, Geometry};
use crate::compositor::{Composited, Compositor, Job, Pending, Target, poses_within_s};
use crate::frame::Frame;
use crate::pixels::Pixels;
use crate::pose::Pose;
use crate::recording::recorder::RecorderError;
use crate::shot::Shot;
use crate::stream::LensState;
use crate::webcam::Picture;

/// A composited frame.
#[derive(Debug)]
pub struct Shown {
    pub done: Composited,
    pub tracking: Tracking,
    /// The share of the evidence that is seen: it fades while the camera is lost.
    pub presence: f64,
    /// How long it waited for its poses, seconds.
    pub waited_s: f64,
    /// When its picture came, by the clock that [`Live::picture`] was told.
    pub came_s: f64,
    /// When it was taken, by the camera's clock.
    pub taken_s: f64,
}

/// Frames in, composites out; the camera, the scene and the settings are the shot's. What is recorded is what is seen.
pub struct Live<'a> {
    shot: &'a Shot,
    compositor: &'a mut Compositor,
    camera: Camera,
    geometry: Geometry,
    intake: Intake,
}

impl<'a> Live<'a> {
    /// The shot is one of [`crate::recording::Recording::arriving`]. Frames wait for their poses at most `patience_s`; those of a
    /// stream that says its lens have cameras by `lenses`.
    pub fn new(
        shot: &'a Shot,
        compositor: &'a mut Compositor,
        max_gap_s: f64,
        patience_s: f64,
        writer: Option<Writer>,
        lenses: Option<Lenses>,
    ) -> Result<Self, LiveError> {
        let (camera, geometry) = (shot.camera(), shot.geometry_at(0)?);
        compositor.place(&shot.objects());
        let intake = Intake::new(max_gap_s, patience_s, writer).with_lenses(lenses);
        Ok(Self { shot, compositor, camera, geometry, intake })
    }

    pub fn counts(&self) -> Counts {
        self.intake.counts()
    }

    /// Frames that were taken.
    pub fn frames(&self) -> usize {
        self.intake.frames()
    }

    pub fn writer(&self) -> Option<&Writer> {
        self.intake.writer()
    }

    /// Takes the recorder away: the rest is not recorded.
    pub fn take_writer(&mut self) -> Option<Writer> {
        self.intake.take_writer()
    }

    pub fn pose(&mut self, time_s: f64, pose: &Pose) -> PoseTaken {
        self.intake.pose(time_s, pose)
    }

    /// Takes what a stream said of its lens with a pose of a time.
    pub fn lens(&mut self, time_s: f64, state: &Arc<LensState>) {
        self.intake.lens(time_s, state);
    }

    /// Takes the poses that have come, for frames up to a time.
    pub fn take_poses(&mut self, watched: &mut Watched, last_frame_s: f64) -> Result<(), LiveError> {
        self.intake.take_poses(watched, last_frame_s)
    }

    /// Takes a picture whose pixels are decoded, and records it.
    pub fn picture(&mut self, picture: &Picture, pixels: Pixels, now_s: f64) -> Came {
        let (camera, settings, geometry) = (&self.camera, &self.shot.settings, &self.geometry);
        let interval_s = self.shot.recording.frame_interval_s;
        let within_s = |frame: &Frame| poses_within_s(frame, camera, settings, geometry, interval_s);
        self.intake.picture(picture, pixels, within_s, now_s)
    }

    /// When the next frame will have waited for its poses.
    pub fn due_s(&self) -> Option<f64> {
        self.intake.due_s()
    }

    /// Starts the next frame that need not wait any longer.
    pub fn submit(&mut self, now_s: f64) -> Result<Option<Submitted>, LiveError> {
        let Some(Arrived { frame, geometry, tracking, waited_s, came_s }) = self.intake.next(now_s) else {
            return Ok(None);
        };
        let (index, taken_s, presence) = (frame.index, frame.timestamp_s, frame.presence);
        let (interval_s, settings) = (self.shot.recording.frame_interval_s, &self.shot.settings);
        // As the recording's shot will have it.
        let own = geometry.and_then(|own| self.shot.rig.geometry_over(Some(&own)));
        let geometry = own.as_ref().unwrap_or(&self.geometry);
        let job = Job::of_frame(frame, &self.camera, settings, geometry, self.intake.track(), interval_s)?;
        let pending = self.compositor.submit(job, &self.camera, settings, Target::Pixels);
        let pending = pending.map_err(|source| LiveError::Submit { frame: index, source })?;
        Ok(Some(Submitted { pending, index, tracking, presence, waited_s, came_s, taken_s }))
    }

    /// Waits for a frame that was started.
    pub fn collect(&mut self, submitted: Submitted) -> Result<Shown, LiveError> {
        let Submitted { pending, index, tracking, presence, waited_s, came_s, taken_s } = submitted;
        let done = self.compositor.collect(pending).map_err(|source| LiveError::Gpu { frame: index, source })?;
        Ok(Shown { done, tracking, presence, waited_s, came_s, taken_s })
    }

    /// Ends the recording, if there is one: how many frames it has, and why it ended earlier if it did.
    pub fn finish(self) -> Option<(usize, Option<RecorderError>)> {
        self.intake.finish()
    }
}

/// A frame that is on the GPU.
#[derive(Debug)]
pub struct Submitted {
    pending: Pending,
    index: usize,
    tracking: Tracking,
    presence: f64,
    waited_s: f64,
    came_s: f64,
    taken_s: f64,
}
