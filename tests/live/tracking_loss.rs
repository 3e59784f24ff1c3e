//! Tags missed in a frame or two: evidence stays in place, and is not smeared when they are found
//! again.

use std::path::Path;

use crate::program::stdout_of;
use crate::sheet::{CAMERA, CameraPose, Rays, SIZE, Sheet};
use crate::tier;
use glam::{DVec2, DVec3};
use locard::live::{FrameQueue, Tracking, open_poses};
use locard::pixels::Pixels;
use locard::pose::Pose;
use locard::profile::Rig;

const INTERVAL_S: f64 = 1.0 / 30.0;
/// Half of an exposure of 180°.
const REACH_S: f64 = 0.25 * INTERVAL_S;
/// Beside the sheet and above it.
const EVIDENCE_M: DVec3 = DVec3::new(0.13, 0.04, 0.03);

/// A hand that sways about the sheet: by some two degrees, twice a second.
fn place(time_s: f64) -> CameraPose {
    let sway = |rate: f64, by: f64| by * (rate * time_s).sin();
    let at = DVec3::new(0.30 + sway(7.0, 0.02), -0.42 + sway(5.0, 0.015), 0.60 + sway(6.0, 0.01));
    CameraPose::look_at(at, DVec3::new(sway(12.5, 0.03), sway(10.0, 0.025), 0.0), 0.1 + sway(8.0, 0.03))
}

fn project_evidence(pose: &Pose) -> DVec2 {
    let own = pose.transform_point(EVIDENCE_M);
    CAMERA.project_ray(own.truncate() / own.z)
}

/// A sheet reduced to spots, 12 mm wide, as blurred by shake.
fn smudged(sheet: &Sheet) -> Vec<u8> {
    const SPOT: usize = 142;
    let mut codes = sheet.codes.clone();
    let (w, h) = (sheet.width, sheet.height);
    for (top, left) in (0..h).step_by(SPOT).flat_map(|top| (0..w).step_by(SPOT).map(move |left| (top, left))) {
        let places = || (top..h.min(top + SPOT)).flat_map(|y| (left..w.min(left + SPOT)).map(move |x| y * w + x));
        let sum: usize = places().map(|at| usize::from(sheet.codes[at])).sum();
        let mean = (sum / places().count()) as u8;
        places().for_each(|at| codes[at] = mean);
    }
    codes
}

/// Position errors of the evidence and its opacity, by the number of frames since the last tag, px;
/// and errors of its blur length in the first frame in which tags are found again, px.
#[derive(Debug, Default)]
struct LossMeasurement {
    off_px: [Vec<f64>; 3],
    opacity: [Vec<f64>; 3],
    smear_px: Vec<f64>,
}

fn measure_loss(are_seen: bool) -> LossMeasurement {
    let temp = tempfile::tempdir().unwrap();
    let path = |name: &str| temp.path().join(name).to_str().unwrap().to_owned();
    stdout_of(&["board", "-o", &path("board.png"), "--quiet"]);
    let printed = image::open(path("board.png")).unwrap().into_luma8();
    let (width, height) = (printed.width() as usize, printed.height() as usize);
    let sheet = Sheet::of(width, height, printed.into_raw());
    let hidden = if are_seen {
        smudged(&sheet)
    } else {
        // Only the table.
        vec![97; width * height]
    };
    let (hidden, rays) = (Sheet::of(width, height, hidden), Rays::of(&CAMERA));
    std::fs::write(path("camera.toml"), CAMERA.profile()).unwrap();
    let camera = Rig::of_file(Path::new(&path("camera.toml"))).unwrap().camera();
    let mut source = open_poses(&format!("tags:{}", path("board.toml")), Some(&camera), None).unwrap();
    let mut w = FrameQueue::new(source.max_gap_s(), 0.0);
    let (mut measured, mut since) = (LossMeasurement::default(), 0);
    for i in 0..tier::fast_or_full(20u32, 60) {
        let time_s = INTERVAL_S * f64::from(i);
        // Missed in two frames of ten.
        let is_missed = matches!(i % 10, 5 | 6);
        let of = if is_missed { &hidden } else { &sheet };
        let codes = of.photograph_by_rays(&rays, tier::fast_or_full(2, 3), 1.0, u64::from(i), |t| place(time_s + t));
        source.add_picture(time_s, &Pixels::from_u8(SIZE.0, SIZE.1, codes).unwrap());
        w.push_frame(i, time_s, (REACH_S, REACH_S), time_s);
        source.take_poses(time_s).unwrap().iter().for_each(|(time_s, pose)| _ = w.add_pose(*time_s, pose));
        source.take_dead_reckoned().iter().for_each(|(time_s, pose)| w.add_dead_reckoned(*time_s, pose));
        let ready = w.next(time_s).unwrap();
        assert_eq!(ready.tracking == Tracking::Predicted, is_missed, "frame {i}");
        // The board is known from the second picture on.
        if w.track().poses().is_empty() {
            assert_eq!((i, ready.tracking), (0, Tracking::Lost));
            continue;
        }
        let by_track = |t: f64| project_evidence(&w.track().at_or_nearest(t).unwrap());
        let truly = |t: f64| place(t).project(&CAMERA, EVIDENCE_M);
        // The opacity rises at first.
        if i < 10 {
            continue;
        }
        if !is_missed && since > 0 {
            let way =
                |by_track: &dyn Fn(f64) -> DVec2| (by_track(time_s + REACH_S) - by_track(time_s - REACH_S)).length();
            measured.smear_px.push((way(&by_track) - way(&truly)).abs());
        }
        since = if is_missed { since + 1 } else { 0 };
        measured.off_px[since].push(by_track(time_s).distance(truly(time_s)));
        measured.opacity[since].push(ready.opacity);
    }
    measured
}

