//! A camera in place of a recording. Its frames are shown as they come; frozen, its last seconds are a recording like any
//! other, and the camera goes on behind it.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use eframe::egui;
use eframe::egui_wgpu::RenderState;

use super::super::errand::{Errand, let_go};
use super::super::player::Player;
use super::super::project::Project;
use super::super::thumbnails::Thumbnails;
use super::Session;
use super::past::{Past, Shown};
use locard_engine::camera::Geometry;
use locard_engine::frame::Frame;
use locard_engine::live::{Feed, Opened, Status, Tracking, Writer};
use locard_engine::recording::recorder::Recorder;
use locard_engine::recording::{OpenOptions, Recording};
use locard_engine::tracking::PoseTrack;
use locard_engine::webcam::monotonic_s;

/// Stands behind the name of what is frozen.
pub const FROZEN: &str = ", frozen";

enum State {
    Showing,
    /// The last seconds are being written.
    Freezing(Errand<Result<Recording, String>>),
    Frozen,
}

/// The newest frame, with what it is composited with.
struct Newest {
    frame: Arc<Frame>,
    tracking: Tracking,
    track: PoseTrack,
    geometry: Option<Geometry>,
}

/// A camera, and how far it is.
pub struct Live {
    feed: Feed,
    state: State,
    /// What the project stands on while the camera is shown.
    arriving: Arc<Recording>,
    seen: Option<Newest>,
    /// The project's version that the feed follows.
    followed: Option<u64>,
    past: Past,
    status: Status,
    /// Frames that nobody took, and those among them that nobody wanted: it was frozen.
    replaced: u64,
    unwanted: u64,
    is_recording: Option<PathBuf>,
    /// The last seconds are being copied.
    keeping: Option<Errand<Result<PathBuf, String>>>,
}

/// What is said of a camera.
#[derive(Clone, Debug)]
pub struct Told {
    pub status: Status,
    pub tracking: Tracking,
    /// Frames for which the window was too slow; they are recorded all the same.
    pub not_shown: u64,
    /// From when pictures were taken until they were composited, the median of the last second.
    pub latency_s: Option<f64>,
    pub is_freezing: bool,
}

impl Live {
    /// A picture was composited, which was taken at a time of the camera's clock.
    pub(super) fn shown(&mut self, taken_s: f64) {
        if matches!(self.state, State::Showing) {
            self.past.show(taken_s, monotonic_s());
        }
    }

    /// The pictures that were shown in the last seconds, and the time that it is now by their clock.
    pub fn past(&self) -> (impl Iterator<Item = &Shown>, f64) {
        (self.past.shown(), monotonic_s())
    }

    fn told(&self) -> Told {
        Told {
            status: self.status.clone(),
            tracking: self.seen.as_ref().map_or(Tracking::Lost, |seen| seen.tracking),
            not_shown: self.replaced - self.unwanted,
            latency_s: self.past.latency_s(monotonic_s()),
            is_freezing: matches!(self.state, State::Freezing(_)),
        }
    }
}

impl Session {
    /// Of a camera, which starts now. The project is of its [`Opened::recording`].
    pub fn live(window: RenderState, ctx: &egui::Context, project: Project, camera: Opened) -> Result<Self, String> {
        let mut session = Self::new(window, ctx, project)?;
        let (wake, shot) = (ctx.clone(), session.project.shot());
        let feed = Feed::start(camera, shot, move || wake.request_repaint()).map_err(|error| error.to_string())?;
        session.live = Some(Live {
            feed,
            state: State::Showing,
            arriving: Arc::clone(&shot.recording),
            seen: None,
            followed: None,
            past: Past::default(),
            status: Status::default(),
            replaced: 0,
            unwanted: 0,
            is_recording: None,
            keeping: None,
        });
        (session.player, session.thumbnails) = (Player::arriving(), None);
        Ok(session)
    }

    /// Whether what is shown comes from a camera, now.
    pub fn is_live(&self) -> bool {
        self.live.as_ref().is_some_and(|live| !matches!(live.state, State::Frozen))
    }

    /// Whether what is shown are a camera's last seconds, and it can be seen again.
    pub fn is_frozen(&self) -> bool {
        self.live.is_some() && !self.is_live()
    }

    /// Whether the camera is being recorded, or its last frames are still to be written.
    pub fn is_recording(&self) -> bool {
        self.live.as_ref().is_some_and(|live| live.is_recording.is_some())
    }

    /// The camera, if there is one.
    pub fn camera(&self) -> Option<&Live> {
        self.live.as_ref()
    }

    /// What is said of the camera, if there is one.
    pub fn told(&self) -> Option<Told> {
        self.live.as_ref().map(Live::told)
    }

