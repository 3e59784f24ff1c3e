//! Effects of lens and exposure on the layer, compared with values computed by hand and with the
//! CPU references.

use crate::board;
use crate::board::{FOCAL_PX, board, sideways};
use crate::gpu;
use glam::DVec2;
use locard::camera::{Camera, Curve, Distortion, Geometry, LensModel, Response};
use locard::compositor::Composited;
use locard::effects::{chromatic_aberration, exposure, halation, point_spread, vignetting};
use locard::frame::FrameExposure;
use locard::params::Value;
use locard::scene::Scene;

const WIDTH: u32 = 320;
const HEIGHT: u32 = 240;
/// Half a unit of 16-bit floats below 1, twice: the layer is stored before and after an effect.
const HALF: f64 = 2.0 / 4096.0;

type Sets<'a> = &'a [(&'a str, &'a str, Value)];

fn composite_by(camera: &Camera, sets: Sets<'_>, scene: Scene, recorded: FrameExposure) -> Composited {
    let mut frame = gpu::frame(0, 0.0, gpu::grey(WIDTH, HEIGHT, 60));
    frame.exposure = recorded;
    gpu::composite(&gpu::gpu(), camera, gpu::settings(sets), scene, &sideways([0.0, 0.0]), frame)
}

/// Rendered by a camera at rest without noise.
fn composite_at_rest(sets: Sets<'_>, scene: Scene) -> Composited {
    composite_by(&gpu::camera(&gpu::pinhole(WIDTH, HEIGHT, FOCAL_PX), 0.0), sets, scene, FrameExposure::default())
}

fn rgba(done: &Composited, x: usize, y: usize) -> [f64; 4] {
    done.layer.as_ref().unwrap().rgba[y * WIDTH as usize + x].map(f64::from)
}

fn codes(done: &Composited, x: usize, y: usize) -> [u8; 3] {
    done.pixels.at(x as u32, y as u32).map(|code| code as u8)
}

fn number(table: &'static str, name: &'static str, value: f64) -> (&'static str, &'static str, Value) {
    (table, name, Value::Number(value))
}

/// Asserts that all components agree within a tolerance.
fn assert_close(actual: [f64; 4], expected: [f64; 4], within: f64, label: &str) {
    assert!(
        actual.iter().zip(expected).all(|(f, e)| (f - e).abs() <= within),
        "{label}: {actual:?} is not {expected:?}"
    );
}

#[test]
fn vignetting_is_cos4_of_the_angle() {
    let done = composite_at_rest(&[number("vignetting", "natural", 1.0)], board([200.0, 150.0], 0.5));
    // The centre of pixel (310, 230) is 150.5 and 110.5 px from the picture's centre: tan²θ =
    // 34860.5/250000.
    assert_close(rgba(&done, 310, 230), [0.5 * 0.770_226, 0.5 * 0.770_226, 0.5 * 0.770_226, 1.0], HALF, "corner");
    assert_close(rgba(&done, 160, 120), [0.5, 0.5, 0.5, 1.0], HALF, "middle");
    // Coverage is unchanged: the footage's share of an edge already has the camera's own
    // vignetting.
    let plain = composite_at_rest(&[], board([60.25, 50.0], 0.5));
    let edge = composite_at_rest(&[number("vignetting", "natural", 2.0)], board([60.25, 50.0], 0.5));
    for x in 95..105 {
        assert_eq!(rgba(&edge, x, 120)[3], rgba(&plain, x, 120)[3]);
    }
}

