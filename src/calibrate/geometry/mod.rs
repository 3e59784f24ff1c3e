//! Photographs of a chessboard or of printed tags in, a camera's intrinsics and distortion out.
//!
//! `board` finds the corners; here are the projection with its derivatives (`model`), where to begin (`start`), the fit
//! (`solve`), which model, coefficients and views count (`choose`), what views are wanted (`missing`), the files that views
//! come from (`load`), and views that are taken from a camera's pictures as they come (`taking`). docs/calibrate-camera.md says more.

mod calibrated;
mod choose;
mod load;
mod missing;
mod model;
mod parameter;
mod picture;
mod report;
mod solve;
mod start;
mod taking;

pub use calibrated::{Calibrated, LensOptions, NamedView, Refused};
pub use choose::{LensError, calibrate};
pub use load::{LensProgress, LoadError, Views, views_from_paths};
pub use missing::{Edge, PictureCorner, Wish};
pub use parameter::Parameter;
pub use picture::residuals;
pub use taking::{Coverage, Look, Taking};
