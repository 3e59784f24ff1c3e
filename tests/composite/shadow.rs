//! Shadows on real receiver surfaces, compared with the planar shadow pixel by pixel, and their
//! typical artefacts.

use std::sync::Arc;

use crate::gpu;
use crate::srgb::{decode, encode};
use glam::{DAffine3, DQuat, DVec2, DVec3, Vec3};
use locard::camera::{Camera, Distortion, Geometry, NoiseBin, NoiseProfile};
use locard::compositor::{Composited, Compositor, Job, Settings, Target};
use locard::frame::Frame;
use locard::params::Value;
use locard::pixels::{DepthMap, LayerImage, Pixels};
use locard::plane::Plane;
use locard::pose::Pose;
use locard::scene::{Environment, Lighting, Material, Mesh, Object, Part, Scene, Sun, Vertex};
use locard::shadow::Shadows;
use locard::tracking::PoseTrack;

const WIDTH: u32 = 320;
const HEIGHT: u32 = 240;
const GREY: u8 = 180;
/// Half sides of the box, m.
const HALF: DVec3 = DVec3::new(0.04, 0.03, 0.05);

fn lighting() -> Lighting {
    let sun = Sun {
        towards_light_in_world: Vec3::new(0.5, 0.3, 0.8).normalize(),
        color: Vec3::new(0.9, 0.8, 0.6),
        diameter_rad: 0.1,
    };
    Lighting { suns: vec![sun], points: Vec::new(), environment: Environment::Uniform(Vec3::new(0.3, 0.35, 0.5)) }
}

/// A box with these half sides, m, on the plane z = 0.
pub fn box_scene(half_m: DVec3, lighting: Lighting) -> Scene {
    let corner = |i: usize| {
        let sign = |bit: usize| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
        let position = (half_m * DVec3::new(sign(0), sign(1), sign(2))).as_vec3().to_array();
        Vertex { position, normal: [0.0, 0.0, 1.0], tangent: [0.0; 4], uv0: [0.0; 2], uv1: [0.0; 2], color: [1.0; 4] }
    };
    let sides = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
    let indices = sides.iter().flat_map(|[a, b, c, d]| [*a, *b, *c, *a, *c, *d]).collect();
    let on = DAffine3::from_translation(half_m.z * DVec3::Z);
    let object = Object {
        name: "box".to_owned(),
        parts: vec![Part { mesh: 0, world_from_mesh: on }],
        support: Some(Plane { point_m: DVec3::ZERO, normal: DVec3::Z }),
        ..Object::default()
    };
    Scene {
        meshes: vec![Arc::new(Mesh { vertices: (0..8).map(corner).collect(), indices, material: 0 })],
        materials: vec![Material { double_sided: true, ..Material::default() }],
        objects: vec![object],
        lighting,
        ..Scene::default()
    }
}

fn scene() -> Scene {
    box_scene(HALF, lighting())
}

fn geometry() -> Geometry {
    let pinhole = gpu::pinhole(WIDTH, HEIGHT, 330.0);
    Geometry::new(pinhole.intrinsics, Distortion { k1: -0.12, k2: 0.03, p1: 1e-3, ..Distortion::default() })
}

/// From half a metre away, looking down at the box.
fn pose() -> Pose {
    let eye = DVec3::new(0.1, -0.45, 0.4);
    let forward = -eye.normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let turn = DQuat::from_mat3(&glam::DMat3::from_cols(right, forward.cross(right), forward));
    Pose::from_camera_in_world(eye, turn)
}

fn track() -> PoseTrack {
    PoseTrack::new(vec![(-1.0, pose()), (1.0, pose())], 3.0).unwrap()
}

fn camera() -> Camera {
    gpu::camera(&geometry(), 0.0)
}

fn composite_frame(settings: Settings, camera: &Camera, frame: Frame, scene: Scene) -> Composited {
    gpu::composite(&gpu::gpu(), camera, settings, scene, &track(), frame)
}

