//! The modal dialogs of the tuner. At most one is open.

use std::path::PathBuf;

use eframe::egui;

use super::super::camera_dialog::CameraDialog;
use super::super::camera_values;
use super::super::chooser::{Chooser, ChooserResult};
use super::super::dialogs;
use super::super::opening::DocumentOpening;
use super::super::question::Answer;
use super::super::recovery_search::RecoverableWork;
use super::super::saving;
use super::super::session::Session;
use super::super::titles;
use super::Documents;
use super::chooser_purpose::ChooserPurpose;
use super::pending_action::{LoadedDocument, PendingAction};

/// A modal dialog.
#[derive(Debug)]
pub(super) enum Dialog {
    Chooser(ChooserPurpose, Box<Chooser>),
    /// Opens a live camera.
    Camera(Box<CameraDialog>),
    /// A document is being opened.
    Opening(Box<DocumentOpening>),
    /// The action would lose work or end something.
    ConfirmDiscard(PendingAction),
    /// The file to save was changed by another program.
    ConfirmOverwrite(PathBuf),
    /// A shared profile is about to be written for the first time.
    ConfirmSharedProfile(PathBuf),
    /// The target for changed camera values. The answer applies to the current save.
    CameraValues,
    /// Unsaved work of another process.
    Recovery(RecoverableWork),
    /// An open file was changed by another program.
    Reload(PathBuf),
}

impl Dialog {
    /// True if recovered work may replace the picture.
    pub(super) fn recovers(&self) -> bool {
        match self {
            Self::Recovery(_) => true,
            Self::Opening(opening) => opening.recovers(),
            Self::ConfirmDiscard(action) => action.recovers(),
            _ => false,
        }
    }
}

impl Documents {
    /// Shows the file chooser and handles the chosen path.
    pub(super) fn show_chooser(&mut self, ctx: &egui::Context, session: &mut Session) {
        let Some((purpose, mut chooser)) = self.take_chooser() else { return };
        match chooser.show(ctx) {
            None => self.dialog = Some(Dialog::Chooser(purpose, chooser)),
            // Cancels the action that was to follow the save.
            Some(ChooserResult::Cancelled) => self.cancel_save(),
            Some(ChooserResult::Path { path, replaces }) => self.handle_choice(ctx, purpose, path, replaces, session),
        }
    }

    fn take_chooser(&mut self) -> Option<(ChooserPurpose, Box<Chooser>)> {
        match self.dialog.take_if(|dialog| matches!(dialog, Dialog::Chooser(..)))? {
            Dialog::Chooser(purpose, chooser) => Some((purpose, chooser)),
            _ => None,
        }
    }

    /// Shows the open dialog, except for the file chooser and for the progress of opening. Opens
    /// the next one that is due. Returns a document that replaces the open one.
    pub(super) fn show_dialog(&mut self, ctx: &egui::Context, session: &mut Session) -> Option<LoadedDocument> {
        self.open_due_dialog(ctx, session);
        match self.dialog.take() {
            None if self.save.is_active() => {}
            None => self.show_start(ctx, session),
            Some(Dialog::ConfirmDiscard(action)) => return self.confirm_discard(ctx, session, action),
            Some(Dialog::Camera(dialog)) => self.show_camera(ctx, dialog),
            Some(Dialog::ConfirmOverwrite(path)) => self.confirm_overwrite(ctx, session, path),
            Some(Dialog::ConfirmSharedProfile(path)) => self.confirm_shared_profile(ctx, session, path),
            Some(Dialog::CameraValues) => self.ask_camera_values(ctx, session),
            Some(Dialog::Recovery(recoverable)) => self.offer_recovery(ctx, recoverable),
            Some(Dialog::Reload(path)) => {
                self.offer_reload(ctx, session, path);
                self.show_start(ctx, session);
            }
            Some(dialog @ (Dialog::Chooser(..) | Dialog::Opening(_))) => self.dialog = Some(dialog),
        }
        None
    }

    /// Opens the dialog of the pending action, of recoverable work or of a changed file, once
    /// nothing else is open and nothing is being saved.
    fn open_due_dialog(&mut self, ctx: &egui::Context, session: &mut Session) {
        if self.dialog.is_some() || self.save.is_active() {
            return;
        }
        self.run_pending(ctx, session);
        if self.dialog.is_none() {
            self.dialog = self.recovery.works.pop().map(Dialog::Recovery);
        }
        if self.dialog.is_none() {
            let files = [&session.project.profile, &session.project.scene].into_iter().flatten();
            let changed = files.into_iter().find(|path| self.watch.is_new_change(path));
            self.dialog = changed.cloned().map(Dialog::Reload);
        }
    }

