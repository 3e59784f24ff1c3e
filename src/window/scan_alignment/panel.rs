//! The controls of the panel that aligns a scan.

use std::sync::Arc;

use eframe::egui::{self, Align, Button, Label, Layout, RichText, Ui, vec2};

use super::super::progress::refused;
use super::super::scan_pick::ScanPick;
use super::super::session::Session;
use super::super::tool::{Tool, ToolStack};
use super::ScanAlignment;
use super::tasks::name;
use locard_engine::pose::Pose;
use locard_engine::site::SiteScan;
use locard_engine::text::count;

/// Lengths of a scan's unit, m, with their names.
const UNITS: [(Option<f64>, &str); 5] =
    [(None, "of the file"), (Some(1.0), "1 m"), (Some(0.01), "1 cm"), (Some(0.001), "1 mm"), (Some(0.3048), "1 foot")];
/// Share of the panel's height for the view of the scan.
const VIEW_SHARE: f32 = 0.56;

impl ScanAlignment {
    /// Shows the panel.
    pub fn show(&mut self, ui: &mut Ui, session: &mut Session, tools: &mut ToolStack) {
        ui.horizontal(|ui| {
            ui.strong("Scan of the place");
            ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
                if ui.button("Close").on_hover_text("The pairs stay until the recording is closed").clicked() {
                    self.close(tools);
                }
                let is_free = self.reading.is_none() && self.aligning.is_none();
                if ui.add_enabled(is_free, Button::new("Choose another…")).clicked() {
                    self.chooses_file = true;
                }
            });
        });
        if let Some(reading) = &self.reading {
            if reading.show(ui) {
                self.reading = None;
                self.is_open = self.scan.is_some();
            }
            return;
        }
        let Some(scan) = self.scan.clone() else {
            self.error.iter().for_each(|why| refused(ui, why));
            return;
        };
        self.description(ui, &scan);
        self.scan_view(ui, session, tools, &scan);
        self.hint(ui, tools);
        egui::ScrollArea::vertical().show(ui, |ui| {
            self.actions(ui, session);
            self.pairs.show(ui, &mut session.player);
        });
    }

    /// The file, its size and its unit.
    fn description(&mut self, ui: &mut Ui, scan: &SiteScan) {
        let text = format!("{}: {}", name(&scan.path), scan.description());
        ui.add(Label::new(RichText::new(&text).weak()).truncate()).on_hover_text(text);
        let present = self.metres_per_unit;
        ui.horizontal(|ui| {
            let label =
                ui.label("Unit of the coordinates").on_hover_text("PLY, OBJ, STL and text have no unit: metres");
            let other = present.map(|metres| format!("{metres} m"));
            let named = UNITS.iter().find(|(metres, _)| *metres == present).map(|(_, name)| (*name).to_owned());
            let combo = egui::ComboBox::from_id_salt("scan unit").selected_text(named.or(other).unwrap_or_default());
            let combo = combo.show_ui(ui, |ui| {
                for (metres, name) in UNITS {
                    ui.selectable_value(&mut self.metres_per_unit, metres, name);
                }
            });
            combo.response.labelled_by(label.id);
        });
        if self.metres_per_unit != present {
            self.begin_reading(ui.ctx(), scan.path.clone());
        }
    }

    /// The view of the scan with its buttons and marks.
    fn scan_view(&mut self, ui: &mut Ui, session: &Session, tools: &mut ToolStack, scan: &Arc<SiteScan>) {
        ui.horizontal(|ui| {
            if ui.button("Fit").on_hover_text("The whole scan").clicked() {
                self.view.fit();
            }
            let as_camera = camera_from_scan(session, scan);
            let button = ui.add_enabled(as_camera.is_some(), Button::new("As the camera"));
            let button = button.on_hover_text("The scan from the place of this frame's camera");
            if button.on_disabled_hover_text("Once the scan is aligned").clicked() {
                as_camera.iter().for_each(|pose| self.view.take_pose(pose));
            }
            let label = ui.label("Cut away").on_hover_text("Removes near surfaces, to look into a room from outside");
            let slider = egui::Slider::new(&mut self.view.cut, 0.0..=1.5).show_value(false);
            if ui.add(slider).labelled_by(label.id).changed() {
                self.view.touch(ui.input(|i| i.time));
            }
        });
        let height = (VIEW_SHARE * ui.max_rect().height()).max(120.0);
        let rect = egui::Rect::from_min_size(ui.cursor().min, vec2(ui.available_width(), height));
        let output = self.view.show(ui, rect, scan);
        match output.clicked_m {
            Some(Some(point_m)) if tools.scan_pick().is_some() => {
                self.pairs.pending_point = Some(point_m / scan.metres_per_unit);
                self.error = None;
                ui.ctx().request_repaint();
            }
            Some(None) if tools.scan_pick().is_some() => {
                self.error = Some("There is no point of the scan: click a surface".to_owned());
            }
            _ => {}
        }
        self.pairs.paint_in_view(&output.painter, &self.view, scan);
    }

    /// The next step.
    fn hint(&self, ui: &mut Ui, tools: &mut ToolStack) {
        ui.horizontal_wrapped(|ui| {
            let is_active = tools.scan_pick().is_some();
            if ui.add(Button::selectable(is_active, "Pick pairs").frame_when_inactive(true)).clicked() {
                if is_active { _ = tools.cancel() } else { tools.begin(Tool::PickScan(ScanPick::default())) }
            }
            let is_view_picked = tools.scan_pick().is_some_and(|pick| pick.view.is_some());
            let text = match (is_active, is_view_picked, self.pairs.pending_point) {
                (false, ..) => "Drag turns the scan, Shift and drag moves it, the wheel zooms.",
                (_, true, _) => "Now click the same point in the scan.",
                (_, _, Some(_)) => "Now click the same point in the picture, in any frame.",
                _ => "Click a point in the picture, then the same point in the scan. Drag turns the scan.",
            };
            ui.add(Label::new(RichText::new(text).weak()).wrap());
        });
    }

    /// The options, the buttons, and the result of the last alignment.
    fn actions(&mut self, ui: &mut Ui, session: &mut Session) {
        ui.add_space(4.0);
        ui.checkbox(&mut self.refines, "Refine by the pictures").on_hover_text(
            "The scan is moved by some millimetres, until its surface has the same brightness in all frames. Takes up \
             to a minute.",
        );
        let hint = "They lie on the edges of the real things if the scan is in its place.";
        ui.checkbox(&mut self.shows_edges, "Edges of the scan over the picture").on_hover_text(hint);
        if !session.project.shot().recording.kind.is_metric() {
            let hint = "For recordings without a scale. Needs four pairs in frames from different positions.";
            ui.checkbox(&mut self.finds_scale, "Find the scale of the recording").on_hover_text(hint);
        }
        if let Some(task) = &self.aligning {
            if task.show(ui) {
                self.aligning = None;
                session.show_message("The alignment was cancelled");
            }
            return;
        }
        ui.horizontal(|ui| {
            let hint = match self.pairs.pairs().len() {
                0 => "Without pairs: at its present place, or with the axes of the world".to_owned(),
                pairs => format!("By {}; four or more are needed in most cases", count(pairs, "pair")),
            };
            if ui.button("Align").on_hover_text(hint).clicked() {
                self.begin_alignment(ui.ctx(), session);
            }
            let is_placed = session.project.edit().scene.site.is_some();
            if ui.add_enabled(is_placed, Button::new("Remove the scan")).clicked() {
                match session.project.remove_scan() {
                    Ok(()) => {
                        self.report.clear();
                        session.show_message("The scan was removed from the scene");
                    }
                    Err(error) => self.fail(session, error.to_string()),
                }
            }
        });
        self.error.iter().for_each(|why| refused(ui, why));
        for line in &self.report {
            ui.add(Label::new(line).wrap());
        }
    }
}

/// The pose of the displayed frame's camera in the axes of the scan, if it is the scene's scan.
fn camera_from_scan(session: &Session, scan: &Arc<SiteScan>) -> Option<Pose> {
    let recording = &session.project.shot().recording;
    let site = recording.site().filter(|site| site.scan.path == scan.path)?;
    let camera = recording.pose_at_frame(session.frame()?.index).ok()?;
    // camera_from_scan = camera_from_world · world_from_scan.
    let origin = camera.transform_point(site.world_from_scan.translation_m);
    Some(Pose::new(camera.rotation * site.world_from_scan.rotation, origin))
}
