//! Photographs: noise added to the real part, the rendered part, and the files of the command. One
//! file, because the tests share the camera and its photographs.

use crate::board;
use crate::board::{FOCAL_PX, board, sideways};
use crate::gpu;
use crate::program;
use crate::random::Random;
use crate::reduced::Reduction;
use crate::tier::fast_or_full;
use locard::camera::grain::{self, GrainRatios};
use locard::camera::{Camera, Capture, Distortion, FilmOverride, Geometry, NoiseBin, NoiseProfile, Opening, Response};
use locard::compositor::{Compositor, Job, RealDepth, Settings, Target};
use locard::depth::{DepthGrid, Surfaces};
use locard::frame::{FrameExposure, PhotoSettings};
use locard::params::Value;
use locard::photo::{Aim, Framing, PhotoExposure, RealPart, Standpoint, take};
use locard::pixels::{Codes, Pixels, Rect};
use locard::scene::Scene;
use std::path::{Path, PathBuf};

const TIME_S: f64 = 0.02;

/// σ grows from 2 codes in the dark to 4; no correlations.
fn noise() -> NoiseProfile {
    let bins: Vec<NoiseBin> =
        (0..16).map(|i| NoiseBin { code: 8.0 + 16.0 * f64::from(i), sigma: 2.0 + f64::from(i) / 7.5 }).collect();
    NoiseProfile {
        example: None,
        bins: [bins.clone(), bins.clone(), bins],
        channel_correlation: [0.0; 3],
        neighbour_correlation: [0.0; 2],
    }
}

fn camera(geometry: &Geometry, noise: Option<NoiseProfile>) -> Camera {
    Camera { noise, ..gpu::camera(geometry, TIME_S) }
}

/// Photographs a picture with a scene composited into it.
fn photo(camera: &Camera, scene: Scene, pixels: Pixels, framing: &Framing, exposed: PhotoExposure) -> Pixels {
    photo_with(Settings::default(), camera, scene, pixels, framing, exposed)
}

fn photo_with(
    settings: Settings,
    camera: &Camera,
    scene: Scene,
    pixels: Pixels,
    framing: &Framing,
    exposed: PhotoExposure,
) -> Pixels {
    photo_of_frame(settings, camera, scene, pixels, framing, exposed, FrameExposure::default())
}

fn photo_of_frame(
    settings: Settings,
    camera: &Camera,
    scene: Scene,
    pixels: Pixels,
    framing: &Framing,
    exposed: PhotoExposure,
    exposure: FrameExposure,
) -> Pixels {
    let gpu = gpu::gpu();
    let recorded = camera.geometry.clone().unwrap();
    let track = sideways([200.0, 0.0]);
    let mut compositor = Compositor::new(gpu.clone(), scene);
    let real = RealPart::new(&[(1.0, pixels)], &camera.response, &framing.framed, framing.size(), neighbours(camera));
    let standpoint = Standpoint {
        camera,
        settings: &settings,
        recorded: &recorded,
        track: &track,
        interval_s: 1.0 / 30.0,
        frame: 3,
        timestamp_s: 0.0,
        exposure,
        opacity: 1.0,
        summed: &[],
        depth_m: None,
        summed_occlusion: &[],
    };
    take(&mut compositor, &standpoint, framing, real, &exposed, |_| true).unwrap().pixels
}

const AS_RECORDED: PhotoExposure = PhotoExposure { opening: None, time_s: TIME_S, over_ev: 0.0, iso_ratio: 1.0 };

fn neighbours(camera: &Camera) -> [f64; 2] {
    camera.noise.as_ref().map_or([0.0; 2], |noise| noise.neighbour_correlation)
}

/// Grey with noise whose σ depends on the code, mean 0.
fn noisy_grey(width: u32, height: u32, code: f64, noise: &NoiseProfile) -> Pixels {
    let mut random = Random::new(1);
    let codes = (0..3 * width * height).map(|i| {
        (257.0 * (code + noise.sigma(i as usize % 3, code) * random.normal())).round().clamp(0.0, 65535.0) as u16
    });
    Pixels::uncoded(width, height, Codes::U16(codes.collect()))
}

