//! What the footage says of itself, against what is known of it.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod common;
#[path = "common/program.rs"]
mod program;
#[path = "common/random.rs"]
mod random;

use std::path::{Path, PathBuf};

use glam::{DQuat, DVec2, DVec3};
use locard::analyse::{Analysis, Taken, analyse, beside};
use locard::camera::{Camera, CameraExposure, Geometry};
use locard::compositor::exposure_time_s;
use locard::frame::{Frame, FrameExposure};
use locard::params::Value;
use locard::pose::Pose;
use locard::recording::write::{Line, trajectory};
use locard::recording::{OpenOptions, Recording};
use locard::shot::{Given, Shot};
use locard::tracking::PoseTrack;
use program::{locard, refused, said};
use random::Random;

/// The demo's first frames, in a folder of their own; `poses` makes its trajectory from the true one.
fn demo(frames: usize, poses: impl Fn(f64, &Pose) -> (f64, Pose)) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let from = Path::new(env!("CARGO_MANIFEST_DIR")).join("recordings/demo");
    let site = folder.path().join("site");
    for sub in ["rgb", "depth"] {
        std::fs::create_dir_all(site.join(sub)).unwrap();
    }
    for file in ["recording.toml", "camera.toml", "exposure.txt"] {
        std::fs::copy(from.join(file), site.join(file)).unwrap();
    }
    for list in ["rgb.txt", "depth.txt"] {
        let text = std::fs::read_to_string(from.join(list)).unwrap();
        let lines: Vec<&str> = text.lines().take(1 + frames).collect();
        for line in &lines[1..] {
            let picture = line.split(' ').nth(1).unwrap();
            std::fs::copy(from.join(picture), site.join(picture)).unwrap();
        }
        std::fs::write(site.join(list), lines.join("\n") + "\n").unwrap();
    }
    let truth = Recording::open(&from, &OpenOptions::default()).unwrap();
    let line = |(time_s, pose): &(f64, Pose)| {
        let (time_s, pose) = poses(*time_s, pose);
        Line::new(time_s, &pose)
    };
    let lines: Vec<Line> = truth.track.poses().iter().map(line).collect();
    std::fs::write(site.join("groundtruth.txt"), trajectory(&lines)).unwrap();
    folder
}

fn opened(folder: &tempfile::TempDir) -> Shot {
    Shot::open(&folder.path().join("site"), &OpenOptions::default(), &Given::default()).unwrap()
}

fn analysed(shot: &Shot, threads: usize) -> Analysis {
    let camera = shot.geometry_at(0).unwrap();
    let rig = shot.camera();
    let exposure_s = |frame: &Frame| exposure_time_s(&rig, &shot.settings, frame, shot.interval_s(frame.index));
    let taken = Taken { response: &rig.response, noise: rig.noise.as_ref(), exposure_s: &exposure_s };
    analyse(&shot.recording, &camera, &taken, threads, &mut |_, _| Ok(())).unwrap()
}

/// Where a point of one frame lands in another, by a track: each row by its own pose.
fn carried(camera: &Geometry, track: &PoseTrack, from: (f64, DVec2, f64), to_s: f64) -> Option<DVec2> {
    let (from_s, at, depth_m) = from;
    let here = track.at(from_s + camera.row_time_s(at.y)).ok()?;
    let world = here.inverse_transform_point(camera.unproject(at)? * depth_m);
    let mut there = DVec2::new(0.0, 240.0);
    for _ in 0..6 {
        there = camera.project(track.at(to_s + camera.row_time_s(there.y)).ok()?.transform_point(world))?;
    }
    let inside = there.x > 0.0 && there.y > 0.0 && there.x < 640.0 && there.y < 480.0;
    inside.then_some(there)
}

/// How far a track moves things from one frame to the one `gap` later than they do in truth: median and 90 %, px.
fn off_px(shot: &Shot, track: &PoseTrack, gap: usize) -> (f64, f64) {
    let demo = Path::new(env!("CARGO_MANIFEST_DIR")).join("recordings/demo");
    let truth = Recording::open(&demo, &OpenOptions::default()).unwrap().track;
    let (camera, times_s) = (shot.geometry_at(0).unwrap(), &shot.recording.timestamps_s);
    let mut off = Vec::new();
    for n in (0..times_s.len() - gap).step_by(3) {
        let depth = shot.read(n).unwrap().depth.unwrap();
        for at in (0..24 * 32).map(|i| DVec2::new(f64::from(i % 32) * 20.0 + 10.5, f64::from(i / 32) * 20.0 + 10.5)) {
            let z = f64::from(depth.depth_m[at.y as usize * 640 + at.x as usize]);
            let by = |track: &PoseTrack| carried(&camera, track, (times_s[n], at, z), times_s[n + gap]);
            if z > 0.2
                && let (Some(a), Some(b)) = (by(track), by(&truth))
            {
                off.push((a - b).length());
            }
        }
    }
    off.sort_by(f64::total_cmp);
    assert!(off.len() > 1000, "{}", off.len());
    (off[off.len() / 2], off[off.len() * 9 / 10])
}

