//! Direct alignment of two frames: the motion that minimizes their photometric error at points with
//! depth.
//!
//! Inverse compositional Gauss-Newton (Baker and Matthews 2004) over points of frame i with known
//! depth, projected into frame j with its rolling shutter. The unknowns are E, a motion in i's
//! axes, and the gain a and the offset b of brightness:
//!
//!   r = I_j(π(T_j⁻¹ T_i E x)) − a·I_i(x) − b
//!   weight 1 / (1 + (r/2σ)²),   σ = 1.4826·MAD + 0.5 codes
//!
//! A link is accepted if the correlation of its pictures exceeds 0.7 times the one that noise
//! allows ([`noise_level`](super::noise_level)):
//!
//!   correlation > min(0.7, max(0.7·√((1 − n₁²/v₁)(1 − n₂²/v₂)), √((p + 3·√(2p)) / (N/5))))
//!
//! v are the variances of the points' brightness in the two pictures, n² those of their noise. The
//! last term is chance: p = 8 parameters explain p/N' of the variance of N' independent values,
//! with a standard deviation of √(2p)/N'. Errors of neighbouring points are correlated, so five of
//! the N points count as one. With contrast far above the noise the limit is 0.7.
//!
//! Not modelled: differences in motion blur, specular reflection, moving objects (the robust
//! weights reduce their effect), occlusion by less than the depth's own error.

use glam::DAffine3;
use nalgebra::{Matrix6, SMatrix, SVector};
use serde::{Deserialize, Serialize};

use super::camera_model::{CameraModel, is_same_surface};
use super::noise_level::expected_correlation;
use super::state::project_rolling_shutter;
use super::view::LinkView;
use crate::fit::quantile::median_and_sigma;
use crate::fit::twist::{self, Twist};

/// Gauss-Newton iterations by level, from the finest.
const ITERATIONS: [usize; 4] = [5, 6, 8, 8];
/// Smallest distance of a projected point from the picture's edge, px, and from the camera, m.
const MARGIN_PX: f64 = 4.0;
const MIN_DEPTH_M: f64 = 0.15;
/// Smallest number of points in a level.
const MIN_POINTS: usize = 150;
/// Smallest number of points that the other frame shows, absolute and by the level's points.
const MIN_VISIBLE_POINTS: usize = 120;
const MIN_VISIBLE_SHARE: f64 = 0.15;
/// Smallest overlap of an accepted link, and its smallest correlation by the expected one.
const MIN_OVERLAP: f64 = 0.25;
const MIN_CORRELATION: f64 = 0.7;
/// A link is noise-limited if noise lowers its smallest correlation to less than this share.
const NOISE_LIMITED_SHARE: f64 = 0.85;
/// Number of points that count as one independent value, and standard deviations of chance above
/// its mean.
const CORRELATED_POINTS: f64 = 5.0;
const CHANCE_SIGMAS: f64 = 3.0;
/// Displacement of the last step of a level, px, by the square root of the level's scale.
const CONVERGED_PX: f64 = 0.02;

/// Alignment of one frame to another.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(from = "PlainLink", into = "PlainLink")]
pub struct Link {
    pub from: usize,
    pub to: usize,
    /// log E: the correction of the given motion between the two, in `from`'s axes.
    pub e: Twist,
    /// Information of e: JᵀWJ/σ² with brightness marginalised.
    pub information: Matrix6<f64>,
    /// Mean of JᵀJ of the points' places: eᵀ·metric·e is the mean square displacement, px².
    pub metric: Matrix6<f64>,
    pub correlation: f64,
    /// Smallest correlation with which the link is accepted.
    pub min_correlation: f64,
    /// Fraction of the points that the other frame shows.
    pub overlap: f64,
    /// Information and gradient of the loss by the readout time, s, with all other unknowns
    /// marginalised. Only if requested.
    pub readout: Option<(f64, f64)>,
}

/// A [`Link`] as plain numbers, matrices by columns.
#[derive(Serialize, Deserialize)]
struct PlainLink {
    frames: [usize; 2],
    e: Vec<f64>,
    information: Vec<f64>,
    metric: Vec<f64>,
    alike: [f64; 3],
    readout: Option<(f64, f64)>,
}

impl From<Link> for PlainLink {
    fn from(link: Link) -> Self {
        Self {
            frames: [link.from, link.to],
            e: link.e.as_slice().to_vec(),
            information: link.information.as_slice().to_vec(),
            metric: link.metric.as_slice().to_vec(),
            alike: [link.correlation, link.min_correlation, link.overlap],
            readout: link.readout,
        }
    }
}

