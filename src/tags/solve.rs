//! Camera pose from corners with known world positions (PnP): robust least squares through the
//! camera's own projection, including its distortion.

use glam::{DMat3, DQuat, DVec2, DVec3};
use nalgebra::{SMatrix, SVector};

use crate::camera::Geometry;
use crate::fit::robust::{Converged, LeastSquaresProblem, minimize, weight};
use crate::fit::{RigidPose, homography, pose_jacobian};
use crate::pose::Pose;

/// Number of times that Huber's δ is estimated.
const SCALE_ROUNDS: usize = 3;
/// Prior standard deviation of a corner, px...
const MIN_SIGMA_PX: f64 = 0.05;
/// ... with the weight of this many corners, so that four corners that happen to fit do not count
/// as exact.
const PRIOR_CORNERS: f64 = 1.0;

/// Corners with their positions in the world (metres) and in the picture (px).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Corners {
    pub in_world_m: Vec<DVec3>,
    pub seen_px: Vec<DVec2>,
    /// The camera's pose at the readout of each corner's row, relative to the estimated pose. Empty
    /// for a global shutter.
    pub moved: Vec<Pose>,
}

/// An estimated pose.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseSolution {
    pub pose: Pose,
    /// Covariance of a rotation about the camera's axes (x, y, z; rad) and of the world's origin in
    /// them (x, y, z; metres).
    pub covariance: SMatrix<f64, 6, 6>,
    /// Residual of each corner: detected minus projected, px.
    pub residuals_px: Vec<DVec2>,
    /// Sum of the squared residuals with Huber's weights, px².
    pub squares_px2: f64,
}

impl PoseSolution {
    /// Root mean square length of the residuals, px.
    pub fn rms_px(&self) -> f64 {
        let squares: f64 = self.residuals_px.iter().map(|r| r.length_squared()).sum();
        (squares / self.residuals_px.len().max(1) as f64).sqrt()
    }

    /// Covariance of the camera's position, m², in the camera's axes. The position is −Rᵀ t; a
    /// rotation ω of R and a step τ of t move it by ω × t − τ in those axes.
    pub fn place_covariance(&self) -> SMatrix<f64, 3, 3> {
        let t = self.pose.translation_m;
        // d(ω × t)/dω = −[t]×.
        let by = SMatrix::<f64, 3, 6>::from_row_slice(&[
            0.0, t.z, -t.y, -1.0, 0.0, 0.0, //
            -t.z, 0.0, t.x, 0.0, -1.0, 0.0, //
            t.y, -t.x, 0.0, 0.0, 0.0, -1.0,
        ]);
        by * self.covariance * by.transpose()
    }
}

struct PnpProblem<'a> {
    geometry: &'a Geometry,
    corners: &'a Corners,
}

struct Equations {
    normal: SMatrix<f64, 6, 6>,
    right: SVector<f64, 6>,
}

impl PnpProblem<'_> {
    fn moved(&self, corner: usize) -> Pose {
        self.corners.moved.get(corner).copied().unwrap_or(Pose::IDENTITY)
    }

    /// Jacobian of the projection at a point in camera coordinates, by central differences. Their
    /// error is about (1e-4)² of the derivative; rounding adds less.
    fn by_point(&self, point: DVec3) -> Option<SMatrix<f64, 2, 3>> {
        let h = 1e-4 * point.length().max(1e-9);
        let mut by = SMatrix::<f64, 2, 3>::zeros();
        for (i, axis) in DVec3::AXES.into_iter().enumerate() {
            let way = self
                .geometry
                .displacement_px(self.geometry.project(point - h * axis)?, self.geometry.project(point + h * axis)?);
            (by[(0, i)], by[(1, i)]) = (way.x / (2.0 * h), way.y / (2.0 * h));
        }
        Some(by)
    }
}

impl LeastSquaresProblem for PnpProblem<'_> {
    type State = RigidPose;
    type Equations = Equations;

    fn residuals(&self, stand: &RigidPose) -> Option<Vec<DVec2>> {
        let both = self.corners.in_world_m.iter().zip(&self.corners.seen_px).enumerate();
        let one = |(i, (place, corner_px)): (usize, (&DVec3, &DVec2))| {
            let at = self.geometry.project(self.moved(i).transform_point(stand.point(*place)))?;
            Some(self.geometry.displacement_px(at, *corner_px)).filter(|way| way.is_finite())
        };
        both.map(one).collect()
    }

    fn equations(&self, stand: &RigidPose, delta_px: f64) -> Option<Equations> {
        let mut equations = Equations { normal: SMatrix::zeros(), right: SVector::zeros() };
        for (i, (place, residual)) in self.corners.in_world_m.iter().zip(self.residuals(stand)?).enumerate() {
            let moved = self.moved(i);
            let turn = SMatrix::<f64, 3, 3>::from_column_slice(&DMat3::from_quat(moved.rotation).to_cols_array());
            let by_point = self.by_point(moved.transform_point(stand.point(*place)))? * turn;
            let by = pose_jacobian(stand, *place, &by_point);
            let weight = weight(residual, delta_px);
            equations.normal += by.transpose() * by * weight;
            equations.right += by.transpose() * SVector::<f64, 2>::new(residual.x, residual.y) * weight;
        }
        Some(equations)
    }

    fn after_step(&self, equations: &Equations, stand: &RigidPose, damping: f64) -> Option<RigidPose> {
        let mut normal = equations.normal;
        for i in 0..6 {
            normal[(i, i)] *= 1.0 + damping;
        }
        let by = normal.cholesky()?.solve(&equations.right);
        by.iter()
            .all(|v| v.is_finite())
            .then(|| stand.after_step(DVec3::new(by[0], by[1], by[2]), DVec3::new(by[3], by[4], by[5])))
    }
}

