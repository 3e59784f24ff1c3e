//! Which things take light from which, and the lightmaps that are known already.
//!
//! A part's lightmap depends on how what is near stands to it, on the floors below, and on the lamps. So it is the same one
//! wherever a thing is moved to on a floor, as long as nothing else is near and all light comes from far away.

use std::cell::LazyCell;
use std::sync::Arc;

use glam::{DAffine3, DVec3};

use super::lightmap::{Among, Room, Surface, lightmap};
use super::occluders::Occluders;
use super::shadow_map::{ShadowMap, ShadowTexture};
use super::sky::{Around, EnvSample};
use super::steps::{Steps, from_steps, step, steps};
use crate::digest::{Digest, Digester};
use crate::memo::Memo;
use crate::render::{Lightmap, MAX_POINTS, MAX_SUNS, Unwrapped};
use crate::scene::{Lighting, Object, Part, PointLight, Scene};

/// A thing takes light from others as far away as this, times its own longest side.
const REACH: f64 = 4.0;
/// So many lightmaps are kept, the ones used last.
const KEPT: usize = 256;

/// For all compositors: of forty things with three parts each. A map has at most 128² texels in ten layers, 2.6 MB; most are a tenth
/// of that.
static LIGHTMAPS: Memo<Digest, Arc<Lightmap>> = Memo::new(128);

/// Works out lightmaps, and keeps them.
#[derive(Debug)]
pub struct Lightmaps {
    lighting: Lighting,
    /// Made when it is first asked for.
    far: Option<Vec<EnvSample>>,
    kept: Memo<Key, Arc<Lightmap>>,
    last: Option<Last>,
}

/// What was asked for last, and what was answered.
#[derive(Debug)]
struct Last {
    objects: Vec<Object>,
    shadow_maps: Vec<ShadowMap>,
    dimmed: Vec<Option<Arc<Lightmap>>>,
    found: Vec<Option<Arc<Lightmap>>>,
    /// In a light that is another now.
    is_of_before: bool,
}

/// All that a part's lightmap depends on but the scene's meshes and far light. Places are told from the object's.
#[derive(Clone, Debug, PartialEq)]
struct Key {
    part: (usize, Steps),
    occluders: Vec<(usize, Steps)>,
    floors: Vec<Floor>,
    lamps: Vec<[i64; 3]>,
}

/// Where a floor lies, and what reaches it. Two are the same where the shares are the very same.
#[derive(Clone, Debug)]
struct Floor {
    place: Steps,
    texture: Arc<ShadowTexture>,
}

impl PartialEq for Floor {
    fn eq(&self, other: &Self) -> bool {
        self.place == other.place && Arc::ptr_eq(&self.texture, &other.texture)
    }
}

/// An object with the box around it, metres.
struct SceneItem<'a> {
    object: &'a Object,
    low: DVec3,
    high: DVec3,
}

impl Lightmaps {
    /// For scenes of these meshes and this light.
    pub fn new(scene: &Scene) -> Self {
        Self { lighting: scene.lighting.clone(), far: None, kept: Memo::new(KEPT), last: None }
    }

    /// The same meshes are lit otherwise from now on. Until lightmaps are worked out anew, the last ones are rough ones, if as many suns
    /// and lamps shine.
    pub fn set_lightmaps(&mut self, scene: &Scene) {
        let count = |lighting: &Lighting| (lighting.suns.len(), lighting.points.len());
        let last = self.last.take().filter(|_| count(&self.lighting) == count(&scene.lighting));
        *self = Self { last: last.map(|last| Last { is_of_before: true, ..last }), ..Self::new(scene) };
    }

    /// One for each part of each object, in turn, as they are placed; `None` where nothing takes any light. `unwrapped` are the
    /// scene's meshes, `shadow_maps` what its objects take of the floors' light, `dimmed` what real things leave of lamps' light for each
    /// part, or nothing.
    pub fn of(
        &mut self,
        scene: &Scene,
        unwrapped: &[Unwrapped],
        shadow_maps: &[ShadowMap],
        dimmed: &[Option<Arc<Lightmap>>],
    ) -> Vec<Option<Arc<Lightmap>>> {
        let is_same = |last: &&Last| {
            !last.is_of_before
                && last.objects == scene.objects
                && last.shadow_maps == shadow_maps
                && last.dimmed == dimmed
        };
        if let Some(last) = self.last.as_ref().filter(is_same) {
            return last.found.clone();
        }
        let things: Vec<SceneItem<'_>> =
            scene.objects.iter().filter_map(|object| SceneItem::of(scene, object)).collect();
        let mut found = Vec::new();
        for object in &scene.objects {
            let own = things.iter().find(|thing| std::ptr::eq(thing.object, object));
            let maps = own.map(|own| self.of_thing(scene, unwrapped, shadow_maps, own, &things));
            found.extend(maps.unwrap_or_else(|| vec![None; object.parts.len()]));
        }
        for (map, dim) in found.iter_mut().zip(dimmed) {
            if let Some(dim) = dim {
                *map = Some(map.take().map_or_else(|| dim.clone(), |map| Arc::new(under(&map, dim))));
            }
        }
        self.last = Some(Last {
            objects: scene.objects.clone(),
            shadow_maps: shadow_maps.to_vec(),
            dimmed: dimmed.to_vec(),
            found: found.clone(),
            is_of_before: false,
        });
        found
    }

