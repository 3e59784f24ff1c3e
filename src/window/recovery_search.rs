//! Unsaved work of other processes. It is searched for once before the window is painted, then on a
//! thread. The work of a window that has just been killed stays locked until the system has cleaned
//! up the process, which takes seconds on a loaded machine.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::thread::sleep;
use std::time::{Duration, Instant};

use super::session_lock::SessionFiles;
use super::task::BackgroundTask;
use super::unsaved_work::UnsavedWork;
use locard_engine::source::file::{self, MAX_LISTING_BYTES};

/// Age from which the unlocked lock file of a window without unsaved work is removed.
const MAX_LOCK_AGE: Duration = Duration::from_secs(86_400);
/// Duration and interval of the search.
const SEARCH_TIME: Duration = Duration::from_secs(30);
const POLL_INTERVAL: Duration = Duration::from_millis(100);

/// Unsaved work of another process, locked so that no other window offers it too.
#[derive(Debug)]
pub struct RecoverableWork {
    pub work: Box<UnsavedWork>,
    files: SessionFiles,
}

impl RecoverableWork {
    /// Unlocked work in a folder, newest first. Unreadable files are left alone.
    pub fn find_in(folder: &Path) -> Vec<Self> {
        remove_old_locks(folder);
        let entries = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
        let of_work = entries.filter(|path| is_recovery_file(path));
        let mut all: Vec<Self> = of_work
            .filter_map(|path| {
                let files = SessionFiles::adopt(path)?;
                let text = file::read_text(&files.work_file, MAX_LISTING_BYTES).ok();
                match text.and_then(|text| UnsavedWork::parse(&text)) {
                    Some(work) => Some(Self { work: Box::new(work), files }),
                    None => {
                        let _ = fs::remove_file(&files.lock_file);
                        None
                    }
                }
            })
            .collect();
        all.sort_by_key(|left| std::cmp::Reverse(left.work.at_s));
        all
    }

    /// The files with their lock, to continue in them.
    pub fn into_files(self) -> SessionFiles {
        self.files
    }

    /// Deletes the work.
    pub fn discard(self) {
        self.files.remove();
    }
}

/// Files with interrupted writes have hidden names and do not count.
fn is_recovery_file(path: &Path) -> bool {
    let hidden = path.file_name().is_none_or(|name| name.to_string_lossy().starts_with('.'));
    !hidden && path.extension().is_some_and(|e| e == "json")
}

/// Removes old lock files of windows that ended abnormally without unsaved work.
fn remove_old_locks(folder: &Path) {
    for path in fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()) {
        let is_alone = path.extension().is_some_and(|e| e == "lock") && !path.with_extension("json").exists();
        let made = fs::metadata(&path).and_then(|there| there.modified()).ok();
        // A newer one may be about to be locked.
        let is_old = made.and_then(|made| made.elapsed().ok()).is_some_and(|age| age > MAX_LOCK_AGE);
        if is_alone && is_old && File::open(&path).is_ok_and(|lock| lock.try_lock().is_ok()) {
            let _ = fs::remove_file(path);
        }
    }
}

/// A search, which ends with the first result.
#[derive(Debug)]
pub enum RecoverySearch {
    /// Found by the first, synchronous search.
    Found(Vec<RecoverableWork>),
    Running(BackgroundTask<Vec<RecoverableWork>>),
}

impl RecoverySearch {
    /// Searches at once: the first picture of the window keeps the graphics device busy, which
    /// delays everything shown after it. `wake` is called from the thread when it finds something
    /// later.
    pub fn begin(folder: PathBuf, wake: impl Fn() + Send + 'static) -> io::Result<Self> {
        let works = RecoverableWork::find_in(&folder);
        if !works.is_empty() {
            return Ok(Self::Found(works));
        }
        let task = BackgroundTask::stream("find unsaved", wake, move |reporter| {
            let started = Instant::now();
            while !reporter.control.is_cancelled() && started.elapsed() < SEARCH_TIME {
                sleep(POLL_INTERVAL);
                let works = RecoverableWork::find_in(&folder);
                if !works.is_empty() {
                    // If the receiver is gone, the work can be found again.
                    reporter.send(works);
                    return;
                }
            }
        })?;
        Ok(Self::Running(task))
    }

    /// The work that was found, newest first. The error is the message of a panic.
    pub fn take(&mut self) -> Option<Result<Vec<RecoverableWork>, String>> {
        match self {
            Self::Found(found) => Some(Ok(std::mem::take(found))),
            Self::Running(task) => task.take(),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;
    use std::time::SystemTime;

    use super::super::unsaved_work::example as work;
    use super::*;

    #[test]
    fn work_is_found_once_its_lock_is_free() {
        let temp = tempfile::tempdir().unwrap();
        let work = work(1);
        fs::write(temp.path().join("1.json"), serde_json::to_string(&work).unwrap()).unwrap();
        // Like the lock of a window that is still exiting.
        let lock_file = File::create(temp.path().join("1.lock")).unwrap();
        lock_file.try_lock().unwrap();
        let (woken, wakes) = channel();
        let mut search = RecoverySearch::begin(temp.path().to_owned(), move || woken.send(()).unwrap()).unwrap();
        assert!(wakes.recv_timeout(3 * POLL_INTERVAL).is_err() && search.take().is_none());
        drop(lock_file);
        wakes.recv_timeout(SEARCH_TIME).unwrap();
        let found_work = search.take().unwrap().unwrap();
        assert!(found_work.len() == 1 && *found_work[0].work == work);
        // Unlocked work is found before the first frame of the window.
        drop(found_work);
        let mut search = RecoverySearch::begin(temp.path().to_owned(), || unreachable!()).unwrap();
        assert_eq!(search.take().unwrap().unwrap().len(), 1);
    }

    #[test]
    fn discarded_work_is_deleted_and_invalid_files_stay() {
        let temp = tempfile::tempdir().unwrap();
        fs::write(temp.path().join("a.json"), serde_json::to_string(&work(1)).unwrap()).unwrap();
        fs::write(temp.path().join("b.json"), "{\"version\": 1, \"at_s\"").unwrap();
        fs::copy(temp.path().join("a.json"), temp.path().join(".a.partial-x.json")).unwrap();
        let mut works = RecoverableWork::find_in(temp.path());
        assert_eq!(works.len(), 1);
        works.pop().unwrap().discard();
        assert!(temp.path().join("b.json").exists());
        assert_eq!(fs::read_dir(temp.path()).unwrap().count(), 1);
    }

    #[test]
    fn unlocked_lock_files_are_removed_after_a_day() {
        let temp = tempfile::tempdir().unwrap();
        let lock = |name: &str, age: Duration| {
            let file = File::create(temp.path().join(name)).unwrap();
            file.set_modified(SystemTime::now() - age).unwrap();
            file
        };
        drop((lock("old.lock", 2 * MAX_LOCK_AGE), lock("new.lock", Duration::ZERO)));
        let lock_file = lock("held.lock", 2 * MAX_LOCK_AGE);
        lock_file.try_lock().unwrap();
        assert!(RecoverableWork::find_in(temp.path()).is_empty());
        let there = |name: &str| temp.path().join(name).exists();
        assert!(!there("old.lock") && there("new.lock") && there("held.lock"));
    }
}
