//! Edits of one item of a scene file: its placement is read, changed and written back to its own
//! entry. `lamp` implements lamps.

use glam::{DQuat, DVec3, EulerRot};

use super::document::{Entry, Instance, PlacedModel, Scale, SceneFile, SceneItem};
use super::heading::wrapped_degrees;
use super::place::Size;

/// Placement of an item, with missing values taken from its object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ItemPlacement {
    /// World axes, metres.
    pub position_m: DVec3,
    /// Applied before the heading.
    pub rotation: DQuat,
    /// About the world's up, counter-clockwise seen from above.
    pub heading_deg: f64,
    pub size: Size,
}

/// Decimal factor for rounding written numbers, m, ° and 1: to a µm, without the rounding errors of
/// sums.
const DECIMAL_ROUNDING: f64 = 1e6;

impl ItemPlacement {
    /// Rotates counter-clockwise about a world axis (unit length) seen from its tip. A rotation
    /// about the world's up changes the heading.
    #[must_use]
    pub fn turned(&self, axis: DVec3, degrees: f64, up: DVec3) -> Self {
        if axis.dot(up).abs() > 1.0 - 1e-9 {
            let heading_deg = self.heading_deg + degrees * axis.dot(up).signum();
            let heading_deg = if degrees == 0.0 { self.heading_deg } else { wrapped_degrees(heading_deg) };
            return Self { heading_deg, ..*self };
        }
        let heading = DQuat::from_axis_angle(up, self.heading_deg.to_radians());
        let turn = DQuat::from_axis_angle(axis, degrees.to_radians());
        Self { rotation: (heading.conjugate() * turn * heading * self.rotation).normalize(), ..*self }
    }

    /// Scales along the model's own axes. A size given as largest extent is scaled by x alone.
    #[must_use]
    pub fn scaled(&self, factors: DVec3) -> Self {
        let size = match self.size {
            Size::Scale(scale) => Size::Scale(scale * factors),
            Size::LargestM(size_m) => Size::LargestM(size_m * factors.max_element()),
        };
        Self { size, ..*self }
    }
}

/// `rotation_deg` of a scene file: about the world's x, then y, then z.
pub(super) fn rotation(degrees: DVec3) -> DQuat {
    let angles = degrees * (std::f64::consts::PI / 180.0);
    DQuat::from_rotation_z(angles.z) * DQuat::from_rotation_y(angles.y) * DQuat::from_rotation_x(angles.x)
}

/// Placement keys of an object or an instance.
struct SceneKeys<'a> {
    position_m: &'a mut Option<[f64; 3]>,
    rotation_deg: &'a mut Option<[f64; 3]>,
    quaternion: &'a mut Option<[f64; 4]>,
    heading_deg: &'a mut Option<f64>,
    scale: &'a mut Option<Scale>,
    size_m: &'a mut Option<f64>,
}

macro_rules! keys {
    ($of:expr) => {{
        let of = $of;
        SceneKeys {
            position_m: &mut of.position_m,
            rotation_deg: &mut of.rotation_deg,
            quaternion: &mut of.quaternion,
            heading_deg: &mut of.heading_deg,
            scale: &mut of.scale,
            size_m: &mut of.size_m,
        }
    }};
}

impl SceneFile {
    /// The object of an entry, and the instance if it is one. `None` if there is no such entry.
    fn entry(&self, entry: Entry) -> Option<(&PlacedModel, Option<&Instance>)> {
        let object = self.objects.get(entry.object)?;
        match entry.instance {
            Some(i) => Some((object, Some(object.instances.get(i)?))),
            None => Some((object, None)),
        }
    }

