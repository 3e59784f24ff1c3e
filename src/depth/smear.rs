//! Motion of a static point's image during the exposure.

use glam::DVec2;

use crate::camera::Geometry;
use crate::pixels::Rect;
use crate::pose::Pose;

/// Side of the cells of nearly uniform motion, px.
const CELL_PX: i32 = 16;

/// Image motion over a part of the picture, by depth. Not modelled: the time of each row, which
/// changes the motion little.
#[derive(Debug)]
pub struct MotionField {
    columns: usize,
    /// Motion of an infinitely distant point in each cell, px, and the additional motion of a point
    /// at 1 m. The latter is proportional to 1/z.
    cells: Vec<[DVec2; 2]>,
}

impl MotionField {
    /// Motion between the poses at the start and at the end of the exposure, over a part of the
    /// picture.
    pub fn new(geometry: &Geometry, frame: &Pose, [opened, closed]: [&Pose; 2], part: Rect) -> Self {
        let cells = |from: i32, to: i32| (from..to).step_by(CELL_PX as usize).map(|at| f64::from(at + CELL_PX / 2));
        let motion_px = |at: DVec2, z: f64| {
            let point = frame.inverse_transform_point(z * geometry.depth_ray(at)?);
            let project = |pose: &Pose| geometry.project(pose.transform_point(point));
            Some(geometry.displacement_px(project(opened)?, project(closed)?))
        };
        // Infinity is a thousand kilometres, for the limited precision of poses.
        let both = |at: DVec2| {
            let far = motion_px(at, 1e6).unwrap_or_default();
            [far, motion_px(at, 1.0).map_or(DVec2::ZERO, |near| near - far)]
        };
        let all = cells(part.y0, part.y1).flat_map(|y| cells(part.x0, part.x1).map(move |x| both(DVec2::new(x, y))));
        Self { columns: cells(part.x0, part.x1).count(), cells: all.collect() }
    }

    /// Motion of a point at the depth `z_m` at a pixel of the part, px.
    pub fn at(&self, x: usize, y: usize, z_m: f32) -> [f32; 2] {
        let side = CELL_PX as usize;
        let [far, near] = self.cells[y / side * self.columns + x / side];
        (far + near / f64::from(z_m)).as_vec2().to_array()
    }

    /// Largest motion of points at `nearest_m` or farther, px.
    pub fn max_length_px(&self, nearest_m: f32) -> f32 {
        let ends = self.cells.iter().flat_map(|[far, near]| [*far, *far + *near / f64::from(nearest_m)]);
        ends.map(DVec2::length).fold(0.0, f64::max) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};

    #[test]
    fn motion_is_inversely_proportional_to_depth() {
        // 20 mm to the right at f = 100 px: 2 px at 1 m, 1 px at 2 m, to the left.
        let at = |x: f64| Pose::from_camera_in_world(DVec3::new(x, 0.0, 0.0), DQuat::IDENTITY);
        let camera = Geometry::pinhole(64, 48, 100.0);
        let smear = MotionField::new(&camera, &at(0.0), [&at(-0.01), &at(0.01)], Rect::new(3, 5, 64, 40));
        let motions = [1.0, 2.0].map(|z| smear.at(60, 34, z));
        for ([x, y], expected) in motions.into_iter().zip([-2.0, -1.0]) {
            assert!((x - expected).abs() < 1e-3 && y.abs() < 1e-3, "{motions:?}");
        }
        assert!((smear.max_length_px(0.5) - 4.0).abs() < 1e-3);
    }
}
