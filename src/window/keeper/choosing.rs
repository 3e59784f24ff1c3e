//! The menu of files, the dialogs that choose a path, and what is done with what is chosen.

use std::path::{Path, PathBuf};

use eframe::egui;

use super::super::air::Air;
use super::super::camera::Asked;
use super::super::chooser::{Begin, Chooser, Chosen, Seeks};
use super::super::command;
use super::super::project::Project;
use super::super::recent::Opened;
use super::super::saving::{self, Step};
use super::super::session::Session;
use super::{Keeper, Purpose, Then};
use locard_engine::assets;
use locard_engine::scene::is_model;

impl Keeper {
    pub fn open(&mut self, project: &Project) {
        self.choose(project, Purpose::Open, "Open a recording", Seeks::Recording, None);
    }

    /// Asks for a path, beginning at the file that is open for it; for a new scene or profile in the recording's folder; for
    /// a missing file where the scene expects it; else in the folder that was used last, or beside the recording; there with
    /// a name that is proposed.
    pub(super) fn choose(
        &mut self,
        project: &Project,
        purpose: Purpose,
        title: &str,
        seeks: Seeks,
        proposed: Option<&str>,
    ) {
        // By their names: the disk is asked later, and not here.
        let whole = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        let is_called = |path: &Path, other: &str| whole(path) == whole(&assets::path(other));
        let own = match purpose {
            Purpose::OpenProfile | Purpose::SaveProfile => project.profile.clone(),
            Purpose::OpenScene | Purpose::SaveScene => {
                project.scene.clone().filter(|scene| !is_called(scene, saving::DEMO_SCENE))
            }
            Purpose::Open | Purpose::Locate(_) | Purpose::Put(_) | Purpose::Record | Purpose::Keep => None,
        };
        let recording = whole(&project.shot().recording.path);
        let parent = recording.parent().map(Path::to_owned);
        // The demonstration's folder is the program's, and a camera has none.
        let is_own =
            !is_called(&recording, saving::DEMO) && !project.is_frozen() && !project.shot().recording.is_arriving();
        let beside = parent.clone().filter(|_| is_own);
        let last = self.habits.folder(purpose.of()).map(Path::to_owned);
        // What belongs to a recording lies in it or beside it.
        let folders = match &purpose {
            Purpose::Locate(missing) => expected_folders(&whole(missing), &whole(&project.scene_path())),
            _ => Vec::new(),
        };
        let others = match purpose {
            Purpose::SaveScene | Purpose::SaveProfile if is_own => [Some(recording), parent, last],
            Purpose::Open => [beside, last, parent],
            _ => [last, beside, None],
        };
        let folders = folders.into_iter().chain(others.into_iter().flatten());
        let begin = match &own {
            Some(own) => Begin::at(own),
            None => Begin {
                name: proposed.unwrap_or_default().to_owned(),
                ..Begin::within(folders.chain(std::env::home_dir()))
            },
        };
        let places = match purpose {
            Purpose::OpenProfile => vec![("Locard's profiles", assets::path(saving::PROFILES))],
            _ => Vec::new(),
        };
        self.chooser = Some((purpose, Chooser::new(title, seeks, Begin { places, ..begin })));
    }

    /// Asks for a profile for what is open.
    pub fn choose_profile(&mut self, project: &Project) {
        self.choose(project, Purpose::OpenProfile, "Open a profile", Seeks::File(&["toml"]), None);
    }

    /// Asks where a file is that the scene names and that cannot be read.
    pub fn choose_missing(&mut self, project: &Project, missing: PathBuf) {
        let title = format!("Locate {}", missing.file_name().unwrap_or_default().to_string_lossy());
        let seeks = Seeks::File(if is_model(&missing) { &["glb", "gltf"] } else { &["hdr", "exr"] });
        self.choose(project, Purpose::Locate(missing), &title, seeks, None);
    }

    pub(super) fn name_scene(&mut self, project: &Project) {
        let seeks = Seeks::NewFile(&["toml"]);
        self.choose(project, Purpose::SaveScene, "Save the scene as", seeks, Some("scene.toml"));
    }

    pub(super) fn name_profile(&mut self, project: &Project) {
        let seeks = Seeks::NewFile(&["toml"]);
        self.choose(project, Purpose::SaveProfile, "Save the profile as", seeks, Some("profile.toml"));
    }

