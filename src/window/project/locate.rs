//! Replaces missing files of the scene.

use std::path::{Path, PathBuf};

use super::Project;
use locard_engine::scene::{SceneFile, relative};

impl Project {
    /// Replaces a missing file by another one, in one step. Other missing files that can be read
    /// from the folder of the new one are replaced too. Returns a message.
    pub fn locate(&mut self, missing: &Path, replacement_file: &Path) -> Result<String, String> {
        let scene_file = self.scene_path();
        let mut scene = self.edit().scene.clone();
        if !replace_file(&mut scene, &scene_file, missing, replacement_file) {
            return Err(format!("{}: the scene already names this file", replacement_file.display()));
        }
        self.load_changed(&scene).map_err(|error| error.to_string())?;
        let folder = replacement_file.parent().unwrap_or(Path::new(""));
        let missing_files: Vec<PathBuf> = self.shot().scene.missing.iter().map(|other| other.file.clone()).collect();
        let mut more = 0;
        for other in missing_files.iter().filter(|other| *other != missing) {
            let Some(replacement) = other.file_name().map(|name| folder.join(name)) else { continue };
            // An existing but unreadable file stays as it is.
            if !replacement.is_file() || replacement.canonicalize().ok() == other.canonicalize().ok() {
                continue;
            }
            let mut candidate = scene.clone();
            if replace_file(&mut candidate, &scene_file, other, &replacement) && self.load_changed(&candidate).is_ok() {
                scene = candidate;
                more += 1;
            }
        }
        let name = missing.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let located = self.change_scene(&format!("{name}: located"), |now| *now = scene);
        located.map_err(|error| error.to_string())?;
        self.close_step();
        let more = if more == 0 { String::new() } else { format!(", and {more} more in the same folder") };
        Ok(format!("Located {}{more}", replacement_file.display()))
    }
}

/// Replaces a file name in the scene. Returns whether the scene has changed.
fn replace_file(scene: &mut SceneFile, scene_file: &Path, from: &Path, to: &Path) -> bool {
    let folder = scene_file.parent().unwrap_or(Path::new(""));
    let before = scene.clone();
    for named in scene.file_names_mut().filter(|named| folder.join(&**named) == from) {
        *named = relative(to, scene_file);
    }
    *scene != before
}
