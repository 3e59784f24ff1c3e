//! The shadow maps of a scene's objects, memoized.
//!
//! A shadow map depends on the arrangement of a group's objects and on the light. If all light is distant, it stays the same wherever
//! the group is moved on its plane.

use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3, Vec3};

use super::dimmed;
use super::extent::Extent;
use super::floor::Floor;
use super::group::Group;
use super::last::Last;
use super::occluders::Occluders;
use super::receiver_mask::ReceiverMask;
use super::room::{ABOVE_M, OccluderMask, Room};
use super::shadow_map::{Real, ShadowMap, ShadowTexture};
use super::sky::{Around, EnvSample, Ray, Sky, rays};
use super::steps::{Steps, from_steps, steps};
use crate::digest::{Digest, Digester};
use crate::memo::Memo;
use crate::render::Lightmap;
use crate::scene::{Lighting, Object, Scene};

/// Number of memoized shadow textures.
const KEPT: usize = 128;
/// Of what real things stop so many: a thing and its facets need five.
const KEPT_STOPS: usize = 128;

/// Shared by all compositors. A texture has at most 5 MB.
static SHADOW_TEXTURES: Memo<Digest, Arc<ShadowTexture>> = Memo::new(32);

/// Computes and memoizes shadow maps.
#[derive(Debug)]
pub struct Shadows {
    lighting: Lighting,
    around: Around,
    /// Far light by the floor's axes.
    rays: Memo<DMat3, Arc<[Ray]>>,
    /// From everywhere, made when it is first asked for.
    far: Option<Arc<[EnvSample]>>,
    extents: Memo<Key, Extent>,
    textures: Memo<Key, Arc<ShadowTexture>>,
    /// Rough ones.
    sketches: Memo<Key, Arc<ShadowTexture>>,
    /// Real things, and what they stop on floors of whole shadow maps.
    room: Option<Arc<Room>>,
    stops: Memo<(Floor, Key), Option<Arc<OccluderMask>>>,
    last: Option<Last>,
    dimmed: Option<Dimmed>,
}

/// The objects whose light was asked for last, and the lightmaps of their parts.
type Dimmed = (Vec<Object>, Vec<Option<Arc<Lightmap>>>);

/// All that an extent or a shadow map depends on but the scene's meshes.
#[derive(Clone, Debug, PartialEq)]
struct Key {
    sky: Arc<Sky>,
    parts: Vec<(usize, Steps)>,
    /// What real things stop there: a matter of the place in the world.
    stops: Option<Arc<OccluderMask>>,
    /// Of a facet.
    within: Option<Arc<ReceiverMask>>,
}

/// A thing's or a group's parts, placed in the world.
type Parts = Vec<(usize, DAffine3)>;

impl Shadows {
    /// For scenes of these meshes and this light.
    pub fn new(scene: &Scene) -> Self {
        Self::under(scene, Around::new(&scene.lighting.environment))
    }

    /// The same meshes are lit otherwise from now on. What the surroundings are, if they are the same, stays known.
    pub fn set_lightmaps(&mut self, scene: &Scene) {
        *self = match self.lighting.environment == scene.lighting.environment {
            true => Self { far: self.far.take(), ..Self::under(scene, self.around.clone()) },
            false => Self::new(scene),
        };
    }

    fn under(scene: &Scene, around: Around) -> Self {
        let lighting = scene.lighting.clone();
        let textures = Memo::new(KEPT);
        let (rays, extents, sketches) = (Memo::new(KEPT), Memo::new(KEPT), Memo::new(KEPT));
        Self {
            around,
            lighting,
            rays,
            far: None,
            extents,
            textures,
            sketches,
            room: None,
            stops: Memo::new(KEPT_STOPS),
            last: None,
            dimmed: None,
        }
    }

    /// Real things stop light, too, from now on.
    pub fn stand_in(&mut self, room: Option<Arc<Room>>) {
        if self.room != room {
            (self.room, self.stops) = (room, Memo::new(KEPT_STOPS));
            (self.last, self.dimmed) = (None, None);
        }
    }

    /// What real things leave of the light for the scene's objects: lightmaps of their parts, in turn.
    pub fn dimmed(&mut self, scene: &Scene) -> Vec<Option<Arc<Lightmap>>> {
        let Some(room) = &self.room else { return Vec::new() };
        if let Some((_, known)) = self.dimmed.as_ref().filter(|(objects, _)| *objects == scene.objects) {
            return known.clone();
        }
        let maps = dimmed::lightmaps(room, scene);
        self.dimmed = Some((scene.objects.clone(), maps.clone()));
        maps
    }

    /// The shadow maps of the scene's objects as they are placed.
    pub fn shadow_maps(&mut self, scene: &Scene) -> Vec<ShadowMap> {
        if let Some(shadow_maps) = self.last.as_ref().and_then(|last| last.of(&scene.objects)) {
            return shadow_maps;
        }
        let groups = self.groups(scene);
        let order = by_place(scene);
        let mut shadow_maps = Vec::new();
        for group in groups {
            let shared: Vec<usize> = order.iter().copied().filter(|index| group.objects.contains(index)).collect();
            shadow_maps.extend(self.shadow_map(scene, &shared).map(|shadow_map| (shadow_map, shared)));
        }
        for (floor, key) in self.beside(scene) {
            let texture = self.extent(scene, key.clone()).map(|extent| self.whole(scene, &floor, key, extent));
            shadow_maps.extend(texture.map(|texture| (ShadowMap { floor, texture, is_beside: true }, Vec::new())));
        }
        let last = self.last.insert(Last::new(scene.objects.clone(), shadow_maps));
        last.shadow_maps()
    }