fn mean_and_sigma(pixels: &Pixels, channel: usize) -> (f64, f64) {
    let places = (0..pixels.height).flat_map(|y| (0..pixels.width).map(move |x| (x, y)));
    let codes: Vec<f64> = places.map(|(x, y)| f64::from(pixels.at(x, y)[channel])).collect();
    let mean = codes.iter().sum::<f64>() / codes.len() as f64;
    (mean, (codes.iter().map(|c| (c - mean).powi(2)).sum::<f64>() / codes.len() as f64).sqrt())
}

#[test]
fn photo_as_recorded_matches_the_composited_frame() {
    let geometry = gpu::pinhole(320, 240, FOCAL_PX);
    let camera = camera(&geometry, Some(noise()));
    let codes = (0..3 * 320 * 240u32).map(|i| (i * 7919 % 251) as u8).collect();
    let pixels = Pixels::from_u8(320, 240, codes).unwrap();
    let framing = Framing::new(&geometry, None, None, f64::INFINITY, None).unwrap();
    let photo = photo(&camera, board([60.0, 50.0], 0.5), pixels.clone(), &framing, AS_RECORDED);
    let frame = gpu::frame(3, 0.0, pixels.clone());
    let track = sideways([200.0, 0.0]);
    let done = gpu::composite(&gpu::gpu(), &camera, Settings::default(), board([60.0, 50.0], 0.5), &track, frame);
    let layer = done.layer.unwrap();
    let mut apart = 0;
    for y in 0..240 {
        for x in 0..320 {
            let (a, b) = (photo.at(x, y), done.pixels.at(x, y));
            if layer.rgba[(y * 320 + x) as usize][3] == 0.0 {
                assert_eq!(a, pixels.at(x, y), "a real pixel lacks nothing");
            }
            // Rounding to 16 bits and to 8: a value at a half may round either way.
            assert!((0..3).all(|c| a[c].abs_diff(b[c]) <= 1), "{x} {y}: {a:?} {b:?}");
            apart += usize::from(a != b);
        }
    }
    assert!(apart < 320 * 240 / 200, "{apart} pixels differ");
}

#[test]
fn real_and_virtual_pixels_have_the_film_grain() {
    let geometry = gpu::pinhole(400, 300, FOCAL_PX);
    let noise = noise();
    let camera = camera(&geometry, Some(noise.clone()));
    let framing = Framing::new(&geometry, None, None, f64::INFINITY, None).unwrap();
    let response = Response::default();
    for (iso_ratio, over_ev) in [(1.0, 0.0), (8.0, 0.0), (8.0, 1.0), (16.0, -1.0)] {
        let exposed = PhotoExposure { iso_ratio, over_ev, ..AS_RECORDED };
        let pixels = noisy_grey(400, 300, 90.0, &noise);
        let done = photo(&camera, Scene::default(), pixels, &framing, exposed);
        // Two stops, four times the light of code 90.
        let code = 255.0 * response.encode(over_ev.exp2() * response.decode(90.0 / 255.0));
        let ratios = GrainRatios { iso: iso_ratio, ..Default::default() };
        for channel in 0..3 {
            let expected = grain::sigma(&noise, &response, channel, code, &ratios);
            let (mean, sigma) = mean_and_sigma(&done, channel);
            assert!((mean - code).abs() < 0.6, "{iso_ratio} {over_ev}: mean {mean}, {code} expected");
            // 120,000 pixels in 2 by 2 grains give σ within 0.5 %, and rounding adds 1/12.
            let expected = (expected * expected + 1.0 / 12.0).sqrt();
            assert!((sigma / expected - 1.0).abs() < 0.03, "{iso_ratio} {over_ev}: σ {sigma}, {expected} expected");
        }
    }
    // A virtual board of the same light has the same grain as the real picture around it.
    let exposed = PhotoExposure { iso_ratio: 8.0, ..AS_RECORDED };
    let light = response.decode(90.0 / 255.0) as f32;
    let all = photo(&camera, board([900.0, 900.0], light), gpu::grey(400, 300, 255), &framing, exposed);
    let expected = grain::sigma(&noise, &response, 1, 90.0, &GrainRatios { iso: 8.0, ..Default::default() });
    let (mean, sigma) = mean_and_sigma(&all, 1);
    assert!((mean - 90.0).abs() < 0.6 && (sigma / expected - 1.0).abs() < 0.03, "{mean} {sigma}, {expected} expected");
}

