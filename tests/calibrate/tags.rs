//! Printed tags: camera poses from photographs of a fully known sheet.

use std::sync::LazyLock;

use crate::sheet::{CAMERA, Camera, CameraPose, Rays, Sheet as Printed};
use crate::tier;
use glam::{DQuat, DVec2, DVec3};
use locard::camera::{Distortion, Geometry, Intrinsics, Response};
use locard::fit::quantile::upper_median;
use locard::pixels::Pixels;
use locard::pose::Pose;
use locard::tags::{
    Board, BoardPose, BoardTracker, Corners, DetectedTag, Detector, Family, LumaCodes, Paper, PoseFailure, Sheet, Tag,
    Track, choose_along, correct_rolling_shutter, extrapolated_pose, picture, solve_pose,
};

static PRINTED: LazyLock<Printed> = LazyLock::new(|| {
    let picture = picture(&Sheet::new(Paper::A4));
    Printed::of(picture.width() as usize, picture.height() as usize, picture.pixels().map(|p| p[0]).collect())
});

fn geometry(camera: &Camera) -> Geometry {
    let Camera { focal_px, centre_px, k1, k2, p1, p2, readout_s } = *camera;
    let intrinsics = Intrinsics {
        fx_px: focal_px,
        fy_px: focal_px,
        cx_px: centre_px.x,
        cy_px: centre_px.y,
        readout_time_s: readout_s,
        ..Intrinsics::default()
    };
    Geometry::new(intrinsics, Distortion { k1, k2, p1, p2, ..Distortion::default() })
}

/// Poses 0.8 m away, increasingly oblique, rolled about their own axis.
fn around(i: u32, count: u32) -> CameraPose {
    let (a, tilt) = (0.7 * f64::from(i), 0.15 + 0.7 * f64::from(i) / f64::from(count));
    let at = 0.8 * DVec3::new(tilt.sin() * a.cos(), tilt.sin() * a.sin(), tilt.cos());
    CameraPose::look_at(at, DVec3::new(0.05 * (1.3 * a).sin(), 0.05 * (0.9 * a).cos(), 0.0), 0.3 * (0.5 * a).sin())
}

/// Error of a pose, mm and degrees.
fn pose_error(pose: &Pose, place: &CameraPose) -> (f64, f64) {
    let turn = pose.world_from_camera_rotation().angle_between(place.quaternion());
    (1e3 * pose.position_in_world_m().distance(place.at_m), turn.to_degrees())
}

#[test]
fn pose_of_a_simulated_camera_is_recovered() {
    let (rays, count) = (Rays::of(&CAMERA), tier::fast_or_full(9, 12));
    let photographs: Vec<Vec<u8>> = (0..count)
        .map(|i| {
            let place = around(i, count);
            PRINTED.photograph_by_rays(&rays, 4, 1.5, i.into(), |_| place)
        })
        .collect();
    let whole = Sheet::new(Paper::A4).board;
    let one = Board { tags: whole.tags[..1].to_vec(), ..whole.clone() };
    // The required accuracy is 2 mm and 0.2° at 0.8 m; a sheet is much better.
    for (board, max_mm, max_deg) in [(whole, 0.5, 0.05), (one, 2.0, 0.2)] {
        let mut searcher = BoardTracker::new(board, geometry(&CAMERA), &Response::default()).unwrap();
        let (mut ways, mut turns, mut normed) = (Vec::new(), Vec::new(), Vec::new());
        for (i, codes) in (0..count).zip(&photographs) {
            let place = around(i, count);
            let sight = searcher.look(&Pixels::from_u8(640, 480, codes.clone()).unwrap()).unwrap().unwrap();
            let (way_mm, turn_deg) = pose_error(&sight.best.pose, &place);
            normed.push(way_mm / (1e3 * sight.best.place_covariance().trace().sqrt()));
            ways.push(way_mm);
            turns.push(turn_deg);
        }
        let [way_mm, turn_deg, normed] = [ways, turns, normed].map(|errors| upper_median(errors).unwrap());
        assert!(way_mm < max_mm && turn_deg < max_deg, "{way_mm:.3} mm, {turn_deg:.4}°");
        // In the median of three dimensions an error is about 0.9 of its deviation; the assumed
        // error of a corner makes deviations larger, not smaller.
        assert!(normed > 0.1 && normed < 1.5, "errors are {normed:.2} deviations");
    }
}

