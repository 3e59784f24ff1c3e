//! `locard board` and `locard track`: from the printed sheet to evidence in the video.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::filmed::{AWAY, FPS, FRAMES, Site, place};
use crate::program;
use crate::program::{refused, stdout_of};
use crate::sheet::CAMERA;
use crate::tier;
use glam::DVec3;
use locard::compositor::Settings;
use locard::live::open_poses;
use locard::pose::Pose;
use locard::profile::Rig;
use locard::recording::{OpenOptions, Recording};
use locard::source::video::{Overrides, probe};
use locard::tracking::covariance::Covariance;
use locard::tracking::smooth::smooth_poses;
use locard::tracking::tum::Line;

fn strs(arguments: &[String]) -> Vec<&str> {
    arguments.iter().map(String::as_str).collect()
}

/// Centroid, mean and number of the differing pixels of two pictures.
fn differs(a: &Path, b: &Path) -> (f64, f64, usize) {
    let [a, b] = [a, b].map(|path| image::open(path).unwrap().into_rgb8());
    let (mut x, mut y, mut sum, mut count) = (0.0, 0.0, 0.0, 0);
    for (at, (a, b)) in a.pixels().zip(b.pixels()).enumerate() {
        let by: f64 = (0..3).map(|c| (f64::from(a[c]) - f64::from(b[c])).abs()).sum();
        (x, y, sum) = (x + by * (at % 640) as f64, y + by * (at / 640) as f64, sum + by);
        count += usize::from(by > 0.0);
    }
    (x / sum, y / sum, count)
}

