//! Opening documents, with the question that prevents the loss of work.

use std::path::PathBuf;

use eframe::egui;

use super::super::dialogs::{self, Consequences};
use super::super::file_kind::FileKind;
use super::super::opening::{DocumentOpening, OpenRefusal};
use super::super::question::Answer;
use super::super::recent::DocumentRef;
use super::super::recovery_search::RecoverableWork;
use super::super::session::Session;
use super::super::task::BackgroundTask;
use super::dialog::Dialog;
use super::pending_action::{LoadedDocument, PendingAction};
use super::{DocumentSwitch, Documents, RefusedOpening};
use locard_engine::live;

impl Documents {
    /// Determines the kind of a dropped or chosen file, which decides how it is opened.
    pub fn open_file(&mut self, ctx: &egui::Context, path: PathBuf, session: &mut Session) {
        let (wake, dropped) = (ctx.clone(), path.clone());
        match BackgroundTask::spawn("file kind", move || wake.request_repaint(), move || FileKind::of(&dropped)) {
            Ok(kind_task) => self.dropped_files.push((path, kind_task)),
            Err(error) => session.show_error(format!("the thread that opens it could not be started: {error}")),
        }
    }

    /// Opens a dropped file once its kind is known.
    pub(super) fn open_identified_file(&mut self, session: &mut Session) {
        let is_opening = matches!(self.dialog, Some(Dialog::Opening(_) | Dialog::ConfirmDiscard(_)));
        if self.pending.is_some() || is_opening {
            return;
        }
        let Some(kind) = self.dropped_files.first().and_then(|(_, kind_task)| kind_task.take()) else { return };
        let (path, _) = self.dropped_files.remove(0);
        match kind {
            Ok(FileKind::Profile) => self.open_profile(path, session),
            Ok(FileKind::Model) => self.dropped_model = Some(path),
            Ok(FileKind::Scene) => self.open_scene(path, session),
            Ok(FileKind::Recording) => self.request(PendingAction::open(DocumentRef::recording(path))),
            Ok(FileKind::Neither(why)) | Err(why) => session.show_error(why),
        }
    }

    /// Opens a scene for the open recording.
    pub(super) fn open_scene(&mut self, path: PathBuf, session: &Session) {
        self.request(PendingAction::open(DocumentRef { scene: Some(path), ..DocumentRef::of(&session.project) }));
    }

    /// Opens a profile for the open recording, or for one that could not be opened without a
    /// profile.
    pub(super) fn open_profile(&mut self, path: PathBuf, session: &Session) {
        let document = self.refused.document.clone().unwrap_or_else(|| DocumentRef::of(&session.project));
        self.request(PendingAction::open(DocumentRef { profile: Some(path), ..document }));
    }

    /// Replaces the pending action.
    pub(super) fn request(&mut self, action: PendingAction) {
        self.set_question_aside();
        self.pending = Some(action);
    }

    /// Cancels a request to close the window if a question must be answered first.
    pub(super) fn intercept_close(&mut self, ctx: &egui::Context, session: &Session) {
        let closes = ctx.input(|i| i.viewport().close_requested());
        if closes && !self.may_close && !self.consequences(session, true).is_harmless() {
            ctx.send_viewport_cmd(egui::ViewportCommand::CancelClose);
            self.request(PendingAction::Close);
        }
    }

    /// Begins the pending action. Files are opened before the question, so that unreadable ones are
    /// refused first. A camera can only be opened after the current one has been closed.
    pub(super) fn run_pending(&mut self, ctx: &egui::Context, session: &mut Session) {
        match self.pending.take() {
            None => self.confirmed_recording_end = false,
            Some(PendingAction::Open(document, recoverable)) if document.camera.is_none() => {
                self.start_opening(ctx, session, *document, recoverable);
            }
            Some(action) => self.dialog = Some(Dialog::ConfirmDiscard(action)),
        }
    }

    /// Runs an action once nothing is lost by it. Returns a document that replaces the open one.
    pub(super) fn confirm_discard(
        &mut self,
        ctx: &egui::Context,
        session: &mut Session,
        action: PendingAction,
    ) -> Option<LoadedDocument> {
        let consequences = self.consequences(session, matches!(action, PendingAction::Close));
        let answer =
            if consequences.is_harmless() { Some(Answer::No) } else { dialogs::confirm_discard(ctx, consequences) };
        match (answer, action) {
            (None, action) => self.dialog = Some(Dialog::ConfirmDiscard(action)),
            (Some(Answer::Cancel), _) => {}
            (Some(Answer::Yes), action) => {
                self.save();
                // It may share files with the save, and is opened again.
                let action = match action {
                    PendingAction::Show(loaded) => PendingAction::Open(Box::new(loaded.document), loaded.recoverable),
                    action => action,
                };
                (self.pending, self.confirmed_recording_end) = (Some(action), true);
            }
            (Some(Answer::No), PendingAction::Close) => {
                self.may_close = true;
                self.output_jobs.cancel_all();
                ctx.send_viewport_cmd(egui::ViewportCommand::Close);
            }
            (Some(Answer::No), PendingAction::Open(document, recoverable)) => {
                self.start_opening(ctx, session, *document, recoverable);
            }
            (Some(Answer::No), PendingAction::Show(loaded)) => return Some(*loaded),
        }
        None
    }

