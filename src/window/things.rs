//! What is done to what is selected, by buttons and by keys alike.

use super::Project;
use locard_engine::scene::Thing;

/// A second one is this far to the side, m.
const ASIDE_M: f64 = 0.1;

/// Puts a second one beside what is selected, which is selected then. Gives back what went wrong.
pub fn duplicate(project: &mut Project, selected: &mut Option<Thing>) -> Option<String> {
    let thing = (*selected)?;
    let what = format!("{}: duplicated", project.edit().scene.title(thing));
    let mut copy = None;
    let done = project.change_scene(&what, |scene| {
        copy = scene.duplicate(thing);
        if let Some((copy, mut stance)) = copy.and_then(|copy| Some((copy, scene.stance(copy)?))) {
            stance.position_m.x += ASIDE_M;
            scene.put(copy, &stance);
        }
    });
    project.close_step();
    if done.is_ok() {
        *selected = copy.or(*selected);
    }
    done.err().map(|e| e.to_string())
}

/// Leaves what is selected out of the picture, or shows it again. Gives back what went wrong.
pub fn hide(project: &mut Project, selected: Option<Thing>) -> Option<String> {
    let entry = match selected? {
        Thing::Object(entry) => entry,
        Thing::Lamp(_) => return Some("A lamp is not hidden; with an intensity of 0 it does not shine.".to_owned()),
    };
    let scene = &project.edit().scene;
    let hides = !scene.is_hidden(entry);
    let what = format!("{}: {}", scene.title(entry), if hides { "hidden" } else { "shown" });
    let done = project.change_scene(&what, |scene| scene.hide(entry, hides));
    project.close_step();
    done.err().map(|e| e.to_string())
}

/// Takes away what is selected. Gives back what went wrong.
pub fn delete(project: &mut Project, selected: &mut Option<Thing>) -> Option<String> {
    let thing = selected.take()?;
    let what = format!("{}: deleted", project.edit().scene.title(thing));
    let done = project.change_scene(&what, |scene| scene.remove(thing));
    project.close_step();
    done.err().map(|e| e.to_string())
}
