//! Live pictures equal those of their recording, bit for bit. Time is simulated: nothing waits.

use std::path::Path;
use std::sync::Arc;

use crate::gpu::gpu;
use crate::random::Random;
use crate::tier;
use glam::{DVec2, DVec3};
use locard::camera::Geometry;
use locard::coding::{ColorMatrix, ColorRange};
use locard::live::{LensTrack, LiveCompositor, LiveCounts, PictureOutcome, RecorderThread};
use locard::pixels::Codes;
use locard::pose::Pose;
use locard::recording::recorder::{Recorder, RecordingInfo};
use locard::recording::{FrameCamera, OpenOptions, Recording};
use locard::shot::{Shot, ShotOptions};
use locard::stream::{LensState, OpenLens};
use locard::webcam::{Layout, Picture, PictureFormat};

const SIZE: (u32, u32) = (96, 72);
const INTERVAL_S: f64 = 1.0 / 30.0;
const MAX_GAP_S: f64 = 0.1;

const PROFILE: &str = "version = 1
[camera]
width_px = 96
height_px = 72
fx_px = 80.0
fy_px = 80.0
cx_px = 48.0
cy_px = 36.0
readout_time_s = 0.012
[camera.distortion]
k1 = -0.11
[camera.noise]
channel_correlation = [0.5, 0.5, 0.5]
neighbour_correlation = [0.5, 0.5]
code = [0.0, 128.0, 255.0]
sigma_r = [1.0, 2.0, 1.5]
sigma_g = [1.0, 2.0, 1.5]
sigma_b = [1.0, 2.0, 1.5]
";

/// A camera that moves around the marker, fast enough to blur it.
fn pose(t: f64) -> Pose {
    let angle = 2.0 * t;
    let eye = DVec3::new(0.5 * angle.cos(), 0.5 * angle.sin(), 0.3 + 0.05 * (7.0 * t).sin());
    Pose::look_at(eye, DVec3::new(0.0, 0.0, 0.05), DVec3::Z).unwrap()
}

fn picture(layout: Layout, i: usize, time_s: f64) -> Picture {
    let (width, height) = SIZE;
    let wave = |n: usize| (90.0 + 60.0 * ((n * (i % 7 + 3)) as f64 * 0.013).sin()) as u8;
    let (stride, bytes) = match layout {
        Layout::Yuyv => (2 * width as usize, (0..2 * (width * height) as usize).map(wave).collect()),
        _ => {
            let codes: Vec<u8> = (0..3 * (width * height) as usize).map(wave).collect();
            let mut file = Vec::new();
            let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut file, 80);
            image::ImageEncoder::write_image(encoder, &codes, width, height, image::ExtendedColorType::Rgb8).unwrap();
            (0, file)
        }
    };
    let picture_format =
        PictureFormat { layout, width, height, stride, range: ColorRange::Limited, matrix: ColorMatrix::Bt601 };
    Picture { picture_format, bytes, time_s, exposure_s: None }
}

#[derive(Clone, Copy)]
enum Event {
    Frame(usize, f64),
    Pose(f64),
}

/// Frames with drops, and poses that are late, lost or out of order, sorted by arrival.
fn events(frames: usize, random: &mut Random) -> Vec<(f64, Event)> {
    let mut events = Vec::new();
    let (mut taken, mut i) = (0, 0);
    while taken < frames {
        i += 1;
        // One in twelve is dropped, and occasionally half a second.
        if random.uniform() < 1.0 / 12.0 || (400..415).contains(&(i % 450)) {
            continue;
        }
        let time_s = 40_213.7 + INTERVAL_S * i as f64 + 2e-3 * random.uniform();
        events.push((time_s + 0.015 + 0.02 * random.uniform(), Event::Frame(taken, time_s)));
        taken += 1;
    }
    let end_s = INTERVAL_S * i as f64 + 0.5;
    for k in 0..(100.0 * end_s) as usize {
        let t = 0.01 * k as f64;
        // The tracker is lost for a while and in short gaps, and one pose in eight does not arrive.
        if (2.0..2.9).contains(&t) || t % 1.7 < 0.16 || random.uniform() < 0.125 {
            continue;
        }
        let slow = if t % 3.1 < 0.5 { 0.09 } else { 0.01 };
        events.push((40_213.7 + t + slow * random.uniform(), Event::Pose(40_213.7 + t)));
    }
    events.sort_by(|a, b| a.0.total_cmp(&b.0));
    events
}

