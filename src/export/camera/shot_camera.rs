//! A shot's camera over a range of frames, in the axes of camera files.

use std::ops::Range;

use glam::{DQuat, DVec3};

use crate::camera::Geometry;
use crate::shot::{Shot, ShotError};
use crate::tracking::matchmove::CameraPlacement;
use crate::tracking::matchmove::axes::file_from_world;

/// A frame of the recording.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraFrame {
    /// Index of the frame in the recording, from 0.
    pub index: usize,
    /// The frame's number in other programs.
    pub number: i64,
    /// Seconds from the recording's first frame on: by the timestamps, or at a constant rate.
    pub time_s: f64,
    /// The camera at the middle row's time. `None` without a pose.
    pub placement: Option<CameraPlacement>,
    /// Index into [`ShotCamera::lenses`].
    pub lens: usize,
}

#[derive(Clone, Debug)]
pub struct ShotCamera {
    pub frames: Vec<CameraFrame>,
    /// The different lenses of the frames, in the order of their first frame.
    pub lenses: Vec<Geometry>,
    /// Up in the recording's world, and whether it is known; otherwise it is the mean of the
    /// cameras' own.
    pub up: DVec3,
    pub is_up_known: bool,
    pub file_from_world: DQuat,
    /// Nominal frame rate.
    pub fps: f64,
}

impl ShotCamera {
    /// The camera in a range that is not empty. Frame 0 of the recording has the number
    /// `first_number`. With `fps`, times are at this rate.
    pub fn of(shot: &Shot, range: Range<usize>, first_number: i64, fps: Option<f64>) -> Result<Self, ShotError> {
        let recording = &shot.recording;
        let up = shot.up();
        let file_from_world = file_from_world(up.unwrap_or_else(|| shot.camera_up()));
        let start_s = recording.timestamps_s.first().copied().unwrap_or_default();
        let (mut frames, mut lenses): (Vec<CameraFrame>, Vec<Geometry>) = (Vec::new(), Vec::new());
        for index in range.clone() {
            let geometry = shot.geometry_at(index)?;
            // The newest lens is the most likely.
            let lens = lenses.iter().rposition(|known| *known == geometry).unwrap_or(lenses.len());
            if lens == lenses.len() {
                lenses.push(geometry);
            }
            let pose = recording.pose_at_frame(index).ok();
            frames.push(CameraFrame {
                index,
                number: first_number + index as i64,
                time_s: fps.map_or_else(|| recording.timestamps_s[index] - start_s, |fps| index as f64 / fps),
                placement: pose.map(|pose| CameraPlacement::of_pose(&pose, file_from_world)),
                lens,
            });
        }
        if let (false, Err(source)) =
            (frames.iter().any(|frame| frame.placement.is_some()), recording.pose_at_frame(range.start))
        {
            return Err(ShotError::NoPose { frame: range.start, source });
        }
        Ok(Self {
            frames,
            lenses,
            up: up.unwrap_or_else(|| shot.camera_up()),
            is_up_known: up.is_some(),
            file_from_world,
            fps: fps.unwrap_or(1.0 / recording.frame_interval_s),
        })
    }

    /// Largest deviation of the frames' times from the nominal rate, seconds.
    pub fn jitter_s(&self) -> f64 {
        let deviation_s = |frame: &CameraFrame| (frame.time_s - frame.index as f64 / self.fps).abs();
        self.frames.iter().map(deviation_s).fold(0.0, f64::max)
    }

    /// The frames with a pose.
    pub fn posed(&self) -> impl Iterator<Item = (&CameraFrame, &CameraPlacement)> {
        self.frames.iter().filter_map(|frame| Some((frame, frame.placement.as_ref()?)))
    }
}
