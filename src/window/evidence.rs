//! The evidence: what there is to place, what has been placed, and where.

use std::path::{Path, PathBuf};

use eframe::egui::{self, RichText, Ui};
use glam::{DVec2, DVec3};

use super::Project;
use super::controls::parse_number;
use crate::frame::Frame;
use crate::scene::document::PlacedModel;
use crate::scene::{Posture, Support, lay, relative};
use crate::words::number;

/// What is being done with the evidence.
#[derive(Clone, Debug, Default)]
pub struct Evidence {
    /// The models that can be placed.
    library: Vec<PathBuf>,
    looked_in: Option<PathBuf>,
    /// The model that the next click places.
    placing: Option<PathBuf>,
    lies_flat: bool,
    heading_deg: f64,
    selected: Option<usize>,
}

impl Evidence {
    /// Whether the next click in the picture places something.
    pub fn is_placing(&self) -> bool {
        self.placing.is_some()
    }

    pub fn cancel(&mut self) {
        self.placing = None;
    }

    /// Shows the list and the controls of what is selected. Gives back what went wrong.
    pub fn show(&mut self, ui: &mut Ui, project: &mut Project) -> Option<String> {
        let mut wrong = None;
        ui.strong("Evidence");
        if !project.can_place() {
            ui.label("A model alone stands by its own coordinates. Open a scene file, or none, to place evidence.");
            return None;
        }
        self.look(&project.scene_path());
        let text = self.placing.as_deref().map_or_else(|| "Place…".to_owned(), name);
        let menu = ui.menu_button(text, |ui| {
            egui::ScrollArea::vertical().max_height(320.0).show(ui, |ui| {
                for model in &self.library {
                    if ui.button(name(model)).on_hover_text(model.display().to_string()).clicked() {
                        self.lies_flat = !stands(model);
                        self.placing = Some(model.clone());
                        ui.close();
                    }
                }
                if self.library.is_empty() {
                    ui.label("No .glb beside the scene file. Drop one into the window.");
                }
            });
        });
        menu.response.on_hover_text(
            "Choose a model, then click where it shall lie. A .glb dropped into the window is taken too.",
        );
        if self.is_placing() {
            ui.horizontal(|ui| {
                ui.selectable_value(&mut self.lies_flat, false, "upright");
                ui.selectable_value(&mut self.lies_flat, true, "flat");
                numeric(ui, "heading of what is placed", &mut self.heading_deg, 1.0, " °");
            });
            ui.label(RichText::new("Click in the picture; Esc ends it.").weak());
        }
        ui.separator();
        let objects = project.edit().scene.objects.clone();
        self.selected = self.selected.filter(|selected| *selected < objects.len());
        egui::ScrollArea::vertical().max_height(220.0).auto_shrink([false, true]).show(ui, |ui| {
            for (i, object) in objects.iter().enumerate() {
                let count = object.instances.len();
                let more = if count > 1 { format!(" ×{count}") } else { String::new() };
                if ui.selectable_label(self.selected == Some(i), format!("{}{more}", title(object))).clicked() {
                    self.selected = if self.selected == Some(i) { None } else { Some(i) };
                }
            }
        });
        if let Some(i) = self.selected {
            ui.separator();
            wrong = self.selected(ui, project, i, &objects[i]);
        }
        wrong
    }