    /// The same, soon. Where only floors have moved, and not far, as when a lens is changed, the last shadow maps go with them. Otherwise
    /// those that are not known yet are rough ones of each thing alone, and light is taken twice where two of their shadows meet. The
    /// second value is whether any is rough.
    pub fn sketched(&mut self, scene: &Scene) -> (Vec<ShadowMap>, bool) {
        if let Some(last) = &self.last {
            if let Some(shadow_maps) = last.of(&scene.objects) {
                return (shadow_maps, false);
            }
            if let Some(shadow_maps) = last.on_floors_of(scene) {
                return (shadow_maps, true);
            }
        }
        let order = by_place(scene);
        let (mut shadow_maps, mut is_rough) = (Vec::new(), false);
        for group in self.groups(scene) {
            let members: Vec<usize> = order.iter().copied().filter(|index| group.objects.contains(index)).collect();
            let known = self.keyed(scene, &members).and_then(|(floor, key)| {
                let texture = self.known(&floor, &key)?;
                Some(ShadowMap { floor, texture, is_beside: false })
            });
            is_rough |= known.is_none();
            match known {
                Some(shadow_map) => shadow_maps.push(shadow_map),
                None => {
                    let keyed: Vec<_> = members.iter().filter_map(|index| self.keyed(scene, &[*index])).collect();
                    for (floor, key) in keyed {
                        let texture = self.sketch(scene, &floor, key);
                        shadow_maps.extend(texture.map(|texture| ShadowMap { floor, texture, is_beside: false }));
                    }
                }
            }
        }
        for (floor, key) in self.beside(scene) {
            is_rough |= self.known(&floor, &key).is_none();
            let texture = self.sketch(scene, &floor, key);
            shadow_maps.extend(texture.map(|texture| ShadowMap { floor, texture, is_beside: true }));
        }
        (shadow_maps, is_rough)
    }

    /// The whole texture, if they are known, or rough ones.
    fn sketch(&mut self, scene: &Scene, floor: &Floor, key: Key) -> Option<Arc<ShadowTexture>> {
        if let Some(texture) = self.known(floor, &key) {
            return Some(texture);
        }
        let (extent, sky) = (self.extent(scene, key.clone())?, key.sky.rough());
        let stops = self.room.as_ref().and_then(|room| OccluderMask::of(room, floor, extent, &sky));
        let key = Key { stops, ..key };
        if let Some(texture) = self.sketches.get(&key) {
            return Some(texture);
        }
        let occluders = Occluders::of(scene, key.placed()).on_floor();
        let texture = Arc::new(ShadowTexture::rough(&occluders, extent, &sky, key.real()));
        self.sketches.insert(key, texture.clone());
        Some(texture)
    }

    /// The facets of all objects that take light: each with its floor, and what its shadow map depends on. Things do not share these: where
    /// two shadows meet on a facet, light that both stop is taken twice.
    fn beside(&mut self, scene: &Scene) -> Vec<(Floor, Key)> {
        let mut all = Vec::new();
        for object in by_place(scene).into_iter().map(|index| &scene.objects[index]).filter(|o| !o.shadowless) {
            let parts = parts_of(object);
            for (n, facet) in object.facets.iter().enumerate() {
                let Some(floor) = parts.first().and_then(|first| Floor::below(&facet.plane, &first.1)) else {
                    continue;
                };
                let mut key = self.key(&floor, &parts, Some(Arc::new(ReceiverMask::new(object, n, &floor))));
                if let Some(room) = &self.room {
                    key.sky = without_walled(key.sky, room, &floor, scene, object);
                }
                all.push((floor, key));
            }
        }
        all
    }

    /// The floor that objects share, and what a shadow map of them depends on.
    fn keyed(&mut self, scene: &Scene, objects: &[usize]) -> Option<(Floor, Key)> {
        let all = objects.iter().map(|i| &scene.objects[*i]);
        let support = all.clone().next()?.support?;
        let parts: Parts = all.flat_map(|o| &o.parts).map(|part| (part.mesh, part.world_from_mesh)).collect();
        let floor = Floor::below(&support, &parts.first()?.1)?;
        let key = self.key(&floor, &parts, None);
        Some((floor, key))
    }

    /// Objects with a floor, those together whose shadows may meet. In which order a scene lists them changes nothing.
    fn groups(&mut self, scene: &Scene) -> Vec<Group> {
        let mut groups: Vec<Group> = Vec::new();
        for index in by_place(scene) {
            let object = &scene.objects[index];
            let Some((floor, extent)) = self.alone(scene, object) else { continue };
            let mut own = Group { floor, extent, objects: vec![index] };
            // It may join groups that were apart.
            let mut apart = Vec::new();
            for group in groups {
                match own.meets(&group) {
                    true => own = group.joined(own),
                    false => apart.push(group),
                }
            }
            apart.push(own);
            groups = apart;
        }
        groups
    }

