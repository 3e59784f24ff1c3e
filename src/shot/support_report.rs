//! Reports on the surfaces that support a scene's objects and receive their shadows.

use super::Shot;
use crate::scene::Object;
use crate::support::{SupportReport, TiltedSupport, facets};

impl Shot {
    /// The support of each object that has one. Empty if neither the scene nor the recording
    /// defines up. Reads the recording's depth.
    pub fn support_report(&self) -> Vec<SupportReport> {
        let Some(up) = self.up() else { return Vec::new() };
        let measured = self.room_points();
        let object_report = |object: &Object| {
            let (support, known_by) = self.support_of(object, &measured)?;
            let points_m: Vec<_> = object.points_m(&self.scene).collect();
            let mut ground = SupportReport::new(&object.name, (known_by, &support), up, &points_m);
            // Occluders without parts cast no shadow.
            if !object.parts.is_empty() {
                let facets = facets(&self.scene, object, &support, &measured.points);
                facets.iter().for_each(|facet| ground.add_receiver(facet, up, &points_m));
            }
            Some(ground)
        };
        self.scene.objects.iter().filter_map(object_report).collect()
    }

    /// The tilted surfaces below the scene's objects, by depth or the recording's floor. Reads the
    /// recording's depth on first use.
    pub fn tilts(&self) -> Vec<TiltedSupport> {
        let Some(up) = self.up() else { return Vec::new() };
        let tilted_support = |(object, placed): (usize, Object)| {
            let support = placed.support.filter(|_| !placed.is_missing && !placed.hidden)?;
            TiltedSupport::of(object, support, &placed.points_m(&self.scene).collect::<Vec<_>>(), up)
        };
        self.objects().into_iter().enumerate().filter_map(tilted_support).collect()
    }
}
