//! Patches of the sky that a single ray stands for.
//!
//! A few hundred rays stand for all of the sky, each for a patch of it some degrees wide. Far from a thing each ray's shadow is a
//! shaft of its own, although a patch's is as blurred as the patch is wide: by its angle times the distance to what stops the
//! light. That distance is at least the one along the floor to where the thing stands, by which shares are blurred here. So nothing
//! changes beside a thing, and shafts far from it become what they stand for.
//!
//! Not modelled: that a patch near the horizon is blurred farther along its shadow than across.

use glam::{DVec3, Vec3};

use crate::parallel::{over_rows, processors};

/// Twice as many texels make no difference: blurs are cut here.
const WIDEST: f32 = 64.0;

/// Blurs values of a shadow map, row by row, each by `angle_rad` times its distance from the nearest of the texels that `stands_on` names,
/// over which things are `over` texels high at least.
pub fn spread(values: &mut [Vec3], width: usize, stands_on: &[bool], over: f32, angle_rad: f32) {
    if width == 0 || !stands_on.contains(&true) {
        return;
    }
    let away = distances(stands_on, width);
    // Two boxes that reach h to each side have the variance 2h²/3, a disc of radius r has r²/4.
    for _ in 0..2 {
        boxed(values, width, |i| (0.61 * angle_rad * away[i].hypot(over)).min(WIDEST));
    }
}

/// Means over squares, each as many texels to each side as `reach` says; between whole ones they are interpolated.
fn boxed(values: &mut [Vec3], width: usize, reach: impl Fn(usize) -> f32 + Sync) {
    let height = values.len() / width;
    // Sums of all above and to the left of a texel's upper left corner.
    let mut sums = vec![DVec3::ZERO; (width + 1) * (height + 1)];
    for (y, row) in values.chunks_exact(width).enumerate() {
        let mut along = DVec3::ZERO;
        for (x, value) in row.iter().enumerate() {
            along += value.as_dvec3();
            sums[(y + 1) * (width + 1) + x + 1] = sums[y * (width + 1) + x + 1] + along;
        }
    }
    // Beyond the shadow map there is none.
    let mean = |x: usize, y: usize, side: usize| {
        let (x0, x1) = (x.saturating_sub(side), (x + side + 1).min(width));
        let (y0, y1) = (y.saturating_sub(side), (y + side + 1).min(height));
        let at = |x: usize, y: usize| sums[y * (width + 1) + x];
        let sum = at(x1, y1) - at(x0, y1) - at(x1, y0) + at(x0, y0);
        (sum / ((2 * side + 1) as f64).powi(2)).as_vec3()
    };
    over_rows(values, width, processors(), |y, row| {
        for (x, value) in row.iter_mut().enumerate() {
            let reach = reach(y * width + x);
            if reach > 0.0 {
                let side = reach as usize;
                *value = mean(x, y, side).lerp(mean(x, y, side + 1), reach - side as f32).max(Vec3::ZERO);
            }
        }
    });
}

/// How far each texel is from the nearest that is named, texels: two sweeps with steps of 1 and √2 (Borgefors 1986), within 8 %.
fn distances(named: &[bool], width: usize) -> Vec<f32> {
    const ASKEW: f32 = std::f32::consts::SQRT_2;
    let mut away: Vec<f32> = named.iter().map(|named| if *named { 0.0 } else { f32::INFINITY }).collect();
    let height = away.len() / width;
    for y in 0..height {
        for x in 0..width {
            let i = y * width + x;
            let mut least = away[i];
            if y > 0 {
                least = least.min(away[i - width] + 1.0);
                least = if x > 0 { least.min(away[i - width - 1] + ASKEW) } else { least };
                least = if x + 1 < width { least.min(away[i - width + 1] + ASKEW) } else { least };
            }
            away[i] = if x > 0 { least.min(away[i - 1] + 1.0) } else { least };
        }
    }
    for y in (0..height).rev() {
        for x in (0..width).rev() {
            let i = y * width + x;
            let mut least = away[i];
            if y + 1 < height {
                least = least.min(away[i + width] + 1.0);
                least = if x > 0 { least.min(away[i + width - 1] + ASKEW) } else { least };
                least = if x + 1 < width { least.min(away[i + width + 1] + ASKEW) } else { least };
            }
            away[i] = if x + 1 < width { least.min(away[i + 1] + 1.0) } else { least };
        }
    }
    away
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_those_of_the_nearest() {
        let (width, height) = (40, 30);
        let at = [(3, 4), (30, 20)];
        let named: Vec<bool> = (0..width * height).map(|i| at.contains(&(i % width, i / width))).collect();
        for (i, found) in distances(&named, width).iter().enumerate() {
            let to = |(x, y): (usize, usize)| ((i % width) as f32 - x as f32).hypot((i / width) as f32 - y as f32);
            let exact = to(at[0]).min(to(at[1]));
            assert!((0.9999 * exact..=1.083 * exact).contains(found), "{i}: {found} is not {exact}");
        }
    }

    #[test]
    fn what_is_near_stays_what_is_even_stays_and_a_shaft_becomes_wide() {
        let (width, height) = (201, 101);
        let named: Vec<bool> = (0..width * height).map(|i| i % width == 0).collect();
        let mut even = vec![Vec3::splat(0.25); width * height];
        spread(&mut even, width, &named, 0.0, 0.1);
        // Away from the shadow map's rim.
        assert!(
            (0..width * height)
                .filter(|i| i % width < 120 && (20..80).contains(&(i / width)))
                .all(|i| even[i].abs_diff_eq(Vec3::splat(0.25), 1e-5))
        );
        // A shaft along the middle row.
        let mut shaft: Vec<Vec3> =
            (0..width * height).map(|i| if i / width == 50 { Vec3::ONE } else { Vec3::ZERO }).collect();
        spread(&mut shaft, width, &named, 0.0, 0.1);
        let column = |x: usize| -> Vec<f32> { (0..height).map(|y| shaft[y * width + x].x).collect() };
        assert!(column(2)[50] > 0.7, "{}", column(2)[50]);
        let far = column(150);
        let sum: f32 = far.iter().sum();
        assert!((sum - 1.0).abs() < 0.05, "{sum}");
        // A disc of 0.1 rad is 15 texels to each side; its σ is 7.5.
        let sigma = (far.iter().enumerate().map(|(y, v)| v * (y as f32 - 50.0).powi(2)).sum::<f32>() / sum).sqrt();
        assert!((6.5..8.5).contains(&sigma), "{sigma}");
    }
}
