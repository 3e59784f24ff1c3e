//! A compositor that follows the scene of a shot.

use std::sync::Arc;

use locard_engine::compositor::Compositor;
use locard_engine::gpu::Gpu;
use locard_engine::memo::ByAddress;
use locard_engine::scene::Scene;
use locard_engine::shot::Shot;

/// A compositor with the scene that was uploaded to it. No memo: another scene is uploaded to the
/// same compositor, which keeps its pipelines and unchanged resources.
#[derive(Debug)]
pub struct SceneCompositor {
    scene: ByAddress<Scene>,
    compositor: Compositor,
}

impl SceneCompositor {
    pub fn new(gpu: Gpu, shot: &Shot) -> Self {
        Self { scene: ByAddress(Arc::clone(&shot.scene)), compositor: shot.compositor(gpu) }
    }

    /// The compositor with the scene of a shot.
    pub fn with_scene_of(&mut self, shot: &Shot) -> &mut Compositor {
        let scene = ByAddress(Arc::clone(&shot.scene));
        if self.scene != scene {
            self.compositor.set_scene(Scene::clone(&scene));
            self.scene = scene;
        }
        &mut self.compositor
    }
}
