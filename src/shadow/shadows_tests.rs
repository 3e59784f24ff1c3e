use super::super::block::block;
use super::*;
use crate::plane::Plane;
use crate::scene::{Environment, Facet, Material, Part, PointLight, Sun};
use glam::{DAffine3, DQuat, DVec3, Vec2, Vec3};

/// Shadows with an empty memo.
fn fresh(scene: &Scene) -> Shadows {
    let memo = Box::leak(Box::new(ShadowMemo::new()));
    Shadows::with_memo(scene, Arc::new(EnvironmentImage::new(&scene.lighting.environment)), memo)
}

const HALF: Vec3 = Vec3::new(0.04, 0.03, 0.05);

/// Boxes on a floor, at positions x, y and angles about its normal.
fn scene(lighting: Lighting, plane: &ReceiverPlane, boxes: &[(f64, f64, f64)]) -> Scene {
    let world_from_plane = DAffine3 { matrix3: plane.axes, translation: plane.origin_m };
    let object = |(x, y, turn): &(f64, f64, f64)| {
        let on =
            DAffine3::from_rotation_translation(DQuat::from_rotation_z(*turn), DVec3::new(*x, *y, f64::from(HALF.z)));
        let part = Part { mesh: 0, world_from_mesh: world_from_plane * on };
        let support = Some(Plane { point_m: plane.origin_m, normal: plane.normal() });
        Object { parts: vec![part], support, ..Object::default() }
    };
    Scene {
        meshes: vec![Arc::new(block(HALF))],
        // Black, without indirect light.
        materials: vec![Material { base_color: [0.0, 0.0, 0.0, 1.0], ..Material::default() }],
        objects: boxes.iter().map(object).collect(),
        lighting,
        ..Scene::default()
    }
}

fn only(planar_shadow: Vec<PlanarShadow>) -> PlanarShadow {
    assert_eq!(planar_shadow.len(), 1);
    planar_shadow.into_iter().next().unwrap()
}

fn uniform_sky() -> Lighting {
    Lighting { environment: Environment::Uniform(Vec3::ONE), ..Lighting::default() }
}

/// True if a ray from a place on the floor hits the box, by its six planes.
fn hits_box(at: DVec3, towards: DVec3) -> bool {
    let (low, high) = (DVec3::new(-0.04, -0.03, 0.0), DVec3::new(0.04, 0.03, 0.1));
    let (a, b) = ((low - at) / towards, (high - at) / towards);
    a.min(b).max_element().max(0.0) <= a.max(b).min_element()
}

#[test]
fn shadow_of_a_uniform_sky_matches_many_rays() {
    let plane = ReceiverPlane::new(DVec3::new(0.3, -0.2, 1.0), DVec3::new(0.2, -0.9, 0.3).normalize());
    let scene = scene(uniform_sky(), &plane, &[(0.0, 0.0, 0.0)]);
    let planar_shadow = only(fresh(&scene).planar_shadows(&scene, Quality::Final).0);
    let mut worst = 0.0f64;
    for at in [(0.045, 0.0), (0.06, 0.02), (0.0, 0.04), (0.1, -0.05), (-0.15, 0.1), (0.0, 0.25), (0.02, 0.01)] {
        // Cosine-distributed: a disc projected to the hemisphere.
        let count = 16384;
        let blocked = (0..count).filter(|n| {
            let r = ((*n as f64 + 0.5) / count as f64).sqrt();
            let (s, c) = (*n as f64 * 2.399_963_229_728_653).sin_cos();
            let towards = DVec3::new(r * c + 1e-12, r * s + 1e-12, (1.0 - r * r).sqrt());
            hits_box(DVec3::new(at.0, at.1, 0.0), towards)
        });
        let truth = blocked.count() as f64 / count as f64;
        let removed = planar_shadow.removed_at(plane.at(glam::DVec2::new(at.0, at.1)));
        assert!(removed.abs_diff_eq(Vec3::splat(removed.x), 1e-4), "a grey sky: {removed}");
        worst = worst.max((f64::from(removed.x) - truth).abs());
    }
    // An edge between two of 512 rays is 1/512. A code of a mid-grey floor is 0.009.
    assert!(worst < 0.008, "{worst}");
    assert_eq!(planar_shadow.removed_at(plane.at(glam::DVec2::new(3.0, 0.0))), Vec3::ZERO);
}