    /// The same, soon: those that were asked for last, if the scene has the same things, wherever they are now. The second value is
    /// whether any is missing or may be another.
    pub fn sketched(&self, scene: &Scene) -> (Vec<Option<Arc<Lightmap>>>, bool) {
        let meshes =
            |objects: &[Object]| objects.iter().flat_map(|o| &o.parts).map(|part| part.mesh).collect::<Vec<_>>();
        match &self.last {
            Some(last) if meshes(&last.objects) == meshes(&scene.objects) => {
                (last.found.clone(), last.is_of_before || last.objects != scene.objects)
            }
            _ => (Vec::new(), !scene.objects.is_empty()),
        }
    }

    fn of_thing(
        &mut self,
        scene: &Scene,
        unwrapped: &[Unwrapped],
        shadow_maps: &[ShadowMap],
        own: &SceneItem<'_>,
        things: &[SceneItem<'_>],
    ) -> Vec<Option<Arc<Lightmap>>> {
        let origin_m = own.object.world_from_model.translation;
        let near = things.iter().filter(|thing| std::ptr::eq(thing.object, own.object) || thing.reaches(own));
        let occluders: Vec<_> = near
            .flat_map(|thing| &thing.object.parts)
            .map(|part| (part.mesh, steps(&around(origin_m, &part.world_from_mesh))))
            .collect();
        let floor = |shadow_map: &ShadowMap| {
            let place = DAffine3 { matrix3: shadow_map.floor.axes, translation: shadow_map.floor.origin_m };
            Floor { place: steps(&around(origin_m, &place)), texture: shadow_map.texture.clone() }
        };
        let floors: Vec<_> = shadow_maps.iter().map(floor).collect();
        let lamp = |lamp: &PointLight| (lamp.position_in_world_m - origin_m).to_array().map(step);
        let lamps: Vec<_> = self.lighting.points.iter().map(lamp).collect();
        let key = |part: &Part| Key {
            part: (part.mesh, steps(&around(origin_m, &part.world_from_mesh))),
            occluders: occluders.clone(),
            floors: floors.clone(),
            lamps: lamps.clone(),
        };
        let parts = own.object.parts.iter();
        let asked: Vec<_> = parts.map(|part| (unwrapped.get(part.mesh).filter(|u| u.side > 0), key(part))).collect();
        let mut maps: Vec<_> = asked.iter().map(|(surface, key)| surface.and_then(|_| self.kept.get(key))).collect();
        let lacks = |(map, (surface, _)): (&Option<_>, &(Option<_>, Key))| map.is_none() && surface.is_some();
        if !maps.iter().zip(&asked).any(lacks) {
            return maps;
        }
        // All parts of a thing stand in one room.
        let occluders = Occluders::of(scene, occluders.iter().map(|(mesh, steps)| (*mesh, from_steps(steps))));
        let far = self.far.get_or_insert_with(|| Around::new(&self.lighting.environment).everywhere());
        let (lighting, most) = (&self.lighting, [MAX_SUNS, MAX_POINTS]);
        let among = Among { origin_m, occluders: &occluders, far, lighting, floors: shadow_maps, most };
        let room = LazyCell::new(|| Room::new(&among));
        let mut digester = Digester::default();
        digester.add(&among);
        for (map, (unwrapped, key)) in maps.iter_mut().zip(asked) {
            let (None, Some(unwrapped)) = (&map, unwrapped) else { continue };
            let (mesh, place) = &key.part;
            let material = scene.materials.get(scene.meshes[*mesh].material);
            let double_sided = material.is_some_and(|material| material.double_sided);
            let surface = Surface { unwrapped, place: from_steps(place), double_sided };
            let mut digester = digester.clone();
            digester.add(&surface);
            let made = LIGHTMAPS.get_or_insert_with(digester.finish(), |_| Arc::new(lightmap(&surface, &room)));
            self.kept.insert(key, made.clone());
            *map = Some(made);
        }
        maps
    }
}

impl<'a> SceneItem<'a> {
    fn of(scene: &Scene, object: &'a Object) -> Option<Self> {
        let (low, high) =
            object.points_m(scene).fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
        (low.is_finite() && high.is_finite()).then_some(Self { object, low, high })
    }

