//! Limits and refusals of the frame loop.

use std::sync::Arc;

use crate::board;
use crate::board::{FOCAL_PX, board, sideways};
use crate::gpu;
use locard::camera::{Capture, FilmOverride, NoiseBin, NoiseProfile, Response};
use locard::compositor::{Composited, Compositor, Job, Settings, SubmitError, Target};
use locard::frame::Frame;
use locard::params::Value;
use locard::pixels::{DepthMap, Pixels};
use locard::scene::{Alpha, Scene};
use locard::tracking::PoseTrack;

/// Submits a frame of a camera whose field of view is as wide as the frame, with an exposure time.
fn submitted(
    settings: Settings,
    scene: Scene,
    track: &PoseTrack,
    exposure_s: f64,
    frame: Frame,
) -> Result<Composited, SubmitError> {
    take_photo(settings, scene, track, exposure_s, frame, false)
}

/// [`submitted`] for a frame or a photograph.
fn take_photo(
    settings: Settings,
    scene: Scene,
    track: &PoseTrack,
    exposure_s: f64,
    frame: Frame,
    photograph: bool,
) -> Result<Composited, SubmitError> {
    let geometry = gpu::pinhole(frame.pixels.width, frame.pixels.height, FOCAL_PX);
    let gpu = gpu::gpu();
    let camera = gpu::camera(&geometry, exposure_s);
    let mut compositor = Compositor::new(gpu.clone(), scene);
    let mut job = Job::of_frame(frame, &camera, &settings, &geometry, track, 1.0 / 30.0)?;
    if photograph {
        let film = Some(FilmOverride { speed: 1.0, width_mm: 36.0 });
        job.capture = Capture { whole: true, film, ..Capture::frame(&geometry, exposure_s, None) };
    }
    let pending = compositor.submit(job, &camera, &settings, Target::Pixels)?;
    Ok(compositor.collect(pending).unwrap())
}

#[test]
fn long_blur_needs_a_margin_of_at_most_the_picture_diagonal() {
    let frame = || gpu::frame(0, 0.0, gpu::grey(320, 240, 60));
    // The track covers 40,000 px in its second; the shutter is open for a minute.
    let track = sideways([40_000.0, 0.0]);
    assert!(submitted(Settings::default(), board([60.0, 50.0], 0.5), &track, 60.0, frame()).is_ok());
    let copies = gpu::settings(&[("motion_blur", "method", Value::Text("copies".to_owned()))]);
    assert!(submitted(copies, board([60.0, 50.0], 0.5), &track, 60.0, frame()).is_ok());
    // The largest representable velocity.
    let track = sideways([1e9, 1e9]);
    assert!(submitted(Settings::default(), board([60.0, 50.0], 0.5), &track, 1e39, frame()).is_ok());
}

#[test]
fn blur_beyond_the_adapter_limit_is_refused_with_its_size() {
    let width = gpu::gpu().max_side_px() - 100;
    let frame = gpu::frame(0, 0.0, gpu::grey(width, 40, 60));
    let track = sideways([40_000.0, 0.0]);
    let error = submitted(Settings::default(), board([60.0, 10.0], 0.5), &track, 60.0, frame).unwrap_err();
    let SubmitError::TooLarge { width_px, side_px, widest, .. } = &error else { panic!("{error}") };
    assert!(width_px > side_px && *widest == Some("motion_blur"), "{error}");
    let text = error.to_string();
    assert!(text.contains(&format!("{width_px}x")) && text.contains(&side_px.to_string()), "{text}");
}

#[test]
fn small_object_in_a_frame_beyond_the_adapter_limit_is_drawn() {
    let width = gpu::gpu().max_side_px() + 100;
    let frame = || gpu::frame(0, 0.0, gpu::grey(width, 40, 60));
    let still = sideways([0.0, 0.0]);
    let done = submitted(Settings::default(), board([30.0, 10.0], 0.5), &still, 0.0, frame()).unwrap();
    assert_ne!(done.pixels.at(width / 2, 20), [60; 3]);
    let wide = [f64::from(width), 10.0];
    let error = submitted(Settings::default(), board(wide, 0.5), &still, 0.0, frame()).unwrap_err();
    assert!(matches!(error, SubmitError::TooLarge { .. }), "{error}");
}

