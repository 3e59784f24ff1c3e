//! Collects views automatically from a live camera: of a board at rest, if it adds information. No
//! I/O: detections and times are arguments, and the outcome and the missing views are returned.

use glam::DVec2;

use super::calibration::{CameraCalibration, LensOptions, NamedView};
use super::choose::{LensCalibrationError, calibrate};
use super::missing::{MissingViews, missing, tilt_deg};
use super::model::LensVector;
use super::parameter::Parameter;
use super::start::stand;
use crate::calibrate::board::BoardDetection;
use crate::camera::LensModel;
use crate::fit::RigidPose;
use crate::fit::robust::median_length;

/// Largest motion of a resting board between pictures, as a share of the picture's diagonal; at
/// least [`REST_MOTION_PX`].
///
/// While the picture is read out row by row the board moves on, by at most its motion between
/// pictures. Over half of the picture's height that is half as much, most of which a rotation and
/// translation of the board explain. The remainder should be less than other errors of the corners:
/// 0.1 to 0.2 px in a picture of 640x480 px.
const MAX_REST_MOTION: f64 = 1e-3;
/// Lower limit of the rest threshold, px: the noise of corners of a board at rest.
const REST_MOTION_PX: f64 = 0.5;
/// Longest interval between pictures over which motion is measured, s.
const MAX_INTERVAL_S: f64 = 0.5;
/// Smallest differences of a new view from the others: position as a share of the picture's
/// diagonal, ratio of sizes, and tilt in degrees.
const NEW_VIEW: ViewDifference = ViewDifference { place: 0.12, size: 1.3, tilt_deg: 12.0 };
/// Smallest differences of a view that fills a gap.
const GAP_VIEW: ViewDifference = ViewDifference { place: 0.03, size: 1.08, tilt_deg: 4.0 };
/// Initial focal length, in units of the picture's longer side.
const INITIAL_FOCAL: f64 = 0.9;
/// Largest relative standard deviation of a focal length that is used for tilts.
const MAX_FOCAL_SIGMA: f64 = 0.1;
/// Cells of the coverage map.
const COVERAGE_CELLS: (usize, usize) = (8, 6);

struct ViewDifference {
    place: f64,
    size: f64,
    tilt_deg: f64,
}

/// Outcome of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ViewOutcome {
    NoBoard,
    Moving,
    /// The board is at rest, but the view adds no information.
    Redundant,
    Accepted,
}

/// Map of the picture's cells that contain corners.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Coverage {
    pub columns: usize,
    pub rows: usize,
    /// Row by row from the top left.
    pub covered: Vec<bool>,
}

impl Coverage {
    /// Share of covered cells, 0 to 1.
    pub fn share(&self) -> f64 {
        self.covered.iter().filter(|covered| **covered).count() as f64 / self.covered.len().max(1) as f64
    }
}

/// Collects views until none is missing.
#[derive(Debug)]
pub struct ViewCollector {
    size: (u32, u32),
    options: LensOptions,
    min_views: usize,
    /// Current estimate, without distortion.
    lens: LensVector,
    previous: Option<(f64, BoardDetection)>,
    views: Vec<NamedView>,
    missing: Vec<MissingViews>,
}

impl ViewCollector {
    /// A collector for pictures of this size. At least `min_views` views are collected.
    pub fn new(size: (u32, u32), min_views: usize, options: LensOptions) -> Self {
        let size_px = DVec2::new(size.0.into(), size.1.into());
        let model = options.model.unwrap_or(LensModel::Opencv);
        let lens = LensVector::plain(model, INITIAL_FOCAL * size_px.max_element(), 0.5 * size_px);
        let missing = missing(size_px, &[], &[], &[], min_views);
        Self { size, options, min_views, lens, previous: None, views: Vec::new(), missing }
    }

    /// The missing views, most important first. Empty when the collection is complete.
    pub fn missing(&self) -> &[MissingViews] {
        &self.missing
    }

    /// Instruction for the person who holds the board. `None` when the collection is complete.
    pub fn hint(&self) -> Option<String> {
        // Any specific view also increases the number of views.
        let special = self.missing.iter().find(|wish| wish.condition_count() > 0);
        special.or(self.missing.first()).map(MissingViews::hint)
    }

    pub fn views(&self) -> &[NamedView] {
        &self.views
    }

    pub fn min_views(&self) -> usize {
        self.min_views
    }

    pub fn coverage(&self) -> Coverage {
        let (columns, rows) = COVERAGE_CELLS;
        let mut covered = vec![false; columns * rows];
        let cell = DVec2::new(columns as f64, rows as f64) / self.size_px();
        for at in self.views.iter().flat_map(|view| &view.detection.corners_px) {
            let at = *at * cell;
            let (column, row) = (at.x.max(0.0) as usize, at.y.max(0.0) as usize);
            covered[row.min(rows - 1) * columns + column.min(columns - 1)] = true;
        }
        Coverage { columns, rows, covered }
    }

    /// Adds the detection in the next picture, with its time, s, and name.
    pub fn add(&mut self, time_s: f64, name: &str, detection: Option<BoardDetection>) -> ViewOutcome {
        let Some(detection) = detection else {
            self.previous = None;
            return ViewOutcome::NoBoard;
        };
        let limit_px = (MAX_REST_MOTION * self.size_px().length()).max(REST_MOTION_PX);
        let rests = self.previous.replace((time_s, detection.clone())).is_some_and(|(previous_s, previous)| {
            (0.0..MAX_INTERVAL_S).contains(&(time_s - previous_s)) && moved_px(&previous, &detection) < limit_px
        });
        if !rests {
            return ViewOutcome::Moving;
        }
        if !self.is_new(&detection) {
            return ViewOutcome::Redundant;
        }
        self.views.push(NamedView { name: name.to_owned(), detection });
        self.update();
        ViewOutcome::Accepted
    }