    /// An object's floor, and how far its shadow reaches.
    fn alone(&mut self, scene: &Scene, object: &Object) -> Option<(Floor, Extent)> {
        let support = object.support.filter(|_| !object.shadowless)?;
        let parts = parts_of(object);
        let floor = Floor::below(&support, &parts.first()?.1)?;
        let key = self.key(&floor, &parts, None);
        Some((floor, self.extent(scene, key)?))
    }

    fn extent(&mut self, scene: &Scene, key: Key) -> Option<Extent> {
        if let Some(known) = self.extents.get(&key) {
            return Some(known);
        }
        let (low, high, height) = Occluders::of(scene, key.placed()).on_floor().bounds()?;
        let extent = Extent::of(low, high, height, &key.sky);
        let extent = key.within.as_ref().map_or(extent, |within| within.clip(extent, Extent { low, high }));
        self.extents.insert(key, extent);
        Some(extent)
    }

    fn shadow_map(&mut self, scene: &Scene, objects: &[usize]) -> Option<ShadowMap> {
        let (floor, key) = self.keyed(scene, objects)?;
        let mut extent: Option<Extent> = None;
        let mut rest = key.parts.as_slice();
        for object in objects.iter().map(|i| &scene.objects[*i]) {
            let (own, others) = rest.split_at(object.parts.len());
            rest = others;
            let own = self.extent(scene, Key { parts: own.to_vec(), ..key.clone() });
            extent = match (extent, own) {
                (Some(a), Some(b)) => Some(a.union(b)),
                (a, b) => a.or(b),
            };
        }
        let texture = self.whole(scene, &floor, key, extent?);
        Some(ShadowMap { floor, texture, is_beside: false })
    }

    fn whole(&mut self, scene: &Scene, floor: &Floor, key: Key, extent: Extent) -> Arc<ShadowTexture> {
        let key = Key { stops: self.stops(floor, &key, extent), ..key };
        if let Some(texture) = self.textures.get(&key) {
            return texture;
        }
        let occluders = Occluders::of(scene, key.placed()).on_floor();
        let mut digester = Digester::default();
        digester.add(&occluders);
        digester.add(&key.real());
        digester.add(&extent);
        digester.add(&key.sky);
        let texture = SHADOW_TEXTURES.get_or_insert_with(digester.finish(), |_| {
            Arc::new(ShadowTexture::new(&occluders, extent, &key.sky, key.real()))
        });
        self.textures.insert(key, texture.clone());
        texture
    }

    /// The whole shadow map on a floor of which a key says all but what real things stop there, if it is known.
    fn known(&mut self, floor: &Floor, key: &Key) -> Option<Arc<ShadowTexture>> {
        let stops = match self.room {
            Some(_) => self.stops.get(&(*floor, key.clone()))?,
            None => None,
        };
        self.textures.get(&Key { stops, ..key.clone() })
    }

    /// What real things stop on a floor, of which a key says all else.
    fn stops(&mut self, floor: &Floor, key: &Key, extent: Extent) -> Option<Arc<OccluderMask>> {
        let room = self.room.clone()?;
        let place = (*floor, key.clone());
        if let Some(known) = self.stops.get(&place) {
            return known;
        }
        let stops = OccluderMask::of(&room, floor, extent, &key.sky);
        self.stops.insert(place, stops.clone());
        stops
    }

    /// `within`: of a facet's floor.
    fn key(&mut self, floor: &Floor, parts: &Parts, within: Option<Arc<ReceiverMask>>) -> Key {
        let rays = self.rays.get(&floor.axes).unwrap_or_else(|| {
            let rays = rays(&self.lighting, &self.around, floor);
            self.rays.insert(floor.axes, rays.clone());
            rays
        });
        let far = within.as_ref().map(|_| self.far.get_or_insert_with(|| self.around.everywhere().into()).clone());
        let sky = Arc::new(Sky::new(&self.lighting, rays, floor, far.as_deref()));
        Key {
            sky,
            stops: None,
            within,
            parts: parts.iter().map(|(mesh, from)| (*mesh, steps(&(floor.floor_from_world() * *from)))).collect(),
        }
    }
}

/// A facet is a piece of something that may go on: without the suns and the lamps behind it that real things keep from an object.
fn without_walled(sky: Arc<Sky>, room: &Room, floor: &Floor, scene: &Scene, object: &Object) -> Arc<Sky> {
    let Some(corners_m) = object.corners_m(scene) else { return sky };
    let middle_m = corners_m.into_iter().sum::<DVec3>() / 8.0;
    let is_floor =
        |at_m: DVec3| object.support.is_some_and(|plane| plane.normal.dot(at_m - plane.point_m) < f64::from(ABOVE_M));
    let is_walled = |towards: DVec3, far_m: f64| room.stands_between(middle_m, towards, far_m, is_floor);
    let of_sun = |towards: Vec3| is_walled(floor.axes * towards.as_dvec3(), f64::INFINITY);
    let of_lamp = |at_m: Vec3| {
        let way_m = floor.origin_m + floor.axes * at_m.as_dvec3() - middle_m;
        is_walled(way_m.normalize_or_zero(), way_m.length())
    };
    Arc::new(Sky::clone(&sky).behind_without(of_sun, of_lamp))
}

