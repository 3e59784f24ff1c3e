//! Shadow maps moved with planes that changed a little: previews, as while a lens is changed.

use super::receiver_plane::ReceiverPlane;
use super::shadow_map::ShadowMap;
use crate::scene::{Object, Scene};

/// Smallest cosine of the tilt of a plane with a reused shadow map: 10°.
const MIN_TILT_COSINE: f64 = 0.985;
/// Largest distance of a plane with a reused shadow map, m.
const MAX_OFFSET_M: f64 = 0.03;

/// A shadow map, with the indices of the objects that share its plane; none on a facet.
#[derive(Clone, Debug)]
pub struct GroupShadowMap {
    pub shadow_map: ShadowMap,
    pub members: Vec<usize>,
}

/// Shadow maps of `objects` on the planes of a scene, if these differ little and nothing else
/// changed. Those on facets are not moved.
pub fn on_planes_of(scene: &Scene, objects: &[Object], maps: &[GroupShadowMap]) -> Option<Vec<ShadowMap>> {
    let is_same =
        |(a, b): (&Object, &Object)| Object { support: b.support, facets: b.facets.clone(), ..a.clone() } == *b;
    if objects.len() != scene.objects.len() || !objects.iter().zip(&scene.objects).all(is_same) {
        return None;
    }
    let on_plane = |GroupShadowMap { shadow_map, members }: &GroupShadowMap| {
        if shadow_map.is_beside {
            return Some(shadow_map.clone());
        }
        let first = &scene.objects[*members.first()?];
        let floor = ReceiverPlane::below(&first.support?, &first.parts.first()?.world_from_mesh)?;
        let tilt = shadow_map.floor.normal().dot(floor.normal());
        let is_near = tilt > MIN_TILT_COSINE && shadow_map.floor.height_m(floor.origin_m).abs() < MAX_OFFSET_M;
        is_near.then(|| ShadowMap { floor, ..shadow_map.clone() })
    };
    maps.iter().map(on_plane).collect()
}
