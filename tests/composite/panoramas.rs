//! 360° pictures and wide fisheyes: objects composited into them. One file, because the tests share
//! the cameras and scenes around them.

use std::borrow::Cow;
use std::f64::consts::PI;
use std::path::Path;

use crate::gpu;
use crate::marks::marks;
use crate::program;
use crate::tier::fast_or_full;
use glam::{DAffine3, DQuat, DVec2, DVec3};
use locard::camera::{Camera, Distortion, Geometry, Intrinsics, LensModel, NoiseBin, NoiseProfile};
use locard::compositor::{Composited, Compositor, IN_FLIGHT, Settings, StreamFrame, StreamInputs};
use locard::grey_image::GreyImage;
use locard::measure::displacement::{DisplacementOptions, displacements};
use locard::params::Value;
use locard::pixels::{DepthMap, LayerImage, Pixels};
use locard::pose::Pose;
use locard::scene::Scene;
use locard::simulate::{Detail, Motion, Options, Simulation, Snapshot, board};
use locard::tracking::PoseTrack;

fn round(width_px: u32) -> Geometry {
    let intrinsics = Intrinsics { width_px, height_px: width_px / 2, ..Default::default() };
    Geometry::new(intrinsics, Distortion { model: LensModel::Equirectangular, ..Default::default() })
}

/// A field of view of 200° across the width, not quite equidistant.
fn fisheye(width_px: u32) -> Geometry {
    let px = |of_640: f64| of_640 * f64::from(width_px) / 640.0;
    let intrinsics = Intrinsics {
        width_px,
        height_px: px(600.0).round() as u32,
        fx_px: px(180.0),
        fy_px: px(181.0),
        cx_px: px(322.0),
        cy_px: px(297.0),
        ..Default::default()
    };
    let [k1, k2, k3, k4] = [0.02, -0.01, 0.002, -0.0002];
    Geometry::new(intrinsics, Distortion { model: LensModel::OpencvFisheye, k1, k2, k3, k4, ..Default::default() })
}

fn still(pose: Pose) -> PoseTrack {
    PoseTrack::new(vec![(-9.0, pose), (9.0, pose)], 99.0).unwrap()
}

/// A camera that turns to the right at a steady rate, with orientation `start` at time 0.
fn turning(rad_per_s: f64, start: DQuat) -> PoseTrack {
    let at = |n: i32| {
        let t = f64::from(n) * 0.01;
        (t, Pose::from_camera_in_world(DVec3::ZERO, start * DQuat::from_rotation_y(rad_per_s * t)))
    };
    PoseTrack::new((-30..=30).map(at).collect(), 1.0).unwrap()
}

fn plain() -> Settings {
    let mut settings = Settings::default();
    settings.plain();
    settings
}

fn grey(geometry: &Geometry) -> Pixels {
    gpu::grey(geometry.intrinsics.width_px, geometry.intrinsics.height_px, 90)
}

fn draw(camera: &Camera, settings: Settings, scene: Scene, track: &PoseTrack) -> Composited {
    let frame = gpu::frame(0, 0.0, grey(camera.geometry.as_ref().unwrap()));
    gpu::composite(&gpu::gpu(), camera, settings, scene, track, frame)
}

fn layer(camera: &Camera, settings: Settings, scene: Scene, track: &PoseTrack) -> LayerImage {
    draw(camera, settings, scene, track).layer.unwrap()
}

/// Coverage centroid within `reach` of a position, px; continues across the seam.
fn centroid(g: &Geometry, layer: &LayerImage, around: DVec2, reach: f64) -> Option<DVec2> {
    let (mut sum, mut weight) = (DVec2::ZERO, 0.0);
    for (i, p) in layer.rgba.iter().enumerate() {
        let at = DVec2::new(f64::from(i as u32 % layer.width) + 0.5, f64::from(i as u32 / layer.width) + 0.5);
        let way = g.displacement_px(around, at);
        if way.abs().max_element() <= reach {
            (sum, weight) = (sum + way * f64::from(p[3]), weight + f64::from(p[3]));
        }
    }
    (weight > 2.0).then(|| around + sum / weight)
}

