//! Compositor of frames that arrive one by one.

use std::sync::Arc;

use super::capture::LiveCapture;
use super::error::LiveError;
use super::frame_queue::LiveCounts;
use super::intake::{Intake, LiveFrame, PictureOutcome};
use super::lens_track::LensTrack;
use super::recorder_thread::RecorderThread;
use super::track::{PoseOutcome, Tracking};
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
pub struct LiveComposite {
    pub done: Composited,
    pub tracking: Tracking,
    /// Opacity of the evidence, which fades while tracking is lost.
    pub opacity: f64,
    /// Time that the frame waited for its poses, seconds.
    pub waited_s: f64,
    /// Arrival of the picture: the `now_s` of [`LiveCompositor::add_picture`].
    pub arrived_s: f64,
    /// Time stamp of the picture, by the camera's clock.
    pub taken_s: f64,
}

/// Composites frames with the camera, scene and settings of a shot. The recording reproduces the
/// composited images.
pub struct LiveCompositor<'a> {
    shot: &'a Shot,
    compositor: &'a mut Compositor,
    camera: Camera,
    geometry: Geometry,
    intake: Intake,
}

impl<'a> LiveCompositor<'a> {
    /// The shot is one of [`crate::recording::Recording::live`]. Frames wait for their poses at
    /// most `max_wait_s`. `lens_track` has the cameras of a stream with lens data.
    pub fn new(
        shot: &'a Shot,
        compositor: &'a mut Compositor,
        max_gap_s: f64,
        max_wait_s: f64,
        recorder: Option<RecorderThread>,
        lens_track: Option<LensTrack>,
    ) -> Result<Self, LiveError> {
        let (camera, geometry) = (shot.camera(), shot.geometry_at(0)?);
        compositor.place(&shot.objects());
        let intake = Intake::new(max_gap_s, max_wait_s, recorder).with_lens_track(lens_track);
        Ok(Self { shot, compositor, camera, geometry, intake })
    }

    pub fn counts(&self) -> LiveCounts {
        self.intake.counts()
    }

    /// Number of accepted frames.
    pub fn frames(&self) -> usize {
        self.intake.frames()
    }

    pub fn recorder(&self) -> Option<&RecorderThread> {
        self.intake.recorder()
    }

    /// Takes the recorder out; further frames are not recorded.
    pub fn take_recorder(&mut self) -> Option<RecorderThread> {
        self.intake.take_recorder()
    }

    pub fn add_pose(&mut self, time_s: f64, pose: &Pose) -> PoseOutcome {
        self.intake.add_pose(time_s, pose)
    }

    /// Adds the lens data that a stream sent with a pose.
    pub fn add_lens_state(&mut self, time_s: f64, state: &Arc<LensState>) {
        self.intake.add_lens_state(time_s, state);
    }

    /// Takes the available poses for frames up to a time.
    pub fn take_poses(&mut self, capture: &mut LiveCapture, last_frame_s: f64) -> Result<(), LiveError> {
        self.intake.take_poses(capture, last_frame_s)
    }

    /// Adds a decoded picture and records it.
    pub fn add_picture(&mut self, picture: &Picture, pixels: Pixels, now_s: f64) -> PictureOutcome {
        let (camera, settings, geometry) = (&self.camera, &self.shot.settings, &self.geometry);
        let interval_s = self.shot.recording.frame_interval_s;
        let within_s = |frame: &Frame| poses_within_s(frame, camera, settings, geometry, interval_s);
        self.intake.add_picture(picture, pixels, within_s, now_s)
    }

    /// Deadline of the next frame.
    pub fn due_s(&self) -> Option<f64> {
        self.intake.due_s()
    }

    /// Submits the next frame whose poses are final.
    pub fn submit(&mut self, now_s: f64) -> Result<Option<InFlightFrame>, LiveError> {
        let Some(LiveFrame { frame, geometry, tracking, waited_s, arrived_s }) = self.intake.next(now_s) else {
            return Ok(None);
        };
        let (index, taken_s, opacity) = (frame.index, frame.timestamp_s, frame.opacity);
        let (interval_s, settings) = (self.shot.recording.frame_interval_s, &self.shot.settings);
        // The same geometry as in a shot of the recording.
        let own = geometry.and_then(|own| self.shot.rig.geometry_over(Some(&own)));
        let geometry = own.as_ref().unwrap_or(&self.geometry);
        let frame = self.shot.with_live_depth(frame, geometry, self.intake.track());
        let job = Job::of_frame(frame, &self.camera, settings, geometry, self.intake.track(), interval_s)?;
        let pending = self.compositor.submit(job, &self.camera, settings, Target::Pixels);
        let pending = pending.map_err(|source| LiveError::Submit { frame: index, source })?;
        Ok(Some(InFlightFrame { pending, index, tracking, opacity, waited_s, arrived_s, taken_s }))
    }

    /// Waits for a submitted frame.
    pub fn collect(&mut self, submitted: InFlightFrame) -> Result<LiveComposite, LiveError> {
        let InFlightFrame { pending, index, tracking, opacity, waited_s, arrived_s, taken_s } = submitted;
        let done = self.compositor.collect(pending).map_err(|source| LiveError::Gpu { frame: index, source })?;
        Ok(LiveComposite { done, tracking, opacity, waited_s, arrived_s, taken_s })
    }

    /// Ends the recording, if there is one. Returns its number of frames, and the error if one
    /// ended it earlier.
    pub fn finish(self) -> Option<(usize, Option<RecorderError>)> {
        self.intake.finish()
    }
}

/// A frame in flight on the GPU.
#[derive(Debug)]
pub struct InFlightFrame {
    pending: Pending,
    index: usize,
    tracking: Tracking,
    opacity: f64,
    waited_s: f64,
    arrived_s: f64,
    taken_s: f64,
}
