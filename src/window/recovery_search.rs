//! Searches for unsaved work of other processes: once before the window is painted, then on a
//! thread. The work of a window that has just been killed stays locked until the system has cleaned
//! up the process, which takes seconds on a loaded machine.

use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::thread::{Builder, sleep};
use std::time::{Duration, Instant};

use super::autosave::RecoverableWork;

/// Duration and interval of the search.
const SEARCH_TIME: Duration = Duration::from_secs(30);
const POLL_INTERVAL: Duration = Duration::from_millis(100);

/// A search, which ends with the first result.
#[derive(Debug)]
pub struct RecoverySearch {
    /// Found by the first, synchronous search.
    found_at_once: Vec<RecoverableWork>,
    found: Receiver<Vec<RecoverableWork>>,
    is_cancelled: Arc<AtomicBool>,
}

impl RecoverySearch {
    /// Searches at once: the first picture of the window keeps the graphics device busy, which
    /// delays everything shown after it. `wake` is called from the thread when it finds something
    /// later.
    pub fn begin(folder: PathBuf, wake: impl FnOnce() + Send + 'static) -> io::Result<Self> {
        let ((sender, found), is_cancelled) = (channel(), Arc::new(AtomicBool::new(false)));
        let found_at_once = RecoverableWork::find_in(&folder);
        if !found_at_once.is_empty() {
            return Ok(Self { found_at_once, found, is_cancelled });
        }
        let cancelled = Arc::clone(&is_cancelled);
        Builder::new().name("left work".to_owned()).spawn(move || {
            let started = Instant::now();
            while !cancelled.load(Ordering::Acquire) && started.elapsed() < SEARCH_TIME {
                sleep(POLL_INTERVAL);
                let found_work = RecoverableWork::find_in(&folder);
                if !found_work.is_empty() {
                    // If the receiver is gone, the work can be found again.
                    let _ = sender.send(found_work);
                    return wake();
                }
            }
        })?;
        Ok(Self { found_at_once, found, is_cancelled })
    }

    /// The work that was found, newest first.
    pub fn take(&mut self) -> Option<Vec<RecoverableWork>> {
        if self.found_at_once.is_empty() {
            self.found.try_recv().ok()
        } else {
            Some(std::mem::take(&mut self.found_at_once))
        }
    }
}

impl Drop for RecoverySearch {
    fn drop(&mut self) {
        self.is_cancelled.store(true, Ordering::Release);
    }
}

#[cfg(test)]
mod tests {
    use super::super::autosave::UnsavedWork;
    use super::super::project::Edit;
    use super::*;
    use locard_engine::compositor::Settings;
    use locard_engine::profile::Rig;
    use locard_engine::scene::SceneFile;

    #[test]
    fn work_is_found_once_its_lock_is_free() {
        let temp = tempfile::tempdir().unwrap();
        let edit = Edit {
            rig: Rig::default(),
            settings: Settings::default(),
            scene: SceneFile::default(),
            other: None,
            unpinned: Default::default(),
        };
        let work = UnsavedWork::new(std::path::Path::new("recordings/demo"), 1.0, None, None, edit);
        std::fs::write(temp.path().join("1.json"), serde_json::to_string(&work).unwrap()).unwrap();
        // Like the lock of a window that is still exiting.
        let held = std::fs::File::create(temp.path().join("1.lock")).unwrap();
        held.try_lock().unwrap();
        let (woken, wakes) = channel();
        let mut search = RecoverySearch::begin(temp.path().to_owned(), move || woken.send(()).unwrap()).unwrap();
        assert!(wakes.recv_timeout(3 * POLL_INTERVAL).is_err() && search.take().is_none());
        drop(held);
        wakes.recv_timeout(SEARCH_TIME).unwrap();
        let found_work = search.take().unwrap();
        assert!(found_work.len() == 1 && *found_work[0].work == work);
        // Unlocked work is found before the first frame of the window.
        drop(found_work);
        let mut search = RecoverySearch::begin(temp.path().to_owned(), || unreachable!()).unwrap();
        assert!(search.take().is_some_and(|found_work| found_work.len() == 1));
    }
}