    /// Calibrates from the views collected so far, complete or not.
    pub fn calibrated(&self) -> Result<CameraCalibration, LensCalibrationError> {
        calibrate(self.size, self.views.clone(), Vec::new(), &self.options)
    }

    fn size_px(&self) -> DVec2 {
        DVec2::new(self.size.0.into(), self.size.1.into())
    }

    fn is_new(&self, detection: &BoardDetection) -> bool {
        let Some(own) = self.place(detection) else { return false };
        let places: Vec<BoardView> = self.views.iter().filter_map(|view| self.place(&view.detection)).collect();
        let diagonal_px = self.size_px().length();
        let differs = |by: &ViewDifference| places.iter().all(|other| own.differs(other, diagonal_px, by));
        let more = self.missing.iter().any(|wish| wish.condition_count() == 0);
        if more && differs(&NEW_VIEW) {
            return true;
        }
        let condition_count = |wishes: &[MissingViews]| wishes.iter().map(MissingViews::condition_count).sum::<usize>();
        let previous: Vec<&BoardDetection> = self.views.iter().map(|view| &view.detection).collect();
        // Evaluated with the same lens, with and without the view.
        let stands: Vec<Option<RigidPose>> = previous.iter().map(|detection| self.stand(detection)).collect();
        let Some(stands) = stands.into_iter().collect::<Option<Vec<RigidPose>>>() else { return differs(&NEW_VIEW) };
        let missing_conditions = |views: &[&BoardDetection], stands: &[RigidPose]| {
            condition_count(&missing(self.size_px(), &[], views, stands, 0))
        };
        let without = missing_conditions(&previous, &stands);
        let with = missing_conditions(&[&previous[..], &[detection]].concat(), &[&stands[..], &[own.stand]].concat());
        with < without && differs(&GAP_VIEW)
    }

    /// Updates the lens and the missing views after a new view.
    fn update(&mut self) {
        let is_accurate = |parameter: &Parameter| parameter.sigma < MAX_FOCAL_SIGMA * parameter.value;
        let calibrated =
            self.calibrated().ok().filter(|calibrated| calibrated.parameters.iter().take(2).all(is_accurate));
        if let Some(calibrated) = calibrated {
            let of = &calibrated.geometry.intrinsics;
            let centre_px = DVec2::new(of.cx_px, of.cy_px);
            self.lens = LensVector::plain(calibrated.geometry.distortion.model, of.fx_px, centre_px);
            let views: Vec<&BoardDetection> = calibrated.views.iter().map(|view| &view.detection).collect();
            let (parameters, stands) = (&calibrated.parameters, &calibrated.stands);
            self.missing = missing(self.size_px(), parameters, &views, stands, self.min_views);
            return;
        }
        let posed = self.views.iter().filter_map(|view| Some((&view.detection, self.stand(&view.detection)?)));
        let (views, stands): (Vec<&BoardDetection>, Vec<RigidPose>) = posed.unzip();
        // Not complete before the camera is known.
        let min_views = self.min_views.max(self.views.len() + 1);
        self.missing = missing(self.size_px(), &[], &views, &stands, min_views);
    }

    fn stand(&self, detection: &BoardDetection) -> Option<RigidPose> {
        stand(&self.lens, &detection.board, &detection.corners_px)
    }

    fn place(&self, detection: &BoardDetection) -> Option<BoardView> {
        let stand = self.stand(detection)?;
        let (low, high) = bounds(&detection.corners_px);
        // Relative to the length of the board, so that partial views are comparable.
        let (board_low, board_high) = bounds(&detection.board);
        let size = (high - low).length() / (board_high - board_low).length().max(1e-9);
        Some(BoardView { middle_px: middle(&detection.corners_px), size, tilt_deg: tilt_deg(&stand), stand })
    }
}

/// Appearance of a board in the picture.
struct BoardView {
    middle_px: DVec2,
    /// Px per length of the board.
    size: f64,
    tilt_deg: DVec2,
    stand: RigidPose,
}

impl BoardView {
    fn differs(&self, other: &Self, diagonal_px: f64, by: &ViewDifference) -> bool {
        self.middle_px.distance(other.middle_px) > by.place * diagonal_px
            || (self.size / other.size).max(other.size / self.size) > by.size
            || self.tilt_deg.distance(other.tilt_deg) > by.tilt_deg
    }
}

fn middle(places: &[DVec2]) -> DVec2 {
    places.iter().sum::<DVec2>() / places.len().max(1) as f64
}

fn bounds(places: &[DVec2]) -> (DVec2, DVec2) {
    places.iter().fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), at| (low.min(*at), high.max(*at)))
}

/// Motion of a board in the picture, px: the median distance of its corners. On a partly visible
/// chessboard the same corner may get another number, so each is matched with the nearest previous
/// one. A motion by a whole square is detected by the centroid.
fn moved_px(previous: &BoardDetection, now: &BoardDetection) -> f64 {
    if previous.corners_px.is_empty() || now.corners_px.is_empty() {
        return f64::INFINITY;
    }
    let to_nearest = |at: &DVec2| {
        let ways = previous.corners_px.iter().map(|other| *other - *at);
        ways.min_by(|a, b| a.length_squared().total_cmp(&b.length_squared())).unwrap_or(DVec2::INFINITY)
    };
    let ways: Vec<DVec2> = now.corners_px.iter().map(to_nearest).collect();
    let whole = if previous.corners_px.len() == now.corners_px.len() {
        middle(&previous.corners_px).distance(middle(&now.corners_px))
    } else {
        0.0
    };
    median_length(ways.iter()).max(whole)
}
