//! Clicks for the light: the position of a new lamp, or a white surface.

use glam::{DVec2, DVec3};

use super::click_context::ClickContext;
use super::point_picker::surface_point;
use super::project::Project;
use locard_engine::scene::document::LampTable;
use locard_engine::scene::{Scene, SceneItem, bounds_m};
use locard_engine::shot::FramePoint;

/// Purpose of a click in the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LampPick {
    /// Position of a new lamp.
    Position,
    /// A white surface to match the light to.
    White,
}

/// Default height of a lamp above the centre of the scene, m.
const DEFAULT_HEIGHT_M: f64 = 1.0;
const DEFAULT_HEIGHT_NOTE: &str = "No depth here: the lamp hangs 1 m above the scene's middle.";

impl LampPick {
    /// Instruction for the click.
    pub fn prompt(self) -> &'static str {
        match self {
            Self::White => "Click on white paper or paint in the light. Esc ends it",
            Self::Position => "Click a place for the lamp. Esc ends it",
        }
    }

    /// Handles a click in the picture: matches the light to a white surface, or adds a lamp that
    /// touches the surface. Returns a message.
    pub fn click(self, context: ClickContext<'_>, at_px: DVec2) -> Result<Option<String>, String> {
        let ClickContext { project, ground, frame, selected } = context;
        if self == Self::White {
            return project.match_white(FramePoint { frame: frame.index, at_px }).map(Some);
        }
        match surface_point(ground.plane, project.shot(), frame, at_px) {
            Some(support) => {
                let radius_m = 0.5 * LampTable::default().diameter_or_default_m();
                *selected = Some(project.add_lamp(support.point_m + radius_m * support.normal)?);
                Ok(None)
            }
            None => add_above_centre(project, selected).map(Some),
        }
    }
}

/// Adds a lamp above the centre of the scene. Returns a note.
pub fn add_above_centre(project: &mut Project, selected: &mut Option<SceneItem>) -> Result<String, String> {
    *selected = Some(project.add_lamp(default_position_m(project))?);
    Ok(DEFAULT_HEIGHT_NOTE.to_owned())
}

/// Point above the centre of the scene's bounding box; above the world's origin in an empty scene.
fn default_position_m(project: &Project) -> DVec3 {
    centre_m(&project.shot().scene) + project.up() * DEFAULT_HEIGHT_M
}

fn centre_m(scene: &Scene) -> DVec3 {
    let boxes = scene.objects.iter().filter_map(|object| bounds_m(scene, object));
    let around = boxes.reduce(|(low, high), (l, h)| (low.min(l), high.max(h)));
    around.map_or(DVec3::ZERO, |(low, high)| 0.5 * (low + high))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use locard_engine::recording::OpenOptions;
    use locard_engine::shot::ShotOptions;

    #[test]
    fn default_lamp_position_is_above_the_centre_of_the_scene() {
        let open = |scene: Option<&str>| {
            let options = ShotOptions { scene: scene.map(Into::into), ..ShotOptions::default() };
            Project::open(Path::new("recordings/demo"), &OpenOptions::default(), &options).unwrap()
        };
        // Things from the marker at the left, x = −0.1, to those on the stool at the right, 0 to
        // 0.41 m above the floor.
        let at_m = default_position_m(&open(Some("scenes/demo.toml")));
        assert!((at_m - DVec3::new(0.2, -0.1, 1.25)).abs().max_element() < 0.1, "{at_m}");
        assert_eq!(default_position_m(&open(None)), DVec3::Z);
    }
}
