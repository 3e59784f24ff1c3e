//! Depth of field on the GPU compared with the thin lens, the analytic disc and the CPU reference,
//! and its typical artefacts. One file, because the tests share the camera and scenes of
//! rectangles.

use std::sync::Arc;

use crate::board::{FOCAL_PX, merge_scenes, sideways};
use crate::flip::{PIXELS_PER_DEGREE, mean_flip};
use crate::gpu;
use crate::tier::fast_or_full;
use glam::DAffine3;
use locard::camera::{Aperture, Camera, Opening};
use locard::compositor::Composited;
use locard::effects::depth_of_field::{self, diffusion, poisson};
use locard::frame::Frame;
use locard::measure::edge::edge;
use locard::params::{Params, Value};
use locard::pixels::{DepthMap, Pixels};
use locard::scene::{Environment, Lighting, Material, Mesh, Object, Part, Scene, Vertex};

const WIDTH: u32 = 320;
const HEIGHT: u32 = 240;
const FOCUS_M: f64 = 1.0;

/// A camera focused at 1 m. The circle of confusion at `depth_m` has a diameter of `circle_px`.
fn camera(circle_px: f64, depth_m: f64, blades: u32) -> Camera {
    let mut camera = gpu::camera(&gpu::pinhole(WIDTH, HEIGHT, FOCAL_PX), 0.0);
    let diameter_m = circle_px / (FOCAL_PX * (1.0 / FOCUS_M - 1.0 / depth_m).abs());
    camera.lens.aperture_diameter_mm = Some(1e3 * diameter_m);
    camera.lens.focus_distance_m = Some(FOCUS_M);
    camera.lens.blades = blades;
    camera
}

/// Projected corners (px from the middle), depth (m), linear colour.
type Rectangle = ([f64; 2], [f64; 2], f64, [f32; 3]);

/// Unlit rectangles facing the camera, in one mesh.
fn rectangles(all: &[Rectangle]) -> Scene {
    let (mut vertices, mut indices) = (Vec::new(), Vec::new());
    for (number, (low, high, depth_m, color)) in (0u32..).zip(all) {
        let corner = |x: f64, y: f64| Vertex {
            position: [(x * depth_m / FOCAL_PX) as f32, (y * depth_m / FOCAL_PX) as f32, *depth_m as f32],
            normal: [0.0, 0.0, -1.0],
            tangent: [0.0; 4],
            uv0: [0.0; 2],
            uv1: [0.0; 2],
            color: [color[0], color[1], color[2], 1.0],
        };
        vertices.extend([
            corner(low[0], low[1]),
            corner(high[0], low[1]),
            corner(high[0], high[1]),
            corner(low[0], high[1]),
        ]);
        indices.extend([0, 1, 2, 0, 2, 3].map(|i| 4 * number + i));
    }
    Scene {
        meshes: vec![Mesh { vertices, indices, material: 0 }.into()],
        materials: vec![Material { unlit: true, double_sided: true, ..Material::default() }],
        objects: vec![Object {
            name: "rectangles".to_owned(),
            parts: vec![Part { mesh: 0, world_from_mesh: DAffine3::IDENTITY }],
            ..Object::default()
        }],
        lighting: Lighting { environment: Environment::Uniform(glam::Vec3::ONE), ..Lighting::default() },
        ..Scene::default()
    }
}

/// A checkerboard in two colours.
fn checks(low: [f64; 2], high: [f64; 2], cell_px: f64, depth_m: f64, colors: [[f32; 3]; 2]) -> Scene {
    let [columns, rows] = [0, 1].map(|c| ((high[c] - low[c]) / cell_px).round() as i32);
    let cell = |i: i32, j: i32| {
        let from = [low[0] + f64::from(i) * cell_px, low[1] + f64::from(j) * cell_px];
        (from, [from[0] + cell_px, from[1] + cell_px], depth_m, colors[((i + j) & 1) as usize])
    };
    rectangles(&(0..rows).flat_map(|j| (0..columns).map(move |i| (i, j))).map(|(i, j)| cell(i, j)).collect::<Vec<_>>())
}

fn composited(camera: &Camera, scene: Scene, method: &str) -> Composited {
    composited_with(camera, scene, method, &[])
}

