//! Tests of modal transforms.

use super::super::labels::{history, status};
use super::*;
use glam::DQuat;
use locard_engine::scene::Size;

/// View from above: 1 px is 1 cm, the world's y points up in the picture.
fn from_above(px: DVec2) -> Option<ViewRay> {
    Some(ViewRay { origin_m: DVec3::new(0.01 * px.x, -0.01 * px.y, 2.0), direction: DVec3::NEG_Z })
}

/// View from the side, along y.
fn from_the_side(px: DVec2) -> Option<ViewRay> {
    Some(ViewRay { origin_m: DVec3::new(0.01 * px.x, -2.0, -0.01 * px.y), direction: DVec3::Y })
}

/// An item 1 m above the floor at (1, 0), with its origin 2 cm above its lowest point. Its
/// local x is the world's y.
fn start() -> DragState {
    let placement = ItemPlacement {
        position_m: DVec3::new(1.0, 0.0, 1.02),
        rotation: DQuat::IDENTITY,
        heading_deg: 90.0,
        size: Size::Scale(DVec3::ONE),
    };
    let local_axes = [DVec3::Y, DVec3::NEG_X, DVec3::Z];
    let support_points_m = vec![DVec3::new(0.1, 0.0, -0.02), DVec3::new(-0.1, 0.0, -0.01)];
    let px = DVec2::new(100.0, 0.0);
    DragState {
        placement,
        local_axes,
        up: DVec3::Z,
        support_points_m,
        free_plane_normal: None,
        centre_px: px,
        anchor_px: px,
        grip_px: DVec2::new(150.0, 0.0),
    }
}

fn pointer(x: f64, y: f64) -> Pointer {
    Pointer { at_px: DVec2::new(x, y), snaps: false, level: false }
}

const NO_DEPTH: fn(DVec2) -> Option<Plane> = |_| None;

fn typed(transform: &mut Transform, text: &str) {
    text.chars().for_each(|c| transform.typed.push(c));
}

#[test]
fn free_move_without_depth_is_level_and_typed_moves_follow_an_axis() {
    let mut transform = Transform::new(TransformKind::Move, Constraint::Free, start());
    let update = transform.update(pointer(153.2, -4.0), from_above, NO_DEPTH);
    assert!(update.placement.position_m.abs_diff_eq(DVec3::new(1.032, 0.04, 1.02), 1e-9), "{update:?}");
    assert_eq!((history(&transform), status(&transform)), ("moved 5.12 cm".to_owned(), "Move: 5.12 cm".to_owned()));
    assert_eq!(update.support, Plane { point_m: DVec3::new(1.0, 0.0, 1.0), normal: DVec3::Z });
    // Whole centimetres.
    let snapping = Pointer { snaps: true, ..pointer(153.2, -4.4) };
    let update = transform.update(snapping, from_above, NO_DEPTH);
    assert!(update.placement.position_m.abs_diff_eq(DVec3::new(1.03, 0.04, 1.02), 1e-9), "{update:?}");
    // Typed distance: along x by default, then along the local x, which is the world's y.
    typed(&mut transform, "-0,1");
    let at =
        |transform: &mut Transform| transform.update(pointer(999.0, 7.0), from_above, NO_DEPTH).placement.position_m;
    assert!(at(&mut transform).abs_diff_eq(DVec3::new(0.9, 0.0, 1.02), 1e-12));
    assert_eq!(status(&transform), "Move along x: [-0,1]  -10 cm");
    transform.toggle_constraint(0, false);
    transform.toggle_constraint(0, false);
    assert!(at(&mut transform).abs_diff_eq(DVec3::new(1.0, -0.1, 1.02), 1e-12));
    assert_eq!(status(&transform), "Move along its own x: [-0,1]  -10 cm");
    transform.toggle_constraint(0, false);
    assert_eq!(transform.constraint, Constraint::Free);
}

