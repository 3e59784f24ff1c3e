//! Missing files of the scene, found again.

use std::path::{Path, PathBuf};

use super::Project;
use locard_engine::scene::{SceneFile, relative};

impl Project {
    /// Names another file in place of a missing one, in one step. Other missing files that can be
    /// read from the new one's folder are replaced, too. Returns a message.
    pub fn locate(&mut self, missing: &Path, found: &Path) -> Result<String, String> {
        let scene_file = self.scene_path();
        let mut scene = self.edit().scene.clone();
        if !rename(&mut scene, &scene_file, missing, found) {
            return Err(format!("{}: the scene already names this file", found.display()));
        }
        self.load_changed(&scene).map_err(|error| error.to_string())?;
        let folder = found.parent().unwrap_or(Path::new(""));
        let others: Vec<PathBuf> = self.shot().scene.missing.iter().map(|other| other.file.clone()).collect();
        let mut more = 0;
        for other in others.iter().filter(|other| *other != missing) {
            let Some(there) = other.file_name().map(|name| folder.join(name)) else { continue };
            // One that is there and cannot be read stays as it is.
            if !there.is_file() || there.canonicalize().ok() == other.canonicalize().ok() {
                continue;
            }
            let mut with_it = scene.clone();
            if rename(&mut with_it, &scene_file, other, &there) && self.load_changed(&with_it).is_ok() {
                scene = with_it;
                more += 1;
            }
        }
        let name = missing.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let located = self.change_scene(&format!("{name}: located"), |now| *now = scene);
        located.map_err(|error| error.to_string())?;
        self.close_step();
        let more = if more == 0 { String::new() } else { format!(", and {more} more in the same folder") };
        Ok(format!("Located {}{more}", found.display()))
    }
}

/// Names a file in place of another one. Returns whether that changes the scene.
fn rename(scene: &mut SceneFile, scene_file: &Path, from: &Path, to: &Path) -> bool {
    let folder = scene_file.parent().unwrap_or(Path::new(""));
    let before = scene.clone();
    for named in scene.file_names_mut().filter(|named| folder.join(&**named) == from) {
        *named = relative(to, scene_file);
    }
    *scene != before
}
