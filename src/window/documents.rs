//! The user's documents: opening and saving, confirmation questions, crash recovery, and exported
//! files.

mod choosing;
mod files;

use std::path::{Path, PathBuf};
use std::time::Instant;

use eframe::egui;

use super::analysing::Analysing;
use super::autosave::{Autosave, HISTORY_STEPS, RecoverableWork, UnsavedWork};
use super::camera_dialog::CameraDialog;
use super::camera_values::CameraValueTarget;
use super::chooser::{Chooser, ChooserMode};
use super::file_kind::FileKind;
use super::file_watch::{Change, FileWatch};
use super::jobs::{JobState, Jobs};
use super::message::MessageWindow;
use super::missing;
use super::opening::Opening;
use super::output::{Output, OutputRequest, PlaybackState, default_name};
use super::preferences::{FolderUse, Preferences};
use super::project::{Project, SaveError, WrittenFile};
use super::recent::{DocumentRef, Recent, ViewState};
use super::recovery_search::RecoverySearch;
use super::restart;
use super::saving::SavedFile;
use super::session::Session;
use super::task::BackgroundTask;
use locard_engine::live;

/// Purpose of a path chosen in a dialog.
#[derive(Debug)]
enum ChooserPurpose {
    Open,
    OpenProfile,
    OpenScene,
    /// A missing file that the scene refers to.
    Locate(PathBuf),
    SaveProfile,
    SaveScene,
    Output(OutputRequest),
    /// Folder for the camera's frames from now on.
    Record,
    /// Folder for the frozen last seconds.
    KeepFrozen,
}

impl ChooserPurpose {
    fn folder_use(&self) -> FolderUse {
        match self {
            Self::Open => FolderUse::Recording,
            Self::OpenProfile | Self::SaveProfile => FolderUse::Profile,
            Self::OpenScene | Self::SaveScene | Self::Locate(_) => FolderUse::Scene,
            Self::Output(_) | Self::Record | Self::KeepFrozen => FolderUse::Output,
        }
    }
}

/// Action that waits until unsaved work is safe.
#[derive(Debug)]
enum PendingAction {
    Close,
    Open(Box<DocumentRef>, Option<RecoverableWork>),
    /// Replaces the open document with the loaded one.
    Show(Box<LoadedDocument>),
}

/// A loaded document and the reference it was loaded from.
#[derive(Debug)]
struct LoadedDocument {
    document: DocumentRef,
    project: Box<Project>,
    recoverable: Option<RecoverableWork>,
}

/// A document to show from now on.
#[derive(Debug)]
pub struct DocumentSwitch {
    pub project: Project,
    /// Camera that replaces the recording.
    pub camera: Option<live::LiveInput>,
    pub at: ViewState,
}

/// Project version and history revision while no mouse button was down.
#[derive(Clone, Copy, Debug, Default)]
struct IdleState {
    version: u64,
    revision: u64,
}

/// Open files, unsaved work, exports, and the dialogs about them.
#[derive(Debug, Default)]
pub struct Documents {
    autosave: Option<Autosave>,
    idle_state: IdleState,
    recoverable: Vec<RecoverableWork>,
    /// Folder to search for recoverable work.
    recovery_folder: Option<PathBuf>,
    recovery_search: Option<RecoverySearch>,
    recent: Recent,
    preferences: Preferences,
    watch: Option<FileWatch>,
    jobs: Option<Jobs>,
    analysing: Analysing,
    output: Output,
    pub is_output_open: bool,
    /// Shows the welcome page of a start without a recording.
    pub is_start_open: bool,
    /// The message in full.
    pub message: Option<MessageWindow>,
    /// Error of the last refused profile, until the user dismisses it.
    pub refused_profile: Option<String>,
    chooser: Option<(ChooserPurpose, Chooser)>,
    /// Dialog for opening a live camera.
    camera_dialog: Option<CameraDialog>,
    /// The camera dialog as the user last confirmed it.
    last_camera_dialog: Option<CameraDialog>,
    /// The user's folder for state between sessions.
    state_folder: Option<PathBuf>,
    opening: Option<Opening>,
    /// Dropped files and the task that determines the kind of each.
    dropped_files: Vec<(PathBuf, BackgroundTask<FileKind>)>,
    /// A readable model that was dropped.
    dropped_model: Option<PathBuf>,
    writing: Option<BackgroundTask<Result<WrittenFile, SaveError>>>,
    /// Files that the user allowed to overwrite; `None` while nothing is being saved.
    approved_files: Option<Vec<PathBuf>>,
    /// Files written since saving started.
    saved_files: Vec<SavedFile>,
    overwrite_question: Option<PathBuf>,
    /// A shared profile about to be written for the first time.
    shared_profile_question: Option<PathBuf>,
    /// Shared profiles that the user allowed to overwrite.
    approved_profiles: Vec<PathBuf>,
    /// The dialog asks where to save changed camera values; its answer applies to the current save.
    asks_camera_values: bool,
    camera_values: Option<CameraValueTarget>,
    /// Waits for an answer or for the current save.
    pending: Option<PendingAction>,
    /// Confirmed document, ready to be shown.
    confirmed_document: Option<Box<LoadedDocument>>,
    /// The user already confirmed that the pending action ends the camera recording.
    confirmed_recording_end: bool,
    /// A recording that could not be opened, possibly for lack of a profile.
    failed_document: Option<DocumentRef>,
    may_close: bool,
    /// The loss of the device has been handled.
    handled_device_loss: bool,
    /// Restarts the program, or returns an error message. [`restart::restart`] if `None`.
    pub restart_with: Option<fn() -> String>,
    /// Files changed on disk whose open state the user chose to keep.
    ignored_changes: Vec<PathBuf>,
}

