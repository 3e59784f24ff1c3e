//! Scene files: `scene.toml` as plain values, read and written. docs/scenes.md describes every key.

use std::path::Path;

use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};

use super::SceneError;
use super::gauge::Gauge;
use super::kind::ObjectKind;
use super::site::SiteTable;
use crate::document;
use crate::source::file as plain;

/// A scene file and its text. Comments and order are kept when values change.
pub type Document = document::TomlDocument<SceneFile>;

/// Reads a scene file for editing. Referenced files are not opened.
pub fn read(file: &Path) -> Result<Document, SceneError> {
    let document = parsed(file, Document::parse)?;
    document.value().check(file)?;
    Ok(document)
}

/// The table `[settings]` of a scene file; empty for any other file.
pub fn settings(file: &Path) -> Result<toml::Table, SceneError> {
    let is_scene = file.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    if is_scene { Ok(values(file)?.settings) } else { Ok(toml::Table::new()) }
}

/// Reads the values of a scene file, with a fraction of the memory needed for editing.
pub(super) fn values(file: &Path) -> Result<SceneFile, SceneError> {
    parsed(file, document::read)
}

fn parsed<T>(file: &Path, parse: impl FnOnce(&str) -> Result<T, document::Problem>) -> Result<T, SceneError> {
    let failed = |source| SceneError::Read { file: file.to_owned(), needed_by: None, source };
    let bytes = plain::read(file, plain::MAX_DOCUMENT_BYTES).map_err(failed)?;
    let text =
        str::from_utf8(&bytes).map_err(|e| SceneError::bad(file, "the text", e, "a TOML file, which is UTF-8"))?;
    parse(text).map_err(|source| SceneError::Syntax { file: file.to_owned(), source })
}

/// Each object is drawn separately, with its own motion.
const MAX_OBJECTS: usize = 1 << 14;

/// A whole scene file, of version 1.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct SceneFile {
    pub version: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub up: Option<Up>,
    /// Length of a unit of the recording, if it is not in metres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub metres_per_unit: Option<f64>,
    /// World in which the positions are given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gauge: Option<Gauge>,
    /// A scan of the place.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub site: Option<SiteTable>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub objects: Vec<PlacedModel>,
    #[serde(default, skip_serializing_if = "is_default")]
    pub light: LightTable,
    /// Parameters of the shot, with the tables of a profile.
    #[serde(default, skip_serializing_if = "toml::Table::is_empty")]
    pub settings: toml::Table,
}

/// A model and its placement, or several placements by `instances`.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PlacedModel {
    /// A `.glb` or `.gltf` file, relative to the scene file.
    pub model: String,
    pub name: Option<String>,
    /// Role in photographs; by default it follows from the model's file name.
    pub kind: Option<ObjectKind>,
    /// Excluded from rendering, with all its instances.
    #[serde(default, skip_serializing_if = "is_default")]
    pub hidden: bool,
    /// Casts no shadow on the real surface below it.
    #[serde(default, skip_serializing_if = "is_default")]
    pub shadowless: bool,
    /// Proxy of a real object: not drawn, occludes the objects behind it.
    #[serde(default, skip_serializing_if = "is_default")]
    pub occluder: bool,
    pub up: Option<Up>,
    /// True if the position is that of the model's lowest point.
    #[serde(default, skip_serializing_if = "is_default")]
    pub ground: bool,
    pub position_m: Option<[f64; 3]>,
    /// About the world's x, then y, then z. Alternative to `quaternion`.
    pub rotation_deg: Option<[f64; 3]>,
    /// x, y, z, w.
    pub quaternion: Option<[f64; 4]>,
    /// About the world's up, counter-clockwise seen from above, after the rotation.
    pub heading_deg: Option<f64>,
    /// Alternative to `size_m`.
    pub scale: Option<Scale>,
    /// Largest extent of the model.
    pub size_m: Option<f64>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub instances: Vec<Instance>,
}

/// Missing values are those of the object.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Instance {
    pub name: Option<String>,
    #[serde(default, skip_serializing_if = "is_default")]
    pub hidden: bool,
    #[serde(default, skip_serializing_if = "is_default")]
    pub shadowless: bool,
    pub position_m: Option<[f64; 3]>,
    pub rotation_deg: Option<[f64; 3]>,
    pub quaternion: Option<[f64; 4]>,
    pub heading_deg: Option<f64>,
    pub scale: Option<Scale>,
    pub size_m: Option<f64>,
}

