//! Cache of models and panoramas: stores loaded data, and inserts them into a new scene.

use std::path::Path;
use std::rc::Rc;

use super::loader::{Loader, MAX_INDICES, MAX_VERTICES};
use super::model_cache::{CachedModel, FileStamp, Model, Panorama, SceneCounts};
use super::picture::MAX_PIXELS;

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

    /// Caches a model that was just read; `start` holds the scene's counts before.
    pub fn cache(&mut self, file: &Path, model: &Model, start: SceneCounts) {
        let scene = &self.scene;
        let cached = CachedModel {
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
        self.model_cache.models.insert(file.to_owned(), cached);
    }

    /// Inserts a cached model into the scene. `None` if it is not cached, its files have changed,
    /// or the scene would be too large: then it must be read.
    pub fn insert_cached(&mut self, file: &Path) -> Option<Rc<Model>> {
        let cached = self.model_cache.models.get(file).filter(|cached| cached.files.iter().all(FileStamp::is_fresh))?;
        let fits = self.pixels + cached.pixels <= MAX_PIXELS
            && self.vertices + cached.vertices <= MAX_VERTICES
            && self.indices + cached.indices <= MAX_INDICES;
        if !fits {
            return None;
        }
        let mut cached = cached.clone();
        let start = self.counts();
        cached.rebase(start);
        let scene = &mut self.scene;
        scene.meshes.extend(cached.meshes.iter().cloned());
        scene.materials.extend(cached.materials.iter().cloned());
        scene.textures.extend(cached.textures.iter().cloned());
        scene.files.extend(cached.files.iter().map(|stamp| stamp.file.clone()));
        (self.pixels, self.vertices, self.indices) =
            (self.pixels + cached.pixels, self.vertices + cached.vertices, self.indices + cached.indices);
        let model = Rc::new(Model { parts: cached.parts.clone(), lights: cached.lights.clone() });
        for warning in &cached.warnings {
            self.warn_verbatim(warning.clone());
        }
        self.model_cache.models.insert(file.to_owned(), cached);
        Some(model)
    }

    /// A panorama from the cache; `read` is called if it is missing or its file has changed.
    pub fn panorama<E>(&mut self, file: &Path, read: impl FnOnce() -> Result<Panorama, E>) -> Result<Panorama, E> {
        if let Some((_, known)) = self.model_cache.panoramas.get(file).filter(|(stamp, _)| stamp.is_fresh()) {
            return Ok(known.clone());
        }
        let stamp = FileStamp::of(file);
        let read = read()?;
        self.model_cache.panoramas.insert(file.to_owned(), (stamp, read.clone()));
        Ok(read)
    }
}
