//! Comparison of virtual noise with the camera's in flat places of the whole recording, in the tab
//! Match.

use eframe::egui::{Button, Grid, RichText, Ui};

use super::background::Background;
use super::progress;
use super::session::Session;
use locard_engine::text::without_options;
use locard_engine::verify::{self, NoiseComparison};

/// The last comparison.
#[derive(Debug, Default)]
pub struct NoiseMatch {
    /// Version of the project that is to be compared.
    requested: Option<u64>,
    comparison: Background<u64, Result<NoiseComparison, String>>,
}

impl NoiseMatch {
    pub fn show(&mut self, ui: &mut Ui, session: &Session) {
        if ui.add_enabled(!session.is_live(), Button::new("Compare with the camera")).clicked() {
            self.requested = Some(session.project.version());
        }
        if let Some(version) = self.requested {
            let (shot, gpu) = (session.project.shot().clone(), session.viewer.gpu().clone());
            self.comparison.request(ui.ctx(), version, move |control| {
                let progress = |done: usize, of: usize| {
                    control.set_progress(done as f64 / of.max(1) as f64);
                    !control.is_cancelled()
                };
                let comparison = verify::noise(&gpu, &shot, progress).map_err(|error| error.to_string())?;
                comparison.map_err(|why| why.to_string())
            });
            if self.comparison.is_of(&version) || self.comparison.failure().is_some() {
                self.requested = None;
            }
        }
        progress::of(ui, "Comparison of noise", &self.comparison);
        match self.comparison.last() {
            Some(Ok(comparison)) => {
                Grid::new("noise beside the camera's").num_columns(2).show(ui, |ui| {
                    for (label, text) in comparison.lines() {
                        ui.label(RichText::new(label.trim()).small().weak());
                        ui.add(eframe::egui::Label::new(RichText::new(text).small()).wrap());
                        ui.end_row();
                    }
                });
            }
            Some(Err(why)) => progress::refused(ui, &format!("The noise was not compared: {}", without_options(why))),
            None => {}
        }
        if self.comparison.last_key().is_some_and(|version| *version != session.project.version()) {
            ui.label(RichText::new("Something has changed since this comparison.").small().weak());
        }
    }

    pub fn cancel(&mut self) {
        self.requested = None;
        self.comparison.cancel();
    }

    /// Drops the result while the pictures of a live camera change.
    pub fn clear(&mut self) {
        self.requested = None;
        self.comparison.clear();
    }
}
