//! The evidence panel: models to place, placed evidence, and its stances.

use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use eframe::egui::{self, Ui};

use super::Project;
use super::fields::{is_typed_reverted, row};
use super::ground::GroundPanel;
use super::library::{Library, name};
use super::list;
use super::missing;
use super::object_actions;
use super::placement::Placement;
use super::scene_checks::SceneChecks;
use super::tilt;
use super::tool::{Tool, ToolStack};
use locard_engine::frame::Frame;
use locard_engine::gpu::Gpu;
use locard_engine::scene::{Entry, ItemPlacement, LoadedModels, SceneFile, SceneItem, Size};

/// State of the panel.
#[derive(Default)]
pub struct EvidencePanel {
    /// The models that can be placed.
    library: Library,
    /// Surface to place on.
    pub ground: GroundPanel,
    scene_checks: SceneChecks,
    /// Heading of the next placement, relative to facing the camera.
    turned_deg: f64,
    /// Loaded models of placement previews.
    models: Arc<Mutex<LoadedModels>>,
    /// The selection, in the list and in the picture.
    pub selected: Option<SceneItem>,
    renaming: Option<Renaming>,
    /// The missing file whose button "Locate…" was pressed.
    pub locates: Option<PathBuf>,
}

/// A name that is being typed: one undo step while its field has the focus.
struct Renaming {
    /// The name before.
    before: String,
    /// Text of the field.
    typed: String,
    /// Resulting title of the item: an empty field is not a name.
    title: String,
}

impl EvidencePanel {
    /// Drops the selection if the scene no longer has the item.
    pub fn update_selection(&mut self, project: &Project) {
        let scene = &project.edit().scene;
        self.selected = self.selected.filter(|selected| scene.placement(*selected).is_some());
    }

    /// Shows the list and the controls of the selected item. Returns a message.
    pub fn show(
        &mut self,
        ui: &mut Ui,
        project: &mut Project,
        gpu: &Gpu,
        frame: Option<&Arc<Frame>>,
        tools: &mut ToolStack,
    ) -> Option<String> {
        let mut message = None;
        ui.strong("Evidence");
        if !project.can_place() {
            ui.label("A model opened alone has its own coordinates. Open a scene file, or none, to place evidence.");
            return None;
        }
        self.library.scan(&project.scene_path());
        let text = tools.placement().map_or_else(|| "Place…".to_owned(), |placement| name(placement.model()));
        let menu = ui.menu_button(text, |ui| {
            let model = self.library.show(ui, gpu);
            let is_chosen = model.is_some();
            if let Some(model) = model {
                self.choose(model, tools);
                ui.close();
            }
            is_chosen
        });
        // Esc returns the keyboard focus to the button. A chosen model needs it free, for the keys
        // of the placement.
        let is_chosen = menu.inner == Some(true);
        if is_chosen {
            ui.memory_mut(|memory| memory.stop_text_input());
        } else if menu.inner.is_some() && ui.input(|i| i.key_pressed(egui::Key::Escape)) {
            menu.response.request_focus();
        }
        menu.response
            .on_hover_text("Choose a model, then click a place for it. A .glb can also be dropped into the window.");
        if let Some(placement) = tools.placement_mut() {
            placement.show(ui);
            self.turned_deg = placement.turned_deg();
        }
        if let Some(Ok(outcome) | Err(outcome)) = self.ground.show(ui, project, tools) {
            message = Some(outcome);
        }
        ui.separator();
        self.locates = missing::show(ui, project);
        message = self.scene_checks.update(project, frame, ui.ctx()).or(message);
        message = list::show(ui, project, &self.scene_checks, &mut self.selected).or(message);
        let scene = project.edit().scene.clone();
        let renaming = self.renaming.take();
        let was_typing = renaming.is_some();
        if let Some(SceneItem::Object(entry)) = self.selected {
            ui.separator();
            message = self.selected(ui, project, &scene, entry, renaming).or(message);
            let object = scene.entries().iter().position(|other| *other == entry);
            let version = project.scene_version();
            if let Some(tilt) = object.and_then(|object| self.scene_checks.tilt(version, object)) {
                message = tilt::show(ui, project, entry, &tilt).or(message);
            }
        }
        if was_typing && self.renaming.is_none() {
            project.close_step();
        }
        message
    }

