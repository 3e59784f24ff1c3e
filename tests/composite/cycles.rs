//! Layers compared with those of Cycles, on its scenes.

use std::path::Path;

use crate::common;
use crate::gpu;
use crate::tier::fast_or_full;
use locard::camera::Geometry;
use locard::grey_image::GreyImage;
use locard::measure::edge::{edge, profile};
use locard::params::Value;
use locard::pixels::LayerImage;
use locard::tracking::tum;

fn reference(path: &Path) -> Vec<[f32; 4]> {
    use exr::prelude::*;
    let image = read_first_rgba_layer_from_file(
        path,
        |size, _| (size.width(), vec![[0f32; 4]; size.area()]),
        |(width, pixels), at, (r, g, b, a): (f32, f32, f32, f32)| pixels[at.y() * *width + at.x()] = [r, g, b, a],
    )
    .expect("an RGBA EXR");
    image.layer_data.channel_data.pixels.1
}

struct Case {
    layer: LayerImage,
    reference: Vec<[f32; 4]>,
}

fn case(name: &str, effect: &str, method: &str) -> Option<Case> {
    let folder = common::data(&format!("cycles/{name}"))?;
    let text = std::fs::read_to_string(folder.join("case.json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    let number = |key: &str| json[key].as_f64().unwrap();
    let mut geometry = gpu::pinhole(640, 480, number("fx_px"));
    geometry.intrinsics.readout_time_s = number("readout_time_s");
    let geometry = Geometry::new(geometry.intrinsics, geometry.distortion);
    let mut camera = gpu::camera(&geometry, number("exposure_time_s"));
    camera.lens.aperture_diameter_mm = Some(number("aperture_diameter_mm"));
    camera.lens.focus_distance_m = Some(number("focus_distance_m"));
    camera.lens.blades = number("blades") as u32;
    let scene = locard::scene::load(&folder.join("scene.glb"), None).unwrap();
    let track = tum::read_trajectory(&folder.join("groundtruth.txt"), None).unwrap();
    let settings = gpu::settings(&[(effect, "method", Value::Text(method.to_owned()))]);
    let frame = gpu::frame(2, 2.0 / 30.0, gpu::grey(640, 480, 128));
    let done = gpu::composite(&gpu::gpu(), &camera, settings, scene, &track, frame);
    let layer = done.layer.unwrap();
    let reference = reference(&folder.join("reference.exr"));
    if let Some(folder) = std::env::var_os("LOCARD_TEST_OUT") {
        let folder = Path::new(&folder);
        gpu::write_layer_png(&folder.join(format!("{name}-{method}.png")), &layer.rgba, 640, 480);
        gpu::write_layer_png(&folder.join(format!("{name}-reference.png")), &reference, 640, 480);
        let difference: Vec<_> = layer
            .rgba
            .iter()
            .zip(&reference)
            .map(|(a, b)| {
                [0, 1, 2, 3].map(|c| if c == 3 { 1.0 } else { (a[c] - b[c]).abs() * 4.0 + (a[3] - b[3]).abs() })
            })
            .collect();
        gpu::write_layer_png(&folder.join(format!("{name}-{method}-difference.png")), &difference, 640, 480);
    }
    Some(Case { layer, reference })
}

#[test]
fn translation_agrees_with_cycles() {
    for method in ["velocity", "reference"] {
        let Some(case) = case("motion-translate", "motion_blur", method) else { return };
        let error = gpu::mean_absolute_error(&case.layer, &case.reference);
        println!("motion-translate, {method}: mean absolute error {error:.4}");
        assert!(error <= 0.015, "{method}: {error}");
    }
}

/// Profiles across silhouettes of the boards: name, from, to, number of adjacent rows or columns.
/// Every profile begins and ends where alpha is flat; the near board moves 13.1 × 2.6 px, the far
/// one half of that.
const SILHOUETTES: [(&str, [f64; 2], [f64; 2], f64); 6] = [
    ("near, left", [172.5, 240.0], [212.5, 240.0], 150.0),
    ("near, right", [472.5, 147.0], [432.5, 147.0], 12.0),
    ("near, top", [320.0, 122.5], [320.0, 146.5], 200.0),
    ("far, left", [226.5, 357.0], [256.5, 357.0], 14.0),
    ("far, right", [466.5, 357.0], [436.5, 357.0], 14.0),
    ("far, bottom", [345.0, 382.5], [345.0, 360.5], 150.0),
];

#[test]
fn silhouette_widths_agree_with_cycles() {
    let mut missed = Vec::new();
    for method in ["velocity", "reference"] {
        let Some(case) = case("motion-translate", "motion_blur", method) else { return };
        let alpha =
            |rgba: &[[f32; 4]]| GreyImage::new(640, 480, rgba.iter().map(|p| f64::from(p[3])).collect()).unwrap();
        let (ours, theirs) = (alpha(&case.layer.rgba), alpha(&case.reference));
        for (name, from, to, across) in SILHOUETTES {
            let edge = |picture| edge(&profile(picture, from, to, 1.0, across).unwrap(), 1.0).unwrap();
            let (ours, theirs) = (edge(&ours), edge(&theirs));
            let apart = ours.width_10_90_px - theirs.width_10_90_px;
            println!(
                "{method}, {name}: 10-90 % over {:.2} px, Cycles {:.2} px ({apart:+.2}); middle {:+.2} px away",
                ours.width_10_90_px,
                theirs.width_10_90_px,
                ours.position_px - theirs.position_px
            );
            if apart.abs() > 0.5 {
                missed.push(format!("{method}, {name}: {ours:?}, Cycles {theirs:?}"));
            }
        }
    }
    assert!(missed.is_empty(), "{missed:#?}");
}

#[test]
fn rolling_shutter_agrees_with_cycles() {
    for method in ["velocity", "reference"] {
        let Some(case) = case("rolling-shutter", "motion_blur", method) else { return };
        let error = gpu::mean_absolute_error(&case.layer, &case.reference);
        println!("rolling-shutter, {method}: mean absolute error {error:.4}");
        assert!(error <= 0.015, "{method}: {error}");
    }
}

/// Skew of a silhouette over the picture's height, px: slope of the line through the rows'
/// half-alpha positions.
fn lean_px(alpha: &GreyImage<f64>, from_x: f64, to_x: f64) -> f64 {
    // The board's rows without a few near its corners.
    let rows = (70..410).map(|row| f64::from(row) + 0.5);
    let edge_of_rows: Vec<(f64, f64)> = rows
        .map(|y| (y, edge(&profile(alpha, [from_x, y], [to_x, y], 1.0, 1.0).unwrap(), 1.0).unwrap().position_px))
        .collect();
    let mean = |part: fn(&(f64, f64)) -> f64| edge_of_rows.iter().map(part).sum::<f64>() / edge_of_rows.len() as f64;
    let (y_mean, x_mean) = (mean(|p| p.0), mean(|p| p.1));
    let (products, squares) = edge_of_rows.iter().fold((0.0, 0.0), |(products, squares), (y, x)| {
        (products + (y - y_mean) * (x - x_mean), squares + (y - y_mean).powi(2))
    });
    480.0 * products / squares
}

#[test]
fn edge_skew_by_rolling_shutter_agrees_with_cycles() {
    for method in ["velocity", "reference"] {
        let Some(case) = case("rolling-shutter", "motion_blur", method) else { return };
        let alpha =
            |rgba: &[[f32; 4]]| GreyImage::new(640, 480, rgba.iter().map(|p| f64::from(p[3])).collect()).unwrap();
        let (ours, theirs) = (alpha(&case.layer.rgba), alpha(&case.reference));
        for (side, from_x, to_x) in [("left", 130.5, 190.5), ("right", 445.5, 505.5)] {
            let (ours, theirs) = (lean_px(&ours, from_x, to_x), lean_px(&theirs, from_x, to_x));
            println!("{method}, {side}: leans by {ours:.2} px, Cycles by {theirs:.2}");
            // 30.74 px a frame, half a frame from the first row to the last: the scene's own
            // parameters.
            assert!((theirs.abs() - 15.3).abs() < 0.3, "{side}: Cycles {theirs}");
            assert!((ours - theirs).abs() < 0.3, "{method}, {side}: {ours}, Cycles {theirs}");
        }
    }
}

/// The reference method samples thousands of lens points: full tier only. In the fast tier
/// `depth_of_field::edge_widths_match_the_analytic_aperture` compares it with the analytic disc.
#[test]
fn defocus_agrees_with_cycles() {
    for method in fast_or_full(&["layered"][..], &["layered", "reference"]) {
        let Some(case) = case("defocus-behind", "depth_of_field", method) else { return };
        let error = gpu::mean_absolute_error(&case.layer, &case.reference);
        println!("defocus-behind, {method}: mean absolute error {error:.4}");
        assert!(error <= 0.015, "{method}: {error}");
    }
}
