//! A dialog that chooses a file or a folder. All disk access is on background threads, so that a
//! slow disk does not block the window.
//!
//! The dialog is drawn by the program itself: a system dialog needs a portal or a toolkit that a
//! minimal Linux desktop lacks. The crate egui-file-dialog 0.15 requires an older egui, checks and
//! creates paths on the window's thread, has no accessible names, and cannot mark and summarize
//! recordings, complete part of a name, or confirm the files of a series.

mod disk;
mod entering;
mod listing;
mod new_folder;
mod recording_summary;

use std::path::{Path, PathBuf};

use eframe::egui::text::{CCursor, CCursorRange};
use eframe::egui::{self, Key, Ui};

use self::disk::ResolvedStart;
use self::entering::PendingEntry;
use self::listing::{FolderEntry, Listing};
use self::new_folder::NewFolderForm;
use self::recording_summary::RecordingSummary;
use super::question::{self, Answer, Choices, DialogKeys};
use super::task::BackgroundTask;
use locard_engine::text::reason;

pub use self::disk::{ChooserResult, StartLocation};
pub use self::listing::ChooserMode;

/// State of the dialog: the shown folder, the typed name, and running tasks.
#[derive(Debug)]
pub struct Chooser {
    title: String,
    mode: ChooserMode,
    folder: PathBuf,
    /// A name in the folder, or a path.
    name: String,
    /// The name was typed, and filters the list.
    is_typed: bool,
    listing: Option<Listing>,
    summary: RecordingSummary,
    /// The folder that is being listed.
    listing_task: Option<(PathBuf, BackgroundTask<Listing>)>,
    start_location: Option<StartLocation>,
    /// The task that resolves the start folder.
    start_task: Option<BackgroundTask<ResolvedStart>>,
    pending_entry: Option<PendingEntry>,
    new_folder: Option<NewFolderForm>,
    /// Existing path to confirm for replacement, with the existing files of a series.
    replace_candidate: Option<(PathBuf, Vec<PathBuf>)>,
    /// Message about the last entry.
    message: Option<String>,
    /// Gives the field the keyboard focus.
    wants_focus: bool,
    /// Further folders to go to, with their labels.
    places: Vec<(&'static str, PathBuf)>,
}

impl Chooser {
    pub fn new(title: &str, mode: ChooserMode, start_location: StartLocation) -> Self {
        Self {
            title: title.to_owned(),
            mode,
            folder: start_location.folders.first().cloned().unwrap_or_default(),
            name: if mode.is_new() { start_location.name.clone() } else { String::new() },
            is_typed: false,
            listing: None,
            summary: RecordingSummary::default(),
            listing_task: None,
            start_location: Some(start_location),
            start_task: None,
            pending_entry: None,
            new_folder: None,
            replace_candidate: None,
            message: None,
            wants_focus: true,
            places: std::env::home_dir().map(|home| ("Home", home)).into_iter().collect(),
        }
    }

    /// Resolves the start folder.
    fn resolve_start(&mut self, ctx: &egui::Context) {
        if let Some(start_location) = self.start_location.take() {
            let wake = ctx.clone();
            match BackgroundTask::spawn("chooser", move || wake.request_repaint(), move || start_location.resolve()) {
                Ok(start_task) => self.start_task = Some(start_task),
                Err(error) => self.message = Some(reason(&error)),
            }
        }
        if let Some(start) = self.start_task.as_ref().and_then(BackgroundTask::take) {
            self.start_task = None;
            match start {
                Ok(ResolvedStart { folder, places }) => {
                    self.folder = folder;
                    self.places.extend(places);
                }
                Err(why) => self.message = Some(why),
            }
        }
    }

    /// Shows another folder. The name of a new file stays.
    fn show_folder(&mut self, folder: PathBuf) {
        let keeps_name = self.mode.is_new() && !self.name.ends_with(std::path::is_separator);
        let name = Path::new(&self.name).file_name().filter(|_| keeps_name);
        self.name = name.map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        (self.folder, self.is_typed, self.message, self.wants_focus) = (folder, false, None, true);
        (self.start_task, self.new_folder) = (None, None);
    }

    /// The path for a typed name or path.
    fn resolve(&self, typed: &str) -> PathBuf {
        match typed.strip_prefix('~').filter(|rest| rest.is_empty() || rest.starts_with('/')) {
            Some(rest) => std::env::home_dir().unwrap_or_default().join(rest.trim_start_matches('/')),
            None => self.folder.join(typed),
        }
    }

    /// The displayed folder, and the filter of its names. A typed path leads to its own folder.
    fn displayed_folder(&self) -> (PathBuf, String) {
        let typed = if self.is_typed { self.name.trim() } else { "" };
        let filter = |text: &str| if self.mode.is_new() { String::new() } else { text.to_lowercase() };
        if !typed.contains(std::path::is_separator) && typed != "~" {
            return (self.folder.clone(), filter(typed));
        }
        let path = self.resolve(typed);
        if typed.ends_with(std::path::is_separator) || typed == "~" {
            return (path, String::new());
        }
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        (path.parent().map_or_else(|| path.clone(), Path::to_owned), filter(&name))
    }

