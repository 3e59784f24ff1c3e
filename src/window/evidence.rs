//! The evidence: what there is to place, what has been placed, and where.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use eframe::egui::{self, RichText, Ui};
use glam::{DVec2, DVec3};

use super::Project;
use super::fields::{is_taken_back, numeric, row};
use super::finder::Click;
use super::ground::Ground;
use super::handles::{Ghost, Plane, Would};
use super::library::{Library, name};
use super::list;
use super::missing;
use super::object_actions;
use super::picture::Seen;
use super::scene_checks::SceneChecks;
use super::tilt;
use locard_engine::frame::Frame;
use locard_engine::gpu::Gpu;
use locard_engine::scene::document::{PlacedModel, Up};
use locard_engine::scene::{
    Entry, ItemPlacement, Posture, SceneError, SceneFile, SceneItem, Size, Support, lay, relative,
};
use locard_engine::shot::{Eye, Ray, Shot};

/// What is being done with the evidence.
#[derive(Default)]
pub struct Evidence {
    /// The models that can be placed.
    library: Library,
    /// What they are placed on.
    pub ground: Ground,
    scene_checks: SceneChecks,
    /// The model that the next click places.
    placing: Option<PathBuf>,
    ghost: Ghost,
    lies_flat: bool,
    /// From facing whoever looks.
    turned_deg: f64,
    /// Pressed, and turned by dragging since; nothing where no surface is known there.
    turning: Option<Turning>,
    /// Where it was pressed, px of the picture.
    pressed_px: Option<DVec2>,
    /// In the list and in the picture.
    pub selected: Option<SceneItem>,
    renaming: Option<Renaming>,
    /// A missing file of the scene that the user wants to locate.
    pub locates: Option<PathBuf>,
}

/// What is being placed stays where the button was pressed, and its front follows the pointer.
#[derive(Clone, Copy, Debug)]
struct Turning {
    at_px: DVec2,
    support: Support,
    /// From facing whoever looks.
    turned_deg: f64,
}

/// A name that is being typed: one step, as long as its field has the focus.
struct Renaming {
    /// The name before.
    before: String,
    /// What stands in the field, and the name that came of it: an empty field is no name.
    typed: String,
    given: String,
}

impl Evidence {
    /// Whether the next click in the picture places something.
    pub fn is_placing(&self) -> bool {
        self.placing.is_some()
    }

    /// Whether something was begun that Esc ends.
    pub fn is_busy(&self) -> bool {
        self.is_placing() || self.ground.is_busy()
    }

    pub fn cancel(&mut self) {
        (self.placing, self.turning, self.pressed_px) = (None, None, None);
        self.ghost.rest();
        self.ground.cancel();
    }

    /// Drops the selection of a thing that the scene no longer has.
    pub fn update_selection(&mut self, project: &Project) {
        let scene = &project.edit().scene;
        self.selected = self.selected.filter(|selected| scene.placement(*selected).is_some());
    }