#[test]
fn pose_of_a_rolling_shutter_camera_is_recovered() {
    // The camera moves 0.5 m and turns 40° in a second, with a readout of 25 ms.
    let camera = Camera { readout_s: 0.025, ..CAMERA };
    let at = |t: f64| CameraPose::look_at(DVec3::new(0.2 + 0.5 * t, -0.45, 0.6), DVec3::new(0.7 * t, 0.0, 0.0), 0.1);
    let mut searcher = BoardTracker::new(Sheet::new(Paper::A4).board, geometry(&camera), &Response::default()).unwrap();
    let rays = Rays::of(&camera);
    let mut sights = Vec::new();
    for i in 0..3 {
        let time_s = (f64::from(i) - 1.0) / 30.0;
        let codes = PRINTED.photograph_by_rays(&rays, 4, 0.5, 0, |t| at(time_s + t));
        sights.push((time_s, searcher.look(&Pixels::from_u8(640, 480, codes).unwrap()).unwrap().ok()));
    }
    let chosen = choose_along(&sights);
    let rolled = correct_rolling_shutter(&geometry(&camera), &sights, &chosen);
    let (before_mm, _) = pose_error(&chosen[1].as_ref().unwrap().solved.pose, &at(0.0));
    let (way_mm, turn_deg) = pose_error(&rolled[1].as_ref().unwrap().solved.pose, &at(0.0));
    assert!(before_mm > 2.0, "{before_mm} mm: the rolling shutter does not show");
    assert!(way_mm < 0.7 && turn_deg < 0.07, "{way_mm:.2} mm, {turn_deg:.3}°; before {before_mm:.2} mm");
}

/// A pinhole camera for calculations by hand: 500 px, principal point (320, 240).
fn pinhole() -> Geometry {
    Geometry::new(Intrinsics { fx_px: 500.0, fy_px: 500.0, ..Intrinsics::default() }, Distortion::default())
}

#[test]
fn pose_matches_the_computed_one() {
    // A tag of 0.2 m on the floor, from 1 m above its middle: x to the right, y up in the picture,
    // 50 px to each side.
    let board =
        Board::parse("version = 1\nfamily = \"36h11\"\n[[tags]]\nid = 3\nsize_m = 0.2\ncenter_m = [0, 0]").unwrap();
    let corners = [(270.0, 190.0), (370.0, 190.0), (370.0, 290.0), (270.0, 290.0)].map(DVec2::from);
    let tags = [DetectedTag { id: 3, corners_px: corners }];
    let sight = BoardPose::of(&pinhole(), &board, &tags, &[]).unwrap();
    let pose = sight.best.pose;
    assert!(pose.position_in_world_m().distance(DVec3::new(0.0, 0.0, 1.0)) < 1e-6, "{pose:?}");
    assert!(pose.transform_point(DVec3::new(0.1, 0.2, 0.3)).distance(DVec3::new(0.1, -0.2, 0.7)) < 1e-6, "{pose:?}");
    assert_eq!(sight.other, None);
    // On the wall of the same room: the camera faces +y from 2 m away.
    let wall = Board {
        family: Family::Tag36h11,
        tags: vec![Tag {
            id: 3,
            size_m: 0.4,
            center_m: DVec3::new(1.0, 2.0, 1.5),
            rotation_deg: DVec3::new(90.0, 0.0, 0.0),
        }],
    };
    let pose = BoardPose::of(&pinhole(), &wall, &tags, &[]).unwrap().best.pose;
    assert!(pose.position_in_world_m().distance(DVec3::new(1.0, 0.0, 1.5)) < 1e-6, "{pose:?}");
    assert!(pose.inverse_transform_point(DVec3::Z).distance(DVec3::new(1.0, 1.0, 1.5)) < 1e-6, "{pose:?}");
}

