//! The depth maps of a recording fused into surfels (Keller et al. 2013): means of voxels that
//! several frames saw, without those that other frames saw through. Occlusion takes them where a
//! frame's map and its neighbours' have no depth ([`crate::depth`]).
//!
//! At most 120 frames, spread over the recording, contribute depth of up to 4 m. Not modelled: when
//! a surface was there. Things that are moved while the recording runs are seen through before or
//! after, and left out.

use glam::DVec3;

use super::camera_model::{CameraModel, is_same_surface};
use super::light::{CoarseDepth, LightInputs, Voxel, Voxels};
use super::registration_result::RegistrationError;
use super::times::{self, Times};
use crate::frame::Surfel;
use crate::parallel::over_rows;

/// Frames that must have seen a voxel.
const MIN_FRAMES: u32 = 2;
/// Number of frames, spread over the recording, by which visibility is tested.
const MAX_TESTED_FRAMES: usize = 40;
/// Largest number of voxels. Rooms that are entered later have no surfels.
const MAX_VOXELS: usize = 400_000;
/// Largest share of frames that measured something behind a voxel, of those that measured it or
/// something behind it.
const MAX_SEEN_THROUGH_SHARE: f64 = 0.25;
/// Voxels that a thread tests at a time.
const VOXELS_PER_BLOCK: usize = 256;

/// Surfels of the recording ([`Surfel::to_array`]), in an order that does not depend on
/// `inputs.threads`; none without a depth sensor.
pub fn surfels(inputs: &LightInputs<'_>, times: &mut Times) -> Result<Vec<[f32; 9]>, RegistrationError> {
    if !inputs.recording.has_measured_depth() || inputs.model.geometry.needs_cube_map() {
        return Ok(Vec::new());
    }
    let (mut voxels, mut depths) = (Voxels::with_limit(MAX_VOXELS), Vec::new());
    inputs.every(times, &mut |view| {
        voxels.add(&view.samples, view.camera_at, view.half);
        depths.push(view.depth);
    })?;
    Ok(times.of(times::SURFACES, || {
        let step = depths.len().div_ceil(MAX_TESTED_FRAMES).max(1);
        let tested: Vec<&CoarseDepth> = depths.iter().step_by(step).collect();
        let surfaces = voxels.surfaces(MIN_FRAMES, inputs.threads);
        let mut is_solid = vec![false; surfaces.len()];
        over_rows(&mut is_solid, VOXELS_PER_BLOCK, inputs.threads, |block, is_solid| {
            for (is_solid, voxel) in is_solid.iter_mut().zip(&surfaces[block * VOXELS_PER_BLOCK..]) {
                *is_solid = !is_seen_through(inputs.model, &tested, voxel.position_m);
            }
        });
        let solid = surfaces.iter().zip(is_solid).filter(|(_, is_solid)| *is_solid);
        solid.map(|(voxel, _)| surfel(voxel).to_array()).collect()
    }))
}

/// Whether too many of the frames that measured a point or something behind it measured the latter.
fn is_seen_through(model: &CameraModel, depths: &[&CoarseDepth], point: DVec3) -> bool {
    let (mut supporting, mut beyond) = (0u32, 0u32);
    for depth in depths {
        if let Some((measured_m, expected_m)) = depth.measured_and_expected_m(model, point) {
            let same = is_same_surface(measured_m, expected_m, 0.0);
            supporting += u32::from(same);
            beyond += u32::from(!same && measured_m > expected_m);
        }
    }
    f64::from(beyond) > MAX_SEEN_THROUGH_SHARE * f64::from(supporting + beyond)
}

fn surfel(voxel: &Voxel) -> Surfel {
    Surfel {
        position_m: voxel.position_m.as_vec3(),
        normal: voxel.normal.as_vec3(),
        sqrt_color: voxel.median.map(|light| light.max(0.0).sqrt()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analyse::state::CameraState;
    use crate::camera::Geometry;
    use crate::fit::twist::Twist;
    use glam::DAffine3;

    #[test]
    fn point_that_a_third_of_the_frames_saw_through_is_left_out() {
        const SIZE: (u32, u32) = (640, 480);
        let model = CameraModel::new(Geometry::pinhole(SIZE.0, SIZE.1, 600.0));
        let count = (SIZE.0 * SIZE.1) as usize;
        // Of a camera that steps aside by 5 cm before a wall across its view.
        let frame = |n: u32, wall_m: f32| {
            let world_from_camera = DAffine3::from_translation(DVec3::X * 0.05 * f64::from(n));
            let state = CameraState { world_from_camera, twist: Twist::zeros() };
            CoarseDepth::new(state, SIZE.0 as usize, &vec![wall_m; count], &vec![true; count])
        };
        let is_left_out = |walls_m: &[f32], point_m: f64| {
            let frames: Vec<CoarseDepth> = (0..).zip(walls_m).map(|(n, wall_m)| frame(n, *wall_m)).collect();
            is_seen_through(&model, &frames.iter().collect::<Vec<_>>(), DVec3::Z * point_m)
        };
        assert!(!is_left_out(&[2.0; 4], 2.0), "the wall");
        assert!(is_left_out(&[2.0; 4], 1.0), "air before it");
        assert!(!is_left_out(&[2.0; 4], 3.0), "nobody sees what is behind it");
        assert!(!is_left_out(&[1.0, 1.0, 1.0, 2.0], 1.0), "seen through once of four times");
        assert!(is_left_out(&[1.0, 1.0, 2.0], 1.0), "once of three times");
        assert!(!is_left_out(&[0.0; 4], 1.0), "nothing was measured");
    }

    #[test]
    fn coarse_depth_is_that_of_the_pixel_at_which_a_point_is_seen() {
        const SIZE: (u32, u32) = (1290, 480);
        let model = CameraModel::new(Geometry::pinhole(SIZE.0, SIZE.1, 600.0));
        let depth_m: Vec<f32> = (0..SIZE.0 * SIZE.1).map(|i| 1.0 + 0.01 * (i % SIZE.0) as f32).collect();
        let state = CameraState { world_from_camera: DAffine3::IDENTITY, twist: Twist::zeros() };
        let coarse = CoarseDepth::new(state, SIZE.0 as usize, &depth_m, &vec![true; depth_m.len()]);
        for x in [1, 3, 17, 640, 1200, 1288] {
            let point = 2.0 * DVec3::from(model.rays[200 * SIZE.0 as usize + x].map(f64::from));
            let (measured_m, expected_m) = coarse.measured_and_expected_m(&model, point).unwrap();
            assert!((expected_m - 2.0).abs() < 1e-9);
            // Within half of a cell of nine pixels.
            assert!((measured_m - 1.0 - 0.01 * x as f64).abs() < 0.051, "{x}: {measured_m}");
        }
    }
}