/// At a quarter of the speed and four times the light, film grain has a quarter of σ or less; the
/// footage keeps all of its own noise.
#[test]
fn virtual_pixels_are_at_least_as_noisy_as_adjacent_real_ones() {
    let geometry = gpu::pinhole(400, 300, FOCAL_PX);
    let noise = noise();
    let camera = camera(&geometry, Some(noise.clone()));
    let framing = Framing::new(&geometry, None, None, f64::INFINITY, None).unwrap();
    let response = Response::default();
    for (iso_ratio, over_ev) in [(0.25, 0.0), (0.25, 2.0), (0.5, -1.0)] {
        let exposed = PhotoExposure { iso_ratio, over_ev, ..AS_RECORDED };
        let real = photo(&camera, Scene::default(), noisy_grey(400, 300, 90.0, &noise), &framing, exposed);
        let light = response.decode(90.0 / 255.0) as f32;
        let virtual_ = photo(&camera, board([900.0, 900.0], light), gpu::grey(400, 300, 255), &framing, exposed);
        for channel in 0..3 {
            let ((mean, sigma), (shown, own)) = (mean_and_sigma(&real, channel), mean_and_sigma(&virtual_, channel));
            assert!((mean - shown).abs() < 0.6, "{iso_ratio} {over_ev}: {shown}, the room's is {mean}");
            assert!((own / sigma - 1.0).abs() < 0.03, "{iso_ratio} {over_ev}: σ {own}, the room's is {sigma}");
        }
    }
}

/// A camera whose noise was measured at ISO 100 records a frame at ISO 1600 with its noise. A
/// photograph at ISO 1600 needs no more.
#[test]
fn frame_recorded_at_another_iso_contributes_the_noise_of_that_iso() {
    let geometry = gpu::pinhole(400, 300, FOCAL_PX);
    let noise = noise();
    let mut camera = camera(&geometry, Some(noise.clone()));
    camera.exposure.iso = Some(100.0);
    let response = Response::default();
    let ratios = GrainRatios { iso: 16.0, ..Default::default() };
    let expected = grain::sigma(&noise, &response, 1, 90.0, &ratios);
    let louder = |bin: &NoiseBin| NoiseBin { code: bin.code, sigma: bin.sigma * expected / noise.sigma(1, 90.0) };
    let recorded =
        NoiseProfile { bins: noise.bins.clone().map(|bins| bins.iter().map(louder).collect()), ..noise.clone() };
    let framing = Framing::new(&geometry, None, None, f64::INFINITY, None).unwrap();
    let exposed = PhotoExposure { iso_ratio: 16.0, ..AS_RECORDED };
    let photo_of = PhotoSettings { iso: Some(1600.0), ..Default::default() };
    let exposure = FrameExposure { photo: photo_of, ..Default::default() };
    let pixels = noisy_grey(400, 300, 90.0, &recorded);
    let done = photo_of_frame(Settings::default(), &camera, Scene::default(), pixels, &framing, exposed, exposure);
    let (_, sigma) = mean_and_sigma(&done, 1);
    assert!((sigma / expected - 1.0).abs() < 0.03, "σ {sigma}, {expected} expected");
}

/// The composite puts the recording's own noise, correlated between neighbours, on a board.
/// Enlarged and reduced, it is completed to exactly the film's grain.
#[test]
fn enlarged_correlated_noise_is_completed_to_the_film_grain() {
    let geometry = gpu::pinhole(400, 300, FOCAL_PX);
    let noise = NoiseProfile { neighbour_correlation: [0.6, 0.5], ..noise() };
    let camera = camera(&geometry, Some(noise.clone()));
    let response = Response::default();
    let whole = Framing::new(&geometry, None, None, f64::INFINITY, None).unwrap();
    let light = response.decode(90.0 / 255.0) as f32;
    // A seed other than the photograph's, so that the grain is independent of this noise.
    let mut settings = Settings::default();
    settings.seed = 7;
    let all = board([900.0, 900.0], light);
    let recorded = photo_with(settings, &camera, all, gpu::grey(400, 300, 255), &whole, AS_RECORDED);
    for width in [200, 400, 640, 1000] {
        let framing = Framing::new(&geometry, None, None, f64::INFINITY, Some(width)).unwrap();
        let done = photo(&camera, Scene::default(), recorded.clone(), &framing, AS_RECORDED);
        let ratios = GrainRatios { picture_width: f64::from(width) / 400.0, ..Default::default() };
        let expected = grain::sigma(&noise, &response, 1, 90.0, &ratios);
        let (mean, sigma) = mean_and_sigma(&done, 1);
        assert!(
            (mean - 90.0).abs() < 0.6 && (sigma / expected - 1.0).abs() < 0.04,
            "{width} px: σ {sigma}, {expected} expected"
        );
    }
}

