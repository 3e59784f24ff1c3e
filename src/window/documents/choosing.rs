//! The File menu, file dialogs, and the handling of chosen paths.

use std::path::{Path, PathBuf};

use eframe::egui;

use super::super::camera::CameraCommand;
use super::super::camera_dialog::CameraDialog;
use super::super::chooser::{Chooser, ChooserMode, StartLocation};
use super::super::command;
use super::super::output::{OutputRequest, default_name};
use super::super::project::Project;
use super::super::saving::{self, SaveStep};
use super::super::session::Session;
use super::Documents;
use super::chooser_purpose::ChooserPurpose;
use super::dialog::Dialog;
use locard_engine::assets;
use locard_engine::scene::is_model;

/// File name extensions of scans.
const SCAN_EXTENSIONS: [&str; 13] =
    ["e57", "las", "laz", "ply", "obj", "stl", "glb", "gltf", "xyz", "pts", "asc", "txt", "csv"];
/// Item of the File menu that opens the panel of the scan.
const SCAN_ITEM: &str = "Scan of the place…";

impl Documents {
    pub fn open(&mut self, project: &Project) {
        self.choose(project, ChooserPurpose::Open, "Open a recording", ChooserMode::Recording, None);
    }

    /// Opens a dialog for a path. It starts at the open file of that kind; for a new scene or
    /// profile in the recording's folder; for a missing file where the scene expects it; else in
    /// the last used folder or beside the recording, with a proposed name.
    pub(super) fn choose(
        &mut self,
        project: &Project,
        purpose: ChooserPurpose,
        title: &str,
        mode: ChooserMode,
        proposed: Option<&str>,
    ) {
        // Compares names only: reading the disk may block.
        let absolute = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        let is_asset = |path: &Path, other: &str| absolute(path) == absolute(&assets::path(other));
        let open_path = match purpose {
            ChooserPurpose::OpenProfile | ChooserPurpose::SaveProfile => project.profile.clone(),
            ChooserPurpose::OpenScene | ChooserPurpose::SaveScene => {
                project.scene.clone().filter(|scene| !is_asset(scene, saving::DEMO_SCENE))
            }
            ChooserPurpose::Open
            | ChooserPurpose::Scan
            | ChooserPurpose::Locate(_)
            | ChooserPurpose::Output(_)
            | ChooserPurpose::Record
            | ChooserPurpose::KeepFrozen => None,
        };
        let recording = absolute(&project.shot().recording.path);
        let parent = recording.parent().map(Path::to_owned);
        // The demonstration's folder belongs to the program, and a camera has none.
        let is_own = !is_asset(&recording, saving::DEMO) && !project.is_frozen() && !project.shot().recording.is_live();
        let beside = parent.clone().filter(|_| is_own);
        let last = self.user_state.folder(purpose.folder_use()).map(Path::to_owned);
        // Files of a recording are in its folder or beside it.
        let folders = match &purpose {
            ChooserPurpose::Locate(missing) => expected_folders(&absolute(missing), &absolute(&project.scene_path())),
            _ => Vec::new(),
        };
        let others = match purpose {
            ChooserPurpose::SaveScene | ChooserPurpose::SaveProfile if is_own => [Some(recording), parent, last],
            ChooserPurpose::Open => [beside, last, parent],
            _ => [last, beside, None],
        };
        let folders = folders.into_iter().chain(others.into_iter().flatten());
        let begin = match &open_path {
            Some(open_path) => StartLocation::at(open_path),
            None => StartLocation {
                name: proposed.unwrap_or_default().to_owned(),
                ..StartLocation::within(folders.chain(std::env::home_dir()))
            },
        };
        let places = match purpose {
            ChooserPurpose::OpenProfile => vec![("Locard's profiles", assets::path(saving::PROFILES))],
            _ => Vec::new(),
        };
        let chooser = Chooser::new(title, mode, StartLocation { places, ..begin });
        self.dialog = Some(Dialog::Chooser(purpose, Box::new(chooser)));
    }

    /// Opens a dialog for a profile of the open recording.
    pub fn choose_profile(&mut self, project: &Project) {
        self.choose(
            project,
            ChooserPurpose::OpenProfile,
            "Open a profile",
            ChooserMode::File(&["toml", "yaml", "yml", "xml"]),
            None,
        );
    }

    /// Opens a dialog for a scan of the place.
    pub fn choose_scan(&mut self, project: &Project) {
        let mode = ChooserMode::File(&SCAN_EXTENSIONS);
        self.choose(project, ChooserPurpose::Scan, "Choose a scan of the place", mode, None);
    }