#[test]
fn free_move_keeps_the_lowest_point_on_the_surface() {
    // A slope with a gradient of 3/4 along x, through (0, 0, 2).
    let normal = DVec3::new(-0.6, 0.0, 0.8);
    let slope = |px: DVec2| {
        let x = 0.01 * px.x;
        Some(Plane { point_m: DVec3::new(x, -0.01 * px.y, 2.0 + 0.75 * x), normal })
    };
    let mut transform = Transform::new(TransformKind::Move, Constraint::Free, start());
    // The grip is 50 px beside the anchor: 200 px is x = 1.5 m.
    let update = transform.update(pointer(200.0, 0.0), from_above, slope);
    let position = update.placement.position_m;
    // The lowest point lies 0.1 · 0.6 + 0.02 · 0.8 = 0.076 m below the position, against the
    // normal.
    assert!(position.abs_diff_eq(DVec3::new(1.5 - 0.0456, 0.0, 3.125 + 0.0608), 1e-4), "{position}");
    assert!((slope(DVec2::ZERO).unwrap().point_m - position).dot(normal) + 0.076 < 1e-4);
    assert_eq!(update.support.normal, normal);
    // Shift: level, regardless of the surface.
    let level = Pointer { level: true, ..pointer(200.0, 0.0) };
    let update = transform.update(level, from_above, slope);
    assert!(update.placement.position_m.abs_diff_eq(DVec3::new(1.5, 0.0, 1.02), 1e-9), "{update:?}");
    // Whole centimetres from the start, projected onto the slope.
    let snapping = Pointer { snaps: true, ..pointer(200.0, 0.0) };
    let position = transform.update(snapping, from_above, slope).placement.position_m;
    assert!(position.abs_diff_eq(DVec3::new(1.45, 0.0, 3.1858 - 0.0044 * 0.75), 2e-4), "{position}");
}

#[test]
fn free_move_with_a_plane_normal_ignores_the_surface_behind() {
    let floor = |px: DVec2| Some(Plane { point_m: DVec3::new(0.01 * px.x, 9.0, 0.0), normal: DVec3::Z });
    let at_px = DVec2::new(100.0, -102.0);
    let hanging = DragState {
        support_points_m: Vec::new(),
        free_plane_normal: Some(DVec3::NEG_Y),
        anchor_px: at_px,
        grip_px: at_px,
        ..start()
    };
    let mut transform = Transform::new(TransformKind::Move, Constraint::Free, hanging);
    // 50 px to the right and 30.04 px up; 1 px is 1 cm.
    let position = transform.update(pointer(150.0, -132.04), from_the_side, floor).placement.position_m;
    assert!(position.abs_diff_eq(DVec3::new(1.5, 0.0, 1.3204), 1e-9), "{position}");
    let snapping = Pointer { snaps: true, ..pointer(150.3, -132.04) };
    let position = transform.update(snapping, from_the_side, floor).placement.position_m;
    assert!(position.abs_diff_eq(DVec3::new(1.5, 0.0, 1.32), 1e-9), "{position}");
    // Shift: the level plane is edge-on from the side, so that the item stays; from above it
    // follows.
    let level = Pointer { level: true, ..pointer(170.0, -102.0) };
    assert_eq!(transform.update(level, from_the_side, floor).placement.position_m, position);
    let position = transform.update(level, from_above, floor).placement.position_m;
    assert!(position.abs_diff_eq(DVec3::new(1.7, 0.0, 1.02), 1e-9), "{position}");
}

#[test]
fn axis_constrained_move_follows_the_pointer_along_the_axis_only() {
    let mut transform = Transform::new(TransformKind::Move, Constraint::Axis { axis: 2, is_local: false }, start());
    let mut side = start();
    side.anchor_px = DVec2::new(100.0, -102.0);
    transform.start = side;
    let update = transform.update(pointer(180.0, -25.04), from_the_side, NO_DEPTH);
    // 25.04 px above the grip.
    assert!(update.placement.position_m.abs_diff_eq(DVec3::new(1.0, 0.0, 1.2704), 1e-9), "{update:?}");
    assert_eq!(status(&transform), "Move along z: 25.04 cm");
    // A view along the axis: the item stays.
    let same = transform.update(pointer(300.0, 0.0), from_above, NO_DEPTH);
    assert_eq!(same.placement, update.placement);
    // The plane of x and z: from the side y does not move.
    transform.toggle_constraint(1, true);
    assert_eq!(transform.constraint, Constraint::Plane { axis: 1, is_local: false });
    let update = transform.update(pointer(160.0, -20.0), from_the_side, NO_DEPTH);
    assert!(update.placement.position_m.abs_diff_eq(DVec3::new(1.1, 0.0, 1.22), 1e-9), "{update:?}");
}

