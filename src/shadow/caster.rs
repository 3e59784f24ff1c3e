//! Objects as casters of a shadow: all that their planar shadow depends on except its rectangle and
//! real occluders.

use std::sync::Arc;

use super::occluders::Occluders;
use super::receiver_mask::ReceiverMask;
use super::receiver_plane::ReceiverPlane;
use super::sky::PlaneLighting;
use super::steps::{MICROMETRES, QuantizedTransform};
use crate::digest::{Digest, Digester};
use crate::scene::{Object, Scene};

/// Parts of objects above a receiver plane, and the light on it.
#[derive(Clone, Debug)]
pub struct ShadowCaster {
    pub sky: Arc<PlaneLighting>,
    /// The receiver mask of a facet.
    pub receiver: Option<Arc<ReceiverMask>>,
    /// Mesh and place of each part in the plane's axes.
    parts: Vec<(usize, QuantizedTransform)>,
    digest: Digest,
}

/// Makes casters of one scene's meshes.
#[derive(Debug, Default)]
pub struct CasterBuilder {
    /// Digests of the meshes with their materials, computed on demand. No memo: all of one scene,
    /// by index.
    meshes: Vec<Option<Digest>>,
}

impl CasterBuilder {
    /// The scene must have the same meshes and materials in every call.
    pub fn caster<'a>(
        &mut self,
        scene: &Scene,
        objects: impl IntoIterator<Item = &'a Object>,
        plane: &ReceiverPlane,
        sky: Arc<PlaneLighting>,
        receiver: Option<ReceiverMask>,
    ) -> ShadowCaster {
        let plane_from_world = plane.plane_from_world();
        let parts = objects.into_iter().flat_map(|object| &object.parts);
        let parts: Vec<_> =
            parts.map(|part| (part.mesh, MICROMETRES.quantize(&(plane_from_world * part.world_from_mesh)))).collect();
        let mut digester = Digester::default();
        digester.add(&sky);
        digester.add(&receiver);
        for (mesh, place) in &parts {
            digester.add(&self.mesh(scene, *mesh));
            digester.add_numbers(place);
        }
        ShadowCaster { sky, receiver: receiver.map(Arc::new), parts, digest: digester.finish() }
    }

    fn mesh(&mut self, scene: &Scene, mesh: usize) -> Digest {
        if self.meshes.len() <= mesh {
            self.meshes.resize(mesh + 1, None);
        }
        *self.meshes[mesh].get_or_insert_with(|| Digest::of(&Occluders::of(scene, [(mesh, glam::DAffine3::IDENTITY)])))
    }
}

impl ShadowCaster {
    /// Digest of all fields.
    pub fn digest(&self) -> Digest {
        self.digest
    }

    /// Triangles above the plane.
    pub fn occluders(&self, scene: &Scene) -> Occluders {
        Occluders::of(scene, self.parts.iter().map(|(mesh, place)| (*mesh, MICROMETRES.dequantize(place)))).on_floor()
    }
}
