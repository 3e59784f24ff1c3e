//! Surface shading compared with values computed by hand.

use crate::gpu;
use crate::models::{Model, png};
use glam::{DAffine3, DQuat, DVec3, Vec2, Vec3};
use locard::pose::Pose;
use locard::scene::{
    Environment, Lighting, Material, Mesh, Object, Part, PointLight, Scene, SceneTexture, Sun, TextureUse, Vertex, Wrap,
};
use locard::tracking::PoseTrack;
use serde_json::json;

const SIDE: usize = 64;

/// The layer of a scene from the origin, looking along +z with y down.
fn layer_of(scene: Scene, focal_px: f64) -> Vec<[f32; 4]> {
    let still = |t| (t, Pose::from_camera_in_world(DVec3::ZERO, DQuat::IDENTITY));
    let track = PoseTrack::new(vec![still(-1.0), still(1.0)], 3.0).unwrap();
    let camera = gpu::camera(&gpu::pinhole(SIDE as u32, SIDE as u32, focal_px), 0.0);
    let frame = gpu::frame(0, 0.0, gpu::grey(SIDE as u32, SIDE as u32, 0));
    let done = gpu::composite(&gpu::gpu(), &camera, gpu::settings(&[]), scene, &track, frame);
    done.layer.unwrap().rgba
}

/// A square of 2 m at 1 m from the camera, wider than the picture and facing it; u to the right, v
/// down.
fn board(material: Material) -> Scene {
    let corner = |x: f32, y: f32| Vertex {
        position: [x, y, 1.0],
        normal: [0.0, 0.0, -1.0],
        tangent: [1.0, 0.0, 0.0, 1.0],
        uv0: [0.5 + 0.5 * x, 0.5 + 0.5 * y],
        uv1: [0.0; 2],
        color: [1.0; 4],
    };
    Scene {
        meshes: vec![
            Mesh {
                vertices: vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)],
                indices: vec![0, 2, 1, 0, 3, 2],
                material: 0,
            }
            .into(),
        ],
        materials: vec![Material { double_sided: true, ..material }],
        objects: vec![Object {
            name: "board".to_owned(),
            parts: vec![Part { mesh: 0, world_from_mesh: DAffine3::IDENTITY }],
            ..Object::default()
        }],
        ..Scene::default()
    }
}

fn dark() -> Lighting {
    Lighting { environment: Environment::Uniform(Vec3::ZERO), ..Lighting::default() }
}

fn sun(towards: Vec3, color: f32) -> Lighting {
    let sun = Sun { towards_light_in_world: towards.normalize(), color: Vec3::splat(color), diameter_rad: 0.00925 };
    Lighting { suns: vec![sun], ..dark() }
}

fn material(base: f32, metallic: f32, roughness: f32) -> Material {
    Material { base_color: [base, base, base, 1.0], metallic, roughness, ..Material::default() }
}

/// Red of the pixel right below and right of the picture's middle.
fn central_red(scene: Scene) -> f32 {
    layer_of(scene, 2000.0)[SIDE / 2 * SIDE + SIDE / 2][0]
}

fn lit_red(material: Material, lighting: Lighting) -> f32 {
    central_red(Scene { lighting, ..board(material) })
}

#[test]
fn white_diffuse_surface_reflects_the_sun_by_lamberts_cosine() {
    // 0.8 at 60°: 0.4. The specular term takes 4 % of 0.31 from the diffuse part (the directional
    // albedo of the roughest surface after one bounce, at normal incidence) and adds 0.04/(2·(1 +
    // 1/2)): together +0.1 %.
    let towards = Vec3::new(0.75f32.sqrt(), 0.0, -0.5);
    let red = lit_red(material(1.0, 0.0, 1.0), sun(towards, 0.8));
    assert!((red - 0.4004).abs() < 0.0005, "{red}");
    assert_eq!(lit_red(material(1.0, 0.0, 1.0), sun(Vec3::new(1.0, 0.0, 0.2), 0.8)), 0.0, "from behind");
}

