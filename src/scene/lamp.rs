//! Lamps of a scene file as placeable items, with their diameter as size.

use glam::{DQuat, DVec3};

use super::document::{Color, LampTable, SceneFile, SceneItem};
use super::edit::{ItemPlacement, rounded, significant, written_position};
use super::light::BULB_DIAMETER_M;
use super::place::Size;

impl LampTable {
    /// Diameter of the lamp itself, metres; a bulb's if the file gives none.
    pub fn diameter_or_default_m(&self) -> f64 {
        self.diameter_m.unwrap_or(BULB_DIAMETER_M)
    }

    /// Linear colour; white if the file gives none.
    pub fn rgb(&self) -> [f64; 3] {
        match self.color {
            None => [1.0; 3],
            Some(Color::Grey(v)) => [v; 3],
            Some(Color::Rgb(rgb)) => rgb,
        }
    }
}

impl SceneFile {
    /// Placement of a lamp. It is isotropic, so the rotation has no effect.
    pub(super) fn lamp_placement(&self, lamp: usize) -> Option<ItemPlacement> {
        let lamp = self.light.lamp.get(lamp)?;
        Some(ItemPlacement {
            position_m: lamp.at_m.into(),
            rotation: DQuat::IDENTITY,
            heading_deg: 0.0,
            size: Size::LargestM(lamp.diameter_or_default_m()),
        })
    }

    /// Keys with unchanged values are not rewritten.
    pub(super) fn put_lamp(&mut self, lamp: usize, to: &ItemPlacement) {
        let Some(from) = self.lamp_placement(lamp) else { return };
        let lamp = &mut self.light.lamp[lamp];
        lamp.at_m = written_position(from.position_m, to.position_m);
        if to.size != from.size
            && let Size::LargestM(diameter_or_default_m) = to.size
        {
            lamp.diameter_m = Some(significant(diameter_or_default_m));
        }
    }

    /// Inserted after the original.
    pub(super) fn duplicate_lamp(&mut self, lamp: usize) -> Option<SceneItem> {
        let copy = self.light.lamp.get(lamp)?.clone();
        self.light.lamp.insert(lamp + 1, copy);
        Some(SceneItem::Lamp(lamp + 1))
    }

    pub(super) fn remove_lamp(&mut self, lamp: usize) {
        if lamp < self.light.lamp.len() {
            self.light.lamp.remove(lamp);
        }
    }

    /// Appends a lamp: a bulb under which white diffuse at 1 m is white.
    pub fn add_lamp(&mut self, at_m: DVec3) -> SceneItem {
        let at_m = at_m.to_array().map(rounded);
        self.light.lamp.push(LampTable { at_m, color: None, intensity: Some(1.0), diameter_m: None });
        SceneItem::Lamp(self.light.lamp.len() - 1)
    }
}

#[cfg(test)]
mod tests {
    use super::super::Document;
    use super::*;

    const TEXT: &str = "version = 1\n\n[light]\nambient = 0.2\n\n# Over the door.\n[[light.lamp]]\nat_m = [0.1, 2, 2.25] # measured\n\
                        color = [5.4, 5.1, 4.6]\n\n# The desk's.\n[[light.lamp]]\nat_m = [1, 1, 1]\ndiameter_m = 0.25\n";

    #[test]
    fn editing_a_lamp_preserves_comments() {
        let mut document = Document::parse(TEXT).unwrap();
        let mut file = document.value().clone();
        let [door, desk] = [0, 1].map(SceneItem::Lamp);
        assert_eq!((file.title(door), file.title(desk)), ("lamp 1".to_owned(), "lamp 2".to_owned()));
        let was = file.placement(door).unwrap();
        assert_eq!((was.position_m, was.size), (DVec3::new(0.1, 2.0, 2.25), Size::LargestM(0.06)));
        file.put(door, &was);
        assert_eq!(&file, document.value(), "what stays is not written");

        // 0.1 + 0.2 is 0.30000000000000004.
        file.put(door, &ItemPlacement { position_m: was.position_m + DVec3::new(0.2, 0.0, 0.0), ..was });
        file.put(desk, &file.placement(desk).unwrap().scaled(DVec3::splat(2.0)));
        document.set(file.clone()).unwrap();
        let expected = TEXT.replace("[0.1, 2, 2.25]", "[0.3, 2.0, 2.25]").replace("= 0.25", "= 0.5");
        assert_eq!(document.to_string(), expected);

        assert_eq!(file.duplicate(door), Some(SceneItem::Lamp(1)));
        assert_eq!(file.light.lamp[1], file.light.lamp[0]);
        assert_eq!(file.placement(SceneItem::Lamp(2)).unwrap().position_m, DVec3::ONE);
        file.remove(SceneItem::Lamp(1));
        file.remove(door);
        document.set(file.clone()).unwrap();
        let text = document.to_string();
        assert!(text.contains("# The desk's.") && !text.contains("color"), "{text}");
        // There is no third one.
        let before = file.clone();
        file.remove(SceneItem::Lamp(2));
        file.put(SceneItem::Lamp(2), &was);
        assert_eq!((file.placement(SceneItem::Lamp(2)), file.duplicate(SceneItem::Lamp(2))), (None, None));
        assert_eq!(file, before);
    }

    #[test]
    fn added_lamp_is_written_with_its_light() {
        let mut document = Document::parse("version = 1 # mine\n").unwrap();
        let mut file = document.value().clone();
        assert_eq!(file.add_lamp(DVec3::new(0.1 + 0.2, -0.0, 1.0)), SceneItem::Lamp(0));
        document.set(file).unwrap();
        let expected = "version = 1 # mine\n\n[[light.lamp]]\nat_m = [0.3, 0.0, 1.0]\nintensity = 1.0\n";
        assert_eq!(document.to_string(), expected);
    }
}