impl Documents {
    /// Stores state in the user's folder, and offers work to recover from there.
    pub fn set_state_folder(&mut self, folder: &Path, session: &mut Session) {
        self.recent = Recent::read(folder.join("recent.json"));
        self.preferences = Preferences::read(folder.join("habits.json"));
        self.state_folder = Some(folder.to_owned());
        let work = folder.join("work");
        match Autosave::begin(&work) {
            Ok(autosave) => self.autosave = Some(autosave),
            Err(error) => {
                session.show_message(format!("Your work is not kept for a crash: {}: {error}", work.display()))
            }
        }
        self.recovery_folder = Some(work);
        self.document_opened(session);
    }

    /// Adds the document and its view to the recent list when it is closed.
    pub fn remember_document(&mut self, project: &Project, at: ViewState) {
        if project.is_frozen() {
            return;
        }
        self.recent.add(DocumentRef { at, ..DocumentRef::of(project) });
    }

    /// Continues autosaving in the files of the recovered work.
    pub fn adopt_recovery(&mut self, recoverable: RecoverableWork) {
        match &mut self.autosave {
            Some(autosave) => autosave.adopt(recoverable),
            None => drop(recoverable),
        }
    }

    /// Closes windows that need no answer. Returns false if none was open.
    pub fn close_windows(&mut self) -> bool {
        let was_open = self.is_output_open || self.is_start_open || self.message.is_some();
        (self.is_output_open, self.is_start_open, self.message) = (false, false, None);
        was_open
    }

    /// Closes the notice of a refused profile. The next profile is for the open recording.
    pub fn close_refusal(&mut self) {
        (self.refused_profile, self.failed_document) = (None, None);
    }

    /// Watches the files of a document that has just been opened.
    fn document_opened(&mut self, session: &Session) {
        let project = &session.project;
        if !project.is_frozen() {
            self.recent.add(DocumentRef::of(project));
        }
        self.ignored_changes.clear();
        if let Some(watch) = &mut self.watch {
            watch.forget();
        }
        self.watch_files(project);
    }

    fn watch_files(&mut self, project: &Project) {
        let Some(watch) = &mut self.watch else { return };
        let own = [project.profile.as_ref(), project.scene.as_ref()].into_iter().flatten();
        own.chain([&project.shot().recording.path]).for_each(|path| watch.record(path, project.stamp(path)));
    }

    /// The last chosen theme.
    pub fn theme(&self) -> egui::ThemePreference {
        self.preferences.theme()
    }

    /// Starts saving changed files.
    pub fn save(&mut self) {
        if self.approved_files.is_none() {
            (self.approved_files, self.saved_files, self.camera_values) = (Some(Vec::new()), Vec::new(), None);
        }
    }

    /// Cancels a request to close the window if a question must be answered first.
    fn intercept_close(&mut self, ctx: &egui::Context, session: &Session) {
        let closes = ctx.input(|i| i.viewport().close_requested());
        if closes && !self.may_close && !self.consequences(session, true).is_harmless() {
            ctx.send_viewport_cmd(egui::ViewportCommand::CancelClose);
            self.pending = Some(PendingAction::Close);
        }
    }

    /// Runs everything in a frame of the window that is not a panel. Returns a document to switch
    /// to.
    pub fn update(&mut self, ctx: &egui::Context, session: &mut Session) -> Option<DocumentSwitch> {
        if self.watch.is_none() {
            let wake = ctx.clone();
            self.watch = FileWatch::begin(move || wake.request_repaint()).ok();
            self.watch_files(&session.project);
        }
        self.autosave_and_watch(ctx, session);
        self.intercept_close(ctx, session);
        self.show_chooser(ctx, session);
        self.advance_save(ctx, session);
        self.open_identified_file(session);
        self.show_questions(ctx, session);
        self.show_output(ctx, session);
        if let Some(message) = &mut self.message
            && message.show(ctx)
        {
            self.message = None;
        }
        self.poll_opening(ctx, session)
    }