#[test]
fn shadow_of_a_lamp_has_its_outline_and_its_colour() {
    let plane = ReceiverPlane::new(DVec3::ZERO, DVec3::Z);
    let world = |v: DVec3| plane.axes * v;
    let lamp = PointLight {
        position_in_world_m: world(DVec3::new(0.0, 0.0, 0.6)),
        color: Vec3::new(0.3, 0.0, 0.0),
        diameter_m: 0.06,
        range_m: f32::INFINITY,
        spot: None,
    };
    let lighting = Lighting { points: vec![lamp], ..uniform_sky() };
    let scene = scene(lighting, &plane, &[(0.0, 0.0, 0.0)]);
    let planar_shadow = only(fresh(&scene).planar_shadows(&scene, Quality::Final).0);
    let at = |x: f64, y: f64| planar_shadow.removed_at(plane.at(glam::DVec2::new(x, y)));
    // From 0.6 m the top at 0.1 m is magnified by 0.6/0.5: its edge is at 0.048 m, with the lamp's
    // penumbra.
    let (inside, outside) = (at(0.043, 0.0), at(0.056, 0.0));
    assert!(inside.x > outside.x + 0.2, "{inside} {outside}");
    // In the other colours only the sky's light is blocked.
    assert!(inside.x > inside.y + 0.15 && outside.x < outside.y, "{inside} {outside}");
}

#[test]
fn bounds_contain_all_visible_shadow_and_the_dark_part() {
    let plane = ReceiverPlane::new(DVec3::ZERO, DVec3::Z);
    let scene = scene(uniform_sky(), &plane, &[(0.0, 0.0, 0.0)]);
    let texture = only(fresh(&scene).planar_shadows(&scene, Quality::Final).0).texture;
    let size = glam::DVec2::new(texture.width.into(), texture.height.into());
    let outside = |part: crate::shadow::UvRect, threshold: f32| {
        texture.removed.iter().enumerate().any(|(i, removed)| {
            let texel = glam::UVec2::new(i as u32 % texture.width, i as u32 / texture.width).as_dvec2();
            let is_outside = texel.cmplt(part.low * size).any() || (texel + 1.0).cmpgt(part.high * size).any();
            is_outside && removed.iter().any(|share| share.abs() > threshold)
        })
    };
    assert!(!outside(texture.visible_bounds, 0.003) && !outside(texture.dark_bounds, 0.05));
    let (shown, dark) = (texture.visible_bounds, texture.dark_bounds);
    assert!(shown.low.cmplt(dark.low).all() && dark.high.cmplt(shown.high).all(), "{dark:?} is not within {shown:?}");
    assert!((dark.high - dark.low).element_product() < 0.3 * (shown.high - shown.low).element_product());
}

#[test]
fn approximate_map_is_close_to_the_final_one_which_is_reused() {
    let plane = ReceiverPlane::new(DVec3::new(0.3, -0.2, 1.0), DVec3::new(0.2, -0.9, 0.3).normalize());
    let sun =
        Sun { towards_light_in_world: Vec3::new(0.4, -0.8, 0.3).normalize(), color: Vec3::ONE, diameter_rad: 0.3 };
    let apart = scene(Lighting { suns: vec![sun], ..uniform_sky() }, &plane, &[(0.0, 0.0, 0.0), (1.5, 0.0, 0.3)]);
    let mut shadows = fresh(&apart);
    let (preview, quality) = shadows.planar_shadows(&apart, Quality::Preview);
    let exact = shadows.planar_shadows(&apart, Quality::Final).0;
    assert!(quality.is_preview() && preview.len() == exact.len());
    let (mut off, mut dark, mut count) = (0.0, 0.0, 0.0);
    for (x, y) in (-20..=20).flat_map(|x| (-20..=20).map(move |y| (0.01 * f64::from(x), 0.01 * f64::from(y)))) {
        let at = plane.at(glam::DVec2::new(x, y));
        let [preview, exact] =
            [&preview, &exact].map(|all| all.iter().map(|planar_shadow| planar_shadow.removed_at(at).x).sum::<f32>());
        (off, dark, count) = (off + (preview - exact).abs(), dark + exact, count + 1.0);
    }
    assert!(dark / count > 0.05 && off < 0.15 * dark, "{off} of {dark}");
    // Now all maps are memoized, also after an object elsewhere has moved.
    assert_eq!(shadows.planar_shadows(&apart, Quality::Preview), (exact.clone(), Quality::Final));
    let mut moved = apart.clone();
    moved.objects[1].move_by(DAffine3::from_translation(plane.axes * DVec3::new(0.3, 0.1, 0.0)));
    let (planar_shadows, quality) = shadows.planar_shadows(&moved, Quality::Preview);
    assert!(!quality.is_preview() && planar_shadows.len() == 2);
    // In a preview, objects that come close keep their separate planar shadows.
    moved.objects[1].move_by(DAffine3::from_translation(plane.axes * DVec3::new(-1.68, -0.1, 0.0)));
    let (planar_shadows, quality) = shadows.planar_shadows(&moved, Quality::Preview);
    assert!(
        quality.is_preview()
            && planar_shadows.len() == 2
            && shadows.planar_shadows(&moved, Quality::Final).0.len() == 1
    );
    assert!(
        planar_shadows.iter().all(|planar_shadow| exact.iter().any(|other| other.texture == planar_shadow.texture))
    );
}

