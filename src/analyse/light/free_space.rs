//! The panorama's centre: a point in free space over the support of virtual objects.
//!
//! It begins 0.3 m over the support and moves along the normals of surfaces that are nearer
//! than that, by 30 % of the mean of the largest fifth of penetrations per step.

use crate::fit::quantile::upper_median;
use glam::DVec3;

use super::voxels::{SIDE_M, Voxel};

/// Initial height over the support, and clearance from all surfaces, m.
const HEIGHT_M: f64 = 0.3;
const CLEARANCE_M: f64 = 0.3;
/// Smallest cosine of a support's normals with up, and radius around the place in which it is
/// searched, m.
const MIN_UP_COS: f64 = 0.8;
const SUPPORT_RADIUS_M: f64 = 0.25;
/// Smallest areas of a support and of a surface that repels, m².
const MIN_SUPPORT_M2: f64 = 0.018;
const MIN_SURFACE_M2: f64 = 0.0045;
const MAX_STEPS: usize = 60;
const STEP_SHARE: f64 = 0.3;
/// A shorter push ends the iteration, m.
const MIN_PUSH_M: f64 = 0.003;

/// `place` is on a support.
pub fn centre(voxels: &[Voxel], up: DVec3, place: DVec3) -> DVec3 {
    let area_m2 = |count: usize| count as f64 * SIDE_M * SIDE_M;
    let supports =
        |voxel: &&Voxel| voxel.position_m.distance(place) < SUPPORT_RADIUS_M && voxel.normal.dot(up) > MIN_UP_COS;
    let heights: Vec<f64> = voxels.iter().filter(supports).map(|voxel| up.dot(voxel.position_m - place)).collect();
    let support_m = if area_m2(heights.len()) > MIN_SUPPORT_M2 { upper_median(heights).unwrap_or(0.0) } else { 0.0 };
    let mut at = place + (support_m + HEIGHT_M) * up;
    for _ in 0..MAX_STEPS {
        let near = voxels.iter().filter(|voxel| voxel.position_m.distance(at) < CLEARANCE_M);
        let push = |voxel: &Voxel| {
            let away_m = voxel.normal.dot(at - voxel.position_m).clamp(-CLEARANCE_M, CLEARANCE_M);
            (CLEARANCE_M - away_m) * voxel.normal
        };
        let mut pushes: Vec<DVec3> = near.map(push).collect();
        if area_m2(pushes.len()) < MIN_SURFACE_M2 {
            break;
        }
        pushes.sort_by(|a, b| b.length_squared().total_cmp(&a.length_squared()));
        let worst = &pushes[..(pushes.len() / 5).max(1)];
        let by = worst.iter().sum::<DVec3>() / worst.len() as f64;
        if by.length() < MIN_PUSH_M {
            break;
        }
        at += STEP_SHARE * by;
    }
    at
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(count: i32, of: impl Fn(f64, f64) -> DVec3, normal: DVec3) -> Vec<Voxel> {
        let places = (-count..count).flat_map(|x| (-count..count).map(move |y| (x, y)));
        let at = |(x, y): (i32, i32)| of(0.02 * f64::from(x), 0.02 * f64::from(y));
        places.map(|place| Voxel::of_surface(at(place), normal, [0.5; 3])).collect()
    }

    #[test]
    fn centre_is_over_the_support_and_away_from_a_wall() {
        let desk = square(40, |x, y| DVec3::new(x, y, 0.01), DVec3::Z);
        let over = centre(&desk, DVec3::Z, DVec3::ZERO);
        assert!(over.distance(DVec3::new(0.0, 0.0, 0.31)) < 0.005, "{over}");
        // A monitor 5 cm from the place faces it.
        let monitor = square(20, |y, z| DVec3::new(0.05, y, 0.4 + z), DVec3::NEG_X);
        let aside = centre(&[desk, monitor].concat(), DVec3::Z, DVec3::ZERO);
        assert!(aside.x < 0.05 - 0.27 && aside.x > -0.4 && (aside.z - 0.31).abs() < 0.05, "{aside}");
    }

    #[test]
    fn centre_inside_a_box_is_pushed_out_of_it() {
        // The monitor's face is 10 cm before the place, which lies in it.
        let face = square(30, |y, z| DVec3::new(-0.1, y, 0.4 + z), DVec3::NEG_X);
        let out = centre(&face, DVec3::Z, DVec3::ZERO);
        assert!(out.x < -0.1 - 0.27, "{out}");
        assert_eq!(centre(&[], DVec3::Z, DVec3::ZERO), DVec3::new(0.0, 0.0, 0.3));
    }
}