#[test]
fn exact_poses_are_kept_and_steady_light_is_not_followed() {
    let folder = demo(24, |time_s, pose| (time_s, *pose));
    let shot = opened(&folder);
    let found = analysed(&shot, 2);
    println!("{}", found.findings);
    assert_eq!((found.findings.registration.poses.as_str(), &found.track), ("right", &None));
    assert!(found.gains.is_empty());
    // It has no blur in focus (docs/calibration.md: 0 to 0.12 px).
    let spread = found.findings.spread.as_ref().unwrap();
    assert!(spread.sigma_px.unwrap() < 0.15 && spread.edges.unwrap() >= 40, "{spread:?}");
    assert_eq!(found.findings.camera, shot.geometry_at(0).unwrap(), "the readout too");
    // Whatever is drawn by it has the bits that it has without.
    let refined = found.refinement(Some(0.1));
    assert!(refined.track.is_none() && refined.depth_later_s == 0.0 && refined.seen.is_empty());
    // Few of these frames' neighbours move otherwise.
    let shutter = found.findings.shutter.as_ref().unwrap();
    assert!(shutter.runs.is_empty() && shutter.why.as_ref().unwrap().contains("say it clearly"), "{shutter:?}");
    assert!(refined.blurred_s.is_empty());
}

#[test]
fn jitter_drift_a_late_clock_and_a_turned_camera_are_found() {
    // 1 mm and 0.1° of jitter at 200 Hz, 2 cm and 1° of drift, poses 15 ms late, a camera turned by 1° on what is tracked.
    let draws = std::cell::RefCell::new(Random::new(7));
    let turned = Pose::from_camera_in_world(
        DVec3::new(0.005, -0.004, 0.008),
        DQuat::from_scaled_axis(DVec3::new(-0.0174, -0.0087, 0.0035)),
    );
    let wrong = |time_s: f64, pose: &Pose| {
        let mut draws = draws.borrow_mut();
        let mut jitter = |sigma: f64| DVec3::from_array([0; 3].map(|_| draws.normal())) * sigma / 3f64.sqrt();
        let (way, turn) = (jitter(0.001), jitter(0.1f64.to_radians()));
        let slow = |rate: f64| (rate * time_s + rate).sin();
        let drift = DVec3::new(slow(0.7), slow(1.0), slow(1.3));
        let by = Pose::from_camera_in_world(
            way + 0.02 / 1.7 * drift,
            DQuat::from_scaled_axis(turn + 1f64.to_radians() / 1.7 * DVec3::new(drift.z, drift.x, drift.y)),
        );
        let at = |inner: &Pose, outer: &Pose| {
            let position = outer.inverse_transform_point(inner.position_in_world_m());
            Pose::from_camera_in_world(
                position,
                outer.world_from_camera_rotation() * inner.world_from_camera_rotation(),
            )
        };
        (time_s + 0.015, at(&by, &at(&turned, pose)))
    };
    let folder = demo(40, wrong);
    let shot = opened(&folder);
    let found = analysed(&shot, 2);
    println!("{}", found.findings);
    let registered = &found.findings.registration;
    let recorded = off_px(&shot, &shot.recording.track, 8);
    let refined = off_px(&shot, found.track.as_ref().unwrap(), 8);
    println!("gap 8: recorded {recorded:.2?} px, refined {refined:.3?} px");
    assert!(recorded.0 > 2.0);
    assert!(refined.0 <= 0.15 && refined.1 <= 0.35, "{refined:?}");
    // With full drift at first; the refined poses do not depend on it.
    assert!((registered.clock_s.unwrap() - 0.015).abs() < 0.004, "{registered:?}");
    assert!((found.findings.camera.intrinsics.readout_time_s - 0.015).abs() <= 0.002);
    assert_eq!(registered.depth_later_s, 0.0);

    // The same for any number of threads, byte for byte, and read back as written.
    let files = found.files(&shot.recording).unwrap();
    let out = folder.path().join("found");
    std::fs::create_dir(&out).unwrap();
    for (name, text) in &files {
        std::fs::write(out.join(name), text).unwrap();
    }
    let back = Analysis::read(&out).unwrap();
    assert!(back == found);
    back.fits(&shot.recording, &shot.geometry_at(0).unwrap()).unwrap();
    // The exposure is seen in the blur. It was 1/60 s, and the recording says so, which goes before.
    let shutter = found.findings.shutter.as_ref().unwrap();
    assert_eq!((shutter.runs.len(), &shutter.why), (1, &None));
    assert!((60.0 * shutter.runs[0].exposure_s - 1.0).abs() < 0.05, "{shutter:?}");
    let mut recording = Recording::clone(&shot.recording);
    recording.refine(&found.refinement(Some(0.1)));
    let frame = recording.frames(5..6).unwrap().next().unwrap().unwrap();
    assert_eq!(frame.exposure.blurred_s, Some(shutter.runs[0].exposure_s));
    let (camera, settings) = (shot.camera(), shot.settings.clone());
    assert_eq!(exposure_time_s(&camera, &settings, &frame, 0.1), 1.0 / 60.0);
    // Without the recording's, the camera's; without that, what was seen; without that, half the interval.
    let mut frame = Frame { exposure: FrameExposure { time_s: None, ..frame.exposure }, ..frame };
    let mut unsaid = camera.clone();
    (unsaid.exposure.time_s, unsaid.exposure.shutter_angle_deg) = (None, None);
    let said = |time_s| Camera { exposure: CameraExposure { time_s, ..unsaid.exposure }, ..unsaid.clone() };
    assert_eq!(exposure_time_s(&said(Some(0.002)), &settings, &frame, 0.1), 0.002);
    assert_eq!(exposure_time_s(&unsaid, &settings, &frame, 0.1), shutter.runs[0].exposure_s);
    frame.exposure.blurred_s = None;
    assert_eq!(exposure_time_s(&unsaid, &settings, &frame, 0.1), 0.05);
}