/// A dark board in front of a wall so bright that four stops clip it long before a pixel is half
/// covered.
#[test]
fn highlights_are_clipped_after_mixing() {
    let geometry = gpu::pinhole(320, 240, FOCAL_PX);
    let camera = camera(&geometry, Some(noise()));
    let framing = Framing::new(&geometry, None, None, f64::INFINITY, None).unwrap();
    let exposed = PhotoExposure { over_ev: 4.0, time_s: 0.0, ..AS_RECORDED };
    let response = Response::default();
    let at =
        |light: f32, code: u8| photo(&camera, board([60.5, 50.0], light), gpu::grey(320, 240, code), &framing, exposed);
    // The column at 99 is half covered. Half of sixteen times 0.2 is white.
    let dark = at(0.0, (255.0 * response.encode(0.2)).round() as u8);
    assert!((60..180).all(|y| dark.at(99, y) == [255; 3]), "{:?}", dark.at(99, 120));
    assert!(dark.at(101, 120)[1] < 40);
    // Sixteen times white clips without grain.
    let bright = at(1.0, 10);
    assert!((75..165).all(|y| (110..210).all(|x| bright.at(x, y) == [255; 3])));
}

#[test]
fn virtual_part_is_rendered_at_photo_size_with_the_same_exposure() {
    let geometry = gpu::pinhole(320, 240, FOCAL_PX);
    let camera = camera(&geometry, None);
    // Half of the picture, four times as large: enlarged eight times.
    let film = locard::camera::Film::new(36.0, 27.0).unwrap();
    let focal_m = 2.0 * 0.036 * FOCAL_PX / 320.0;
    let framing = Framing::new(&geometry, Some(film), Some(focal_m), f64::INFINITY, Some(1280)).unwrap();
    assert!((framing.enlargement() - 8.0).abs() < 1e-9);
    let exposed = PhotoExposure { over_ev: 1.0, time_s: 0.0, ..AS_RECORDED };
    let done = photo(&camera, board([40.0, 30.0], 0.8), gpu::grey(320, 240, 60), &framing, exposed);
    let response = Response::default();
    let real = (255.0 * response.encode(2.0 * response.decode(60.0 / 255.0))).round() as u32;
    // The board's edges at 160 ± 40 of 320 are at 640 ± 320 of 1280, and sharp. 1.6 times white
    // clips.
    let row: Vec<u32> = (0..1280).map(|x| done.at(x, 480)[1]).collect();
    assert!(row[..319].iter().chain(&row[961..]).all(|&c| c == real), "{real}: {:?}", &row[310..330]);
    assert!(row[321..959].iter().all(|&c| c == 255));
}

#[test]
fn chromatic_aberration_leaves_the_real_part_unchanged() {
    let geometry = gpu::pinhole(320, 240, FOCAL_PX);
    let camera = camera(&geometry, None);
    let framing = Framing::new(&geometry, None, None, f64::INFINITY, None).unwrap();
    let settings = gpu::settings(&[("chromatic_aberration", "red", Value::Number(0.01))]);
    let pixels = gpu::grey(320, 240, 60);
    // In the upper left corner: most of the picture is outside of the layer.
    let board = board::panel([-150.0, -110.0], [-90.0, -70.0], 0.8);
    let done = photo_with(settings, &camera, board, pixels, &framing, AS_RECORDED);
    for (x, y) in (60..240).flat_map(|y| (0..320).map(move |x| (x, y))).chain((0..320).map(|x| (x, 4))) {
        assert_eq!(done.at(x, y), [60; 3], "{x} {y}");
    }
    // Red is displaced outwards: at the upper left it shows beside white, at the lower right it is
    // missing.
    let columns = |channel: usize| (0..320).filter(|&x| done.at(x, 30)[channel] > 150).collect::<Vec<u32>>();
    assert!(columns(0).first() < columns(1).first() && columns(0).last() < columns(1).last());
}