fn grey_frame() -> Frame {
    gpu::frame(0, 0.0, gpu::grey(WIDTH, HEIGHT, GREY))
}

/// Floor positions of a pixel's four samples.
fn floor_samples(x: u32, y: u32) -> impl Iterator<Item = Option<DVec3>> {
    let middle = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
    [(-0.375, -0.125), (0.125, -0.375), (0.375, 0.125), (-0.125, 0.375)].into_iter().map(move |(dx, dy)| {
        let ray = geometry().unproject(middle + DVec2::new(dx, dy))?;
        let (eye, along) = (pose().position_in_world_m(), pose().world_from_camera_rotation() * ray);
        Some(eye - along * (eye.z / along.z)).filter(|_| along.z < 0.0)
    })
}

/// The applied share of a shadow: all of it from 1/64 of the light on, none up to 1/256.
fn applied_share(taken: Vec3) -> Vec3 {
    let t = ((taken.abs().max_element() - 1.0 / 256.0) / (1.0 / 64.0 - 1.0 / 256.0)).clamp(0.0, 1.0);
    taken * (t * t * (3.0 - 2.0 * t))
}

#[test]
fn shadowed_pixels_match_the_planar_shadow_and_others_are_unchanged() {
    let done = composite_frame(Settings::default(), &camera(), grey_frame(), scene());
    let planar_shadow = &Shadows::new(&scene()).planar_shadows(&scene(), locard::quality::Quality::Final).0[0];
    let layer = done.layer.as_ref().unwrap();
    let (mut worst, mut shaded, mut free, mut darkest) = (0.0f64, 0, 0, 255.0f64);
    for (i, out) in done.pixels.codes.eight_bit().unwrap().chunks_exact(3).enumerate() {
        // The object's soft edge is the edge blend's, a pixel wide.
        let (x, y) = (i as u32 % WIDTH, i as u32 / WIDTH);
        let touched = |dx: i32, dy: i32| {
            let (x, y) = ((x as i32 + dx).clamp(0, 319), (y as i32 + dy).clamp(0, 239));
            layer.rgba[(y * 320 + x) as usize][3] > 0.0
        };
        if (-2..=2).any(|dy| (-2..=2).any(|dx| touched(dx, dy))) {
            continue;
        }
        let places: Vec<Vec3> = floor_samples(x, y)
            .map(|place| place.map_or(Vec3::ZERO, |place| planar_shadow.removed_at(place)))
            .collect();
        let taken = applied_share(places.iter().sum::<Vec3>() / 4.0);
        if layer.left[i] == [1.0; 3] {
            free += 1;
            assert_eq!(out, [GREY; 3], "{x} {y}");
            assert!(taken.max_element() < 1e-3, "{x} {y}: {taken}");
            continue;
        }
        shaded += 1;
        for c in 0..3 {
            let code = |taken: f32| 255.0 * encode(decode(f64::from(GREY) / 255.0) * (1.0 - f64::from(taken)));
            let off = (code(taken[c]) - f64::from(out[c])).abs();
            // The four samples are three quarters of a pixel apart. Rays between the nodes of their
            // grid, and a texture's weights, are exact to a thirtieth of a pixel.
            let of_place =
                |which: fn(f32, f32) -> f32| places.iter().map(|taken| applied_share(*taken)[c]).reduce(which).unwrap();
            let per_px = (code(of_place(f32::min)) - code(of_place(f32::max))) / 0.75;
            worst = worst.max(off - per_px / 30.0);
            darkest = darkest.min(f64::from(out[c]));
        }
    }
    assert!(shaded > 4000 && free > 8000, "{shaded} {free}");
    assert!(darkest < 120.0, "the sun's shadow is there: {darkest}");
    // Half a code of rounding, and ratios are 16-bit floats.
    assert!(worst <= 0.6, "{worst} codes");
}