fn composited_with(camera: &Camera, scene: Scene, method: &str, more: &[(&str, Value)]) -> Composited {
    // Background: a picture with structure.
    let codes =
        (0..HEIGHT * WIDTH).flat_map(|i| [60 + (i % WIDTH / 4) as u8, 90, 60 + (i / WIDTH / 4) as u8]).collect();
    let frame = gpu::frame(0, 0.0, Pixels::from_u8(WIDTH, HEIGHT, codes).unwrap());
    let mut sets = vec![("depth_of_field", "method", Value::Text(method.to_owned()))];
    sets.extend(more.iter().map(|(name, value)| ("depth_of_field", *name, value.clone())));
    let settings = gpu::settings(&sets);
    gpu::composite(&gpu::gpu(), camera, settings, scene, &sideways([0.0; 2]), frame)
}

const METHODS: [&str; 3] = ["layered", "poisson", "diffusion"];

/// Mean FLIP between each method and the reference, over both their footprints.
fn flip_of_methods(name: &str, camera: &Camera, scene: &Scene) -> [f64; 3] {
    let write = |method: &str, done: &Composited| {
        if let Some(folder) = std::env::var_os("LOCARD_TEST_OUT") {
            let locard::pixels::Codes::U8(codes) = &done.pixels.codes else { unreachable!() };
            let path = std::path::Path::new(&folder).join(format!("{name}-{method}.png"));
            image::save_buffer(path, codes, WIDTH, HEIGHT, image::ColorType::Rgb8).unwrap();
        }
    };
    let alphas = |done: &Composited| done.layer.as_ref().unwrap().rgba.iter().map(|p| p[3] > 0.0).collect::<Vec<_>>();
    let reference = composited(camera, scene.clone(), "reference");
    write("reference", &reference);
    let flips = METHODS.map(|method| {
        let done = composited(camera, scene.clone(), method);
        write(method, &done);
        let mask: Vec<bool> = alphas(&reference).iter().zip(alphas(&done)).map(|(a, b)| *a || b).collect();
        mean_flip(&reference.pixels, &done.pixels, Some(&mask), PIXELS_PER_DEGREE)
    });
    println!("{name}: mean FLIP layered {:.4}, poisson {:.4}, diffusion {:.4}", flips[0], flips[1], flips[2]);
    flips
}

const GREENS: [[f32; 3]; 2] = [[0.05, 0.45, 0.1], [0.7, 0.7, 0.75]];
const BLUES: [[f32; 3]; 2] = [[0.02, 0.03, 0.12], [0.8, 0.6, 0.05]];

/// Corners of a wall that fills the picture, and of one with half its area for the fast tier.
const WALL: ([f64; 2], [f64; 2]) = ([-150.0, -110.0], [150.0, 110.0]);
const SMALL_WALL: ([f64; 2], [f64; 2]) = ([-100.0, -80.0], [100.0, 80.0]);

fn wall() -> ([f64; 2], [f64; 2]) {
    fast_or_full(SMALL_WALL, WALL)
}

/// Corners of the board in front of the wall. Its border is at least 60 px from the wall's: the
/// poisson method blurs the border of a sharp surface near a blurred one.
fn before_wall() -> ([f64; 2], [f64; 2]) {
    fast_or_full(([-30.0, -20.0], [30.0, 20.0]), ([-60.0, -50.0], [60.0, 50.0]))
}

fn blurred_over_sharp() -> Scene {
    let ((low, high), (from, to)) = (wall(), before_wall());
    merge_scenes(checks(low, high, 20.0, FOCUS_M, GREENS), checks(from, to, 20.0, 0.5, BLUES))
}

fn sharp_over_blurred() -> Scene {
    let ((low, high), (from, to)) = (wall(), before_wall());
    merge_scenes(checks(low, high, 20.0, 2.0, GREENS), checks(from, to, 20.0, FOCUS_M, BLUES))
}

fn lights() -> Scene {
    let (low, high) = wall();
    let wall = rectangles(&[(low, high, 4.0, [0.01, 0.012, 0.02])]);
    let all = [(-90.0, -60.0), (-20.0, -70.0), (70.0, -50.0), (-60.0, 20.0), (10.0, 0.0), (95.0, 40.0), (-110.0, 80.0)];
    let small = [(-60.0, -50.0), (-20.0, -40.0), (10.0, 0.0), (65.0, 30.0)];
    let light = |&(x, y): &(f64, f64)| ([x, y], [x + 2.0, y + 2.0], 3.9, [60.0, 50.0, 30.0]);
    merge_scenes(wall, rectangles(&fast_or_full(&small[..], &all).iter().map(light).collect::<Vec<_>>()))
}

