//! The planar shadows of a scene's objects.
//!
//! A planar shadow depends on the arrangement of a group's objects and on the light. If all light
//! is distant, it stays the same wherever the group is moved on its plane. Results are memoized by
//! the digests of all their inputs, for all compositors of the process.

use std::sync::Arc;

use glam::{DMat3, DVec3, Vec3};

use super::caster::{CasterBuilder, ShadowCaster};
use super::extent::Extent;
use super::group::ShadowGroup;
use super::light_visibility;
use super::moved_planes::{GroupShadow, on_planes_of};
use super::planar_shadow::{PlanarShadow, RealOcclusion, ShadowTexture};
use super::receiver_mask::ReceiverMask;
use super::receiver_plane::ReceiverPlane;
use super::room::{MIN_HEIGHT_M, OccluderMask, Room};
use super::sky::{EnvSample, EnvironmentImage, PlaneLighting, SkyRay, rays};
use crate::digest::{Digest, Digester};
use crate::memo::{ByAddress, Memo};
use crate::quality::Quality;
use crate::render::Lightmap;
use crate::scene::{Lighting, Object, Scene};

/// Number of memoized extents, occluder masks and directions of planes.
const MEMO_CAPACITY: usize = 256;
/// Memory of the memoized shadow textures, bytes. A texture takes at most 5 MB, most a tenth of
/// that.
const TEXTURE_BUDGET_BYTES: usize = 256 << 20;

/// Results of all compositors.
static SHADOW_MEMO: ShadowMemo = ShadowMemo::new();

/// Derived data by the digests of its inputs.
#[derive(Debug)]
struct ShadowMemo {
    extents: Memo<Digest, Option<Extent>>,
    occluder_masks: Memo<Digest, Option<Arc<OccluderMask>>>,
    textures: Memo<Digest, Arc<ShadowTexture>>,
}

impl ShadowMemo {
    const fn new() -> Self {
        Self {
            extents: Memo::new(MEMO_CAPACITY),
            occluder_masks: Memo::new(MEMO_CAPACITY),
            textures: Memo::with_budget(TEXTURE_BUDGET_BYTES, |texture| texture.size_bytes()),
        }
    }
}

/// Computes planar shadows.
#[derive(Debug)]
pub struct Shadows {
    lighting: Lighting,
    environment: Arc<EnvironmentImage>,
    memo: &'static ShadowMemo,
    casters: CasterBuilder,
    /// Distant light by the axes of the receiver plane.
    rays: Memo<DMat3, Arc<[SkyRay]>>,
    /// Real objects, and their digest: an input, digested when it is set.
    room: Option<(Arc<Room>, Digest)>,
    /// Final planar shadows. Previews move the latest ones.
    planar_shadows: Memo<ShadowInputs, Arc<[GroupShadow]>>,
    /// Lightmaps of one texel for the parts of objects.
    light_visibility: Memo<ShadowInputs, Vec<Option<Arc<Lightmap>>>>,
    runs: u64,
    visibility_runs: u64,
}

/// All inputs of a scene's planar shadows except its meshes and light.
#[derive(Clone, Debug, PartialEq)]
struct ShadowInputs {
    objects: Vec<Object>,
    room: Option<Digest>,
}

impl Shadows {
    /// Shadows for scenes of these meshes and this light.
    pub fn new(scene: &Scene) -> Self {
        Self::with_memo(scene, Arc::new(EnvironmentImage::new(&scene.lighting.environment)), &SHADOW_MEMO)
    }

    fn with_memo(scene: &Scene, environment: Arc<EnvironmentImage>, memo: &'static ShadowMemo) -> Self {
        Self {
            lighting: scene.lighting.clone(),
            environment,
            memo,
            casters: CasterBuilder::default(),
            rays: Memo::new(MEMO_CAPACITY),
            room: None,
            planar_shadows: Memo::default(),
            light_visibility: Memo::default(),
            runs: 0,
            visibility_runs: 0,
        }
    }

    /// Replaces the light on the same meshes. The image of an unchanged environment stays.
    pub fn set_lighting(&mut self, scene: &Scene) {
        let is_same = self.lighting.environment == scene.lighting.environment;
        let image = || Arc::new(EnvironmentImage::new(&scene.lighting.environment));
        let environment = if is_same { self.environment.clone() } else { image() };
        *self = Self::with_memo(scene, environment, self.memo);
    }

    /// The environment of the scene's light.
    pub fn environment(&self) -> &Arc<EnvironmentImage> {
        &self.environment
    }

