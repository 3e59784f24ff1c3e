//! Placement of a model: a click lays it on the surface there, and a drag turns it.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use eframe::egui::{self, RichText, Ui};
use glam::{DVec2, DVec3};

use super::Project;
use super::click_context::ClickContext;
use super::fields::numeric;
use super::handles::{PlacementPreview, PreviewKey, intersect_plane};
use super::library::name;
use super::picked_ground::PickedGround;
use super::picture::PictureOutput;
use super::point_picker::{Click, PointPicker, surface_point};
use locard_engine::frame::Frame;
use locard_engine::plane::{HessePlane, Plane};
use locard_engine::scene::document::{PlacedModel, Up};
use locard_engine::scene::{Entry, LoadedModels, Posture, SceneError, SceneFile, place_at_rest, relative};
use locard_engine::shot::{PosedCamera, Shot, ViewRay};

/// Smallest distance of the pointed target from the object at which its direction counts.
const MIN_FACING_DISTANCE_M: f64 = 0.01;

/// Placement of a model. It continues after a click.
#[derive(Debug)]
pub struct Placement {
    model: PathBuf,
    lies_flat: bool,
    /// Heading relative to facing the camera.
    turned_deg: f64,
    picker: PointPicker,
    /// A placement that is turned by dragging. `None` if no surface is known at the pressed point.
    turning: Option<DraggedTurn>,
    /// Position at which the button was pressed, px of the picture.
    pressed_px: Option<DVec2>,
    preview: PlacementPreview,
}

/// A placement at the point of the press whose front follows the pointer.
#[derive(Clone, Copy, Debug)]
struct DraggedTurn {
    at_px: DVec2,
    support: Plane,
    /// Heading relative to facing the camera.
    turned_deg: f64,
}

impl Placement {
    pub fn new(model: PathBuf, turned_deg: f64, models: Arc<Mutex<LoadedModels>>) -> Self {
        Self {
            lies_flat: !is_upright_model(&model),
            model,
            turned_deg,
            picker: PointPicker::default(),
            turning: None,
            pressed_px: None,
            preview: PlacementPreview::new(models),
        }
    }

    pub fn model(&self) -> &Path {
        &self.model
    }

    /// Heading relative to facing the camera.
    pub fn turned_deg(&self) -> f64 {
        self.turned_deg
    }

    /// Drops the first view of a point that needs two.
    pub fn forget_first_view(&mut self) {
        self.picker.cancel();
    }

    /// Shows posture and heading.
    pub fn show(&mut self, ui: &mut Ui) {
        ui.horizontal(|ui| {
            ui.selectable_value(&mut self.lies_flat, false, "upright");
            ui.selectable_value(&mut self.lies_flat, true, "flat");
            let turned = numeric(ui, "turned from facing you", &mut self.turned_deg, 1.0, " °");
            turned.on_hover_text("0: its front faces you. Positive turns counter-clockwise, seen from above.");
        });
        ui.label(RichText::new("Click in the picture, or press and drag to turn it; Esc ends it.").weak());
    }

    fn posture(&self) -> Posture {
        if self.lies_flat { Posture::Flat } else { Posture::Upright }
    }

    /// The point at a pixel where the model lies, if one click is enough.
    fn support(&self, plane: Option<HessePlane>, shot: &Shot, frame: &Frame, at_px: DVec2) -> Option<Plane> {
        if self.picker.awaits_second_view() {
            return None;
        }
        surface_point(plane, shot, frame, at_px)
    }

    /// Turns it by dragging: the object stays at the point of the press, its front follows the
    /// pointer. Returns that point when the button is released.
    pub fn turn(
        &mut self,
        picture: &PictureOutput,
        ground: &PickedGround,
        project: &Project,
        frame: &Frame,
    ) -> Option<DVec2> {
        let response = &picture.response;
        let px = |at: egui::Pos2| {
            let at = picture.placed.picture_px(at);
            DVec2::new(at.x.into(), at.y.into())
        };
        if response.drag_started_by(egui::PointerButton::Primary) {
            self.pressed_px = response.ctx.input(|i| i.pointer.press_origin()).map(px);
            self.turning = self.pressed_px.and_then(|at_px| {
                let support = self.support(ground.plane, project.shot(), frame, at_px)?;
                Some(DraggedTurn { at_px, support, turned_deg: self.turned_deg })
            });
        }
        let Some(turning) = self.turning.as_mut() else {
            // `click` returns the reason.
            return self.pressed_px.take_if(|_| response.drag_stopped_by(egui::PointerButton::Primary));
        };
        if let (Some(at), Ok(eye)) = (response.interact_pointer_pos(), project.shot().posed_camera(frame.index)) {
            let facing_deg = eye.ray(px(at)).and_then(|ray| facing_deg(&eye, &ray, &turning.support, project.up()));
            turning.turned_deg = facing_deg.unwrap_or(turning.turned_deg);
        }
        let at_px = turning.at_px;
        let is_done = response.drag_stopped_by(egui::PointerButton::Primary);
        self.pressed_px.take_if(|_| is_done).map(|_| at_px)
    }