#[test]
fn floor_that_moves_a_little_reuses_the_last_map() {
    let plane = ReceiverPlane::new(DVec3::new(0.3, -0.2, 1.0), DVec3::Z);
    let scene = scene(uniform_sky(), &plane, &[(0.0, 0.0, 0.0)]);
    let mut shadows = fresh(&scene);
    let exact = only(shadows.planar_shadows(&scene, Quality::Final).0);
    let moved = |tilt: f64, up_m: f64| {
        let mut moved = scene.clone();
        let (point_m, normal) = (plane.origin_m + up_m * DVec3::Z, (DVec3::Z + tilt * DVec3::X).normalize());
        moved.objects[0].support = Some(Plane { point_m, normal });
        moved
    };
    let (preview, quality) = shadows.planar_shadows(&moved(0.1, -0.02), Quality::Preview);
    let preview = only(preview);
    assert!(quality.is_preview() && preview.texture == exact.texture);
    assert!(preview.plane.normal().x > 0.09 && (preview.plane.origin_m.z - 0.98).abs() < 0.01, "{:?}", preview.plane);
    for (tilt, up_m) in [(0.3, 0.0), (0.0, -0.05)] {
        let (preview, quality) = shadows.planar_shadows(&moved(tilt, up_m), Quality::Preview);
        assert!(quality.is_preview() && only(preview).texture != exact.texture, "{tilt} {up_m}");
    }
    let mut bare = moved(0.1, 0.0);
    bare.objects[0].shadowless = true;
    assert_eq!(shadows.planar_shadows(&bare, Quality::Preview).0, []);
    // A final map is that of the new floor.
    assert!(only(shadows.planar_shadows(&moved(0.1, 0.0), Quality::Final).0).texture != exact.texture);
}

#[test]
fn planar_shadows_after_a_change_of_light_are_those_of_the_new_light() {
    let plane = ReceiverPlane::new(DVec3::new(0.3, -0.2, 1.0), DVec3::Z);
    let lamp = |x: f64| PointLight {
        position_in_world_m: plane.at(glam::DVec2::new(x, 0.1)) + DVec3::Z,
        color: Vec3::ONE,
        diameter_m: 0.06,
        range_m: f32::INFINITY,
        spot: None,
    };
    let scene_of = |lighting: Lighting| scene(lighting, &plane, &[(0.0, 0.0, 0.0)]);
    let [left, right] = [-0.5, 0.5].map(|x| scene_of(Lighting { points: vec![lamp(x)], ..uniform_sky() }));
    let dark_sky = Environment::Uniform(Vec3::splat(0.1));
    let dark = scene_of(Lighting { points: vec![lamp(0.5)], environment: dark_sky, ..Lighting::default() });
    let mut shadows = fresh(&left);
    let first = shadows.planar_shadows(&left, Quality::Final).0;
    // Planar shadows are compared by address, textures by value.
    let textures = |planar_shadows: Vec<PlanarShadow>| {
        planar_shadows.iter().map(|planar_shadow| ShadowTexture::clone(&planar_shadow.texture)).collect::<Vec<_>>()
    };
    for scene in [&right, &dark, &left] {
        shadows.set_lighting(scene);
        let (preview, quality) = shadows.planar_shadows(scene, Quality::Preview);
        if std::ptr::eq(scene, &left) {
            // Memoized from before.
            assert!(!quality.is_preview() && preview == first);
            continue;
        }
        assert!(quality.is_preview());
        assert!(textures(preview) == textures(fresh(scene).planar_shadows(scene, Quality::Preview).0));
        assert!(
            textures(shadows.planar_shadows(scene, Quality::Final).0)
                == textures(fresh(scene).planar_shadows(scene, Quality::Final).0)
        );
    }
    let first = textures(first);
    assert!(
        textures(shadows.planar_shadows(&left, Quality::Final).0) == first
            && textures(fresh(&right).planar_shadows(&right, Quality::Final).0) != first
    );
}