    /// Sets the real objects that block light, too.
    pub fn set_room(&mut self, room: Option<Arc<Room>>) {
        if self.room.as_ref().map(|(room, _)| room) != room.as_ref() {
            self.room = room.map(|room| {
                let digest = Digest::of(&*room);
                (room, digest)
            });
        }
    }

    fn inputs(&self, scene: &Scene) -> ShadowInputs {
        ShadowInputs { objects: scene.objects.clone(), room: self.room.as_ref().map(|(_, digest)| *digest) }
    }

    /// The fraction of suns and lamps that real objects leave visible from the scene's objects:
    /// lightmaps of one texel for their parts, in order.
    pub fn light_visibility(&mut self, scene: &Scene) -> Vec<Option<Arc<Lightmap>>> {
        let inputs = self.inputs(scene);
        let Some((room, _)) = &self.room else { return Vec::new() };
        self.light_visibility.get_or_insert_with(inputs, |_| {
            self.visibility_runs += 1;
            light_visibility::lightmaps(room, scene)
        })
    }

    /// Number of computations of planar shadows, previews included, since the light was set.
    pub fn runs(&self) -> u64 {
        self.runs
    }

    /// Number of computations of [`Shadows::light_visibility`] since the light was set.
    pub fn visibility_runs(&self) -> u64 {
        self.visibility_runs
    }

    /// The planar shadows of the scene's objects as they are placed, and their quality: final ones
    /// may be memoized where previews are requested.
    pub fn planar_shadows(&mut self, scene: &Scene, quality: Quality) -> (Vec<PlanarShadow>, Quality) {
        let inputs = self.inputs(scene);
        let ungrouped = |shadows: &[GroupShadow]| shadows.iter().map(|shadow| shadow.planar_shadow.clone()).collect();
        if let Some(planar_shadows) = self.planar_shadows.get(&inputs) {
            return (ungrouped(&planar_shadows), Quality::Final);
        }
        self.runs += 1;
        if quality.is_preview() {
            return self.preview_shadows(scene, &inputs);
        }
        let shadows = self.final_shadows(scene).into();
        (ungrouped(&self.planar_shadows.insert(inputs, shadows)), Quality::Final)
    }

    fn final_shadows(&mut self, scene: &Scene) -> Vec<GroupShadow> {
        let mut planar_shadows = Vec::new();
        for members in self.groups(scene) {
            let planar_shadow = self.group_planar_shadow(scene, &members);
            planar_shadows.extend(planar_shadow.map(|planar_shadow| GroupShadow { planar_shadow, members }));
        }
        for (plane, caster) in self.facets(scene) {
            let Some(extent) = self.extent(scene, &caster) else { continue };
            let texture = ByAddress(self.texture(scene, &plane, &caster, extent));
            let planar_shadow = PlanarShadow { plane, texture, is_beside: true };
            planar_shadows.push(GroupShadow { planar_shadow, members: Vec::new() });
        }
        planar_shadows
    }

    /// Where only planes moved, and not far, as when a lens is changed, the latest planar shadows
    /// move with them. Elsewhere a group without a memoized planar shadow gets a preview for each
    /// of its objects, so that light is subtracted twice where two of their shadows meet.
    fn preview_shadows(&mut self, scene: &Scene, inputs: &ShadowInputs) -> (Vec<PlanarShadow>, Quality) {
        let latest = self.planar_shadows.latest().filter(|(of, _)| of.room == inputs.room);
        if let Some(planar_shadows) = latest.and_then(|(of, shadows)| on_planes_of(scene, &of.objects, &shadows)) {
            return (planar_shadows, Quality::Preview);
        }
        let (mut planar_shadows, mut quality) = (Vec::new(), Quality::Final);
        for members in self.groups(scene) {
            let memoized_shadow = self.group_caster(scene, &members).and_then(|(plane, caster, extent)| {
                let texture = self.memoized_texture(&plane, &caster, extent)?;
                Some(PlanarShadow { plane, texture: ByAddress(texture), is_beside: false })
            });
            if let Some(planar_shadow) = memoized_shadow {
                planar_shadows.push(planar_shadow);
                continue;
            }
            quality = Quality::Preview;
            for member in members {
                let Some((plane, caster, extent)) = self.group_caster(scene, &[member]) else { continue };
                let (texture, _) = self.preview_texture(scene, &plane, &caster, extent);
                planar_shadows.push(PlanarShadow { plane, texture: ByAddress(texture), is_beside: false });
            }
        }
        for (plane, caster) in self.facets(scene) {
            let Some(extent) = self.extent(scene, &caster) else { continue };
            let (texture, of_texture) = self.preview_texture(scene, &plane, &caster, extent);
            quality = quality.min(of_texture);
            planar_shadows.push(PlanarShadow { plane, texture: ByAddress(texture), is_beside: true });
        }
        (planar_shadows, quality)
    }

