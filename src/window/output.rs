//! The output panel: exports, photographs, snapshots, and their queue.

use std::ffi::OsStr;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Instant;

use eframe::egui::{self, RichText, Ui};

use super::dials::Dials;
use super::fields::typed_parser;
use super::jobs::{JobKind, JobState, Jobs, remaining_time};
use super::progress;
use locard_engine::analyse::AnalysisStage;
use locard_engine::export::Export;
use locard_engine::photo::PhotoRequest;
use locard_engine::sink::OutPath;
use locard_engine::text::count;

/// Range of frames to export.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FrameRange {
    #[default]
    All,
    Loop,
    Current,
    /// The frames between the first and the last that the user enters.
    Interval,
}

/// The panel's state.
#[derive(Clone, Debug, Default)]
pub struct OutputPanel {
    frames: FrameRange,
    /// The loop at the last call.
    looped: Option<Range<usize>>,
    first_and_last: [usize; 2],
    lossless: bool,
    dials: Dials,
}

/// An output for which a path has to be chosen.
#[derive(Clone, Debug, PartialEq)]
pub enum OutputRequest {
    Folder(Range<usize>),
    Video { range: Range<usize>, lossless: bool },
    Photograph(Box<PhotoRequest>),
    Snapshot(usize),
}

impl OutputRequest {
    /// Name of the output at the chosen path. A bracketed series has no file of its own: it is
    /// named by its first one.
    pub fn name(&self, path: &Path) -> String {
        match self {
            Self::Photograph(request) if request.bracket.is_some() => {
                let first = PhotoRequest { output: path.to_owned(), ..(**request).clone() }.path_of("1");
                let name = |part: Option<&OsStr>| part.unwrap_or_default().to_string_lossy().into_owned();
                let folder = first.parent().unwrap_or(Path::new("")).display();
                format!("the series {} … in {folder}", name(first.file_name()))
            }
            _ => path.display().to_string(),
        }
    }

    /// The job that writes the chosen path. `force`: existing files are replaced.
    pub fn job(self, path: PathBuf, force: bool) -> JobKind {
        match self {
            Self::Folder(range) => JobKind::Export(Export { force, ..Export::new(range, OutPath::Folder(path)) }),
            Self::Video { range, lossless } => {
                JobKind::Export(Export { force, lossless, ..Export::new(range, OutPath::Video(path)) })
            }
            Self::Photograph(request) => JobKind::Photograph(PhotoRequest { output: path, force, ..*request }),
            Self::Snapshot(frame) => JobKind::Snapshot { frame, path, force },
        }
    }
}

/// Playback state of the recording.
#[derive(Clone, Debug)]
pub struct PlaybackState {
    pub frame: usize,
    pub count: usize,
    pub looped: Option<Range<usize>>,
}

impl OutputPanel {
    fn range(&self, now: &PlaybackState) -> Range<usize> {
        match (self.frames, &now.looped) {
            (FrameRange::Current, _) => now.frame..now.frame + 1,
            (FrameRange::Loop, Some(looped)) => looped.clone(),
            (FrameRange::Interval, _) => {
                self.first_and_last[0].min(self.first_and_last[1])
                    ..self.first_and_last[0].max(self.first_and_last[1]) + 1
            }
            _ => 0..now.count,
        }
    }

