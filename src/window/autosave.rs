//! Work that is not saved yet, kept beside the user's files as soon as an edit is over: what a crash leaves is offered at the
//! next start.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};

use super::held::Place;
use super::history::Record;
use super::project::Edit;
use super::recent::{At, Opened};
use locard_engine::live::LiveFrom;
use locard_engine::sink::atomic::write_atomically;
use locard_engine::source::file::{self, MOST_LISTING};

/// What is changed is written once nothing more has changed for so long.
const QUIET: Duration = Duration::from_millis(250);
/// And while it goes on changing, as often as this; not during a drag.
const EVERY: Duration = Duration::from_secs(2);
const DAY: Duration = Duration::from_secs(86_400);
/// Of this form.
const VERSION: u32 = 1;

/// What a person has changed, with what it was changed in.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Work {
    version: u32,
    /// Seconds since 1970 (UTC).
    pub at_s: u64,
    /// Absolute, as the others.
    pub recording: PathBuf,
    pub metres_per_unit: f64,
    pub profile: Option<PathBuf>,
    pub scene: Option<PathBuf>,
    pub frame: usize,
    /// In place of the recording.
    #[serde(default)]
    pub camera: Option<LiveFrom>,
    pub edit: Edit,
    /// The last [`HISTORY_STEPS`] steps that led to `edit`, and those that were undone.
    #[serde(default)]
    pub history: Record<Edit>,
}

/// Largest number of history steps in a recovery file. Steps are dropped where the file would
/// exceed [`MOST_LISTING`].
pub const HISTORY_STEPS: usize = 50;

impl Work {
    /// Now. A scene without a file names its models and its panorama by absolute paths: where it lies is not known later.
    pub fn new(
        recording: &Path,
        metres_per_unit: f64,
        profile: Option<&Path>,
        scene: Option<&Path>,
        edit: Edit,
    ) -> Self {
        let mut edit = edit;
        if scene.is_none() {
            name_absolutely(&mut edit);
        }
        let at_s = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
        let (profile, scene) = (profile.map(absolute), scene.map(absolute));
        Self {
            version: VERSION,
            at_s,
            recording: absolute(recording),
            metres_per_unit,
            profile,
            scene,
            frame: 0,
            camera: None,
            edit,
            history: Record::default(),
        }
    }

    /// Adds the undo history.
    pub fn with_history(self, history: Record<Edit>) -> Self {
        Self { history, ..self }
    }

    /// As a file's text, with as many steps as fit into `most_bytes`. Copies the steps of a scene
    /// without a file, so the UI thread does not call it.
    fn text(&mut self, most_bytes: u64) -> serde_json::Result<String> {
        if self.scene.is_none() {
            self.history.steps.iter_mut().for_each(|(_, edit)| name_absolutely(Arc::make_mut(edit)));
        }
        loop {
            let text = serde_json::to_string(self)?;
            if text.len() as u64 <= most_bytes || !self.history.halve() {
                return Ok(text);
            }
        }
    }
}

/// Names the models and the panorama of a scene by absolute paths.
fn name_absolutely(edit: &mut Edit) {
    for name in edit.scene.file_names_mut() {
        *name = absolute(Path::new(name)).to_string_lossy().into_owned();
    }
}

fn absolute(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}

/// Work that a window left behind, held so that no other window offers it too.
#[derive(Debug)]
pub struct Left {
    pub work: Box<Work>,
    place: Place,
}

impl Left {
    /// What was left in a folder, the newest first. What cannot be read is left alone.
    pub fn found(folder: &Path) -> Vec<Self> {
        remove_old_locks(folder);
        let entries = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
        let of_work = entries.filter(|path| is_work(path));
        let mut found: Vec<Self> = of_work
            .filter_map(|path| {
                let place = Place::left(path)?;
                let text = file::read_text(&place.work, MOST_LISTING).ok();
                let work = text.and_then(|text| serde_json::from_str(&text).ok());
                match work.filter(|work: &Work| work.version == VERSION) {
                    Some(work) => Some(Self { work: Box::new(work), place }),
                    None => {
                        let _ = fs::remove_file(&place.lock);
                        None
                    }
                }
            })
            .collect();
        found.sort_by_key(|left| std::cmp::Reverse(left.work.at_s));
        found
    }

    /// What is to be opened to take it up.
    pub fn opened(&self) -> Opened {
        let Work { recording, scene, profile, metres_per_unit, frame, camera, .. } = &*self.work;
        let (scene, profile) = (scene.clone(), profile.clone());
        if let Some(from) = camera {
            return Opened::camera(from.clone(), profile, scene);
        }
        let at = At { frame: *frame, ..At::default() };
        Opened { scene, profile, metres_per_unit: *metres_per_unit, at, ..Opened::recording(recording.clone()) }
    }

