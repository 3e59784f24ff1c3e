//! Writes unsaved work into a recovery file as soon as an edit is complete. After a crash, the next
//! start offers to recover it.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};

use super::history::HistoryRecord;
use super::project::Edit;
use super::recent::{DocumentRef, ViewState};
use super::session_lock::SessionFiles;
use locard_engine::live::LiveSpec;
use locard_engine::sink::atomic::write_atomically;
use locard_engine::source::file::{self, MAX_LISTING_BYTES};

/// A change is written once nothing more has changed for this time.
const DEBOUNCE: Duration = Duration::from_millis(250);
/// Longest delay while changes continue, except during a drag.
const MAX_WRITE_DELAY: Duration = Duration::from_secs(2);
/// Age from which the unlocked lock file of a window without unsaved work is removed.
const MAX_LOCK_AGE: Duration = Duration::from_secs(86_400);
/// Version of the file format.
const FORMAT_VERSION: u32 = 1;

/// The edited state with the paths of its documents.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct UnsavedWork {
    version: u32,
    /// Seconds since 1970 (UTC).
    pub at_s: u64,
    /// All paths are absolute.
    pub recording: PathBuf,
    pub metres_per_unit: f64,
    pub profile: Option<PathBuf>,
    pub scene: Option<PathBuf>,
    pub frame: usize,
    /// Live camera that replaces the recording.
    #[serde(default)]
    pub camera: Option<LiveSpec>,
    pub edit: Edit,
    /// The last [`HISTORY_STEPS`] steps that led to `edit`, and the undone steps after it.
    #[serde(default)]
    pub history: HistoryRecord<Edit>,
}

/// Largest number of history steps in a recovery file. Steps are dropped if the file would exceed
/// [`MAX_LISTING_BYTES`].
pub const HISTORY_STEPS: usize = 50;

impl UnsavedWork {
    /// Unsaved work at this moment. A scene without a file refers to its models and panorama by
    /// absolute paths, because it has no folder.
    pub fn new(
        recording: &Path,
        metres_per_unit: f64,
        profile: Option<&Path>,
        scene: Option<&Path>,
        edit: Edit,
    ) -> Self {
        let mut edit = edit;
        if scene.is_none() {
            make_paths_absolute(&mut edit);
        }
        let at_s = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
        let (profile, scene) = (profile.map(absolute), scene.map(absolute));
        Self {
            version: FORMAT_VERSION,
            at_s,
            recording: absolute(recording),
            metres_per_unit,
            profile,
            scene,
            frame: 0,
            camera: None,
            edit,
            history: HistoryRecord::default(),
        }
    }

    /// Adds the undo history.
    pub fn with_history(self, history: HistoryRecord<Edit>) -> Self {
        Self { history, ..self }
    }

    /// Serializes with as many history steps as fit into `max_bytes`. Copies the steps of a scene
    /// without a file, so the UI thread does not call it.
    fn write_json(&mut self, max_bytes: u64) -> serde_json::Result<String> {
        if self.scene.is_none() {
            self.history.steps.iter_mut().for_each(|(_, edit)| make_paths_absolute(Arc::make_mut(edit)));
        }
        loop {
            let text = serde_json::to_string(self)?;
            if text.len() as u64 <= max_bytes || !self.history.halve() {
                return Ok(text);
            }
        }
    }
}

/// Makes the paths of a scene's models and panorama absolute.
fn make_paths_absolute(edit: &mut Edit) {
    for name in edit.scene.file_names_mut() {
        *name = absolute(Path::new(name)).to_string_lossy().into_owned();
    }
}

