//! Point spread of a recording, from the frames with the least camera motion, and of a rendered
//! picture.

use super::camera_model::CameraModel;
use super::capture_info::CaptureInfo;
use super::depth_source::DepthSource;
use super::plane_sweep::camera_model_for;
use super::registration_result::recorded;
use super::shutter::ExposureRun;
use super::spread::{EdgeSpreads, FrameMotion, PointSpreadEstimate, measured_frames, stillest_frames};
use super::state::CameraState;
use crate::camera::{Geometry, Response};
use crate::fit::twist::Twist;
use crate::frame::Frame;
use crate::pixels::Pixels;
use crate::recording::{Recording, RecordingError};

/// Motion and exposure of the frames.
pub struct SharpnessInputs<'a> {
    /// One per frame.
    pub states: &'a [Option<CameraState>],
    /// Added to the depth maps' times, s.
    pub depth_later_s: f64,
    /// Exposures by the frames' motion blur.
    pub exposure_runs: &'a [ExposureRun],
}

/// The point spread, or the reason for which it is unknown.
pub fn of_recording(
    recording: &Recording,
    model: &CameraModel,
    capture: &CaptureInfo<'_>,
    inputs: &SharpnessInputs<'_>,
    threads: usize,
) -> Result<Result<PointSpreadEstimate, String>, RecordingError> {
    let mut spreads =
        EdgeSpreads::new(model, capture.response, if recording.bits > 8 { 0xffff } else { 0xff }, threads);
    let mut depths = DepthSource::new(model, recording, inputs.states, inputs.depth_later_s, threads)?;
    for n in stillest_frames(inputs.states, measured_frames(inputs.states.len())) {
        let Some(state) = inputs.states[n] else { continue };
        for frame in recording.frames(n..n + 1)? {
            let mut frame = frame?;
            let run = inputs.exposure_runs.iter().find(|run| (run.from..run.to).contains(&n));
            frame.exposure.blur_estimate_s = run.map(|run| run.exposure_s);
            let depth = depths.of(model, &frame, &state)?;
            spreads
                .add(&frame, &FrameMotion { state: &state, depth: &depth, exposure_s: (capture.exposure_s)(&frame) });
        }
    }
    Ok(spreads.finish())
}

/// σ of the recording's own edges by its recorded poses, px, or the reason for which it is unknown.
pub fn footage_spread_px(
    recording: &Recording,
    camera: &Geometry,
    capture: &CaptureInfo<'_>,
    threads: usize,
) -> Result<Result<f64, String>, RecordingError> {
    let states = recorded(recording, 0.0);
    let model = camera_model_for(camera.clone(), recording, &states);
    let inputs = SharpnessInputs { states: &states, depth_later_s: 0.0, exposure_runs: &[] };
    Ok(of_recording(recording, &model, capture, &inputs, threads)?.map(|spread| spread.sigma_px))
}

/// σ of the edges of a picture without motion, px. `None` for too few edges.
pub fn drawn_spread_px(camera: &Geometry, response: &Response, pixels: Pixels, threads: usize) -> Option<f64> {
    let model = CameraModel::new(camera.clone());
    let mut spreads = EdgeSpreads::new(&model, response, pixels.max_code(), threads);
    let state = CameraState { world_from_camera: glam::DAffine3::IDENTITY, twist: Twist::zeros() };
    let frame = Frame::new(0, 0.0, pixels);
    spreads.add(&frame, &FrameMotion { state: &state, depth: &[], exposure_s: 0.0 });
    spreads.finish().ok().map(|spread| spread.sigma_px)
}

/// The frames with the least camera motion, one from each part of the recording.
pub fn still_frames(recording: &Recording) -> Vec<usize> {
    let states = recorded(recording, 0.0);
    stillest_frames(&states, measured_frames(states.len()))
}