    /// Nobody wants it.
    pub fn throw_away(self) {
        self.place.remove();
    }
}

/// Not what was cut off while it was written: that has a hidden name.
fn is_work(path: &Path) -> bool {
    let hidden = path.file_name().is_none_or(|name| name.to_string_lossy().starts_with('.'));
    !hidden && path.extension().is_some_and(|e| e == "json")
}

/// A window that ends with nothing to keep, but not in order, leaves its lock alone.
fn remove_old_locks(folder: &Path) {
    for path in fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()) {
        let is_alone = path.extension().is_some_and(|e| e == "lock") && !path.with_extension("json").exists();
        let made = fs::metadata(&path).and_then(|there| there.modified()).ok();
        // One that is younger may be about to be locked.
        let is_old = made.and_then(|made| made.elapsed().ok()).is_some_and(|age| age > DAY);
        if is_alone && is_old && File::open(&path).is_ok_and(|lock| lock.try_lock().is_ok()) {
            let _ = fs::remove_file(path);
        }
    }
}

/// A change that is still to be written: its version, when it was seen, and since when there is one.
#[derive(Clone, Copy, Debug)]
struct Unwritten {
    version: u64,
    seen: Instant,
    since: Instant,
}

enum Order {
    Write(PathBuf, Box<Work>),
    Remove(PathBuf),
}

/// Keeps a window's work. Dropped in an orderly end, it leaves nothing; where the window breaks off, all that it kept.
#[derive(Debug)]
pub struct Autosave {
    place: Place,
    orders: Option<Sender<Order>>,
    problems: Receiver<String>,
    thread: Option<JoinHandle<()>>,
    /// The version of the project that was given to be written last.
    written: Option<u64>,
    unwritten: Option<Unwritten>,
    leaves: bool,
    is_hurried: bool,
}

impl Autosave {
    pub fn begin(folder: &Path) -> io::Result<Self> {
        let place = Place::make(folder)?;
        let (orders, to_do) = channel::<Order>();
        let (tell, problems) = channel();
        let thread = std::thread::Builder::new().name("autosave".to_owned()).spawn(move || {
            for order in to_do {
                match order {
                    Order::Write(path, mut work) => {
                        let failed = |reason: String| format!("Your work is not kept for a crash: {reason}");
                        let done = work.text(MOST_LISTING).map_err(|e| e.to_string()).and_then(|text| {
                            let write = |file: &mut io::BufWriter<&mut File>| file.write_all(text.as_bytes());
                            write_atomically(&path, true, write).map_err(|e| e.to_string())
                        });
                        if let Err(reason) = done {
                            // The window may be gone.
                            let _ = tell.send(failed(reason));
                        }
                    }
                    Order::Remove(path) => _ = fs::remove_file(path),
                }
            }
        })?;
        Ok(Self {
            place,
            orders: Some(orders),
            problems,
            thread: Some(thread),
            written: None,
            unwritten: None,
            leaves: false,
            is_hurried: false,
        })
    }

    /// Goes on with what was left, in its place: it is not lost before the next change is written.
    pub fn take_up(&mut self, left: Left) {
        let own = std::mem::replace(&mut self.place, left.place);
        own.remove();
        (self.written, self.unwritten) = (None, None);
    }

    /// Makes the next [`Autosave::keep`] write a change at once: a drag has ended.
    pub fn hurry(&mut self) {
        self.is_hurried = true;
    }

    /// Has the work written, if it has changed and it is time. `version` tells changes apart; `work` is `None` where
    /// nothing would be lost. Gives how long the next change has to wait, and what went wrong.
    pub fn keep(&mut self, version: u64, now: Instant, work: impl FnOnce() -> Option<Work>) -> Kept {
        let problem = self.problems.try_iter().last();
        let is_hurried = std::mem::take(&mut self.is_hurried);
        // What was opened is no change.
        if *self.written.get_or_insert(version) == version {
            self.unwritten = None;
            return Kept { wait: None, problem };
        }
        let begun = self.unwritten.map_or(now, |unwritten| unwritten.since);
        let same = self.unwritten.filter(|unwritten| unwritten.version == version);
        let unwritten = same.unwrap_or(Unwritten { version, seen: now, since: begun });
        let due = (unwritten.seen + QUIET).min(unwritten.since + EVERY);
        if now < due && !is_hurried {
            self.unwritten = Some(unwritten);
            return Kept { wait: Some(due - now), problem };
        }
        self.unwritten = None;
        let path = self.place.work.clone();
        let order = match work() {
            Some(work) => Order::Write(path, Box::new(work)),
            None => Order::Remove(path),
        };
        let is_sent = self.orders.as_ref().is_some_and(|orders| orders.send(order).is_ok());
        let ended = || "Your work is not kept for a crash: the thread that writes it has ended".to_owned();
        self.written = Some(version);
        Kept { wait: None, problem: problem.or_else(|| (!is_sent).then(ended)) }
    }