#[test]
fn shadow_of_a_sun_is_on_the_opposite_side() {
    let plane = ReceiverPlane::new(DVec3::ZERO, DVec3::NEG_Y);
    let towards = (plane.axes * DVec3::new(1.0, 0.0, 1.0).normalize()).as_vec3();
    let sun = Sun { towards_light_in_world: towards, color: Vec3::ONE, diameter_rad: 0.01 };
    let lighting = Lighting { suns: vec![sun], points: Vec::new(), environment: Environment::Uniform(Vec3::ZERO) };
    let scene = scene(lighting, &plane, &[(0.0, 0.0, 0.0)]);
    let planar_shadow = only(fresh(&scene).planar_shadows(&scene, Quality::Final).0);
    let at = |x: f64, y: f64| planar_shadow.removed_at(plane.at(glam::DVec2::new(x, y))).x;
    // A height of 0.1 m under 45°: from −0.04 m to −0.14 m.
    assert!(at(-0.135, 0.0) > 0.99 && at(-0.145, 0.0) < 0.01, "{} {}", at(-0.135, 0.0), at(-0.145, 0.0));
    assert!(at(-0.1, 0.027) > 0.99 && at(-0.1, 0.033) < 0.01 && at(0.05, 0.0) < 0.01);
}

#[test]
fn objects_with_overlapping_shadows_share_a_planar_shadow() {
    let plane = ReceiverPlane::new(DVec3::ZERO, DVec3::Z);
    let both = scene(uniform_sky(), &plane, &[(0.0, 0.0, 0.0), (0.12, 0.0, 0.4)]);
    let planar_shadow = only(fresh(&both).planar_shadows(&both, Quality::Final).0);
    let alone = |n: usize| {
        let one = Scene { objects: vec![both.objects[n].clone()], ..both.clone() };
        only(fresh(&one).planar_shadows(&one, Quality::Final).0)
    };
    let between = plane.at(glam::DVec2::new(0.06, 0.0));
    let [together, left, right] =
        [&planar_shadow, &alone(0), &alone(1)].map(|planar_shadow| planar_shadow.removed_at(between).x);
    // They block light from different sides.
    assert!((together - left - right).abs() < 0.03 && together < 1.0, "{together} {left} {right}");
    let apart = scene(uniform_sky(), &plane, &[(0.0, 0.0, 0.0), (5.0, 0.0, 0.4)]);
    assert_eq!(fresh(&apart).planar_shadows(&apart, Quality::Final).0.len(), 2);
    let shadowless = scene(uniform_sky(), &plane, &[(0.0, 0.0, 0.0)]);
    let object = Object { shadowless: true, ..shadowless.objects[0].clone() };
    let shadowless = Scene { objects: vec![object], ..shadowless };
    assert!(fresh(&shadowless).planar_shadows(&shadowless, Quality::Final).0.is_empty());
}