#[test]
fn pose_covariance_matches_the_computed_deviation() {
    // For a tag facing the camera, a shift of τ in x or y moves each corner by 500 τ px, so its σ
    // is σ / (500 √4).
    let geometry = pinhole();
    let corners_m = Sheet::new(Paper::A4).board.tags[0].corners_m().map(|c| c - DVec3::new(-0.0425, 0.085, 0.0));
    let pose = Pose::look_at(DVec3::Z, DVec3::ZERO, DVec3::Y).unwrap();
    // Corners alternately displaced by 0.1 px towards and away from the middle, which no pose
    // explains.
    let corner_px = |i: usize| {
        let at = geometry.project(pose.transform_point(corners_m[i])).unwrap();
        at + (at - DVec2::new(320.0, 240.0)).normalize() * if i.is_multiple_of(2) { 0.1 } else { -0.1 }
    };
    let corners =
        Corners { in_world_m: corners_m.to_vec(), seen_px: (0..4).map(corner_px).collect(), ..Corners::default() };
    let solution = solve_pose(&geometry, &corners, &pose).unwrap();
    let sum_px2 = solution.squares_px2;
    // Eight measurements less six parameters, and the assumed 0.05 px of one corner.
    let sigma_px = ((sum_px2 + 2.0 * 0.05 * 0.05) / (2.0 + 2.0)).sqrt();
    assert!(sum_px2 > 0.01, "{sum_px2}");
    // A rotation of the camera moves the corners as well, so x and y are less certain than by
    // translation alone.
    let alone_m = sigma_px / 1000.0;
    let turned = solution.covariance.fixed_view::<3, 3>(3, 3).into_owned();
    assert!(turned[(0, 0)].sqrt() >= 0.999 * alone_m && turned[(2, 2)] > turned[(0, 0)], "{turned}");
    let information = solution.covariance.try_inverse().unwrap();
    let (x, y) = (information[(3, 3)].sqrt().recip(), information[(4, 4)].sqrt().recip());
    assert!((x / alone_m - 1.0).abs() < 1e-3 && (y / alone_m - 1.0).abs() < 1e-3, "{x} {y} {alone_m}");
}

/// A small distant tag, whose tilt hardly shows in the picture.
fn far_tag() -> Board {
    Board::parse("version = 1\nfamily = \"36h11\"\n[[tags]]\nid = 0\nsize_m = 0.05\ncenter_m = [0, 0]").unwrap()
}

/// The pose of a camera 2 m away at this angle from the tag's normal, and its detection with corner
/// errors.
fn oblique_detection(aside_deg: f64, error_px: f64) -> (Pose, Vec<DetectedTag>) {
    let (s, c) = aside_deg.to_radians().sin_cos();
    let pose = Pose::look_at(2.0 * DVec3::new(s, 0.0, c), DVec3::ZERO, DVec3::Y).unwrap();
    let errors = [DVec2::new(1.0, 0.3), DVec2::new(-0.4, 0.9), DVec2::new(0.6, -1.0), DVec2::new(-0.8, -0.5)];
    let places = far_tag().tags[0].corners_m();
    let corners_px =
        std::array::from_fn(|i| pinhole().project(pose.transform_point(places[i])).unwrap() + error_px * errors[i]);
    (pose, vec![DetectedTag { id: 0, corners_px }])
}

