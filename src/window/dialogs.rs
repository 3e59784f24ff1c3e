//! Questions, and what is told all of: each a few plain sentences and the buttons that answer.

use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use eframe::egui::{self, Context, InnerResponse, Key, Modal, ModalResponse, RichText, Ui, accesskit::Role};

use super::autosave::Work;
use super::recent::Opened;
use crate::words::count;

/// To a question that one can also leave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    Yes,
    No,
    /// Nothing is done.
    Stay,
}

/// Nothing else can be done while it is open. To a screen reader every modal is a dialog; it has that name.
pub fn modal<T>(ctx: &Context, id: &str, name: &str, body: impl FnOnce(&mut Ui) -> T) -> ModalResponse<T> {
    let id = egui::Id::unique(id);
    let area = Modal::default_area(id).accessible_name(name);
    Modal::new(id).area(area).show(ctx, body)
}

/// Makes a window that says or asks something a dialog for screen readers; it has the window's title for a name.
fn as_dialog<T>(ctx: &Context, window: Option<&InnerResponse<T>>) {
    if let Some(window) = window {
        ctx.accesskit_node_builder(window.response.id, |node| node.set_role(Role::Dialog));
    }
}

/// Asks, with a word for each answer. Esc stays.
pub fn question(ctx: &Context, title: &str, answers: [&str; 3], body: impl FnOnce(&mut Ui)) -> Option<Answer> {
    let mut given = None;
    let modal = modal(ctx, "question", title, |ui| {
        ui.set_width(420.0);
        ui.heading(title);
        ui.add_space(4.0);
        body(ui);
        ui.add_space(10.0);
        ui.horizontal(|ui| {
            for (text, answer) in answers.into_iter().zip([Answer::Yes, Answer::No, Answer::Stay]) {
                if !text.is_empty() && ui.button(text).clicked() {
                    given = Some(answer);
                }
            }
        });
    });
    // A click beside it is no answer.
    let left = modal.should_close() && ctx.input(|i| i.key_pressed(Key::Escape));
    given.or(left.then_some(Answer::Stay))
}

/// What ends or is lost if the window is closed, or something else is opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Ending {
    /// The window is closed, else something else is opened.
    pub closes: bool,
    /// There are changes that are not saved.
    pub is_changed: bool,
    /// Something is being exported, or analysed.
    pub is_busy: bool,
    /// A camera is being recorded.
    pub is_recording: bool,
}

impl Ending {
    /// Whether nothing ends and nothing is lost.
    pub fn is_harmless(&self) -> bool {
        !(self.is_changed || self.is_recording || self.closes && self.is_busy)
    }
}

const RECORDED: &str = "The camera is being recorded. The recording ends here, and is whole.";

/// Before the window is closed, or something else is opened.
pub fn before_it_is_lost(ctx: &Context, ending: Ending) -> Option<Answer> {
    let Ending { closes, is_changed, is_busy, is_recording } = ending;
    let is_busy = closes && is_busy;
    if !is_changed {
        let (title, answer) = match (is_recording, closes) {
            (true, true) => ("Close while the camera is recorded?", "End the recording and close"),
            (true, false) => ("Leave the camera while it is recorded?", "End the recording and go on"),
            (false, _) => ("Close while something is being made?", "Close and cancel it"),
        };
        return question(ctx, title, ["", answer, "Stay"], |ui| {
            if is_recording {
                ui.label(RECORDED);
            }
            if is_busy {
                ui.label(
                    "What is being exported or analysed is cancelled. Pictures that are whole stay; what is not finished is \
                     removed.",
                );
            }
        });
    }
    let answers = match closes {
        true => ["Save and close", "Close without saving", "Stay"],
        false => ["Save", "Go on without saving", "Stay"],
    };
    question(ctx, "Save what you have changed?", answers, |ui| {
        ui.label("The changes since the last save are lost otherwise.");
        if is_recording {
            ui.label(RECORDED);
        }
        if is_busy {
            ui.label("Something is being exported or analysed; it is cancelled when the window closes.");
        }
    })
}

