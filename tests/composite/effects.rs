//! Effects on the GPU compared with their formulas: blur lengths, noise variance, the CPU
//! reference. One file, because the tests share the cameras and the measures of a blur.

use crate::board;
use crate::board::{FOCAL_PX, board, sideways};
use crate::gpu;
use crate::tier::fast_or_full;
use glam::{DAffine3, DVec3};
use locard::camera::grain::{self, GrainRatios};
use locard::camera::{Camera, Capture, Curve, Geometry, NoiseBin, NoiseProfile, Response};
use locard::compositor::{Composited, Compositor, Job, Settings, Target};
use locard::effects::{FrameContext, edge_blend, motion_blur, noise};
use locard::frame::{FrameExposure, PhotoSettings, RelativeBrightness, SpatialGain};
use locard::measure::edge::box_blur;
use locard::params::Value;
use locard::scene::Scene;

const EXPOSURE_S: f64 = 0.02;

fn blurred(geometry: &Geometry, blur_px: [f64; 2], method: &str) -> Composited {
    let camera = gpu::camera(geometry, EXPOSURE_S);
    let sets = [
        ("motion_blur", "method", Value::Text(method.to_owned())),
        ("motion_blur", "threshold_px", Value::Number(0.0)),
        ("motion_blur", "copies", Value::Number(64.0)),
    ];
    let track = sideways(blur_px.map(|px| px / EXPOSURE_S));
    let (width, height) = (geometry.intrinsics.width_px, geometry.intrinsics.height_px);
    let frame = gpu::frame(0, 0.0, gpu::grey(width, height, 0));
    gpu::composite(&gpu::gpu(), &camera, gpu::settings(&sets), board([60.0, 50.0], 0.8), &track, frame)
}

#[test]
fn silhouette_blur_matches_the_analytic_length() {
    let geometry = gpu::pinhole(320, 240, FOCAL_PX);
    for method in ["velocity", "copies", "reference"] {
        for &length in fast_or_full(&[2.0, 13.0, 40.0][..], &[2.0, 3.5, 8.0, 13.0, 20.0, 40.0]) {
            let layer = blurred(&geometry, [length, 0.0], method).layer.unwrap();
            // The left silhouette at x = 100, from outside to inside.
            let profile: Vec<f64> = (60..140).map(|x| f64::from(layer.rgba[120 * 320 + x][3])).collect();
            let blur = box_blur(&profile, 1.0, 1.0).unwrap();
            assert!((blur.length_px - length).abs() <= 0.5, "{method} {length}: {blur:?}");
            assert!((blur.position_px - 40.0).abs() <= 0.75, "{method} {length}: {blur:?}");
        }
    }
}

/// vSLRcam (12), H = ∫ E dt over the open shutter: a board of radiance 0.8 whose side moves from 90
/// to 110 px covers the middle of pixel 92, at 92.5 px, for an eighth of the time, and so on. The
/// total is 0.8 on 120 px: 96.
#[test]
fn exposure_integrates_over_the_open_shutter() {
    let geometry = gpu::pinhole(320, 240, FOCAL_PX);
    for (method, within) in [("velocity", 0.03), ("copies", 0.02), ("reference", 0.02)] {
        let layer = blurred(&geometry, [20.0, 0.0], method).layer.unwrap();
        let row = &layer.rgba[120 * 320..121 * 320];
        for (x, expected) in [(88, 0.0), (92, 0.1), (94, 0.18), (99, 0.38), (104, 0.58), (107, 0.7), (111, 0.8)] {
            let light = f64::from(row[x][0]);
            assert!((light - expected).abs() < within, "{method}, {x}: {light}, not {expected}");
        }
        let sum: f64 = row.iter().map(|p| f64::from(p[0])).sum();
        assert!((sum - 96.0).abs() < 0.5, "{method}: {sum}");
    }
}

