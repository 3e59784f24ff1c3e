//! Watches open files for changes on disk by other programs. A thread polls them, so that a disk
//! that does not respond does not block the window. A file is stamped before it is read, so that no
//! change in between is missed.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use super::task::BackgroundTask;

/// Interval between two polls.
const POLL_INTERVAL: Duration = Duration::from_secs(2);

/// Modification time and length of a file; `None` if it does not exist.
pub type WatchStamp = Option<(SystemTime, u64)>;

/// Reads the stamp from disk; may block.
pub fn stamp(path: &Path) -> WatchStamp {
    let there = std::fs::metadata(path).ok()?;
    Some((there.modified().ok()?, if there.is_file() { there.len() } else { 0 }))
}

/// Change of a file on disk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    Changed,
    Gone,
}

/// Watches a few files.
#[derive(Debug, Default)]
pub struct FileWatch {
    recorded: BTreeMap<PathBuf, WatchStamp>,
    /// Missing files, each with its last stamp.
    missing: BTreeMap<PathBuf, WatchStamp>,
    /// A missing file has appeared or changed.
    has_returned: bool,
    /// Changes that are not resolved.
    changes: BTreeMap<PathBuf, Change>,
    /// Changed files whose open state the user chose to keep.
    ignored: Vec<PathBuf>,
    last_request: Option<Instant>,
    /// The poll in progress.
    stamps: Option<BackgroundTask<Vec<(PathBuf, WatchStamp)>>>,
    /// The poll began before a file was read or written: its result is dropped.
    is_stale: bool,
}

impl FileWatch {
    /// True if no file was recorded yet.
    pub fn is_empty(&self) -> bool {
        self.recorded.is_empty()
    }

    /// Records the stamp of a file: from before it was read, or from after it was written.
    pub fn record(&mut self, path: &Path, stamp: WatchStamp) {
        self.recorded.insert(path.to_owned(), stamp);
        self.changes.remove(path);
        self.ignored.retain(|ignored| ignored != path);
        self.is_stale = self.stamps.is_some();
    }

    /// Stops watching all files.
    pub fn forget(&mut self) {
        self.recorded.clear();
        self.changes.clear();
        self.ignored.clear();
        self.missing.clear();
        self.has_returned = false;
    }

    /// Keeps the open state of a changed file.
    pub fn ignore(&mut self, path: PathBuf) {
        self.ignored.push(path);
    }

    /// True for a changed file whose open state the user did not choose to keep.
    pub fn is_new_change(&self, path: &Path) -> bool {
        self.change(path) == Some(Change::Changed) && !self.ignored.iter().any(|ignored| ignored == path)
    }

    /// Replaces the list of missing files to watch.
    pub fn expect(&mut self, missing: &[PathBuf]) {
        self.missing.retain(|path, _| missing.contains(path));
        for path in missing {
            if !self.missing.contains_key(path) {
                self.missing.insert(path.clone(), None);
            }
        }
    }

    /// True if a missing file has appeared or changed since the last call.
    pub fn take_returned(&mut self) -> bool {
        std::mem::take(&mut self.has_returned)
    }

    /// The unresolved change of a file.
    pub fn change(&self, path: &Path) -> Option<Change> {
        self.changes.get(path).copied()
    }

    /// Takes results and starts a poll when due. Returns the time until the next call is useful.
    /// `wake` is called from a thread after the poll. The error is the message of a panic.
    pub fn poll(&mut self, now: Instant, wake: impl FnOnce() + Send + 'static) -> Result<Duration, String> {
        if let Some(stamps) = self.stamps.as_ref().and_then(BackgroundTask::take) {
            self.stamps = None;
            let is_stale = std::mem::take(&mut self.is_stale);
            stamps?.into_iter().filter(|_| !is_stale).for_each(|(path, stamp)| self.compare(path, stamp));
        }
        let since = self.last_request.map_or(POLL_INTERVAL, |last| now.saturating_duration_since(last));
        if since < POLL_INTERVAL || self.stamps.is_some() || (self.recorded.is_empty() && self.missing.is_empty()) {
            return Ok(POLL_INTERVAL.saturating_sub(since).max(Duration::from_millis(100)));
        }
        self.last_request = Some(now);
        let paths: Vec<PathBuf> = self.recorded.keys().chain(self.missing.keys()).cloned().collect();
        let read = move || paths.into_iter().map(|path| (stamp(&path), path)).map(|(s, p)| (p, s)).collect();
        self.stamps = BackgroundTask::spawn("watch", wake, read).ok();
        Ok(POLL_INTERVAL)
    }

