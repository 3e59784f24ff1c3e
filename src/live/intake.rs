//! Pictures and poses in; frames that have their poses out.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::encode::encoded;
use super::error::LiveError;
use super::latest::Latest;
use super::lenses::Lenses;
use super::track::{PoseTaken, Tracking};
use super::waiting::{Counts, Ready, Waiting};
use super::watched::Watched;
use super::writer::Writer;
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

/// What became of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Came {
    Frame,
    /// The disk is too slow to record it, so that it is left out altogether.
    NotRecorded,
    /// Not behind the one before it.
    Backwards,
}

/// A frame that need not wait any longer.
#[derive(Clone, Debug)]
pub struct Arrived {
    /// With the [presence](Frame::presence) and the [lens](FrameExposure::lens) that are recorded.
    pub frame: Frame,
    /// The camera that took it and is recorded, where a stream says its lens.
    pub geometry: Option<Geometry>,
    pub tracking: Tracking,
    /// How long it waited for its poses, seconds.
    pub waited_s: f64,
    /// When its picture came, by the clock that [`Intake::picture`] was told.
    pub came_s: f64,
}

/// Frames wait for their poses. What goes out is what a recording of it gives, number for number.
#[derive(Debug)]
pub struct Intake {
    waiting: Waiting<(Frame, f64)>,
    writer: Option<Writer>,
    latest: Option<Arc<Mutex<Latest>>>,
    lenses: Option<Lenses>,
    frames: usize,
    /// The last frame of the recording, which may still wait.
    ends_at_s: Option<f64>,
    /// The last picture that was taken, and the last frame that went out.
    last_s: f64,
    out_s: f64,
}

impl Intake {
    /// Poses are interpolated across at most `max_gap_s`; frames wait for theirs at most `patience_s`.
    pub fn new(max_gap_s: f64, patience_s: f64, writer: Option<Writer>) -> Self {
        let waiting = Waiting::new(max_gap_s, patience_s);
        let never_s = f64::NEG_INFINITY;
        Self {
            waiting,
            writer,
            latest: None,
            lenses: None,
            frames: 0,
            ends_at_s: None,
            last_s: never_s,
            out_s: never_s,
        }
    }

    /// Keeps the last seconds in memory.
    pub fn keeping(self, latest: Arc<Mutex<Latest>>) -> Self {
        Self { latest: Some(latest), ..self }
    }

    /// Frames have cameras of their own.
    pub fn with_lenses(self, lenses: Option<Lenses>) -> Self {
        Self { lenses, ..self }
    }

    /// From now on what this rig sets overrides what is said of the lens.
    pub fn follow(&mut self, rig: &Rig) {
        self.lenses.iter_mut().for_each(|lenses| lenses.follow(rig));
    }

    pub fn counts(&self) -> Counts {
        self.waiting.counts()
    }

    /// Frames that were taken, since the recording began if there is one.
    pub fn frames(&self) -> usize {
        self.frames
    }

    pub fn writer(&self) -> Option<&Writer> {
        self.writer.as_ref()
    }

    /// Takes the recorder away: the rest is not recorded.
    pub fn take_writer(&mut self) -> Option<Writer> {
        self.writer.take()
    }

    /// Records from the next picture on, which is number 0 from now on.
    pub fn record(&mut self, writer: Writer) {
        // The first frames are blurred by what was before them.
        if let Some(latest) = self.latest() {
            writer.poses(latest.poses());
        }
        (self.writer, self.frames, self.ends_at_s) = (Some(writer), 0, None);
    }

    /// Records no picture that comes from now on. The recording is whole, and can be ended, when [`Intake::is_recorded`]: once
    /// the frames that wait have their poses.
    pub fn stop_recording(&mut self) {
        self.ends_at_s = self.writer.as_ref().map(|_| self.last_s);
    }

    pub fn is_recorded(&self) -> bool {
        self.ends_at_s.is_some_and(|ends_at_s| self.out_s >= ends_at_s)
    }

    pub fn pose(&mut self, time_s: f64, pose: &Pose) -> PoseTaken {
        let taken = self.waiting.pose(time_s, pose);
        if self.waiting.due_s().is_none() {
            self.give_poses();
        }
        taken
    }

    /// Takes the poses that have come, for frames up to a time, each with how sure it is.
    pub fn take_poses(&mut self, watched: &mut Watched, last_frame_s: f64) -> Result<(), LiveError> {
        let carried = watched.carried();
        for (time_s, pose) in watched.new_poses(last_frame_s)? {
            watched.lens(time_s).into_iter().for_each(|state| self.lens(time_s, &state));
            if self.pose(time_s, &pose) == PoseTaken::Added {
                watched.covariance(time_s).into_iter().for_each(|covariance| self.covariance(covariance));
            }
        }
        carried.iter().for_each(|(time_s, pose)| self.waiting.carry(*time_s, pose));
        self.waiting.told().into_iter().for_each(|text| watched.tell(text));
        Ok(())
    }

    /// Takes what a stream said of its lens with a pose of a time. Without [lenses](Self::with_lenses) it is left out.
    pub fn lens(&mut self, time_s: f64, state: &Arc<LensState>) {
        self.lenses.iter_mut().for_each(|lenses| lenses.add(time_s, state));
    }

    /// Records and keeps how sure a pose is that was taken.
    fn covariance(&mut self, covariance: Covariance) {
        if let Some(writer) = &self.writer {
            writer.covariance(covariance);
        }
        if let Some(mut latest) = self.latest() {
            latest.covariance(covariance);
        }
    }

    /// The poses as they are when a frame goes out: what is added later does not change them for it.
    pub fn track(&self) -> &PoseTrack {
        self.waiting.track()
    }

