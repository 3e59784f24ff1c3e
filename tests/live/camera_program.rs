//! `locard record` and `locard live` with a video in place of the camera.

use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::filmed::{AWAY, FRAMES, Site};
use crate::fixture;
use crate::program::{locard, program, refused, stdout_of};
use crate::sheet::CAMERA;
use crate::tier;
use glam::DVec2;
use locard::live::open_poses;
use locard::pose::Pose;
use locard::profile::Rig;
use locard::recording::{OpenOptions, Recording};
use locard::source::video::{Overrides, probe};
use locard::stream::{Encoding, LensState, Sample, Sender, packets, transform_of};
use locard::tracking::smooth::Smoother;

/// The demonstration's first frames, so slow that no machine drops many, and no longer than its
/// poses. All tests share it.
fn video() -> PathBuf {
    let folder = fixture::once("played", &["recordings/demo/rgb"], "10 frames at 4 Hz", |folder| {
        let status = Command::new("ffmpeg")
            .args(["-nostdin", "-loglevel", "error", "-framerate", "4", "-i", "recordings/demo/rgb/%05d.jpg"])
            .args(["-frames:v", "10", "-c:v", "ffv1", "-pix_fmt", "gbrp"])
            .arg(folder.join("played.mkv"))
            .status();
        assert!(status.unwrap().success());
    });
    folder.join("played.mkv")
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Code values of a written frame. Its label names the camera or the recording.
fn pixels_of_frame(folder: &Path, frame: usize) -> image::RgbImage {
    image::open(folder.join(format!("frame_{frame:06}.png"))).unwrap().to_rgb8()
}

#[test]
fn video_is_recorded_like_a_camera() {
    let temp = tempfile::tempdir().unwrap();
    let (video, site) = (video(), temp.path().join("site"));
    let arguments =
        ["record", "--camera", text(&video), "--pose", "file:recordings/demo", "--frames", "5", "-o", text(&site)];
    let output = locard(&arguments);
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{stderr}");
    assert!(stderr.contains("delivers 640x480 rgb at 4.00 Hz; 640x480 at 30.00 Hz was requested"), "{stderr}");
    assert!(stderr.contains("5 frames in "), "{stderr}");
    let recording = Recording::open(&site, &OpenOptions::default()).unwrap();
    assert_eq!((recording.frame_count(), recording.frame_interval_s), (5, 0.25));
    // The first pose is the first frame's, on a separate clock.
    let demo = Recording::open(Path::new("recordings/demo"), &OpenOptions::default()).unwrap();
    let (ours, theirs) = (recording.pose_at_frame(0).unwrap(), demo.pose_at_frame(0).unwrap());
    assert!((ours.translation_m - theirs.translation_m).length() < 1e-6);
    assert!(ours.rotation.angle_between(theirs.rotation) < 1e-6);
    // The pictures equal the video's in every code.
    let first = recording.frames(0..1).unwrap().next().unwrap().unwrap();
    let played = probe(&video, &Overrides::default()).unwrap();
    assert!(played.read(0..10).unwrap().any(|pixels| pixels.unwrap() == *first.pixels));
    let again = refused(&arguments);
    assert!(again.contains("site: exists already, and is kept; name a new folder"), "{again}");
}

#[test]
fn high_dynamic_range_video_as_a_camera_is_reported_as_lost() {
    let temp = tempfile::tempdir().unwrap();
    let (video, site) = (temp.path().join("hlg.mp4"), temp.path().join("site"));
    let mut ffmpeg = Command::new("ffmpeg");
    ffmpeg.args(["-v", "error", "-f", "lavfi", "-i", "testsrc=s=64x48:d=0.4:r=5", "-pix_fmt", "yuv420p"]);
    assert!(ffmpeg.args(["-color_trc", "arib-std-b67"]).arg(&video).status().unwrap().success());
    let output = locard(&["record", "--camera", text(&video), "--pose", "none", "--frames", "1", "-o", text(&site)]);
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{stderr}");
    let message = "hlg.mp4: is tagged: it is in HLG (high dynamic range); recorded pictures lose the tag";
    assert_eq!(stderr.matches(message).count(), 1, "{stderr}");
}

#[test]
fn live_pictures_match_the_recording() {
    let temp = tempfile::tempdir().unwrap();
    let video = video();
    let [site, shown, again] = ["site", "seen", "again"].map(|name| temp.path().join(name));
    let scene = ["--scene", tier::any_scene()];
    let mut arguments = vec!["live", "--camera", text(&video), "--pose", "file:recordings/demo", "--headless"];
    arguments.extend(scene);
    arguments.extend(tier::no_shadows());
    arguments.extend(["--profile", "recordings/demo/camera.toml", "--frames", "3"]);
    arguments.extend(["--record", text(&site), "-o", text(&shown)]);
    let output = locard(&arguments);
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{stderr}");
    // All recorded pictures were tracked, however slow the machine is.
    let taken = std::fs::read_dir(&shown).unwrap().count();
    assert!(taken > 0 && stderr.contains(" tracked, 0 by predicted poses, 0 without"), "{stderr}");
    stdout_of(&[&["composite", text(&site), "-o", text(&again)][..], &scene, tier::no_shadows()].concat());
    assert_eq!(std::fs::read_dir(&again).unwrap().count(), taken);
    for frame in 0..taken {
        let [live, again] = [&shown, &again].map(|at| pixels_of_frame(at, frame));
        assert!(live == again, "frame {frame} differs");
    }
}

#[test]
fn unknown_cameras_and_pose_sources_are_refused_in_one_line() {
    let temp = tempfile::tempdir().unwrap();
    let (video, out) = (video(), temp.path().join("out"));
    for (arguments, expected) in [
        (["--camera", "77", "--pose", "none"], "77: is not a camera; there "),
        (
            ["--camera", "none.mp4", "--pose", "none"],
            "none.mp4: there is no such file; expected a video file, or a camera's number or device: there ",
        ),
        (
            ["--camera", text(&video), "--pose", "http://x"],
            "expected tags, tags:BOARD.toml, opentrackio://…, freed://…, file:RECORDING, none",
        ),
        (["--camera", text(&video), "--pose", "file:scenes"], "scenes: not a recording"),
        (["--camera", "Cargo.toml", "--pose", "none"], "Cargo.toml: "),
    ] {
        let error = refused(&[&["record"][..], &arguments, &["-o", text(&out)]].concat());
        assert!(error.contains(expected) && error.lines().count() == 1, "{error}");
        assert!(!out.exists());
    }
}

/// The site's video at a lower rate, followed by grey frames, several times over, so that a slow
/// machine records some frame of the fade.
fn grey_at_its_end(site: &Site, rate_hz: f64, times: usize) -> String {
    let to = site.path("ends-grey.mkv");
    let grey = format!("tpad=stop_mode=add:stop_duration=0.5:color=gray,loop=loop={}:size=33:start=0", times - 1);
    let filter = format!("{grey},setpts=N/{rate_hz}/TB");
    let from = site.path("site.mkv");
    let arguments = ["-v", "error", "-i", &from, "-vf", &filter, "-r", &rate_hz.to_string(), "-c:v", "libx264rgb"];
    let status = Command::new("ffmpeg").args(arguments).args(["-preset", "ultrafast", "-qp", "0", &to]).status();
    assert!(status.unwrap().success());
    to
}

/// Frames recorded without compositing fade in the replay as they would live.
// Slow: the video in place of the camera lasts 4.4 s.
#[test]
fn recording_stores_the_opacity_while_the_camera_is_lost() {
    let site = Site::shared(&CAMERA);
    let times = tier::fast_or_full(2, 4);
    let (video, tags) = (grey_at_its_end(&site, 15.0, times), format!("tags:{}", site.path("board.toml")));
    let (profile, folder) = (site.path("camera.toml"), site.path("recorded"));
    stdout_of(&["record", "--camera", &video, "--pose", &tags, "--profile", &profile, "-o", &folder]);
    let recording = Recording::open(Path::new(&folder), &OpenOptions::default()).unwrap();
    let sure = std::fs::read_to_string(Path::new(&folder).join("covariance.txt")).unwrap();
    let seen_s: Vec<f64> = sure.lines().skip(2).map(|line| line.split(' ').next().unwrap().parse().unwrap()).collect();
    assert!(seen_s.len() > 5 && seen_s.len() <= times * (FRAMES - AWAY.len()), "{}", seen_s.len());
    let (mut faded, mut without_pose) = (0, 0);
    for (frame, time_s) in recording.timestamps_s.iter().enumerate().filter(|(_, time_s)| !seen_s.contains(time_s)) {
        let Some(last_s) = seen_s.iter().rev().find(|seen_s| *seen_s < time_s) else { continue };
        let (since_s, opacity) = (time_s - last_s, recording.opacity(frame));
        // Earlier if the camera turned away as fast as that.
        let max_opacity = (1.0 - (since_s - 0.1) / 0.2).clamp(0.0, 1.0);
        if recording.pose_at_frame(frame).is_err() {
            assert_eq!(opacity, 1.0, "nothing is drawn");
        } else if !seen_s.iter().any(|seen_s| seen_s > time_s && *seen_s < time_s + 0.25) {
            // Found a moment before, the opacity may still rise; it falls as it does live.
            assert!(opacity <= max_opacity + 1e-9, "{since_s}: {opacity} {max_opacity}");
            faded += usize::from(opacity > 0.0 && opacity < 1.0);
        }
        without_pose += usize::from(recording.pose_at_frame(frame).is_err());
    }
    assert!(faded > 0 && without_pose > 0, "{faded} {without_pose}");
    // Poses are recorded as measured: no prediction replaces them.
    let times_s: Vec<f64> = recording.track.poses().iter().map(|(time_s, _)| *time_s).collect();
    assert!(seen_s.iter().all(|seen_s| times_s.contains(seen_s)));
    let first_gap_s = seen_s.windows(2).find(|pair| pair[1] - pair[0] > 0.1).unwrap()[0];
    let before: Vec<f64> = times_s.iter().copied().filter(|time_s| *time_s <= first_gap_s).collect();
    assert_eq!(before, seen_s.iter().copied().filter(|time_s| *time_s <= first_gap_s).collect::<Vec<f64>>());
}

#[test]
fn smoothed_poses_are_composited_and_recorded() {
    let site = Site::shared(&CAMERA);
    let (tags, profile) = (format!("tags:{}", site.path("board.toml")), site.path("camera.toml"));
    // Each is the smoother's result for the measured poses, with its covariance.
    let camera = Rig::of_file(Path::new(&profile)).unwrap().camera();
    let open = |smooth_s| open_poses(&tags, Some(&camera), smooth_s).unwrap();
    let (mut plain, mut smooth, mut smoother) = (open(None), open(Some(0.05)), Smoother::new(0.05, 0.1));
    let video = probe(Path::new(&site.path("site.mkv")), &Overrides::default()).unwrap();
    let mut differs = 0;
    for (pixels, time_s) in video.read(0..FRAMES).unwrap().zip(&video.timestamps_s) {
        let pixels = pixels.unwrap();
        plain.add_picture(*time_s, &pixels);
        smooth.add_picture(*time_s, &pixels);
        let (plains, smooths) = (plain.take_poses(1e9).unwrap(), smooth.take_poses(1e9).unwrap());
        assert_eq!(plains.len(), smooths.len());
        if let (Some((_, shown)), Some((_, quiet))) = (plains.first(), smooths.first()) {
            let expected = smoother.next(shown, &plain.covariance(*time_s).unwrap());
            assert_eq!((*quiet, smooth.covariance(*time_s).unwrap()), expected);
            differs += usize::from(quiet != shown);
        }
    }
    assert!(differs > 10, "{differs}");
    // The live pictures equal those of the recording.
    let [recorded, shown, again] = ["recorded", "seen", "again"].map(|name| site.path(name));
    let scene = site.scene();
    let endless = if tier::is_full() { site.endless() } else { site.repeated(40) };
    let mut arguments = vec!["live", "--camera", &endless, "--pose", &tags, "--profile", &profile, "--scene", &scene];
    let count = tier::fast_or_full(5, 14);
    let frames = count.to_string();
    arguments.extend(["--headless", "--frames", &frames, "--smooth", "0.05", "--record", &recorded, "-o", &shown]);
    arguments.extend(tier::no_shadows());
    stdout_of(&arguments);
    stdout_of(&[&["composite", &recorded, "--scene", &scene, "-o", &again], tier::no_shadows()].concat());
    let taken = std::fs::read_dir(&shown).unwrap().count();
    assert_eq!((std::fs::read_dir(&again).unwrap().count(), taken), (count, count));
    for frame in 0..taken {
        let [live, again] = [&shown, &again].map(|at| pixels_of_frame(Path::new(at), frame));
        assert!(live == again, "frame {frame} differs");
    }
    let error =
        refused(&["record", "--camera", &endless, "--pose", "none", "--smooth", "0.05", "-o", &site.path("no")]);
    assert!(error.contains("smoothing is refused: it is for poses from tags"), "{error}");
}

/// A lens that zooms while it is sent.
fn zooming(i: u32) -> LensState {
    LensState {
        focal_length_mm: Some(28.0 + 0.02 * f64::from(i % 400)),
        sensor_mm: Some(DVec2::new(36.0, 27.0)),
        shutter_angle_deg: Some(180.0),
        frame_rate_hz: Some(4.0),
        iso: Some(400.0),
        ..LensState::default()
    }
}

/// Without a profile the camera is that of the stream, and the used values are recorded with each
/// frame.
#[test]
fn lens_of_a_stream_is_the_camera_live_and_recorded() {
    let temp = tempfile::tempdir().unwrap();
    let video = video();
    let demo = Recording::open(Path::new("recordings/demo"), &OpenOptions::default()).unwrap();
    let pose = demo.pose_at_frame(0).unwrap();
    let [site, shown, again, bare] = ["site", "seen", "again", "bare"].map(|name| temp.path().join(name));
    let live = ["live", "--scene", tier::any_scene(), "--headless", "--frames", "4", "--record", text(&site)];
    let live = [&live[..], tier::no_shadows()].concat();
    let record = ["record", "--frames", "4"];
    for (arguments, out) in [(&live[..], &shown), (&record[..], &bare)] {
        let port = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let url = format!("opentrackio://127.0.0.1:{port}");
        let rest = ["--camera", text(&video), "--pose", &url, "-o", text(out)];
        let mut running = program();
        running.args(arguments).args(rest).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut running = running.spawn().unwrap();
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        let (until, began) = (Instant::now() + Duration::from_secs(120), Instant::now());
        for i in 0u32.. {
            if running.try_wait().unwrap().is_some() {
                break;
            }
            assert!(Instant::now() < until, "it goes on");
            let mut sample = Sample::default();
            zooming(i).write(&mut sample, true);
            sample.set(&["transforms"], transform_of(&pose));
            let time_s = began.elapsed().as_secs_f64();
            sample.set(&["timing", "sampleTimestamp", "seconds"], time_s.floor() as u64);
            sample.set(&["timing", "sampleTimestamp", "nanoseconds"], (1e9 * time_s.fract()) as u64);
            for packet in packets(Encoding::Json, i as u16, &sample.encode(Encoding::Json).unwrap()) {
                // Nobody may listen to the first ones.
                let _ = socket.send_to(&packet, ("127.0.0.1", port));
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        let output = running.wait_with_output().unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success(), "{stderr}");
        assert!(
            stderr.contains("the lens is the stream's: focal length 28") && stderr.contains("36x27 mm"),
            "{stderr}"
        );
    }
    for folder in [&site, &bare] {
        let recording = Recording::open(folder, &OpenOptions::default()).unwrap();
        let fx: Vec<f64> = (0..4).map(|frame| recording.geometry_at_frame(frame).unwrap().intrinsics.fx_px).collect();
        // 640 px over 36 mm.
        assert!(fx.iter().all(|fx| (497.0..641.0).contains(fx)) && fx.windows(2).any(|p| p[0] != p[1]), "{fx:?}");
        assert!(recording.exposure.iter().all(|exposure| exposure.time_s == Some(0.125)), "{:?}", recording.exposure);
    }
    let composite = ["composite", text(&site), "--scene", tier::any_scene(), "-o", text(&again)];
    stdout_of(&[&composite[..], tier::no_shadows()].concat());
    let taken = std::fs::read_dir(&shown).unwrap().count();
    assert_eq!((std::fs::read_dir(&again).unwrap().count(), taken), (4, 4));
    for frame in 0..taken {
        let [live, again] = [&shown, &again].map(|at| pixels_of_frame(at, frame));
        assert!(live == again, "frame {frame} differs");
    }
}

/// Files are limited to 512 bytes.
#[cfg(unix)]
#[test]
fn unwritable_output_leaves_no_files() {
    let temp = tempfile::tempdir().unwrap();
    let (video, site) = (video(), temp.path().join("site"));
    let mut command = Command::new("sh");
    command.args(["-c", "ulimit -f 1; exec \"$0\" \"$@\"", env!("CARGO_BIN_EXE_locard"), "record"]);
    let output = command.args(["--camera", text(&video), "--frames", "3", "-o", text(&site)]).output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    assert!(stderr.contains("; nothing was recorded") && !site.exists(), "{stderr}");
}

#[test]
fn recording_without_frames_fails_and_leaves_no_files() {
    let temp = tempfile::tempdir().unwrap();
    let (video, site) = (video(), temp.path().join("site"));
    let error = refused(&["record", "--camera", text(&video), "--seconds", "0.000001", "-o", text(&site)]);
    assert!(error.contains("site: nothing was recorded: no picture came from the camera in 0.0"), "{error}");
    assert!(!error.contains("0 frames") && !site.exists(), "{error}");
    let out = temp.path().join("out.mkv");
    let live = ["--seconds", "0.000001", "--scene", tier::any_scene(), "--headless", "-o", text(&out)];
    let profile = ["--profile", "recordings/demo/camera.toml", "--record", text(&site)];
    let error =
        refused(&[&["live", "--camera", text(&video), "--pose", "file:recordings/demo"][..], &live, &profile].concat());
    assert!(error.contains("nothing was composited: no picture came from the camera"), "{error}");
    assert!(!out.exists() && !site.exists(), "{error}");
}

#[test]
fn stream_without_a_lens_or_profile_is_refused_with_the_reason() {
    let temp = tempfile::tempdir().unwrap();
    let video = video();
    let port = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let url = format!("opentrackio://127.0.0.1:{port}");
    let out = temp.path().join("out");
    let scene = ["--scene", "scenes/demo.toml", "--headless", "-o", text(&out)];
    let error = refused(&[&["live", "--camera", text(&video), "--pose", &url, "-q"][..], &scene].concat());
    assert!(
        error.contains(&format!("no lens was received from {url} within 2 s: {url}, received at "))
            && error.contains("(--profile)"),
        "{error}"
    );
}

#[test]
fn closing_lines_count_the_received_poses() {
    let temp = tempfile::tempdir().unwrap();
    let (video, site) = (video(), temp.path().join("site"));
    let port = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let url = format!("opentrackio://127.0.0.1:{port}");
    let arguments = ["record", "--camera", text(&video), "--pose", &url, "-o", text(&site)];
    let mut recording = program().args(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut walk = Sender::open(&url, "walk", 100.0, None).unwrap();
    let mut other = Sender::open(&url, "another", 100.0, None).unwrap();
    let noise = UdpSocket::bind("127.0.0.1:0").unwrap();
    let until = Instant::now() + Duration::from_secs(60);
    let mut count = 0;
    while recording.try_wait().unwrap().is_none() {
        assert!(Instant::now() < until, "it goes on");
        // Nobody may listen to the first ones.
        let _ = walk.send(0.01 * f64::from(count), &Pose::IDENTITY);
        if count > 50 {
            let _ = other.send(0.01 * f64::from(count), &Pose::IDENTITY);
            let _ = noise.send_to(b"no packet", ("127.0.0.1", port));
        }
        count += 1;
        std::thread::sleep(Duration::from_millis(10));
    }
    let stderr = String::from_utf8(recording.wait_with_output().unwrap().stderr).unwrap();
    let line = stderr.lines().find(|line| line.contains(&format!("{url}: "))).unwrap_or_else(|| panic!("{stderr}"));
    for part in [" poses in ", " datagrams; dropped: ", " of another source", " no packet of this protocol, or damaged"]
    {
        assert!(line.contains(part), "{part}: {stderr}");
    }
}
