//! Every projection, compared with known directions.

use std::f64::consts::PI;
use std::path::Path;

use crate::gpu;
use crate::marks::{marks, unlit, vertex};
use crate::program;
use crate::tier::{fast_or_full, is_full};
use glam::{DQuat, DVec2, DVec3, Vec3};
use locard::camera::curved::{CurvedCamera, CurvedProjection};
use locard::camera::{Distortion, Geometry, Intrinsics, LensModel, MapSample, fit_lens_map};
use locard::pixels::LinearImage;
use locard::pose::Pose;
use locard::render::{PictureRequest, Projection, Renderer, take_still};
use locard::scene::{Environment, EnvironmentMap, Lighting, Scene};

/// The colour of a direction on the walls of [`room`].
fn wall_color(d: DVec3) -> Vec3 {
    (0.5 + 0.5 * d / d.abs().max_element()).as_vec3()
}

/// The inside of a cube of 2 m around the origin, twelve triangles, each point coloured by its
/// direction.
fn room() -> Scene {
    let corner = |i: usize| {
        DVec3::new(f64::from((i & 1) as u8), f64::from((i >> 1 & 1) as u8), f64::from((i >> 2) as u8)) * 2.0 - 1.0
    };
    let vertices = (0..8).map(|i| vertex(corner(i), wall_color(corner(i)))).collect();
    let sides = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
    unlit(vertices, sides.iter().flat_map(|s: &[u32; 4]| [s[0], s[1], s[2], s[0], s[2], s[3]]).collect())
}

fn shoot(scene: Scene, projection: &Projection, pose: Pose) -> LinearImage {
    let gpu = gpu::gpu();
    let mut renderer = Renderer::new(&gpu, scene);
    take_still(&gpu, &mut renderer, &PictureRequest { projection: projection.clone(), pose, background: true }).unwrap()
}

fn curved(curve: CurvedProjection, width_px: u32, height_px: u32) -> Projection {
    Projection::Curved(CurvedCamera { curve, width_px, height_px })
}

fn all_around() -> CurvedProjection {
    CurvedProjection::Environment { fov_rad: DVec2::new(2.0 * PI, PI) }
}

fn real_fisheye(scale: f64) -> Geometry {
    let intrinsics = Intrinsics {
        width_px: (400.0 * scale) as u32,
        height_px: (300.0 * scale) as u32,
        fx_px: 150.0 * scale,
        fy_px: 151.0 * scale,
        cx_px: 203.0 * scale,
        cy_px: 148.0 * scale,
        ..Default::default()
    };
    let [k1, k2, k3, k4] = [0.02, -0.03, 0.01, -0.002];
    Geometry::new(intrinsics, Distortion { model: LensModel::OpencvFisheye, k1, k2, k3, k4, ..Default::default() })
}

/// A lens as a table: another program's formula, which no model of ours has.
fn tabled(scale: f64) -> Geometry {
    let intrinsics = Intrinsics {
        width_px: (320.0 * scale) as u32,
        height_px: (240.0 * scale) as u32,
        fx_px: 200.0 * scale,
        fy_px: 200.0 * scale,
        cx_px: 160.0 * scale,
        cy_px: 120.0 * scale,
        ..Default::default()
    };
    let size = DVec2::new(f64::from(intrinsics.width_px), f64::from(intrinsics.height_px));
    let undistorted = (1.5 * size).floor();
    let sample = |n: u32| {
        let place = (DVec2::new(f64::from(n % 91), f64::from(n / 91)) / DVec2::new(90.0, 70.0)) * undistorted;
        let from_middle = (place - 0.5 * undistorted) / (200.0 * scale);
        let barrel = from_middle / (1.0 + 0.08 * from_middle.length_squared() + 0.03 * from_middle.x.powi(2));
        let skew = DVec2::new(0.01 * from_middle.y, 0.02 * from_middle.x * from_middle.y);
        MapSample { undistorted_px: place, recorded: ((barrel + skew) * 200.0 * scale + 0.5 * size) / size }
    };
    let samples: Vec<MapSample> = (0..91 * 71).map(sample).collect();
    let map = fit_lens_map(&samples, [undistorted.x as u32, undistorted.y as u32], None).unwrap();
    map.check(&intrinsics).unwrap();
    Geometry::new(intrinsics, Distortion { model: LensModel::StMap, map: Some(map), ..Default::default() })
}

