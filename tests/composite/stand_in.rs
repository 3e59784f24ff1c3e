//! Stand-ins for real objects: not drawn, they occlude objects behind them, with a sensor's depth
//! and without.

use std::sync::Arc;

use crate::gpu;
use glam::{DAffine3, Vec3};
use locard::compositor::Settings;
use locard::pixels::{DepthMap, Pixels};
use locard::pose::Pose;
use locard::scene::{Environment, Lighting, Material, Mesh, Object, Part, Scene, Vertex};
use locard::tracking::PoseTrack;

const WIDTH: u32 = 160;
const HEIGHT: u32 = 120;
const FOCAL_PX: f64 = 150.0;
const CODE: u8 = 90;
/// Tolerance around the outline, px: real edges may be moved onto the picture's and are soft over a
/// pixel or two.
const OUTLINE_TOLERANCE_PX: f32 = 4.0;

/// A rectangle that faces the camera.
fn board(low: [f32; 2], high: [f32; 2], z: f32) -> Arc<Mesh> {
    let corner = |x: f32, y: f32| Vertex {
        position: [x, y, z],
        normal: [0.0, 0.0, -1.0],
        tangent: [0.0; 4],
        uv0: [0.0; 2],
        uv1: [0.0; 2],
        color: [1.0; 4],
    };
    let vertices =
        vec![corner(low[0], low[1]), corner(low[0], high[1]), corner(high[0], high[1]), corner(high[0], low[1])];
    Arc::new(Mesh { vertices, indices: vec![0, 1, 2, 0, 2, 3], material: 0 })
}

/// Composites evidence 2 m away that fills the picture, and a stand-in at another distance that
/// covers a part of it.
fn composited(stand_in_m: Option<f32>, sensor_m: Option<f32>) -> Pixels {
    let part = |mesh| Part { mesh, world_from_mesh: DAffine3::IDENTITY };
    let low_high = |z: f32| ([-0.25 * z, -0.15 * z], [0.1 * z, 0.2 * z]);
    let evidence = Object { parts: vec![part(0)], ..Object::default() };
    let (low, high) = low_high(stand_in_m.unwrap_or(1.0));
    let real = Object { occluder_parts: vec![part(1)], occluder: true, ..Object::default() };
    let scene = Scene {
        meshes: vec![board([-3.0; 2], [3.0; 2], 2.0), board(low, high, stand_in_m.unwrap_or(1.0))],
        materials: vec![Material { base_color: [0.8, 0.8, 0.8, 1.0], double_sided: true, ..Material::default() }],
        objects: if stand_in_m.is_some() { vec![evidence, real] } else { vec![evidence] },
        lighting: Lighting { environment: Environment::Uniform(Vec3::ONE), ..Lighting::default() },
        ..Scene::default()
    };
    let geometry = gpu::pinhole(WIDTH, HEIGHT, FOCAL_PX);
    let camera = gpu::camera(&geometry, 0.0);
    let track = PoseTrack::new(vec![(-1.0, Pose::IDENTITY), (1.0, Pose::IDENTITY)], 3.0).unwrap();
    let mut frame = gpu::frame(0, 0.0, gpu::grey(WIDTH, HEIGHT, CODE));
    frame.depth = sensor_m.map(|z| {
        let depth_m = vec![z; (WIDTH * HEIGHT) as usize];
        Arc::new(DepthMap { width: WIDTH, height: HEIGHT, depth_m, timestamp_s: 0.0 })
    });
    gpu::composite(&gpu::gpu(), &camera, Settings::default(), scene, &track, frame).pixels
}

/// Distance of a pixel from the stand-in's outline, px; negative outside.
fn inside_px(x: u32, y: u32) -> f32 {
    let f = FOCAL_PX as f32;
    let [x, y] = [(x, WIDTH), (y, HEIGHT)].map(|(at, side)| at as f32 + 0.5 - 0.5 * side as f32);
    (x + 0.25 * f).min(0.1 * f - x).min(y + 0.15 * f).min(0.2 * f - y)
}

#[test]
fn stand_in_occludes_only_objects_behind_it() {
    let whole = composited(None, None);
    assert!((0..WIDTH).all(|x| whole.at(x, 60) != [u32::from(CODE); 3]), "the evidence fills the picture");
    // Without a sensor, and with one that measures a wall behind everything.
    for sensor_m in [None, Some(3.0)] {
        let picture = composited(Some(1.2), sensor_m);
        let (mut hidden, mut shown) = (0, 0);
        for (x, y) in (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (x, y))) {
            let inside = inside_px(x, y);
            if inside > OUTLINE_TOLERANCE_PX {
                hidden += 1;
                assert_eq!(picture.at(x, y), [u32::from(CODE); 3], "{x} {y}, sensor {sensor_m:?}");
            } else if inside < -OUTLINE_TOLERANCE_PX {
                shown += 1;
                assert_eq!(picture.at(x, y), whole.at(x, y), "{x} {y}, sensor {sensor_m:?}");
            }
        }
        assert!(hidden > 1500 && shown > 10000, "{hidden} hidden, {shown} shown");
    }
}

#[test]
fn stand_in_behind_evidence_occludes_nothing() {
    assert_eq!(composited(Some(2.6), None), composited(None, None));
}
