//! Views that a calibration still lacks.
//!
//! Distortion is strongest in the picture's corners. The focal length and the principal point can
//! only be separated from a board's depth by its tilt, and from each other by different distances.

use std::fmt;

use glam::{DVec2, DVec3};

use super::parameter::Parameter;
use crate::calibrate::board::BoardDetection;
use crate::fit::RigidPose;
use crate::text::{count, fixed};

/// A corner of the picture is covered if a board's corner lies within this share of the picture's
/// width and height.
const CORNER_SHARE: f64 = 0.25;
/// Smallest tilt of a board that gives information on depth, degrees.
const MIN_TILT_DEG: f64 = 15.0;
/// Smallest ratio of the farthest to the nearest board.
const MIN_DISTANCE_RATIO: f64 = 1.4;
/// Largest relative standard deviation of a focal length.
const MAX_RELATIVE_SIGMA: f64 = 0.01;

/// The edge of a board, as seen in the picture, that should be farther away.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureEdge {
    Right,
    Left,
    Lower,
    Upper,
}

impl PictureEdge {
    const ALL: [Self; 4] = [Self::Right, Self::Left, Self::Lower, Self::Upper];

    fn name(self) -> &'static str {
        match self {
            Self::Right => "right",
            Self::Left => "left",
            Self::Lower => "lower",
            Self::Upper => "upper",
        }
    }

    /// Direction of [`tilt_deg`] if this edge is the farther one.
    fn towards(self) -> DVec2 {
        match self {
            Self::Right => DVec2::X,
            Self::Left => DVec2::NEG_X,
            Self::Lower => DVec2::Y,
            Self::Upper => DVec2::NEG_Y,
        }
    }
}

/// A corner of the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PictureCorner {
    pub right: bool,
    pub lower: bool,
}

impl PictureCorner {
    const ALL: [Self; 4] = [
        Self { right: false, lower: false },
        Self { right: true, lower: false },
        Self { right: false, lower: true },
        Self { right: true, lower: true },
    ];

    fn name(self) -> &'static str {
        match (self.lower, self.right) {
            (false, false) => "upper left",
            (false, true) => "upper right",
            (true, false) => "lower left",
            (true, true) => "lower right",
        }
    }

    /// Position in fractions of the picture's width and height.
    fn at(self) -> DVec2 {
        DVec2::new(f64::from(u8::from(self.right)), f64::from(u8::from(self.lower)))
    }
}

/// A lack of views.
#[derive(Clone, Debug, PartialEq)]
pub enum MissingViews {
    /// More views.
    Views { taken: usize, min_views: usize },
    /// Boards tilted so that these edges are farther away.
    Tilts(Vec<PictureEdge>),
    /// Boards in these corners of the picture.
    Corners(Vec<PictureCorner>),
    /// Boards closer and farther than the others.
    Distances,
    /// A parameter with a large standard deviation, percent.
    Focal { name: &'static str, percent: f64 },
}

impl MissingViews {
    /// Number of conditions to fulfil; further views of any kind count as none.
    pub fn condition_count(&self) -> usize {
        match self {
            Self::Views { .. } | Self::Focal { .. } => 0,
            Self::Tilts(edges) => edges.len(),
            Self::Corners(corners) => corners.len(),
            Self::Distances => 1,
        }
    }