    /// Waits until all that was given is written.
    pub fn finish_writing(&mut self) {
        drop(self.orders.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }

    /// Ends, and leaves the work for the next start.
    pub fn leave(mut self, work: Option<Work>) {
        if let (Some(work), Some(orders)) = (work, &self.orders) {
            let _ = orders.send(Order::Write(self.place.work.clone(), Box::new(work)));
        }
        self.finish_writing();
        self.leaves = true;
    }
}

impl Drop for Autosave {
    fn drop(&mut self) {
        self.finish_writing();
        if !self.leaves && !std::thread::panicking() {
            self.place.remove();
        }
    }
}

/// What came of [`Autosave::keep`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Kept {
    /// Until a change that is not written yet may be.
    pub wait: Option<Duration>,
    pub problem: Option<String>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use locard_engine::compositor::Settings;
    use locard_engine::profile::Rig;
    use locard_engine::scene::SceneFile;

    fn work(seed: u64) -> Work {
        let mut settings = Settings::default();
        settings.seed = seed;
        let edit = Edit {
            rig: Rig::default(),
            settings,
            scene: SceneFile::default(),
            other: None,
            unpinned: Default::default(),
        };
        Work::new(Path::new("recordings/demo"), 1.0, None, Some(Path::new("scene.toml")), edit)
    }

    fn names(folder: &Path) -> usize {
        fs::read_dir(folder).unwrap().count()
    }

    #[test]
    fn a_window_that_breaks_off_leaves_its_work() {
        let temp = tempfile::tempdir().unwrap();
        let folder = temp.path().to_owned();
        let broken = std::panic::catch_unwind(move || {
            let mut autosave = Autosave::begin(&folder).unwrap();
            let now = Instant::now();
            autosave.keep(0, now, || None);
            autosave.keep(1, now, || unreachable!());
            autosave.keep(1, now + QUIET, || Some(work(7)));
            panic!("the window breaks off");
        });
        assert!(broken.is_err());
        let found = Left::found(temp.path());
        assert!(found.len() == 1 && found[0].work.edit.settings.seed == 7);
    }

    #[test]
    fn what_is_left_is_found_once_and_an_orderly_end_leaves_nothing() {
        let temp = tempfile::tempdir().unwrap();
        let begun = Instant::now();
        let at = |ms: u64| begun + Duration::from_millis(ms);
        let mut first = Autosave::begin(temp.path()).unwrap();
        let mut other = Autosave::begin(temp.path()).unwrap();
        // What was opened is not written, a change is as soon as nothing more changes.
        assert_eq!(first.keep(7, at(0), || unreachable!()), Kept::default());
        assert_eq!(first.keep(8, at(100), || unreachable!()).wait, Some(QUIET));
        assert_eq!(first.keep(8, at(300), || unreachable!()).wait, Some(Duration::from_millis(50)));
        assert_eq!(first.keep(8, at(350), || Some(work(8))), Kept::default());
        assert_eq!(first.keep(8, at(900), || unreachable!()), Kept::default());
        // What goes on changing is written every two seconds.
        for n in 0..20 {
            assert!(first.keep(100 + n, at(1000 + 100 * n), || unreachable!()).wait.is_some(), "{n}");
        }
        first.keep(120, at(3000), || Some(work(9)));
        other.keep(1, at(0), || None);
        other.keep(2, at(0), || unreachable!());
        other.keep(2, at(250), || Some(work(2)));
        first.finish_writing();
        other.finish_writing();
        // Both live.
        assert!(Left::found(temp.path()).is_empty());
        // The one leaves its work, as if it had been cut off while it wrote.
        let place = first.place.work.clone();
        let cut_off = format!(".{}.partial-x.json", place.file_stem().unwrap().display());
        fs::write(temp.path().join(cut_off), "cut").unwrap();
        first.leave(None);
        let mut found = Left::found(temp.path());
        assert_eq!(found.len(), 1);
        assert!(Left::found(temp.path()).is_empty(), "it is offered to one window alone");
        let left = found.pop().unwrap();
        assert_eq!(*left.work, Work { at_s: left.work.at_s, ..work(9) });
        assert!(left.work.recording.is_absolute() && left.work.scene.as_ref().unwrap().is_absolute());

        // Taken up, it stays until the end, and goes on in its own place.
        let mut next = Autosave::begin(temp.path()).unwrap();
        next.take_up(left);
        next.keep(1, at(0), || unreachable!());
        next.keep(2, at(9), || unreachable!());
        next.keep(2, at(9000), || None);
        next.finish_writing();
        drop((next, other));
        assert_eq!(names(temp.path()), 0);
    }

