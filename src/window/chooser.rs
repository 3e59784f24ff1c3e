//! A dialog that chooses a file or a folder. Whatever the disk is asked for is asked on a thread of its own: a slow one does
//! not hold the window up.
//!
//! It is the program's own: a system's dialog needs a portal or a toolkit that a bare Linux desktop lacks.

mod about;
mod disk;
mod entering;
mod listed;
mod making;

use std::path::{Path, PathBuf};

use eframe::egui::text::{CCursor, CCursorRange};
use eframe::egui::{self, Key, Ui};

use self::about::About;
use self::disk::Begun;
use self::entering::Entering;
use self::listed::{Entry, Listing};
use self::making::Making;
use super::errand::Errand;
use super::question::{self, Answer, Choices, DialogKeys};
use locard_engine::text::reason;

pub use self::disk::{Begin, Chosen};
pub use self::listed::Seeks;

#[derive(Debug)]
pub struct Chooser {
    title: String,
    seeks: Seeks,
    folder: PathBuf,
    /// A name in the folder, or a path.
    name: String,
    /// It was typed, and leaves in the list what holds it.
    is_typed: bool,
    listed: Option<Listing>,
    about: About,
    /// The folder that is being listed.
    listing: Option<(PathBuf, Errand<Listing>)>,
    begin: Option<Begin>,
    /// It is being looked for where it begins.
    begins: Option<Errand<Begun>>,
    entering: Option<Entering>,
    makes: Option<Making>,
    /// What is there, for which it is asked whether it may be replaced; the files of a series.
    replaces: Option<(PathBuf, Vec<PathBuf>)>,
    /// What there is to say of what was entered.
    told: Option<String>,
    /// The field is to have the keyboard.
    wants_keys: bool,
    /// Where else to begin: what a folder is called, and where it is.
    places: Vec<(&'static str, PathBuf)>,
}

impl Chooser {
    pub fn new(title: &str, seeks: Seeks, begin: Begin) -> Self {
        Self {
            title: title.to_owned(),
            seeks,
            folder: begin.folders.first().cloned().unwrap_or_default(),
            name: if seeks.is_new() { begin.name.clone() } else { String::new() },
            is_typed: false,
            listed: None,
            about: About::default(),
            listing: None,
            begin: Some(begin),
            begins: None,
            entering: None,
            makes: None,
            replaces: None,
            told: None,
            wants_keys: true,
            places: std::env::home_dir().map(|home| ("Home", home)).into_iter().collect(),
        }
    }

    /// Finds where it begins.
    fn begin(&mut self, ctx: &egui::Context) {
        if let Some(begin) = self.begin.take() {
            let wake = ctx.clone();
            match Errand::begin("chooser", move || wake.request_repaint(), move || begin.found()) {
                Ok(begins) => self.begins = Some(begins),
                Err(error) => self.told = Some(reason(&error)),
            }
        }
        if let Some(begun) = self.begins.as_ref().and_then(Errand::take) {
            self.begins = None;
            match begun {
                Ok(Begun { folder, places }) => {
                    self.folder = folder;
                    self.places.extend(places);
                }
                Err(why) => self.told = Some(why),
            }
        }
    }

    /// Shows another folder. The name of a new file stays.
    fn go(&mut self, folder: PathBuf) {
        let is_kept = self.seeks.is_new() && !self.name.ends_with(std::path::is_separator);
        let name = Path::new(&self.name).file_name().filter(|_| is_kept);
        self.name = name.map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        (self.folder, self.is_typed, self.told, self.wants_keys) = (folder, false, None, true);
        (self.begins, self.makes) = (None, None);
    }

    /// What a name or a path means that was typed.
    fn meant(&self, typed: &str) -> PathBuf {
        match typed.strip_prefix('~').filter(|rest| rest.is_empty() || rest.starts_with('/')) {
            Some(rest) => std::env::home_dir().unwrap_or_default().join(rest.trim_start_matches('/')),
            None => self.folder.join(typed),
        }
    }

    /// The folder that is shown, and what its entries' names must hold: a path that is typed leads to its own.
    fn looks_in(&self) -> (PathBuf, String) {
        let typed = if self.is_typed { self.name.trim() } else { "" };
        let part = |text: &str| if self.seeks.is_new() { String::new() } else { text.to_lowercase() };
        if !typed.contains(std::path::is_separator) && typed != "~" {
            return (self.folder.clone(), part(typed));
        }
        let meant = self.meant(typed);
        if typed.ends_with(std::path::is_separator) || typed == "~" {
            return (meant, String::new());
        }
        let name = meant.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        (meant.parent().map_or_else(|| meant.clone(), Path::to_owned), part(&name))
    }