/// KHR_lights_punctual: a spot's attenuation is the square of a ramp that is linear in the cosine,
/// from 0 at the outer angle (here 60°, cosine 0.5) to 1 at the inner angle (here 0°, cosine 1).
#[test]
fn spot_light_between_its_angles_falls_off_with_the_square_of_the_ramp() {
    let lit_at = |cosine: f32| {
        let axis = Vec3::new((1.0 - cosine * cosine).sqrt(), 0.0, cosine);
        let spot = PointLight {
            position_in_world_m: DVec3::ZERO,
            color: Vec3::ONE,
            diameter_m: 0.05,
            range_m: f32::INFINITY,
            spot: Some((axis, Vec2::new(0.0, std::f32::consts::FRAC_PI_3))),
        };
        lit_red(material(1.0, 0.0, 1.0), Lighting { points: vec![spot], ..dark() })
    };
    // A white diffuse surface that faces the light at 1 m shows about its colour.
    let on_axis = lit_at(1.0);
    assert!((on_axis - 1.0).abs() < 0.1, "{on_axis}");
    for (cosine, ramp) in [(0.875, 0.75), (0.75, 0.5), (0.625, 0.25), (0.45, 0.0)] {
        let relative = lit_at(cosine) / on_axis;
        // The layer has half floats, and the pixel's centre is 0.02° off.
        assert!((relative - ramp * ramp).abs() < 0.002, "cosine {cosine}: {relative}");
    }
}

#[test]
fn white_surface_under_a_white_sky_is_white() {
    for metallic in [0.0, 1.0] {
        for roughness in [0.1, 0.4, 0.75, 1.0] {
            for slant in [0.0, 1.2] {
                let mut scene = board(material(1.0, metallic, roughness));
                let about = DVec3::new(0.0, 0.0, 1.0);
                scene.objects[0].parts[0].world_from_mesh = DAffine3::from_translation(about)
                    * DAffine3::from_quat(DQuat::from_rotation_y(slant))
                    * DAffine3::from_translation(-about);
                let red = central_red(scene);
                // Half floats.
                assert!((red - 1.0).abs() < 0.001, "metallic {metallic}, roughness {roughness}, {slant}: {red}");
            }
        }
    }
}

#[test]
fn rough_metal_matches_the_brdf_integral() {
    // At roughness 0.6 and normal incidence one bounce returns 0.8245 F0 of uniform light, over all
    // views 0.8030 (by summing the BRDF over 400,000 directions). F0 = 0.5: mean of Schlick's term
    // 0.5238, further bounces add 9.98 %.
    let red = lit_red(material(0.5, 1.0, 0.6), Lighting::default());
    assert!((red - 0.4534).abs() < 0.002, "{red}");
}

#[test]
fn smooth_metal_has_the_full_specular_peak() {
    // Camera, sun and normal are aligned: D·π = 1/α² = 10⁴, visibility 1/4, F = 1. Half a pixel off
    // at 2000 px: 0.05 %.
    let red = lit_red(material(1.0, 1.0, 0.1), sun(Vec3::NEG_Z, 1.0));
    assert!((red - 2500.0).abs() < 12.0, "{red}");
}

#[test]
fn metallic_of_one_half_is_the_mean_of_metal_and_dielectric() {
    let towards = Vec3::new(0.4, -0.3, -0.8);
    for roughness in [0.3, 1.0] {
        for base in [0.15, 0.8] {
            for light in [sun(towards, 1.0), Lighting::default()] {
                let [none, half, whole] = [0.0, 0.5, 1.0].map(|m| lit_red(material(base, m, roughness), light.clone()));
                let mean = 0.5 * (none + whole);
                // The multiple-scattering term ignores Fresnel's rise and the dielectric's part.
                assert!((half / mean - 1.0).abs() < 0.01, "{base}, {roughness}: {none} {half} {whole}");
            }
        }
    }
}

fn texture(width: u32, height: u32, rgb: impl Fn(u32, u32) -> [u8; 3], srgb: bool) -> SceneTexture {
    let texel = |i: u32| rgb(i % width, i / width);
    let rgba = (0..width * height).flat_map(|i| [texel(i)[0], texel(i)[1], texel(i)[2], 255]).collect();
    let wrap = [Wrap::Repeat; 2];
    SceneTexture { width, height, rgba: std::sync::Arc::new(rgba), srgb, wrap, smooth: true, mipmaps: true }
}