    #[test]
    fn a_drag_is_written_as_soon_as_it_ends() {
        let temp = tempfile::tempdir().unwrap();
        let mut autosave = Autosave::begin(temp.path()).unwrap();
        let now = Instant::now();
        autosave.keep(0, now, || None);
        autosave.hurry();
        assert_eq!(autosave.keep(1, now, || Some(work(3))), Kept::default());
        autosave.leave(None);
        assert_eq!(Left::found(temp.path())[0].work.edit.settings.seed, 3);
    }

    #[test]
    fn a_recovery_file_keeps_as_many_steps_as_fit() {
        let mut work = work(0);
        let steps = (0..16).map(|n| (n.to_string(), Arc::new(work.edit.clone()))).collect();
        work = work.with_history(Record { steps, at: 15 });
        let alone = serde_json::to_string(&work.edit).unwrap().len() as u64;
        let text = work.text(8 * alone).unwrap();
        let read: Work = serde_json::from_str(&text).unwrap();
        assert!((2..8).contains(&read.history.steps.len()) && text.len() as u64 <= 8 * alone);
        let last = &read.history.steps[read.history.at];
        assert_eq!((last.0.as_str(), &*last.1), ("15", &read.edit));
        // The work itself and its current step are always kept.
        let least: Work = serde_json::from_str(&work.text(1).unwrap()).unwrap();
        assert!(least.edit == work.edit && least.history.steps.len() == 1);
    }

    #[test]
    fn history_of_a_scene_without_a_file_is_written_with_absolute_names() {
        let mut work = work(0);
        work.scene = None;
        let mut edit = work.edit.clone();
        edit.scene.light.environment = Some("hall.hdr".to_owned());
        let shared = Arc::new(edit);
        work = work.with_history(Record { steps: vec![("lit".to_owned(), Arc::clone(&shared))], at: 0 });
        let read: Work = serde_json::from_str(&work.text(MOST_LISTING).unwrap()).unwrap();
        let written = read.history.steps[0].1.scene.light.environment.clone().unwrap();
        assert!(Path::new(&written).is_absolute(), "{written}");
        assert_eq!(shared.scene.light.environment.as_deref(), Some("hall.hdr"), "the window's own is as it was");
    }

    #[test]
    fn what_nobody_wants_is_gone_and_what_is_no_work_is_left_alone() {
        let temp = tempfile::tempdir().unwrap();
        fs::write(temp.path().join("a.json"), serde_json::to_string(&work(1)).unwrap()).unwrap();
        fs::write(temp.path().join("b.json"), "{\"version\": 1, \"at_s\"").unwrap();
        fs::copy(temp.path().join("a.json"), temp.path().join(".a.partial-x.json")).unwrap();
        let mut found = Left::found(temp.path());
        assert_eq!(found.len(), 1);
        found.pop().unwrap().throw_away();
        assert!(temp.path().join("b.json").exists());
        assert_eq!(names(temp.path()), 1);
    }

    #[test]
    fn locks_that_nobody_holds_go_after_a_day() {
        let temp = tempfile::tempdir().unwrap();
        let lock = |name: &str, age: Duration| {
            let file = File::create(temp.path().join(name)).unwrap();
            file.set_modified(SystemTime::now() - age).unwrap();
            file
        };
        drop((lock("old.lock", 2 * DAY), lock("new.lock", Duration::ZERO)));
        let held = lock("held.lock", 2 * DAY);
        held.try_lock().unwrap();
        assert!(Left::found(temp.path()).is_empty());
        let there = |name: &str| temp.path().join(name).exists();
        assert!(!there("old.lock") && there("new.lock") && there("held.lock"));
    }

    #[test]
    fn a_scene_without_a_file_names_its_models_absolutely() {
        let mut edit = work(0).edit;
        let model = locard_engine::scene::document::PlacedModel {
            model: "scenes/marker-1.glb".to_owned(),
            ..Default::default()
        };
        edit.scene.objects.push(model);
        edit.scene.light.environment = Some("scenes/demo-light.hdr".to_owned());
        let written = Work::new(Path::new("r"), 1.0, None, None, edit.clone());
        assert!(Path::new(&written.edit.scene.objects[0].model).is_absolute());
        assert!(Path::new(&written.edit.scene.light.environment.unwrap()).is_absolute());
        let written = Work::new(Path::new("r"), 1.0, None, Some(Path::new("s.toml")), edit.clone());
        assert_eq!(written.edit, edit);
    }
}