    /// Lists the folder that is shown, if that has not been begun, and takes what was listed.
    fn list(&mut self, ctx: &egui::Context) {
        let (folder, _) = self.looks_in();
        if let Some(listing) = self.listing.as_ref().and_then(|(_, listing)| listing.take()) {
            let (of, _) = self.listing.take().unzip();
            self.listed = Some(listing.unwrap_or_else(|why| Listing::failed(of.unwrap_or_default(), why)));
        }
        let is_listed = self.listed.as_ref().is_some_and(|listing| listing.folder == folder);
        let is_begun = self.begins.is_none() || self.is_typed;
        if is_listed || !is_begun || self.listing.as_ref().is_some_and(|(listing, _)| *listing == folder) {
            return;
        }
        let (wanted, seeks, wake) = (folder.clone(), self.seeks, ctx.clone());
        // The dialog may be closed before it is over.
        match Errand::begin("chooser", move || wake.request_repaint(), move || Listing::of(wanted, seeks)) {
            Ok(listing) => self.listing = Some((folder, listing)),
            Err(error) => self.listed = Some(Listing::failed(folder, reason(&error))),
        }
    }

    pub fn show(&mut self, ctx: &egui::Context) -> Option<Chosen> {
        self.begin(ctx);
        self.list(ctx);
        let mut chosen = self.asked(ctx);
        let makes = self.makes.is_some();
        let mut asks = false;
        let title = self.title.clone();
        let modal = question::modal(ctx, "chooser", &title, |ui| {
            ui.set_width(620.0_f32.min(ctx.content_rect().width() - 48.0));
            ui.heading(&self.title);
            ui.add_space(6.0);
            if let Some((path, there)) = self.replaces.clone() {
                chosen = self.asks(ui, &path, &there).or(chosen.take());
                asks = true;
                return;
            }
            self.way(ui);
            self.makes(ui);
            ui.separator();
            self.entries(ui);
            ui.separator();
            if self.foot(ui) && chosen.is_none() {
                chosen = Some(Chosen::Nothing);
            }
        });
        if modal.should_close() && chosen.is_none() {
            // Esc leaves what was begun in it first.
            (self.makes, self.replaces, self.wants_keys) = (None, None, true);
            chosen = (!makes && !asks).then_some(Chosen::Nothing);
        }
        chosen
    }