#[test]
fn shadow_on_a_wall_matches_that_on_a_floor_in_its_plane() {
    let plane = ReceiverPlane::new(DVec3::ZERO, DVec3::Z);
    let sun =
        Sun { towards_light_in_world: Vec3::new(-1.0, 0.0, 0.5).normalize(), color: Vec3::ONE, diameter_rad: 0.02 };
    let mut scene = scene(Lighting { suns: vec![sun], ..uniform_sky() }, &plane, &[(0.0, 0.0, 0.0)]);
    // A wall 4 cm to the right of the box.
    let reach = scene.objects[0].points_m(&scene).map(|p| p.x).fold(f64::NEG_INFINITY, f64::max);
    let plane = Plane { point_m: DVec3::new(reach + 0.04, 0.0, 0.1), normal: DVec3::NEG_X };
    let half = glam::DVec2::new(0.3, 0.1);
    let facet = Facet { plane, along: DVec3::Y, low_m: -half, high_m: half };
    scene.objects[0].facets = vec![facet];
    let mut shadows = fresh(&scene);
    let (preview, quality) = shadows.planar_shadows(&scene, Quality::Preview);
    assert!(quality.is_preview() && preview.len() == 2);
    let planar_shadows = shadows.planar_shadows(&scene, Quality::Final).0;
    assert_eq!(
        (planar_shadows.len(), planar_shadows.iter().filter(|planar_shadow| planar_shadow.is_beside).count()),
        (2, 1)
    );
    assert_eq!(shadows.planar_shadows(&scene, Quality::Preview), (planar_shadows.clone(), Quality::Final));
    let wall = planar_shadows.iter().find(|planar_shadow| planar_shadow.is_beside).unwrap();
    let preview = preview.iter().find(|planar_shadow| planar_shadow.is_beside).unwrap();
    // The same box near an unbounded floor in the plane of the wall.
    let mut lying = scene.clone();
    (lying.objects[0].support, lying.objects[0].facets) = (Some(plane), Vec::new());
    let lying = only(fresh(&lying).planar_shadows(&lying, Quality::Final).0);
    let at = |y: f64, z: f64| DVec3::new(plane.point_m.x, y, z);
    let (mut dark, mut off) = (0.0f32, 0.0f32);
    for (y, z) in (-10..=10).flat_map(|y| (3..10).map(move |z| (0.01 * f64::from(y), 0.02 * f64::from(z)))) {
        let [removed, expected] = [wall, &lying].map(|planar_shadow| planar_shadow.removed_at(at(y, z)).x);
        (dark, off) = (dark.max(removed), off.max((removed - expected).abs()));
        assert!((preview.removed_at(at(y, z)).x - removed).abs() < 0.3);
    }
    // The texels are different.
    assert!(dark > 0.5 && off < 0.06, "{dark} {off}");
    // The shadow on the wall ends 15 mm above the floor and at the rectangle.
    assert!(lying.removed_at(at(0.0, 0.01)).x > 0.3, "{}", lying.removed_at(at(0.0, 0.01)));
    assert_eq!([wall.removed_at(at(0.0, 0.01)), wall.removed_at(at(0.32, 0.1))], [Vec3::ZERO; 2]);
    // The shadow on the floor is that without a wall. A shadowless object has none on either.
    let ground = planar_shadows.iter().find(|planar_shadow| !planar_shadow.is_beside).unwrap();
    scene.objects[0].facets.clear();
    assert_eq!(*only(fresh(&scene).planar_shadows(&scene, Quality::Final).0).texture, *ground.texture);
    (scene.objects[0].facets, scene.objects[0].shadowless) = (vec![facet], true);
    assert_eq!(fresh(&scene).planar_shadows(&scene, Quality::Final).0, []);
}

/// A red box, 4 cm to its right a wall of 0.2 m that faces it, and a lamp.
fn in_front_of_a_wall(at_m: DVec3, bright: f32) -> Scene {
    let plane = ReceiverPlane::new(DVec3::ZERO, DVec3::Z);
    let (color, range_m) = (Vec3::splat(bright), f32::INFINITY);
    let lamp = PointLight { position_in_world_m: at_m, color, diameter_m: 0.02, range_m, spot: None };
    let lighting = Lighting { points: vec![lamp], ..uniform_sky() };
    let mut scene = scene(lighting, &plane, &[(0.0, 0.0, 0.0)]);
    scene.materials[0].base_color = [0.9, 0.0, 0.0, 1.0];
    let reach = scene.objects[0].points_m(&scene).map(|p| p.x).fold(f64::NEG_INFINITY, f64::max);
    let plane = Plane { point_m: DVec3::new(reach + 0.04, 0.0, 0.1), normal: DVec3::NEG_X };
    let half = glam::DVec2::splat(0.1);
    scene.objects[0].facets = vec![Facet { plane, along: DVec3::Y, low_m: -half, high_m: half }];
    scene
}

