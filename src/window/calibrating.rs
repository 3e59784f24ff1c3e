//! The tab Calibrate: lens from a board before a live camera, noise from uniform areas, sharpness
//! from edges. Each result is shown beside the current value, to be accepted or discarded.

mod lens;
mod noise;
mod parts;
mod sharpness;
mod views;

use eframe::egui::{self, RichText, Ui};

use self::lens::LensPanel;
use self::noise::NoisePanel;
use self::sharpness::SharpnessPanel;
use super::session::Session;
use super::tool::ToolStack;
use locard_engine::calibrate::NoisePoint;
use locard_engine::pixels::Rect;

/// State of the tab.
#[derive(Debug, Default)]
pub struct Calibrating {
    lens: LensPanel,
    noise: NoisePanel,
    sharpness: SharpnessPanel,
}

impl Calibrating {
    /// Picked regions that belong to a frame.
    pub fn marks(&self, frame: usize) -> impl Iterator<Item = (Rect, String)> {
        self.noise.marks(frame).chain(self.sharpness.marks(frame))
    }

    /// Last measured noise points of the picked regions.
    pub fn points(&self) -> Option<&[Vec<NoisePoint>; 3]> {
        self.noise.points()
    }

    /// Passes a live camera's newest frame to the board detection, while views are being collected.
    pub fn process_newest(&mut self, session: &Session) {
        self.lens.process_newest(session);
    }

    /// Cancels running measurements.
    pub fn cancel(&mut self) {
        self.noise.cancel();
        self.sharpness.cancel();
    }

    pub fn show(&mut self, ui: &mut Ui, session: &mut Session, tools: &mut ToolStack) {
        self.noise.take_picked(session, tools);
        self.sharpness.take_picked(session, tools);
        egui::ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
            let open = |title: &str| egui::CollapsingHeader::new(RichText::new(title).strong()).default_open(true);
            open("Lens, from a board").show(ui, |ui| self.lens.show(ui, session));
            ui.separator();
            open("Noise, from uniform areas").show(ui, |ui| self.noise.show(ui, session, tools));
            ui.separator();
            open("Sharpness, from edges").show(ui, |ui| self.sharpness.show(ui, session, tools));
        });
    }
}
