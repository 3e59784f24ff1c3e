//! Bundle adjustment: the camera and the boards' poses that best explain the detected corners.
//!
//! A corner's residual is its detected minus its projected position, px; `fit::robust` minimizes a
//! robust sum of them.
//!
//! A view's pose only affects that view's corners, so the normal equations have an arrowhead
//! structure. The poses are eliminated view by view (Schur complement), and the remaining system
//! has the size of the camera's parameters.

use glam::{DVec2, DVec3};
use nalgebra::{DMatrix, DVector, SMatrix, SVector};

use super::model::{LensVector, MAX_PARAMETERS};
use super::start::stand;
use crate::calibrate::board::BoardDetection;
use crate::camera::LensModel;
use crate::fit::robust::{self, LeastSquaresProblem, median_length, weight};
use crate::fit::{RigidPose, pose_jacobian};

/// Initial focal lengths, in units of the picture's longer side: from a wide fisheye to a long
/// lens.
const START_FOCALS: [f64; 7] = [0.25, 0.4, 0.6, 0.9, 1.4, 2.2, 4.0];
/// Number of times that δ is re-estimated.
const SCALE_ROUNDS: usize = 6;
/// A camera and the pose of each view's board.
#[derive(Clone, Debug, PartialEq)]
pub struct LensFit {
    pub lens: LensVector,
    pub stands: Vec<RigidPose>,
    /// Residuals of each view's corners: detected minus projected, px.
    pub residuals_px: Vec<Vec<DVec2>>,
    /// Huber's δ of the last round, px.
    pub delta_px: f64,
}

/// Indices into [`LensVector::values`] of the optimized parameters.
type Free<'a> = &'a [usize];

/// Fits a model to views of a picture of this size, px. `None` if no camera explains them.
pub fn fit(model: LensModel, size_px: DVec2, views: &[&BoardDetection]) -> Option<LensFit> {
    let first = |focal: f64| {
        let lens = LensVector::plain(model, focal * size_px.max_element(), 0.5 * size_px);
        let stands =
            views.iter().map(|view| stand(&lens, &view.board, &view.corners_px)).collect::<Option<Vec<_>>>()?;
        // First only the focal length and the strongest coefficient: the others would diverge from
        // a poor start.
        let rough = iterate(views, lens, stands, &[0, 1, 4], 2)?;
        iterate(views, rough.lens, rough.stands, &FREE[..lens.count()], 1)
    };
    let best = START_FOCALS.into_iter().filter_map(first).min_by(|a, b| a.mean_px().total_cmp(&b.mean_px()))?;
    iterate(views, best.lens, best.stands, &FREE[..best.lens.count()], SCALE_ROUNDS)
}

/// Final fit from an approximate camera and poses. Without `with_last` the last coefficient is 0.
pub fn finish(
    views: &[&BoardDetection],
    mut lens: LensVector,
    stands: Vec<RigidPose>,
    with_last: bool,
) -> Option<LensFit> {
    let free = lens.count() - usize::from(!with_last);
    lens.values[free..].fill(0.0);
    iterate(views, lens, stands, &FREE[..free], SCALE_ROUNDS)
}

const FREE: [usize; MAX_PARAMETERS] = [0, 1, 2, 3, 4, 5, 6, 7, 8];

impl LensFit {
    /// Mean length of the residuals, px.
    pub fn mean_px(&self) -> f64 {
        let lengths = || self.residuals_px.iter().flatten().map(|r| r.length());
        lengths().sum::<f64>() / lengths().count().max(1) as f64
    }

    /// Root mean square length of the residuals, px: equals OpenCV's reprojection error.
    pub fn rms_px(&self) -> f64 {
        let squares: f64 = self.residuals_px.iter().flatten().map(|r| r.length_squared()).sum();
        (squares / self.residuals_px.iter().flatten().count().max(1) as f64).sqrt()
    }

    /// Median length of the residuals, px.
    pub fn median_px(&self) -> f64 {
        median_length(self.residuals_px.iter().flatten())
    }

    /// Median length of one view's residuals, px.
    pub fn view_median_px(&self, view: usize) -> f64 {
        median_length(self.residuals_px.get(view).into_iter().flatten())
    }

