//! Analyses of footage compared with the known truth. One file, because the tests share the footage
//! and its analyses.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use crate::common;
use glam::DVec3;

use crate::footage::{
    analysed, analysed_by_tier, demo_by_tier, demo_track, median_and_p90, opened, pair_errors_px, regressions,
};
use crate::program::{locard, stdout_of};
use crate::tier::{any_scene, fast_or_full, is_full, no_shadows};
use locard::analyse::{Analysis, default_folder};
use locard::camera::{Camera, CameraExposure};
use locard::compositor::ExposureTime;
use locard::frame::{Frame, FrameExposure, SURFEL_SPACING_M, Surfel};
use locard::params::Value;
use locard::recording::{OpenOptions, Recording};
use locard::shot::{AnalysisChoice, Shot, ShotOptions};
use locard::simulate::Flaws;
use locard::tracking::PoseTrack;

/// Flaws of a tracker whose clock is ahead of the pictures' clock by this time.
pub fn late(poses_later_s: f64) -> Flaws {
    Flaws { poses_later_s, ..Flaws::default() }
}

// Slow: the spread of edges needs pictures of full size.
#[test]
fn exact_poses_are_kept_and_steady_light_is_not_followed() {
    let folder = demo_by_tier(fast_or_full(13, 24), &Flaws::default(), 1);
    let shot = opened(&folder);
    let analysis = analysed_by_tier(&shot, 2);
    println!("{}", analysis.findings);
    assert_eq!((analysis.findings.registration.poses.as_str(), &analysis.track), ("right", &None));
    assert!(analysis.gains.is_empty());
    // The demonstration has no blur in focus (docs/calibration.md: 0 to 0.12 px).
    let spread = analysis.findings.spread.as_ref().unwrap();
    assert!(spread.sigma_px.unwrap() < 0.15 && spread.edges.unwrap() >= 40, "{spread:?}");
    assert_eq!(analysis.findings.camera, shot.geometry_at(0).unwrap(), "the readout too");
    // Rendering with the refinement has the same bits as without.
    let refined = analysis.refinement(Some(0.1));
    assert!(refined.track.is_none() && refined.depth_later_s == 0.0 && refined.brightness.is_empty());
    // The floor is z = 0, and the largest surface.
    let surfels = &refined.surfels;
    let is_floor = |surfel: &&Surfel| surfel.position_m.z.abs() < 0.005 && surfel.normal.z > 0.99;
    let (floor, m2) = (surfels.iter().filter(is_floor).count(), SURFEL_SPACING_M.powi(2));
    assert!(floor as f64 * m2 > 1.0 && 3 * floor > surfels.len(), "{floor} of {}", surfels.len());
    // Few neighbours of these frames differ in their motion.
    let shutter = analysis.findings.shutter.as_ref().unwrap();
    assert!(shutter.runs.is_empty() && shutter.why.as_ref().unwrap().contains("determine it clearly"), "{shutter:?}");
    assert!(refined.blur_estimate_s.is_empty());
}

/// Asserts that the findings other than the registration are used with the recorded poses.
fn assert_findings_used_without_registration(site: &Path) {
    let shot = |analysis: AnalysisChoice, recorded_poses: bool| {
        Shot::open(site, &OpenOptions::default(), &ShotOptions { analysis, recorded_poses, ..ShotOptions::default() })
            .unwrap()
    };
    let (analysed, recorded) = (shot(AnalysisChoice::Beside, false), shot(AnalysisChoice::No, false));
    let left = shot(AnalysisChoice::Beside, true);
    let pose = |shot: &Shot| shot.recording.pose_at_frame(2).unwrap();
    assert!(pose(&left) == pose(&recorded) && pose(&left) != pose(&analysed));
    let readout_s = |shot: &Shot| shot.known_geometry_at(2).unwrap().intrinsics.readout_time_s;
    assert_eq!(readout_s(&left), readout_s(&recorded));
    assert_eq!(left.recording.exposure, analysed.recording.exposure);
    let surfels = |shot: &Shot| shot.read(2).unwrap().surfels.len();
    assert!(surfels(&analysed) > 1000 && surfels(&left) == 0, "they lie where the refined poses put them");
    let picture = |more: &[&str]| {
        let out = tempfile::tempdir().unwrap();
        let at = out.path().join("out");
        let all = ["composite", site.to_str().unwrap(), "--scene", any_scene(), "--frames", "2..3", "-o"];
        let output = locard(&[&all[..], &[at.to_str().unwrap()], no_shadows(), more].concat());
        assert!(output.status.success() && !String::from_utf8_lossy(&output.stderr).contains("changes nothing"));
        std::fs::read(at.join("frame_000002.png")).unwrap()
    };
    assert!(picture(&["--without", "registration"]) != picture(&[]));
}