    /// The last seconds of what was taken, if they are kept.
    fn latest(&self) -> Option<MutexGuard<'_, Latest>> {
        // A panic under the lock leaves plain values.
        self.latest.as_ref().map(|latest| latest.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Takes a picture whose pixels are decoded, and records it. `within_s` says from how long before the frame to how
    /// long after it poses matter.
    pub fn picture(
        &mut self,
        picture: &Picture,
        pixels: Pixels,
        within_s: impl FnOnce(&Frame) -> (f64, f64),
        now_s: f64,
    ) -> Came {
        let (time_s, exposure_s) = (picture.time_s, picture.exposure_s);
        if time_s.is_nan() || time_s <= self.last_s {
            return Came::Backwards;
        }
        if self.writer.is_some() || self.latest.is_some() {
            let file = Arc::new(encoded(picture, &pixels));
            let writer = self.writer.as_ref().filter(|_| self.ends_at_s.is_none());
            if writer.is_some_and(|writer| !writer.frame(time_s, Arc::clone(&file), exposure_s, None)) {
                return Came::NotRecorded;
            }
            if let Some(mut latest) = self.latest() {
                latest.frame(time_s, file, exposure_s);
            }
        }
        self.last_s = time_s;
        // As the recording's reader finds it.
        let photo = picture.jpeg().map(|file| exif::settings_of(&file)).unwrap_or_default();
        let exposure = FrameExposure { time_s: exposure_s.or(photo.time_s), photo, ..FrameExposure::default() };
        // How long poses matter to it must not change any more.
        let exposure_s = self.lenses.as_ref().and_then(|lenses| lenses.exposure_s(time_s));
        let exposure = exposure.with_lens(FrameLens { exposure_s, ..FrameLens::default() });
        let frame = Frame {
            index: self.frames,
            timestamp_s: time_s,
            pixels,
            depth: None,
            exposure,
            presence: 1.0,
            beside: Vec::new(),
            surfels: Arc::default(),
        };
        self.frames += 1;
        let needs_s = within_s(&frame);
        self.waiting.frame((frame, now_s), time_s, needs_s, now_s);
        Came::Frame
    }

    /// When the next frame will have waited for its poses.
    pub fn due_s(&self) -> Option<f64> {
        self.waiting.due_s()
    }

    /// The next frame that need not wait any longer.
    pub fn next(&mut self, now_s: f64) -> Option<Arrived> {
        let Ready { frame: (mut frame, came_s), tracking, presence, waited_s } = self.waiting.next(now_s)?;
        frame.presence = presence;
        self.give_poses();
        let mut camera = self.lenses.as_ref().map(|lenses| lenses.at(frame.timestamp_s));
        if let Some(camera) = &mut camera {
            camera.lens.exposure_s = frame.exposure.lens.exposure_s;
            frame.exposure = frame.exposure.with_lens(camera.lens);
        }
        if let Some(writer) = &self.writer {
            writer.settle(frame.timestamp_s, presence, camera.as_ref());
        }
        self.out_s = frame.timestamp_s;
        if let Some(mut latest) = self.latest() {
            latest.settle(frame.timestamp_s, presence, camera.as_ref());
        }
        let geometry = camera.and_then(|camera| camera.geometry);
        Some(Arrived { frame, geometry, tracking, waited_s, came_s })
    }

    fn give_poses(&mut self) {
        let new = self.waiting.take_new();
        if let Some(mut latest) = self.latest() {
            latest.add_poses(&new);
        }
        if let Some(writer) = &self.writer {
            writer.poses(new);
        }
    }

    /// Nothing comes any more. What nobody waits for is recorded all the same: how many frames the recording has, if there is
    /// one, and why it ended earlier if it did.
    pub fn finish(mut self) -> Option<(usize, Option<RecorderError>)> {
        while self.next(f64::INFINITY).is_some() {}
        self.end_recording()
    }

    /// Ends the recording, if there is one: how many frames it has, and why it ended earlier if it did.
    pub fn end_recording(&mut self) -> Option<(usize, Option<RecorderError>)> {
        self.give_poses();
        self.ends_at_s = None;
        self.writer.take().map(Writer::finish)
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::live::source::PoseSource;
    use crate::recording::recorder::About;
    use crate::webcam::Newest;

    /// Gives poses once, each with how sure it is.
    struct Given(Vec<f64>);

    impl PoseSource for Given {
        fn poses(&mut self, _: f64) -> Result<Vec<(f64, Pose)>, LiveError> {
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
    fn only_poses_that_are_taken_have_a_covariance() {
        let latest = Arc::<Mutex<Latest>>::default();
        let mut intake = Intake::new(0.1, 0.0, None).keeping(Arc::clone(&latest));
        let (_putter, newest) = Newest::new();
        // One comes too late, and one that no camera can have made is not there.
        let mut watched = Watched::new(newest, Box::new(Given(vec![1.0, 0.5, 1.05, f64::NAN])));
        intake.take_poses(&mut watched, 2.0).unwrap();
        assert_eq!((intake.counts().poses, intake.counts().late, intake.counts().odd), (2, 1, 1));
        let pixels = Pixels::from_u8(16, 16, vec![7; 768]).unwrap();
        let temp = tempfile::tempdir().unwrap();
        let about = About {
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
        let mut latest = latest.lock().unwrap().clone();
        latest.frame(1.0, Arc::new(super::super::encode::Encoded::Pixels(pixels)), None);
        latest.write(&temp.path().join("last"), &about).unwrap();
        let sure = std::fs::read_to_string(temp.path().join("last/covariance.txt")).unwrap();
        let times_s: Vec<&str> = sure.lines().skip(2).filter_map(|line| line.split(' ').next()).collect();
        assert_eq!(times_s, ["1", "1.05"]);
    }
}