#[test]
fn light_follows_the_spatial_gain_of_the_footage() {
    let geometry = gpu::pinhole(320, 240, FOCAL_PX);
    let track = sideways([0.0, 0.0]);
    let drawn = |brightness: Option<RelativeBrightness>, sets: &[(&str, &str, Value)]| {
        let mut frame = gpu::frame(0, 0.0, gpu::grey(320, 240, 0));
        frame.exposure.brightness = brightness;
        let camera = gpu::camera(&geometry, 0.0);
        gpu::composite(&gpu::gpu(), &camera, gpu::settings(sets), board([120.0, 90.0], 0.4), &track, frame)
            .layer
            .unwrap()
    };
    // A different value at each node, up to 0.6 stops.
    let across = SpatialGain(std::array::from_fn(|n| ((7 * n) % 20) as f32 * 0.06 - 0.6));
    let brightness = RelativeBrightness { factors: [1.0, 0.5, 2.0], median_s: None, spatial_gain: across };
    let as_lit = drawn(None, &[]);
    let follows = drawn(Some(brightness), &[]);
    assert_eq!(drawn(Some(brightness), &[("exposure", "follow", Value::Bool(false))]).rgba, as_lit.rgba);
    let mut seen_pixels = 0;
    for (i, (lit, follows)) in as_lit.rgba.iter().zip(&follows.rgba).enumerate().filter(|(_, (lit, _))| lit[3] == 1.0) {
        let place = [(i % 320) as f32 + 0.5, (i / 320) as f32 + 0.5];
        let factor = across.at([place[0] / 320.0, place[1] / 240.0]).exp2();
        for (c, gain) in [1.0, 0.5, 2.0].into_iter().enumerate() {
            // Half floats have 11 significant bits.
            let expected = lit[c] * gain * factor;
            assert!((follows[c] / expected - 1.0).abs() < 2e-3, "{place:?}: {} for {expected}", follows[c]);
        }
        seen_pixels += 1;
    }
    assert!(seen_pixels > 40_000, "{seen_pixels}");
}

#[test]
fn accumulation_matches_the_finite_sum_of_the_paper() {
    // 20 ms at 500 frames a second: n = 10, α = 0.676 (14); 20 px in ten steps of 2 px.
    let geometry = gpu::pinhole(320, 240, FOCAL_PX);
    let sets = [
        ("motion_blur", "method", Value::Text("accumulation".to_owned())),
        ("motion_blur", "frames_per_s", Value::Number(500.0)),
    ];
    let track = sideways([20.0 / EXPOSURE_S, 0.0]);
    let draw = |index: usize| {
        let frame = gpu::frame(index, 0.0, gpu::grey(320, 240, 0));
        let camera = gpu::camera(&geometry, EXPOSURE_S);
        gpu::composite(&gpu::gpu(), &camera, gpu::settings(&sets), board([60.0, 50.0], 0.8), &track, frame)
            .layer
            .unwrap()
    };
    let layer = draw(0);
    // The board covers 100 to 220 px in the middle of the exposure. The mean of all frames is
    // centred there: the newest, with weight 1 − α, is Σ i·wᵢ = 2.05 steps further to the right;
    // the oldest, with weight α^10 = 1/50, is 7.95 to the left. That is 4.09 px; the four samples
    // of a pixel are beyond its first 0.09.
    let alpha = 0.676_243_f64;
    let weight = |i: i32| if i == 10 { 0.02 } else { (1.0 - alpha) * alpha.powi(i) };
    let mean: f64 = (0..=10).map(|i| f64::from(i) * weight(i)).sum();
    assert!((mean - 2.047).abs() < 1e-3, "{mean}");
    for x in 85..235 {
        let covered = |i: i32| {
            let shift = 4 - 2 * i;
            (100 + shift..220 + shift).contains(&x)
        };
        let twin: f64 = (0..=10).filter(|i| covered(*i)).map(weight).sum();
        let alpha = f64::from(layer.rgba[120 * 320 + x as usize][3]);
        assert!((alpha - twin).abs() < 1e-3, "{x}: {alpha}, not {twin}");
    }
    // At the board's position in the frame, within half a sample's width: centred on 100 to 220 px.
    let row = &layer.rgba[120 * 320..121 * 320];
    let centre =
        |f: fn(f64) -> f64| row.iter().enumerate().map(|(x, p)| f64::from(p[3]) * f(x as f64 + 0.5)).sum::<f64>();
    let centroid_px = centre(|x| x) / centre(|_| 1.0);
    assert!((centroid_px - 160.0).abs() < 0.15, "{centroid_px}");
    // Independent of earlier frames.
    assert_eq!(layer.rgba, draw(7).rgba);
}

