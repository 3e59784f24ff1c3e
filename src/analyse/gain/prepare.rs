//! Prepares a frame for comparison: its reduced channels, flat points and landmarks.

use glam::DVec3;

use super::super::state::{CameraState, move_point};
use super::super::view::scattered;
use super::{
    BLUR_PX, GainFrame, GainPoint, Gains, MAX_CODE, MAX_GRADIENT, MAX_LANDMARKS, MAX_POINTS, MAX_WIDTH_PX, MIN_CODE,
    PixelSample,
};
use crate::frame::Frame;
use crate::grey_image::{GreyImage, gaussian};
use crate::pixels::Pixels;
use crate::recording::Landmark;

impl Gains<'_> {
    /// Number of halvings until a picture is at most [`MAX_WIDTH_PX`] wide.
    pub(super) fn halvings(&self) -> usize {
        let width = self.model.size().0;
        (0..).find(|n| width >> n <= MAX_WIDTH_PX).unwrap_or(0)
    }
    /// The frame with its sampled points and landmarks. `depth`: in the camera's rows, 0 where
    /// unknown.
    pub(super) fn prepare_frame(
        &self,
        frame: &Frame,
        state: CameraState,
        depth: &[f32],
        landmarks: &[Landmark],
    ) -> GainFrame {
        let halvings = self.halvings();
        let colours = channel_planes(&frame.pixels, halvings);
        let noise = [0, 1, 2].map(|channel| self.noise_sigma(&colours[channel], channel, halvings));
        let (w, h) = (colours[0].width, colours[0].height);
        let (width, _) = self.model.size();
        let scale = 1usize << halvings;
        let small: Vec<f32> = (0..w * h).map(|i| depth[(i / w) * scale * width + (i % w) * scale]).collect();
        let point = |i: usize| {
            let (x, y) = ((i % w) * scale, (i / w) * scale);
            let there = f64::from(small[i]) * DVec3::from(self.model.rays[y * width + x].map(f64::from));
            let at = move_point(there, &state.twist, self.model.geometry.row_time_s(y as f64 + 0.5));
            let codes = [0, 1, 2].map(|c| colours[c].values[i]);
            GainPoint { at, sample: self.sample([(i % w) as f32 / w as f32, (i / w) as f32 / h as f32], codes) }
        };
        let points = sound_pixels(&colours, &small).into_iter().map(point).collect();
        let landmarks = self.landmark_samples(&colours, scale, landmarks);
        GainFrame { index: frame.index, state, colours, noise, depth: small, points, landmarks }
    }

    /// Samples of at most [`MAX_LANDMARKS`] landmarks with usable codes, by ascending numbers.
    /// `scale`: side of a reduced pixel, px.
    fn landmark_samples(
        &self,
        colours: &[GreyImage; 3],
        scale: usize,
        landmarks: &[Landmark],
    ) -> Vec<(u64, PixelSample)> {
        let (w, h) = (colours[0].width, colours[0].height);
        let mut landmarks: Vec<&Landmark> = landmarks.iter().collect();
        if landmarks.len() > MAX_LANDMARKS {
            landmarks.sort_unstable_by_key(|landmark| scattered(landmark.number));
            landmarks.truncate(MAX_LANDMARKS);
        }
        let landmark = |landmark: &&Landmark| {
            let [x, y] = landmark.at_px.map(|px| (px - 0.5) / scale as f32);
            let [red, green, blue] = [0, 1, 2].map(|c| colours[c].sample_inside(x, y));
            let codes = [red?, green?, blue?];
            let is_sound = codes.iter().all(|code| *code > MIN_CODE && *code < MAX_CODE);
            is_sound.then(|| (landmark.number, self.sample([x / w as f32, y / h as f32], codes)))
        };
        let mut samples: Vec<_> = landmarks.iter().filter_map(landmark).collect();
        samples.sort_by_key(|(number, _)| *number);
        samples
    }
}

/// Red, green and blue at reduced size, smoothed, codes of 255.
fn channel_planes(pixels: &Pixels, halvings: usize) -> [GreyImage; 3] {
    [0, 1, 2].map(|channel| {
        let mut plane = GreyImage::of_channel(pixels, channel);
        for _ in 0..halvings {
            plane = plane.halved();
        }
        plane.filtered(&gaussian(BLUR_PX))
    })
}

/// Indices of at most [`MAX_POINTS`] pixels with depth, usable codes and little gradient.
fn sound_pixels(colours: &[GreyImage; 3], depth: &[f32]) -> Vec<usize> {
    let (w, h) = (colours[0].width, colours[0].height);
    let mut sound = Vec::new();
    for y in 2..h.saturating_sub(2) {
        for x in 2..w.saturating_sub(2) {
            let i = y * w + x;
            let is_sound = |plane: &GreyImage| {
                let v = &plane.values;
                let slope = (0.5 * (v[i + 1] - v[i - 1])).hypot(0.5 * (v[i + w] - v[i - w]));
                v[i] > MIN_CODE && v[i] < MAX_CODE && slope < MAX_GRADIENT
            };
            if depth[i] > 0.0 && colours.iter().all(is_sound) {
                sound.push(i);
            }
        }
    }
    if sound.len() > MAX_POINTS {
        sound.sort_unstable_by_key(|i| (scattered(*i as u64), *i));
        sound.truncate(MAX_POINTS);
    }
    sound
}