    /// The camera's newest frame, while it is shown.
    pub fn newest(&self) -> Option<Arc<Frame>> {
        self.live.as_ref().filter(|_| self.is_live())?.seen.as_ref().map(|seen| Arc::clone(&seen.frame))
    }

    /// Takes what has come from the camera. Never waits.
    pub(super) fn take_arrived(&mut self, ctx: &egui::Context) {
        let Some(live) = &mut self.live else { return };
        let before = std::mem::replace(&mut live.status, live.feed.status());
        let replaced = live.feed.replaced();
        if !matches!(live.state, State::Showing) {
            live.unwanted += replaced - live.replaced;
        }
        live.replaced = replaced;
        let version = self.project.version();
        if live.followed != Some(version) && matches!(live.state, State::Showing) {
            live.feed.follow(self.project.shot());
            live.followed = Some(version);
        }
        // What is not taken is replaced by what is newer.
        if matches!(live.state, State::Showing)
            && self.viewer.under_way() < 2
            && let Some(seen) = live.feed.take()
        {
            let (tracking, geometry) = (seen.arrived.tracking, seen.arrived.geometry);
            let frame = Arc::new(seen.arrived.frame);
            live.past.begin(frame.timestamp_s, tracking);
            live.seen = Some(Newest { frame, tracking, track: seen.track, geometry });
            self.show_newest();
        }
        let Some(live) = &mut self.live else { return };
        let status = live.status.clone();
        if status.written != before.written
            && let (Some((frames, why)), Some(path)) = (&status.written, live.is_recording.take())
        {
            let name = path.display();
            match why {
                None => self.say(format!("Recorded {}: {name}", locard_engine::text::count(*frames, "frame"))),
                Some(why) if *frames == 0 => self.wrong(format!("{name}: {why}; nothing was recorded")),
                Some(why) => self.wrong(format!("{name}: {why}; the recording is whole up to there")),
            }
        }
        if status.no_poses != before.no_poses
            && let Some(why) = &status.no_poses
        {
            self.wrong(why.clone());
        }
        if status.told != before.told
            && let Some(text) = &status.told
        {
            self.say(text.clone());
        }
        self.take_frozen(ctx);
        let Some(live) = &mut self.live else { return };
        let Some(kept) = live.keeping.as_ref().and_then(Errand::take) else { return };
        live.keeping = None;
        match kept.and_then(|kept| kept) {
            Ok(path) => self.say(format!("Kept: {}", path.display())),
            Err(why) => self.wrong(format!("Not kept: {why}")),
        }
    }

    /// Stands on the frame that came last.
    fn show_newest(&mut self) {
        let Some(Newest { frame, track, geometry, .. }) = self.live.as_ref().and_then(|live| live.seen.as_ref()) else {
            return;
        };
        self.project.arrive(frame.index, frame.timestamp_s, track.clone(), geometry.clone());
        self.player.arrive(frame.index);
    }

    /// The last seconds are a recording: it is shown.
    fn take_frozen(&mut self, ctx: &egui::Context) {
        let Some(live) = &mut self.live else { return };
        let State::Freezing(errand) = &live.state else { return };
        let Some(done) = errand.take() else { return };
        match done.and_then(|recording| recording) {
            Ok(recording) => {
                live.state = State::Frozen;
                let recording = Arc::new(recording);
                self.stand_on(ctx, recording);
                self.player.step(isize::MAX);
            }
            Err(why) => {
                live.state = State::Showing;
                self.player.playing = true;
                self.wrong(format!("Not frozen: {why}"));
            }
        }
    }

    /// Shows another recording of the same camera.
    fn stand_on(&mut self, ctx: &egui::Context, recording: Arc<Recording>) {
        self.player = match recording.is_arriving() {
            true => Player::arriving(),
            false => Player::new(&recording.timestamps_s),
        };
        self.thumbnails =
            (!recording.is_arriving()).then(|| Thumbnails::new(Arc::clone(&recording), ctx).ok()).flatten();
        self.project.stand_on(recording);
    }