#[test]
fn summed_samples_keep_the_depth_of_the_nearest_surface() {
    let geometry = gpu::pinhole(160, 120, FOCAL_PX);
    // A board at 2 m moves by 8 px during the exposure. One at 1 m, from 76 to 84 px in its middle,
    // moves by 16 px: it covers each pixel from 68 to 92 px for a part of the exposure, and the far
    // board is seen there in the rest of it.
    let mut near = board([4.0, 40.0], 0.8);
    near.objects[0].parts[0].world_from_mesh = DAffine3::from_scale(DVec3::splat(0.5));
    let scene = board::merge_scenes(board([60.0, 50.0], 0.4), near);
    let settings = gpu::settings(&[("motion_blur", "method", Value::Text("reference".to_owned()))]);
    let (camera, track) = (gpu::camera(&geometry, EXPOSURE_S), sideways([8.0 / EXPOSURE_S, 0.0]));
    let frame = gpu::frame(0, 0.0, gpu::grey(160, 120, 0));
    let layer = gpu::composite(&gpu::gpu(), &camera, settings, scene, &track, frame).layer.unwrap();
    for x in (30..66).chain(70..90).chain(94..130) {
        let nearest_m = if (70..90).contains(&x) { 1.0 } else { 2.0 };
        let found_m = layer.depth_m[60 * 160 + x];
        assert!((found_m - nearest_m).abs() < 1e-4, "{x}: {found_m} m, not {nearest_m} m");
    }
}

/// Row y is read at readout · y / height. A point that moves down at V px/s moves by
/// dy = V (ds + readout / height · dy) during a time ds of the exposure: its velocity is
/// V / (1 - V · readout / height). A board is stretched by the same factor.
#[test]
fn velocity_under_a_rolling_shutter_includes_the_readout_of_the_rows_passed() {
    let mut geometry = gpu::pinhole(160, 120, FOCAL_PX);
    geometry.intrinsics.readout_time_s = 0.02;
    let camera = gpu::camera(&geometry, 0.0);
    for down_px_per_s in [600.0, -600.0] {
        let stretch = 1.0 / (1.0 - down_px_per_s * 0.02 / 120.0);
        let track = sideways([300.0, down_px_per_s]);
        let frame = gpu::frame(0, 0.0, gpu::grey(160, 120, 0));
        let scene = board([50.0, 30.0], 0.8);
        let layer = gpu::composite(&gpu::gpu(), &camera, Settings::default(), scene, &track, frame).layer.unwrap();
        let height_px: f64 = layer.rgba.iter().skip(80).step_by(160).map(|p| f64::from(p[3])).sum();
        assert!((height_px - 60.0 * stretch).abs() < 0.5, "{down_px_per_s} px/s: {height_px} px high");
        for y in [40, 60, 80] {
            let [right, down] = layer.velocity[y * 160 + 80].map(f64::from);
            let expected = [300.0 * stretch, down_px_per_s * stretch];
            // Half floats have steps of 0.5 px/s here.
            let close = (right - expected[0]).abs() < 1.0 && (down - expected[1]).abs() < 1.0;
            assert!(close, "row {y}: {right}, {down} px/s, by hand {expected:?}");
        }
    }
}

/// One second of a hand that trembles five times; at the ends and in the middle it is at rest. A
/// point beside the middle is covered while A sin(φ) > d - h.
#[test]
fn long_exposure_follows_the_camera_shake() {
    let (half, swing) = (20.0, 20.0);
    let track = board::displaced_by(600, 0.001, |t| [swing * (10.0 * std::f64::consts::PI * t).sin(), 0.0]);
    for readout_s in [0.0, 0.004] {
        let mut geometry = gpu::pinhole(160, 60, FOCAL_PX);
        geometry.intrinsics.readout_time_s = readout_s;
        let settings = gpu::settings(&[("motion_blur", "method", Value::Text("reference".to_owned()))]);
        let frame = gpu::frame(0, 0.0, gpu::grey(160, 60, 0));
        let camera = gpu::camera(&geometry, 1.0);
        let done = gpu::composite(&gpu::gpu(), &camera, settings, board([half, 20.0], 0.8), &track, frame);
        let layer = done.layer.unwrap();
        for (row, x) in [12, 30, 47].into_iter().flat_map(|row| (10..150).map(move |x| (row, x))) {
            let beside = ((x as f64 + 0.5) - 80.0).abs();
            let expected = 0.5 - ((beside - half) / swing).clamp(-1.0, 1.0).asin() / std::f64::consts::PI;
            let alpha = f64::from(layer.rgba[row * 160 + x][3]);
            // At the turning points of the hand, coverage rises as a square root.
            let limit = if (beside - half).abs() > swing - 2.0 { 0.08 } else { 0.012 };
            assert!((alpha - expected).abs() < limit, "{readout_s} s, {x}, {row}: {alpha}, by hand {expected}");
        }
    }
}