// Slow: the reference method renders the scene from many lens points.
#[test]
fn methods_match_the_thin_lens_by_flip() {
    let mut missed = Vec::new();
    // Per method: the value that its paper's algorithm reaches, plus a tenth.
    for (name, scene, depth_m, max_flips) in [
        ("blurred over sharp", blurred_over_sharp(), 0.5, [0.05, 0.078, 0.064]),
        ("sharp over blurred", sharp_over_blurred(), 2.0, [0.05, 0.138, 0.059]),
        ("point lights", lights(), 3.9, [0.05, 0.066, 0.028]),
    ] {
        for &(circle_px, blades) in fast_or_full(&[(12.0, 0)][..], &[(5.0, 0), (12.0, 0), (24.0, 5)]) {
            let flips = flip_of_methods(
                &format!("{name}, {circle_px} px, {blades} blades"),
                &camera(circle_px, depth_m, blades),
                &scene,
            );
            for ((method, flip), max_flips) in METHODS.iter().zip(flips).zip(max_flips) {
                if flip > max_flips {
                    missed.push((name, circle_px, blades, method, flip));
                }
            }
        }
    }
    assert!(missed.is_empty(), "{missed:?}");
}

/// Distribution of light through the aperture along one axis: sorted positions of evenly spread
/// aperture points, in radii.
fn aperture_spread(blades: u32) -> Vec<f64> {
    let camera = camera(8.0, 2.0, blades);
    let opening = camera.lens.opening(&camera.geometry.clone().unwrap()).unwrap().unwrap();
    let aperture = Aperture::of(&opening);
    let mut places: Vec<f64> = (0..40_000).map(|i| aperture.sequence(i)[0]).collect();
    places.sort_by(f64::total_cmp);
    places
}

/// 10-90 % width and position of the left silhouette of a board, averaged over subpixel positions
/// of the edge. A single position biases the result, since a filter only has whole pixels.
fn edge_of(mut alpha: impl FnMut(f64) -> Vec<f64>) -> (f64, f64) {
    let places = 5;
    let sum = (0..places).fold((0.0, 0.0), |(width, middle), k| {
        let place = f64::from(k) / f64::from(places);
        let measured = edge(&alpha(place), 1.0).unwrap();
        (width + measured.width_10_90_px, middle + measured.position_px - place)
    });
    (sum.0 / f64::from(places), sum.1 / f64::from(places))
}