    /// Opens a dialog to locate a missing file of the scene.
    pub fn choose_missing(&mut self, project: &Project, missing: PathBuf) {
        let title = format!("Locate {}", missing.file_name().unwrap_or_default().to_string_lossy());
        let mode = ChooserMode::File(if is_model(&missing) { &["glb", "gltf"] } else { &["hdr", "exr"] });
        self.choose(project, ChooserPurpose::Locate(missing), &title, mode, None);
    }

    /// Opens a dialog for the path of an output.
    pub(super) fn choose_output(&mut self, project: &Project, request: OutputRequest) {
        let (title, mode) = match &request {
            OutputRequest::Folder(_) => ("Write pictures into a folder", ChooserMode::NewFolder),
            OutputRequest::Video { lossless: false, .. } => {
                ("Write a video", ChooserMode::NewFile(&["mp4", "mkv", "mov"]))
            }
            OutputRequest::Video { .. } => ("Write a video", ChooserMode::NewFile(&["mkv", "mp4"])),
            OutputRequest::Photograph(photo_request) if photo_request.bracket.is_some() => {
                ("Write a series of photographs", ChooserMode::NewSeries(&["jpg", "jpeg", "png"]))
            }
            OutputRequest::Photograph(_) => ("Write a photograph", ChooserMode::NewFile(&["jpg", "jpeg", "png"])),
            OutputRequest::Snapshot(_) => ("Write the frame", ChooserMode::NewFile(&["png"])),
        };
        let name = default_name(&request, &project.shot().recording.path);
        self.choose(project, ChooserPurpose::Output(request), title, mode, Some(&name));
    }

    pub(super) fn name_scene(&mut self, project: &Project) {
        let mode = ChooserMode::NewFile(&["toml"]);
        self.choose(project, ChooserPurpose::SaveScene, "Save the scene as", mode, Some("scene.toml"));
    }

    pub(super) fn name_profile(&mut self, project: &Project) {
        let mode = ChooserMode::NewFile(&["toml"]);
        self.choose(project, ChooserPurpose::SaveProfile, "Save the profile as", mode, Some("profile.toml"));
    }

    /// The File menu.
    pub fn menu(&mut self, ui: &mut egui::Ui, session: &mut Session) {
        let project = &session.project;
        let mut chosen = None;
        ui.menu_button("File", |ui| {
            let mut item = |ui: &mut egui::Ui, enabled: bool, text: &str| {
                let clicked = ui.add_enabled(enabled, egui::Button::new(text)).clicked();
                if clicked {
                    ui.close();
                    chosen = Some(text.to_owned());
                }
            };
            item(ui, true, "Open a recording…");
            item(ui, true, "Live camera…");
            item(ui, true, "Open a scene…");
            item(ui, true, "Open a profile…");
            item(ui, project.can_place() && !session.is_live(), SCAN_ITEM);
            ui.separator();
            item(ui, !project.is_saved(), "Save");
            item(ui, project.can_place(), "Save the scene as…");
            item(ui, true, "Save the profile as…");
            ui.separator();
            item(ui, true, "Export and photograph…");
            item(ui, true, "Copy command line");
            ui.separator();
            item(ui, true, "Home");
            ui.menu_button("Theme", |ui| {
                let mut theme = ui.ctx().options(|options| options.theme_preference);
                for (one, name) in [
                    (egui::ThemePreference::System, "as the system"),
                    (egui::ThemePreference::Light, "light"),
                    (egui::ThemePreference::Dark, "dark"),
                ] {
                    if ui.radio_value(&mut theme, one, name).clicked() {
                        ui.ctx().set_theme(theme);
                        ui.close();
                    }
                }
            });
        });
        let project = &session.project;
        match chosen.as_deref() {
            Some("Open a recording…") => self.open(project),
            Some("Live camera…") => self.show_camera_dialog(ui.ctx(), project),
            Some("Open a scene…") => {
                let mode = ChooserMode::File(&["toml", "glb", "gltf"]);
                self.choose(project, ChooserPurpose::OpenScene, "Open a scene", mode, None);
            }
            Some("Open a profile…") => self.choose_profile(project),
            Some(SCAN_ITEM) => self.opens_scan_panel = true,
            Some("Save") => self.save(),
            Some("Save the scene as…") => {
                self.name_scene(project);
            }
            Some("Save the profile as…") => {
                self.name_profile(project);
            }
            Some("Export and photograph…") => self.output_jobs.is_open = true,
            Some("Copy command line") => copy_command(ui.ctx(), session),
            Some("Home") => self.is_start_open = true,
            _ => {}
        }
    }

