//! The footage analysed from the window: a line that offers it, how far it is, and what was found taken over where one is.

use std::path::PathBuf;
use std::sync::Arc;

use eframe::egui::{self, Label, RichText, Ui, WidgetInfo};

use super::jobs::{JobEntry, JobKind, JobState, Jobs};
use super::output::percent;
use super::progress;
use super::project::Project;
use super::session::Session;
use locard_engine::analyse::beside;
use locard_engine::recording::Recording;
use locard_engine::shot::AnalysisState;

/// An analysis that was begun.
#[derive(Debug)]
struct Begun {
    /// Its place in the queue.
    entry: usize,
    /// Of which it is.
    recording: Arc<Recording>,
    folder: PathBuf,
}

/// See above.
#[derive(Debug, Default)]
pub struct Analysing(Option<Begun>);

impl Analysing {
    /// The line, where there is something to say. Whether a person begins it is given back.
    pub fn show(&self, ui: &mut Ui, session: &Session, jobs: Option<&mut Jobs>) -> bool {
        let project = &session.project;
        if let Some(entry) = self.of(project).and_then(|begun| jobs?.entries.get_mut(begun.entry))
            && !entry.state.is_over()
        {
            under_way(ui, entry);
            ui.separator();
            return false;
        }
        let Some(finds) = project.shot().lacks_analysis().filter(|_| !session.is_frozen() && !session.lacks_camera())
        else {
            return false;
        };
        let (text, why) = match &project.shot().analysis {
            AnalysisState::Unfit(_, why) => ("The analysis of this footage is not used", format!("{why}. ")),
            _ => ("This footage is not analysed", String::new()),
        };
        let hint = format!("{why}Its pictures tell {finds}. What you have done here stays.");
        let mut begins = false;
        ui.horizontal(|ui| {
            begins = ui.button("Analyse").on_hover_text(&hint).clicked();
            ui.add(Label::new(RichText::new(text).weak()).truncate()).on_hover_text(hint);
        });
        ui.separator();
        begins
    }

    /// Begins it, in the queue.
    pub fn begin(&mut self, project: &Project, jobs: &mut Jobs) {
        let shot = project.shot();
        let folder = beside(&shot.recording.path);
        let entry = jobs.add(folder.display().to_string(), &shot.as_recorded(), JobKind::Analyse(folder.clone()));
        self.0 = Some(Begun { entry, recording: Arc::clone(&shot.recording), folder });
    }

    /// Something of the queue is over: what was found is taken over, if that is what it was.
    pub fn ended(&mut self, entry: usize, jobs: &mut Jobs, session: &mut Session) {
        let Some(begun) = self.0.take_if(|begun| begun.entry == entry) else { return };
        let Some(found) = jobs.entries.get_mut(entry).and_then(|entry| entry.analysis.take()) else { return };
        // Something else may be open by now.
        if begun.is_of(&session.project)
            && let Err(error) = session.project.adopt_analysis(begun.folder, *found)
        {
            session.show_error(error.to_string());
        }
    }

    fn of(&self, project: &Project) -> Option<&Begun> {
        self.0.as_ref().filter(|begun| begun.is_of(project))
    }
}

impl Begun {
    /// A scene may have given the recording another unit or another world since; it is the same pictures still.
    fn is_of(&self, project: &Project) -> bool {
        let now = &project.shot().recording;
        now.path == self.recording.path && Arc::ptr_eq(&now.timestamps_s, &self.recording.timestamps_s)
    }
}

fn under_way(ui: &mut Ui, entry: &mut JobEntry) {
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
            _ => _ = ui.weak("Analysed as soon as what is being exported is done"),
        }
    });
}
