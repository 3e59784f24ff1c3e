//! Describes a scene's contents for people.

use std::fmt;

use glam::{DAffine3, DVec3, Vec3};
use serde::Serialize;

use super::{Environment, Object, Scene, overlaps, place};
use crate::text::{count, fixed, number, shown};

/// Beyond these extents a model is probably not in metres.
const LARGE_M: f64 = 10.0;
const SMALL_M: f64 = 0.001;

/// More are not listed.
const MOST_OVERLAPS: usize = 8;

/// A scene in numbers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Description {
    pub objects: Vec<ObjectDescription>,
    pub triangles: usize,
    pub materials: usize,
    pub textures: Vec<TextureDescription>,
    pub suns: usize,
    pub points: usize,
    /// The surrounding light, in words.
    pub environment: String,
    /// The loader's warnings, then those about sizes.
    pub warnings: Vec<String>,
}

/// An object in numbers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ObjectDescription {
    pub name: String,
    pub triangles: usize,
    /// Left out of the picture.
    pub hidden: bool,
    /// The corners of its bounding box, world axes, metres; `None` if it has no points.
    pub bounds_in_world_m: Option<[[f64; 3]; 2]>,
}

/// A texture in numbers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TextureDescription {
    pub width: u32,
    pub height: u32,
    pub srgb: bool,
}

fn light(value: f32) -> String {
    // By its own digits, not by those of the same number in more bits.
    value.to_string().parse().map_or_else(|_| value.to_string(), number)
}

/// Counts what is in a scene and collects warnings about it.
pub fn describe(scene: &Scene) -> Description {
    let mut warnings = scene.warnings.clone();
    let objects: Vec<_> = scene.objects.iter().map(|object| describe_object(scene, object, &mut warnings)).collect();
    warnings.extend(overlaps(scene).iter().take(MOST_OVERLAPS).map(|overlap| overlap.told(scene)));
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
    Description {
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
        warnings,
    }
}

fn describe_object(scene: &Scene, object: &Object, warnings: &mut Vec<String>) -> ObjectDescription {
    let bounds = bounds_m(scene, object);
    match bounds.map(|(low, high)| (high - low).max_element()) {
        None if object.hidden => {}
        None => warnings.push(format!("{}: there is nothing in it to see", object.name)),
        Some(extent_m) => warnings.extend(oddly_sized(object, extent_m)),
    }
    ObjectDescription {
        name: object.name.clone(),
        hidden: object.hidden,
        triangles: object.parts.iter().map(|part| scene.meshes[part.mesh].indices.len() / 3).sum(),
        bounds_in_world_m: bounds.map(|(low, high)| [low.to_array(), high.to_array()]),
    }
}

/// The lowest and the highest corner of an object's box along the world's axes, metres.
pub fn bounds_m(scene: &Scene, object: &Object) -> Option<(DVec3, DVec3)> {
    place::bounds(scene, &object.parts, DAffine3::IDENTITY)
}

/// Says so where an object is so large or so small that its model is hardly in metres.
pub fn odd_size(scene: &Scene, object: &Object) -> Option<String> {
    let (low, high) = bounds_m(scene, object)?;
    oddly_sized(object, (high - low).max_element())
}

fn oddly_sized(object: &Object, extent_m: f64) -> Option<String> {
    let size = match extent_m {
        large if large > LARGE_M => format!("{} m", fixed(large, 1)),
        small if small < SMALL_M => format!("{:.4} mm", small * 1e3),
        _ => return None,
    };
    Some(format!("{}: {size} large; is it in metres? (scale, size_m)", object.name))
}

/// To the millimetre.
fn metres(value: f64) -> String {
    fixed(value, 3)
}

impl fmt::Display for Description {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for object in &self.objects {
            match object.hidden {
                true => write!(f, "object     {}: hidden", shown(&object.name))?,
                false => write!(f, "object     {}: {}", shown(&object.name), count(object.triangles, "triangle"))?,
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
        self.warnings.iter().try_for_each(|warning| writeln!(f, "odd        {}", shown(warning)))
    }
}
