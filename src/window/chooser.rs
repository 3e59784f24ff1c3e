//! A dialog that chooses a file or a folder. Folders are listed on a thread of its own: a slow disk does not hold the
//! window up.
//!
//! It is the program's own: a system's dialog needs a portal or a toolkit that a bare Linux desktop lacks.

mod about;
mod listed;

use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, channel};

use eframe::egui::text::{CCursor, CCursorRange};
use eframe::egui::{self, Key, Ui};

use self::about::About;
use self::listed::{Entry, Listing};
use super::dialogs;
use crate::photo::series_there;
use crate::recording::Recording;
use crate::words::reason;

pub use self::listed::Seeks;

/// How it ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Chosen {
    Path {
        path: PathBuf,
        /// What is there may be replaced: it was asked.
        replaces: bool,
    },
    Nothing,
}

impl Chosen {
    fn free(path: PathBuf) -> Self {
        Self::Path { path, replaces: false }
    }
}

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
    listing: Option<(PathBuf, Receiver<Listing>)>,
    /// A file that is there, for which it has been asked whether it may be replaced.
    replaces: Option<PathBuf>,
    /// What there is to say of what was entered.
    told: Option<String>,
    /// The field is to have the keyboard.
    wants_keys: bool,
    /// Where else to begin: what a folder is called, and where it is.
    places: Vec<(&'static str, PathBuf)>,
}

impl Chooser {
    /// Begins in a folder, or in the folder of a file, whose name it proposes.
    pub fn new(title: &str, seeks: Seeks, at: &Path) -> Self {
        let at = std::path::absolute(at).unwrap_or_else(|_| at.to_owned());
        let is_folder = at.is_dir() && !matches!(seeks, Seeks::NewFolder | Seeks::EmptyFolder);
        let there = |folder: &Path| folder.ancestors().find(|folder| folder.is_dir()).map(Path::to_owned);
        let parent = if is_folder { Some(at.as_path()) } else { at.parent() };
        let folder = parent.and_then(there).or_else(std::env::home_dir).unwrap_or_default();
        let file = at.file_name().filter(|_| !is_folder && seeks.is_new());
        let name = file.map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let title = title.to_owned();
        let (listed, listing, replaces, told) = (None, None, None, None);
        let about = About::default();
        let places = std::env::home_dir().map(|home| ("Home", home)).into_iter().collect();
        Self {
            title,
            seeks,
            folder,
            name,
            is_typed: false,
            listed,
            about,
            listing,
            replaces,
            told,
            wants_keys: true,
            places,
        }
    }

    /// Offers another folder to begin in, if it is there.
    pub fn with(mut self, called: &'static str, folder: &Path) -> Self {
        if let Some(folder) = folder.canonicalize().ok().filter(|folder| folder.is_dir()) {
            self.places.push((called, folder));
        }
        self
    }

    /// Shows another folder. The name of a new file stays.
    fn go(&mut self, folder: PathBuf) {
        let is_kept = self.seeks.is_new() && !self.name.ends_with(std::path::is_separator);
        let name = Path::new(&self.name).file_name().filter(|_| is_kept);
        self.name = name.map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        (self.folder, self.is_typed, self.told, self.wants_keys) = (folder, false, None, true);
    }

    /// Shows a folder that was named.
    fn go_into(&mut self, folder: PathBuf) {
        self.name.clear();
        self.go(folder);
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
        if let Some(listing) = self.listing.as_ref().and_then(|(_, listing)| listing.try_recv().ok()) {
            (self.listed, self.listing) = (Some(listing), None);
        }
        let is_listed = self.listed.as_ref().is_some_and(|listing| listing.folder == folder);
        if is_listed || self.listing.as_ref().is_some_and(|(listing, _)| *listing == folder) {
            return;
        }
        let (send, receive) = channel();
        let (wanted, seeks, wake) = (folder.clone(), self.seeks, ctx.clone());
        let begun = std::thread::Builder::new().name("chooser".to_owned()).spawn(move || {
            // The dialog may be closed.
            let _ = send.send(Listing::of(wanted, seeks));
            wake.request_repaint();
        });
        match begun {
            Ok(_) => self.listing = Some((folder, receive)),
            Err(error) => {
                self.listed = Some(Listing { folder, is_recording: false, entries: Err(reason(&error)) });
            }
        }
    }