/// One factor for all axes, or one for each.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(untagged, expecting = "expected a number or [x, y, z]")]
pub enum Scale {
    All(f64),
    Each([f64; 3]),
}

/// A grey or a linear colour.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(untagged, expecting = "expected a number or [r, g, b]")]
pub enum Color {
    Grey(f64),
    Rgb([f64; 3]),
}

impl From<Color> for Vec3 {
    fn from(color: Color) -> Self {
        match color {
            Color::Grey(v) => Vec3::splat(v as f32),
            Color::Rgb(c) => DVec3::from(c).as_vec3(),
        }
    }
}

/// The table `[light]`. Intensities are factors, colours linear.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct LightTable {
    /// A panorama, relative to the scene file.
    pub environment: Option<String>,
    pub environment_intensity: Option<f64>,
    pub environment_color: Option<Color>,
    pub environment_rotation_deg: Option<f64>,
    /// The panorama's up, if it differs from the scene's.
    pub environment_up: Option<Up>,
    pub ambient: Option<Color>,
    pub white_lx: Option<f64>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub sun: Vec<SunTable>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub lamp: Vec<LampTable>,
}

/// An isotropic lamp, world axes.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct LampTable {
    pub at_m: [f64; 3],
    pub color: Option<Color>,
    /// Linear radiance of a white diffuse surface facing the lamp at 1 m; default 1.
    pub intensity: Option<f64>,
    /// Diameter of the lamp itself; default 0.06, a bulb.
    pub diameter_m: Option<f64>,
}

/// An entry of `[[light.sun]]`: a distant light, in the scene's axes.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct SunTable {
    /// Any length but 0.
    pub towards: [f64; 3],
    pub color: Option<Color>,
    pub intensity: Option<f64>,
    /// Angular diameter; default 0.53°, the sun's.
    pub diameter_deg: Option<f64>,
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

impl Default for SceneFile {
    fn default() -> Self {
        Self {
            version: 1,
            up: None,
            metres_per_unit: None,
            gauge: None,
            site: None,
            objects: Vec::new(),
            light: LightTable::default(),
            settings: toml::Table::new(),
        }
    }
}

/// Position of a loaded object in its scene file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Index into [`SceneFile::objects`].
    pub object: usize,
    /// Index into its [`PlacedModel::instances`]; `None` if it has none and is placed itself.
    pub instance: Option<usize>,
}

/// An item of a scene file that can be selected: a visible object, or a lamp.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SceneItem {
    Object(Entry),
    /// Index into [`LightTable::lamp`].
    Lamp(usize),
}

impl From<Entry> for SceneItem {
    fn from(entry: Entry) -> Self {
        Self::Object(entry)
    }
}

impl SceneFile {
    /// Referenced files: the objects' models, then the panorama.
    pub fn file_names(&self) -> impl Iterator<Item = &str> {
        let models = self.objects.iter().map(|object| &object.model);
        let scan = self.site.iter().map(|site| &site.scan);
        models.chain(&self.light.environment).chain(scan).map(String::as_str)
    }

    /// Mutable version of [`Self::file_names`].
    pub fn file_names_mut(&mut self) -> impl Iterator<Item = &mut String> {
        let models = self.objects.iter_mut().map(|object| &mut object.model);
        let scan = self.site.iter_mut().map(|site| &mut site.scan);
        models.chain(&mut self.light.environment).chain(scan)
    }

    /// Number of placed objects. Each instance is an object of its own, as in [`Self::entries`].
    pub fn placed_count(&self) -> usize {
        self.objects.iter().map(|object| object.instances.len().max(1)).sum()
    }

    /// The entry of each object of the loaded scene, in the order of [`super::Scene::objects`].
    pub fn entries(&self) -> Vec<Entry> {
        let entries_of = |(object, placed): (usize, &PlacedModel)| -> Vec<Entry> {
            match placed.instances.len() {
                0 => vec![Entry { object, instance: None }],
                count => (0..count).map(|i| Entry { object, instance: Some(i) }).collect(),
            }
        };
        self.objects.iter().enumerate().flat_map(entries_of).collect()
    }

    /// True if an object is excluded from rendering, by its own key or its parent's.
    pub fn is_hidden(&self, entry: Entry) -> bool {
        self.objects.get(entry.object).is_some_and(|object| {
            object.hidden || entry.instance.and_then(|i| object.instances.get(i)).is_some_and(|i| i.hidden)
        })
    }

