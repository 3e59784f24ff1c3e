//! How the scene is lit: lamps of its own, and the light that an analysis found, taken into the scene to be edited.

use std::path::{Path, PathBuf};

use glam::DVec3;

use super::Project;
use locard_engine::analyse::{ENVIRONMENT, FILE_NAME, FoundLight};
use locard_engine::scene::{LitBy, SceneFile, Thing, relative};
use locard_engine::shot::AnalysisState;

impl Project {
    /// The light that an analysis found and that lights the scene, because the scene says none of its own.
    pub fn found_light(&self) -> Option<&FoundLight> {
        self.found().map(|(_, light)| light).filter(|_| self.edit().scene.light.says_none())
    }

    fn found(&self) -> Option<(&Path, &FoundLight)> {
        let AnalysisState::Used(folder, findings) = &self.shot.analysis else { return None };
        Some((folder, findings.light.as_ref().filter(|light| light.panorama.is_some())?))
    }

    /// Writes the light that was found into the scene, as `locard light` does. Its panorama is the analysis' own until the scene is
    /// saved; then a copy lies beside its file.
    pub fn take_found_light(&mut self) -> Result<(), String> {
        let mut scene = self.edit().scene.clone();
        self.say_light(&mut scene)?;
        self.change_scene("light: as it was found", |now| *now = scene).map_err(|error| error.to_string())?;
        self.close_step();
        Ok(())
    }

    /// Adds a lamp to the light that the scene is in. Where the file says none, it says that light first: what was seen stays as it
    /// is but for the lamp.
    pub fn add_lamp(&mut self, at_m: DVec3) -> Result<Thing, String> {
        let mut scene = self.edit().scene.clone();
        self.say_light(&mut scene)?;
        let lamp = scene.add_lamp(at_m);
        let what = format!("{}: added", scene.title(lamp));
        self.change_scene(&what, |now| *now = scene).map_err(|error| error.to_string())?;
        self.close_step();
        Ok(lamp)
    }

    /// Says in a scene how it is lit, where it does not.
    fn say_light(&self, scene: &mut SceneFile) -> Result<(), String> {
        if !scene.light.says_none() {
            return Ok(());
        }
        if let Some((folder, light)) = self.found() {
            let file = self.scene_path();
            return light.put_into(scene, &file, relative(&folder.join(ENVIRONMENT), &file));
        }
        // Lights that models bring go on shining.
        if self.shot.scene.lit_by != LitBy::Models {
            scene.light.say_guessed(self.up());
        }
        Ok(())
    }
}

/// The panorama that a scene file names, if it is an analysis' own: another analysis would replace it.
pub fn panorama_of_analysis(scene: &SceneFile, file: &Path) -> Option<PathBuf> {
    let panorama = file.parent().unwrap_or(Path::new("")).join(scene.light.environment.as_ref()?);
    let is_analysis = panorama.file_name()? == ENVIRONMENT && panorama.with_file_name(FILE_NAME).exists();
    panorama.canonicalize().ok().filter(|_| is_analysis)
}