#[test]
fn regions_of_a_photo_join_without_a_seam() {
    let geometry = gpu::pinhole(320, 240, FOCAL_PX);
    let camera = camera(&geometry, Some(noise()));
    let opening = Opening { diameter_m: 0.03, focus_distance_m: 1.0, blades: 5, rotation_rad: 0.0 };
    let track = sideways([200.0, 0.0]);
    // A floor that approaches downwards, and a post in front of it; bright stripes on both.
    let places = || (0..240u32).flat_map(|y| (0..320u32).map(move |x| (x, y)));
    let depth_m: Vec<f32> =
        places().map(|(x, y)| if (90..140).contains(&x) { 0.8 } else { 4.0 - 3.0 * y as f32 / 240.0 }).collect();
    let stripes = places().flat_map(|(x, y)| [if (x / 9 + y / 7).is_multiple_of(3) { 200 } else { 60 }; 3]).collect();
    let stripes = Pixels::from_u8(320, 240, stripes).unwrap();
    let light = vec![[0.1; 3]; depth_m.len()];
    let surfaces = Surfaces {
        background_m: depth_m.clone(),
        background_light: light.clone(),
        nearest: DepthGrid { width: 320, height: 240, enlargement: 1.0, depth_m, light, is_dilated: true },
    };
    let made = |regions: &[Rect], surfaces: Option<&Surfaces>| {
        let gpu = gpu::gpu();
        let mut compositor = Compositor::new(gpu.clone(), board([60.0, 50.0], 0.5));
        let mut made = stripes.clone();
        for region in regions {
            let capture = Capture {
                region: *region,
                whole: true,
                over_ev: 0.5,
                film: Some(FilmOverride { speed: 4.0, width_mm: 36.0 }),
                ..Capture::frame(&geometry, TIME_S, Some(opening))
            };
            let job = Job {
                frame: gpu::frame(3, 0.0, stripes.clone()),
                picture: &geometry,
                capture,
                real: RealDepth::Known { grid: None, surfaces, moments: &[] },
                track: &track,
                interval_s: 1.0 / 30.0,
                want_layer: false,
            };
            let pending = compositor.submit(job, &camera, &Settings::default(), Target::Pixels).unwrap();
            let done = compositor.collect(pending).unwrap().pixels;
            let (Codes::U8(to), Codes::U8(from)) = (&mut made.codes, &done.codes) else { panic!("8 bits went in") };
            for y in region.y0..region.y1 {
                let row = 3 * (y * 320 + region.x0) as usize..3 * (y * 320 + region.x1) as usize;
                to[row.clone()].copy_from_slice(&from[row]);
            }
        }
        made
    };
    let parts = [
        Rect::new(0, 0, 130, 110),
        Rect::new(130, 0, 320, 110),
        Rect::new(0, 110, 130, 240),
        Rect::new(130, 110, 320, 240),
    ];
    // The layered method's samples fall on different texels of the smaller pictures if a region
    // begins elsewhere: a few codes.
    for (surfaces, max_codes) in [(None, 4), (Some(&surfaces), 1)] {
        let (whole, parts) = (made(&[Rect::full(320, 240)], surfaces), made(&parts, surfaces));
        let (Codes::U8(a), Codes::U8(b)) = (&whole.codes, &parts.codes) else { panic!("8 bits went in") };
        let far = a.iter().zip(b).filter(|(a, b)| a.abs_diff(**b) > 1).count();
        let worst = a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
        assert!(
            far < a.len() / 50 && worst <= max_codes,
            "{far} of {} differ by more than a code, the worst by {worst}",
            a.len()
        );
    }
}