    /// Placement of an item. `None` if there is no such entry.
    pub fn placement(&self, of: impl Into<SceneItem>) -> Option<ItemPlacement> {
        let entry = match of.into() {
            SceneItem::Object(entry) => entry,
            SceneItem::Lamp(lamp) => return self.lamp_placement(lamp),
        };
        let (object, instance) = self.entry(entry)?;
        let turned = |degrees: Option<[f64; 3]>, quaternion: Option<[f64; 4]>| {
            degrees.map(|d| rotation(d.into())).or_else(|| quaternion.map(|q| DQuat::from_array(q).normalize()))
        };
        let sized = |scale: Option<Scale>, size_m: Option<f64>| {
            let scale = scale.map(|scale| match scale {
                Scale::All(s) => DVec3::splat(s),
                Scale::Each(s) => s.into(),
            });
            scale.map(Size::Scale).or(size_m.map(Size::LargestM))
        };
        let own_rotation = instance.and_then(|i| turned(i.rotation_deg, i.quaternion));
        let own_size = instance.and_then(|i| sized(i.scale, i.size_m));
        let rotation = own_rotation.or_else(|| turned(object.rotation_deg, object.quaternion));
        let position = instance.and_then(|i| i.position_m).or(object.position_m).unwrap_or_default();
        Some(ItemPlacement {
            position_m: position.into(),
            rotation: rotation.unwrap_or(DQuat::IDENTITY),
            heading_deg: instance.and_then(|i| i.heading_deg).or(object.heading_deg).unwrap_or(0.0),
            size: own_size.or(sized(object.scale, object.size_m)).unwrap_or(Size::Scale(DVec3::ONE)),
        })
    }

    /// Sets the placement of an item. Keys with unchanged values are not rewritten, and other
    /// instances stay as they are.
    pub fn put(&mut self, thing: impl Into<SceneItem>, to: &ItemPlacement) {
        let entry = match thing.into() {
            SceneItem::Object(entry) => entry,
            SceneItem::Lamp(lamp) => return self.put_lamp(lamp, to),
        };
        let Some(from) = self.placement(entry) else { return };
        let object = &mut self.objects[entry.object];
        let by_quaternion = {
            let own = entry.instance.map(|i| &object.instances[i]);
            let own = own.filter(|i| i.rotation_deg.is_some() || i.quaternion.is_some());
            own.map_or(object.quaternion.is_some(), |i| i.quaternion.is_some())
        };
        let of_all = object.heading_deg.filter(|_| entry.instance.is_some());
        let keys = match entry.instance {
            Some(i) => keys!(&mut object.instances[i]),
            None => keys!(object),
        };
        if to.position_m != from.position_m {
            *keys.position_m = Some(written_position(from.position_m, to.position_m));
        }
        if to.heading_deg != from.heading_deg {
            let heading_deg = rounded(to.heading_deg);
            *keys.heading_deg = (heading_deg != 0.0 || of_all.is_some()).then_some(heading_deg);
        }
        if to.rotation != from.rotation {
            (*keys.rotation_deg, *keys.quaternion) = if by_quaternion {
                (None, Some(to.rotation.to_array().map(rounded)))
            } else {
                let (z, y, x) = to.rotation.to_euler(EulerRot::ZYX);
                (Some([x, y, z].map(|angle| rounded(angle.to_degrees()))), None)
            };
        }
        if to.size != from.size {
            (*keys.scale, *keys.size_m) = match to.size {
                Size::LargestM(size_m) => (None, Some(significant(size_m))),
                Size::Scale(s) if s.x == s.y && s.y == s.z => (Some(Scale::All(significant(s.x))), None),
                Size::Scale(s) => (Some(Scale::Each(s.to_array().map(significant))), None),
            };
        }
    }

    /// Title of an item: its own name, or its object's and a number; without a name the file name
    /// of its model.
    pub fn title(&self, of: impl Into<SceneItem>) -> String {
        let entry = match of.into() {
            SceneItem::Object(entry) => entry,
            SceneItem::Lamp(lamp) => return format!("lamp {}", lamp + 1),
        };
        let Some((object, instance)) = self.entry(entry) else { return String::new() };
        let name = || object.title();
        match (instance.and_then(|i| i.name.clone()), entry.instance) {
            (Some(own), _) => own,
            (None, Some(i)) => format!("{} {}", name(), i + 1),
            (None, None) => name(),
        }
    }

    /// Renames an object. The title that it would have without a name is stored as no name.
    pub fn rename(&mut self, entry: Entry, name: &str) {
        let name = Some(name.to_owned()).filter(|name| !name.trim().is_empty());
        match (self.objects.get_mut(entry.object), entry.instance) {
            (Some(object), None) => object.name = name,
            (Some(object), Some(i)) => {
                if let Some(instance) = object.instances.get_mut(i) {
                    instance.name = name;
                }
            }
            (None, _) => {}
        }
    }

