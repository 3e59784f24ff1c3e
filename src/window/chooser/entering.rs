//! What becomes of a name or a path that is entered: the disk says it.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use eframe::egui::Context;

use super::super::errand::Errand;
use super::Chooser;
use super::disk::{Chosen, Entered, Taken};
use locard_engine::text::reason;

/// Something that was entered, of which the disk has not said yet what it is.
#[derive(Debug)]
pub struct Entering {
    taken: Errand<Taken>,
    since: Instant,
    /// What stood in the field: what is typed meanwhile is meant for what comes then.
    name: String,
    /// And was entered, too.
    again: bool,
}

/// A disk that takes longer is told.
const PATIENCE: Duration = Duration::from_millis(300);

impl Entering {
    pub fn is_slow(&self) -> bool {
        self.since.elapsed() >= PATIENCE
    }
}

impl Chooser {
    /// Has the disk asked what was entered.
    pub(super) fn ask(&mut self, ctx: &Context, ask: impl FnOnce() -> Taken + Send + 'static) {
        let wake = ctx.clone();
        match Errand::begin("chooser", move || wake.request_repaint(), ask) {
            Ok(taken) => {
                let (since, name) = (Instant::now(), self.name.clone());
                self.entering = Some(Entering { taken, since, name, again: false });
            }
            Err(error) => self.told = Some(reason(&error)),
        }
    }

    /// Takes what the disk said.
    pub(super) fn asked(&mut self, ctx: &Context) -> Option<Chosen> {
        let entering = self.entering.as_ref()?;
        let Some(taken) = entering.taken.take() else {
            ctx.request_repaint_after(PATIENCE.saturating_sub(entering.since.elapsed()));
            return None;
        };
        let Entering { name, again, .. } = self.entering.take()?;
        let typed = (self.name != name).then(|| self.name.clone());
        let chosen = self.settle(taken.unwrap_or_else(Taken::Told));
        if let Some(typed) = typed {
            (self.name, self.is_typed, self.wants_keys) = (typed, true, false);
            if again {
                self.enter(ctx);
            }
        }
        chosen
    }

    fn settle(&mut self, taken: Taken) -> Option<Chosen> {
        match taken {
            Taken::Path(path) => return Some(Chosen::free(path)),
            Taken::Folder(folder) => {
                // A name that is proposed for a new file is kept by whoever goes into a folder that is made for it.
                if self.makes.is_none() {
                    self.name.clear();
                }
                self.go(folder);
            }
            Taken::Asks { path, there } => self.replaces = Some((path, there)),
            Taken::Told(why) => self.told = Some(why),
        }
        None
    }

    pub(super) fn enter(&mut self, ctx: &Context) {
        match &mut self.entering {
            Some(entering) => entering.again = self.name != entering.name,
            None => {
                self.told = None;
                let entered = self.entered();
                self.ask(ctx, move || entered.taken());
            }
        }
    }

    /// Enters one of the list.
    pub(super) fn enter_path(&mut self, ctx: &Context, path: PathBuf) {
        let entered = Entered { path: Some(path), only: None, ..self.entered() };
        self.ask(ctx, move || entered.taken());
    }

    /// What is typed, or the only thing that is left of the list by it.
    fn entered(&self) -> Entered {
        let (typed, (folder, part)) = (self.name.trim(), self.looks_in());
        let part = if self.is_typed { part } else { typed.to_lowercase() };
        let listed = self.listed.iter().filter(|listing| listing.folder == folder);
        let entries = listed.flat_map(|listing| listing.entries.iter().flatten());
        let mut like = entries.filter(|entry| entry.name.to_lowercase().contains(&part));
        let only = like.next().map(|entry| folder.join(&entry.name)).filter(|_| like.next().is_none());
        let path = (!typed.is_empty()).then(|| self.meant(typed));
        Entered { seeks: self.seeks, folder: self.folder.clone(), path, only }
    }
}

#[cfg(test)]
mod tests {
    use super::super::disk::Begin;
    use super::super::listed::{Listing, Seeks};
    use super::*;

    #[test]
    fn what_is_typed_is_a_name_a_path_or_a_part() {
        let temp = tempfile::tempdir().unwrap();
        std::fs::create_dir(temp.path().join("in")).unwrap();
        for file in ["mine.toml", "other.toml"] {
            std::fs::write(temp.path().join(file), "").unwrap();
        }
        let endings: &[&str] = &["toml"];
        let mut open = Chooser::new("Open", Seeks::File(endings), Begin::within([temp.path().to_owned()]));
        let enter = |chooser: &mut Chooser| {
            let taken = chooser.entered().taken();
            chooser.settle(taken)
        };
        let mut type_in = |text: &str| {
            (open.name, open.is_typed) = (text.to_owned(), true);
            let (folder, _) = open.looks_in();
            open.listed = Some(Listing::of(folder, open.seeks));
            (enter(&mut open), open.folder.clone())
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
        assert!(enter(&mut open).is_none() && open.told.is_some());

        let mut save = Chooser::new("Save", Seeks::NewFile(endings), Begin::at(&temp.path().join("mine.toml")));
        assert_eq!(save.name, "mine.toml");
        assert_eq!(enter(&mut save), None);
        assert_eq!(save.replaces, Some((temp.path().join("mine.toml"), Vec::new())), "it asks");
        save.name = "new".to_owned();
        assert_eq!(enter(&mut save), at("new.toml"));

        // Of a series it is its own files that count, not the one that would be a single photograph.
        let begin = Begin::at(&temp.path().join("a.jpg"));
        let mut series = Chooser::new("Write", Seeks::NewSeries(&["jpg", "png"]), begin);
        std::fs::write(temp.path().join("a.jpg"), "").unwrap();
        assert_eq!(enter(&mut series), at("a.jpg"));
        std::fs::write(temp.path().join("a-2.jpg"), "").unwrap();
        let there = vec![temp.path().join("a-2.jpg")];
        assert_eq!((enter(&mut series), &series.replaces), (None, &Some((temp.path().join("a.jpg"), there))));
    }
}
