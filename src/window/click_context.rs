//! The data that a click in the picture reads and changes.

use std::sync::Arc;

use super::picked_ground::PickedGround;
use super::project::Project;
use locard_engine::frame::Frame;
use locard_engine::scene::SceneItem;

/// The scene that a click changes.
pub struct ClickContext<'a> {
    pub project: &'a mut Project,
    pub ground: &'a mut PickedGround,
    pub frame: &'a Arc<Frame>,
    pub selected: &'a mut Option<SceneItem>,
}
