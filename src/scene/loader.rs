//! State of a scene while it is loaded, and its limits.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use glam::{DVec3, Vec2, Vec3};

use super::light::{BULB_DIAMETER_M, SUN_RAD};
use super::loaded_models::{LightKind, LoadedModels, MissingModels, Model};
use super::{Environment, Lighting, Object, Part, PointLight, Scene, SceneError, Sun};

/// Vertices and indices of a scene at these limits take 1.6 GB.
pub(super) const MAX_VERTICES: usize = 1 << 24;
pub(super) const MAX_INDICES: usize = 1 << 26;
pub(super) const MAX_PARTS: usize = 1 << 20;
const MAX_WARNINGS: usize = 100;

/// The scene while it is loaded, and the counts for its limits.
pub(super) struct Loader {
    pub scene: Scene,
    pub pixels: u64,
    pub vertices: usize,
    pub indices: usize,
    pub parts: usize,
    /// Models read so far, by file. No memo: none may be evicted, since parts refer to them.
    pub models: HashMap<PathBuf, Rc<Model>>,
    /// Files that earlier scenes loaded.
    pub loaded_models: LoadedModels,
    pub missing_models: MissingModels,
    /// The box in place of missing models, once created.
    pub stand_in: Option<Rc<Model>>,
}

impl Default for Loader {
    /// No object and no light.
    fn default() -> Self {
        let lighting = Lighting { suns: Vec::new(), points: Vec::new(), environment: Environment::Uniform(Vec3::ZERO) };
        let scene = Scene { lighting, ..Scene::default() };
        Self {
            scene,
            pixels: 0,
            vertices: 0,
            indices: 0,
            parts: 0,
            models: HashMap::new(),
            loaded_models: LoadedModels::default(),
            missing_models: MissingModels::Refuse,
            stand_in: None,
        }
    }
}

impl Loader {
    /// Adds a warning once, with the name of its file.
    pub fn warn(&mut self, file: &Path, text: String) {
        self.warn_verbatim(format!("{}: {text}", file.display()));
    }

    /// Adds a warning once.
    pub fn warn_verbatim(&mut self, text: String) {
        let warnings = &mut self.scene.warnings;
        if warnings.len() < MAX_WARNINGS && !warnings.contains(&text) {
            warnings.push(text);
            if warnings.len() == MAX_WARNINGS {
                warnings.push("further warnings of this kind are omitted".to_owned());
            }
        }
    }

    pub fn warn_of_dark_ambient(&mut self, file: &Path) {
        if matches!(self.scene.lighting.environment, Environment::Uniform(color) if color == Vec3::ZERO) {
            self.warn(
                file,
                "there is no environment light: surfaces that lamps and suns do not reach are black".to_owned(),
            );
        }
    }

    /// Adds a model to the scene as an object, with its lights. `object` is complete except for its
    /// parts. Hidden objects get no parts, and proxies of real objects emit no light.
    pub fn place(&mut self, file: &Path, model: &Model, object: Object, white_lx: f64) -> Result<(), SceneError> {
        let world_from_model = object.world_from_model;
        if object.hidden {
            self.scene.objects.push(object);
            return Ok(());
        }
        self.parts += model.parts.len();
        if self.parts > MAX_PARTS {
            let actual = format!("{} placed meshes so far", self.parts);
            return Err(SceneError::bad(file, "the objects", actual, format!("up to {MAX_PARTS}")));
        }
        let place = |part: &Part| Part { world_from_mesh: world_from_model * part.world_from_mesh, ..*part };
        let parts: Vec<_> = model.parts.iter().map(place).collect();
        if !parts.iter().all(|part| part.world_from_mesh.is_finite()) {
            return Err(SceneError::bad(file, &object.name, "a place that is not finite", "finite numbers"));
        }
        if object.occluder {
            self.scene.objects.push(Object { occluder_parts: parts, ..object });
            return Ok(());
        }
        self.scene.objects.push(Object { parts, ..object });
        for light in &model.lights {
            let world_from_light = world_from_model * light.model_from_light;
            let towards = world_from_light.transform_vector3(DVec3::Z).normalize().as_vec3();
            // A white diffuse surface reflects all it receives: E lux have the radiance E /
            // white_lx.
            let color = light.color / white_lx as f32;
            if !(world_from_light.is_finite() && towards.is_finite() && color.is_finite()) {
                return Err(SceneError::bad(file, "a light", "numbers too large", "a finite place and brightness"));
            }
            let lighting = &mut self.scene.lighting;
            match light.kind {
                LightKind::Directional => {
                    lighting.suns.push(Sun { towards_light_in_world: towards, color, diameter_rad: SUN_RAD })
                }
                LightKind::Point { range_m, spot } => lighting.points.push(PointLight {
                    position_in_world_m: world_from_light.translation,
                    color,
                    diameter_m: BULB_DIAMETER_M as f32,
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
        location: &str,
        vertices: usize,
        indices: usize,
    ) -> Result<(), SceneError> {
        self.vertices = self.vertices.saturating_add(vertices);
        self.indices = self.indices.saturating_add(indices);
        if self.vertices > MAX_VERTICES || self.indices > MAX_INDICES {
            let actual = format!("{} vertices and {} indices so far", self.vertices, self.indices);
            return Err(SceneError::bad(
                file,
                location,
                actual,
                format!("up to {MAX_VERTICES} and {MAX_INDICES} in all"),
            ));
        }
        Ok(())
    }
}