impl From<PlainLink> for Link {
    fn from(plain: PlainLink) -> Self {
        let matrix =
            |values: Vec<f64>| Matrix6::from_iterator(values.into_iter().chain(std::iter::repeat(0.0)).take(36));
        let [from, to] = plain.frames;
        let [correlation, min_correlation, overlap] = plain.alike;
        Self {
            from,
            to,
            e: Twist::from_iterator(plain.e.into_iter().chain(std::iter::repeat(0.0)).take(6)),
            information: matrix(plain.information),
            metric: matrix(plain.metric),
            correlation,
            min_correlation,
            overlap,
            readout: plain.readout,
        }
    }
}

impl Link {
    pub fn is_good(&self) -> bool {
        self.correlation > self.min_correlation && self.overlap > MIN_OVERLAP
    }

    /// True if noise accounts for much of the missing correlation, so that low contrast can be the
    /// reason for a rejection.
    pub fn is_faint(&self) -> bool {
        self.min_correlation < NOISE_LIMITED_SHARE * MIN_CORRELATION
    }

    /// Root mean square displacement by a twist in `from`'s axes, px.
    pub fn displaced_px(&self, by: &Twist) -> f64 {
        (by.transpose() * self.metric * by)[0].max(0.0).sqrt()
    }
}

/// Why two frames have no link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinkFailure {
    /// Too few textured points with depth lie in both frames: blank surfaces, blur, or poses
    /// without overlap.
    FewPoints,
    /// The points' depth differs, or no motion aligns their brightness.
    Mismatch,
}

const N: usize = 8;

/// Smallest correlation of an accepted link. `of`: for each picture the variances of its brightness
/// and of its noise.
fn min_correlation(of: [(f64, f64); 2], points: usize) -> f64 {
    let parameters = N as f64;
    let chance = (parameters + CHANCE_SIGMAS * (2.0 * parameters).sqrt()) * CORRELATED_POINTS / points as f64;
    (MIN_CORRELATION * expected_correlation(of)).max(chance.sqrt()).min(MIN_CORRELATION)
}

/// Aligns `from` to `to`, beginning at the level `coarsest` (at most the coarsest there is).
pub fn align(
    model: &CameraModel,
    from: &LinkView,
    to: &LinkView,
    coarsest: usize,
    estimates_readout: bool,
) -> Result<Link, LinkFailure> {
    let j_from_i = to.state.world_from_camera.inverse() * from.state.world_from_camera;
    let mut e = DAffine3::IDENTITY;
    let (mut gain, mut shift) = (1.0, 0.0);
    let coarsest = coarsest.min(from.levels.len() - 1);
    let mut last = None;
    for level in (0..=coarsest).rev() {
        let points = &from.levels[level].points;
        if points.is_empty() && level == 0 {
            continue;
        }
        // A blank surface has few points at coarse levels, and may have enough at finer ones.
        if points.len() < MIN_POINTS {
            if last.is_none() {
                continue;
            }
            return Err(LinkFailure::FewPoints);
        }
        let is_first_level = last.is_none();
        let mut rows = vec![f32::NAN; points.len()];
        for step in 0..ITERATIONS[level.min(ITERATIONS.len() - 1)] {
            let is_first = step == 0 && is_first_level;
            let observed = Observations::new(model, from, to, level, &(j_from_i * e), &mut rows)?;
            let sums = observed.sums(from, level, gain, shift, is_first);
            let mut h = sums.h;
            for k in 0..N {
                h[(k, k)] *= 1.0 + 1e-6;
            }
            let d = h.cholesky().ok_or(LinkFailure::Mismatch)?.solve(&sums.g);
            let by = Twist::from_iterator(d.iter().take(6).copied());
            e *= twist::exp(&-by);
            gain = (gain + d[6]).clamp(0.4, 2.5);
            shift += d[7];
            let moved_px = (by.transpose() * sums.metric * by)[0].max(0.0).sqrt();
            last = Some((level, sums, observed));
            if moved_px < CONVERGED_PX * f64::from(1u32 << level).sqrt() {
                break;
            }
        }
    }
    let (level, sums, observed) = last.ok_or(LinkFailure::FewPoints)?;
    let (pose, light) = (sums.h.fixed_view::<6, 6>(0, 0), sums.h.fixed_view::<2, 2>(6, 6));
    let across = sums.h.fixed_view::<6, 2>(0, 6);
    let light = light.try_inverse().ok_or(LinkFailure::Mismatch)?;
    let information = (pose - across * light * across.transpose()) / sums.sigma.powi(2);
    let points = from.levels[level].points.len();
    let readout = if estimates_readout {
        let readout = observed.readout(from, to, level, &(j_from_i * e), gain, shift, sums.sigma);
        Some(readout.ok_or(LinkFailure::Mismatch)?)
    } else {
        None
    };
    Ok(Link {
        from: from.index,
        to: to.index,
        e: twist::log(&e),
        information,
        metric: sums.metric,
        correlation: sums.correlation,
        min_correlation: min_correlation(
            [(sums.variance[0], to.levels[level].noise), (sums.variance[1], gain * gain * from.levels[level].noise)],
            sums.count,
        ),
        overlap: sums.count as f64 / points as f64,
        readout,
    })
}

