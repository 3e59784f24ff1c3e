//! Referenced files that cannot be read. A marked box replaces a missing model, so that the other
//! objects can be shown; it is never exported.

use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;

use glam::{DAffine3, Vec3};

use super::loaded_models::{MissingModels, Model, SceneCounts};
use super::loader::Loader;
use super::{Material, Mesh, Part, SceneError, SceneTexture, Size, TextureUse, Vertex, Wrap};

/// Side of the box if the scene file gives no size, m.
const BOX_SIDE_M: f64 = 0.1;
/// Checks along an edge.
const CHECKS_PER_SIDE: u32 = 4;
const CHECK_COLOURS: [[u8; 4]; 2] = [[255, 0, 255, 255], [0, 0, 0, 255]];

/// A referenced file that cannot be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MissingFile {
    pub file: PathBuf,
    pub problem: String,
    /// False if all objects of the model are hidden.
    pub is_needed: bool,
}

/// Size of the box: scale factors refer to the missing model.
pub(super) fn size(of_model: Size) -> Size {
    match of_model {
        Size::LargestM(size_m) => Size::LargestM(size_m),
        Size::Scale(_) => Size::LargestM(BOX_SIDE_M),
    }
}

impl Loader {
    /// True if a file is known to be missing. Marks it as needed if `is_needed`.
    pub fn is_missing(&mut self, file: &Path, is_needed: bool) -> bool {
        let listed = self.scene.missing.iter_mut().find(|missing| missing.file == file);
        listed.map(|missing| missing.is_needed |= is_needed).is_some()
    }

    /// Records a missing file, or returns the error if it is needed and may not be replaced.
    pub fn skip_missing(&mut self, file: &Path, is_needed: bool, error: SceneError) -> Result<(), SceneError> {
        if is_needed && self.missing_models == MissingModels::Refuse {
            return Err(error);
        }
        self.scene.missing.push(MissingFile { file: file.to_owned(), problem: error.to_string(), is_needed });
        Ok(())
    }

    /// Warns of missing models whose objects are all hidden. To be called after all objects are
    /// read.
    pub fn warn_of_hidden(&mut self) {
        let hidden = self.scene.missing.iter().filter(|missing| !missing.is_needed);
        let warnings: Vec<_> = hidden.map(|missing| format!("{}; its objects are hidden", missing.problem)).collect();
        warnings.into_iter().for_each(|warning| self.warn_verbatim(warning));
    }

    /// Removes the data that a model added before it failed to load.
    pub fn roll_back(&mut self, to: SceneCounts) {
        let scene = &mut self.scene;
        scene.meshes.truncate(to.meshes);
        scene.materials.truncate(to.materials);
        scene.textures.truncate(to.textures);
        scene.files.truncate(to.files);
        scene.warnings.truncate(to.warnings);
        (self.pixels, self.vertices, self.indices) = (to.pixels, to.vertices, to.indices);
    }

    /// The marked box, standing on the model's origin with y up.
    pub fn stand_in_box(&mut self) -> Rc<Model> {
        if let Some(made) = &self.stand_in {
            return Rc::clone(made);
        }
        let scene = &mut self.scene;
        scene.textures.push(checkerboard());
        let base_color_texture = Some(TextureUse {
            texture: scene.textures.len() - 1,
            uv_set: 0,
            transform: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        });
        let name = "missing model".to_owned();
        scene.materials.push(Material { name, unlit: true, base_color_texture, ..Material::default() });
        scene.meshes.push(Arc::new(cube(scene.materials.len() - 1)));
        let part = Part { mesh: scene.meshes.len() - 1, world_from_mesh: DAffine3::IDENTITY };
        let made = Rc::new(Model { parts: vec![part], lights: Vec::new() });
        Rc::clone(self.stand_in.insert(made))
    }
}

fn checkerboard() -> SceneTexture {
    let texel = |n: u32| CHECK_COLOURS[((n % CHECKS_PER_SIDE + n / CHECKS_PER_SIDE) % 2) as usize];
    let rgba: Vec<u8> = (0..CHECKS_PER_SIDE * CHECKS_PER_SIDE).flat_map(texel).collect();
    SceneTexture {
        width: CHECKS_PER_SIDE,
        height: CHECKS_PER_SIDE,
        rgba: Arc::new(rgba),
        srgb: true,
        wrap: [Wrap::Clamp; 2],
        smooth: false,
        mipmaps: true,
    }
}

