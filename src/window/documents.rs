//! The user's documents: opening and saving, confirmation questions, crash recovery, and exported
//! files.

mod chooser_purpose;
mod choosing;
mod dialog;
mod open;
mod output_jobs;
mod pending_action;
mod recovery;
mod save;

use std::path::{Path, PathBuf};
use std::time::Instant;

use eframe::egui;

use self::dialog::Dialog;
use self::output_jobs::OutputJobs;
use self::pending_action::PendingAction;
use self::recovery::Recovery;
use self::save::SaveProgress;
use super::camera_dialog::CameraDialog;
use super::file_kind::FileKind;
use super::file_watch::{Change, FileWatch};
use super::jobs::Jobs;
use super::message::MessageWindow;
use super::missing;
use super::project::Project;
use super::recent::{DocumentRef, ViewState};
use super::recovery_search::RecoverableWork;
use super::session::Session;
use super::state::UserState;
use super::task::BackgroundTask;
use locard_engine::live;

/// The last refused document, until another one is opened.
#[derive(Debug, Default)]
struct RefusedOpening {
    /// A recording that could not be opened, possibly for lack of a profile.
    document: Option<DocumentRef>,
    profile_error: Option<String>,
}

/// A document to show from now on.
#[derive(Debug)]
pub struct DocumentSwitch {
    pub project: Project,
    /// Camera that replaces the recording.
    pub camera: Option<live::LiveInput>,
    pub at: ViewState,
}

/// Open files, unsaved work, exports, and the dialogs about them.
#[derive(Debug, Default)]
pub struct Documents {
    /// The user's folder for state between sessions.
    state_folder: Option<PathBuf>,
    user_state: UserState,
    recovery: Recovery,
    watch: FileWatch,
    pub output_jobs: OutputJobs,
    save: SaveProgress,
    dialog: Option<Dialog>,
    /// The camera dialog as the user last confirmed it.
    last_camera_dialog: Option<CameraDialog>,
    /// Shows the welcome page of a start without a recording.
    pub is_start_open: bool,
    /// The message in full.
    pub message: Option<MessageWindow>,
    /// Dropped files and the task that determines the kind of each.
    dropped_files: Vec<(PathBuf, BackgroundTask<FileKind>)>,
    /// A readable model that was dropped.
    dropped_model: Option<PathBuf>,
    /// A scan that was chosen.
    chosen_scan: Option<PathBuf>,
    /// The panel of the scan is to be opened.
    opens_scan_panel: bool,
    /// Waits for the open dialog and for the current save.
    pending: Option<PendingAction>,
    /// The user already confirmed that the pending action ends the camera recording.
    confirmed_recording_end: bool,
    may_close: bool,
    refused: RefusedOpening,
}

impl Documents {
    /// Stores state in the user's folder, and offers work to recover from there.
    pub fn set_state_folder(&mut self, folder: &Path, session: &mut Session) {
        self.user_state = UserState::read(folder);
        self.state_folder = Some(folder.to_owned());
        let work = folder.join("work");
        if let Err(error) = self.recovery.begin(&work) {
            session.show_message(format!("Autosave is off: {}: {error}", work.display()));
        }
        self.document_opened(session);
    }

    /// Adds the document and its view to the recent list when it is closed.
    pub fn remember_document(&mut self, project: &Project, at: ViewState) {
        if project.is_frozen() {
            return;
        }
        self.user_state.add_recent(DocumentRef { at, ..DocumentRef::of(project) });
    }

    /// Continues autosaving in the files of the recovered work.
    pub fn adopt_recovery(&mut self, recoverable: RecoverableWork) {
        self.recovery.adopt(recoverable);
    }

    /// Closes windows that need no answer. Returns false if none was open.
    pub fn close_windows(&mut self) -> bool {
        let was_open = self.output_jobs.is_open || self.is_start_open || self.message.is_some();
        (self.output_jobs.is_open, self.is_start_open, self.message) = (false, false, None);
        was_open
    }

    /// Closes the notice of a refused profile. The next profile is for the open recording.
    pub fn close_refusal(&mut self) {
        self.refused = RefusedOpening::default();
    }

    /// Error of the last refused profile, until the user dismisses it.
    pub fn refused_profile(&self) -> Option<&str> {
        self.refused.profile_error.as_deref()
    }

    /// Sets the function that restarts the program after the graphics device was lost.
    pub fn restart_with(&mut self, restart: fn() -> String) {
        self.recovery.restart_with = Some(restart);
    }

    /// Watches the files of a document that has just been opened.
    pub fn document_opened(&mut self, session: &Session) {
        let project = &session.project;
        if !project.is_frozen() {
            self.user_state.add_recent(DocumentRef::of(project));
        }
        self.watch.forget();
        self.watch_files(project);
    }

