//! The dialog that opens a live camera and selects the source of its poses.

use std::path::{Path, PathBuf};

use eframe::egui::{self, Context, Ui};

use super::chooser::{Chooser, ChooserMode, ChooserResult, StartLocation};
use super::question::{self, DialogKeys, default_button};
use super::recent::DocumentRef;
use super::task::BackgroundTask;
use locard_engine::live::{DelayMode, LiveOptions, LiveSpec};
use locard_engine::text::{number, shown};
use locard_engine::webcam::{self, DriverName};

/// Source of poses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum PoseChoice {
    #[default]
    Tags,
    Stream,
    None,
}

/// A camera in the list.
#[derive(Debug)]
struct CameraEntry {
    /// The camera in the form that [`DriverName::split`] parses.
    camera: String,
    /// Number, name, and the driver if it is not the default one.
    label: String,
}

/// The cameras of all drivers.
#[derive(Debug, Default)]
struct CameraList {
    entries: Vec<CameraEntry>,
    /// Errors of drivers whose cameras are missing.
    errors: Option<String>,
}

/// The dialog with its entries.
#[derive(Debug)]
pub struct CameraDialog {
    listing_task: Option<BackgroundTask<CameraList>>,
    cameras: CameraList,
    camera: String,
    /// The user has selected a camera.
    is_camera_chosen: bool,
    poses: PoseChoice,
    board: String,
    address: String,
    profile: String,
    size: String,
    rate: String,
    delay: String,
    smoothing: String,
    /// Further request options, from the command line.
    options: LiveOptions,
    scene: Option<PathBuf>,
    with_scene: bool,
    /// Error of the last attempt to open a camera.
    error: Option<String>,
    /// A file chooser that covers the dialog.
    chooser: Option<(FileField, Chooser)>,
}

/// A field that names a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum FileField {
    Video,
    Board,
    Profile,
}

impl CameraDialog {
    /// Proposes a profile and a scene.
    pub fn new(ctx: &Context, profile: Option<PathBuf>, scene: Option<PathBuf>) -> Self {
        let wake = ctx.clone();
        Self {
            listing_task: BackgroundTask::spawn("cameras", move || wake.request_repaint(), cameras).ok(),
            cameras: CameraList::default(),
            camera: "0".to_owned(),
            is_camera_chosen: false,
            poses: PoseChoice::default(),
            board: String::new(),
            address: "opentrackio://127.0.0.1:55555".to_owned(),
            profile: profile.map_or(String::new(), |path| path.display().to_string()),
            size: String::new(),
            rate: String::new(),
            delay: String::new(),
            smoothing: String::new(),
            options: LiveOptions::default(),
            with_scene: scene.is_some(),
            scene,
            error: None,
            chooser: None,
        }
    }

    /// Fills the dialog with the settings of an open camera.
    pub fn with_source(self, from: &LiveSpec) -> Self {
        let options = from.options;
        let (poses, board, address) = match from.poses.split_once(':') {
            Some(("tags", board)) => (PoseChoice::Tags, board.to_owned(), self.address.clone()),
            _ if from.poses == "tags" => (PoseChoice::Tags, String::new(), self.address.clone()),
            _ if from.poses == "none" => (PoseChoice::None, String::new(), self.address.clone()),
            _ => (PoseChoice::Stream, String::new(), from.poses.clone()),
        };
        Self {
            camera: camera_name(options.driver, &from.camera),
            is_camera_chosen: true,
            poses,
            board,
            address,
            size: options.size.map_or(String::new(), |(width, height)| format!("{width}x{height}")),
            rate: options.rate_hz.map_or(String::new(), number),
            delay: match options.delay {
                DelayMode::Estimated => "auto".to_owned(),
                DelayMode::Fixed(0.0) => String::new(),
                DelayMode::Fixed(s) => number(s),
            },
            smoothing: options.smooth_s.map_or(String::new(), number),
            options,
            ..self
        }
    }