    /// Closes a question that gives way to a new action; it is repeated later.
    pub(super) fn set_question_aside(&mut self) {
        match self.dialog.take() {
            Some(Dialog::Recovery(recoverable)) => self.recovery.works.push(recoverable),
            Some(Dialog::ConfirmDiscard(_) | Dialog::Reload(_)) | None => {}
            dialog => self.dialog = dialog,
        }
    }

    fn show_camera(&mut self, ctx: &egui::Context, mut dialog: Box<CameraDialog>) {
        match dialog.show(ctx) {
            None => self.dialog = Some(Dialog::Camera(dialog)),
            Some(answer) => {
                self.last_camera_dialog = Some(*dialog);
                self.pending = answer.map(|document| PendingAction::Open(Box::new(document), None));
            }
        }
    }

    fn confirm_overwrite(&mut self, ctx: &egui::Context, session: &mut Session, path: PathBuf) {
        match dialogs::confirm_overwrite(ctx, &path) {
            Some(Answer::Yes) => self.save.approve(path),
            Some(Answer::No) => {
                self.cancel_save();
                self.reload_files(ctx, session);
            }
            Some(Answer::Cancel) => self.cancel_save(),
            None => self.dialog = Some(Dialog::ConfirmOverwrite(path)),
        }
    }

    fn confirm_shared_profile(&mut self, ctx: &egui::Context, session: &Session, path: PathBuf) {
        let owner = saving::profile_owner(&session.project, &path);
        match dialogs::confirm_shared_profile(ctx, &path, owner) {
            Some(Answer::Yes) => self.save.approved_profiles.push(path),
            Some(Answer::No) => self.name_profile(&session.project),
            Some(Answer::Cancel) => self.cancel_save(),
            None => self.dialog = Some(Dialog::ConfirmSharedProfile(path)),
        }
    }

    fn ask_camera_values(&mut self, ctx: &egui::Context, session: &Session) {
        match camera_values::ask(ctx, &session.project) {
            Some(Some(target)) => self.save.camera_values = Some(target),
            Some(None) => self.cancel_save(),
            None => self.dialog = Some(Dialog::CameraValues),
        }
    }

    fn offer_recovery(&mut self, ctx: &egui::Context, recoverable: RecoverableWork) {
        match dialogs::offer_recovery(ctx, &recoverable.work) {
            Some(Answer::Yes) => {
                self.pending = Some(PendingAction::Open(Box::new(recoverable.work.document()), Some(recoverable)));
            }
            Some(Answer::No) => recoverable.discard(),
            // Stays on disk, and is offered at the next start.
            Some(Answer::Cancel) => drop(recoverable),
            None => self.dialog = Some(Dialog::Recovery(recoverable)),
        }
    }

    /// Offers to reload a file unless its change was undone meanwhile.
    fn offer_reload(&mut self, ctx: &egui::Context, session: &mut Session, path: PathBuf) {
        if !self.watch.is_new_change(&path) {
            return;
        }
        match dialogs::offer_reload(ctx, &path, !session.project.is_saved()) {
            Some(Answer::Yes) => self.reload_files(ctx, session),
            Some(_) => self.watch.ignore(path),
            None => self.dialog = Some(Dialog::Reload(path)),
        }
    }

    /// Shows the welcome page, if it is open.
    fn show_start(&mut self, ctx: &egui::Context, session: &Session) {
        if !self.is_start_open {
            return;
        }
        let name = titles::of_recording(&session.project);
        let behind = if saving::is_demonstration(&session.project.shot().recording.path) {
            dialogs::StartBackground::Demonstration
        } else {
            dialogs::StartBackground::Recording(&name)
        };
        match dialogs::show_start(ctx, self.user_state.recent(ctx), behind) {
            Some(dialogs::StartChoice::Open) => self.open(&session.project),
            Some(dialogs::StartChoice::Camera) => self.show_camera_dialog(ctx, &session.project),
            Some(dialogs::StartChoice::Recent(document)) => self.pending = Some(PendingAction::Open(document, None)),
            Some(dialogs::StartChoice::Continue) => self.is_start_open = false,
            None => {}
        }
    }
}