    /// Covariance of the camera's parameters, in their order and units.
    ///
    /// Two estimates are combined. The first is from the scatter of all residuals, as if they were
    /// independent. The second is the jackknife (Tukey 1958): the change of the camera when a view
    /// is left out, in one Newton step. It also captures errors that are common to a view's
    /// corners, such as those of a board that is not flat. With few views each one pulls the camera
    /// towards itself, so that the residuals underestimate such errors; the jackknife does not. For
    /// each parameter the larger deviation is used, with the correlations of the first estimate.
    /// `None` if the views do not determine the camera.
    pub fn covariance(&self, views: &[&BoardDetection]) -> Option<DMatrix<f64>> {
        let n = self.lens.count();
        let blocks = blocks(views, &self.lens, &self.stands, self.delta_px)?;
        let (reduced, _) = reduced_system(&blocks, 0.0)?;
        let information = DMatrix::from_fn(n, n, |i, j| reduced[(i, j)]);
        // Parameters differ by many powers of ten.
        let scale = DVector::from_fn(n, |i, _| information[(i, i)].max(1e-300).sqrt().recip());
        let scaled = DMatrix::from_fn(n, n, |i, j| information[(i, j)] * scale[i] * scale[j]);
        let scaled_inverse = scaled.cholesky()?.inverse();
        let inverse = DMatrix::from_fn(n, n, |i, j| scaled_inverse[(i, j)] * scale[i] * scale[j]);
        let corners: usize = views.iter().map(|view| view.corners_px.len()).sum();
        let freedom = (2 * corners) as f64 - (n + 6 * views.len()) as f64;
        if freedom < 1.0 {
            return None;
        }
        let squares: f64 =
            self.residuals_px.iter().flatten().map(|r| weight(*r, self.delta_px) * r.length_squared()).sum();
        let alone = &inverse * (squares / freedom);
        let count = views.len() as f64;
        let mut together = DMatrix::<f64>::zeros(n, n);
        for block in &blocks {
            let (part, own) = schur_complement(block, 0.0)?;
            let own = DVector::from_fn(n, |i, _| own[i] * scale[i]);
            let others = DMatrix::from_fn(n, n, |i, j| (information[(i, j)] - part[(i, j)]) * scale[i] * scale[j]);
            // If the other views do not determine the camera, the information of all views limits
            // the step.
            let by = others.cholesky().map_or_else(|| &scaled_inverse * &own, |others| others.solve(&own));
            let by = DVector::from_fn(n, |i, _| by[i] * scale[i]);
            together += &by * by.transpose() * ((count - 1.0) / count);
        }
        let larger = |i: usize| (together[(i, i)] / alone[(i, i)]).max(1.0).sqrt();
        let covariance = DMatrix::from_fn(n, n, |i, j| alone[(i, j)] * larger(i) * larger(j));
        covariance.iter().all(|value| value.is_finite()).then_some(covariance)
    }
}

/// Bundle adjustment as a robust problem: its state is the camera and the boards' poses.
struct BundleAdjustment<'a> {
    views: &'a [&'a BoardDetection],
    free: Free<'a>,
}

impl LeastSquaresProblem for BundleAdjustment<'_> {
    type State = (LensVector, Vec<RigidPose>);
    type Equations = Vec<ViewEquations>;

    fn residuals(&self, (lens, stands): &Self::State) -> Option<Vec<DVec2>> {
        let corners = |view: &&BoardDetection| view.corners_px.len();
        let mut residuals = Vec::with_capacity(self.views.iter().map(corners).sum());
        for (view, stand) in self.views.iter().zip(stands) {
            for (board, corner_px) in view.board.iter().zip(&view.corners_px) {
                residuals.push(*corner_px - lens.project(stand.point(board.extend(0.0)))?.0);
            }
        }
        residuals.iter().all(|r| r.is_finite()).then_some(residuals)
    }

    fn equations(&self, (lens, stands): &Self::State, delta_px: f64) -> Option<Vec<ViewEquations>> {
        blocks(self.views, lens, stands, delta_px)
    }

    fn after_step(
        &self,
        blocks: &Vec<ViewEquations>,
        (lens, stands): &Self::State,
        damping: f64,
    ) -> Option<Self::State> {
        after_step(blocks, lens, stands, self.free, damping)
    }
}

/// Iterates to convergence, with δ estimated `rounds` times. Only the parameters in `free` change.
fn iterate(
    views: &[&BoardDetection],
    lens: LensVector,
    stands: Vec<RigidPose>,
    free: Free<'_>,
    rounds: usize,
) -> Option<LensFit> {
    let rest = robust::minimize(&BundleAdjustment { views, free }, (lens, stands), rounds)?;
    let (lens, stands) = rest.state;
    let mut left = rest.residuals_px.into_iter();
    let residuals_px = views.iter().map(|view| left.by_ref().take(view.corners_px.len()).collect()).collect();
    Some(LensFit { lens, stands, residuals_px, delta_px: rest.delta_px })
}

