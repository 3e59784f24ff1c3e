//! A frame prepared for alignment: image pyramid, depth, and points with high gradient.

use glam::{DVec2, DVec3};

use super::camera_model::CameraModel;
use super::depth_at_frame;
use super::noise_level::{luma_variance, share_kept, variance_bound};
use super::state::{CameraState, move_point};
use crate::camera::{Geometry, NoiseProfile};
use crate::frame::Frame;
use crate::grey_image::{GreyImage, dilated, gaussian};
use crate::hash::mix64;

/// Largest number of points by level, from the finest; coarser levels have the last.
const MAX_POINTS: [usize; 4] = [6000, 4000, 2500, 1500];
/// Side of the blocks over which the gradient is averaged, px, by level.
const BLOCK_PX: [usize; 3] = [32, 16, 8];
/// Gradient threshold: multiple of the block's mean, plus an offset, codes per px of the level.
const GRADIENT_FACTOR: f32 = 1.5;
const GRADIENT_OFFSET: f32 = 1.2;
/// A level has low contrast if fewer points pass the threshold and its mean gradient is below this,
/// codes per px. The offset is then dropped.
const ENOUGH_POINTS: usize = 600;
const LOW_GRADIENT: f32 = 2.0 * GRADIENT_OFFSET / GRADIENT_FACTOR;
/// Smallest distance of a point from the level's edge, px.
const MARGIN_PX: usize = 4;
/// Smallest distance of a point from a depth edge, px, and smallest relative depth step of an edge.
const DEPTH_EDGE_DISTANCE_PX: usize = 3;
const DEPTH_EDGE_STEP: f32 = 0.05;

/// A point of a frame with a high gradient and known depth.
#[derive(Clone, Copy, Debug)]
pub struct AlignPoint {
    /// Position in the camera's axes at the middle row's time, m.
    pub at: DVec3,
    /// Brightness, codes.
    pub value: f64,
    /// Derivative of the brightness at the point by a twist, codes.
    pub value_by: [f64; 6],
    /// Derivative of the pixel by a twist, px.
    pub place_by: [[f64; 6]; 2],
    /// Time of the row as a fraction of the readout time, −½ to ½.
    pub row: f64,
}

/// A level of an image pyramid, half as wide as the one before.
#[derive(Debug)]
pub struct Level {
    pub picture: GreyImage,
    pub points: Vec<AlignPoint>,
    /// Variance of the picture's noise, codes²; 0 if unknown.
    pub noise: f64,
}

/// A frame with all that its alignment to other frames needs.
#[derive(Debug)]
pub struct LinkView {
    pub index: usize,
    pub state: CameraState,
    /// Depth at the frame's time, m or the recording's unit; 0 where unknown.
    pub depth: Vec<f32>,
    /// Pyramid levels, the finest first.
    pub levels: Vec<Level>,
}

impl LinkView {
    /// `depth`: at the frame's time and pixels. Levels finer than `finest` have no points. `noise`:
    /// the camera's, if calibrated.
    pub fn new(
        model: &CameraModel,
        frame: &Frame,
        state: CameraState,
        depth: Vec<f32>,
        finest: usize,
        noise: Option<&NoiseProfile>,
    ) -> Self {
        let (width, _) = model.size();
        let is_usable = usable(frame, &depth, width);
        let mut picture = GreyImage::luma_601(&frame.pixels);
        let luma = noise.map(|profile| (profile, luma_variance(profile, &frame.pixels)));
        let mut levels = Vec::new();
        for level in 0..model.levels() {
            let next = picture.halved();
            if level == 0 {
                picture = picture.filtered(&gaussian(1.0));
            }
            let points =
                if level < finest { Vec::new() } else { points(model, &picture, level, &depth, &is_usable, &state) };
            let by_profile = luma.map(|(profile, variance)| variance * share_kept(profile, level));
            let noise = if level < finest { 0.0 } else { variance_bound(by_profile, &picture) };
            levels.push(Level { picture, points, noise });
            picture = next;
        }
        Self { index: frame.index, state, depth, levels }
    }
}

/// Mask of the pixels with depth, away from depth edges and clipped pixels.
fn usable(frame: &Frame, depth: &[f32], width: usize) -> Vec<bool> {
    let pixels = &frame.pixels;
    let clipped = pixels.each(|c| f32::from(u8::from(c.into_iter().any(|code| code >= pixels.clip_code()))));
    let near_clipped = dilated(&clipped, width, 2);
    let smooth = depth_at_frame::smooth_mask(depth, width, DEPTH_EDGE_DISTANCE_PX, DEPTH_EDGE_STEP);
    smooth.iter().zip(&near_clipped).map(|(smooth, clipped)| *smooth && *clipped == 0.0).collect()
}