impl Key {
    /// Each mesh with its place on the floor.
    fn placed(&self) -> Parts {
        self.parts.iter().map(|(mesh, steps)| (*mesh, from_steps(steps))).collect()
    }

    fn real(&self) -> Real<'_> {
        Real { stops: self.stops.as_deref(), within: self.within.as_deref() }
    }
}

fn parts_of(object: &Object) -> Parts {
    object.parts.iter().map(|part| (part.mesh, part.world_from_mesh)).collect()
}

/// The objects with parts, by where the first one stands.
fn by_place(scene: &Scene) -> Vec<usize> {
    let place = |index: &usize| scene.objects[*index].parts.first().map(|part| part.world_from_mesh.translation);
    let mut order: Vec<usize> = (0..scene.objects.len()).filter(|index| place(index).is_some()).collect();
    let compared = |a: &usize, b: &usize| {
        let (a, b) = (place(a).unwrap_or_default(), place(b).unwrap_or_default());
        a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z))
    };
    order.sort_by(compared);
    order
}

#[cfg(test)]
mod tests {
    use super::super::block::block;
    use super::*;
    use crate::scene::{Environment, Facet, Material, Part, PointLight, Sun, Support};
    use glam::{DQuat, DVec3, Vec2, Vec3};

    const HALF: Vec3 = Vec3::new(0.04, 0.03, 0.05);

    /// Boxes on a floor, at places and turned about its normal.
    fn scene(lighting: Lighting, floor: &Floor, boxes: &[(f64, f64, f64)]) -> Scene {
        let world_from_floor = DAffine3 { matrix3: floor.axes, translation: floor.origin_m };
        let object = |(x, y, turn): &(f64, f64, f64)| {
            let on = DAffine3::from_rotation_translation(
                DQuat::from_rotation_z(*turn),
                DVec3::new(*x, *y, f64::from(HALF.z)),
            );
            let part = Part { mesh: 0, world_from_mesh: world_from_floor * on };
            let support = Some(Support { point_m: floor.origin_m, normal: floor.normal() });
            Object { parts: vec![part], support, ..Object::default() }
        };
        Scene {
            meshes: vec![Arc::new(block(HALF))],
            // What is black throws nothing back.
            materials: vec![Material { base_color: [0.0, 0.0, 0.0, 1.0], ..Material::default() }],
            objects: boxes.iter().map(object).collect(),
            lighting,
            ..Scene::default()
        }
    }

    fn only(shadow_map: Vec<ShadowMap>) -> ShadowMap {
        assert_eq!(shadow_map.len(), 1);
        shadow_map.into_iter().next().unwrap()
    }

    fn even_sky() -> Lighting {
        Lighting { environment: Environment::Uniform(Vec3::ONE), ..Lighting::default() }
    }

    /// Whether a ray from a place on the floor meets the box, by its six planes.
    fn meets(at: DVec3, towards: DVec3) -> bool {
        let (low, high) = (DVec3::new(-0.04, -0.03, 0.0), DVec3::new(0.04, 0.03, 0.1));
        let (a, b) = ((low - at) / towards, (high - at) / towards);
        a.min(b).max_element().max(0.0) <= a.max(b).min_element()
    }

    #[test]
    fn under_an_even_sky_it_is_what_many_rays_find() {
        let floor = Floor::new(DVec3::new(0.3, -0.2, 1.0), DVec3::new(0.2, -0.9, 0.3).normalize());
        let scene = scene(even_sky(), &floor, &[(0.0, 0.0, 0.0)]);
        let shadow_map = only(Shadows::new(&scene).shadow_maps(&scene));
        let mut worst = 0.0f64;
        for at in [(0.045, 0.0), (0.06, 0.02), (0.0, 0.04), (0.1, -0.05), (-0.15, 0.1), (0.0, 0.25), (0.02, 0.01)] {
            // Evenly over the cosine: a disc, raised to the hemisphere.
            let count = 16384;
            let stopped = (0..count).filter(|n| {
                let r = ((*n as f64 + 0.5) / count as f64).sqrt();
                let (s, c) = (*n as f64 * 2.399_963_229_728_653).sin_cos();
                let towards = DVec3::new(r * c + 1e-12, r * s + 1e-12, (1.0 - r * r).sqrt());
                meets(DVec3::new(at.0, at.1, 0.0), towards)
            });
            let truth = stopped.count() as f64 / count as f64;
            let found = shadow_map.taken_at(floor.at(glam::DVec2::new(at.0, at.1)));
            assert!(found.abs_diff_eq(Vec3::splat(found.x), 1e-4), "a grey sky: {found}");
            worst = worst.max((f64::from(found.x) - truth).abs());
        }
        // 512 rays: an edge between two of them is 1/512; a code of a mid-grey floor is 0.009.
        assert!(worst < 0.008, "{worst}");
        assert_eq!(shadow_map.taken_at(floor.at(glam::DVec2::new(3.0, 0.0))), Vec3::ZERO);
    }