#[test]
fn edge_widths_match_the_analytic_aperture() {
    let mut missed = Vec::new();
    let (behind, before) = (2.0, 0.5);
    let all: [&[f64]; 3] = [
        &[2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 15.9, 16.1, 24.0, 33.0, 48.0],
        &[2.0, 3.0, 4.0, 5.25, 6.0, 9.0, 14.0, 20.0, 28.0, 48.0],
        &[3.0, 5.25, 7.0, 14.0, 28.0],
    ];
    let chosen: [&[f64]; 3] = [&[2.0, 6.0, 16.1, 33.0], &[3.0, 9.0, 28.0], &[7.0, 28.0]];
    let [many, some, few] = fast_or_full(chosen, all);
    // The board's other edges are outside the circle of confusion of every measured pixel.
    let (half_high_px, right_px) = fast_or_full((30.0, 10.0), (90.0, 80.0));
    let [wall_x, wall_y] = fast_or_full([110.0, 30.0], WALL.1);
    for (method, blades, depth_m, circles) in [
        ("layered", 0, behind, many),
        ("layered", 0, before, some),
        ("layered", 5, behind, few),
        ("layered", 5, before, few),
        ("layered", 6, before, fast_or_full(&[5.25][..], &[5.25, 12.0])),
        ("reference", 0, behind, fast_or_full(&[6.0][..], &[2.0, 6.0])),
    ] {
        let spread = aperture_spread(blades);
        for &circle_px in circles {
            let (width, middle) = edge_of(|place| {
                let board =
                    rectangles(&[([-80.0 + place, -half_high_px], [right_px, half_high_px], depth_m, [0.5; 3])]);
                // A blurred object is drawn differently in front of a sharp surface and in front of
                // nothing.
                let wall = rectangles(&[([-wall_x, -wall_y], [wall_x, wall_y], FOCUS_M, [0.0; 3])]);
                let scene = if depth_m < FOCUS_M { merge_scenes(wall, board) } else { board };
                let layer = composited(&camera(circle_px, depth_m, blades), scene, method).layer.unwrap();
                // The silhouette at x = 80, from outside to inside.
                (30..130).map(|x| f64::from(layer.rgba[120 * WIDTH as usize + x][0])).collect()
            });
            let (expected_width, expected_middle) = edge_of(|place| {
                // Behind the focus plane the aperture's image is upright, and a pixel gathers the
                // image around it.
                let side = if depth_m < FOCUS_M { -1.0 } else { 1.0 };
                let share = |at: f64| {
                    let left = |x: f64| spread.partition_point(|&p| p < x) as f64 / spread.len() as f64;
                    let x = (at - 80.0 - place) / (0.5 * circle_px);
                    if side > 0.0 { left(x) } else { 1.0 - left(-x) }
                };
                (30..130)
                    .map(|x| (0..64).map(|k| share(f64::from(x) + (f64::from(k) + 0.5) / 64.0)).sum::<f64>() / 64.0)
                    .collect()
            });
            let text = format!(
                "{method}, {blades} blades, {depth_m} m, {circle_px} px: 10-90 % over {width:.2} px, the opening's \
                 {expected_width:.2} ({:+.1} %); middle {:+.2} px away",
                100.0 * (width / expected_width - 1.0),
                middle - expected_middle
            );
            println!("{text}");
            // A few texels approximate a polygon less well than a disc.
            let (many, max_px) = if blades == 0 { (0.05, 0.1) } else { (0.09, 0.25) };
            if (width / expected_width - 1.0).abs() > many || (middle - expected_middle).abs() > max_px {
                missed.push(text);
            }
        }
    }
    assert!(missed.is_empty(), "{missed:#?}");
}

#[test]
fn blur_conserves_the_energy_of_a_light() {
    let all = [2.0, 3.0, 5.0, 6.9, 7.1, 9.0, 12.0, 24.0, 33.0, 48.0, 70.0];
    for at in [[-0.5, -0.5], [3.2, 1.7]] {
        let light = rectangles(&[(at, [at[0] + 3.0, at[1] + 3.0], 2.0, [400.0, 300.0, 200.0])]);
        for method in ["layered", "diffusion"] {
            let sum = |camera: &Camera| {
                let layer = composited(camera, light.clone(), method).layer.unwrap();
                layer.rgba.iter().map(|p| f64::from(p[0])).sum::<f64>()
            };
            let sharp = sum(&camera(0.01, 2.0, 0));
            for &circle_px in fast_or_full(&[2.0, 6.9, 7.1, 48.0][..], &all) {
                let ratio = sum(&camera(circle_px, 2.0, 0)) / sharp;
                assert!((ratio - 1.0).abs() < 0.02, "{method}, {circle_px} px at {at:?}: {ratio:.4}");
            }
        }
    }
}

/// Circles of confusion are limited to a quarter of the picture, 80 px; an object farther out of
/// focus is drawn with that one.
#[test]
fn object_far_out_of_focus_is_still_drawn() {
    for circle_px in [15.997, 63.99, 79.0, 130.0, 400.0] {
        let board = rectangles(&[([-60.0, -60.0], [60.0, 60.0], 2.0, [0.5; 3])]);
        let layer = composited(&camera(circle_px, 2.0, 0), board, "layered").layer.unwrap();
        let covered: f64 = layer.rgba.iter().map(|p| f64::from(p[3])).sum();
        assert!((covered / 14400.0 - 1.0).abs() < 0.02, "{circle_px} px: {covered} px of 14400");
    }
}

