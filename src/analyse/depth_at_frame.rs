//! Reprojects a depth map from its own time to the time of a frame, row by row.
//!
//! Like [`depth::reprojected_at_frame`](crate::depth), with two additions: the row times of the
//! rolling shutter, and the clock offset of the depth sensor. Both cameras are assumed to have the
//! same readout (a Kinect's two sensors are of one kind). The scene is assumed to be static.

use glam::{DVec2, DVec3};

use super::state::{CameraState, move_point, project_rolling_shutter};
use crate::camera::Geometry;
use crate::fit::twist;
use crate::grey_image::{dilated, eroded};
use crate::pixels::DepthMap;

/// Smallest depth that a sensor measures, m.
const MIN_DEPTH_M: f32 = 0.2;

/// Rays of unit depth through the pixel centres. NaN where a pixel has none.
pub fn pixel_rays(geometry: &Geometry) -> Vec<[f32; 3]> {
    let i = &geometry.intrinsics;
    let (width, height) = (i.width_px as usize, i.height_px as usize);
    let mut rays = vec![[f32::NAN; 3]; width * height];
    crate::parallel::over_rows(&mut rays, width, crate::parallel::processors(), |y, row| {
        for (x, ray) in row.iter_mut().enumerate() {
            if let Some(camera_ray) = geometry.depth_ray(DVec2::new(x as f64 + 0.5, y as f64 + 0.5)) {
                *ray = camera_ray.as_vec3().to_array();
            }
        }
    });
    rays
}

/// Depth at the frame's pixels, m, 0 where unknown. `later_s`: time of the map's middle row minus
/// that of the frame's.
pub fn depth_at_frame(
    geometry: &Geometry,
    rays: &[[f32; 3]],
    map: &DepthMap,
    state: &CameraState,
    later_s: f64,
) -> Vec<f32> {
    let (width, height) = (map.width as usize, map.height as usize);
    if later_s == 0.0 {
        return map.depth_m.iter().map(|z| if *z > MIN_DEPTH_M { *z } else { 0.0 }).collect();
    }
    let shift = twist::exp(&(later_s * state.twist));
    let mut out = vec![0.0f32; width * height];
    for (i, (z, ray)) in map.depth_m.iter().zip(rays).enumerate() {
        if !(*z > MIN_DEPTH_M && ray[0].is_finite()) {
            continue;
        }
        let point = f64::from(*z) * DVec3::from(ray.map(f64::from));
        let row_s = geometry.row_time_s((i / width) as f64 + 0.5);
        let here = shift.transform_point3(move_point(point, &state.twist, row_s));
        let Some((at, far)) = project_rolling_shutter(geometry, here, &state.twist, Some((i / width) as f64 + 0.5), 1)
        else {
            continue;
        };
        if at.x >= 0.0 && at.y >= 0.0 && at.x < width as f64 && at.y < height as f64 {
            let (x, y) = (at.x as usize, at.y as usize);
            let texel = &mut out[y * width + x];
            if *texel == 0.0 || (far as f32) < *texel {
                *texel = far as f32;
            }
        }
    }
    fill_pinholes(&out, width)
}

/// Fills pixels that no point hit if at least 5 of their 8 neighbours have a depth, with the
/// smallest of these.
fn fill_pinholes(depth: &[f32], width: usize) -> Vec<f32> {
    let mut out = depth.to_vec();
    let height = depth.len() / width.max(1);
    for y in 1..height.saturating_sub(1) {
        for x in 1..width - 1 {
            let i = y * width + x;
            if depth[i] > 0.0 {
                continue;
            }
            let around = [i - width, i, i + width].into_iter().flat_map(|i| [depth[i - 1], depth[i], depth[i + 1]]);
            let (measured_count, nearest) =
                around.filter(|z| *z > 0.0).fold((0, f32::MAX), |(n, low), z| (n + 1, z.min(low)));
            if measured_count >= 5 {
                out[i] = nearest;
            }
        }
    }
    out
}

/// Mask of the pixels with depth and without a depth edge near: within `reach` pixels depth varies
/// by less than `share` of it.
pub fn smooth_mask(depth: &[f32], width: usize, reach: usize, share: f32) -> Vec<bool> {
    let farthest = dilated(depth, width, reach);
    let depth_or_max: Vec<f32> = depth.iter().map(|z| if *z > 0.0 { *z } else { f32::MAX }).collect();
    let nearest = eroded(&depth_or_max, width, reach);
    let is_smooth = |((z, high), low): ((&f32, &f32), &f32)| *z > 0.0 && high - low < share * low;
    depth.iter().zip(&farthest).zip(&nearest).map(is_smooth).collect()
}
