//! Models and panoramas for the next scene that references the same files.
//!
//! Interactive dragging builds a scene sixty times a second, with only transforms changed. Meshes
//! and textures are shared between the scenes, and files are read again once they have changed on
//! disk.

use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::Arc;

use glam::{DAffine3, Vec3};

use super::{Material, Mesh, Part, SceneTexture};
use crate::memo::Memo;
use crate::source::file::FileStamp;

/// A model, loaded once for all its placements.
pub(super) struct Model {
    /// Meshes of the scene, with their transforms in the model.
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

/// Shape of a model's light.
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

/// Number of memoized panoramas: the scene's, and the one before it.
const PANORAMA_CAPACITY: usize = 2;

/// The loaded files, for [`super::load_file_with`].
#[derive(Debug)]
pub struct LoadedModels {
    /// The last state of each model. No memo: the files that it depends on are known only once it
    /// was read, and its indices change with the scene.
    pub(super) models: HashMap<PathBuf, LoadedModel>,
    pub(super) panoramas: Memo<FileStamp, Panorama>,
}

impl Default for LoadedModels {
    fn default() -> Self {
        Self { models: HashMap::new(), panoramas: Memo::new(PANORAMA_CAPACITY) }
    }
}

/// Linear colours row by row.
#[derive(Clone, Debug)]
pub(super) struct Panorama {
    pub width: u32,
    pub height: u32,
    pub rgb: Arc<Vec<[f32; 3]>>,
    pub warning: Option<String>,
}

/// A loaded model, with indices as in the scene that it was last part of.
#[derive(Clone, Debug)]
pub(super) struct LoadedModel {
    pub files: Vec<FileStamp>,
    pub start: SceneCounts,
    pub meshes: Vec<Arc<Mesh>>,
    pub materials: Vec<Material>,
    pub textures: Vec<SceneTexture>,
    pub parts: Vec<Part>,
    pub lights: Vec<ModelLight>,
    pub warnings: Vec<String>,
    pub pixels: u64,
    pub vertices: usize,
    pub indices: usize,
}

/// SceneCounts of a scene's lists, and limit counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SceneCounts {
    pub meshes: usize,
    pub materials: usize,
    pub textures: usize,
    pub files: usize,
    pub warnings: usize,
    pub pixels: u64,
    pub vertices: usize,
    pub indices: usize,
}

