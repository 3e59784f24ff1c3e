//! Writes unsaved work into a recovery file as soon as an edit is complete. After a crash, the next
//! start offers to recover it.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Sender, channel};
use std::time::{Duration, Instant};

use super::recovery_search::RecoverableWork;
use super::session_lock::SessionFiles;
use super::task::BackgroundTask;
use super::unsaved_work::UnsavedWork;
use locard_engine::sink::atomic::write_atomically;
use locard_engine::source::file::MAX_LISTING_BYTES;

/// A change is written once nothing more has changed for this time.
const DEBOUNCE: Duration = Duration::from_millis(250);
/// Longest delay while changes continue, except during a drag.
const MAX_WRITE_DELAY: Duration = Duration::from_secs(2);

/// An unwritten change: its version, the time of the last change, and the time of the first one.
#[derive(Clone, Copy, Debug)]
struct PendingChange {
    version: u64,
    last_change: Instant,
    first_change: Instant,
}

enum WriteRequest {
    Write(PathBuf, Box<UnsavedWork>),
    Remove(PathBuf),
}

impl WriteRequest {
    fn run(self) -> Result<(), String> {
        match self {
            Self::Write(path, mut work) => {
                let text = work.write_json(MAX_LISTING_BYTES).map_err(|error| error.to_string())?;
                let write = |file: &mut io::BufWriter<&mut File>| file.write_all(text.as_bytes());
                write_atomically(&path, true, write).map_err(|error| error.to_string())
            }
            Self::Remove(path) => {
                let _ = fs::remove_file(path);
                Ok(())
            }
        }
    }
}

/// Autosave of a window. An orderly drop removes its files; after a panic they remain.
#[derive(Debug)]
pub struct Autosave {
    files: SessionFiles,
    requests: Option<Sender<WriteRequest>>,
    /// Writing thread; its values are errors.
    task: Option<BackgroundTask<String>>,
    /// Version of the project that was last passed to the thread.
    queued_version: Option<u64>,
    pending: Option<PendingChange>,
    keeps_files: bool,
    writes_at_once: bool,
}

impl Autosave {
    pub fn begin(folder: &Path) -> io::Result<Self> {
        let files = SessionFiles::create(folder)?;
        let (requests, incoming) = channel::<WriteRequest>();
        let task = BackgroundTask::stream(
            "autosave",
            || (),
            move |output| {
                for request in incoming {
                    if let Err(reason) = request.run() {
                        output.send(format!("Autosave is off: {reason}"));
                    }
                }
            },
        )?;
        Ok(Self {
            files,
            requests: Some(requests),
            task: Some(task.joined()),
            queued_version: None,
            pending: None,
            keeps_files: false,
            writes_at_once: false,
        })
    }

    /// Continues in the files of the recovered work, so that it is not lost before the next write.
    pub fn adopt(&mut self, left: RecoverableWork) {
        let own = std::mem::replace(&mut self.files, left.into_files());
        own.remove();
        (self.queued_version, self.pending) = (None, None);
    }

    /// Makes the next [`Autosave::update`] write a change at once: a drag has ended.
    pub fn write_next_at_once(&mut self) {
        self.writes_at_once = true;
    }

    /// Queues the work for writing if it has changed and the delay has passed. `version` identifies
    /// the state; `work` returns `None` if there is nothing to lose. Returns the remaining delay of
    /// a pending change and the last error.
    pub fn update(&mut self, version: u64, now: Instant, work: impl FnOnce() -> Option<UnsavedWork>) -> AutosaveStatus {
        let problem = self.problem();
        let writes_at_once = std::mem::take(&mut self.writes_at_once);
        // The state as opened is not a change.
        if *self.queued_version.get_or_insert(version) == version {
            self.pending = None;
            return AutosaveStatus { wait: None, problem };
        }
        let first_change = self.pending.map_or(now, |pending| pending.first_change);
        let same = self.pending.filter(|pending| pending.version == version);
        let pending = same.unwrap_or(PendingChange { version, last_change: now, first_change });
        let due = (pending.last_change + DEBOUNCE).min(pending.first_change + MAX_WRITE_DELAY);
        if now < due && !writes_at_once {
            self.pending = Some(pending);
            return AutosaveStatus { wait: Some(due - now), problem };
        }
        self.pending = None;
        let path = self.files.work_file.clone();
        let request = match work() {
            Some(work) => WriteRequest::Write(path, Box::new(work)),
            None => WriteRequest::Remove(path),
        };
        let is_sent = self.requests.as_ref().is_some_and(|requests| requests.send(request).is_ok());
        let ended = || "Autosave is off: its thread has ended".to_owned();
        self.queued_version = Some(version);
        AutosaveStatus { wait: None, problem: problem.or_else(|| (!is_sent).then(ended)) }
    }

    /// The last error.
    fn problem(&self) -> Option<String> {
        let problems = std::iter::from_fn(|| self.task.as_ref()?.take());
        problems.map(|problem| problem.unwrap_or_else(|panic| panic)).last()
    }