    /// The folders above, and where else to begin.
    fn way(&mut self, ui: &mut Ui) {
        let mut to = None;
        let (shown, _) = self.looks_in();
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
            for (called, folder) in &self.places {
                if ui.small_button(*called).clicked() {
                    to = Some(folder.clone());
                }
            }
            if self.seeks.is_new() {
                ui.separator();
                if ui.small_button("New folder…").clicked() {
                    self.makes = Some(Making::default());
                }
            }
        });
        if let Some(folder) = to {
            self.go(folder);
        }
    }

    /// The list, as high as whole rows are.
    fn entries(&mut self, ui: &mut Ui) {
        let text = ui.text_style_height(&egui::TextStyle::Button) + 2.0 * ui.spacing().button_padding.y;
        let (row, gap) = (text.max(ui.spacing().interact_size.y), ui.spacing().item_spacing.y);
        let most = (ui.ctx().content_rect().height() - 260.0).clamp(120.0, 320.0);
        let height = (most / (row + gap)).floor() * (row + gap) - gap;
        let area = egui::ScrollArea::vertical().max_height(height).min_scrolled_height(height).auto_shrink(false);
        let (folder, part) = self.looks_in();
        let entries = match &self.listed {
            Some(Listing { folder: listed, entries: Ok(entries), .. }) if *listed == folder => {
                entries.iter().filter(|entry| entry.name.to_lowercase().contains(&part)).cloned().collect::<Vec<_>>()
            }
            other => {
                let text = match other {
                    Some(Listing { folder: listed, entries: Err(why), .. }) if *listed == folder => {
                        format!("{}: {why}", folder.display())
                    }
                    _ => "Listing…".to_owned(),
                };
                area.show(ui, |ui| ui.weak(text));
                return;
            }
        };
        if entries.is_empty() {
            let text = if part.is_empty() { "Nothing here that can be opened" } else { "Nothing here is called that" };
            let text = if self.seeks.is_new() { "Nothing is here yet" } else { text };
            area.show(ui, |ui| ui.weak(text));
            return;
        }
        area.show_rows(ui, row, entries.len(), |ui, rows| {
            entries[rows].iter().for_each(|entry| self.entry(ui, &folder, entry));
        });
    }

    fn entry(&mut self, ui: &mut Ui, folder: &Path, entry: &Entry) {
        let sign = if entry.is_recording { "   recording" } else { "" };
        let slash = if entry.is_folder { "/" } else { "" };
        let response = ui.selectable_label(self.name == entry.name, format!("{}{slash}{sign}", entry.name));
        let path = folder.join(&entry.name);
        match () {
            () if entry.is_folder && response.clicked() && !entry.is_recording => self.go(path),
            () if response.double_clicked() => {
                self.enter_path(ui.ctx(), path);
            }
            () if response.clicked() => {
                // The list stays as it is: a second click means the same entry.
                (self.folder, self.told, self.wants_keys) = (folder.to_owned(), None, true);
                (self.name, self.is_typed) = (entry.name.clone(), false);
            }
            () => {}
        }
    }

    /// Whether it is left.
    fn foot(&mut self, ui: &mut Ui) -> bool {
        let mut is_left = false;
        let recording = self.recording();
        let is_slow = self.entering.as_ref().is_some_and(Entering::is_slow);
        match (&self.told, &recording) {
            _ if is_slow => _ = ui.weak("The disk is being asked…"),
            (Some(told), _) => _ = ui.label(told),
            (None, Some(path)) => {
                let name = path.file_name().unwrap_or_default().to_string_lossy();
                _ = ui.label(format!("{name}: {}", self.about.of(ui.ctx(), path)));
            }
            (None, None) if self.seeks == Seeks::Recording => {
                _ = ui.weak("A click selects a recording; a double click or Enter opens it.");
            }
            (None, None) => {}
        }
        ui.horizontal(|ui| {
            let hint = if self.seeks.is_new() { "Name, or a path" } else { "Part of a name, or a path" };
            let field = egui::TextEdit::singleline(&mut self.name).desired_width(380.0).hint_text(hint);
            let response = ui.add(field);
            response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::TextInput, true, "File name"));
            if std::mem::take(&mut self.wants_keys) {
                response.request_focus();
                // What is typed next takes the place of what stands there.
                let mut state = egui::text_edit::TextEditState::load(ui.ctx(), response.id).unwrap_or_default();
                let all = CCursorRange::two(CCursor::new(0), CCursor::new(self.name.chars().count()));
                state.cursor.set_char_range(Some(all));
                state.store(ui.ctx(), response.id);
            }
            if response.changed() {
                (self.told, self.is_typed) = (None, true);
            }
            let entered = response.lost_focus() && ui.input(|i| i.key_pressed(Key::Enter));
            let does = match () {
                () if self.seeks.is_new() => "Save here",
                () if recording.is_some() => "Open recording",
                () => "Open",
            };
            if ui.button(does).clicked() || entered {
                self.enter(ui.ctx());
                self.wants_keys = true;
                ui.ctx().request_repaint();
            }
            is_left = ui.button("Cancel").clicked();
        });
        is_left
    }

    /// The recording that would be opened.
    fn recording(&self) -> Option<PathBuf> {
        let typed = self.name.trim();
        let name = if typed.is_empty() { String::new() } else { self.meant(typed).file_name()?.to_str()?.to_owned() };
        let (folder, _) = self.looks_in();
        self.listed.as_ref().filter(|listing| listing.folder == folder)?.recording(&name)
    }

    fn asks(&mut self, ui: &mut Ui, path: &Path, there: &[PathBuf]) -> Option<Chosen> {
        let (text, does) = match self.seeks {
            Seeks::NewFolder => (
                format!("There are files in {}. Those of the same names are replaced, no others.", path.display()),
                "Write there",
            ),
            Seeks::NewSeries(_) => {
                let first = there.first().unwrap_or(&self.folder).display();
                let are = match there.len() {
                    0 | 1 => "is".to_owned(),
                    many => format!("and {} more of its series are", many - 1),
                };
                (
                    format!("{first} {are} there already. Those of the same names are replaced, no others."),
                    "Replace them",
                )
            }
            _ => (format!("{} is there already.", path.display()), "Replace it"),
        };
        ui.label(text);
        ui.add_space(8.0);
        let keys = DialogKeys::of(ui.ctx(), "replaces");
        let choices = Choices { labels: [does, "Choose another name", ""], default: Answer::No };
        match question::buttons(ui, choices).or(keys.enter.then_some(Answer::No))? {
            Answer::Yes => Some(Chosen::Path { path: path.to_owned(), replaces: true }),
            Answer::No | Answer::Cancel => {
                (self.replaces, self.wants_keys) = (None, true);
                None
            }
        }
    }
}