// Slow: the program tracks a video of 18 frames twice and composites it twice.
#[test]
fn tracked_video_becomes_a_recording_with_static_evidence() {
    let site = Site::shared(&CAMERA);
    let track = site.track("board.toml", "tracked");
    let stdout = stdout_of(&strs(&track));
    for line in [
        "poses      15 of 18 frames, from 6.0 tags each",
        "lost       frames 10 to 12 (0.333 to 0.400 s): no tag is seen",
    ] {
        assert!(stdout.contains(line), "{stdout}");
    }
    assert!(!stdout.contains("doubtful"), "{stdout}");
    let tracked = PathBuf::from(site.path("tracked"));
    let recording = Recording::open(&tracked, &OpenOptions::default()).unwrap();
    assert_eq!((recording.frame_count(), recording.up), (FRAMES, Some(DVec3::Z)));
    // Evidence beside the sheet, on it and standing up from it.
    let points = [DVec3::ZERO, DVec3::new(0.2, 0.05, 0.0), DVec3::new(-0.15, -0.1, 0.1), DVec3::new(0.1, 0.2, 0.0)];
    for i in 0..FRAMES {
        let pose = recording.pose_at_frame(i);
        assert_eq!(pose.is_err(), AWAY.contains(&i), "frame {i}");
        let Ok(pose) = pose else { continue };
        let truth = place(i as f64 / FPS);
        for point in points {
            let own = pose.transform_point(point);
            let off_px = CAMERA.project_ray(own.truncate() / own.z).distance(truth.project(&CAMERA, point));
            assert!(off_px < 0.5, "frame {i}: {off_px:.3} px off");
        }
    }
    // A covariance for each pose, with the same times.
    let text = std::fs::read_to_string(tracked.join("covariance.txt")).unwrap();
    let lines: Vec<Vec<f64>> = text
        .lines()
        .filter(|line| !line.starts_with('#'))
        .map(|line| line.split(' ').map(|n| n.parse().unwrap()).collect())
        .collect();
    assert!(lines.len() == 15 && lines.iter().all(|line| line.len() == 22), "{text}");
    let times: Vec<f64> = recording.track.poses().iter().map(|pose| pose.0).collect();
    assert_eq!(lines.iter().map(|line| line[0]).collect::<Vec<_>>(), times);
    // Diagonals: rotation is certain to some hundredths of a degree, position to a millimetre.
    for line in &lines {
        for (i, max_sigma) in [(1, 2e-3), (7, 2e-3), (12, 2e-3), (16, 2e-3), (19, 2e-3), (21, 2e-3)] {
            assert!(line[i] > 0.0 && line[i].sqrt() < max_sigma, "{line:?}");
        }
    }

    // The same with the true poses, and both composited.
    let truth = site.folder.path().join("truth");
    program::copied(&tracked, &truth);
    let lines: Vec<Line> = recording
        .track
        .poses()
        .iter()
        .map(|(time_s, _)| {
            let place = place(*time_s);
            Line { time_s: *time_s, position_m: place.at_m, rotation: place.quaternion() }
        })
        .collect();
    std::fs::write(truth.join("poses.txt"), locard::recording::write::trajectory(&lines)).unwrap();
    let scene = site.scene();
    let composited = tier::fast_or_full(8..11, 4..11);
    let range = format!("{}..{}", composited.start, composited.end);
    for name in ["tracked", "truth"] {
        let (from, to) = (site.path(name), site.path(&format!("out-{name}")));
        stdout_of(&[
            "composite",
            &from,
            "--scene",
            &scene,
            "--frames",
            &range,
            "--without",
            "noise",
            "-o",
            &to,
            "--quiet",
        ]);
    }
    let source = |i: usize| {
        // A frame without a pose is unmodified.
        site.folder.path().join(format!("out-truth/frame_{i:06}.png"))
    };
    let tracked = |i: usize| site.folder.path().join(format!("out-tracked/frame_{i:06}.png"));
    // The labels name the recordings.
    let pixels = |path: PathBuf| image::open(path).unwrap().to_rgb8();
    assert!(pixels(source(10)) == pixels(tracked(10)));
    let plain = site.path("plain");
    std::fs::create_dir(&plain).unwrap();
    assert!(
        Command::new("ffmpeg")
            .args(["-v", "error", "-i", &site.path("site.mkv"), "-start_number", "0", &format!("{plain}/%d.png")])
            .status()
            .unwrap()
            .success()
    );
    for i in composited.start..AWAY.start {
        let own = Path::new(&plain).join(format!("{i}.png"));
        let ((x, y, count), (tx, ty, _)) = (differs(&tracked(i), &own), differs(&source(i), &own));
        assert!(count > 200, "frame {i}: {count} pixels of evidence");
        assert!((x - tx).hypot(y - ty) < 0.5, "frame {i}: {:.3} px off", (x - tx).hypot(y - ty));
    }

    // A tracked recording is replaced on request, and no other folder ever is.
    assert!(refused(&strs(&track)).contains("exists already"));
    let force: Vec<String> = track.iter().cloned().chain(["--force".to_owned()]).collect();
    assert_eq!(stdout_of(&strs(&force)), stdout);
    std::fs::write(site.path("tracked/mine.txt"), "mine").unwrap();
    assert!(refused(&strs(&force)).contains("contains mine.txt"));
    assert!(Path::new(&site.path("tracked/poses.txt")).exists());

    // A board other than the filmed one: in three frames in the fast tier.
    let frames = tier::fast_or_full(3, FRAMES);
    let few = site.path("few.mkv");
    let cut = ["-v", "error", "-i", &site.path("site.mkv"), "-frames:v", &frames.to_string(), "-c", "copy", &few];
    assert!(Command::new("ffmpeg").args(cut).status().unwrap().success());
    let track_few = || {
        let mut track = site.track("other.toml", "other");
        track[1].clone_from(&few);
        refused(&strs(&track))
    };
    let wrong_family = format!("no tag of family 25h9 is seen in any of {frames} frames; tags of 36h11 are");
    let board = std::fs::read_to_string(site.path("board.toml")).unwrap();
    // The line number of a tag is that of its id.
    let tag_at = board.lines().position(|line| line == "id = 0").unwrap() + 1;
    let wrong_size = format!("line {tag_at}, tags.size_m of tag 0: 0: expected");
    for (from, to, message) in [
        ("36h11", "25h9", wrong_family.as_str()),
        ("id = ", "id = 10", "the visible tags are not on the board: 0, 1, 2, 3, 4, 5"),
        ("0.0425", "0.0825", "are not arranged as on the board"),
        ("0.065", "0", wrong_size.as_str()),
    ] {
        std::fs::write(site.path("other.toml"), board.replace(from, to)).unwrap();
        let error = track_few();
        assert!(error.contains(message), "{error}");
        assert!(!Path::new(&site.path("other")).exists(), "{error}");
    }
    let small = CAMERA.profile().replace("width_px = 640", "width_px = 1280");
    std::fs::write(site.path("camera.toml"), small).unwrap();
    assert!(
        refused(&strs(&site.track("board.toml", "other"))).contains("is 640x480 px and the profile's camera 1280x480")
    );
}