    /// Autosaves unsaved work and checks the watched files.
    fn autosave_and_watch(&mut self, ctx: &egui::Context, session: &mut Session) {
        let now = Instant::now();
        let theme = ctx.options(|options| options.theme_preference);
        if theme != self.preferences.theme() {
            self.preferences.set_theme(theme);
        }
        #[cfg(development)]
        restart::lose_device_when_due(session.viewer.gpu(), ctx);
        if session.is_lost() && !self.handled_device_loss {
            self.handled_device_loss = true;
            return self.restart_program(ctx, session);
        }
        if let Some(folder) = self.recovery_folder.take() {
            let wake = ctx.clone();
            self.recovery_search = RecoverySearch::begin(folder, move || wake.request_repaint()).ok();
        }
        if let Some(recoverable) = self.recovery_search.as_mut().and_then(RecoverySearch::take) {
            (self.recoverable, self.recovery_search) = (recoverable, None);
        }
        let project = &session.project;
        let is_dragging = ctx.input(|i| i.pointer.any_down());
        let revision = project.history().revision();
        if !is_dragging {
            self.idle_state = IdleState { version: project.version(), revision };
        }
        // A slider drag changes the history. Any other drag does not, and an earlier edit is
        // written during it.
        let can_autosave = self.idle_state.revision == revision;
        if let Some(autosave) = self.autosave.as_mut().filter(|_| can_autosave) {
            if !is_dragging && ctx.input(|i| i.pointer.any_released()) {
                autosave.write_next_at_once();
            }
            // Saving changes the unsaved work but not the project's version.
            let version = (self.idle_state.version << 1) | u64::from(project.is_committed_saved());
            let status = autosave.update(version, now, || unsaved_work(session));
            if let Some(wait) = status.wait {
                ctx.request_repaint_after(wait);
            }
            if let Some(problem) = status.problem {
                session.show_message(problem);
            }
        }
        if let Some(watch) = &mut self.watch {
            ctx.request_repaint_after(watch.poll(now));
            let recording = &session.project.shot().recording.path;
            if watch.change(recording) == Some(Change::Gone) {
                session.show_error(format!(
                    "{} is gone: bring it back, and its frames are shown again",
                    recording.display()
                ));
            }
        }
        self.load_returned_files(session);
    }