#[test]
fn real_edge_of_coarse_depth_has_no_steps() {
    let (size, geometry) = ((320, 240), gpu::pinhole(320, 240, FOCAL_PX));
    // A surface at 1 m ends at a slanted line. Its depth is sampled once per 4 by 4 pixels.
    let (leans, every) = (0.3, 4);
    let edge_px = |y_px: f64| 90.0 + leans * y_px;
    let middle = |n: u32| f64::from(every * n) + 0.5 * f64::from(every);
    let (width, height) = (size.0 / every, size.1 / every);
    let depth_m = (0..width * height).map(|i| if middle(i % width) < edge_px(middle(i / width)) { 1.0 } else { 3.0 });
    let depth_m = depth_m.collect();
    let grid = DepthGrid { width, height, enlargement: every.into(), depth_m, light: Vec::new(), is_dilated: false };
    let mut settings = Settings::default();
    settings.plain();
    settings.depth.occlusion = true;
    let job = Job {
        frame: gpu::frame(3, 0.0, gpu::grey(size.0, size.1, 60)),
        picture: &geometry,
        capture: Capture { whole: true, ..Capture::frame(&geometry, TIME_S, None) },
        real: RealDepth::Known { grid: Some(&grid), surfaces: None, moments: &[] },
        track: &sideways([0.0, 0.0]),
        interval_s: 1.0 / 30.0,
        want_layer: false,
    };
    let mut compositor = Compositor::new(gpu::gpu().clone(), board::panel([-400.0, -300.0], [400.0, 300.0], 2.0));
    let pending = compositor.submit(job, &camera(&geometry, None), &settings, Target::Pixels).unwrap();
    let done = compositor.collect(pending).unwrap().pixels;
    let [real, evidence] = [2, 300].map(|x| f64::from(done.at(x, 120)[1]));
    assert!(real == 60.0 && evidence > 150.0, "{real} {evidence}");
    // Threshold in codes: the transition takes one pixel of a row.
    let hidden =
        |y: u32| (0..size.0).map(|x| (evidence - f64::from(done.at(x, y)[1])) / (evidence - real)).sum::<f64>();
    let ends: Vec<f64> = (20..220).map(hidden).collect();
    for (n, end) in ends.iter().enumerate() {
        let off_px = end - edge_px(n as f64 + 20.5);
        assert!(off_px.abs() < 0.65 * f64::from(every), "row {n}: {off_px}");
    }
    // Unfiltered, the grid's pixels would make steps of four.
    let steps = ends.windows(2).map(|two| (two[1] - two[0]).abs());
    assert!(steps.clone().fold(0.0, f64::max) < 2.0, "{:?}", steps.collect::<Vec<_>>());
}

/// A rolling shutter reads the rows of a cropped picture at their times in the whole picture.
#[test]
fn cropped_rolling_shutter_photo_keeps_the_row_times_of_the_whole_picture() {
    const READOUT_S: f64 = 0.03;
    let mut intrinsics = gpu::pinhole(160, 120, FOCAL_PX).intrinsics;
    intrinsics.readout_time_s = READOUT_S;
    let camera = camera(&Geometry::new(intrinsics, Distortion::default()), None);
    let geometry = camera.geometry.as_ref().unwrap();
    let mut settings = Settings::default();
    settings.plain();
    let exposed = PhotoExposure { time_s: 0.0, ..AS_RECORDED };
    // 40 columns of 160 and 30 rows of 120, at the upper border.
    let aim = Aim { at_px: Some([80.0, 15.0].into()), around_px: Some([40.0, 30.0].into()) };
    let whole = Framing::new(geometry, None, None, f64::INFINITY, None).unwrap();
    let part = Framing::aimed(geometry, None, None, f64::INFINITY, None, aim).unwrap();
    assert_eq!((part.size(), part.framed.left_px, part.framed.top_px), ((40, 30), 60.0, 0.0));
    for framing in [whole, part] {
        let (width, height) = framing.size();
        // A board over rows 4 to 26, around column 80 when the middle row is read. It moves 200 px
        // a second.
        let scene = board::panel([-10.0, -56.0], [10.0, -34.0], 0.5);
        let done = photo_with(settings.clone(), &camera, scene, gpu::grey(width, height, 60), &framing, exposed);
        let decode = |code: u32| camera.response.decode(f64::from(code) / 255.0);
        for y in 6..24 {
            // Coverage is linear in light.
            let covered: Vec<f64> = (0..width).map(|x| decode(done.at(x, y)[1]) - decode(60)).collect();
            let moment: f64 = covered.iter().enumerate().map(|(x, share)| (x as f64 + 0.5) * share).sum();
            let centroid_px = framing.framed.left_px + moment / covered.iter().sum::<f64>();
            let expected = 80.0 + 200.0 * READOUT_S * ((f64::from(y) + 0.5) / 120.0 - 0.5);
            // A pixel has four samples: each edge is known to an eighth of a pixel.
            assert!(
                (centroid_px - expected).abs() < 0.2,
                "{width} px wide, row {y}: {centroid_px}, by hand {expected}"
            );
        }
    }
}

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

/// Runs `locard photo`. No shadows in the fast tier: these tests do not depend on them.
fn shoot(arguments: &[&str]) -> std::process::Output {
    shoot_in(Path::new("recordings/demo"), arguments)
}