/// Share of the light of a 3 px square source in one pixel, by sampling positions in pixel and
/// source.
fn image_of_a_light(aperture: &Aperture, radius_px: f64, upright: f64, area: f64, at: [f64; 2]) -> f64 {
    let along = |i: u32, n: u32| (f64::from(i) + 0.5) / f64::from(n) - 0.5;
    let (pixels, lights) = (4, 6);
    let mut inside = 0;
    for i in 0..pixels * pixels {
        for j in 0..lights * lights {
            let [x, y] = [0, 1].map(|c| {
                let (in_pixel, in_light) = if c == 0 { (i % pixels, j % lights) } else { (i / pixels, j / lights) };
                upright * (at[c] + along(in_pixel, pixels) - 3.0 * along(in_light, lights)) / radius_px
            });
            inside += u32::from(aperture.gauge([x, y]) <= 1.0);
        }
    }
    f64::from(inside) / f64::from((pixels * lights).pow(2)) * 9.0 / (area * radius_px * radius_px)
}

/// So bright that an error of one texel would be a hundred times brighter than white.
#[test]
fn bright_light_has_the_shape_of_the_aperture() {
    const LIGHT: f64 = 3000.0;
    for (blades, depth_m) in [(0, 2.0), (5, 2.0), (5, 0.5), (6, 0.5)] {
        // Across pixels and blocks, and within one.
        for (circle_px, at) in [(10.0, [3.2, 1.7]), (24.0, [0.4, -0.5]), (24.0, [6.5, 5.5]), (52.0, [-8.3, 2.9])] {
            let corner: [f64; 2] = at.map(|v| v - 1.5);
            let light = rectangles(&[(corner, corner.map(|v| v + 3.0), depth_m, [LIGHT as f32; 3])]);
            let camera = camera(circle_px, depth_m, blades);
            let opening = camera.lens.opening(&camera.geometry.clone().unwrap()).unwrap().unwrap();
            let aperture = Aperture::of(&opening);
            let area = match blades {
                0 => std::f64::consts::PI,
                n => 0.5 * f64::from(n) * (std::f64::consts::TAU / f64::from(n)).sin(),
            };
            let layer = composited(&camera, light, "layered").layer.unwrap();
            let upright = if depth_m < FOCUS_M { -1.0 } else { 1.0 };
            let radius_px = 0.5 * circle_px;
            let full = LIGHT * 9.0 / (area * radius_px * radius_px);
            let (mut worst, mut off, mut all) = (0.0f64, 0.0, 0.0);
            for (i, texel) in layer.rgba.iter().enumerate() {
                let place = [f64::from(i as u32 % WIDTH) - 159.5, f64::from(i as u32 / WIDTH) - 119.5];
                let from = [place[0] - at[0], place[1] - at[1]];
                let near = from[0].hypot(from[1]) < radius_px + 4.0;
                let expected =
                    if near { LIGHT * image_of_a_light(&aperture, radius_px, upright, area, from) } else { 0.0 };
                let error = (f64::from(texel[0]) - expected).abs();
                worst = worst.max(error / full);
                off += error;
                all += expected;
                assert!(texel[0] == 0.0 || texel[3] > 0.0, "light is seen where something is covered");
            }
            let text = format!("{blades} blades, {depth_m} m, {circle_px} px: worst {worst:.3}, all {:.4}", off / all);
            println!("{text}");
            // Tolerates a border of one pixel that is displaced by a tenth of a pixel, and places
            // where borders meet.
            assert!(worst < 0.25 && off / all < 0.01 + 0.7 / circle_px, "{text}");
        }
    }
}

/// Half of a light's image is behind a board in focus. The light itself is a few pixels from the
/// board's edge or touches it; in that case texels contain both. Behind both is a dark wall,
/// blurred even more.
#[test]
fn bright_light_is_occluded_only_by_the_board_in_front_of_it() {
    let wall = || rectangles(&[([-150.0, -110.0], [150.0, 110.0], 3.0, [0.02; 3])]);
    let board = || rectangles(&[([0.0, -60.0], [60.0, 60.0], FOCUS_M, [0.2; 3])]);
    let camera = camera(30.0, 2.0, 0);
    let red = |done: &Composited, x: i32, y: i32| {
        done.layer.as_ref().unwrap().rgba[((y + 120) * WIDTH as i32 + x + 160) as usize][0]
    };
    for from in [-6.0, -4.0, -3.0] {
        let light = || rectangles(&[([from, -1.0], [from + 3.0, 2.0], 2.0, [900.0; 3])]);
        let done = composited(&camera, merge_scenes(wall(), merge_scenes(light(), board())), "layered");
        let alone = composited(&camera, merge_scenes(wall(), light()), "layered");
        for y in -10..10 {
            for x in 1..20 {
                assert!((red(&done, x, y) - 0.2).abs() < 1e-3, "{from}: ({x}, {y}): {}", red(&done, x, y));
            }
            for x in -14..-1 {
                let (actual, alone) = (red(&done, x, y), red(&alone, x, y));
                assert!((actual - alone).abs() < 0.05 * alone + 0.01, "{from}: ({x}, {y}): {actual}, {alone} alone");
            }
        }
        // None of the light is gathered with the wall, over 40 px.
        for y in [-30, 30] {
            for x in -40..0 {
                assert!(red(&done, x, y) < 0.03, "{from}: ({x}, {y}): {}", red(&done, x, y));
            }
        }
    }
}

