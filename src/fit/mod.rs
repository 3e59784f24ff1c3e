//! What a picture says about where things stand: robust least squares, and where they begin.
//!
//! A camera's calibration and the poses of printed tags rest on the same steps: a homography says roughly where a plane
//! stands (`homography`), and residuals in the picture move the stand (`stand`) until they are least (`robust`).

pub mod band;
pub mod homography;
pub mod quantile;
pub mod robust;
mod stand;
pub mod twist;

pub use stand::{Stand, by_stand};