/// With the defaults, consecutive frames are one exposure apart, and the sampled positions precede
/// the frame's.
#[test]
fn accumulation_is_centred_on_the_position_in_the_frame() {
    let geometry = gpu::pinhole(320, 240, FOCAL_PX);
    for length in [-40.0, 25.0] {
        let layer = blurred(&geometry, [length, 0.0], "accumulation").layer.unwrap();
        let row = &layer.rgba[120 * 320..121 * 320];
        let centre =
            |f: fn(f64) -> f64| row.iter().enumerate().map(|(x, p)| f64::from(p[3]) * f(x as f64 + 0.5)).sum::<f64>();
        let (area, centre_px) = (centre(|_| 1.0), centre(|x| x) / centre(|_| 1.0));
        assert!((area - 120.0).abs() < 0.2, "{length}: something is cut off, {area}");
        assert!((centre_px - 160.0).abs() < 0.3, "{length}: {centre_px}");
    }
}

#[test]
fn blur_longer_than_the_picture_keeps_its_coverage() {
    let geometry = gpu::pinhole(320, 240, FOCAL_PX);
    let length_px = 1000.0;
    let layer = blurred(&geometry, [length_px, 0.0], "velocity").layer.unwrap();
    // The board, 120 px wide, covers each pixel for 12 % of the exposure.
    for x in (64..256).step_by(8) {
        let alpha = f64::from(layer.rgba[120 * 320 + x][3]);
        assert!((alpha - 120.0 / length_px).abs() < 1.0 / 255.0, "{x}: {alpha}");
    }
}

#[test]
fn diagonal_blur_matches_the_mean_over_the_shutter() {
    let (width, height) = fast_or_full((160, 120), (320, 240));
    let geometry = gpu::pinhole(width, height, FOCAL_PX);
    let still = blurred(&geometry, [0.0, 0.0], "velocity").layer.unwrap();
    let sharp: Vec<[f64; 4]> = still.rgba.iter().map(|p| p.map(f64::from)).collect();
    for motion in [[9.0, 6.0], [-4.0, 11.0]] {
        let twin = motion_blur::twin(&sharp, width as usize, height as usize, motion);
        let layer = blurred(&geometry, motion, "velocity").layer.unwrap();
        let mut worst = 0.0f64;
        let mut sum = 0.0;
        for (a, b) in layer.rgba.iter().zip(&twin) {
            let error = (f64::from(a[3]) - b[3]).abs();
            worst = worst.max(error);
            sum += error;
        }
        // The filter takes one tap a pixel with whole weights, the reference interpolates in both
        // axes: at an edge they differ by at most one pixel's share of the line.
        let longest = motion[0].abs().max(motion[1].abs());
        assert!(worst < 1.0 / longest, "{motion:?}: {worst}");
        let area = twin.iter().map(|p| p[3]).sum::<f64>();
        assert!(sum / area < 0.01, "{motion:?}: {}", sum / area);
    }
}

fn noisy_camera(geometry: &Geometry, correlation: f64) -> Camera {
    let mut camera = gpu::camera(geometry, 0.0);
    let bins = vec![NoiseBin { code: 0.0, sigma: 1.0 }, NoiseBin { code: 255.0, sigma: 6.1 }];
    camera.noise = Some(NoiseProfile {
        example: None,
        bins: [bins.clone(), bins.clone(), bins],
        channel_correlation: [0.5, 0.2, 0.3],
        neighbour_correlation: [correlation; 2],
    });
    camera
}

fn noisy(camera: &Camera, settings: Settings, grey: f32, frame: usize) -> Composited {
    let frame = gpu::frame(frame, 0.0, gpu::grey(320, 240, 90));
    gpu::composite(&gpu::gpu(), camera, settings, board([200.0, 150.0], grey), &sideways([0.0, 0.0]), frame)
}

/// Mean, σ, correlation with the right neighbour, and correlation of R with G, over the board.
fn statistics(codes: &[u8], width: usize) -> [f64; 4] {
    let at = |i: usize, c: usize| f64::from(codes[3 * i + c]);
    let n = (codes.len() / 3) as f64;
    let mean = |c: usize| (0..codes.len() / 3).map(|i| at(i, c)).sum::<f64>() / n;
    let (m, g) = (mean(0), mean(1));
    let variance = (0..codes.len() / 3).map(|i| (at(i, 0) - m).powi(2)).sum::<f64>() / n;
    let green = (0..codes.len() / 3).map(|i| (at(i, 1) - g).powi(2)).sum::<f64>() / n;
    let right =
        (0..codes.len() / 3 - 1).filter(|i| i % width != width - 1).map(|i| (at(i, 0) - m) * (at(i + 1, 0) - m));
    let both = (0..codes.len() / 3).map(|i| (at(i, 0) - m) * (at(i, 1) - g)).sum::<f64>() / n;
    [m, variance.sqrt(), right.sum::<f64>() / n / variance, both / (variance * green).sqrt()]
}