#[test]
fn sharp_object_does_not_bleed_into_the_blurred_wall_behind_it() {
    for circle_px in [3.0, 6.0, 12.0, 24.0, 40.0] {
        let wall = || rectangles(&[([-150.0, -110.0], [150.0, 110.0], 2.0, [0.2; 3])]);
        let red = rectangles(&[([-40.0, -40.0], [40.3, 40.6], FOCUS_M, [0.9, 0.01, 0.01])]);
        let camera = camera(circle_px, 2.0, 0);
        let codes = |scene: Scene| -> Vec<f64> {
            let layer = composited(&camera, scene, "layered").layer.unwrap();
            layer.rgba.iter().map(|p| 255.0 * camera.response.encode(f64::from(p[0]))).collect()
        };
        let (alone, both) = (codes(wall()), codes(merge_scenes(wall(), red)));
        let mut worst = 0.0f64;
        for (i, (a, b)) in alone.iter().zip(&both).enumerate() {
            let (dx, dy) = (f64::from(i as u32 % WIDTH) - 159.5, f64::from(i as u32 / WIDTH) - 119.5);
            let away = (-40.0 - dx).max(dx - 40.3).max(-40.0 - dy).max(dy - 40.6);
            // Excludes the wall's own border, whose blur is computed differently next to an object.
            if away > 2.0 && dx.abs() < 120.0 && dy.abs() < 85.0 {
                worst = worst.max((a - b).abs());
            }
        }
        println!("{circle_px} px: {worst:.3} codes");
        assert!(worst < 1.0, "{circle_px} px: {worst} codes");
    }
}

/// A board blurred over 12 px, behind the edge of a real object in focus: the object's pixels stay
/// the footage, and the board is as blurred as without an occluder.
#[test]
fn real_object_in_focus_occludes_a_blurred_object_sharply() {
    let camera = camera(12.0, 2.0, 0);
    let board = || rectangles(&[([-60.0, -50.0], [60.0, 50.0], 2.0, [0.5; 3])]);
    let edge_x = 150;
    let depth_m = (0..HEIGHT * WIDTH).map(|i| if i % WIDTH < edge_x { FOCUS_M as f32 } else { 3.0 }).collect();
    let depth = DepthMap { width: WIDTH, height: HEIGHT, depth_m, timestamp_s: 0.0 };
    for method in METHODS {
        let taken = |depth: Option<DepthMap>| {
            let frame = Frame { depth: depth.map(Arc::new), ..gpu::frame(0, 0.0, gpu::grey(WIDTH, HEIGHT, 60)) };
            let settings = gpu::settings(&[("depth_of_field", "method", Value::Text(method.to_owned()))]);
            gpu::composite(&gpu::gpu(), &camera, settings, board(), &sideways([0.0; 2]), frame)
        };
        let (free, hidden) = (taken(None), taken(Some(depth.clone())));
        let (free_layer, layer) = (free.layer.unwrap(), hidden.layer.unwrap());
        for (i, (a, b)) in free_layer.rgba.iter().zip(&layer.rgba).enumerate() {
            let (x, y) = (i as u32 % WIDTH, i as u32 / WIDTH);
            match x {
                // The edge itself takes one pixel on either side.
                x if x < edge_x - 1 => {
                    assert_eq!(*b, [0.0; 4], "{method}, {x}, {y}");
                    assert_eq!(hidden.pixels.at(x, y), [60; 3], "{method}, {x}, {y}");
                }
                x if x > edge_x => {
                    let error = (0..4).map(|c| (a[c] - b[c]).abs()).fold(0.0, f32::max);
                    assert!(error < 2e-3, "{method}, {x}, {y}: {b:?}, without it {a:?}");
                }
                _ => {}
            }
        }
        // Far behind the edge the board is not drawn; three quarters of a pixel at the edge are
        // visible.
        let alpha = layer.rgba[(120 * WIDTH + edge_x) as usize][3];
        assert!((alpha - 0.75).abs() < 0.01, "{method}: {alpha}");
    }
}

