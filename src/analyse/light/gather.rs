//! Samples of a recording's frames by measured depth: world points with linear light, divided by
//! the frames' gains.

use std::time::Instant;

use glam::{DVec3, Vec3};

use super::super::camera_model::CameraModel;
use super::super::depth_at_frame::smooth_mask;
use super::super::depth_source::SingleFrameDepth;
use super::super::registration_result::RegistrationError;
use super::super::sparse_frames::frames;
use super::super::state::{CameraState, move_point, project_rolling_shutter};
use super::super::times::{self, Times};
use super::sample::LightSample;
use super::voxels::{Voxel, Voxels};
use crate::camera::Response;
use crate::frame::Frame;
use crate::parallel::over_rows;
use crate::recording::Recording;

/// Largest number of gathered frames, and of frames in the survey.
const MAX_FRAMES: usize = 120;
const MAX_SURVEY_FRAMES: usize = 12;
/// Approximate number of points in a frame.
const POINTS: usize = 76_800;
/// Points keep this distance from depth edges, px at a width of 640; smallest relative depth step
/// of an edge.
const DEPTH_EDGE_DISTANCE_PX: usize = 3;
const DEPTH_EDGE_STEP: f32 = 0.05;
/// Approximate number of columns of a coarse depth map.
const COARSE_COLUMNS: usize = 160;

/// The samples of a frame, and its mean light.
pub struct FrameSamples {
    pub samples: Vec<LightSample>,
    pub camera_at: Vec3,
    /// 0 in the first half of the recording, 1 in the second.
    pub half: usize,
    /// Brightness by the frame of median brightness, a factor for each channel.
    pub gain: [f64; 3],
    /// Mean linear light of the whole picture, divided by the gain.
    pub mean: [f64; 3],
    pub depth: CoarseDepth,
}

/// Depth of a frame on a coarse grid of pixels.
pub struct CoarseDepth {
    state: CameraState,
    columns: usize,
    step_px: usize,
    /// m; 0 where unknown or near an edge.
    depth_m: Vec<f32>,
}

impl CoarseDepth {
    /// Subsamples a depth map. `is_smooth`: mask of the pixels without a depth edge near.
    pub fn new(state: CameraState, width: usize, depth_m: &[f32], is_smooth: &[bool]) -> Self {
        let step_px = width.div_ceil(COARSE_COLUMNS).max(1);
        // The middle of each cell, or the last pixel of a narrower one.
        let middles = |count: usize| (0..count).step_by(step_px).map(move |at| (at + step_px / 2).min(count - 1));
        let smooth_depth = |i: usize| if is_smooth[i] { depth_m[i] } else { 0.0 };
        let height = depth_m.len() / width;
        let coarse_m =
            middles(height).flat_map(|y| middles(width).map(move |x| y * width + x)).map(smooth_depth).collect();
        Self { state, columns: width.div_ceil(step_px), step_px, depth_m: coarse_m }
    }

    /// The measured depth at the projection of a world point, and the point's own depth, m. `None`
    /// without a measurement.
    pub fn measured_and_expected_m(&self, model: &CameraModel, point: DVec3) -> Option<(f64, f64)> {
        let in_camera = self.state.world_from_camera.inverse().transform_point3(point);
        if in_camera.z <= 0.0 {
            return None;
        }
        let (at, expected_m) = project_rolling_shutter(&model.geometry, in_camera, &self.state.twist, None, 2)?;
        let cell = |px: f64| (px >= 0.0).then_some(px as usize / self.step_px);
        let (x, y) = (cell(at.x)?, cell(at.y)?);
        let measured_m = *self.depth_m.get(y * self.columns + x).filter(|z| x < self.columns && **z > 0.0)?;
        Some((f64::from(measured_m), expected_m))
    }
}

/// The recording, with the estimates on which its light depends.
pub struct LightInputs<'a> {
    pub recording: &'a Recording,
    pub model: &'a CameraModel,
    pub response: &'a Response,
    /// One per frame.
    pub states: &'a [Option<CameraState>],
    /// Added to the depth maps' times, s.
    pub later_s: f64,
    /// Factors on light, one per frame; empty if all are equal.
    pub gains: &'a [[f64; 3]],
    pub up: DVec3,
    pub threads: usize,
}