    #[test]
    fn a_lamp_s_shadow_lies_where_its_rays_are_stopped_and_has_its_colour() {
        let floor = Floor::new(DVec3::ZERO, DVec3::Z);
        let world = |v: DVec3| floor.axes * v;
        let lamp = PointLight {
            position_in_world_m: world(DVec3::new(0.0, 0.0, 0.6)),
            color: Vec3::new(0.3, 0.0, 0.0),
            diameter_m: 0.06,
            range_m: f32::INFINITY,
            spot: None,
        };
        let lighting = Lighting { points: vec![lamp], ..even_sky() };
        let scene = scene(lighting, &floor, &[(0.0, 0.0, 0.0)]);
        let shadow_map = only(Shadows::new(&scene).shadow_maps(&scene));
        let at = |x: f64, y: f64| shadow_map.taken_at(floor.at(glam::DVec2::new(x, y)));
        // From 0.6 m the top at 0.1 m is thrown outwards by 0.6/0.5: its edge lies at 0.048 m, blurred by the lamp.
        let (inside, outside) = (at(0.043, 0.0), at(0.056, 0.0));
        assert!(inside.x > outside.x + 0.2, "{inside} {outside}");
        // Of the other colours only the sky's is taken.
        assert!(inside.x > inside.y + 0.15 && outside.x < outside.y, "{inside} {outside}");
    }

    #[test]
    fn what_is_shown_holds_all_that_is_worth_it_and_what_is_dark_lies_within() {
        let floor = Floor::new(DVec3::ZERO, DVec3::Z);
        let scene = scene(even_sky(), &floor, &[(0.0, 0.0, 0.0)]);
        let shares = only(Shadows::new(&scene).shadow_maps(&scene)).texture;
        let size = glam::DVec2::new(shares.width.into(), shares.height.into());
        let outside = |part: crate::shadow::Part, least: f32| {
            shares.taken.iter().enumerate().any(|(i, taken)| {
                let texel = glam::UVec2::new(i as u32 % shares.width, i as u32 / shares.width).as_dvec2();
                let is_outside = texel.cmplt(part.low * size).any() || (texel + 1.0).cmpgt(part.high * size).any();
                is_outside && taken.iter().any(|share| share.abs() > least)
            })
        };
        assert!(!outside(shares.shown, 0.003) && !outside(shares.dark, 0.05));
        let (shown, dark) = (shares.shown, shares.dark);
        assert!(
            shown.low.cmplt(dark.low).all() && dark.high.cmplt(shown.high).all(),
            "{dark:?} is not within {shown:?}"
        );
        assert!((dark.high - dark.low).element_product() < 0.3 * (shown.high - shown.low).element_product());
    }

    #[test]
    fn approximate_map_is_close_to_the_final_one_which_is_reused() {
        let floor = Floor::new(DVec3::new(0.3, -0.2, 1.0), DVec3::new(0.2, -0.9, 0.3).normalize());
        let sun =
            Sun { towards_light_in_world: Vec3::new(0.4, -0.8, 0.3).normalize(), color: Vec3::ONE, diameter_rad: 0.3 };
        let apart = scene(Lighting { suns: vec![sun], ..even_sky() }, &floor, &[(0.0, 0.0, 0.0), (1.5, 0.0, 0.3)]);
        let mut shadows = Shadows::new(&apart);
        let (rough, is_rough) = shadows.sketched(&apart);
        let exact = shadows.shadow_maps(&apart);
        assert!(is_rough && rough.len() == exact.len());
        let (mut off, mut dark, mut count) = (0.0, 0.0, 0.0);
        for (x, y) in (-20..=20).flat_map(|x| (-20..=20).map(move |y| (0.01 * f64::from(x), 0.01 * f64::from(y)))) {
            let at = floor.at(glam::DVec2::new(x, y));
            let [rough, exact] =
                [&rough, &exact].map(|all| all.iter().map(|shadow_map| shadow_map.taken_at(at).x).sum::<f32>());
            (off, dark, count) = (off + (rough - exact).abs(), dark + exact, count + 1.0);
        }
        assert!(dark / count > 0.05 && off < 0.15 * dark, "{off} of {dark}");
        // Now all is known, also where something else has moved that stands apart.
        assert_eq!(shadows.sketched(&apart), (exact.clone(), false));
        let mut moved = apart.clone();
        moved.objects[1].move_by(DAffine3::from_translation(floor.axes * DVec3::new(0.3, 0.1, 0.0)));
        let (shadow_maps, is_rough) = shadows.sketched(&moved);
        assert!(!is_rough && shadow_maps.len() == 2);
        // Where things come close, each keeps the shadow map that it has alone.
        moved.objects[1].move_by(DAffine3::from_translation(floor.axes * DVec3::new(-1.68, -0.1, 0.0)));
        let (shadow_maps, is_rough) = shadows.sketched(&moved);
        assert!(is_rough && shadow_maps.len() == 2 && shadows.shadow_maps(&moved).len() == 1);
        assert!(
            shadow_maps
                .iter()
                .all(|shadow_map| exact.iter().any(|known| Arc::ptr_eq(&known.texture, &shadow_map.texture)))
        );
    }

