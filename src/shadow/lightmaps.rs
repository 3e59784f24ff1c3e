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
use super::planar_shadow::{PlanarShadow, ShadowTexture};
use super::receiver_plane::ReceiverPlane;
use super::sky::EnvironmentImage;
use super::steps::{MICROMETRES, NANOMETRES, QuantizedTransform};
use crate::digest::{Digest, Digester};
use crate::memo::{ByAddress, Memo};
use crate::quality::Quality;
use crate::render::{Lightmap, MAX_POINTS, MAX_SUNS, UnwrappedMesh};
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
    environment: Arc<EnvironmentImage>,
    /// Lightmaps by arrangement: also of objects that were moved as a whole, where exact inputs
    /// differ.
    by_arrangement: Memo<Arrangement, Arc<Lightmap>>,
    /// Lightmaps of all parts. Previews show the latest ones.
    of_scene: Memo<LightmapInputs, Vec<Option<Arc<Lightmap>>>>,
    runs: u64,
}

/// All inputs of a scene's lightmaps except its meshes.
#[derive(Clone, Debug, PartialEq)]
struct LightmapInputs {
    objects: Vec<Object>,
    planar_shadows: Vec<PlanarShadow>,
    visibility: Vec<Option<Arc<Lightmap>>>,
    lighting: ByAddress<Lighting>,
}

/// All that a part's lightmap depends on except the scene's meshes and distant light, relative to
/// the object's origin. It is baked from these places, not from the exact ones, so that it does not
/// depend on which of the equal arrangements came first.
#[derive(Clone, Debug, PartialEq)]
struct Arrangement {
    part: (usize, QuantizedTransform),
    occluders: Vec<(usize, QuantizedTransform)>,
    shadows: Vec<PlacedShadow>,
    lamps: Vec<[i64; 3]>,
}

