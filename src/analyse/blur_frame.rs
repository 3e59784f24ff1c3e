//! A frame prepared for the comparison of motion blur: band-passed green light, and synthetic noise
//! like the camera's.

use super::camera_model::CameraModel;
use super::state::CameraState;
use super::view::scattered;
use crate::camera::{NoiseProfile, Response, side_tap};
use crate::fit::twist::Twist;
use crate::frame::Frame;
use crate::grey_image::{GreyImage, gaussian};

/// Largest width of the reduced pictures, px.
const MAX_WIDTH_PX: usize = 800;
/// Side of a cell of the clipping mask, px of the full picture.
const CLIP_CELL_PX: usize = 8;
/// σ of the two Gaussians of the band-pass, px.
const BAND_SIGMAS_PX: (f32, f32) = (1.2, 3.0);

/// A frame prepared for comparison.
#[derive(Debug)]
pub struct BlurFrame {
    pub state: CameraState,
    /// Acceleration, m/s² and rad/s².
    pub acceleration: Twist,
    /// Linear light of green, reduced.
    pub light: GreyImage,
    /// Synthetic noise; `None` without a noise profile.
    pub noise: Option<GreyImage>,
    /// `light` and `noise` after the band-pass.
    pub band: GreyImage,
    pub noise_band: Option<GreyImage>,
    /// Depth at full size, m or the recording's unit; 0 where unknown.
    pub depth: Vec<f32>,
    is_clipped: Vec<bool>,
}

/// Number of halvings of the pictures.
pub fn halvings(model: &CameraModel) -> usize {
    (0..).find(|n| model.size().0 >> n <= MAX_WIDTH_PX).unwrap_or(0)
}

impl BlurFrame {
    /// `depth`: at the frame's time and pixels.
    pub fn new(
        model: &CameraModel,
        frame: &Frame,
        (state, acceleration): (CameraState, Twist),
        depth: Vec<f32>,
        response: &Response,
        noise: Option<&NoiseProfile>,
    ) -> Self {
        let light_of: Vec<f32> =
            response.table(frame.pixels.max_code()).into_iter().map(|light| light as f32).collect();
        let (width, height) = model.size();
        let clip_code = frame.pixels.clip_code();
        let across = width.div_ceil(CLIP_CELL_PX);
        let mut is_clipped = vec![false; across * height.div_ceil(CLIP_CELL_PX)];
        let clipped = frame.pixels.each(|c| c.into_iter().any(|code| code >= clip_code));
        for (i, _) in clipped.iter().enumerate().filter(|(_, clipped)| **clipped) {
            is_clipped[(i / width / CLIP_CELL_PX) * across + i % width / CLIP_CELL_PX] = true;
        }
        let greens = frame.pixels.each(|c| c[1]);
        let values = greens.iter().map(|g| light_of[*g as usize]).collect();
        let mut light = GreyImage { width, height, values };
        let mut noise = noise.map(|profile| {
            let scale = frame.pixels.max_code() as f32 / 255.0;
            let codes = greens.iter().map(|g| *g as f32 / scale).collect();
            synthetic_noise(GreyImage { width, height, values: codes }, frame.index, profile, response)
        });
        for _ in 0..halvings(model) {
            light = light.halved();
            noise = noise.map(|noise| noise.halved());
        }
        let band = band_pass(&light);
        let noise_band = noise.as_ref().map(band_pass);
        Self { state, acceleration, light, noise, band, noise_band, depth, is_clipped }
    }

    /// The state with the velocity at a row's time, s from the middle row's.
    pub fn at_row(&self, row_s: f64) -> CameraState {
        CameraState { twist: self.state.twist + row_s * self.acceleration, ..self.state }
    }

    /// True if a pixel near this one of the full picture may be clipped.
    pub fn is_clipped_near(&self, model: &CameraModel, x: f64, y: f64) -> bool {
        let (width, height) = model.size();
        let (across, down) = (width.div_ceil(CLIP_CELL_PX) as i64, height.div_ceil(CLIP_CELL_PX) as i64);
        let (cx, cy) = ((x / CLIP_CELL_PX as f64) as i64, (y / CLIP_CELL_PX as f64) as i64);
        let is_in_picture = |x: i64, y: i64| x >= 0 && y >= 0 && x < across && y < down;
        (-1..=1).any(|dy| {
            (-1..=1)
                .any(|dx| is_in_picture(cx + dx, cy + dy) && self.is_clipped[((cy + dy) * across + cx + dx) as usize])
        })
    }
}

/// Difference of two Gaussians.
pub fn band_pass(plane: &GreyImage) -> GreyImage {
    let (fine, coarse) = (plane.filtered(&gaussian(BAND_SIGMAS_PX.0)), plane.filtered(&gaussian(BAND_SIGMAS_PX.1)));
    let values = fine.values.iter().zip(&coarse.values).map(|(a, b)| a - b).collect();
    GreyImage { values, ..fine }
}

/// Synthetic camera noise on a picture of codes, in linear light: white noise through (a, 1, a),
/// times σ and the response's slope.
fn synthetic_noise(codes: GreyImage, index: usize, profile: &NoiseProfile, response: &Response) -> GreyImage {
    let table: Vec<f32> = (0..256)
        .map(|code| {
            let code = f64::from(code);
            let slope = response.slope_at_code(code / 255.0).max(1e-6);
            (profile.sigma(1, code) / 255.0 / slope) as f32
        })
        .collect();
    let plane = unit_noise(codes.width, codes.height, index as u64, profile.neighbour_correlation);
    // By the codes of the smoothed picture, so that σ does not depend on the noise itself.
    let smooth = codes.filtered(&gaussian(1.5));
    let values = plane.values.iter().zip(&smooth.values).map(|(n, code)| n * table[code.clamp(0.0, 255.0) as usize]);
    GreyImage { values: values.collect(), ..codes }
}

/// Noise of unit variance with the given correlation of neighbours along rows and along columns:
/// white noise filtered by (a, 1, a). Depends on the seed alone.
pub fn unit_noise(width: usize, height: usize, seed: u64, neighbour_correlation: [f64; 2]) -> GreyImage {
    let seed = scattered(seed);
    let mut white = vec![0.0f32; width * height];
    for (i, value) in white.iter_mut().enumerate() {
        // Four uniform numbers: variance 4/12.
        let bits = scattered(seed ^ i as u64);
        let sum: u32 = (0..4).map(|k| (bits >> (16 * k)) as u32 & 0xffff).sum();
        *value = (sum as f32 / 65536.0 - 2.0) * 3f32.sqrt();
    }
    let axis = |rho: f64| {
        let a = side_tap(rho);
        let whole = (1.0 + 2.0 * a * a).sqrt();
        [(1.0 / whole) as f32, (a / whole) as f32]
    };
    let [x, y] = neighbour_correlation.map(axis);
    GreyImage { width, height, values: white }.filtered_by_axis(&x, &y)
}