    /// Instruction where to hold the board next.
    pub fn hint(&self) -> String {
        match self {
            Self::Views { .. } => "somewhere else, or otherwise tilted".to_owned(),
            Self::Tilts(edges) => {
                let edge = edges.first().map_or("", |edge| edge.name());
                format!("tilt it, its {edge} edge away from the camera")
            }
            Self::Corners(corners) => {
                let corner = corners.first().map_or("", |corner| corner.name());
                format!("into the picture's {corner} corner")
            }
            Self::Distances => "nearer, or farther away".to_owned(),
            Self::Focal { .. } => "tilt it by 20° to 45°, to any side".to_owned(),
        }
    }
}

impl fmt::Display for MissingViews {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Views { taken, min_views } => write!(f, "{} so far: take {min_views} or more", count(*taken, "view")),
            Self::Tilts(edges) => write!(
                f,
                "no board is tilted so that its {} edge is farther away: tilt it by 20° to 45°",
                listed(&edges.iter().map(|edge| edge.name()).collect::<Vec<_>>(), "or")
            ),
            Self::Corners(corners) => write!(
                f,
                "no board is seen in the picture's {} {}, where distortion is strongest: hold it there",
                listed(&corners.iter().map(|corner| corner.name()).collect::<Vec<_>>(), "and"),
                if corners.len() > 1 { "corners" } else { "corner" }
            ),
            Self::Distances => {
                f.write_str("all boards are about as far away: take some from nearer and some from farther")
            }
            Self::Focal { name, percent } => {
                write!(f, "{name} is known to ±{} % only: more views, tilted more", fixed(*percent, 1))
            }
        }
    }
}

/// Rotation of a board about the picture's vertical (positive if its right edge is farther) and
/// about its horizontal (positive if its lower edge is farther), degrees.
pub fn tilt_deg(stand: &RigidPose) -> DVec2 {
    let normal = stand.rotation * DVec3::Z;
    // A board has the same plane from behind.
    let normal = if normal.z < 0.0 { -normal } else { normal };
    DVec2::new(-normal.x.atan2(normal.z), -normal.y.atan2(normal.z)) * 1f64.to_degrees()
}

/// Distance of the visible part of a board, in its unit.
pub fn distance(detection: &BoardDetection, stand: &RigidPose) -> f64 {
    let middle = detection.board.iter().sum::<DVec2>() / detection.board.len().max(1) as f64;
    stand.point(middle.extend(0.0)).length()
}

/// The views that a calibration lacks for a picture of this size, most important first. At least
/// `min_views` views are required, with enough variation.
pub fn missing(
    size_px: DVec2,
    parameters: &[Parameter],
    views: &[&BoardDetection],
    stands: &[RigidPose],
    min_views: usize,
) -> Vec<MissingViews> {
    let mut missing_views = Vec::new();
    if views.len() < min_views {
        missing_views.push(MissingViews::Views { taken: views.len(), min_views });
    }
    let tilts: Vec<DVec2> = stands.iter().map(tilt_deg).collect();
    let is_tilted = |edge: PictureEdge| tilts.iter().any(|tilt| tilt.dot(edge.towards()) >= MIN_TILT_DEG);
    let absent: Vec<PictureEdge> = PictureEdge::ALL.into_iter().filter(|edge| !is_tilted(*edge)).collect();
    if !absent.is_empty() {
        missing_views.push(MissingViews::Tilts(absent));
    }
    let points = || views.iter().flat_map(|view| &view.corners_px).map(|at| *at / size_px);
    let is_covered = |corner: PictureCorner| points().any(|at| (at - corner.at()).abs().max_element() < CORNER_SHARE);
    let absent: Vec<PictureCorner> = PictureCorner::ALL.into_iter().filter(|corner| !is_covered(*corner)).collect();
    if !absent.is_empty() {
        missing_views.push(MissingViews::Corners(absent));
    }
    let distances = || views.iter().zip(stands).map(|(view, stand)| distance(view, stand));
    let (near, far) = (distances().fold(f64::INFINITY, f64::min), distances().fold(0.0, f64::max));
    if far < MIN_DISTANCE_RATIO * near {
        missing_views.push(MissingViews::Distances);
    }
    for parameter in parameters.iter().take(2).filter(|p| p.sigma > MAX_RELATIVE_SIGMA * p.value) {
        missing_views
            .push(MissingViews::Focal { name: parameter.name, percent: 100.0 * parameter.sigma / parameter.value });
    }
    missing_views
}

