//! The camera and the boards' stands that explain what was seen.
//!
//! A corner's residual is the way from where it is projected to where it is seen, px; `fit::robust` makes them least.
//!
//! A view's stand touches that view's corners alone, so the normal equations have an arrow's shape: stands are eliminated
//! view by view (Schur's complement), and what remains is as large as the camera has parameters.

use glam::{DVec2, DVec3};
use nalgebra::{DMatrix, DVector, SMatrix, SVector};

use super::model::{Lens, MOST};
use super::start::stand;
use crate::calibrate::board::Seen;
use crate::camera::LensModel;
use crate::fit::robust::{self, Problem, median, weight};
use crate::fit::{Stand, by_stand};

/// Focal lengths to begin from, of the picture's longer side: from a wide fisheye's to a long lens's.
const FOCAL: [f64; 7] = [0.25, 0.4, 0.6, 0.9, 1.4, 2.2, 4.0];
/// δ is estimated anew this often.
const ROUNDS: usize = 6;
/// A camera, with where the board of each view stood.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    pub lens: Lens,
    pub stands: Vec<Stand>,
    /// For each view and corner the way from where it is projected to where it is seen, px.
    pub residuals_px: Vec<Vec<DVec2>>,
    /// Huber's δ of the end, px.
    pub delta_px: f64,
}

/// Parameters by their place in [`Lens::values`] that may change.
type Free<'a> = &'a [usize];

/// Fits a model to views of a picture of this size, px. `None` if no camera explains them.
pub fn fit(model: LensModel, size_px: DVec2, views: &[&Seen]) -> Option<Fit> {
    let first = |focal: f64| {
        let lens = Lens::plain(model, focal * size_px.max_element(), 0.5 * size_px);
        let stands = views.iter().map(|view| stand(&lens, &view.board, &view.at_px)).collect::<Option<Vec<_>>>()?;
        // The focal length and the strongest coefficient alone: the others would follow a poor start too far.
        let rough = settled(views, lens, stands, &[0, 1, 4], 2)?;
        settled(views, rough.lens, rough.stands, &FREE[..lens.count()], 1)
    };
    let best = FOCAL.into_iter().filter_map(first).min_by(|a, b| a.mean_px().total_cmp(&b.mean_px()))?;
    settled(views, best.lens, best.stands, &FREE[..best.lens.count()], ROUNDS)
}

/// The same to the end, from a camera and stands that are about right. Without `with_last` the last coefficient is 0.
pub fn finish(views: &[&Seen], mut lens: Lens, stands: Vec<Stand>, with_last: bool) -> Option<Fit> {
    let free = lens.count() - usize::from(!with_last);
    lens.values[free..].fill(0.0);
    settled(views, lens, stands, &FREE[..free], ROUNDS)
}

const FREE: [usize; MOST] = [0, 1, 2, 3, 4, 5, 6, 7, 8];

impl Fit {
    /// The mean length of a residual, px.
    pub fn mean_px(&self) -> f64 {
        let lengths = || self.residuals_px.iter().flatten().map(|r| r.length());
        lengths().sum::<f64>() / lengths().count().max(1) as f64
    }

    /// The root of the mean squared length of all residuals, px: as OpenCV's reprojection error.
    pub fn rms_px(&self) -> f64 {
        let squares: f64 = self.residuals_px.iter().flatten().map(|r| r.length_squared()).sum();
        (squares / self.residuals_px.iter().flatten().count().max(1) as f64).sqrt()
    }

    /// Half of the residuals are shorter, px.
    pub fn median_px(&self) -> f64 {
        median(self.residuals_px.iter().flatten())
    }

    /// The same of one view.
    pub fn view_median_px(&self, view: usize) -> f64 {
        median(self.residuals_px.get(view).into_iter().flatten())
    }