    /// Waits until all queued work is written.
    pub fn finish_writing(&mut self) {
        drop(self.requests.take());
        drop(self.task.take());
    }

    /// Ends, and leaves the work for the restarted program.
    pub fn leave_for_restart(mut self, work: Option<UnsavedWork>) {
        if let (Some(work), Some(requests)) = (work, &self.requests) {
            let _ = requests.send(WriteRequest::Write(self.files.work_file.clone(), Box::new(work)));
        }
        self.finish_writing();
        self.keeps_files = true;
    }
}

impl Drop for Autosave {
    fn drop(&mut self) {
        self.finish_writing();
        if !self.keeps_files && !std::thread::panicking() {
            self.files.remove();
        }
    }
}

/// Result of [`Autosave::update`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AutosaveStatus {
    /// Remaining delay until the pending change is written.
    pub wait: Option<Duration>,
    pub problem: Option<String>,
}

#[cfg(test)]
mod tests {
    use super::super::unsaved_work::example as work;
    use super::*;

    fn file_count(folder: &Path) -> usize {
        fs::read_dir(folder).unwrap().count()
    }

    #[test]
    fn panicking_window_leaves_its_work() {
        let temp = tempfile::tempdir().unwrap();
        let folder = temp.path().to_owned();
        let broken = std::panic::catch_unwind(move || {
            let mut autosave = Autosave::begin(&folder).unwrap();
            let now = Instant::now();
            autosave.update(0, now, || None);
            autosave.update(1, now, || unreachable!());
            autosave.update(1, now + DEBOUNCE, || Some(work(7)));
            panic!("the window breaks off");
        });
        assert!(broken.is_err());
        let works = RecoverableWork::find_in(temp.path());
        assert!(works.len() == 1 && works[0].work.edit.settings.seed == 7);
    }

    #[test]
    fn work_is_offered_once_and_an_orderly_end_removes_it() {
        let temp = tempfile::tempdir().unwrap();
        let start = Instant::now();
        let at = |ms: u64| start + Duration::from_millis(ms);
        let mut first = Autosave::begin(temp.path()).unwrap();
        let mut other = Autosave::begin(temp.path()).unwrap();
        // The opened state is not written; a change is written after the debounce time.
        assert_eq!(first.update(7, at(0), || unreachable!()), AutosaveStatus::default());
        assert_eq!(first.update(8, at(100), || unreachable!()).wait, Some(DEBOUNCE));
        assert_eq!(first.update(8, at(300), || unreachable!()).wait, Some(Duration::from_millis(50)));
        assert_eq!(first.update(8, at(350), || Some(work(8))), AutosaveStatus::default());
        assert_eq!(first.update(8, at(900), || unreachable!()), AutosaveStatus::default());
        // Continuous changes are written every two seconds.
        for n in 0..20 {
            assert!(first.update(100 + n, at(1000 + 100 * n), || unreachable!()).wait.is_some(), "{n}");
        }
        first.update(120, at(3000), || Some(work(9)));
        other.update(1, at(0), || None);
        other.update(2, at(0), || unreachable!());
        other.update(2, at(250), || Some(work(2)));
        first.finish_writing();
        other.finish_writing();
        // Both windows are alive.
        assert!(RecoverableWork::find_in(temp.path()).is_empty());
        // The first one leaves its work, and a file of an interrupted write.
        let files = first.files.work_file.clone();
        let cut_off = format!(".{}.partial-x.json", files.file_stem().unwrap().display());
        fs::write(temp.path().join(cut_off), "cut").unwrap();
        first.leave_for_restart(None);
        let mut works = RecoverableWork::find_in(temp.path());
        assert_eq!(works.len(), 1);
        assert!(RecoverableWork::find_in(temp.path()).is_empty(), "it is offered to one window alone");
        let left = works.pop().unwrap();
        let mut expected = work(9);
        expected.at_s = left.work.at_s;
        assert_eq!(*left.work, expected);
        assert!(left.work.recording.is_absolute() && left.work.scene.as_ref().unwrap().is_absolute());

        // Adopted work stays until the end, and autosave continues in its files.
        let mut next = Autosave::begin(temp.path()).unwrap();
        next.adopt(left);
        next.update(1, at(0), || unreachable!());
        next.update(2, at(9), || unreachable!());
        next.update(2, at(9000), || None);
        next.finish_writing();
        drop((next, other));
        assert_eq!(file_count(temp.path()), 0);
    }

    #[test]
    fn drag_is_written_when_it_ends() {
        let temp = tempfile::tempdir().unwrap();
        let mut autosave = Autosave::begin(temp.path()).unwrap();
        let now = Instant::now();
        autosave.update(0, now, || None);
        autosave.write_next_at_once();
        assert_eq!(autosave.update(1, now, || Some(work(3))), AutosaveStatus::default());
        autosave.leave_for_restart(None);
        assert_eq!(RecoverableWork::find_in(temp.path())[0].work.edit.settings.seed, 3);
    }
}
