//! The formats of cameras.

use super::plate::CameraAbilities;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CameraFormat {
    /// Nuke's `.chan`: the camera alone.
    Chan,
    /// USD as text.
    Usda,
    /// glTF in a binary container, `.glb`.
    Gltf,
}

impl CameraFormat {
    pub fn file_name(self) -> &'static str {
        match self {
            Self::Chan => "camera.chan",
            Self::Usda => "camera.usda",
            Self::Gltf => "camera.glb",
        }
    }

    pub(super) fn abilities(self) -> CameraAbilities {
        match self {
            Self::Chan => CameraAbilities { has_offsets: false, has_animated_lens: true },
            Self::Usda => CameraAbilities { has_offsets: true, has_animated_lens: true },
            Self::Gltf => CameraAbilities { has_offsets: false, has_animated_lens: false },
        }
    }

    /// Whether the file contains the evidence.
    pub fn has_scene(self) -> bool {
        self != Self::Chan
    }
}