fn shoot_in(recording: &Path, arguments: &[&str]) -> std::process::Output {
    let (recording, scene) = (Path::new(ROOT).join(recording), format!("{ROOT}/scenes/demo.toml"));
    let _gpu = gpu::gpu();
    let shadows = fast_or_full(&["--set", "shadow.cast=false"][..], &[]);
    let usual = ["photo", recording.to_str().unwrap(), "--scene", &scene];
    program::locard(&[&usual[..], arguments, shadows].concat())
}

/// The demonstration at 1/`smaller` of its resolution.
fn recording(smaller: u32) -> PathBuf {
    if smaller == 1 { "recordings/demo".into() } else { Reduction::by(smaller).demo() }
}

#[test]
fn bracket_writes_a_series_with_contact_sheet_and_exif() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("door.jpg");
    let out = out.to_str().unwrap();
    let series = ["--frame", "10", "--bracket", "iso", "--lux", "300", "--aperture", "4", "--focus", "1.5", "-o", out];
    let series = [&series[..], fast_or_full(&["--width", "320"], &[])].concat();
    let done = shoot(&series);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    assert!(done.stdout.is_empty());
    let text = String::from_utf8_lossy(&done.stderr).into_owned();
    assert!(!text.contains("only virtual objects"), "{text}");
    let settings =
        |n: usize| locard::source::exif::read(&folder.path().join(format!("door-{n}.jpg"))).unwrap().settings;
    for (n, iso) in [100.0, 200.0, 400.0, 800.0, 1600.0, 3200.0, 6400.0, 12800.0, 25600.0].into_iter().enumerate() {
        let settings = settings(n + 1);
        assert_eq!((settings.iso, settings.f_number), (Some(iso), Some(4.0)));
    }
    // EV of 300 lx at ISO 100 is 6.91: f/4 needs 16/120 s, of which 1/8 is the nearest; two stops
    // faster film 1/30.
    let part = |n| (1.0 / settings(n).time_s.unwrap()).round();
    assert_eq!([part(1), part(3)], [8.0, 30.0]);
    assert!(image::image_dimensions(folder.path().join("door-sheet.jpg")).unwrap().0 > 1400);
    // Nine photographs with their records, and the sheet.
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 19);
    let again = shoot(&[&series[..], &["--only", ""]].concat());
    assert!(String::from_utf8_lossy(&again.stderr).contains("there are: motion_blur"), "names are asked for");
    let again = shoot(&series);
    assert_eq!(again.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&again.stderr).contains("door-1.jpg: exists already"));
}

#[test]
fn impossible_camera_values_are_refused_with_the_accepted_range() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a.jpg");
    let out = out.to_str().unwrap();
    let cases: [(&[&str], &[&str]); 17] = [
        (&["--frame", "1", "--hand-held", "--tripod"], &["--hand-held", "cannot be used with", "--tripod"]),
        (&["--frame", "1", "--across", "300", "--focal", "90"], &["--across", "cannot be used with", "--focal"]),
        (&["--frame", "1", "--across", "700"], &["700 px across", "covers 640 px"]),
        (&["--frame", "1", "--aim", "640.5,3"], &["--aim 640.5,3 lies outside the picture, 640x480 px"]),
        (&["--frame", "1", "--aim", "knife"], &["--aim knife", "the name of one object", "marker 1"]),
        (&["--frame", "4000"], &["--frame 4000", "numbered 0 to "]),
        (&["--frame", "1", "--aperture", "0"], &["--aperture", "expected an f-number from 0.5 to 256"]),
        (&["--frame", "1", "--shutter", "0"], &["--shutter", "expected more than 0"]),
        (&["--frame", "1", "--iso", "50"], &["--iso", "expected ISO 100 to 25600"]),
        (&["--frame", "1", "--focal", "20"], &["20.0 mm", "covers more than the recording", "or more"]),
        (&["--frame", "1", "--focal", "100", "--focus", "0.05"], &["0.05 m", "within the focal length"]),
        (&["--frame", "1", "--film", "huge"], &["huge is not a film format", "36x24"]),
        (&["--frame", "1", "--mode", "a"], &["--mode a needs --aperture"]),
        (
            &["--frame", "1", "--mode", "p", "--shutter", "1/60"],
            &["--mode p chooses the shutter", "leave --shutter out"],
        ),
        (&["--frame", "1", "--hand-held", "--shutter", "60"], &["--shutter 60", "around frame 1", "up to"]),
        (&["--frame", "1", "--mode", "x"], &["not a mode", "p (program)"]),
        (&["--frame", "1", "--set", "camera.lens.blades=2"], &["camera.lens.blades = 2", "3 to 32"]),
    ];
    for (arguments, expected) in cases {
        let done = shoot(&[arguments, &["-o", out]].concat());
        let text = String::from_utf8_lossy(&done.stderr).into_owned();
        assert_eq!(done.status.code(), Some(2), "{arguments:?}: {text}");
        for part in expected {
            assert!(text.contains(part), "{arguments:?}: {text}");
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "{arguments:?} left something");
    }
    let done = shoot(&["--frame", "1", "-o", "a.gif"]);
    assert!(String::from_utf8_lossy(&done.stderr).contains("expected .jpg or .png"));
}