    /// Starts listing the displayed folder if necessary, and takes the result.
    fn update_listing(&mut self, ctx: &egui::Context) {
        let (folder, _) = self.displayed_folder();
        if let Some(listing) = self.listing_task.as_ref().and_then(|(_, listing)| listing.take()) {
            let (of, _) = self.listing_task.take().unzip();
            self.listing = Some(listing.unwrap_or_else(|why| Listing::failed(of.unwrap_or_default(), why)));
        }
        let is_listed = self.listing.as_ref().is_some_and(|listing| listing.folder == folder);
        let is_resolved = self.start_task.is_none() || self.is_typed;
        if is_listed || !is_resolved || self.listing_task.as_ref().is_some_and(|(listing, _)| *listing == folder) {
            return;
        }
        let (folder_to_list, mode, wake) = (folder.clone(), self.mode, ctx.clone());
        // The dialog may be closed before the task ends.
        match BackgroundTask::spawn(
            "chooser",
            move || wake.request_repaint(),
            move || Listing::of(folder_to_list, mode),
        ) {
            Ok(listing) => self.listing_task = Some((folder, listing)),
            Err(error) => self.listing = Some(Listing::failed(folder, reason(&error))),
        }
    }

    pub fn show(&mut self, ctx: &egui::Context) -> Option<ChooserResult> {
        self.resolve_start(ctx);
        self.update_listing(ctx);
        let mut chosen = self.poll_entry(ctx);
        let is_naming_folder = self.new_folder.is_some();
        let mut is_asking = false;
        let title = self.title.clone();
        let modal = question::modal(ctx, "chooser", &title, |ui| {
            ui.set_width(620.0_f32.min(ctx.content_rect().width() - 48.0));
            ui.heading(&self.title);
            ui.add_space(6.0);
            if let Some((path, existing)) = self.replace_candidate.clone() {
                chosen = self.replace_question(ui, &path, &existing).or(chosen.take());
                is_asking = true;
                return;
            }
            self.path_bar(ui);
            self.show_new_folder_form(ui);
            ui.separator();
            self.entries(ui);
            ui.separator();
            if self.footer(ui) && chosen.is_none() {
                chosen = Some(ChooserResult::Cancelled);
            }
        });
        if modal.should_close() && chosen.is_none() {
            // Esc first cancels a question or form inside the dialog.
            (self.new_folder, self.replace_candidate, self.wants_focus) = (None, None, true);
            chosen = (!is_naming_folder && !is_asking).then_some(ChooserResult::Cancelled);
        }
        chosen
    }

    /// Buttons of the parent folders and the further folders.
    fn path_bar(&mut self, ui: &mut Ui) {
        let mut to = None;
        let (shown, _) = self.displayed_folder();
        ui.horizontal_wrapped(|ui| {
            let mut above: Vec<&Path> = shown.ancestors().collect();
            above.reverse();
            for folder in above {
                let name =
                    folder.file_name().map_or_else(|| folder.display().to_string(), |n| n.to_string_lossy().into());
                if ui.small_button(name).clicked() {
                    to = Some(folder.to_owned());
                }
            }
            ui.separator();
            for (label, folder) in &self.places {
                if ui.small_button(*label).clicked() {
                    to = Some(folder.clone());
                }
            }
            if self.mode.is_new() {
                ui.separator();
                if ui.small_button("New folder…").clicked() {
                    self.new_folder = Some(NewFolderForm::default());
                }
            }
        });
        if let Some(folder) = to {
            self.show_folder(folder);
        }
    }

    /// The list. Its height is a whole number of rows.
    fn entries(&mut self, ui: &mut Ui) {
        let text = ui.text_style_height(&egui::TextStyle::Button) + 2.0 * ui.spacing().button_padding.y;
        let (row, gap) = (text.max(ui.spacing().interact_size.y), ui.spacing().item_spacing.y);
        let max_height = (ui.ctx().content_rect().height() - 260.0).clamp(120.0, 320.0);
        let height = (max_height / (row + gap)).floor() * (row + gap) - gap;
        let area = egui::ScrollArea::vertical().max_height(height).min_scrolled_height(height).auto_shrink(false);
        let (folder, filter) = self.displayed_folder();
        let entries = match &self.listing {
            Some(Listing { folder: listing, entries: Ok(entries), .. }) if *listing == folder => {
                entries.iter().filter(|entry| entry.name.to_lowercase().contains(&filter)).cloned().collect::<Vec<_>>()
            }
            other => {
                let text = match other {
                    Some(Listing { folder: listing, entries: Err(why), .. }) if *listing == folder => {
                        format!("{}: {why}", folder.display())
                    }
                    _ => "Listing…".to_owned(),
                };
                area.show(ui, |ui| ui.weak(text));
                return;
            }
        };
        if entries.is_empty() {
            let text = if filter.is_empty() { "Nothing here that can be opened" } else { "Nothing here has this name" };
            let text = if self.mode.is_new() { "This folder is empty" } else { text };
            area.show(ui, |ui| ui.weak(text));
            return;
        }
        area.show_rows(ui, row, entries.len(), |ui, rows| {
            entries[rows].iter().for_each(|entry| self.entry(ui, &folder, entry));
        });
    }

