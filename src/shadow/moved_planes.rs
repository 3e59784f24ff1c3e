//! Planar shadows moved with planes that changed a little: previews, as while a lens is changed.

use super::planar_shadow::PlanarShadow;
use super::receiver_plane::ReceiverPlane;
use crate::scene::{Object, Scene};

/// Smallest cosine of the tilt of a plane with a reused planar shadow: 10°.
const MIN_TILT_COSINE: f64 = 0.985;
/// Largest distance of a plane with a reused planar shadow, m.
const MAX_OFFSET_M: f64 = 0.03;

/// A planar shadow, with the indices of the objects that share its plane; none on a facet.
#[derive(Clone, Debug)]
pub struct GroupShadow {
    pub planar_shadow: PlanarShadow,
    pub members: Vec<usize>,
}

/// Planar shadows of `objects` on the planes of a scene, if these differ little and nothing else
/// changed. Those on facets are not moved.
pub fn on_planes_of(scene: &Scene, objects: &[Object], shadows: &[GroupShadow]) -> Option<Vec<PlanarShadow>> {
    let is_same =
        |(a, b): (&Object, &Object)| Object { support: b.support, facets: b.facets.clone(), ..a.clone() } == *b;
    if objects.len() != scene.objects.len() || !objects.iter().zip(&scene.objects).all(is_same) {
        return None;
    }
    let on_plane = |GroupShadow { planar_shadow, members }: &GroupShadow| {
        if planar_shadow.is_beside {
            return Some(planar_shadow.clone());
        }
        let first = &scene.objects[*members.first()?];
        let plane = ReceiverPlane::below(&first.support?, &first.parts.first()?.world_from_mesh)?;
        let tilt = planar_shadow.plane.normal().dot(plane.normal());
        let is_near = tilt > MIN_TILT_COSINE && planar_shadow.plane.height_m(plane.origin_m).abs() < MAX_OFFSET_M;
        is_near.then(|| PlanarShadow { plane, ..planar_shadow.clone() })
    };
    shadows.iter().map(on_plane).collect()
}