/// Some pinholes and every curve, at `scale` times the full tier's resolution.
fn projections(scale: f64) -> Vec<Projection> {
    let px = |of_full: u32| (f64::from(of_full) * scale).round() as u32;
    let pinhole = |focal_px: f64| gpu::pinhole(px(320), px(240), focal_px * scale);
    let curved = |curve: CurvedProjection, width_px: u32, height_px: u32| curved(curve, px(width_px), px(height_px));
    let mut off_centre = pinhole(240.0);
    off_centre.intrinsics.cx_px = 100.0 * scale;
    off_centre.intrinsics.cy_px = 170.0 * scale;
    vec![
        Projection::Perspective(pinhole(200.0)),
        Projection::Perspective(off_centre),
        Projection::Perspective(real_fisheye(scale)),
        Projection::Perspective(tabled(scale)),
        curved(CurvedProjection::Fisheye { fov_rad: PI }, 400, 360),
        curved(CurvedProjection::Fisheye { fov_rad: 280f64.to_radians() }, 400, 400),
        curved(all_around(), 720, 360),
        curved(CurvedProjection::LittlePlanet { fov_rad: 220f64.to_radians() }, 420, 360),
    ]
}

/// A pose rotated about all axes.
fn turned() -> Pose {
    Pose::from_camera_in_world(DVec3::ZERO, DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -1.1, 2.0))
}

/// Coverage centroid within `reach` of a position.
fn centroid(image: &LinearImage, around: DVec2, reach: f64) -> Option<DVec2> {
    let (mut sum, mut weight) = (DVec2::ZERO, 0.0);
    for (i, p) in image.rgba.iter().enumerate() {
        let at = DVec2::new(i as f64 % f64::from(image.width), (i / image.width as usize) as f64);
        let at = DVec2::new(at.x.floor() + 0.5, at.y + 0.5);
        if (at - around).abs().max_element() <= reach {
            sum += at * f64::from(p[3]);
            weight += f64::from(p[3]);
        }
    }
    (weight > 2.0).then(|| sum / weight)
}

// Slow: renders a marker for each of many directions in every projection.
#[test]
fn marks_project_by_the_formula_in_every_projection() {
    // In camera axes: all about the optical axis, on seams and corners of the cube, behind.
    let mut directions: Vec<DVec3> = Vec::new();
    for (theta, count) in
        [(0.0, 1), (18.0, 3), (33.0, 5), (45.0, 4), (54.7356, 4), (75.0, 8), (90.0, 4), (125.2644, 4), (135.0, 4)]
    {
        for n in 0..count {
            let (theta, phi) = (
                f64::to_radians(theta),
                2.0 * PI * f64::from(n) / f64::from(count)
                    + if theta == 54.7356 || theta == 125.2644 { 0.25 * PI } else { 0.0 },
            );
            directions.push(DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()));
        }
    }
    let pose = turned();
    let (scale, side) = (fast_or_full(0.6, 1.0), 0.04);
    let scene =
        marks(&directions.iter().map(|d| pose.world_from_camera_rotation() * *d).collect::<Vec<_>>(), side, 1.0);
    let mut worst = 0.0f64;
    for projection in projections(scale) {
        let image = shoot(scene.clone(), &projection, pose);
        let size = DVec2::new(image.width.into(), image.height.into());
        let mut marks = 0;
        for d in &directions {
            let Some(at) = projection.project(2.0 * *d) else { continue };
            let step = projection.direction(at + DVec2::X).map_or(1.0, |e| e.angle_between(*d));
            let reach = 4.0f64.max(1.8 * 0.5 * side * 2f64.sqrt() / step).ceil();
            let inside = at.cmpgt(DVec2::splat(reach)).all() && at.cmplt(size - reach).all();
            // Skipped: squares cut by the image circle, directions beside or behind a perspective
            // lens without cube map, and poles, which span whole rows.
            let whole = projection.direction(at).is_some_and(|e| e.angle_between(*d) < 1e-6);
            let whole = whole && projection.direction(at + 8.0 * (at - 0.5 * size).normalize_or_zero()).is_some();
            let direct = matches!(&projection, Projection::Perspective(g) if !g.needs_cube_map()) && d.z < 0.2;
            let pole = matches!(
                projection,
                Projection::Curved(CurvedCamera { curve: CurvedProjection::Environment { .. }, .. })
            ) && d.y.abs() > 0.98;
            if !inside || !whole || direct || pole {
                continue;
            }
            let mark_px = centroid(&image, at, reach).unwrap_or_else(|| panic!("{projection:?}: {d} is not at {at}"));
            worst = worst.max(mark_px.distance(at));
            // The centroid of a projected square deviates a little from the projection of its
            // centre; most of the rest is sampling.
            assert!(mark_px.distance(at) < 0.3, "{projection:?}: {d} at {mark_px}, not {at}");
            marks += 1;
        }
        println!("{projection:?}: {marks} marks");
        assert!(marks >= 5, "{projection:?}: {marks} marks");
    }
    println!("farthest {worst:.3} px");
}

