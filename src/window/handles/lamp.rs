//! Where lamps are shown: most hang outside the picture or behind the camera, and are shown at its rim then, with their handles.
//!
//! Places are points of the screen, y down.

use eframe::egui::Rect;
use glam::{DVec2, DVec3};

use locard_engine::shot::Eye;

/// How far a mark stands within the rim, and handles, which are longer.
const MARK_INSET: f64 = 18.0;
const HANDLES_INSET: f64 = 104.0;
/// How near the pointer has to be.
const NEAR: f64 = 13.0;
/// A way on the screen that is shorter than this says nothing: unit length is 1.
const NO_WAY: f64 = 1e-9;

/// Where a lamp is shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mark {
    pub at: DVec2,
    /// At the rim: the way to where it is, unit length. `None`: it is seen there.
    pub beyond: Option<DVec2>,
}

/// Where a lamp is shown in the part of the picture that is seen; `screen` takes px of the picture to the screen.
pub fn mark(eye: &Eye, at_m: DVec3, visible: Rect, screen: impl Fn(DVec2) -> DVec2) -> Mark {
    let seen = eye.project(at_m).map(screen);
    placed(seen, eye.way_to(at_m), corners(visible))
}

/// The same of where it is seen, its way from the camera in the camera's axes, and the corners of what is seen.
fn placed(seen: Option<DVec2>, way: DVec3, [low, high]: [DVec2; 2]) -> Mark {
    let middle = 0.5 * (low + high);
    if let Some(at) = seen.filter(|at| at.cmpge(low).all() && at.cmple(high).all()) {
        return Mark { at, beyond: None };
    }
    // Right behind no way is shorter than another: up, where most lamps are.
    let long = |way: DVec2| way.try_normalize().filter(|_| way.length() > NO_WAY);
    let towards = seen.and_then(|at| long(at - middle)).or_else(|| long(way.truncate())).unwrap_or(DVec2::NEG_Y);
    Mark { at: at_rim([low, high], MARK_INSET, towards), beyond: Some(towards) }
}

/// The mark that a pointer is on: the nearest.
pub fn at(marks: &[Mark], pointer: DVec2) -> Option<usize> {
    let near = marks.iter().map(|mark| mark.at.distance(pointer)).enumerate().filter(|(_, far)| *far <= NEAR);
    near.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(lamp, _)| lamp)
}

/// The place in the world that the handles of a lamp beyond the rim are around: within the picture, as far off as the lamp is, so that
/// a step with them is the same step. `px` takes places of the screen to the picture.
pub fn stand_in(eye: &Eye, at_m: DVec3, towards: DVec2, visible: Rect, px: impl Fn(DVec2) -> DVec2) -> Option<DVec3> {
    let at = at_rim(corners(visible), HANDLES_INSET, towards);
    Some(eye.ray(px(at))?.at(at_m.distance(eye.position_m())))
}

fn corners(rect: Rect) -> [DVec2; 2] {
    [rect.min, rect.max].map(|p| DVec2::new(p.x.into(), p.y.into()))
}

/// Where a way from the middle of a rectangle comes to its rim, so far within it; never farther within than half-way.
fn at_rim([low, high]: [DVec2; 2], inset: f64, towards: DVec2) -> DVec2 {
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
    use locard_engine::shot::{Given, Shot};
    use std::path::Path;

    const CORNERS: [DVec2; 2] = [DVec2::new(100.0, 50.0), DVec2::new(900.0, 650.0)];

    #[test]
    fn a_lamp_in_the_picture_is_marked_there_and_others_at_the_rim() {
        let ahead = DVec3::new(0.3, 0.4, 2.0);
        let inside = DVec2::new(899.0, 51.0);
        assert_eq!(placed(Some(inside), ahead, CORNERS), Mark { at: inside, beyond: None });
        // Projected 3 to the right and 4 up from the middle (500, 350): the upper rim, 300 − 18 above it.
        let above = placed(Some(DVec2::new(500.0 + 1800.0, 350.0 - 2400.0)), ahead, CORNERS);
        assert!(above.at.abs_diff_eq(DVec2::new(500.0 + 211.5, 68.0), 1e-9), "{above:?}");
        assert!(above.beyond.unwrap().abs_diff_eq(DVec2::new(0.6, -0.8), 1e-12));
        // Behind the camera to the left: by the camera's own axes, as far as the left rim.
        let behind = placed(None, DVec3::new(-2.0, 0.0, -1.0), CORNERS);
        assert_eq!((behind.at, behind.beyond), (DVec2::new(118.0, 350.0), Some(DVec2::NEG_X)));
        assert_eq!(placed(None, DVec3::NEG_Z, CORNERS).beyond, Some(DVec2::NEG_Y));
        assert_eq!([at(&[above, behind], behind.at + 9.0), at(&[above, behind], behind.at + 10.0)], [Some(1), None]);
        // A part of the picture that is hardly seen.
        let small = placed(None, DVec3::Y, [DVec2::ZERO, DVec2::new(300.0, 20.0)]);
        assert_eq!(small.at, DVec2::new(150.0, 15.0));
    }

    #[test]
    fn handles_of_a_lamp_behind_lie_in_the_picture_as_far_off_as_it() {
        let shot = Shot::open(Path::new("recordings/demo"), &OpenOptions::default(), &Given::default()).unwrap();
        let eye = shot.eye(30).unwrap();
        let visible = Rect::from_min_max(pos2(0.0, 0.0), pos2(640.0, 480.0));
        // A px is a point.
        let same = |at: DVec2| at;
        for at_m in [DVec3::new(-0.28, 0.28, 2.35), 3.0 * eye.position_m()] {
            let mark = mark(&eye, at_m, visible, same);
            let towards = mark.beyond.unwrap();
            let there = stand_in(&eye, at_m, towards, visible, same).unwrap();
            let (seen, far) = (eye.project(there).unwrap(), at_m.distance(eye.position_m()));
            assert!((there.distance(eye.position_m()) - far).abs() < 0.01 * far);
            assert!(seen.cmpge(DVec2::splat(103.0)).all() && seen.cmple(DVec2::new(537.0, 377.0)).all(), "{seen}");
            assert!((seen - DVec2::new(320.0, 240.0)).normalize().dot(towards) > 0.999, "{seen} {towards}");
        }
    }
}
