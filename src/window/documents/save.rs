//! Saving, with the questions that prevent the loss of files.

use std::path::PathBuf;

use eframe::egui;

use super::super::camera_values::CameraValueTarget;
use super::super::project::{ProfileScope, SaveError, WrittenFile};
use super::super::recent::DocumentRef;
use super::super::saving::{self, Approvals, SaveStep, SavedFile};
use super::super::session::Session;
use super::super::task::BackgroundTask;
use super::Documents;
use super::dialog::Dialog;

/// State of a save.
#[derive(Debug, Default)]
pub(super) struct SaveProgress {
    writing: Option<BackgroundTask<Result<WrittenFile, SaveError>>>,
    /// Files that the user allowed to overwrite; `None` while nothing is being saved.
    approved_files: Option<Vec<PathBuf>>,
    /// Files written since saving started.
    written: Vec<SavedFile>,
    /// Shared profiles that the user allowed to overwrite.
    pub(super) approved_profiles: Vec<PathBuf>,
    /// The target for changed camera values.
    pub(super) camera_values: Option<CameraValueTarget>,
}

impl SaveProgress {
    /// Starts saving unless it is in progress.
    pub(super) fn begin(&mut self) {
        if self.approved_files.is_none() {
            (self.approved_files, self.written, self.camera_values) = (Some(Vec::new()), Vec::new(), None);
        }
    }

    /// True while files are to be written.
    pub(super) fn is_active(&self) -> bool {
        self.approved_files.is_some() || self.writing.is_some()
    }

    /// Allows to overwrite a file.
    pub(super) fn approve(&mut self, path: PathBuf) {
        self.approved_files.get_or_insert_default().push(path);
    }
}

impl Documents {
    /// Starts saving changed files.
    pub fn save(&mut self) {
        self.save.begin();
    }

    /// Ends the save, and drops the action that was to follow it.
    pub(super) fn cancel_save(&mut self) {
        (self.save.approved_files, self.pending) = (None, None);
    }

    /// Starts writing the current state into a file. `chosen`: the user has just named it in a
    /// dialog and confirmed replacement.
    pub(super) fn write(&mut self, ctx: &egui::Context, session: &mut Session, step: &SaveStep, chosen: bool) {
        let project = &mut session.project;
        // Saving writes camera values into a profile; "Save the profile as" writes all values.
        let is_of_camera = self.save.approved_files.is_some() && project.can_place();
        let scope = if is_of_camera { ProfileScope::Camera } else { ProfileScope::All };
        let (path, draft) = match step {
            SaveStep::WriteScene(path) => (path, project.scene_draft(path)),
            SaveStep::WriteProfile(path) => (path, Ok(project.profile_draft(path, scope))),
            _ => return,
        };
        let is_approved = chosen || self.save.approved_files.as_ref().is_some_and(|approved| approved.contains(path));
        let (known, wake) = (project.stamp(path), ctx.clone());
        let spawned = draft.map_err(|error| error.to_string()).and_then(|draft| {
            let draft = if is_approved { draft } else { draft.unless_changed(known) };
            let spawned = BackgroundTask::spawn("saving", move || wake.request_repaint(), move || draft.write());
            spawned.map_err(|error| format!("the thread that writes it could not be started: {error}"))
        });
        match spawned {
            Ok(writing) => self.save.writing = Some(writing),
            Err(why) => self.save_failed(session, &why),
        }
    }

    fn save_failed(&mut self, session: &mut Session, why: &str) {
        session.show_error(format!("Not saved: {why}"));
        self.cancel_save();
    }

    /// Handles a finished write. Returns true while one is in progress.
    fn poll_write(&mut self, session: &mut Session) -> bool {
        let Some(done) = self.save.writing.as_ref().map(BackgroundTask::take) else { return false };
        let Some(done) = done else { return true };
        self.save.writing = None;
        match done {
            Ok(Ok(written)) => self.file_written(session, written),
            // Behind another dialog the file is tried again once that is closed.
            Ok(Err(SaveError::Changed(path))) => _ = self.dialog.get_or_insert(Dialog::ConfirmOverwrite(path)),
            Ok(Err(error)) => self.save_failed(session, &error.to_string()),
            Err(why) => self.save_failed(session, &why),
        }
        false
    }

    fn file_written(&mut self, session: &mut Session, written: WrittenFile) {
        let (path, kind) = (written.path.clone(), written.kind());
        session.project.written(written);
        self.save.written.retain(|saved| saved.kind != kind);
        self.save.written.push(SavedFile { kind, path: path.clone() });
        session.show_message(saving::end_message(&self.save.written, &session.project.unsavable_changes()));
        self.user_state.add_recent(DocumentRef::of(&session.project));
        self.watch.record(&path, session.project.stamp(&path));
    }

    /// Advances the save until it needs an answer or has to wait.
    pub(super) fn advance_save(&mut self, ctx: &egui::Context, session: &mut Session) {
        while !self.poll_write(session) && self.dialog.is_none() {
            let Some(replaced) = &self.save.approved_files else { return };
            let project = &session.project;
            let approvals =
                Approvals { replaced, shared: &self.save.approved_profiles, camera: self.save.camera_values };
            match saving::next_step(project, &self.watch, approvals) {
                SaveStep::Done => {
                    self.save.approved_files = None;
                    session.show_message(saving::end_message(&self.save.written, &project.unsavable_changes()));
                }
                SaveStep::NameScene => self.name_scene(project),
                SaveStep::NameProfile => self.name_profile(project),
                SaveStep::AskCameraValues => self.dialog = Some(Dialog::CameraValues),
                SaveStep::AskSharedProfile(path) => self.dialog = Some(Dialog::ConfirmSharedProfile(path)),
                SaveStep::AskOverwrite(path) => self.dialog = Some(Dialog::ConfirmOverwrite(path)),
                step => self.write(ctx, session, &step, false),
            }
        }
    }
}