/// Directions all around: on edges and corners of a cube, on the seam, near the poles and behind.
fn all_around() -> Vec<DVec3> {
    let mut directions = vec![DVec3::Z, DVec3::NEG_Z, DVec3::new(0.002, 0.1, -1.0), DVec3::ONE, -DVec3::ONE];
    for above in [-70.0, -45.0, -20.0, 0.0, 30.0, 45.0, 60.0f64] {
        for n in 0..8 {
            let ((s, c), (above, level)) = ((0.25 * PI * f64::from(n) + 0.3).sin_cos(), above.to_radians().sin_cos());
            directions.push(DVec3::new(s * level, above, c * level));
        }
    }
    directions
}

#[test]
fn marks_project_by_the_formula_all_around() {
    let pose =
        Pose::from_camera_in_world(DVec3::new(3.0, -1.0, 2.0), DQuat::from_euler(glam::EulerRot::XYZ, 0.2, -1.1, 0.3));
    let (round_px, fisheye_px, half_size, at_a_time) = fast_or_full((640, 400, 0.04, 32), (1024, 640, 0.03, 8));
    for (geometry, min_marks, largest) in [(round(round_px), 61, 180.0), (fisheye(fisheye_px), 30, 99.0)] {
        let size = DVec2::new(geometry.intrinsics.width_px.into(), geometry.intrinsics.height_px.into());
        let directions: Vec<DVec3> = all_around().into_iter().map(DVec3::normalize).collect();
        let camera = gpu::camera(&geometry, 0.0);
        let (mut mark_count, mut worst, mut farthest) = (0, 0.0f64, 0.0f64);
        for few in directions.chunks(at_a_time) {
            // Few marks at a time, so that their squares do not overlap.
            let mut scene = marks(few, half_size, 0.5);
            scene.objects[0].parts[0].world_from_mesh =
                DAffine3::from_rotation_translation(pose.world_from_camera_rotation(), pose.position_in_world_m());
            let image = layer(&camera, plain(), scene, &still(pose));
            for d in few {
                let Some(at) = geometry.project(2.0 * *d) else { continue };
                let theta = d.angle_between(DVec3::Z).to_degrees();
                let finest = geometry.intrinsics.fx_px;
                // Near a pole a square is wide.
                let wide = if geometry.is_equirectangular() { 1.0 / (d.x.hypot(d.z)) } else { 1.6 };
                let reach = (half_size * 0.75 * finest * wide).ceil() + 3.0;
                let inside = at.y > reach && at.y < size.y - reach;
                let inside = inside && (geometry.is_equirectangular() || (at.x > reach && at.x < size.x - reach));
                if !inside || theta > largest {
                    continue;
                }
                let mark_px = centroid(&geometry, &image, at, reach).unwrap_or_else(|| panic!("{d} is not at {at}"));
                // The centroid of a projected square deviates a little from the projection of its
                // centre.
                assert!(mark_px.distance(at) < 0.3, "{d} ({theta}°) at {mark_px}, not {at}");
                (mark_count, worst, farthest) = (mark_count + 1, worst.max(mark_px.distance(at)), farthest.max(theta));
                let (x, y) = ((at.x as u32).min(image.width - 1), at.y as u32);
                let depth = f64::from(image.depth_m[(y * image.width + x) as usize]);
                assert!((depth - 2.0).abs() < 0.002, "{d}: {depth} m is the distance");
            }
        }
        println!("{mark_count} marks out to {farthest:.1}°, farthest {worst:.3} px");
        assert!(mark_count >= min_marks && farthest > 95.0, "{mark_count} {farthest}");
    }
}

