//! Calibration of a camera's intrinsics and distortion from photographs of a chessboard or of
//! printed tags.
//!
//! `board` detects the corners. `model` is the projection with its derivatives, `start` the initial
//! estimate, `solve` the bundle adjustment, and `choose` the selection of the model, its
//! coefficients and the views. `missing` determines which views would help. `load` reads views from
//! files. `view_collector` collects views from a live camera. docs/calibrate-camera.md has the
//! details.

mod calibration;
mod choose;
mod load;
mod missing;
mod model;
mod parameter;
mod report;
mod residual_plot;
mod solve;
mod start;
mod view_collector;

pub use calibration::{CameraCalibration, LensOptions, NamedView, RejectedView};
pub use choose::{LensCalibrationError, calibrate};
pub use load::{LensProgress, LoadError, Views, views_from_paths};
pub use missing::{MissingViews, PictureCorner, PictureEdge};
pub use parameter::Parameter;
pub use residual_plot::residuals;
pub use view_collector::{Coverage, ViewCollector, ViewOutcome};
