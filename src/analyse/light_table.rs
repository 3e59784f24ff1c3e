//! Writes the estimated light of a room into a scene file, where it can be edited.

use std::path::{Path, PathBuf};

use glam::DVec3;

use super::light::LampEstimate;
use super::light_findings::LightFindings;
use crate::scene::SceneFile;
use crate::scene::document::{Color, LampTable, LightTable, Up};

/// Up directions that differ by less than half a degree are equal: its cosine.
const SAME_UP_COS: f64 = 0.99996;

impl LightFindings {
    /// Replaces the light of a scene, except for its `white_lx`. `panorama`: path of the panorama's
    /// file in the scene file. A scene without up gets the panorama's. If the scene's up differs,
    /// the panorama keeps its own.
    pub fn put_into(&self, scene: &mut SceneFile, file: &Path, panorama: String) -> Result<(), String> {
        let up = self.up.unwrap_or([0.0, 0.0, 1.0]);
        let mut environment_up = None;
        match scene.up {
            Some(own) => {
                let own = own.axis(file, "up").map_err(|error| error.to_string())?;
                environment_up = (own.dot(DVec3::from(up)) <= SAME_UP_COS).then_some(Up::Direction(up));
            }
            None => scene.up = Some(Up::Direction(up)),
        }
        let (environment, white_lx) = (Some(panorama), scene.light.white_lx);
        let lamp = self.lamp_tables();
        scene.light = LightTable { environment, environment_up, white_lx, lamp, ..LightTable::default() };
        Ok(())
    }

    /// The lamps as tables of a scene file.
    pub fn lamp_tables(&self) -> Vec<LampTable> {
        let lamp = |lamp: &LampEstimate| LampTable {
            at_m: lamp.at_m,
            color: Some(Color::Rgb(lamp.shown_at_1_m)),
            intensity: None,
            diameter_m: Some(lamp.diameter_m),
        };
        self.lamps.iter().map(lamp).collect()
    }
}

/// Path of a scene file's own panorama: beside it, of its name.
pub fn panorama_beside(scene: &Path) -> PathBuf {
    let stem = scene.file_stem().unwrap_or_default().to_string_lossy();
    scene.with_file_name(format!("{stem}-light.hdr"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scene_gets_the_lamps_and_the_panorama_keeps_a_different_up() {
        let findings = LightFindings {
            up: Some([0.0, 0.0, 1.0]),
            lamps: vec![LampEstimate { at_m: [1.0, 2.0, 2.4], shown_at_1_m: [5.0, 4.0, 3.0], diameter_m: 0.25 }],
            ..LightFindings::of(&Err(String::new()), None)
        };
        let put = |scene: &mut SceneFile| findings.put_into(scene, Path::new("a.toml"), "a-light.hdr".to_owned());
        let mut scene = SceneFile::default();
        (scene.light.ambient, scene.light.white_lx) = (Some(Color::Grey(0.3)), Some(200.0));
        put(&mut scene).unwrap();
        let lamp = LampTable {
            at_m: [1.0, 2.0, 2.4],
            color: Some(Color::Rgb([5.0, 4.0, 3.0])),
            intensity: None,
            diameter_m: Some(0.25),
        };
        let light = LightTable {
            environment: Some("a-light.hdr".to_owned()),
            white_lx: Some(200.0),
            lamp: vec![lamp],
            ..LightTable::default()
        };
        assert_eq!((&scene.light, scene.up), (&light, Some(Up::Direction([0.0, 0.0, 1.0]))));

        // Half a degree is the same, a degree is not.
        let leaning = |deg: f64| Up::Direction([deg.to_radians().sin(), 0.0, deg.to_radians().cos()]);
        let mut other = SceneFile { up: Some(leaning(0.4)), ..SceneFile::default() };
        put(&mut other).unwrap();
        assert_eq!((other.up, other.light.environment_up), (Some(leaning(0.4)), None));
        let mut other = SceneFile { up: Some(leaning(1.0)), ..SceneFile::default() };
        put(&mut other).unwrap();
        assert_eq!((other.up, other.light.environment_up), (Some(leaning(1.0)), Some(Up::Direction([0.0, 0.0, 1.0]))));
    }
}
