//! Depth of field on the real part of photographs.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

#[path = "common/board.rs"]
mod board;
#[path = "common/gpu.rs"]
mod gpu;
#[path = "common/kinect.rs"]
mod kinect;

use std::sync::LazyLock;

use board::{FOCAL_PX, panel, sideways};
use locard::camera::grain::{self, GrainRatios};
use locard::camera::{Camera, NoiseBin, NoiseProfile, Opening, Response};
use locard::compositor::{Compositor, Settings};
use locard::image::{Codes, DepthMap, Pixels};
use locard::photo::{Exposed, Framing, Real, Site, take};
use locard::scene::Scene;
use locard::simulate::{Detail, Options, Shot, Simulation};

const SIZE: (u32, u32) = (320, 240);

fn lens(circle_at_infinity_px: f64, focus_distance_m: f64) -> Opening {
    let diameter_m = circle_at_infinity_px * focus_distance_m / FOCAL_PX;
    Opening { diameter_m, focus_distance_m, blades: 0, rotation_rad: 0.0 }
}

/// A picture of code values, and its depth, by column and row.
fn pictured(code: impl Fn(u32, u32) -> u16, depth_m: impl Fn(u32, u32) -> f32) -> (Pixels, DepthMap) {
    let (width, height) = SIZE;
    let places = || (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let codes = places().flat_map(|(x, y)| [code(x, y); 3]).collect();
    let depth_m = places().map(|(x, y)| depth_m(x, y)).collect();
    (Pixels { width, height, codes: Codes::U16(codes) }, DepthMap { width, height, depth_m, timestamp_s: 0.0 })
}

fn photo(camera: &Camera, scene: Scene, pixels: &Pixels, depth: &DepthMap, opening: Opening, width: u32) -> Pixels {
    let recorded = camera.geometry.clone().unwrap();
    let framing = Framing::new(&recorded, None, None, opening.focus_distance_m, Some(width)).unwrap();
    let gpu = gpu::gpu();
    let mut compositor = Compositor::new(gpu.clone(), camera.clone(), Settings::default(), scene);
    let real = Real::new(&[(1.0, pixels.clone())], &camera.response, &framing.framed, framing.size(), 1.0);
    let track = sideways([0.0, 0.0]);
    let site = Site {
        recorded: &recorded,
        track: &track,
        time_offset_s: 0.0,
        interval_s: 1.0 / 30.0,
        frame: 3,
        timestamp_s: 0.0,
        exposure: Default::default(),
        depth: Some(depth),
    };
    let exposed = Exposed { opening: Some(opening), time_s: 0.0, over_ev: 0.0, iso_ratio: 1.0 };
    take(&mut compositor, &site, &framing, real, &exposed).unwrap()
}

fn without_noise() -> Camera {
    gpu::camera(&gpu::pinhole(SIZE.0, SIZE.1, FOCAL_PX), 0.0)
}

fn light(pixels: &Pixels, x: u32, y: u32) -> f64 {
    Response::default().decode(f64::from(pixels.at(x, y)[1]) / f64::from(pixels.max_code()))
}

/// From 10 to 90 % of an edge's light along a row, px.
fn width_px(pixels: &Pixels, y: u32, columns: std::ops::Range<u32>) -> f64 {
    let row: Vec<f64> = columns.map(|x| light(pixels, x, y)).collect();
    let (dark, bright) = (row[0], row[row.len() - 1]);
    let crossing = |part: f64| {
        let level = dark + part * (bright - dark);
        let i = row.windows(2).position(|w| (w[0] <= level) != (w[1] <= level)).unwrap();
        i as f64 + (level - row[i]) / (row[i + 1] - row[i])
    };
    crossing(0.9) - crossing(0.1)
}

#[test]
fn a_far_edge_is_as_wide_as_its_circle() {
    let camera = without_noise();
    // 4 m away; 1 m is sharp: three quarters of the circle at infinity. An edge through a disc of diameter c rises from
    // 10 to 90 % within 0.687 c; a pixel's own width adds in squares (0.8 px).
    for infinity_px in [4.0f64, 8.0, 16.0, 32.0, 56.0] {
        let (pixels, depth) = pictured(|x, _| if x < 160 { 6000 } else { 40000 }, |_, _| 4.0);
        let done = photo(&camera, Scene::default(), &pixels, &depth, lens(infinity_px, 1.0), SIZE.0);
        let found = width_px(&done, 120, 100..220);
        let wanted = (0.687 * 0.75 * infinity_px).hypot(0.8);
        assert!((found / wanted - 1.0).abs() < 0.05, "circle {}: {found} px, {wanted} wanted", 0.75 * infinity_px);
        // Nothing is darker or brighter at the picture's rims.
        for (x, y) in [(0, 0), (319, 0), (0, 239), (319, 239)] {
            let there = f64::from(pixels.at(x, y)[0]) / 257.0;
            assert!((f64::from(done.at(x, y)[0]) - there).abs() <= 1.0, "{x} {y}: {:?}, {there}", done.at(x, y));
        }
    }
}

#[test]
fn what_is_sharp_stays_code_for_code_and_takes_nothing_from_behind() {
    let camera = without_noise();
    let texture = |x: u32, y: u32| ((x * 7919 + y * 104_729) % 200) as u16 * 257;
    // A near thing in focus, left; a bright wall far behind.
    let (pixels, depth) =
        pictured(|x, y| if x < 160 { texture(x, y) } else { 62000 }, |x, _| if x < 160 { 1.0 } else { 4.0 });
    let done = photo(&camera, Scene::default(), &pixels, &depth, lens(16.0, 1.0), SIZE.0);
    for (x, y) in (0..240).flat_map(|y| (0..159).map(move |x| (x, y))) {
        assert_eq!(done.at(x, y)[1], pixels.at(x, y)[1] / 257, "{x} {y}");
    }
    // Nothing of the near thing in the wall: the pixel on the edge is the thing's (it may show both).
    for (x, y) in (0..240).flat_map(|y| (162..320).map(move |x| (x, y))) {
        assert!(done.at(x, y)[1].abs_diff(62000 / 257) <= 1, "{x} {y}: {:?}", done.at(x, y));
    }
}

#[test]
fn a_near_thing_is_blurred_over_what_is_sharp_and_lets_it_through() {
    let camera = without_noise();
    // Dark at 0.5 m before a bright wall at 1 m: 16 px of circle, half of it to either side of the edge.
    let (pixels, depth) = pictured(|x, _| if x < 160 { 6000 } else { 40000 }, |x, _| if x < 160 { 0.5 } else { 1.0 });
    let done = photo(&camera, Scene::default(), &pixels, &depth, lens(16.0, 1.0), SIZE.0);
    let found = width_px(&done, 120, 130..190);
    let wanted = (0.687 * 16.0f64).hypot(0.8);
    assert!((found / wanted - 1.0).abs() < 0.08, "{found}, {wanted} wanted");
    // Half of it at the edge, which lies one pixel farther out.
    let middle = light(&done, 160, 120) / (light(&pixels, 10, 120) + light(&pixels, 300, 120));
    assert!((middle - 0.5).abs() < 0.08, "{middle}");
}

#[test]
fn a_thing_blurs_alike_whether_it_is_real_or_virtual() {
    let camera = without_noise();
    // At 2 m (where boards stand), before a wall at 6 m with stripes; sharp is 1 m, 3 m or the wall.
    let wall = |x: u32| if (x / 20).is_multiple_of(2) { 20000 } else { 50000 };
    let inside = |x: u32, y: u32| (100..220).contains(&x) && (80..160).contains(&y);
    let grey = Response::default().decode(9000.0 / 65535.0) as f32;
    for focus_m in [1.0, 3.0, 6.0] {
        let opening = lens(24.0, focus_m);
        let (whole, depth) =
            pictured(|x, y| if inside(x, y) { 9000 } else { wall(x) }, |x, y| if inside(x, y) { 2.0 } else { 6.0 });
        let real = photo(&camera, Scene::default(), &whole, &depth, opening, SIZE.0);
        let (empty, depth) = pictured(|x, _| wall(x), |_, _| 6.0);
        let mixed = photo(&camera, panel([-60.0, -40.0], [60.0, 40.0], grey), &empty, &depth, opening, SIZE.0);
        let mut sum = 0.0;
        for (x, y) in (0..240).flat_map(|y| (0..320).map(move |x| (x, y))) {
            sum += f64::from(real.at(x, y)[1].abs_diff(mixed.at(x, y)[1]));
        }
        let mean = sum / 76800.0;
        // A real thing is a pixel wider; and of stripes that its blur uncovers, where the wall is sharp, half are made up.
        let most = if focus_m == 6.0 { 3.0 } else { 1.2 };
        assert!(mean < most, "sharp at {focus_m} m: {mean} codes");
    }
}

#[test]
fn blurred_real_pixels_get_the_films_grain() {
    let bins: Vec<NoiseBin> =
        (0..16).map(|i| NoiseBin { code: 8.0 + 16.0 * f64::from(i), sigma: 2.0 + f64::from(i) / 7.5 }).collect();
    let noise = NoiseProfile {
        bins: [bins.clone(), bins.clone(), bins],
        channel_correlation: [0.0; 3],
        neighbour_correlation: [0.0; 2],
    };
    let camera = Camera { noise: Some(noise.clone()), ..without_noise() };
    let mut state = 1u64;
    let mut even = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / f64::from(1u32 << 31)
    };
    let noisy: Vec<u16> = (0..SIZE.0 * SIZE.1)
        .map(|_| {
            let normal = (0..12).map(|_| even()).sum::<f64>() - 6.0;
            (257.0 * (90.0 + noise.sigma(1, 90.0) * normal)).round() as u16
        })
        .collect();
    for (infinity_px, width) in [(1.6, SIZE.0), (4.0, SIZE.0), (16.0, SIZE.0), (4.0, 960)] {
        let (pixels, depth) = pictured(|x, y| noisy[(y * SIZE.0 + x) as usize], |_, _| 4.0);
        let done = photo(&camera, Scene::default(), &pixels, &depth, lens(infinity_px, 1.0), width);
        let codes: Vec<f64> = (20..done.height - 20)
            .flat_map(|y| (20..done.width - 20).map(move |x| (x, y)))
            .map(|(x, y)| f64::from(done.at(x, y)[1]))
            .collect();
        let mean = codes.iter().sum::<f64>() / codes.len() as f64;
        let sigma = (codes.iter().map(|c| (c - mean).powi(2)).sum::<f64>() / codes.len() as f64).sqrt();
        let ratios = GrainRatios { picture_width: f64::from(width) / f64::from(SIZE.0), ..Default::default() };
        let wanted = grain::sigma(&noise, &Response::default(), 1, 90.0, &ratios).powi(2) + 1.0 / 12.0;
        assert!((sigma / wanted.sqrt() - 1.0).abs() < 0.04, "{infinity_px} {width}: σ {sigma}, {}", wanted.sqrt());
    }
}