    /// Reloads the scene when a missing file is back, unless an uncommitted change is in progress.
    fn load_returned_files(&mut self, session: &mut Session) {
        let Some(watch) = &mut self.watch else { return };
        let missing = |project: &Project| -> Vec<PathBuf> {
            project.shot().scene.missing.iter().map(|missing| missing.file.clone()).collect()
        };
        let before = missing(&session.project);
        watch.expect(&before);
        if session.project.history().has_uncommitted() || !watch.take_returned() {
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

    /// Restarts the program after the graphics device was lost; the new process recovers the work.
    fn restart_program(&mut self, ctx: &egui::Context, session: &mut Session) {
        let is_recoverable = match self.autosave.take() {
            Some(autosave) => {
                autosave.leave_for_restart(unsaved_work(session));
                true
            }
            None => session.project.is_saved(),
        };
        let again = self.restart_with.unwrap_or(restart::restart);
        let why = if is_recoverable { again() } else { "your work is not kept: save it first".to_owned() };
        let message = format!("The graphics device was lost: start it again ({why})");
        // The window may be unable to draw this message.
        eprintln!("locard: {message}");
        session.show_error(message);
        if is_recoverable {
            self.may_close = true;
            ctx.send_viewport_cmd(egui::ViewportCommand::Close);
        }
    }

    /// Shows the line that offers to analyse the footage, or the progress of the analysis.
    pub fn show_analysis_offer(&mut self, ui: &mut egui::Ui, session: &mut Session) {
        if !self.analysing.show(ui, session, self.jobs.as_mut()) {
            return;
        }
        if self.ensure_queue(ui.ctx()) {
            self.jobs.iter_mut().for_each(|jobs| self.analysing.begin(&session.project, jobs))
        } else {
            session.show_error("no thread can be started that analyses")
        }
    }

    /// Starts the job queue if there is none. Returns whether there is one.
    fn ensure_queue(&mut self, ctx: &egui::Context) -> bool {
        if self.jobs.is_none() {
            let wake = ctx.clone();
            self.jobs = Jobs::new(move || wake.request_repaint()).ok();
        }
        self.jobs.is_some()
    }

    /// Shows the export window, and reports finished jobs.
    fn show_output(&mut self, ctx: &egui::Context, session: &mut Session) {
        for index in self.jobs.iter_mut().flat_map(Jobs::take).collect::<Vec<_>>() {
            let Some(jobs) = &mut self.jobs else { continue };
            self.analysing.ended(index, jobs, session);
            let Some(entry) = jobs.entries.get(index) else { continue };
            match &entry.state {
                JobState::Done(summary) => session.show_message(format!("Written {}: {summary}", entry.name)),
                // The error already names the file, or one in the folder.
                JobState::Failed(why) if why.starts_with(&entry.name) => session.show_error(why.clone()),
                JobState::Failed(why) => session.show_error(format!("{}: {why}", entry.name)),
                _ => {}
            }
        }
        if !self.is_output_open {
            return;
        }
        if session.is_live() {
            self.is_output_open = false;
            return session.show_message(
                "Freeze the camera first (Space): its last seconds can be exported and photographed then",
            );
        }
        let player = &session.player;
        let looped = Some(player.range()).filter(|range| range.len() < player.count());
        let now = PlaybackState { frame: player.frame(), count: player.count(), looped };
        let mut ask = None;
        let mut is_open = true;
        let at = ctx.content_rect().right_top() + egui::vec2(-424.0, 44.0);
        egui::Window::new("Export and photograph")
            .default_pos(at)
            .open(&mut is_open)
            .default_size([400.0, 560.0])
            .vscroll(false)
            .show(ctx, |ui| ask = self.output.show(ui, &now, self.jobs.as_mut()));
        self.is_output_open = is_open;
        if let Some(ask) = ask {
            let (title, mode) = match &ask {
                OutputRequest::Folder(_) => ("Write pictures into a folder", ChooserMode::NewFolder),
                OutputRequest::Video { lossless: false, .. } => {
                    ("Write a video", ChooserMode::NewFile(&["mp4", "mkv"]))
                }
                OutputRequest::Video { .. } => ("Write a video", ChooserMode::NewFile(&["mkv", "mp4"])),
                OutputRequest::Photograph(wanted) if wanted.bracket.is_some() => {
                    ("Write a series of photographs", ChooserMode::NewSeries(&["jpg", "jpeg", "png"]))
                }
                OutputRequest::Photograph(_) => ("Write a photograph", ChooserMode::NewFile(&["jpg", "jpeg", "png"])),
                OutputRequest::Snapshot(_) => ("Write the frame", ChooserMode::NewFile(&["png"])),
            };
            let name = default_name(&ask, &session.project.shot().recording.path);
            self.choose(&session.project, ChooserPurpose::Output(ask), title, mode, Some(&name));
        }
    }

    /// Takes the dropped model, which the next click places.
    pub fn take_model(&mut self) -> Option<PathBuf> {
        self.dropped_model.take()
    }

    /// Called after the window has switched to another document.
    pub fn document_switched(&mut self, session: &Session) {
        self.document_opened(session);
    }

    /// True if rendering can wait. The first picture keeps the graphics device busy, which would
    /// delay the question about recoverable work; and recovery replaces the picture.
    pub fn defers_rendering(&self) -> bool {
        let recovers = self.opening.as_ref().is_some_and(Opening::recovers);
        let recovers = recovers
            || match &self.pending {
                Some(PendingAction::Open(_, recoverable)) => recoverable.is_some(),
                Some(PendingAction::Show(loaded)) => loaded.recoverable.is_some(),
                Some(PendingAction::Close) | None => false,
            };
        !self.recoverable.is_empty() || recovers
    }

    /// True while a dialog needs an answer.
    pub fn is_dialog_open(&self) -> bool {
        let is_open = self.chooser.is_some()
            || self.overwrite_question.is_some()
            || self.pending.is_some()
            || self.opening.is_some();
        let is_open = is_open
            || self.shared_profile_question.is_some()
            || self.asks_camera_values
            || self.camera_dialog.is_some();
        is_open || !self.recoverable.is_empty()
    }

    /// Closes the window and discards unsaved changes.
    pub fn close_without_asking(&mut self) {
        self.may_close = true;
    }

    pub fn jobs(&self) -> Option<&Jobs> {
        self.jobs.as_ref()
    }
}

/// Unsaved work that a crash would lose, without a drag in progress and without an uncommitted
/// change.
fn unsaved_work(session: &Session) -> Option<UnsavedWork> {
    let project = &session.project;
    if project.is_committed_saved() {
        return None;
    }
    let (recording, unit) = (&project.shot().recording.path, project.metres_per_unit);
    let (profile, scene) = (project.profile.as_deref(), project.scene.as_deref());
    let mut work = UnsavedWork::new(recording, unit, profile, scene, project.history().committed().clone())
        .with_history(project.history().record(HISTORY_STEPS));
    work.frame = session.player.frame();
    work.camera = project.camera.clone().filter(|_| session.is_live());
    Some(work)
}