    /// The final texture if it is known, else a preview.
    fn preview_texture(
        &mut self,
        scene: &Scene,
        plane: &ReceiverPlane,
        caster: &ShadowCaster,
        extent: Extent,
    ) -> (Arc<ShadowTexture>, Quality) {
        if let Some(texture) = self.memoized_texture(plane, caster, extent) {
            return (texture, Quality::Final);
        }
        let sky = caster.sky.sparse();
        let mask = self.room.as_ref().and_then(|(room, _)| OccluderMask::of(room, plane, extent, &sky));
        let real = RealOcclusion { blocked: mask.as_deref(), receiver: caster.receiver.as_deref() };
        let key = texture_key(caster, extent, &real, Quality::Preview);
        let texture = self.memo.textures.get_or_insert_with(key, |_| {
            Arc::new(ShadowTexture::new(&caster.occluders(scene), extent, &sky, real, Quality::Preview))
        });
        (texture, Quality::Preview)
    }

    fn texture(
        &mut self,
        scene: &Scene,
        plane: &ReceiverPlane,
        caster: &ShadowCaster,
        extent: Extent,
    ) -> Arc<ShadowTexture> {
        let mask = self.room.as_ref().and_then(|(room, digest)| {
            let compute = |_: &Digest| OccluderMask::of(room, plane, extent, &caster.sky);
            self.memo.occluder_masks.get_or_insert_with(mask_key(digest, plane, caster, extent), compute)
        });
        let real = RealOcclusion { blocked: mask.as_deref(), receiver: caster.receiver.as_deref() };
        self.memo.textures.get_or_insert_with(texture_key(caster, extent, &real, Quality::Final), |_| {
            Arc::new(ShadowTexture::new(&caster.occluders(scene), extent, &caster.sky, real, Quality::Final))
        })
    }

    /// The final texture, if it is memoized.
    fn memoized_texture(
        &self,
        plane: &ReceiverPlane,
        caster: &ShadowCaster,
        extent: Extent,
    ) -> Option<Arc<ShadowTexture>> {
        let mask = match &self.room {
            Some((_, digest)) => self.memo.occluder_masks.get(&mask_key(digest, plane, caster, extent))?,
            None => None,
        };
        let real = RealOcclusion { blocked: mask.as_deref(), receiver: caster.receiver.as_deref() };
        self.memo.textures.get(&texture_key(caster, extent, &real, Quality::Final))
    }

    fn group_planar_shadow(&mut self, scene: &Scene, members: &[usize]) -> Option<PlanarShadow> {
        let (plane, caster, extent) = self.group_caster(scene, members)?;
        let texture = ByAddress(self.texture(scene, &plane, &caster, extent));
        Some(PlanarShadow { plane, texture, is_beside: false })
    }

    /// The facets of all objects that cast shadows: each with its plane and its caster. Objects do
    /// not share these: where two shadows meet on a facet, light that both block is subtracted
    /// twice.
    fn facets(&mut self, scene: &Scene) -> Vec<(ReceiverPlane, ShadowCaster)> {
        let mut all = Vec::new();
        for object in sorted_by_position(scene).into_iter().map(|index| &scene.objects[index]).filter(|o| !o.shadowless)
        {
            for (n, facet) in object.facets.iter().enumerate() {
                let first = object.parts.first();
                let Some(plane) = first.and_then(|first| ReceiverPlane::below(&facet.plane, &first.world_from_mesh))
                else {
                    continue;
                };
                let mut sky = self.sky(&plane, Some(&self.environment.sphere_samples()));
                if let Some((room, _)) = &self.room {
                    sky = without_occluded_back_lights(sky, room, &plane, scene, object);
                }
                let receiver = ReceiverMask::new(object, n, &plane);
                all.push((plane, self.casters.caster(scene, [object], &plane, sky, Some(receiver))));
            }
        }
        all
    }

