//! Penumbra of the patches of the sky.
//!
//! A few hundred rays sample all of the sky, each a patch that is some degrees wide. Far from an
//! object the hard shadow of each ray would be visible by itself. The shadow of a patch has a
//! penumbra: its angle times the distance to the occluder. This distance is at least that along the
//! plane to the base of the object, by which shadows are blurred here. Shadows at the base thus
//! stay sharp.
//!
//! Not modelled: the penumbra of a patch near the horizon is longer along its shadow than across
//! it.

use glam::{DVec3, Vec3};

use crate::parallel::{over_rows, processors};

/// Largest radius of a blur, texels. Twice as many make no difference.
const MAX_RADIUS_TEXELS: f32 = 64.0;

/// Blurs values of a planar shadow, row by row, each by `angle_rad` times its distance from the
/// nearest texel below an object. Objects are at least `min_height` texels above the plane.
pub fn blur_penumbra(values: &mut [Vec3], width: usize, is_below_object: &[bool], min_height: f32, angle_rad: f32) {
    if width == 0 || !is_below_object.contains(&true) {
        return;
    }
    let distances = chamfer_distances(is_below_object, width);
    // Two boxes that reach h to each side have the variance 2h²/3, a disc of radius r has r²/4.
    for _ in 0..2 {
        box_blur(values, width, |i| (0.61 * angle_rad * distances[i].hypot(min_height)).min(MAX_RADIUS_TEXELS));
    }
}

/// Box filter with a radius for each texel, interpolated between whole radii.
fn box_blur(values: &mut [Vec3], width: usize, radius: impl Fn(usize) -> f32 + Sync) {
    let height = values.len() / width;
    // Summed-area table.
    let mut sums = vec![DVec3::ZERO; (width + 1) * (height + 1)];
    for (y, row) in values.chunks_exact(width).enumerate() {
        let mut along = DVec3::ZERO;
        for (x, value) in row.iter().enumerate() {
            along += value.as_dvec3();
            sums[(y + 1) * (width + 1) + x + 1] = sums[y * (width + 1) + x + 1] + along;
        }
    }
    // Values outside the planar shadow are 0.
    let mean = |x: usize, y: usize, side: usize| {
        let (x0, x1) = (x.saturating_sub(side), (x + side + 1).min(width));
        let (y0, y1) = (y.saturating_sub(side), (y + side + 1).min(height));
        let at = |x: usize, y: usize| sums[y * (width + 1) + x];
        let sum = at(x1, y1) - at(x0, y1) - at(x1, y0) + at(x0, y0);
        (sum / ((2 * side + 1) as f64).powi(2)).as_vec3()
    };
    over_rows(values, width, processors(), |y, row| {
        for (x, value) in row.iter_mut().enumerate() {
            let radius = radius(y * width + x);
            if radius > 0.0 {
                let side = radius as usize;
                *value = mean(x, y, side).lerp(mean(x, y, side + 1), radius - side as f32).max(Vec3::ZERO);
            }
        }
    });
}

/// Chamfer distance to the nearest marked texel, texels: two sweeps with steps of 1 and √2
/// (Borgefors 1986), within 8 %.
fn chamfer_distances(is_marked: &[bool], width: usize) -> Vec<f32> {
    const DIAGONAL: f32 = std::f32::consts::SQRT_2;
    let mut distances: Vec<f32> =
        is_marked.iter().map(|is_marked| if *is_marked { 0.0 } else { f32::INFINITY }).collect();
    let height = distances.len() / width;
    for y in 0..height {
        for x in 0..width {
            let i = y * width + x;
            let mut nearest = distances[i];
            if y > 0 {
                nearest = nearest.min(distances[i - width] + 1.0);
                nearest = if x > 0 { nearest.min(distances[i - width - 1] + DIAGONAL) } else { nearest };
                nearest = if x + 1 < width { nearest.min(distances[i - width + 1] + DIAGONAL) } else { nearest };
            }
            distances[i] = if x > 0 { nearest.min(distances[i - 1] + 1.0) } else { nearest };
        }
    }
    for y in (0..height).rev() {
        for x in (0..width).rev() {
            let i = y * width + x;
            let mut nearest = distances[i];
            if y + 1 < height {
                nearest = nearest.min(distances[i + width] + 1.0);
                nearest = if x > 0 { nearest.min(distances[i + width - 1] + DIAGONAL) } else { nearest };
                nearest = if x + 1 < width { nearest.min(distances[i + width + 1] + DIAGONAL) } else { nearest };
            }
            distances[i] = if x + 1 < width { nearest.min(distances[i + 1] + 1.0) } else { nearest };
        }
    }
    distances
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chamfer_distances_are_within_8_percent() {
        let (width, height) = (40, 30);
        let at = [(3, 4), (30, 20)];
        let is_marked: Vec<bool> = (0..width * height).map(|i| at.contains(&(i % width, i / width))).collect();
        for (i, distance) in chamfer_distances(&is_marked, width).iter().enumerate() {
            let to = |(x, y): (usize, usize)| ((i % width) as f32 - x as f32).hypot((i / width) as f32 - y as f32);
            let exact = to(at[0]).min(to(at[1]));
            assert!((0.9999 * exact..=1.083 * exact).contains(distance), "{i}: {distance} is not {exact}");
        }
    }

    #[test]
    fn uniform_and_near_values_stay_and_a_far_stripe_is_blurred() {
        let (width, height) = (201, 101);
        let is_marked: Vec<bool> = (0..width * height).map(|i| i % width == 0).collect();
        let mut uniform = vec![Vec3::splat(0.25); width * height];
        blur_penumbra(&mut uniform, width, &is_marked, 0.0, 0.1);
        // Away from the planar shadow's border.
        assert!(
            (0..width * height)
                .filter(|i| i % width < 120 && (20..80).contains(&(i / width)))
                .all(|i| uniform[i].abs_diff_eq(Vec3::splat(0.25), 1e-5))
        );
        // A stripe along the middle row.
        let mut stripe: Vec<Vec3> =
            (0..width * height).map(|i| if i / width == 50 { Vec3::ONE } else { Vec3::ZERO }).collect();
        blur_penumbra(&mut stripe, width, &is_marked, 0.0, 0.1);
        let column = |x: usize| -> Vec<f32> { (0..height).map(|y| stripe[y * width + x].x).collect() };
        assert!(column(2)[50] > 0.7, "{}", column(2)[50]);
        let far = column(150);
        let sum: f32 = far.iter().sum();
        assert!((sum - 1.0).abs() < 0.05, "{sum}");
        // A disc of 0.1 rad has a radius of 15 texels; its σ is 7.5.
        let sigma = (far.iter().enumerate().map(|(y, v)| v * (y as f32 - 50.0).powi(2)).sum::<f32>() / sum).sqrt();
        assert!((6.5..8.5).contains(&sigma), "{sigma}");
    }
}
