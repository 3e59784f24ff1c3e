//! The shadow maps that were made last: for the same things, and for floors that have moved a
//! little.

use super::floor::Floor;
use super::shadow_map::ShadowMap;
use crate::scene::{Object, Scene};

/// A shadow map may be of another floor that differs less: cosine of its tilt (10°), and metres.
const NEAR_TILT: f64 = 0.985;
const NEAR_HEIGHT_M: f64 = 0.03;

/// The objects that were asked for last, and their shadow maps, each with the numbers of the
/// objects that share a floor.
#[derive(Debug)]
pub struct Last {
    objects: Vec<Object>,
    shadow_maps: Vec<(ShadowMap, Vec<usize>)>,
}

impl Last {
    pub fn new(objects: Vec<Object>, shadow_maps: Vec<(ShadowMap, Vec<usize>)>) -> Self {
        Self { objects, shadow_maps }
    }

    pub fn shadow_maps(&self) -> Vec<ShadowMap> {
        self.shadow_maps.iter().map(|(shadow_map, _)| shadow_map.clone()).collect()
    }

    /// The shadow maps, if these are the objects.
    pub fn of(&self, objects: &[Object]) -> Option<Vec<ShadowMap>> {
        (self.objects == objects).then(|| self.shadow_maps())
    }

    /// The shadow maps moved to floors that are a little different, with nothing else changed.
    /// Those beside stay where they were.
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
            let floor = Floor::below(&first.support?, &first.parts.first()?.world_from_mesh)?;
            let tilt = shadow_map.floor.normal().dot(floor.normal());
            let is_near = tilt > NEAR_TILT && shadow_map.floor.height_m(floor.origin_m).abs() < NEAR_HEIGHT_M;
            is_near.then(|| ShadowMap { floor, ..shadow_map.clone() })
        };
        self.shadow_maps.iter().map(on_floor).collect()
    }
}