    #[test]
    fn floor_that_moves_a_little_reuses_the_last_map() {
        let floor = Floor::new(DVec3::new(0.3, -0.2, 1.0), DVec3::Z);
        let scene = scene(even_sky(), &floor, &[(0.0, 0.0, 0.0)]);
        let mut shadows = Shadows::new(&scene);
        let exact = only(shadows.shadow_maps(&scene));
        let moved = |tilt: f64, up_m: f64| {
            let mut moved = scene.clone();
            let (point_m, normal) = (floor.origin_m + up_m * DVec3::Z, (DVec3::Z + tilt * DVec3::X).normalize());
            moved.objects[0].support = Some(Support { point_m, normal });
            moved
        };
        let (sketch, is_rough) = shadows.sketched(&moved(0.1, -0.02));
        let sketch = only(sketch);
        assert!(is_rough && Arc::ptr_eq(&sketch.texture, &exact.texture));
        assert!(sketch.floor.normal().x > 0.09 && (sketch.floor.origin_m.z - 0.98).abs() < 0.01, "{:?}", sketch.floor);
        for (tilt, up_m) in [(0.3, 0.0), (0.0, -0.05)] {
            let (sketch, is_rough) = shadows.sketched(&moved(tilt, up_m));
            assert!(is_rough && !Arc::ptr_eq(&only(sketch).texture, &exact.texture), "{tilt} {up_m}");
        }
        let mut bare = moved(0.1, 0.0);
        bare.objects[0].shadowless = true;
        assert_eq!(shadows.sketched(&bare).0, []);
        // A whole one is of the floor as it is.
        assert!(!Arc::ptr_eq(&only(shadows.shadow_maps(&moved(0.1, 0.0))).texture, &exact.texture));
    }

    #[test]
    fn lit_otherwise_charts_are_those_of_the_new_light() {
        let floor = Floor::new(DVec3::new(0.3, -0.2, 1.0), DVec3::Z);
        let lamp = |x: f64| PointLight {
            position_in_world_m: floor.at(glam::DVec2::new(x, 0.1)) + DVec3::Z,
            color: Vec3::ONE,
            diameter_m: 0.06,
            range_m: f32::INFINITY,
            spot: None,
        };
        let of = |lighting: Lighting| scene(lighting, &floor, &[(0.0, 0.0, 0.0)]);
        let [left, right] = [-0.5, 0.5].map(|x| of(Lighting { points: vec![lamp(x)], ..even_sky() }));
        let dark = of(Lighting { points: vec![lamp(0.5)], ..Lighting::default() });
        let mut shadows = Shadows::new(&left);
        let first = shadows.shadow_maps(&left);
        // Shadow maps are compared by whether they are the very same.
        let shares = |shadow_maps: Vec<ShadowMap>| {
            shadow_maps.iter().map(|shadow_map| ShadowTexture::clone(&shadow_map.texture)).collect::<Vec<_>>()
        };
        for scene in [&right, &dark, &left] {
            shadows.set_lightmaps(scene);
            let (rough, is_rough) = shadows.sketched(scene);
            assert!(is_rough && shares(rough) == shares(Shadows::new(scene).sketched(scene).0));
            assert!(shares(shadows.shadow_maps(scene)) == shares(Shadows::new(scene).shadow_maps(scene)));
        }
        let first = shares(first);
        assert!(
            shares(shadows.shadow_maps(&left)) == first && shares(Shadows::new(&right).shadow_maps(&right)) != first
        );
    }

    #[test]
    fn a_sun_s_shadow_lies_to_the_other_side() {
        let floor = Floor::new(DVec3::ZERO, DVec3::NEG_Y);
        let towards = (floor.axes * DVec3::new(1.0, 0.0, 1.0).normalize()).as_vec3();
        let sun = Sun { towards_light_in_world: towards, color: Vec3::ONE, diameter_rad: 0.01 };
        let lighting = Lighting { suns: vec![sun], points: Vec::new(), environment: Environment::Uniform(Vec3::ZERO) };
        let scene = scene(lighting, &floor, &[(0.0, 0.0, 0.0)]);
        let shadow_map = only(Shadows::new(&scene).shadow_maps(&scene));
        let at = |x: f64, y: f64| shadow_map.taken_at(floor.at(glam::DVec2::new(x, y))).x;
        // 0.1 m high under 45°: from −0.04 m to −0.14.
        assert!(at(-0.135, 0.0) > 0.99 && at(-0.145, 0.0) < 0.01, "{} {}", at(-0.135, 0.0), at(-0.145, 0.0));
        assert!(at(-0.1, 0.027) > 0.99 && at(-0.1, 0.033) < 0.01 && at(0.05, 0.0) < 0.01);
    }

