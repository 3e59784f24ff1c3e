//! A lamp of a scene file as a thing that stands somewhere: its place, and its diameter as its size.

use glam::{DQuat, DVec3};

use super::document::{Color, LampTable, SceneFile, Thing};
use super::edit::{Stance, moved, rounded, significant};
use super::light::BULB_M;
use super::place::Size;

impl LampTable {
    /// Of the lamp itself, metres: a bulb's where the file does not say it.
    pub fn wide_m(&self) -> f64 {
        self.diameter_m.unwrap_or(BULB_M)
    }

    /// Its colour, linear; white where the file does not say it.
    pub fn rgb(&self) -> [f64; 3] {
        match self.color {
            None => [1.0; 3],
            Some(Color::Grey(v)) => [v; 3],
            Some(Color::Rgb(rgb)) => rgb,
        }
    }
}

impl SceneFile {
    /// It shines alike into all directions: how it is turned says nothing.
    pub(super) fn lamp_stance(&self, lamp: usize) -> Option<Stance> {
        let lamp = self.light.lamp.get(lamp)?;
        Some(Stance {
            position_m: lamp.at_m.into(),
            rotation: DQuat::IDENTITY,
            heading_deg: 0.0,
            size: Size::LargestM(lamp.wide_m()),
        })
    }

    /// Keys whose value stays are left as they are.
    pub(super) fn put_lamp(&mut self, lamp: usize, to: &Stance) {
        let Some(from) = self.lamp_stance(lamp) else { return };
        let lamp = &mut self.light.lamp[lamp];
        lamp.at_m = moved(from.position_m, to.position_m);
        if to.size != from.size
            && let Size::LargestM(wide_m) = to.size
        {
            lamp.diameter_m = Some(significant(wide_m));
        }
    }

    /// Behind the first.
    pub(super) fn duplicate_lamp(&mut self, lamp: usize) -> Option<Thing> {
        let copy = self.light.lamp.get(lamp)?.clone();
        self.light.lamp.insert(lamp + 1, copy);
        Some(Thing::Lamp(lamp + 1))
    }

    pub(super) fn remove_lamp(&mut self, lamp: usize) {
        if lamp < self.light.lamp.len() {
            self.light.lamp.remove(lamp);
        }
    }

    /// Puts another lamp behind the others: a bulb whose white matt at 1 m is white.
    pub fn add_lamp(&mut self, at_m: DVec3) -> Thing {
        let at_m = at_m.to_array().map(rounded);
        self.light.lamp.push(LampTable { at_m, color: None, intensity: Some(1.0), diameter_m: None });
        Thing::Lamp(self.light.lamp.len() - 1)
    }
}

#[cfg(test)]
mod tests {
    use super::super::Document;
    use super::*;

    const TEXT: &str = "version = 1\n\n[light]\nambient = 0.2\n\n# Over the door.\n[[light.lamp]]\nat_m = [0.1, 2, 2.25] # measured\n\
                        color = [5.4, 5.1, 4.6]\n\n# The desk's.\n[[light.lamp]]\nat_m = [1, 1, 1]\ndiameter_m = 0.25\n";

    #[test]
    fn a_lamp_is_moved_made_larger_doubled_and_taken_away_and_comments_stay() {
        let mut document = Document::parse(TEXT).unwrap();
        let mut file = document.value().clone();
        let [door, desk] = [0, 1].map(Thing::Lamp);
        assert_eq!((file.title(door), file.title(desk)), ("lamp 1".to_owned(), "lamp 2".to_owned()));
        let was = file.stance(door).unwrap();
        assert_eq!((was.position_m, was.size), (DVec3::new(0.1, 2.0, 2.25), Size::LargestM(0.06)));
        file.put(door, &was);
        assert_eq!(&file, document.value(), "what stays is not written");

        // 0.1 + 0.2 is 0.30000000000000004.
        file.put(door, &Stance { position_m: was.position_m + DVec3::new(0.2, 0.0, 0.0), ..was });
        file.put(desk, &file.stance(desk).unwrap().scaled(DVec3::splat(2.0)));
        document.set(file.clone()).unwrap();
        let expected = TEXT.replace("[0.1, 2, 2.25]", "[0.3, 2.0, 2.25]").replace("= 0.25", "= 0.5");
        assert_eq!(document.to_string(), expected);

        assert_eq!(file.duplicate(door), Some(Thing::Lamp(1)));
        assert_eq!(file.light.lamp[1], file.light.lamp[0]);
        assert_eq!(file.stance(Thing::Lamp(2)).unwrap().position_m, DVec3::ONE);
        file.remove(Thing::Lamp(1));
        file.remove(door);
        document.set(file.clone()).unwrap();
        let text = document.to_string();
        assert!(text.contains("# The desk's.") && !text.contains("color"), "{text}");
        // There is no third one.
        let before = file.clone();
        file.remove(Thing::Lamp(2));
        file.put(Thing::Lamp(2), &was);
        assert_eq!((file.stance(Thing::Lamp(2)), file.duplicate(Thing::Lamp(2))), (None, None));
        assert_eq!(file, before);
    }

    #[test]
    fn a_lamp_that_is_added_is_written_as_it_shines() {
        let mut document = Document::parse("version = 1 # mine\n").unwrap();
        let mut file = document.value().clone();
        assert_eq!(file.add_lamp(DVec3::new(0.1 + 0.2, -0.0, 1.0)), Thing::Lamp(0));
        document.set(file).unwrap();
        let expected = "version = 1 # mine\n\n[[light.lamp]]\nat_m = [0.3, 0.0, 1.0]\nintensity = 1.0\n";
        assert_eq!(document.to_string(), expected);
    }
}
