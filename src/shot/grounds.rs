//! What a scene's objects stand on and what takes their shadows, to be told.

use super::Shot;
use super::facets::facets;
use crate::analyse::SupportReport;
use crate::scene::Object;

impl Shot {
    /// Of each object that has a surface. None where nobody says where up is; a scene's file does, or z is. The recording's depth is
    /// read.
    pub fn grounds(&self) -> Vec<SupportReport> {
        let Some(up) = self.up() else { return Vec::new() };
        let measured = self.room_points();
        let of = |object: &Object| {
            let (support, known_by) = self.support_of(object, &measured)?;
            let points_m: Vec<_> = object.points_m(&self.scene).collect();
            let mut ground = SupportReport::new(&object.name, (known_by, &support), up, &points_m);
            // What only hides throws no shadow.
            if !object.parts.is_empty() {
                let facets = facets(&self.scene, object, &support, &measured.points);
                facets.iter().for_each(|facet| ground.add_receiver(facet, up, &points_m));
            }
            Some(ground)
        };
        self.scene.objects.iter().filter_map(of).collect()
    }
}