// Slow: the claimed precision needs forty frames.
#[test]
fn jitter_drift_clock_offset_and_hand_eye_rotation_are_found() {
    let wrong = Flaws {
        jitter_mm: 1.0,
        jitter_deg: 0.1,
        drift_mm: 20.0,
        drift_deg: 1.0,
        hand_eye_mm: 10.0,
        hand_eye_deg: 1.1,
        ..late(0.015)
    };
    let folder = demo_by_tier(40, &wrong, 2);
    let shot = opened(&folder);
    let analysis = analysed_by_tier(&shot, 2);
    println!("{}", analysis.findings);
    analysis.write(&default_folder(&folder.path().join("site")), &shot.recording).unwrap();
    assert_findings_used_without_registration(&folder.path().join("site"));
    let registered = &analysis.findings.registration;
    let off = |track: &PoseTrack| pair_errors_px(&shot, &demo_track(), track, 8);
    let [by_recorded, by_refined] = [&shot.recording.track, analysis.track.as_ref().unwrap()].map(off);
    let (recorded, refined) = (median_and_p90(&by_recorded), median_and_p90(&by_refined));
    let (share, largest_px) = regressions(&by_recorded, &by_refined);
    println!(
        "gap 8: recorded {recorded:.2?} px, refined {refined:.3?} px; {share} got worse, by {largest_px:.2} px at most"
    );
    assert!(recorded.0 > fast_or_full(1.0, 2.0), "{recorded:?} of pictures half as wide");
    assert!(refined.0 <= 0.15 && refined.1 <= 0.35, "{refined:?}");
    assert!(share <= 0.05 && largest_px <= 0.5, "{share} {largest_px}");
    assert!((registered.clock_s.unwrap() - 0.015).abs() <= 0.002, "{registered:?}");
    assert!((analysis.findings.camera.intrinsics.readout_time_s - 0.015).abs() <= 0.002);
    assert_eq!(registered.depth_later_s, 0.0);

    // Identical for any number of threads, byte for byte, and after reading back.
    let files = analysis.files(&shot.recording).unwrap();
    let out = folder.path().join("found");
    std::fs::create_dir(&out).unwrap();
    for (name, text) in &files {
        std::fs::write(out.join(name), text).unwrap();
    }
    let back = Analysis::read(&out).unwrap();
    assert!(back == analysis);
    back.fits(&shot.recording, &shot.geometry_at(0).unwrap()).unwrap();
    // The exposure is estimated by the blur. It was 1/60 s, as recorded, and the recorded value
    // takes precedence.
    let shutter = analysis.findings.shutter.as_ref().unwrap();
    assert_eq!((shutter.runs.len(), &shutter.why), (1, &None));
    assert!((60.0 * shutter.runs[0].exposure_s - 1.0).abs() < 0.05, "{shutter:?}");
    let mut recording = Recording::clone(&shot.recording);
    recording.refine(&analysis.refinement(Some(0.1)));
    let frame = recording.frames(5..6).unwrap().next().unwrap().unwrap();
    assert_eq!(frame.exposure.blur_estimate_s, Some(shutter.runs[0].exposure_s));
    let (camera, settings) = (shot.camera(), shot.settings.clone());
    assert_eq!(ExposureTime::of_frame(&camera, &settings, &frame.exposure, 0.1).s, 1.0 / 60.0);
    // Order of precedence: the recording's, the camera's, the estimated one, half the interval of
    // at most 1/60 s.
    let mut frame = Frame { exposure: FrameExposure { time_s: None, ..frame.exposure }, ..frame };
    let mut unexposed = camera.clone();
    (unexposed.exposure.time_s, unexposed.exposure.shutter_angle_deg) = (None, None);
    let exposed = |time_s| Camera { exposure: CameraExposure { time_s, ..unexposed.exposure }, ..unexposed.clone() };
    assert_eq!(ExposureTime::of_frame(&exposed(Some(0.002)), &settings, &frame.exposure, 0.1).s, 0.002);
    assert_eq!(ExposureTime::of_frame(&unexposed, &settings, &frame.exposure, 0.1).s, shutter.runs[0].exposure_s);
    frame.exposure.blur_estimate_s = None;
    assert_eq!(ExposureTime::of_frame(&unexposed, &settings, &frame.exposure, 0.02).s, 0.01);
    assert_eq!(ExposureTime::of_frame(&unexposed, &settings, &frame.exposure, 0.1).s, 1.0 / 60.0);
}

