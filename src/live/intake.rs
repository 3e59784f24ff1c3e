//! Takes pictures and poses, records them, and emits frames that have their poses.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::capture::LiveCapture;
use super::error::LiveError;
use super::frame_queue::{FrameQueue, LiveCounts, ReleasedFrame};
use super::lens_track::LensTrack;
use super::picture_file::picture_file;
use super::recorder_thread::RecorderThread;
use super::replay_buffer::ReplayBuffer;
use super::track::{PoseOutcome, Tracking};
use crate::camera::Geometry;
use crate::frame::{Frame, FrameExposure, FrameLens};
use crate::pixels::Pixels;
use crate::pose::Pose;
use crate::profile::Rig;
use crate::recording::recorder::RecorderError;
use crate::source::exif;
use crate::stream::LensState;
use crate::tracking::PoseTrack;
use crate::tracking::covariance::Covariance;
use crate::webcam::Picture;

/// Outcome of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureOutcome {
    Accepted,
    /// Dropped, not composited either: the disk is too slow.
    NotRecorded,
    /// Not later than the picture before.
    OutOfOrder,
}

/// A frame whose poses are final.
#[derive(Clone, Debug)]
pub struct LiveFrame {
    /// Has the recorded [opacity](Frame::opacity) and [lens](FrameExposure::lens).
    pub frame: Frame,
    /// Geometry of the frame's camera, as recorded, if a stream describes the lens.
    pub geometry: Option<Geometry>,
    pub tracking: Tracking,
    /// Time that the frame waited for its poses, seconds.
    pub waited_s: f64,
    /// Arrival of the picture: the `now_s` of [`Intake::add_picture`].
    pub arrived_s: f64,
}

/// Queue of frames that wait for their poses. Emitted frames and poses equal those of the
/// recording, bit for bit.
#[derive(Debug)]
pub struct Intake {
    queue: FrameQueue<(Frame, f64)>,
    recorder: Option<RecorderThread>,
    replay: Option<Arc<Mutex<ReplayBuffer>>>,
    lens_track: Option<LensTrack>,
    frames: usize,
    /// Time of the recording's last frame, which may still wait.
    ends_at_s: Option<f64>,
    /// Times of the last accepted picture and of the last emitted frame.
    last_s: f64,
    emitted_s: f64,
}

impl Intake {
    /// Poses are interpolated across at most `max_gap_s`. Frames wait for their poses at most
    /// `max_wait_s`.
    pub fn new(max_gap_s: f64, max_wait_s: f64, recorder: Option<RecorderThread>) -> Self {
        let queue = FrameQueue::new(max_gap_s, max_wait_s);
        let never_s = f64::NEG_INFINITY;
        Self {
            queue,
            recorder,
            replay: None,
            lens_track: None,
            frames: 0,
            ends_at_s: None,
            last_s: never_s,
            emitted_s: never_s,
        }
    }

    /// Keeps the last seconds in memory.
    pub fn with_replay_buffer(self, replay: Arc<Mutex<ReplayBuffer>>) -> Self {
        Self { replay: Some(replay), ..self }
    }

    /// Gives each frame a camera of its own.
    pub fn with_lens_track(self, lens_track: Option<LensTrack>) -> Self {
        Self { lens_track, ..self }
    }

    /// Sets the rig, whose settings override the stream's lens.
    pub fn set_rig(&mut self, rig: &Rig) {
        self.lens_track.iter_mut().for_each(|lens_track| lens_track.set_rig(rig));
    }

    pub fn counts(&self) -> LiveCounts {
        self.queue.counts()
    }

    /// Number of accepted frames, since the start of the recording if there is one.
    pub fn frames(&self) -> usize {
        self.frames
    }

    pub fn recorder(&self) -> Option<&RecorderThread> {
        self.recorder.as_ref()
    }

    /// Takes the recorder out; further frames are not recorded.
    pub fn take_recorder(&mut self) -> Option<RecorderThread> {
        self.recorder.take()
    }

    /// Starts a recording with the next picture, which gets number 0.
    pub fn record(&mut self, recorder: RecorderThread) {
        // The motion blur of the first frames needs earlier poses.
        if let Some(replay) = self.replay() {
            recorder.poses(replay.poses());
        }
        (self.recorder, self.frames, self.ends_at_s) = (Some(recorder), 0, None);
    }

