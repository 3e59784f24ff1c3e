//! A frame's scene in its neighbouring frames: their codes at the same points, and the mean of
//! these, which is the frame's picture without noise.
//!
//! Neighbours are sampled by cubic convolution (Keys 1981), with their rolling shutter. Each is
//! scaled by a factor for each channel, for its exposure. Samples that differ from their median by
//! more than noise are left out: they see another surface.

use glam::{DAffine3, DVec3};

use super::box_blur::cubic_weights;
use super::camera_model::CameraModel;
use super::state::{CameraState, move_point, project_rolling_shutter};
use crate::example_noise::calibration::CalibrationFrame;
use crate::example_noise::content::brightness;
use crate::example_noise::path::Planes;
use crate::fit::quantile::upper_median_in_place;
use crate::fit::twist::Twist;

/// Largest number of neighbours.
pub const MAX_NEIGHBOURS: usize = 8;
/// Fewest samples of a place.
pub const MIN_SAMPLES: usize = 4;
/// Largest difference of a sample from the median, standard deviations of the noise, and codes.
const MAX_DEVIATION: f32 = 4.0;
const MAX_DEVIATION_CODES: f32 = 2.0;
/// Codes of a channel by which exposures are compared.
const COMPARED_CODES: std::ops::RangeInclusive<f32> = 20.0..=235.0;
/// Distance of the pixels by which exposures are compared, px, and fewest such pixels.
const COMPARED_STEP_PX: usize = 8;
const MIN_COMPARED: usize = 50;
/// Distance of samples from the picture's edge, px.
const MARGIN_PX: f64 = 2.0;

/// A neighbouring frame.
pub struct SampledFrame {
    /// R', G', B' codes.
    pub planes: Planes,
    pub camera_from_world: DAffine3,
    pub twist: Twist,
    /// Factor for each channel.
    pub gain: [f32; 3],
}

impl SampledFrame {
    /// A frame with factors of 1.
    pub fn new(planes: Planes, state: &CameraState) -> Self {
        Self { planes, camera_from_world: state.world_from_camera.inverse(), twist: state.twist, gain: [1.0; 3] }
    }
}

/// A frame's view of the scene.
pub struct DepthView<'a> {
    pub model: &'a CameraModel,
    pub state: CameraState,
    /// One for each pixel, m; 0 where unknown.
    pub depth: &'a [f32],
}

