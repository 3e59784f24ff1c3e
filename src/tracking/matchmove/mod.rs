//! Animated cameras of other programs as trajectories: Nuke's `.chan`, USD as text (`.usda`), glTF
//! (`.gltf`, `.glb`). [`axes`] has the conventions that all three share. Lenses are not read.

mod animated_camera;
pub mod axes;
pub mod chan;
mod gltf;
mod gltf_buffers;
mod keyframes;
mod usd;
mod usd_text;
mod usd_transform;

use std::path::Path;

pub use animated_camera::{AnimatedCamera, CameraKeyframe, FrameNumbering, KeyframeClock};
pub use axes::CameraPlacement;

use super::records::{self, TextError};

/// File extensions of the formats.
pub const EXTENSIONS: [&str; 5] = ["chan", "usda", "usd", "gltf", "glb"];

fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase()
}

/// True if a file is an animated camera, by its extension.
pub fn is_camera_file(path: &Path) -> bool {
    EXTENSIONS.contains(&extension(path).as_str()) || usd::BINARY_EXTENSIONS.contains(&extension(path).as_str())
}

/// Reads an animated camera; the format follows from the file's extension.
pub fn read(path: &Path) -> Result<AnimatedCamera, TextError> {
    match extension(path).as_str() {
        "chan" => chan::parse(&records::read(path)?, path),
        "gltf" | "glb" => gltf::read(path),
        _ => usd::read(path),
    }
}