    /// Shows the list and the controls of what is selected. Gives back what is to be said.
    pub fn show(
        &mut self,
        ui: &mut Ui,
        project: &mut Project,
        gpu: &Gpu,
        frame: Option<&Arc<Frame>>,
    ) -> Option<String> {
        let mut told = None;
        ui.strong("Evidence");
        if !project.can_place() {
            ui.label("A model alone stands by its own coordinates. Open a scene file, or none, to place evidence.");
            return None;
        }
        self.library.look(&project.scene_path());
        let text = self.placing.as_deref().map_or_else(|| "Place…".to_owned(), name);
        let menu = ui.menu_button(text, |ui| {
            let model = self.library.show(ui, gpu);
            let is_chosen = model.is_some();
            if let Some(model) = model {
                self.choose(model);
                ui.close();
            }
            is_chosen
        });
        // Left by a key, the button has the keyboard again; a model that was taken wants a place, which has its own keys.
        let is_chosen = menu.inner == Some(true);
        if is_chosen {
            ui.memory_mut(|memory| memory.stop_text_input());
        } else if menu.inner.is_some() && ui.input(|i| i.key_pressed(egui::Key::Escape)) {
            menu.response.request_focus();
        }
        menu.response.on_hover_text(
            "Choose a model, then click where it shall lie. A .glb dropped into the window is taken too.",
        );
        if self.is_placing() {
            ui.horizontal(|ui| {
                ui.selectable_value(&mut self.lies_flat, false, "upright");
                ui.selectable_value(&mut self.lies_flat, true, "flat");
                let turned = numeric(ui, "turned from facing you", &mut self.turned_deg, 1.0, " °");
                turned.on_hover_text("0: its front faces you. Positive turns counter-clockwise, seen from above.");
            });
            ui.label(RichText::new("Click in the picture, or press and drag to turn it; Esc ends it.").weak());
        }
        if let Some(Ok(said) | Err(said)) = self.ground.show(ui, project) {
            told = Some(said);
        }
        ui.separator();
        self.locates = missing::show(ui, project);
        self.scene_checks.update(project, frame, ui.ctx());
        told = list::show(ui, project, &self.scene_checks, &mut self.selected).or(told);
        let scene = project.edit().scene.clone();
        let renaming = self.renaming.take();
        let was_typing = renaming.is_some();
        if let Some(SceneItem::Object(entry)) = self.selected {
            ui.separator();
            told = self.selected(ui, project, &scene, entry, renaming).or(told);
            let object = scene.entries().iter().position(|other| *other == entry);
            let version = project.scene_version();
            if let Some(tilt) = object.and_then(|object| self.scene_checks.tilt(version, object)) {
                told = tilt::show(ui, project, entry, &tilt).or(told);
            }
        }
        if was_typing && self.renaming.is_none() {
            project.close_step();
        }
        told
    }

