//! Samples of surface radiance: points with measured depth, seen in the pictures of frames spread over the recording.
//!
//! Depth and picture of a frame have different moments, and rows have poses of their own. So each point is projected into the
//! picture by the pose of the row in which it is seen.

use std::sync::Arc;

use crate::camera::{Geometry, Response};
use crate::compositor::{WHITE, seen_by_row};
use crate::depth::measured_from;
use crate::frame::Frame;
use crate::pose::Pose;
use crate::profile::Rig;
use crate::recording::Recording;
use crate::shadow::{SurfaceRadiance, SurfaceSample};
use crate::source::ahead::Ahead;

/// Samples across a frame.
const ACROSS: u32 = 128;
/// Beyond this distance samples are farther apart than cells of [`SurfaceRadiance`], and depth is known less well, m.
const FARTHEST_M: f64 = 4.0;

/// Radiance of surfaces by some frames of a recording. Frames without depth, pose or gain, and frames that cannot be read, tell
/// nothing.
pub fn radiance_of(recording: &Arc<Recording>, rig: &Rig, response: &Response, frames: Vec<usize>) -> SurfaceRadiance {
    let of = recording.clone();
    let count = frames.len();
    let read = move |n: usize| of.frames(frames[n]..frames[n] + 1).ok()?.next()?.ok();
    let Ok(read) = Ahead::new(0..count, read) else { return SurfaceRadiance::default() };
    let samples = read.filter_map(|frame| frame.ok().flatten()).flat_map(|frame| {
        let geometry = rig.geometry_over(recording.geometry_at_frame(frame.index));
        geometry.map_or_else(Vec::new, |geometry| samples(&frame, &geometry, response, recording))
    });
    SurfaceRadiance::of(samples)
}

fn samples(frame: &Frame, geometry: &Geometry, response: &Response, recording: &Recording) -> Vec<SurfaceSample> {
    let (Some(depth), Some(brightness)) = (&frame.depth, frame.exposure.seen) else { return Vec::new() };
    let (track, offset_s) = (&recording.track, recording.time_offset_s);
    let Ok(measured) = measured_from(depth, geometry, track, offset_s) else { return Vec::new() };
    let taken_s = frame.timestamp_s + offset_s;
    if track.at(taken_s).is_err() {
        return Vec::new();
    }
    let pose_at = |time_s: f64| track.at_or_nearest(taken_s + time_s).unwrap_or(Pose::IDENTITY);
    let pixels = &frame.pixels;
    let (max_code, light) = (pixels.max_code(), response.table(pixels.max_code()));
    let step = (depth.width / ACROSS).max(1) as usize;
    let mut samples = Vec::new();
    for y in (step as u32 / 2..depth.height).step_by(step) {
        for x in (step as u32 / 2..depth.width).step_by(step) {
            let z = f64::from(depth.depth_m[(y * depth.width + x) as usize]);
            if !(z > 0.0 && z < FARTHEST_M) {
                continue;
            }
            let Some(ray) = geometry.depth_ray(glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)) else {
                continue;
            };
            let at_m = measured.inverse_transform_point(z * ray);
            let Some((at_px, _)) = seen_by_row(geometry, pose_at, at_m) else { continue };
            if !(at_px.x >= 0.0 && at_px.y >= 0.0)
                || at_px.x >= f64::from(pixels.width)
                || at_px.y >= f64::from(pixels.height)
            {
                continue;
            }
            let codes = pixels.at(at_px.x as u32, at_px.y as u32);
            let share = [at_px.x as f32 / pixels.width as f32, at_px.y as f32 / pixels.height as f32];
            let here = f64::from(brightness.across.at(share)).exp2();
            let usual = |c: usize| (light[codes[c] as usize] / (brightness.factors[c] * here)) as f32;
            let is_clipped = codes.map(|code| code as f32 >= WHITE * max_code as f32);
            samples.push(SurfaceSample { at_m, light: [usual(0), usual(1), usual(2)], is_clipped });
        }
    }
    samples
}
