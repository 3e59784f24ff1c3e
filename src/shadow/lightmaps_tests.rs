use super::*;
use crate::render::TexelPoint;
use crate::scene::{Environment, Material, Mesh, Sun, Vertex};
use glam::{DQuat, Vec2, Vec3};

/// A flat rectangle in x and y, or a box, with normals that stand upright.
fn mesh(corners: &[[Vec3; 4]]) -> Arc<Mesh> {
    let (mut vertices, mut indices) = (Vec::new(), Vec::new());
    for side in corners {
        let normal = (side[1] - side[0]).cross(side[2] - side[0]).normalize().to_array();
        let first = vertices.len() as u32;
        indices.extend([0, 1, 2, 0, 2, 3].map(|i| first + i));
        vertices.extend(side.map(|p| Vertex { position: p.to_array(), normal, ..bytemuck::Zeroable::zeroed() }));
    }
    vertices.iter_mut().for_each(|v: &mut Vertex| v.color = [1.0; 4]);
    Arc::new(Mesh { vertices, indices, material: 0 })
}

/// 0.2 m × 0.2 m, facing up.
fn plate() -> Arc<Mesh> {
    let at = |x: f32, y: f32| Vec3::new(0.1 * x, 0.1 * y, 0.0);
    mesh(&[[at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)]])
}

const WALL_M: f32 = 0.3;

/// A wall at x = 0.1, 20 m long, facing the plate.
fn wall() -> Arc<Mesh> {
    let at = |y: f32, z: f32| Vec3::new(0.1, 10.0 * y, WALL_M * z);
    mesh(&[[at(-1.0, 0.0), at(-1.0, 1.0), at(1.0, 1.0), at(1.0, 0.0)]])
}

fn cube() -> Arc<Mesh> {
    let at = |i: u32| {
        0.05 * Vec3::new(
            [-1.0, 1.0][(i & 1) as usize],
            [-1.0, 1.0][(i >> 1 & 1) as usize],
            [-1.0, 1.0][(i >> 2) as usize],
        )
    };
    let sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    mesh(&sides.map(|side| side.map(at)))
}

fn scene(meshes: &[Arc<Mesh>], reflectance: f32, lighting: Lighting) -> Scene {
    let object =
        |mesh: usize| Object { parts: vec![Part { mesh, world_from_mesh: DAffine3::IDENTITY }], ..Object::default() };
    Scene {
        meshes: meshes.to_vec(),
        materials: vec![Material { base_color: [reflectance, reflectance, reflectance, 1.0], ..Material::default() }],
        objects: (0..meshes.len()).map(object).collect(),
        lighting,
        ..Scene::default()
    }
}

fn even_sky() -> Lighting {
    Lighting { environment: Environment::Uniform(Vec3::new(1.0, 2.0, 3.0)), ..Lighting::default() }
}

fn lamp(at: DVec3) -> PointLight {
    PointLight { position_in_world_m: at, color: Vec3::ONE, diameter_m: 0.02, range_m: f32::INFINITY, spot: None }
}

fn environment(scene: &Scene) -> Arc<EnvironmentImage> {
    Arc::new(EnvironmentImage::new(&scene.lighting.environment))
}

fn new_lightmaps(scene: &Scene) -> Lightmaps {
    Lightmaps::new(scene, &environment(scene))
}

fn unwrapped(scene: &Scene) -> Vec<UnwrappedMesh> {
    scene.meshes.iter().map(|mesh| UnwrappedMesh::new(mesh, 32)).collect()
}

/// The first part's lightmap, and where in the mesh each of its texels lies, but for those in
/// the corner at the wall.
fn first(scene: &Scene) -> (Arc<Lightmap>, Vec<(Vec3, TexelPoint)>) {
    let unwrapped = unwrapped(scene);
    let maps = new_lightmaps(scene).lightmaps(scene, &unwrapped, &[], &[]);
    let own = &unwrapped[0];
    let at = |place: &TexelPoint| {
        let corner = |n: usize| own.corners[own.indices[3 * place.triangle as usize + n] as usize].vertex.position;
        (0..3).map(|n| place.weights[n] * Vec3::from(corner(n))).sum::<Vec3>()
    };
    let places = own.places().into_iter().map(|place| (at(&place), place));
    (maps[0].clone().unwrap(), places.filter(|(at, _)| at.x < 0.099).collect())
}

#[test]
fn unoccluded_surface_gets_all_light_exactly() {
    let lighting = Lighting { points: vec![lamp(DVec3::new(0.3, 0.2, 0.5))], ..even_sky() };
    for mesh in [plate(), cube()] {
        let (map, places) = first(&scene(&[mesh], 0.8, lighting.clone()));
        assert!(places.len() > 300);
        for (_, place) in places {
            assert_eq!(map.layers[0][place.texel as usize], [1.0; 4]);
            assert_eq!(map.layers[1][place.texel as usize][..3], [0.0; 3]);
        }
    }
}

