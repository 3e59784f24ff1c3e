//! Depth of a frame: measured and reprojected to the frame's time, rendered from a scan of the
//! site, or from neighbouring frames ([`plane_sweep`](super::plane_sweep)).

use super::camera_model::CameraModel;
use super::depth_at_frame::depth_at_frame;
use super::plane_sweep::PlaneSweep;
use super::state::{CameraState, pose};
use crate::frame::Frame;
use crate::recording::{Recording, RecordingError};
use crate::site::ScannedSite;

/// Origin of the depth of the frames.
pub enum DepthSource<'a> {
    /// Depth that follows from a single frame.
    Single(SingleFrameDepth<'a>),
    /// Depth swept from pictures, without a depth sensor.
    Swept(Box<PlaneSweep<'a>>),
}

/// Depth that follows from a frame and its pose.
#[derive(Clone, Copy)]
pub enum SingleFrameDepth<'a> {
    /// `later_s`: added to the maps' times, s.
    Measured { later_s: f64 },
    /// Rendered from the present estimate of the pose.
    Rendered(&'a ScannedSite),
}

impl<'a> DepthSource<'a> {
    /// `states`: one per frame. Frames must be requested in ascending order.
    pub fn new(
        model: &'a CameraModel,
        recording: &'a Recording,
        states: &'a [Option<CameraState>],
        later_s: f64,
        threads: usize,
    ) -> Result<Self, RecordingError> {
        if recording.has_depth() || model.geometry.needs_cube_map() {
            return Ok(Self::Single(SingleFrameDepth::new(recording, later_s)));
        }
        Ok(Self::Swept(Box::new(PlaneSweep::new(model, recording, states, threads)?)))
    }

    /// Depth that can be computed on any thread and in any order.
    pub fn single(&self) -> SingleFrameDepth<'a> {
        match self {
            Self::Single(single) => *single,
            Self::Swept(_) => SingleFrameDepth::Measured { later_s: 0.0 },
        }
    }

    /// Depth of a frame by plane sweep; `None` if a single frame suffices. Frames must be requested
    /// in ascending order.
    pub fn swept(&mut self, frame: usize) -> Result<Option<Vec<f32>>, RecordingError> {
        match self {
            Self::Single(_) => Ok(None),
            Self::Swept(sweep) => sweep.depth(frame).map(Some),
        }
    }

    /// Depth at the frame's time and pixels, m or the recording's unit; 0 where unknown.
    pub fn of(&mut self, model: &CameraModel, frame: &Frame, state: &CameraState) -> Result<Vec<f32>, RecordingError> {
        match self {
            Self::Single(single) => Ok(single.of(model, frame, state)),
            Self::Swept(sweep) => sweep.depth(frame.index),
        }
    }
}

impl<'a> SingleFrameDepth<'a> {
    pub fn new(recording: &'a Recording, later_s: f64) -> Self {
        match recording.site().filter(|_| !recording.has_measured_depth()) {
            Some(site) => Self::Rendered(site),
            None => Self::Measured { later_s },
        }
    }

    /// Depth at the frame's time and pixels, m; 0 where unknown.
    pub fn of(self, model: &CameraModel, frame: &Frame, state: &CameraState) -> Vec<f32> {
        match self {
            Self::Measured { later_s } => measured(model, frame, state, later_s),
            Self::Rendered(site) => {
                let camera = |later_s: f64| pose(&state.extrapolated(later_s).world_from_camera);
                site.depth(&model.geometry, camera, frame.timestamp_s).depth_m
            }
        }
    }
}

/// The measured depth, reprojected to the frame's time, m; 0 where unknown. `later_s` is added to
/// the map's time.
fn measured(model: &CameraModel, frame: &Frame, state: &CameraState, later_s: f64) -> Vec<f32> {
    let (width, height) = model.size();
    match &frame.depth {
        Some(map) if (map.width as usize, map.height as usize) == (width, height) => {
            let later_s = map.timestamp_s + later_s - frame.timestamp_s;
            let later_s = if later_s.abs() < 1e-4 { 0.0 } else { later_s };
            depth_at_frame(&model.geometry, &model.rays, map, state, later_s)
        }
        _ => vec![0.0; width * height],
    }
}
