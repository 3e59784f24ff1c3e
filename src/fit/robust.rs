//! Levenberg-Marquardt least squares with Huber's loss.
//!
//! A residual r is a reprojection error, px. Huber's loss (1964) is r²/2 up to δ and δ(r − δ/2)
//! beyond, so that an outlier has no more influence than a residual of δ. δ is 2.5 σ, and σ follows
//! from the median of r: for normal errors of σ in x and y the median length is σ √(2 ln 2).

use glam::DVec2;

use super::quantile::upper_median;

/// Huber's δ in σ: 4 % of two-dimensional normal errors lie beyond.
const HUBER_DELTA_SIGMAS: f64 = 2.5;
/// √(2 ln 2): median length of a two-dimensional normal error of σ = 1.
const MEDIAN_PER_SIGMA: f64 = 1.177_410_022_515_474_7;
/// Maximum number of steps between two estimates of δ.
const MAX_STEPS_PER_ROUND: usize = 40;
/// Convergence threshold: relative decrease of the loss per step.
const MIN_RELATIVE_GAIN: f64 = 1e-11;

/// A model fitted to image points.
pub trait LeastSquaresProblem {
    /// The parameters.
    type State;
    /// The normal equations JᵀWJ · step = JᵀWr at a state, in a representation of the problem's
    /// choice.
    type Equations;

    /// Differences from projected to observed points, px, in a fixed order. `None` if a point
    /// cannot be projected.
    fn residuals(&self, state: &Self::State) -> Option<Vec<DVec2>>;

    /// The equations at a state, each residual weighted by [`weight`].
    fn equations(&self, state: &Self::State, delta_px: f64) -> Option<Self::Equations>;

    /// The state after a step, with the equations' diagonal increased by this share. `None` if they
    /// have no solution.
    fn after_step(&self, equations: &Self::Equations, state: &Self::State, damping: f64) -> Option<Self::State>;
}

/// A converged state.
#[derive(Clone, Debug, PartialEq)]
pub struct Converged<State> {
    pub state: State,
    pub residuals_px: Vec<DVec2>,
    /// Huber's δ of the last round, px.
    pub delta_px: f64,
}

/// Iterates until convergence, with δ estimated `rounds` times. `None` if points cannot be
/// projected in the initial state.
pub fn minimize<P: LeastSquaresProblem>(
    problem: &P,
    mut state: P::State,
    rounds: usize,
) -> Option<Converged<P::State>> {
    let mut now = problem.residuals(&state)?;
    let mut delta_px = delta(&now);
    for _ in 0..rounds {
        delta_px = delta(&now);
        let mut own = loss(&now, delta_px);
        let mut damping = 1e-3;
        for _ in 0..MAX_STEPS_PER_ROUND {
            let equations = problem.equations(&state, delta_px)?;
            let mut gained = 0.0;
            while damping < 1e12 {
                if let Some(next_state) = problem.after_step(&equations, &state, damping)
                    && let Some(next) = problem.residuals(&next_state)
                    && loss(&next, delta_px) < own
                {
                    gained = own - loss(&next, delta_px);
                    (state, now) = (next_state, next);
                    damping = (0.1 * damping).max(1e-12);
                    break;
                }
                damping *= 10.0;
            }
            own -= gained;
            if gained <= MIN_RELATIVE_GAIN * own {
                break;
            }
        }
    }
    Some(Converged { state, residuals_px: now, delta_px })
}

/// Huber's weight of a residual in the normal equations.
pub fn weight(residual: DVec2, delta_px: f64) -> f64 {
    let length = residual.length();
    if length <= delta_px { 1.0 } else { delta_px / length }
}

/// Median length of the residuals, px. 0 for none.
pub fn median_length<'a>(residuals: impl Iterator<Item = &'a DVec2>) -> f64 {
    upper_median(residuals.map(|r| r.length())).unwrap_or(0.0)
}

fn loss(residuals: &[DVec2], delta_px: f64) -> f64 {
    let one = |r: &DVec2| {
        let length = r.length();
        if length <= delta_px { 0.5 * length * length } else { delta_px * (length - 0.5 * delta_px) }
    };
    residuals.iter().map(one).sum()
}

fn delta(residuals: &[DVec2]) -> f64 {
    (HUBER_DELTA_SIGMAS * median_length(residuals.iter()) / MEDIAN_PER_SIGMA).max(1e-6)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Estimates the centre of points.
    struct Middle(Vec<DVec2>);

    impl LeastSquaresProblem for Middle {
        type State = DVec2;
        type Equations = (f64, DVec2);

        fn residuals(&self, at: &DVec2) -> Option<Vec<DVec2>> {
            Some(self.0.iter().map(|sample| *sample - *at).collect())
        }

        fn equations(&self, at: &DVec2, delta_px: f64) -> Option<(f64, DVec2)> {
            let each = || self.0.iter().map(|sample| (weight(*sample - *at, delta_px), *sample - *at));
            Some((each().map(|(w, _)| w).sum(), each().map(|(w, r)| r * w).sum()))
        }

        fn after_step(&self, (sum, right): &(f64, DVec2), at: &DVec2, damping: f64) -> Option<DVec2> {
            (*sum > 0.0).then(|| *at + *right / (*sum * (1.0 + damping)))
        }
    }

    #[test]
    fn huber_weight_matches_hand_calculation() {
        // Within δ a residual counts fully, beyond it as δ.
        assert_eq!([0.5, 1.0, 4.0].map(|r| weight(DVec2::new(0.0, r), 1.0)), [1.0, 1.0, 0.25]);
        assert_eq!(loss(&[DVec2::new(0.6, 0.8), DVec2::new(3.0, 4.0)], 1.0), 0.5 + 4.5);
        assert_eq!(median_length([3.0, 1.0, 2.0].map(|x| DVec2::new(x, 0.0)).iter()), 2.0);
        assert_eq!(median_length([].iter()), 0.0);
    }

    #[test]
    fn single_outlier_has_little_influence() {
        let around = [(0.1, 0.0), (-0.1, 0.0), (0.0, 0.1), (0.0, -0.1), (0.05, 0.05), (-0.05, -0.05)];
        let mut places: Vec<DVec2> = around.iter().map(|p| DVec2::new(5.0, 7.0) + DVec2::from(*p)).collect();
        let rest = minimize(&Middle(places.clone()), DVec2::ZERO, 6).unwrap();
        assert!(rest.state.distance(DVec2::new(5.0, 7.0)) < 1e-6, "{rest:?}");
        places.push(DVec2::new(105.0, 7.0));
        let rest = minimize(&Middle(places), DVec2::ZERO, 6).unwrap();
        // Their mean is 14 px away.
        assert!(rest.state.distance(DVec2::new(5.0, 7.0)) < 0.1, "{rest:?}");
        assert!(rest.residuals_px[6].length() > 99.0 && rest.delta_px < 0.5, "{rest:?}");
    }
}
