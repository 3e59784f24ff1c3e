//! Work that was left is looked for before the window is painted, and from then on by a thread: a window that was killed a
//! moment ago holds it until the system has cleared that away, which on a loaded machine takes seconds.

use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::thread::{Builder, sleep};
use std::time::{Duration, Instant};

use super::autosave::Left;

/// How long it is looked for, and how often.
const FOR: Duration = Duration::from_secs(30);
const EVERY: Duration = Duration::from_millis(100);

/// See above. It ends with the first that is found.
#[derive(Debug)]
pub struct Looking {
    /// What was there at once.
    there: Vec<Left>,
    found: Receiver<Vec<Left>>,
    ended: Arc<AtomicBool>,
}

impl Looking {
    /// Looks at once, for the first picture of the window keeps the graphics device busy, and with it whatever is to be shown
    /// after it. `wake` is called from the thread when there is something later.
    pub fn begin(folder: PathBuf, wake: impl FnOnce() + Send + 'static) -> io::Result<Self> {
        let ((tell, found), ended) = (channel(), Arc::new(AtomicBool::new(false)));
        let there = Left::found(&folder);
        if !there.is_empty() {
            return Ok(Self { there, found, ended });
        }
        let ends = Arc::clone(&ended);
        Builder::new().name("left work".to_owned()).spawn(move || {
            let begun = Instant::now();
            while !ends.load(Ordering::Acquire) && begun.elapsed() < FOR {
                sleep(EVERY);
                let left = Left::found(&folder);
                if !left.is_empty() {
                    // If nobody wants it any more, it can be found again.
                    let _ = tell.send(left);
                    return wake();
                }
            }
        })?;
        Ok(Self { there, found, ended })
    }

    /// What was found, the newest first.
    pub fn take(&mut self) -> Option<Vec<Left>> {
        match self.there.is_empty() {
            true => self.found.try_recv().ok(),
            false => Some(std::mem::take(&mut self.there)),
        }
    }
}

impl Drop for Looking {
    fn drop(&mut self) {
        self.ended.store(true, Ordering::Release);
    }
}

#[cfg(test)]
mod tests {
    use super::super::autosave::Work;
    use super::super::project::Edit;
    use super::*;
    use locard_engine::compositor::Settings;
    use locard_engine::profile::Rig;
    use locard_engine::scene::SceneFile;

    #[test]
    fn work_is_found_as_soon_as_nobody_holds_it() {
        let temp = tempfile::tempdir().unwrap();
        let edit = Edit {
            rig: Rig::default(),
            settings: Settings::default(),
            scene: SceneFile::default(),
            other: None,
            unpinned: Default::default(),
        };
        let work = Work::new(std::path::Path::new("recordings/demo"), 1.0, None, None, edit);
        std::fs::write(temp.path().join("1.json"), serde_json::to_string(&work).unwrap()).unwrap();
        // As by a window that is still ending.
        let held = std::fs::File::create(temp.path().join("1.lock")).unwrap();
        held.try_lock().unwrap();
        let (woken, wakes) = channel();
        let mut looking = Looking::begin(temp.path().to_owned(), move || woken.send(()).unwrap()).unwrap();
        assert!(wakes.recv_timeout(3 * EVERY).is_err() && looking.take().is_none());
        drop(held);
        wakes.recv_timeout(FOR).unwrap();
        let left = looking.take().unwrap();
        assert!(left.len() == 1 && *left[0].work == work);
        // What nobody holds is there from the first frame of the window on.
        drop(left);
        let mut looking = Looking::begin(temp.path().to_owned(), || unreachable!()).unwrap();
        assert!(looking.take().is_some_and(|left| left.len() == 1));
    }
}