#[test]
fn virtual_pixels_have_the_camera_noise() {
    let geometry = gpu::pinhole(320, 240, FOCAL_PX);
    for (correlation, magnification) in [(0.0, 1.0), (0.5, 1.0), (0.0, 3.0), (0.4, 2.5)] {
        let camera = noisy_camera(&geometry, correlation);
        let settings = gpu::settings(&[("noise", "magnification", Value::Number(magnification))]);
        let done = noisy(&camera, settings, 0.2, 3);
        let [mean, sigma, right, channels] = statistics(done.pixels.codes.eight_bit().unwrap(), 320);
        // 0.2 in linear light is sRGB code 123.5, where σ = 1 + 5.1 · 123.5/255 = 3.47; rounding to
        // integers adds 1/12 to the variance. 76,800 pixels, fewer independent ones with large
        // patches: three standard errors of σ are 0.3 to 2 %, hence the tolerance of 2 %.
        let expected = (3.47f64.powi(2) + 1.0 / 12.0).sqrt();
        assert!((mean - 123.5).abs() < 0.2, "{mean}");
        assert!((sigma / expected - 1.0).abs() < 0.02 * magnification, "{correlation} {magnification}: {sigma}");
        assert!((channels - 0.5).abs() < 0.03 * magnification, "{channels}");
        if magnification == 1.0 {
            assert!((right - correlation).abs() < 0.02, "{right}");
        } else {
            assert!(right > 0.6, "{right}");
        }
    }
}

#[test]
fn noise_matches_the_cpu_reference() {
    let geometry = gpu::pinhole(320, 240, FOCAL_PX);
    // Another film speed is relative to the camera's 200: half a stop in grain diameter, eight
    // times the variance of shot noise.
    for (magnification, iso) in [(1.0, None), (2.5, None), (1.0, Some(1600.0)), (1.5, Some(100.0)), (1.0, Some(100.0))]
    {
        let mut camera = noisy_camera(&geometry, 0.4);
        camera.exposure.iso = Some(200.0);
        let film = ("noise", "iso", iso.map_or(Value::None, Value::Number));
        let settings = gpu::settings(&[("noise", "magnification", Value::Number(magnification)), film]);
        let done = noisy(&camera, settings, 0.2, 7);
        let plain = noisy(&camera, gpu::settings(&[("noise", "scale", Value::Number(0.0))]), 0.2, 7);
        let params = noise::Noise { magnification: magnification as f32, iso, ..Default::default() };
        let capture = Capture::frame(&geometry, 0.0, None);
        let context = FrameContext {
            camera: &camera,
            picture: &geometry,
            capture: &capture,
            frame: 7,
            seed: 0,
            coding: None,
            max_code: 255,
            recorded: FrameExposure::default(),
            interval_s: 1.0 / 30.0,
            resting_frames: 0,
            fastest_px_per_s: 0.0,
            depths_m: [1.0, 1.0],
            real_depths_m: None,
            objects: &[],
        };
        // The unrounded value that the noise is added to; the layer has 16-bit floats.
        let mean = 255.0 * camera.response.encode(half::f16::from_f32(0.2).to_f64());
        assert_eq!(f64::from(plain.pixels.codes.eight_bit().unwrap()[0]), mean.round());
        let ratios = GrainRatios { iso: iso.unwrap_or(200.0) / 200.0, ..Default::default() };
        let sigma = grain::sigma(camera.noise.as_ref().unwrap(), &camera.response, 0, mean, &ratios);
        let mut differ = 0;
        for y in 0..240 {
            for x in 0..320 {
                let pattern = noise::twin_pattern(&params, &context, x, y);
                for (c, pattern) in pattern.into_iter().enumerate() {
                    let twin = noise::twin(mean, sigma, 1.0, 0.0, pattern);
                    let got =
                        f64::from(done.pixels.codes.eight_bit().unwrap()[3 * (y as usize * 320 + x as usize) + c]);
                    // Values within the 32-bit error of a half may round either way.
                    assert!((got - twin).abs() < 0.51, "({x}, {y}) {c}: {got} {twin}");
                    differ += usize::from(got != twin.round());
                }
            }
        }
        assert!(differ < 200, "{differ} of 230,400 codes round to the other side");
    }
}

