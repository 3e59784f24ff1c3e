//! Opening and saving, with the questions that prevent loss of work.

use std::path::PathBuf;

use eframe::egui;

use super::super::autosave::RecoverableWork;
use super::super::camera_values;
use super::super::dialogs::{self, Consequences};
use super::super::file_kind::FileKind;
use super::super::file_watch::Change;
use super::super::jobs::Jobs;
use super::super::opening::{OpenRefusal, Opening};
use super::super::project::{ProfileScope, SaveError};
use super::super::question::Answer;
use super::super::recent::DocumentRef;
use super::super::saving::{self, Approvals, SaveStep, SavedFile};
use super::super::session::Session;
use super::super::task::BackgroundTask;
use super::super::titles;
use super::{DocumentSwitch, Documents, LoadedDocument, PendingAction};
use locard_engine::live;

impl Documents {
    /// Determines the kind of a dropped or chosen file, which decides how it is opened.
    pub fn open_file(&mut self, ctx: &egui::Context, path: PathBuf, session: &mut Session) {
        let (wake, dropped) = (ctx.clone(), path.clone());
        match BackgroundTask::spawn("looking", move || wake.request_repaint(), move || FileKind::of(&dropped)) {
            Ok(kind_task) => self.dropped_files.push((path, kind_task)),
            Err(error) => session.show_error(format!("no thread can be started that opens it: {error}")),
        }
    }

    /// Opens a dropped file once its kind is known.
    pub(super) fn open_identified_file(&mut self, session: &mut Session) {
        if self.pending.is_some() || self.opening.is_some() {
            return;
        }
        let Some(kind) = self.dropped_files.first().and_then(|(_, kind_task)| kind_task.take()) else { return };
        let (path, _) = self.dropped_files.remove(0);
        match kind {
            Ok(FileKind::Profile) => self.open_profile(path, session),
            Ok(FileKind::Model) => self.dropped_model = Some(path),
            Ok(FileKind::Scene) => {
                self.pending = Some(PendingAction::Open(
                    Box::new(DocumentRef { scene: Some(path), ..DocumentRef::of(&session.project) }),
                    None,
                ))
            }
            Ok(FileKind::Recording) => {
                self.pending = Some(PendingAction::Open(Box::new(DocumentRef::recording(path)), None));
            }
            Ok(FileKind::Neither(why)) | Err(why) => session.show_error(why),
        }
    }

    /// Opens a profile for the open recording, or for one that could not be opened without a
    /// profile.
    pub(super) fn open_profile(&mut self, path: PathBuf, session: &Session) {
        let document = self.failed_document.clone().unwrap_or_else(|| DocumentRef::of(&session.project));
        self.pending = Some(PendingAction::Open(Box::new(DocumentRef { profile: Some(path), ..document }), None));
    }

    /// Starts writing the current state into a file. `chosen`: the user has just named it in a
    /// dialog and confirmed replacement.
    pub(super) fn write(&mut self, ctx: &egui::Context, session: &mut Session, step: &SaveStep, chosen: bool) {
        let project = &mut session.project;
        // Saving writes camera values into a profile; "Save the profile as" writes all values.
        let is_of_camera = self.approved_files.is_some() && project.can_place();
        let scope = if is_of_camera { ProfileScope::Camera } else { ProfileScope::All };
        let (path, draft) = match step {
            SaveStep::WriteScene(path) => (path, project.scene_draft(path)),
            SaveStep::WriteProfile(path) => (path, Ok(project.profile_draft(path, scope))),
            _ => return,
        };
        let is_approved = chosen || self.approved_files.as_ref().is_some_and(|approvals| approvals.contains(path));
        let (known, wake) = (project.stamp(path), ctx.clone());
        let spawned = draft.map_err(|error| error.to_string()).and_then(|draft| {
            let draft = if is_approved { draft } else { draft.unless_changed(known) };
            let spawned = BackgroundTask::spawn("saving", move || wake.request_repaint(), move || draft.write());
            spawned.map_err(|error| format!("no thread can be started that writes it: {error}"))
        });
        match spawned {
            Ok(writing) => self.writing = Some(writing),
            Err(why) => self.save_failed(session, &why),
        }
    }