/// The demonstration's camera turns fast in frame 36. At 20 lx the shutter stays open for many
/// frames: on a tripod this blurs nothing more, and hand-held only where motion is visible at all.
// Slow: starts the program five times, with an exposure of many frames.
#[test]
fn slow_shutter_on_a_tripod_shows_the_frame_itself() {
    let folder = tempfile::tempdir().unwrap();
    let taken = |name: &str, arguments: &[&str]| {
        let out = folder.path().join(name);
        let usual =
            ["--frame", "36", "--lux", "20", "--mode", "m", "--aperture", "2.8", "--shutter", "1/4", "--focus", "inf"];
        let done =
            shoot_in(&recording(fast_or_full(4, 1)), &[&usual[..], &["-o", out.to_str().unwrap()], arguments].concat());
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        image::open(out).unwrap().into_rgb8()
    };
    let without = ["--without", "motion_blur,depth_of_field"];
    let stand = taken("stand.png", &["--without", "depth_of_field"]);
    let named = taken("named.png", &["--without", "depth_of_field", "--tripod"]);
    let hand = taken("hand.png", &["--without", "depth_of_field", "--hand-held"]);
    assert!(stand == named);
    // Edges of the frame itself, away from the evidence.
    let edges = |picture: &image::RgbImage| {
        let across = |x: u32, y: u32| i64::from(picture.get_pixel(x, y)[1]) - i64::from(picture.get_pixel(x - 1, y)[1]);
        (0..picture.height())
            .flat_map(|y| (1..picture.width()).map(move |x| (x, y)))
            .map(|(x, y)| across(x, y).pow(2))
            .sum::<i64>()
    };
    assert!(edges(&stand) > 3 * edges(&hand), "{} {}", edges(&stand), edges(&hand));
    // Sharp evidence in footage of a single moment.
    let sharp = [taken("a.png", &without), taken("b.png", &[&without[..], &["--hand-held"]].concat())];
    assert!(sharp[0] == sharp[1]);
}

#[test]
fn aimed_point_is_at_the_centre_of_the_photo() {
    let folder = tempfile::tempdir().unwrap();
    let smaller = fast_or_full(2, 1);
    let taken = |name: &str, arguments: &[&str]| {
        let out = folder.path().join(name);
        let usual = ["--frame", "71", "--lux", "300", "--only", "motion_blur", "-o", out.to_str().unwrap()];
        let done = shoot_in(&recording(smaller), &[&usual[..], arguments].concat());
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        image::open(out).unwrap().into_rgb8()
    };
    let whole = taken("whole.png", &["--focus", "inf", "--aperture", "22"]);
    let [x0, y0, width, height, aim_x, aim_y] = [340, 70, 160, 120, 420, 130].map(|px| px / smaller);
    let (aim, across) = (format!("{aim_x},{aim_y}"), width.to_string());
    let part = taken("part.png", &["--focus", "inf", "--aperture", "22", "--aim", &aim, "--across", &across]);
    assert_eq!(part.dimensions(), (width, height));
    // The same pixels from (x0, y0) on, except for the row times of virtual ones.
    let same = part.enumerate_pixels().filter(|&(x, y, p)| whole.get_pixel(x0 + x, y0 + y) == p).count() as u32;
    assert!(same > width * height * 97 / 100, "{same}");
    let (wide, high) = (800 / smaller, 600 / smaller);
    let object = taken("object.png", &["--focus", "inf", "--aim", "marker 1", "--width", &wide.to_string()]);
    assert_eq!(object.dimensions(), (wide, high));
}