#[test]
fn mixed_pixel_receives_only_its_missing_variance() {
    let geometry = gpu::pinhole(320, 240, FOCAL_PX);
    let mut camera = noisy_camera(&geometry, 0.0);
    camera.response = locard::camera::Response { curve: locard::camera::Curve::Linear, ..Default::default() };
    // A half-transparent board in the camera's own grey, mean 90: the camera's half contributes
    // (0.5 σ)², so (1 − 0.25) σ² is missing. The camera's frame in this test has no noise.
    let mut scene = board([200.0, 150.0], 90.0 / 255.0);
    scene.materials[0].base_color[3] = 0.5;
    scene.materials[0].alpha = locard::scene::Alpha::Blend;
    let frame = gpu::frame(3, 0.0, gpu::grey(320, 240, 90));
    let done = gpu::composite(&gpu::gpu(), &camera, Settings::default(), scene, &sideways([0.0, 0.0]), frame);
    let [mean, sigma, ..] = statistics(done.pixels.codes.eight_bit().unwrap(), 320);
    let expected = (0.75 * (1.0f64 + 5.1 * 90.0 / 255.0).powi(2) + 1.0 / 12.0).sqrt();
    assert!((mean - 90.0).abs() < 0.1, "{mean}");
    assert!((sigma / expected - 1.0).abs() < 0.02, "{sigma} {expected}");
}

/// Renderings without and with the edge blend, over code 40, with a linear response.
fn edge_blended(scene: impl Fn() -> Scene, sigma_px: f64, impact: f64) -> [Composited; 2] {
    let mut camera = gpu::camera(&gpu::pinhole(320, 240, FOCAL_PX), 0.0);
    camera.response = Response { curve: Curve::Linear, ..Default::default() };
    [0.0, impact].map(|impact| {
        let sigma = ("point_spread", "sigma_px", Value::Number(sigma_px));
        let settings = gpu::settings(&[("edge_blend", "impact", Value::Number(impact)), sigma]);
        let frame = gpu::frame(0, 0.0, gpu::grey(320, 240, 40));
        gpu::composite(&gpu::gpu(), &camera, settings, scene(), &sideways([0.0, 0.0]), frame)
    })
}

/// A blended board with this alpha.
fn glass(alpha: f32) -> Scene {
    let mut scene = board([60.0, 50.0], 0.5);
    scene.materials[0].base_color[3] = alpha;
    scene.materials[0].alpha = locard::scene::Alpha::Blend;
    scene
}

#[test]
fn edge_blend_follows_the_rule_of_the_paper_on_hard_and_soft_edges() {
    let mut losses = Vec::new();
    for (alpha, sigma_px) in [(1.0, 0.0), (1.0, 0.3), (1.0, 0.7), (1.0, 2.0), (0.5, 0.0), (0.5, 0.7)] {
        let [plain, done] = edge_blended(|| glass(alpha), sigma_px, 0.75);
        let layer = plain.layer.as_ref().unwrap();
        let (mut edges, mut all) = (0, 0.0f64);
        for y in 1..239usize {
            for x in 1..319usize {
                let i = y * 320 + x;
                let covered = |j: usize| f64::from(layer.rgba[j][3]);
                let neighbours: Vec<(f64, f64)> = (0..9)
                    .filter(|k| *k != 4)
                    .map(|k| (40.0, covered((y + k / 3 - 1) * 320 + x + k % 3 - 1)))
                    .collect();
                let light = f64::from(layer.rgba[i][0]) + (1.0 - covered(i)) * 40.0 / 255.0;
                let current = 255.0 * light;
                let twin = edge_blend::twin(current, covered(i), &neighbours, 0.75);
                let got = f64::from(done.pixels.codes.eight_bit().unwrap()[3 * i]);
                assert!((got - twin).abs() < 0.55, "{alpha} {sigma_px} ({x}, {y}): {got} {twin}");
                edges += usize::from((got - current).abs() > 2.0);
                all += current - twin;
            }
        }
        assert!(edges > 400, "{alpha} {sigma_px}: {edges} pixels are blended");
        losses.push(all / f64::from(alpha));
    }
    // Each of the 4 · 110 - 4 pixels along the hard edge loses 0.75 · 3 / 4 of 127.5 - 40 codes,
    // those at the corners 0.75 · 5 / 6. Blur rounds the corners.
    let hard = (0.75 * 436.0 * 0.75 + 4.0 * 0.75 * 5.0 / 6.0) * 87.5;
    assert!(losses.iter().all(|loss| (loss / hard - 1.0).abs() < 0.02), "{losses:?}, a hard edge loses {hard}");
}

