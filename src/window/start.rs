//! The start window, without a recording and without the demonstration. It offers recordings and
//! cameras to open, and then becomes the tuner.

use std::path::{Path, PathBuf};

use eframe::egui::{self, Ui};
use eframe::egui_wgpu::RenderState;

use super::actions::{self, Action};
use super::app::App;
use super::camera_dialog::CameraDialog;
use super::chooser::{Chooser, ChooserMode, ChooserResult, StartLocation};
use super::dialogs;
use super::documents::DocumentSwitch;
use super::file_kind::FileKind;
use super::keys;
use super::message::MessageWindow;
use super::opening::DocumentOpening;
use super::painter;
use super::question::Answer;
use super::recent::DocumentRef;
use super::recovery_search::{RecoverableWork, RecoverySearch};
use super::saving::DEMO;
use super::state::{FolderUse, UserState};
use super::task::BackgroundTask;
use super::theme;
use super::window_size;
use locard_engine::assets;

/// An opened project, with autosaved work to restore.
type OpenedTurn = (DocumentSwitch, Option<RecoverableWork>);

/// A modal dialog of the start window.
enum StartDialog {
    Chooser(Box<Chooser>),
    Camera(Box<CameraDialog>),
    Opening(Box<DocumentOpening>),
    Recovery(RecoverableWork),
}

/// The start window.
pub struct Start {
    window: RenderState,
    /// Folder of preferences and autosaved work.
    folder: Option<PathBuf>,
    user_state: UserState,
    recoverable: Vec<RecoverableWork>,
    recovery_search: Option<RecoverySearch>,
    dialog: Option<StartDialog>,
    /// Searched folders of the demonstration.
    places: Vec<PathBuf>,
    /// The camera dialog as last confirmed, restored if opening fails.
    last_camera_dialog: Option<Box<CameraDialog>>,
    /// A dropped file whose kind is being determined.
    dropped: Option<(PathBuf, BackgroundTask<FileKind>)>,
    message: Option<MessageWindow>,
    shows_keys: bool,
    /// The tuner, once a recording is open.
    app: Option<Box<App>>,
}

impl Start {
    /// Offers autosaved work in the user's state folder.
    pub fn new(context: &eframe::CreationContext<'_>, folder: Option<&Path>) -> Result<Self, String> {
        let ctx = &context.egui_ctx;
        theme::install(ctx);
        // From the first frame on: egui hands over its textures only once.
        let window = painter::take_over(context)?;
        let user_state = folder.map_or_else(UserState::default, UserState::read);
        ctx.set_theme(user_state.theme());
        let wake = ctx.clone();
        let recovery_search =
            folder.and_then(|folder| RecoverySearch::begin(folder.join("work"), move || wake.request_repaint()).ok());
        Ok(Self {
            window,
            folder: folder.map(Path::to_owned),
            user_state,
            recoverable: Vec::new(),
            recovery_search,
            dialog: None,
            places: assets::folders(),
            last_camera_dialog: None,
            dropped: None,
            message: None,
            shows_keys: false,
            app: None,
        })
    }

    /// The tuner, once something is open.
    pub fn app(&self) -> Option<&App> {
        self.app.as_deref()
    }

    fn begin(&mut self, ctx: &egui::Context, document: DocumentRef, recoverable: Option<RecoverableWork>) {
        let wake = ctx.clone();
        match DocumentOpening::begin(document, recoverable, false, move || wake.request_repaint()) {
            Ok(opening) => {
                if let Some(StartDialog::Recovery(waiting)) =
                    self.dialog.replace(StartDialog::Opening(Box::new(opening)))
                {
                    self.recoverable.push(waiting);
                }
            }
            Err(error) => {
                self.message =
                    Some(MessageWindow::new(format!("The thread that opens it could not be started: {error}")))
            }
        }
    }

    fn drop(&mut self, ctx: &egui::Context, path: PathBuf) {
        let (wake, dropped) = (ctx.clone(), path.clone());
        match BackgroundTask::spawn("file kind", move || wake.request_repaint(), move || FileKind::of(&dropped)) {
            Ok(kind) => self.dropped = Some((path, kind)),
            Err(error) => {
                self.message =
                    Some(MessageWindow::new(format!("The thread that opens it could not be started: {error}")))
            }
        }
    }

    fn show_chooser(&mut self) {
        let last = self.user_state.folder(FolderUse::Recording).map(Path::to_owned);
        let begin = StartLocation::within(last.into_iter().chain(std::env::home_dir()));
        let chooser = Chooser::new("Open a recording", ChooserMode::Recording, begin);
        self.dialog = Some(StartDialog::Chooser(Box::new(chooser)));
    }

    /// Shows one frame of the window. Returns an opened project.
    fn show(&mut self, ctx: &egui::Context) -> Option<OpenedTurn> {
        for file in ctx.input(|i| i.raw.dropped_files.clone()) {
            self.drop(ctx, file.path().to_owned());
        }
        if let Some((path, kind)) = self.dropped.take() {
            match kind.take() {
                None => self.dropped = Some((path, kind)),
                Some(Ok(FileKind::Recording)) => self.begin(ctx, DocumentRef::recording(path), None),
                Some(Ok(FileKind::Neither(why)) | Err(why)) => self.message = Some(MessageWindow::new(why)),
                Some(Ok(FileKind::Scene | FileKind::Profile | FileKind::Model)) => {
                    let why = format!("{}: open a recording first, then drop it again", path.display());
                    self.message = Some(MessageWindow::new(why));
                }
            }
        }
        if self.dialog.is_none() {
            match self.recovery_search.as_mut().and_then(RecoverySearch::take) {
                Some(Ok(work)) => (self.recoverable, self.recovery_search) = (work, None),
                Some(Err(why)) => self.message = Some(MessageWindow::new(why)),
                None => {}
            }
            self.dialog = self.recoverable.pop().map(StartDialog::Recovery);
        }
        match self.dialog.take() {
            Some(dialog) => self.show_dialog(ctx, dialog),
            None => {
                self.show_page(ctx);
                None
            }
        }
    }