/// The points of a level that the other frame shows, with its brightness there.
struct Observations {
    /// Index of the point, brightness in the other frame, time of the row there as a fraction of
    /// the readout.
    points: Vec<(usize, f64, f64)>,
}

/// Normal equations for (e, a, b), and statistics of the residuals.
struct NormalEquations {
    h: SMatrix<f64, N, N>,
    g: SVector<f64, N>,
    metric: Matrix6<f64>,
    sigma: f64,
    correlation: f64,
    /// Variances of the brightness of `to` and of its prediction.
    variance: [f64; 2],
    count: usize,
}

impl Observations {
    /// `rows`: for each point its row in the previous iteration, px; NaN if it was not visible.
    fn new(
        model: &CameraModel,
        from: &LinkView,
        to: &LinkView,
        level: usize,
        j_from_i: &DAffine3,
        rows: &mut [f32],
    ) -> Result<Self, LinkFailure> {
        let (width, height) = model.size();
        let (right, bottom) = (width as f64 - MARGIN_PX, height as f64 - MARGIN_PX);
        let picture = &to.levels[level].picture;
        let scale = 1.0 / f64::from(1u32 << level);
        let all = &from.levels[level].points;
        let mut points = Vec::with_capacity(all.len());
        let mut in_view = 0;
        for (n, point) in all.iter().enumerate() {
            let there = j_from_i.transform_point3(point.at);
            if there.z <= MIN_DEPTH_M {
                continue;
            }
            let near_px = Some(f64::from(rows[n])).filter(|y| !y.is_nan());
            let rounds = if near_px.is_some() { 1 } else { 2 };
            let Some((at, far)) = project_rolling_shutter(&model.geometry, there, &to.state.twist, near_px, rounds)
            else {
                continue;
            };
            rows[n] = at.y as f32;
            if !(at.x > MARGIN_PX && at.x < right && at.y > MARGIN_PX && at.y < bottom) {
                continue;
            }
            in_view += 1;
            let depth = f64::from(to.depth[at.y as usize * width + at.x as usize]);
            if depth > 0.0 && !is_same_surface(depth, far, model.depth_tolerance_m(far)) {
                continue;
            }
            let (x, y) = (scale * (at.x - 0.5), scale * (at.y - 0.5));
            if let Some(value) = picture.sample_inside(x as f32, y as f32) {
                points.push((n, f64::from(value), at.y / height as f64 - 0.5));
            }
        }
        let min_points = MIN_VISIBLE_POINTS.max((MIN_VISIBLE_SHARE * all.len() as f64) as usize);
        if in_view < min_points {
            Err(LinkFailure::FewPoints)
        } else if points.len() < min_points {
            Err(LinkFailure::Mismatch)
        } else {
            Ok(Self { points })
        }
    }

    /// Information and gradient of the readout time as a ninth unknown, with the other eight
    /// marginalised.
    #[expect(clippy::too_many_arguments)]
    fn readout(
        &self,
        from: &LinkView,
        to: &LinkView,
        level: usize,
        j_from_i: &DAffine3,
        gain: f64,
        shift: f64,
        sigma: f64,
    ) -> Option<(f64, f64)> {
        let all = &from.levels[level].points;
        let others = twist::adjoint(&j_from_i.inverse()) * to.state.twist;
        let mut h = SMatrix::<f64, 9, 9>::zeros();
        let mut g = SVector::<f64, 9>::zeros();
        for (n, value, row_there) in &self.points {
            let point = &all[*n];
            let residual = value - gain * point.value - shift;
            let motion = from.state.twist * point.row - others * *row_there;
            let column: f64 = point.value_by.iter().zip(motion.iter()).map(|(a, b)| a * b).sum();
            let [a, b, c, d, e, f] = point.value_by.map(|by| gain * by);
            let row = SVector::from([a, b, c, d, e, f, point.value, 1.0, gain * column]);
            let w = weight(residual, sigma);
            h.ger(w, &row, &row, 1.0);
            g.axpy(w * residual, &row, 1.0);
        }
        let rest = h.fixed_view::<8, 8>(0, 0).clone_owned().cholesky()?;
        let across = h.fixed_view::<8, 1>(0, 8).clone_owned();
        let solved = rest.solve(&across);
        let information = h[(8, 8)] - across.dot(&solved);
        let slope = g[8] - solved.dot(&g.fixed_view::<8, 1>(0, 0));
        Some((information / sigma.powi(2), slope / sigma.powi(2)))
    }

