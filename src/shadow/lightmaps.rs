//! The lightmaps of a scene's parts, memoized.
//!
//! A part's lightmap depends on the arrangement of the objects around it, on the floors below and
//! on the lamps. If all light is distant and nothing else is near, it stays the same wherever an
//! object is moved on a floor.

use std::cell::LazyCell;
use std::sync::Arc;

use glam::{DAffine3, DVec3};

use super::bake_scene::{BakeInputs, BakeScene};
use super::lightmap::{PartSurface, lightmap};
use super::occluders::Occluders;
use super::shadow_map::{ShadowMap, ShadowTexture};
use super::sky::{EnvSample, EnvironmentImage};
use super::steps::{QuantizedTransform, dequantize, quantize, quantize_length};
use crate::digest::{Digest, Digester};
use crate::memo::{ByAddress, Memo};
use crate::quality::Quality;
use crate::render::{Lightmap, MAX_POINTS, MAX_SUNS, Unwrapped};
use crate::scene::{Lighting, Object, Part, PointLight, Scene};

/// Distance up to which an object occludes others, as a multiple of its longest side.
const OCCLUSION_REACH: f64 = 4.0;
/// Number of lightmaps that are memoized by arrangement.
const ARRANGEMENT_CAPACITY: usize = 256;
/// Memory of the lightmaps that are memoized for all compositors, bytes. A map has at most 128²
/// texels in ten layers, 2.6 MB; most take a tenth of that.
const LIGHTMAP_BUDGET_BYTES: usize = 128 << 20;

/// Lightmaps shared by all compositors.
static LIGHTMAPS: Memo<Digest, Arc<Lightmap>> =
    Memo::with_budget(LIGHTMAP_BUDGET_BYTES, |map| map.layers.iter().map(|layer| size_of_val(layer.as_slice())).sum());

/// Computes lightmaps.
#[derive(Debug)]
pub struct Lightmaps {
    lighting: ByAddress<Lighting>,
    /// Samples of the whole environment, computed on demand.
    environment: Option<Vec<EnvSample>>,
    /// Lightmaps by arrangement: also of objects that were moved as a whole, where exact inputs
    /// differ.
    by_arrangement: Memo<Arrangement, Arc<Lightmap>>,
    /// Lightmaps of all parts. Previews show the latest ones.
    of_scene: Memo<LightmapInputs, Vec<Option<Arc<Lightmap>>>>,
}

/// All inputs of a scene's lightmaps except its meshes.
#[derive(Clone, Debug, PartialEq)]
struct LightmapInputs {
    objects: Vec<Object>,
    shadow_maps: Vec<ShadowMap>,
    visibility: Vec<Option<Arc<Lightmap>>>,
    lighting: ByAddress<Lighting>,
}

/// All that a part's lightmap depends on except the scene's meshes and distant light, relative to
/// the object's origin.
#[derive(Clone, Debug, PartialEq)]
struct Arrangement {
    part: (usize, QuantizedTransform),
    occluders: Vec<(usize, QuantizedTransform)>,
    shadows: Vec<PlacedShadow>,
    lamps: Vec<[i64; 3]>,
}

/// A shadow map with the place of its plane.
#[derive(Clone, Debug, PartialEq)]
struct PlacedShadow {
    place: QuantizedTransform,
    texture: ByAddress<ShadowTexture>,
}

/// An object with its bounding box, m.
struct BoundedObject<'a> {
    object: &'a Object,
    low: DVec3,
    high: DVec3,
}

impl Lightmaps {
    /// Lightmaps for scenes of these meshes and this light.
    pub fn new(scene: &Scene) -> Self {
        Self {
            lighting: ByAddress(Arc::new(scene.lighting.clone())),
            environment: None,
            by_arrangement: Memo::new(ARRANGEMENT_CAPACITY),
            of_scene: Memo::default(),
        }
    }

    /// Replaces the light on the same meshes. If the numbers of suns and lamps stay, the latest
    /// lightmaps are previews.
    pub fn set_lighting(&mut self, scene: &Scene) {
        let count = |lighting: &Lighting| (lighting.suns.len(), lighting.points.len());
        let before = std::mem::replace(self, Self::new(scene));
        if count(&before.lighting) == count(&scene.lighting) {
            self.of_scene = before.of_scene;
        }
    }

