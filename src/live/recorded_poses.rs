//! Poses of a recording, replayed for new pictures.

use std::path::Path;

use glam::DVec3;

use super::error::LiveError;
use super::pose_source::PoseSource;
use crate::pixels::Pixels;
use crate::pose::Pose;
use crate::recording::{OpenOptions, Recording};

/// The time of the recording's first frame is mapped to that of the first picture.
#[derive(Debug)]
pub struct RecordedPoses {
    poses: std::vec::IntoIter<(f64, Pose)>,
    first_frame_s: f64,
    offset_s: Option<f64>,
    up: Option<DVec3>,
    has_floor: bool,
    max_gap_s: f64,
}

impl RecordedPoses {
    pub fn open(path: &Path) -> Result<Self, LiveError> {
        let recording = Recording::open(path, &OpenOptions::default())?;
        if recording.track.poses().is_empty() {
            return Err(LiveError::NoPoses { path: path.to_owned() });
        }
        Ok(Self {
            first_frame_s: recording.timestamps_s.first().copied().unwrap_or_default(),
            poses: recording.track.poses_in_frame_time().collect::<Vec<_>>().into_iter(),
            offset_s: None,
            up: recording.up,
            has_floor: recording.has_floor,
            max_gap_s: recording.track.max_gap_s(),
        })
    }
}

impl PoseSource for RecordedPoses {
    fn add_picture(&mut self, time_s: f64, _: &Pixels) {
        self.offset_s.get_or_insert(time_s - self.first_frame_s);
    }
    fn take_poses(&mut self, until_s: f64) -> Result<Vec<(f64, Pose)>, LiveError> {
        let Some(offset_s) = self.offset_s else { return Ok(Vec::new()) };
        let mut due = Vec::new();
        while let Some((time_s, pose)) = self.poses.as_slice().first().filter(|(t, _)| t + offset_s <= until_s) {
            due.push((time_s + offset_s, *pose));
            self.poses.next();
        }
        Ok(due)
    }
    fn up(&self) -> Option<DVec3> {
        self.up
    }
    fn has_floor(&self) -> bool {
        self.has_floor
    }
    fn max_gap_s(&self) -> f64 {
        self.max_gap_s
    }
}
