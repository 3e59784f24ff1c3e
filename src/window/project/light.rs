//! How the scene is lit: its own light, matched to a white thing, and the light that an analysis found, taken into the scene to be
//! edited.

use std::path::{Path, PathBuf};

use glam::DVec3;

use super::Project;
use crate::room_light::even;
use locard_engine::analyse::{ENVIRONMENT, FILE_NAME, FoundLight, WHITE};
use locard_engine::scene::document::LightTable;
use locard_engine::scene::{LightCorrection, Lighting, LitBy, SceneFile, Support, Thing, relative};
use locard_engine::shadow::{Room, on_white};
use locard_engine::shot::{AnalysisState, ReferencePick, View};
use locard_engine::text::fixed;

impl Project {
    /// The light that an analysis found and that lights the scene, because the scene says none of its own.
    pub fn found_light(&self) -> Option<&FoundLight> {
        self.found().map(|(_, light)| light).filter(|_| self.edit().scene.light.says_none())
    }

    fn found(&self) -> Option<(&Path, &FoundLight)> {
        let AnalysisState::Used(folder, findings) = &self.shot.analysis else { return None };
        Some((folder, findings.light.as_ref().filter(|light| light.panorama.is_some())?))
    }

    /// Writes the light that lights the scene into its file: the one that was found, as `locard light` does, or the default one. A
    /// found panorama is the analysis' own until the scene is saved; then a copy lies beside its file.
    pub fn take_light(&mut self) -> Result<(), String> {
        let title = if self.found_light().is_some() { "light: as it was found" } else { "light: to be edited" };
        let mut scene = self.edit().scene.clone();
        self.say_light(&mut scene)?;
        self.set_light(title, scene)
    }

    /// Matches all light to a place of the picture that is white, and reports by how much.
    pub fn match_white(&mut self, view: View) -> Result<String, String> {
        let mut scene = self.edit().scene.clone();
        self.say_light(&mut scene)?;
        if scene.light.says_none() {
            return Err("The scene is lit by lights inside its models, which cannot be matched.".to_owned());
        }
        let lighting = self.load(&scene).map_err(|error| error.to_string())?.lighting;
        if lighting.points.len() > scene.light.lamp.len() || lighting.suns.len() > scene.light.sun.len() {
            return Err("Lights inside models light the scene, too, and cannot be matched: change the others by hand."
                .to_owned());
        }
        let pick = ReferencePick { view, reflectance: WHITE };
        let whites = self.shot.white_at(&[pick], &lighting).map_err(|(_, error)| error.to_string())?;
        let factors: Vec<[f64; 3]> = whites.iter().map(|white| white.factors).collect();
        let (correction, [low, high]) = LightCorrection::mean_of(&factors);
        correction.apply(&mut scene.light);
        self.set_light("light: matched to white", scene)?;
        let two = |value: f64| fixed(value, 2);
        Ok(format!(
            "All light is {} times as bright (between {} and {}), by colour {}.",
            two(correction.scale),
            two(low),
            two(high),
            correction.tint.map(two).join(", ")
        ))
    }

    /// Replaces the panorama by light from everywhere that is as bright from above.
    pub fn even_light(&mut self) -> Result<(), String> {
        let surroundings =
            Lighting { environment: self.shot.scene.lighting.environment.clone(), ..Lighting::default() };
        let from_above = Support { point_m: DVec3::ZERO, normal: self.up() };
        let upward = on_white(&surroundings, &Room::default(), &from_above);
        let mut scene = self.edit().scene.clone();
        let LightTable { white_lx, sun, lamp, .. } = scene.light;
        scene.light = LightTable { white_lx, sun, lamp, ..even(upward.far) };
        self.set_light("light: even", scene)
    }

    /// One step of the history.
    fn set_light(&mut self, title: &str, scene: SceneFile) -> Result<(), String> {
        self.change_scene(title, |now| *now = scene).map_err(|error| error.to_string())?;
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
        self.set_light(&what, scene)?;
        Ok(lamp)
    }

    /// Whether nothing but lights inside models lights the scene.
    pub fn is_lit_by_models(&self) -> bool {
        self.found_light().is_none() && self.edit().scene.light.says_none() && self.shot.scene.lit_by == LitBy::Models
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