#[test]
fn flat_tag_ambiguity_is_resolved_by_neighbouring_pictures() {
    let sight = |aside_deg: f64, error_px: f64| {
        let (truth, tags) = oblique_detection(aside_deg, error_px);
        (truth, BoardPose::of(&pinhole(), &far_tag(), &tags, &[]).unwrap())
    };
    let far = |pose: &Pose, truth: &Pose| pose.rotation.angle_between(truth.rotation).to_degrees();
    // Tilted by 35° it is 13 px across, and the corners of its two poses differ by less than the
    // detection error.
    let (truth, both) = sight(35.0, 0.1);
    let other = both.other.clone().unwrap();
    let (a, b) = (far(&both.best.pose, &truth), far(&other.pose, &truth));
    assert!(a.min(b) < 12.0 && a.max(b) > 45.0, "{a}° {b}°");
    // Alone it is ambiguous, and reported as such.
    let alone = choose_along(&[(0.0, Some(both.clone()))]);
    assert!(!alone[0].as_ref().unwrap().is_certain);
    // From nearby the picture decides.
    let near = {
        let (pose, _) = oblique_detection(35.0, 0.0);
        let near = Pose::look_at(0.15 * pose.position_in_world_m(), DVec3::ZERO, DVec3::Y).unwrap();
        let corners_px = far_tag().tags[0].corners_m().map(|c| pinhole().project(near.transform_point(c)).unwrap());
        BoardPose::of(&pinhole(), &far_tag(), &[DetectedTag { id: 0, corners_px }], &[]).unwrap()
    };
    assert_eq!(near.other, None);
    // An unambiguous picture resolves those before and after it, in both directions, and through
    // the moment of facing the tag.
    let mut sights = Vec::new();
    let mut truths = Vec::new();
    for i in 0..15 {
        let (truth, mut sight) = sight(35.0 - 5.0 * f64::from(i), 0.02);
        if i == 3 {
            (sight.other, sight.best.pose) = (None, truth);
        }
        sights.push((f64::from(i) / 30.0, Some(sight)));
        truths.push(truth);
    }
    let chosen = choose_along(&sights);
    let worst = chosen.iter().zip(&truths).map(|(chosen, truth)| far(&chosen.as_ref().unwrap().solved.pose, truth));
    let worst = worst.fold(0.0, f64::max);
    assert!(worst < 15.0, "{worst}°");
    assert!(chosen[0].as_ref().unwrap().is_certain && chosen[14].as_ref().unwrap().is_certain);
}

#[test]
fn expected_pose_is_extrapolated_at_constant_velocity() {
    let at = |x: f64, turn: f64| Pose::from_camera_in_world(DVec3::new(x, 0.0, 0.0), DQuat::from_rotation_z(turn));
    let went = [(0.0, at(0.0, 0.0)), (0.1, at(1.0, 0.2))];
    let next = extrapolated_pose(&went, 0.2).unwrap();
    assert!(next.position_in_world_m().distance(DVec3::new(2.0, 0.0, 0.0)) < 1e-9);
    assert!(next.world_from_camera_rotation().angle_between(DQuat::from_rotation_z(0.4)) < 1e-7);
    assert_eq!(extrapolated_pose(&went[..1], 0.2), Some(at(0.0, 0.0)));
    assert_eq!(extrapolated_pose(&went, 1.0), None);
    assert_eq!(extrapolated_pose(&[], 0.0), None);
}