    /// Excludes or includes an object. Instances that the parent hid stay hidden by their own keys.
    pub fn set_hidden(&mut self, entry: Entry, hidden: bool) {
        self.switch(entry, hidden, |object| &mut object.hidden, |instance| &mut instance.hidden);
    }

    /// True if an object casts no shadow, by its own key or its parent's.
    pub fn is_shadowless(&self, entry: Entry) -> bool {
        self.objects.get(entry.object).is_some_and(|object| {
            object.shadowless || entry.instance.and_then(|i| object.instances.get(i)).is_some_and(|i| i.shadowless)
        })
    }

    /// Sets whether an object casts no shadow, like [`Self::set_hidden`].
    pub fn set_shadowless(&mut self, entry: Entry, shadowless: bool) {
        self.switch(entry, shadowless, |object| &mut object.shadowless, |instance| &mut instance.shadowless);
    }

    /// True if an object is a proxy of a real object.
    pub fn is_occluder(&self, entry: Entry) -> bool {
        self.objects.get(entry.object).is_some_and(|object| object.occluder)
    }

    /// Makes an object with all its instances a proxy of a real object, or evidence again.
    pub fn set_occluder(&mut self, entry: Entry, occluder: bool) {
        if let Some(object) = self.objects.get_mut(entry.object) {
            object.occluder = occluder;
        }
    }

    fn switch(
        &mut self,
        entry: Entry,
        on: bool,
        of_object: impl Fn(&mut PlacedModel) -> &mut bool,
        of_instance: impl Fn(&mut Instance) -> &mut bool,
    ) {
        let Some(object) = self.objects.get_mut(entry.object) else { return };
        let Some(i) = entry.instance else {
            *of_object(object) = on;
            return;
        };
        if !on && std::mem::take(of_object(object)) {
            object.instances.iter_mut().for_each(|instance| *of_instance(instance) = true);
        }
        if let Some(instance) = object.instances.get_mut(i) {
            *of_instance(instance) = on;
        }
    }

    /// Checks all rules that need no other files. Further rules are checked on loading.
    pub(super) fn check(&self, file: &Path) -> Result<(), SceneError> {
        let placed = self.placed_count();
        if placed > MAX_OBJECTS {
            return Err(SceneError::bad(file, "the placed objects", placed, format!("up to {MAX_OBJECTS}")));
        }
        if let Some((key, value)) = toml::Value::try_from(self).ok().as_ref().and_then(not_finite) {
            return Err(SceneError::bad(file, key, value, "finite numbers"));
        }
        match self.version {
            1 => Ok(()),
            value => Err(SceneError::bad(file, "version", value, "1")),
        }
    }
}

/// The first number that is not finite, with its key, as in `objects[0].position_m[2]`.
fn not_finite(value: &toml::Value) -> Option<(String, f64)> {
    match value {
        toml::Value::Float(number) if !number.is_finite() => Some((String::new(), *number)),
        toml::Value::Table(table) => table.iter().find_map(|(key, value)| {
            let (inner, number) = not_finite(value)?;
            let dot = if inner.is_empty() || inner.starts_with('[') { "" } else { "." };
            Some((format!("{key}{dot}{inner}"), number))
        }),
        toml::Value::Array(list) => list.iter().enumerate().find_map(|(i, value)| {
            let (inner, number) = not_finite(value)?;
            let dot = if inner.is_empty() || inner.starts_with('[') { "" } else { "." };
            Some((format!("[{i}]{dot}{inner}"), number))
        }),
        _ => None,
    }
}

/// Up direction: a named axis or any vector.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(untagged, expecting = r#"expected "x", "y", "z", "-x", "-y", "-z" or [x, y, z]"#)]
pub enum Up {
    Named(Axis),
    Direction([f64; 3]),
}

/// An axis of the world with its sign.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
pub enum Axis {
    #[serde(rename = "x")]
    X,
    #[serde(rename = "y")]
    Y,
    #[serde(rename = "z")]
    Z,
    #[serde(rename = "-x")]
    NegX,
    #[serde(rename = "-y")]
    NegY,
    #[serde(rename = "-z")]
    NegZ,
}

