//! State while a glTF file is read into a scene.

use std::collections::HashMap;
use std::rc::Rc;

use glam::DAffine3;

use super::Wrap;
use super::gltf::Gltf;
use super::loader::Loader;
use super::picture::Rgba;

/// Key of an image use: equal keys share one [`super::SceneTexture`].
pub(super) type TextureKey = (usize, bool, [Wrap; 2], bool, bool);

/// Identity of a mesh's rest pose: its skin, and the node if that has weights of its own.
pub(super) type RestKey = (Option<usize>, Option<usize>);

/// Reads one file into the scene. Its maps from elements of the file to those of the scene are no
/// memos: an element that is evicted and read again would be in the scene twice.
pub(super) struct ModelReader<'a> {
    pub gltf: &'a Gltf,
    pub loader: &'a mut Loader,
    pub materials: HashMap<Option<usize>, usize>,
    pub textures: HashMap<TextureKey, usize>,
    pub images: HashMap<usize, Rgba>,
    pub meshes: HashMap<(usize, RestKey), Vec<usize>>,
    /// Joint matrices by skin; `None` for a skin that cannot be used.
    pub skins: HashMap<usize, Option<Rc<Vec<DAffine3>>>>,
}