    /// Whether it may take light from another.
    fn reaches(&self, other: &Self) -> bool {
        let apart = (self.low - other.high).max(other.low - self.high).max(DVec3::ZERO).length();
        !self.object.shadowless && apart < REACH * (self.high - self.low).max_element()
    }
}

/// A lightmap of which suns and lamps reach no more than the shares of one texel.
fn under(map: &Lightmap, dim: &Lightmap) -> Lightmap {
    let layer = |(n, layer): (usize, &Vec<[f32; 4]>)| {
        // A back has layers of its own.
        let n = n % dim.layers.len();
        let shares = dim.layers[n].first().copied().unwrap_or([1.0; 4]);
        // The first two have one light each, the others four.
        let share = |i: usize| if n < 2 && i < 3 { 1.0 } else { shares[i] };
        let factors: [f32; 4] = std::array::from_fn(share);
        layer.iter().map(|texel| std::array::from_fn(|i| texel[i] * factors[i])).collect()
    };
    Lightmap { side: map.side, layers: map.layers.iter().enumerate().map(layer).collect() }
}

/// A place, told from a point.
fn around(origin_m: DVec3, place: &DAffine3) -> DAffine3 {
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

    /// At x = 0.1, 20 m long, facing the plate.
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

    /// The first part's lightmap, and where in the mesh each of its texels lies, but for those in the corner at the wall.
    fn first(scene: &Scene) -> (Arc<Lightmap>, Vec<(Vec3, TexelPoint)>) {
        let unwrapped = unwrapped(scene);
        let found = Lightmaps::new(scene).of(scene, &unwrapped, &[], &[]);
        let own = &unwrapped[0];
        let at = |place: &TexelPoint| {
            let corner = |n: usize| own.corners[own.indices[3 * place.triangle as usize + n] as usize].vertex.position;
            (0..3).map(|n| place.weights[n] * Vec3::from(corner(n))).sum::<Vec3>()
        };
        let places = own.places().into_iter().map(|place| (at(&place), place));
        (found[0].clone().unwrap(), places.filter(|(at, _)| at.x < 0.099).collect())
    }

    #[test]
    fn what_nothing_stands_before_gets_all_light_to_the_last_bit() {
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
    fn beside_a_wall_a_place_sees_as_much_less_of_the_sky_as_the_wall_fills_and_the_wall_s_own_light() {
        let filled = |distance: f32| 0.5 * (1.0 - distance / WALL_M.hypot(distance));
        for reflectance in [0.0, 0.8] {
            let (map, places) = first(&scene(&[plate(), wall()], reflectance, even_sky()));
            for (at, place) in places {
                let distance = 0.1 - at.x;
                // The wall's outline crosses some 45 of the 512 patches of the sky, each half right: 0.017 rms, and three times that
                // at the worst of many places.
                let (open, thrown) = (map.layers[0][place.texel as usize], map.layers[1][place.texel as usize]);
                assert!((open[0] - (1.0 - filled(distance))).abs() < 0.05, "{at}: {} {}", open[0], filled(distance));
                assert!(
                    (open[0] - open[1]).abs() < 1e-5 && (open[0] - open[2]).abs() < 1e-5 && open[3] == 1.0,
                    "{open:?}"
                );
                // The wall sees the sky with all of its view, but for what the plate hides below it.
                let wanted = reflectance * filled(distance);
                for (c, sky) in [1.0, 2.0, 3.0].into_iter().enumerate() {
                    let off = (thrown[c] / sky - wanted).abs();
                    assert!(off < 0.15 * wanted + 0.015, "{at}: {} for {wanted}", thrown[c] / sky);
                }
            }
        }
    }

    #[test]
    fn behind_a_wall_lamps_and_suns_are_not_seen_and_each_has_its_own_share() {
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
            // The wall hides what comes from beyond it: the first lamp is seen from 0.8 m on, and the plate ends before.
            assert_eq!((a[3], b[3], c[0], c[1], c[2]), (1.0, 0.0, 0.0, 1.0, 0.0), "{at}");
            // A black sky's share does not matter; what the wall throws is there.
            assert!(b[0] > 0.0);
        }
    }

    #[test]
    fn the_back_of_a_double_sided_surface_has_its_own() {
        let mut scene = scene(&[plate(), wall()], 0.5, even_sky());
        scene.materials[0].double_sided = true;
        let (map, places) = first(&scene);
        assert_eq!(map.layers.len(), 4);
        // The wall stands on the plate's upper side alone.
        for (at, place) in places.iter().filter(|(at, _)| at.x > 0.0) {
            let [front, back] = [0, 2].map(|layer| map.layers[layer][place.texel as usize][0]);
            assert!(front < 0.75 && back == 1.0, "{at}: {front} {back}");
        }
    }

    #[test]
    fn what_real_things_stop_is_taken_of_each_lamp_and_of_nothing_else() {
        let lighting =
            Lighting { points: [0.1, 0.2, 0.3].map(|x| lamp(DVec3::new(x, 0.0, 1.0))).to_vec(), ..even_sky() };
        let mut scene = scene(&[plate(), wall()], 0.5, lighting);
        scene.materials[0].double_sided = true;
        let unwrapped = unwrapped(&scene);
        let open = Lightmaps::new(&scene).of(&scene, &unwrapped, &[], &[]);
        let layers = [[1.0, 1.0, 1.0, 0.5], [0.0, 0.0, 0.0, 0.25], [0.125, 1.0, 1.0, 1.0]];
        let dim = Arc::new(Lightmap { side: 1, layers: layers.map(|texel| vec![texel]).to_vec() });
        let behind = Lightmaps::new(&scene).of(&scene, &unwrapped, &[], &[Some(dim), None]);
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
    fn a_moved_thing_keeps_its_lightmap_and_one_that_comes_near_changes_it() {
        let mut scene = scene(&[cube(), cube()], 0.5, even_sky());
        let unwrapped = unwrapped(&scene);
        let mut maps = Lightmaps::new(&scene);
        let moved = |object: &mut Object, by: DAffine3| object.move_by(by);
        moved(&mut scene.objects[1], DAffine3::from_translation(DVec3::new(5.0, 0.0, 0.0)));
        let alone = maps.of(&scene, &unwrapped, &[], &[]);
        moved(&mut scene.objects[0], DAffine3::from_translation(DVec3::new(0.37, 0.1, 0.0)));
        let beside = maps.of(&scene, &unwrapped, &[], &[]);
        assert!(Arc::ptr_eq(alone[0].as_ref().unwrap(), beside[0].as_ref().unwrap()), "it was worked out again");
        moved(&mut scene.objects[0], DAffine3::from_rotation_translation(DQuat::IDENTITY, DVec3::new(4.5, -0.1, 0.0)));
        let near = maps.of(&scene, &unwrapped, &[], &[]);
        let least =
            |map: &Option<Arc<Lightmap>>| map.as_ref().unwrap().layers[0].iter().map(|t| t[0]).fold(1.0, f32::min);
        assert_eq!(maps.sketched(&scene), (near.clone(), false));
        assert!(least(&alone[0]) == 1.0 && least(&near[0]) < 0.9, "{}", least(&near[0]));
        // Under a sky of another colour it is the one of before until it is asked for; with a lamp more there is none.
        scene.lighting.environment = Environment::Uniform(Vec3::new(0.5, 0.4, 0.3));
        maps.set_lightmaps(&scene);
        assert_eq!(maps.sketched(&scene), (near.clone(), true));
        assert_eq!(maps.of(&scene, &unwrapped, &[], &[]), Lightmaps::new(&scene).of(&scene, &unwrapped, &[], &[]));
        assert!(!maps.sketched(&scene).1);
        let mut lamps = scene.clone();
        lamps.lighting.points.push(lamp(DVec3::new(0.0, 0.0, 3.0)));
        maps.set_lightmaps(&lamps);
        assert_eq!(maps.sketched(&lamps), (Vec::new(), true));
        maps.set_lightmaps(&scene);
        let near = maps.of(&scene, &unwrapped, &[], &[]);
        // Something without a shadow takes nothing.
        scene.objects[1].shadowless = true;
        assert_eq!(maps.sketched(&scene), (near.clone(), true));
        assert_eq!(least(&maps.of(&scene, &unwrapped, &[], &[])[0]), 1.0);
        assert_eq!(Lightmaps::new(&scene).of(&scene, &unwrapped, &[], &[]), maps.of(&scene, &unwrapped, &[], &[]));
    }
}