impl Up {
    /// The unit vector; `location` is the key that contains it.
    pub fn axis(self, file: &Path, location: &str) -> Result<DVec3, SceneError> {
        Ok(match self {
            Self::Named(Axis::X) => DVec3::X,
            Self::Named(Axis::Y) => DVec3::Y,
            Self::Named(Axis::Z) => DVec3::Z,
            Self::Named(Axis::NegX) => DVec3::NEG_X,
            Self::Named(Axis::NegY) => DVec3::NEG_Y,
            Self::Named(Axis::NegZ) => DVec3::NEG_Z,
            Self::Direction(v) => DVec3::from(v)
                .try_normalize()
                .ok_or_else(|| SceneError::bad(file, location, DVec3::from(v), "a vector with a length"))?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SCENE: &str = "# the desk\nversion = 1\nup = \"z\"\n\n# a marker\n[[objects]]\nmodel = \"a.glb\" # yellow\n\
        position_m = [0.1, 2, 0]\n\n[[objects]]\nmodel = \"b.glb\"\nscale = 2\n\n# by the window\n[[objects.instances]]\n\
        position_m = [1, 1, 0]\n\n[light]\nambient = 0.5\n";

    #[test]
    fn moving_a_placement_preserves_the_rest_of_the_file() {
        let mut document = Document::parse(SCENE).unwrap();
        let mut scene = document.value().clone();
        assert_eq!((scene.up, scene.objects[1].scale), (Some(Up::Named(Axis::Z)), Some(Scale::All(2.0))));
        scene.objects[0].position_m = Some([0.1, 2.0, 0.25]);
        scene.objects[1].instances[0].rotation_deg = Some([0.0, 0.0, 12.0]);
        document.set(scene.clone()).unwrap();
        let expected = SCENE
            .replace("[0.1, 2, 0]", "[0.1, 2.0, 0.25]")
            .replace("[1, 1, 0]\n", "[1, 1, 0]\nrotation_deg = [0.0, 0.0, 12.0]\n");
        assert_eq!(document.to_string(), expected);
        scene.objects.push(PlacedModel { model: "c.glb".to_owned(), ..PlacedModel::default() });
        document.set(scene.clone()).unwrap();
        assert!(document.to_string().contains("\n[[objects]]\nmodel = \"c.glb\"\n"), "{document}");
        assert_eq!(Document::parse(&document.to_string()).unwrap().value(), &scene);
    }

    fn number() -> impl Strategy<Value = f64> {
        prop_oneof![any::<f64>().prop_filter("finite", |n| n.is_finite()), -9.0..9.0f64]
    }

    fn placed() -> impl Strategy<Value = PlacedModel> {
        let numbers = || prop::option::of([number(), number(), number()]);
        let scale = prop_oneof![number().prop_map(Scale::All), [number(), number(), number()].prop_map(Scale::Each)];
        let instance = (numbers(), prop::option::of(number())).prop_map(|(position_m, size_m)| Instance {
            position_m,
            size_m,
            ..Instance::default()
        });
        let instances = prop::collection::vec(instance, 0..3);
        ("\\PC{0,6}", any::<bool>(), numbers(), numbers(), prop::option::of(scale), instances).prop_map(
            |(model, ground, position_m, rotation_deg, scale, instances)| PlacedModel {
                model: model.clone(),
                name: ground.then_some(model),
                up: ground.then_some(Up::Named(Axis::NegY)),
                ground,
                position_m,
                rotation_deg,
                scale,
                instances,
                ..PlacedModel::default()
            },
        )
    }

    proptest! {
        #[test]
        fn written_scene_file_reads_back_equal(
            before in prop::collection::vec(placed(), 0..4),
            after in prop::collection::vec(placed(), 0..4),
            sun in prop::option::of([number(), number(), number()]),
        ) {
            let suns = sun.map(|towards| SunTable { towards, color: Some(Color::Rgb(towards)), intensity: Some(towards[0]), diameter_deg: Some(towards[1]) });
            let lamp = sun.map(|at_m| LampTable { at_m, color: Some(Color::Grey(at_m[2])), intensity: Some(at_m[1]), diameter_m: Some(at_m[0]) });
            let light = LightTable {
                ambient: sun.map(|s| Color::Grey(s[1])),
                sun: suns.into_iter().collect(),
                lamp: lamp.into_iter().collect(),
                ..LightTable::default()
            };
            let scene = |objects| SceneFile { up: sun.map(Up::Direction), objects, light: light.clone(), ..SceneFile::default() };
            let mut document = Document::new(scene(before)).unwrap();
            let read = Document::parse(&document.to_string()).unwrap();
            prop_assert_eq!(read.value(), document.value());
            document.set(scene(after)).unwrap();
            let read = Document::parse(&document.to_string()).unwrap();
            // The shortest decimal representation restores every bit.
            prop_assert_eq!(format!("{:?}", read.value()), format!("{:?}", document.value()));
        }
    }
}