#[test]
fn what_is_not_this_recordings_is_refused_and_not_fitted_away() {
    let folder = demo(16, |time_s, pose| (time_s, *pose));
    let site = folder.path().join("site");
    let refused = |sets: &[&str]| {
        let sets = sets.iter().map(|set| (*set).to_owned()).collect();
        let given = Given { sets, ..Given::default() };
        let found = analysed(&Shot::open(&site, &OpenOptions::default(), &given).unwrap(), 2);
        assert!(found.track.is_none(), "{}", found.findings);
        found.findings.registration.why.unwrap_or_default()
    };
    let why = refused(&["camera.fx_px=640", "camera.fy_px=640"]);
    assert!(why.contains("focal length"), "{why}");
    // The same way half a second later.
    let later = demo(16, |time_s, pose| (time_s - 0.5, *pose));
    let found = analysed(&opened(&later), 2);
    assert!(found.track.is_none() && found.findings.gain.is_none(), "{}", found.findings);
    let why = found.findings.registration.why.unwrap();
    assert!(why.contains("away from where the poses say"), "{why}");
}

#[test]
fn any_number_of_threads_finds_the_same() {
    // Neither count fills the last batch.
    let folder = demo(13, |time_s, pose| (time_s + 0.01, *pose));
    let shot = opened(&folder);
    let files = |threads| analysed(&shot, threads).files(&shot.recording).unwrap();
    assert_eq!(files(1), files(3));
}

#[test]
fn a_kinects_poses_are_refined_and_its_gain_is_followed() {
    let Some(folder) = common::data("tum-fr1-rpy") else { return };
    let given = Given { profile: Some(PathBuf::from("profiles/tum-fr1.toml")), ..Given::default() };
    let shot = Shot::open(&folder, &OpenOptions::default(), &given).unwrap();
    let found = analysed(&shot, 2);
    println!("{}", found.findings);
    let registered = &found.findings.registration;
    assert_eq!(registered.poses, "refined");
    // Known of this camera by another program: −5 ms, 25 ms, −1.1° and −0.5°.
    assert!((registered.clock_s.unwrap() + 0.005).abs() < 0.002);
    assert!((found.findings.camera.intrinsics.readout_time_s - 0.025).abs() < 0.002);
    let turn = registered.hand_eye_turn_deg.unwrap();
    assert!((turn[0] + 1.1).abs() < 0.2 && (turn[1] + 0.5).abs() < 0.2, "{turn:?}");
    assert!(registered.recorded_px.unwrap() > 2.0 && registered.refined_px.unwrap() < 0.2);
    let gain = found.findings.gain.unwrap();
    assert!(gain.is_followed && gain.left < 0.011 && gain.range_ev > 1.0 && gain.range_ev < 1.6, "{gain:?}");
    // Its lamps flicker at 100 Hz, and it exposes for two of their periods.
    let shutter = found.findings.shutter.unwrap();
    assert!(shutter.runs.len() == 1 && (shutter.runs[0].exposure_s - 0.020).abs() < 0.001, "{shutter:?}");
    // By hand 0.50 and 0.51 ± 0.03 px (docs/calibration.md), by another program 0.49.
    let spread = found.findings.spread.unwrap();
    assert!((spread.sigma_px.unwrap() - 0.49).abs() < 0.07, "{spread:?}");
}

