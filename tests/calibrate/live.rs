//! Automatic collection of views: a simulated hand moves a sheet of tags in front of a camera.

use std::f64::consts::FRAC_PI_2;
use std::path::Path;
use std::process::Command;

use crate::program::{locard, refused};
use crate::random::Random;
use crate::sheet::{CAMERA, CameraPose, Rays, SIZE, Sheet as Printed};
use crate::tier;
use glam::{DMat3, DVec2, DVec3};
use locard::calibrate::board::{BoardDetection, DetectedTarget};
use locard::calibrate::geometry::{LensOptions, MissingViews, PictureEdge, ViewCollector, ViewOutcome};
use locard::tags::{Paper, Sheet, picture};

const FRAME_S: f64 = 1.0 / 30.0;

/// The visible tags of the sheet, detected with errors of 0.1 px.
fn detect(place: &CameraPose, random: &mut Random) -> BoardDetection {
    let (mut board, mut corners_px) = (Vec::new(), Vec::new());
    for tag in Sheet::new(Paper::A4).board.tags {
        let corners = tag.corners_m().map(|corner| place.project(&CAMERA, corner));
        let inside = |at: &DVec2| at.cmpge(DVec2::splat(3.0)).all() && at.cmple(DVec2::new(637.0, 477.0)).all();
        if corners.iter().all(inside) {
            board.extend(tag.corners_m().map(|corner| DVec2::new(corner.x, -corner.y)));
            corners_px.extend(corners.map(|at| at + 0.1 * DVec2::new(random.normal(), random.normal())));
        }
    }
    BoardDetection { board, corners_px, target: DetectedTarget::Tags(6) }
}

/// A camera that points at `beside`·`far` on the sheet from a distance of `far`, tilted to the
/// south. The sheet's far edge is the upper one in the picture, then rolled by `turn`: a quarter
/// turn makes it the left one, two the lower one.
fn leaning(tilt: f64, turn: f64, far: f64, beside: DVec2) -> CameraPose {
    let at = far * DVec3::new(0.0, -tilt.sin(), tilt.cos());
    let target = far * beside.extend(0.0);
    CameraPose::look_at(at + target, target, turn)
}

/// The `n`th resting pose of the hand.
fn rest(n: u32) -> CameraPose {
    let i = f64::from(n);
    let beside = DVec2::new(0.42 * (1.3 * i).sin(), 0.3 * (2.1 * i).cos());
    leaning(0.25 + 0.35 * (0.7 * i).sin().abs(), 2.4 * i, 0.5 + 0.17 * (1.9 * i).sin(), beside)
}

/// Interpolates between two poses.
fn between(a: &CameraPose, b: &CameraPose, t: f64) -> CameraPose {
    let turn = a.quaternion().slerp(b.quaternion(), t);
    CameraPose { at_m: a.at_m.lerp(b.at_m, t), axes: DMat3::from_quat(turn) }
}

fn view_collector(min_views: usize) -> ViewCollector {
    ViewCollector::new(SIZE, min_views, LensOptions::default())
}

#[test]
fn views_are_collected_at_rest_until_none_is_missing() {
    const RESTS: u32 = 60;
    const MOVES: u32 = 8;
    const STAYS: u32 = 5;
    let mut random = Random::new(4);
    let mut taking = view_collector(12);
    let (mut frame, mut rests, mut hints) = (0u32, 0, Vec::new());
    'hand: for n in 0..RESTS {
        rests += 1;
        for i in 0..MOVES + STAYS {
            let place = between(&rest(n), &rest(n + 1), f64::from(i.min(MOVES)) / f64::from(MOVES));
            let look = taking.add(f64::from(frame) * FRAME_S, &frame.to_string(), Some(detect(&place, &mut random)));
            frame += 1;
            // At rest since frame MOVES, which shows in the next one.
            assert!(look != ViewOutcome::Accepted || i > MOVES, "taken {i} frames after it set out");
            hints.extend(taking.hint());
            if taking.missing().is_empty() {
                break 'hand;
            }
        }
    }
    let share = taking.coverage().share();
    println!("{} views of {rests} rests, {share:.2} of the picture", taking.views().len());
    assert_eq!(taking.missing(), [], "after {rests} rests");
    assert!((12..24).contains(&taking.views().len()), "{}", taking.views().len());
    assert!(share > 0.8, "{share}");
    assert!(taking.hint().is_none());
    // The first hint concerns the board's position, later ones any view.
    assert!(hints[0].contains("edge away from the camera"), "{}", hints[0]);
    let calibrated = taking.calibrated().unwrap();
    let of = &calibrated.geometry;
    assert!((of.intrinsics.fx_px / CAMERA.focal_px - 1.0).abs() < 0.01, "{calibrated}");
    assert!((of.distortion.k1 / CAMERA.k1 - 1.0).abs() < 0.1, "{calibrated}");
    assert!(!calibrated.missing.iter().any(|wish| wish.condition_count() > 0), "{calibrated}");
}