#[test]
fn live_picture_gets_its_pose_from_its_tags() {
    let site = Site::shared(&CAMERA);
    let mut rig = Rig::default();
    rig.read(Path::new(&site.path("camera.toml")), &mut Settings::default()).unwrap();
    let mut poses = open_poses(&format!("tags:{}", site.path("board.toml")), Some(&rig.camera()), None).unwrap();
    let video = probe(Path::new(&site.path("site.mkv")), &Overrides::default()).unwrap();
    for (i, pixels) in video.read(0..FRAMES).unwrap().enumerate() {
        let time_s = 7.0 + i as f64 / FPS;
        poses.add_picture(time_s, &pixels.unwrap());
        let new_poses = poses.take_poses(time_s).unwrap();
        // The board is not known after a single picture.
        assert_eq!(new_poses.len(), usize::from(i > 0 && !AWAY.contains(&i)), "frame {i}");
        // Each pose has a covariance, like those of `track`.
        let covariance = poses.covariance(time_s);
        assert_eq!(covariance.is_some(), new_poses.len() == 1, "frame {i}");
        let sigma = |n: usize| covariance.unwrap().upper[n].sqrt();
        assert!(new_poses.is_empty() || [0, 6, 11, 15, 18, 20].into_iter().all(|n| sigma(n) > 0.0 && sigma(n) < 2e-3));
        let Some((at_s, pose)) = new_poses.first() else { continue };
        assert_eq!(*at_s, time_s);
        let truth = place(i as f64 / FPS);
        for point in [DVec3::ZERO, DVec3::new(0.2, 0.05, 0.0), DVec3::new(-0.15, -0.1, 0.1)] {
            let own = pose.transform_point(point);
            let off_px = CAMERA.project_ray(own.truncate() / own.z).distance(truth.project(&CAMERA, point));
            assert!(off_px < 0.5, "frame {i}: {point} is {off_px} px off");
        }
    }
    assert_eq!((poses.take_poses(9.0).unwrap(), poses.up()), (Vec::new(), Some(DVec3::Z)));
}

/// A recording's poses and covariances.
fn recorded(folder: &str) -> Vec<(Pose, Covariance)> {
    let recording = Recording::open(Path::new(folder), &OpenOptions::default()).unwrap();
    let text = std::fs::read_to_string(Path::new(folder).join("covariance.txt")).unwrap();
    let sure = text.lines().skip(2).map(|line| {
        let numbers: Vec<f64> = line.split(' ').map(|number| number.parse().unwrap()).collect();
        Covariance { time_s: numbers[0], upper: numbers[1..].try_into().unwrap() }
    });
    recording.track.poses().iter().map(|(_, pose)| *pose).zip(sure).collect()
}

#[test]
fn track_is_smoothed_on_request() {
    let site = Site::shared(&CAMERA);
    let plain = site.track("board.toml", "plain");
    stdout_of(&strs(&plain));
    let smooth: Vec<String> = site.track("board.toml", "smooth");
    let stdout = stdout_of(&[&strs(&smooth)[..], &["--smooth", "0.05"]].concat());
    assert!(stdout.contains("smoothed   by a line through the poses around each, 0.05 s to 1/e"), "{stdout}");
    let (plain, smooth) = (recorded(&site.path("plain")), recorded(&site.path("smooth")));
    // The frames in which the camera points away are not bridged.
    let expected = smooth_poses(&plain, 0.05, 0.05);
    assert_eq!((smooth.len(), expected.len()), (FRAMES - AWAY.len(), FRAMES - AWAY.len()));
    for ((pose, sure), (expected, wanted_sure)) in smooth.iter().zip(&expected) {
        assert!((pose.translation_m - expected.translation_m).length() < 1e-12);
        assert!(pose.rotation.angle_between(expected.rotation) < 1e-7 && sure.time_s == wanted_sure.time_s);
        (0..21).for_each(|i| assert!((sure.upper[i] - wanted_sure.upper[i]).abs() < 1e-9 * wanted_sure.upper[0]));
    }
    let moved = |i: usize| smooth[i].0.translation_m.distance(plain[i].0.translation_m);
    assert!((0..plain.len()).any(|i| moved(i) > 1e-6));
}

#[test]
fn sheet_is_written_with_its_board_file() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    stdout_of(&["board", "-o", &at("sheet.pdf"), "--paper", "letter"]);
    let pdf = std::fs::read(at("sheet.pdf")).unwrap();
    assert!(pdf.starts_with(b"%PDF-1.4") && pdf.ends_with(b"%%EOF\n"));
    let board = locard::tags::Board::read(Path::new(&at("sheet.toml"))).unwrap();
    assert_eq!(board.tags.len(), 6);
    // The same board on other paper needs no confirmation; a measured size is kept.
    stdout_of(&["board", "-o", &at("sheet.png")]);
    assert!(refused(&["board", "-o", &at("sheet.png")]).contains("sheet.png"));
    let mine = std::fs::read_to_string(at("sheet.toml")).unwrap().replace("version = 1", "version = 1\nscale = 0.97");
    std::fs::write(at("sheet.toml"), &mine).unwrap();
    std::fs::remove_file(at("sheet.png")).unwrap();
    assert!(refused(&["board", "-o", &at("sheet.png")]).contains("sheet.toml"));
    assert!(!Path::new(&at("sheet.png")).exists());
    assert_eq!(std::fs::read_to_string(at("sheet.toml")).unwrap(), mine);
    assert!(refused(&["board", "-o", &at("sheet.svg")]).contains("a sheet is written as .pdf or .png"));
    assert!(refused(&["board", "-o", &at("x.pdf"), "--paper", "a3"]).contains("expected a4 or letter"));
}
