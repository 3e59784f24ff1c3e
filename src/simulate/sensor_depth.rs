//! A sensor's depth map from an exact one. Errors are applied in the order of their physical
//! causes: holes, displaced edges, noise, quantization, isolated pixels. Each frame has its own
//! random numbers.

use super::correlated_noise::{correlated_noise, gaussian_mean};
use super::depth_errors::DepthErrors;
use super::edge_errors::DepthMapView;
use super::random::Random;
use super::render::SimulatedPicture;
use super::sensor_return::SensorReturn;

/// Map width to which the lengths in px refer.
const REFERENCE_WIDTH_PX: f64 = 640.0;
/// Rms of the logarithm of the return's fluctuation. Between always measured and never measured
/// surfaces lies a band of holes and patches, as on a black screen at grazing angles.
const FLICKER_LOG_RMS: f64 = 0.3;
/// Range of depths of isolated outliers, uniform in 1/z.
const OUTLIER_RANGE_M: [f64; 2] = [0.5, 5.0];

/// Keys of the random numbers, in addition to the seed.
const FLICKER_KEY: u64 = 32;
const EDGE_JITTER_KEYS: [u64; 2] = [33, 34];
const NOISE_KEY: u64 = 35;
const ISOLATED_KEY: u64 = 36;

/// The depths of `exact` with a sensor's errors, m; 0 for none.
pub fn measured(
    exact: &SimulatedPicture,
    sensor_return: &[SensorReturn],
    errors: &DepthErrors,
    seed: u64,
    frame: u64,
) -> Vec<f32> {
    let (width, height) = (exact.width as usize, exact.height as usize);
    let px = f64::from(exact.width) / REFERENCE_WIDTH_PX;
    let noise_field = |what: u64, size: f64| {
        if size == 0.0 {
            return vec![0.0; width * height];
        }
        let correlated = correlated_noise([seed, what, frame], width, height, px * errors.correlation_px);
        correlated.into_iter().map(|value| size * value).collect()
    };
    let flicker = noise_field(FLICKER_KEY, if errors.min_return_per_m2 > 0.0 { FLICKER_LOG_RMS } else { 0.0 });
    // A sensor matches patches: the patch's mean return counts, so a thin dark line makes no hole.
    let light: Vec<Option<f64>> = sensor_return.iter().map(|sensor_return| sensor_return.light_per_m2).collect();
    let light = gaussian_mean(&light, width, px * errors.correlation_px);
    let is_measurable = |i: usize| light[i].is_some_and(|light| light * flicker[i].exp() >= errors.min_return_per_m2);
    let has_depth: Vec<bool> = (0..width * height).map(|i| exact.depth_m[i] > 0.0 && is_measurable(i)).collect();
    let edge_offsets_px = EDGE_JITTER_KEYS.map(|what| noise_field(what, px * errors.edge_jitter_px));
    let noise = noise_field(NOISE_KEY, errors.noise_per_m);
    let map = DepthMapView { width, depth_m: &exact.depth_m, sensor_return, has_depth: &has_depth };
    let depth_of_pixel = |i: usize| {
        let mut random = Random::new([seed, ISOLATED_KEY, frame, i as u64]);
        if random.uniform() < errors.dropout_share {
            return 0.0;
        }
        if random.uniform() < errors.outlier_share {
            let [near, far] = OUTLIER_RANGE_M.map(f64::recip);
            return quantized_depth(far + (near - far) * random.uniform(), errors.step_per_m);
        }
        let source = map.source_pixel(i, [edge_offsets_px[0][i], edge_offsets_px[1][i]], px * errors.dilation_px);
        let depth_m = f64::from(exact.depth_m[source]);
        match (has_depth[source], errors.noise_per_m + errors.step_per_m > 0.0) {
            (false, _) => 0.0,
            (true, false) => exact.depth_m[source],
            (true, true) => quantized_depth(depth_m.recip() + noise[i], errors.step_per_m),
        }
    };
    (0..width * height).map(depth_of_pixel).collect()
}

/// The depth of a quantized 1/z; not quantized if the step is 0.
fn quantized_depth(per_m: f64, step_per_m: f64) -> f32 {
    let per_m = if step_per_m > 0.0 { step_per_m * (per_m / step_per_m).round() } else { per_m };
    if per_m > 0.0 { per_m.recip() as f32 } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 320;
    const HEIGHT: usize = 200;

    /// A wall at a distance with a given return.
    fn wall(depth_m: f32, light_per_m2: impl Into<Option<f64>>, errors: DepthErrors, frame: u64) -> Vec<f32> {
        let count = WIDTH * HEIGHT;
        let exact = SimulatedPicture {
            width: WIDTH as u32,
            height: HEIGHT as u32,
            light: vec![[0.0; 3]; count],
            depth_m: vec![depth_m; count],
            max_blur_px: 0.0,
        };
        let sensor_return = vec![SensorReturn { surface: 1, light_per_m2: light_per_m2.into() }; count];
        measured(&exact, &sensor_return, &errors, 7, frame)
    }

    fn share(values: &[f32], is: impl Fn(f32) -> bool) -> f64 {
        values.iter().filter(|v| is(**v)).count() as f64 / values.len() as f64
    }

    #[test]
    fn zero_errors_change_no_bit() {
        assert!(wall(1.234_567, 0.0, DepthErrors::default(), 3).iter().all(|z| *z == 1.234_567));
        assert!(wall(1.234_567, None, DepthErrors::default(), 3).iter().all(|z| *z == 0.0), "a shade");
    }

    #[test]
    fn depth_noise_grows_with_the_distance_squared() {
        for z in [1.0, 3.0] {
            let errors = DepthErrors { noise_per_m: 1e-3, ..DepthErrors::default() };
            let off: Vec<f64> = wall(z, 0.5, errors, 0).iter().map(|v| f64::from(v - z)).collect();
            let rms = (off.iter().map(|v| v * v).sum::<f64>() / off.len() as f64).sqrt();
            // Independent values: standard error 0.3 %.
            assert!((rms / (1e-3 * f64::from(z * z)) - 1.0).abs() < 0.02, "{rms}");
        }
    }

    #[test]
    fn depth_steps_match_quantized_disparity() {
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
    fn weak_returns_give_holes_that_differ_between_frames() {
        let errors = DepthErrors { min_return_per_m2: 0.02, correlation_px: 2.0, ..DepthErrors::default() };
        let missing = |light, frame| share(&wall(1.0, light, errors, frame), |z| z == 0.0);
        assert!(missing(0.1, 0) < 1e-3 && missing(0.004, 0) > 0.999);
        assert!((missing(0.02, 0) - 0.5).abs() < 0.08, "{}", missing(0.02, 0));
        assert!(wall(1.0, 0.02, errors, 0) != wall(1.0, 0.02, errors, 1));
        assert!(wall(1.0, 0.02, errors, 1) == wall(1.0, 0.02, errors, 1));
    }

    #[test]
    fn isolated_errors_have_the_requested_share() {
        let errors = DepthErrors { dropout_share: 0.05, outlier_share: 0.02, ..DepthErrors::default() };
        let values = wall(1.0, 0.5, errors, 0);
        // Standard errors 0.0009 and 0.0006.
        assert!((share(&values, |z| z == 0.0) - 0.05).abs() < 0.004);
        assert!((share(&values, |z| z != 0.0 && z != 1.0) - 0.019).abs() < 0.003);
        assert!(values.iter().all(|z| *z == 0.0 || (0.5..=5.0).contains(z)));
    }
}
