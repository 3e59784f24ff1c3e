//! Random functions of time: smooth, or piecewise constant. Values follow from keys and time alone,
//! so any range of frames has the same values as in the whole recording.

use super::random::Random;

/// Smooth random walk between −1 and 1: a uniform cubic B-spline (de Boor 1978) over random
/// numbers, with two continuous derivatives.
#[derive(Clone, Copy, Debug)]
pub struct SmoothWalk {
    keys: [u64; 2],
    /// Knot interval, s. The period of the walk is about four knots.
    interval_s: f64,
}

impl SmoothWalk {
    pub fn new(keys: [u64; 2], interval_s: f64) -> Self {
        Self { keys, interval_s }
    }

    pub fn at(&self, time_s: f64) -> f64 {
        let at = time_s / self.interval_s;
        let (first, f) = (at.floor(), at - at.floor());
        let weights = [
            (1.0 - f).powi(3),
            3.0 * f.powi(3) - 6.0 * f * f + 4.0,
            -3.0 * f.powi(3) + 3.0 * f * f + 3.0 * f + 1.0,
            f.powi(3),
        ];
        let number = |n: usize| uniform(self.keys, first as i64 + n as i64);
        weights.iter().enumerate().map(|(n, weight)| weight / 6.0 * number(n)).sum()
    }
}

/// A level between −½ and ½ that jumps at a random time in every interval of `interval_s`.
#[derive(Clone, Copy, Debug)]
pub struct RandomSteps {
    pub keys: [u64; 2],
    pub interval_s: f64,
}

impl RandomSteps {
    pub fn at(&self, time_s: f64) -> f64 {
        let at = time_s / self.interval_s;
        let interval = at.floor() as i64;
        // Uniform in the interval, with other random numbers than the levels.
        let moment = 0.5 + 0.5 * uniform([!self.keys[0], self.keys[1]], interval);
        let jumped = i64::from(at - at.floor() >= moment);
        0.5 * uniform(self.keys, interval + jumped)
    }
}

/// The `n`-th number, uniform in [−1, 1).
fn uniform(keys: [u64; 2], n: i64) -> f64 {
    2.0 * Random::new([keys[0], keys[1], n as u64, 0]).uniform() - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn walk_stays_within_one_and_is_continuous() {
        let walk = SmoothWalk::new([3, 1], 0.5);
        let values: Vec<f64> = (-20_000..20_000).map(|n| walk.at(1e-3 * f64::from(n))).collect();
        let largest = values.iter().fold(0.0f64, |largest, v| largest.max(v.abs()));
        assert!(largest > 0.5 && largest <= 1.0, "{largest}");
        // The slope of a cubic B-spline is at most the largest step between knots, 2 in 0.5 s.
        assert!(values.windows(2).all(|pair| (pair[1] - pair[0]).abs() <= 4.001e-3));
        // At a knot the weights are 1/6, 4/6 and 1/6 of uniform numbers with variance ⅓: 0.408².
        let at_numbers: Vec<f64> = (0..4000).map(|n| walk.at(0.5 * f64::from(n))).collect();
        let rms = (at_numbers.iter().map(|v| v * v).sum::<f64>() / 4000.0).sqrt();
        assert!((rms - 0.408).abs() < 0.015, "{rms}");
        assert!((walk.at(1.3) - SmoothWalk::new([4, 1], 0.5).at(1.3)).abs() > 1e-6, "keys count");
    }

    #[test]
    fn steps_jump_once_in_each_interval() {
        let steps = RandomSteps { keys: [3, 1], interval_s: 0.25 };
        let values: Vec<f64> = (0..40_000).map(|n| steps.at(1e-3 * f64::from(n))).collect();
        assert!(values.iter().all(|v| v.abs() <= 0.5));
        assert_eq!(values.windows(2).filter(|pair| pair[0] != pair[1]).count(), 160);
    }
}