#[test]
fn square_at_a_pole_covers_all_longitudes_and_nothing_else() {
    let geometry = round(512);
    for pole in [DVec3::Y, DVec3::NEG_Y] {
        let image = layer(&gpu::camera(&geometry, 0.0), plain(), marks(&[pole], 0.2, 0.5), &still(Pose::IDENTITY));
        let (mut wrong, mut rim) = (0, 0);
        for (i, p) in image.rgba.iter().enumerate() {
            let at = DVec2::new(f64::from(i as u32 % 512) + 0.5, f64::from(i as u32 / 512) + 0.5);
            let d = geometry.direction(at).unwrap();
            // The square is 2 m away and 0.4 m wide; 1 is its edge, a pixel is 0.12.
            let (a, b) = pole.any_orthonormal_pair();
            let on = |axis: DVec3| (2.0 * d / d.dot(pole)).dot(axis).abs() / 0.2;
            let far = if d.dot(pole) > 0.0 { on(a).max(on(b)) } else { 9.0 };
            match far {
                f if f < 0.85 => wrong += usize::from((p[3] - 1.0).abs() > 1e-3),
                f if f > 1.15 => wrong += usize::from(p[3] != 0.0),
                _ => rim += 1,
            }
        }
        assert!(wrong == 0 && rim > 20, "{pole}: {wrong} wrong, {rim} at the rim");
    }
}

/// An object across the seam has the same picture as in the middle, with the camera turned by 180°;
/// with motion blur too.
#[test]
fn picture_is_continuous_across_the_seam() {
    let geometry = round(1024);
    let mut camera = gpu::camera(&geometry, 0.03);
    let scene = marks(&[DVec3::new(0.05, 0.2, 1.0), DVec3::new(-0.1, -0.2, 1.0)], 0.1, 0.5);
    for exposure_time_s in [0.0, 0.03] {
        camera.exposure.time_s = Some(exposure_time_s);
        let middle = layer(&camera, Settings::default(), scene.clone(), &turning(1.0, DQuat::IDENTITY));
        let seam = layer(&camera, Settings::default(), scene.clone(), &turning(1.0, DQuat::from_rotation_y(PI)));
        let (mut visible, mut worst) = (0, 0.0f32);
        for (i, p) in middle.rgba.iter().enumerate() {
            let (x, y) = (i % 1024, i / 1024);
            let q = seam.rgba[y * 1024 + (x + 512) % 1024];
            visible += usize::from(p[3] > 0.0);
            worst = (0..4).fold(worst, |w, c| w.max((p[c] - q[c]).abs()));
            let (v, w) = (middle.velocity[i], seam.velocity[y * 1024 + (x + 512) % 1024]);
            if p[3] > 0.99 && q[3] > 0.99 {
                // A turn to the right moves everything to the left at the same rate at every
                // latitude.
                assert!((v[0] + 1024.0 / (2.0 * PI) as f32).abs() < 2.0 && v[1].abs() < 2.0, "{v:?}");
                assert!((v[0] - w[0]).hypot(v[1] - w[1]) < 2.0, "{v:?} {w:?}");
            }
        }
        println!("{exposure_time_s} s: {visible} pixels, at most {worst:.4} apart");
        assert!(visible > 500 && worst < 0.005, "{visible} {worst}");
    }
}

#[test]
fn velocity_filter_matches_the_reference_at_the_seam_and_in_a_wide_fisheye() {
    let reference = || gpu::settings(&[("motion_blur", "method", Value::Text("reference".to_owned()))]);
    let wide = DVec3::new(-1.0, 0.1, -0.02);
    for (geometry, start, at, axis) in [
        (round(1024), DQuat::from_rotation_y(PI), DVec3::new(0.0, 0.3, 1.0), DVec3::Y),
        (fisheye(640), DQuat::IDENTITY, wide, DVec3::Z),
    ] {
        let camera = gpu::camera(&geometry, 0.03);
        let track = {
            let at = |n: i32| {
                let t = f64::from(n) * 0.01;
                (t, Pose::from_camera_in_world(DVec3::ZERO, start * DQuat::from_axis_angle(axis, 1.5 * t)))
            };
            PoseTrack::new((-30..=30).map(at).collect(), 1.0).unwrap()
        };
        let scene = marks(&[at], 0.12, 0.5);
        let filtered = layer(&camera, Settings::default(), scene.clone(), &track);
        let summed = layer(&camera, reference(), scene, &track);
        let error = gpu::mean_absolute_error(&filtered, &summed.rgba);
        let partly = filtered.rgba.iter().filter(|p| p[3] > 0.05 && p[3] < 0.95).count();
        println!("{error:.4} over {partly} blurred pixels");
        assert!(error < 0.02 && partly > 50, "{error} {partly}");
    }
}

