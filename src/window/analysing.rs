//! Analysis of the footage from the window: the offer, progress, and adoption of the result.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use eframe::egui::{self, Label, RichText, Ui, WidgetInfo};

use super::jobs::{JobEntry, JobKind, JobState, Jobs};
use super::output::percent;
use super::progress;
use super::project::Project;
use super::session::Session;
use locard_engine::analyse::{Findings, default_folder};
use locard_engine::recording::Recording;
use locard_engine::shot::AnalysisState;

/// A started analysis.
#[derive(Debug)]
struct StartedAnalysis {
    /// Index in the queue.
    entry: usize,
    recording: Arc<Recording>,
    folder: PathBuf,
}

/// The current analysis, if any.
#[derive(Debug, Default)]
pub struct Analysing(Option<StartedAnalysis>);

impl Analysing {
    /// Shows the offer or the progress. Returns true if the user starts the analysis.
    pub fn show(&self, ui: &mut Ui, session: &Session, jobs: Option<&mut Jobs>) -> bool {
        let project = &session.project;
        if let Some(entry) = self.of(project).and_then(|begun| jobs?.entries.get_mut(begun.entry))
            && !entry.state.is_over()
        {
            show_progress(ui, entry);
            ui.separator();
            return false;
        }
        let Some(finds) = project.shot().missing_analysis().filter(|_| !session.is_frozen() && !session.lacks_camera())
        else {
            return false;
        };
        let (text, why) = match &project.shot().analysis {
            AnalysisState::Unfit(_, why) => ("The analysis of this footage is not used", format!("{why}. ")),
            _ => ("This footage is not analysed", String::new()),
        };
        let hint = format!("{why}Its pictures show {finds}. Your edits are kept.");
        let mut begins = false;
        ui.horizontal(|ui| {
            begins = ui.button("Analyse").on_hover_text(&hint).clicked();
            ui.add(Label::new(RichText::new(text).weak()).truncate()).on_hover_text(hint);
        });
        ui.separator();
        begins
    }

    /// Adds the analysis to the queue.
    pub fn begin(&mut self, project: &Project, jobs: &mut Jobs) {
        let shot = project.shot();
        let folder = default_folder(&shot.recording.path);
        let entry = jobs.add(folder.display().to_string(), &shot.as_recorded(), JobKind::Analyse(folder.clone()));
        self.0 = Some(StartedAnalysis { entry, recording: Arc::clone(&shot.recording), folder });
    }

    /// Adopts and reports the result when an entry of the queue that is the analysis has ended.
    /// Returns true if there is one.
    pub fn ended(&mut self, entry: usize, jobs: &mut Jobs, session: &mut Session) -> bool {
        let Some(begun) = self.0.take_if(|begun| begun.entry == entry) else { return false };
        let Some(analysis) = jobs.entries.get_mut(entry).and_then(|entry| entry.analysis.take()) else { return false };
        let message = format!("Analysis finished: {}.", analysis.findings.summary());
        let details = details(&analysis.findings, &begun.folder);
        // Another recording may be open by now.
        let adopted = if begun.is_of(&session.project) {
            session.project.adopt_analysis(begun.folder, *analysis)
        } else {
            Ok(())
        };
        match adopted {
            Ok(()) => session.show_message_with_details(&message, &details),
            Err(error) => session.show_error(error.to_string()),
        }
        true
    }

    fn of(&self, project: &Project) -> Option<&StartedAnalysis> {
        self.0.as_ref().filter(|begun| begun.is_of(project))
    }
}

impl StartedAnalysis {
    /// True for the same footage, even if a scene has changed its unit or its world frame since.
    fn is_of(&self, project: &Project) -> bool {
        let now = &project.shot().recording;
        now.path == self.recording.path && Arc::ptr_eq(&now.timestamps_s, &self.recording.timestamps_s)
    }
}

/// Everything that the analysis found, one estimate in a line, and its folder.
fn details(findings: &Findings, folder: &Path) -> String {
    let lines = findings.lines().into_iter().map(|(name, text)| format!("{name}: {text}"));
    lines.chain([format!("written to {}", folder.display())]).collect::<Vec<_>>().join("\n")
}

fn show_progress(ui: &mut Ui, entry: &mut JobEntry) {
    ui.horizontal(|ui| {
        let cancel = ui.button("Cancel");
        cancel.widget_info(|| WidgetInfo::labeled(egui::Role::Button, true, "Cancel the analysis"));
        if cancel.clicked() {
            entry.cancel();
        }
        match &entry.state {
            JobState::Running { progress, begun, stage } => {
                let text = format!("Analysing: {}", percent(*progress, *begun, *stage));
                progress::bar(ui, "Analysing the footage", *progress as f32, Some(text));
            }
            _ => _ = ui.weak("The analysis starts when the exports are done"),
        }
    });
}
