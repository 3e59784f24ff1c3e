//! A depth map as the frame saw its surfaces: from the map's own moment, row by row, to the frame's.
//!
//! Like [`depth::seen_at_frame`](crate::depth), with what is known here besides: the rows' times, and how late the depth
//! sensor's clock is. Both cameras are read alike (a Kinect's two sensors are of one kind). Room and lamps stand still.

use glam::{DVec2, DVec3};

use super::state::{State, moved, seen};
use crate::camera::Geometry;
use crate::fit::twist;
use crate::pixels::DepthMap;

/// Nearer than this no sensor measures, m.
const NEAREST_M: f32 = 0.2;

/// The rays through a camera's pixel centres: times a depth it is the point. NaN where there is none.
pub fn rays(geometry: &Geometry) -> Vec<[f32; 3]> {
    let i = &geometry.intrinsics;
    let (width, height) = (i.width_px as usize, i.height_px as usize);
    let mut rays = vec![[f32::NAN; 3]; width * height];
    crate::parallel::over_rows(&mut rays, width, crate::parallel::processors(), |y, row| {
        for (x, ray) in row.iter_mut().enumerate() {
            if let Some(found) = geometry.depth_ray(DVec2::new(x as f64 + 0.5, y as f64 + 0.5)) {
                *ray = found.as_vec3().to_array();
            }
        }
    });
    rays
}

/// Depth at the frame's pixels, m, 0 where unknown. `later_s` is how much later than the frame's middle row the map's was
/// measured.
pub fn carried(geometry: &Geometry, rays: &[[f32; 3]], map: &DepthMap, state: &State, later_s: f64) -> Vec<f32> {
    let (width, height) = (map.width as usize, map.height as usize);
    if later_s == 0.0 {
        return map.depth_m.iter().map(|z| if *z > NEAREST_M { *z } else { 0.0 }).collect();
    }
    let shift = twist::exp(&(later_s * state.twist));
    let mut out = vec![0.0f32; width * height];
    for (i, (z, ray)) in map.depth_m.iter().zip(rays).enumerate() {
        if !(*z > NEAREST_M && ray[0].is_finite()) {
            continue;
        }
        let point = f64::from(*z) * DVec3::from(ray.map(f64::from));
        let row_s = geometry.row_time_s((i / width) as f64 + 0.5);
        let here = shift.transform_point3(moved(point, &state.twist, row_s));
        let Some((at, far)) = seen(geometry, here, &state.twist, Some((i / width) as f64 + 0.5), 1) else { continue };
        if at.x >= 0.0 && at.y >= 0.0 && at.x < width as f64 && at.y < height as f64 {
            let (x, y) = (at.x as usize, at.y as usize);
            let texel = &mut out[y * width + x];
            if *texel == 0.0 || (far as f32) < *texel {
                *texel = far as f32;
            }
        }
    }
    filled(&out, width)
}

/// Single pixels that no point hit between others that were: the nearest of them.
fn filled(depth: &[f32], width: usize) -> Vec<f32> {
    let mut out = depth.to_vec();
    let height = depth.len() / width.max(1);
    for y in 1..height.saturating_sub(1) {
        for x in 1..width - 1 {
            let i = y * width + x;
            if depth[i] > 0.0 {
                continue;
            }
            let around = [i - width, i, i + width].into_iter().flat_map(|i| [depth[i - 1], depth[i], depth[i + 1]]);
            let (known, nearest) = around.filter(|z| *z > 0.0).fold((0, f32::MAX), |(n, low), z| (n + 1, z.min(low)));
            if known >= 5 {
                out[i] = nearest;
            }
        }
    }
    out
}

/// Where depth is known and no edge of it is near: within `reach` pixels it differs by less than a `share`.
pub fn smooth(depth: &[f32], width: usize, reach: usize, share: f32) -> Vec<bool> {
    let largest = extreme(depth, width, reach, |a, b| if a > b { a } else { b });
    let known: Vec<f32> = depth.iter().map(|z| if *z > 0.0 { *z } else { f32::MAX }).collect();
    let least = extreme(&known, width, reach, |a, b| if a < b { a } else { b });
    let is_smooth = |((z, high), low): ((&f32, &f32), &f32)| *z > 0.0 && high - low < share * low;
    depth.iter().zip(&largest).zip(&least).map(is_smooth).collect()
}

/// The largest or smallest value of the square around each pixel.
pub fn extreme(values: &[f32], width: usize, reach: usize, of: impl Fn(f32, f32) -> f32) -> Vec<f32> {
    let height = values.len() / width.max(1);
    let mut across = values.to_vec();
    for (out, row) in across.chunks_mut(width.max(1)).zip(values.chunks(width.max(1))) {
        for k in 1..=reach.min(width.saturating_sub(1)) {
            for (out, v) in out.iter_mut().zip(&row[k..]) {
                *out = of(*out, *v);
            }
            for (out, v) in out[k..].iter_mut().zip(row) {
                *out = of(*out, *v);
            }
        }
    }
    let mut down = across.clone();
    for y in 0..height {
        for other in y.saturating_sub(reach)..(y + reach + 1).min(height) {
            let (out, row) = (&mut down[y * width..(y + 1) * width], &across[other * width..(other + 1) * width]);
            for (out, v) in out.iter_mut().zip(row) {
                *out = of(*out, *v);
            }
        }
    }
    down
}