const PLAIN: TextureUse = TextureUse { texture: 0, uv_set: 0, transform: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] };

/// White under a normal map tilted by 45° to the right everywhere.
fn shade_tilted_bump(lighting: Lighting) -> f32 {
    let material = Material { normal_texture: Some(PLAIN), ..material(1.0, 0.0, 1.0) };
    let textures = vec![texture(1, 1, |_, _| [218, 128, 218], false)];
    central_red(Scene { lighting, textures, ..board(material) })
}

#[test]
fn normal_map_tilts_towards_growing_u() {
    let from = |x: f32, z: f32| shade_tilted_bump(sun(Vec3::new(x, 0.0, z), 1.0));
    assert!(
        (from(1.0, -1.0) - 1.0).abs() < 0.03 && from(-1.0, -0.9) == 0.0,
        "{} {}",
        from(1.0, -1.0),
        from(-1.0, -0.9)
    );
    // The board faces away from these suns, though the bumps do not.
    assert_eq!(from(1.0, 0.1), 0.0);
    assert!(from(1.0, -0.02) < 0.25, "{}", from(1.0, -0.02));
    // A white bump is white under a white sky: it reflects itself where it does not reflect the
    // sky.
    assert!((shade_tilted_bump(Lighting::default()) - 1.0).abs() < 0.01);
}

#[test]
fn fine_print_keeps_its_contrast_when_filtered() {
    // Stripes of two pixels, six texels: every pixel is black or white.
    let material = Material { base_color_texture: Some(PLAIN), unlit: true, ..Material::default() };
    let stripes = texture(192, 192, |x, _| [if x / 6 % 2 == 0 { 0 } else { 255 }; 3], true);
    let picture = layer_of(Scene { textures: vec![stripes], ..board(material) }, 32.0);
    let mut worst = 0.0f32;
    for x in 8..SIDE - 8 {
        let (actual, truth) = (picture[SIDE / 2 * SIDE + x][0], (x / 2 % 2) as f32);
        worst = worst.max((actual - truth).abs());
    }
    // A single trilinear tap is off by 0.18.
    assert!(worst < 0.1, "{worst}");
}

#[test]
fn texture_transform_rotates_by_the_extension() {
    // Red green over blue white. The coordinates turn by 90°, counter-clockwise on the picture: u'
    // = v, v' = −u.
    let mut model = Model::triangle();
    model.textured(&png(2, 2, &[255, 0, 0, 255, 0, 255, 0, 255, 0, 0, 255, 255, 255, 255, 255, 255]));
    let positions = model.floats("VEC3", &[-1.0, -1.0, 1.0, 1.0, -1.0, 1.0, 1.0, 1.0, 1.0, -1.0, 1.0, 1.0]);
    let uv = model.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0]);
    let indices = model.accessor(5121, "SCALAR", 6, &[0, 2, 1, 0, 3, 2]);
    *model.primitive() =
        json!({ "attributes": { "POSITION": positions, "TEXCOORD_0": uv }, "indices": indices, "material": 0 });
    model.json["samplers"] = json!([{ "magFilter": 9728, "minFilter": 9728 }]);
    model.json["textures"][0]["sampler"] = json!(0);
    model.json["materials"][0]["extensions"] = json!({ "KHR_materials_unlit": {} });
    let turn = json!({ "KHR_texture_transform": { "rotation": std::f64::consts::FRAC_PI_2 } });
    model.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["extensions"] = turn;
    model.json["extensionsUsed"] = json!(["KHR_materials_unlit", "KHR_texture_transform"]);
    let picture = layer_of(model.load().unwrap(), 16.0);
    let at = |x: usize, y: usize| picture[y * SIDE + x].map(|v| v.round() as i32);
    // The square is 32 px wide; the picture on it has turned clockwise.
    assert_eq!([at(24, 24), at(40, 24)], [[0, 0, 1, 1], [1, 0, 0, 1]], "blue, red");
    assert_eq!([at(24, 40), at(40, 40)], [[1, 1, 1, 1], [0, 1, 0, 1]], "white, green");
}
