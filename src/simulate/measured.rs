//! A depth map as a sensor measures it, of an exact one: holes, torn edges, noise, steps, lone pixels, in the order in which they
//! come about. Each frame has its own random numbers.

use super::depth_errors::DepthErrors;
use super::grain::{around, grain};
use super::random::Random;
use super::render::Picture;
use super::returned::Returned;
use super::torn::Map;

/// Lengths in the map are px of one as wide as this.
const OF_WIDTH_PX: f64 = 640.0;
/// Light that comes back flickers by so much, as its logarithm's rms: between what always has depth and what never has it lies a belt
/// of holes and patches, as on a black screen that is seen ever more from the side.
const FLICKER: f64 = 0.3;
/// What a lone wrong pixel may show: as often any 1/z.
const WRONG_M: [f64; 2] = [0.5, 5.0];

/// What the random numbers are for: keys beside the seed.
const FLICKERS: u64 = 32;
const TORN: [u64; 2] = [33, 34];
const NOISE: u64 = 35;
const LONE: u64 = 36;

/// The depths of `exact` with a sensor's errors, m; 0 for none.
pub fn measured(exact: &Picture, returned: &[Returned], errors: &DepthErrors, seed: u64, frame: u64) -> Vec<f32> {
    let (width, height) = (exact.width as usize, exact.height as usize);
    let px = f64::from(exact.width) / OF_WIDTH_PX;
    let grained = |what: u64, size: f64| {
        if size == 0.0 {
            return vec![0.0; width * height];
        }
        let alike = grain([seed, what, frame], width, height, px * errors.grain_px);
        alike.into_iter().map(|value| size * value).collect()
    };
    let flicker = grained(FLICKERS, if errors.faintest_per_m2 > 0.0 { FLICKER } else { 0.0 });
    // Of a patch that is compared, all of the light counts: a thin dark line makes no hole.
    let light: Vec<Option<f64>> = returned.iter().map(|returned| returned.light_per_m2).collect();
    let light = around(&light, width, px * errors.grain_px);
    let is_lit = |i: usize| light[i].is_some_and(|light| light * flicker[i].exp() >= errors.faintest_per_m2);
    let has_depth: Vec<bool> = (0..width * height).map(|i| exact.depth_m[i] > 0.0 && is_lit(i)).collect();
    let torn = TORN.map(|what| grained(what, px * errors.torn_px));
    let noise = grained(NOISE, errors.noise_per_m);
    let map = Map { width, depth_m: &exact.depth_m, returned, has_depth: &has_depth };
    let one = |i: usize| {
        let mut random = Random::new([seed, LONE, frame, i as u64]);
        if random.uniform() < errors.missing_share {
            return 0.0;
        }
        if random.uniform() < errors.wrong_share {
            let [near, far] = WRONG_M.map(f64::recip);
            return stepped(far + (near - far) * random.uniform(), errors.step_per_m);
        }
        let shown = map.shown(i, [torn[0][i], torn[1][i]], px * errors.wider_px);
        let depth_m = f64::from(exact.depth_m[shown]);
        match (has_depth[shown], errors.noise_per_m + errors.step_per_m > 0.0) {
            (false, _) => 0.0,
            (true, false) => exact.depth_m[shown],
            (true, true) => stepped(depth_m.recip() + noise[i], errors.step_per_m),
        }
    };
    (0..width * height).map(one).collect()
}

/// The depth of a 1/z in whole steps, or in none if they are 0.
fn stepped(per_m: f64, step_per_m: f64) -> f32 {
    let per_m = if step_per_m > 0.0 { step_per_m * (per_m / step_per_m).round() } else { per_m };
    if per_m > 0.0 { per_m.recip() as f32 } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 320;
    const HEIGHT: usize = 200;

    /// A wall so far away, of which so much light comes back.
    fn wall(depth_m: f32, light_per_m2: impl Into<Option<f64>>, errors: DepthErrors, frame: u64) -> Vec<f32> {
        let count = WIDTH * HEIGHT;
        let exact = Picture {
            width: WIDTH as u32,
            height: HEIGHT as u32,
            light: vec![[0.0; 3]; count],
            depth_m: vec![depth_m; count],
            most_blur_px: 0.0,
        };
        let returned = vec![Returned { surface: 1, light_per_m2: light_per_m2.into() }; count];
        measured(&exact, &returned, &errors, 7, frame)
    }

    fn share(values: &[f32], is: impl Fn(f32) -> bool) -> f64 {
        values.iter().filter(|v| is(**v)).count() as f64 / values.len() as f64
    }

    #[test]
    fn nothing_wrong_changes_no_bit() {
        assert!(wall(1.234_567, 0.0, DepthErrors::default(), 3).iter().all(|z| *z == 1.234_567));
        assert!(wall(1.234_567, None, DepthErrors::default(), 3).iter().all(|z| *z == 0.0), "a shade");
    }

    #[test]
    fn noise_grows_with_the_distance_squared() {
        for z in [1.0, 3.0] {
            let errors = DepthErrors { noise_per_m: 1e-3, ..DepthErrors::default() };
            let off: Vec<f64> = wall(z, 0.5, errors, 0).iter().map(|v| f64::from(v - z)).collect();
            let rms = (off.iter().map(|v| v * v).sum::<f64>() / off.len() as f64).sqrt();
            // Independent ones: standard error 0.3 %.
            assert!((rms / (1e-3 * f64::from(z * z)) - 1.0).abs() < 0.02, "{rms}");
        }
    }

    #[test]
    fn steps_are_those_of_disparity() {
        let errors = DepthErrors { step_per_m: 2.5e-3, ..DepthErrors::default() };
        // 1/2.002 = 0.499 500 is 199.8 steps, so 200: 2 m.
        assert_eq!(wall(2.002, 0.5, errors, 0)[5], 2.0);
        let errors = DepthErrors { noise_per_m: 5e-3, ..errors };
        let mut values = wall(2.0, 0.5, errors, 0);
        values.sort_by(f32::total_cmp);
        values.dedup();
        assert!(values.len() > 10);
        for value in values {
            let steps = 400.0 / f64::from(value);
            assert!((steps - steps.round()).abs() < 1e-4, "{value}");
        }
    }

    #[test]
    fn what_throws_too_little_light_back_has_holes_and_each_frame_others() {
        let errors = DepthErrors { faintest_per_m2: 0.02, grain_px: 2.0, ..DepthErrors::default() };
        let missing = |light, frame| share(&wall(1.0, light, errors, frame), |z| z == 0.0);
        assert!(missing(0.1, 0) < 1e-3 && missing(0.004, 0) > 0.999);
        assert!((missing(0.02, 0) - 0.5).abs() < 0.08, "{}", missing(0.02, 0));
        assert!(wall(1.0, 0.02, errors, 0) != wall(1.0, 0.02, errors, 1));
        assert!(wall(1.0, 0.02, errors, 1) == wall(1.0, 0.02, errors, 1));
    }

    #[test]
    fn lone_pixels_are_as_many_as_asked() {
        let errors = DepthErrors { missing_share: 0.05, wrong_share: 0.02, ..DepthErrors::default() };
        let values = wall(1.0, 0.5, errors, 0);
        // Standard errors 0.0009 and 0.0006.
        assert!((share(&values, |z| z == 0.0) - 0.05).abs() < 0.004);
        assert!((share(&values, |z| z != 0.0 && z != 1.0) - 0.019).abs() < 0.003);
        assert!(values.iter().all(|z| *z == 0.0 || (0.5..=5.0).contains(z)));
    }
}
