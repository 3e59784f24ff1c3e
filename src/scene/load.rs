//! Loads a scene from a path.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use glam::DVec3;

use super::document::SceneFile;
use super::light::{DEFAULT_WHITE_LX, default_lighting};
use super::loaded_models::MissingModels;
use super::loader::Loader;
use super::{
    Lighting, LightingOrigin, LoadedModels, Object, ObjectKind, Scene, SceneError, bytes, document, model, scene_file,
};
use crate::text::shown;

/// Loads a model or a scene file.
///
/// A `.glb` or `.gltf` file is one object whose coordinates are the world's, unchanged. A `.toml`
/// file is a scene file; docs/scenes.md documents its keys. `world_up` is the recording's up, if it
/// has one; a scene file's own `up` overrides it.
///
/// Without any light, a white diffuse surface facing up has a radiance of about 1: ambient 0.55 and
/// a sun of 0.6, 35° off the world's up. For a model alone with unknown up: ambient 1.
///
/// No input causes a panic or exceeds the memory limits: 1 GiB per file, 16384 pixels a side and
/// 2^28 pixels in all textures, 2^24 vertices, 2^26 indices, 2^20 placed meshes, 2^14 objects.
pub fn load(path: &Path, world_up: Option<DVec3>) -> Result<Scene, SceneError> {
    load_with(path, world_up, MissingModels::Refuse)
}

/// Like [`load`], with a policy for missing models.
pub fn load_with(path: &Path, world_up: Option<DVec3>, missing_models: MissingModels) -> Result<Scene, SceneError> {
    guarded(path, || load_unguarded(Loader { missing_models, ..Loader::default() }, path, world_up))
}

/// Loads the contents of a scene file. `path` is its (possible) location; models are found relative
/// to it.
pub fn load_file(file: &SceneFile, path: &Path, world_up: Option<DVec3>) -> Result<Scene, SceneError> {
    load_file_with(file, path, world_up, &mut LoadedModels::default(), MissingModels::Refuse)
}

/// Like [`load_file`]; loaded models are read again only if their files have changed.
pub fn load_file_with(
    file: &SceneFile,
    path: &Path,
    world_up: Option<DVec3>,
    models: &mut LoadedModels,
    missing_models: MissingModels,
) -> Result<Scene, SceneError> {
    let loaded_models = std::mem::take(models);
    guarded(path, || {
        let mut loader = Loader { loaded_models, missing_models, ..Loader::default() };
        let done = unit(path, world_up).and_then(|up| scene_file::read(&mut loader, file, path, up));
        *models = loader.loaded_models;
        done.map(|()| loader.scene)
    })
}

fn guarded(path: &Path, load: impl FnOnce() -> Result<Scene, SceneError>) -> Result<Scene, SceneError> {
    // The checks below should prevent any panic; this catches those that they, or a decoder, miss.
    catch_unwind(AssertUnwindSafe(load)).unwrap_or_else(|panic| {
        let message = panic.downcast_ref::<String>().cloned();
        let message = message.or_else(|| panic.downcast_ref::<&str>().map(|s| (*s).to_owned())).unwrap_or_default();
        Err(SceneError::DecoderPanic { file: path.to_owned(), message })
    })
}

/// The world's up, normalized.
fn unit(path: &Path, world_up: Option<DVec3>) -> Result<Option<DVec3>, SceneError> {
    let refused = |up: DVec3| SceneError::bad(path, "the world's up", up, "a vector with a length");
    world_up.map(|up| up.try_normalize().ok_or_else(|| refused(up))).transpose()
}

fn load_unguarded(mut loader: Loader, path: &Path, world_up: Option<DVec3>) -> Result<Scene, SceneError> {
    let world_up = unit(path, world_up)?;
    match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("glb" | "gltf") => {
            loader.scene.up_in_world = world_up;
            let model = model::load(&mut loader, path, None)?;
            let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            loader.place(
                path,
                &model,
                Object { name, kind: ObjectKind::of_model(path), ..Object::default() },
                DEFAULT_WHITE_LX,
            )?;
            if loader.scene.lighting.is_dark() {
                loader.scene.lighting = world_up.map_or_else(Lighting::default, default_lighting);
                loader.scene.lighting_origin = LightingOrigin::Default;
            } else {
                loader.scene.lighting_origin = LightingOrigin::Models;
                loader.warn_of_dark_ambient(path);
            }
        }
        Some("toml") => scene_file::read(&mut loader, &document::values(path)?, path, world_up)?,
        _ => {
            bytes::read(path, None)?; // a missing file is the more useful error
            let extension = path.extension().map(|extension| shown(&extension.to_string_lossy()));
            return Err(SceneError::UnsupportedExtension { file: path.to_owned(), extension });
        }
    }
    Ok(loader.scene)
}