fn noisy(mut camera: Camera) -> Camera {
    let bins = || vec![NoiseBin { code: 0.0, sigma: 2.0 }, NoiseBin { code: 255.0, sigma: 4.0 }];
    camera.noise = Some(NoiseProfile {
        example: None,
        bins: [bins(), bins(), bins()],
        channel_correlation: [0.3; 3],
        neighbour_correlation: [0.4; 2],
    });
    camera
}

/// A picture in which no two neighbours are equal.
fn speckled(geometry: &Geometry) -> Pixels {
    let (w, h) = (geometry.intrinsics.width_px, geometry.intrinsics.height_px);
    Pixels::from_u8(w, h, (0..3 * w * h).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect()).unwrap()
}

/// The seam, both poles and a turning camera, with all effects on: pixels with A = 0 are unchanged,
/// and a frame composited alone equals the one of the whole run.
// Slow: two 360° cameras, each frame alone and among the others.
#[test]
fn footage_around_objects_is_unchanged_and_frames_are_independent() {
    // Half the resolution and twice the marks: their size in pixels is equal in both tiers.
    let (smaller, half_size) = fast_or_full((2, 0.2), (1, 0.1));
    let scene = marks(&[DVec3::NEG_Z, DVec3::new(0.3, 1.0, -0.2), DVec3::new(0.3, -0.1, 1.0)], half_size, 0.5);
    for geometry in [round(512 / smaller), fisheye(640 / smaller)] {
        let camera = noisy(gpu::camera(&geometry, 0.02));
        let settings = || {
            gpu::settings(&[
                ("edge_blend", "impact", Value::Number(0.5)),
                ("point_spread", "sigma_px", Value::Number(0.6)),
            ])
        };
        let track = turning(1.2, DQuat::IDENTITY);
        let frame = |n: usize| gpu::frame(n, n as f64 * 0.02, speckled(&geometry));
        let settings = settings();
        let inputs = StreamInputs {
            camera: Cow::Borrowed(&camera),
            settings: &settings,
            track: &track,
            want_layers: true,
            in_flight: IN_FLIGHT,
        };
        let run = |range: std::ops::Range<usize>| -> Vec<Composited> {
            let mut compositor = Compositor::new(gpu::gpu().clone(), scene.clone());
            let input = |n| StreamFrame { frame: frame(n), geometry: geometry.clone(), interval_s: 0.02 };
            let frames = range.map(|n| Ok::<_, std::io::Error>(input(n)));
            compositor.composite_stream(inputs.clone(), frames).map(Result::unwrap).collect()
        };
        let (frames, alone) = fast_or_full((3, [2, 1]), (4, [3, 1]));
        let all = run(0..frames);
        for done in &all {
            assert_eq!(done.stats.effects, ["motion_blur", "point_spread", "edge_blend", "noise"]);
            let layer = done.layer.as_ref().unwrap();
            let (mut visible, mut changed) = (0, 0);
            let before = speckled(&geometry);
            for (i, (out, camera)) in done
                .pixels
                .codes
                .eight_bit()
                .unwrap()
                .chunks(3)
                .zip(before.codes.eight_bit().unwrap().chunks(3))
                .enumerate()
            {
                if layer.rgba[i][3] == 0.0 {
                    assert_eq!(out, camera, "frame {} pixel {i}", done.frame);
                    assert_eq!(layer.depth_m[i], 0.0);
                } else {
                    (visible, changed) = (visible + 1, changed + usize::from(out != camera));
                }
            }
            assert!(visible > 500 && changed > visible / 2, "{visible} {changed}");
        }
        for n in alone {
            let one = run(n..n + 1).remove(0);
            assert!(one.pixels.codes.eight_bit().unwrap() == all[n].pixels.codes.eight_bit().unwrap(), "frame {n}");
            assert!(one.layer == all[n].layer, "frame {n}");
        }
    }
}

