//! A camera that is watched, with what finds poses in its pictures.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Instant;

use super::error::LiveError;
use super::source::PoseSource;
use crate::pixels::Pixels;
use crate::pose::Pose;
use crate::stream::LensState;
use crate::tracking::covariance::Covariance;
use crate::webcam::{Drops, Newest, Picture, PictureError, Taken};

/// Poses that are known beforehand come so far ahead of their frames, seconds.
const AHEAD_S: f64 = 1.0;
/// Messages that wait to be told; beyond it the oldest goes.
const MAX_TOLD: usize = 16;

/// What came of a camera.
pub enum Next {
    Picture(Box<(Picture, Pixels)>),
    Nothing,
    Ended,
}

/// A camera that delivers, and its poses.
pub struct Watched {
    newest: Newest<Picture>,
    poses: Box<dyn PoseSource>,
    gone: Option<String>,
    damaged: u64,
    damage: Option<PictureError>,
    told: VecDeque<String>,
}

impl Watched {
    pub fn new(newest: Newest<Picture>, poses: Box<dyn PoseSource>) -> Self {
        Self { newest, poses, gone: None, damaged: 0, damage: None, told: VecDeque::new() }
    }

    /// The newest picture, decoded, if one comes until then. A damaged one is left out and counted.
    pub fn next(&mut self, until: Instant) -> Next {
        match self.newest.take(until) {
            Taken::New(picture) => {
                self.gone = None;
                match picture.pixels() {
                    Ok(pixels) => {
                        self.poses.picture(picture.time_s, &pixels);
                        Next::Picture(Box::new((picture, pixels)))
                    }
                    Err(error) => {
                        self.damaged += 1;
                        self.damage.get_or_insert(error);
                        Next::Nothing
                    }
                }
            }
            Taken::Nothing => Next::Nothing,
            Taken::Gone(why) => {
                self.gone = Some(why);
                Next::Nothing
            }
            Taken::Ended => Next::Ended,
        }
    }

    /// The poses that have come, for frames up to a time.
    pub fn new_poses(&mut self, last_frame_s: f64) -> Result<Vec<(f64, Pose)>, LiveError> {
        self.poses.poses(last_frame_s + AHEAD_S)
    }

    /// Poses of pictures in which nothing was found, by how the picture moved.
    pub fn carried(&mut self) -> Vec<(f64, Pose)> {
        self.poses.carried()
    }

    /// How sure a pose is that was given last, by its time.
    pub fn covariance(&self, time_s: f64) -> Option<Covariance> {
        self.poses.covariance(time_s)
    }

    /// What was said of the lens with a pose that was given last, by its time.
    pub fn lens(&self, time_s: f64) -> Option<Arc<LensState>> {
        self.poses.lens(time_s)
    }

    /// What became of all the poses that came, for the end.
    pub fn closing(&self) -> Option<String> {
        self.poses.closing()
    }

    /// What a person should know of the poses by now; each once.
    pub fn told(&mut self) -> Option<String> {
        self.told.pop_front().or_else(|| self.poses.told())
    }

    /// Has [`Watched::told`] tell this after what waits to be told.
    pub fn tell(&mut self, text: String) {
        if self.told.len() == MAX_TOLD {
            self.told.pop_front();
        }
        self.told.push_back(text);
    }

    /// Why there is no pose now, if that is known.
    pub fn lacks(&self) -> Option<String> {
        self.poses.lacks()
    }

    /// Why nothing comes for now: unplugged, say.
    pub fn gone(&self) -> Option<&str> {
        self.gone.as_deref()
    }

    /// What was wrong with the first picture that could not be decoded.
    pub fn damage(&self) -> Option<&PictureError> {
        self.damage.as_ref()
    }

    pub fn drops(&self) -> Drops {
        let drops = self.newest.drops();
        Drops { damaged: drops.damaged + self.damaged, ..drops }
    }
}
