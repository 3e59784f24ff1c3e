//! Whether files that are open have been changed on disk by somebody else. They are looked at on a thread: a disk that
//! does not answer does not hold the window up. What is read is looked at before, so that no change slips in between.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant, SystemTime};

const EVERY: Duration = Duration::from_secs(2);

/// What tells a changed file: its time and its length; `None` where there is none.
pub type Stamp = Option<(SystemTime, u64)>;

/// Asks the disk, which may take its time.
pub fn stamp(path: &Path) -> Stamp {
    let there = std::fs::metadata(path).ok()?;
    Some((there.modified().ok()?, if there.is_file() { there.len() } else { 0 }))
}

/// What became of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    Changed,
    Gone,
}

/// Watches a few files.
#[derive(Debug)]
pub struct Watch {
    ask: Sender<Vec<PathBuf>>,
    seen: Receiver<Vec<(PathBuf, Stamp)>>,
    known: BTreeMap<PathBuf, Stamp>,
    /// Missing files, each with its stamp of the last look.
    missing: BTreeMap<PathBuf, Stamp>,
    /// Whether a missing file has appeared or changed.
    has_returned: bool,
    /// What was found and not dealt with.
    changes: BTreeMap<PathBuf, Change>,
    asked: Option<Instant>,
    awaits: bool,
    /// What is awaited was begun before a file was read or written.
    is_stale: bool,
}

impl Watch {
    /// `wake` is called from the thread when something is known.
    pub fn begin(wake: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        let (ask, asked) = channel::<Vec<PathBuf>>();
        let (tell, seen) = channel();
        std::thread::Builder::new().name("watch".to_owned()).spawn(move || {
            for paths in asked {
                let stamps: Vec<_> = paths.into_iter().map(|path| (stamp(&path), path)).map(|(s, p)| (p, s)).collect();
                if tell.send(stamps).is_err() {
                    return;
                }
                wake();
            }
        })?;
        Ok(Self {
            ask,
            seen,
            known: BTreeMap::new(),
            missing: BTreeMap::new(),
            has_returned: false,
            changes: BTreeMap::new(),
            asked: None,
            awaits: false,
            is_stale: false,
        })
    }

    /// A file has been read or written, and was like this: before it was read, or after it was written.
    pub fn known(&mut self, path: &Path, stamp: Stamp) {
        self.known.insert(path.to_owned(), stamp);
        self.changes.remove(path);
        self.is_stale = self.awaits;
    }

    /// Nothing is watched any more.
    pub fn forget(&mut self) {
        self.known.clear();
        self.changes.clear();
        self.missing.clear();
        self.has_returned = false;
    }

    /// Watches the files that are missing now, and no longer those that were missing before.
    pub fn expect(&mut self, missing: &[PathBuf]) {
        self.missing.retain(|path, _| missing.contains(path));
        for path in missing {
            if !self.missing.contains_key(path) {
                self.missing.insert(path.clone(), None);
            }
        }
    }

    /// Whether a missing file has appeared or changed since the last call.
    pub fn take_returned(&mut self) -> bool {
        std::mem::take(&mut self.has_returned)
    }

    /// What became of a file, as far as it is known and not dealt with.
    pub fn change(&self, path: &Path) -> Option<Change> {
        self.changes.get(path).copied()
    }

    /// Looks now and then. Gives how long until it looks again.
    pub fn look(&mut self, now: Instant) -> Duration {
        for stamps in self.seen.try_iter() {
            self.awaits = false;
            if std::mem::take(&mut self.is_stale) {
                continue;
            }
            for (path, stamp) in stamps {
                if let Some(last) = self.missing.get_mut(&path) {
                    self.has_returned |= stamp.is_some() && *last != stamp;
                    *last = stamp;
                }
                match (self.known.get(&path), stamp) {
                    (Some(Some(_)), None) => _ = self.changes.insert(path, Change::Gone),
                    (Some(known), Some(_)) if *known != stamp => _ = self.changes.insert(path, Change::Changed),
                    (Some(_), _) => _ = self.changes.remove(&path),
                    (None, _) => {}
                }
            }
        }
        let since = self.asked.map_or(EVERY, |asked| now.saturating_duration_since(asked));
        if since < EVERY || self.awaits || (self.known.is_empty() && self.missing.is_empty()) {
            return EVERY.saturating_sub(since).max(Duration::from_millis(100));
        }
        self.asked = Some(now);
        let paths = self.known.keys().chain(self.missing.keys()).cloned().collect();
        self.awaits = self.ask.send(paths).is_ok();
        EVERY
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_somebody_else_changes_is_told_until_it_is_dealt_with() {
        let temp = tempfile::tempdir().unwrap();
        let path = temp.path().join("p.toml");
        std::fs::write(&path, "version = 1\n").unwrap();
        let (woken, wakes) = channel();
        let mut watch = Watch::begin(move || _ = woken.send(())).unwrap();
        watch.known(&path, stamp(&path));
        let mut now = Instant::now();
        let mut look = |watch: &mut Watch| {
            now += EVERY;
            watch.look(now);
            wakes.recv().unwrap();
            // Takes what was seen; it is too early to ask again.
            watch.look(now);
            watch.change(&path)
        };
        assert_eq!(look(&mut watch), None);
        std::fs::write(&path, "version = 1\n# mine\n").unwrap();
        assert_eq!(look(&mut watch), Some(Change::Changed));
        std::fs::remove_file(&path).unwrap();
        assert_eq!(look(&mut watch), Some(Change::Gone));
        std::fs::write(&path, "version = 1\n# saved by us\n").unwrap();
        watch.known(&path, stamp(&path));
        assert_eq!(watch.change(&path), None);
        assert_eq!(look(&mut watch), None);
        // Changed between the look at it and the end of reading it.
        let before = stamp(&path);
        std::fs::write(&path, "version = 1\n# by somebody else, while it was read\n").unwrap();
        watch.known(&path, before);
        assert_eq!(look(&mut watch), Some(Change::Changed));
    }

    #[test]
    fn missing_file_that_is_back_is_reported_once() {
        let temp = tempfile::tempdir().unwrap();
        let path = temp.path().join("knife.glb");
        let (woken, wakes) = channel();
        let mut watch = Watch::begin(move || _ = woken.send(())).unwrap();
        let mut now = Instant::now();
        let mut look = |watch: &mut Watch| {
            watch.expect(std::slice::from_ref(&path));
            now += EVERY;
            watch.look(now);
            wakes.recv().unwrap();
            watch.look(now);
            watch.take_returned()
        };
        assert!(!look(&mut watch));
        std::fs::write(&path, "half").unwrap();
        assert!(look(&mut watch) && !look(&mut watch));
        std::fs::write(&path, "the whole file").unwrap();
        assert!(look(&mut watch), "it was still being copied");
        // Found, and missing again with the same contents.
        let there = std::fs::read(&path).unwrap();
        watch.expect(&[]);
        std::fs::remove_file(&path).unwrap();
        assert!(!look(&mut watch));
        std::fs::write(&path, there).unwrap();
        assert!(look(&mut watch));
    }
}
