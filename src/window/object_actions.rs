//! Actions on the selected object or lamp, for buttons and keys.

use super::Project;
use locard_engine::scene::SceneItem;

/// Offset of a duplicate duplicate along x, m.
const DUPLICATE_OFFSET_M: f64 = 0.1;

/// Duplicates the selection beside it and selects the copy. Returns an error message.
pub fn duplicate(project: &mut Project, selected: &mut Option<SceneItem>) -> Option<String> {
    let item = (*selected)?;
    let what = format!("{}: duplicated", project.edit().scene.title(item));
    let mut copy = None;
    let done = project.change_scene(&what, |scene| {
        copy = scene.duplicate(item);
        if let Some((copy, mut placement)) = copy.and_then(|copy| Some((copy, scene.placement(copy)?))) {
            placement.position_m.x += DUPLICATE_OFFSET_M;
            scene.put(copy, &placement);
        }
    });
    project.close_step();
    if done.is_ok() {
        *selected = copy.or(*selected);
    }
    done.err().map(|e| e.to_string())
}

/// Hides or shows the selected object. Returns an error message.
pub fn hide(project: &mut Project, selected: Option<SceneItem>) -> Option<String> {
    let entry = match selected? {
        SceneItem::Object(entry) => entry,
        SceneItem::Lamp(_) => {
            return Some("A lamp cannot be hidden; with an intensity of 0 it does not shine.".to_owned());
        }
    };
    let scene = &project.edit().scene;
    let hides = !scene.is_hidden(entry);
    let what = format!("{}: {}", scene.title(entry), if hides { "hidden" } else { "shown" });
    let done = project.change_scene(&what, |scene| scene.set_hidden(entry, hides));
    project.close_step();
    done.err().map(|e| e.to_string())
}

/// Deletes the selection. Returns an error message.
pub fn delete(project: &mut Project, selected: &mut Option<SceneItem>) -> Option<String> {
    let item = selected.take()?;
    let what = format!("{}: deleted", project.edit().scene.title(item));
    let done = project.change_scene(&what, |scene| scene.remove(item));
    project.close_step();
    done.err().map(|e| e.to_string())
}