fn listed(names: &[&str], word: &str) -> String {
    match names {
        [] => String::new(),
        [one] => (*one).to_owned(),
        [first @ .., last] => format!("{} {word} {last}", first.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DQuat};

    use super::*;
    use crate::calibrate::board::{ChessboardSize, DetectedTarget};

    const SIZE_PX: DVec2 = DVec2::new(640.0, 480.0);

    fn stand(turn: DVec3, z: f64) -> RigidPose {
        RigidPose { rotation: DMat3::from_quat(DQuat::from_scaled_axis(turn)), translation: DVec3::new(0.0, 0.0, z) }
    }

    fn view(corners_px: Vec<DVec2>) -> BoardDetection {
        BoardDetection {
            board: vec![DVec2::ZERO; corners_px.len()],
            corners_px,
            target: DetectedTarget::Chessboard(ChessboardSize::new(9, 6)),
        }
    }

    /// The messages, if ten views are required.
    fn messages(parameters: &[Parameter], view: &BoardDetection, stands: &[RigidPose]) -> Vec<String> {
        let missing_views = missing(SIZE_PX, parameters, &vec![view; stands.len()], stands, 10);
        missing_views.iter().map(MissingViews::to_string).collect()
    }

    #[test]
    fn tilts_have_the_sign_of_the_farther_edge() {
        // Rotated about y by +30°, the board's x axis goes to (cos 30°, −sin 30°) in x and z: its
        // right edge is closer.
        let tilt = tilt_deg(&stand(DVec3::new(0.0, 30f64.to_radians(), 0.0), 9.0));
        assert!((tilt - DVec2::new(-30.0, 0.0)).length() < 1e-9, "{tilt}");
        // Rotated about x by +30°, the lower edge (the board's y axis) goes to z +y sin 30°:
        // farther.
        let tilt = tilt_deg(&stand(DVec3::new(30f64.to_radians(), 0.0, 0.0), 9.0));
        assert!((tilt - DVec2::new(0.0, 30.0)).length() < 1e-9, "{tilt}");
    }

    #[test]
    fn missing_views_are_reported_until_all_are_there() {
        let parameters = [Parameter { name: "fx_px", value: 500.0, sigma: 1.0 }; 2];
        let middle = view(vec![DVec2::new(320.0, 240.0)]);
        let all = messages(&parameters, &middle, &[stand(DVec3::ZERO, 10.0); 3]).join("\n");
        for part in [
            "3 views so far",
            "its right, left, lower or upper edge",
            "upper left, upper right, lower left and lower right corners",
            "as far away",
        ] {
            assert!(all.contains(part), "{all}");
        }
        assert!(!all.contains("known to"));
        let poor = [Parameter { name: "fx_px", value: 500.0, sigma: 20.0 }];
        let tilts = [(0.3, 0.0), (-0.3, 0.0), (0.0, 0.3), (0.0, -0.3)];
        let mut stands: Vec<RigidPose> = tilts.iter().map(|(x, y)| stand(DVec3::new(*x, *y, 0.0), 10.0)).collect();
        stands.resize(10, stand(DVec3::ZERO, 20.0));
        let corners = [(9.0, 9.0), (630.0, 9.0), (9.0, 470.0), (630.0, 470.0)];
        let everywhere = view(corners.iter().map(|c| DVec2::from(*c)).collect());
        assert_eq!(messages(&parameters, &everywhere, &stands), Vec::<String>::new());
        assert_eq!(messages(&poor, &everywhere, &stands), ["fx_px is known to ±4.0 % only: more views, tilted more"]);
        // Without the view tilted to the left, and without the lower right corner.
        stands[1] = stands[9];
        let without = view(corners[..3].iter().map(|c| DVec2::from(*c)).collect());
        let messages = messages(&parameters, &without, &stands);
        assert!(messages[0].contains("upper edge") || messages[0].contains("right edge"), "{messages:?}");
        assert!(messages.len() == 2 && messages[1].contains("picture's lower right corner,"), "{messages:?}");
    }
}
