//! Markers of lamps. Most lamps are outside the picture or behind the camera: their markers stand
//! at its border, and their gizmos inside it.
//!
//! Positions are points of the screen, y down.

use eframe::egui::Rect;
use glam::{DVec2, DVec3};

use locard_engine::shot::PosedCamera;

/// Distance of a marker from the border of the picture, points.
const MARKER_INSET_PT: f64 = 18.0;
/// Distance of a gizmo from the border of the picture, points.
const GIZMO_INSET_PT: f64 = 104.0;
/// Pick radius of a marker, points.
const PICK_RADIUS_PT: f64 = 13.0;
/// A shorter vector has no direction.
const MIN_DIRECTION_LENGTH: f64 = 1e-9;

/// Marker of a lamp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Marker {
    pub at: DVec2,
    /// Unit direction to a lamp outside the visible part of the picture. `None`: the lamp is
    /// inside.
    pub off_screen: Option<DVec2>,
}

/// Marker of a lamp in the visible part of the picture; `screen` maps px of the picture to the
/// screen.
pub fn marker(eye: &PosedCamera, at_m: DVec3, visible: Rect, screen: impl Fn(DVec2) -> DVec2) -> Marker {
    let projected = eye.project(at_m).map(screen);
    marker_at(projected, eye.vector_to(at_m), corners(visible))
}

/// Marker of a lamp by its projection, its direction in camera coordinates, and two corners of the
/// visible part.
fn marker_at(projected: Option<DVec2>, direction: DVec3, [low, high]: [DVec2; 2]) -> Marker {
    let middle = 0.5 * (low + high);
    if let Some(at) = projected.filter(|at| at.cmpge(low).all() && at.cmple(high).all()) {
        return Marker { at, off_screen: None };
    }
    // A lamp exactly behind the camera has no direction on the screen: up, where most lamps are.
    let unit = |vector: DVec2| vector.try_normalize().filter(|_| vector.length() > MIN_DIRECTION_LENGTH);
    let towards =
        projected.and_then(|at| unit(at - middle)).or_else(|| unit(direction.truncate())).unwrap_or(DVec2::NEG_Y);
    Marker { at: at_border([low, high], MARKER_INSET_PT, towards), off_screen: Some(towards) }
}

/// Index of the nearest marker within the pick radius.
pub fn pick(markers: &[Marker], pointer: DVec2) -> Option<usize> {
    let distances = markers.iter().map(|marker| marker.at.distance(pointer)).enumerate();
    let near = distances.filter(|(_, distance)| *distance <= PICK_RADIUS_PT);
    near.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(lamp, _)| lamp)
}

/// World position of the gizmo of a lamp outside the visible part: inside the picture, at the
/// lamp's distance, so that both have the same scale. `px` maps points of the screen to the
/// picture.
pub fn gizmo_position_m(
    eye: &PosedCamera,
    at_m: DVec3,
    towards: DVec2,
    visible: Rect,
    px: impl Fn(DVec2) -> DVec2,
) -> Option<DVec3> {
    let at = at_border(corners(visible), GIZMO_INSET_PT, towards);
    Some(eye.ray(px(at))?.at(at_m.distance(eye.position_m())))
}

fn corners(rect: Rect) -> [DVec2; 2] {
    [rect.min, rect.max].map(|p| DVec2::new(p.x.into(), p.y.into()))
}

/// Intersection of a ray from the centre of a rectangle with its border, moved inwards by `inset`,
/// at most by half of the way to the centre.
fn at_border([low, high]: [DVec2; 2], inset: f64, towards: DVec2) -> DVec2 {
    let half = 0.5 * (high - low);
    let reach = (half - inset).max(0.5 * half);
    let share = (reach / towards.abs().max(DVec2::splat(f64::MIN_POSITIVE))).min_element();
    0.5 * (low + high) + towards * share
}

#[cfg(test)]
mod tests {
    use eframe::egui::pos2;

    use super::*;
    use locard_engine::recording::OpenOptions;
    use locard_engine::shot::{Shot, ShotOptions};
    use std::path::Path;

    const CORNERS: [DVec2; 2] = [DVec2::new(100.0, 50.0), DVec2::new(900.0, 650.0)];

    #[test]
    fn marker_of_a_lamp_outside_the_picture_stands_at_the_border() {
        let ahead = DVec3::new(0.3, 0.4, 2.0);
        let inside = DVec2::new(899.0, 51.0);
        assert_eq!(marker_at(Some(inside), ahead, CORNERS), Marker { at: inside, off_screen: None });
        // Projected 3 to the right and 4 up from the centre (500, 350): the upper border, 300 − 18
        // above it.
        let above = marker_at(Some(DVec2::new(500.0 + 1800.0, 350.0 - 2400.0)), ahead, CORNERS);
        assert!(above.at.abs_diff_eq(DVec2::new(500.0 + 211.5, 68.0), 1e-9), "{above:?}");
        assert!(above.off_screen.unwrap().abs_diff_eq(DVec2::new(0.6, -0.8), 1e-12));
        // Behind the camera to the left: the left border, by the camera's axes.
        let behind = marker_at(None, DVec3::new(-2.0, 0.0, -1.0), CORNERS);
        assert_eq!((behind.at, behind.off_screen), (DVec2::new(118.0, 350.0), Some(DVec2::NEG_X)));
        assert_eq!(marker_at(None, DVec3::NEG_Z, CORNERS).off_screen, Some(DVec2::NEG_Y));
        let markers = [above, behind];
        assert_eq!([pick(&markers, behind.at + 9.0), pick(&markers, behind.at + 10.0)], [Some(1), None]);
        // A visible part that is smaller than the inset.
        let small = marker_at(None, DVec3::Y, [DVec2::ZERO, DVec2::new(300.0, 20.0)]);
        assert_eq!(small.at, DVec2::new(150.0, 15.0));
    }

    #[test]
    fn gizmo_of_a_lamp_outside_the_picture_lies_inside_at_the_same_distance() {
        let shot = Shot::open(Path::new("recordings/demo"), &OpenOptions::default(), &ShotOptions::default()).unwrap();
        let eye = shot.posed_camera(30).unwrap();
        let visible = Rect::from_min_max(pos2(0.0, 0.0), pos2(640.0, 480.0));
        // 1 px is 1 point.
        let same = |at: DVec2| at;
        for at_m in [DVec3::new(-0.28, 0.28, 2.35), 3.0 * eye.position_m()] {
            let marker = marker(&eye, at_m, visible, same);
            let towards = marker.off_screen.unwrap();
            let there = gizmo_position_m(&eye, at_m, towards, visible, same).unwrap();
            let (seen, distance_m) = (eye.project(there).unwrap(), at_m.distance(eye.position_m()));
            assert!((there.distance(eye.position_m()) - distance_m).abs() < 0.01 * distance_m);
            assert!(seen.cmpge(DVec2::splat(103.0)).all() && seen.cmple(DVec2::new(537.0, 377.0)).all(), "{seen}");
            assert!((seen - DVec2::new(320.0, 240.0)).normalize().dot(towards) > 0.999, "{seen} {towards}");
        }
    }
}