    pub fn show(&mut self, ctx: &egui::Context) -> Option<Chosen> {
        self.list(ctx);
        let mut chosen = None;
        let title = self.title.clone();
        let modal = dialogs::modal(ctx, "chooser", &title, |ui| {
            ui.set_width(620.0_f32.min(ctx.content_rect().width() - 48.0));
            ui.heading(&self.title);
            ui.add_space(6.0);
            if let Some(path) = self.replaces.clone() {
                chosen = self.asks(ui, &path);
                return;
            }
            self.way(ui);
            ui.separator();
            chosen = self.entries(ui);
            ui.separator();
            if chosen.is_none() {
                chosen = self.foot(ui);
            }
        });
        if modal.should_close() && chosen.is_none() {
            chosen = Some(Chosen::Nothing);
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
        });
        if let Some(folder) = to {
            self.go(folder);
        }
    }

    /// The list, as high as whole rows are.
    fn entries(&mut self, ui: &mut Ui) -> Option<Chosen> {
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
                return None;
            }
        };
        if entries.is_empty() {
            let text = if part.is_empty() { "Nothing here that can be opened" } else { "Nothing here is called that" };
            let text = if self.seeks.is_new() { "Nothing is here yet" } else { text };
            area.show(ui, |ui| ui.weak(text));
            return None;
        }
        let mut chosen = None;
        area.show_rows(ui, row, entries.len(), |ui, rows| {
            for entry in &entries[rows] {
                chosen = self.entry(ui, &folder, entry).or(chosen.take());
            }
        });
        chosen
    }

    fn entry(&mut self, ui: &mut Ui, folder: &Path, entry: &Entry) -> Option<Chosen> {
        let sign = if entry.is_recording { "   recording" } else { "" };
        let slash = if entry.is_folder { "/" } else { "" };
        let response = ui.selectable_label(self.name == entry.name, format!("{}{slash}{sign}", entry.name));
        let path = folder.join(&entry.name);
        match () {
            () if entry.is_folder && response.clicked() && !entry.is_recording => self.go(path),
            () if response.double_clicked() => return self.take(path),
            () if response.clicked() => {
                // The list stays as it is: a second click means the same entry.
                (self.folder, self.told, self.wants_keys) = (folder.to_owned(), None, true);
                (self.name, self.is_typed) = (entry.name.clone(), false);
            }
            () => {}
        }
        None
    }

    fn foot(&mut self, ui: &mut Ui) -> Option<Chosen> {
        let mut chosen = None;
        let recording = self.recording();
        match (&self.told, &recording) {
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
            if (ui.button(does).clicked() || entered) && chosen.is_none() {
                chosen = self.enter();
                self.wants_keys = chosen.is_none();
                ui.ctx().request_repaint();
            }
            if ui.button("Cancel").clicked() {
                chosen = Some(Chosen::Nothing);
            }
        });
        chosen
    }

    /// The recording that would be opened.
    fn recording(&self) -> Option<PathBuf> {
        let typed = self.name.trim();
        let name = if typed.is_empty() { String::new() } else { self.meant(typed).file_name()?.to_str()?.to_owned() };
        let (folder, _) = self.looks_in();
        self.listed.as_ref().filter(|listing| listing.folder == folder)?.recording(&name)
    }

    /// What is typed, or the only thing that is left of the list by it.
    fn enter(&mut self) -> Option<Chosen> {
        let typed = self.name.trim().to_owned();
        if typed.is_empty() {
            match self.seeks {
                Seeks::NewFolder | Seeks::EmptyFolder => return self.take(self.folder.clone()),
                Seeks::Recording if Recording::is_at(&self.folder) => return self.take(self.folder.clone()),
                Seeks::Recording => {
                    self.told = Some("There is no recording in this folder: go to one that is marked".to_owned());
                }
                _ => self.told = Some("Choose a file, or type its name".to_owned()),
            }
            return None;
        }
        let path = self.meant(&typed);
        if path.exists() || self.seeks.is_new() {
            return self.take(path);
        }
        let (folder, part) = self.looks_in();
        let part = if self.is_typed { part } else { typed.to_lowercase() };
        let listed = self.listed.iter().filter(|listing| listing.folder == folder);
        let entries = listed.flat_map(|listing| listing.entries.iter().flatten());
        let mut like = entries.filter(|entry| entry.name.to_lowercase().contains(&part));
        match (like.next().map(|entry| folder.join(&entry.name)), like.next()) {
            (Some(only), None) => self.take(only),
            _ => {
                self.told = Some(format!("There is no {}", path.display()));
                None
            }
        }
    }

    fn take(&mut self, path: PathBuf) -> Option<Chosen> {
        match self.seeks {
            Seeks::Recording if path.is_dir() && !Recording::is_at(&path) => self.go_into(path),
            Seeks::File(_) | Seeks::NewFile(_) | Seeks::NewSeries(_) if path.is_dir() => self.go_into(path),
            Seeks::File(_) | Seeks::Recording => return Some(Chosen::free(path)),
            Seeks::NewFile(endings) | Seeks::NewSeries(endings) => {
                let path = match path.extension() {
                    Some(_) => path,
                    None => path.with_extension(endings.first().unwrap_or(&"")),
                };
                let is_there = match self.seeks {
                    Seeks::NewSeries(_) => !series_there(&path).is_empty(),
                    _ => path.exists(),
                };
                if !is_there {
                    return Some(Chosen::free(path));
                }
                self.replaces = Some(path);
            }
            Seeks::NewFolder | Seeks::EmptyFolder => {
                if !std::fs::read_dir(&path).is_ok_and(|mut entries| entries.next().is_some()) {
                    return Some(Chosen::free(path));
                }
                if self.seeks == Seeks::EmptyFolder {
                    self.told = Some(format!("There are files in {}: name a new folder", path.display()));
                    return None;
                }
                self.replaces = Some(path);
            }
        }
        None
    }

    fn asks(&mut self, ui: &mut Ui, path: &Path) -> Option<Chosen> {
        let (text, does) = match self.seeks {
            Seeks::NewFolder => (
                format!("There are files in {}. Those of the same names are replaced, no others.", path.display()),
                "Write there",
            ),
            Seeks::NewSeries(_) => {
                let there = series_there(path);
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
        let mut chosen = None;
        ui.horizontal(|ui| {
            if ui.button(does).clicked() {
                chosen = Some(Chosen::Path { path: path.to_owned(), replaces: true });
            }
            if ui.button("Choose another name").clicked() {
                self.replaces = None;
            }
        });
        chosen
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_typed_is_a_name_a_path_or_a_part() {
        let temp = tempfile::tempdir().unwrap();
        std::fs::create_dir(temp.path().join("in")).unwrap();
        for file in ["mine.toml", "other.toml"] {
            std::fs::write(temp.path().join(file), "").unwrap();
        }
        let endings: &[&str] = &["toml"];
        let mut open = Chooser::new("Open", Seeks::File(endings), temp.path());
        let mut type_in = |text: &str| {
            (open.name, open.is_typed) = (text.to_owned(), true);
            let (folder, _) = open.looks_in();
            open.listed = Some(Listing::of(folder, open.seeks));
            (open.enter(), open.folder.clone())
        };
        let (here, within) = (temp.path().to_owned(), temp.path().join("in"));
        let at = |name: &str| Some(Chosen::free(temp.path().join(name)));
        let whole = |name: &str| temp.path().join(name).display().to_string();
        assert_eq!(type_in("mine.toml"), (at("mine.toml"), here.clone()));
        assert_eq!(type_in("oth").0, at("other.toml"));
        assert_eq!(type_in(&whole("mine.toml")).0, at("mine.toml"));
        assert_eq!(type_in(&whole("oth")).0, at("other.toml"), "a part of a name in another folder");
        assert_eq!([type_in("nothing").0, type_in("toml").0, type_in("").0], [None, None, None]);
        assert_eq!(type_in("in"), (None, within.clone()));
        assert_eq!(type_in("../mine.toml").0, Some(Chosen::free(within.join("../mine.toml"))));
        assert_eq!(type_in(&whole("")), (None, PathBuf::from(whole(""))));
        assert!(open.told.is_none() && open.wants_keys && open.name.is_empty());
        (open.name, open.is_typed) = ("nothing".to_owned(), true);
        assert!(open.enter().is_none() && open.told.is_some());

        let mut save = Chooser::new("Save", Seeks::NewFile(endings), &temp.path().join("mine.toml"));
        assert_eq!(save.name, "mine.toml");
        assert_eq!(save.enter(), None);
        assert_eq!(save.replaces, Some(temp.path().join("mine.toml")), "it asks");
        save.name = "new".to_owned();
        assert_eq!(save.enter(), at("new.toml"));

        // Of a series it is its own files that count, not the one that would be a single photograph.
        let mut series = Chooser::new("Write", Seeks::NewSeries(&["jpg", "png"]), &temp.path().join("a.jpg"));
        std::fs::write(temp.path().join("a.jpg"), "").unwrap();
        assert_eq!(series.enter(), at("a.jpg"));
        std::fs::write(temp.path().join("a-2.jpg"), "").unwrap();
        assert_eq!((series.enter(), &series.replaces), (None, &Some(temp.path().join("a.jpg"))));
    }
}