fn on_the_wall(scene: &Scene, room: Option<Room>) -> Vec3 {
    let mut shadows = fresh(scene);
    shadows.set_room(room.map(Arc::new));
    let wall = shadows
        .planar_shadows(scene, Quality::Final)
        .0
        .into_iter()
        .find(|planar_shadow| planar_shadow.is_beside)
        .unwrap();
    wall.removed_at(scene.objects[0].facets[0].plane.point_m - 0.03 * DVec3::Z)
}

#[test]
fn object_reflects_light_from_behind_a_facet_onto_the_facet() {
    // A lamp behind the wall and above it lights the side of the box and not the wall's front.
    let low = in_front_of_a_wall(DVec3::new(0.2, 0.0, 0.9), 10.0);
    let mut high = low.clone();
    // A wall so high that no light passes it.
    high.objects[0].facets[0].high_m = glam::DVec2::splat(9.0);
    high.objects[0].facets[0].low_m = glam::DVec2::splat(-9.0);
    let [low, high] = [&low, &high].map(|scene| on_the_wall(scene, None));
    assert!(low.x < high.x - 0.2 && low.x < -0.1, "{low} {high}");
    // A red object reflects no other colour.
    assert!(low.y > 0.2 && (low.y - high.y).abs() < 0.01, "{low} {high}");
}

#[test]
fn real_wall_beyond_its_facet_blocks_the_light_behind_it() {
    let low = in_front_of_a_wall(DVec3::new(0.2, 0.0, 0.9), 10.0);
    let dim = in_front_of_a_wall(DVec3::new(0.2, 0.0, 0.9), 0.0);
    let wall_m = low.objects[0].facets[0].plane.point_m.x;
    // A wall higher than the lamp, with two points for each centimetre.
    let places = (0..2 * 120 * 150).map(|n| (n / 2 % 120, n / 240));
    let wall = Room::of(
        places.map(|(y, z)| DVec3::new(wall_m + 0.015, 0.01 * f64::from(y) - 0.595, 0.01 * f64::from(z) + 0.005)),
    );
    let [past, with_real_wall] = [None, Some(wall)].map(|room| on_the_wall(&low, room).x);
    let none = on_the_wall(&dim, None).x;
    assert!(past < none - 0.1 && (with_real_wall - none).abs() < 0.02, "{past} {with_real_wall} {none}");
}

#[test]
fn light_that_a_real_object_blocks_is_not_subtracted_from_a_wall() {
    let lit = in_front_of_a_wall(DVec3::new(-0.8, 0.0, 0.25), 1.0);
    let mut dim = lit.clone();
    dim.lighting.points.clear();
    // A board between the lamp and the box, with two points for each centimetre.
    let places = (0..2 * 60 * 60).map(|n| (n / 2 % 60, n / 120));
    let board = places.map(|(y, z)| DVec3::new(-0.4, 0.01 * f64::from(y) - 0.3, 0.01 * f64::from(z)));
    let behind = Room::of(board.map(|at_m| at_m + DVec3::splat(0.005)));
    let [unblocked, blocked, dim] =
        [on_the_wall(&lit, None), on_the_wall(&lit, Some(behind)), on_the_wall(&dim, None)].map(|share| share.y);
    assert!(unblocked > dim + 0.2 && (blocked - dim).abs() < 1e-4, "{unblocked} {blocked} {dim}");
}

#[test]
fn object_moved_on_its_floor_has_the_map_of_a_new_one() {
    let plane = ReceiverPlane::new(DVec3::new(0.1, 0.2, 0.3), DVec3::new(0.1, 0.2, 0.9).normalize());
    let mut shadows = fresh(&scene(uniform_sky(), &plane, &[]));
    let at = |x: f64, y: f64| scene(uniform_sky(), &plane, &[(x, y, 0.7)]);
    let first = only(shadows.planar_shadows(&at(0.0, 0.0), Quality::Final).0);
    let moved = only(shadows.planar_shadows(&at(0.731, -0.25), Quality::Final).0);
    assert!(first.texture == moved.texture, "it was worked out again");
    let scene = at(0.731, -0.25);
    assert_eq!(*only(fresh(&scene).planar_shadows(&scene, Quality::Final).0).texture, *moved.texture);
    let beside = moved.removed_at(plane.at(glam::DVec2::new(0.731, -0.25) + Vec2::new(0.0, 0.06).as_dvec2()));
    assert!(beside.x > 0.05, "{beside}");
    assert_eq!(first.removed_at(plane.at(glam::DVec2::new(0.731, -0.25))), Vec3::ZERO);
}