/// A file that is about to be written was changed by somebody else.
pub fn whether_to_replace(ctx: &Context, path: &Path) -> Option<Answer> {
    question(ctx, "Replace what somebody else has written?", ["Save mine", "Read theirs", "Stay"], |ui| {
        ui.label(format!("{} was changed on disk since it was opened here.", path.display()));
    })
}

/// A profile is about to be written for the first time that others use too.
pub fn whether_to_write(ctx: &Context, path: &Path, whose: &str) -> Option<Answer> {
    let title = match whose {
        "the program" => "Change the supplied profile?",
        _ => "Change the recording's profile?",
    };
    question(ctx, title, ["Overwrite", "Save as…", "Cancel"], |ui| {
        ui.label(format!("{} belongs to {whose}. Wherever it is used, your changes apply.", path.display()));
    })
}

/// A file that is open was changed by somebody else.
pub fn changed_on_disk(ctx: &Context, path: &Path, is_changed: bool) -> Option<Answer> {
    question(ctx, "A file was changed on disk", ["Read it again", "Keep what is here", ""], |ui| {
        ui.label(format!("{} was changed by another program.", path.display()));
        if is_changed {
            ui.label("What you have changed here is not lost: undo brings it back.");
        }
    })
}

/// Work that a crash left.
pub fn left(ctx: &Context, work: &Work) -> Option<Answer> {
    let now_s = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    let answers = ["Take it up", "Throw it away", "Later"];
    question(ctx, "Take up where it ended?", answers, |ui| {
        ui.label(format!(
            "The window ended {} with changes that were not saved.",
            ago(now_s.saturating_sub(work.at_s))
        ));
        ui.add_space(4.0);
        egui::Grid::new("work").num_columns(2).spacing([12.0, 4.0]).show(ui, |ui| {
            let mut line = |what: &str, path: Option<&Path>| {
                let Some(path) = path else { return };
                ui.weak(what);
                let text = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
                ui.add(egui::Label::new(text).truncate()).on_hover_text(path.display().to_string());
                ui.end_row();
            };
            line("Recording", Some(&work.recording));
            line("Scene", work.scene.as_deref());
            line("Profile", work.profile.as_deref());
            ui.weak("Evidence");
            ui.label(count(work.edit.scene.objects.len(), "object"));
            ui.end_row();
        });
    })
}

/// How long ago, as people say it.
fn ago(seconds: u64) -> String {
    match seconds {
        0..90 => "a moment ago".to_owned(),
        90..5400 => format!("{} minutes ago", (seconds + 30) / 60),
        5400..129_600 => format!("{} hours ago", (seconds + 1800) / 3600),
        _ => format!("{} days ago", (seconds + 43_200) / 86_400),
    }
}

/// Says that something is being opened.
pub fn opening(ctx: &Context, what: &Path) {
    modal(ctx, "opening", "Opening", |ui| {
        ui.set_width(360.0);
        ui.horizontal(|ui| {
            ui.spinner();
            ui.add(egui::Label::new(format!("Opening {}", what.display())).wrap());
        });
    });
}

/// A message, all of it, to be read and copied. Nothing waits for it: what is clicked beside it counts, and closes it. Gives
/// whether it is closed.
pub fn message(ctx: &Context, text: &str) -> bool {
    let (mut closed, mut is_open) = (false, true);
    let window = egui::Window::new("Message")
        .open(&mut is_open)
        .collapsible(false)
        .resizable(false)
        .anchor(egui::Align2::CENTER_CENTER, egui::Vec2::ZERO)
        .show(ctx, |ui| {
            ui.set_width(520.0_f32.min(ctx.content_rect().width() - 48.0));
            egui::ScrollArea::vertical().max_height(300.0).show(ui, |ui| {
                ui.add(egui::Label::new(text).wrap().selectable(true));
            });
            ui.add_space(8.0);
            ui.horizontal(|ui| {
                if ui.button("Copy").clicked() {
                    ui.ctx().copy_text(text.to_owned());
                }
                closed = ui.button("Close").clicked();
            });
        });
    as_dialog(ctx, window.as_ref());
    let rect = window.map(|window| window.response.rect);
    let is_beside = |at: egui::Pos2| rect.is_some_and(|rect| !rect.contains(at));
    let beside = ctx.input(|i| i.pointer.any_pressed() && i.pointer.interact_pos().is_some_and(is_beside));
    closed || !is_open || beside
}

