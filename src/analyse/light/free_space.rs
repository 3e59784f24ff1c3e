//! The panorama's centre: a point in free space over the surface that evidence stands on.
//!
//! It begins 0.3 m over the support and is pushed along the normals of surfaces that are nearer
//! than that, by 30 % of the mean of the worst fifth at a time.

use glam::DVec3;

use super::voxels::{SIDE_M, Voxel};

/// Height over the support, and the distance that is kept from all surfaces, m.
const OVER_M: f64 = 0.3;
const KEPT_M: f64 = 0.3;
/// Cosine with up of a support's normals, and how far around the place it is sought, m.
const UPWARD: f64 = 0.8;
const SUPPORT_M: f64 = 0.25;
/// Least areas of a support and of a surface that pushes, m².
const SUPPORT_M2: f64 = 0.018;
const SURFACE_M2: f64 = 0.0045;
const STEPS: usize = 60;
const STEP: f64 = 0.3;
/// A shorter push ends the search, m.
const STILL_M: f64 = 0.003;

/// `place` is on a support.
pub fn centre(voxels: &[Voxel], up: DVec3, place: DVec3) -> DVec3 {
    let area_m2 = |count: usize| count as f64 * SIDE_M * SIDE_M;
    let supports = |voxel: &&Voxel| voxel.at.distance(place) < SUPPORT_M && voxel.normal.dot(up) > UPWARD;
    let mut heights: Vec<f64> = voxels.iter().filter(supports).map(|voxel| up.dot(voxel.at - place)).collect();
    let support_m = if area_m2(heights.len()) > SUPPORT_M2 { super::super::robust::median(&mut heights) } else { 0.0 };
    let mut at = place + (support_m + OVER_M) * up;
    for _ in 0..STEPS {
        let near = voxels.iter().filter(|voxel| voxel.at.distance(at) < KEPT_M);
        let push = |voxel: &Voxel| {
            let away_m = voxel.normal.dot(at - voxel.at).clamp(-KEPT_M, KEPT_M);
            (KEPT_M - away_m) * voxel.normal
        };
        let mut pushes: Vec<DVec3> = near.map(push).collect();
        if area_m2(pushes.len()) < SURFACE_M2 {
            break;
        }
        pushes.sort_by(|a, b| b.length_squared().total_cmp(&a.length_squared()));
        let worst = &pushes[..(pushes.len() / 5).max(1)];
        let by = worst.iter().sum::<DVec3>() / worst.len() as f64;
        if by.length() < STILL_M {
            break;
        }
        at += STEP * by;
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