fn points(
    model: &CameraModel,
    picture: &GreyImage,
    level: usize,
    depth: &[f32],
    is_usable: &[bool],
    state: &CameraState,
) -> Vec<AlignPoint> {
    let (w, h) = (picture.width, picture.height);
    let (width, _) = model.size();
    let scale = 1usize << level;
    let (along, down) = picture.sobel();
    let slope: Vec<f32> = along.values.iter().zip(&down.values).map(|(x, y)| x.hypot(*y)).collect();
    let side = BLOCK_PX[level.min(BLOCK_PX.len() - 1)];
    let means = block_means(&slope, w, side);
    let across = w.div_ceil(side);
    let steeper_by = |more: f32| -> Vec<usize> {
        let places = (MARGIN_PX..h.saturating_sub(MARGIN_PX))
            .flat_map(|y| (MARGIN_PX..w.saturating_sub(MARGIN_PX)).map(move |x| (x, y)));
        let is_steep = |(x, y): &(usize, usize)| {
            let mean = means[(y / side) * across + x / side];
            slope[y * w + x] > GRADIENT_FACTOR * mean + more && is_usable[y * scale * width + x * scale]
        };
        places.filter(is_steep).map(|(x, y)| y * w + x).collect()
    };
    let mut steep = steeper_by(GRADIENT_OFFSET);
    let mean_slope = slope.iter().sum::<f32>() / slope.len().max(1) as f32;
    if steep.len() < ENOUGH_POINTS && mean_slope < LOW_GRADIENT {
        steep = steeper_by(0.0);
    }
    let max_points = MAX_POINTS[level.min(MAX_POINTS.len() - 1)];
    if steep.len() > max_points {
        // The smallest hashes of the positions: an even spread, the same in every run.
        steep.sort_unstable_by_key(|i| (scattered(*i as u64), *i));
        steep.truncate(max_points);
        steep.sort_unstable();
    }
    let point = |i: usize| {
        let (x, y) = ((i % w) * scale, (i / w) * scale);
        let at = y * width + x;
        let z = f64::from(depth[at]);
        let ray = DVec3::from(model.rays[at].map(f64::from));
        let slope = DVec2::new(along.values[i].into(), down.values[i].into()) / scale as f64;
        of_place(&model.geometry, z * ray, y as f64 + 0.5, f64::from(picture.values[i]), slope, state)
    };
    steep.into_iter().filter_map(point).collect()
}

/// The point of a pixel. `there`: its position in the camera's axes at its row's time.
fn of_place(
    geometry: &Geometry,
    there: DVec3,
    row_px: f64,
    value: f64,
    slope: DVec2,
    state: &CameraState,
) -> Option<AlignPoint> {
    const STEP_M: f64 = 1e-4;
    let here = geometry.project(there)?;
    let slope_px = |axis: DVec3| Some((geometry.project(there + STEP_M * axis)? - here) / STEP_M);
    let by_place = [slope_px(DVec3::X)?, slope_px(DVec3::Y)?, slope_px(DVec3::Z)?];
    let at = move_point(there, &state.twist, geometry.row_time_s(row_px));
    // ẋ = v + ω × x.
    let by_turn = [DVec3::new(0.0, -at.z, at.y), DVec3::new(at.z, 0.0, -at.x), DVec3::new(-at.y, at.x, 0.0)];
    let turned = by_turn.map(|d| d.x * by_place[0] + d.y * by_place[1] + d.z * by_place[2]);
    let columns = [by_place[0], by_place[1], by_place[2], turned[0], turned[1], turned[2]];
    Some(AlignPoint {
        at,
        value,
        value_by: columns.map(|c| slope.dot(c)),
        place_by: [columns.map(|c| c.x), columns.map(|c| c.y)],
        row: row_px / f64::from(geometry.intrinsics.height_px) - 0.5,
    })
}

fn block_means(values: &[f32], width: usize, side: usize) -> Vec<f32> {
    let across = width.div_ceil(side);
    let down = (values.len() / width.max(1)).div_ceil(side);
    let (mut sums, mut counts) = (vec![0.0f32; across * down], vec![0u32; across * down]);
    for (i, value) in values.iter().enumerate() {
        let block = (i / width / side) * across + (i % width) / side;
        sums[block] += value;
        counts[block] += 1;
    }
    sums.iter().zip(&counts).map(|(sum, count)| sum / (*count).max(1) as f32).collect()
}

/// Number n of SplitMix64 (Steele, Lea and Flood 2014) with the seed 0.
pub fn scattered(n: u64) -> u64 {
    mix64(n.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15))
}