    /// Indices of objects on a plane, those together whose shadows may meet. The order in which a
    /// scene lists them does not matter.
    fn groups(&mut self, scene: &Scene) -> Vec<Vec<usize>> {
        let order = sorted_by_position(scene);
        let mut groups: Vec<ShadowGroup> = Vec::new();
        for index in &order {
            let Some((plane, _, extent)) = self.group_caster(scene, &[*index]) else { continue };
            let mut own = ShadowGroup { plane, extent, objects: vec![*index] };
            // It may join groups that were apart.
            let mut apart = Vec::new();
            for group in groups {
                if own.overlaps(&group) {
                    own = group.joined(own);
                } else {
                    apart.push(group);
                }
            }
            apart.push(own);
            groups = apart;
        }
        let in_order =
            |group: &ShadowGroup| order.iter().copied().filter(|index| group.objects.contains(index)).collect();
        groups.iter().map(in_order).collect()
    }

    /// The plane that objects share, their caster, and the rectangle of their shadow: the union of
    /// each one's.
    fn group_caster(&mut self, scene: &Scene, members: &[usize]) -> Option<(ReceiverPlane, ShadowCaster, Extent)> {
        let objects: Vec<&Object> = members.iter().map(|index| &scene.objects[*index]).collect();
        let first = objects.first()?;
        let support = first.support.filter(|_| !first.shadowless)?;
        let plane = ReceiverPlane::below(&support, &first.parts.first()?.world_from_mesh)?;
        let sky = self.sky(&plane, None);
        let mut extent: Option<Extent> = None;
        for object in &objects {
            let alone = self.casters.caster(scene, [*object], &plane, sky.clone(), None);
            let own = self.extent(scene, &alone);
            extent = extent.into_iter().chain(own).reduce(Extent::union);
        }
        let caster = self.casters.caster(scene, objects, &plane, sky, None);
        Some((plane, caster, extent?))
    }

    fn extent(&self, scene: &Scene, caster: &ShadowCaster) -> Option<Extent> {
        self.memo.extents.get_or_insert_with(caster.digest(), |_| {
            let (low, high, height) = caster.occluders(scene).bounds()?;
            let extent = Extent::of(low, high, height, &caster.sky);
            let receiver = caster.receiver.as_ref();
            Some(receiver.map_or(extent, |receiver| receiver.clip(extent, Extent { low, high })))
        })
    }

    /// Light on a plane. `environment`: for a facet, all samples of the environment.
    fn sky(&self, plane: &ReceiverPlane, environment: Option<&[EnvSample]>) -> Arc<PlaneLighting> {
        let compute = |_: &DMat3| rays(&self.lighting, &self.environment, plane);
        let rays = self.rays.get_or_insert_with(plane.axes, compute);
        Arc::new(PlaneLighting::new(&self.lighting, rays, plane, environment))
    }
}

fn texture_key(caster: &ShadowCaster, extent: Extent, real: &RealOcclusion<'_>, quality: Quality) -> Digest {
    let mut digester = Digester::default();
    digester.add(&caster.digest());
    digester.add(&extent);
    digester.add(&real.blocked);
    digester.add(&quality);
    digester.finish()
}

fn mask_key(room: &Digest, plane: &ReceiverPlane, caster: &ShadowCaster, extent: Extent) -> Digest {
    let mut digester = Digester::default();
    digester.add(room);
    digester.add(plane);
    digester.add(&caster.digest());
    digester.add(&extent);
    digester.finish()
}

/// Removes suns and lamps behind a facet that real objects hide from the virtual object. A facet
/// may be a part of a larger surface.
fn without_occluded_back_lights(
    sky: Arc<PlaneLighting>,
    room: &Room,
    plane: &ReceiverPlane,
    scene: &Scene,
    object: &Object,
) -> Arc<PlaneLighting> {
    let Some(corners_m) = object.corners_m(scene) else { return sky };
    let middle_m = corners_m.into_iter().sum::<DVec3>() / 8.0;
    let is_receiver = |at_m: DVec3| object.support.is_some_and(|plane| plane.height_m(at_m) < f64::from(MIN_HEIGHT_M));
    let is_walled = |towards: DVec3, far_m: f64| room.blocks(middle_m, towards, far_m, is_receiver);
    let of_sun = |towards: Vec3| is_walled(plane.axes * towards.as_dvec3(), f64::INFINITY);
    let of_lamp = |at_m: Vec3| {
        let way_m = plane.origin_m + plane.axes * at_m.as_dvec3() - middle_m;
        is_walled(way_m.normalize_or_zero(), way_m.length())
    };
    Arc::new(PlaneLighting::clone(&sky).without_back_lights(of_sun, of_lamp))
}

/// Indices of the objects that have parts, sorted by the position of the first part.
fn sorted_by_position(scene: &Scene) -> Vec<usize> {
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
#[path = "shadows_tests.rs"]
mod tests;
