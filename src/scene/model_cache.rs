//! Models and panoramas that were read, kept for the next scene that places the same files.
//!
//! Moving a thing in a window makes a scene sixty times a second; only where things stand differs. What a model has, its
//! meshes and pictures, is shared between the scenes, and its files are read again once they have changed on disk.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

use glam::{DAffine3, Vec3};

use super::{Material, Mesh, Part, Texture};

/// A model, read only once however often it is placed.
pub(super) struct Model {
    /// Meshes of the scene, placed in the model.
    pub parts: Vec<Part>,
    pub lights: Vec<ModelLight>,
}

/// A light of KHR_lights_punctual, in photometric units.
#[derive(Clone, Copy, Debug)]
pub(super) struct ModelLight {
    pub model_from_light: DAffine3,
    /// Lux for a directional light, candela for the others.
    pub color: Vec3,
    pub kind: LightKind,
}

#[derive(Clone, Copy, Debug)]
pub(super) enum LightKind {
    Directional,
    Point {
        range_m: f32,
        /// Inner and outer angle from the axis, radians.
        spot: Option<[f32; 2]>,
    },
}

/// Policy for models of a scene file that cannot be read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MissingModels {
    /// The scene is refused.
    #[default]
    Refuse,
    /// Marked boxes stand in for them ([`Scene::missing`](super::Scene::missing)).
    StandIn,
}

/// Keeps what was read; for [`super::load_file_with`].
#[derive(Debug, Default)]
pub struct Models {
    pub(super) models: HashMap<PathBuf, Kept>,
    pub(super) panoramas: HashMap<PathBuf, (Stamp, Panorama)>,
}

/// Linear colours row by row.
#[derive(Clone, Debug)]
pub(super) struct Panorama {
    pub width: u32,
    pub height: u32,
    pub rgb: Arc<Vec<[f32; 3]>>,
    pub warning: Option<String>,
}

/// What tells whether a file is still the same.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Stamp {
    pub file: PathBuf,
    modified: Option<SystemTime>,
    length: Option<u64>,
}

impl Stamp {
    pub fn of(file: &Path) -> Self {
        let found = std::fs::metadata(file).ok();
        let modified = found.as_ref().and_then(|m| m.modified().ok());
        Self { file: file.to_owned(), modified, length: found.map(|m| m.len()) }
    }

    /// A file that is needed by nothing may be missing, then and now.
    pub fn is_fresh(&self) -> bool {
        *self == Self::of(&self.file)
    }
}

/// Everything of a model as it stands in the scene into which it was read.
#[derive(Clone, Debug)]
pub(super) struct Kept {
    pub files: Vec<Stamp>,
    pub start: Lengths,
    pub meshes: Vec<Arc<Mesh>>,
    pub materials: Vec<Material>,
    pub textures: Vec<Texture>,
    pub parts: Vec<Part>,
    pub lights: Vec<ModelLight>,
    pub warnings: Vec<String>,
    pub pixels: u64,
    pub vertices: usize,
    pub indices: usize,
}

/// How much of everything a scene has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Lengths {
    pub meshes: usize,
    pub materials: usize,
    pub textures: usize,
    pub files: usize,
    pub warnings: usize,
    pub pixels: u64,
    pub vertices: usize,
    pub indices: usize,
}