    /// Restores the entries of an earlier dialog.
    pub fn with_entries_of(self, before: Self) -> Self {
        let Self { scene, with_scene, listing_task, cameras, .. } = self;
        let profile = if before.profile.is_empty() { self.profile } else { before.profile.clone() };
        Self {
            scene,
            with_scene,
            listing_task,
            cameras,
            profile,
            is_camera_chosen: true,
            error: None,
            chooser: None,
            ..before
        }
    }

    /// Shows the dialog again with the reason why the camera was not opened.
    pub fn with_error(self, why: String) -> Self {
        Self { error: Some(why), is_camera_chosen: true, chooser: None, ..self }
    }

    /// Returns the document to open, or `Some(None)` if the dialog was cancelled.
    pub fn show(&mut self, ctx: &Context) -> Option<Option<DocumentRef>> {
        if let Some(done) = self.listing_task.as_ref().and_then(BackgroundTask::take) {
            self.listing_task = None;
            let failed = |errors| CameraList { entries: Vec::new(), errors: Some(errors) };
            self.cameras = done.unwrap_or_else(failed);
            if let Some(first) = self.cameras.entries.first().filter(|_| !self.is_camera_chosen) {
                self.camera.clone_from(&first.camera);
            }
        }
        if let Some((file_field, mut chooser)) = self.chooser.take() {
            match chooser.show(ctx) {
                None => self.chooser = Some((file_field, chooser)),
                Some(ChooserResult::Cancelled) => {}
                Some(ChooserResult::Path { path, .. }) => *self.text_of(file_field) = path.display().to_string(),
            }
            return None;
        }
        let mut answer = None;
        let keys = DialogKeys::of(ctx, "air");
        // Checked before the body: a field loses the focus on Enter.
        let has_focus = ctx.memory(|memory| memory.focused().is_some());
        let modal = question::modal(ctx, "air", "Live camera", |ui| {
            ui.set_width(460.0);
            ui.heading("Live camera");
            ui.add_space(4.0);
            egui::Grid::new("air").num_columns(2).spacing([12.0, 8.0]).show(ui, |ui| self.fields(ui));
            ui.add_space(10.0);
            let document = self.document();
            if let Some(error) = document.as_ref().err().or(self.error.as_ref()) {
                ui.colored_label(ui.visuals().error_fg_color, error);
            }
            ui.horizontal(|ui| {
                let start = ui.add_enabled_ui(document.is_ok(), |ui| default_button(ui, "Start", true)).inner;
                let is_cancelled = ui.button("Cancel").clicked();
                // Enter belongs to a focused field or button.
                let is_entered = keys.enter && !has_focus;
                if let Some(document) = document.ok().filter(|_| start.clicked() || is_entered) {
                    answer = Some(Some(document));
                }
                if is_cancelled {
                    answer = Some(None);
                }
            });
        });
        // Consumes Esc. A click beside the dialog does not close it.
        let _ = modal.should_close();
        answer.or(keys.escape.then_some(None))
    }