/// Composites live, and then from the resulting recording, and asserts equality. Also returns the
/// marker's opacity in each frame, if it had a pose.
fn assert_live_equals_replay(layout: Layout, frames: usize, sets: &[&str]) -> (LiveCounts, Vec<Option<f64>>) {
    let (counts, opacity, _) = assert_live_equals_replay_with(layout, frames, sets, None);
    (counts, opacity)
}

/// [`assert_live_equals_replay`] with a lens state from a stream as a function of time. Also
/// returns the recording's cameras.
fn assert_live_equals_replay_with(
    layout: Layout,
    frames: usize,
    sets: &[&str],
    lens: Option<fn(f64) -> LensState>,
) -> (LiveCounts, Vec<Option<f64>>, Vec<Geometry>) {
    let temp = tempfile::tempdir().unwrap();
    let (profile, folder) = (temp.path().join("camera.toml"), temp.path().join("site"));
    std::fs::write(&profile, PROFILE).unwrap();
    let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
    let scene = Some(Path::new("scenes/marker-1.glb").to_owned());
    let options =
        ShotOptions { profile: Some(profile), sets: sets.clone(), scene: scene.clone(), ..ShotOptions::default() };
    let shot = Shot::of(Recording::live("made up", SIZE.0, SIZE.1, INTERVAL_S, Some(DVec3::Z)), &options).unwrap();
    let about = RecordingInfo {
        interval_s: INTERVAL_S,
        max_gap_s: MAX_GAP_S,
        up: Some(DVec3::Z),
        has_floor: false,
        camera: None,
        delivered: None,
        has_exposure: false,
        has_cameras: lens.is_some(),
        profile: Some(PROFILE.to_owned()),
    };
    let writer = RecorderThread::new(Recorder::create(&folder, &about).unwrap()).unwrap();
    let lenses = lens.map(|_| LensTrack::new(SIZE, INTERVAL_S, shot.rig.clone(), FrameCamera::default()));
    let gpu = gpu();
    let mut compositor = shot.compositor(gpu.clone());
    let mut live = LiveCompositor::new(&shot, &mut compositor, MAX_GAP_S, INTERVAL_S, Some(writer), lenses).unwrap();
    let (mut shown_frames, mut opacities) = (Vec::new(), Vec::new());
    let mut show = |live: &mut LiveCompositor<'_>, now_s: f64| {
        while let Some(submitted) = live.submit(now_s).unwrap() {
            let shown = live.collect(submitted).unwrap();
            opacities.push(shown.opacity);
            shown_frames.push(shown.done);
        }
    };
    for (now_s, event) in events(frames, &mut Random::new(7)) {
        match event {
            Event::Pose(time_s) => {
                let t = time_s - 40_213.7;
                lens.into_iter().for_each(|lens| live.add_lens_state(time_s, &Arc::new(lens(t))));
                live.add_pose(time_s, &pose(t));
            }
            Event::Frame(i, time_s) => {
                let picture = picture(layout, i, time_s);
                // The disk may be behind; a retry loses nothing.
                while live.add_picture(&picture, picture.pixels().unwrap(), now_s) == PictureOutcome::NotRecorded {
                    std::thread::yield_now();
                }
            }
        }
        show(&mut live, now_s);
    }
    show(&mut live, f64::INFINITY);
    let counts = live.counts();
    let (kept, ended) = live.finish().unwrap();
    assert!(ended.is_none(), "{ended:?}");
    assert_eq!((kept, shown_frames.len()), (frames, frames));

    let options = ShotOptions { sets, scene, ..ShotOptions::default() };
    let shot = Shot::open(&folder, &OpenOptions::default(), &options).unwrap();
    assert_eq!(shot.recording.frame_count(), frames);
    (0..frames).for_each(|frame| assert_eq!(shot.recording.opacity(frame), opacities[frame], "frame {frame}"));
    let mut compositor = shot.compositor(gpu.clone());
    let replayed = shot.frames(&mut compositor, 0..frames, false, 2).unwrap();
    let (mut drawn, mut opacity) = (0, Vec::new());
    for (live, again) in shown_frames.iter().zip(replayed) {
        let again = again.unwrap();
        assert_eq!(live.stats.no_pose.is_some(), again.stats.no_pose.is_some(), "frame {}", live.frame);
        assert!(live.pixels == again.pixels, "frame {} differs: {:?} {:?}", live.frame, live.stats, again.stats);
        let plain = shot.read(live.frame).unwrap().pixels;
        let (Codes::U8(live), Codes::U8(plain)) = (&live.pixels.codes, &plain.codes) else { panic!("8 bits") };
        drawn += usize::from(live != plain);
        opacity.push(again.stats.no_pose.is_none().then(|| shot.recording.opacity(again.frame)));
    }
    // The marker is in the picture in each frame with a pose, unless it has faded.
    assert_eq!(drawn, opacity.iter().filter(|share| share.is_some_and(|share| share > 0.02)).count(), "{counts:?}");
    assert_eq!(opacity.iter().flatten().count() as u64, counts.tracked + counts.predicted, "{counts:?}");
    let cameras = (0..frames).map(|frame| shot.geometry_at(frame).unwrap()).collect();
    (counts, opacity, cameras)
}