    #[test]
    fn objects_whose_shadows_meet_share_a_shadow_map() {
        let floor = Floor::new(DVec3::ZERO, DVec3::Z);
        let both = scene(even_sky(), &floor, &[(0.0, 0.0, 0.0), (0.12, 0.0, 0.4)]);
        let shadow_map = only(Shadows::new(&both).shadow_maps(&both));
        let alone = |n: usize| {
            let one = Scene { objects: vec![both.objects[n].clone()], ..both.clone() };
            only(Shadows::new(&one).shadow_maps(&one))
        };
        let between = floor.at(glam::DVec2::new(0.06, 0.0));
        let [together, left, right] =
            [&shadow_map, &alone(0), &alone(1)].map(|shadow_map| shadow_map.taken_at(between).x);
        // They stand to different sides: what one takes the other does not.
        assert!((together - left - right).abs() < 0.03 && together < 1.0, "{together} {left} {right}");
        let apart = scene(even_sky(), &floor, &[(0.0, 0.0, 0.0), (5.0, 0.0, 0.4)]);
        assert_eq!(Shadows::new(&apart).shadow_maps(&apart).len(), 2);
        let shadowless = scene(even_sky(), &floor, &[(0.0, 0.0, 0.0)]);
        let object = Object { shadowless: true, ..shadowless.objects[0].clone() };
        let shadowless = Scene { objects: vec![object], ..shadowless };
        assert!(Shadows::new(&shadowless).shadow_maps(&shadowless).is_empty());
    }

    #[test]
    fn beside_a_wall_its_shadow_falls_on_the_wall_as_a_floor_there_would_have_it() {
        let floor = Floor::new(DVec3::ZERO, DVec3::Z);
        let sun =
            Sun { towards_light_in_world: Vec3::new(-1.0, 0.0, 0.5).normalize(), color: Vec3::ONE, diameter_rad: 0.02 };
        let mut scene = scene(Lighting { suns: vec![sun], ..even_sky() }, &floor, &[(0.0, 0.0, 0.0)]);
        // A wall 4 cm to the right of the box, whose side is at 0.04 m in some turn of the floor's axes.
        let reach = scene.objects[0].points_m(&scene).map(|p| p.x).fold(f64::NEG_INFINITY, f64::max);
        let plane = Support { point_m: DVec3::new(reach + 0.04, 0.0, 0.1), normal: DVec3::NEG_X };
        let half = glam::DVec2::new(0.3, 0.1);
        let facet = Facet { plane, along: DVec3::Y, low_m: -half, high_m: half };
        scene.objects[0].facets = vec![facet];
        let mut shadows = Shadows::new(&scene);
        let (sketch, is_rough) = shadows.sketched(&scene);
        assert!(is_rough && sketch.len() == 2);
        let shadow_maps = shadows.shadow_maps(&scene);
        assert_eq!((shadow_maps.len(), shadow_maps.iter().filter(|shadow_map| shadow_map.is_beside).count()), (2, 1));
        assert_eq!(shadows.sketched(&scene), (shadow_maps.clone(), false));
        let wall = shadow_maps.iter().find(|shadow_map| shadow_map.is_beside).unwrap();
        let rough = sketch.iter().find(|shadow_map| shadow_map.is_beside).unwrap();
        // The same box stands as near to a floor that lies there, which ends nowhere.
        let mut lying = scene.clone();
        (lying.objects[0].support, lying.objects[0].facets) = (Some(plane), Vec::new());
        let lying = only(Shadows::new(&lying).shadow_maps(&lying));
        let at = |y: f64, z: f64| DVec3::new(plane.point_m.x, y, z);
        let (mut dark, mut off) = (0.0f32, 0.0f32);
        for (y, z) in (-10..=10).flat_map(|y| (3..10).map(move |z| (0.01 * f64::from(y), 0.02 * f64::from(z)))) {
            let [found, wanted] = [wall, &lying].map(|shadow_map| shadow_map.taken_at(at(y, z)).x);
            (dark, off) = (dark.max(found), off.max((found - wanted).abs()));
            assert!((rough.taken_at(at(y, z)).x - found).abs() < 0.3);
        }
        // Texels are not the same ones.
        assert!(dark > 0.5 && off < 0.06, "{dark} {off}");
        // What lies 15 mm over the floor is the floor's, and what is beyond the rectangle is something else.
        assert!(lying.taken_at(at(0.0, 0.01)).x > 0.3, "{}", lying.taken_at(at(0.0, 0.01)));
        assert_eq!([wall.taken_at(at(0.0, 0.01)), wall.taken_at(at(0.32, 0.1))], [Vec3::ZERO; 2]);
        // On the floor the box takes what it took without a wall, and shadowless nothing on either.
        let ground = shadow_maps.iter().find(|shadow_map| !shadow_map.is_beside).unwrap();
        scene.objects[0].facets.clear();
        assert_eq!(only(Shadows::new(&scene).shadow_maps(&scene)).texture, ground.texture);
        (scene.objects[0].facets, scene.objects[0].shadowless) = (vec![facet], true);
        assert_eq!(Shadows::new(&scene).shadow_maps(&scene), []);
    }

