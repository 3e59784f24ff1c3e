//! What goes into a calibration and what comes out, as plain values.

use glam::DVec2;
use nalgebra::DMatrix;

use super::missing::Wish;
use super::parameter::Parameter;
use crate::calibrate::board::{Board, Seen, Target};
use crate::camera::{Geometry, LensModel};
use crate::fit::Stand;

/// Fewer views leave the principal point open.
pub const LEAST_VIEWS: usize = 3;
/// Enough that one poor view does little.
pub const ENOUGH_VIEWS: usize = 10;

/// A view with the name by which people know it.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedView {
    pub name: String,
    pub seen: Seen,
}

/// A view that was not used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refused {
    pub name: String,
    pub reason: String,
}

/// What is known beforehand.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LensOptions {
    /// A chessboard's inner corners; otherwise the largest that is seen.
    pub board: Option<Board>,
    /// The side of a chessboard's square, mm; distances are told in squares without it.
    pub square_mm: Option<f64>,
    /// The lens's model; otherwise `opencv`, or the fisheye's where that explains the views far better.
    pub model: Option<LensModel>,
}

/// A calibrated camera and what it rests on.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibrated {
    pub geometry: Geometry,
    pub parameters: Vec<Parameter>,
    /// Of the parameters in their order; in the product of their units.
    pub covariance: DMatrix<f64>,
    /// Root of the mean squared length of all residuals, px.
    pub rms_px: f64,
    /// Half of the residuals are shorter, px.
    pub median_px: f64,
    pub target: Target,
    /// The board's unit of length, mm, if it is known.
    pub unit_mm: Option<f64>,
    /// The views that were used.
    pub views: Vec<NamedView>,
    /// For each of those, where its board stood (in the board's unit, its x right and y down, z away from whoever looks at it), and the way of each corner from where it is projected to where it is
    /// seen, px.
    pub stands: Vec<Stand>,
    pub residuals_px: Vec<Vec<DVec2>>,
    pub refused: Vec<Refused>,
    /// Views that would make it better, each with what to do.
    pub missing: Vec<Wish>,
    pub notes: Vec<String>,
}
