//! Asks for a camera, and where its poses come from.

use std::path::PathBuf;

use eframe::egui::{self, Context, Key, Ui};

use super::errand::Errand;
use super::recent::Opened;
use crate::live::LiveFrom;
use crate::webcam;
use crate::words::shown;

/// Where poses come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Poses {
    #[default]
    Tags,
    Stream,
    None,
}

/// The cameras that were found: what each is called for `locard live`, and for people.
type Found = Vec<(String, String)>;

/// See above.
#[derive(Debug)]
pub struct Air {
    looking: Option<Errand<Result<Found, String>>>,
    found: Found,
    /// Why none was found.
    why: Option<String>,
    camera: String,
    /// A person has said which.
    is_chosen: bool,
    poses: Poses,
    board: String,
    address: String,
    profile: String,
    scene: Option<PathBuf>,
    with_scene: bool,
}

impl Air {
    /// Proposes a profile, and a scene.
    pub fn new(ctx: &Context, profile: Option<PathBuf>, scene: Option<PathBuf>) -> Self {
        let wake = ctx.clone();
        Self {
            looking: Errand::begin("cameras", move || wake.request_repaint(), cameras).ok(),
            found: Vec::new(),
            why: None,
            camera: "0".to_owned(),
            is_chosen: false,
            poses: Poses::default(),
            board: String::new(),
            address: "opentrackio://127.0.0.1:55555".to_owned(),
            profile: profile.map_or(String::new(), |path| path.display().to_string()),
            with_scene: scene.is_some(),
            scene,
        }
    }

    /// With what was chosen and typed before.
    pub fn restored(self, before: Self) -> Self {
        let Self { camera, poses, board, address, profile, .. } = before;
        let profile = if profile.is_empty() { self.profile.clone() } else { profile };
        Self { camera, poses, board, address, profile, is_chosen: true, ..self }
    }

    /// What is to be opened; `Some(None)` where it is left.
    pub fn show(&mut self, ctx: &Context) -> Option<Option<Opened>> {
        if let Some(done) = self.looking.as_ref().and_then(Errand::take) {
            self.looking = None;
            match done.and_then(|found| found) {
                Ok(found) => {
                    if let Some((first, _)) = found.first().filter(|_| !self.is_chosen) {
                        self.camera.clone_from(first);
                    }
                    self.found = found;
                }
                Err(why) => self.why = Some(why),
            }
        }
        let mut answer = None;
        // The modal takes the key.
        let escaped = ctx.input(|i| i.key_pressed(Key::Escape));
        let modal = egui::Modal::new(egui::Id::unique("air")).show(ctx, |ui| {
            ui.set_width(460.0);
            ui.heading("Live camera");
            ui.add_space(4.0);
            egui::Grid::new("air").num_columns(2).spacing([12.0, 8.0]).show(ui, |ui| self.fields(ui));
            ui.add_space(10.0);
            ui.horizontal(|ui| {
                if ui.button("Start").clicked() {
                    answer = Some(Some(self.opened()));
                }
                if ui.button("Leave").clicked() {
                    answer = Some(None);
                }
            });
        });
        let left = modal.should_close() && escaped;
        answer.or(left.then_some(None))
    }

    fn fields(&mut self, ui: &mut Ui) {
        let width = 330.0;
        let label = ui.label("Camera");
        ui.vertical(|ui| {
            for (name, text) in &self.found {
                ui.radio_value(&mut self.camera, name.clone(), text);
            }
            if self.looking.is_some() {
                ui.spinner();
            }
            if let Some(why) = &self.why {
                ui.add(egui::Label::new(why).wrap());
            }
            let field = egui::TextEdit::singleline(&mut self.camera).desired_width(width);
            ui.add(field)
                .labelled_by(label.id)
                .on_hover_text("Its number or device, or a video that is played in its place");
        });
        ui.end_row();
        ui.label("Poses");
        ui.vertical(|ui| {
            ui.radio_value(&mut self.poses, Poses::Tags, "from printed tags in the picture");
            if self.poses == Poses::Tags {
                let hint = "The board's file; empty for the sheet that `locard board` prints";
                let field = egui::TextEdit::singleline(&mut self.board).desired_width(width).hint_text("locard board");
                ui.add(field).on_hover_text(hint).widget_info(|| text_field("Board"));
            }
            ui.radio_value(&mut self.poses, Poses::Stream, "from a stream");
            if self.poses == Poses::Stream {
                let field = egui::TextEdit::singleline(&mut self.address).desired_width(width);
                let hint = "opentrackio://HOST:PORT, freed://HOST:PORT, or file:RECORDING";
                ui.add(field).on_hover_text(hint).widget_info(|| text_field("Address"));
            }
            ui.radio_value(&mut self.poses, Poses::None, "none: the picture alone");
        });
        ui.end_row();
        let label = ui.label("Profile");
        let hint = "The camera's, as `locard calibrate camera` writes it: tags need its focal length";
        let field = egui::TextEdit::singleline(&mut self.profile).desired_width(width).hint_text("camera.toml");
        ui.add(field).labelled_by(label.id).on_hover_text(hint);
        ui.end_row();
        if let Some(scene) = &self.scene {
            ui.label("Scene");
            let name = scene.file_name().unwrap_or(scene.as_os_str()).to_string_lossy();
            ui.checkbox(&mut self.with_scene, format!("{name}, which is open"));
            ui.end_row();
        }
    }

    fn opened(&self) -> Opened {
        let typed = |text: &str| Some(text.trim().to_owned()).filter(|text| !text.is_empty());
        let poses = match self.poses {
            Poses::Tags => typed(&self.board).map_or_else(|| "tags".to_owned(), |board| format!("tags:{board}")),
            Poses::Stream => self.address.trim().to_owned(),
            Poses::None => "none".to_owned(),
        };
        let from = LiveFrom::new(self.camera.trim(), &poses);
        let scene = self.scene.clone().filter(|_| self.with_scene);
        Opened::camera(from, typed(&self.profile).map(PathBuf::from), scene)
    }
}

fn text_field(name: &str) -> egui::WidgetInfo {
    egui::WidgetInfo::labeled(egui::Role::TextInput, true, name)
}

fn cameras() -> Result<Found, String> {
    let found = webcam::cameras().map_err(|error| error.to_string())?;
    if found.is_empty() {
        return Err("No camera was found; a video's file can stand in for one.".to_owned());
    }
    Ok(found
        .iter()
        .map(|camera| (camera.number.to_string(), format!("{}: {}", camera.number, shown(&camera.name))))
        .collect())
}