impl DepthView<'_> {
    /// The point at a pixel, world axes.
    fn point(&self, x: usize, y: usize) -> Option<DVec3> {
        let i = y * self.model.size().0 + x;
        let (z, ray) = (self.depth[i], self.model.rays[i]);
        if !(z > 0.0 && ray[0].is_finite()) {
            return None;
        }
        let at_row = f64::from(z) * DVec3::from(ray.map(f64::from));
        let row_s = self.model.geometry.row_time_s(y as f64 + 0.5);
        Some(self.state.world_from_camera.transform_point3(move_point(at_row, &self.state.twist, row_s)))
    }

    /// A neighbour's codes at a point near row `y`, before its gain, and the sum of the squared
    /// weights.
    fn sample(&self, neighbour: &SampledFrame, point: DVec3, y: usize) -> Option<[f32; 4]> {
        let there = neighbour.camera_from_world.transform_point3(point);
        let geometry = &self.model.geometry;
        if there.z <= 0.0 {
            return None;
        }
        let (at, _) = project_rolling_shutter(geometry, there, &neighbour.twist, Some(y as f64 + 0.5), 2)?;
        let (width, height) = self.model.size();
        let inside =
            at.x > MARGIN_PX && at.y > MARGIN_PX && at.x < width as f64 - MARGIN_PX && at.y < height as f64 - MARGIN_PX;
        if !inside {
            return None;
        }
        let (u, v) = (at.x - 0.5, at.y - 0.5);
        let (column, row) = (u.floor() as usize - 1, v.floor() as usize - 1);
        let across = cubic_weights((u - u.floor()) as f32);
        let down = cubic_weights((v - v.floor()) as f32);
        let mut sums = [0.0f32; 4];
        for (c, plane) in neighbour.planes.iter().enumerate() {
            for (dy, weight) in down.iter().enumerate() {
                let values = &plane.values[(row + dy) * width + column..][..4];
                sums[c] += weight * values.iter().zip(across).map(|(v, w)| v * w).sum::<f32>();
            }
        }
        sums[3] = across.iter().map(|w| w * w).sum::<f32>() * down.iter().map(|w| w * w).sum::<f32>();
        Some(sums)
    }

    /// The factors on a neighbour's codes that make it as bright as this frame. `None` if they
    /// share too few pixels.
    pub fn gain(&self, own: &Planes, neighbour: &SampledFrame) -> Option<[f32; 3]> {
        let (width, height) = self.model.size();
        let mut ratios: [Vec<f32>; 3] = Default::default();
        for y in (0..height).step_by(COMPARED_STEP_PX) {
            for x in (0..width).step_by(COMPARED_STEP_PX) {
                let Some(point) = self.point(x, y) else { continue };
                let Some(sample) = self.sample(neighbour, point, y) else { continue };
                for (c, ratios) in ratios.iter_mut().enumerate() {
                    let code = own[c].values[y * width + x];
                    if COMPARED_CODES.contains(&code) && COMPARED_CODES.contains(&sample[c]) {
                        ratios.push(code / sample[c]);
                    }
                }
            }
        }
        let mut gain = [1.0; 3];
        for (gain, ratios) in gain.iter_mut().zip(&mut ratios) {
            if ratios.len() < MIN_COMPARED {
                return None;
            }
            *gain = upper_median_in_place(ratios)?;
        }
        Some(gain)
    }

    /// Sums over usable pixels: of the products of the frame's residual and a neighbour's, and of
    /// the squares of the frame's.
    pub fn products(
        &self,
        own: &Planes,
        neighbour: &SampledFrame,
        frame: &CalibrationFrame,
        table: &[[f32; 3]],
    ) -> [f64; 2] {
        let (width, height) = self.model.size();
        let mut sums = [0.0; 2];
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            let i = y * width + x;
            let Some(point) = self.point(x, y).filter(|_| frame.mask[i]) else { continue };
            let Some(sample) = self.sample(neighbour, point, y) else { continue };
            let mean = frame.mean[1].values[i];
            let [residual, other] = [own[1].values[i] - mean, neighbour.gain[1] * sample[1] - mean];
            let sigma = table[mean.clamp(0.0, 255.0) as usize][1];
            if other.abs() > MAX_DEVIATION * sigma + MAX_DEVIATION_CODES {
                // Another surface.
                continue;
            }
            sums[0] += f64::from(residual * other);
            sums[1] += f64::from(residual * residual);
        }
        sums
    }

    /// Mean of the neighbours' samples at a pixel, and Σ gᵢ² cᵢ / n². `table`: σ by code.
    pub fn mean(&self, neighbours: &[SampledFrame], x: usize, y: usize, table: &[[f32; 3]]) -> Option<[f32; 4]> {
        let point = self.point(x, y)?;
        let mut samples = [([0.0; 4], 0.0); MAX_NEIGHBOURS];
        let mut sample_count = 0;
        for neighbour in neighbours.iter().take(MAX_NEIGHBOURS) {
            if let Some(mut sample) = self.sample(neighbour, point, y) {
                (0..3).for_each(|c| sample[c] *= neighbour.gain[c]);
                sample[3] *= neighbour.gain[1].powi(2);
                let [r, g, b, _] = sample;
                samples[sample_count] = (sample, brightness([r, g, b]));
                sample_count += 1;
            }
        }
        let samples = &mut samples[..sample_count];
        if sample_count < MIN_SAMPLES {
            return None;
        }
        samples.sort_by(|a, b| a.1.total_cmp(&b.1));
        let median = samples[sample_count / 2].1;
        let sigma = table[median.clamp(0.0, 255.0) as usize][1];
        let within = MAX_DEVIATION * sigma + MAX_DEVIATION_CODES;
        let mut sum = [0.0; 4];
        let mut count = 0;
        for (sample, _) in samples.iter().filter(|(_, light)| (light - median).abs() <= within) {
            sum.iter_mut().zip(sample).for_each(|(sum, v)| *sum += v);
            count += 1;
        }
        let n = count as f32;
        (count >= MIN_SAMPLES).then(|| [sum[0] / n, sum[1] / n, sum[2] / n, sum[3] / (n * n)])
    }
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use crate::camera::{Geometry, NoiseBin, NoiseProfile};
    use crate::grey_image::GreyImage;
    use crate::hash::pcg3d;

    pub const WIDTH: usize = 160;
    pub const HEIGHT: usize = 120;
    const SIGMA: f32 = 3.0;

    fn noise(i: usize, seed: u32) -> f32 {
        let word = pcg3d([i as u32, seed, 0])[0];
        (word as f32 / u32::MAX as f32 - 0.5) * 12.0f32.sqrt() * SIGMA
    }

    /// A camera `step` cm to the right of the first, before a wall at 2 m with a step of brightness
    /// at its middle.
    pub fn neighbour(step: f64, seed: u32, exposure: f32) -> SampledFrame {
        let shift_px = 100.0 * 0.01 * step / 2.0;
        let light = |x: f64| if x + shift_px < 80.0 { 60.0 } else { 140.0 };
        let plane = |c: u32| {
            GreyImage::from_fn(WIDTH, HEIGHT, |x, y| exposure * light(x as f64) + noise(y * WIDTH + x, 3 * seed + c))
        };
        let world_from_camera = DAffine3::from_translation(DVec3::X * 0.01 * step);
        let state = CameraState { world_from_camera, twist: Twist::zeros() };
        SampledFrame::new([0, 1, 2].map(plane), &state)
    }

    pub fn table() -> NoiseProfile {
        let bins = vec![NoiseBin { code: 128.0, sigma: f64::from(SIGMA) }];
        NoiseProfile {
            bins: [bins.clone(), bins.clone(), bins],
            channel_correlation: [0.0; 3],
            neighbour_correlation: [0.0; 2],
            example: None,
        }
    }

    #[test]
    fn neighbour_mean_follows_exposure_and_excludes_motion() {
        let model = CameraModel::new(Geometry::pinhole(WIDTH as u32, HEIGHT as u32, 100.0));
        let own = neighbour(0.0, 0, 1.0);
        let state = CameraState { world_from_camera: DAffine3::IDENTITY, twist: Twist::zeros() };
        let view = DepthView { model: &model, state, depth: &[2.0; WIDTH * HEIGHT] };
        let mut neighbours: Vec<SampledFrame> = (1..=8)
            .map(|n| {
                let mut neighbour = neighbour(2.0 * f64::from(n) - 9.0, n, if n == 3 { 0.8 } else { 1.0 });
                neighbour.gain = view.gain(&own.planes, &neighbour).expect("enough pixels");
                neighbour
            })
            .collect();
        assert!((neighbours[2].gain[1] - 1.25).abs() < 0.02, "{:?}", neighbours[2].gain);
        // Something white passes before one of them.
        neighbours[5].planes.iter_mut().for_each(|plane| plane.values.fill(250.0));
        let table = table().table();
        let (mut squares, mut added, mut count) = (0.0, 0.0, 0.0);
        for (x, y) in (20..60).flat_map(|x| (10..110).map(move |y| (x, y))) {
            let mean = view.mean(&neighbours, x, y, &table).expect("eight samples");
            squares += (mean[1] - 60.0).powi(2);
            added += mean[3];
            count += 1.0;
        }
        // Seven samples; the scaled one has 1.25² of their variance.
        let expected = SIGMA * SIGMA * added / count;
        assert!((squares / count / expected - 1.0).abs() < 0.15, "{} {expected}", squares / count);
        assert!(added / count < 1.1 / 7.0 && added / count > 0.4 / 7.0, "interpolation averages: {}", added / count);
    }
}