/// A simulated room, seen by a pinhole.
struct Room {
    camera: Camera,
    recorded: Pixels,
    light: Vec<[f32; 3]>,
    depth_m: Vec<f32>,
    /// Focus distance and diameter, metres, and what a thin lens sees with them: 200 rays a pixel.
    seen: Vec<([f64; 2], Pixels)>,
}

const ROOM_FOCAL_PX: f32 = 260.0;

static ROOM: LazyLock<Room> = LazyLock::new(|| {
    let options = Options {
        width_px: SIZE.0,
        height_px: SIZE.1,
        focal_px: ROOM_FOCAL_PX.into(),
        exposure_time_s: 0.0,
        readout_time_s: 0.0,
        ..Options::default()
    };
    let simulation = Simulation::with_detail(&options, Detail::for_focal_px(120.0), 2).unwrap();
    let sharp = simulation.shot(70);
    let pinhole = simulation.take(&sharp);
    let response = Response::default();
    let codes = |light: &[[f32; 3]]| {
        let code = |l: &f32| (65535.0 * response.encode(f64::from(*l).clamp(0.0, 1.0))).round() as u16;
        Pixels { width: SIZE.0, height: SIZE.1, codes: Codes::U16(light.as_flattened().iter().map(code).collect()) }
    };
    let seen = |[focus_distance_m, aperture_diameter_m]: [f64; 2]| {
        let shot = Shot { samples: 200, aperture_diameter_m, focus_distance_m, ..sharp };
        ([focus_distance_m, aperture_diameter_m], codes(&simulation.take(&shot).light))
    };
    Room {
        camera: gpu::camera(simulation.geometry(), 0.0),
        recorded: codes(&pinhole.light),
        seen: [[0.6, 0.025], [2.0, 0.06]].map(seen).into(),
        light: pinhole.light,
        depth_m: pinhole.depth_m,
    }
});

