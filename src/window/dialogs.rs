//! The questions of the window and the welcome page.

use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use eframe::egui::{self, Context, RichText};

use super::question::{Answer, Choices, as_dialog, ask, modal};
use super::recent::DocumentRef;
use super::saving::ProfileOwner;
use super::titles::distinct;
use super::unsaved_work::UnsavedWork;
use locard_engine::text::count;

/// Consequences of closing the window or opening another document.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Consequences {
    /// The window is closed; else another document is opened.
    pub closes: bool,
    /// There are unsaved changes.
    pub is_changed: bool,
    /// An export or analysis is running.
    pub is_busy: bool,
    /// A camera is being recorded.
    pub is_recording: bool,
}

impl Consequences {
    /// True if nothing ends or is lost.
    pub fn is_harmless(&self) -> bool {
        !(self.is_changed || self.is_recording || self.closes && self.is_busy)
    }
}

const RECORDED: &str = "The camera is being recorded. The recording ends here and is complete.";

/// Confirmation before the window is closed or another document is opened.
pub fn confirm_discard(ctx: &Context, consequences: Consequences) -> Option<Answer> {
    let Consequences { closes, is_changed, is_busy, is_recording } = consequences;
    let is_busy = closes && is_busy;
    if !is_changed {
        let (title, answer) = match (is_recording, closes) {
            (true, true) => ("Close while the camera is recorded?", "End the recording and close"),
            (true, false) => ("Leave the camera while it is recorded?", "End the recording and continue"),
            (false, _) => ("Close while a task is running?", "Close and cancel it"),
        };
        let choices = Choices { labels: ["", answer, "Cancel"], default: Answer::Cancel };
        return ask(ctx, title, choices, |ui| {
            if is_recording {
                ui.label(RECORDED);
            }
            if is_busy {
                ui.label(
                    "Running exports and analyses are cancelled. Finished pictures are kept, unfinished ones are \
                     removed.",
                );
            }
        });
    }
    let labels = if closes {
        ["Save and close", "Close without saving", "Cancel"]
    } else {
        ["Save", "Continue without saving", "Cancel"]
    };
    ask(ctx, "Save changes?", Choices { labels, default: Answer::Yes }, |ui| {
        ui.label("Otherwise the changes since the last save are lost.");
        if is_recording {
            ui.label(RECORDED);
        }
        if is_busy {
            ui.label("Running exports and analyses are cancelled when the window closes.");
        }
    })
}

/// A file to write was changed by another program.
pub fn confirm_overwrite(ctx: &Context, path: &Path) -> Option<Answer> {
    let choices = Choices { labels: ["Save mine", "Read theirs", "Cancel"], default: Answer::Cancel };
    ask(ctx, "Overwrite another program's changes?", choices, |ui| {
        ui.label(format!("{} was changed on disk since it was opened here.", path.display()));
    })
}

/// A shared profile is about to be written for the first time.
pub fn confirm_shared_profile(ctx: &Context, path: &Path, owner: Option<ProfileOwner>) -> Option<Answer> {
    let (title, name) = match owner {
        Some(ProfileOwner::Program) => ("Change the supplied profile?", "the program"),
        Some(ProfileOwner::Recording) => ("Change the recording's profile?", "the recording"),
        None => ("Change the profile?", "others"),
    };
    let choices = Choices { labels: ["Overwrite", "Save as…", "Cancel"], default: Answer::No };
    ask(ctx, title, choices, |ui| {
        ui.label(format!("{} belongs to {name}. Wherever it is used, your changes apply.", path.display()));
    })
}

/// An open file was changed by another program.
pub fn offer_reload(ctx: &Context, path: &Path, is_changed: bool) -> Option<Answer> {
    // It appears without a user action: Enter in another field must not discard changes.
    let choices = Choices { labels: ["Read it again", "Keep mine", ""], default: Answer::No };
    ask(ctx, "A file was changed on disk", choices, |ui| {
        ui.label(format!("{} was changed by another program.", path.display()));
        if is_changed {
            ui.label("Your changes here are not lost: undo restores them.");
        }
    })
}

/// Work recovered from a crash.
pub fn offer_recovery(ctx: &Context, work: &UnsavedWork) -> Option<Answer> {
    let now_s = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    let choices = Choices { labels: ["Restore", "Discard", "Not now"], default: Answer::Yes };
    ask(ctx, "Restore unsaved work?", choices, |ui| {
        ui.label(format!(
            "Locard ended {} with changes that were not saved.",
            time_ago(now_s.saturating_sub(work.at_s))
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
            ui.label(count(work.edit.scene.placed_count(), "object"));
            ui.end_row();
        });
    })
}

/// Time elapsed, in words.
fn time_ago(seconds: u64) -> String {
    match seconds {
        0..90 => "a moment ago".to_owned(),
        90..5400 => format!("{} minutes ago", (seconds + 30) / 60),
        5400..129_600 => format!("{} hours ago", (seconds + 1800) / 3600),
        _ => format!("{} days ago", (seconds + 43_200) / 86_400),
    }
}

