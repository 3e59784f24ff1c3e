//! A running camera with its pose source.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Instant;

use super::error::LiveError;
use super::pose_source::PoseSource;
use crate::pixels::Pixels;
use crate::pose::Pose;
use crate::stream::LensState;
use crate::tracking::covariance::Covariance;
use crate::webcam::{Drops, LatestReceiver, Picture, PictureError, TakeOutcome};

/// Poses that are known in advance are requested until this long after the last frame, seconds.
const LOOKAHEAD_S: f64 = 1.0;
/// Capacity for pending messages. Beyond it the oldest one is dropped.
const MESSAGE_CAPACITY: usize = 16;

/// Result of waiting for a picture.
pub enum CaptureEvent {
    Picture(Box<(Picture, Pixels)>),
    Nothing,
    Ended,
}

/// A running camera and its poses.
pub struct LiveCapture {
    newest: LatestReceiver<Picture>,
    pose_source: Box<dyn PoseSource>,
    outage: Option<String>,
    damaged: u64,
    decode_error: Option<PictureError>,
    messages: VecDeque<String>,
}

impl LiveCapture {
    pub fn new(newest: LatestReceiver<Picture>, poses: Box<dyn PoseSource>) -> Self {
        Self { newest, pose_source: poses, outage: None, damaged: 0, decode_error: None, messages: VecDeque::new() }
    }

    /// The newest picture, decoded, if one arrives before the deadline. A damaged one is skipped
    /// and counted.
    pub fn next(&mut self, until: Instant) -> CaptureEvent {
        match self.newest.take(until) {
            TakeOutcome::New(picture) => {
                self.outage = None;
                match picture.pixels() {
                    Ok(pixels) => {
                        self.pose_source.add_picture(picture.time_s, &pixels);
                        CaptureEvent::Picture(Box::new((picture, pixels)))
                    }
                    Err(error) => {
                        self.damaged += 1;
                        self.decode_error.get_or_insert(error);
                        CaptureEvent::Nothing
                    }
                }
            }
            TakeOutcome::Nothing => CaptureEvent::Nothing,
            TakeOutcome::Unavailable(why) => {
                self.outage = Some(why);
                CaptureEvent::Nothing
            }
            TakeOutcome::Ended => CaptureEvent::Ended,
        }
    }

    /// Takes the available poses for frames up to a time.
    pub fn take_poses(&mut self, last_frame_s: f64) -> Result<Vec<(f64, Pose)>, LiveError> {
        self.pose_source.take_poses(last_frame_s + LOOKAHEAD_S)
    }

    /// Takes the dead-reckoned poses of pictures without a detection.
    pub fn take_dead_reckoned(&mut self) -> Vec<(f64, Pose)> {
        self.pose_source.take_dead_reckoned()
    }

    /// Covariance of one of the last returned poses, by its time.
    pub fn covariance(&self, time_s: f64) -> Option<Covariance> {
        self.pose_source.covariance(time_s)
    }

    /// Lens state of one of the last returned poses, by its time.
    pub fn lens(&self, time_s: f64) -> Option<Arc<LensState>> {
        self.pose_source.lens(time_s)
    }

    /// Summary of all received poses, for the end.
    pub fn summary(&self) -> Option<String> {
        self.pose_source.summary()
    }

    /// Takes the next message for the user.
    pub fn take_message(&mut self) -> Option<String> {
        self.messages.pop_front().or_else(|| self.pose_source.take_message())
    }

    /// Appends a message for [`LiveCapture::take_message`].
    pub fn push_message(&mut self, text: String) {
        if self.messages.len() == MESSAGE_CAPACITY {
            self.messages.pop_front();
        }
        self.messages.push_back(text);
    }

    /// Reason why there is no pose at present, if known.
    pub fn no_pose_reason(&self) -> Option<String> {
        self.pose_source.no_pose_reason()
    }

    /// Reason why the camera delivers nothing at present, for example because it is unplugged.
    pub fn outage(&self) -> Option<&str> {
        self.outage.as_deref()
    }

    /// Error of the first picture that could not be decoded.
    pub fn decode_error(&self) -> Option<&PictureError> {
        self.decode_error.as_ref()
    }

    pub fn drops(&self) -> Drops {
        let drops = self.newest.drops();
        Drops { damaged: drops.damaged + self.damaged, ..drops }
    }
}