/// Zooms from 30 to 45 mm and back, and pulls focus; shutter and film speed change, too. The first
/// states have no lens.
fn zoomed(t: f64) -> LensState {
    if t < 0.2 {
        return LensState::default();
    }
    let focal_mm = 37.5 - 7.5 * (3.0 * t).cos();
    LensState {
        focal_length_mm: Some(focal_mm),
        sensor_mm: Some(DVec2::new(36.0, 27.0)),
        projection_offset_mm: Some(DVec2::new(0.1, -0.2)),
        distortion: Some(OpenLens { distorts: false, radial: vec![-1e-4], tangential: [0.0; 2] }),
        f_stop: Some(1.4),
        focus_distance_m: Some(0.4 + 0.2 * t),
        shutter_angle_deg: Some(if t < 1.0 { 120.0 } else { 300.0 }),
        frame_rate_hz: Some(30.0),
        iso: Some(800.0),
        ..LensState::default()
    }
}

#[test]
fn lens_of_a_stream_is_followed_and_replays_bit_for_bit() {
    let (_, _, cameras) = assert_live_equals_replay_with(Layout::Yuyv, 60, &["camera.lens.f_number=8"], Some(zoomed));
    // 96 px over 36 mm. The first cameras are the profile's, and its readout time stays.
    assert_eq!(cameras[0].intrinsics.fx_px, 80.0);
    let fx: Vec<f64> = cameras.iter().map(|camera| camera.intrinsics.fx_px).skip(8).collect();
    assert!(fx.iter().all(|fx| (79.9..120.1).contains(fx)), "{fx:?}");
    assert!(fx.windows(2).filter(|pair| pair[0] != pair[1]).count() > 35, "{fx:?}");
    assert!(cameras.iter().all(|camera| camera.intrinsics.readout_time_s == 0.012));
}

/// The user's settings override the stream's values one by one.
#[test]
fn settings_override_the_lens_of_the_stream() {
    let sets = ["camera.fx_px=90", "camera.lens.focus_distance_m=none", "camera.exposure.time_s=0.01"];
    let (_, _, cameras) = assert_live_equals_replay_with(Layout::Yuyv, 30, &sets, Some(zoomed));
    let lenses = cameras.iter().skip(8).map(|camera| (&camera.intrinsics, &camera.distortion));
    assert!(lenses.clone().count() > 10);
    for (i, d) in lenses {
        assert!(i.fx_px == 90.0 && i.fy_px != 80.0 && d.k1 != -0.11, "{i:?} {d:?}");
    }
}

#[test]
fn frames_with_dropped_late_and_lost_poses_replay_bit_for_bit() {
    let (frames, min_count) = tier::fast_or_full((100, 5), (300, 15));
    let (counts, opacity) = assert_live_equals_replay(Layout::Yuyv, frames, &[]);
    // All cases have occurred.
    let LiveCounts { tracked, predicted, untracked, late, .. } = counts;
    assert!(
        tracked > frames as u64 / 3 && predicted > min_count && untracked > min_count && late > min_count,
        "{counts:?}"
    );
    let faded = |pair: &&[Option<f64>]| matches!(pair, [Some(a), Some(b)] if a > b);
    let rose = |pair: &&[Option<f64>]| matches!(pair, [Some(a), Some(b)] if a < b);
    let [fell, rose] = [opacity.windows(2).filter(faded).count(), opacity.windows(2).filter(rose).count()];
    assert!(fell > min_count as usize / 3 && rose > min_count as usize / 3, "{fell} {rose} {opacity:?}");
}

#[test]
fn jpeg_pictures_replay_bit_for_bit() {
    assert_live_equals_replay(Layout::Mjpeg, tier::fast_or_full(15, 40), &["noise.scale=1.5"]);
}

/// These depend on more than the exposure: one on the next frame's pose, one on earlier moments.
#[test]
fn motion_blur_of_long_exposures_replays_bit_for_bit() {
    for method in ["copies", "accumulation"] {
        let set = format!("motion_blur.method={method}");
        assert_live_equals_replay(
            Layout::Yuyv,
            tier::fast_or_full(20, 60),
            &[&set, "camera.exposure.shutter_angle_deg=300"],
        );
    }
}
