//! Alignment of a scan with the world of a recording, by picked pairs of points.
//!
//! A pair is a point of the scan and a position in a frame that shows it: a ray of the world. With
//! x' = s·R·x + t and the vector v from the ray's origin to x', the residual is the part of v/|v|
//! across the ray, in px by the camera's focal length. Levenberg-Marquardt minimizes it from many
//! initial rotations. For each of these the translation is a linear least-squares solution, since
//! e·(s·R·x + t − o) = 0 for two directions e across each ray.
//!
//! Three pairs in one frame have up to four solutions (Grunert 1841), and pairs from frames of one
//! position give no scale. The alignment is refused if another solution explains the pairs as well.

use glam::{DQuat, DVec2, DVec3};
use nalgebra::{DMatrix, DVector, SMatrix, SVector};

use crate::fit::SimilarityTransform;
use crate::fit::robust::{LeastSquaresProblem, minimize, weight};

/// Rotations per half turn in the grid of initial rotations.
const GRID_STEPS: usize = 4;
/// Accuracy of a picked position, px.
const PICK_SIGMA_PX: f64 = 1.0;
/// Accepted lengths of a scan's unit in units of the world.
const SCALES: std::ops::Range<f64> = 1e-4..1e4;
/// Solutions that differ by less are one solution.
const SAME_ROTATION_RAD: f64 = 0.05;
/// A second solution is refuted if its sum of squared errors exceeds that of the best by this many
/// variances of a pick: 3.5 standard deviations.
const REFUTED_VARIANCES: f64 = 12.0;
/// Estimates of the outlier threshold per solution.
const ROUNDS: usize = 4;
/// Largest reprojection error of a pair, rad.
const MAX_ERROR_RAD: f64 = 0.015;
/// Larger standard deviations of the rotation mean that the pairs do not define it, rad.
const MAX_SIGMA_RAD: f64 = 0.5;
/// Larger relative standard deviations of the scale mean that the frames do not define it.
const MAX_SIGMA_SCALE: f64 = 0.05;
/// Largest angle between the scan's up and the world's, rad.
const MAX_UP_ANGLE_RAD: f64 = 0.35;

/// A point of the scan, and the ray of a position in a frame that shows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayPair {
    /// In the scan's axes, m.
    pub point_m: DVec3,
    /// Of the ray, in the world, m.
    pub origin_m: DVec3,
    /// Of the ray, in the world; unit length.
    pub direction: DVec3,
    /// Magnification of the picture at the position, px/rad.
    pub px_per_rad: f64,
}

/// Requirements on the alignment beside the pairs.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AlignmentOptions {
    /// Up in the scan's axes and in the world: rules out rotations that do not map one to the
    /// other.
    pub ups: Option<[DVec3; 2]>,
    /// True if the length of the scan's unit in units of the world is estimated, too.
    pub finds_scale: bool,
}

/// A scan aligned by pairs.
#[derive(Clone, Debug, PartialEq)]
pub struct Alignment {
    pub world_from_scan: SimilarityTransform,
    /// Reprojection error of each pair, px.
    pub errors_px: Vec<f64>,
    /// Standard deviation of the position of the pairs' center, m; of the rotation, rad; of the
    /// scale, relative.
    pub sigma_m: f64,
    pub sigma_rad: f64,
    pub sigma_scale: f64,
}

/// Reasons why pairs give no alignment.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum AlignmentError {
    #[error("{0} pairs are too few: {1} are needed, not on a line")]
    FewPairs(usize, usize),
    #[error(
        "the pairs do not define the alignment: their points are on a line or too near to each other, or for the scale \
         all frames are from one position; pick points farther apart"
    )]
    Undetermined,
    #[error(
        "another alignment explains the pairs as well; add a pair, with a point that is not on the plane of the others, or \
         in a frame from another position"
    )]
    Ambiguous,
    #[error("{0}")]
    Inconsistent(InconsistentPairs),
    #[error("no alignment has the scan's up within 20° of the world's; check the pairs, and `up` of the scene")]
    Tilted,
}