#[test]
fn surface_at_one_depth_matches_the_cpu_reference() {
    let shape = rectangles(&[
        ([-40.0, -30.0], [10.0, 20.0], 2.0, [0.8, 0.5, 0.2]),
        ([10.0, -30.0], [30.0, 35.0], 2.0, [0.1, 0.5, 0.9]),
    ]);
    let sharp = composited(&camera(0.01, 2.0, 0), shape.clone(), "layered").layer.unwrap();
    let sharp: Vec<[f64; 4]> = sharp.rgba.iter().map(|p| p.map(f64::from)).collect();
    let all = [(4.0, 0), (10.0, 0), (24.0, 5), (24.0, 3), (48.0, 6)];
    for &(circle_px, blades) in fast_or_full(&[(10.0, 0), (24.0, 3)][..], &all) {
        let camera = camera(circle_px, 2.0, blades);
        let geometry = camera.geometry.clone().unwrap();
        let opening: Opening = camera.lens.opening(&geometry).unwrap().unwrap();
        let twin =
            depth_of_field::twin(&sharp, WIDTH as usize, HEIGHT as usize, circle_px, &Aperture::of(&opening), 400);
        let layer = composited(&camera, shape.clone(), "layered").layer.unwrap();
        let (mut sum, mut area) = (0.0, 0.0);
        let mut worst = 0.0f64;
        for (a, b) in layer.rgba.iter().zip(&twin) {
            let error = (0..4).map(|c| (f64::from(a[c]) - b[c]).abs()).fold(0.0, f64::max);
            worst = worst.max(error);
            sum += error;
            area += f64::from(u8::from(b[3] > 0.0));
        }
        println!("{circle_px} px, {blades} blades: mean {:.4}, worst {worst:.3}", sum / area);
        // A few points or texels represent the whole aperture: corners are rounder, those of a
        // triangle most.
        assert!(
            sum / area < 0.016 && worst < 0.12,
            "{circle_px} px, {blades} blades: mean {}, worst {worst}",
            sum / area
        );
    }
}

/// A light and a board in front of a wall, drawn without blur, and the signed circle of confusion
/// of each pixel (NaN: background).
fn two_depths(circle_px: f64) -> (Scene, Vec<[f64; 4]>, Vec<f64>) {
    let wall = rectangles(&[([-60.0, -50.0], [60.0, 50.0], 2.0, [0.3, 0.2, 0.1])]);
    let before = rectangles(&[
        ([-20.0, -30.0], [10.0, 5.0], 0.8, [0.1, 0.5, 0.9]),
        ([30.0, 20.0], [33.0, 23.0], 0.8, [40.0, 30.0, 20.0]),
    ]);
    let sharp = |scene: &Scene| composited(&camera(0.01, 2.0, 0), scene.clone(), "layered").layer.unwrap().rgba;
    let near = sharp(&before);
    let scene = merge_scenes(wall, before);
    let all: Vec<[f64; 4]> = sharp(&scene).iter().map(|p| p.map(f64::from)).collect();
    // (8): 1/d_s − 1/d_o is 1/2 for the wall and −1/4 for the objects in front of it.
    let circle = |(p, near): (&[f64; 4], &[f32; 4])| match (near[3] > 0.0, p[3] > 0.0) {
        (true, _) => -0.5 * circle_px,
        (false, true) => circle_px,
        (false, false) => f64::NAN,
    };
    let circles = all.iter().zip(&near).map(circle).collect();
    (scene, all, circles)
}