    /// One for each part of each object, in order; `None` for a part without a surface to light.
    /// `unwrapped` are the scene's meshes, `shadow_maps` those of the floors, `visibility` the
    /// lightmaps of one texel of lights behind real objects, or empty.
    pub fn lightmaps(
        &mut self,
        scene: &Scene,
        unwrapped: &[Unwrapped],
        shadow_maps: &[ShadowMap],
        visibility: &[Option<Arc<Lightmap>>],
    ) -> Vec<Option<Arc<Lightmap>>> {
        let inputs = LightmapInputs {
            objects: scene.objects.clone(),
            shadow_maps: shadow_maps.to_vec(),
            visibility: visibility.to_vec(),
            lighting: self.lighting.clone(),
        };
        if let Some(known) = self.of_scene.get(&inputs) {
            return known;
        }
        let bounded = scene.objects.iter().filter_map(|object| BoundedObject::of(scene, object));
        let bounded: Vec<BoundedObject<'_>> = bounded.collect();
        let mut lightmaps = Vec::new();
        for object in &scene.objects {
            let own = bounded.iter().find(|bounded| std::ptr::eq(bounded.object, object));
            let maps = own.map(|own| self.of_object(scene, unwrapped, shadow_maps, own, &bounded));
            lightmaps.extend(maps.unwrap_or_else(|| vec![None; object.parts.len()]));
        }
        for (map, visibility) in lightmaps.iter_mut().zip(visibility) {
            if let Some(visibility) = visibility {
                let map_or_all = map.take().map(|map| Arc::new(attenuated(&map, visibility)));
                *map = Some(map_or_all.unwrap_or_else(|| visibility.clone()));
            }
        }
        self.of_scene.insert(inputs, lightmaps)
    }

    /// The latest lightmaps, if the scene has the same parts, wherever they are now; and whether
    /// they are final.
    pub fn preview(&self, scene: &Scene) -> (Vec<Option<Arc<Lightmap>>>, Quality) {
        let meshes =
            |objects: &[Object]| objects.iter().flat_map(|o| &o.parts).map(|part| part.mesh).collect::<Vec<_>>();
        let quality = |is_final: bool| if is_final { Quality::Final } else { Quality::Preview };
        match self.of_scene.latest() {
            Some((of, lightmaps)) if meshes(&of.objects) == meshes(&scene.objects) => {
                (lightmaps, quality(of.lighting == self.lighting && of.objects == scene.objects))
            }
            _ => (Vec::new(), quality(scene.objects.is_empty())),
        }
    }