    /// Places the model on the surface at a pixel. Returns a message.
    pub fn click(&mut self, context: ClickContext<'_>, at_px: DVec2) -> Result<Option<String>, String> {
        let ClickContext { project, ground, frame, selected } = context;
        let turned_deg = self.turning.take().map_or(self.turned_deg, |turning| turning.turned_deg);
        let click = self.picker.click(ground.plane, project.shot(), project.up(), frame, at_px)?;
        let Click::Point { support, accuracy } = click else { return Ok(None) };
        let is_up_undefined = project.is_up_undefined();
        let up = if is_up_undefined { project.shot().up_on(Some(support.normal)) } else { project.up() };
        let params = PlacementParams { model: self.model.clone(), posture: self.posture(), turned_deg, up: Some(up) };
        let placed = params.lay(project.shot(), frame.index, &support, &project.scene_path());
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
        *selected = Some(entry.into());
        Ok(accuracy)
    }

    /// Shows the preview at the pointer.
    pub fn show_preview(
        &mut self,
        picture: &PictureOutput,
        ground: &PickedGround,
        project: &Project,
        frame: &Arc<Frame>,
    ) {
        let turned = self.turning.map(|turning| (turning.at_px, turning.turned_deg));
        let pointed = picture.pointed.map(|at| (DVec2::new(at.x.into(), at.y.into()), self.turned_deg));
        let Some((at_px, turned_deg)) = turned.or(pointed) else { return };
        let model = self.model.clone();
        let lies_flat = self.lies_flat;
        let file = project.scene_path();
        let key = PreviewKey {
            model: model.clone(),
            frame: frame.index,
            at_px,
            lies_flat,
            turned_deg,
            version: project.version(),
        };
        let up = (!project.is_up_undefined()).then(|| project.up());
        let params = PlacementParams { model, posture: self.posture(), turned_deg, up };
        let is_determined = !self.picker.awaits_second_view();
        let plane = ground.plane;
        let of_scene = file.clone();
        self.preview.show(picture, key, project.shot(), frame, file, move |shot, frame| {
            let support = surface_point(plane, shot, frame, at_px).filter(|_| is_determined)?;
            params.lay(shot, frame.index, &support, &of_scene).ok()
        });
    }

    /// Paints the first view of a point that needs two.
    pub fn paint_first_view(&self, picture: &PictureOutput, project: &Project, frame: usize) {
        self.picker.paint(picture, project.shot(), frame);
    }

    /// The current outline of the preview: closed polygons, px of the picture.
    pub fn preview_outline(&self) -> Option<&[Vec<DVec2>]> {
        self.preview.outline().map(Vec::as_slice)
    }
}

/// Parameters of a placement on a surface.
struct PlacementParams {
    model: PathBuf,
    posture: Posture,
    /// Heading relative to facing the camera.
    turned_deg: f64,
    /// `None`: derived from the support.
    up: Option<DVec3>,
}

impl PlacementParams {
    /// The entry of the scene file.
    fn lay(&self, shot: &Shot, frame: usize, support: &Plane, file: &Path) -> Result<PlacedModel, SceneError> {
        let up = self.up.unwrap_or_else(|| shot.up_preview(Some(support.normal)));
        let heading = shot.heading_to_camera(frame, support.point_m, up, self.turned_deg);
        place_at_rest(&relative(&self.model, file), file, support, self.posture, heading, up, None)
    }
}

/// Heading, relative to facing the camera, of an object whose front faces the intersection of a ray
/// with its support plane, rounded to 1°. `None` within [`MIN_FACING_DISTANCE_M`].
fn facing_deg(eye: &PosedCamera, ray: &ViewRay, support: &Plane, up: DVec3) -> Option<f64> {
    let towards = (intersect_plane(support, ray)? - support.point_m).reject_from_normalized(up);
    let viewer = eye.horizontal_towards_camera(support.point_m, up)?;
    if towards.length() < MIN_FACING_DISTANCE_M {
        return None;
    }
    let turned = viewer.cross(towards).dot(up).atan2(viewer.dot(towards));
    Some(turned.to_degrees().round() + 0.0)
}

/// True if models of that name usually stand upright.
fn is_upright_model(model: &Path) -> bool {
    name(model).to_lowercase().contains("marker")
}
