//! Indirect light between objects: the renderer compared with analytic geometry.

use std::sync::Arc;

use crate::gpu;
use glam::{DAffine3, DMat3, DQuat, DVec2, DVec3, Vec3};
use locard::compositor::{Settings, ShadowSettings};
use locard::pose::Pose;
use locard::scene::{Environment, Lighting, Material, Mesh, Object, Part, PointLight, Scene, Vertex};
use locard::tracking::PoseTrack;

const WIDTH: u32 = 160;
const HEIGHT: u32 = 120;
const WALL_M: f32 = 0.3;
const REFLECTANCE: f32 = 0.3;

/// A rectangle by its corners, counter-clockwise seen from its front.
fn rectangle(corners: [Vec3; 4]) -> Arc<Mesh> {
    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize().to_array();
    let vertex = |p: Vec3| Vertex {
        position: p.to_array(),
        normal,
        tangent: [0.0; 4],
        uv0: [0.0; 2],
        uv1: [0.0; 2],
        color: [1.0; 4],
    };
    Arc::new(Mesh { vertices: corners.map(vertex).to_vec(), indices: vec![0, 1, 2, 0, 2, 3], material: 0 })
}

/// A plate of 0.2 m at z = 0 and, at x = 0.1, a wall of 20 m that faces it.
fn scene(lighting: Lighting) -> Scene {
    let plate = |x: f32, y: f32| Vec3::new(0.1 * x, 0.1 * y, 0.0);
    let wall = |y: f32, z: f32| Vec3::new(0.1, 10.0 * y, WALL_M * z);
    let meshes = vec![
        rectangle([plate(-1.0, -1.0), plate(1.0, -1.0), plate(1.0, 1.0), plate(-1.0, 1.0)]),
        rectangle([wall(-1.0, 0.0), wall(-1.0, 1.0), wall(1.0, 1.0), wall(1.0, 0.0)]),
    ];
    let part = |mesh: usize| Part { mesh, world_from_mesh: DAffine3::IDENTITY };
    let object = |mesh: usize| Object { parts: vec![part(mesh)], ..Object::default() };
    let matt =
        Material { base_color: [REFLECTANCE, REFLECTANCE, REFLECTANCE, 1.0], metallic: 0.0, ..Material::default() };
    Scene { meshes, materials: vec![matt], objects: vec![object(0), object(1)], lighting, ..Scene::default() }
}

fn pose() -> Pose {
    // Points down onto the plate from the side that is not behind the wall.
    let eye = DVec3::new(-0.25, 0.0, 0.4);
    let forward = -eye.normalize();
    let right = forward.cross(DVec3::Z).normalize();
    Pose::from_camera_in_world(eye, DQuat::from_mat3(&DMat3::from_cols(right, forward.cross(right), forward)))
}

/// The plate's x in each fully covered pixel, and the pixel's light.
fn plate(lighting: Lighting, shadow: ShadowSettings) -> Vec<(f64, [f32; 3])> {
    let geometry = gpu::pinhole(WIDTH, HEIGHT, 200.0);
    let camera = gpu::camera(&geometry, 0.0);
    let mut settings = Settings::default();
    settings.shadow = shadow;
    let track = PoseTrack::new(vec![(-1.0, pose()), (1.0, pose())], 3.0).unwrap();
    let frame = gpu::frame(0, 0.0, gpu::grey(WIDTH, HEIGHT, 128));
    let done = gpu::composite(&gpu::gpu(), &camera, settings, scene(lighting), &track, frame);
    let layer = done.layer.unwrap();
    let places = (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (x, y))).filter_map(|(x, y)| {
        let ray = geometry.unproject(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5))?;
        let (eye, along) = (pose().position_in_world_m(), pose().world_from_camera_rotation() * ray);
        let at = eye - along * (eye.z / along.z);
        let [r, g, b, a] = layer.rgba[(y * WIDTH + x) as usize];
        (along.z < 0.0 && at.x.abs().max(at.y.abs()) < 0.094).then(|| {
            assert!(a > 0.99, "{x} {y}: {a}");
            (at.x, [r, g, b])
        })
    });
    places.collect()
}

fn shade_settings(on_evidence: bool, strength: f32) -> ShadowSettings {
    ShadowSettings { cast: true, on_evidence, strength }
}

#[test]
fn plate_beside_a_wall_has_the_analytic_sky_visibility_and_indirect_light() {
    let sky = || Lighting { environment: Environment::Uniform(Vec3::new(0.3, 0.5, 0.7)), ..Lighting::default() };
    let [without, with, half] =
        [shade_settings(false, 1.0), shade_settings(true, 1.0), shade_settings(true, 0.5)].map(|set| plate(sky(), set));
    assert!(with.len() > 1500, "{} pixels", with.len());
    let mut darkest = 1.0f32;
    for ((place, with), ((_, without), (_, half))) in with.iter().zip(without.iter().zip(&half)) {
        let distance = (0.1 - *place) as f32;
        let filled = 0.5 * (1.0 - distance / WALL_M.hypot(distance));
        // The wall receives an even sky over nearly its whole hemisphere. Its specular reflection
        // is a few per cent of its light.
        let expected = 1.0 - filled * (1.0 - REFLECTANCE);
        for c in 0..3 {
            let [actual, halved] = [with[c], half[c]].map(|light| light / without[c]);
            assert!((actual - expected).abs() < 0.04, "{place}: {actual} for {expected}");
            assert!((halved - 0.5 * (1.0 + actual)).abs() < 0.02, "{place}: {halved} for half of {actual}");
            darkest = darkest.min(actual);
        }
    }
    assert!(darkest < 0.72, "{darkest}");
}

#[test]
fn lamp_behind_a_wall_lights_nothing_in_front_of_it() {
    let lamp = |x: f64, z: f64| PointLight {
        position_in_world_m: DVec3::new(x, 0.0, z),
        color: Vec3::ONE,
        diameter_m: 0.02,
        range_m: f32::INFINITY,
        spot: None,
    };
    let dark =
        |points: Vec<PointLight>| Lighting { points, suns: Vec::new(), environment: Environment::Uniform(Vec3::ZERO) };
    // Three lamps, so that each kind of layer has a share; only the last one is visible.
    let hidden = [lamp(0.5, 0.4), lamp(0.7, 0.3), lamp(0.6, 0.5)];
    let in_front = lamp(-0.3, 1.0);
    let all: Vec<_> = hidden.iter().copied().chain([in_front]).collect();
    let [with, without, alone] = [
        plate(dark(all.clone()), shade_settings(true, 1.0)),
        plate(dark(all), shade_settings(false, 1.0)),
        plate(dark(vec![in_front]), shade_settings(true, 1.0)),
    ];
    for (((place, with), (_, without)), (_, alone)) in with.iter().zip(&without).zip(&alone) {
        assert!((with[0] - alone[0]).abs() < 0.002 * alone[0], "{place}: {} for {}", with[0], alone[0]);
        assert!(without[0] > 1.5 * with[0], "{place}: {} and {}", without[0], with[0]);
    }
}