#[test]
fn every_pixel_shows_the_colour_of_its_direction_without_seams() {
    let pose = turned();
    for projection in projections(fast_or_full(0.4, 1.0)) {
        let image = shoot(room(), &projection, pose);
        let (mut shown, mut worst) = (0, 0.0f32);
        for (i, p) in image.rgba.iter().enumerate() {
            let at = DVec2::new(f64::from(i as u32 % image.width), f64::from(i as u32 / image.width));
            let corners =
                [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)].map(|c| projection.direction(at + DVec2::from(c)));
            let Some(d) = projection.direction(at + 0.5) else {
                // Pixels on the image circle are partly covered.
                assert!(corners.iter().any(Option::is_some) || p[3] == 0.0, "{projection:?} {at}: beyond the circle");
                continue;
            };
            let direct = matches!(&projection, Projection::Perspective(g) if !g.needs_cube_map()) && d.z < 0.05;
            if corners.iter().any(Option::is_none) || direct {
                continue;
            }
            let expected = wall_color(pose.world_from_camera_rotation() * d);
            let off = (Vec3::new(p[0], p[1], p[2]) - expected).abs().max_element().max((p[3] - 1.0).abs());
            // At most half a pixel: the mean over a pixel is not its centre's value where walls
            // meet or the curve is steep.
            let wide = corners[0].unwrap().angle_between(corners[3].unwrap()) as f32;
            worst = worst.max(off);
            assert!(off < 0.004 + 0.5 * wide, "{projection:?} {at}: {p:?}, not {expected}");
            shown += 1;
        }
        println!("{projection:?}: {shown} pixels, at most {worst:.4} off");
        assert!(shown > image.rgba.len() / 2);
    }
}

#[test]
fn orthographic_projection_keeps_sizes_and_occludes() {
    // A square of 0.2 m at 1 m, one of 0.2 m at 9 m beside it, and a third half behind the first.
    let square = |x: f64, z: f64, grey: f32| {
        [(-0.1, -0.1), (0.1, -0.1), (0.1, 0.1), (-0.1, 0.1)]
            .map(|(a, b)| vertex(DVec3::new(x + a, b, z), Vec3::splat(grey)))
    };
    let vertices =
        [square(0.0, 1.0, 0.2), square(0.3, 9.0, 0.5), square(0.1, 5.0, 0.9), square(0.0, -1.0, 1.0)].concat();
    let indices = (0..4).flat_map(|n| [0, 1, 2, 0, 2, 3].map(|i| 4 * n + i)).collect();
    let projection = Projection::Orthographic { width_px: 200, height_px: 100, px_per_m: 200.0 };
    let image = shoot(unlit(vertices, indices), &projection, Pose::IDENTITY);
    let row = &image.rgba[50 * 200..51 * 200];
    let expected = |x: usize| match x {
        80..120 => [0.2, 0.2, 0.2, 1.0],
        120..140 => [0.9, 0.9, 0.9, 1.0],
        140..180 => [0.5, 0.5, 0.5, 1.0],
        _ => [0.0; 4],
    };
    for (x, p) in row.iter().enumerate() {
        assert!((0..4).all(|c| (p[c] - expected(x)[c]).abs() < 1e-3), "column {x}: {p:?}");
    }
    let column: f32 = (0..100).map(|y| image.rgba[y * 200 + 100][3]).sum();
    assert!((column - 40.0).abs() < 1e-3, "{column}");
}