    /// Shows the panel. Returns an output for which a path has to be chosen.
    pub fn show(&mut self, ui: &mut Ui, now: &PlaybackState, jobs: Option<&mut Jobs>) -> Option<OutputRequest> {
        let mut request = None;
        egui::ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
            ui.strong("Export");
            ui.label(RichText::new("Uses the settings at the moment you press a button.").weak());
            if let Some(requested) = self.export(ui, now) {
                request = Some(requested);
            }
            if let Some(jobs) = jobs.filter(|jobs| jobs.entries.iter().any(|entry| !entry.is_hidden)) {
                ui.separator();
                queue(ui, jobs);
            }
            ui.separator();
            ui.strong("Photograph");
            if let Some(photo_request) = self.dials.show(ui, now.frame) {
                request = Some(OutputRequest::Photograph(Box::new(photo_request)));
            }
        });
        request
    }

    fn export(&mut self, ui: &mut Ui, now: &PlaybackState) -> Option<OutputRequest> {
        let last = now.count.saturating_sub(1);
        let looped = now.looped.as_ref().filter(|looped| looped.len() < now.count);
        // A new loop selects itself for export.
        if self.looped.as_ref() != looped {
            self.looped = looped.cloned();
            self.frames = match (looped, self.frames) {
                (Some(_), FrameRange::All) => FrameRange::Loop,
                (None, FrameRange::Loop) => FrameRange::All,
                (_, frames) => frames,
            };
        }
        ui.horizontal_wrapped(|ui| {
            let mut choice = |ui: &mut Ui, frames: FrameRange, text: String| {
                if ui.radio(self.frames == frames, text).clicked() {
                    self.frames = frames;
                    if frames == FrameRange::Interval && self.first_and_last == [0, 0] {
                        self.first_and_last = [0, last];
                    }
                }
            };
            choice(ui, FrameRange::All, format!("All ({})", count(now.count, "frame")));
            if let Some(looped) = looped {
                choice(ui, FrameRange::Loop, format!("Loop ({} to {})", looped.start, looped.end - 1));
            }
            choice(ui, FrameRange::Current, format!("Current (frame {})", now.frame));
            choice(ui, FrameRange::Interval, "Range".to_owned());
        });
        if self.frames == FrameRange::Interval {
            ui.horizontal(|ui| {
                for (at, name) in self.first_and_last.iter_mut().zip(["first frame", "last frame"]) {
                    ui.label(name);
                    let drag = egui::DragValue::new(at).range(0..=last).speed(0.2).update_while_editing(false);
                    let drag = drag.custom_parser(typed_parser(ui.ctx()));
                    ui.add(drag).widget_info(|| egui::WidgetInfo::labeled(egui::Role::SpinButton, true, name));
                }
            });
        }
        let range = self.range(now);
        let mut request = None;
        ui.horizontal_wrapped(|ui| {
            if ui
                .button("Image sequence…")
                .on_hover_text("A folder with one PNG per frame, pixel values unchanged")
                .clicked()
            {
                request = Some(OutputRequest::Folder(range.clone()));
            }
            if ui.button("Video…").on_hover_text("An .mp4 or .mkv file, by the program ffmpeg").clicked() {
                request = Some(OutputRequest::Video { range: range.clone(), lossless: self.lossless });
            }
            ui.checkbox(&mut self.lossless, "Lossless").on_hover_text("A larger video with unchanged pixel values");
        });
        if ui.button("Snapshot…").on_hover_text("The frame that is shown, as one PNG").clicked() {
            request = Some(OutputRequest::Snapshot(now.frame));
        }
        request
    }
}

fn queue(ui: &mut Ui, jobs: &mut Jobs) {
    ui.strong("Queue");
    let mut gone = Vec::new();
    for (n, entry) in jobs.entries.iter_mut().enumerate().rev() {
        if entry.is_hidden {
            continue;
        }
        ui.add_space(4.0);
        ui.horizontal(|ui| {
            let over = entry.state.is_over();
            let (text, hint) =
                if over { ("Clear", "Removes it from the list") } else { ("Cancel", "Unfinished output is removed") };
            let button = ui.button(text).on_hover_text(hint);
            button
                .widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, format!("{text} {}", entry.name)));
            if button.clicked() {
                if over { gone.push(n) } else { entry.cancel() }
            }
            ui.add(egui::Label::new(&entry.name).truncate()).on_hover_text(&entry.name);
        });
        match &entry.state {
            JobState::Waiting => _ = ui.weak("waiting"),
            JobState::Cancelled => _ = ui.weak("cancelled"),
            JobState::Running { progress, begun, stage } => {
                progress::bar(ui, &entry.name, *progress as f32, Some(percent(*progress, *begun, *stage)));
            }
            JobState::Done(message) => _ = ui.label(format!("done: {message}")),
            JobState::Failed(why) => {
                let text = RichText::new(why).color(ui.visuals().error_fg_color);
                ui.add(egui::Label::new(text).wrap().selectable(true));
            }
        }
        for note in &entry.notes {
            ui.add(egui::Label::new(RichText::new(note).weak().small()).wrap().selectable(true));
        }
    }
    for n in gone {
        jobs.entries[n].is_hidden = true;
    }
}