#[test]
fn floor_point_keeps_its_shadow_ratio_while_the_camera_moves() {
    // Subpixel translations and a slight rotation from frame to frame.
    let pose = |n: i32| {
        let by = DVec3::new(0.0013, 0.0007, 0.0004) * f64::from(n);
        Pose::from_camera_in_world(
            pose().position_in_world_m() + by,
            pose().world_from_camera_rotation() * DQuat::from_rotation_z(0.002 * f64::from(n)),
        )
    };
    let frames = (0..10).map(|n| {
        let track = PoseTrack::new(vec![(-1.0, pose(n)), (1.0, pose(n))], 3.0).unwrap();
        let done = gpu::composite(&gpu::gpu(), &camera(), Settings::default(), scene(), &track, grey_frame());
        (pose(n), done.layer.unwrap())
    });
    let frames: Vec<_> = frames.collect();
    // The code at a point between the centres of four pixels, if none of them is covered.
    let code = |point: DVec3, (pose, layer): &(Pose, LayerImage)| {
        let at = geometry().project(pose.transform_point(point))? - 0.5;
        let (first, share) = (at.floor(), at - at.floor());
        let mut left = 0.0;
        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let (x, y) = (first.x as i64 + dx, first.y as i64 + dy);
            let inside = (0..i64::from(WIDTH)).contains(&x) && (0..i64::from(HEIGHT)).contains(&y);
            let i = inside.then(|| (y * i64::from(WIDTH) + x) as usize).filter(|i| layer.rgba[*i] == [0.0; 4])?;
            let of = |n: i64, share: f64| if n == 1 { share } else { 1.0 - share };
            left += of(dx, share.x) * of(dy, share.y) * f64::from(layer.left[i][1]);
        }
        Some(255.0 * encode(decode(f64::from(GREY) / 255.0) * left))
    };
    let places =
        (-30..=30).flat_map(|x| (-30..=30).map(move |y| DVec3::new(0.005 * f64::from(x), 0.005 * f64::from(y), 0.0)));
    let mut ranges: Vec<f64> = places
        .filter_map(|point| {
            let codes: Vec<f64> = frames.iter().map(|frame| code(point, frame)).collect::<Option<_>>()?;
            let (low, high) = codes.iter().fold((f64::INFINITY, 0.0f64), |(l, h), c| (l.min(*c), h.max(*c)));
            (low < f64::from(GREY) - 1.0).then_some(high - low)
        })
        .collect();
    ranges.sort_by(f64::total_cmp);
    let median = ranges[ranges.len() / 2];
    let within = ranges.iter().filter(|range| **range <= 0.3).count() as f64 / ranges.len() as f64;
    println!("{} places: {median:.3} codes in the median, within 0.3 at {within:.3} of them", ranges.len());
    // Near the box's foot and at the edge of the sun's shadow the ratio is not linear within a
    // pixel, so interpolated pixel means deviate.
    assert!(ranges.len() > 500 && median < 0.02 && within > 0.8, "{} places, {median}, {within}", ranges.len());
}

#[test]
fn shadow_that_is_off_or_without_strength_changes_nothing() {
    let off = gpu::settings(&[("shadow", "cast", Value::Bool(false))]);
    let off = composite_frame(off, &camera(), grey_frame(), scene());
    let none =
        composite_frame(gpu::settings(&[("shadow", "strength", Value::Number(0.0))]), &camera(), grey_frame(), scene());
    assert!(off.pixels == none.pixels && off.layer.as_ref().unwrap().left.iter().all(|left| *left == [1.0; 3]));
    let on = composite_frame(Settings::default(), &camera(), grey_frame(), scene());
    assert!(on.pixels != off.pixels);
    let half =
        composite_frame(gpu::settings(&[("shadow", "strength", Value::Number(0.5))]), &camera(), grey_frame(), scene());
    for (whole, half) in on.layer.unwrap().left.iter().zip(&half.layer.unwrap().left) {
        assert!((0..3).all(|c| (1.0 - half[c] - 0.5 * (1.0 - whole[c])).abs() < 2e-3), "{whole:?} {half:?}");
    }
}