#[test]
fn poses_of_another_recording_are_refused() {
    let folder = demo_by_tier(16, &Flaws::default(), 4);
    let site = folder.path().join("site");
    let refused = |sets: &[&str]| {
        let sets = sets.iter().map(|set| (*set).to_owned()).collect();
        let options = ShotOptions { sets, ..ShotOptions::default() };
        let analysis = analysed_by_tier(&Shot::open(&site, &OpenOptions::default(), &options).unwrap(), 2);
        assert!(analysis.track.is_none(), "{}", analysis.findings);
        analysis.findings.registration.why.unwrap_or_default()
    };
    let why = refused(&["camera.fx_px=640", "camera.fy_px=640"]);
    assert!(why.contains("focal length"), "{why}");
    // The same path half a second later.
    let later = demo_by_tier(16, &late(-0.5), 4);
    let analysis = analysed_by_tier(&opened(&later), 2);
    assert!(analysis.track.is_none() && analysis.findings.gain.is_none(), "{}", analysis.findings);
    let why = analysis.findings.registration.why.unwrap();
    assert!(why.contains("from its recorded position"), "{why}");
}

/// Removes the depth from a recording, and multiplies each frame's light by `gain` per colour.
fn without_depth(folder: &tempfile::TempDir, gain: impl Fn(usize) -> [f64; 3]) {
    let site = folder.path().join("site");
    let response = opened(folder).camera().response.clone();
    let list = std::fs::read_to_string(site.join("rgb.txt")).unwrap();
    for (n, line) in list.lines().filter(|line| !line.starts_with('#')).enumerate() {
        let file = site.join(line.split(' ').nth(1).unwrap());
        let mut picture = image::open(&file).unwrap().to_rgb8();
        for pixel in picture.pixels_mut() {
            for (code, gain) in pixel.0.iter_mut().zip(gain(n)) {
                let light = gain * response.decode(f64::from(*code) / 255.0);
                *code = (255.0 * response.encode(light.min(1.0))).round().clamp(0.0, 255.0) as u8;
            }
        }
        picture.save(&file).unwrap();
    }
    let toml = std::fs::read_to_string(site.join("recording.toml")).unwrap();
    let without = toml.replace("[depth]\nlist = \"depth.txt\"\nscale = 250.0\n", "");
    assert!(without.len() < toml.len());
    std::fs::write(site.join("recording.toml"), without).unwrap();
    std::fs::remove_dir_all(site.join("depth")).unwrap();
    std::fs::remove_file(site.join("depth.txt")).unwrap();
}

// Slow: depth from pictures takes 0.3 s a frame, and the spread needs full size.
#[test]
fn light_and_sharpness_are_found_without_depth() {
    let frames = fast_or_full(12, 24);
    let gain = |n: usize| {
        let stops = 0.6 * (0.4 * n as f64).sin() - if n > frames / 2 { 0.5 } else { 0.0 };
        [stops.exp2(), stops.exp2(), (stops + 0.01 * n as f64).exp2()]
    };
    let folder = demo_by_tier(frames, &Flaws::default(), 1);
    without_depth(&folder, gain);
    let shot = opened(&folder);
    let analysis = analysed_by_tier(&shot, 2);
    println!("{}", analysis.findings);
    assert_eq!((analysis.findings.registration.poses.as_str(), &analysis.track), ("kept", &None));
    // Relative to the median frame, which is 1.
    let mut off = Vec::new();
    for c in 0..3 {
        let mut all: Vec<f64> = (0..frames).map(|n| gain(n)[c].ln()).collect();
        all.sort_by(f64::total_cmp);
        off.extend((0..frames).map(|n| analysis.gains[n][c].ln() - (gain(n)[c].ln() - all[frames / 2])));
    }
    let rms = (off.iter().map(|o| o * o).sum::<f64>() / off.len() as f64).sqrt();
    assert!(rms < 0.012, "{rms}: {off:.3?}");
    let spread = analysis.findings.spread.as_ref().unwrap();
    assert!(spread.sigma_px.unwrap() < 0.2, "{spread:?}");
    // With the poses of another site, no pair matches.
    let other = demo_by_tier(frames, &late(1.1), 4);
    without_depth(&other, gain);
    let analysis = analysed_by_tier(&opened(&other), 2);
    println!("{}", analysis.findings);
    assert!(analysis.gains.is_empty() || analysis.findings.gain.unwrap().left < 0.03);
}

