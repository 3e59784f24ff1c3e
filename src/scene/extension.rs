//! Extensions of glTF: the supported ones, and the commands that convert others.

use std::path::Path;

use super::bytes::shell_quoted;

/// The supported extensions.
pub(super) const SUPPORTED: [&str; 5] = [
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
];

pub(super) const AVIF: &str = "EXT_texture_avif";
pub(super) const KTX2: &str = "KHR_texture_basisu";
pub(super) const WEBP: &str = "EXT_texture_webp";

/// Extensions that a glTF Transform command (`npm install --global @gltf-transform/cli`) converts
/// to plain glTF 2.0: the command, and its arguments after the two files.
const CONVERSIONS: [(&str, &str, &str); 6] = [
    ("KHR_draco_mesh_compression", "copy", ""),
    ("EXT_meshopt_compression", "copy", ""),
    (WEBP, "png", " --formats webp"),
    (AVIF, "png", " --formats avif"),
    (KTX2, "ktxdecompress", ""),
    ("KHR_materials_pbrSpecularGlossiness", "metalrough", ""),
];

pub(super) fn is_supported(name: &str) -> bool {
    SUPPORTED.contains(&name)
}

/// Advice for converting a file that uses this extension, as a clause.
pub(super) fn conversion(name: &str, file: &Path) -> Option<String> {
    let (_, command, options) = CONVERSIONS.iter().find(|(extension, ..)| *extension == name)?;
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    let converted = file.with_file_name(format!("{stem}-converted.glb"));
    let (from, to) = (shell_quoted(file), shell_quoted(&converted));
    Some(format!("`gltf-transform {command} {from} {to}{options}` converts it"))
}

/// `text`, followed by conversion advice if there is any.
pub(super) fn with_conversion(text: impl Into<String>, name: &str, file: &Path) -> String {
    let text = text.into();
    conversion(name, file).map_or(text.clone(), |conversion| format!("{text}; {conversion}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conversion_of_a_file_with_a_space_quotes_it() {
        let command = conversion(WEBP, Path::new("my models/a b.gltf")).unwrap();
        assert_eq!(
            command,
            "`gltf-transform png 'my models/a b.gltf' 'my models/a b-converted.glb' --formats webp` converts it"
        );
        assert_eq!(conversion("KHR_materials_clearcoat", Path::new("a.glb")), None);
    }
}