#[test]
fn edge_blend_leaves_the_interior_of_glass_unchanged() {
    let [plain, done] = edge_blended(|| glass(0.5), 0.0, 1.0);
    let layer = plain.layer.as_ref().unwrap();
    let (before, after) = (plain.pixels.codes.eight_bit().unwrap(), done.pixels.codes.eight_bit().unwrap());
    let mut inside = 0;
    for i in (0..320 * 240).filter(|i| layer.rgba[*i][3] > 0.0) {
        let around = [-321i32, -320, -319, -1, 1, 319, 320, 321].map(|step| layer.rgba[(i as i32 + step) as usize][3]);
        if around.iter().all(|a| *a == layer.rgba[i][3]) {
            inside += 1;
            assert_eq!(after[3 * i..3 * i + 3], before[3 * i..3 * i + 3], "pixel {i}");
        }
    }
    assert!(inside > 10_000, "{inside}");
}

/// A camera of linear response with σ 1 at black and 6.1 at white, measured at ISO 400 on 36 mm.
fn film_camera(geometry: &Geometry) -> Camera {
    let mut camera = noisy_camera(geometry, 0.0);
    camera.response = locard::camera::Response { curve: Curve::Linear, ..Default::default() };
    camera.exposure.iso = Some(400.0);
    camera
}

#[test]
fn grain_at_the_calibrated_iso_is_the_calibrated_noise() {
    let geometry = gpu::pinhole(320, 240, FOCAL_PX);
    for correlation in [0.0, 0.4] {
        for response in [Curve::Linear, Curve::Srgb, Curve::Gamma] {
            let mut camera = film_camera(&geometry);
            camera.response.curve = response;
            camera.noise.as_mut().unwrap().neighbour_correlation = [correlation; 2];
            let film = |iso| [("noise", "iso", iso), ("noise", "film_width_mm", Value::Number(36.0))];
            let calibrated = noisy(&camera, Settings::default(), 0.2, 3);
            let own = noisy(&camera, gpu::settings(&film(Value::Number(400.0))), 0.2, 3);
            assert!(
                own.pixels.codes.eight_bit().unwrap() == calibrated.pixels.codes.eight_bit().unwrap(),
                "{response:?}"
            );
            let other = noisy(&camera, gpu::settings(&film(Value::Number(800.0))), 0.2, 3);
            assert!(
                other.pixels.codes.eight_bit().unwrap() != calibrated.pixels.codes.eight_bit().unwrap(),
                "{response:?}"
            );
        }
    }
}

#[test]
fn grain_grows_with_iso_and_smaller_film() {
    let geometry = gpu::pinhole(320, 240, FOCAL_PX);
    let camera = film_camera(&geometry);
    let measured = |iso: f64, film_width_mm: f64| {
        let film = [("noise", "iso", Value::Number(iso)), ("noise", "film_width_mm", Value::Number(film_width_mm))];
        statistics(noisy(&camera, gpu::settings(&film), 123.5 / 255.0, 3).pixels.codes.eight_bit().unwrap(), 320)
    };
    // At code 123.5 σ² is 3.47² = 12.041: 1 of read noise, as at black, and 11.041 of shot noise.
    // At k times the speed it is 11.041 k + k²; rounding adds 1/12.
    for (iso, variance) in [(100.0, 2.823), (400.0, 12.041), (1600.0, 60.164), (3200.0, 152.328)] {
        let [mean, sigma, ..] = measured(iso, 36.0);
        let expected = (variance + 1.0 / 12.0f64).sqrt();
        assert!((mean - 123.5).abs() < 0.3, "{iso}: {mean}");
        // Three standard errors of 76,800 pixels are 0.8 %, more with larger patches.
        assert!((sigma / expected - 1.0).abs() < 0.03, "{iso}: {sigma} is not {expected}");
    }
    let right = |iso, film_width_mm| measured(iso, film_width_mm)[2];
    // Patches of 1, 2 and 2 px; they are never finer than 1 px.
    assert!(right(400.0, 36.0).abs() < 0.02 && right(100.0, 36.0).abs() < 0.02);
    assert!(right(6400.0, 36.0) > 0.5 && right(400.0, 18.0) > 0.5);
    // A smaller film has larger grains, but not more noise.
    let [_, sigma, ..] = measured(400.0, 18.0);
    assert!((sigma / 3.48 - 1.0).abs() < 0.03, "{sigma}");
}

