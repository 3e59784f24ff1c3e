//! Recovery: autosave of the open document, search for work of other processes, and the restart
//! after the graphics device was lost.

use std::fmt::Display;
use std::io;
use std::path::{Path, PathBuf};
use std::time::Instant;

use eframe::egui;

use super::super::autosave::Autosave;
use super::super::recovery_search::{RecoverableWork, RecoverySearch};
use super::super::restart;
use super::super::session::Session;
use super::super::unsaved_work::{HISTORY_STEPS, UnsavedWork};

/// Project version and history revision while no mouse button was down.
#[derive(Clone, Copy, Debug, Default)]
struct SettledRevision {
    version: u64,
    revision: u64,
}

/// Autosave, and recoverable work.
#[derive(Debug, Default)]
pub(super) struct Recovery {
    autosave: Option<Autosave>,
    settled: SettledRevision,
    /// Folder to search, before the first frame of the window.
    folder: Option<PathBuf>,
    search: Option<RecoverySearch>,
    /// Work that was not offered yet.
    pub(super) works: Vec<RecoverableWork>,
    has_handled_device_loss: bool,
    /// Restarts the program, or returns an error message. [`restart::restart`] if `None`.
    pub(super) restart_with: Option<fn() -> String>,
}

impl Recovery {
    /// Autosaves into a folder, which is also searched.
    pub(super) fn begin(&mut self, folder: &Path) -> io::Result<()> {
        self.folder = Some(folder.to_owned());
        self.autosave = Some(Autosave::begin(folder)?);
        Ok(())
    }

    /// Continues autosaving in the files of the recovered work.
    pub(super) fn adopt(&mut self, recoverable: RecoverableWork) {
        match &mut self.autosave {
            Some(autosave) => autosave.adopt(recoverable),
            None => drop(recoverable),
        }
    }

    pub(super) fn has_handled_device_loss(&self) -> bool {
        self.has_handled_device_loss
    }

    /// Restarts the program after the graphics device was lost; the new process recovers the work.
    /// Returns false if the work would be lost: the window stays open.
    pub(super) fn restart(&mut self, session: &mut Session) -> bool {
        self.has_handled_device_loss = true;
        let is_recoverable = match self.autosave.take() {
            Some(autosave) => {
                autosave.leave_for_restart(unsaved_work(session));
                true
            }
            None => session.project.is_saved(),
        };
        let again = self.restart_with.unwrap_or(restart::restart);
        let why = if is_recoverable { again() } else { "your work cannot be recovered: save it first".to_owned() };
        let message = format!("The graphics device was lost: start Locard again ({why})");
        // The window may be unable to draw this message.
        eprintln!("locard: {message}");
        session.show_error(message);
        is_recoverable
    }

    /// Searches for work of other processes, once.
    pub(super) fn search(&mut self, ctx: &egui::Context, session: &mut Session) {
        if let Some(folder) = self.folder.take() {
            let wake = ctx.clone();
            match RecoverySearch::begin(folder, move || wake.request_repaint()) {
                Ok(search) => self.search = Some(search),
                Err(error) => show_failed_search(session, &error),
            }
        }
        match self.search.as_mut().and_then(RecoverySearch::take) {
            Some(Ok(found)) => (self.works, self.search) = (found, None),
            Some(Err(why)) => show_failed_search(session, &why),
            None => {}
        }
    }

    /// Autosaves unsaved work.
    pub(super) fn autosave(&mut self, ctx: &egui::Context, session: &mut Session, now: Instant) {
        let project = &session.project;
        let is_dragging = ctx.input(|i| i.pointer.any_down());
        let revision = project.history().revision();
        if !is_dragging {
            self.settled = SettledRevision { version: project.version(), revision };
        }
        // A slider drag changes the history. Any other drag does not, and an earlier edit is
        // written during it.
        let can_autosave = self.settled.revision == revision;
        let Some(autosave) = self.autosave.as_mut().filter(|_| can_autosave) else { return };
        if !is_dragging && ctx.input(|i| i.pointer.any_released()) {
            autosave.write_next_at_once();
        }
        // Saving changes the unsaved work but not the project's version.
        let version = (self.settled.version << 1) | u64::from(project.is_committed_saved());
        let status = autosave.update(version, now, || unsaved_work(session));
        if let Some(wait) = status.wait {
            ctx.request_repaint_after(wait);
        }
        if let Some(problem) = status.problem {
            session.show_message(problem);
        }
    }
}

fn show_failed_search(session: &mut Session, why: &dyn Display) {
    session.show_error(format!("Unsaved work could not be searched for: {why}"));
}

/// Unsaved work that a crash would lose, without a drag in progress and without an uncommitted
/// change.
fn unsaved_work(session: &Session) -> Option<UnsavedWork> {
    let project = &session.project;
    if project.is_committed_saved() {
        return None;
    }
    let (recording, unit) = (&project.shot().recording.path, project.shot().opened_unit_m());
    let (profile, scene) = (project.profile.as_deref(), project.scene.as_deref());
    let mut work = UnsavedWork::new(recording, unit, profile, scene, project.history().committed().clone())
        .with_history(project.history().record(HISTORY_STEPS));
    work.frame = session.player.frame();
    work.camera = project.camera.clone().filter(|_| session.is_live());
    Some(work)
}