    /// Duplicates an item in place, and returns the copy. A name gets the suffix `copy`.
    pub fn duplicate(&mut self, of: impl Into<SceneItem>) -> Option<SceneItem> {
        let entry = match of.into() {
            SceneItem::Object(entry) => entry,
            SceneItem::Lamp(lamp) => return self.duplicate_lamp(lamp),
        };
        let title = self.title(entry);
        let taken: Vec<String> = self.entries().into_iter().map(|entry| self.title(entry)).collect();
        let copies = (1..).map(|n| if n == 1 { format!("{title} copy") } else { format!("{title} copy {n}") });
        let name = copies.into_iter().find(|name| !taken.contains(name));
        let object = self.objects.get_mut(entry.object)?;
        match entry.instance {
            Some(i) => {
                let mut copy = object.instances.get(i)?.clone();
                copy.name = copy.name.and(name);
                object.instances.push(copy);
                Some(Entry { instance: Some(object.instances.len() - 1), ..entry }.into())
            }
            None => {
                let copy = PlacedModel { name, ..object.clone() };
                self.objects.insert(entry.object + 1, copy);
                Some(Entry { object: entry.object + 1, instance: None }.into())
            }
        }
    }

    /// Removes an item. An object is removed with the last of its instances.
    pub fn remove(&mut self, thing: impl Into<SceneItem>) {
        let entry = match thing.into() {
            SceneItem::Object(entry) => entry,
            SceneItem::Lamp(lamp) => return self.remove_lamp(lamp),
        };
        if self.entry(entry).is_none() {
            return;
        }
        let instances = &mut self.objects[entry.object].instances;
        match entry.instance {
            Some(i) if instances.len() > 1 => _ = instances.remove(i),
            _ => _ = self.objects.remove(entry.object),
        }
    }
}

impl PlacedModel {
    /// Name of the object, or the file stem of its model.
    pub fn title(&self) -> String {
        let stem = || std::path::Path::new(&self.model).file_stem().unwrap_or_default().to_string_lossy().into_owned();
        self.name.clone().unwrap_or_else(stem)
    }
}

/// A position for writing; unchanged components keep their bits.
pub(super) fn written_position(from: DVec3, to: DVec3) -> [f64; 3] {
    [0, 1, 2].map(|i| if to[i] != from[i] { rounded(to[i]) } else { from[i] })
}

pub(super) fn rounded(number: f64) -> f64 {
    // Adding zero turns −0 into 0.
    (number * DECIMAL_ROUNDING).round() / DECIMAL_ROUNDING + 0.0
}

/// Rounded to seven significant digits: a model in millimetres has a scale of 0.001.
pub(super) fn significant(number: f64) -> f64 {
    format!("{number:.6e}").parse().unwrap_or(number)
}

#[cfg(test)]
mod tests {
    use super::*;

    const UP: DVec3 = DVec3::Z;

    fn scene(text: &str) -> SceneFile {
        super::super::Document::parse(text).unwrap().value().clone()
    }

    fn cases() -> SceneFile {
        scene(
            "version = 1\n[[objects]]\nname = \"case\"\nmodel = \"a.glb\"\nheading_deg = 10\nscale = 2\n\
             [[objects.instances]]\nposition_m = [1, 2, 3]\nrotation_deg = [90, 0, 35]\n\
             [[objects.instances]]\nname = \"last\"\nquaternion = [0, 0, 0, 1]\nsize_m = 0.02\n\
             [[objects]]\nmodel = \"x/knife.glb\"\n",
        )
    }

    const FIRST: Entry = Entry { object: 0, instance: Some(0) };
    const LAST: Entry = Entry { object: 0, instance: Some(1) };
    const KNIFE: Entry = Entry { object: 1, instance: None };