#[test]
fn unusable_depth_reports_its_reason() {
    let depth = |width, height, timestamp_s| DepthMap {
        width,
        height,
        depth_m: vec![1.0; width as usize * height as usize],
        timestamp_s,
    };
    let still = sideways([0.0, 0.0]);
    let done = |settings: Settings, depth| {
        let frame = Frame { depth: Some(Arc::new(depth)), ..gpu::frame(0, 0.0, gpu::grey(320, 240, 60)) };
        let done = submitted(settings, board([60.0, 50.0], 0.5), &still, 0.0, frame).unwrap();
        (done.pixels.at(160, 120) == [60; 3], done.stats.no_occlusion)
    };
    // A wall one metre in front of the board occludes it.
    assert_eq!(done(Settings::default(), depth(320, 240, 0.0)), (true, None));
    // A microsecond is a rounding error; the track ends at half a second.
    assert_eq!(done(Settings::default(), depth(320, 240, 0.5 + 5e-7)), (true, None));
    let (hidden, why) = done(Settings::default(), depth(320, 240, 0.6));
    assert!(!hidden && why.as_ref().is_some_and(|why| why.contains("after the last pose")), "{why:?}");
    let (hidden, why) = done(Settings::default(), depth(160, 120, 0.0));
    assert!(!hidden && why.as_ref().is_some_and(|why| why.contains("160x120 px")), "{why:?}");
    // Occlusion is off, so no reason is reported.
    let off = gpu::settings(&[("depth", "occlusion", Value::Bool(false))]);
    assert_eq!(done(off, depth(320, 240, 0.6)), (false, None));
}

#[test]
fn screen_with_sparse_depth_occludes_objects_behind_it() {
    // A black screen in front of the left half of a board and of a bright wall; depth covers its
    // border and one pixel in fifty.
    let inside = |x: usize, y: usize| (90..160).contains(&x) && (60..180).contains(&y);
    let places = || (0..240).flat_map(|y| (0..320).map(move |x| (x, y)));
    let codes = places().flat_map(|(x, y)| [if inside(x, y) { 10 } else { 200 }; 3]).collect();
    let depth_m = places()
        .map(|(x, y)| match inside(x, y) {
            false => 2.0 * board::DEPTH_M as f32,
            true if x == 159 || (x % 10 == 0 && y % 5 == 0) => 0.5 * board::DEPTH_M as f32,
            true => 0.0,
        })
        .collect();
    let depth = DepthMap { width: 320, height: 240, depth_m, timestamp_s: 0.0 };
    let frame = gpu::frame(0, 0.0, Pixels::from_u8(320, 240, codes).unwrap());
    let frame = Frame { depth: Some(depth.into()), ..frame };
    let still = sideways([0.0, 0.0]);
    let done = submitted(Settings::default(), board([60.0, 50.0], 0.5), &still, 0.0, frame.clone()).unwrap();
    for (x, y) in (100..140).flat_map(|y| (135..185).map(move |x| (x, y))).filter(|(x, _)| !(156..164).contains(x)) {
        let shown = done.pixels.at(x, y) != frame.pixels.at(x, y);
        assert_eq!(shown, x >= 160, "{x} {y}");
    }
}

#[test]
fn light_without_coverage_is_dropped_in_frames_and_photos() {
    // So thin that its coverage is 0 in 16 bits, and so bright that its light is not.
    let mut ghost = board([60.0, 50.0], 3e8);
    ghost.materials[0].base_color[3] = 1e-9;
    ghost.materials[0].alpha = Alpha::Blend;
    for photograph in [false, true] {
        let frame = gpu::frame(0, 0.0, gpu::grey(320, 240, 60));
        let still = sideways([0.0, 0.0]);
        let done = take_photo(Settings::default(), ghost.clone(), &still, 0.0, frame, photograph).unwrap();
        assert_eq!(done.pixels, gpu::grey(320, 240, 60), "photograph: {photograph}");
    }
}

#[test]
fn opacity_scales_light_and_coverage_of_a_layer() {
    let still = sideways([0.0, 0.0]);
    let done = |opacity| {
        let frame = Frame { opacity, ..gpu::frame(0, 0.0, gpu::grey(320, 240, 60)) };
        submitted(Settings::default(), board([60.0, 50.0], 0.5), &still, 0.0, frame).unwrap()
    };
    let curve = Response::default();
    let code = |share: f64| {
        let light = share * 0.5 + (1.0 - share) * curve.decode(60.0 / 255.0);
        (255.0 * curve.encode(light)).round() as u32
    };
    for opacity in [1.0, 0.75, 0.5, 0.1] {
        let done = done(opacity);
        let green = done.pixels.at(160, 120)[1];
        // The layer has 11 significant bits, and so has a product of its values.
        assert!(green.abs_diff(code(opacity)) <= 1, "{opacity}: {green}");
        assert_eq!(done.pixels.at(20, 20), [60; 3]);
        assert_eq!(done.stats.opacity, Some(opacity).filter(|share| *share < 1.0));
    }
    assert_eq!(done(0.0).pixels, gpu::grey(320, 240, 60));
}