    fn fields(&mut self, ui: &mut Ui) {
        let width = 330.0;
        let label = ui.label("Camera");
        ui.vertical(|ui| {
            for CameraEntry { camera, label } in &self.cameras.entries {
                ui.radio_value(&mut self.camera, camera.clone(), label);
            }
            if self.listing_task.is_some() {
                ui.spinner();
            }
            if let Some(errors) = &self.cameras.errors {
                ui.add(egui::Label::new(errors).wrap());
            }
            let field = egui::TextEdit::singleline(&mut self.camera).desired_width(width);
            ui.add(field)
                .labelled_by(label.id)
                .on_hover_text("Its number or device, or a video that is played in its place");
            self.chooser_button(ui, FileField::Video, "Choose a video…");
        });
        ui.end_row();
        let label = ui.label("Pictures");
        ui.horizontal(|ui| {
            let field = egui::TextEdit::singleline(&mut self.size).desired_width(90.0).hint_text("640x480");
            ui.add(field).labelled_by(label.id).on_hover_text("Their size, px; empty: the profile's");
            ui.label("px, at");
            let field = egui::TextEdit::singleline(&mut self.rate).desired_width(50.0).hint_text("30");
            ui.add(field).on_hover_text("Pictures a second").widget_info(|| text_field("Rate"));
            ui.label("a second");
        });
        ui.end_row();
        ui.label("Poses");
        ui.vertical(|ui| {
            ui.radio_value(&mut self.poses, PoseChoice::Tags, "from printed tags in the picture");
            if self.poses == PoseChoice::Tags {
                let hint = "The board's file; empty for the sheet that `locard board` prints";
                let field = egui::TextEdit::singleline(&mut self.board).desired_width(width).hint_text("locard board");
                ui.add(field).on_hover_text(hint).widget_info(|| text_field("Board"));
                self.chooser_button(ui, FileField::Board, "Choose a board…");
                ui.horizontal(|ui| {
                    ui.label("smoothed over");
                    let field = egui::TextEdit::singleline(&mut self.smoothing).desired_width(50.0).hint_text("0");
                    let hint = "A time constant: poses are steadier, and as much later. Empty: as measured";
                    ui.add(field).on_hover_text(hint).widget_info(|| text_field("Smoothing"));
                    ui.label("s");
                });
            }
            ui.radio_value(&mut self.poses, PoseChoice::Stream, "from a stream");
            if self.poses == PoseChoice::Stream {
                let field = egui::TextEdit::singleline(&mut self.address).desired_width(width);
                let hint = "opentrackio://HOST:PORT, freed://HOST:PORT, or file:RECORDING";
                ui.add(field).on_hover_text(hint).widget_info(|| text_field("Address"));
                ui.horizontal(|ui| {
                    ui.label("delayed by");
                    let field = egui::TextEdit::singleline(&mut self.delay).desired_width(50.0).hint_text("0");
                    let hint =
                        "Added to the time of each pose; auto: the delay that fits the pictures best, found while they \
                         arrive";
                    ui.add(field).on_hover_text(hint).widget_info(|| text_field("Delay"));
                    ui.label("s, or auto");
                });
            }
            ui.radio_value(&mut self.poses, PoseChoice::None, "none: the picture alone");
        });
        ui.end_row();
        let label = ui.label("Profile");
        let hint = "The camera's, as `locard calibrate camera` writes it: tags need its focal length";
        ui.vertical(|ui| {
            let field =
                egui::TextEdit::singleline(&mut self.profile).desired_width(width).hint_text("a file; empty: none");
            ui.add(field).labelled_by(label.id).on_hover_text(hint);
            self.chooser_button(ui, FileField::Profile, "Choose a profile…");
        });
        ui.end_row();
        if let Some(scene) = &self.scene {
            ui.label("Scene");
            let name = scene.file_name().unwrap_or(scene.as_os_str()).to_string_lossy();
            ui.checkbox(&mut self.with_scene, format!("{name}, which is open"));
            ui.end_row();
        }
    }

    fn text_of(&mut self, file_field: FileField) -> &mut String {
        match file_field {
            FileField::Video => &mut self.camera,
            FileField::Board => &mut self.board,
            FileField::Profile => &mut self.profile,
        }
    }

    /// A button that opens a file chooser for a field.
    fn chooser_button(&mut self, ui: &mut Ui, file_field: FileField, title: &'static str) {
        if !ui.small_button(title).clicked() {
            return;
        }
        let mode = match file_field {
            FileField::Video => ChooserMode::File(&["mp4", "mkv", "mov", "webm", "avi"]),
            FileField::Board => ChooserMode::File(&["toml"]),
            FileField::Profile => ChooserMode::File(&["toml", "yaml", "yml", "xml"]),
        };
        // Starts in the folder of a file that is already named.
        let texts = [self.text_of(file_field).clone(), self.profile.clone(), self.board.clone(), self.camera.clone()];
        let files = texts.iter().map(|text| PathBuf::from(text.trim())).filter(|path| path.is_absolute());
        let folders = files.filter_map(|file| file.parent().map(Path::to_owned)).chain(std::env::home_dir());
        let begin = StartLocation::within(folders.collect::<Vec<_>>());
        self.chooser = Some((file_field, Chooser::new(title.trim_end_matches('…'), mode, begin)));
    }