/// Pairs that no alignment explains.
#[derive(Clone, Debug, PartialEq)]
pub struct InconsistentPairs {
    /// Reprojection error of each pair in the best alignment, px.
    pub errors_px: Vec<f64>,
    /// Index of a pair without which the others agree.
    pub wrong_pair: Option<usize>,
}

impl std::fmt::Display for InconsistentPairs {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let errors_px: Vec<String> = self.errors_px.iter().map(|px| format!("{px:.0}")).collect();
        write!(f, "the pairs contradict each other: they are off by {} px", errors_px.join(", "))?;
        match self.wrong_pair {
            Some(wrong) => write!(f, "; without pair {} the others agree: check it", wrong + 1),
            None => write!(f, "; check their frames and coordinates, and the scan's unit"),
        }
    }
}

impl Alignment {
    /// The alignment with the smallest reprojection errors. Pairs that are off by more than
    /// 0.015 rad (8 px at a focal length of 525 px) are refused.
    pub fn of_pairs(pairs: &[RayPair], options: &AlignmentOptions) -> Result<Self, AlignmentError> {
        let errors_px = match Self::best(pairs, options) {
            Ok(alignment) if alignment.agrees(pairs) => return Ok(alignment),
            Ok(alignment) => alignment.errors_px,
            Err(AlignmentError::Inconsistent(inconsistent)) => inconsistent.errors_px,
            Err(other) => return Err(other),
        };
        let agree_without = |wrong: &usize| {
            let others: Vec<RayPair> =
                pairs.iter().enumerate().filter(|(n, _)| n != wrong).map(|(_, pair)| *pair).collect();
            Self::best(&others, options).is_ok_and(|alignment| alignment.agrees(&others))
        };
        let wrong: Vec<usize> = (0..pairs.len()).filter(agree_without).collect();
        let wrong_pair = if let [wrong] = wrong[..] { Some(wrong) } else { None };
        Err(AlignmentError::Inconsistent(InconsistentPairs { errors_px, wrong_pair }))
    }

    fn agrees(&self, pairs: &[RayPair]) -> bool {
        agree(&self.errors_px, pairs)
    }

    /// The alignment with the smallest reprojection errors, of any size.
    fn best(pairs: &[RayPair], options: &AlignmentOptions) -> Result<Self, AlignmentError> {
        let needed = if options.finds_scale { 4 } else { 3 };
        if pairs.len() < needed {
            return Err(AlignmentError::FewPairs(pairs.len(), needed));
        }
        // About their center, so that rotation and translation are hardly correlated.
        let center = pairs.iter().map(|pair| pair.point_m).sum::<DVec3>() / pairs.len() as f64;
        let centered: Vec<RayPair> =
            pairs.iter().map(|pair| RayPair { point_m: pair.point_m - center, ..*pair }).collect();
        let problem = AlignmentProblem { pairs: &centered, finds_scale: options.finds_scale };
        let mut solutions: Vec<AlignmentSolution> =
            initial_rotations().filter_map(|rotation| problem.solution(rotation)).collect();
        solutions.sort_by(|a, b| a.rms_px.total_cmp(&b.rms_px));
        if solutions.is_empty() {
            return Err(AlignmentError::Undetermined);
        }
        solutions.retain(|solution| solution.has_up(options));
        let best = solutions.first().ok_or(AlignmentError::Tilted)?;
        let count = pairs.len() as f64;
        let variance = PICK_SIGMA_PX.powi(2).max(problem.variance(best));
        let limit = count * best.rms_px.powi(2) + REFUTED_VARIANCES * variance;
        let is_other = |other: &AlignmentSolution| {
            count * other.rms_px.powi(2) < limit
                && other.transform.rotation.angle_between(best.transform.rotation) > SAME_ROTATION_RAD
        };
        if solutions.iter().any(is_other) {
            let errors_px = best.errors_px();
            let is_ambiguous = agree(&errors_px, pairs);
            let inconsistent = InconsistentPairs { errors_px, wrong_pair: None };
            return Err(if is_ambiguous {
                AlignmentError::Ambiguous
            } else {
                AlignmentError::Inconsistent(inconsistent)
            });
        }
        let mut alignment = problem.with_sigma(best).ok_or(AlignmentError::Undetermined)?;
        let transform = &mut alignment.world_from_scan;
        transform.translation_m -= transform.scale * (transform.rotation * center);
        Ok(alignment)
    }
}