    /// Consequences of closing the window or opening another document.
    fn consequences(&self, session: &Session, closes: bool) -> Consequences {
        Consequences {
            closes,
            is_changed: !session.project.is_saved(),
            is_busy: self.output_jobs.is_busy(),
            is_recording: session.is_recording() && !self.confirmed_recording_end,
        }
    }

    pub(super) fn reload_files(&mut self, ctx: &egui::Context, session: &mut Session) {
        let wake = ctx.clone();
        self.set_opening(session, DocumentOpening::reload(&session.project, move || wake.request_repaint()));
    }

    fn start_opening(
        &mut self,
        ctx: &egui::Context,
        session: &mut Session,
        document: DocumentRef,
        recoverable: Option<RecoverableWork>,
    ) {
        // A camera can only be open in one program and one window.
        if document.camera.is_some() {
            session.close_camera();
        }
        let is_open = document.recording == DocumentRef::of(&session.project).recording;
        let has_camera = is_open && !session.lacks_camera();
        let wake = ctx.clone();
        self.set_opening(
            session,
            DocumentOpening::begin(document, recoverable, has_camera, move || wake.request_repaint()),
        );
    }

    fn set_opening(&mut self, session: &mut Session, opening: std::io::Result<DocumentOpening>) {
        match opening {
            Ok(opening) => self.dialog = Some(Dialog::Opening(Box::new(opening))),
            Err(error) => session.show_error(format!("the thread that opens it could not be started: {error}")),
        }
    }

    /// Shows that a document is being opened, and handles the result. Returns a document to switch
    /// to.
    pub(super) fn poll_opening(&mut self, ctx: &egui::Context, session: &mut Session) -> Option<DocumentSwitch> {
        let opening = match self.dialog.take() {
            Some(Dialog::Opening(opening)) => opening,
            dialog => {
                self.dialog = dialog;
                return None;
            }
        };
        let done = match opening.take() {
            Ok(done) => done,
            Err(opening) => {
                dialogs::show_opening(ctx, opening.recording_path());
                self.dialog = Some(Dialog::Opening(opening));
                return None;
            }
        };
        match done.project {
            Ok((fresh, _)) if done.is_reload => {
                session.project.adopt_files(*fresh);
                session.show_message("Read again from the files; undo restores your version");
                self.watch_files(&session.project);
                None
            }
            Ok((project, camera)) => {
                let loaded = LoadedDocument { document: done.document, project, recoverable: done.recoverable };
                if camera.is_none() && !self.consequences(session, false).is_harmless() {
                    self.pending = Some(PendingAction::Show(Box::new(loaded)));
                    ctx.request_repaint();
                    return None;
                }
                Some(self.switch_to(loaded, camera))
            }
            Err(refusal) => {
                self.recovery.works.extend(done.recoverable);
                self.opening_refused(session, done.document, refusal);
                None
            }
        }
    }

    /// Shows why a document was not opened, and prepares another attempt.
    fn opening_refused(&mut self, session: &mut Session, document: DocumentRef, refusal: OpenRefusal) {
        let OpenRefusal { why, lacks_camera, is_unfit_profile } = refusal;
        if document.camera.is_some()
            && let Some(dialog) = self.last_camera_dialog.take()
        {
            // Shows the dialog again with its entries.
            self.dialog = Some(Dialog::Camera(Box::new(dialog.with_error(why))));
            return;
        }
        if is_unfit_profile {
            session.show_error(why.clone());
            self.refused.profile_error = Some(why);
            // The next profile is for the refused recording, which may differ from the open one.
            let is_open = document.recording == DocumentRef::of(&session.project).recording;
            self.refused.document = Some(DocumentRef { profile: None, ..document }).filter(|_| !is_open);
            return;
        }
        let lacks_profile = lacks_camera && document.profile.is_none();
        let advice = if lacks_profile { ". Choose a camera profile for it: File, Open a profile…" } else { "" };
        session.show_error(format!("{why}{advice}"));
        self.refused.document = if lacks_profile {
            Some(document)
        } else {
            self.refused.document.take().filter(|waiting| waiting.recording == document.recording)
        };
    }

    /// Replaces the open document.
    pub(super) fn switch_to(&mut self, loaded: LoadedDocument, camera: Option<live::LiveInput>) -> DocumentSwitch {
        let LoadedDocument { document, project, recoverable } = loaded;
        recoverable.into_iter().for_each(|recoverable| self.recovery.adopt(recoverable));
        self.is_start_open = false;
        self.refused = RefusedOpening::default();
        DocumentSwitch { project: *project, camera, at: document.at }
    }
}
