//! From a path to a scene.

use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::rc::Rc;

use glam::{DAffine3, DVec2, DVec3, Vec2, Vec3};

use super::model::{self, LightKind, Model};
use super::{Environment, Lighting, Object, Part, PointLight, Scene, SceneError, Sun, bytes, scene_file};

/// Vertices and indices of a scene together, 1.6 GB.
const MAX_VERTICES: usize = 1 << 24;
const MAX_INDICES: usize = 1 << 26;
pub(super) const MAX_PARTS: usize = 1 << 20;
const MAX_WARNINGS: usize = 100;

/// Illuminance under which a white matt surface is the camera's white: an office.
pub(super) const DEFAULT_WHITE_LX: f64 = 500.0;

/// Reads what is to be put into the room.
///
/// A `.glb` or `.gltf` file is one object whose coordinates are the world's, unchanged. A
/// `.toml` file is a scene of ours; docs/scenes.md has its keys. `world_up` is the recording's
/// up where it knows one; a scene file's own `up` goes before it.
///
/// Without any light a white matt surface that faces up shows about 1: ambient 0.55 and a sun
/// of 0.6, 35° off the world's up. Where a model stands alone and no up is known, ambient 1.
///
/// No input makes it panic or take memory beyond its limits: 1 GiB a file, 16384 pixels a
/// side and 2^28 pixels in all textures, 2^24 vertices, 2^26 indices, 2^20 placed meshes.
pub fn load(path: &Path, world_up: Option<DVec3>) -> Result<Scene, SceneError> {
    // The checks below are meant to leave no panic; this is for what they, or a decoder, miss.
    catch_unwind(AssertUnwindSafe(|| load_unguarded(path, world_up))).unwrap_or_else(|panic| {
        let message = panic.downcast_ref::<String>().cloned();
        let message = message.or_else(|| panic.downcast_ref::<&str>().map(|s| (*s).to_owned())).unwrap_or_default();
        Err(SceneError::Inside { file: path.to_owned(), message })
    })
}

fn load_unguarded(path: &Path, world_up: Option<DVec3>) -> Result<Scene, SceneError> {
    let world_up = match world_up.map(|up| (up, up.try_normalize())) {
        Some((up, None)) => return Err(SceneError::bad(path, "the world's up", up, "a vector with a length")),
        Some((_, up)) => up,
        None => None,
    };
    let mut loader = Loader::default();
    match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("glb" | "gltf") => {
            loader.scene.up_in_world = world_up;
            let model = loader.model(path, None)?;
            let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            loader.place(path, &model, name, DAffine3::IDENTITY, DEFAULT_WHITE_LX)?;
            if loader.scene.lighting.is_dark() {
                loader.scene.lighting = world_up.map_or_else(Lighting::default, default_lighting);
            } else {
                loader.say_dark_ambient(path);
            }
        }
        Some("toml") => scene_file::read(&mut loader, path, world_up)?,
        _ => {
            bytes::read(path, None)?; // a missing file is the better news
            let found = path.extension().map_or("none".to_owned(), |e| e.to_string_lossy().into_owned());
            return Err(SceneError::bad(path, "the file's extension", found, ".glb, .gltf or .toml"));
        }
    }
    Ok(loader.scene)
}

/// The light where nobody gives any.
pub(super) fn default_lighting(world_up: DVec3) -> Lighting {
    // 35° off towards the world's axis that is least along up, the first of equals.
    let axis = [DVec3::X, DVec3::Y, DVec3::Z]
        .into_iter()
        .reduce(|best, axis| if axis.dot(world_up).abs() < best.dot(world_up).abs() { axis } else { best })
        .unwrap_or(DVec3::X);
    let sideways = axis.reject_from_normalized(world_up).normalize();
    let DVec2 { x: up_part, y: side_part } = DVec2::from_angle(35f64.to_radians());
    let towards_light_in_world = (world_up * up_part + sideways * side_part).as_vec3();
    Lighting {
        suns: vec![Sun { towards_light_in_world, color: Vec3::splat(0.6) }],
        points: Vec::new(),
        environment: Environment::Uniform(Vec3::splat(0.55)),
    }
}

impl Lighting {
    /// Whether there is no light at all.
    pub(super) fn is_dark(&self) -> bool {
        self.suns.is_empty()
            && self.points.is_empty()
            && matches!(self.environment, Environment::Uniform(color) if color == Vec3::ZERO)
    }
}