/// A view's part of the normal equations JᵀWJ · step = JᵀWr.
struct ViewEquations {
    lens: SMatrix<f64, MAX_PARAMETERS, MAX_PARAMETERS>,
    mixed: SMatrix<f64, MAX_PARAMETERS, 6>,
    stand: SMatrix<f64, 6, 6>,
    by_lens: SVector<f64, MAX_PARAMETERS>,
    pose_jacobian: SVector<f64, 6>,
}

fn blocks(
    views: &[&BoardDetection],
    lens: &LensVector,
    stands: &[RigidPose],
    delta_px: f64,
) -> Option<Vec<ViewEquations>> {
    let of_view = |(view, stand): (&&BoardDetection, &RigidPose)| {
        let mut block = ViewEquations {
            lens: SMatrix::zeros(),
            mixed: SMatrix::zeros(),
            stand: SMatrix::zeros(),
            by_lens: SVector::zeros(),
            pose_jacobian: SVector::zeros(),
        };
        for (board, corner_px) in view.board.iter().zip(&view.corners_px) {
            let (at, by_lens, by_point) = lens.project(stand.point(board.extend(0.0)))?;
            let pose_jacobian = pose_jacobian(stand, board.extend(0.0), &by_point);
            let residual = *corner_px - at;
            let weight = weight(residual, delta_px);
            let residual = SVector::<f64, 2>::new(residual.x, residual.y) * weight;
            block.lens += by_lens.transpose() * by_lens * weight;
            block.mixed += by_lens.transpose() * pose_jacobian * weight;
            block.stand += pose_jacobian.transpose() * pose_jacobian * weight;
            block.by_lens += by_lens.transpose() * residual;
            block.pose_jacobian += pose_jacobian.transpose() * residual;
        }
        Some(block)
    };
    views.iter().zip(stands).map(of_view).collect()
}

fn damped<const N: usize>(m: &SMatrix<f64, N, N>, damping: f64) -> SMatrix<f64, N, N> {
    let mut m = *m;
    for i in 0..N {
        m[(i, i)] *= 1.0 + damping;
    }
    m
}

/// A view's Schur complement: its normal equations reduced to the camera's parameters.
fn schur_complement(
    block: &ViewEquations,
    damping: f64,
) -> Option<(SMatrix<f64, MAX_PARAMETERS, MAX_PARAMETERS>, SVector<f64, MAX_PARAMETERS>)> {
    let across = block.mixed * damped(&block.stand, damping).cholesky()?.inverse();
    let lens = damped(&block.lens, damping) - across * block.mixed.transpose();
    Some((lens, block.by_lens - across * block.pose_jacobian))
}

/// The reduced camera system.
fn reduced_system(
    blocks: &[ViewEquations],
    damping: f64,
) -> Option<(SMatrix<f64, MAX_PARAMETERS, MAX_PARAMETERS>, SVector<f64, MAX_PARAMETERS>)> {
    let (mut reduced, mut right) = (SMatrix::zeros(), SVector::zeros());
    for block in blocks {
        let (lens, by_lens) = schur_complement(block, damping)?;
        reduced += lens;
        right += by_lens;
    }
    Some((reduced, right))
}

fn after_step(
    blocks: &[ViewEquations],
    lens: &LensVector,
    stands: &[RigidPose],
    free: Free<'_>,
    damping: f64,
) -> Option<(LensVector, Vec<RigidPose>)> {
    let (reduced, right) = reduced_system(blocks, damping)?;
    let small = DMatrix::from_fn(free.len(), free.len(), |i, j| reduced[(free[i], free[j])]);
    let solved = small.cholesky()?.solve(&DVector::from_fn(free.len(), |i, _| right[free[i]]));
    let mut step = SVector::<f64, MAX_PARAMETERS>::zeros();
    free.iter().zip(solved.iter()).for_each(|(i, value)| step[*i] = *value);
    let mut lens = *lens;
    lens.values.iter_mut().zip(step.iter()).for_each(|(value, by)| *value += by);
    if !(lens.values[0] > 0.0 && lens.values[1] > 0.0 && lens.values.iter().all(|value| value.is_finite())) {
        return None;
    }
    let moved = |(block, stand): (&ViewEquations, &RigidPose)| {
        let right = block.pose_jacobian - block.mixed.transpose() * step;
        let by = damped(&block.stand, damping).cholesky()?.solve(&right);
        Some(stand.after_step(DVec3::new(by[0], by[1], by[2]), DVec3::new(by[3], by[4], by[5])))
    };
    let stands = blocks.iter().zip(stands).map(moved).collect::<Option<Vec<_>>>()?;
    Some((lens, stands))
}