/// True if all errors may be those of picks.
fn agree(errors_px: &[f64], pairs: &[RayPair]) -> bool {
    errors_px.iter().zip(pairs).all(|(px, pair)| *px < MAX_ERROR_RAD * pair.px_per_rad)
}

/// A grid of rotations. Every rotation is within 45° of one of them.
fn initial_rotations() -> impl Iterator<Item = DQuat> {
    let step = std::f64::consts::PI / GRID_STEPS as f64;
    (0..2 * GRID_STEPS).flat_map(move |yaw| {
        (0..=GRID_STEPS).flat_map(move |pitch| {
            (0..2 * GRID_STEPS).map(move |roll| {
                let [yaw, roll] = [yaw, roll].map(|n| n as f64 * step);
                let pitch = (pitch as f64 - 0.5 * GRID_STEPS as f64) * step;
                DQuat::from_euler(glam::EulerRot::ZYX, yaw, pitch, roll)
            })
        })
    })
}

/// Least-squares problem of the alignment.
struct AlignmentProblem<'a> {
    pairs: &'a [RayPair],
    finds_scale: bool,
}

/// Solution of the least-squares problem, with its residuals.
struct AlignmentSolution {
    transform: SimilarityTransform,
    rms_px: f64,
    residuals_px: Vec<DVec2>,
}

impl AlignmentSolution {
    fn errors_px(&self) -> Vec<f64> {
        self.residuals_px.iter().map(|residual| residual.length()).collect()
    }

    fn has_up(&self, options: &AlignmentOptions) -> bool {
        options.ups.is_none_or(|[scan, world]| (self.transform.rotation * scan).angle_between(world) < MAX_UP_ANGLE_RAD)
    }
}

type Matrix7 = SMatrix<f64, 7, 7>;
type Vector7 = SVector<f64, 7>;

impl RayPair {
    /// Two directions across the ray.
    fn perpendiculars(&self) -> [DVec3; 2] {
        let across = self.direction.any_orthonormal_vector();
        [across, self.direction.cross(across)]
    }

    fn residual_px(&self, transform: &SimilarityTransform) -> DVec2 {
        let towards = (transform.transform_point(self.point_m) - self.origin_m).normalize_or_zero();
        let offset = DVec2::from_array(self.perpendiculars().map(|axis| axis.dot(towards)));
        // Behind the camera the residual keeps growing with the angle.
        if self.direction.dot(towards) > 0.0 {
            return -self.px_per_rad * offset;
        }
        -self.px_per_rad * (2.0 - offset.length()) * offset.try_normalize().unwrap_or(DVec2::X)
    }

    /// Derivative of the projection by rotation about the world's axes (rad), translation (m) and
    /// the logarithm of the scale, px.
    fn jacobian(&self, transform: &SimilarityTransform) -> SMatrix<f64, 2, 7> {
        let arm = transform.scale * (transform.rotation * self.point_m);
        let to_point = arm + transform.translation_m - self.origin_m;
        let (distance_m, towards) = (to_point.length(), to_point.normalize_or_zero());
        let mut jacobian = SMatrix::<f64, 2, 7>::zeros();
        for (row, axis) in self.perpendiculars().into_iter().enumerate() {
            // d(v/|v|) = (1 − v̂v̂ᵀ)/|v| dv.
            let gradient = self.px_per_rad / distance_m * axis.reject_from_normalized(towards);
            let turned = arm.cross(gradient);
            let scaled = gradient.dot(arm);
            let columns = [turned.x, turned.y, turned.z, gradient.x, gradient.y, gradient.z, scaled];
            columns.into_iter().enumerate().for_each(|(column, value)| jacobian[(row, column)] = value);
        }
        jacobian
    }
}

