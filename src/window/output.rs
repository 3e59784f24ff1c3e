//! What leaves the window: exports, photographs, snapshots, and the queue of them.

use std::ffi::OsStr;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Instant;

use eframe::egui::{self, RichText, Ui};

use super::dials::Dials;
use super::fields::typed;
use super::jobs::{JobKind, JobState, Jobs, remaining_time};
use super::progress;
use locard_engine::analyse::Stage;
use locard_engine::export::Export;
use locard_engine::photo::Wanted;
use locard_engine::sink::OutPath;
use locard_engine::text::count;

/// Which frames are exported.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Frames {
    #[default]
    All,
    Loop,
    This,
    /// From the first to the last that is given.
    Given,
}

/// The panel's state.
#[derive(Clone, Debug, Default)]
pub struct Output {
    frames: Frames,
    /// The loop that was there when it was shown last.
    looped: Option<Range<usize>>,
    given: [usize; 2],
    lossless: bool,
    dials: Dials,
}

/// What the panel asks for: a place to put it.
#[derive(Clone, Debug, PartialEq)]
pub enum Ask {
    Folder(Range<usize>),
    Video { range: Range<usize>, lossless: bool },
    Photograph(Box<Wanted>),
    Snapshot(usize),
}

impl Ask {
    /// What it is called, at the place that a person chose: of a series that is no file of its own.
    pub fn name(&self, path: &Path) -> String {
        match self {
            Self::Photograph(wanted) if wanted.bracket.is_some() => {
                let first = Wanted { output: path.to_owned(), ..(**wanted).clone() }.path_of("1");
                let name = |part: Option<&OsStr>| part.unwrap_or_default().to_string_lossy().into_owned();
                let folder = first.parent().unwrap_or(Path::new("")).display();
                format!("the series {} … in {folder}", name(first.file_name()))
            }
            _ => path.display().to_string(),
        }
    }

    /// What is done, at the place that a person chose. `force`: what is there may be replaced.
    pub fn job(self, path: PathBuf, force: bool) -> JobKind {
        match self {
            Self::Folder(range) => JobKind::Export(Export { force, ..Export::new(range, OutPath::Folder(path)) }),
            Self::Video { range, lossless } => {
                JobKind::Export(Export { force, lossless, ..Export::new(range, OutPath::Video(path)) })
            }
            Self::Photograph(wanted) => JobKind::Photograph(Wanted { output: path, force, ..*wanted }),
            Self::Snapshot(frame) => JobKind::Snapshot { frame, path, force },
        }
    }
}

/// What the panel has to know of the recording.
#[derive(Clone, Debug)]
pub struct Situation {
    pub frame: usize,
    pub count: usize,
    pub looped: Option<Range<usize>>,
}

impl Output {
    fn range(&self, now: &Situation) -> Range<usize> {
        match (self.frames, &now.looped) {
            (Frames::This, _) => now.frame..now.frame + 1,
            (Frames::Loop, Some(looped)) => looped.clone(),
            (Frames::Given, _) => self.given[0].min(self.given[1])..self.given[0].max(self.given[1]) + 1,
            _ => 0..now.count,
        }
    }

