//! Evidence that is part of the simulated site, compared with independent calculations.

use std::sync::Arc;

use glam::{DAffine3, DVec2, DVec3};
use locard::scene::{Alpha, Material, Mesh, Object, Part, Scene, Vertex};
use locard::simulate::{Detail, Motion, Options, SimulateError, SimulatedPicture, Simulation};

const DETAIL: Detail = Detail { texture_m: 0.02, light_m: 0.05 };

/// A square card that faces up, diffuse and grey.
fn card(half_m: f32, height_m: f64, grey: f32) -> Scene {
    let vertex = |x: f32, y: f32| Vertex {
        position: [x * half_m, y * half_m, 0.0],
        normal: [0.0, 0.0, 1.0],
        tangent: [0.0; 4],
        uv0: [0.0; 2],
        uv1: [0.0; 2],
        color: [1.0; 4],
    };
    let vertices = vec![vertex(-1.0, -1.0), vertex(1.0, -1.0), vertex(1.0, 1.0), vertex(-1.0, 1.0)];
    let world_from_mesh = DAffine3::from_translation(DVec3::new(0.0, 0.0, height_m));
    Scene {
        meshes: vec![Arc::new(Mesh { vertices, indices: vec![0, 1, 2, 0, 2, 3], material: 0 })],
        materials: vec![Material { base_color: [grey, grey, grey, 1.0], metallic: 0.0, ..Material::default() }],
        objects: vec![Object { parts: vec![Part { mesh: 0, world_from_mesh }], ..Object::default() }],
        ..Scene::default()
    }
}

fn site() -> Simulation {
    let options = Options {
        width_px: 160,
        height_px: 120,
        focal_px: 130.0,
        frames: 1,
        motion: Motion::Static,
        samples: 64,
        exposure_time_s: 0.0,
        readout_time_s: 0.0,
        ..Options::default()
    };
    Simulation::with_detail(&options, DETAIL, 2).unwrap()
}

/// Mean light of 3×3 px around the projection of a world point.
fn mean_light_at(simulation: &Simulation, picture: &SimulatedPicture, point: DVec3) -> DVec3 {
    let pose = simulation.track().at(simulation.timestamp_s(0)).unwrap();
    let at: DVec2 = simulation.geometry().project(pose.transform_point(point)).unwrap();
    let around = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (at.x as i64 + dx, at.y as i64 + dy)));
    let light = |(x, y): (i64, i64)| picture.light[(y * i64::from(picture.width) + x) as usize];
    around.map(|place| DVec3::from(light(place).map(f64::from))).sum::<DVec3>() / 9.0
}

#[test]
fn card_reflects_the_light_from_above_and_shadows_the_floor() {
    let (bare, high) = (site(), 0.15);
    let there = bare.clone().with_evidence(&card(0.1, high, 0.5)).unwrap();
    let [empty, full] = [&bare, &there].map(|simulation| simulation.picture(0));
    // The irradiance integrated over all directions: half of it is reflected diffusely and 4 %
    // specularly.
    let upward = bare.white_facing_up(DVec3::new(0.0, 0.0, high));
    let shown = mean_light_at(&there, &full, DVec3::new(0.0, 0.0, high)) / upward;
    println!("of the light from above a card of 0.5 shows {shown:.3}");
    assert!(shown.min_element() > 0.48 && shown.max_element() < 0.53, "{shown}");

    // The floor below the card, visible beside it: the lamp is occluded, and part of the room.
    let toward = bare.lamps()[0].0 - DVec3::new(0.0, 0.0, high);
    let below = DVec3::new(-toward.x, -toward.y, 0.0) * (high / toward.z);
    let mut light_ratios = Vec::new();
    for (dx, dy) in [(0.0, -0.12), (0.12, 0.0), (-0.12, 0.0), (0.0, -0.4), (0.5, 0.3), (-0.5, -0.1)] {
        let place = below + DVec3::new(dx, dy, 0.0);
        let [was, is] = [&empty, &full].map(|picture| mean_light_at(&bare, picture, place));
        light_ratios.push(is.y / was.y);
    }
    println!("shares of the light on the floor that are left: {light_ratios:.3?}");
    // No loss far away.
    assert!(light_ratios[3..].iter().all(|left| (left - 1.0).abs() < 0.03), "{light_ratios:?}");
    let floor = full.light.iter().zip(&empty.light).zip(full.depth_m.iter().zip(&empty.depth_m));
    let floor = floor.filter(|(_, (now_m, was_m))| now_m == was_m).map(|((is, was), _)| is[1] / was[1]);
    let mut left: Vec<f32> = floor.collect();
    left.sort_by(f32::total_cmp);
    println!("of {} places the twentieth darkest keeps {:.3}", left.len(), left[19]);
    assert!(left[0] >= 0.0 && left[19] < 0.7, "{:?}", &left[..20]);
}

#[test]
fn empty_scene_changes_nothing_and_transparency_is_refused() {
    let bare = site();
    assert_eq!(bare.clone().with_evidence(&Scene::default()).unwrap().picture(0), bare.picture(0));
    let mut glass = card(0.1, 0.1, 0.5);
    glass.materials[0].alpha = Alpha::Blend;
    let refused = bare.with_evidence(&glass).unwrap_err();
    assert!(matches!(refused, SimulateError::Unsupported("transparency")), "{refused}");
}