/// A frame recorded at another speed has the variance of that speed, with patches as calibrated.
/// Its own pixels have it too, so an edge is as noisy as either side.
#[test]
fn noise_follows_the_iso_of_each_frame() {
    let geometry = gpu::pinhole(320, 240, FOCAL_PX);
    let mut camera = film_camera(&geometry);
    let photo = |iso| FrameExposure { photo: PhotoSettings { iso, ..Default::default() }, ..Default::default() };
    let taken = |camera: &Camera, exposure: FrameExposure, settings: Settings, code: f64| {
        let mut frame = gpu::frame(3, 0.0, gpu::grey(320, 240, 40));
        frame.exposure = exposure;
        let scene = board([200.0, 150.0], (code / 255.0) as f32);
        gpu::composite(&gpu::gpu(), camera, settings, scene, &sideways([0.0, 0.0]), frame)
    };
    let measured = |exposure| {
        statistics(taken(&camera, exposure, Settings::default(), 123.5).pixels.codes.eight_bit().unwrap(), 320)
    };
    // As in the test above: 11.041 k + k² at code 123.5; the gain is used if no ISO is recorded.
    let gain = |gain| FrameExposure { gain: Some(gain), ..Default::default() };
    for (exposure, variance) in [
        (photo(Some(1600.0)), 60.164),
        (photo(Some(100.0)), 2.823),
        (gain(4.0), 60.164),
        (FrameExposure { gain: Some(4.0), ..photo(Some(400.0)) }, 12.041),
        (FrameExposure::default(), 12.041),
    ] {
        let [_, sigma, right, ..] = measured(exposure);
        let expected = (variance + 1.0 / 12.0f64).sqrt();
        assert!((sigma / expected - 1.0).abs() < 0.03, "{exposure:?}: {sigma} is not {expected}");
        assert!(right.abs() < 0.02, "a sensor's noise gets no coarser: {right}");
    }
    // A requested speed takes precedence; without a speed in the profile, none is known.
    let own = gpu::settings(&[("noise", "iso", Value::Number(400.0))]);
    let calibrated = taken(&camera, photo(None), Settings::default(), 123.5);
    assert!(taken(&camera, photo(Some(1600.0)), own, 123.5).pixels == calibrated.pixels);
    camera.exposure.iso = None;
    assert!(taken(&camera, photo(Some(1600.0)), Settings::default(), 123.5).pixels == calibrated.pixels);
}

#[test]
fn iso_without_measured_noise_is_reported() {
    let geometry = gpu::pinhole(320, 240, FOCAL_PX);
    let mut camera = film_camera(&geometry);
    let with_speed = || gpu::settings(&[("noise", "iso", Value::Number(800.0))]);
    assert!(with_speed().ineffective_settings(&camera).is_empty());
    camera.noise = None;
    let ineffective = with_speed().ineffective_settings(&camera);
    assert!(
        ineffective.len() == 1 && ineffective[0].contains("noise.iso") && ineffective[0].contains("[camera.noise]"),
        "{ineffective:?}"
    );
    assert!(Settings::default().ineffective_settings(&camera).is_empty());
    let mut off = with_speed();
    off.without(&["noise".to_owned()]).unwrap();
    assert!(off.ineffective_settings(&camera).is_empty());
}

#[test]
fn grain_without_a_reference_iso_is_refused() {
    let geometry = gpu::pinhole(320, 240, FOCAL_PX);
    let mut camera = film_camera(&geometry);
    camera.exposure.iso = None;
    let settings = gpu::settings(&[("noise", "iso", Value::Number(800.0))]);
    let gpu = gpu::gpu();
    let mut compositor = Compositor::new(gpu.clone(), board([60.0, 50.0], 0.5));
    let (frame, track) = (gpu::frame(0, 0.0, gpu::grey(320, 240, 40)), sideways([0.0, 0.0]));
    let job = Job::of_frame(frame, &camera, &settings, &geometry, &track, 1.0 / 30.0).unwrap();
    let error = compositor.submit(job, &camera, &settings, Target::Pixels).unwrap_err().to_string();
    assert!(error.contains("noise.iso") && error.contains("camera.exposure.iso"), "{error}");
    for iso in [99.0, 25601.0] {
        let error = Settings::default().set("noise", "iso", &Value::Number(iso)).unwrap().unwrap_err().to_string();
        assert!(error.contains("100 to 25600"), "{error}");
    }
}
