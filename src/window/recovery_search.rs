//! Searches for unsaved work of other processes: once before the window is painted, then on a
//! thread. The work of a window that has just been killed stays locked until the system has cleaned
//! up the process, which takes seconds on a loaded machine.

use std::io;
use std::path::PathBuf;
use std::thread::sleep;
use std::time::{Duration, Instant};

use super::autosave::RecoverableWork;
use super::task::BackgroundTask;

/// Duration and interval of the search.
const SEARCH_TIME: Duration = Duration::from_secs(30);
const POLL_INTERVAL: Duration = Duration::from_millis(100);

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
        let found = RecoverableWork::find_in(&folder);
        if !found.is_empty() {
            return Ok(Self::Found(found));
        }
        let task = BackgroundTask::stream("left work", wake, move |output| {
            let started = Instant::now();
            while !output.ticket.is_cancelled() && started.elapsed() < SEARCH_TIME {
                sleep(POLL_INTERVAL);
                let found = RecoverableWork::find_in(&folder);
                if !found.is_empty() {
                    // If the receiver is gone, the work can be found again.
                    output.send(found);
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
    use super::super::autosave::UnsavedWork;
    use super::super::project::Edit;
    use super::*;
    use locard_engine::compositor::Settings;
    use locard_engine::profile::Rig;
    use locard_engine::scene::SceneFile;
    use std::sync::mpsc::channel;

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
        let found_work = search.take().unwrap().unwrap();
        assert!(found_work.len() == 1 && *found_work[0].work == work);
        // Unlocked work is found before the first frame of the window.
        drop(found_work);
        let mut search = RecoverySearch::begin(temp.path().to_owned(), || unreachable!()).unwrap();
        assert_eq!(search.take().unwrap().unwrap().len(), 1);
    }
}
