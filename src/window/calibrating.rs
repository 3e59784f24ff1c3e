//! Calibration from inside: a board before a camera gives the lens, plain places give the noise, edges the sharpness. Each result stands beside the present value, and
//! is taken or left.

mod lens;
mod noise;
mod parts;
mod sharpness;
mod views;

use eframe::egui::{self, RichText, Ui};

use self::lens::Lens;
use self::noise::Noise;
use self::sharpness::Sharpness;
use super::region_picker::RegionPicker;
use super::session::Session;
use locard_engine::calibrate::NoisePoint;
use locard_engine::pixels::Rect;

/// The tab.
#[derive(Debug, Default)]
pub struct Calibrating {
    lens: Lens,
    noise: Noise,
    sharpness: Sharpness,
}

impl Calibrating {
    /// The places that were picked, as far as they belong to a frame.
    pub fn marks(&self, frame: usize) -> impl Iterator<Item = (Rect, String)> {
        self.noise.marks(frame).chain(self.sharpness.marks(frame))
    }

    /// The noise of the places that were picked, as it was measured last.
    pub fn points(&self) -> Option<&[Vec<NoisePoint>; 3]> {
        self.noise.points()
    }

    /// Has a camera's newest frame looked at, where views of a board are taken of it.
    pub fn look(&mut self, session: &Session) {
        self.lens.look(session);
    }

    /// Nobody waits for what is being measured.
    pub fn rest(&mut self) {
        self.noise.rest();
        self.sharpness.rest();
    }

    pub fn show(&mut self, ui: &mut Ui, session: &mut Session, picker: &mut RegionPicker) {
        self.noise.answers(session, picker);
        self.sharpness.answers(session, picker);
        egui::ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
            let open = |title: &str| egui::CollapsingHeader::new(RichText::new(title).strong()).default_open(true);
            open("Lens, from a board").show(ui, |ui| self.lens.show(ui, session));
            ui.separator();
            open("Noise, from plain places").show(ui, |ui| self.noise.show(ui, session, picker));
            ui.separator();
            open("Sharpness, from edges").show(ui, |ui| self.sharpness.show(ui, session, picker));
        });
    }
}