    /// Compares a file on disk with its record.
    fn compare(&mut self, path: PathBuf, stamp: WatchStamp) {
        if let Some(last) = self.missing.get_mut(&path) {
            self.has_returned |= stamp.is_some() && *last != stamp;
            *last = stamp;
        }
        match (self.recorded.get(&path), stamp) {
            (Some(Some(_)), None) => _ = self.changes.insert(path, Change::Gone),
            (Some(record), Some(_)) if *record != stamp => _ = self.changes.insert(path, Change::Changed),
            (Some(_), _) => _ = self.changes.remove(&path),
            (None, _) => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::channel;

    #[test]
    fn external_change_is_reported_until_it_is_resolved() {
        let temp = tempfile::tempdir().unwrap();
        let path = temp.path().join("p.toml");
        std::fs::write(&path, "version = 1\n").unwrap();
        let (woken, wakes) = channel();
        let mut watch = FileWatch::default();
        let wake = move || {
            let woken = woken.clone();
            move || _ = woken.send(())
        };
        watch.record(&path, stamp(&path));
        let mut now = Instant::now();
        let mut poll = |watch: &mut FileWatch| {
            now += POLL_INTERVAL;
            watch.poll(now, wake()).unwrap();
            wakes.recv().unwrap();
            // Takes the result; the next poll is not due.
            watch.poll(now, wake()).unwrap();
            watch.change(&path)
        };
        assert_eq!(poll(&mut watch), None);
        std::fs::write(&path, "version = 1\n# mine\n").unwrap();
        assert_eq!(poll(&mut watch), Some(Change::Changed));
        std::fs::remove_file(&path).unwrap();
        assert_eq!(poll(&mut watch), Some(Change::Gone));
        std::fs::write(&path, "version = 1\n# saved by us\n").unwrap();
        watch.record(&path, stamp(&path));
        assert_eq!(watch.change(&path), None);
        assert_eq!(poll(&mut watch), None);
        // Changed between its stamp and the end of reading.
        let before = stamp(&path);
        std::fs::write(&path, "version = 1\n# by somebody else, while it was read\n").unwrap();
        watch.record(&path, before);
        assert_eq!(poll(&mut watch), Some(Change::Changed));
    }

    #[test]
    fn missing_file_that_is_back_is_reported_once() {
        let temp = tempfile::tempdir().unwrap();
        let path = temp.path().join("knife.glb");
        let (woken, wakes) = channel();
        let mut watch = FileWatch::default();
        let wake = move || {
            let woken = woken.clone();
            move || _ = woken.send(())
        };
        let mut now = Instant::now();
        let mut poll = |watch: &mut FileWatch| {
            watch.expect(std::slice::from_ref(&path));
            now += POLL_INTERVAL;
            watch.poll(now, wake()).unwrap();
            wakes.recv().unwrap();
            watch.poll(now, wake()).unwrap();
            watch.take_returned()
        };
        assert!(!poll(&mut watch));
        std::fs::write(&path, "half").unwrap();
        assert!(poll(&mut watch) && !poll(&mut watch));
        std::fs::write(&path, "the whole file").unwrap();
        assert!(poll(&mut watch), "it was still being copied");
        // Back, and missing again with the same contents.
        let there = std::fs::read(&path).unwrap();
        watch.expect(&[]);
        std::fs::remove_file(&path).unwrap();
        assert!(!poll(&mut watch));
        std::fs::write(&path, there).unwrap();
        assert!(poll(&mut watch));
    }
}