    #[test]
    fn instance_inherits_from_its_object_and_is_written_separately() {
        let mut file = cases();
        let first = file.placement(FIRST).unwrap();
        assert_eq!((first.heading_deg, first.size), (10.0, Size::Scale(DVec3::splat(2.0))));
        assert_eq!(file.placement(LAST).unwrap().size, Size::LargestM(0.02));
        assert_eq!(file.placement(Entry { object: 0, instance: Some(2) }), None);
        let before = file.clone();
        file.put(FIRST, &first);
        assert_eq!(file, before, "what stays is not written");

        file.put(
            FIRST,
            &ItemPlacement { position_m: DVec3::new(1.0, 2.0 + 0.1 + 0.2, 3.0), ..first.turned(UP, -10.0, UP) },
        );
        let mut expected = before.objects[0].instances[0].clone();
        (expected.position_m, expected.heading_deg) = (Some([1.0, 2.3, 3.0]), Some(0.0));
        assert_eq!(file.objects[0].instances[0], expected);
        file.put(LAST, &file.placement(LAST).unwrap().scaled(DVec3::splat(1.5)));
        assert_eq!(file.objects[0].instances[1].size_m, Some(0.03));
        file.put(KNIFE, &file.placement(KNIFE).unwrap().scaled(DVec3::new(1.0, 0.001, 1.0)));
        assert_eq!(file.objects[1].scale, Some(Scale::Each([1.0, 0.001, 1.0])));
        file.put(KNIFE, &file.placement(KNIFE).unwrap().turned(UP, 200.0, UP));
        assert_eq!(file.objects[1].heading_deg, Some(-160.0));
        file.put(KNIFE, &file.placement(KNIFE).unwrap().turned(-UP, -160.0, UP));
        assert_eq!(file.objects[1].heading_deg, None);
        assert_eq!(
            (&before.objects[0].instances[1].quaternion, before.objects[0].scale),
            (&file.objects[0].instances[1].quaternion, file.objects[0].scale)
        );
    }

    #[test]
    fn rotation_about_any_axis_is_that_rotation_in_the_world() {
        for (entry, axis, degrees) in [
            (FIRST, DVec3::X, 30.0),
            (LAST, DVec3::Y, -75.0),
            (KNIFE, DVec3::new(0.6, 0.0, 0.8), 110.0),
            (FIRST, UP, 15.0),
        ] {
            let mut file = cases();
            let whole = |file: &SceneFile| {
                let placement = file.placement(entry).unwrap();
                DQuat::from_axis_angle(UP, placement.heading_deg.to_radians()) * placement.rotation
            };
            let before = whole(&file);
            let turned = file.placement(entry).unwrap().turned(axis, degrees, UP);
            file.put(entry, &turned);
            let by = whole(&file) * before.conjugate();
            // Angles are written to a millionth of a degree.
            let expected = DQuat::from_axis_angle(axis, degrees.to_radians());
            assert!(by.angle_between(expected) < 1e-6, "{entry:?} {axis}: {by}");
            // Rotations keep their representation, quaternion or angles.
            let last = &file.objects[0].instances[1];
            assert!(last.quaternion.is_some() && last.rotation_deg.is_none());
            assert!(file.objects[0].instances[0].rotation_deg.is_some() && file.objects[1].quaternion.is_none());
        }
    }

    #[test]
    fn items_are_renamed_duplicated_and_removed() {
        let mut file = cases();
        let titles = |file: &SceneFile| file.entries().into_iter().map(|entry| file.title(entry)).collect::<Vec<_>>();
        assert_eq!(titles(&file), ["case 1", "last", "knife"]);
        file.rename(LAST, " ");
        file.rename(KNIFE, "blade");
        assert_eq!(titles(&file), ["case 1", "case 2", "blade"]);
        file = cases();
        assert_eq!(file.duplicate(FIRST), Some(Entry { object: 0, instance: Some(2) }.into()));
        assert_eq!(file.duplicate(LAST), Some(Entry { object: 0, instance: Some(3) }.into()));
        assert_eq!(file.duplicate(KNIFE), Some(Entry { object: 2, instance: None }.into()));
        assert_eq!(file.duplicate(KNIFE), Some(Entry { object: 2, instance: None }.into()));
        assert_eq!(titles(&file), ["case 1", "last", "case 3", "last copy", "knife", "knife copy 2", "knife copy"]);
        assert_eq!(file.duplicate(Entry { object: 9, instance: None }), None);
        for _ in 0..4 {
            file.remove(FIRST);
        }
        assert_eq!(titles(&file), ["knife", "knife copy 2", "knife copy"]);
        file.remove(KNIFE);
        assert_eq!(titles(&file), ["knife", "knife copy"]);
        file.remove(FIRST);
        assert_eq!(titles(&file), ["knife", "knife copy"], "it has no instances");
    }
}