    /// The name and the numbers of what is selected.
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
        // What turns it may be its rotation.
        let faces_deg = scene.heading_deg(entry, project.up()).unwrap_or(placement.heading_deg);
        let shown_deg = (faces_deg * 10.0).round() / 10.0;
        let mut heading_deg = shown_deg;
        // Undone meanwhile, it has its old name.
        let renaming = renaming.filter(|renaming| renaming.given == title);
        let mut name = renaming.as_ref().map_or_else(|| title.clone(), |renaming| renaming.typed.clone());
        let salt = ("name", entry.object, entry.instance);
        let field = ui.add(egui::TextEdit::singleline(&mut name).id_salt(salt).desired_width(180.0));
        field.widget_info(|| egui::WidgetInfo::labeled(egui::Role::TextInput, true, "Name"));
        if let Some(renaming) = &renaming
            && field.lost_focus()
            && is_taken_back(ui.ctx())
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
        // To a tenth of a millimetre and of a degree, but only what was touched.
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
            let what = match () {
                () if is_renamed => renamed(&title),
                () if moved => format!("{title}: moved"),
                () if changed.heading_deg != placement.heading_deg => format!("{title}: turned"),
                () => format!("{title}: scaled"),
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
            let given = project.edit().scene.title(entry);
            self.renaming = Some(Renaming { before: title, typed: name, given });
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

    /// Where the picture is dragged while something is placed: the thing stands where the button was pressed, and its front
    /// follows the pointer. Gives the place once the button is let go.
    pub fn turn(&mut self, seen: &Seen, project: &Project, frame: &Frame) -> Option<DVec2> {
        let response = &seen.response;
        let px = |at: egui::Pos2| {
            let at = seen.placed.picture_px(at);
            DVec2::new(at.x.into(), at.y.into())
        };
        if response.drag_started_by(egui::PointerButton::Primary) {
            self.pressed_px = response.ctx.input(|i| i.pointer.press_origin()).map(px);
            self.turning = self.pressed_px.and_then(|at_px| {
                let support = self.ground.finder.look(project.shot(), frame, at_px)?;
                Some(Turning { at_px, support, turned_deg: self.turned_deg })
            });
        }
        let Some(turning) = self.turning.as_mut() else {
            // A click there says why.
            return self.pressed_px.take_if(|_| response.drag_stopped_by(egui::PointerButton::Primary));
        };
        if let (Some(at), Ok(eye)) = (response.interact_pointer_pos(), project.shot().eye(frame.index)) {
            let facing_deg = eye.ray(px(at)).and_then(|ray| facing_deg(&eye, &ray, &turning.support, project.up()));
            turning.turned_deg = facing_deg.unwrap_or(turning.turned_deg);
        }
        let at_px = turning.at_px;
        let is_done = response.drag_stopped_by(egui::PointerButton::Primary);
        self.pressed_px.take_if(|_| is_done).map(|_| at_px)
    }

    /// Puts what is being placed where the frame shows a surface, and goes on placing.
    pub fn place(&mut self, project: &mut Project, frame: &Frame, at_px: DVec2) -> Result<(), String> {
        let turned_deg = self.turning.take().map_or(self.turned_deg, |turning| turning.turned_deg);
        let Some(model) = &self.placing else { return Ok(()) };
        let support = match self.ground.finder.click(project.shot(), project.up(), frame, at_px)? {
            Click::Point(support) => support,
            Click::Again(_) => return Ok(()),
        };
        let posture = if self.lies_flat { Posture::Flat } else { Posture::Upright };
        let is_up_undefined = project.is_up_undefined();
        let up = if is_up_undefined { project.shot().up_on(Some(support.normal)) } else { project.up() };
        let laying = Laying { model: model.clone(), posture, turned_deg, up: Some(up) };
        let placed = laying.lay(project.shot(), frame.index, &support, &project.scene_path());
        let placed = placed.map_err(|e| e.to_string())?;
        let what = format!("{}: placed", placed.title());
        let gauge = project.shot().gauge(frame.index);
        let put = |scene: &mut SceneFile| {
            scene.gauge = scene.gauge.or(gauge);
            scene.up = scene.up.or(is_up_undefined.then(|| Up::Direction(up.to_array())));
            scene.objects.push(placed);
        };
        project.change_scene(&what, put).map_err(|e| e.to_string())?;
        project.close_step();
        let entry = Entry { object: project.edit().scene.objects.len() - 1, instance: None };
        self.selected = Some(entry.into());
        Ok(())
    }

    /// Shows where the next click would put what is being placed.
    pub fn preview(&mut self, seen: &Seen, project: &Project, frame: &Arc<Frame>) {
        let turned = self.turning.map(|turning| (turning.at_px, turning.turned_deg));
        let pointed = seen.pointed.map(|at| (DVec2::new(at.x.into(), at.y.into()), self.turned_deg));
        let (Some(model), Some((at_px, turned_deg))) = (self.placing.clone(), turned.or(pointed)) else { return };
        let (lies_flat, file) = (self.lies_flat, project.scene_path());
        let would = Would {
            model: model.clone(),
            frame: frame.index,
            at_px,
            lies_flat,
            turned_deg,
            version: project.version(),
        };
        let posture = if lies_flat { Posture::Flat } else { Posture::Upright };
        let up = (!project.is_up_undefined()).then(|| project.up());
        let laying = Laying { model, posture, turned_deg, up };
        let (finder, of_scene) = (self.ground.finder.clone(), file.clone());
        self.ghost.show(seen, would, project.shot(), frame, file, move |shot, frame| {
            let support = finder.look(shot, frame, at_px)?;
            laying.lay(shot, frame.index, &support, &of_scene).ok()
        });
    }

    /// Where it was shown last that the next click would put something: closed polygons, px of the picture.
    pub fn previewed(&self) -> Option<&[Vec<DVec2>]> {
        self.ghost.border().map(Vec::as_slice)
    }

    /// A file that was dropped into the window: the next click places it.
    pub fn drop(&mut self, model: PathBuf) {
        self.library.add(&model);
        self.choose(model);
    }

    /// The next click places it.
    fn choose(&mut self, model: PathBuf) {
        self.ground.cancel();
        self.lies_flat = !stands(&model);
        self.placing = Some(model);
    }
}

/// How a model is put onto a surface.
struct Laying {
    model: PathBuf,
    posture: Posture,
    /// From facing whoever looks.
    turned_deg: f64,
    /// `None`: what it stands on says it.
    up: Option<DVec3>,
}

impl Laying {
    /// As the scene file has it then.
    fn lay(&self, shot: &Shot, frame: usize, support: &Support, file: &Path) -> Result<PlacedModel, SceneError> {
        let up = self.up.unwrap_or_else(|| shot.up_preview(Some(support.normal)));
        let heading = shot.facing(frame, support.point_m, up, self.turned_deg);
        lay(&relative(&self.model, file), file, support, self.posture, heading, up, None)
    }
}

/// How far a thing on a surface is turned from facing whoever looks when its front faces what a ray meets there, to the degree;
/// `None` where that is too near to tell.
fn facing_deg(eye: &Eye, ray: &Ray, support: &Support, up: DVec3) -> Option<f64> {
    let plane = Plane { point_m: support.point_m, normal: support.normal };
    let towards = (plane.seen_at(ray)? - support.point_m).reject_from_normalized(up);
    let viewer = eye.level_to_viewer(support.point_m, up)?;
    // A hand's tremble is no direction.
    if towards.length() < NEAREST_M {
        return None;
    }
    let turned = viewer.cross(towards).dot(up).atan2(viewer.dot(towards));
    Some(turned.to_degrees().round() + 0.0)
}

/// What a thing is turned towards by dragging lies farther from it than this.
const NEAREST_M: f64 = 0.01;

/// Whether a thing of that name is usually stood up.
fn stands(model: &Path) -> bool {
    name(model).to_lowercase().contains("marker")
}

/// What the history calls a new name.
fn renamed(before: &str) -> String {
    format!("{before}: renamed")
}

/// Whether a thing throws a shadow, and whether it is one at all. Gives back what went wrong.
fn switches(ui: &mut Ui, project: &mut Project, entry: Entry) -> Option<String> {
    let scene = &project.edit().scene;
    let (title, mut throws, mut is_real) = (scene.title(entry), !scene.is_shadowless(entry), scene.is_occluder(entry));
    let all = if entry.instance.is_some() { ", with all instances of its object" } else { "" };
    let throwing = ui
        .add_enabled(!is_real, egui::Checkbox::new(&mut throws, "Throws a shadow"))
        .on_hover_text("It takes light from what it stands on, and from what is beside it");
    let standing = ui.checkbox(&mut is_real, "Stands in for something real").on_hover_text(format!(
        "It is not drawn, and hides what is behind it: where depth was not measured, or not well{all}"
    ));
    let done = if throwing.changed() {
        let what = format!("{title}: {}", if throws { "with its shadow" } else { "without its shadow" });
        project.change_scene(&what, |scene| scene.set_shadowless(entry, !throws))
    } else if standing.changed() {
        let what = format!("{title}: {}{all}", if is_real { "stands in for something real" } else { "is evidence" });
        project.change_scene(&what, |scene| scene.set_occluder(entry, is_real))
    } else {
        return None;
    };
    project.close_step();
    done.err().map(|e| e.to_string())
}

/// The size as the scene file has it: a factor, three, or the largest extent.
fn size(ui: &mut Ui, placement: &ItemPlacement, changed: &mut ItemPlacement) -> bool {
    // Zero and less are nothing to look at; a mirror image is a matter for the scene file.
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
