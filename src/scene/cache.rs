//! Models and panoramas that are kept go into the scene that is being read, and what is read is kept.

use std::path::Path;
use std::rc::Rc;

use super::loader::{Loader, MAX_INDICES, MAX_VERTICES};
use super::models::{Kept, Lengths, Model, Panorama, Stamp};
use super::picture::MAX_PIXELS;

impl Loader {
    pub fn lengths(&self) -> Lengths {
        let scene = &self.scene;
        Lengths {
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

    /// Keeps a model that has just been read; `start` is what the scene had before.
    pub fn keep(&mut self, file: &Path, model: &Model, start: Lengths) {
        let scene = &self.scene;
        let kept = Kept {
            files: scene.files[start.files..].iter().map(|file| Stamp::of(file)).collect(),
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
        self.kept.models.insert(file.to_owned(), kept);
    }

    /// Puts a model that is kept into the scene. `None` if it is not, its files have changed, or the scene would be too large:
    /// then it must be read.
    pub fn take_kept(&mut self, file: &Path) -> Option<Rc<Model>> {
        let kept = self.kept.models.get(file).filter(|kept| kept.files.iter().all(Stamp::is_fresh))?;
        let fits = self.pixels + kept.pixels <= MAX_PIXELS
            && self.vertices + kept.vertices <= MAX_VERTICES
            && self.indices + kept.indices <= MAX_INDICES;
        if !fits {
            return None;
        }
        let mut kept = kept.clone();
        let start = self.lengths();
        kept.move_to(start);
        let scene = &mut self.scene;
        scene.meshes.extend(kept.meshes.iter().cloned());
        scene.materials.extend(kept.materials.iter().cloned());
        scene.textures.extend(kept.textures.iter().cloned());
        scene.files.extend(kept.files.iter().map(|stamp| stamp.file.clone()));
        (self.pixels, self.vertices, self.indices) =
            (self.pixels + kept.pixels, self.vertices + kept.vertices, self.indices + kept.indices);
        let model = Rc::new(Model { parts: kept.parts.clone(), lights: kept.lights.clone() });
        for warning in &kept.warnings {
            self.warn_as_it_is(warning.clone());
        }
        self.kept.models.insert(file.to_owned(), kept);
        Some(model)
    }

    /// A panorama that was read; `read` reads it where it is not kept or has changed.
    pub fn panorama<E>(&mut self, file: &Path, read: impl FnOnce() -> Result<Panorama, E>) -> Result<Panorama, E> {
        if let Some((_, known)) = self.kept.panoramas.get(file).filter(|(stamp, _)| stamp.is_fresh()) {
            return Ok(known.clone());
        }
        let stamp = Stamp::of(file);
        let read = read()?;
        self.kept.panoramas.insert(file.to_owned(), (stamp, read.clone()));
        Ok(read)
    }
}