    fn save_failed(&mut self, session: &mut Session, why: &str) {
        session.show_error(format!("Not saved: {why}"));
        (self.approved_files, self.pending) = (None, None);
    }

    /// Handles a finished write. Returns true while one is in progress.
    fn poll_write(&mut self, session: &mut Session) -> bool {
        let Some(done) = self.writing.as_ref().map(BackgroundTask::take) else { return false };
        let Some(done) = done else { return true };
        self.writing = None;
        match done {
            Ok(Ok(written)) => {
                let path = written.path.clone();
                let kind = written.kind();
                session.project.written(written);
                self.saved_files.retain(|saved| saved.kind != kind);
                self.saved_files.push(SavedFile { kind, path: path.clone() });
                session.show_message(saving::end_message(&self.saved_files, &session.project.unsavable_changes()));
                self.recent.add(DocumentRef::of(&session.project));
                self.ignored_changes.retain(|ignored| *ignored != path);
                if let Some(watch) = &mut self.watch {
                    watch.record(&path, session.project.stamp(&path));
                }
            }
            Ok(Err(SaveError::Changed(path))) => self.overwrite_question = Some(path),
            Ok(Err(error)) => self.save_failed(session, &error.to_string()),
            Err(why) => self.save_failed(session, &why),
        }
        false
    }

    /// Advances the save until it needs an answer or has to wait.
    pub(super) fn advance_save(&mut self, ctx: &egui::Context, session: &mut Session) {
        while !self.poll_write(session)
            && self.chooser.is_none()
            && self.overwrite_question.is_none()
            && self.shared_profile_question.is_none()
            && !self.asks_camera_values
        {
            let Some(replaced) = &self.approved_files else { return };
            let project = &session.project;
            let approvals = Approvals { replaced, shared: &self.approved_profiles, camera: self.camera_values };
            match saving::next_step(project, self.watch.as_ref(), approvals) {
                SaveStep::Done => {
                    self.approved_files = None;
                    session.show_message(saving::end_message(&self.saved_files, &session.project.unsavable_changes()));
                }
                SaveStep::NameScene => self.name_scene(project),
                SaveStep::NameProfile => self.name_profile(project),
                SaveStep::AskCameraValues => self.asks_camera_values = true,
                SaveStep::AskSharedProfile(path) => self.shared_profile_question = Some(path),
                SaveStep::AskOverwrite(path) => self.overwrite_question = Some(path),
                step => self.write(ctx, session, &step, false),
            }
        }
    }