/// The best pose near an initial one. `None` if the corners do not determine it.
pub fn solve_pose(geometry: &Geometry, corners: &Corners, near: &Pose) -> Option<PoseSolution> {
    let problem = PnpProblem { geometry, corners };
    let begin = RigidPose { rotation: DMat3::from_quat(near.rotation), translation: near.translation_m };
    let Converged { state, residuals_px, delta_px } = minimize(&problem, begin, SCALE_ROUNDS)?;
    let squares_px2: f64 = residuals_px.iter().map(|r| weight(*r, delta_px) * r.length_squared()).sum();
    // Lengths and angles differ by powers of ten.
    let normal = problem.equations(&state, delta_px)?.normal;
    let scale = SVector::<f64, 6>::from_fn(|i, _| normal[(i, i)].max(1e-300).sqrt().recip());
    let scaled = SMatrix::<f64, 6, 6>::from_fn(|i, j| normal[(i, j)] * scale[i] * scale[j]);
    let inverse = scaled.cholesky()?.inverse();
    let count = residuals_px.len() as f64;
    // Each corner has two residuals, x and y.
    let freedom = (2.0 * count - 6.0).max(0.0) + 2.0 * PRIOR_CORNERS;
    let variance_px2 = (squares_px2 + 2.0 * PRIOR_CORNERS * MIN_SIGMA_PX * MIN_SIGMA_PX) / freedom;
    let covariance = SMatrix::<f64, 6, 6>::from_fn(|i, j| inverse[(i, j)] * scale[i] * scale[j] * variance_px2);
    let pose = Pose::new(DQuat::from_mat3(&state.rotation), state.translation);
    (pose.rotation.is_finite() && covariance.iter().all(|v| v.is_finite())).then_some(PoseSolution {
        pose,
        covariance,
        residuals_px,
        squares_px2,
    })
}

/// Initial poses of a flat tag from its four corners: two, because the picture of a distant flat
/// object hardly changes when it leans the other way (Schweighofer and Pinz 2006). `corners_m` as
/// in `Tag::corners_m`.
pub fn initial_poses(geometry: &Geometry, corners_m: &[DVec3; 4], seen_px: &[DVec2; 4]) -> Option<[Pose; 2]> {
    let rays: Option<Vec<DVec3>> = seen_px.iter().map(|at| geometry.direction(*at)).collect();
    let rays = rays?;
    // Rotated so that the tag is on the axis: its corners then lie on a plane in front of the
    // camera, wherever it is in the picture.
    let sight = rays.iter().sum::<DVec3>().try_normalize()?;
    let ahead = DQuat::from_rotation_arc(sight, DVec3::Z);
    let on_plane: Option<Vec<DVec2>> = rays
        .iter()
        .map(|ray| {
            let ray = ahead * *ray;
            (ray.z > 1e-3).then(|| ray.truncate() / ray.z)
        })
        .collect();
    let middle = corners_m.iter().sum::<DVec3>() / 4.0;
    let x = (corners_m[1] - corners_m[0]).try_normalize()?;
    let y = (corners_m[0] - corners_m[3]).try_normalize()?;
    let own_from_world = DMat3::from_cols(x, y, x.cross(y)).transpose();
    let own = corners_m.map(|corner| (own_from_world * (corner - middle)).truncate());
    let stand = homography::plane_pose(&own, &on_plane?)?;
    // Mirrored in depth along the line of sight z: R' = D R D, D = diag(1, 1, −1).
    let flip = DMat3::from_diagonal(DVec3::new(1.0, 1.0, -1.0));
    let turn = ahead.conjugate();
    let pose = |rotation: DMat3| {
        let rotation = DMat3::from_quat(turn) * rotation * own_from_world;
        let translation = turn * stand.translation - rotation * middle;
        Pose::new(DQuat::from_mat3(&rotation), translation)
    };
    Some([pose(stand.rotation), pose(flip * stand.rotation * flip)])
}
