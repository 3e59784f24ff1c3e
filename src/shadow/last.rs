//! The shadow maps of the last request, for the same objects, also on planes that moved a little.

use super::receiver_plane::ReceiverPlane;
use super::shadow_map::ShadowMap;
use crate::scene::{Object, Scene};

/// Smallest cosine of the tilt of a plane with a reused shadow map: 10°.
const MIN_TILT_COSINE: f64 = 0.985;
/// Largest distance of a plane with a reused shadow map, m.
const MAX_OFFSET_M: f64 = 0.03;

/// The objects of the last request, and their shadow maps, each with the indices of the objects
/// that share a plane.
#[derive(Debug)]
pub struct LastShadowMaps {
    objects: Vec<Object>,
    shadow_maps: Vec<(ShadowMap, Vec<usize>)>,
}

impl LastShadowMaps {
    pub fn new(objects: Vec<Object>, shadow_maps: Vec<(ShadowMap, Vec<usize>)>) -> Self {
        Self { objects, shadow_maps }
    }

    pub fn shadow_maps(&self) -> Vec<ShadowMap> {
        self.shadow_maps.iter().map(|(shadow_map, _)| shadow_map.clone()).collect()
    }

    /// The shadow maps, if the objects are the same.
    pub fn of(&self, objects: &[Object]) -> Option<Vec<ShadowMap>> {
        (self.objects == objects).then(|| self.shadow_maps())
    }

    /// The shadow maps moved to planes that differ a little, if nothing else changed. Those on
    /// facets are not moved.
    pub fn on_floors_of(&self, scene: &Scene) -> Option<Vec<ShadowMap>> {
        let is_same =
            |(a, b): (&Object, &Object)| Object { support: b.support, facets: b.facets.clone(), ..a.clone() } == *b;
        if self.objects.len() != scene.objects.len() || !self.objects.iter().zip(&scene.objects).all(is_same) {
            return None;
        }
        let on_floor = |(shadow_map, members): &(ShadowMap, Vec<usize>)| {
            if shadow_map.is_beside {
                return Some(shadow_map.clone());
            }
            let first = &scene.objects[*members.first()?];
            let floor = ReceiverPlane::below(&first.support?, &first.parts.first()?.world_from_mesh)?;
            let tilt = shadow_map.floor.normal().dot(floor.normal());
            let is_near = tilt > MIN_TILT_COSINE && shadow_map.floor.height_m(floor.origin_m).abs() < MAX_OFFSET_M;
            is_near.then(|| ShadowMap { floor, ..shadow_map.clone() })
        };
        self.shadow_maps.iter().map(on_floor).collect()
    }
}