    pub(super) fn show_questions(&mut self, ctx: &egui::Context, session: &mut Session) {
        if self.chooser.is_some() || self.opening.is_some() {
            return;
        }
        if let Some(camera_dialog) = &mut self.camera_dialog {
            if let Some(answer) = camera_dialog.show(ctx) {
                self.last_camera_dialog = self.camera_dialog.take();
                self.pending = answer.map(|document| PendingAction::Open(Box::new(document), None));
            }
            return;
        }
        if let Some(path) = self.overwrite_question.clone() {
            match dialogs::confirm_overwrite(ctx, &path) {
                Some(Answer::Yes) => {
                    self.approved_files.get_or_insert_default().push(path);
                    self.overwrite_question = None;
                }
                Some(Answer::No) => {
                    self.reload_files(ctx, session);
                    (self.overwrite_question, self.approved_files, self.pending) = (None, None, None);
                }
                Some(Answer::Cancel) => {
                    (self.overwrite_question, self.approved_files, self.pending) = (None, None, None)
                }
                None => {}
            }
            return;
        }
        if let Some(path) = self.shared_profile_question.clone() {
            let owner = saving::profile_owner(&session.project, &path);
            let answer = dialogs::confirm_shared_profile(ctx, &path, owner);
            match answer {
                Some(Answer::Yes) => self.approved_profiles.push(path),
                Some(Answer::No) => self.name_profile(&session.project),
                Some(Answer::Cancel) => (self.approved_files, self.pending) = (None, None),
                None => return,
            }
            self.shared_profile_question = None;
            return;
        }
        if self.asks_camera_values {
            let Some(answer) = camera_values::ask(ctx, &session.project) else { return };
            (self.asks_camera_values, self.camera_values) = (false, answer);
            if answer.is_none() {
                (self.approved_files, self.pending) = (None, None);
            }
            return;
        }
        if self.approved_files.is_some() || self.writing.is_some() {
            return;
        }
        self.run_pending(ctx, session);
        if self.pending.is_some() {
            return;
        }
        if let Some(recoverable) = self.recoverable.pop() {
            match dialogs::offer_recovery(ctx, &recoverable.work) {
                Some(Answer::Yes) => {
                    self.pending = Some(PendingAction::Open(Box::new(recoverable.document()), Some(recoverable)))
                }
                Some(Answer::No) => recoverable.discard(),
                // Stays on disk, and is offered at the next start.
                Some(Answer::Cancel) => drop(recoverable),
                None => self.recoverable.push(recoverable),
            }
            return;
        }
        self.offer_reload(ctx, session);
        if self.is_start_open {
            let name = titles::of_recording(&session.project);
            let behind = if saving::is_demonstration(&session.project.shot().recording.path) {
                dialogs::StartBackground::Demonstration
            } else {
                dialogs::StartBackground::Recording(&name)
            };
            match dialogs::show_start(ctx, self.recent.entries(ctx), behind) {
                Some(dialogs::StartChoice::Open) => self.open(&session.project),
                Some(dialogs::StartChoice::Camera) => self.show_camera_dialog(ctx, &session.project),
                Some(dialogs::StartChoice::Recent(document)) => {
                    self.pending = Some(PendingAction::Open(document, None))
                }
                Some(dialogs::StartChoice::Continue) => self.is_start_open = false,
                None => {}
            }
        }
    }