impl AlignmentProblem<'_> {
    fn solution(&self, rotation: DQuat) -> Option<AlignmentSolution> {
        let start = self.start(rotation)?;
        let is_ahead = |pair: &RayPair| (start.transform_point(pair.point_m) - pair.origin_m).dot(pair.direction) > 0.0;
        if !self.pairs.iter().all(is_ahead) {
            return None;
        }
        let converged = minimize(self, start, ROUNDS)?;
        let residuals_px = converged.residuals_px;
        let sum = residuals_px.iter().map(|residual| residual.length_squared()).sum::<f64>();
        let rms_px = (sum / residuals_px.len() as f64).sqrt();
        Some(AlignmentSolution { transform: converged.state, rms_px, residuals_px })
    }

    /// The translation, and the scale if it is estimated, that bring the points nearest to the rays
    /// for a rotation.
    fn start(&self, rotation: DQuat) -> Option<SimilarityTransform> {
        let unknowns = if self.finds_scale { 4 } else { 3 };
        let mut rows = DMatrix::zeros(2 * self.pairs.len(), unknowns);
        let mut right = DVector::zeros(2 * self.pairs.len());
        for (n, pair) in self.pairs.iter().enumerate() {
            let turned = rotation * pair.point_m;
            for (k, axis) in pair.perpendiculars().into_iter().enumerate() {
                let row = 2 * n + k;
                axis.to_array().into_iter().enumerate().for_each(|(column, value)| rows[(row, column)] = value);
                right[row] = axis.dot(pair.origin_m);
                if self.finds_scale {
                    rows[(row, 3)] = axis.dot(turned);
                } else {
                    right[row] -= axis.dot(turned);
                }
            }
        }
        let solved = rows.svd(true, true).solve(&right, 1e-12).ok()?;
        let scale = if self.finds_scale { solved[3] } else { 1.0 };
        let translation_m = DVec3::new(solved[0], solved[1], solved[2]);
        (scale > 0.0 && translation_m.is_finite()).then_some(SimilarityTransform { scale, rotation, translation_m })
    }

    fn information(&self, transform: &SimilarityTransform, delta_px: f64) -> (Matrix7, Vector7) {
        let (mut normal, mut gradient) = (Matrix7::zeros(), Vector7::zeros());
        for pair in self.pairs {
            let residual = pair.residual_px(transform);
            let jacobian = pair.jacobian(transform);
            let weight = weight(residual, delta_px);
            normal += weight * jacobian.transpose() * jacobian;
            gradient += weight * jacobian.transpose() * SVector::<f64, 2>::new(residual.x, residual.y);
        }
        if !self.finds_scale {
            normal.fill_row(6, 0.0);
            normal.fill_column(6, 0.0);
            normal[(6, 6)] = 1.0;
            gradient[6] = 0.0;
        }
        (normal, gradient)
    }

    /// Variance of a pick by the residuals of a solution, px².
    fn variance(&self, solution: &AlignmentSolution) -> f64 {
        let unknowns = if self.finds_scale { 7 } else { 6 };
        let freedom = (2 * self.pairs.len()).saturating_sub(unknowns).max(1) as f64;
        self.pairs.len() as f64 * solution.rms_px.powi(2) / freedom
    }

    /// The alignment of centered pairs, with errors from the normal equations.
    fn with_sigma(&self, best: &AlignmentSolution) -> Option<Alignment> {
        let (normal, _) = self.information(&best.transform, f64::INFINITY);
        let covariance = normal.cholesky()?.inverse();
        let sigma_px = PICK_SIGMA_PX.max(self.variance(best).sqrt());
        let variance = |first: usize| (first..first + 3).map(|n| covariance[(n, n)]).sum::<f64>();
        let (sigma_rad, sigma_m) = (sigma_px * variance(0).sqrt(), sigma_px * variance(3).sqrt());
        let sigma_scale = if self.finds_scale { sigma_px * covariance[(6, 6)].sqrt() } else { 0.0 };
        let is_determined = sigma_m.is_finite() && sigma_rad < MAX_SIGMA_RAD && sigma_scale < MAX_SIGMA_SCALE;
        is_determined.then(|| Alignment {
            world_from_scan: best.transform,
            errors_px: best.errors_px(),
            sigma_m,
            sigma_rad,
            sigma_scale,
        })
    }
}