    fn selected(&mut self, ui: &mut Ui, project: &mut Project, i: usize, object: &PlacedModel) -> Option<String> {
        let mut changed = object.clone();
        let mut done = false;
        let mut edit_name = title(object);
        if ui.add(egui::TextEdit::singleline(&mut edit_name).desired_width(180.0)).changed() {
            changed.name = Some(edit_name).filter(|name| !name.is_empty());
        }
        if object.instances.is_empty() {
            let mut position = object.position_m.unwrap_or_default();
            for (axis, value) in ["x", "y", "z"].into_iter().zip(&mut position) {
                ui.horizontal(|ui| {
                    ui.label(axis);
                    let response = numeric(ui, &format!("position {axis}"), value, 0.002, " m");
                    done |= response.drag_stopped() || response.lost_focus();
                });
            }
            if position != object.position_m.unwrap_or_default() {
                changed.position_m = Some(position.map(|n| (n * 1e4).round() / 1e4));
            }
            let mut heading = object.heading_deg.unwrap_or(0.0);
            ui.horizontal(|ui| {
                ui.label("heading");
                let response = numeric(ui, "heading", &mut heading, 0.5, " °");
                done |= response.drag_stopped() || response.lost_focus();
            });
            if heading != object.heading_deg.unwrap_or(0.0) {
                changed.heading_deg = Some((heading * 10.0).round() / 10.0);
            }
        } else {
            ui.label(RichText::new("It stands in several places: edit them in the scene file.").weak());
        }
        let mut wrong = None;
        if changed != *object {
            let what = format!("{}: changed", title(object));
            wrong = project.change_scene(&what, |scene| scene.objects[i] = changed).err().map(|e| e.to_string());
        }
        if done {
            project.close_step();
        }
        ui.horizontal(|ui| {
            if ui.button("Duplicate").clicked() {
                let mut copy = object.clone();
                if let Some([x, ..]) = &mut copy.position_m {
                    *x += 0.1;
                }
                let what = format!("{}: duplicated", title(object));
                wrong =
                    project.change_scene(&what, |scene| scene.objects.insert(i + 1, copy)).err().map(|e| e.to_string());
                project.close_step();
                self.selected = Some(i + 1);
            }
            if ui.button("Delete").clicked() {
                let what = format!("{}: deleted", title(object));
                wrong = project.change_scene(&what, |scene| _ = scene.objects.remove(i)).err().map(|e| e.to_string());
                project.close_step();
                self.selected = None;
            }
        });
        wrong
    }

    /// Puts what is being placed where the frame shows a surface, and goes on placing.
    pub fn place(&mut self, project: &mut Project, frame: &Frame, at_px: DVec2) -> Result<(), String> {
        let Some(model) = &self.placing else { return Ok(()) };
        let surface = project.shot().surface_at(frame, at_px).map_err(|e| e.to_string())?;
        let support = Support { point_m: surface.point_m, normal: surface.normal_in_world };
        let posture = if self.lies_flat { Posture::Flat } else { Posture::Upright };
        let (file, up): (PathBuf, DVec3) = (project.scene_path(), project.up());
        let model = relative(model, &file);
        let placed = lay(&model, &file, &support, posture, self.heading_deg, up).map_err(|e| e.to_string())?;
        let what = format!("{}: placed", title(&placed));
        project.change_scene(&what, |scene| scene.objects.push(placed)).map_err(|e| e.to_string())?;
        project.close_step();
        self.selected = Some(project.edit().scene.objects.len() - 1);
        Ok(())
    }

    /// A file that was dropped into the window: the next click places it.
    pub fn drop(&mut self, model: PathBuf) {
        self.lies_flat = !stands(&model);
        if !self.library.contains(&model) {
            self.library.push(model.clone());
        }
        self.placing = Some(model);
    }

    /// Models beside the scene file, and those that come with the program.
    fn look(&mut self, scene: &Path) {
        let folder =
            scene.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new(".")).to_owned();
        if self.looked_in.as_ref() == Some(&folder) {
            return;
        }
        let folders = [folder.clone(), PathBuf::from("scenes")];
        let mut found: Vec<PathBuf> = folders
            .iter()
            .filter_map(|folder| std::fs::read_dir(folder).ok())
            .flat_map(|entries| entries.flatten().map(|entry| entry.path()))
            .filter(|path| {
                path.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb") || e.eq_ignore_ascii_case("gltf"))
            })
            .collect();
        found.sort();
        let mut seen = std::collections::BTreeSet::new();
        found.retain(|path| seen.insert(std::fs::canonicalize(path).unwrap_or_else(|_| path.clone())));
        self.library = found;
        self.looked_in = Some(folder);
    }
}

/// Whether a thing of that name is usually stood up.
fn stands(model: &Path) -> bool {
    name(model).to_lowercase().contains("marker")
}

fn name(model: &Path) -> String {
    model.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

fn title(object: &PlacedModel) -> String {
    object.name.clone().unwrap_or_else(|| name(Path::new(&object.model)))
}

fn numeric(ui: &mut Ui, called: &str, value: &mut f64, speed: f64, unit: &str) -> egui::Response {
    let drag = egui::DragValue::new(value).speed(speed).suffix(unit).custom_parser(parse_number);
    let response = ui.add(drag.custom_formatter(|n, _| number((n * 1e4).round() / 1e4)));
    response.widget_info(|| egui::WidgetInfo::slider(true, *value, called));
    response
}
