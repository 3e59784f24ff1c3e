//! What a scene's objects stand on and what takes their shadows, to be told.

use super::Shot;
use super::facets::facets;
use crate::analyse::Ground;
use crate::scene::Object;

impl Shot {
    /// Of each object. None where neither the scene nor the recording says where up is. The recording's depth is read.
    pub fn grounds(&self) -> Vec<Ground> {
        let Some(up) = self.up() else { return Vec::new() };
        let points = self.depth_points();
        let of = |object: &Object| {
            let (support, known_by) = self.support_of(object, &points)?;
            let points_m: Vec<_> = object.points_m(&self.scene).collect();
            let mut ground = Ground::new(&object.name, (known_by, &support), up, &points_m);
            for facet in facets(&self.scene, object, &support, &points) {
                ground.take(&facet, up, &points_m);
            }
            Some(ground)
        };
        self.scene.objects.iter().filter_map(of).collect()
    }
}