/// A fisheye of 200 px a radian with a field of view above 180°; its image circle ends at 100 px,
/// 0.5 rad.
#[test]
fn nothing_is_drawn_beyond_a_circular_fisheye_picture() {
    let mut geometry = gpu::pinhole(WIDTH, HEIGHT, 200.0);
    geometry.intrinsics.cx_px = 150.0;
    let fisheye = Distortion { model: LensModel::OpencvFisheye, ..Default::default() };
    let camera = gpu::camera(&Geometry::new(geometry.intrinsics, fisheye), 0.0);
    let whole = composite_by(&camera, &[], board([900.0, 900.0], 0.5), FrameExposure::default());
    let circle = [number("vignetting", "image_circle_px", 200.0)];
    let done = composite_by(&camera, &circle, board([900.0, 900.0], 0.5), FrameExposure::default());
    for y in 0..HEIGHT as usize {
        for x in 0..WIDTH as usize {
            let off = DVec2::new(x as f64 + 0.5, y as f64 + 0.5).distance(DVec2::new(150.0, 120.0)) - 100.0;
            let (actual, all) = (rgba(&done, x, y), rgba(&whole, x, y));
            let left = (0.5 - off).clamp(0.0, 1.0);
            assert_close(actual, all.map(|v| v * left), 2e-3, &format!("({x}, {y}), {off:.2} px beyond the rim"));
            if off > 0.5 {
                assert_eq!(codes(&done, x, y), [60; 3], "({x}, {y})");
            }
        }
    }
}

