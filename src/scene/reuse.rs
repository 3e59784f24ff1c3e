//! Stores loaded models and panoramas, and inserts them into a new scene.

use std::path::Path;
use std::rc::Rc;

use super::loaded_models::{LoadedModel, Model, Panorama, SceneCounts};
use super::loader::{Loader, MAX_INDICES, MAX_VERTICES};
use super::picture::MAX_PIXELS;
use crate::source::file::FileStamp;

impl Loader {
    pub fn counts(&self) -> SceneCounts {
        let scene = &self.scene;
        SceneCounts {
            meshes: scene.meshes.len(),
            materials: scene.materials.len(),
            textures: scene.textures.len(),
            files: scene.files.len(),
            warnings: scene.warnings.len(),
            pixels: self.pixels,
            vertices: self.vertices,
            indices: self.indices,
        }
    }

    /// Stores a model that was just read; `start` holds the scene's counts before.
    pub fn store(&mut self, file: &Path, model: &Model, start: SceneCounts) {
        let scene = &self.scene;
        let loaded = LoadedModel {
            files: scene.files[start.files..].iter().map(|file| FileStamp::of(file)).collect(),
            start,
            meshes: scene.meshes[start.meshes..].to_vec(),
            materials: scene.materials[start.materials..].to_vec(),
            textures: scene.textures[start.textures..].to_vec(),
            parts: model.parts.clone(),
            lights: model.lights.clone(),
            warnings: scene.warnings[start.warnings..].to_vec(),
            pixels: self.pixels - start.pixels,
            vertices: self.vertices - start.vertices,
            indices: self.indices - start.indices,
        };
        self.loaded_models.models.insert(file.to_owned(), loaded);
    }

    /// Inserts a loaded model into the scene. `None` if it is not loaded, its files have changed,
    /// or the scene would be too large: then it must be read.
    pub fn insert_loaded(&mut self, file: &Path) -> Option<Rc<Model>> {
        let loaded =
            self.loaded_models.models.get(file).filter(|loaded| loaded.files.iter().all(FileStamp::is_fresh))?;
        let fits = self.pixels + loaded.pixels <= MAX_PIXELS
            && self.vertices + loaded.vertices <= MAX_VERTICES
            && self.indices + loaded.indices <= MAX_INDICES;
        if !fits {
            return None;
        }
        let mut loaded = loaded.clone();
        let start = self.counts();
        loaded.rebase(start);
        let scene = &mut self.scene;
        scene.meshes.extend(loaded.meshes.iter().cloned());
        scene.materials.extend(loaded.materials.iter().cloned());
        scene.textures.extend(loaded.textures.iter().cloned());
        scene.files.extend(loaded.files.iter().map(|stamp| stamp.file.clone()));
        (self.pixels, self.vertices, self.indices) =
            (self.pixels + loaded.pixels, self.vertices + loaded.vertices, self.indices + loaded.indices);
        let model = Rc::new(Model { parts: loaded.parts.clone(), lights: loaded.lights.clone() });
        for warning in &loaded.warnings {
            self.warn_verbatim(warning.clone());
        }
        self.loaded_models.models.insert(file.to_owned(), loaded);
        Some(model)
    }

    /// The panorama of a file, memoized; `read` is called if the file has changed.
    pub fn panorama<E>(&self, file: &Path, read: impl FnOnce() -> Result<Panorama, E>) -> Result<Panorama, E> {
        self.loaded_models.panoramas.get_or_try_insert_with(FileStamp::of(file), |_| read())
    }
}