    /// The covariance of the camera's parameters, in their order and units. Two estimates are made: from the scatter of
    /// all residuals, as if each had an error of its own, and from how far the camera goes when a view is left out, in
    /// one step of Newton's (the jackknife: Tukey 1958), which also sees errors that a view's corners share, such as of a
    /// board that is not flat. Of few views each pulls the camera to itself; what their residuals show of that is too
    /// small, what leaving them out shows is not. For each parameter the larger deviation counts, with the correlations
    /// of the first. `None` if the views do not determine the camera.
    pub fn covariance(&self, views: &[&Seen]) -> Option<DMatrix<f64>> {
        let n = self.lens.count();
        let blocks = blocks(views, &self.lens, &self.stands, self.delta_px)?;
        let (reduced, _) = eliminated(&blocks, 0.0)?;
        let information = DMatrix::from_fn(n, n, |i, j| reduced[(i, j)]);
        // Parameters differ by many powers of ten.
        let scale = DVector::from_fn(n, |i, _| information[(i, i)].max(1e-300).sqrt().recip());
        let scaled = DMatrix::from_fn(n, n, |i, j| information[(i, j)] * scale[i] * scale[j]);
        let scaled_inverse = scaled.cholesky()?.inverse();
        let inverse = DMatrix::from_fn(n, n, |i, j| scaled_inverse[(i, j)] * scale[i] * scale[j]);
        let corners: usize = views.iter().map(|view| view.at_px.len()).sum();
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
            let (part, own) = seen_of_lens(block, 0.0)?;
            let own = DVector::from_fn(n, |i, _| own[i] * scale[i]);
            let others = DMatrix::from_fn(n, n, |i, j| (information[(i, j)] - part[(i, j)]) * scale[i] * scale[j]);
            // Where the others alone do not determine the camera, it goes as far as all of them let it.
            let by = others.cholesky().map_or_else(|| &scaled_inverse * &own, |others| others.solve(&own));
            let by = DVector::from_fn(n, |i, _| by[i] * scale[i]);
            together += &by * by.transpose() * ((count - 1.0) / count);
        }
        let larger = |i: usize| (together[(i, i)] / alone[(i, i)]).max(1.0).sqrt();
        let covariance = DMatrix::from_fn(n, n, |i, j| alone[(i, j)] * larger(i) * larger(j));
        covariance.iter().all(|value| value.is_finite()).then_some(covariance)
    }
}

/// Views of a camera, as a problem whose state is that camera and where the boards stood.
struct Seeing<'a> {
    views: &'a [&'a Seen],
    free: Free<'a>,
}

impl Problem for Seeing<'_> {
    type State = (Lens, Vec<Stand>);
    type Equations = Vec<Block>;

    fn residuals(&self, (lens, stands): &Self::State) -> Option<Vec<DVec2>> {
        let corners = |view: &&Seen| view.at_px.len();
        let mut residuals = Vec::with_capacity(self.views.iter().map(corners).sum());
        for (view, stand) in self.views.iter().zip(stands) {
            for (board, seen) in view.board.iter().zip(&view.at_px) {
                residuals.push(*seen - lens.project(stand.point(board.extend(0.0)))?.0);
            }
        }
        residuals.iter().all(|r| r.is_finite()).then_some(residuals)
    }

    fn equations(&self, (lens, stands): &Self::State, delta_px: f64) -> Option<Vec<Block>> {
        blocks(self.views, lens, stands, delta_px)
    }

    fn stepped(&self, blocks: &Vec<Block>, (lens, stands): &Self::State, damping: f64) -> Option<Self::State> {
        stepped(blocks, lens, stands, self.free, damping)
    }
}

/// Steps until it rests, with δ estimated `rounds` times; `free` are the parameters that may change.
fn settled(views: &[&Seen], lens: Lens, stands: Vec<Stand>, free: Free<'_>, rounds: usize) -> Option<Fit> {
    let rest = robust::settled(&Seeing { views, free }, (lens, stands), rounds)?;
    let (lens, stands) = rest.state;
    let mut left = rest.residuals_px.into_iter();
    let residuals_px = views.iter().map(|view| left.by_ref().take(view.at_px.len()).collect()).collect();
    Some(Fit { lens, stands, residuals_px, delta_px: rest.delta_px })
}

