//! A dialog that chooses a file or a folder. Folders are listed on a thread of its own: a slow disk does not hold the
//! window up.
//!
//! It is the program's own: a system's dialog needs a portal or a toolkit that a bare Linux desktop lacks.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, channel};

use eframe::egui::{self, Key, RichText, Ui};

use crate::photo::series_there;
use crate::recording::Recording;
use crate::words::reason;

/// What is looked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Seeks {
    /// A file with one of these endings.
    File(&'static [&'static str]),
    /// A recording: a folder, or a file of one.
    Recording,
    /// A file that may be new; the first ending is added where there is none.
    NewFile(&'static [&'static str]),
    /// A name for a series of photographs, as [`NewFile`](Self::NewFile).
    NewSeries(&'static [&'static str]),
    /// A folder that may be new.
    NewFolder,
}

impl Seeks {
    fn is_new(self) -> bool {
        matches!(self, Self::NewFile(_) | Self::NewSeries(_) | Self::NewFolder)
    }

    fn shows(self, path: &Path) -> bool {
        let ending = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        match self {
            Self::File(endings) | Self::NewFile(endings) | Self::NewSeries(endings) => {
                endings.contains(&ending.as_str())
            }
            Self::Recording => matches!(ending.as_str(), "toml" | "json" | "txt"),
            Self::NewFolder => false,
        }
    }
}

#[derive(Clone, Debug)]
struct Entry {
    name: String,
    is_folder: bool,
    is_recording: bool,
}

type Listing = (PathBuf, Result<Vec<Entry>, String>);

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
    /// `None` while the folder is being listed.
    entries: Option<Result<Vec<Entry>, String>>,
    listing: Option<Receiver<Listing>>,
    /// A file that is there, for which it has been asked whether it may be replaced.
    replaces: Option<PathBuf>,
    wrong: Option<String>,
    is_new: bool,
}

impl Chooser {
    /// Begins in a folder, or in the folder of a file, whose name it proposes.
    pub fn new(title: &str, seeks: Seeks, at: &Path) -> Self {
        let at = std::path::absolute(at).unwrap_or_else(|_| at.to_owned());
        let is_folder = at.is_dir() && seeks != Seeks::NewFolder;
        let there = |folder: &Path| folder.ancestors().find(|folder| folder.is_dir()).map(Path::to_owned);
        let parent = if is_folder { Some(at.as_path()) } else { at.parent() };
        let folder = parent.and_then(there).or_else(std::env::home_dir).unwrap_or_default();
        let file = at.file_name().filter(|_| !is_folder && seeks.is_new());
        let name = file.map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let title = title.to_owned();
        let (entries, listing, replaces, wrong) = (None, None, None, None);
        Self { title, seeks, folder, name, is_typed: false, entries, listing, replaces, wrong, is_new: true }
    }

    fn go(&mut self, folder: PathBuf) {
        self.folder = folder;
        (self.entries, self.listing, self.wrong) = (None, None, None);
        if !self.seeks.is_new() {
            self.name.clear();
        }
    }

    /// Lists the folder, if that has not been begun, and takes what was listed.
    fn list(&mut self, ctx: &egui::Context) {
        if self.entries.is_none() && self.listing.is_none() {
            let (send, receive) = channel();
            let (folder, seeks, wake) = (self.folder.clone(), self.seeks, ctx.clone());
            let begun = std::thread::Builder::new().name("chooser".to_owned()).spawn(move || {
                let listed = listed(&folder, seeks);
                // The dialog may be closed.
                let _ = send.send((folder, listed));
                wake.request_repaint();
            });
            match begun {
                Ok(_) => self.listing = Some(receive),
                Err(error) => self.entries = Some(Err(reason(&error))),
            }
        }
        if let Some((folder, listed)) = self.listing.as_ref().and_then(|listing| listing.try_recv().ok())
            && folder == self.folder
        {
            (self.entries, self.listing) = (Some(listed), None);
        }
    }

