//! Work that was left is looked for on a thread, and offered as soon as it can be had: a window that was killed a moment ago
//! holds it until the system has cleared that away, which on a loaded machine takes seconds.

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
    found: Receiver<Vec<Left>>,
    ended: Arc<AtomicBool>,
}

impl Looking {
    /// `wake` is called from the thread when there is something.
    pub fn begin(folder: PathBuf, wake: impl FnOnce() + Send + 'static) -> io::Result<Self> {
        let ((tell, found), ended) = (channel(), Arc::new(AtomicBool::new(false)));
        let ends = Arc::clone(&ended);
        Builder::new().name("left work".to_owned()).spawn(move || {
            let begun = Instant::now();
            while !ends.load(Ordering::Acquire) && begun.elapsed() < FOR {
                let left = Left::found(&folder);
                if !left.is_empty() {
                    // If nobody wants it any more, it can be found again.
                    let _ = tell.send(left);
                    return wake();
                }
                sleep(EVERY);
            }
        })?;
        Ok(Self { found, ended })
    }

    /// What was found, the newest first.
    pub fn take(&self) -> Option<Vec<Left>> {
        self.found.try_recv().ok()
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
    use crate::compositor::Settings;
    use crate::profile::Rig;
    use crate::scene::SceneFile;

    #[test]
    fn work_is_found_as_soon_as_nobody_holds_it() {
        let temp = tempfile::tempdir().unwrap();
        let edit =
            Edit { rig: Rig::default(), settings: Settings::default(), scene: SceneFile::default(), other: None };
        let work = Work::new(std::path::Path::new("recordings/demo"), 1.0, None, None, edit);
        std::fs::write(temp.path().join("1.json"), serde_json::to_string(&work).unwrap()).unwrap();
        // As by a window that is still ending.
        let held = std::fs::File::create(temp.path().join("1.lock")).unwrap();
        held.try_lock().unwrap();
        let (woken, wakes) = channel();
        let looking = Looking::begin(temp.path().to_owned(), move || woken.send(()).unwrap()).unwrap();
        assert!(wakes.recv_timeout(3 * EVERY).is_err() && looking.take().is_none());
        drop(held);
        wakes.recv_timeout(FOR).unwrap();
        let left = looking.take().unwrap();
        assert!(left.len() == 1 && *left[0].work == work);
    }
}