impl LightInputs<'_> {
    /// At most `max_count` frames with a pose, spread over the recording.
    fn chosen(&self, max_count: usize) -> Vec<usize> {
        self.recording.spread_frames(max_count).filter(|n| self.states[*n].is_some()).collect()
    }

    /// A few frames spread over the recording, and the room's surfaces by them. A single view of a
    /// surface is enough.
    pub fn survey(&self, times: &mut Times) -> Result<(Vec<FrameSamples>, Vec<Voxel>), RegistrationError> {
        let (mut views, mut voxels) = (Vec::new(), Voxels::default());
        self.each(MAX_SURVEY_FRAMES, times, &mut |view| {
            voxels.add(&view.samples, view.camera_at, view.half);
            views.push(view);
        })?;
        let surfaces = times.of(times::LIGHT, || voxels.surfaces(1, self.threads));
        Ok((views, surfaces))
    }

    /// Calls `each` with every frame of the recording, or of [`MAX_FRAMES`] spread over it.
    pub fn every(&self, times: &mut Times, each: &mut dyn FnMut(FrameSamples)) -> Result<(), RegistrationError> {
        self.each(MAX_FRAMES, times, each)
    }

    fn each(
        &self,
        max_count: usize,
        times: &mut Times,
        each: &mut dyn FnMut(FrameSamples),
    ) -> Result<(), RegistrationError> {
        let indices = self.chosen(max_count);
        let mut coming = frames(self.recording, indices.iter().copied());
        loop {
            let begun = Instant::now();
            let mut batch = Vec::new();
            while batch.len() < 2 * self.threads.max(1) {
                let Some(frame) = coming.next() else { break };
                let frame = frame?;
                if indices.binary_search(&frame.index).is_ok() {
                    batch.push((frame, None));
                }
            }
            times.add(times::READING, begun.elapsed());
            if batch.is_empty() {
                return Ok(());
            }
            times.of(times::LIGHT, || {
                over_rows(&mut batch, 1, self.threads, |_, slot| {
                    let (frame, view) = &mut slot[0];
                    *view = self.view(frame);
                });
                batch.into_iter().filter_map(|(_, view)| view).for_each(&mut *each);
            });
        }
    }

    fn view(&self, frame: &Frame) -> Option<FrameSamples> {
        let state = self.states[frame.index]?;
        let (width, height) = self.model.size();
        let depth = SingleFrameDepth::new(self.recording, self.later_s).of(self.model, frame, &state);
        let is_smooth =
            smooth_mask(&depth, width, (DEPTH_EDGE_DISTANCE_PX * width).div_ceil(640).max(1), DEPTH_EDGE_STEP);
        let gain = self.gains.get(frame.index).copied().unwrap_or([1.0; 3]);
        let max_code = frame.pixels.max_code();
        let light: Vec<f64> = (0..=255).map(|code| self.response.decode(f64::from(code) / 255.0)).collect();
        let decoded = |code: u32| match max_code {
            255 => light[code as usize],
            _ => self.response.decode(f64::from(code) / f64::from(max_code)),
        };
        let every = ((width * height) as f64 / POINTS as f64).sqrt().round().max(1.0) as usize;
        let (mut samples, mut sum, mut count) = (Vec::new(), [0.0; 3], 0usize);
        for y in (0..height).step_by(every) {
            let row_s = self.model.geometry.row_time_s(y as f64 + 0.5);
            for x in (0..width).step_by(every) {
                let n = y * width + x;
                let codes = frame.pixels.at(x as u32, y as u32);
                let code = codes.map(decoded);
                (0..3).for_each(|c| sum[c] += code[c]);
                count += 1;
                let ray = DVec3::from(self.model.rays[n].map(f64::from));
                if !(is_smooth[n] && ray.is_finite()) {
                    continue;
                }
                let here = move_point(f64::from(depth[n]) * ray, &state.twist, row_s);
                samples.push(LightSample {
                    position_m: state.world_from_camera.transform_point3(here).as_vec3(),
                    light: [0, 1, 2].map(|c| (code[c] / gain[c]) as f32),
                    code: code.map(|code| code as f32),
                    clipped: codes.map(|code| code >= frame.pixels.clip_code()),
                });
            }
        }
        Some(FrameSamples {
            samples,
            camera_at: state.world_from_camera.translation.as_vec3(),
            half: (2 * frame.index / self.recording.frame_count().max(1)).min(1),
            gain,
            mean: [0, 1, 2].map(|c| sum[c] / count.max(1) as f64 / gain[c]),
            depth: CoarseDepth::new(state, width, &depth, &is_smooth),
        })
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use glam::DAffine3;

    use super::*;
    use crate::camera::{Curve, Geometry};
    use crate::fit::twist::Twist;
    use crate::pixels::{DepthMap, Pixels};
    use crate::recording::OpenOptions;

    #[test]
    fn sample_light_does_not_depend_on_the_frames_exposure() {
        const SIZE: (u32, u32) = (16, 12);
        let recording = Recording::open(Path::new("recordings/demo"), &OpenOptions::default()).unwrap();
        let model = CameraModel::new(Geometry::pinhole(SIZE.0, SIZE.1, 16.0));
        let still = CameraState { world_from_camera: DAffine3::IDENTITY, twist: Twist::zeros() };
        let inputs = LightInputs {
            recording: &recording,
            model: &model,
            response: &Response { curve: Curve::Linear, ..Response::default() },
            states: &[Some(still); 2],
            later_s: 0.0,
            gains: &[[1.0; 3], [2.0, 1.5, 0.5]],
            up: DVec3::NEG_Y,
            threads: 1,
        };
        // A grey wall. The second frame shows each colour brighter by its gain.
        for (index, codes) in [[40u8; 3], [80, 60, 20]].into_iter().enumerate() {
            let count = (SIZE.0 * SIZE.1) as usize;
            let depth = DepthMap { width: SIZE.0, height: SIZE.1, depth_m: vec![2.0; count], timestamp_s: 0.0 };
            let frame = Frame {
                depth: Some(depth.into()),
                ..Frame::new(index, 0.0, Pixels::from_u8(SIZE.0, SIZE.1, codes.repeat(count)).unwrap())
            };
            let view = inputs.view(&frame).unwrap();
            let samples = &view.samples;
            assert_eq!(samples.len(), count);
            let is_grey = |sample: &LightSample| sample.light.iter().all(|light| (light - 40.0 / 255.0).abs() < 1e-6);
            assert!(samples.iter().all(is_grey), "frame {index}: {:?}", samples[0]);
            assert!(view.mean.iter().all(|mean| (mean - 40.0 / 255.0).abs() < 1e-12), "{:?}", view.mean);
            assert_eq!(samples[0].code, codes.map(|code| (f64::from(code) / 255.0) as f32));
        }
    }
}