fn largest(values: &[f64]) -> f64 {
    values.iter().copied().fold(0.0, f64::max)
}

#[test]
fn evidence_stays_in_place_while_tags_are_missed() {
    let measured = measure_loss(true);
    let [tracked, first, second] = [0, 1, 2].map(|n| largest(&measured.off_px[n]));
    println!("{measured:.1?}");
    // By the rotation between pictures: within two pixels. Constant velocity would be off by some
    // ten and thirty.
    assert!(tracked < 1.0 && first < 2.0 && second < 2.5, "{measured:?}");
    assert!(measured.opacity.iter().flatten().all(|share| *share == 1.0), "{measured:?}");
    assert!(largest(&measured.smear_px) < 1.5, "{measured:?}");
}

/// If the picture does not determine the motion, evidence with a wrong position fades, and evidence
/// with a new pose is not smeared.
#[test]
fn evidence_fades_without_poses() {
    let measured = measure_loss(false);
    println!("{measured:.1?}");
    for (off_px, opacity) in measured.off_px[2].iter().zip(&measured.opacity[2]) {
        assert!(*off_px < 10.0 || *opacity < 0.9, "{measured:?}");
    }
    // The change of the motion in between, over half of an exposure; the step itself is some ten
    // pixels.
    assert!(largest(&measured.smear_px) < 4.0, "{measured:?}");
}

/// Tracks pictures of the sheet by a changed board file. Returns the number of poses, and the last
/// reason for a missing one.
fn poses_by(change: impl Fn(&str) -> String, pictures: u32) -> (usize, Option<String>) {
    let temp = tempfile::tempdir().unwrap();
    let path = |name: &str| temp.path().join(name).to_str().unwrap().to_owned();
    stdout_of(&["board", "-o", &path("board.png"), "--quiet"]);
    let printed = image::open(path("board.png")).unwrap().into_luma8();
    let sheet = Sheet::of(printed.width() as usize, printed.height() as usize, printed.into_raw());
    let text = std::fs::read_to_string(path("board.toml")).unwrap();
    let changed = change(&text);
    assert_ne!(text, changed);
    std::fs::write(path("other.toml"), changed).unwrap();
    std::fs::write(path("camera.toml"), CAMERA.profile()).unwrap();
    let camera = Rig::of_file(Path::new(&path("camera.toml"))).unwrap().camera();
    let mut source = open_poses(&format!("tags:{}", path("other.toml")), Some(&camera), None).unwrap();
    let rays = Rays::of(&CAMERA);
    let mut pose_count = 0;
    for i in 0..pictures {
        let time_s = INTERVAL_S * f64::from(i);
        // The camera comes so near that sometimes few tags are in the picture.
        let place = |t: f64| {
            let CameraPose { at_m, axes } = place(t);
            CameraPose { at_m: at_m * if i % 4 == 3 { 0.35 } else { 1.0 }, axes }
        };
        let codes = sheet.photograph_by_rays(&rays, 2, 1.0, u64::from(i), |t| place(time_s + t));
        source.add_picture(time_s, &Pixels::from_u8(SIZE.0, SIZE.1, codes).unwrap());
        pose_count += source.take_poses(time_s).unwrap().len();
    }
    (pose_count, source.no_pose_reason())
}

#[test]
fn board_of_other_sizes_gives_no_pose() {
    let larger = |text: &str| {
        let line = |line: &str| match line.strip_prefix("size_m = ") {
            Some(size_m) => format!("size_m = {}\n", 1.3 * size_m.parse::<f64>().unwrap()),
            None => format!("{line}\n"),
        };
        text.lines().map(line).collect()
    };
    let (pose_count, why) = poses_by(larger, tier::fast_or_full(12, 24));
    assert_eq!(pose_count, 0, "{why:?}");
    assert!(why.unwrap().contains("does the board's file describe this board?"));
}

#[test]
fn other_visible_family_is_named() {
    let (pose_count, why) = poses_by(|text| text.replace("36h11", "25h9"), 3);
    let why = why.unwrap();
    let message = "no tag of family 25h9 is seen; tags of 36h11 are: `family` in the board's file names another";
    assert!(pose_count == 0 && why.contains(message), "{why}");
}
