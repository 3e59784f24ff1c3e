//! The point spread of a whole recording, from the frames in which the camera moves least; and that of a drawn picture.

use super::depths::Depths;
use super::eye::Eye;
use super::registered::recorded;
use super::shutter::Run;
use super::spread::{Motion, PointSpread, Spreads, chosen};
use super::state::State;
use super::sweep::eye_of;
use super::taken::Taken;
use crate::camera::{Geometry, Response};
use crate::fit::twist::Twist;
use crate::frame::{Frame, FrameExposure};
use crate::pixels::Pixels;
use crate::recording::{Recording, RecordingError};

/// What is known of how frames were taken.
pub struct Known<'a> {
    /// One per frame.
    pub states: &'a [Option<State>],
    /// Added to the depth maps' times, s.
    pub depth_later_s: f64,
    /// By the frames' own blur.
    pub exposed: &'a [Run],
}

/// Or why it is not known.
pub fn of_recording(
    recording: &Recording,
    eye: &Eye,
    taken: &Taken<'_>,
    known: &Known<'_>,
    threads: usize,
) -> Result<Result<PointSpread, String>, RecordingError> {
    let mut spreads = Spreads::new(eye, taken.response, if recording.bits > 8 { 0xffff } else { 0xff }, threads);
    let mut depths = Depths::new(eye, recording, known.states, known.depth_later_s, threads)?;
    for n in chosen(known.states) {
        let Some(state) = known.states[n] else { continue };
        for frame in recording.frames(n..n + 1)? {
            let mut frame = frame?;
            let run = known.exposed.iter().find(|run| (run.from..run.to).contains(&n));
            frame.exposure.blurred_s = run.map(|run| run.exposure_s);
            let depth = depths.of(eye, &frame, &state)?;
            spreads.add(&frame, &Motion { state: &state, depth: &depth, exposure_s: (taken.exposure_s)(&frame) });
        }
    }
    Ok(spreads.finish())
}

/// σ of the recording's own edges by its recorded poses, px, or why it is not known.
pub fn footage_spread_px(
    recording: &Recording,
    camera: &Geometry,
    taken: &Taken<'_>,
    threads: usize,
) -> Result<Result<f64, String>, RecordingError> {
    let states = recorded(recording, 0.0);
    let eye = eye_of(camera.clone(), recording, &states);
    let known = Known { states: &states, depth_later_s: 0.0, exposed: &[] };
    Ok(of_recording(recording, &eye, taken, &known, threads)?.map(|spread| spread.sigma_px))
}

/// σ of the edges of a picture in which nothing moved, px. `None` where it has too few of them.
pub fn drawn_spread_px(camera: &Geometry, response: &Response, pixels: Pixels, threads: usize) -> Option<f64> {
    let eye = Eye::new(camera.clone());
    let mut spreads = Spreads::new(&eye, response, pixels.max_code(), threads);
    let state = State { world_from_camera: glam::DAffine3::IDENTITY, twist: Twist::zeros() };
    let frame = Frame {
        index: 0,
        timestamp_s: 0.0,
        pixels,
        depth: None,
        exposure: FrameExposure::default(),
        presence: 1.0,
        beside: Vec::new(),
        surfels: Default::default(),
    };
    spreads.add(&frame, &Motion { state: &state, depth: &[], exposure_s: 0.0 });
    spreads.finish().ok().map(|spread| spread.sigma_px)
}

/// The frames in which the camera moves least, of as many parts of the recording.
pub fn still_frames(recording: &Recording) -> Vec<usize> {
    chosen(&recorded(recording, 0.0))
}
