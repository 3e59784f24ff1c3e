//! The open document's files on disk, watched for changes by other programs.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use eframe::egui;

use super::super::file_watch::{Change, FileWatch, Stamp};
use super::super::project::Project;

/// The watched files.
#[derive(Debug, Default)]
pub(super) struct WatchedFiles {
    watch: Option<FileWatch>,
    /// Changed files whose open state the user chose to keep.
    ignored: Vec<PathBuf>,
}

impl WatchedFiles {
    /// Starts to watch the open files, with the first call.
    pub(super) fn begin(&mut self, ctx: &egui::Context, project: &Project) {
        if self.watch.is_none() {
            let wake = ctx.clone();
            self.watch = FileWatch::begin(move || wake.request_repaint()).ok();
            self.record(project);
        }
    }

    /// Watches the files of another document.
    pub(super) fn switch_to(&mut self, project: &Project) {
        self.ignored.clear();
        if let Some(watch) = &mut self.watch {
            watch.forget();
        }
        self.record(project);
    }

    /// Records the files as they were read.
    fn record(&mut self, project: &Project) {
        let Some(watch) = &mut self.watch else { return };
        let own = [project.profile.as_ref(), project.scene.as_ref()].into_iter().flatten();
        own.chain([&project.shot().recording.path]).for_each(|path| watch.record(path, project.stamp(path)));
    }

    /// The files were reloaded.
    pub(super) fn reloaded(&mut self, project: &Project) {
        self.ignored.clear();
        self.record(project);
    }

    /// The program itself has written a file.
    pub(super) fn written(&mut self, path: &Path, stamp: Stamp) {
        self.ignored.retain(|ignored| ignored != path);
        if let Some(watch) = &mut self.watch {
            watch.record(path, stamp);
        }
    }

    /// Takes results, and starts a poll when due. Returns the time until the next call is useful.
    pub(super) fn poll(&mut self, now: Instant) -> Option<Duration> {
        self.watch.as_mut().map(|watch| watch.poll(now))
    }

    /// Why the files are no longer watched, once.
    pub(super) fn take_failure(&mut self) -> Option<String> {
        self.watch.as_mut()?.take_failure()
    }

    fn change(&self, path: &Path) -> Option<Change> {
        self.watch.as_ref()?.change(path)
    }

    /// True if a file no longer exists.
    pub(super) fn is_gone(&self, path: &Path) -> bool {
        self.change(path) == Some(Change::Gone)
    }

    /// True if another program has changed a file since it was read or written here.
    pub(super) fn has_changed(&self, path: &Path) -> bool {
        self.change(path) == Some(Change::Changed)
    }

    /// True for a changed file whose open state the user did not choose to keep.
    pub(super) fn is_new_change(&self, path: &Path) -> bool {
        self.has_changed(path) && !self.ignored.iter().any(|ignored| ignored == path)
    }

    /// The profile or scene that another program has changed.
    pub(super) fn changed(&self, project: &Project) -> Option<PathBuf> {
        let files = [&project.profile, &project.scene].into_iter().flatten();
        files.into_iter().find(|path| self.is_new_change(path)).cloned()
    }

    /// Keeps the open state of a changed file.
    pub(super) fn ignore(&mut self, path: PathBuf) {
        self.ignored.push(path);
    }

    /// Replaces the list of missing files to watch.
    pub(super) fn expect(&mut self, missing: &[PathBuf]) {
        if let Some(watch) = &mut self.watch {
            watch.expect(missing);
        }
    }

    /// True if a missing file has appeared or changed since the last call.
    pub(super) fn take_returned(&mut self) -> bool {
        self.watch.as_mut().is_some_and(FileWatch::take_returned)
    }
}
