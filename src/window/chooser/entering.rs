//! Checks an entered name or path on disk.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use eframe::egui::Context;

use super::super::task::BackgroundTask;
use super::Chooser;
use super::disk::{ChooserResult, EnteredPath, EntryOutcome};
use locard_engine::text::reason;

/// An entry that is being checked.
#[derive(Debug)]
pub struct PendingEntry {
    outcome: BackgroundTask<EntryOutcome>,
    since: Instant,
    /// Text of the field at the time of the entry. Text typed since then applies to the result.
    name: String,
    /// The text typed since then was entered too.
    was_entered_again: bool,
}

/// Delay after which a message reports a slow disk.
const SLOW_DISK: Duration = Duration::from_millis(300);

impl PendingEntry {
    pub fn is_slow(&self) -> bool {
        self.since.elapsed() >= SLOW_DISK
    }
}

impl Chooser {
    /// Starts checking an entry.
    pub(super) fn start_entry(&mut self, ctx: &Context, check: impl FnOnce() -> EntryOutcome + Send + 'static) {
        let wake = ctx.clone();
        match BackgroundTask::spawn("chooser", move || wake.request_repaint(), check) {
            Ok(outcome) => {
                let (since, name) = (Instant::now(), self.name.clone());
                self.pending_entry = Some(PendingEntry { outcome, since, name, was_entered_again: false });
            }
            Err(error) => self.message = Some(reason(&error)),
        }
    }

    /// Handles the result of the check.
    pub(super) fn poll_entry(&mut self, ctx: &Context) -> Option<ChooserResult> {
        let pending = self.pending_entry.as_ref()?;
        let Some(outcome) = pending.outcome.take() else {
            ctx.request_repaint_after(SLOW_DISK.saturating_sub(pending.since.elapsed()));
            return None;
        };
        let PendingEntry { name, was_entered_again, .. } = self.pending_entry.take()?;
        let typed = (self.name != name).then(|| self.name.clone());
        let chosen = self.apply_outcome(outcome.unwrap_or_else(EntryOutcome::Rejected));
        if let Some(typed) = typed {
            (self.name, self.is_typed, self.wants_focus) = (typed, true, false);
            if was_entered_again {
                self.enter(ctx);
            }
        }
        chosen
    }

    fn apply_outcome(&mut self, outcome: EntryOutcome) -> Option<ChooserResult> {
        match outcome {
            EntryOutcome::Path(path) => return Some(ChooserResult::new_path(path)),
            EntryOutcome::Folder(folder) => {
                // A proposed file name is kept when the user enters a folder that was created for
                // it.
                if self.new_folder.is_none() {
                    self.name.clear();
                }
                self.show_folder(folder);
            }
            EntryOutcome::ConfirmReplace { path, existing } => self.replace_candidate = Some((path, existing)),
            EntryOutcome::Rejected(why) => self.message = Some(why),
        }
        None
    }

    pub(super) fn enter(&mut self, ctx: &Context) {
        match &mut self.pending_entry {
            Some(pending) => pending.was_entered_again = self.name != pending.name,
            None => {
                self.message = None;
                let entry = self.typed_entry();
                self.start_entry(ctx, move || entry.check());
            }
        }
    }

    /// Enters an item of the list.
    pub(super) fn enter_path(&mut self, ctx: &Context, path: PathBuf) {
        let entry = EnteredPath { path: Some(path), only: None, ..self.typed_entry() };
        self.start_entry(ctx, move || entry.check());
    }

    /// The typed path, or the only list item that matches it.
    fn typed_entry(&self) -> EnteredPath {
        let (typed, (folder, filter)) = (self.name.trim(), self.displayed_folder());
        let filter = if self.is_typed { filter } else { typed.to_lowercase() };
        let listed = self.listing.iter().filter(|listing| listing.folder == folder);
        let entries = listed.flat_map(|listing| listing.entries.iter().flatten());
        let mut matches = entries.filter(|entry| entry.name.to_lowercase().contains(&filter));
        let only = matches.next().map(|entry| folder.join(&entry.name)).filter(|_| matches.next().is_none());
        let path = (!typed.is_empty()).then(|| self.resolve(typed));
        EnteredPath { mode: self.mode, folder: self.folder.clone(), path, only }
    }
}

#[cfg(test)]
mod tests {
    use super::super::disk::StartLocation;
    use super::super::listing::{ChooserMode, Listing};
    use super::*;

    #[test]
    fn typed_text_is_a_name_a_path_or_a_filter() {
        let temp = tempfile::tempdir().unwrap();
        std::fs::create_dir(temp.path().join("in")).unwrap();
        for file in ["mine.toml", "other.toml"] {
            std::fs::write(temp.path().join(file), "").unwrap();
        }
        let endings: &[&str] = &["toml"];
        let mut open =
            Chooser::new("Open", ChooserMode::File(endings), StartLocation::within([temp.path().to_owned()]));
        let enter = |chooser: &mut Chooser| {
            let outcome = chooser.typed_entry().check();
            chooser.apply_outcome(outcome)
        };
        let mut type_in = |text: &str| {
            (open.name, open.is_typed) = (text.to_owned(), true);
            let (folder, _) = open.displayed_folder();
            open.listing = Some(Listing::of(folder, open.mode));
            (enter(&mut open), open.folder.clone())
        };
        let (here, within) = (temp.path().to_owned(), temp.path().join("in"));
        let at = |name: &str| Some(ChooserResult::new_path(temp.path().join(name)));
        let full_path = |name: &str| temp.path().join(name).display().to_string();
        assert_eq!(type_in("mine.toml"), (at("mine.toml"), here.clone()));
        assert_eq!(type_in("oth").0, at("other.toml"));
        assert_eq!(type_in(&full_path("mine.toml")).0, at("mine.toml"));
        assert_eq!(type_in(&full_path("oth")).0, at("other.toml"), "a part of a name in another folder");
        assert_eq!([type_in("nothing").0, type_in("toml").0, type_in("").0], [None, None, None]);
        assert_eq!(type_in("in"), (None, within.clone()));
        assert_eq!(type_in("../mine.toml").0, Some(ChooserResult::new_path(within.join("../mine.toml"))));
        assert_eq!(type_in(&full_path("")), (None, PathBuf::from(full_path(""))));
        assert!(open.message.is_none() && open.wants_focus && open.name.is_empty());
        (open.name, open.is_typed) = ("nothing".to_owned(), true);
        assert!(enter(&mut open).is_none() && open.message.is_some());

        let mut save =
            Chooser::new("Save", ChooserMode::NewFile(endings), StartLocation::at(&temp.path().join("mine.toml")));
        assert_eq!(save.name, "mine.toml");
        assert_eq!(enter(&mut save), None);
        assert_eq!(save.replace_candidate, Some((temp.path().join("mine.toml"), Vec::new())), "it asks");
        save.name = "new".to_owned();
        assert_eq!(enter(&mut save), at("new.toml"));

        // For a series, its own files are checked, not the file of a single photograph.
        let begin = StartLocation::at(&temp.path().join("a.jpg"));
        let mut series = Chooser::new("Write", ChooserMode::NewSeries(&["jpg", "png"]), begin);
        std::fs::write(temp.path().join("a.jpg"), "").unwrap();
        assert_eq!(enter(&mut series), at("a.jpg"));
        std::fs::write(temp.path().join("a-2.jpg"), "").unwrap();
        let existing = vec![temp.path().join("a-2.jpg")];
        assert_eq!(
            (enter(&mut series), &series.replace_candidate),
            (None, &Some((temp.path().join("a.jpg"), existing)))
        );
    }
}