/// RMS error of the projected motion within ±10 ms of each frame, for points in front of the
/// camera, px.
fn motion_off_px(shot: &Shot, truth: &PoseTrack, track: &PoseTrack) -> f64 {
    let camera = shot.geometry_at(0).unwrap();
    let way = |track: &PoseTrack, time_s: f64, place: DVec3| {
        let world = track.at(time_s).unwrap().inverse_transform_point(place);
        let projected = |by_s: f64| camera.project(track.at(time_s + by_s).unwrap().transform_point(world)).unwrap();
        projected(0.01) - projected(-0.01)
    };
    let places = [DVec3::new(0.0, 0.0, 1.2), DVec3::new(0.4, 0.2, 1.2), DVec3::new(-0.4, -0.2, 1.2)];
    let times_s = &shot.recording.timestamps_s[1..shot.recording.frame_count() - 1];
    let off = |t: &f64| places.map(|place| (way(track, *t, place) - way(truth, *t, place)).length_squared());
    let all: Vec<f64> = times_s.iter().flat_map(off).collect();
    (all.iter().sum::<f64>() / all.len() as f64).sqrt()
}

// Slow: depth from pictures takes 0.3 s a frame.
#[test]
fn motion_without_depth_is_refined_at_the_recorded_position() {
    let folder = demo_by_tier(fast_or_full(14, 20), &Flaws { jitter_mm: 1.0, jitter_deg: 0.1, ..Flaws::default() }, 2);
    without_depth(&folder, |_| [1.0; 3]);
    let shot = opened(&folder);
    let analysis = analysed_by_tier(&shot, 2);
    println!("{}", analysis.findings);
    let registered = &analysis.findings.registration;
    // The fast tier's pictures are half as wide, and so are motions in px.
    assert!(
        registered.poses == "kept"
            && registered.motion_px.unwrap() > fast_or_full(0.25, 0.5)
            && analysis.refined().is_none()
    );
    let (recorded, track) = (&shot.recording.track, analysis.track.as_ref().unwrap());
    for time_s in shot.recording.timestamps_s.iter() {
        let (was, is) = (recorded.at(*time_s).unwrap(), track.at(*time_s).unwrap());
        assert!((was.position_in_world_m() - is.position_in_world_m()).length() < 1e-9, "{time_s}");
        assert!(was.rotation.angle_between(is.rotation) < 1e-7, "{time_s}");
    }
    let truth = demo_track();
    let [by_poses, by_pictures] = [recorded, track].map(|track| motion_off_px(&shot, &truth, track));
    println!("motion within 20 ms: {by_poses:.2} px off by the poses, {by_pictures:.2} by the pictures");
    assert!(by_poses > fast_or_full(0.4, 1.0) && by_pictures < 0.3 * by_poses, "{by_poses} {by_pictures}");
}

#[test]
fn analysis_is_independent_of_the_thread_count() {
    // Neither count fills the last batch.
    let folder = demo_by_tier(13, &late(0.01), 4);
    let shot = opened(&folder);
    let files = |threads| analysed_by_tier(&shot, threads).files(&shot.recording).unwrap();
    assert_eq!(files(1), files(3));
}

/// A Kinect's recording with its profile, and its analysis; `None` without the real recordings.
pub fn kinect() -> Option<(Shot, &'static Analysis)> {
    // Shared by two tests: it takes a minute.
    static FOUND: OnceLock<Analysis> = OnceLock::new();
    let folder = common::data("tum-fr1-rpy")?;
    let options = ShotOptions { profile: Some(PathBuf::from("profiles/tum-fr1.toml")), ..ShotOptions::default() };
    let shot = Shot::open(&folder, &OpenOptions::default(), &options).unwrap();
    let analysis = FOUND.get_or_init(|| analysed(&shot, 2));
    Some((shot, analysis))
}

