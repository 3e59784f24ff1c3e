//! What views a calibration still wants.
//!
//! Distortion is strongest in the picture's corners. The focal length and the principal point are told from a board's
//! depth by its tilt alone. Different distances keep the two apart.

use glam::{DVec2, DVec3};

use super::calibrated::{ENOUGH_VIEWS, NamedView, Parameter};
use crate::camera::Geometry;
use crate::fit::Stand;
use crate::words::{count, fixed};

/// A corner of the picture is seen if a board's corner lies in this share of its width and height.
const CORNER: f64 = 0.25;
/// A board says something about depth if it is turned by this, degrees.
const TILTED_DEG: f64 = 15.0;
/// The farthest board is this many times as far as the nearest.
const SPREAD: f64 = 1.4;
/// A focal length is known to this share, σ.
const KNOWN: f64 = 0.01;

/// How far a board is turned about the picture's vertical (positive: its right edge is the farther one) and about its
/// horizontal (its lower edge), degrees.
pub fn tilt_deg(stand: &Stand) -> DVec2 {
    let normal = stand.rotation * DVec3::Z;
    // A board is the same from behind.
    let normal = if normal.z < 0.0 { -normal } else { normal };
    DVec2::new(-normal.x.atan2(normal.z), -normal.y.atan2(normal.z)) * 1f64.to_degrees()
}

/// The distance of what is seen of a board, in its unit.
pub fn distance(view: &NamedView, stand: &Stand) -> f64 {
    let middle = view.seen.board.iter().sum::<DVec2>() / view.seen.board.len().max(1) as f64;
    stand.point(middle.extend(0.0)).length()
}

/// Says what to photograph next, most needed first.
pub(super) fn missing(
    geometry: &Geometry,
    parameters: &[Parameter],
    views: &[NamedView],
    stands: &[Stand],
) -> Vec<String> {
    let mut wanted = Vec::new();
    if views.len() < ENOUGH_VIEWS {
        wanted.push(format!("{} so far: take {} or more", count(views.len(), "view"), ENOUGH_VIEWS));
    }
    let tilts: Vec<DVec2> = stands.iter().map(tilt_deg).collect();
    let farther = [("right", DVec2::X), ("left", DVec2::NEG_X), ("lower", DVec2::Y), ("upper", DVec2::NEG_Y)];
    let absent = farther.iter().filter(|(_, towards)| !tilts.iter().any(|tilt| tilt.dot(*towards) >= TILTED_DEG));
    let absent: Vec<&str> = absent.map(|(edge, _)| *edge).collect();
    if !absent.is_empty() {
        wanted.push(format!(
            "no board is tilted so that its {} edge is farther away: tilt it by 20° to 45°",
            or(&absent)
        ));
    }
    let size = DVec2::new(geometry.intrinsics.width_px.into(), geometry.intrinsics.height_px.into());
    let seen = || views.iter().flat_map(|view| &view.seen.at_px).map(|at| *at / size);
    let corners =
        [("upper left", 0.0, 0.0), ("upper right", 1.0, 0.0), ("lower left", 0.0, 1.0), ("lower right", 1.0, 1.0)];
    let is_seen = |x: f64, y: f64| seen().any(|at| (at - DVec2::new(x, y)).abs().max_element() < CORNER);
    let absent: Vec<&str> = corners.iter().filter(|(_, x, y)| !is_seen(*x, *y)).map(|(name, ..)| *name).collect();
    if !absent.is_empty() {
        let plural = if absent.len() > 1 { "corners" } else { "corner" };
        wanted.push(format!(
            "no board is seen in the picture's {} {plural}, where distortion is strongest: hold it there",
            and(&absent)
        ));
    }
    let distances = || views.iter().zip(stands).map(|(view, stand)| distance(view, stand));
    let (near, far) = (distances().fold(f64::INFINITY, f64::min), distances().fold(0.0, f64::max));
    if far < SPREAD * near {
        wanted.push("all boards are about as far away: take some from nearer and some from farther".to_owned());
    }
    for parameter in parameters.iter().take(2).filter(|p| p.sigma > KNOWN * p.value) {
        let percent = fixed(100.0 * parameter.sigma / parameter.value, 1);
        wanted.push(format!("{} is known to ±{percent} % only: more views, tilted more", parameter.name));
    }
    wanted
}