#[test]
fn surfaces_off_the_receiver_plane_are_not_shadowed() {
    // Depth is that of the floor on the left, 6 cm in front of it on the right, and of a lower
    // floor at the top.
    let rays: Vec<_> = (0..WIDTH * HEIGHT)
        .map(|i| geometry().unproject(DVec2::new(f64::from(i % WIDTH) + 0.5, f64::from(i / WIDTH) + 0.5)).unwrap())
        .collect();
    let depth_m = |i: usize, height: f64| {
        let along = pose().world_from_camera_rotation() * rays[i];
        ((height - pose().position_in_world_m().z) / along.z) as f32
    };
    let with = |height: f64| {
        let depth_m = (0..rays.len()).map(|i| depth_m(i, height)).collect();
        let depth = Some(DepthMap { width: WIDTH, height: HEIGHT, depth_m, timestamp_s: 0.0 });
        let done = composite_frame(
            Settings::default(),
            &camera(),
            Frame { depth: depth.map(Arc::new), ..grey_frame() },
            scene(),
        );
        done.layer.unwrap().left
    };
    let without = composite_frame(Settings::default(), &camera(), grey_frame(), scene()).layer.unwrap();
    let shaded = |left: &[[f32; 3]]| left.iter().filter(|left| left[1] < 0.9).count();
    let on_floor = with(0.0);
    let far = |a: &[f32; 3], b: &[f32; 3]| (0..3).map(|c| (a[c] - b[c]).abs()).fold(0.0, f32::max);
    let worst = on_floor.iter().zip(&without.left).map(|(a, b)| far(a, b)).fold(0.0, f32::max);
    assert!(worst < 2e-3, "depth of the floor changes nothing: {worst}");
    // A sensor error of a centimetre is tolerated.
    assert!(shaded(&with(0.01)) > shaded(&without.left) * 99 / 100);
    for height in [0.06, -0.06] {
        assert_eq!(shaded(&with(height)), 0, "{height} m over the floor");
    }
}

#[test]
fn earlier_frames_do_not_affect_a_picture() {
    let frame = |height: f64| {
        let depth_m = (0..WIDTH * HEIGHT).map(|i| {
            let ray = geometry().unproject(DVec2::new(f64::from(i % WIDTH) + 0.5, f64::from(i / WIDTH) + 0.5)).unwrap();
            let along = pose().world_from_camera_rotation() * ray;
            ((height - pose().position_in_world_m().z) / along.z) as f32
        });
        let depth = DepthMap { width: WIDTH, height: HEIGHT, depth_m: depth_m.collect(), timestamp_s: 0.0 };
        Frame { depth: Some(depth.into()), ..grey_frame() }
    };
    // The shadow extends beyond the picture's right edge.
    let at = |x: f64| {
        let mut scene = scene();
        scene.lighting.suns[0].towards_light_in_world = Vec3::new(-0.8, 0.0, 0.4).normalize();
        scene.objects[0].move_by(DAffine3::from_translation(DVec3::new(x, 0.0, 0.0)));
        scene
    };
    let (camera, settings, geometry, track) = (camera(), Settings::default(), geometry(), track());
    let mut compositor = Compositor::new(gpu::gpu().clone(), at(0.2));
    let drawn = |compositor: &mut Compositor, frame: Frame| {
        let job = Job::of_frame(frame, &camera, &settings, &geometry, &track, 1.0 / 30.0).unwrap();
        let pending = compositor.submit(job, &camera, &settings, Target::Pixels).unwrap();
        compositor.collect(pending).unwrap()
    };
    // Over a surface in front of the floor, in a slightly larger rectangle: textures are reused.
    for step in 0..4 {
        compositor.set_scene(at(0.2 + 0.003 * f64::from(step)));
        drawn(&mut compositor, frame(0.06));
    }
    compositor.set_scene(at(0.215));
    let again = drawn(&mut compositor, frame(0.0));
    let fresh = drawn(&mut Compositor::new(gpu::gpu().clone(), at(0.215)), frame(0.0));
    let codes = fresh.pixels.codes.eight_bit().unwrap();
    let rim = (0..HEIGHT as usize).filter(|y| codes[3 * (y + 1) * WIDTH as usize - 1] < GREY - 10).count();
    assert!(rim > 10, "the shadow reaches the rim: {rim}");
    assert!(again.pixels == fresh.pixels);
}

