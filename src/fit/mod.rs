//! Geometric estimation: robust least squares and its initial values.
//!
//! Camera calibration and tag poses use the same steps: a homography gives the initial pose of a
//! plane (`homography`), and the pose (`stand`) is refined by minimising the reprojection error
//! (`robust`).

pub mod band;
pub mod cholesky;
pub mod homography;
pub mod kaplan_meier;
pub mod quantile;
mod ray_intersection;
mod rigid_pose;
pub mod robust;
mod similarity;
pub mod twist;

pub use ray_intersection::ray_intersection;
pub use rigid_pose::{RigidPose, pose_jacobian};
pub use similarity::SimilarityTransform;
