//! Roles of objects in photographs of a scene.

use std::path::Path;

use serde::{Deserialize, Serialize};

/// Role of an object: the key `kind` of a scene file's object, or by its model's file name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum ObjectKind {
    /// An item that is to be photographed.
    #[default]
    Evidence,
    /// A numbered marker, which identifies an item.
    Marker,
    /// A scale, by which lengths are measured.
    Scale,
    /// Anything else: furniture, a board, a proxy of a real object.
    Prop,
}

impl ObjectKind {
    /// The kind by a model's file name: a scale if one of its words is `scale` or `ruler`, a marker
    /// if one is `marker`, evidence otherwise. Words are separated by anything but letters.
    pub fn of_model(model: &Path) -> Self {
        let name = model.file_stem().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        let has = |word: &str| name.split(|c: char| !c.is_ascii_alphabetic()).any(|part| part == word);
        if has("scale") || has("ruler") {
            Self::Scale
        } else if has("marker") {
            Self::Marker
        } else {
            Self::Evidence
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kind_follows_from_the_words_of_the_file_name() {
        let kind = |name: &str| ObjectKind::of_model(Path::new(name));
        assert_eq!(kind("models/L-Scale.glb"), ObjectKind::Scale);
        assert_eq!(kind("abfo_scale_2.gltf"), ObjectKind::Scale);
        assert_eq!(kind("marker-9.glb"), ObjectKind::Marker);
        assert_eq!(kind("scales/knife.glb"), ObjectKind::Evidence);
        assert_eq!(kind("fish-scales.glb"), ObjectKind::Evidence);
    }
}