fn listed(names: &[&str], word: &str) -> String {
    match names {
        [] => String::new(),
        [one] => (*one).to_owned(),
        [first @ .., last] => format!("{} {word} {last}", first.join(", ")),
    }
}

fn or(names: &[&str]) -> String {
    listed(names, "or")
}

fn and(names: &[&str]) -> String {
    listed(names, "and")
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DQuat};

    use super::*;
    use crate::calibrate::board::{Board, Seen, Target};
    use crate::camera::{Distortion, Intrinsics};

    fn stand(turn: DVec3, z: f64) -> Stand {
        Stand { rotation: DMat3::from_quat(DQuat::from_scaled_axis(turn)), translation: DVec3::new(0.0, 0.0, z) }
    }

    fn view(at_px: Vec<DVec2>) -> NamedView {
        let board = vec![DVec2::ZERO; at_px.len()];
        NamedView { name: "a".to_owned(), seen: Seen { board, at_px, of: Target::Chessboard(Board::new(9, 6)) } }
    }

    #[test]
    fn tilts_have_the_sign_of_the_farther_edge() {
        // Turned about y by +30°, x of the board goes to x cos 30°, z −x sin 30°: its right edge is nearer.
        let tilt = tilt_deg(&stand(DVec3::new(0.0, 30f64.to_radians(), 0.0), 9.0));
        assert!((tilt - DVec2::new(-30.0, 0.0)).length() < 1e-9, "{tilt}");
        // About x by +30° the lower edge, y of the board, goes to z +y sin 30°: farther.
        let tilt = tilt_deg(&stand(DVec3::new(30f64.to_radians(), 0.0, 0.0), 9.0));
        assert!((tilt - DVec2::new(0.0, 30.0)).length() < 1e-9, "{tilt}");
    }

    #[test]
    fn what_is_missing_is_told_and_nothing_when_all_is_there() {
        let geometry = Geometry::new(Intrinsics::default(), Distortion::default());
        let known = [Parameter { name: "fx_px", value: 500.0, sigma: 1.0 }; 2];
        let middle = view(vec![DVec2::new(320.0, 240.0)]);
        let told = missing(&geometry, &known, &vec![middle.clone(); 3], &[stand(DVec3::ZERO, 10.0); 3]).join("\n");
        for part in [
            "3 views so far",
            "its right, left, lower or upper edge",
            "upper left, upper right, lower left and lower right corners",
            "as far away",
        ] {
            assert!(told.contains(part), "{told}");
        }
        assert!(!told.contains("known to"));
        let poor = [Parameter { name: "fx_px", value: 500.0, sigma: 20.0 }];
        let tilts = [(0.3, 0.0), (-0.3, 0.0), (0.0, 0.3), (0.0, -0.3)];
        let mut stands: Vec<Stand> = tilts.iter().map(|(x, y)| stand(DVec3::new(*x, *y, 0.0), 10.0)).collect();
        stands.resize(10, stand(DVec3::ZERO, 20.0));
        let corners = [(9.0, 9.0), (630.0, 9.0), (9.0, 470.0), (630.0, 470.0)];
        let views = vec![view(corners.iter().map(|c| DVec2::from(*c)).collect()); 10];
        assert_eq!(missing(&geometry, &known, &views, &stands), Vec::<String>::new());
        assert_eq!(
            missing(&geometry, &poor, &views, &stands),
            ["fx_px is known to ±4.0 % only: more views, tilted more"]
        );
        // Without what is turned to the left, and without the lower right corner.
        stands[1] = stands[9];
        let views = vec![view(corners[..3].iter().map(|c| DVec2::from(*c)).collect()); 10];
        let told = missing(&geometry, &known, &views, &stands);
        assert!(told[0].contains("upper edge") || told[0].contains("right edge"), "{told:?}");
        assert!(told.len() == 2 && told[1].contains("picture's lower right corner,"), "{told:?}");
    }
}