/// Shows that a document is being opened.
pub fn show_opening(ctx: &Context, what: &Path) {
    modal(ctx, "opening", "Opening", |ui| {
        ui.set_width(360.0);
        ui.horizontal(|ui| {
            ui.spinner();
            ui.add(egui::Label::new(format!("Opening {}", what.display())).wrap());
        });
    });
}

/// Choice on the welcome page.
#[derive(Clone, Debug, PartialEq)]
pub enum StartChoice {
    Open,
    Camera,
    Recent(Box<DocumentRef>),
    Continue,
}

/// The content behind the welcome page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StartBackground<'a> {
    Demonstration,
    /// A recording of that name.
    Recording(&'a str),
    /// Nothing: the demonstration is in none of these places.
    Nothing(&'a [PathBuf]),
}

/// The welcome page.
pub fn show_start<'a>(
    ctx: &Context,
    recent: impl Iterator<Item = (&'a DocumentRef, bool)>,
    behind: StartBackground<'_>,
) -> Option<StartChoice> {
    let (mut chosen, mut is_open) = (None, true);
    let page = egui::Window::new("Welcome").collapsible(false).resizable(false).default_width(420.0);
    let page = match behind {
        StartBackground::Nothing(_) => page.anchor(egui::Align2::CENTER_CENTER, egui::Vec2::ZERO),
        _ => page.open(&mut is_open).default_pos([250.0, 90.0]),
    };
    let page = page.show(ctx, |ui| {
        let (text, stay) = match behind {
            StartBackground::Demonstration => (
                "This is the demonstration. Move a slider, drag the picture, press ? for the keys.".to_owned(),
                Some("Continue with the demo".to_owned()),
            ),
            StartBackground::Recording(name) => (
                format!("{name} is open. Open another one, or press ? for the keys."),
                Some(format!("Continue with {name}")),
            ),
            StartBackground::Nothing(_) => {
                ("Open a recording: the frames of a camera with its poses. Press ? for the keys.".to_owned(), None)
            }
        };
        ui.add(egui::Label::new(text).wrap());
        ui.add_space(6.0);
        ui.horizontal(|ui| {
            if ui.button("Open a recording…").clicked() {
                chosen = Some(StartChoice::Open);
            }
            if ui.button("Live camera…").clicked() {
                chosen = Some(StartChoice::Camera);
            }
            if stay.is_some_and(|stay| ui.button(stay).clicked()) {
                chosen = Some(StartChoice::Continue);
            }
        });
        ui.add_space(6.0);
        ui.add(egui::Label::new(RichText::new(CAN_BE_DROPPED).weak()).wrap());
        if let StartBackground::Nothing(places) = behind {
            let places: Vec<String> = places.iter().map(|place| place.display().to_string()).collect();
            let text =
                format!("The demonstration is missing from the program's folder. Searched: {}.", places.join(", "));
            ui.add(egui::Label::new(RichText::new(text).weak()).wrap());
        }
        let recent: Vec<_> = recent.collect();
        if recent.is_empty() {
            return;
        }
        let paths: Vec<&Path> = recent.iter().map(|(document, _)| document.recording.as_path()).collect();
        ui.separator();
        ui.strong("Recent");
        egui::ScrollArea::vertical().max_height(240.0).show(ui, |ui| {
            for ((document, is_there), name) in recent.into_iter().zip(distinct(&paths)) {
                let of =
                    document.scene.as_ref().and_then(|scene| scene.file_name()).map(|scene| scene.to_string_lossy());
                let text = of.map_or_else(|| name.clone(), |scene| format!("{name}   {scene}"));
                let button = ui.add_enabled(is_there, egui::Button::selectable(false, text).truncate());
                let button = button.on_hover_text(files(document));
                if button.on_disabled_hover_text("It no longer exists").clicked() {
                    chosen = Some(StartChoice::Recent(Box::new(document.clone())));
                }
            }
        });
    });
    as_dialog(ctx, page.as_ref());
    chosen.or((!is_open).then_some(StartChoice::Continue))
}

/// The full paths of a recording, its scene and its profile, one per line.
fn files(document: &DocumentRef) -> String {
    let with = [("Scene", &document.scene), ("Profile", &document.profile)];
    let with = with.into_iter().filter_map(|(what, path)| Some(format!("\n{what}: {}", path.as_ref()?.display())));
    format!("Recording: {}", document.recording.display()) + &with.collect::<String>()
}

const CAN_BE_DROPPED: &str = "A recording's folder, a profile, a scene (.toml) or a model (.glb, .gltf) can be dropped into \
                              the window at any time.";

#[cfg(test)]
mod tests {
    use super::time_ago;

    #[test]
    fn elapsed_time_is_given_in_words() {
        let message = [5, 100, 3000, 7200, 200_000].map(time_ago);
        assert_eq!(message, ["a moment ago", "2 minutes ago", "50 minutes ago", "2 hours ago", "2 days ago"]);
    }
}