impl Kept {
    /// Has its indices count from elsewhere. Meshes are copied only if their materials have other numbers there.
    pub fn move_to(&mut self, start: Lengths) {
        let from = std::mem::replace(&mut self.start, start);
        let moved = |index: usize, from: usize, to: usize| index - from + to;
        if start.materials != from.materials {
            for mesh in &mut self.meshes {
                Arc::make_mut(mesh).material = moved(mesh.material, from.materials, start.materials);
            }
        }
        for material in &mut self.materials {
            let uses = [
                &mut material.base_color_texture,
                &mut material.metallic_roughness_texture,
                &mut material.normal_texture,
                &mut material.occlusion_texture,
                &mut material.emissive_texture,
            ];
            for used in uses.into_iter().flatten() {
                used.texture = moved(used.texture, from.textures, start.textures);
            }
        }
        for part in &mut self.parts {
            part.mesh = moved(part.mesh, from.meshes, start.meshes);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::document::{Instance, PlacedModel};
    use crate::scene::{Entry, MissingModels, Models, SceneFile, load_file, load_file_with};
    use glam::DVec3;

    fn placed(models: &[&str]) -> SceneFile {
        let object = |model: &&str| PlacedModel { model: (*model).to_owned(), ..PlacedModel::default() };
        SceneFile { objects: models.iter().map(object).collect(), ..SceneFile::default() }
    }

    #[test]
    fn a_scene_of_kept_models_is_the_same_and_shares_them() {
        let path = Path::new("scenes/any.toml");
        let mut models = Models::default();
        let [a, b, c] = ["marker-1.glb", "l-scale.glb", "cartridge-case-9mm.glb"];
        let first = placed(&[a, b]);
        let scene = load_file_with(&first, path, Some(DVec3::Z), &mut models, MissingModels::Refuse).unwrap();
        let mut moved = first.clone();
        moved.objects[1].position_m = Some([0.5, 0.0, 0.0]);
        let again = load_file_with(&moved, path, Some(DVec3::Z), &mut models, MissingModels::Refuse).unwrap();
        assert!(scene.meshes.iter().zip(&again.meshes).all(|(a, b)| Arc::ptr_eq(a, b)));
        assert!(again.is_made_of_the_same(&scene) && again != scene);
        // In another order, with others, and back: as if nothing were kept.
        for file in [placed(&[b, c, a]), placed(&[c]), moved.clone(), first] {
            let kept = load_file_with(&file, path, Some(DVec3::Z), &mut models, MissingModels::Refuse).unwrap();
            assert!(kept == load_file(&file, path, Some(DVec3::Z)).unwrap(), "{file:?}");
        }
        assert!(!load_file(&placed(&[a, c]), path, None).unwrap().is_made_of_the_same(&scene));
        // What goes wrong loses nothing.
        let before = load_file_with(&moved, path, Some(DVec3::Z), &mut models, MissingModels::Refuse).unwrap();
        load_file_with(&placed(&["none.glb"]), path, None, &mut models, MissingModels::Refuse).unwrap_err();
        let again = load_file_with(&moved, path, Some(DVec3::Z), &mut models, MissingModels::Refuse).unwrap();
        assert!(before.meshes.iter().zip(&again.meshes).all(|(a, b)| Arc::ptr_eq(a, b)));
    }

    #[test]
    fn a_model_that_changes_on_disk_is_read_again() {
        let folder = tempfile::tempdir().unwrap();
        let (path, model) = (folder.path().join("scene.toml"), folder.path().join("a.glb"));
        std::fs::copy("scenes/marker-1.glb", &model).unwrap();
        let mut models = Models::default();
        let mut load = || load_file_with(&placed(&["a.glb"]), &path, None, &mut models, MissingModels::Refuse);
        let before = load().unwrap();
        std::fs::copy("scenes/l-scale.glb", &model).unwrap();
        assert!(!load().unwrap().is_made_of_the_same(&before));
        std::fs::remove_file(&model).unwrap();
        assert!(load().unwrap_err().to_string().contains("a.glb"));
    }

    #[test]
    fn what_is_hidden_keeps_its_place_and_is_not_drawn() {
        let path = Path::new("scenes/any.toml");
        let mut file = placed(&["marker-1.glb", "l-scale.glb"]);
        file.objects[1].instances = vec![Instance::default(), Instance::default()];
        let [marker, first, second] = file.entries()[..] else { panic!("{:?}", file.entries()) };
        file.hide(marker, true);
        file.hide(first, true);
        let hidden = |file: &SceneFile| file.entries().into_iter().map(|e| file.is_hidden(e)).collect::<Vec<_>>();
        assert_eq!(hidden(&file), [true, true, false]);
        let scene = load_file(&file, path, Some(DVec3::Z)).unwrap();
        let drawn: Vec<bool> = scene.objects.iter().map(|object| !object.parts.is_empty()).collect();
        assert_eq!((drawn, scene.objects[0].hidden, scene.warnings.len()), (vec![false, false, true], true, 0));
        // All of an object, and one of it shown again.
        file.hide(Entry { instance: None, ..second }, true);
        assert_eq!(hidden(&file), [true, true, true]);
        file.hide(second, false);
        file.hide(marker, false);
        assert_eq!(hidden(&file), [false, true, false]);
    }

    #[test]
    fn what_stands_in_for_something_real_is_not_drawn_and_gives_no_light() {
        let path = Path::new("scenes/any.toml");
        let mut file = placed(&["marker-1.glb", "l-scale.glb"]);
        let drawn = load_file(&file, path, Some(DVec3::Z)).unwrap();
        file.objects[1].occluder = true;
        let scene = load_file(&file, path, Some(DVec3::Z)).unwrap();
        let [marker, scale] = &scene.objects[..] else { panic!("{:?}", scene.objects) };
        assert!(!marker.parts.is_empty() && marker.hides.is_empty());
        assert!(scale.parts.is_empty() && scale.occluder && scale.hides == drawn.objects[1].parts);
        // It can be seen and taken hold of where it stands.
        assert_eq!(scale.corners_m(&scene), drawn.objects[1].corners_m(&drawn));
        assert!(scale.points_m(&scene).eq(drawn.objects[1].points_m(&drawn)));
    }
}