#[test]
fn pictures_without_a_pose_name_the_reason() {
    let (_, tags) = oblique_detection(20.0, 0.0);
    let of = |board: &Board, tags: &[DetectedTag]| BoardPose::of(&pinhole(), board, tags, &[]);
    assert_eq!(of(&far_tag(), &[]), Err(PoseFailure::Nothing));
    let stranger = [DetectedTag { id: 9, ..tags[0].clone() }];
    assert_eq!(of(&far_tag(), &stranger), Err(PoseFailure::NotOnBoard(vec![9])));
    // The sheet's tags, twice as far apart as in the file.
    let sheet = Sheet::new(Paper::A4).board;
    let pose = Pose::look_at(DVec3::new(0.2, -0.3, 0.8), DVec3::ZERO, DVec3::Y).unwrap();
    let tags = sheet.tags.iter().map(|tag| {
        let wide = Tag { center_m: 2.0 * tag.center_m, ..*tag };
        DetectedTag {
            id: tag.id,
            corners_px: wide.corners_m().map(|c| pinhole().project(pose.transform_point(c)).unwrap()),
        }
    });
    let tags: Vec<DetectedTag> = tags.collect();
    let error = of(&sheet, &tags).unwrap_err();
    assert!(matches!(error, PoseFailure::Misfit { .. }), "{error}");
    assert!(error.to_string().starts_with("the tags 0, 1, 2, 3, 4, 5 are not arranged as on the board"), "{error}");
    // Corners that are not finite, or coincide.
    for at in [DVec2::NAN, DVec2::new(300.0, 200.0)] {
        assert!(of(&far_tag(), &[DetectedTag { id: 0, corners_px: [at; 4] }]).is_err());
    }
    // One of six tags is misread: the others decide.
    let mut misread: Vec<DetectedTag> = sheet
        .tags
        .iter()
        .map(|tag| DetectedTag {
            id: tag.id,
            corners_px: tag.corners_m().map(|c| pinhole().project(pose.transform_point(c)).unwrap()),
        })
        .collect();
    misread[2].corners_px = misread[2].corners_px.map(|at| at + DVec2::new(9.0, -4.0));
    let estimated = of(&sheet, &misread).unwrap().best.pose;
    let way_m = estimated.position_in_world_m().distance(pose.position_in_world_m());
    assert!(way_m < 2e-4, "{way_m}");
}

#[test]
fn lost_frames_get_no_poses() {
    let (_, tags) = oblique_detection(35.0, 0.1);
    let sight = BoardPose::of(&pinhole(), &far_tag(), &tags, &[]).unwrap();
    // Frames 2, 3 and 6 are lost; the camera's clock stutters after frame 4.
    let times_s = vec![0.0, 0.1, 0.2, 0.3, 0.4, 0.55, 0.65, 0.75];
    let is_posed = [true, true, false, false, true, true, false, true];
    let sights: Vec<_> =
        times_s.iter().zip(is_posed).map(|(t, is_posed)| (*t, is_posed.then(|| sight.clone()))).collect();
    let frames = choose_along(&sights).into_iter().map(|chosen| chosen.ok_or(PoseFailure::Nothing)).collect();
    let track = Track {
        times_s,
        frames,
        tags: is_posed.iter().map(|is_posed| usize::from(*is_posed)).collect(),
        repeated: Vec::new(),
        smoothed_s: None,
    };
    // 0.15 s between frames 4 and 5, 0.2 s across the shortest gap.
    let gap_s = track.max_gap_s();
    assert!(gap_s > 0.15 && gap_s < 0.2, "{gap_s}");
    assert_eq!(track.unsolved_ranges(), [(2..4, &PoseFailure::Nothing), (6..7, &PoseFailure::Nothing)]);
    assert_eq!(track.doubtful(), [0..2, 4..6, 7..8]);
    let text = track.to_string();
    for line in [
        "poses      5 of 8 frames, from 1.0 tags each in the mean\n",
        "lost       frames 2 to 3 (0.200 to 0.300 s): no tag is seen\n",
        "lost       frame 6 (0.650 s): no tag is seen\n",
        "doubtful   frames 4 to 5 (0.400 to 0.550 s): a flat tag may lean the other way, and no frame nearby decides\n",
    ] {
        assert!(text.contains(line), "{text}");
    }
}

/// A white picture with 36h11 tags, each drawn from its upper left corner with this cell size, px.
fn drawn(tags: &[(u32, [u32; 2], u32)]) -> Pixels {
    drawn_over(tags, |_, _| false)
}