impl LeastSquaresProblem for AlignmentProblem<'_> {
    type State = SimilarityTransform;
    type Equations = (Matrix7, Vector7);

    fn residuals(&self, state: &Self::State) -> Option<Vec<DVec2>> {
        let is_valid = SCALES.contains(&state.scale) && state.translation_m.is_finite();
        is_valid.then(|| self.pairs.iter().map(|pair| pair.residual_px(state)).collect())
    }

    fn equations(&self, state: &Self::State, delta_px: f64) -> Option<Self::Equations> {
        Some(self.information(state, delta_px))
    }

    fn after_step(
        &self,
        (normal, gradient): &Self::Equations,
        state: &Self::State,
        damping: f64,
    ) -> Option<Self::State> {
        let mut damped = *normal;
        (0..7).for_each(|n| damped[(n, n)] *= 1.0 + damping);
        let step = damped.cholesky()?.solve(gradient);
        let turn = DVec3::new(step[0], step[1], step[2]);
        Some(SimilarityTransform {
            scale: state.scale * step[6].exp(),
            rotation: (DQuat::from_scaled_axis(turn) * state.rotation).normalize(),
            translation_m: state.translation_m + DVec3::new(step[3], step[4], step[5]),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of a scan, and rays from a camera position for the frames.
    fn pairs(points: &[[f64; 3]], eyes: &[[f64; 3]], truth: &SimilarityTransform, noise_px: f64) -> Vec<RayPair> {
        let picked_pair = |(n, point): (usize, &[f64; 3])| {
            let (point_m, origin_m) = (DVec3::from(*point), DVec3::from(eyes[n % eyes.len()]));
            let exact = (truth.transform_point(point_m) - origin_m).normalize();
            let across = exact.any_orthonormal_vector();
            let side = if n % 2 == 0 { across } else { exact.cross(across) };
            let direction = (exact + noise_px / 500.0 * side).normalize();
            RayPair { point_m, origin_m, direction, px_per_rad: 500.0 }
        };
        points.iter().enumerate().map(picked_pair).collect()
    }

    const POINTS: [[f64; 3]; 5] = [[0.0, 0.0, 0.0], [2.0, 0.1, 0.0], [0.2, 1.7, 0.1], [1.4, 1.2, 1.1], [0.5, 0.4, 0.8]];

    fn truth(scale: f64) -> SimilarityTransform {
        let rotation = DQuat::from_euler(glam::EulerRot::ZYX, 2.1, -0.7, 0.4);
        SimilarityTransform { scale, rotation, translation_m: DVec3::new(3.0, -1.0, 4.0) }
    }

    fn offset_m(a: &SimilarityTransform, b: &SimilarityTransform) -> f64 {
        POINTS
            .iter()
            .map(|at| a.transform_point((*at).into()).distance(b.transform_point((*at).into())))
            .fold(0.0, f64::max)
    }

    #[test]
    fn exact_pairs_give_the_transform_from_one_frame_and_from_several() {
        for eyes in [&[[0.0, 0.0, 0.0]][..], &[[0.0, 0.0, 0.0], [1.5, 0.2, 0.0]]] {
            let alignment = Alignment::of_pairs(&pairs(&POINTS, eyes, &truth(1.0), 0.0), &AlignmentOptions::default());
            let alignment = alignment.unwrap();
            assert!(offset_m(&alignment.world_from_scan, &truth(1.0)) < 1e-6, "{alignment:?}");
            assert!(alignment.errors_px.iter().all(|px| *px < 1e-4));
        }
    }

    #[test]
    fn error_of_noisy_pairs_is_within_its_standard_deviation() {
        let pairs = pairs(&POINTS, &[[0.0, 0.0, 0.0], [1.5, 0.2, 0.0]], &truth(1.0), 1.0);
        let alignment = Alignment::of_pairs(&pairs, &AlignmentOptions::default()).unwrap();
        let off_m = offset_m(&alignment.world_from_scan, &truth(1.0));
        assert!(off_m > 1e-4 && off_m < 4.0 * alignment.sigma_m, "{off_m} m, {alignment:?}");
    }

    #[test]
    fn scale_needs_frames_from_several_positions() {
        let options = AlignmentOptions { finds_scale: true, ups: None };
        let eyes = [[0.0, 0.0, 0.0], [1.5, 0.2, 0.0], [0.3, 1.1, 0.4]];
        let alignment = Alignment::of_pairs(&pairs(&POINTS, &eyes, &truth(0.4), 0.0), &options).unwrap();
        assert!((alignment.world_from_scan.scale - 0.4).abs() < 1e-6, "{alignment:?}");
        let one_position = Alignment::of_pairs(&pairs(&POINTS, &eyes[..1], &truth(0.4), 0.0), &options);
        assert!(one_position.is_err(), "{one_position:?}");
    }

    #[test]
    fn up_decides_between_the_solutions_of_three_pairs() {
        // A camera above the middle of an equilateral triangle: three more solutions tilt it.
        let corners: [[f64; 3]; 3] = std::array::from_fn(|n| [(2.1 * n as f64).cos(), (2.1 * n as f64).sin(), 0.0]);
        let truth = SimilarityTransform { translation_m: DVec3::new(0.0, 0.0, 2.0), ..SimilarityTransform::IDENTITY };
        let pairs = pairs(&corners, &[[0.0, 0.0, 0.0]], &truth, 0.0);
        let without = Alignment::of_pairs(&pairs, &AlignmentOptions::default());
        assert_eq!(without, Err(AlignmentError::Ambiguous));
        let ups = Some([DVec3::Z, DVec3::Z]);
        let alignment = Alignment::of_pairs(&pairs, &AlignmentOptions { ups, finds_scale: false }).unwrap();
        assert!(alignment.world_from_scan.translation_m.distance(truth.translation_m) < 1e-5, "{alignment:?}");
    }

    #[test]
    fn wrong_pair_is_named() {
        let points: Vec<[f64; 3]> = POINTS.into_iter().chain([[1.9, 1.5, 0.3], [0.1, 0.2, 1.4]]).collect();
        let mut pairs = pairs(&points, &[[0.0, 0.0, 0.0], [1.5, 0.2, 0.0]], &truth(1.0), 0.0);
        pairs[2].point_m += DVec3::new(0.4, -0.3, 0.2);
        match Alignment::of_pairs(&pairs, &AlignmentOptions::default()) {
            Err(AlignmentError::Inconsistent(inconsistent)) => {
                assert_eq!(inconsistent.wrong_pair, Some(2), "{inconsistent}");
                assert!(inconsistent.to_string().contains("without pair 3 the others agree"), "{inconsistent}");
            }
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn pairs_at_random_contradict_each_other() {
        let mut pairs = pairs(&POINTS, &[[0.0, 0.0, 0.0], [1.5, 0.2, 0.0]], &truth(1.0), 0.0);
        let points = [3, 0, 4, 2, 1].map(|n: usize| pairs[n].point_m);
        pairs.iter_mut().zip(points).for_each(|(pair, point_m)| pair.point_m = point_m);
        let result = Alignment::of_pairs(&pairs, &AlignmentOptions::default());
        assert!(matches!(result, Err(AlignmentError::Inconsistent(_))), "{result:?}");
    }

    #[test]
    fn pairs_that_define_nothing_are_refused() {
        let options = AlignmentOptions::default();
        let two = pairs(&POINTS[..2], &[[0.0; 3]], &truth(1.0), 0.0);
        assert_eq!(Alignment::of_pairs(&two, &options), Err(AlignmentError::FewPairs(2, 3)));
        let line: Vec<[f64; 3]> = (0..4).map(|n| [f64::from(n), 0.0, 0.0]).collect();
        let on_a_line = pairs(&line, &[[0.0; 3]], &truth(1.0), 0.0);
        assert!(Alignment::of_pairs(&on_a_line, &options).is_err());
    }
}