/// The scene that grows, and what it may still take.
pub(super) struct Loader {
    pub scene: Scene,
    pub pixels: u64,
    vertices: usize,
    indices: usize,
    parts: usize,
    models: HashMap<PathBuf, Rc<Model>>,
}

impl Default for Loader {
    /// No object and no light.
    fn default() -> Self {
        let lighting = Lighting { suns: Vec::new(), points: Vec::new(), environment: Environment::Uniform(Vec3::ZERO) };
        let scene = Scene { lighting, ..Scene::default() };
        Self { scene, pixels: 0, vertices: 0, indices: 0, parts: 0, models: HashMap::new() }
    }
}

impl Loader {
    /// Adds a warning once, with the name of the file that it is about.
    pub fn warn(&mut self, file: &Path, text: String) {
        let warnings = &mut self.scene.warnings;
        let text = format!("{}: {text}", file.display());
        if warnings.len() < MAX_WARNINGS && !warnings.contains(&text) {
            warnings.push(text);
            if warnings.len() == MAX_WARNINGS {
                warnings.push("there is more like this, not said".to_owned());
            }
        }
    }

    pub fn say_dark_ambient(&mut self, file: &Path) {
        if matches!(self.scene.lighting.environment, Environment::Uniform(color) if color == Vec3::ZERO) {
            self.warn(file, "there is no light from around: what lamps and suns do not reach is black".to_owned());
        }
    }

    /// A model, read at its first use.
    pub fn model(&mut self, file: &Path, needed_by: Option<&Path>) -> Result<Rc<Model>, SceneError> {
        if let Some(known) = self.models.get(file) {
            return Ok(Rc::clone(known));
        }
        let model = Rc::new(model::read(self, file, needed_by)?);
        if model.parts.is_empty() {
            self.warn(file, "there is nothing in it to see".to_owned());
        }
        self.models.insert(file.to_owned(), Rc::clone(&model));
        Ok(model)
    }

    /// Puts a model into the world as an object, with its lights.
    pub fn place(
        &mut self,
        file: &Path,
        model: &Model,
        name: String,
        world_from_model: DAffine3,
        white_lx: f64,
    ) -> Result<(), SceneError> {
        self.parts += model.parts.len();
        if self.parts > MAX_PARTS {
            let found = format!("{} placed meshes so far", self.parts);
            return Err(SceneError::bad(file, "the objects", found, format!("up to {MAX_PARTS}")));
        }
        let place = |part: &Part| Part { world_from_mesh: world_from_model * part.world_from_mesh, ..*part };
        let parts: Vec<_> = model.parts.iter().map(place).collect();
        if !parts.iter().all(|part| part.world_from_mesh.is_finite()) {
            return Err(SceneError::bad(file, &name, "a place that is not finite", "finite numbers"));
        }
        self.scene.objects.push(Object { name, parts });
        for light in &model.lights {
            let world_from_light = world_from_model * light.model_from_light;
            let towards = world_from_light.transform_vector3(DVec3::Z).normalize().as_vec3();
            // A white matt surface reflects what it receives: E lux show as E / white_lx.
            let color = light.color / white_lx as f32;
            if !(world_from_light.is_finite() && towards.is_finite() && color.is_finite()) {
                return Err(SceneError::bad(file, "a light", "numbers too large", "a finite place and brightness"));
            }
            let lighting = &mut self.scene.lighting;
            match light.kind {
                LightKind::Directional => lighting.suns.push(Sun { towards_light_in_world: towards, color }),
                LightKind::Point { range_m, spot } => lighting.points.push(PointLight {
                    position_in_world_m: world_from_light.translation,
                    color,
                    range_m,
                    spot: spot.map(|angles| (-towards, Vec2::from(angles))),
                }),
            }
        }
        Ok(())
    }

    pub fn count_geometry(
        &mut self,
        file: &Path,
        what: &str,
        vertices: usize,
        indices: usize,
    ) -> Result<(), SceneError> {
        self.vertices = self.vertices.saturating_add(vertices);
        self.indices = self.indices.saturating_add(indices);
        if self.vertices > MAX_VERTICES || self.indices > MAX_INDICES {
            let found = format!("{} vertices and {} indices so far", self.vertices, self.indices);
            return Err(SceneError::bad(file, what, found, format!("up to {MAX_VERTICES} and {MAX_INDICES} in all")));
        }
        Ok(())
    }
}