#[test]
fn turn_follows_the_pointer_on_screen_or_on_the_ring() {
    let mut transform = Transform::new(TransformKind::Turn, Constraint::Free, start());
    let mut turned = |x: f64, y: f64, snaps| {
        let update = transform.update(Pointer { snaps, ..pointer(x, y) }, from_above, NO_DEPTH);
        update.placement.heading_deg - 90.0
    };
    // From the right over the top to the left and on to below: 90°, 180°, 270°.
    assert!((turned(100.0, -50.0, false) - 90.0).abs() < 1e-9);
    assert!((turned(50.0, -1e-6, false).abs() - 90.0).abs() < 1e-9 || turned(50.0, -1e-6, false).abs() < 360.0);
    turned(100.0, 50.0, false);
    let steps = Pointer { snaps: true, ..pointer(104.0, 50.0) };
    transform.update(steps, from_above, NO_DEPTH);
    assert_eq!((history(&transform), status(&transform)), ("turned 275°".to_owned(), "Turn about up: 275°".to_owned()));
    // From below the same motion of the pointer turns the other way.
    let from_below = |px: DVec2| Some(ViewRay { origin_m: DVec3::new(px.x, px.y, -9.0), direction: DVec3::Z });
    let mut below = Transform::new(TransformKind::Turn, Constraint::Free, start());
    below.update(pointer(100.0, -50.0), from_below, NO_DEPTH);
    assert_eq!(status(&below), "Turn about up: -90°");
    // On a ring seen at 30°, 50 px to the right and 25 px up are 45°.
    let sin = 0.5f64;
    let oblique = |px: DVec2| {
        let direction = DVec3::new(0.0, 0.75f64.sqrt(), -sin);
        let up = DVec3::new(0.0, sin, 0.75f64.sqrt());
        let middle = DVec3::new(1.0, 0.0, 1.02) - 5.0 * direction;
        Some(ViewRay { origin_m: middle + 0.01 * (DVec3::X * (px.x - 100.0) - up * px.y), direction })
    };
    let mut ring = Transform::new(TransformKind::Turn, Constraint::Free, start()).on_ring();
    ring.update(pointer(150.0, -25.0), oblique, NO_DEPTH);
    assert_eq!(status(&ring), "Turn about up: 45°");
    // A typed turn about the world's x: the heading stays.
    ring.toggle_constraint(0, false);
    typed(&mut ring, "45");
    let placement = ring.update(pointer(0.0, 0.0), oblique, NO_DEPTH).placement;
    assert_eq!((placement.heading_deg, status(&ring).as_str()), (90.0, "Turn about x: [45]  45°"));
    let heading = DQuat::from_rotation_z(90f64.to_radians());
    let whole = heading * placement.rotation * DVec3::Y;
    // The local y was the world's −x, which the turn leaves; the local x rises.
    assert!(whole.abs_diff_eq(DVec3::NEG_X, 1e-9), "{whole}");
    let rises = heading * placement.rotation * DVec3::X;
    assert!(rises.abs_diff_eq(DVec3::new(0.0, 0.5f64.sqrt(), 0.5f64.sqrt()), 1e-9), "{rises}");
}

#[test]
fn scale_factor_is_the_ratio_of_pointer_distances() {
    let mut transform = Transform::new(TransformKind::Scale, Constraint::Free, start());
    let size = |transform: &mut Transform, x: f64, snaps| {
        transform.update(Pointer { snaps, ..pointer(x, 0.0) }, from_above, NO_DEPTH).placement.size
    };
    assert_eq!(size(&mut transform, 200.0, false), Size::Scale(DVec3::splat(2.0)));
    assert_eq!(size(&mut transform, 161.0, true), Size::Scale(DVec3::splat(1.2)));
    assert_eq!(
        (history(&transform), size(&mut transform, 100.0, false)),
        ("scaled to 120 %".into(), Size::Scale(DVec3::splat(MIN_DRAG_FACTOR)))
    );
    transform.toggle_constraint(1, false);
    typed(&mut transform, "50%");
    assert_eq!(size(&mut transform, 0.0, false), Size::Scale(DVec3::new(1.0, 0.5, 1.0)));
    assert_eq!(status(&transform), "Scale along its own y: [50%]  50 %");
}
