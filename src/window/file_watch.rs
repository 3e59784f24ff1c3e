//! Watches open files for changes on disk by other programs. A thread polls them, so that a disk
//! that does not respond does not block the window. A file is stamped before it is read, so that no
//! change in between is missed.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Sender, channel};
use std::time::{Duration, Instant, SystemTime};

use super::task::BackgroundTask;

/// Interval between two polls.
const POLL_INTERVAL: Duration = Duration::from_secs(2);

/// Modification time and length of a file; `None` if it does not exist.
pub type Stamp = Option<(SystemTime, u64)>;

/// Reads the stamp from disk; may block.
pub fn stamp(path: &Path) -> Stamp {
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
#[derive(Debug)]
pub struct FileWatch {
    requests: Sender<Vec<PathBuf>>,
    stamps: BackgroundTask<Vec<(PathBuf, Stamp)>>,
    recorded: BTreeMap<PathBuf, Stamp>,
    /// Missing files, each with its last stamp.
    missing: BTreeMap<PathBuf, Stamp>,
    /// A missing file has appeared or changed.
    has_returned: bool,
    /// Changes that are not resolved.
    changes: BTreeMap<PathBuf, Change>,
    last_request: Option<Instant>,
    is_pending: bool,
    /// The pending poll began before a file was read or written: its result is dropped.
    is_stale: bool,
    /// Message of a panic of the thread.
    failure: Option<String>,
}

impl FileWatch {
    /// `wake` is called from the thread after each poll.
    pub fn begin(wake: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        let (requests, received) = channel::<Vec<PathBuf>>();
        let stamps = BackgroundTask::stream("watch", wake, move |output| {
            for paths in received {
                if !output.send(paths.into_iter().map(|path| (stamp(&path), path)).map(|(s, p)| (p, s)).collect()) {
                    return;
                }
            }
        })?;
        Ok(Self {
            requests,
            stamps,
            recorded: BTreeMap::new(),
            missing: BTreeMap::new(),
            has_returned: false,
            changes: BTreeMap::new(),
            last_request: None,
            is_pending: false,
            is_stale: false,
            failure: None,
        })
    }

    /// Records the stamp of a file: from before it was read, or from after it was written.
    pub fn record(&mut self, path: &Path, stamp: Stamp) {
        self.recorded.insert(path.to_owned(), stamp);
        self.changes.remove(path);
        self.is_stale = self.is_pending;
    }

    /// Stops watching all files.
    pub fn forget(&mut self) {
        self.recorded.clear();
        self.changes.clear();
        self.missing.clear();
        self.has_returned = false;
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

    /// Why the files are no longer watched, once.
    pub fn take_failure(&mut self) -> Option<String> {
        self.failure.take()
    }

    /// The unresolved change of a file.
    pub fn change(&self, path: &Path) -> Option<Change> {
        self.changes.get(path).copied()
    }

    /// Takes results and starts a poll when due. Returns the time until the next call is useful.
    pub fn poll(&mut self, now: Instant) -> Duration {
        while let Some(taken) = self.stamps.take() {
            let stamps = match taken {
                Ok(stamps) => stamps,
                Err(why) => {
                    self.failure = Some(why);
                    break;
                }
            };
            self.is_pending = false;
            if std::mem::take(&mut self.is_stale) {
                continue;
            }
            for (path, stamp) in stamps {
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
        let since = self.last_request.map_or(POLL_INTERVAL, |last| now.saturating_duration_since(last));
        if since < POLL_INTERVAL || self.is_pending || (self.recorded.is_empty() && self.missing.is_empty()) {
            return POLL_INTERVAL.saturating_sub(since).max(Duration::from_millis(100));
        }
        self.last_request = Some(now);
        let paths = self.recorded.keys().chain(self.missing.keys()).cloned().collect();
        self.is_pending = self.requests.send(paths).is_ok();
        POLL_INTERVAL
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn external_change_is_reported_until_it_is_resolved() {
        let temp = tempfile::tempdir().unwrap();
        let path = temp.path().join("p.toml");
        std::fs::write(&path, "version = 1\n").unwrap();
        let (woken, wakes) = channel();
        let mut watch = FileWatch::begin(move || _ = woken.send(())).unwrap();
        watch.record(&path, stamp(&path));
        let mut now = Instant::now();
        let mut poll = |watch: &mut FileWatch| {
            now += POLL_INTERVAL;
            watch.poll(now);
            wakes.recv().unwrap();
            // Takes the result; the next poll is not due.
            watch.poll(now);
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
        let mut watch = FileWatch::begin(move || _ = woken.send(())).unwrap();
        let mut now = Instant::now();
        let mut poll = |watch: &mut FileWatch| {
            watch.expect(std::slice::from_ref(&path));
            now += POLL_INTERVAL;
            watch.poll(now);
            wakes.recv().unwrap();
            watch.poll(now);
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
