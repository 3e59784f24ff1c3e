//! Reprojection of a depth map to the pose of a frame.
//!
//! Depth and colour have different timestamps: at 1000 px/s, 10 ms are 10 px. Each measured point
//! is reprojected to the time of the frame by the poses, under the assumption of a static scene.
//! Disoccluded pixels stay unknown (`repair` fills them).
//!
//! Not modelled: the sensor's own readout.

use std::ops::Range;
use std::sync::OnceLock;

use glam::DVec2;

use super::reprojection::{LANES, PointBatch, Reprojection};
use crate::camera::{Geometry, Intrinsics};
use crate::parallel::{over_rows, processors};
use crate::pixels::{DepthMap, Rect, floor};
use crate::pose::Pose;
use crate::tracking::PoseTrack;

/// Margin around a part of the picture from which points may move into it, px.
pub const SOURCE_MARGIN_PX: i32 = 64;

/// The pose from which a camera's map was measured, or the reason why the map cannot be used.
pub fn measured_from(depth: &DepthMap, camera: &Geometry, track: &PoseTrack) -> Result<Pose, String> {
    let Intrinsics { width_px, height_px, .. } = camera.intrinsics;
    if (depth.width, depth.height) != (width_px, height_px) {
        return Err(format!("the depth is {}x{} px, the camera's {width_px}x{height_px}", depth.width, depth.height));
    }
    track.at(depth.timestamp_s).map_err(|why| format!("no pose of the depth: {why}"))
}

/// The rays through a camera's pixel centres. Each row is computed once, when it is first needed: a
/// lens's distortion is costly to invert, and most requests are for a part of the picture.
#[derive(Debug)]
pub struct Rays {
    geometry: Geometry,
    /// Scaled so that depth × ray is the point. NaN for pixels without a ray, or without a depth.
    /// No memo: rows by index, which pixel loops read in place.
    rows: Vec<OnceLock<Vec<[f32; 3]>>>,
}

/// A depth map reprojected to the time of a frame, m, row by row; 0 where unknown. `None` without a
/// pose at one of the two times.
pub fn reprojected_at_frame(
    recorded: &Geometry,
    depth: &DepthMap,
    track: &PoseTrack,
    timestamp_s: f64,
) -> Option<Vec<f32>> {
    let map_pose = track.at(depth.timestamp_s).ok()?;
    let picture_pose = track.at(timestamp_s).ok()?;
    let whole = Rect::full(recorded.intrinsics.width_px, recorded.intrinsics.height_px);
    Some(Rays::new(recorded).reproject(depth, &map_pose, &picture_pose, whole))
}

impl Rays {
    pub fn new(geometry: &Geometry) -> Self {
        let rows = std::iter::repeat_with(OnceLock::new).take(geometry.intrinsics.height_px as usize).collect();
        Self { geometry: geometry.clone(), rows }
    }

    /// Computes the missing rows of a range.
    pub fn prepare(&self, rows: Range<i32>) {
        let missing: Vec<usize> =
            (rows.start as usize..rows.end as usize).filter(|y| self.rows[*y].get().is_none()).collect();
        let width = self.geometry.intrinsics.width_px as usize;
        let mut rays = vec![[f32::NAN; 3]; width * missing.len()];
        over_rows(&mut rays, width, processors(), |n, row| {
            for (x, ray) in row.iter_mut().enumerate() {
                let at = DVec2::new(x as f64 + 0.5, missing[n] as f64 + 0.5);
                if let Some(unit_ray) = self.geometry.depth_ray(at) {
                    *ray = unit_ray.as_vec3().to_array();
                }
            }
        });
        for (y, row) in missing.iter().zip(rays.chunks(width.max(1))) {
            // Another thread may have computed the same.
            let _ = self.rows[*y].set(row.to_vec());
        }
    }

    /// The rays of a row. `None` before it was prepared.
    pub fn row(&self, y: usize) -> Option<&[[f32; 3]]> {
        self.rows[y].get().map(Vec::as_slice)
    }

    /// The whole picture.
    pub fn full(&self) -> Rect {
        Rect::full(self.geometry.intrinsics.width_px, self.geometry.intrinsics.height_px)
    }