    /// Shows the panel. Gives what a place has to be chosen for.
    pub fn show(&mut self, ui: &mut Ui, now: &Situation, jobs: Option<&mut Jobs>) -> Option<Ask> {
        let mut ask = None;
        egui::ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
            ui.strong("Export");
            ui.label(RichText::new("As it is set now: what is changed later is not in it.").weak());
            if let Some(asked) = self.export(ui, now) {
                ask = Some(asked);
            }
            if let Some(jobs) = jobs.filter(|jobs| jobs.entries.iter().any(|entry| !entry.is_hidden)) {
                ui.separator();
                queue(ui, jobs);
            }
            ui.separator();
            ui.strong("Photograph");
            if let Some(wanted) = self.dials.show(ui, now.frame) {
                ask = Some(Ask::Photograph(Box::new(wanted)));
            }
        });
        ask
    }

    fn export(&mut self, ui: &mut Ui, now: &Situation) -> Option<Ask> {
        let last = now.count.saturating_sub(1);
        let looped = now.looped.as_ref().filter(|looped| looped.len() < now.count);
        // Who sets a loop means it.
        if self.looped.as_ref() != looped {
            self.looped = looped.cloned();
            self.frames = match (looped, self.frames) {
                (Some(_), Frames::All) => Frames::Loop,
                (None, Frames::Loop) => Frames::All,
                (_, frames) => frames,
            };
        }
        ui.horizontal_wrapped(|ui| {
            let mut choice = |ui: &mut Ui, frames: Frames, text: String| {
                if ui.radio(self.frames == frames, text).clicked() {
                    self.frames = frames;
                    if frames == Frames::Given && self.given == [0, 0] {
                        self.given = [0, last];
                    }
                }
            };
            choice(ui, Frames::All, format!("all {}", count(now.count, "frame")));
            if let Some(looped) = looped {
                choice(ui, Frames::Loop, format!("the loop, {} to {}", looped.start, looped.end - 1));
            }
            choice(ui, Frames::This, format!("frame {} alone", now.frame));
            choice(ui, Frames::Given, "from … to …".to_owned());
        });
        if self.frames == Frames::Given {
            ui.horizontal(|ui| {
                for (at, name) in self.given.iter_mut().zip(["first frame", "last frame"]) {
                    ui.label(name);
                    let drag = egui::DragValue::new(at).range(0..=last).speed(0.2).update_while_editing(false);
                    let drag = drag.custom_parser(typed(ui.ctx()));
                    ui.add(drag).widget_info(|| egui::WidgetInfo::labeled(egui::Role::SpinButton, true, name));
                }
            });
        }
        let range = self.range(now);
        let mut ask = None;
        ui.horizontal_wrapped(|ui| {
            if ui.button("Pictures…").on_hover_text("A folder with one PNG a frame, every code value kept").clicked()
            {
                ask = Some(Ask::Folder(range.clone()));
            }
            if ui.button("Video…").on_hover_text("An .mp4 or .mkv file, by the program ffmpeg").clicked() {
                ask = Some(Ask::Video { range: range.clone(), lossless: self.lossless });
            }
            ui.checkbox(&mut self.lossless, "lossless").on_hover_text("A video that keeps every code value; larger");
        });
        if ui.button("Snapshot…").on_hover_text("The frame that is shown, as one PNG").clicked() {
            ask = Some(Ask::Snapshot(now.frame));
        }
        ask
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
                if over { ("Clear", "Off the list") } else { ("Cancel", "What is not finished is removed") };
            let button = ui.button(text).on_hover_text(hint);
            button
                .widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, format!("{text} {}", entry.name)));
            if button.clicked() {
                if over { gone.push(n) } else { entry.cancel() }
            }
            ui.add(egui::Label::new(&entry.name).truncate()).on_hover_text(&entry.name);
        });
        match &entry.state {
            JobState::Waiting => _ = ui.weak("waits"),
            JobState::Cancelled => _ = ui.weak("cancelled"),
            JobState::Running { progress, begun, stage } => {
                progress::bar(ui, &entry.name, *progress as f32, Some(percent(*progress, *begun, *stage)));
            }
            JobState::Done(said) => _ = ui.label(format!("done: {said}")),
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

pub fn percent(share: f64, begun: Instant, stage: Option<Stage>) -> String {
    let rest = remaining_time(share, begun.elapsed());
    let rest = rest.map(|left| format!(", {} left", duration(left.as_secs_f64()))).unwrap_or_default();
    let stage = stage.map(|stage| format!("{}, ", stage.name())).unwrap_or_default();
    format!("{stage}{:.0} %{rest}", 100.0 * share)
}

/// As people say it: 40 s, 3 min 20 s, 2 h 5 min.
fn duration(seconds: f64) -> String {
    let s = seconds.ceil() as u64;
    match s {
        0..60 => format!("{s} s"),
        60..3600 => format!("{} min {} s", s / 60, s % 60),
        _ => format!("{} h {} min", s / 3600, s % 3600 / 60),
    }
}

/// The name that is proposed for what comes of a recording.
pub fn proposed(ask: &Ask, recording: &Path) -> String {
    let name = recording.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    match ask {
        Ask::Folder(_) => format!("{name}-composited"),
        Ask::Video { lossless, .. } => format!("{name}.{}", if *lossless { "mkv" } else { "mp4" }),
        Ask::Photograph(wanted) => format!("{name}-{:06}.jpg", wanted.frame),
        Ask::Snapshot(frame) => format!("{name}-{frame:06}.png"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use locard_engine::photo::Bracket;

    #[test]
    fn time_is_said_as_people_do() {
        let said = [0.2, 59.0, 60.0, 200.0, 7500.0].map(duration);
        assert_eq!(said, ["1 s", "59 s", "1 min 0 s", "3 min 20 s", "2 h 5 min"]);
    }

    #[test]
    fn progress_names_the_part_and_the_time_left() {
        let begun = Instant::now().checked_sub(std::time::Duration::from_secs(10)).unwrap();
        for (stage, name) in [(Stage::Path, "camera path, 50 %, "), (Stage::Light, "light, 50 %, ")] {
            let text = percent(0.5, begun, Some(stage));
            assert!(text.starts_with(name) && text.ends_with(" s left"), "{text}");
        }
        assert!(percent(0.5, begun, None).starts_with("50 %, "));
    }

    #[test]
    fn a_series_is_called_by_its_first_file() {
        let wanted = |bracket| Ask::Photograph(Box::new(Wanted { bracket, ..Wanted::new(3, PathBuf::new()) }));
        let path = Path::new("/cases/desk.png");
        assert_eq!(wanted(Some(Bracket::Iso)).name(path), "the series desk-1.png … in /cases");
        assert_eq!([wanted(None).name(path), Ask::Snapshot(3).name(path)], ["/cases/desk.png"; 2]);
    }

    #[test]
    fn the_range_is_what_was_chosen() {
        let now = Situation { frame: 7, count: 20, looped: Some(3..9) };
        let of = |frames, given| Output { frames, given, ..Output::default() }.range(&now);
        assert_eq!(of(Frames::All, [0, 0]), 0..20);
        assert_eq!((of(Frames::Loop, [0, 0]), of(Frames::This, [0, 0])), (3..9, 7..8));
        assert_eq!((of(Frames::Given, [4, 4]), of(Frames::Given, [9, 2])), (4..5, 2..10));
    }
}