/// A planar shadow with the place of its plane.
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
    /// Lightmaps for scenes of these meshes and this light, whose environment is given.
    pub fn new(scene: &Scene, environment: &Arc<EnvironmentImage>) -> Self {
        Self {
            lighting: ByAddress(Arc::new(scene.lighting.clone())),
            environment: environment.clone(),
            by_arrangement: Memo::new(ARRANGEMENT_CAPACITY),
            of_scene: Memo::default(),
            runs: 0,
        }
    }

    /// Replaces the light on the same meshes. If the numbers of suns and lamps stay, the latest
    /// lightmaps are previews.
    pub fn set_lighting(&mut self, scene: &Scene, environment: &Arc<EnvironmentImage>) {
        let count = |lighting: &Lighting| (lighting.suns.len(), lighting.points.len());
        let before = std::mem::replace(self, Self::new(scene, environment));
        if count(&before.lighting) == count(&scene.lighting) {
            self.of_scene = before.of_scene;
        }
    }

    /// One for each part of each object, in order; `None` for a part without a surface to light.
    /// `unwrapped` are the scene's meshes, `planar_shadows` those of the floors, `visibility` the
    /// lightmaps of one texel of lights behind real objects, or empty.
    pub fn lightmaps(
        &mut self,
        scene: &Scene,
        unwrapped: &[UnwrappedMesh],
        planar_shadows: &[PlanarShadow],
        visibility: &[Option<Arc<Lightmap>>],
    ) -> Vec<Option<Arc<Lightmap>>> {
        let inputs = LightmapInputs {
            objects: scene.objects.clone(),
            planar_shadows: planar_shadows.to_vec(),
            visibility: visibility.to_vec(),
            lighting: self.lighting.clone(),
        };
        if let Some(lightmaps) = self.of_scene.get(&inputs) {
            return lightmaps;
        }
        self.runs += 1;
        let bounded = scene.objects.iter().filter_map(|object| BoundedObject::of(scene, object));
        let bounded: Vec<BoundedObject<'_>> = bounded.collect();
        let mut lightmaps = Vec::new();
        for object in &scene.objects {
            let own = bounded.iter().find(|bounded| std::ptr::eq(bounded.object, object));
            let maps = own.map(|own| self.of_object(scene, unwrapped, planar_shadows, own, &bounded));
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

    /// Number of computations of a scene's lightmaps since the light was set.
    pub fn runs(&self) -> u64 {
        self.runs
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
        unwrapped: &[UnwrappedMesh],
        planar_shadows: &[PlanarShadow],
        own: &BoundedObject<'_>,
        all: &[BoundedObject<'_>],
    ) -> Vec<Option<Arc<Lightmap>>> {
        let origin_m = own.object.world_from_model.translation;
        let near = all.iter().filter(|other| std::ptr::eq(other.object, own.object) || other.occludes(own));
        let occluders: Vec<_> = near
            .flat_map(|other| &other.object.parts)
            .map(|part| (part.mesh, MICROMETRES.quantize(&relative(origin_m, &part.world_from_mesh))))
            .collect();
        let shadows: Vec<_> = planar_shadows.iter().map(|shadow| PlacedShadow::new(origin_m, shadow)).collect();
        let lamp = |lamp: &PointLight| NANOMETRES.quantize_point(lamp.position_in_world_m - origin_m);
        let lamps: Vec<_> = self.lighting.points.iter().map(lamp).collect();
        let arrangement = |part: &Part| Arrangement {
            part: (part.mesh, MICROMETRES.quantize(&relative(origin_m, &part.world_from_mesh))),
            occluders: occluders.clone(),
            shadows: shadows.clone(),
            lamps: lamps.clone(),
        };
        let surface = |part: &Part| unwrapped.get(part.mesh).filter(|unwrapped| unwrapped.side > 0);
        let parts: Vec<_> = own.object.parts.iter().map(|part| (surface(part), arrangement(part))).collect();
        let cached =
            |(surface, key): &(Option<_>, _)| surface.and_then(|_: &UnwrappedMesh| self.by_arrangement.get(key));
        let mut maps: Vec<_> = parts.iter().map(cached).collect();
        let is_missing = |(map, (surface, _)): (&Option<_>, &(Option<_>, _))| map.is_none() && surface.is_some();
        if !maps.iter().zip(&parts).any(is_missing) {
            return maps;
        }
        // All parts of an object share a scene.
        let occluders =
            Occluders::of(scene, occluders.iter().map(|(mesh, steps)| (*mesh, MICROMETRES.dequantize(steps))));
        let planar_shadows: Vec<_> = shadows.iter().map(PlacedShadow::planar_shadow).collect();
        let mut lighting = Lighting { suns: self.lighting.suns.clone(), ..Lighting::default() };
        let placed = |(lamp, steps): (&PointLight, &[i64; 3])| PointLight {
            position_in_world_m: NANOMETRES.dequantize_point(*steps),
            ..*lamp
        };
        lighting.points = self.lighting.points.iter().zip(&lamps).map(placed).collect();
        let environment = self.environment.sphere_samples();
        let inputs = BakeInputs {
            occluders: &occluders,
            environment: &environment,
            lighting: &lighting,
            planar_shadows: &planar_shadows,
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
            let surface = PartSurface { unwrapped, scene_from_mesh: MICROMETRES.dequantize(place), double_sided };
            let mut digester = digester.clone();
            digester.add(&surface);
            let baked = LIGHTMAPS.get_or_insert_with(digester.finish(), |_| Arc::new(lightmap(&surface, &bake_scene)));
            self.by_arrangement.insert(key, baked.clone());
            *map = Some(baked);
        }
        maps
    }
}

impl PlacedShadow {
    fn new(origin_m: DVec3, planar_shadow: &PlanarShadow) -> Self {
        let place = DAffine3 { matrix3: planar_shadow.plane.axes, translation: planar_shadow.plane.origin_m };
        Self { place: NANOMETRES.quantize(&relative(origin_m, &place)), texture: planar_shadow.texture.clone() }
    }

    /// The planar shadow relative to the object's origin.
    fn planar_shadow(&self) -> PlanarShadow {
        let place = NANOMETRES.dequantize(&self.place);
        let plane = ReceiverPlane { origin_m: place.translation, axes: place.matrix3 };
        PlanarShadow { plane, texture: self.texture.clone(), is_beside: false }
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
#[path = "lightmaps_tests.rs"]
mod tests;