    fn sums(&self, from: &LinkView, level: usize, gain: f64, shift: f64, is_first: bool) -> NormalEquations {
        let all = &from.levels[level].points;
        let residual = |(n, value, _): &(usize, f64, f64)| value - gain * all[*n].value - shift;
        let residuals: Vec<f64> = self.points.iter().map(residual).collect();
        let sigma = sigma(&residuals);
        let (mut h, mut g) = ([[0.0f64; N]; N], [0.0f64; N]);
        let mut metric = [[0.0f64; 6]; 6];
        let mut moments = [0.0f64; 6];
        for ((n, value, _), r) in self.points.iter().zip(&residuals) {
            let point = &all[*n];
            let w = weight(*r, sigma);
            let [a, b, c, d, e, f] = point.value_by.map(|by| gain * by);
            let row = [a, b, c, d, e, f, point.value, 1.0];
            let robust_weight = if is_first { 1.0 } else { w };
            for k in 0..N {
                let by = robust_weight * row[k];
                g[k] += by * r;
                for m in 0..=k {
                    h[k][m] += by * row[m];
                }
            }
            for place in &point.place_by {
                for k in 0..6 {
                    for m in 0..=k {
                        metric[k][m] += place[k] * place[m];
                    }
                }
            }
            let model = gain * point.value + shift;
            for (sum, term) in moments.iter_mut().zip([1.0, *value, model, value * value, model * model, value * model])
            {
                *sum += w * term;
            }
        }
        let count = self.points.len();
        let [n, x, y, xx, yy, xy] = moments;
        let variance = [xx / n - (x / n).powi(2), yy / n - (y / n).powi(2)];
        let spread = (variance[0] * variance[1]).max(1e-12).sqrt();
        NormalEquations {
            h: SMatrix::from_fn(|k, m| if m <= k { h[k][m] } else { h[m][k] }),
            g: SVector::from(g),
            metric: Matrix6::from_fn(|k, m| if m <= k { metric[k][m] } else { metric[m][k] }) / count as f64,
            sigma,
            correlation: (xy / n - x / n * (y / n)) / spread,
            variance,
            count,
        }
    }
}

fn weight(residual: f64, sigma: f64) -> f64 {
    1.0 / (1.0 + (residual / (2.0 * sigma)).powi(2))
}

/// 1.4826 · median |r − median r|, plus half a code for rounding.
fn sigma(residuals: &[f64]) -> f64 {
    median_and_sigma(residuals.iter().copied()).1 + 0.5
}

#[cfg(test)]
mod tests {
    use glam::DAffine3;

    use super::super::state::CameraState;
    use super::*;
    use crate::camera::Geometry;
    use crate::frame::Frame;
    use crate::pixels::Pixels;

    /// A static wall, with waves of a contrast, or blank.
    fn view(model: &CameraModel, index: usize, contrast: f64, depth_m: f32) -> LinkView {
        let (width, height) = (320, 240);
        let code = |i: u32| {
            let (x, y) = (f64::from(i % width), f64::from(i / width));
            let wave = (0.31 * x).sin() * (0.23 * y + 0.05 * x).cos() + (0.11 * x + 0.17 * y).sin();
            [(120.0 + contrast * wave).round() as u8; 3]
        };
        let frame = Frame::new(
            index,
            0.0,
            Pixels::from_u8(width, height, (0..width * height).flat_map(code).collect()).unwrap(),
        );
        let state = CameraState { world_from_camera: DAffine3::IDENTITY, twist: Twist::zeros() };
        LinkView::new(model, &frame, state, vec![depth_m; (width * height) as usize], 0, None)
    }

    #[test]
    fn blank_frames_share_few_points_and_another_depth_is_a_mismatch() {
        let model = CameraModel::new(Geometry::pinhole(320, 240, 260.0));
        let link =
            |from: &LinkView, to: &LinkView| align(&model, from, to, usize::MAX, false).map(|link| link.is_good());
        let (here, there) = (view(&model, 0, 30.0, 2.0), view(&model, 1, 30.0, 2.0));
        assert_eq!(link(&here, &there), Ok(true));
        assert_eq!(link(&view(&model, 0, 0.0, 2.0), &there), Err(LinkFailure::FewPoints));
        assert_eq!(link(&here, &view(&model, 1, 30.0, 1.0)), Err(LinkFailure::Mismatch));
    }
}
