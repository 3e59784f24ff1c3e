//! The job queue with its window, and the analysis of the footage.

use std::path::PathBuf;

use eframe::egui;

use super::super::analysing::Analysing;
use super::super::jobs::{JobState, Jobs};
use super::super::output::{OutputPanel, OutputRequest, PlaybackState};
use super::super::session::Session;

/// Exports, photographs and analyses.
#[derive(Debug, Default)]
pub struct OutputJobs {
    jobs: Option<Jobs>,
    analysing: Analysing,
    panel: OutputPanel,
    /// The window is shown.
    pub is_open: bool,
}

impl OutputJobs {
    /// Shows the line that offers to analyse the footage, or the progress of the analysis.
    pub fn show_analysis_offer(&mut self, ui: &mut egui::Ui, session: &mut Session) {
        if !self.analysing.show(ui, session, self.jobs.as_mut()) {
            return;
        }
        self.ensure_queue(ui.ctx());
        match &mut self.jobs {
            Some(jobs) => self.analysing.begin(&session.project, jobs),
            None => session.show_error("the thread for analyses could not be started"),
        }
    }

    /// Starts the job queue if there is none.
    fn ensure_queue(&mut self, ctx: &egui::Context) {
        if self.jobs.is_none() {
            let wake = ctx.clone();
            self.jobs = Jobs::new(move || wake.request_repaint()).ok();
        }
    }

    /// Queues an output at a chosen path, and shows the queue. `force`: existing files are
    /// replaced.
    pub(super) fn add(
        &mut self,
        ctx: &egui::Context,
        session: &mut Session,
        request: OutputRequest,
        path: PathBuf,
        force: bool,
    ) {
        let name = request.name(&path);
        self.ensure_queue(ctx);
        match &mut self.jobs {
            Some(jobs) => _ = jobs.add(name, session.project.shot(), request.job(path, force)),
            None => session.show_error("the thread for exports could not be started"),
        }
        self.is_open = true;
    }

    pub(super) fn is_busy(&self) -> bool {
        self.jobs.as_ref().is_some_and(Jobs::is_busy)
    }

    pub(super) fn cancel_all(&mut self) {
        self.jobs.iter_mut().for_each(Jobs::cancel_all);
    }

    pub fn jobs(&self) -> Option<&Jobs> {
        self.jobs.as_ref()
    }

    /// Adopts a finished analysis, and reports all finished jobs.
    pub(super) fn report_ended(&mut self, session: &mut Session) {
        let Some(jobs) = &mut self.jobs else { return };
        for index in jobs.take() {
            if self.analysing.ended(index, jobs, session) {
                continue;
            }
            let Some(entry) = jobs.entries.get(index) else { continue };
            match &entry.state {
                JobState::Done(summary) => session.show_message(format!("Written {}: {summary}", entry.name)),
                // The error already names the file, or one in the folder.
                JobState::Failed(why) if why.starts_with(&entry.name) => session.show_error(why.clone()),
                JobState::Failed(why) => session.show_error(format!("{}: {why}", entry.name)),
                _ => {}
            }
        }
    }

    /// Shows the window, if it is open. Returns an output for which a path has to be chosen.
    pub(super) fn show(&mut self, ctx: &egui::Context, session: &mut Session) -> Option<OutputRequest> {
        if !self.is_open {
            return None;
        }
        if session.is_live() {
            self.is_open = false;
            session.show_message(
                "Freeze the camera first (Space): its last seconds can be exported and photographed then",
            );
            return None;
        }
        let player = &session.player;
        let looped = Some(player.range()).filter(|range| range.len() < player.count());
        let now = PlaybackState { frame: player.frame(), count: player.count(), looped };
        let at = ctx.content_rect().right_top() + egui::vec2(-424.0, 44.0);
        let window = egui::Window::new("Export and photograph")
            .default_pos(at)
            .open(&mut self.is_open)
            .default_size([400.0, 560.0])
            .vscroll(false)
            .show(ctx, |ui| self.panel.show(ui, &now, self.jobs.as_mut()));
        window?.inner?
    }
}