/// [`drawn`] on a partly black ground.
fn drawn_over(tags: &[(u32, [u32; 2], u32)], is_black: impl Fn(u32, u32) -> bool) -> Pixels {
    let (width, height) = (640, 480);
    let ground = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let mut codes: Vec<u8> = ground.flat_map(|(x, y)| [if is_black(x, y) { 0 } else { 255 }; 3]).collect();
    for (id, [left, top], cell) in tags {
        let white = Family::Tag36h11.white_cells(*id).unwrap();
        let side = cell * Family::Tag36h11.cells();
        for (x, y) in (0..side).flat_map(|y| (0..side).map(move |x| (x, y))) {
            if !white.contains(&(x / cell, y / cell)) {
                let at = 3 * ((top + y) * width + left + x) as usize;
                codes[at..at + 3].fill(0);
            }
        }
    }
    Pixels::from_u8(width, height, codes).unwrap()
}

/// A sheet's tags with their ids, 60 px apart, from an upper left corner.
fn sheet_at(left: u32, ids: &[u32]) -> Vec<(u32, [u32; 2], u32)> {
    ids.iter().map(|id| (*id, [left + 85 * (id % 2), 60 + 85 * (id / 2)], 8)).collect()
}

#[test]
fn repeated_tags_are_reported_and_the_others_give_the_pose() {
    let board = || Sheet::new(Paper::A4).board;
    let mut searcher = BoardTracker::new(board(), pinhole(), &Response::default()).unwrap();
    let first = sheet_at(40, &[0, 1, 2, 3, 4, 5]);
    let alone = searcher.look(&drawn(&first)).unwrap().unwrap();
    assert_eq!((alone.tags.len(), alone.repeated.len()), (6, 0));
    let two = [first.clone(), sheet_at(300, &[0, 1, 4, 5])].concat();
    let sight = searcher.look(&drawn(&two)).unwrap().unwrap();
    assert_eq!((sight.tags, sight.repeated), (vec![2, 3], vec![0, 1, 4, 5]));
    let off_m = sight.best.pose.position_in_world_m().distance(alone.best.pose.position_in_world_m());
    assert!(off_m < 0.02, "{off_m}");
    let both = [first, sheet_at(300, &[0, 1, 2, 3, 4, 5])].concat();
    let failure = searcher.look(&drawn(&both)).unwrap().unwrap_err();
    assert_eq!(failure, PoseFailure::Repeated(vec![0, 1, 2, 3, 4, 5]));
    assert!(failure.to_string().starts_with("the tags 0, 1, 2, 3, 4, 5 are detected more than once"), "{failure}");
}

#[test]
fn foreign_tags_do_not_hide_a_small_tag_of_the_board() {
    // On black, with a white border of one pixel. Half the resolution skips the odd columns and
    // rows, and with them the border's left and upper sides: no square remains.
    let [near, rim] = [12, 1].map(|px| move |at: u32, from: u32| (from - px..from + 24 + px).contains(&at));
    let is_black = |x, y| near(x, 300) && near(y, 200) && !(rim(x, 300) && rim(y, 200));
    let picture = drawn_over(&[(24, [300, 200], 3), (85, [20, 20], 14), (144, [460, 300], 14)], is_black);
    let grey = LumaCodes::of(&picture, LumaCodes::table(&Response::default()));
    let mut detector = Detector::new(Family::Tag36h11, 640, 480).unwrap();
    let mut ids = |is_expected: &dyn Fn(u32) -> bool| {
        detector.find(&grey, 1, is_expected).unwrap().tags.iter().map(|tag| tag.id).collect::<Vec<_>>()
    };
    assert_eq!(ids(&|id| id == 85), [85, 144], "at half the resolution");
    assert_eq!(ids(&|id| id == 24), [24, 85, 144]);
}

#[test]
fn board_file_states_its_origin() {
    let text = Sheet::new(Paper::A4).board.to_string();
    assert!(text.contains("the small cross in the middle of the tags, not the middle of the paper"), "{text}");
    assert_eq!(Board::parse(&text).unwrap(), Sheet::new(Paper::A4).board);
}