/// The limit is a thousandth of the diagonal, 0.8 px, from picture to picture.
#[test]
fn moving_or_single_views_are_not_accepted() {
    for (px, rests) in [(0.3, true), (0.6, true), (1.2, false), (4.0, false), (60.0, false)] {
        let mut random = Random::new(9);
        let mut taking = view_collector(3);
        let whole = leaning(0.3, 1.0, 0.6, DVec2::ZERO);
        let mut looks = Vec::new();
        for frame in 0..4 {
            let mut detection = detect(&whole, &mut random);
            detection.corners_px.iter_mut().for_each(|at| at.x += px * f64::from(frame));
            looks.push(taking.add(f64::from(frame) * FRAME_S, "a", Some(detection)));
        }
        let second = if rests { ViewOutcome::Accepted } else { ViewOutcome::Moving };
        let later = if rests { ViewOutcome::Redundant } else { ViewOutcome::Moving };
        assert_eq!(looks, [ViewOutcome::Moving, second, later, later], "{px} px");
    }
    let mut random = Random::new(9);
    let mut own = view_collector(3);
    let whole = detect(&leaning(0.3, 1.0, 0.6, DVec2::ZERO), &mut random);
    // Lost in between, or a second later: the motion is unknown.
    assert_eq!(own.add(0.0, "a", Some(whole.clone())), ViewOutcome::Moving);
    assert_eq!(own.add(0.1, "b", None), ViewOutcome::NoBoard);
    assert_eq!(own.add(0.2, "c", Some(whole.clone())), ViewOutcome::Moving);
    assert_eq!(own.add(1.2, "d", Some(whole.clone())), ViewOutcome::Moving);
    // A clock that goes back.
    assert_eq!(own.add(0.3, "e", Some(whole.clone())), ViewOutcome::Moving);
    assert_eq!(own.add(0.4, "f", Some(whole.clone())), ViewOutcome::Accepted);
    assert_eq!(own.add(0.5, "g", Some(whole.clone())), ViewOutcome::Redundant);
    assert_eq!((own.views().len(), own.views()[0].name.as_str()), (1, "f"));
    // Too few corners for a view.
    let few = BoardDetection {
        board: whole.board[..4].to_vec(),
        corners_px: whole.corners_px[..4].to_vec(),
        target: whole.target,
    };
    own.add(0.6, "h", Some(few.clone()));
    assert_eq!(own.add(0.7, "i", Some(few)), ViewOutcome::Redundant);
    let none = BoardDetection { board: Vec::new(), corners_px: Vec::new(), target: whole.target };
    own.add(0.8, "j", Some(none.clone()));
    assert_eq!(own.add(0.9, "k", Some(none)), ViewOutcome::Moving);
}

/// Requests the missing views, and accepts no others once there are enough.
#[test]
fn missing_views_are_requested_and_accepted() {
    let mut random = Random::new(2);
    let mut taking = view_collector(4);
    let mut time_s = 0.0;
    let mut show = |taking: &mut ViewCollector, place: &CameraPose| {
        let mut last = ViewOutcome::NoBoard;
        for _ in 0..2 {
            time_s += FRAME_S;
            last = taking.add(time_s, "a", Some(detect(place, &mut random)));
        }
        last
    };
    for (quarter, far) in [(1.0, 0.45), (2.0, 0.6), (3.0, 0.75)] {
        assert_eq!(show(&mut taking, &leaning(0.5, quarter * FRAC_PI_2, far, DVec2::ZERO)), ViewOutcome::Accepted);
    }
    let tilts = taking.missing().iter().find_map(|wish| match wish {
        MissingViews::Tilts(edges) => Some(edges.clone()),
        _ => None,
    });
    assert_eq!(tilts, Some(vec![PictureEdge::Upper]), "{:?}", taking.missing());
    assert!(taking.hint().unwrap().contains("its upper edge away from the camera"), "{:?}", taking.hint());
    assert_eq!(show(&mut taking, &leaning(0.5, 0.0, 0.6, DVec2::ZERO)), ViewOutcome::Accepted);
    // Now the corners: the camera points beside the sheet, which then appears on the other side.
    let hint = taking.hint().unwrap();
    assert!(hint.starts_with("into the picture's ") && hint.contains(" corner"), "{hint}: {:?}", taking.missing());
    let views = taking.views().len();
    for (x, y) in [(-1.0, 1.0), (1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)] {
        show(&mut taking, &leaning(0.1, 0.0, 0.5, DVec2::new(0.38 * x, 0.26 * y)));
    }
    assert!(taking.views().len() > views, "{:?}", taking.missing());
    assert!(!taking.missing().iter().any(|wish| matches!(wish, MissingViews::Corners(_))), "{:?}", taking.missing());
}

