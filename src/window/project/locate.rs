//! Missing files of the scene, found again.

use std::path::Path;

use super::Project;
use crate::scene::{SceneError, relative};

impl Project {
    /// Names another file in place of a missing one, in one step. Other missing files that lie in
    /// the same folder as the new one are replaced, too. Returns a message.
    pub fn locate(&mut self, missing: &Path, found: &Path) -> Result<String, SceneError> {
        let scene_file = self.scene_path();
        let folder = scene_file.parent().unwrap_or(Path::new("")).to_owned();
        let beside = found.parent().unwrap_or(Path::new(""));
        let mut replaced = vec![(missing.to_owned(), found.to_owned())];
        for other in self.shot().scene.missing.iter().filter(|other| other.file != missing) {
            let there = other.file.file_name().map(|name| beside.join(name)).filter(|path| path.is_file());
            replaced.extend(there.map(|there| (other.file.clone(), there)));
        }
        let name = missing.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        self.change_scene(&format!("{name}: located"), |scene| {
            let names = scene.objects.iter_mut().map(|object| &mut object.model).chain(&mut scene.light.environment);
            for named in names {
                let file = folder.join(&*named);
                if let Some((_, to)) = replaced.iter().find(|(from, _)| *from == file) {
                    *named = relative(to, &scene_file);
                }
            }
        })?;
        self.close_step();
        let more = replaced.len() - 1;
        let more = if more == 0 { String::new() } else { format!(", and {more} more in the same folder") };
        Ok(format!("Located {}{more}", found.display()))
    }
}
