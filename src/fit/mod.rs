//! Geometric estimation: robust least squares and its initial values.
//!
//! Camera calibration and tag poses use the same steps: a homography gives the initial pose of a
//! plane (`homography`), and the pose (`stand`) is refined by minimising the reprojection error
//! (`robust`).

pub mod band;
pub mod cholesky;
mod convex_hull;
pub mod homography;
pub mod kaplan_meier;
pub mod quantile;
mod ray_intersection;
mod rigid_pose;
pub mod robust;
mod similarity;
mod symmetric_eigen;
pub mod twist;

pub use convex_hull::convex_hull;
pub use ray_intersection::ray_intersection;
pub use rigid_pose::{RigidPose, pose_jacobian};
pub use similarity::SimilarityTransform;
pub use symmetric_eigen::symmetric_eigen;