#[test]
fn real_depth_occludes_across_the_seam() {
    let geometry = round(512);
    let scene = marks(&[DVec3::NEG_Z], 0.4, 0.5);
    // Right of the seam (the left of the picture) a wall at 1 m, left of it one at 3 m.
    let depth_m = (0..512 * 256).map(|i| if i % 512 < 256 { 1.0 } else { 3.0 }).collect();
    for later_s in [0.0, 0.01] {
        let mut frame = gpu::frame(0, 0.0, grey(&geometry));
        let depth = DepthMap { width: 512, height: 256, depth_m: Clone::clone(&depth_m), timestamp_s: later_s };
        frame.depth = Some(depth.into());
        let track = turning(0.5, DQuat::IDENTITY);
        let mut settings = Settings::default();
        settings.only(&["noise".to_owned()]).unwrap();
        let done = gpu::composite(&gpu::gpu(), &gpu::camera(&geometry, 0.0), settings, scene.clone(), &track, frame);
        let layer = done.layer.unwrap();
        let count = |columns: std::ops::Range<usize>| {
            (0..256)
                .map(|y| layer.rgba[y * 512..][columns.clone()].iter().filter(|p| p[3] > 0.5).count())
                .sum::<usize>()
        };
        // The turn between the depth's time and the frame's is 0.4 px.
        let (left, right) = (count(256..512), count(2..256));
        assert!(left > 400 && right == 0, "{left} {right}");
    }
}

/// Resamples 0.34 rad around a direction as a pinhole picture, from a picture of any projection.
fn pinhole_view(geometry: &Geometry, towards: DVec3, value: impl Fn(u32, u32) -> f64) -> GreyImage<f64> {
    let side = 192usize;
    let (right, down) = {
        let up = if towards.y.abs() > 0.9 { DVec3::Z } else { DVec3::NEG_Y };
        let right = towards.cross(up).normalize();
        (right, towards.cross(right))
    };
    let (w, h) = (geometry.intrinsics.width_px as i64, geometry.intrinsics.height_px as i64);
    let values = (0..side * side).map(|i| {
        let p = (DVec2::new((i % side) as f64, (i / side) as f64) + 0.5 - 0.5 * side as f64) / side as f64 * 0.34;
        let at = geometry.project(towards + p.x * right + p.y * down).unwrap() - 0.5;
        let (base, f) = (at.floor(), at - at.floor());
        let texel = |dx: i64, dy: i64| {
            let x = base.x as i64 + dx;
            let x = if geometry.is_equirectangular() { x.rem_euclid(w) } else { x.clamp(0, w - 1) };
            value(x as u32, (base.y as i64 + dy).clamp(0, h - 1) as u32)
        };
        let row = |dy| texel(0, dy) * (1.0 - f.x) + texel(1, dy) * f.x;
        row(0) * (1.0 - f.y) + row(1) * f.y
    });
    GreyImage::new(side, side, values.collect()).unwrap()
}