#[test]
fn moved_light_redraws_the_shadows_of_unchanged_objects() {
    let geometry = gpu::pinhole(160, 120, 165.0);
    let (camera, track) = (gpu::camera(&geometry, 0.0), track());
    // Only the shadow on the floor: the objects' lightmaps depend on the same condition and cost
    // more.
    let settings = gpu::settings(&[("shadow", "on_evidence", Value::Bool(false))]);
    let drawn = |compositor: &mut Compositor| {
        let frame = gpu::frame(0, 0.0, gpu::grey(160, 120, GREY));
        let job = Job::of_frame(frame, &camera, &settings, &geometry, &track, 1.0 / 30.0).unwrap();
        let pending = compositor.submit(job, &camera, &settings, Target::Pixels).unwrap();
        compositor.collect(pending).unwrap().pixels
    };
    let before = scene();
    let mut after = before.clone();
    after.lighting.suns[0].towards_light_in_world.x *= -1.0;
    let gpu = gpu::gpu();
    let mut compositor = Compositor::new(gpu.clone(), before);
    let unmoved = drawn(&mut compositor);
    compositor.set_scene(after.clone());
    let moved = drawn(&mut compositor);
    // A point 3 cm beside the box is in its shadow while the sun is on the other side.
    let code_beside = |pixels: &Pixels, x: f64| {
        let at = geometry.project(pose().transform_point(DVec3::new(x, 0.0, 0.0))).unwrap();
        pixels.at(at.x as u32, at.y as u32)[1]
    };
    let (left, right) = (-HALF.x - 0.03, HALF.x + 0.03);
    assert!(code_beside(&unmoved, left) + 20 < code_beside(&unmoved, right));
    assert!(code_beside(&moved, right) + 20 < code_beside(&moved, left));
    assert!(moved == drawn(&mut Compositor::new(gpu.clone(), after)));
}

#[test]
fn shadow_fades_with_its_object() {
    let half = composite_frame(Settings::default(), &camera(), Frame { opacity: 0.5, ..grey_frame() }, scene());
    let whole = composite_frame(Settings::default(), &camera(), grey_frame(), scene());
    for (whole, half) in whole.layer.unwrap().left.iter().zip(&half.layer.unwrap().left) {
        assert!((0..3).all(|c| (1.0 - half[c] - 0.5 * (1.0 - whole[c])).abs() < 2e-3), "{whole:?} {half:?}");
    }
    let gone = composite_frame(Settings::default(), &camera(), Frame { opacity: 0.0, ..grey_frame() }, scene());
    assert_eq!(gone.pixels, *grey_frame().pixels);
}

#[test]
fn shadow_of_an_object_outside_the_picture_is_drawn() {
    let mut beside = scene();
    beside.lighting.suns[0] =
        Sun { towards_light_in_world: Vec3::new(0.95, 0.0, 0.3).normalize(), ..beside.lighting.suns[0] };
    // The picture covers x up to about 0.34 m; a box at 0.4 m casts its shadow to the left.
    beside.objects[0].move_by(DAffine3::from_translation(DVec3::new(0.42, 0.0, 0.0)));
    let done = composite_frame(Settings::default(), &camera(), grey_frame(), beside);
    let layer = done.layer.unwrap();
    assert!(layer.rgba.iter().all(|p| p[3] == 0.0), "the box is seen");
    assert!(layer.left.iter().filter(|left| left[0] < 0.6).count() > 100);
}