#[test]
#[ignore = "full tier: 90 frames of a real recording; first_kinect_frames_are_refined is its small form"]
fn kinect_poses_are_refined_and_its_gain_is_followed() {
    let Some((_, analysis)) = kinect() else { return };
    println!("{}", analysis.findings);
    let registered = &analysis.findings.registration;
    assert_eq!(registered.poses, "refined");
    // Known for this camera by another program: −5 ms, 25 ms, −1.1° and −0.5°.
    assert!((registered.clock_s.unwrap() + 0.005).abs() < 0.002);
    assert!((analysis.findings.camera.intrinsics.readout_time_s - 0.025).abs() < 0.002);
    let turn = registered.hand_eye_turn_deg.unwrap();
    assert!((turn[0] + 1.1).abs() < 0.2 && (turn[1] + 0.5).abs() < 0.2, "{turn:?}");
    assert!(registered.recorded_px.unwrap() > 2.0 && registered.refined_px.unwrap() < 0.2);
    let gain = analysis.findings.gain.as_ref().unwrap();
    assert!(gain.is_followed && gain.left < 0.011 && gain.range_ev > 1.0 && gain.range_ev < 1.6, "{gain:?}");
    // The lamps flicker at 100 Hz, and the exposure is two of their periods.
    let shutter = analysis.findings.shutter.as_ref().unwrap();
    assert!(shutter.runs.len() == 1 && (shutter.runs[0].exposure_s - 0.020).abs() < 0.001, "{shutter:?}");
    // By hand 0.50 and 0.51 ± 0.03 px (docs/calibration.md), by another program 0.49.
    let spread = analysis.findings.spread.as_ref().unwrap();
    assert!((spread.sigma_px.unwrap() - 0.49).abs() < 0.07, "{spread:?}");
    // An office by day under rows of lamps: no single lamp is observable.
    let light = analysis.findings.light.as_ref().unwrap();
    assert!(light.claimed && light.lamps.is_empty() && light.no_lamp.is_some(), "{light:?}");
    // White paper in four frames shows 1.06, 0.99 and 1.11 times 0.8, by its codes and the frames'
    // gains.
    let mut by_paper =
        light.white_level.unwrap().into_iter().zip([1.06, 0.99, 1.11]).map(|(white, paper)| white / paper);
    assert!(by_paper.all(|ratio| (ratio - 1.0).abs() < 0.11), "{light:?}");
}

#[test]
#[ignore = "full tier: 90 frames of a real recording; clipped_desk_follows_the_exposure_within_its_bounds is its small form"]
fn white_of_clipped_paper_on_a_kitchen_table_is_claimed() {
    let Some(folder) = common::data("redkitchen") else { return };
    let shot = Shot::open(&folder, &OpenOptions::default(), &ShotOptions::default()).unwrap();
    let light = analysed(&shot, 2).findings.light.unwrap();
    println!("{light:?}");
    // Four fifths of the paper are clipped in frames of 0.94 times the usual brightness: white
    // shows 1.29, 1.32, 1.33 or more. The carpet, which is larger than the table, has nothing white
    // on it.
    assert!(light.claimed && light.guessed_up && light.lamps.is_empty(), "{light:?}");
    assert!(light.white_level.unwrap().iter().all(|white| (1.2..1.7).contains(white)), "{light:?}");
}

/// The first ten of the 90 frames, without the light of the room.
// Slow: a real recording at its full size.
#[test]
fn first_kinect_frames_are_refined() {
    let Some(folder) = common::data("tum-fr1-rpy") else { return };
    let temp = tempfile::tempdir().unwrap();
    first_frames_of_tum(&folder, temp.path(), 10);
    let options = ShotOptions { profile: Some(PathBuf::from("profiles/tum-fr1.toml")), ..ShotOptions::default() };
    let shot = Shot::open(temp.path(), &OpenOptions::default(), &options).unwrap();
    let analysis = analysed_by_tier(&shot, 2);
    println!("{}", analysis.findings);
    let registered = &analysis.findings.registration;
    assert_eq!(registered.poses, "refined");
    // The limits of 90 frames are 0.2 px and ln 0.011. With 16 frames there are few links per
    // frame: 0.27 px of 1.96 and ln 0.025 of 0.415 are reached.
    let [recorded_px, refined_px] = [registered.recorded_px, registered.refined_px].map(Option::unwrap);
    assert!(recorded_px > 1.5 && refined_px < 0.2 * recorded_px, "{recorded_px} {refined_px}");
    let gain = analysis.findings.gain.as_ref().unwrap();
    assert!(gain.is_followed && gain.left < 0.1 * gain.recorded, "{gain:?}");
}