/// The site's board rendered by the simulation, and the same board composited over it: in the
/// middle, across the seam, at the nadir, and in a fisheye at its border and beyond 90°.
#[test]
fn virtual_board_coincides_with_the_simulated_one() {
    let glb = board().glb().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("board.glb");
    std::fs::write(&file, glb).unwrap();
    let scene = locard::scene::load(&file, Some(DVec3::Z)).unwrap();
    let (smaller, samples) = fast_or_full((1.25, 4), (1.0, 6));
    let options = |lens, width_px, height_px| Options {
        lens,
        width_px,
        height_px,
        focal_px: 260.0 / smaller,
        k1: -0.02,
        k2: 0.003,
        frames: 1,
        motion: Motion::Static,
        board: true,
        exposure_time_s: 0.0,
        readout_time_s: 0.0,
        ..Options::default()
    };
    let (sky, fish) = (LensModel::Equirectangular, LensModel::OpencvFisheye);
    let beside = |degrees: f64| DVec3::new(degrees.to_radians().sin(), 0.0, degrees.to_radians().cos());
    let places = [
        (sky, 1536, 768, DVec3::NEG_Z, "seam"),
        (sky, 1536, 768, DVec3::Y, "nadir"),
        (fish, 1000, 300, beside(94.0), "94° off a fisheye's axis"),
        (sky, 1536, 768, DVec3::Z, "middle"),
        (fish, 900, 300, beside(80.0), "80° off a fisheye's axis"),
    ];
    for (lens, width, height, at, name) in places.into_iter().take(fast_or_full(3, 5)) {
        let [width, height] = [width, height].map(|side| (2.0 * (f64::from(side) / smaller / 2.0).floor()) as u32);
        let detail = Detail { texture_m: 0.05, light_m: 0.4 };
        let simulation = Simulation::with_detail(&options(lens, width, height), detail, 2).unwrap();
        // Turned so that the board is in the requested direction.
        let aim = simulation.track().poses()[0].1.transform_point(board().point_at_texel(DVec2::splat(32.0)));
        let simulation = simulation.turned(DQuat::from_rotation_arc(aim.normalize(), at));
        let snapshot = Snapshot { samples, ..simulation.snapshot(0) };
        let real = simulation.shoot(&snapshot);
        let geometry = simulation.geometry();
        let encode = |light: [f32; 3]| {
            let code =
                |v: f32| (255.0 * simulation.sensor.response.encode(f64::from(v))).round().clamp(0.0, 255.0) as u8;
            light.map(code)
        };
        let pixels = Pixels::from_u8(width, height, real.light.iter().flat_map(|l| encode(*l)).collect()).unwrap();
        let camera = gpu::camera(geometry, 0.0);
        let mut frame = gpu::frame(0, snapshot.timestamp_s, pixels.clone());
        // The frame is grey where the board is: only composited pixels are compared.
        frame.pixels = grey(geometry).into();
        let done = gpu::composite(&gpu::gpu(), &camera, plain(), scene.clone(), simulation.track(), frame);
        let layer = done.layer.unwrap();
        let centre = simulation
            .track()
            .at(snapshot.timestamp_s)
            .unwrap()
            .transform_point(board().point_at_texel(DVec2::splat(32.0)));
        let towards = centre.normalize();
        let green = |pixels: &Pixels| pinhole_view(geometry, towards, |x, y| f64::from(pixels.at(x, y)[1]));
        let covered = pinhole_view(geometry, towards, |x, y| f64::from(layer.rgba[(y * width + x) as usize][3]));
        let mask: Vec<bool> = covered.values.iter().map(|a| *a > 0.999).collect();
        let (a, b) = (green(&pixels), green(&done.pixels));
        let options = DisplacementOptions { patch_px: 64, step_px: 16, min_mask_share: 0.8, ..Default::default() };
        let measured = displacements(&a, &b, Some(&mask), &options).unwrap();
        // In px of the picture itself, not of the resampled view.
        let scale = geometry.intrinsics.fx_px / (192.0 / 0.34);
        let median = measured.median_length_px().unwrap() * scale;
        let off: Vec<f64> = mask
            .iter()
            .zip(a.values.iter().zip(&b.values))
            .filter(|(m, _)| **m)
            .map(|(_, (a, b))| (a - b).abs())
            .collect();
        let mean = off.iter().sum::<f64>() / off.len() as f64;
        println!(
            "{name} ({:.1}°): {median:.3} px in {} patches; {mean:.2} codes over {} places",
            towards.angle_between(DVec3::Z).to_degrees(),
            measured.patches.len(),
            off.len()
        );
        assert!(measured.patches.len() >= 2 && median <= 0.3 && mean < 8.0, "{name}: {median} {mean}");
    }
}

fn recording(folder: &Path, (width, height): (u32, u32), toml: &str) {
    std::fs::create_dir_all(folder.join("rgb")).unwrap();
    image::RgbImage::from_pixel(width, height, image::Rgb([90; 3])).save(folder.join("rgb/0.png")).unwrap();
    std::fs::write(folder.join("poses.txt"), "0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n").unwrap();
    let text =
        "version = 1\n[frames]\nimages = \"rgb\"\nfps = 30.0\n[poses]\ntrajectory = \"poses.txt\"\nmax_gap_s = 2.0\n";
    std::fs::write(folder.join("recording.toml"), format!("{text}{toml}")).unwrap();
}