#[test]
fn vignetting_follows_the_lens_of_a_distorted_camera() {
    let mut geometry = gpu::pinhole(WIDTH, HEIGHT, 200.0);
    geometry.intrinsics.cx_px = 150.3;
    geometry.intrinsics.film_width_mm = 10.0;
    let distortion = Distortion { k1: -0.2, k2: 0.05, p1: 0.003, p2: -0.002, ..Default::default() };
    let geometry = Geometry::new(geometry.intrinsics, distortion);
    let mut camera = gpu::camera(&geometry, 0.0);
    // So small that nothing is blurred: 0.4 mm at 2 m.
    camera.lens.aperture_diameter_mm = Some(0.4);
    camera.lens.focus_distance_m = Some(2.0);
    let sets = [
        number("vignetting", "natural", 0.8),
        number("vignetting", "rim_distance_mm", 1.0),
        number("vignetting", "rim_radius_mm", 0.6),
    ];
    let done = composite_by(&camera, &sets, board([900.0, 900.0], 0.5), FrameExposure::default());
    let params =
        vignetting::Vignetting { natural: 0.8, rim_distance_mm: 1.0, rim_radius_mm: 0.6, image_circle_px: None };
    let opening = camera.lens.opening(&geometry).unwrap();
    let mut darkest = 1.0f64;
    for y in (0..HEIGHT as usize).step_by(7) {
        for x in (0..WIDTH as usize).step_by(3) {
            let twin = vignetting::twin(&params, &geometry, opening, DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
            darkest = darkest.min(twin);
            // At the onset of mechanical vignetting the gain has a kink, which a cell of 2.5 px
            // rounds; and the reference samples.
            assert_close(rgba(&done, x, y), [0.5 * twin, 0.5 * twin, 0.5 * twin, 1.0], 3e-3, &format!("({x}, {y})"));
        }
    }
    assert!(darkest < 0.4, "the rim is seen: {darkest}");
}

#[test]
fn one_stop_doubles_the_light() {
    let grey = board([60.25, 50.0], 0.2);
    let plain = composite_at_rest(&[], grey.clone());
    let over = composite_at_rest(&[number("exposure", "ev", 1.5)], grey.clone());
    for x in 95..130 {
        let [r, g, b, a] = rgba(&plain, x, 120);
        let gain = 2.0 * std::f64::consts::SQRT_2;
        assert_close(rgba(&over, x, 120), [gain * r, gain * g, gain * b, a], HALF, "1.5 stops");
    }
    // 0.2 · 2^1.5 = 0.566 is sRGB code 197.5 (IEC 61966-2-1), 0.2 · 2^3 clips.
    assert!(codes(&over, 160, 120)[0].abs_diff(197) <= 1);
    assert_eq!(codes(&composite_at_rest(&[number("exposure", "ev", 3.0)], grey.clone()), 160, 120), [255; 3]);
    // Highlights recovered by a darker exposure.
    let lamp = composite_at_rest(&[number("exposure", "ev", -2.0)], board([60.25, 50.0], 2.0));
    assert_close(rgba(&lamp, 160, 120), [0.5, 0.5, 0.5, 1.0], HALF, "a lamp");
}

#[test]
fn exposure_by_equation_11_shifts_display_values() {
    let method = ("exposure", "method", Value::Text("additive".to_owned()));
    for curve in [Curve::Srgb, Curve::Linear, Curve::Gamma, Curve::Hlg] {
        let response = Response { curve, gamma: 2.2, ..Response::default() };
        let mut camera = gpu::camera(&gpu::pinhole(WIDTH, HEIGHT, FOCAL_PX), 0.0);
        camera.response = response.clone();
        let light = response.decode(0.4);
        let scene = || board([60.25, 50.0], light as f32);
        let sets = |ev| [method.clone(), number("exposure", "ev", ev)];
        let plain = composite_by(&camera, &[], scene(), FrameExposure::default());
        for (ev, display) in [(0.5, 0.5), (-1.5, 0.1), (-3.0, 0.0), (4.0, 1.0)] {
            let done = composite_by(&camera, &sets(ev), scene(), FrameExposure::default());
            // 0.4 + 0.2 · ΔEV by hand; one code for the layer's 16 bits.
            assert!((f64::from(codes(&done, 160, 120)[0]) - 255.0 * display).abs() < 1.0, "{curve:?} {ev}");
            for x in 95..105 {
                let twin = exposure::twin(rgba(&plain, x, 120), exposure::ExposureMethod::Additive, ev, &response);
                assert_close(rgba(&done, x, 120), twin, 2.0 * HALF, &format!("{curve:?} {ev} {x}"));
            }
        }
    }
}

#[test]
fn objects_follow_automatic_exposure() {
    let camera = gpu::camera(&gpu::pinhole(WIDTH, HEIGHT, FOCAL_PX), 0.0);
    let grey = || board([60.0, 50.0], 0.2);
    let recorded = FrameExposure { time_s: Some(0.02), gain: Some(0.5), ..Default::default() };
    // Twice the time, half the gain of 1/200 s: 20 ms · 0.5 / 5 ms.
    let done = composite_by(&camera, &[number("exposure", "reference_s", 0.005)], grey(), recorded);
    assert_close(rgba(&done, 160, 120), [0.4, 0.4, 0.4, 1.0], HALF, "followed");
    let done = composite_by(&camera, &[], grey(), recorded);
    assert_close(rgba(&done, 160, 120), [0.2, 0.2, 0.2, 1.0], HALF, "not followed");
}

/// Mean and variance of the derivative of values a pixel apart, px.
fn edge(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let values: Vec<f64> = values.collect();
    let steps: Vec<f64> = values.windows(2).map(|w| w[1] - w[0]).collect();
    let total: f64 = steps.iter().sum();
    let mean = steps.iter().enumerate().map(|(i, s)| i as f64 * s).sum::<f64>() / total;
    let variance = steps.iter().enumerate().map(|(i, s)| (i as f64 - mean).powi(2) * s).sum::<f64>() / total;
    [mean, variance]
}

#[test]
fn point_spread_widens_edges_by_sigma() {
    for half in [60.0, 60.25, 60.5] {
        let plain = composite_at_rest(&[], board([half, 50.0], 0.5));
        let row = |done: &Composited, c: usize| {
            edge((60..140).map(|x| rgba(done, x, 120)[c]).collect::<Vec<_>>().into_iter())
        };
        let total = |done: &Composited| done.layer.as_ref().unwrap().rgba.iter().map(|p| f64::from(p[0])).sum::<f64>();
        for sigma in [0.2, 0.3, 0.5, 0.7, 1.0, 2.0, 3.0] {
            let done = composite_at_rest(&[number("point_spread", "sigma_px", sigma)], board([half, 50.0], 0.5));
            for c in [0, 3] {
                let ([was_at, was], [at, now]) = (row(&plain, c), row(&done, c));
                assert!((at - was_at).abs() < 2e-3, "{half} {sigma}: the edge has moved by {}", at - was_at);
                // 16-bit floats are off by 1/4096 near 1, and the taps are cut at 1e-4.
                assert!(
                    (now - was - sigma * sigma).abs() < 0.01 * sigma * sigma + 2e-3,
                    "{half} {sigma}: {}",
                    now - was
                );
            }
            assert!((total(&done) / total(&plain) - 1.0).abs() < 5e-4, "{sigma}: {}", total(&done) / total(&plain));
        }
    }
}

#[test]
fn point_spread_matches_the_cpu_reference_and_keeps_depth_of_lit_pixels() {
    let scene = || board([60.25, 50.75], 0.5);
    let plain = composite_at_rest(&[], scene());
    let before: Vec<[f64; 4]> = plain.layer.as_ref().unwrap().rgba.iter().map(|p| p.map(f64::from)).collect();
    for sigma in [0.6, 2.5] {
        let done = composite_at_rest(&[number("point_spread", "sigma_px", sigma)], scene());
        let twin = point_spread::twin(&before, WIDTH as usize, HEIGHT as usize, sigma);
        let layer = done.layer.as_ref().unwrap();
        for (i, (p, twin)) in layer.rgba.iter().zip(&twin).enumerate() {
            assert_close(p.map(f64::from), *twin, 2.0 * HALF, &format!("{sigma} pixel {i}"));
            assert_eq!(p[3] > 0.0, layer.depth_m[i] > 0.0, "{sigma} pixel {i}: depth where there is light");
            let distance = f64::from(layer.depth_m[i]) - board::DEPTH_M;
            assert!(p[3] == 0.0 || distance.abs() < 1e-4, "{sigma} pixel {i}: {distance}");
        }
    }
}

#[test]
fn chromatic_aberration_grows_towards_the_corners() {
    // r = 1 is 200 px. Board edges at 100 px to the right: red is magnified by 1 % there and moves
    // to 101, blue by −0.005 − 0.01/4 to 99.25.
    let sets = [
        number("chromatic_aberration", "red", 0.01),
        number("chromatic_aberration", "blue", -0.005),
        number("chromatic_aberration", "blue_cubic", -0.01),
    ];
    let scene = || board([100.0, 50.0], 0.5);
    let plain = composite_at_rest(&[], scene());
    let done = composite_at_rest(&sets, scene());
    let place = |c: usize| edge((230..290).map(|x| 0.5 - rgba(&done, x, 120)[c]).collect::<Vec<_>>().into_iter())[0];
    // The edge is between two pixels.
    let green = place(1);
    assert!((place(0) - green - 1.0).abs() < 0.01, "{}", place(0) - green);
    assert!((place(2) - green + 0.75).abs() < 0.01, "{}", place(2) - green);
    // No aberration in the middle; green is the reference everywhere.
    assert_close(rgba(&done, 160, 120), [0.5, 0.5, 0.5, 1.0], HALF, "middle");

    let params =
        chromatic_aberration::ChromaticAberration { red: 0.01, red_cubic: 0.0, blue: -0.005, blue_cubic: -0.01 };
    let before: Vec<[f64; 4]> = plain.layer.as_ref().unwrap().rgba.iter().map(|p| p.map(f64::from)).collect();
    let twin = chromatic_aberration::twin(&params, &gpu::pinhole(WIDTH, HEIGHT, FOCAL_PX), &before);
    let response = Response::default();
    let behind = response.decode(60.0 / 255.0);
    let mut parted = 0;
    for (i, [light, coverage]) in twin.iter().enumerate() {
        let (x, y) = (i % WIDTH as usize, i / WIDTH as usize);
        let alpha = 0.2126 * coverage[0] + 0.7152 * coverage[1] + 0.0722 * coverage[2];
        assert_close(rgba(&done, x, y), [light[0], light[1], light[2], alpha], 2.0 * HALF, &format!("({x}, {y})"));
        let depth = done.layer.as_ref().unwrap().depth_m[i];
        assert_eq!(depth > 0.0, rgba(&done, x, y)[3] > 0.0, "({x}, {y})");
        // Each channel over the footage by its own coverage.
        for c in 0..3 {
            let code = 255.0 * response.encode(light[c] + (1.0 - coverage[c]) * behind);
            assert!((f64::from(codes(&done, x, y)[c]) - code).abs() < 0.7, "({x}, {y}) {c}: {code}");
        }
        parted += usize::from(coverage[0] != coverage[2]);
        if alpha == 0.0 {
            assert_eq!(codes(&done, x, y), [60; 3]);
        }
    }
    assert!(parted > 300, "{parted}");
}

#[test]
fn board_in_the_background_grey_has_no_colour_fringe() {
    // A single alpha for all three channels would show seams at the silhouette of an object of the
    // background's colour.
    let light = Response::default().decode(60.0 / 255.0) as f32;
    let sets = [number("chromatic_aberration", "red", 0.02), number("chromatic_aberration", "blue", -0.02)];
    let done = composite_at_rest(&sets, board([100.3, 80.6], light));
    for y in 0..HEIGHT as usize {
        for x in 0..WIDTH as usize {
            assert_eq!(codes(&done, x, y), [60; 3], "({x}, {y})");
        }
    }
}

/// A bright board's glow extends over the footage, and no light is lost.
#[test]
fn halation_conserves_light_and_glows_beside_the_object() {
    let plain = composite_at_rest(&[], board([30.0, 20.0], 4.0));
    let before: Vec<[f64; 4]> = plain.layer.as_ref().unwrap().rgba.iter().map(|p| p.map(f64::from)).collect();
    let sum = |rgba: &[[f64; 4]]| rgba.iter().map(|p| p[1]).sum::<f64>();
    // At the layer's resolution, and at half of it.
    for (sigma_px, within) in [(3.0, 2e-3), (12.0, 2e-3)] {
        let done = composite_at_rest(
            &[number("halation", "share", 0.3), number("halation", "sigma_px", sigma_px)],
            board([30.0, 20.0], 4.0),
        );
        let twin = halation::twin(&before, WIDTH as usize, &halation::Halation { share: 0.3, sigma_px });
        let with_glow: Vec<[f64; 4]> = done.layer.as_ref().unwrap().rgba.iter().map(|p| p.map(f64::from)).collect();
        for (i, (with_glow, twin)) in with_glow.iter().zip(&twin).enumerate() {
            // Relative to the brightest light; taps below a ten-thousandth are left out.
            assert_close(*with_glow, *twin, 4.0 * within, &format!("{sigma_px}: {i}"));
            assert_eq!(with_glow[3], before[i][3], "coverage stays");
        }
        assert!((sum(&with_glow) / sum(&before) - 1.0).abs() < 1e-3, "{sigma_px}: {}", sum(&with_glow) / sum(&before));
        // Beside the board's edge, at 190 px, nothing is covered and the footage is brightened by
        // the glow.
        let (beside, behind) = (190 + (0.5 * sigma_px) as usize, Response::default().decode(60.0 / 255.0));
        let glow = rgba(&done, beside, 120);
        assert!(glow[3] == 0.0 && glow[1] > 0.1, "{glow:?}");
        let code = 255.0 * Response::default().encode(behind + glow[1]).min(1.0);
        assert!((f64::from(codes(&done, beside, 120)[1]) - code).abs() < 0.6, "{code}");
        // Far from the board nothing changes.
        assert_eq!(codes(&done, 2, 2), [60; 3]);
    }
}