/// A cube of side 1 whose lower face is centred at the origin.
fn cube(material: usize) -> Mesh {
    let (mut vertices, mut indices) = (Vec::new(), Vec::new());
    let axes = [Vec3::X, Vec3::Y, Vec3::Z];
    for (axis, sign) in (0..3).flat_map(|axis| [(axis, 1.0), (axis, -1.0)]) {
        let normal = sign * axes[axis];
        let right = axes[(axis + 1) % 3];
        let up = normal.cross(right);
        let first = vertices.len() as u32;
        for [u, v] in [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]] {
            let at = 0.5 * normal + (u - 0.5) * right + (v - 0.5) * up + 0.5 * Vec3::Y;
            vertices.push(Vertex {
                position: at.to_array(),
                normal: normal.to_array(),
                tangent: [0.0; 4],
                uv0: [u, v],
                uv1: [0.0; 2],
                color: [1.0; 4],
            });
        }
        indices.extend([0, 1, 2, 0, 2, 3].map(|corner| first + corner));
    }
    Mesh { vertices, indices, material }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::document::PlacedModel;
    use crate::scene::{LoadedModels, Scene, SceneFile, load_file, load_file_with};
    use glam::DVec3;

    fn scene_of(models: &[&str]) -> SceneFile {
        let object = |model: &&str| PlacedModel { model: (*model).to_owned(), ..PlacedModel::default() };
        SceneFile { objects: models.iter().map(object).collect(), ..SceneFile::default() }
    }

    fn load_standing_in(file: &SceneFile) -> Scene {
        let path = Path::new("scenes/any.toml");
        load_file_with(file, path, Some(DVec3::Z), &mut LoadedModels::default(), MissingModels::StandIn).unwrap()
    }

    #[test]
    fn missing_model_is_a_box_and_other_objects_are_unchanged() {
        let path = Path::new("scenes/any.toml");
        let file = scene_of(&["none.glb", "marker-1.glb", "none.glb", "Cargo.toml"]);
        let scene = load_standing_in(&file);
        let missing: Vec<bool> = scene.objects.iter().map(|object| object.is_missing).collect();
        assert_eq!(missing, [true, false, true, true]);
        let files: Vec<_> = scene.missing.iter().map(|missing| (missing.file.as_path(), missing.is_needed)).collect();
        assert_eq!(files, [(Path::new("scenes/none.glb"), true), (Path::new("scenes/Cargo.toml"), true)]);
        let alone = load_file(&scene_of(&["marker-1.glb"]), path, Some(DVec3::Z)).unwrap();
        assert!(scene.objects[1].points_m(&scene).eq(alone.objects[0].points_m(&alone)));
        // It stands at its position and is 10 cm high; with a size it has that.
        let height_m = |scene: &Scene, object: usize| {
            let z = scene.objects[object].points_m(scene).map(|point| point.z);
            z.fold((f64::MAX, f64::MIN), |(low, high), z| (low.min(z), high.max(z)))
        };
        let (low, high) = height_m(&scene, 0);
        assert!(low.abs() < 1e-9 && (high - 0.1).abs() < 1e-9, "{low} {high}");
        let mut sized = file.clone();
        sized.objects[0].size_m = Some(0.5);
        assert!((height_m(&load_standing_in(&sized), 0).1 - 0.5).abs() < 1e-9);
        // Other policies return an error that names the file.
        let error = load_file(&file, path, None).unwrap_err().to_string();
        assert!(error.contains("none.glb"), "{error}");
    }

    #[test]
    fn hidden_model_may_be_missing_under_any_policy() {
        let path = Path::new("scenes/any.toml");
        let mut file = scene_of(&["none.glb", "marker-1.glb"]);
        file.objects[0].hidden = true;
        let scene = load_file(&file, path, None).unwrap();
        assert!(scene.objects[0].parts.is_empty() && !scene.objects[1].parts.is_empty());
        assert!(!scene.missing[0].is_needed && scene.warnings[0].contains("none.glb"), "{:?}", scene.warnings);
    }

    #[test]
    fn missing_model_of_a_visible_object_is_not_reported_as_hidden() {
        let mut file = scene_of(&["none.glb", "none.glb"]);
        file.objects[0].hidden = true;
        let scene = load_standing_in(&file);
        assert!(scene.missing[0].is_needed && scene.warnings.is_empty(), "{:?}", scene.warnings);
    }

    #[test]
    fn missing_panorama_is_left_out() {
        let path = Path::new("scenes/any.toml");
        let mut file = scene_of(&["marker-1.glb"]);
        file.light.environment = Some("none.hdr".to_owned());
        let scene = load_standing_in(&file);
        assert_eq!(scene.missing.len(), 1);
        assert!(!scene.lighting.is_dark() && load_file(&file, path, None).is_err());
    }
}