/// A view's part of the normal equations JᵀWJ · step = JᵀWr.
struct Block {
    lens: SMatrix<f64, MOST, MOST>,
    mixed: SMatrix<f64, MOST, 6>,
    stand: SMatrix<f64, 6, 6>,
    by_lens: SVector<f64, MOST>,
    by_stand: SVector<f64, 6>,
}

fn blocks(views: &[&Seen], lens: &Lens, stands: &[Stand], delta_px: f64) -> Option<Vec<Block>> {
    let of_view = |(view, stand): (&&Seen, &Stand)| {
        let mut block = Block {
            lens: SMatrix::zeros(),
            mixed: SMatrix::zeros(),
            stand: SMatrix::zeros(),
            by_lens: SVector::zeros(),
            by_stand: SVector::zeros(),
        };
        for (board, seen) in view.board.iter().zip(&view.at_px) {
            let (at, by_lens, by_point) = lens.project(stand.point(board.extend(0.0)))?;
            let by_stand = by_stand(stand, board.extend(0.0), &by_point);
            let residual = *seen - at;
            let weight = weight(residual, delta_px);
            let residual = SVector::<f64, 2>::new(residual.x, residual.y) * weight;
            block.lens += by_lens.transpose() * by_lens * weight;
            block.mixed += by_lens.transpose() * by_stand * weight;
            block.stand += by_stand.transpose() * by_stand * weight;
            block.by_lens += by_lens.transpose() * residual;
            block.by_stand += by_stand.transpose() * residual;
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

/// A view's part of the equations for the camera alone, wherever its board stands.
fn seen_of_lens(block: &Block, damping: f64) -> Option<(SMatrix<f64, MOST, MOST>, SVector<f64, MOST>)> {
    let across = block.mixed * damped(&block.stand, damping).cholesky()?.inverse();
    let lens = damped(&block.lens, damping) - across * block.mixed.transpose();
    Some((lens, block.by_lens - across * block.by_stand))
}

/// The equations for the camera alone.
fn eliminated(blocks: &[Block], damping: f64) -> Option<(SMatrix<f64, MOST, MOST>, SVector<f64, MOST>)> {
    let (mut reduced, mut right) = (SMatrix::zeros(), SVector::zeros());
    for block in blocks {
        let (lens, by_lens) = seen_of_lens(block, damping)?;
        reduced += lens;
        right += by_lens;
    }
    Some((reduced, right))
}

fn stepped(
    blocks: &[Block],
    lens: &Lens,
    stands: &[Stand],
    free: Free<'_>,
    damping: f64,
) -> Option<(Lens, Vec<Stand>)> {
    let (reduced, right) = eliminated(blocks, damping)?;
    let small = DMatrix::from_fn(free.len(), free.len(), |i, j| reduced[(free[i], free[j])]);
    let solved = small.cholesky()?.solve(&DVector::from_fn(free.len(), |i, _| right[free[i]]));
    let mut step = SVector::<f64, MOST>::zeros();
    free.iter().zip(solved.iter()).for_each(|(i, value)| step[*i] = *value);
    let mut lens = *lens;
    lens.values.iter_mut().zip(step.iter()).for_each(|(value, by)| *value += by);
    if !(lens.values[0] > 0.0 && lens.values[1] > 0.0 && lens.values.iter().all(|value| value.is_finite())) {
        return None;
    }
    let moved = |(block, stand): (&Block, &Stand)| {
        let right = block.by_stand - block.mixed.transpose() * step;
        let by = damped(&block.stand, damping).cholesky()?.solve(&right);
        Some(stand.stepped(DVec3::new(by[0], by[1], by[2]), DVec3::new(by[3], by[4], by[5])))
    };
    let stands = blocks.iter().zip(stands).map(moved).collect::<Option<Vec<_>>>()?;
    Some((lens, stands))
}