    fn of_object(
        &mut self,
        scene: &Scene,
        unwrapped: &[Unwrapped],
        shadow_maps: &[ShadowMap],
        own: &BoundedObject<'_>,
        all: &[BoundedObject<'_>],
    ) -> Vec<Option<Arc<Lightmap>>> {
        let origin_m = own.object.world_from_model.translation;
        let near = all.iter().filter(|other| std::ptr::eq(other.object, own.object) || other.occludes(own));
        let occluders: Vec<_> = near
            .flat_map(|other| &other.object.parts)
            .map(|part| (part.mesh, quantize(&relative(origin_m, &part.world_from_mesh))))
            .collect();
        let shadow = |shadow_map: &ShadowMap| {
            let place = DAffine3 { matrix3: shadow_map.floor.axes, translation: shadow_map.floor.origin_m };
            PlacedShadow { place: quantize(&relative(origin_m, &place)), texture: shadow_map.texture.clone() }
        };
        let shadows: Vec<_> = shadow_maps.iter().map(shadow).collect();
        let lamp = |lamp: &PointLight| (lamp.position_in_world_m - origin_m).to_array().map(quantize_length);
        let lamps: Vec<_> = self.lighting.points.iter().map(lamp).collect();
        let arrangement = |part: &Part| Arrangement {
            part: (part.mesh, quantize(&relative(origin_m, &part.world_from_mesh))),
            occluders: occluders.clone(),
            shadows: shadows.clone(),
            lamps: lamps.clone(),
        };
        let surface = |part: &Part| unwrapped.get(part.mesh).filter(|unwrapped| unwrapped.side > 0);
        let parts: Vec<_> = own.object.parts.iter().map(|part| (surface(part), arrangement(part))).collect();
        let known = |(surface, key): &(Option<_>, _)| surface.and_then(|_: &Unwrapped| self.by_arrangement.get(key));
        let mut maps: Vec<_> = parts.iter().map(known).collect();
        let is_missing = |(map, (surface, _)): (&Option<_>, &(Option<_>, _))| map.is_none() && surface.is_some();
        if !maps.iter().zip(&parts).any(is_missing) {
            return maps;
        }
        // All parts of an object share a scene.
        let occluders = Occluders::of(scene, occluders.iter().map(|(mesh, steps)| (*mesh, dequantize(steps))));
        let environment =
            self.environment.get_or_insert_with(|| EnvironmentImage::new(&self.lighting.environment).sphere_samples());
        let inputs = BakeInputs {
            origin_m,
            occluders: &occluders,
            environment,
            lighting: &self.lighting,
            shadow_maps,
            max_lights: [MAX_SUNS, MAX_POINTS],
        };
        let bake_scene = LazyCell::new(|| BakeScene::new(&inputs));
        let mut digester = Digester::default();
        digester.add(&inputs);
        for (map, (unwrapped, key)) in maps.iter_mut().zip(parts) {
            let (None, Some(unwrapped)) = (&map, unwrapped) else { continue };
            let (mesh, place) = &key.part;
            let material = scene.materials.get(scene.meshes[*mesh].material);
            let double_sided = material.is_some_and(|material| material.double_sided);
            let surface = PartSurface { unwrapped, scene_from_mesh: dequantize(place), double_sided };
            let mut digester = digester.clone();
            digester.add(&surface);
            let baked = LIGHTMAPS.get_or_insert_with(digester.finish(), |_| Arc::new(lightmap(&surface, &bake_scene)));
            self.by_arrangement.insert(key, baked.clone());
            *map = Some(baked);
        }
        maps
    }
}

impl<'a> BoundedObject<'a> {
    fn of(scene: &Scene, object: &'a Object) -> Option<Self> {
        let (low, high) =
            object.points_m(scene).fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
        (low.is_finite() && high.is_finite()).then_some(Self { object, low, high })
    }