    /// Stops recording further pictures. The recording is complete, and can be ended, when
    /// [`Intake::is_recorded`]: once the queued frames have their poses.
    pub fn stop_recording(&mut self) {
        self.ends_at_s = self.recorder.as_ref().map(|_| self.last_s);
    }

    pub fn is_recorded(&self) -> bool {
        self.ends_at_s.is_some_and(|ends_at_s| self.emitted_s >= ends_at_s)
    }

    pub fn add_pose(&mut self, time_s: f64, pose: &Pose) -> PoseOutcome {
        let outcome = self.queue.add_pose(time_s, pose);
        if self.queue.due_s().is_none() {
            self.record_poses();
        }
        outcome
    }

    /// Takes the available poses for frames up to a time, with their covariances and lens data.
    pub fn take_poses(&mut self, capture: &mut LiveCapture, last_frame_s: f64) -> Result<(), LiveError> {
        let dead_reckoned = capture.take_dead_reckoned();
        for (time_s, pose) in capture.take_poses(last_frame_s)? {
            capture.lens(time_s).into_iter().for_each(|state| self.add_lens_state(time_s, &state));
            if self.add_pose(time_s, &pose) == PoseOutcome::Added {
                capture.covariance(time_s).into_iter().for_each(|covariance| self.record_covariance(covariance));
            }
        }
        dead_reckoned.iter().for_each(|(time_s, pose)| self.queue.add_dead_reckoned(*time_s, pose));
        self.queue.take_message().into_iter().for_each(|text| capture.push_message(text));
        Ok(())
    }

    /// Adds the lens data that a stream sent with a pose. Ignored without [lens
    /// tracking](Self::with_lens_track).
    pub fn add_lens_state(&mut self, time_s: f64, state: &Arc<LensState>) {
        self.lens_track.iter_mut().for_each(|lens_track| lens_track.add(time_s, state));
    }

    /// Records the covariance of an accepted pose.
    fn record_covariance(&mut self, covariance: Covariance) {
        if let Some(recorder) = &self.recorder {
            recorder.covariance(covariance);
        }
        if let Some(mut replay) = self.replay() {
            replay.add_covariance(covariance);
        }
    }

    /// The pose track at the time a frame is emitted. Poses that are added later do not change it
    /// within the frame.
    pub fn track(&self) -> &PoseTrack {
        self.queue.track()
    }

