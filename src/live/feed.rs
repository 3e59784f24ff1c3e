//! A camera that a thread watches: frames with their poses, the newest first, for whoever composites himself.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::error::LiveError;
use super::intake::{Arrived, Came, Intake};
use super::latest::Latest;
use super::open::Opened;
use super::waiting::Counts;
use super::watched::{Next, Watched};
use super::writer::Writer;
use crate::recording::recorder::About;
use crate::shot::Shot;
use crate::tracking::PoseTrack;
use crate::webcam::{Drops, Newest, Putter, Taken, monotonic_s};

/// A frame, and the poses that it is composited with.
#[derive(Clone, Debug)]
pub struct Seen {
    pub arrived: Arrived,
    pub track: PoseTrack,
}

/// How it goes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Status {
    pub counts: Counts,
    /// Of the camera; what whoever takes the frames is too slow for stands in [`Feed::replaced`].
    pub drops: Drops,
    /// Pictures that the disk was too slow for.
    pub not_recorded: u64,
    /// Frames that are recorded, while it records.
    pub recorded: Option<usize>,
    /// Why nothing comes for now.
    pub gone: Option<String>,
    /// Why there is no pose now.
    pub lacks: Option<String>,
    /// What went wrong with the poses; there are none any more.
    pub no_poses: Option<String>,
    /// What was told of the poses last ([`PoseSource::told`](super::PoseSource::told)).
    pub told: Option<String>,
    /// A recording that is over: how many frames it has, and why it ended if nobody ended it.
    pub written: Option<(usize, Option<String>)>,
    /// Nothing will come any more.
    pub is_over: bool,
}

#[derive(Debug, Default)]
struct Asked {
    record: Option<Writer>,
    stop: bool,
}

#[derive(Debug)]
struct Shared {
    shot: Shot,
    status: Status,
    asked: Asked,
}

/// A camera at work, with the last ten seconds of it.
#[derive(Debug)]
pub struct Feed {
    /// What its recordings say.
    pub about: About,
    seen: Option<Newest<Seen>>,
    shared: Arc<Mutex<Shared>>,
    latest: Arc<Mutex<Latest>>,
    thread: Option<JoinHandle<()>>,
}

fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    // A panic under the lock leaves plain values.
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Feed {
    /// Starts a camera. How long poses matter to a frame follows from the shot; `wake` is called from the thread when
    /// there is a frame, or something to be told.
    pub fn start(opened: Opened, shot: &Shot, wake: impl Fn() + Send + 'static) -> Result<Self, LiveError> {
        let about = opened.about(None);
        let latest = Arc::<Mutex<Latest>>::default();
        let intake = Intake::new(about.max_gap_s, opened.patience_s(), None).keeping(Arc::clone(&latest));
        let intake = intake.with_lenses(opened.lenses(&shot.rig));
        let watched = Watched::new(opened.camera.start()?, opened.poses);
        let (putter, seen) = Newest::new();
        let (status, asked) = Default::default();
        let shared = Arc::new(Mutex::new(Shared { shot: shot.clone(), status, asked }));
        let of_thread = Arc::clone(&shared);
        let watch = move || watch(watched, intake, &of_thread, &putter, wake);
        let thread = std::thread::Builder::new().name("live".to_owned()).spawn(watch).map_err(LiveError::Thread)?;
        Ok(Self { about, seen: Some(seen), shared, latest, thread: Some(thread) })
    }

    /// From now on as this shot is set.
    pub fn follow(&self, shot: &Shot) {
        lock(&self.shared).shot = shot.clone();
    }

    /// The newest frame that was not taken yet. Never waits.
    pub fn take(&self) -> Option<Seen> {
        match self.seen.as_ref()?.take(Instant::now()) {
            Taken::New(seen) => Some(seen),
            Taken::Nothing | Taken::Gone(_) | Taken::Ended => None,
        }
    }

    /// Frames that were replaced by newer ones before they were taken here.
    pub fn replaced(&self) -> u64 {
        self.seen.as_ref().map_or(0, |seen| seen.drops().replaced)
    }

    pub fn status(&self) -> Status {
        lock(&self.shared).status.clone()
    }

    /// The last ten seconds, up to a frame's time.
    pub fn latest(&self, until_s: f64) -> Latest {
        lock(&self.latest).clone().until(until_s)
    }

    /// Records from the next picture on. Frames are numbered anew.
    pub fn record(&self, writer: Writer) {
        let mut shared = lock(&self.shared);
        shared.status.written = None;
        shared.asked = Asked { record: Some(writer), stop: false };
    }

    /// Ends the recording: [`Status::written`] says when it is whole.
    pub fn stop_recording(&self) {
        lock(&self.shared).asked = Asked { record: None, stop: true };
    }
}