    /// Name and placement of the selected object.
    fn selected(
        &mut self,
        ui: &mut Ui,
        project: &mut Project,
        scene: &SceneFile,
        entry: Entry,
        renaming: Option<Renaming>,
    ) -> Option<String> {
        let placement = scene.placement(entry)?;
        let (title, mut changed, mut done) = (scene.title(entry), placement, false);
        // The heading may come from the rotation.
        let faces_deg = scene.heading_deg(entry, project.up()).unwrap_or(placement.heading_deg);
        let shown_deg = (faces_deg * 10.0).round() / 10.0;
        let mut heading_deg = shown_deg;
        // Discarded if the renaming was undone meanwhile.
        let renaming = renaming.filter(|renaming| renaming.title == title);
        let mut name = renaming.as_ref().map_or_else(|| title.clone(), |renaming| renaming.typed.clone());
        let salt = ("name", entry.object, entry.instance);
        let field = ui.add(egui::TextEdit::singleline(&mut name).id_salt(salt).desired_width(180.0));
        field.widget_info(|| egui::WidgetInfo::labeled(egui::Role::TextInput, true, "Name"));
        if let Some(renaming) = &renaming
            && field.lost_focus()
            && is_typed_reverted(ui.ctx())
        {
            project.remove_open_step(&renamed(&renaming.before));
            return None;
        }
        let is_renamed = field.changed();
        let title = renaming.filter(|_| is_renamed || field.has_focus()).map_or(title, |renaming| renaming.before);
        egui::Grid::new("stance").num_columns(2).spacing([8.0, 3.0]).show(ui, |ui| {
            for (axis, value) in ["x", "y", "z"].into_iter().zip(changed.position_m.as_mut()) {
                done |= row(ui, axis, &format!("position {axis}"), value, 0.002, " m");
            }
            done |= row(ui, "heading", "heading", &mut heading_deg, 0.5, " °");
            done |= size(ui, &placement, &mut changed);
        });
        // Rounds to 0.1 mm and 0.1°, changed values only.
        let moved = changed.position_m != placement.position_m;
        let rounded = |to: f64, from: f64| if to == from { to } else { (to * 1e4).round() / 1e4 };
        for i in 0..3 {
            changed.position_m[i] = rounded(changed.position_m[i], placement.position_m[i]);
        }
        if heading_deg != shown_deg {
            let up = project.up();
            changed = changed.turned(up, (heading_deg * 10.0).round() / 10.0 - faces_deg, up);
        }
        let mut wrong = None;
        if is_renamed || changed != placement {
            let what = if is_renamed {
                renamed(&title)
            } else if moved {
                format!("{title}: moved")
            } else if changed.heading_deg != placement.heading_deg {
                format!("{title}: turned")
            } else {
                format!("{title}: scaled")
            };
            let change = |scene: &mut SceneFile| {
                scene.put(entry, &changed);
                if is_renamed {
                    scene.rename(entry, &name);
                }
            };
            wrong = project.change_scene(&what, change).err().map(|e| e.to_string());
        }
        if field.has_focus() {
            let new_title = project.edit().scene.title(entry);
            self.renaming = Some(Renaming { before: title, typed: name, title: new_title });
        }
        if done {
            project.close_step();
        }
        wrong = switches(ui, project, entry).or(wrong);
        ui.horizontal(|ui| {
            if ui.button("Duplicate").on_hover_text("Shift+D, and move it").clicked() {
                wrong = object_actions::duplicate(project, &mut self.selected);
            }
            if ui.button(if scene.is_hidden(entry) { "Show" } else { "Hide" }).on_hover_text("H").clicked() {
                wrong = object_actions::hide(project, self.selected);
            }
            if ui.button("Delete").on_hover_text("Del").clicked() {
                wrong = object_actions::delete(project, &mut self.selected);
            }
        });
        wrong
    }

    /// Takes a file that was dropped into the window; the next click places it.
    pub fn drop(&mut self, model: PathBuf, tools: &mut ToolStack) {
        self.library.add(&model);
        self.choose(model, tools);
    }

    /// Begins the placement of a model.
    fn choose(&mut self, model: PathBuf, tools: &mut ToolStack) {
        self.ground.picked.cancel_scale();
        let placement = Placement::new(model, self.turned_deg, Arc::clone(&self.models));
        tools.begin(Tool::Place(Box::new(placement)));
    }
}

/// History label of a renaming.
fn renamed(before: &str) -> String {
    format!("{before}: renamed")
}

/// Switches for the shadow and for occluders. Returns an error.
fn switches(ui: &mut Ui, project: &mut Project, entry: Entry) -> Option<String> {
    let scene = &project.edit().scene;
    let (title, mut casts_shadow, mut is_occluder) =
        (scene.title(entry), !scene.is_shadowless(entry), scene.is_occluder(entry));
    let all = if entry.instance.is_some() { ", with all instances of its object" } else { "" };
    let shadow_box = ui
        .add_enabled(!is_occluder, egui::Checkbox::new(&mut casts_shadow, "Casts a shadow"))
        .on_hover_text("Darkens the surface below");
    let occluder_box = ui
        .checkbox(&mut is_occluder, "Occluder (invisible, hides what is behind it)")
        .on_hover_text(format!("For a real object where measured depth is missing or poor{all}"));
    let done = if shadow_box.changed() {
        let what = format!("{title}: {}", if casts_shadow { "with its shadow" } else { "without its shadow" });
        project.change_scene(&what, |scene| scene.set_shadowless(entry, !casts_shadow))
    } else if occluder_box.changed() {
        let what = format!("{title}: {}{all}", if is_occluder { "occluder" } else { "evidence" });
        project.change_scene(&what, |scene| scene.set_occluder(entry, is_occluder))
    } else {
        return None;
    };
    project.close_step();
    done.err().map(|e| e.to_string())
}

/// The size as the scene file has it: a factor, three, or the largest extent.
fn size(ui: &mut Ui, placement: &ItemPlacement, changed: &mut ItemPlacement) -> bool {
    // Zero and changes of sign are rejected; mirror images are left to the scene file.
    let kept = |to: f64, from: f64| if to != 0.0 && to.signum() == from.signum() { to } else { from };
    match placement.size {
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