#[test]
fn sharpness_follows_the_footage_where_nobody_says_it() {
    let folder = demo(3, |time_s, pose| (time_s, *pose));
    let site = folder.path().join("site");
    let told = said(&["analyse", site.to_str().unwrap()]);
    assert!(told.contains("spread     unknown: ") && told.contains("40 are needed"), "{told}");
    let toml = folder.path().join("site.analysis/analysis.toml");
    let sigma_px = |sets: &[&str]| {
        let given = Given { sets: sets.iter().map(|&s| s.to_owned()).collect(), ..Given::default() };
        let shot = Shot::open(&site, &OpenOptions::default(), &given).unwrap();
        let tables = shot.settings.tables();
        match tables.iter().find(|t| t.table() == "point_spread").unwrap().get("sigma_px") {
            Some(Value::Number(px)) => px,
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(sigma_px(&[]), 0.0);
    // 0.566 px is what a drawn edge measures of 0.6.
    let text = std::fs::read_to_string(&toml).unwrap();
    std::fs::write(&toml, text.replace("[spread]\n", "[spread]\nsigma_px = 0.566\n")).unwrap();
    assert!((sigma_px(&[]) - 0.6).abs() < 1e-12);
    // Who says the default says it, too.
    for said in [0.0, 0.6, 1.0, 2.5] {
        assert_eq!(sigma_px(&[&format!("point_spread.sigma_px={said}")]), said);
    }
    let camera = site.join("camera.toml");
    let profile = std::fs::read_to_string(&camera).unwrap();
    std::fs::write(&camera, profile + "\n[point_spread]\nsigma_px = 0.0\n").unwrap();
    assert_eq!(sigma_px(&[]), 0.0);
}

#[test]
fn what_is_found_lies_beside_the_recording_and_is_used_while_it_fits() {
    let folder = demo(8, |time_s, pose| (time_s + 0.01, *pose));
    let site = folder.path().join("site");
    let path = site.to_str().unwrap();
    let told = said(&["analyse", path]);
    assert!(told.contains("poses      ") && told.contains("readout"), "{told}");
    let analysis = folder.path().join("site.analysis");
    assert_eq!(beside(&site), analysis.canonicalize().unwrap());
    assert_eq!(said(&["inspect", analysis.to_str().unwrap()]), told);
    assert_eq!(said(&["analyse", path]), told, "once is enough");

    let marker = ["--scene", "scenes/demo.toml", "--frames", "2..3", "-o"];
    let composite = |out: &str, more: &[&str]| {
        let out = folder.path().join(out);
        let arguments = [&["composite", path][..], &marker, &[out.to_str().unwrap()], more].concat();
        let done = locard(&arguments);
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        (std::fs::read(out.join("frame_000002.png")).unwrap(), String::from_utf8(done.stderr).unwrap())
    };
    let (by_default, _) = composite("a", &[]);
    let (named, _) = composite("b", &["--analysis", analysis.to_str().unwrap()]);
    let (without, _) = composite("c", &["--no-analysis"]);
    assert!(by_default == named);

    // Another recording in the same place.
    let poses = std::fs::read_to_string(site.join("groundtruth.txt")).unwrap();
    let dropped: String =
        poses.lines().enumerate().filter(|(n, _)| *n != 3).map(|(_, line)| format!("{line}\n")).collect();
    std::fs::write(site.join("groundtruth.txt"), dropped).unwrap();
    let (stale, said) = composite("d", &[]);
    assert!(
        stale == without
            && said.contains("is not used: the recording is another now")
            && said.contains("analyse the recording again"),
        "{said}"
    );
    let named = ["composite", path, "--analysis", analysis.to_str().unwrap()];
    let out = folder.path().join("e");
    let problem = refused(&[&named[..], &marker, &[out.to_str().unwrap()]].concat());
    assert!(problem.contains("the recording is another now"), "{problem}");

    // Half-written, and of another version.
    let toml = analysis.join("analysis.toml");
    let text = std::fs::read_to_string(&toml).unwrap();
    std::fs::write(&toml, text.replace("version = 1", "version = 7")).unwrap();
    assert!(composite("f", &[]).1.contains("version 7; this program makes and reads version 1"));
    std::fs::write(&toml, &text[..text.len() / 2]).unwrap();
    assert!(composite("g", &[]).1.contains("is not used"));
    std::fs::remove_file(&toml).unwrap();
    assert!(composite("h", &[]).1.is_empty());

    // Made first, if that is asked for.
    let (made, _) = composite("i", &["--analyse"]);
    assert!(toml.exists() && made == composite("j", &[]).0);
    std::fs::remove_file(&toml).unwrap();

    // What is no analysis is not written into.
    std::fs::write(analysis.join("mine.txt"), "").unwrap();
    let problem = refused(&["analyse", path]);
    assert!(problem.contains("holds mine.txt, which is no part of an analysis"), "{problem}");
}
