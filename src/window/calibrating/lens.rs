//! Focal length, principal point and distortion of a live camera, from a board that is held before
//! it.

use std::sync::Arc;

use eframe::egui::{self, Color32, Sense, Ui};

use super::super::session::Session;
use super::parts::{self, Decision};
use super::views::{CollectionStatus, ViewCollection};
use locard_engine::calibrate::geometry::{CameraCalibration, Coverage, Parameter, ViewOutcome};
use locard_engine::frame::Frame;
use locard_engine::params::Value;
use locard_engine::text::{fixed, without_options};

/// Smallest number of views for a fit: fewer do not determine the principal point.
const MIN_VIEWS: usize = 3;

/// State of the section.
#[derive(Debug, Default)]
pub struct LensPanel {
    views: Option<ViewCollection>,
    /// Result of the fit.
    result: Option<Result<CameraCalibration, String>>,
}

impl LensPanel {
    /// Passes the newest frame to the board detection and takes its result.
    pub fn process_newest(&mut self, session: &Session) {
        let Some(views) = &mut self.views else { return };
        session.newest().iter().for_each(|frame| views.process(frame));
        if let Some(result) = views.take() {
            (self.views, self.result) = (None, Some(result));
        }
    }

    pub fn show(&mut self, ui: &mut Ui, session: &mut Session) {
        if let Some(views) = &self.views {
            let status = views.status();
            view_progress(ui, &status);
            let mut is_given_up = false;
            ui.horizontal(|ui| {
                let enough = status.views >= MIN_VIEWS && !status.is_fitting;
                let finish = ui.add_enabled(enough, egui::Button::new("Finish"));
                if finish.on_hover_text("With the views there are").clicked() {
                    views.end();
                }
                is_given_up = ui.button("Cancel").clicked();
            });
            if is_given_up {
                self.views = None;
            }
            return;
        }
        parts::aside(
            ui,
            "Hold the sheet of tags (locard board) or a chessboard before the camera: flat, still, then elsewhere, tilted to \
             all sides. Views are taken by themselves. One zoom, one focus.",
        );
        match session.newest() {
            Some(frame) => {
                if ui.button("Calibrate camera…").clicked() {
                    self.begin(ui, session, &frame);
                }
            }
            None => parts::aside(ui, "Open a camera first: File, Live camera…"),
        }
        match &self.result {
            Some(Ok(calibrated)) => {
                let calibrated = calibrated.clone();
                self.result(ui, session, &calibrated);
            }
            Some(Err(why)) => _ = ui.colored_label(ui.visuals().warn_fg_color, without_options(why)),
            None => {}
        }
    }

    fn begin(&mut self, ui: &Ui, session: &mut Session, frame: &Arc<Frame>) {
        let (size, wake) = ((frame.pixels.width, frame.pixels.height), ui.ctx().clone());
        self.result = None;
        match ViewCollection::begin(size, &session.project.edit().rig.response, move || wake.request_repaint()) {
            Ok(views) => self.views = Some(views),
            Err(why) => session.show_error(why),
        }
    }

    /// Measured beside current values.
    fn result(&mut self, ui: &mut Ui, session: &mut Session, calibrated: &CameraCalibration) {
        ui.label(calibrated.origin());
        egui::Grid::new("lens").num_columns(3).striped(true).show(ui, |ui| {
            ["", "current", "measured"].into_iter().for_each(|head| _ = ui.weak(head));
            ui.end_row();
            for parameter in &calibrated.parameters {
                ui.label(parameter.name);
                let present = match session.project.value(parameter.table(), parameter.name) {
                    Some(Value::Number(present)) => fixed(present, parameter.digits()),
                    _ => String::new(),
                };
                ui.label(present);
                ui.label(parameter.shown());
                ui.end_row();
            }
        });
        calibrated.missing.iter().for_each(|wish| parts::aside(ui, format!("missing: {wish}")));
        calibrated.notes.iter().for_each(|note| parts::aside(ui, note));
        let is_set = |parameter: &Parameter| {
            let present = session.project.value(parameter.table(), parameter.name);
            present == Some(Value::Number(parameter.value))
        };
        let is_applied = calibrated.parameters.iter().all(is_set);
        match parts::apply_or_discard(ui, "camera", is_applied) {
            Some(Decision::Apply) => {
                session.project.set_geometry(&calibrated.geometry);
                session.show_message(
                    "The measured camera is in use. Save it and open the camera again to read tags with it",
                );
            }
            Some(Decision::Discard) => self.result = None,
            None => {}
        }
    }
}

fn view_progress(ui: &mut Ui, status: &CollectionStatus) {
    let share = fixed(100.0 * status.coverage.share(), 0);
    ui.label(format!("{} of {} views, {share} % of the picture seen", status.views, status.min_views));
    coverage(ui, &status.coverage);
    if status.is_fitting {
        ui.horizontal(|ui| {
            ui.spinner();
            ui.label("the views are being fitted");
        });
        return;
    }
    let now = match status.look {
        None => "Looking for a board",
        Some(ViewOutcome::NoBoard) => "No board detected",
        Some(ViewOutcome::Moving) => "The board moves: hold it still",
        Some(ViewOutcome::Redundant) => "This view exists already: hold the board elsewhere",
        Some(ViewOutcome::Accepted) => "Accepted: move on",
    };
    ui.label(now);
    if let Some(hint) = &status.hint {
        ui.strong(hint);
    }
    for wish in &status.missing {
        parts::aside(ui, format!("missing: {wish}"));
    }
}

/// Map of the picture's cells in which the board has been detected.
fn coverage(ui: &mut Ui, coverage: &Coverage) {
    let size = egui::vec2(160.0, 120.0);
    let (rect, response) = ui.allocate_exact_size(size, Sense::hover());
    let cell = size / egui::vec2(coverage.columns as f32, coverage.rows as f32);
    let covered_color = ui.visuals().selection.bg_fill;
    ui.painter().rect_filled(rect, 0.0, ui.visuals().extreme_bg_color);
    for (n, is_seen) in coverage.covered.iter().enumerate() {
        let at = egui::vec2((n % coverage.columns) as f32, (n / coverage.columns) as f32) * cell;
        let color = if *is_seen { covered_color } else { Color32::TRANSPARENT };
        ui.painter().rect_filled(egui::Rect::from_min_size(rect.min + at, cell).shrink(1.0), 0.0, color);
    }
    response.on_hover_text("The picture: where the board has been seen");
}