    pub fn show(&mut self, ctx: &egui::Context) -> Option<Chosen> {
        self.list(ctx);
        let mut chosen = None;
        let modal = egui::Modal::new(egui::Id::unique("chooser")).show(ctx, |ui| {
            ui.set_width(620.0_f32.min(ctx.content_rect().width() - 48.0));
            ui.heading(&self.title);
            ui.add_space(6.0);
            if let Some(path) = self.replaces.clone() {
                chosen = self.asks(ui, &path);
                return;
            }
            self.way(ui);
            ui.separator();
            let height = (ctx.content_rect().height() - 260.0).clamp(120.0, 320.0);
            egui::ScrollArea::vertical()
                .max_height(height)
                .min_scrolled_height(height)
                .auto_shrink(false)
                .show(ui, |ui| chosen = self.entries(ui));
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
        ui.horizontal_wrapped(|ui| {
            let mut above: Vec<&Path> = self.folder.ancestors().collect();
            above.reverse();
            for folder in above {
                let name =
                    folder.file_name().map_or_else(|| folder.display().to_string(), |n| n.to_string_lossy().into());
                if ui.small_button(name).clicked() {
                    to = Some(folder.to_owned());
                }
            }
            ui.separator();
            if let Some(home) = std::env::home_dir()
                && ui.small_button("Home").clicked()
            {
                to = Some(home);
            }
        });
        if let Some(folder) = to {
            self.go(folder);
        }
    }

    fn entries(&mut self, ui: &mut Ui) -> Option<Chosen> {
        let entries = match &self.entries {
            None => {
                ui.weak("Listing…");
                return None;
            }
            Some(Err(why)) => {
                ui.label(RichText::new(why).color(ui.visuals().error_fg_color));
                return None;
            }
            Some(Ok(entries)) => entries.clone(),
        };
        // Of what is looked for, what is typed leaves what holds it.
        let typed = if self.is_typed && !self.seeks.is_new() { self.name.to_lowercase() } else { String::new() };
        let fits = |entry: &&Entry| typed.is_empty() || entry.name.to_lowercase().contains(&typed);
        let shown: Vec<&Entry> = entries.iter().filter(fits).collect();
        if shown.is_empty() {
            ui.weak(if entries.is_empty() { "Nothing here that can be opened" } else { "Nothing here is called that" });
        }
        let mut chosen = None;
        for entry in shown {
            let sign = if entry.is_recording { "   recording" } else { "" };
            let slash = if entry.is_folder { "/" } else { "" };
            let response = ui.selectable_label(self.name == entry.name, format!("{}{slash}{sign}", entry.name));
            let path = self.folder.join(&entry.name);
            match () {
                () if entry.is_folder && response.clicked() && !entry.is_recording => self.go(path),
                () if response.double_clicked() => chosen = self.take(path),
                () if response.clicked() => {
                    // The list stays as it is: a second click means the same entry.
                    (self.name, self.is_typed) = (entry.name.clone(), false);
                }
                () => {}
            }
        }
        chosen
    }

    fn foot(&mut self, ui: &mut Ui) -> Option<Chosen> {
        let mut chosen = None;
        if let Some(wrong) = &self.wrong {
            ui.label(RichText::new(wrong).color(ui.visuals().error_fg_color));
        }
        ui.horizontal(|ui| {
            let hint = if self.seeks.is_new() { "Name, or a path" } else { "Part of a name, or a path" };
            let field = egui::TextEdit::singleline(&mut self.name).desired_width(380.0).hint_text(hint);
            let response = ui.add(field);
            response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::TextInput, true, "File name"));
            if std::mem::take(&mut self.is_new) {
                response.request_focus();
            }
            if response.changed() {
                (self.wrong, self.is_typed) = (None, true);
            }
            let entered = response.lost_focus() && ui.input(|i| i.key_pressed(Key::Enter));
            let does = if self.seeks.is_new() { "Save here" } else { "Open" };
            if (ui.button(does).clicked() || entered) && chosen.is_none() {
                chosen = self.enter();
                self.is_new = chosen.is_none();
            }
            if ui.button("Cancel").clicked() {
                chosen = Some(Chosen::Nothing);
            }
        });
        chosen
    }

    /// What is typed, or the only thing that is left of the list by it.
    fn enter(&mut self) -> Option<Chosen> {
        let typed = self.name.trim().to_owned();
        if typed.is_empty() {
            if self.seeks == Seeks::Recording || self.seeks == Seeks::NewFolder {
                return self.take(self.folder.clone());
            }
            self.wrong = Some("Choose a file, or type its name".to_owned());
            return None;
        }
        let path = match typed.strip_prefix("~/").and_then(|rest| Some(std::env::home_dir()?.join(rest))) {
            Some(path) => path,
            None => self.folder.join(&typed),
        };
        if path.exists() || self.seeks.is_new() {
            return self.take(path);
        }
        let entries = self.entries.as_ref().and_then(|entries| entries.as_ref().ok());
        let mut like =
            entries.into_iter().flatten().filter(|entry| entry.name.to_lowercase().contains(&typed.to_lowercase()));
        match (like.next().map(|entry| self.folder.join(&entry.name)), like.next()) {
            (Some(only), None) => self.take(only),
            _ => {
                self.wrong = Some(format!("There is no {}", path.display()));
                None
            }
        }
    }