impl Drop for Feed {
    /// Ends what is recorded.
    fn drop(&mut self) {
        self.seen = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// How long poses are waited for where no frame waits for any.
const IDLE_S: f64 = 0.02;
/// How often it is looked whether a frame's poses have come.
const LOOKED_EVERY_S: f64 = 0.005;

fn watch(mut watched: Watched, mut intake: Intake, shared: &Mutex<Shared>, putter: &Putter<Seen>, wake: impl Fn()) {
    let mut last_s = f64::NEG_INFINITY;
    let mut status = Status::default();
    while !putter.is_over() && !status.is_over {
        let asked = std::mem::take(&mut lock(shared).asked);
        if asked.stop {
            intake.stop_recording();
        }
        if asked.record.is_some() || intake.is_recorded() {
            status.written = ended(&mut intake).or(status.written);
            status.recorded = None;
        }
        if let Some(writer) = asked.record {
            intake.record(writer);
            status.written = None;
        }
        let wait_s = intake.due_s().map_or(IDLE_S, |due_s| (due_s - monotonic_s()).clamp(0.0, LOOKED_EVERY_S));
        match watched.next(Instant::now() + Duration::from_secs_f64(wait_s)) {
            Next::Picture(came) => {
                let (picture, pixels) = *came;
                let shot = lock(shared).shot.clone();
                intake.follow(&shot.rig);
                // Without a camera nothing is drawn, and poses do not matter.
                let within_s = |frame: &_| shot.poses_within_s(frame).unwrap_or_default();
                let came = intake.picture(&picture, pixels, within_s, monotonic_s());
                status.not_recorded += u64::from(came == Came::NotRecorded);
                last_s = picture.time_s;
            }
            Next::Nothing => {}
            Next::Ended => status.is_over = intake.due_s().is_none(),
        }
        if status.no_poses.is_none() {
            status.no_poses = intake.take_poses(&mut watched, last_s).err().map(|error| error.to_string());
        }
        status.told = watched.told().or(status.told);
        let mut is_new = false;
        while let Some(arrived) = intake.next(monotonic_s()) {
            putter.put(Seen { arrived, track: intake.track().clone() });
            is_new = true;
        }
        let failure = intake.writer().and_then(Writer::failure);
        if let Some(error) = failure {
            let frames = intake.end_recording().map_or(0, |(frames, _)| frames);
            (status.written, status.recorded) = (Some((frames, Some(error.to_string()))), None);
        } else if intake.writer().is_some() {
            status.recorded = Some(intake.frames());
        }
        (status.counts, status.drops) = (intake.counts(), watched.drops());
        status.lacks = watched.lacks();
        status.gone = watched.gone().map(str::to_owned);
        let mut shared = lock(shared);
        let is_told = shared.status.gone != status.gone
            || shared.status.no_poses != status.no_poses
            || shared.status.told != status.told
            || shared.status.written != status.written
            || status.is_over;
        shared.status.clone_from(&status);
        drop(shared);
        if is_new || is_told {
            wake();
        }
    }
    let written = ended(&mut intake);
    if written.is_some() {
        let status = &mut lock(shared).status;
        (status.written, status.recorded) = (written, None);
        wake();
    }
}

/// Ends the recording, if there is one.
fn ended(intake: &mut Intake) -> Option<(usize, Option<String>)> {
    let (frames, error) = intake.end_recording()?;
    Some((frames, error.map(|error| error.to_string())))
}