#[test]
fn sky_visibility_and_indirect_light_beside_a_wall_match_its_solid_angle() {
    let form_factor = |distance: f32| 0.5 * (1.0 - distance / WALL_M.hypot(distance));
    for reflectance in [0.0, 0.8] {
        let (map, places) = first(&scene(&[plate(), wall()], reflectance, even_sky()));
        for (at, place) in places {
            let distance = 0.1 - at.x;
            // The wall's outline crosses some 45 of the 512 patches of the sky, with an error
            // of half a patch each: 0.017 rms, and three times that at the worst of many
            // places.
            let (open, indirect) = (map.layers[0][place.texel as usize], map.layers[1][place.texel as usize]);
            assert!(
                (open[0] - (1.0 - form_factor(distance))).abs() < 0.05,
                "{at}: {} {}",
                open[0],
                form_factor(distance)
            );
            assert!((open[0] - open[1]).abs() < 1e-5 && (open[0] - open[2]).abs() < 1e-5 && open[3] == 1.0, "{open:?}");
            // The whole view of the wall is sky, except for the plate below it.
            let expected = reflectance * form_factor(distance);
            for (c, sky) in [1.0, 2.0, 3.0].into_iter().enumerate() {
                let off = (indirect[c] / sky - expected).abs();
                assert!(off < 0.15 * expected + 0.015, "{at}: {} for {expected}", indirect[c] / sky);
            }
        }
    }
}

#[test]
fn lights_behind_a_wall_are_hidden_and_each_has_its_own_visibility() {
    let sun = |x: f32| Sun {
        towards_light_in_world: Vec3::new(x, 0.0, 1.0).normalize(),
        color: Vec3::ONE,
        diameter_rad: 0.01,
    };
    let lighting = Lighting {
        suns: vec![sun(-1.0), sun(6.0)],
        points: vec![
            lamp(DVec3::new(0.5, 0.0, 0.45)),
            lamp(DVec3::new(0.0, 0.0, 1.0)),
            lamp(DVec3::new(3.0, 0.0, 0.3)),
        ],
        environment: Environment::Uniform(Vec3::ZERO),
    };
    let (map, places) = first(&scene(&[plate(), wall()], 0.5, lighting));
    assert_eq!(map.layers.len(), 3);
    for (at, place) in places {
        let [a, b, c] = [0, 1, 2].map(|layer| map.layers[layer][place.texel as usize]);
        // The wall hides lights behind it. The first lamp is visible from 0.8 m on, beyond the
        // end of the plate.
        assert_eq!((a[3], b[3], c[0], c[1], c[2]), (1.0, 0.0, 0.0, 1.0, 0.0), "{at}");
        // The visibility of a black sky has no effect. The wall's indirect light is present.
        assert!(b[0] > 0.0);
    }
}

#[test]
fn back_of_a_double_sided_surface_has_its_own_layers() {
    let mut scene = scene(&[plate(), wall()], 0.5, even_sky());
    scene.materials[0].double_sided = true;
    let (map, places) = first(&scene);
    assert_eq!(map.layers.len(), 4);
    // The wall is on the plate's upper side alone.
    for (at, place) in places.iter().filter(|(at, _)| at.x > 0.0) {
        let [front, back] = [0, 2].map(|layer| map.layers[layer][place.texel as usize][0]);
        assert!(front < 0.75 && back == 1.0, "{at}: {front} {back}");
    }
}

#[test]
fn real_occluders_attenuate_each_lamp_and_nothing_else() {
    let lighting = Lighting { points: [0.1, 0.2, 0.3].map(|x| lamp(DVec3::new(x, 0.0, 1.0))).to_vec(), ..even_sky() };
    let mut scene = scene(&[plate(), wall()], 0.5, lighting);
    scene.materials[0].double_sided = true;
    let unwrapped = unwrapped(&scene);
    let open = new_lightmaps(&scene).lightmaps(&scene, &unwrapped, &[], &[]);
    let layers = [[1.0, 1.0, 1.0, 0.5], [0.0, 0.0, 0.0, 0.25], [0.125, 1.0, 1.0, 1.0]];
    let dim = Arc::new(Lightmap { side: 1, layers: layers.map(|texel| vec![texel]).to_vec() });
    let behind = new_lightmaps(&scene).lightmaps(&scene, &unwrapped, &[], &[Some(dim), None]);
    assert_eq!(behind[1], open[1]);
    let [open, behind] = [&open, &behind].map(|maps| maps[0].clone().unwrap());
    assert_eq!((open.layers.len(), behind.layers.len()), (6, 6), "two sides of three");
    let factors = [[1.0, 1.0, 1.0, 0.5], [1.0, 1.0, 1.0, 0.25], [0.125, 1.0, 1.0, 1.0]];
    for (n, (open, behind)) in open.layers.iter().zip(&behind.layers).enumerate() {
        for (open, behind) in open.iter().zip(behind) {
            assert_eq!(*behind, std::array::from_fn(|i| open[i] * factors[n % 3][i]));
        }
    }
}

