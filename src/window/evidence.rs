//! The evidence: what there is to place, what has been placed, and where.

use std::path::{Path, PathBuf};

use eframe::egui::{self, RichText, Ui};
use glam::{DVec2, DVec3};

use super::Project;
use super::controls::parse_number;
use crate::frame::Frame;
use crate::scene::{Entry, Posture, SceneFile, Size, Stance, Support, lay, relative};
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
    /// In the list and in the picture.
    pub selected: Option<Entry>,
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
        let scene = project.edit().scene.clone();
        let entries = scene.entries();
        self.selected = self.selected.filter(|selected| entries.contains(selected));
        egui::ScrollArea::vertical().max_height(220.0).auto_shrink([false, true]).show(ui, |ui| {
            for entry in entries {
                let is_selected = self.selected == Some(entry);
                let title = RichText::new(scene.title(entry));
                let title = if scene.is_hidden(entry) { title.weak().italics() } else { title };
                if ui.selectable_label(is_selected, title).clicked() {
                    self.selected = (!is_selected).then_some(entry);
                }
            }
        });
        if let Some(entry) = self.selected {
            ui.separator();
            wrong = self.selected(ui, project, &scene, entry);
        }
        wrong
    }

    /// The name and the numbers of what is selected.
    fn selected(&mut self, ui: &mut Ui, project: &mut Project, scene: &SceneFile, entry: Entry) -> Option<String> {
        let stance = scene.stance(entry)?;
        let (title, mut changed, mut done) = (scene.title(entry), stance, false);
        let mut name = title.clone();
        let is_renamed = ui.add(egui::TextEdit::singleline(&mut name).desired_width(180.0)).changed();
        egui::Grid::new("stance").num_columns(2).spacing([8.0, 3.0]).show(ui, |ui| {
            for (axis, value) in ["x", "y", "z"].into_iter().zip(changed.position_m.as_mut()) {
                done |= row(ui, axis, &format!("position {axis}"), value, 0.002, " m");
            }
            done |= row(ui, "heading", "heading", &mut changed.heading_deg, 0.5, " °");
            done |= size(ui, &stance, &mut changed);
        });
        // To a tenth of a millimetre and of a degree, but only what was touched.
        let moved = changed.position_m != stance.position_m;
        let rounded = |to: f64, from: f64| if to == from { to } else { (to * 1e4).round() / 1e4 };
        for i in 0..3 {
            changed.position_m[i] = rounded(changed.position_m[i], stance.position_m[i]);
        }
        if changed.heading_deg != stance.heading_deg {
            changed.heading_deg = (changed.heading_deg * 10.0).round() / 10.0;
        }
        let mut wrong = None;
        if is_renamed || changed != stance {
            let verb = match () {
                () if is_renamed => "renamed",
                () if moved => "moved",
                () if changed.heading_deg != stance.heading_deg => "turned",
                () => "scaled",
            };
            let change = |scene: &mut SceneFile| {
                scene.put(entry, &changed);
                if is_renamed {
                    scene.rename(entry, &name);
                }
            };
            wrong = project.change_scene(&format!("{title}: {verb}"), change).err().map(|e| e.to_string());
        }
        if done {
            project.close_step();
        }
        ui.horizontal(|ui| {
            if ui.button("Duplicate").on_hover_text("Shift+D, and move it").clicked() {
                wrong = self.duplicate(project, entry);
            }
            if ui.button(if scene.is_hidden(entry) { "Show" } else { "Hide" }).on_hover_text("H").clicked() {
                wrong = self.hide(project);
            }
            if ui.button("Delete").on_hover_text("Del").clicked() {
                wrong = self.delete(project);
            }
        });
        wrong
    }

    /// A second one, 10 cm to the side.
    fn duplicate(&mut self, project: &mut Project, entry: Entry) -> Option<String> {
        let what = format!("{}: duplicated", project.edit().scene.title(entry));
        let mut copy = None;
        let done = project.change_scene(&what, |scene| {
            copy = scene.duplicate(entry);
            if let Some((copy, mut stance)) = copy.and_then(|copy| Some((copy, scene.stance(copy)?))) {
                stance.position_m.x += 0.1;
                scene.put(copy, &stance);
            }
        });
        project.close_step();
        if done.is_ok() {
            self.selected = copy.or(self.selected);
        }
        done.err().map(|e| e.to_string())
    }

    /// Leaves what is selected out of the picture, or shows it again. Gives back what went wrong.
    pub fn hide(&mut self, project: &mut Project) -> Option<String> {
        let entry = self.selected?;
        let scene = &project.edit().scene;
        let hides = !scene.is_hidden(entry);
        let what = format!("{}: {}", scene.title(entry), if hides { "hidden" } else { "shown" });
        let done = project.change_scene(&what, |scene| scene.hide(entry, hides));
        project.close_step();
        done.err().map(|e| e.to_string())
    }

    /// Takes away what is selected. Gives back what went wrong.
    pub fn delete(&mut self, project: &mut Project) -> Option<String> {
        let entry = self.selected.take()?;
        let what = format!("{}: deleted", project.edit().scene.title(entry));
        let done = project.change_scene(&what, |scene| scene.remove(entry));
        project.close_step();
        done.err().map(|e| e.to_string())
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
        let what = format!("{}: placed", placed.title());
        project.change_scene(&what, |scene| scene.objects.push(placed)).map_err(|e| e.to_string())?;
        project.close_step();
        self.selected = Some(Entry { object: project.edit().scene.objects.len() - 1, instance: None });
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

/// A number with its label; whether a change of it has ended.
fn row(ui: &mut Ui, label: &str, called: &str, value: &mut f64, speed: f64, unit: &str) -> bool {
    ui.label(label);
    let response = numeric(ui, called, value, speed, unit);
    ui.end_row();
    response.drag_stopped() || response.lost_focus()
}

/// The size as the scene file has it: a factor, three, or the largest extent.
fn size(ui: &mut Ui, stance: &Stance, changed: &mut Stance) -> bool {
    // Zero and less are nothing to look at; a mirror image is a matter for the scene file.
    let kept = |to: f64, from: f64| if to != 0.0 && to.signum() == from.signum() { to } else { from };
    match stance.size {
        Size::LargestM(from) => {
            let mut to = from;
            let done = row(ui, "size", "largest extent", &mut to, 0.001 * from.max(0.01), " m");
            changed.size = Size::LargestM(kept(to, from));
            done
        }
        Size::Scale(from) if from.x == from.y && from.y == from.z => {
            let mut to = from.x;
            let done = row(ui, "scale", "scale", &mut to, 0.005 * from.x.abs(), "");
            changed.size = Size::Scale(glam::DVec3::splat(kept(to, from.x)));
            done
        }
        Size::Scale(from) => {
            let (mut to, mut done) = (from, false);
            for (axis, i) in ["scale x", "scale y", "scale z"].into_iter().zip(0..3) {
                done |= row(ui, axis, axis, &mut to[i], 0.005 * from[i].abs(), "");
                to[i] = kept(to[i], from[i]);
            }
            changed.size = Size::Scale(to);
            done
        }
    }
}

fn numeric(ui: &mut Ui, called: &str, value: &mut f64, speed: f64, unit: &str) -> egui::Response {
    let drag = egui::DragValue::new(value).speed(speed).suffix(unit).custom_parser(parse_number);
    let response = ui.add(drag.custom_formatter(|n, _| number((n * 1e4).round() / 1e4)));
    response.widget_info(|| egui::WidgetInfo::slider(true, *value, called));
    response
}