/// Copies the first frames of a recording in the layout of TUM RGB-D, with all of its poses.
fn first_frames_of_tum(from: &Path, to: &Path, frames: usize) {
    for list in ["rgb", "depth"] {
        let text = std::fs::read_to_string(from.join(list).with_extension("txt")).unwrap();
        let is_data = |line: &&str| !line.starts_with('#');
        let lines: Vec<&str> = text.lines().filter(is_data).take(frames).collect();
        std::fs::create_dir(to.join(list)).unwrap();
        for line in &lines {
            let name = line.split(' ').nth(1).unwrap();
            std::fs::copy(from.join(name), to.join(name)).unwrap();
        }
        std::fs::write(to.join(list).with_extension("txt"), lines.join("\n") + "\n").unwrap();
    }
    std::fs::copy(from.join("groundtruth.txt"), to.join("groundtruth.txt")).unwrap();
}

/// Copies a COLMAP text model for reduced pictures: sizes, focal length, principal point and image
/// points are divided.
fn reduced_model(from: &Path, to: &Path, reduction: f64) {
    let text = |name: &str| std::fs::read_to_string(from.join(name)).unwrap();
    let divided = |word: &str| (word.parse::<f64>().unwrap() / reduction).to_string();
    // CAMERA_ID SIMPLE_RADIAL WIDTH HEIGHT f cx cy k
    let camera = |line: &str| {
        let words = line.split(' ').enumerate();
        words.map(|(n, word)| if (2..7).contains(&n) { divided(word) } else { word.to_owned() }).collect::<Vec<_>>()
    };
    // Repeated X Y POINT3D_ID.
    let points = |line: &str| {
        let words = line.split(' ').enumerate();
        words.map(|(n, word)| if n % 3 < 2 { divided(word) } else { word.to_owned() }).collect::<Vec<_>>()
    };
    let is_data = |line: &&str| !line.starts_with('#');
    let cameras: Vec<String> = text("cameras.txt").lines().filter(is_data).map(|line| camera(line).join(" ")).collect();
    let images: Vec<String> = text("images.txt")
        .lines()
        .filter(is_data)
        .enumerate()
        .map(|(n, line)| if n % 2 == 1 { points(line).join(" ") } else { line.to_owned() })
        .collect();
    std::fs::write(to.join("cameras.txt"), cameras.join("\n") + "\n").unwrap();
    std::fs::write(to.join("images.txt"), images.join("\n") + "\n").unwrap();
}

/// Photographs of a door from distant positions, which no plane sweep matches.
// Slow: twelve photographs are decoded, reduced and analysed.
#[test]
fn gain_of_photographs_is_found_by_the_landmarks_of_a_model() {
    let Some(folder) = common::data("lund-door-dslr") else { return };
    let analysis_of = |folder: &Path| {
        let shot = Shot::open(folder, &OpenOptions::default(), &ShotOptions::default()).unwrap();
        let analysis = analysed_by_tier(&shot, 2);
        println!("{}", analysis.findings);
        analysis
    };
    if is_full() {
        // All have f/4.8, 1/125 s, ISO 400.
        let gain = analysis_of(&folder).findings.gain.unwrap();
        assert!(gain.recorded < 0.1, "{gain:?}");
    }
    // One in three has half of the light.
    let temp = tempfile::tempdir().unwrap();
    std::fs::create_dir(temp.path().join("images")).unwrap();
    let reduction = fast_or_full(4, 1);
    reduced_model(&folder.join("colmap"), temp.path(), f64::from(reduction));
    let response = Camera::default().response;
    let half: Vec<u8> = (0..=255u8)
        .map(|code| (255.0 * response.encode(0.5 * response.decode(f64::from(code) / 255.0))).round() as u8)
        .collect();
    let is_darker = |n: usize| n % 3 == 1;
    for n in 0..12 {
        let name = format!("images/DSC_{:04}.JPG", n + 1);
        let mut picture = image::open(folder.join(&name)).unwrap().to_rgb8();
        if reduction > 1 {
            let (width, height) = (picture.width() / reduction, picture.height() / reduction);
            picture = image::imageops::thumbnail(&picture, width, height);
        }
        if is_darker(n) {
            picture.iter_mut().for_each(|code| *code = half[usize::from(*code)]);
        }
        let file = std::fs::File::create(temp.path().join(&name)).unwrap();
        image::codecs::jpeg::JpegEncoder::new_with_quality(file, 95).encode_image(&picture).unwrap();
    }
    let analysis = analysis_of(temp.path());
    assert!(analysis.findings.gain.as_ref().unwrap().is_followed, "{}", analysis.findings);
    for (n, gains) in analysis.gains.iter().enumerate() {
        let expected = if is_darker(n) { 0.5f64 } else { 1.0 };
        assert!((gains[1] / expected).ln().abs() < 0.06, "{n}: {gains:?}");
    }
}

