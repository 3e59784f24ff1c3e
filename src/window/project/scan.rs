//! The scan of the place in the scene.

use std::sync::Arc;

use super::Project;
use locard_engine::scene::{SceneError, SceneFile};
use locard_engine::site::SiteScan;

/// A scan that has been aligned.
#[derive(Debug)]
pub struct PlacedScan {
    pub scan: Arc<SiteScan>,
    /// The scene with the scan; only its world counts, since its objects may have changed
    /// meanwhile.
    pub scene: SceneFile,
}

impl Project {
    /// Writes an aligned scan into the scene, in one step.
    pub fn place_scan(&mut self, placed: PlacedScan) -> Result<(), SceneError> {
        let PlacedScan { scan, scene: SceneFile { site, up, gauge, metres_per_unit, .. } } = placed;
        self.shot.keep_scan(scan);
        self.change_scene("scan: aligned", |scene| {
            *scene = SceneFile { site, up, gauge, metres_per_unit, ..std::mem::take(scene) };
        })?;
        self.close_step();
        Ok(())
    }

    /// Removes the scan from the scene, in one step.
    pub fn remove_scan(&mut self) -> Result<(), SceneError> {
        self.change_scene("scan: removed", |scene| scene.site = None)?;
        self.close_step();
        Ok(())
    }
}
