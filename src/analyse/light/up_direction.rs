//! Estimates up for recordings without it: mean shift from a first guess to the normals of level
//! surfaces.
//!
//! Normals face the camera, and cameras see floors and tables rather than ceilings. A camera that
//! is mounted upside down is detected by normals opposite to the guess.

use glam::DVec3;

use super::voxels::Voxel;

/// Cones around up in which normals are averaged, in turn: cosines of 41° to 14°.
const CONE_COSINES: [f64; 8] = [0.75, 0.85, 0.9, 0.94, 0.96, 0.97, 0.97, 0.97];
/// Fewer normals end the mean shift.
const MIN_NORMALS: usize = 100;

/// Smallest ratio of normals opposite to the guess to those along it for a camera upside down.
const UPSIDE_DOWN_RATIO: usize = 4;

pub fn refined_up(voxels: &[Voxel], guess: DVec3) -> DVec3 {
    let count = |up: DVec3| voxels.iter().filter(|voxel| voxel.normal.dot(up) > CONE_COSINES[0]).count();
    let (upright, overhead) = (count(guess), count(-guess));
    let is_upside_down = overhead > UPSIDE_DOWN_RATIO * upright && overhead > MIN_NORMALS;
    let mut up = if is_upside_down { -guess } else { guess };
    for cone in CONE_COSINES {
        let within: Vec<DVec3> =
            voxels.iter().map(|voxel| voxel.normal).filter(|normal| normal.dot(up) > cone).collect();
        if within.len() < MIN_NORMALS {
            break;
        }
        up = within.iter().sum::<DVec3>().normalize_or(up);
    }
    up
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn up_shifts_from_30_degrees_away_to_the_level_surfaces() {
        let level = (0..300).map(|n| DVec3::new(0.05 * f64::from(n).sin(), 0.05 * f64::from(n).cos(), 1.0));
        let wall = (0..200).map(|n| DVec3::new(1.0, 0.05 * f64::from(n).sin(), 0.0));
        let voxels: Vec<Voxel> =
            level.chain(wall).map(|normal| Voxel::of_surface(DVec3::ZERO, normal.normalize(), [0.5; 3])).collect();
        let guess = DVec3::new(30f64.to_radians().sin(), 0.0, 30f64.to_radians().cos());
        let up = refined_up(&voxels, guess);
        assert!(up.angle_between(DVec3::Z).to_degrees() < 0.5, "{up}");
        assert_eq!(refined_up(&voxels[..50], guess), guess);
        // With a camera upside down the guess is the opposite direction.
        let up = refined_up(&voxels, -guess);
        assert!(up.angle_between(DVec3::Z).to_degrees() < 0.5, "{up}");
    }
}