    /// Runs the pending action once nothing is lost by it.
    fn run_pending(&mut self, ctx: &egui::Context, session: &mut Session) {
        let Some(action) = self.pending.take() else {
            self.confirmed_recording_end = false;
            return;
        };
        // Files are opened before the question, so that unreadable ones are refused first. A camera
        // can only be opened after the current one has been closed.
        let action = match action {
            PendingAction::Open(document, recoverable) if document.camera.is_none() => {
                return self.start_opening(ctx, session, *document, recoverable);
            }
            action => action,
        };
        let consequences = self.consequences(session, matches!(action, PendingAction::Close));
        let answer =
            if consequences.is_harmless() { Some(Answer::No) } else { dialogs::confirm_discard(ctx, consequences) };
        match (answer, action) {
            (None, action) => self.pending = Some(action),
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
                if let Some(jobs) = &mut self.jobs {
                    jobs.cancel_all();
                }
                ctx.send_viewport_cmd(egui::ViewportCommand::Close);
            }
            (Some(Answer::No), PendingAction::Open(document, recoverable)) => {
                self.start_opening(ctx, session, *document, recoverable)
            }
            (Some(Answer::No), PendingAction::Show(loaded)) => self.confirmed_document = Some(loaded),
        }
    }

    /// Consequences of closing the window or opening another document.
    pub(super) fn consequences(&self, session: &Session, closes: bool) -> Consequences {
        Consequences {
            closes,
            is_changed: !session.project.is_saved(),
            is_busy: self.jobs.as_ref().is_some_and(Jobs::is_busy),
            is_recording: session.is_recording() && !self.confirmed_recording_end,
        }
    }

    /// Offers to reload files that another program has changed.
    fn offer_reload(&mut self, ctx: &egui::Context, session: &mut Session) {
        let project = &session.project;
        let files = [project.profile.clone(), project.scene.clone()].into_iter().flatten();
        let is_new = |path: &PathBuf| {
            let change = self.watch.as_ref().and_then(|watch| watch.change(path));
            change == Some(Change::Changed) && !self.ignored_changes.contains(path)
        };
        let Some(path) = files.into_iter().find(is_new) else { return };
        match dialogs::offer_reload(ctx, &path, !project.is_saved()) {
            Some(Answer::Yes) => self.reload_files(ctx, session),
            Some(_) => self.ignored_changes.push(path),
            None => {}
        }
    }

    fn reload_files(&mut self, ctx: &egui::Context, session: &mut Session) {
        let wake = ctx.clone();
        self.set_opening(session, Opening::reload(&session.project, move || wake.request_repaint()));
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
        self.set_opening(session, Opening::begin(document, recoverable, has_camera, move || wake.request_repaint()));
    }

    fn set_opening(&mut self, session: &mut Session, opening: std::io::Result<Opening>) {
        match opening {
            Ok(opening) => self.opening = Some(opening),
            Err(error) => session.show_error(format!("no thread can be started that opens it: {error}")),
        }
    }

    /// Handles a finished opening task.
    pub(super) fn poll_opening(&mut self, ctx: &egui::Context, session: &mut Session) -> Option<DocumentSwitch> {
        if let Some(loaded) = self.confirmed_document.take() {
            return Some(self.switch_to(*loaded, None));
        }
        let done = match self.opening.take()?.take() {
            Ok(done) => done,
            Err(opening) => {
                dialogs::show_opening(ctx, opening.what());
                self.opening = Some(*opening);
                return None;
            }
        };
        match done.project {
            Ok((fresh, _)) if done.is_reload => {
                session.project.adopt_files(*fresh);
                session.show_message("Read again from the files; undo brings back what you had");
                self.ignored_changes.clear();
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
            // Shows the dialog again with its entries.
            Err(OpenRefusal { why, .. }) if done.document.camera.is_some() && self.last_camera_dialog.is_some() => {
                self.camera_dialog = self.last_camera_dialog.take().map(|camera_dialog| camera_dialog.with_error(why));
                self.recoverable.extend(done.recoverable);
                None
            }
            Err(OpenRefusal { why, is_unfit_profile: true, .. }) => {
                session.show_error(why.clone());
                self.refused_profile = Some(why);
                // The next profile is for the refused recording, which may differ from the open
                // one.
                let is_open = done.document.recording == DocumentRef::of(&session.project).recording;
                self.failed_document = Some(DocumentRef { profile: None, ..done.document }).filter(|_| !is_open);
                self.recoverable.extend(done.recoverable);
                None
            }
            Err(OpenRefusal { why, lacks_camera, .. }) => {
                let lacks_profile = lacks_camera && done.document.profile.is_none();
                let advice =
                    if lacks_profile { ". Choose a camera profile for it: File, Open a profile…" } else { "" };
                session.show_error(format!("{why}{advice}"));
                self.failed_document = if lacks_profile {
                    Some(done.document)
                } else {
                    self.failed_document.take().filter(|waiting| waiting.recording == done.document.recording)
                };
                self.recoverable.extend(done.recoverable);
                None
            }
        }
    }

    /// Replaces the open document.
    fn switch_to(&mut self, loaded: LoadedDocument, camera: Option<live::LiveInput>) -> DocumentSwitch {
        let LoadedDocument { document, project, recoverable } = loaded;
        if let Some(recoverable) = recoverable {
            self.adopt_recovery(recoverable);
        }
        (self.is_start_open, self.failed_document, self.refused_profile) = (false, None, None);
        DocumentSwitch { project: *project, camera, at: document.at }
    }
}