    /// The document to open, or an error in the entries.
    fn document(&self) -> Result<DocumentRef, String> {
        let typed = |text: &str| Some(text.trim().to_owned()).filter(|text| !text.is_empty());
        let poses = match self.poses {
            PoseChoice::Tags => typed(&self.board).map_or_else(|| "tags".to_owned(), |board| format!("tags:{board}")),
            PoseChoice::Stream => self.address.trim().to_owned(),
            PoseChoice::None => "none".to_owned(),
        };
        let size = parsed("Pictures", typed(&self.size), LiveOptions::parse_size)?;
        let rate_hz = parsed("Rate", typed(&self.rate), LiveOptions::parse_rate_hz)?;
        // Ignores entries of the pose sources that are not selected.
        let is = |poses: PoseChoice| self.poses == poses;
        let delay = typed(&self.delay).filter(|_| is(PoseChoice::Stream));
        let delay = parsed("Delay", delay, LiveOptions::parse_delay)?;
        let smoothing = typed(&self.smoothing).filter(|_| is(PoseChoice::Tags));
        let smooth_s = parsed("Smoothing", smoothing, LiveOptions::parse_time_constant_s)?;
        let (driver, camera) = DriverName::split(self.camera.trim());
        let options = LiveOptions { driver, size, rate_hz, delay: delay.unwrap_or_default(), smooth_s, ..self.options };
        let from = LiveSpec { options, ..LiveSpec::new(camera, &poses) }.absolute();
        let scene = self.scene.clone().filter(|_| self.with_scene);
        Ok(DocumentRef::camera(from, typed(&self.profile).map(PathBuf::from), scene))
    }
}

/// The value of a field's text; `None` for an empty field. An error names the field.
fn parsed<T>(
    field: &str,
    text: Option<String>,
    parse: impl Fn(&str) -> Result<T, String>,
) -> Result<Option<T>, String> {
    text.map(|text| parse(&text)).transpose().map_err(|error| format!("{field}: {error}"))
}

fn text_field(name: &str) -> egui::WidgetInfo {
    egui::WidgetInfo::labeled(egui::Role::TextInput, true, name)
}

/// The cameras of all drivers. The name of a driver other than the default one precedes its
/// cameras.
fn cameras() -> CameraList {
    let drivers = webcam::cameras();
    let default = drivers.first().map(|(driver, _)| *driver);
    let mut entries = Vec::new();
    let mut problems = Vec::new();
    for (driver, cameras) in drivers {
        match cameras {
            Ok(cameras) => entries.extend(cameras.iter().map(|camera| {
                let number = camera.number.to_string();
                let label = format!("{number}: {}", shown(&camera.name));
                if Some(driver) == default {
                    CameraEntry { camera: number, label }
                } else {
                    CameraEntry { camera: camera_name(Some(driver), &number), label: format!("{label} ({driver})") }
                }
            })),
            Err(error) => problems.push(error.to_string()),
        }
    }
    if entries.is_empty() && problems.is_empty() {
        problems.push("No camera was found; a video's file can stand in for one.".to_owned());
    }
    let errors = (!problems.is_empty()).then(|| problems.join("\n"));
    CameraList { entries, errors }
}

/// A camera, preceded by its driver if that is not the default one, for [`DriverName::split`].
fn camera_name(driver: Option<DriverName>, camera: &str) -> String {
    driver.map_or_else(|| camera.to_owned(), |driver| format!("{driver}:{camera}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn camera_name_includes_its_driver() {
        for (driver, camera) in [(None, "0"), (Some(DriverName::Nokhwa), "1"), (None, "video.mp4")] {
            assert_eq!(DriverName::split(&camera_name(driver, camera)), (driver, camera));
        }
    }
}