#[test]
fn moved_object_keeps_its_lightmap_until_another_one_is_near() {
    let mut scene = scene(&[cube(), cube()], 0.5, even_sky());
    let unwrapped = unwrapped(&scene);
    let mut maps = new_lightmaps(&scene);
    let moved = |object: &mut Object, by: DAffine3| object.move_by(by);
    moved(&mut scene.objects[1], DAffine3::from_translation(DVec3::new(5.0, 0.0, 0.0)));
    let alone = maps.lightmaps(&scene, &unwrapped, &[], &[]);
    moved(&mut scene.objects[0], DAffine3::from_translation(DVec3::new(0.37, 0.1, 0.0)));
    let beside = maps.lightmaps(&scene, &unwrapped, &[], &[]);
    assert!(Arc::ptr_eq(alone[0].as_ref().unwrap(), beside[0].as_ref().unwrap()), "it was worked out again");
    moved(&mut scene.objects[0], DAffine3::from_rotation_translation(DQuat::IDENTITY, DVec3::new(4.5, -0.1, 0.0)));
    let near = maps.lightmaps(&scene, &unwrapped, &[], &[]);
    let darkest =
        |map: &Option<Arc<Lightmap>>| map.as_ref().unwrap().layers[0].iter().map(|t| t[0]).fold(1.0, f32::min);
    assert_eq!(maps.preview(&scene), (near.clone(), Quality::Final));
    assert!(darkest(&alone[0]) == 1.0 && darkest(&near[0]) < 0.9, "{}", darkest(&near[0]));
    // Under a sky of another colour the preview is the last map until a final one is requested.
    // With another lamp there is no preview.
    scene.lighting.environment = Environment::Uniform(Vec3::new(0.5, 0.4, 0.3));
    maps.set_lighting(&scene, &environment(&scene));
    assert_eq!(maps.preview(&scene), (near.clone(), Quality::Preview));
    assert_eq!(
        maps.lightmaps(&scene, &unwrapped, &[], &[]),
        new_lightmaps(&scene).lightmaps(&scene, &unwrapped, &[], &[])
    );
    assert_eq!(maps.preview(&scene).1, Quality::Final);
    let mut lamps = scene.clone();
    lamps.lighting.points.push(lamp(DVec3::new(0.0, 0.0, 3.0)));
    maps.set_lighting(&lamps, &environment(&lamps));
    assert_eq!(maps.preview(&lamps), (Vec::new(), Quality::Preview));
    maps.set_lighting(&scene, &environment(&scene));
    let near = maps.lightmaps(&scene, &unwrapped, &[], &[]);
    // Something without a shadow takes nothing.
    scene.objects[1].shadowless = true;
    assert_eq!(maps.preview(&scene), (near.clone(), Quality::Preview));
    assert_eq!(darkest(&maps.lightmaps(&scene, &unwrapped, &[], &[])[0]), 1.0);
    assert_eq!(
        new_lightmaps(&scene).lightmaps(&scene, &unwrapped, &[], &[]),
        maps.lightmaps(&scene, &unwrapped, &[], &[])
    );
}

#[test]
fn lightmap_of_a_moved_object_equals_a_new_one_bit_for_bit() {
    // The moves are shorter than the steps of occluders and planes. The floor's shadow becomes
    // darker along x.
    let mut texture = ShadowTexture::empty(Vec2::splat(-0.5), 0.01, 100, 100);
    texture.removed = (0..100 * 100).map(|i| [(i % 100) as f32 / 100.0; 3]).collect();
    let plane = ReceiverPlane::new(DVec3::new(0.0, 0.0, -0.1), DVec3::Z);
    let floor = [PlanarShadow { plane, texture: ByAddress(Arc::new(texture)), is_beside: false }];
    let mut scene = scene(&[cube()], 0.5, even_sky());
    scene.lighting.points.push(lamp(DVec3::new(0.3, 0.2, 0.5)));
    let unwrapped = unwrapped(&scene);
    let mut maps = new_lightmaps(&scene);
    for move_m in [0.0, 4e-10, 3e-7] {
        scene.objects[0].move_by(DAffine3::from_translation(DVec3::new(move_m, 0.0, 0.0)));
        let moved = maps.lightmaps(&scene, &unwrapped, &floor, &[]);
        assert!(moved == new_lightmaps(&scene).lightmaps(&scene, &unwrapped, &floor, &[]), "{move_m} m");
    }
}