impl LoadedModel {
    /// Rebases its indices. Meshes are copied only if their material indices change.
    pub fn rebase(&mut self, start: SceneCounts) {
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
    use std::path::Path;

    use super::*;
    use crate::scene::document::{Instance, PlacedModel};
    use crate::scene::{Entry, LoadedModels, MissingModels, SceneFile, load_file, load_file_with};
    use glam::DVec3;

    fn placed(models: &[&str]) -> SceneFile {
        let object = |model: &&str| PlacedModel { model: (*model).to_owned(), ..PlacedModel::default() };
        SceneFile { objects: models.iter().map(object).collect(), ..SceneFile::default() }
    }

    #[test]
    fn reloaded_scene_is_equal_and_shares_its_meshes() {
        let path = Path::new("scenes/any.toml");
        let mut models = LoadedModels::default();
        let [a, b, c] = ["marker-1.glb", "l-scale.glb", "cartridge-case-9mm.glb"];
        let first = placed(&[a, b]);
        let scene = load_file_with(&first, path, Some(DVec3::Z), &mut models, MissingModels::Refuse).unwrap();
        let mut moved = first.clone();
        moved.objects[1].position_m = Some([0.5, 0.0, 0.0]);
        let again = load_file_with(&moved, path, Some(DVec3::Z), &mut models, MissingModels::Refuse).unwrap();
        assert!(scene.meshes.iter().zip(&again.meshes).all(|(a, b)| Arc::ptr_eq(a, b)));
        assert!(again.has_same_resources(&scene) && again != scene);
        // In another order, with others, and back: as if read anew.
        for file in [placed(&[b, c, a]), placed(&[c]), moved.clone(), first] {
            let kept = load_file_with(&file, path, Some(DVec3::Z), &mut models, MissingModels::Refuse).unwrap();
            assert!(kept == load_file(&file, path, Some(DVec3::Z)).unwrap(), "{file:?}");
        }
        assert!(!load_file(&placed(&[a, c]), path, None).unwrap().has_same_resources(&scene));
        // Errors invalidate nothing.
        let before = load_file_with(&moved, path, Some(DVec3::Z), &mut models, MissingModels::Refuse).unwrap();
        load_file_with(&placed(&["none.glb"]), path, None, &mut models, MissingModels::Refuse).unwrap_err();
        let again = load_file_with(&moved, path, Some(DVec3::Z), &mut models, MissingModels::Refuse).unwrap();
        assert!(before.meshes.iter().zip(&again.meshes).all(|(a, b)| Arc::ptr_eq(a, b)));
    }

    #[test]
    fn model_changed_on_disk_is_read_again() {
        let folder = tempfile::tempdir().unwrap();
        let (path, model) = (folder.path().join("scene.toml"), folder.path().join("a.glb"));
        std::fs::copy("scenes/marker-1.glb", &model).unwrap();
        let mut models = LoadedModels::default();
        let mut load = || load_file_with(&placed(&["a.glb"]), &path, None, &mut models, MissingModels::Refuse);
        let before = load().unwrap();
        std::fs::copy("scenes/l-scale.glb", &model).unwrap();
        assert!(!load().unwrap().has_same_resources(&before));
        std::fs::remove_file(&model).unwrap();
        assert!(load().unwrap_err().to_string().contains("a.glb"));
    }

    #[test]
    fn hidden_object_keeps_its_position_and_is_not_drawn() {
        let path = Path::new("scenes/any.toml");
        let mut file = placed(&["marker-1.glb", "l-scale.glb"]);
        file.objects[1].instances = vec![Instance::default(), Instance::default()];
        let [marker, first, second] = file.entries()[..] else { panic!("{:?}", file.entries()) };
        file.set_hidden(marker, true);
        file.set_hidden(first, true);
        let hidden = |file: &SceneFile| file.entries().into_iter().map(|e| file.is_hidden(e)).collect::<Vec<_>>();
        assert_eq!(hidden(&file), [true, true, false]);
        let scene = load_file(&file, path, Some(DVec3::Z)).unwrap();
        let drawn: Vec<bool> = scene.objects.iter().map(|object| !object.parts.is_empty()).collect();
        assert_eq!((drawn, scene.objects[0].hidden, scene.warnings.len()), (vec![false, false, true], true, 0));
        // All instances of an object, and one of them shown again.
        file.set_hidden(Entry { instance: None, ..second }, true);
        assert_eq!(hidden(&file), [true, true, true]);
        file.set_hidden(second, false);
        file.set_hidden(marker, false);
        assert_eq!(hidden(&file), [false, true, false]);
    }

    #[test]
    fn proxy_of_a_real_object_is_not_drawn_and_emits_no_light() {
        let path = Path::new("scenes/any.toml");
        let mut file = placed(&["marker-1.glb", "l-scale.glb"]);
        let drawn = load_file(&file, path, Some(DVec3::Z)).unwrap();
        file.objects[1].occluder = true;
        let scene = load_file(&file, path, Some(DVec3::Z)).unwrap();
        let [marker, scale] = &scene.objects[..] else { panic!("{:?}", scene.objects) };
        assert!(!marker.parts.is_empty() && marker.occluder_parts.is_empty());
        assert!(scale.parts.is_empty() && scale.occluder && scale.occluder_parts == drawn.objects[1].parts);
        // It can still be selected at its position.
        assert_eq!(scale.corners_m(&scene), drawn.objects[1].corners_m(&drawn));
        assert!(scale.points_m(&scene).eq(drawn.objects[1].points_m(&drawn)));
    }
}