#[test]
fn environment_is_the_background_and_shows_through_partial_coverage() {
    let (width, height) = (256, 128);
    // By longitude: red to the right of the map's middle (−z), green to its left; bright above.
    let rgb = (0..width * height)
        .map(|i| {
            let (right, above) = (i % width >= width / 2, i / width < height / 2);
            [f32::from(u8::from(right)), f32::from(u8::from(!right)), f32::from(u8::from(above))]
        })
        .collect();
    let map = EnvironmentMap {
        width,
        height,
        rgb: std::sync::Arc::new(rgb),
        map_from_world: glam::Quat::IDENTITY,
        color: glam::Vec3::splat(0.5),
    };
    let mut scene = marks(&[DVec3::NEG_Z], 0.04, 1.0);
    scene.lighting = Lighting { environment: Environment::Map(map), ..Lighting::default() };
    // Faces the world's −z, y up.
    let pose = Pose::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y).unwrap();
    for projection in [Projection::Perspective(gpu::pinhole(200, 160, 100.0)), curved(all_around(), 800, 400)] {
        let image = shoot(scene.clone(), &projection, pose);
        let at = |x: u32, y: u32| image.rgba[(y * image.width + x) as usize];
        let (right, low) = (image.width - 70, image.height - 20);
        for (p, expected) in [
            (at(right, 20), [0.5, 0.0, 0.5, 1.0]),
            (at(70, 20), [0.0, 0.5, 0.5, 1.0]),
            (at(right, low), [0.5, 0.0, 0.0, 1.0]),
            (at(image.width / 2, image.height / 2), [1.0; 4]),
        ] {
            assert!((0..4).all(|c| (p[c] - expected[c]).abs() < 2e-3), "{projection:?}: {p:?}, not {expected:?}");
        }
    }
}

#[test]
fn program_frames_a_scene_with_every_projection() {
    let temp = tempfile::tempdir().unwrap();
    for camera in ["perspective", "orthographic", "off-centre", "fisheye", "environment", "little-planet"] {
        for model in ["scenes/l-scale.glb", "scenes/demo.toml"] {
            if model == "scenes/demo.toml" && camera != "perspective" && !is_full() {
                continue;
            }
            let file = temp.path().join(format!("{camera}.png"));
            let mut arguments =
                vec!["render", model, "--camera", camera, "--size", "96x64", "--transparent", "--force"];
            if camera == "off-centre" {
                arguments.extend(["--shift", "0.1,-0.1"]);
            }
            let (done, text) = program::success_and_stderr(&[&arguments[..], &["-o", file.to_str().unwrap()]].concat());
            assert!(done && !text.contains("nothing of the scene"), "{camera}: {text}");
            let picture = image::open(&file).unwrap().to_rgba8();
            assert_eq!(picture.dimensions(), (96, 64));
            let opaque_px = picture.pixels().filter(|p| p.0[3] > 128).count();
            assert!(opaque_px > 4, "{camera} {model}: {opaque_px} pixels");
            // Complete: nothing touches the frame, except for the ground below an environment.
            let cut = picture
                .enumerate_pixels()
                .filter(|(x, y, p)| (*x == 0 || *y == 0 || *x == 95 || *y == 63) && p.0[3] > 128)
                .count();
            assert!(
                cut == 0 || ["off-centre", "environment"].contains(&camera),
                "{camera} {model}: {cut} pixels at the frame"
            );
        }
    }
}

#[test]
fn invalid_cameras_are_refused() {
    let out = std::env::temp_dir().join("never-written.png");
    for (arguments, message) in [
        (&["--fov", "0"][..], "more than 0"),
        (&["--fov", "180"], "up to 175"),
        (&["--fov", "90,45"], "one angle of view"),
        (&["--size", "0x5"], "1 to 16384"),
        (&["--camera", "orthographic", "--fov", "40"], "--height"),
        (&["--camera", "off-centre"], "--shift"),
        (&["--shift", "1,1"], "off-centre"),
        (&["--height", "1"], "orthographic"),
        (&["--camera", "environment", "--fov", "360,200"], "360 by 180"),
        (&["--from", "0,0,1", "--at", "0,0,1"], "do not define a view"),
        (&["--from", "0,0,1", "--at", "0,0,0", "--up", "0,0,1"], "do not define a view"),
        (&["--from", "0,nan,1"], "expected numbers from"),
        (&["-o", "a.gif"], ".png or .exr"),
    ] {
        let mut all = vec!["render", "scenes/l-scale.glb"];
        all.extend(arguments);
        if !arguments.contains(&"-o") {
            all.extend(["-o", out.to_str().unwrap()]);
        }
        let (done, text) = program::success_and_stderr(&all);
        assert!(!done && text.contains(message), "{arguments:?}: {text}");
    }
    assert!(!Path::new(&out).exists());
}