    /// Has the camera's last seconds written into a new folder of `folder`, and shows them then.
    pub fn freeze(&mut self, ctx: &egui::Context, folder: &Path) {
        let Some(live) = self.live.as_mut().filter(|live| matches!(live.state, State::Showing)) else { return };
        let Some(until_s) = live.seen.as_ref().map(|seen| seen.frame.timestamp_s) else { return };
        let (latest, mut about) = (live.feed.latest(until_s), live.feed.about.clone());
        // The camera is shown again, and what it shows by now has not come yet.
        if latest.frames() == 0 {
            return;
        }
        let name = live.arriving.name.clone();
        let (folder, draft, wake) = (folder.to_owned(), self.project.profile_text(), ctx.clone());
        let begun = Errand::begin(
            "freezing",
            move || wake.request_repaint(),
            move || {
                about.profile = Some(draft().map_err(|error| error.to_string())?);
                let folder = fresh(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
                latest.write(&folder, &about).map_err(|error| error.to_string())?;
                let mut recording =
                    Recording::open(&folder, &OpenOptions::default()).map_err(|error| error.to_string())?;
                recording.name = format!("{name}{FROZEN}");
                // The project has it, with what was changed since: what is saved is what differs from its own files.
                recording.camera_profile = None;
                Ok(recording)
            },
        );
        match begun {
            Ok(errand) => {
                live.state = State::Freezing(errand);
                self.player.playing = false;
            }
            Err(error) => self.wrong(format!("no thread can be started that freezes it: {error}")),
        }
    }

    /// Copies the recording that is shown into a new folder.
    pub fn keep(&mut self, ctx: &egui::Context, to: PathBuf) {
        let from = self.project.shot().recording.path.clone();
        let Some(live) = &mut self.live else { return };
        let wake = ctx.clone();
        let begun = Errand::begin(
            "keeping",
            move || wake.request_repaint(),
            move || {
                let copied = match std::fs::read_dir(&to).is_ok_and(|mut entries| entries.next().is_some()) {
                    true => return Err(format!("{}: exists already; name a new folder", to.display())),
                    false => copy(&from, &to),
                };
                copied.map(|()| to.clone()).map_err(|error| format!("{}: {error}", to.display()))
            },
        );
        match begun {
            Ok(errand) => live.keeping = Some(errand),
            Err(error) => self.wrong(format!("no thread can be started that copies it: {error}")),
        }
    }

    /// Ends the camera, and what it records. What it showed last stays.
    pub fn let_camera_go(&mut self) {
        // What it records may still have to be written.
        self.live.take().into_iter().for_each(let_go);
        self.player.play(false);
    }

    /// Shows the camera again.
    pub fn go_live(&mut self, ctx: &egui::Context) {
        if !self.is_frozen() {
            return;
        }
        let Some(live) = &mut self.live else { return };
        (live.state, live.followed) = (State::Showing, None);
        let arriving = Arc::clone(&live.arriving);
        self.stand_on(ctx, arriving);
        // A camera that has ended gives no other one.
        self.show_newest();
    }

    /// Records what comes from now on into a new folder.
    pub fn record(&mut self, folder: PathBuf) {
        let Some(live) = &mut self.live else { return };
        let mut about = live.feed.about.clone();
        let begun = self.project.profile_text()().map_err(|error| error.to_string()).and_then(|profile| {
            about.profile = Some(profile);
            let recorder = Recorder::create(&folder, &about).map_err(|error| error.to_string())?;
            Writer::new(recorder).map_err(|error| error.to_string())
        });
        match begun {
            Ok(writer) => {
                live.feed.record(writer);
                live.is_recording = Some(folder);
            }
            Err(why) => self.wrong(why),
        }
    }

    pub fn stop_recording(&mut self) {
        if let Some(live) = &self.live {
            live.feed.stop_recording();
        }
    }
}

/// So many frozen recordings are kept.
const KEPT: usize = 5;

/// A folder that is not there yet; the oldest of those before it are removed.
fn fresh(folder: &Path) -> std::io::Result<PathBuf> {
    std::fs::create_dir_all(folder)?;
    let mut there: Vec<PathBuf> = std::fs::read_dir(folder)?.flatten().map(|entry| entry.path()).collect();
    there.retain(|path| path.join("recording.toml").is_file());
    there.sort();
    let number = |path: &PathBuf| path.file_name()?.to_str()?.strip_prefix("frozen-")?.parse::<u64>().ok();
    let last = there.iter().filter_map(number).max().unwrap_or(0);
    for old in there.iter().take((there.len() + 1).saturating_sub(KEPT)) {
        std::fs::remove_dir_all(old)?;
    }
    Ok(folder.join(format!("frozen-{:06}", last + 1)))
}

/// A folder with all that is in it.
fn copy(from: &Path, to: &Path) -> std::io::Result<()> {
    std::fs::create_dir_all(to)?;
    for entry in std::fs::read_dir(from)? {
        let entry = entry?;
        let to = to.join(entry.file_name());
        match entry.file_type()?.is_dir() {
            true => copy(&entry.path(), &to)?,
            false => _ = std::fs::copy(entry.path(), to)?,
        }
    }
    Ok(())
}