    /// The replay buffer, if there is one.
    fn replay(&self) -> Option<MutexGuard<'_, ReplayBuffer>> {
        // A panic while the lock is held leaves no partial state.
        self.replay.as_ref().map(|replay| replay.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Adds a decoded picture and records it. `within_s` returns how long before and after the
    /// frame poses matter, seconds.
    pub fn add_picture(
        &mut self,
        picture: &Picture,
        pixels: Pixels,
        within_s: impl FnOnce(&Frame) -> (f64, f64),
        now_s: f64,
    ) -> PictureOutcome {
        let (time_s, exposure_s) = (picture.time_s, picture.exposure_s);
        if time_s.is_nan() || time_s <= self.last_s {
            return PictureOutcome::OutOfOrder;
        }
        if self.recorder.is_some() || self.replay.is_some() {
            let file = Arc::new(picture_file(picture, &pixels));
            let recorder = self.recorder.as_ref().filter(|_| self.ends_at_s.is_none());
            if recorder.is_some_and(|recorder| !recorder.frame(time_s, Arc::clone(&file), exposure_s, None)) {
                return PictureOutcome::NotRecorded;
            }
            if let Some(mut replay) = self.replay() {
                replay.add_frame(time_s, file, exposure_s);
            }
        }
        self.last_s = time_s;
        // Equals the metadata that a reader of the recording gets.
        let photo = picture.jpeg().map(|file| exif::settings_of(&file)).unwrap_or_default();
        let exposure = FrameExposure { time_s: exposure_s.or(photo.time_s), photo, ..FrameExposure::default() };
        // Fixed now, because it determines the span in which poses matter.
        let exposure_s = self.lens_track.as_ref().and_then(|lens_track| lens_track.exposure_s(time_s));
        let exposure = exposure.with_lens(FrameLens { exposure_s, ..FrameLens::default() });
        let frame = Frame { exposure, ..Frame::new(self.frames, time_s, pixels) };
        self.frames += 1;
        let span_s = within_s(&frame);
        self.queue.push_frame((frame, now_s), time_s, span_s, now_s);
        PictureOutcome::Accepted
    }

    /// Deadline of the next frame.
    pub fn due_s(&self) -> Option<f64> {
        self.queue.due_s()
    }

    /// The next frame whose poses are final.
    pub fn next(&mut self, now_s: f64) -> Option<LiveFrame> {
        let ReleasedFrame { frame: (mut frame, arrived_s), tracking, opacity, waited_s } = self.queue.next(now_s)?;
        frame.opacity = opacity;
        self.record_poses();
        let mut camera = self.lens_track.as_ref().map(|lens_track| lens_track.at(frame.timestamp_s));
        if let Some(camera) = &mut camera {
            camera.lens.exposure_s = frame.exposure.lens.exposure_s;
            frame.exposure = frame.exposure.with_lens(camera.lens);
        }
        if let Some(recorder) = &self.recorder {
            recorder.set_opacity(frame.timestamp_s, opacity, camera.as_ref());
        }
        self.emitted_s = frame.timestamp_s;
        if let Some(mut replay) = self.replay() {
            replay.set_opacity(frame.timestamp_s, opacity, camera.as_ref());
        }
        let geometry = camera.and_then(|camera| camera.geometry);
        Some(LiveFrame { frame, geometry, tracking, waited_s, arrived_s })
    }

    fn record_poses(&mut self) {
        let new = self.queue.take_unrecorded();
        if let Some(mut replay) = self.replay() {
            replay.add_poses(&new);
        }
        if let Some(recorder) = &self.recorder {
            recorder.poses(new);
        }
    }

    /// Flushes the queue at the end of the input and ends the recording, if there is one. Returns
    /// its number of frames, and the error if one ended it earlier.
    pub fn finish(mut self) -> Option<(usize, Option<RecorderError>)> {
        while self.next(f64::INFINITY).is_some() {}
        self.end_recording()
    }

    /// Ends the recording, if there is one. Returns its number of frames, and the error if one
    /// ended it earlier.
    pub fn end_recording(&mut self) -> Option<(usize, Option<RecorderError>)> {
        self.record_poses();
        self.ends_at_s = None;
        self.recorder.take().map(RecorderThread::finish)
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::live::pose_source::PoseSource;
    use crate::recording::recorder::RecordingInfo;
    use crate::webcam::LatestReceiver;

    /// Returns its poses once, each with a covariance.
    struct FixedPoses(Vec<f64>);

    impl PoseSource for FixedPoses {
        fn take_poses(&mut self, _: f64) -> Result<Vec<(f64, Pose)>, LiveError> {
            Ok(std::mem::take(&mut self.0).into_iter().map(|time_s| (time_s, Pose::IDENTITY)).collect())
        }
        fn up(&self) -> Option<DVec3> {
            None
        }
        fn covariance(&self, time_s: f64) -> Option<Covariance> {
            Some(Covariance { time_s, upper: [1e-6; 21] })
        }
    }

    #[test]
    fn only_accepted_poses_have_a_covariance() {
        let replay = Arc::<Mutex<ReplayBuffer>>::default();
        let mut intake = Intake::new(0.1, 0.0, None).with_replay_buffer(Arc::clone(&replay));
        let (_putter, newest) = LatestReceiver::new();
        // One pose is late, and one has a time that is no number.
        let mut capture = LiveCapture::new(newest, Box::new(FixedPoses(vec![1.0, 0.5, 1.05, f64::NAN])));
        intake.take_poses(&mut capture, 2.0).unwrap();
        assert_eq!((intake.counts().poses, intake.counts().late, intake.counts().implausible), (2, 1, 1));
        let pixels = Pixels::from_u8(16, 16, vec![7; 768]).unwrap();
        let temp = tempfile::tempdir().unwrap();
        let about = RecordingInfo {
            interval_s: 0.1,
            max_gap_s: 0.1,
            up: None,
            has_floor: false,
            camera: None,
            delivered: None,
            has_exposure: false,
            has_cameras: false,
            profile: None,
        };
        let mut replay = replay.lock().unwrap().clone();
        replay.add_frame(1.0, Arc::new(super::super::picture_file::PictureFile::Pixels(pixels)), None);
        replay.write(&temp.path().join("last"), &about).unwrap();
        let covariance_text = std::fs::read_to_string(temp.path().join("last/covariance.txt")).unwrap();
        let times_s: Vec<&str> = covariance_text.lines().skip(2).filter_map(|line| line.split(' ').next()).collect();
        assert_eq!(times_s, ["1", "1.05"]);
    }
}