fn absolute(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}

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
        let mut found: Vec<Self> = of_work
            .filter_map(|path| {
                let files = SessionFiles::adopt(path)?;
                let text = file::read_text(&files.work_file, MAX_LISTING_BYTES).ok();
                let work = text.and_then(|text| serde_json::from_str(&text).ok());
                match work.filter(|work: &UnsavedWork| work.version == FORMAT_VERSION) {
                    Some(work) => Some(Self { work: Box::new(work), files }),
                    None => {
                        let _ = fs::remove_file(&files.lock_file);
                        None
                    }
                }
            })
            .collect();
        found.sort_by_key(|left| std::cmp::Reverse(left.work.at_s));
        found
    }

    /// The document to open for recovery.
    pub fn document(&self) -> DocumentRef {
        let UnsavedWork { recording, scene, profile, metres_per_unit, frame, camera, .. } = &*self.work;
        let (scene, profile) = (scene.clone(), profile.clone());
        if let Some(from) = camera {
            return DocumentRef::camera(from.clone(), profile, scene);
        }
        let at = ViewState { frame: *frame, ..ViewState::default() };
        DocumentRef {
            scene,
            profile,
            metres_per_unit: *metres_per_unit,
            at,
            ..DocumentRef::recording(recording.clone())
        }
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

/// Autosave of a window. An orderly drop removes its files; after a panic they remain.
#[derive(Debug)]
pub struct Autosave {
    files: SessionFiles,
    requests: Option<Sender<WriteRequest>>,
    problems: Receiver<String>,
    thread: Option<JoinHandle<()>>,
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
        let (sender, problems) = channel();
        let thread = std::thread::Builder::new().name("autosave".to_owned()).spawn(move || {
            for request in incoming {
                match request {
                    WriteRequest::Write(path, mut work) => {
                        let failed = |reason: String| format!("Your work is not kept for a crash: {reason}");
                        let done = work.write_json(MAX_LISTING_BYTES).map_err(|e| e.to_string()).and_then(|text| {
                            let write = |file: &mut io::BufWriter<&mut File>| file.write_all(text.as_bytes());
                            write_atomically(&path, true, write).map_err(|e| e.to_string())
                        });
                        if let Err(reason) = done {
                            // The receiver may be gone.
                            let _ = sender.send(failed(reason));
                        }
                    }
                    WriteRequest::Remove(path) => _ = fs::remove_file(path),
                }
            }
        })?;
        Ok(Self {
            files,
            requests: Some(requests),
            problems,
            thread: Some(thread),
            queued_version: None,
            pending: None,
            keeps_files: false,
            writes_at_once: false,
        })
    }

    /// Continues in the files of the recovered work, so that it is not lost before the next write.
    pub fn adopt(&mut self, left: RecoverableWork) {
        let own = std::mem::replace(&mut self.files, left.files);
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
        let problem = self.problems.try_iter().last();
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
        let ended = || "Your work is not kept for a crash: the thread that writes it has ended".to_owned();
        self.queued_version = Some(version);
        AutosaveStatus { wait: None, problem: problem.or_else(|| (!is_sent).then(ended)) }
    }

    /// Waits until all queued work is written.
    pub fn finish_writing(&mut self) {
        drop(self.requests.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
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
    use super::*;
    use locard_engine::compositor::Settings;
    use locard_engine::profile::Rig;
    use locard_engine::scene::SceneFile;

    fn work(seed: u64) -> UnsavedWork {
        let mut settings = Settings::default();
        settings.seed = seed;
        let edit = Edit {
            rig: Rig::default(),
            settings,
            scene: SceneFile::default(),
            other: None,
            unpinned: Default::default(),
        };
        UnsavedWork::new(Path::new("recordings/demo"), 1.0, None, Some(Path::new("scene.toml")), edit)
    }

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
        let found = RecoverableWork::find_in(temp.path());
        assert!(found.len() == 1 && found[0].work.edit.settings.seed == 7);
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
        let mut found = RecoverableWork::find_in(temp.path());
        assert_eq!(found.len(), 1);
        assert!(RecoverableWork::find_in(temp.path()).is_empty(), "it is offered to one window alone");
        let left = found.pop().unwrap();
        assert_eq!(*left.work, UnsavedWork { at_s: left.work.at_s, ..work(9) });
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

    #[test]
    fn recovery_file_contains_as_many_steps_as_fit() {
        let mut work = work(0);
        let steps = (0..16).map(|n| (n.to_string(), Arc::new(work.edit.clone()))).collect();
        work = work.with_history(HistoryRecord { steps, at: 15 });
        let alone = serde_json::to_string(&work.edit).unwrap().len() as u64;
        let text = work.write_json(8 * alone).unwrap();
        let read: UnsavedWork = serde_json::from_str(&text).unwrap();
        assert!((2..8).contains(&read.history.steps.len()) && text.len() as u64 <= 8 * alone);
        let last = &read.history.steps[read.history.at];
        assert_eq!((last.0.as_str(), &*last.1), ("15", &read.edit));
        // The work itself and its current step are always included.
        let least: UnsavedWork = serde_json::from_str(&work.write_json(1).unwrap()).unwrap();
        assert!(least.edit == work.edit && least.history.steps.len() == 1);
    }

    #[test]
    fn history_of_a_scene_without_a_file_has_absolute_paths() {
        let mut work = work(0);
        work.scene = None;
        let mut edit = work.edit.clone();
        edit.scene.light.environment = Some("hall.hdr".to_owned());
        let shared = Arc::new(edit);
        work = work.with_history(HistoryRecord { steps: vec![("lit".to_owned(), Arc::clone(&shared))], at: 0 });
        let read: UnsavedWork = serde_json::from_str(&work.write_json(MAX_LISTING_BYTES).unwrap()).unwrap();
        let written = read.history.steps[0].1.scene.light.environment.clone().unwrap();
        assert!(Path::new(&written).is_absolute(), "{written}");
        assert_eq!(shared.scene.light.environment.as_deref(), Some("hall.hdr"), "the window's own is as it was");
    }

    #[test]
    fn discarded_work_is_deleted_and_invalid_files_stay() {
        let temp = tempfile::tempdir().unwrap();
        fs::write(temp.path().join("a.json"), serde_json::to_string(&work(1)).unwrap()).unwrap();
        fs::write(temp.path().join("b.json"), "{\"version\": 1, \"at_s\"").unwrap();
        fs::copy(temp.path().join("a.json"), temp.path().join(".a.partial-x.json")).unwrap();
        let mut found = RecoverableWork::find_in(temp.path());
        assert_eq!(found.len(), 1);
        found.pop().unwrap().discard();
        assert!(temp.path().join("b.json").exists());
        assert_eq!(file_count(temp.path()), 1);
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
        let held = lock("held.lock", 2 * MAX_LOCK_AGE);
        held.try_lock().unwrap();
        assert!(RecoverableWork::find_in(temp.path()).is_empty());
        let there = |name: &str| temp.path().join(name).exists();
        assert!(!there("old.lock") && there("new.lock") && there("held.lock"));
    }

    #[test]
    fn scene_without_a_file_has_absolute_model_paths() {
        let mut edit = work(0).edit;
        let model = locard_engine::scene::document::PlacedModel {
            model: "scenes/marker-1.glb".to_owned(),
            ..Default::default()
        };
        edit.scene.objects.push(model);
        edit.scene.light.environment = Some("scenes/demo-light.hdr".to_owned());
        let written = UnsavedWork::new(Path::new("r"), 1.0, None, None, edit.clone());
        assert!(Path::new(&written.edit.scene.objects[0].model).is_absolute());
        assert!(Path::new(&written.edit.scene.light.environment.unwrap()).is_absolute());
        let written = UnsavedWork::new(Path::new("r"), 1.0, None, Some(Path::new("s.toml")), edit.clone());
        assert_eq!(written.edit, edit);
    }
}