/// Mean and largest difference over pixels covered in either picture; values above 1 are compared
/// relatively.
fn differences(actual: &[[f32; 4]], twin: &[[f64; 4]]) -> (f64, f64) {
    let (mut sum, mut count, mut worst) = (0.0, 0.0, 0.0f64);
    for (a, b) in actual.iter().zip(twin).filter(|(a, b)| a[3] > 0.0 || b[3] > 0.0) {
        let error = (0..4).map(|c| (f64::from(a[c]) - b[c]).abs() / b[c].max(1.0)).fold(0.0, f64::max);
        worst = worst.max(error);
        sum += error;
        count += 1.0;
    }
    (sum / f64::max(count, 1.0), worst)
}

#[test]
fn poisson_method_matches_the_mean_over_each_circle_of_confusion() {
    for &circle_px in fast_or_full(&[8.0][..], &[4.0, 10.0, 20.0]) {
        let (scene, sharp, circles) = two_depths(circle_px);
        let twin = poisson::twin(
            &sharp,
            WIDTH as usize,
            &circles.iter().map(|c| if c.is_nan() { 0.0 } else { *c }).collect::<Vec<_>>(),
        );
        let layer = composited(&camera(circle_px, 2.0, 0), scene, "poisson").layer.unwrap();
        let (mean, worst) = differences(&layer.rgba, &twin);
        println!("{circle_px} px: mean {mean:.4}, worst {worst:.3}");
        // 48 points represent the whole disc, most coarsely around the light.
        assert!(mean < 0.003 + 0.0004 * circle_px, "{circle_px} px: mean {mean}, worst {worst}");
    }
}

#[test]
fn diffusion_method_matches_the_stamps_of_the_paper() {
    let text = |t: &str| Value::Text(t.to_owned());
    for (circle_px, blades, more) in [
        (6.0, 0, vec![]),
        (12.0, 5, vec![("rim", Value::Number(0.1))]),
        (12.0, 3, vec![("mix", text("printed"))]),
        (20.0, 0, vec![("shape", text("star")), ("gaussian_px", Value::Number(1.5))]),
        (20.0, 0, vec![("shape", text("heart")), ("mix", text("printed")), ("mix_ratio", Value::Number(0.5))]),
        (20.0, 6, vec![("shape", text("star")), ("blend_below", Value::Number(0.6))]),
        (20.0, 0, vec![("largest_radius_px", Value::Number(7.0))]),
    ] {
        let (scene, sharp, circles) = two_depths(circle_px);
        let camera = camera(circle_px, 2.0, blades);
        let opening = camera.lens.opening(&camera.geometry.clone().unwrap()).unwrap().unwrap();
        let mut params = depth_of_field::DepthOfField::default();
        more.iter().for_each(|(name, value)| params.set(name, value).unwrap());
        let limit = 2.0 * f64::from(params.largest_radius_px);
        let circles: Vec<f64> = circles.iter().map(|c| if c.is_nan() { *c } else { c.clamp(-limit, limit) }).collect();
        let twin = diffusion::twin(&sharp, WIDTH as usize, &circles, &opening, &params);
        let layer = composited_with(&camera, scene, "diffusion", &more).layer.unwrap();
        if let Some(folder) = std::env::var_os("LOCARD_TEST_OUT") {
            let path = std::path::Path::new(&folder).join(format!("diffusion-{circle_px}-{blades}-{}.png", more.len()));
            gpu::write_layer_png(&path, &layer.rgba, WIDTH, HEIGHT);
        }
        let (mean, worst) = differences(&layer.rgba, &twin);
        println!("{circle_px} px, {blades} blades, {more:?}: mean {mean:.5}, worst {worst:.4}");
        // Texels and sums of 16-bit floats: 2^-11 each.
        assert!(mean < 2e-4 && worst < 2e-3, "{more:?}: mean {mean}, worst {worst}");
    }
}

#[test]
fn unsupported_aperture_shapes_are_refused() {
    let camera = camera(12.0, 2.0, 0);
    for method in ["layered", "poisson", "reference"] {
        let settings = gpu::settings(&[
            ("depth_of_field", "method", Value::Text(method.to_owned())),
            ("depth_of_field", "shape", Value::Text("heart".to_owned())),
        ]);
        let effect = settings.effects().find(|e| e.table() == "depth_of_field").unwrap();
        let error = effect.check(&camera, camera.geometry.as_ref().unwrap()).unwrap_err().to_string();
        assert!(error.contains("depth_of_field.shape is refused") && error.contains("diffusion"), "{error}");
    }
}