    /// Shows the open dialog. Returns an opened project.
    fn show_dialog(&mut self, ctx: &egui::Context, dialog: StartDialog) -> Option<OpenedTurn> {
        match dialog {
            StartDialog::Opening(opening) => return self.poll_opening(ctx, opening),
            StartDialog::Chooser(mut chooser) => match chooser.show(ctx) {
                None => self.dialog = Some(StartDialog::Chooser(chooser)),
                Some(ChooserResult::Cancelled) => {}
                Some(ChooserResult::Path { path, .. }) => {
                    self.user_state.remember_folder(FolderUse::Recording, &path);
                    self.drop(ctx, path);
                }
            },
            StartDialog::Camera(mut camera_dialog) => match camera_dialog.show(ctx) {
                None => self.dialog = Some(StartDialog::Camera(camera_dialog)),
                Some(None) => {}
                Some(Some(document)) => {
                    self.last_camera_dialog = Some(camera_dialog);
                    self.begin(ctx, document, None);
                }
            },
            StartDialog::Recovery(recoverable) => match dialogs::offer_recovery(ctx, &recoverable.work) {
                Some(Answer::Yes) => self.begin(ctx, recoverable.work.document(), Some(recoverable)),
                Some(Answer::No) => recoverable.discard(),
                // The work stays on disk and is offered at the next start.
                Some(Answer::Cancel) => drop(recoverable),
                None => self.dialog = Some(StartDialog::Recovery(recoverable)),
            },
        }
        None
    }

    /// Shows the progress of opening, and handles its result. Returns an opened project.
    fn poll_opening(&mut self, ctx: &egui::Context, opening: Box<DocumentOpening>) -> Option<OpenedTurn> {
        let done = match opening.take() {
            Ok(done) => done,
            Err(opening) => {
                dialogs::show_opening(ctx, opening.recording_path());
                self.dialog = Some(StartDialog::Opening(opening));
                return None;
            }
        };
        match done.project {
            Ok((project, camera)) => {
                let turn = DocumentSwitch { project: *project, camera, at: done.document.at };
                return Some((turn, done.recoverable));
            }
            Err(refused) => {
                self.recoverable.extend(done.recoverable);
                // The dialog reappears with its input.
                match self.last_camera_dialog.take().filter(|_| done.document.camera.is_some()) {
                    Some(dialog) => self.dialog = Some(StartDialog::Camera(Box::new(dialog.with_error(refused.why)))),
                    None => self.message = Some(MessageWindow::new(refused.why)),
                }
            }
        }
        None
    }

    /// Handles keys, and shows the welcome page.
    fn show_page(&mut self, ctx: &egui::Context) {
        for action in actions::pressed(ctx, false) {
            match action {
                Action::Keys => self.shows_keys = !self.shows_keys,
                Action::Leave => (self.shows_keys, self.message) = (false, None),
                Action::Open => self.show_chooser(),
                Action::Theme => theme::toggle(ctx),
                // Other actions need an open recording.
                _ => {}
            }
        }
        keys::show(ctx, &mut self.shows_keys);
        let places: Vec<PathBuf> = self.places.iter().map(|folder| folder.join(DEMO)).collect();
        match dialogs::show_start(ctx, self.user_state.recent(ctx), dialogs::StartBackground::Nothing(&places)) {
            Some(dialogs::StartChoice::Open) => self.show_chooser(),
            Some(dialogs::StartChoice::Camera) => {
                self.dialog = Some(StartDialog::Camera(Box::new(CameraDialog::new(ctx, None, None))));
            }
            Some(dialogs::StartChoice::Recent(document)) => self.begin(ctx, *document, None),
            Some(dialogs::StartChoice::Continue) | None => {}
        }
        if let Some(message) = &mut self.message
            && message.show(ctx)
        {
            self.message = None;
        }
    }
}

impl eframe::App for Start {
    fn clear_color(&self, visuals: &egui::Visuals) -> [f32; 4] {
        visuals.panel_fill.to_normalized_gamma_f32()
    }

    fn ui(&mut self, ui: &mut Ui, frame: &mut eframe::Frame) {
        if let Some(app) = &mut self.app {
            return app.ui(ui, frame);
        }
        let ctx = ui.ctx().clone();
        window_size::fit_to_screen(&ctx);
        egui::CentralPanel::default().show(ui, |_| ());
        let Some((turn, recoverable)) = self.show(&ctx) else { return };
        match App::begin(&ctx, self.window.clone(), turn.project, turn.camera) {
            Ok(mut app) => {
                // The tuner offers autosaved work from now on.
                (self.recoverable, self.recovery_search) = (Vec::new(), None);
                // Its file is complete before the tuner reads it.
                self.user_state = UserState::default();
                if let Some(folder) = &self.folder {
                    app.set_state_folder(folder);
                }
                app.restore_view(turn.at, recoverable);
                self.app = Some(Box::new(app));
                ctx.request_repaint();
            }
            Err(why) => self.message = Some(MessageWindow::new(why)),
        }
    }

    fn on_exit(&mut self) {
        if let Some(app) = &mut self.app {
            app.on_exit();
        }
    }
}