    /// The camera of these rays.
    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// Depth over `rect` from the frame's pose, m; 0 where unknown. It is the distance from the
    /// camera if the picture does not fit a plane, otherwise z. In a 360° picture `rect` may extend
    /// beyond the left and right rims.
    ///
    /// Each point covers the 2×2 pixels around its new position, so that slight magnification
    /// leaves no holes. The nearest point wins. A map of another size than the camera's picture
    /// gives 0 everywhere.
    pub fn reproject(&self, depth: &DepthMap, measured: &Pose, frame: &Pose, rect: Rect) -> Vec<f32> {
        let width = rect.width() as usize;
        let mut out = vec![0.0f32; width * rect.height() as usize];
        let i = &self.geometry.intrinsics;
        if (depth.width, depth.height) != (i.width_px, i.height_px) {
            return out;
        }
        let full = Rect::full(depth.width, depth.height);
        let turns: &[i32] = if self.geometry.is_equirectangular() { &[0, -1, 1] } else { &[0] };
        let put = |out: &mut [f32], x: i32, y: i32, d: f32| {
            for turn in turns {
                let x = x + turn * depth.width as i32;
                if rect.contains(x, y) {
                    let texel = &mut out[(y - rect.y0) as usize * width + (x - rect.x0) as usize];
                    if *texel == 0.0 || d < *texel {
                        *texel = d;
                    }
                }
            }
        };
        let is_still = measured == frame;
        // Points outside the rectangle may move into it: at most as far as in a fast pan between
        // the times of the two sensors.
        let mut source = rect.grown(if is_still { 0 } else { SOURCE_MARGIN_PX }).intersection(&full);
        if self.geometry.is_equirectangular() {
            source = Rect { x0: full.x0, x1: full.x1, ..source };
        }
        if source.is_empty() {
            return out;
        }
        let row = |y: i32| {
            let start = y as usize * depth.width as usize;
            &depth.depth_m[start + source.x0 as usize..start + source.x1 as usize]
        };
        // Without motion z stays the same.
        if is_still && !self.geometry.needs_cube_map() {
            for y in source.y0..source.y1 {
                let there = &mut out[(y - rect.y0) as usize * width + (source.x0 - rect.x0) as usize..];
                there.iter_mut().zip(row(y)).for_each(|(there, d)| *there = if *d > 0.0 { *d } else { 0.0 });
            }
            return out;
        }
        self.prepare(source.y0..source.y1);
        let reprojection = Reprojection::new(&self.geometry, measured, frame);
        // Positions of the upper left of four pixels, so that all four are inside.
        let inner = Rect { x1: rect.x1 - 1, y1: rect.y1 - 1, ..rect };
        for y in source.y0..source.y1 {
            let Some(rays) = self.row(y as usize) else { continue };
            let rays = &rays[source.x0 as usize..source.x1 as usize];
            for (x, (piece, rays)) in (source.x0..).step_by(LANES).zip(row(y).chunks(LANES).zip(rays.chunks(LANES))) {
                let reprojected = reprojection.reproject(&PointBatch::of(piece, rays));
                for lane in (0..piece.len()).filter(|&lane| reprojected.depth_m[lane] > 0.0) {
                    let depth_m = reprojected.depth_m[lane];
                    if is_still {
                        put(&mut out, x + lane as i32, y, depth_m);
                        continue;
                    }
                    // Pixel centres are at +0.5: the 2×2 pixels whose centres surround the point.
                    let [left, top] = [reprojected.x_px[lane], reprojected.y_px[lane]].map(|at| floor(at - 0.5));
                    if turns.len() == 1 && inner.contains(left, top) {
                        let first = (top - rect.y0) as usize * width + (left - rect.x0) as usize;
                        for i in [first, first + 1, first + width, first + width + 1] {
                            out[i] = if out[i] == 0.0 { depth_m } else { out[i].min(depth_m) };
                        }
                        continue;
                    }
                    for (px, py) in [(left, top), (left + 1, top), (left, top + 1), (left + 1, top + 1)] {
                        put(&mut out, px, py, depth_m);
                    }
                }
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Distortion, Intrinsics};
    use glam::{DQuat, DVec3};

    #[test]
    fn wall_keeps_its_depth_and_moves_by_parallax() {
        let intrinsics = Intrinsics {
            width_px: 64,
            height_px: 48,
            fx_px: 100.0,
            fy_px: 100.0,
            cx_px: 32.0,
            cy_px: 24.0,
            ..Default::default()
        };
        let geometry = Geometry::new(intrinsics, Distortion::default());
        // A wall at 2 m, and at 1 m in its left half.
        let depth_m = (0..64 * 48).map(|i| if i % 64 < 32 { 1.0 } else { 2.0 }).collect();
        let depth = DepthMap { width: 64, height: 48, depth_m, timestamp_s: 0.0 };
        // The camera moves 0.1 m to the left: near points move right by 10 px, far ones by 5.
        let before = Pose::IDENTITY;
        let after = Pose::from_camera_in_world(DVec3::new(-0.1, 0.0, 0.0), DQuat::IDENTITY);
        let out = Rays::new(&geometry).reproject(&depth, &before, &after, Rect::full(64, 48));
        let row = &out[24 * 64..25 * 64];
        assert!((row[40] - 1.0).abs() < 1e-6, "{}", row[40]);
        assert!((row[45] - 2.0).abs() < 1e-6, "{}", row[45]);
        // The part left of the old picture was never measured.
        assert_eq!(row[3], 0.0);
    }

    #[test]
    fn measured_from_with_a_time_offset_is_the_pose_of_the_shifted_time() {
        // The camera moves 1 m along x each second.
        let at = |time_s: f64| Pose::from_camera_in_world(DVec3::new(time_s, 0.0, 0.0), DQuat::IDENTITY);
        let track = PoseTrack::new(vec![(0.0, at(0.0)), (1.0, at(1.0))], 2.0).unwrap();
        let depth = DepthMap { width: 4, height: 2, depth_m: vec![1.0; 8], timestamp_s: 0.25 };
        let measured = |offset_s| {
            measured_from(&depth, &Geometry::pinhole(4, 2, 3.0), &track.clone().with_clock_offset_s(offset_s))
        };
        for offset_s in [0.0, 0.5, -0.125] {
            let x_m = measured(offset_s).unwrap().position_in_world_m().x;
            assert!((x_m - (0.25 + offset_s)).abs() < 1e-12, "{offset_s} s: {x_m} m");
        }
        // The shifted times, 1.25 s and -0.25 s, are outside the track.
        assert!(measured(1.0).is_err() && measured(-0.5).is_err());
    }
}