pub fn percent(share: f64, begun: Instant, stage: Option<AnalysisStage>) -> String {
    let rest = remaining_time(share, begun.elapsed());
    let rest = rest.map(|left| format!(", {} left", duration(left.as_secs_f64()))).unwrap_or_default();
    let stage = stage.map(|stage| format!("{}, ", stage.name())).unwrap_or_default();
    format!("{stage}{:.0} %{rest}", 100.0 * share)
}

/// Rounded up: 40 s, 3 min 20 s, 2 h 5 min.
fn duration(seconds: f64) -> String {
    let s = seconds.ceil() as u64;
    match s {
        0..60 => format!("{s} s"),
        60..3600 => format!("{} min {} s", s / 60, s % 60),
        _ => format!("{} h {} min", s / 3600, s % 3600 / 60),
    }
}

/// Default file name of an output of a recording.
pub fn default_name(request: &OutputRequest, recording: &Path) -> String {
    let name = recording.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    match request {
        OutputRequest::Folder(_) => format!("{name}-composited"),
        OutputRequest::Video { lossless, .. } => format!("{name}.{}", if *lossless { "mkv" } else { "mp4" }),
        OutputRequest::Photograph(photo_request) => format!("{name}-{:06}.jpg", photo_request.frame),
        OutputRequest::Snapshot(frame) => format!("{name}-{frame:06}.png"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use locard_engine::photo::Bracket;

    #[test]
    fn durations_are_shown_in_two_units() {
        let texts = [0.2, 59.0, 60.0, 200.0, 7500.0].map(duration);
        assert_eq!(texts, ["1 s", "59 s", "1 min 0 s", "3 min 20 s", "2 h 5 min"]);
    }

    #[test]
    fn progress_shows_the_stage_and_the_time_left() {
        let begun = Instant::now().checked_sub(std::time::Duration::from_secs(10)).unwrap();
        for (stage, name) in [(AnalysisStage::Path, "camera path, 50 %, "), (AnalysisStage::Light, "light, 50 %, ")] {
            let text = percent(0.5, begun, Some(stage));
            assert!(text.starts_with(name) && text.ends_with(" s left"), "{text}");
        }
        assert!(percent(0.5, begun, None).starts_with("50 %, "));
    }

    #[test]
    fn bracketed_series_is_named_by_its_first_file() {
        let photograph = |bracket| {
            OutputRequest::Photograph(Box::new(PhotoRequest { bracket, ..PhotoRequest::new(3, PathBuf::new()) }))
        };
        let path = Path::new("/cases/desk.png");
        assert_eq!(photograph(Some(Bracket::Iso)).name(path), "the series desk-1.png … in /cases");
        assert_eq!([photograph(None).name(path), OutputRequest::Snapshot(3).name(path)], ["/cases/desk.png"; 2]);
    }

    #[test]
    fn export_range_follows_the_selection() {
        let now = PlaybackState { frame: 7, count: 20, looped: Some(3..9) };
        let range_of =
            |frames, first_and_last| OutputPanel { frames, first_and_last, ..OutputPanel::default() }.range(&now);
        assert_eq!(range_of(FrameRange::All, [0, 0]), 0..20);
        assert_eq!((range_of(FrameRange::Loop, [0, 0]), range_of(FrameRange::Current, [0, 0])), (3..9, 7..8));
        assert_eq!((range_of(FrameRange::Interval, [4, 4]), range_of(FrameRange::Interval, [9, 2])), (4..5, 2..10));
    }
}