impl Room {
    /// Taken with a depth, by the lens of one of `seen`.
    fn photo(&self, depth_m: &[f32], [focus_distance_m, diameter_m]: [f64; 2]) -> Pixels {
        let opening = Opening { diameter_m, focus_distance_m, blades: 0, rotation_rad: 0.0 };
        let depth = DepthMap { width: SIZE.0, height: SIZE.1, depth_m: depth_m.to_vec(), timestamp_s: 0.0 };
        photo(&self.camera, Scene::default(), &self.recorded, &depth, opening, SIZE.0)
    }
}

/// Mean difference in linear light.
fn apart(a: &Pixels, b: &Pixels) -> f64 {
    let places = (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| (x, y)));
    let sum: f64 = places.map(|(x, y)| (light(a, x, y) - light(b, x, y)).abs()).sum();
    sum / f64::from(SIZE.0 * SIZE.1)
}

/// Into the folder that LOCARD_PICTURES names, if it does.
fn show(name: &str, p: &Pixels) {
    let Ok(folder) = std::env::var("LOCARD_PICTURES") else { return };
    let bytes: Vec<u8> = (0..SIZE.1)
        .flat_map(|y| (0..SIZE.0).flat_map(move |x| p.at(x, y)))
        .map(|c| (c * 255 / p.max_code()) as u8)
        .collect();
    image::RgbImage::from_raw(SIZE.0, SIZE.1, bytes).unwrap().save(format!("{folder}/{name}.png")).unwrap();
}

#[test]
fn a_photograph_is_what_a_thin_lens_sees() {
    for (lens, truth) in &ROOM.seen {
        let done = ROOM.photo(&ROOM.depth_m, *lens);
        let (of_photo, of_recorded) = (apart(&done, truth), apart(&ROOM.recorded, truth));
        for (name, pixels) in [("truth", truth), ("photo", &done), ("recorded", &ROOM.recorded)] {
            show(&format!("{name}-{}", lens[0]), pixels);
        }
        println!("{lens:?}: {of_photo}, the recorded picture {of_recorded}");
        assert!(of_photo < 0.003 && of_photo < 0.4 * of_recorded, "{of_photo}, the recorded picture {of_recorded}");
    }
}

#[test]
fn with_a_kinects_depth_it_is_nearly_so() {
    let measured_m = kinect::measured(&ROOM.depth_m, &ROOM.light, SIZE.0 as usize, ROOM_FOCAL_PX);
    for (lens, truth) in &ROOM.seen {
        let done = ROOM.photo(&measured_m, *lens);
        let of_photo = apart(&done, truth);
        show(&format!("kinect-{}", lens[0]), &done);
        println!("{lens:?}: {of_photo}");
    }
}