    /// True if it is near enough to another one to occlude it.
    fn occludes(&self, other: &Self) -> bool {
        let distance = (self.low - other.high).max(other.low - self.high).max(DVec3::ZERO).length();
        !self.object.shadowless && distance < OCCLUSION_REACH * (self.high - self.low).max_element()
    }
}

/// A lightmap whose visibility of suns and lamps is multiplied by that of a lightmap of one texel.
fn attenuated(map: &Lightmap, visibility: &Lightmap) -> Lightmap {
    let layer = |(n, layer): (usize, &Vec<[f32; 4]>)| {
        // A back has layers of its own.
        let n = n % visibility.layers.len();
        let fractions = visibility.layers[n].first().copied().unwrap_or([1.0; 4]);
        // The first two layers have one light each, the others four.
        let factor = |i: usize| if n < 2 && i < 3 { 1.0 } else { fractions[i] };
        let factors: [f32; 4] = std::array::from_fn(factor);
        layer.iter().map(|texel| std::array::from_fn(|i| texel[i] * factors[i])).collect()
    };
    Lightmap { side: map.side, layers: map.layers.iter().enumerate().map(layer).collect() }
}

/// A transform relative to a point.
fn relative(origin_m: DVec3, place: &DAffine3) -> DAffine3 {
    DAffine3 { matrix3: place.matrix3, translation: place.translation - origin_m }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::TexelPoint;
    use crate::scene::{Environment, Material, Mesh, Sun, Vertex};
    use glam::{DQuat, Vec3};

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
        let object = |mesh: usize| Object {
            parts: vec![Part { mesh, world_from_mesh: DAffine3::IDENTITY }],
            ..Object::default()
        };
        Scene {
            meshes: meshes.to_vec(),
            materials: vec![Material {
                base_color: [reflectance, reflectance, reflectance, 1.0],
                ..Material::default()
            }],
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

    fn unwrapped(scene: &Scene) -> Vec<Unwrapped> {
        scene.meshes.iter().map(|mesh| Unwrapped::new(mesh, 32)).collect()
    }

    /// The first part's lightmap, and where in the mesh each of its texels lies, but for those in
    /// the corner at the wall.
    fn first(scene: &Scene) -> (Arc<Lightmap>, Vec<(Vec3, TexelPoint)>) {
        let unwrapped = unwrapped(scene);
        let found = Lightmaps::new(scene).lightmaps(scene, &unwrapped, &[], &[]);
        let own = &unwrapped[0];
        let at = |place: &TexelPoint| {
            let corner = |n: usize| own.corners[own.indices[3 * place.triangle as usize + n] as usize].vertex.position;
            (0..3).map(|n| place.weights[n] * Vec3::from(corner(n))).sum::<Vec3>()
        };
        let places = own.places().into_iter().map(|place| (at(&place), place));
        (found[0].clone().unwrap(), places.filter(|(at, _)| at.x < 0.099).collect())
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
                assert!(
                    (open[0] - open[1]).abs() < 1e-5 && (open[0] - open[2]).abs() < 1e-5 && open[3] == 1.0,
                    "{open:?}"
                );
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
        let lighting =
            Lighting { points: [0.1, 0.2, 0.3].map(|x| lamp(DVec3::new(x, 0.0, 1.0))).to_vec(), ..even_sky() };
        let mut scene = scene(&[plate(), wall()], 0.5, lighting);
        scene.materials[0].double_sided = true;
        let unwrapped = unwrapped(&scene);
        let open = Lightmaps::new(&scene).lightmaps(&scene, &unwrapped, &[], &[]);
        let layers = [[1.0, 1.0, 1.0, 0.5], [0.0, 0.0, 0.0, 0.25], [0.125, 1.0, 1.0, 1.0]];
        let dim = Arc::new(Lightmap { side: 1, layers: layers.map(|texel| vec![texel]).to_vec() });
        let behind = Lightmaps::new(&scene).lightmaps(&scene, &unwrapped, &[], &[Some(dim), None]);
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
        let mut maps = Lightmaps::new(&scene);
        let moved = |object: &mut Object, by: DAffine3| object.move_by(by);
        moved(&mut scene.objects[1], DAffine3::from_translation(DVec3::new(5.0, 0.0, 0.0)));
        let alone = maps.lightmaps(&scene, &unwrapped, &[], &[]);
        moved(&mut scene.objects[0], DAffine3::from_translation(DVec3::new(0.37, 0.1, 0.0)));
        let beside = maps.lightmaps(&scene, &unwrapped, &[], &[]);
        assert!(Arc::ptr_eq(alone[0].as_ref().unwrap(), beside[0].as_ref().unwrap()), "it was worked out again");
        moved(&mut scene.objects[0], DAffine3::from_rotation_translation(DQuat::IDENTITY, DVec3::new(4.5, -0.1, 0.0)));
        let near = maps.lightmaps(&scene, &unwrapped, &[], &[]);
        let least =
            |map: &Option<Arc<Lightmap>>| map.as_ref().unwrap().layers[0].iter().map(|t| t[0]).fold(1.0, f32::min);
        assert_eq!(maps.preview(&scene), (near.clone(), Quality::Final));
        assert!(least(&alone[0]) == 1.0 && least(&near[0]) < 0.9, "{}", least(&near[0]));
        // Under a sky of another colour the preview is the last map until a final one is requested.
        // With another lamp there is no preview.
        scene.lighting.environment = Environment::Uniform(Vec3::new(0.5, 0.4, 0.3));
        maps.set_lighting(&scene);
        assert_eq!(maps.preview(&scene), (near.clone(), Quality::Preview));
        assert_eq!(
            maps.lightmaps(&scene, &unwrapped, &[], &[]),
            Lightmaps::new(&scene).lightmaps(&scene, &unwrapped, &[], &[])
        );
        assert_eq!(maps.preview(&scene).1, Quality::Final);
        let mut lamps = scene.clone();
        lamps.lighting.points.push(lamp(DVec3::new(0.0, 0.0, 3.0)));
        maps.set_lighting(&lamps);
        assert_eq!(maps.preview(&lamps), (Vec::new(), Quality::Preview));
        maps.set_lighting(&scene);
        let near = maps.lightmaps(&scene, &unwrapped, &[], &[]);
        // Something without a shadow takes nothing.
        scene.objects[1].shadowless = true;
        assert_eq!(maps.preview(&scene), (near.clone(), Quality::Preview));
        assert_eq!(least(&maps.lightmaps(&scene, &unwrapped, &[], &[])[0]), 1.0);
        assert_eq!(
            Lightmaps::new(&scene).lightmaps(&scene, &unwrapped, &[], &[]),
            maps.lightmaps(&scene, &unwrapped, &[], &[])
        );
    }
}