/// The poses end 4 ms after the last picture, on a clock that is 20 ms late.
#[test]
fn late_clock_keeps_all_frames_at_the_end_of_the_poses() {
    let folder = demo_by_tier(13, &late(0.02), 4);
    let last_s = *opened(&folder).recording.timestamps_s.last().unwrap();
    let poses = folder.path().join("site/groundtruth.txt");
    let time_s = |line: &str| line.split(' ').next().unwrap().parse::<f64>().unwrap();
    let text = std::fs::read_to_string(&poses).unwrap();
    let is_kept = |line: &&str| line.starts_with('#') || time_s(line) < last_s + 0.004;
    let lines: Vec<&str> = text.lines().filter(is_kept).collect();
    std::fs::write(&poses, lines.join("\n") + "\n").unwrap();
    every_frame_keeps_a_pose(&opened(&folder));
}

fn every_frame_keeps_a_pose(shot: &Shot) {
    let analysis = analysed_by_tier(shot, 2);
    println!("{}", analysis.findings);
    let track = analysis.track.expect("its poses are refined");
    assert!(analysis.findings.registration.clock_s.unwrap().abs() > 0.001, "the clock is another");
    for time_s in shot.recording.timestamps_s.iter() {
        assert!(track.at(*time_s).is_ok(), "{time_s}");
    }
}

#[test]
#[ignore = "full tier: a real recording; late_clock_keeps_all_frames_at_the_end_of_the_poses is its small form"]
fn clock_offset_beyond_the_last_pose_keeps_all_frames() {
    let Some(folder) = common::data("redkitchen") else { return };
    let temp = tempfile::tempdir().unwrap();
    for n in 0..24 {
        for kind in ["color.jpg", "color.png", "depth.png", "pose.txt"] {
            let name = format!("frame-{n:06}.{kind}");
            if folder.join(&name).exists() {
                std::fs::copy(folder.join(&name), temp.path().join(&name)).unwrap();
            }
        }
    }
    every_frame_keeps_a_pose(&Shot::open(temp.path(), &OpenOptions::default(), &ShotOptions::default()).unwrap());
}

#[test]
fn unset_sharpness_follows_the_footage() {
    let folder = demo_by_tier(3, &Flaws::default(), 4);
    let site = folder.path().join("site");
    let stdout = stdout_of(&["analyse", site.to_str().unwrap()]);
    assert!(stdout.contains("spread     unknown: ") && stdout.contains("40 are needed"), "{stdout}");
    let toml = folder.path().join("site.analysis/analysis.toml");
    let sigma_px = |sets: &[&str]| {
        let options = ShotOptions { sets: sets.iter().map(|&s| s.to_owned()).collect(), ..ShotOptions::default() };
        let shot = Shot::open(&site, &OpenOptions::default(), &options).unwrap();
        let tables = shot.settings.tables();
        match tables.iter().find(|t| t.table() == "point_spread").unwrap().get("sigma_px") {
            Some(Value::Number(px)) => px,
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(sigma_px(&[]), 0.0);
    // A rendered edge of σ = 0.6 measures 0.566 px.
    let text = std::fs::read_to_string(&toml).unwrap();
    std::fs::write(&toml, text.replace("[spread]\n", "[spread]\nsigma_px = 0.566\n")).unwrap();
    assert!((sigma_px(&[]) - 0.6).abs() < 1e-12);
    // A value that equals the default counts as set.
    for message in [0.0, 0.6, 1.0, 2.5] {
        assert_eq!(sigma_px(&[&format!("point_spread.sigma_px={message}")]), message);
    }
    let camera = site.join("camera.toml");
    let profile = std::fs::read_to_string(&camera).unwrap();
    std::fs::write(&camera, profile + "\n[point_spread]\nsigma_px = 0.0\n").unwrap();
    assert_eq!(sigma_px(&[]), 0.0);
}
