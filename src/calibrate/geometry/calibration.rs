//! Inputs and results of a camera calibration.

use glam::DVec2;
use nalgebra::DMatrix;

use super::missing::MissingViews;
use super::parameter::Parameter;
use crate::calibrate::board::{BoardDetection, ChessboardSize, DetectedTarget};
use crate::camera::{Geometry, LensModel};
use crate::fit::RigidPose;

/// Smallest number of views: fewer do not determine the principal point.
pub const MIN_VIEWS: usize = 3;
/// Recommended number of views: one poor view has little weight.
pub const RECOMMENDED_VIEWS: usize = 10;

/// A view with a name for messages.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedView {
    pub name: String,
    pub detection: BoardDetection,
}

/// A view that was not used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RejectedView {
    pub name: String,
    pub reason: String,
}

/// Prior knowledge for a calibration.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LensOptions {
    /// A chessboard's inner corners; the largest detected size if `None`.
    pub board: Option<ChessboardSize>,
    /// Side of a chessboard's square, mm; distances are reported in squares if `None`.
    pub square_mm: Option<f64>,
    /// Lens model. If `None` it is `opencv`, or the fisheye model if that fits far better.
    pub model: Option<LensModel>,
}

/// A calibrated camera with the data it was computed from.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraCalibration {
    pub geometry: Geometry,
    pub parameters: Vec<Parameter>,
    /// Covariance of the parameters, in their order; in the product of their units.
    pub covariance: DMatrix<f64>,
    /// Root mean square length of all residuals, px.
    pub rms_px: f64,
    /// Median length of the residuals, px.
    pub median_px: f64,
    pub target: DetectedTarget,
    /// The board's unit of length, mm, if known.
    pub unit_mm: Option<f64>,
    /// The used views.
    pub views: Vec<NamedView>,
    /// The board's pose in each used view, in the board's unit (x right, y down, z away from the
    /// viewer).
    pub stands: Vec<RigidPose>,
    /// Residuals of each used view's corners: detected minus projected, px.
    pub residuals_px: Vec<Vec<DVec2>>,
    pub refused: Vec<RejectedView>,
    /// Views that would improve the calibration.
    pub missing: Vec<MissingViews>,
    pub notes: Vec<String>,
}