#[test]
fn equirectangular_and_fisheye_recordings_open_and_invalid_ones_are_refused() {
    let temp = tempfile::tempdir().unwrap();
    let folder = |name: &str| temp.path().join(name);
    let kind = "[camera]\nkind = \"equirectangular\"\n";
    recording(&folder("good"), (128, 64), kind);
    recording(&folder("bad"), (128, 72), kind);
    let scene = folder("scene.toml");
    std::fs::write(
        &scene,
        format!(
            "version = 1\nup = \"y\"\n[[objects]]\nmodel = {:?}\nposition_m = [0, 0, -0.4]\n",
            Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/marker-1.glb")
        ),
    )
    .unwrap();
    let (scene, out) = (scene.to_str().unwrap().to_owned(), folder("out"));
    let run = |name: &str, more: &[&str]| {
        let from = folder(name);
        let all = ["composite", from.to_str().unwrap(), "--scene", &scene, "-o", out.to_str().unwrap(), "--force"];
        program::success_and_stderr(&[&all[..], more].concat())
    };
    let (done, text) = run("good", &[]);
    assert!(done, "{text}");
    let picture = image::open(out.join("frame_000000.png")).unwrap().to_rgb8();
    assert!(picture.pixels().filter(|p| p.0 != [90; 3]).count() > 50, "the marker is seen");
    let (done, text) = run("bad", &[]);
    assert!(!done && text.contains("twice as wide as high") && text.contains("128x72"), "{text}");

    let other =
        "version = 1\n[camera]\nwidth_px = 128\nheight_px = 64\nfx_px = 90\nfy_px = 90\ncx_px = 64\ncy_px = 32\n";
    std::fs::write(folder("profile.toml"), other).unwrap();
    std::fs::write(folder("rows.toml"), "version = 1\n[camera]\nwidth_px = 128\nheight_px = 64\nreadout_time_s = 0.01\n[camera.distortion]\nmodel = \"equirectangular\"\n").unwrap();
    let (profile, rows) = (folder("profile.toml"), folder("rows.toml"));
    for (more, message) in [
        (
            &[
                "--set",
                "motion_blur.method=copies",
                "--set",
                "motion_blur.threshold_px=0",
                "--set",
                "camera.exposure.time_s=0.01",
            ][..],
            "motion_blur.method is refused",
        ),
        (&["--set", "vignetting.natural=1"], "vignetting is refused: a 360° picture"),
        (&["--set", "chromatic_aberration.red=0.01"], "chromatic_aberration is refused: a 360° picture"),
        (
            &["--set", "camera.lens.aperture_diameter_mm=20", "--set", "camera.lens.focus_distance_m=9"],
            "depth_of_field is refused",
        ),
        (&["--profile", profile.to_str().unwrap()], "omit that table"),
        (&["--profile", rows.to_str().unwrap()], "readout_time_s"),
    ] {
        let (done, text) = run("good", more);
        assert!(message.is_empty() == done && text.contains(message), "{more:?}: {text}");
    }

    // nerfstudio's own conventions: OpenGL axes, meaningless focal lengths.
    for ((width, height), message) in [((128, 64), ""), ((128, 100), "twice as wide as high")] {
        let folder = folder(&format!("nerf{height}"));
        recording(&folder, (width, height), "");
        std::fs::remove_file(folder.join("recording.toml")).unwrap();
        let frame = "{\"file_path\": \"rgb/0.png\", \"transform_matrix\": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}";
        let text = format!(
            "{{\"camera_model\": \"EQUIRECTANGULAR\", \"w\": {width}, \"h\": {height}, \"fl_x\": 64, \"frames\": [{frame}]}}"
        );
        std::fs::write(folder.join("transforms.json"), text).unwrap();
        let (done, text) = run(&format!("nerf{height}"), &[]);
        assert!(message.is_empty() == done && text.contains(message), "{text}");
    }
}