/// White noise filtered by (a, 1, a) along rows and columns; the correlation of neighbours is ρ =
/// 2a/(1 + 2a²).
fn noise_like(rho: f64) -> Vec<f64> {
    let mut state = 0x1234_5678_9abc_def0_u64;
    let mut uniform = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let mut gauss = || (-2.0 * uniform().max(1e-12).ln()).sqrt() * (std::f64::consts::TAU * uniform()).cos();
    let (width, height) = (WIDTH as usize, HEIGHT as usize);
    let white: Vec<f64> = (0..(width + 2) * (height + 2)).map(|_| gauss()).collect();
    let side = if rho > 0.0 { (1.0 - (1.0 - 2.0 * rho * rho).sqrt()) / (2.0 * rho) } else { 0.0 };
    let taps = [side, 1.0, side].map(|tap| tap / (1.0 + 2.0 * side * side).sqrt());
    let at = |x: usize, y: usize| {
        let row = |dy: usize| (0..3).map(|dx| taps[dx] * white[(y + dy) * (width + 2) + x + dx]).sum::<f64>();
        (0..3).map(|dy| taps[dy] * row(dy)).sum()
    };
    (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| at(x, y)).collect()
}

#[test]
fn noise_in_a_shadow_matches_the_camera_noise_at_that_brightness() {
    // σ² = 1 + 0.05 · code (8-bit codes); a frame with that noise, white or correlated.
    let sigma = |code: f64| (1.0 + 0.05 * code).sqrt();
    let bin = |n: u32| NoiseBin { code: f64::from(5 * n), sigma: sigma(f64::from(5 * n)) };
    let bins: Vec<NoiseBin> = (0..52).map(bin).collect();
    for rho in [0.0, 0.4] {
        let noise = NoiseProfile {
            example: None,
            bins: [bins.clone(), bins.clone(), bins.clone()],
            channel_correlation: [0.0; 3],
            neighbour_correlation: [rho; 2],
        };
        let mut camera = camera();
        camera.noise = Some(noise);
        let grain = noise_like(rho);
        let code = |i: usize| (f64::from(GREY) + sigma(f64::from(GREY)) * grain[i]).round() as u8;
        let codes =
            (0..grain.len()).flat_map(|i| [code(i), code((i + 977) % grain.len()), code((i + 4999) % grain.len())]);
        let pixels = Pixels::from_u8(WIDTH, HEIGHT, codes.collect()).unwrap();
        let done = composite_frame(Settings::default(), &camera, gpu::frame(0, 0.0, pixels), scene());
        let layer = done.layer.unwrap();
        let codes = done.pixels.codes.eight_bit().unwrap();
        // Residuals from the shadowed grey, in its dark part, in units of the camera's σ.
        let residual = |i: usize, c: usize| {
            let left = layer.left[i];
            let mean = 255.0 * encode(decode(f64::from(GREY) / 255.0) * f64::from(left[c]));
            let is_dark = left[0] < 0.6 && layer.rgba[i] == [0.0; 4];
            is_dark.then(|| (f64::from(codes[3 * i + c]) - mean) / sigma(mean))
        };
        let (mut square, mut count, mut pairs, mut both) = (0.0, 0, 0.0, 0);
        for (i, c) in (0..layer.left.len() - 1).flat_map(|i| (0..3).map(move |c| (i, c))) {
            let Some(own) = residual(i, c) else { continue };
            (square, count) = (square + own * own, count + 1);
            if let Some(next) = residual(i + 1, c).filter(|_| (i + 1) % WIDTH as usize > 0) {
                (pairs, both) = (pairs + own * next, both + 1);
            }
        }
        let ratio = (square / f64::from(count)).sqrt();
        assert!(count > 2000 && (ratio - 1.0).abs() < 0.05, "{ratio} of the camera's σ over {count} values");
        let alike = pairs / f64::from(both) / (ratio * ratio);
        println!("{rho}: {ratio} of the camera's σ, neighbours {alike} alike");
        assert!((alike - rho).abs() < 0.05, "neighbours are {alike} alike, not {rho}");
    }
}
