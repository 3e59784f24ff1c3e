//! The rays of a camera's pixels on a coarse grid, and the tiles in which they are straight.

use std::sync::Arc;

use glam::{DVec2, Vec3};

use crate::camera::Geometry;
use crate::gpu::{Gpu, Texture};
use crate::parallel::{over_rows, processors};

/// Spacing of the grid of rays, px. Between two of them a lens bends rays by less than a thousandth
/// of a pixel.
pub const RAY_GRID_PX: u32 = 8;
/// Possible sides of the tiles in which a planar shadow is drawn, px. The largest is used within
/// which rays are straight to `MAX_BEND_PX`. The smallest is a cell of the grid.
const TILE_SIDES_PX: [i32; 3] = [32, 16, RAY_GRID_PX as i32];
/// Largest error of rays interpolated across a tile, px.
const MAX_BEND_PX: f64 = 0.1;

/// The rays through every eighth pixel's corner.
#[derive(Clone, Debug)]
pub struct RayGrid {
    pub texture: Texture,
    /// The texels: a ray, and 1 if it exists.
    nodes: Arc<[[f32; 4]]>,
    pub size: [u32; 2],
    /// Side of the tiles in which a planar shadow is drawn, px.
    pub tile_px: i32,
}

impl RayGrid {
    pub fn new(gpu: &Gpu, geometry: &Geometry) -> Self {
        let i = &geometry.intrinsics;
        let size = [i.width_px, i.height_px].map(|side| side.div_ceil(RAY_GRID_PX).max(1) + 1);
        let mut texels = vec![[0.0f32; 4]; size[0] as usize * size[1] as usize];
        over_rows(&mut texels, size[0] as usize, processors(), |y, row| {
            for (x, texel) in row.iter_mut().enumerate() {
                let at = DVec2::new(x as f64, y as f64) * f64::from(RAY_GRID_PX);
                if let Some(ray) = geometry.depth_ray(at) {
                    *texel = ray.as_vec3().extend(1.0).to_array();
                }
            }
        });
        let texture = Texture::new(gpu, "rays", size[0], size[1], wgpu::TextureFormat::Rgba32Float, 1);
        texture.write(gpu, size[0], size[1], &texels);
        Self { texture, nodes: texels.into(), size, tile_px: tile_side_px(geometry) }
    }

    /// The ray through a corner of the grid's cells, if it exists.
    pub fn at(&self, x_px: i32, y_px: i32) -> Option<Vec3> {
        let [column, row] = [(x_px, 0), (y_px, 1)].map(|(at, axis)| {
            let node = at / RAY_GRID_PX as i32;
            usize::try_from(node).ok().filter(|node| *node < self.size[axis] as usize)
        });
        let [x, y, z, exists] = self.nodes[row? * self.size[0] as usize + column?];
        (exists > 0.0).then(|| Vec3::new(x, y, z))
    }
}

/// The side of tiles in which this camera's rays are straight.
fn tile_side_px(geometry: &Geometry) -> i32 {
    let i = &geometry.intrinsics;
    let [largest, .., smallest] = TILE_SIDES_PX;
    let side = f64::from(largest);
    let bend_px = |x: u32, y: u32| {
        let ray = |across: f64, down: f64| {
            geometry.depth_ray(side * (DVec2::new(x.into(), y.into()) + DVec2::new(across, down)))
        };
        // A tile is two triangles, so its middle lies on one of its diagonals.
        let middle = ray(0.5, 0.5)?;
        let [one, other] = [(ray(0.0, 0.0)?, ray(1.0, 1.0)?), (ray(1.0, 0.0)?, ray(0.0, 1.0)?)]
            .map(|(from, to)| middle.distance(0.5 * (from + to)) * i.fx_px.max(i.fy_px));
        Some(one.max(other))
    };
    let [columns, rows] = [i.width_px, i.height_px].map(|length| length.div_ceil(largest as u32));
    let tiles = (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y)));
    let Some(bend_px) = tiles.map(|(x, y)| bend_px(x, y)).try_fold(0.0, |max, bend| Some(f64::max(max, bend?))) else {
        return smallest;
    };
    // The error grows with the square of the side.
    let is_straight = |tile_px: &i32| bend_px * (f64::from(*tile_px) / side).powi(2) <= MAX_BEND_PX;
    TILE_SIDES_PX.into_iter().find(is_straight).unwrap_or(smallest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_are_smaller_for_stronger_lens_distortion() {
        use crate::camera::{Distortion, LensModel};
        let with = |distortion: Distortion| {
            let straight = Geometry::pinhole(640, 480, 520.0);
            tile_side_px(&Geometry::new(straight.intrinsics, distortion))
        };
        assert_eq!(with(Distortion::default()), 32);
        assert_eq!(with(Distortion { k1: -0.05, ..Distortion::default() }), 16);
        assert_eq!(with(Distortion { k1: 0.2624, k2: -0.9531, k3: 1.1633, ..Distortion::default() }), 8);
        assert_eq!(with(Distortion { model: LensModel::OpencvFisheye, ..Distortion::default() }), 8);
    }
}
