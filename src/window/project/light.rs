//! The scene's lighting: adopting the lighting found by an analysis, and matching it to a white
//! reference.

use std::path::{Path, PathBuf};

use glam::DVec3;

use super::Project;
use crate::environment_light::ambient;
use locard_engine::analyse::{ENVIRONMENT, FILE_NAME, LightFindings, WHITE_REFLECTANCE};
use locard_engine::plane::Plane;
use locard_engine::scene::document::LightTable;
use locard_engine::scene::{LightCorrection, Lighting, LightingOrigin, SceneFile, SceneItem, relative};
use locard_engine::shadow::{Room, white_radiance};
use locard_engine::shot::{AnalysisState, FramePoint, ReferencePick};
use locard_engine::text::fixed;

impl Project {
    /// Lighting from the analysis, which applies because the scene has none of its own.
    pub fn found_light(&self) -> Option<&LightFindings> {
        self.analysis_light().map(|(_, light)| light).filter(|_| self.edit().scene.light.is_unspecified())
    }

    fn analysis_light(&self) -> Option<(&Path, &LightFindings)> {
        let AnalysisState::Used(folder, findings) = &self.shot.analysis else { return None };
        Some((folder, findings.light.as_ref().filter(|light| light.panorama.is_some())?))
    }

    /// Writes the current lighting into the scene: the lighting from the analysis, as `locard
    /// light` does, or the default one. The panorama stays in the analysis' folder until the scene
    /// is saved; then a copy is placed beside the scene file.
    pub fn adopt_light(&mut self) -> Result<(), String> {
        let title =
            if self.found_light().is_some() { "light: copied from the analysis" } else { "light: to be edited" };
        let mut scene = self.edit().scene.clone();
        self.write_current_light(&mut scene)?;
        self.set_light(title, scene)
    }

    /// Matches brightness and colour of all light to a white place of the picture. Returns a
    /// message with the factors.
    pub fn match_white(&mut self, view: FramePoint) -> Result<String, String> {
        let mut scene = self.edit().scene.clone();
        self.write_current_light(&mut scene)?;
        if scene.light.is_unspecified() {
            return Err("The scene is lit by lights inside its models, which cannot be matched.".to_owned());
        }
        let lighting = self.load(&scene).map_err(|error| error.to_string())?.lighting;
        if lighting.points.len() > scene.light.lamp.len() || lighting.suns.len() > scene.light.sun.len() {
            return Err("Lights inside models light the scene, too, and cannot be matched: change the others by hand."
                .to_owned());
        }
        let pick = ReferencePick { view, reflectance: WHITE_REFLECTANCE };
        let whites = self.shot.white_references(&[pick], &lighting).map_err(|(_, error)| error.to_string())?;
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

    /// Replaces the panorama by uniform light that is as bright from above.
    pub fn make_light_uniform(&mut self) -> Result<(), String> {
        let surroundings =
            Lighting { environment: self.shot.scene.lighting.environment.clone(), ..Lighting::default() };
        let from_above = Plane { point_m: DVec3::ZERO, normal: self.up() };
        let upward = white_radiance(&surroundings, &Room::default(), &from_above);
        let mut scene = self.edit().scene.clone();
        let LightTable { white_lx, sun, lamp, .. } = scene.light;
        scene.light = LightTable { white_lx, sun, lamp, ..ambient(upward.far) };
        self.set_light("light: even", scene)
    }

    /// Changes the lighting in one step of the history.
    fn set_light(&mut self, title: &str, scene: SceneFile) -> Result<(), String> {
        self.change_scene(title, |now| *now = scene).map_err(|error| error.to_string())?;
        self.close_step();
        Ok(())
    }

    /// Adds a lamp. If the file has no lighting, the current lighting is written first, so that
    /// only the lamp changes the picture.
    pub fn add_lamp(&mut self, at_m: DVec3) -> Result<SceneItem, String> {
        let mut scene = self.edit().scene.clone();
        self.write_current_light(&mut scene)?;
        let lamp = scene.add_lamp(at_m);
        let what = format!("{}: added", scene.title(lamp));
        self.set_light(&what, scene)?;
        Ok(lamp)
    }

    /// True if only lights inside models light the scene.
    pub fn is_lit_by_models(&self) -> bool {
        self.found_light().is_none()
            && self.edit().scene.light.is_unspecified()
            && self.shot.scene.lighting_origin == LightingOrigin::Models
    }

    /// Writes the current lighting into a scene that has none.
    fn write_current_light(&self, scene: &mut SceneFile) -> Result<(), String> {
        if !scene.light.is_unspecified() {
            return Ok(());
        }
        if let Some((folder, light)) = self.analysis_light() {
            let file = self.scene_path();
            return light.put_into(scene, &file, relative(&folder.join(ENVIRONMENT), &file));
        }
        // Lights inside models keep shining.
        if self.shot.scene.lighting_origin != LightingOrigin::Models {
            scene.light.write_default(self.up());
        }
        Ok(())
    }
}

/// The scene's panorama if it belongs to an analysis, where another analysis would replace it.
pub fn panorama_of_analysis(scene: &SceneFile, file: &Path) -> Option<PathBuf> {
    let panorama = file.parent().unwrap_or(Path::new("")).join(scene.light.environment.as_ref()?);
    let is_analysis = panorama.file_name()? == ENVIRONMENT && panorama.with_file_name(FILE_NAME).exists();
    panorama.canonicalize().ok().filter(|_| is_analysis)
}
