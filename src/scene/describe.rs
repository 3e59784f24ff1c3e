//! Human-readable description of a scene's contents.

use std::fmt;

use glam::{DAffine3, DVec3, Vec3};
use serde::Serialize;

use super::{Environment, Object, Scene, overlaps, place};
use crate::text::{count, fixed, number, shown};

/// Extents outside this range suggest that a model is not in metres.
const MAX_USUAL_EXTENT_M: f64 = 10.0;
const MIN_USUAL_EXTENT_M: f64 = 0.001;

/// Maximum number of listed overlaps.
const MAX_LISTED_OVERLAPS: usize = 8;

/// Contents of a scene in numbers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SceneDescription {
    pub objects: Vec<ObjectDescription>,
    pub triangles: usize,
    pub materials: usize,
    pub textures: Vec<TextureDescription>,
    pub suns: usize,
    pub points: usize,
    /// Text description of the environment light.
    pub environment: String,
    /// File of the scan of the place.
    pub scan: Option<String>,
    /// Warnings of the loader, then those about sizes.
    pub warnings: Vec<String>,
}

/// Contents of an object in numbers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ObjectDescription {
    pub name: String,
    pub triangles: usize,
    /// Excluded from rendering.
    pub hidden: bool,
    /// Corners of the bounding box, world axes, metres; `None` without points.
    pub bounds_in_world_m: Option<[[f64; 3]; 2]>,
}

/// Size and encoding of a texture.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TextureDescription {
    pub width: u32,
    pub height: u32,
    pub srgb: bool,
}

fn light(value: f32) -> String {
    // Formatted as f32: the digits of the f64 would be longer.
    value.to_string().parse().map_or_else(|_| value.to_string(), number)
}

/// Counts the contents of a scene and collects warnings about them.
pub fn describe(scene: &Scene) -> SceneDescription {
    let mut warnings = scene.warnings.clone();
    let objects: Vec<_> = scene.objects.iter().map(|object| describe_object(scene, object, &mut warnings)).collect();
    warnings.extend(overlaps(scene).iter().take(MAX_LISTED_OVERLAPS).map(|overlap| overlap.message(scene)));
    let environment = match &scene.lighting.environment {
        Environment::Uniform(c) if *c == Vec3::ZERO => "none from around".to_owned(),
        Environment::Uniform(c) if c.x == c.y && c.y == c.z => format!("{} from everywhere", light(c.x)),
        Environment::Uniform(c) => format!("{} from everywhere", c.to_array().map(light).join(" ")),
        Environment::Map(map) => {
            let factor = match map.color {
                Vec3::ONE => String::new(),
                Vec3 { x, y, z } if x == y && y == z => format!(", times {}", light(x)),
                color => format!(", times {}", color.to_array().map(light).join(" ")),
            };
            format!("a panorama of {}x{} px{factor}", map.width, map.height)
        }
    };
    SceneDescription {
        triangles: objects.iter().map(|o| o.triangles).sum(),
        objects,
        materials: scene.materials.len(),
        textures: scene
            .textures
            .iter()
            .map(|t| TextureDescription { width: t.width, height: t.height, srgb: t.srgb })
            .collect(),
        suns: scene.lighting.suns.len(),
        points: scene.lighting.points.len(),
        environment,
        scan: scene.site.as_ref().map(|site| site.scan.display().to_string()),
        warnings,
    }
}

fn describe_object(scene: &Scene, object: &Object, warnings: &mut Vec<String>) -> ObjectDescription {
    let bounds = bounds_m(scene, object);
    match bounds.map(|(low, high)| (high - low).max_element()) {
        None if object.hidden => {}
        None => warnings.push(format!("{}: it has nothing visible", object.name)),
        Some(extent_m) => warnings.extend(extent_warning(object, extent_m)),
    }
    ObjectDescription {
        name: object.name.clone(),
        hidden: object.hidden,
        triangles: object.parts.iter().map(|part| scene.meshes[part.mesh].indices.len() / 3).sum(),
        bounds_in_world_m: bounds.map(|(low, high)| [low.to_array(), high.to_array()]),
    }
}

/// Minimum and maximum of an object's world-aligned bounding box, metres.
pub fn bounds_m(scene: &Scene, object: &Object) -> Option<(DVec3, DVec3)> {
    place::bounds(scene, &object.parts, DAffine3::IDENTITY)
}

/// Warning for an object whose size suggests a unit other than metres.
pub fn size_warning(scene: &Scene, object: &Object) -> Option<String> {
    let (low, high) = bounds_m(scene, object)?;
    extent_warning(object, (high - low).max_element())
}

fn extent_warning(object: &Object, extent_m: f64) -> Option<String> {
    let size = match extent_m {
        large if large > MAX_USUAL_EXTENT_M => format!("{} m", fixed(large, 1)),
        small if small < MIN_USUAL_EXTENT_M => format!("{:.4} mm", small * 1e3),
        _ => return None,
    };
    Some(format!("{}: {size} large; is it in metres? (scale, size_m)", object.name))
}

/// Rounded to the millimetre.
fn metres(value: f64) -> String {
    fixed(value, 3)
}

impl fmt::Display for SceneDescription {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for object in &self.objects {
            if object.hidden {
                write!(f, "object     {}: hidden", shown(&object.name))?
            } else {
                write!(f, "object     {}: {}", shown(&object.name), count(object.triangles, "triangle"))?
            }
            if let Some([low, high]) = object.bounds_in_world_m {
                let extent = [0, 1, 2].map(|i| metres(high[i] - low[i])).join(" x ");
                let [low, high] = [low, high].map(|corner| corner.map(metres).join(" "));
                write!(f, ", {extent} m, from {low} to {high}")?;
            }
            writeln!(f)?;
        }
        writeln!(f, "in all     {}, {}", count(self.triangles, "triangle"), count(self.materials, "material"))?;
        for (i, texture) in self.textures.iter().enumerate() {
            let kind = if texture.srgb { "colour" } else { "data" };
            writeln!(f, "texture {i:<2} {}x{} px, {kind}", texture.width, texture.height)?;
        }
        writeln!(f, "light      {}, {}, {}", count(self.suns, "sun"), count(self.points, "lamp"), self.environment)?;
        if let Some(scan) = &self.scan {
            writeln!(f, "site       {}", shown(scan))?;
        }
        self.warnings.iter().try_for_each(|warning| writeln!(f, "odd        {}", shown(warning)))
    }
}