/// A video of the hand: rests of more than a second, so that a slow machine samples two pictures of
/// each, and moves in between.
pub fn video(folder: &Path, rests: u32) -> std::path::PathBuf {
    let printed = picture(&Sheet::new(Paper::A4));
    let printed =
        Printed::of(printed.width() as usize, printed.height() as usize, printed.pixels().map(|p| p[0]).collect());
    let rays = Rays::of(&CAMERA);
    let mut bytes = Vec::new();
    for n in 0..rests {
        for i in 0..8 {
            let place = between(&rest(n), &rest(n + 1), f64::from(i.min(2)) / 2.0);
            // In the fast tier a rest is one repeated photograph.
            if i > 2 && !tier::is_full() {
                bytes.extend_from_within(bytes.len() - (3 * SIZE.0 * SIZE.1) as usize..);
                continue;
            }
            bytes.extend(printed.photograph_by_rays(&rays, 2, 1.5, u64::from(8 * n + i), |_| place));
        }
    }
    let (raw, video) = (folder.join("hand.rgb"), folder.join("hand.mkv"));
    std::fs::write(&raw, bytes).unwrap();
    let status = Command::new("ffmpeg")
        .args([
            "-nostdin",
            "-loglevel",
            "error",
            "-f",
            "rawvideo",
            "-pix_fmt",
            "rgb24",
            "-s",
            "640x480",
            "-r",
            "5",
            "-i",
        ])
        .arg(&raw)
        .args(["-c:v", "ffv1", "-pix_fmt", "gbrp"])
        .arg(&video)
        .status();
    assert!(status.unwrap().success());
    video
}

// Slow: the camera plays in real time, and a view counts only at rest.
#[test]
fn program_calibrates_a_live_camera() {
    let folder = tempfile::tempdir().unwrap();
    let video = video(folder.path(), tier::fast_or_full(4, 5));
    let [video, profile] = [video, folder.path().join("mine.toml")].map(|path| path.to_str().unwrap().to_owned());
    let arguments = ["calibrate", "camera", "--camera", &video, "-o", &profile];
    let output = locard(&arguments);
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{stderr}");
    // The rewritten status line fits a terminal of 80 columns.
    assert!(stderr.lines().filter(|line| line.contains(" seen; ")).all(|line| line.chars().count() <= 88), "{stderr}");
    assert!(stderr.contains(" of 20 views, ") && stderr.contains(" % seen; taken; "), "{stderr}");
    let report = String::from_utf8(output.stdout).unwrap();
    assert!(report.contains(" of a board of 6 tags, ") && report.contains("frame "), "{report}");
    let written = std::fs::read_to_string(&profile).unwrap();
    assert!(written.contains("fx_px = 5"), "{written}");
    // Ended too early: it names the missing views, and writes nothing.
    let other = format!("{profile}.other.toml");
    let text = refused(&["calibrate", "camera", "--camera", &video, "--frames", "3", "-o", &other]);
    assert!(text.contains("can be used; 3 with the board tilted differently are needed"), "{text}");
    assert!(!Path::new(&other).exists());
    let text = refused(&["calibrate", "camera", "scenes", "--size", "640x480", "-o", &other]);
    assert!(text.contains("--size is for a camera: name one with --camera"), "{text}");
    let text = refused(&["calibrate", "camera", "scenes", "--camera", &video, "-o", &other]);
    assert!(text.contains("cannot be used with"), "{text}");
    let text = refused(&["calibrate", "camera", "--camera", "none.mp4", "-o", &other]);
    assert!(text.contains("none.mp4: there is no such file"), "{text}");
}