    /// The menu of files.
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
            Some("Live camera…") => self.asks_camera(ui.ctx(), project),
            Some("Open a scene…") => {
                let seeks = Seeks::File(&["toml", "glb", "gltf"]);
                self.choose(project, Purpose::OpenScene, "Open a scene", seeks, None);
            }
            Some("Open a profile…") => self.choose_profile(project),
            Some("Save") => self.save(),
            Some("Save the scene as…") => {
                self.name_scene(project);
            }
            Some("Save the profile as…") => {
                self.name_profile(project);
            }
            Some("Export and photograph…") => self.shows_output = true,
            Some("Copy command line") => copy_command(ui.ctx(), session),
            Some("Home") => self.shows_start = true,
            _ => {}
        }
    }

    /// Asks for a camera, with the profile and the scene that are open.
    pub fn asks_camera(&mut self, ctx: &egui::Context, project: &Project) {
        let scene = project.scene.clone().filter(|scene| !saving::is_demo(scene));
        // What was asked for last, and perhaps refused, is still there.
        let air = Air::new(ctx, project.profile.clone(), scene);
        self.air = Some(match (self.aired.take(), &project.camera) {
            (Some(before), _) => air.restored(before),
            (None, Some(from)) => air.of(from),
            (None, None) => air,
        });
    }

    /// What is asked of the camera that is shown.
    pub fn of_camera(&mut self, ctx: &egui::Context, session: &mut Session, asked: Asked) {
        let seeks = Seeks::EmptyFolder;
        match asked {
            Asked::Freeze => {
                let folder = self.folder.clone().unwrap_or_else(|| std::env::temp_dir().join("locard"));
                session.freeze(ctx, &folder.join("live"));
            }
            Asked::Live => session.go_live(ctx),
            Asked::Record => {
                self.choose(&session.project, Purpose::Record, "Record into a new folder", seeks, Some("recording"));
            }
            Asked::Stop => session.stop_recording(),
            Asked::Keep => {
                self.choose(&session.project, Purpose::Keep, "Keep it in a new folder", seeks, Some("recording"));
            }
        }
    }

    pub(super) fn choosing(&mut self, ctx: &egui::Context, session: &mut Session) {
        let Some((purpose, mut chooser)) = self.chooser.take() else { return };
        match chooser.show(ctx) {
            None => self.chooser = Some((purpose, chooser)),
            Some(Chosen::Nothing) => {
                // What was to be done after saving is not done.
                (self.saving, self.then) = (None, None);
            }
            Some(Chosen::Path { path, replaces }) => self.chosen(ctx, purpose, path, replaces, session),
        }
    }

    pub(super) fn chosen(
        &mut self,
        ctx: &egui::Context,
        purpose: Purpose,
        path: PathBuf,
        replaces: bool,
        session: &mut Session,
    ) {
        self.habits.used(purpose.of(), &path);
        match purpose {
            Purpose::Open => self.dropped(ctx, path, session),
            Purpose::OpenProfile => self.open_profile(path, session),
            Purpose::OpenScene => {
                self.then =
                    Some(Then::Open(Box::new(Opened { scene: Some(path), ..Opened::of(&session.project) }), None));
            }
            Purpose::Locate(missing) => match session.project.locate(&missing, &path) {
                Ok(said) => session.say(said),
                Err(error) => session.wrong(error),
            },
            Purpose::SaveProfile => {
                // It was named.
                self.shared.push(path.clone());
                self.write(ctx, session, &Step::WriteProfile(path), true);
            }
            Purpose::SaveScene => self.write(ctx, session, &Step::WriteScene(path), true),
            Purpose::Record => session.record(path),
            Purpose::Keep => session.keep(ctx, path),
            Purpose::Put(ask) => {
                let name = ask.name(&path);
                self.queue(ctx);
                match &mut self.jobs {
                    Some(jobs) => _ = jobs.add(name, session.project.shot(), ask.task(path, replaces)),
                    None => session.wrong("no thread can be started that exports"),
                }
                self.shows_output = true;
            }
        }
    }
}

fn copy_command(ctx: &egui::Context, session: &mut Session) {
    let line = command::composite(&session.project, session.player.frame());
    ctx.copy_text(line.text);
    session.say(match line.before.is_empty() {
        true => "The command line is in the clipboard".to_owned(),
        false => format!("The command line is in the clipboard. {}", line.before.join(" ")),
    });
}

/// The folders in which a missing file is looked for, the likeliest first: its own one, the folders
/// above it as far as the scene's, and the scene's.
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
    fn missing_file_is_looked_for_where_the_scene_expects_it() {
        let folders = |missing: &str| expected_folders(Path::new(missing), Path::new("/case/scene.toml"));
        let [own, above, of_scene] = ["/case/models/new", "/case/models", "/case"].map(PathBuf::from);
        assert_eq!(folders("/case/models/new/knife.glb"), [own, above, of_scene.clone(), of_scene.clone()]);
        assert_eq!(folders("/other/disk/knife.glb"), [PathBuf::from("/other/disk"), of_scene.clone()]);
        let beside = ["/case/../models", "/case/..", "/case"].map(PathBuf::from);
        assert_eq!(folders("/case/../models/knife.glb")[..3], beside);
    }
}
