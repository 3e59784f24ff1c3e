//! The catalogue `scenes/kit.toml`.

use std::path::{Path, PathBuf};

use serde::Deserialize;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Catalogue {
    pub version: u32,
    pub licence: String,
    pub items: Vec<Item>,
}

/// Files of the same size and features.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Item {
    pub files: Vec<String>,
    pub name: String,
    pub description: String,
    /// Bounding box along the model's x, y and z.
    pub size_mm: [f64; 3],
    pub source: String,
    #[serde(default)]
    pub features: Vec<Feature>,
}

/// A dimension and the way to measure it. Exactly one of `mm` and `reflectance` is set.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Feature {
    pub name: String,
    pub mm: Option<f64>,
    pub reflectance: Option<f64>,
    pub measure: Measure,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    X,
    Y,
    Z,
}

#[derive(Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Measure {
    /// Extent along an axis of the section by the plane `axis` = `at_mm`, of one material's
    /// triangles if it is named.
    Section { axis: Axis, at_mm: f64, along: Axis, material: Option<String> },
    /// Smallest diameter about the y axis of the section at a height.
    SmallestDiameter { at_y_mm: f64 },
    /// Extent of one material's triangles.
    Part { material: String, along: Axis },
    /// Extent of the opaque part of a decal.
    Print { along: Axis },
    /// Mean distance of the middles of `count` dark marks along a line on the surface.
    Pitch { from_mm: [f64; 3], to_mm: [f64; 3], count: usize },
    /// Distance from the first to the last edge along a line on the surface.
    Outer { from_mm: [f64; 3], to_mm: [f64; 3] },
    /// Distance from the end of the first to the start of the last dark mark along a line.
    Inner { from_mm: [f64; 3], to_mm: [f64; 3] },
    /// Linear base colour at a point of the surface.
    Color { at_mm: [f64; 3] },
}

/// The folder `scenes/`.
pub fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes")
}

/// # Panics
/// If the catalogue is missing or invalid.
pub fn read() -> Catalogue {
    let text = std::fs::read_to_string(folder().join("kit.toml")).unwrap();
    toml::from_str(&text).unwrap()
}