/// What is chosen on the start page.
#[derive(Clone, Debug, PartialEq)]
pub enum Start {
    Open,
    Camera,
    Recent(Box<Opened>),
    Leave,
}

/// What is behind the start page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Behind<'a> {
    Demonstration,
    /// A recording of that name.
    Recording(&'a str),
    /// Nothing: no demonstration lies in any of these places.
    Nothing(&'a [PathBuf]),
}

/// The page of a start without a recording.
pub fn start<'a>(ctx: &Context, recent: impl Iterator<Item = (&'a Opened, bool)>, behind: Behind<'_>) -> Option<Start> {
    let (mut chosen, mut is_open) = (None, true);
    let page = egui::Window::new("Welcome").collapsible(false).resizable(false).default_width(420.0);
    let page = match behind {
        Behind::Nothing(_) => page.anchor(egui::Align2::CENTER_CENTER, egui::Vec2::ZERO),
        _ => page.open(&mut is_open).default_pos([250.0, 90.0]),
    };
    let page = page.show(ctx, |ui| {
        let (text, stay) = match behind {
            Behind::Demonstration => (
                "This is the demonstration. Move a slider, drag the picture, press ? for the keys.".to_owned(),
                Some("Stay with the demonstration".to_owned()),
            ),
            Behind::Recording(name) => (
                format!("{name} is open. Open another one, or press ? for the keys."),
                Some(format!("Stay with {name}")),
            ),
            Behind::Nothing(_) => {
                ("Open a recording: the frames of a camera with its poses. Press ? for the keys.".to_owned(), None)
            }
        };
        ui.add(egui::Label::new(text).wrap());
        ui.add_space(6.0);
        ui.horizontal(|ui| {
            if ui.button("Open a recording…").clicked() {
                chosen = Some(Start::Open);
            }
            if ui.button("Live camera…").clicked() {
                chosen = Some(Start::Camera);
            }
            if stay.is_some_and(|stay| ui.button(stay).clicked()) {
                chosen = Some(Start::Leave);
            }
        });
        ui.add_space(6.0);
        ui.add(egui::Label::new(RichText::new(CAN_BE_DROPPED).weak()).wrap());
        if let Behind::Nothing(places) = behind {
            let places: Vec<String> = places.iter().map(|place| place.display().to_string()).collect();
            let text = format!(
                "The demonstration lies in the program's folder, and is not there. It was looked for at {}.",
                places.join(", ")
            );
            ui.add(egui::Label::new(RichText::new(text).weak()).wrap());
        }
        let mut recent = recent.peekable();
        if recent.peek().is_none() {
            return;
        }
        ui.separator();
        ui.strong("Opened lately");
        egui::ScrollArea::vertical().max_height(240.0).show(ui, |ui| {
            for (opened, is_there) in recent {
                let name = opened.recording.file_name().unwrap_or(opened.recording.as_os_str()).to_string_lossy();
                let of = opened.scene.as_ref().and_then(|scene| scene.file_name()).map(|scene| scene.to_string_lossy());
                let text = of.map_or_else(|| name.to_string(), |scene| format!("{name}   {scene}"));
                let button = ui.add_enabled(is_there, egui::Button::selectable(false, text));
                let button = button.on_hover_text(opened.recording.display().to_string());
                if button.on_disabled_hover_text("It is no longer there").clicked() {
                    chosen = Some(Start::Recent(Box::new(opened.clone())));
                }
            }
        });
    });
    as_dialog(ctx, page.as_ref());
    chosen.or((!is_open).then_some(Start::Leave))
}

const CAN_BE_DROPPED: &str = "A recording's folder, a profile, a scene (.toml) or a model (.glb, .gltf) can be dropped into \
                              the window at any time.";

#[cfg(test)]
mod tests {
    use super::ago;

    #[test]
    fn time_that_has_passed_is_said_as_people_do() {
        let said = [5, 100, 3000, 7200, 200_000].map(ago);
        assert_eq!(said, ["a moment ago", "2 minutes ago", "50 minutes ago", "2 hours ago", "2 days ago"]);
    }
}