    fn take(&mut self, path: PathBuf) -> Option<Chosen> {
        match self.seeks {
            Seeks::File(_) if path.is_dir() => {
                self.go(path);
                None
            }
            Seeks::File(_) => Some(Chosen::free(path)),
            Seeks::Recording if path.is_dir() && !Recording::is_at(&path) => {
                self.go(path);
                self.wrong = Some("There is no recording in this folder".to_owned());
                None
            }
            Seeks::Recording => Some(Chosen::free(path)),
            Seeks::NewFile(_) | Seeks::NewSeries(_) if path.is_dir() => {
                self.go(path);
                self.name.clear();
                None
            }
            Seeks::NewFile(endings) | Seeks::NewSeries(endings) => {
                let path = match path.extension() {
                    Some(_) => path,
                    None => path.with_extension(endings.first().unwrap_or(&"")),
                };
                let is_there = match self.seeks {
                    Seeks::NewSeries(_) => !series_there(&path).is_empty(),
                    _ => path.exists(),
                };
                if is_there {
                    self.replaces = Some(path);
                    return None;
                }
                Some(Chosen::free(path))
            }
            Seeks::NewFolder => {
                if std::fs::read_dir(&path).is_ok_and(|mut entries| entries.next().is_some()) {
                    self.replaces = Some(path);
                    return None;
                }
                Some(Chosen::free(path))
            }
        }
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

/// Folders first, then the files that are looked for; no hidden ones.
fn listed(folder: &Path, seeks: Seeks) -> Result<Vec<Entry>, String> {
    let mut entries: Vec<Entry> = std::fs::read_dir(folder)
        .map_err(|error| reason(&error))?
        .flatten()
        .filter_map(|entry| {
            let name = entry.file_name().to_str().filter(|name| !name.starts_with('.'))?.to_owned();
            // Through links.
            let is_folder = std::fs::metadata(entry.path()).is_ok_and(|there| there.is_dir());
            let is_recording = seeks == Seeks::Recording && is_folder && Recording::is_at(&entry.path());
            (is_folder || seeks.shows(&entry.path())).then_some(Entry { name, is_folder, is_recording })
        })
        .collect();
    entries.sort_by_key(|entry| (!entry.is_folder, entry.name.to_lowercase()));
    Ok(entries)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_come_first_and_files_of_the_wrong_kind_do_not_come() {
        let temp = tempfile::tempdir().unwrap();
        for folder in ["b", "A", ".hidden"] {
            std::fs::create_dir(temp.path().join(folder)).unwrap();
        }
        for file in ["z.toml", "a.TOML", "c.png", ".d.toml"] {
            std::fs::write(temp.path().join(file), "").unwrap();
        }
        let names = |seeks| listed(temp.path(), seeks).unwrap().into_iter().map(|e| e.name).collect::<Vec<_>>();
        assert_eq!(names(Seeks::File(&["toml"])), ["A", "b", "a.TOML", "z.toml"]);
        assert_eq!(names(Seeks::NewFolder), ["A", "b"]);
        assert!(listed(&temp.path().join("nowhere"), Seeks::NewFolder).unwrap_err().contains("no such"));
        let recordings = listed(Path::new("recordings"), Seeks::Recording).unwrap();
        assert!(recordings.iter().any(|entry| entry.name == "demo" && entry.is_recording));
    }

    #[test]
    fn what_is_typed_is_a_name_a_path_or_a_part() {
        let temp = tempfile::tempdir().unwrap();
        std::fs::create_dir(temp.path().join("in")).unwrap();
        for file in ["mine.toml", "other.toml"] {
            std::fs::write(temp.path().join(file), "").unwrap();
        }
        let endings: &[&str] = &["toml"];
        let mut open = Chooser::new("Open", Seeks::File(endings), temp.path());
        open.entries = Some(listed(temp.path(), open.seeks));
        let mut type_in = |text: &str| {
            open.name = text.to_owned();
            open.enter()
        };
        let at = |name: &str| Some(Chosen::free(temp.path().join(name)));
        assert_eq!(type_in("mine.toml"), at("mine.toml"));
        assert_eq!(type_in("oth"), at("other.toml"));
        assert_eq!(type_in(&temp.path().join("mine.toml").display().to_string()), at("mine.toml"));
        assert_eq!((type_in("nothing"), type_in("toml"), type_in("")), (None, None, None));
        assert!(open.wrong.is_some());
        open.name = "in".to_owned();
        assert_eq!((open.enter(), &open.folder), (None, &temp.path().join("in")));

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