    /// Watches the open files, from their state when they were read.
    fn watch_files(&mut self, project: &Project) {
        let own = [project.profile.as_ref(), project.scene.as_ref()].into_iter().flatten();
        own.chain([&project.shot().recording.path]).for_each(|path| self.watch.record(path, project.stamp(path)));
    }

    /// The last chosen theme.
    pub fn theme(&self) -> egui::ThemePreference {
        self.user_state.theme()
    }

    /// Runs everything in a frame of the window that is not a panel. Returns a document to switch
    /// to.
    pub fn update(&mut self, ctx: &egui::Context, session: &mut Session) -> Option<DocumentSwitch> {
        if self.watch.is_empty() {
            self.watch_files(&session.project);
        }
        self.autosave_and_watch(ctx, session);
        self.intercept_close(ctx, session);
        self.show_chooser(ctx, session);
        self.advance_save(ctx, session);
        self.open_identified_file(session);
        let confirmed = self.show_dialog(ctx, session);
        self.output_jobs.report_ended(session);
        if let Some(request) = self.output_jobs.show(ctx, session) {
            self.choose_output(&session.project, request);
        }
        if let Some(message) = &mut self.message
            && message.show(ctx)
        {
            self.message = None;
        }
        match confirmed {
            Some(loaded) => Some(self.switch_to(loaded, None)),
            None => self.poll_opening(ctx, session),
        }
    }

    /// Autosaves unsaved work and checks the watched files.
    fn autosave_and_watch(&mut self, ctx: &egui::Context, session: &mut Session) {
        let now = Instant::now();
        let theme = ctx.options(|options| options.theme_preference);
        if theme != self.user_state.theme() {
            self.user_state.set_theme(theme);
        }
        #[cfg(development)]
        super::restart::lose_device_when_due(session.viewer.gpu(), ctx);
        if session.is_lost() && !self.recovery.has_handled_device_loss() {
            if self.recovery.restart(session) {
                self.may_close = true;
                ctx.send_viewport_cmd(egui::ViewportCommand::Close);
            }
            return;
        }
        self.recovery.search(ctx, session);
        self.recovery.autosave(ctx, session, now);
        let wake = ctx.clone();
        match self.watch.poll(now, move || wake.request_repaint()) {
            Ok(wait) => ctx.request_repaint_after(wait),
            Err(why) => session.show_error(format!("Files could not be checked for changes: {why}")),
        }
        let recording = &session.project.shot().recording.path;
        if self.watch.change(recording) == Some(Change::Gone) {
            session.show_error(format!("{} is missing: restore it to see its frames again", recording.display()));
        }
        self.load_returned_files(session);
    }

    /// Reloads the scene when a missing file is back, unless an uncommitted change is in progress.
    fn load_returned_files(&mut self, session: &mut Session) {
        let missing = |project: &Project| -> Vec<PathBuf> {
            project.shot().scene.missing.iter().map(|missing| missing.file.clone()).collect()
        };
        let before = missing(&session.project);
        self.watch.expect(&before);
        if session.project.history().has_uncommitted() || !self.watch.take_returned() {
            return;
        }
        match missing::reload(&mut session.project) {
            Ok(()) if missing(&session.project).len() < before.len() => {
                session.show_message("A missing file is back, and the scene was loaded again");
            }
            Ok(()) => {}
            Err(error) => session.show_error(error.to_string()),
        }
    }

    /// Takes the dropped model, which the next click places.
    pub fn take_model(&mut self) -> Option<PathBuf> {
        self.dropped_model.take()
    }

    /// Takes the chosen scan.
    pub fn take_scan(&mut self) -> Option<PathBuf> {
        self.chosen_scan.take()
    }

    /// True once after the request for the panel of the scan.
    pub fn take_scan_panel_request(&mut self) -> bool {
        std::mem::take(&mut self.opens_scan_panel)
    }

    /// True if rendering can wait. The first picture keeps the graphics device busy, which would
    /// delay the question about recoverable work; and recovery replaces the picture.
    pub fn defers_rendering(&self) -> bool {
        let is_due = !self.recovery.works.is_empty() || self.pending.as_ref().is_some_and(PendingAction::recovers);
        is_due || self.dialog.as_ref().is_some_and(Dialog::recovers)
    }

    /// True while a dialog needs an answer.
    pub fn is_dialog_open(&self) -> bool {
        self.dialog.is_some() || self.pending.is_some() || !self.recovery.works.is_empty()
    }

    /// Closes the window and discards unsaved changes.
    pub fn close_without_asking(&mut self) {
        self.may_close = true;
    }

    pub fn jobs(&self) -> Option<&Jobs> {
        self.output_jobs.jobs()
    }
}