#[test]
fn faded_layer_with_chromatic_aberration_keeps_the_uncovered_share_of_the_footage() {
    let frame = Frame { opacity: 0.5, ..gpu::frame(0, 0.0, gpu::grey(160, 120, 200)) };
    let settings = gpu::settings(&[("chromatic_aberration", "red", Value::Number(0.01))]);
    let done = submitted(settings, board([60.0, 50.0], 0.5), &sideways([0.0, 0.0]), 0.0, frame).unwrap();
    assert_eq!(done.stats.effects, ["chromatic_aberration"]);
    // In the middle of the board each colour covers half of the footage.
    let curve = Response::default();
    let code = 255.0 * curve.encode(0.5 * 0.5 + 0.5 * curve.decode(200.0 / 255.0));
    for actual in done.pixels.at(80, 60) {
        assert!((f64::from(actual) - code).abs() <= 1.0, "{actual}, by hand {code}");
    }
}

#[test]
fn layer_image_of_a_fading_object_is_scaled_by_the_opacity() {
    let camera = gpu::camera(&gpu::pinhole(160, 120, FOCAL_PX), 0.0);
    let layer = |opacity| {
        let frame = Frame { opacity, ..gpu::frame(0, 0.0, gpu::grey(160, 120, 60)) };
        let (scene, still) = (board([40.25, 30.0], 0.5), sideways([0.0, 0.0]));
        gpu::composite(&gpu::gpu(), &camera, Settings::default(), scene, &still, frame).layer.unwrap()
    };
    // Products with a power of two are exact.
    let (whole, faded) = (layer(1.0), layer(0.25));
    assert_eq!(faded.rgba[60 * 160 + 80], [0.125, 0.125, 0.125, 0.25]);
    assert!(faded.rgba.iter().zip(&whole.rgba).all(|(faded, whole)| *faded == whole.map(|value| 0.25 * value)));
    assert_eq!(faded.depth_m, whole.depth_m);
}

#[test]
fn nearly_transparent_object_leaves_the_footage_unchanged() {
    let (width, height) = (320u32, 240u32);
    let code = |x: u32, y: u32| (60 + (x * 37 + y * 91 + x * y) % 120) as u8;
    let codes = (0..height).flat_map(|y| (0..width).flat_map(move |x| [code(x, y); 3])).collect();
    let plain = Pixels::from_u8(width, height, codes).unwrap();
    let sets = [("edge_blend", "impact", Value::Number(1.0)), ("noise", "scale", Value::Number(4.0))];
    let still = sideways([0.0, 0.0]);
    let mut difference = Vec::new();
    for opacity in [1.0, 1e-4] {
        let geometry = gpu::pinhole(width, height, FOCAL_PX);
        let gpu = gpu::gpu();
        let mut camera = gpu::camera(&geometry, 0.0);
        let bin = |code| NoiseBin { code, sigma: 3.0 };
        let bins = std::array::from_fn(|_| vec![bin(0.0), bin(255.0)]);
        camera.noise =
            Some(NoiseProfile { example: None, bins, channel_correlation: [0.0; 3], neighbour_correlation: [0.0; 2] });
        let settings = gpu::settings(&sets);
        let mut compositor = Compositor::new(gpu.clone(), board([60.0, 50.0], 0.5));
        let frame = Frame { opacity, ..gpu::frame(0, 0.0, plain.clone()) };
        let job = Job::of_frame(frame, &camera, &settings, &geometry, &still, 1.0 / 30.0);
        let pending = compositor.submit(job.unwrap(), &camera, &settings, Target::Pixels).unwrap();
        let done = compositor.collect(pending).unwrap();
        assert_eq!(done.stats.effects, ["edge_blend", "noise"]);
        let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        difference.push(places.map(|(x, y)| done.pixels.at(x, y)[0].abs_diff(plain.at(x, y)[0])).max());
    }
    assert!(difference[0] > Some(60) && difference[1] <= Some(1), "{difference:?}");
}

#[test]
fn clock_offset_is_added_to_the_frame_time_of_the_pose() {
    // The board moves 80 px a second: it is 20 px right of the middle at 0.25 s and 30 px at 0.375
    // s.
    let track = sideways([80.0, 0.0]);
    let geometry = gpu::pinhole(160, 60, FOCAL_PX);
    let (camera, settings) = (gpu::camera(&geometry, 0.02), Settings::default());
    let gpu = gpu::gpu();
    let mut compositor = Compositor::new(gpu.clone(), board([4.0, 10.0], 0.5));
    let mut drawn = |timestamp_s, clock_offset_s| {
        let track = track.clone().with_clock_offset_s(clock_offset_s);
        let frame = gpu::frame(0, timestamp_s, gpu::grey(160, 60, 60));
        let job = Job::of_frame(frame, &camera, &settings, &geometry, &track, 1.0 / 30.0).unwrap();
        let pending = compositor.submit(job, &camera, &settings, Target::Pixels).unwrap();
        compositor.collect(pending).unwrap().pixels
    };
    // Binary fractions: the sum of both times is exact.
    let offset = drawn(0.25, 0.125);
    assert!(offset == drawn(0.375, 0.0));
    assert!(offset.at(110, 30) != [60; 3] && offset.at(100, 30) == [60; 3] && offset.at(120, 30) == [60; 3]);
}