    /// A red box, and 4 cm to its right a wall of 0.2 m that faces it, in the light of a lamp.
    fn before_a_wall(at_m: DVec3, bright: f32) -> Scene {
        let floor = Floor::new(DVec3::ZERO, DVec3::Z);
        let (color, range_m) = (Vec3::splat(bright), f32::INFINITY);
        let lamp = PointLight { position_in_world_m: at_m, color, diameter_m: 0.02, range_m, spot: None };
        let lighting = Lighting { points: vec![lamp], ..even_sky() };
        let mut scene = scene(lighting, &floor, &[(0.0, 0.0, 0.0)]);
        scene.materials[0].base_color = [0.9, 0.0, 0.0, 1.0];
        let reach = scene.objects[0].points_m(&scene).map(|p| p.x).fold(f64::NEG_INFINITY, f64::max);
        let plane = Support { point_m: DVec3::new(reach + 0.04, 0.0, 0.1), normal: DVec3::NEG_X };
        let half = glam::DVec2::splat(0.1);
        scene.objects[0].facets = vec![Facet { plane, along: DVec3::Y, low_m: -half, high_m: half }];
        scene
    }

    fn on_the_wall(scene: &Scene, room: Option<Room>) -> Vec3 {
        let mut shadows = Shadows::new(scene);
        shadows.stand_in(room.map(Arc::new));
        let wall = shadows.shadow_maps(scene).into_iter().find(|shadow_map| shadow_map.is_beside).unwrap();
        wall.taken_at(scene.objects[0].facets[0].plane.point_m - 0.03 * DVec3::Z)
    }

    #[test]
    fn light_that_goes_past_a_wall_comes_back_onto_it_from_the_thing_before_it() {
        // Behind the wall and over it: the wall's front has no light of it, the box's side has.
        let low = before_a_wall(DVec3::new(0.2, 0.0, 0.9), 10.0);
        let mut high = low.clone();
        // One so high that no light goes past it.
        high.objects[0].facets[0].high_m = glam::DVec2::splat(9.0);
        high.objects[0].facets[0].low_m = glam::DVec2::splat(-9.0);
        let [low, high] = [&low, &high].map(|scene| on_the_wall(scene, None));
        assert!(low.x < high.x - 0.2 && low.x < -0.1, "{low} {high}");
        // A red thing throws no other colour.
        assert!(low.y > 0.2 && (low.y - high.y).abs() < 0.01, "{low} {high}");
    }

    #[test]
    fn light_behind_a_wall_that_goes_on_beyond_its_facet_does_not_come_past_it() {
        let low = before_a_wall(DVec3::new(0.2, 0.0, 0.9), 10.0);
        let dim = before_a_wall(DVec3::new(0.2, 0.0, 0.9), 0.0);
        let wall_m = low.objects[0].facets[0].plane.point_m.x;
        // As high as the lamp and more, every centimetre of it seen twice.
        let places = (0..2 * 120 * 150).map(|n| (n / 2 % 120, n / 240));
        let wall = Room::of(
            places.map(|(y, z)| DVec3::new(wall_m + 0.015, 0.01 * f64::from(y) - 0.595, 0.01 * f64::from(z) + 0.005)),
        );
        let [past, walled] = [None, Some(wall)].map(|room| on_the_wall(&low, room).x);
        let none = on_the_wall(&dim, None).x;
        assert!(past < none - 0.1 && (walled - none).abs() < 0.02, "{past} {walled} {none}");
    }

    #[test]
    fn a_lamp_that_real_things_keep_from_a_wall_is_not_taken_from_it() {
        let lit = before_a_wall(DVec3::new(-0.8, 0.0, 0.25), 1.0);
        let mut dim = lit.clone();
        dim.lighting.points.clear();
        // A board between the lamp and all else, every centimetre of it seen twice.
        let places = (0..2 * 60 * 60).map(|n| (n / 2 % 60, n / 120));
        let board = places.map(|(y, z)| DVec3::new(-0.4, 0.01 * f64::from(y) - 0.3, 0.01 * f64::from(z)));
        let behind = Room::of(board.map(|at_m| at_m + DVec3::splat(0.005)));
        let [open, stopped, dim] =
            [on_the_wall(&lit, None), on_the_wall(&lit, Some(behind)), on_the_wall(&dim, None)].map(|taken| taken.y);
        assert!(open > dim + 0.2 && (stopped - dim).abs() < 1e-4, "{open} {stopped} {dim}");
    }

    #[test]
    fn object_moved_on_its_floor_has_the_map_of_a_new_one() {
        let floor = Floor::new(DVec3::new(0.1, 0.2, 0.3), DVec3::new(0.1, 0.2, 0.9).normalize());
        let mut shadows = Shadows::new(&scene(even_sky(), &floor, &[]));
        let at = |x: f64, y: f64| scene(even_sky(), &floor, &[(x, y, 0.7)]);
        let first = only(shadows.shadow_maps(&at(0.0, 0.0)));
        let moved = only(shadows.shadow_maps(&at(0.731, -0.25)));
        assert!(Arc::ptr_eq(&first.texture, &moved.texture), "it was worked out again");
        let scene = at(0.731, -0.25);
        assert_eq!(*only(Shadows::new(&scene).shadow_maps(&scene)).texture, *moved.texture);
        let beside = moved.taken_at(floor.at(glam::DVec2::new(0.731, -0.25) + Vec2::new(0.0, 0.06).as_dvec2()));
        assert!(beside.x > 0.05, "{beside}");
        assert_eq!(first.taken_at(floor.at(glam::DVec2::new(0.731, -0.25))), Vec3::ZERO);
    }
}