    fn entry(&mut self, ui: &mut Ui, folder: &Path, entry: &FolderEntry) {
        let sign = if entry.is_recording { "   recording" } else { "" };
        let slash = if entry.is_folder { "/" } else { "" };
        let response = ui.selectable_label(self.name == entry.name, format!("{}{slash}{sign}", entry.name));
        let path = folder.join(&entry.name);
        if entry.is_folder && response.clicked() && !entry.is_recording {
            self.show_folder(path);
        } else if response.double_clicked() {
            self.enter_path(ui.ctx(), path);
        } else if response.clicked() {
            // The list stays unfiltered, so that a second click hits the same entry.
            (self.folder, self.message, self.wants_focus) = (folder.to_owned(), None, true);
            (self.name, self.is_typed) = (entry.name.clone(), false);
        }
    }

    /// The name field and the buttons. Returns true if the dialog was cancelled.
    fn footer(&mut self, ui: &mut Ui) -> bool {
        let mut is_cancelled = false;
        let recording = self.recording();
        let is_slow = self.pending_entry.as_ref().is_some_and(PendingEntry::is_slow);
        match (&self.message, &recording) {
            _ if is_slow => _ = ui.weak("Reading the disk…"),
            (Some(message), _) => _ = ui.label(message),
            (None, Some(path)) => {
                let name = path.file_name().unwrap_or_default().to_string_lossy();
                _ = ui.label(format!("{name}: {}", self.summary.of(ui.ctx(), path)));
            }
            (None, None) if self.mode == ChooserMode::Recording => {
                _ = ui.weak("A click selects a recording; a double click or Enter opens it.");
            }
            (None, None) => {}
        }
        ui.horizontal(|ui| {
            let hint = if self.mode.is_new() { "Name, or a path" } else { "Part of a name, or a path" };
            let field = egui::TextEdit::singleline(&mut self.name).desired_width(380.0).hint_text(hint);
            let response = ui.add(field);
            response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::TextInput, true, "File name"));
            if std::mem::take(&mut self.wants_focus) {
                response.request_focus();
                // Selects the text, so that typing replaces it.
                let mut state = egui::text_edit::TextEditState::load(ui.ctx(), response.id).unwrap_or_default();
                let all = CCursorRange::two(CCursor::new(0), CCursor::new(self.name.chars().count()));
                state.cursor.set_char_range(Some(all));
                state.store(ui.ctx(), response.id);
            }
            if response.changed() {
                (self.message, self.is_typed) = (None, true);
            }
            let entered = response.lost_focus() && ui.input(|i| i.key_pressed(Key::Enter));
            let action = if self.mode.is_new() {
                "Save here"
            } else if recording.is_some() {
                "Open recording"
            } else {
                "Open"
            };
            if ui.button(action).clicked() || entered {
                self.enter(ui.ctx());
                self.wants_focus = true;
                ui.ctx().request_repaint();
            }
            is_cancelled = ui.button("Cancel").clicked();
        });
        is_cancelled
    }

    /// The recording that would be opened.
    fn recording(&self) -> Option<PathBuf> {
        let typed = self.name.trim();
        let name = if typed.is_empty() { String::new() } else { self.resolve(typed).file_name()?.to_str()?.to_owned() };
        let (folder, _) = self.displayed_folder();
        self.listing.as_ref().filter(|listing| listing.folder == folder)?.recording(&name)
    }

    fn replace_question(&mut self, ui: &mut Ui, path: &Path, existing: &[PathBuf]) -> Option<ChooserResult> {
        let (text, action) = match self.mode {
            ChooserMode::NewFolder => (
                format!("{} contains files. Only those of the same names are replaced.", path.display()),
                "Write there",
            ),
            ChooserMode::NewSeries(_) => {
                let first = existing.first().unwrap_or(&self.folder).display();
                let are = match existing.len() {
                    0 | 1 => "is".to_owned(),
                    many => format!("and {} more of its series are", many - 1),
                };
                (format!("{first} {are} there already. Only files of the same names are replaced."), "Replace them")
            }
            _ => (format!("{} is there already.", path.display()), "Replace it"),
        };
        ui.label(text);
        ui.add_space(8.0);
        let keys = DialogKeys::of(ui.ctx(), "replaces");
        let choices = Choices { labels: [action, "Choose another name", ""], default: Answer::No };
        match question::buttons(ui, choices).or(keys.enter.then_some(Answer::No))? {
            Answer::Yes => Some(ChooserResult::Path { path: path.to_owned(), replaces: true }),
            Answer::No | Answer::Cancel => {
                (self.replace_candidate, self.wants_focus) = (None, true);
                None
            }
        }
    }
}