    /// Opens the camera dialog with the open profile and scene.
    pub fn show_camera_dialog(&mut self, ctx: &egui::Context, project: &Project) {
        let scene = project.scene.clone().filter(|scene| !saving::is_demo(scene));
        // Restores the last request, which may have been refused.
        let camera_dialog = CameraDialog::new(ctx, project.profile.clone(), scene);
        let camera_dialog = match (self.last_camera_dialog.take(), &project.camera) {
            (Some(before), _) => camera_dialog.with_entries_of(before),
            (None, Some(from)) => camera_dialog.with_source(from),
            (None, None) => camera_dialog,
        };
        self.dialog = Some(Dialog::Camera(Box::new(camera_dialog)));
    }

    /// Handles a button of the camera panel.
    pub fn handle_camera_request(&mut self, ctx: &egui::Context, session: &mut Session, request: CameraCommand) {
        let mode = ChooserMode::EmptyFolder;
        match request {
            CameraCommand::Freeze => {
                let folder = self.state_folder.clone().unwrap_or_else(|| std::env::temp_dir().join("locard"));
                session.freeze(ctx, &folder.join("live"));
            }
            CameraCommand::Live => session.go_live(ctx),
            CameraCommand::Record => {
                self.choose(
                    &session.project,
                    ChooserPurpose::Record,
                    "Record into a new folder",
                    mode,
                    Some("recording"),
                );
            }
            CameraCommand::Stop => session.stop_recording(),
            CameraCommand::Keep => {
                self.choose(
                    &session.project,
                    ChooserPurpose::KeepFrozen,
                    "Keep it in a new folder",
                    mode,
                    Some("recording"),
                );
            }
        }
    }

    pub(super) fn handle_choice(
        &mut self,
        ctx: &egui::Context,
        purpose: ChooserPurpose,
        path: PathBuf,
        replaces: bool,
        session: &mut Session,
    ) {
        self.user_state.remember_folder(purpose.folder_use(), &path);
        match purpose {
            ChooserPurpose::Open => self.open_file(ctx, path, session),
            ChooserPurpose::OpenProfile => self.open_profile(path, session),
            ChooserPurpose::OpenScene => self.open_scene(path, session),
            ChooserPurpose::Locate(missing) => match session.project.locate(&missing, &path) {
                Ok(message) => session.show_message(message),
                Err(error) => session.show_error(error),
            },
            ChooserPurpose::Scan => self.chosen_scan = Some(path),
            ChooserPurpose::SaveProfile => {
                // The user named this profile, which approves it.
                self.save.approved_profiles.push(path.clone());
                self.write(ctx, session, &SaveStep::WriteProfile(path), true);
            }
            ChooserPurpose::SaveScene => self.write(ctx, session, &SaveStep::WriteScene(path), true),
            ChooserPurpose::Record => session.record(path),
            ChooserPurpose::KeepFrozen => session.copy_recording(ctx, path),
            ChooserPurpose::Output(request) => self.output_jobs.add(ctx, session, request, path, replaces),
        }
    }
}

fn copy_command(ctx: &egui::Context, session: &mut Session) {
    let line = command::composite(&session.project, session.player.frame());
    ctx.copy_text(line.text);
    session.show_message(if line.before.is_empty() {
        "The command line is in the clipboard".to_owned()
    } else {
        format!("The command line is in the clipboard. {}", line.before.join(" "))
    });
}

/// Folders to search for a missing file, most likely first: its own folder, the folders above it up
/// to the scene's, and the scene's.
fn expected_folders(missing: &Path, scene: &Path) -> Vec<PathBuf> {
    let of_scene = scene.parent().unwrap_or(Path::new(""));
    let above = missing.ancestors().skip(1);
    let within = above.enumerate().take_while(|(at, folder)| *at == 0 || folder.starts_with(of_scene));
    within.map(|(_, folder)| folder).chain([of_scene]).map(Path::to_owned).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_file_is_searched_where_the_scene_expects_it() {
        let folders = |missing: &str| expected_folders(Path::new(missing), Path::new("/case/scene.toml"));
        let [own, above, of_scene] = ["/case/models/new", "/case/models", "/case"].map(PathBuf::from);
        assert_eq!(folders("/case/models/new/knife.glb"), [own, above, of_scene.clone(), of_scene.clone()]);
        assert_eq!(folders("/other/disk/knife.glb"), [PathBuf::from("/other/disk"), of_scene.clone()]);
        let beside = ["/case/../models", "/case/..", "/case"].map(PathBuf::from);
        assert_eq!(folders("/case/../models/knife.glb")[..3], beside);
    }
}
