//! A live camera in place of a recording. Its frames are displayed as they arrive. When frozen, its
//! last seconds become a recording and the camera keeps running in the background.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use eframe::egui;
use eframe::egui_wgpu::RenderState;

use super::super::player::Player;
use super::super::project::Project;
use super::super::task::{BackgroundTask, drop_in_background};
use super::super::thumbnails::Thumbnails;
use super::Session;
use super::frozen_folder::FrozenFolder;
use super::recent_frames::{RecentFrame, RecentFrames};
use locard_engine::camera::Geometry;
use locard_engine::frame::Frame;
use locard_engine::live::{Feed, FeedStatus, LiveInput, RecorderThread, Tracking};
use locard_engine::recording::recorder::Recorder;
use locard_engine::recording::{OpenOptions, Recording};
use locard_engine::tracking::PoseTrack;
use locard_engine::webcam::monotonic_s;

/// Suffix of the name of a frozen recording.
pub const FROZEN: &str = ", frozen";

enum LiveState {
    Showing,
    /// The last seconds are being written.
    Freezing(BackgroundTask<Result<Recording, String>>),
    Frozen,
}

/// The newest frame and the data it is composited with.
struct NewestFrame {
    frame: Arc<Frame>,
    tracking: Tracking,
    track: PoseTrack,
    geometry: Option<Geometry>,
}

/// A camera and its state.
pub struct LiveCamera {
    feed: Feed,
    state: LiveState,
    /// The project's recording while the camera is displayed.
    live_recording: Arc<Recording>,
    newest: Option<NewestFrame>,
    /// Project version that the feed has.
    feed_version: Option<u64>,
    recent: RecentFrames,
    status: FeedStatus,
    /// Frames dropped by the feed, and those among them that were dropped because the picture was
    /// frozen.
    dropped: u64,
    dropped_while_frozen: u64,
    recording_folder: Option<PathBuf>,
    /// The last seconds are being copied.
    copying: Option<BackgroundTask<Result<PathBuf, String>>>,
}

/// Status of a camera.
#[derive(Clone, Debug)]
pub struct LiveStatus {
    pub status: FeedStatus,
    pub tracking: Tracking,
    /// Frames for which the window was too slow; they are recorded nevertheless.
    pub not_shown: u64,
    /// Latency from capture to compositing, median of the last second.
    pub latency_s: Option<f64>,
    pub is_freezing: bool,
}

impl LiveCamera {
    /// Called for a composited picture; `taken_s` is its capture time by the camera's clock.
    pub(super) fn frame_displayed(&mut self, taken_s: f64) {
        if matches!(self.state, LiveState::Showing) {
            self.recent.finish(taken_s, monotonic_s());
        }
    }

    /// The pictures of the last seconds, and the current time of the same clock.
    pub fn recent(&self) -> (impl Iterator<Item = &RecentFrame>, f64) {
        (self.recent.displayed(), monotonic_s())
    }

    fn live_status(&self) -> LiveStatus {
        LiveStatus {
            status: self.status.clone(),
            tracking: self.newest.as_ref().map_or(Tracking::Lost, |newest| newest.tracking),
            not_shown: self.dropped - self.dropped_while_frozen,
            latency_s: self.recent.latency_s(monotonic_s()),
            is_freezing: matches!(self.state, LiveState::Freezing(_)),
        }
    }
}

impl Session {
    /// Opens a session for a camera, which starts now. The project has its
    /// [`LiveInput::recording`].
    pub fn live(window: RenderState, ctx: &egui::Context, project: Project, camera: LiveInput) -> Result<Self, String> {
        let mut session = Self::new(window, ctx, project)?;
        let (wake, shot) = (ctx.clone(), session.project.shot());
        let feed = Feed::start(camera, shot, move || wake.request_repaint()).map_err(|error| error.to_string())?;
        session.live = Some(LiveCamera {
            feed,
            state: LiveState::Showing,
            live_recording: Arc::clone(&shot.recording),
            newest: None,
            feed_version: None,
            recent: RecentFrames::default(),
            status: FeedStatus::default(),
            dropped: 0,
            dropped_while_frozen: 0,
            recording_folder: None,
            copying: None,
        });
        (session.player, session.thumbnails) = (Player::arriving(), None);
        Ok(session)
    }

    /// True while frames of the camera are displayed.
    pub fn is_live(&self) -> bool {
        self.live.as_ref().is_some_and(|live| !matches!(live.state, LiveState::Frozen))
    }

    /// True while the camera's last seconds are displayed and it can be resumed.
    pub fn is_frozen(&self) -> bool {
        self.live.is_some() && !self.is_live()
    }

    /// True while the camera is recorded or its last frames are still being written.
    pub fn is_recording(&self) -> bool {
        self.live.as_ref().is_some_and(|live| live.recording_folder.is_some())
    }

    /// The camera, if there is one.
    pub fn camera(&self) -> Option<&LiveCamera> {
        self.live.as_ref()
    }

    /// Status of the camera, if there is one.
    pub fn live_status(&self) -> Option<LiveStatus> {
        self.live.as_ref().map(LiveCamera::live_status)
    }

    /// The newest frame of the camera, while it is displayed.
    pub fn newest(&self) -> Option<Arc<Frame>> {
        self.live.as_ref().filter(|_| self.is_live())?.newest.as_ref().map(|newest| Arc::clone(&newest.frame))
    }

    /// Takes new frames and messages from the camera. Never blocks.
    pub(super) fn poll_camera(&mut self, ctx: &egui::Context) {
        let Some(live) = &mut self.live else { return };
        let before = std::mem::replace(&mut live.status, live.feed.status());
        let replaced = live.feed.replaced();
        if !matches!(live.state, LiveState::Showing) {
            live.dropped_while_frozen += replaced - live.dropped;
        }
        live.dropped = replaced;
        let version = self.project.version();
        if live.feed_version != Some(version) && matches!(live.state, LiveState::Showing) {
            live.feed.set_shot(self.project.shot());
            live.feed_version = Some(version);
        }
        // Frames that are not taken are replaced by newer ones.
        if matches!(live.state, LiveState::Showing)
            && self.viewer.in_flight() < 2
            && let Some(newest) = live.feed.take()
        {
            let (tracking, geometry) = (newest.frame.tracking, newest.frame.geometry);
            let frame = Arc::new(newest.frame.frame);
            live.recent.start(frame.timestamp_s, tracking);
            live.newest = Some(NewestFrame { frame, tracking, track: newest.track, geometry });
            self.show_newest();
        }
        let Some(live) = &mut self.live else { return };
        let status = live.status.clone();
        if status.finished != before.finished
            && let (Some((frames, why)), Some(path)) = (&status.finished, live.recording_folder.take())
        {
            let name = path.display();
            match why {
                None => self.show_message(format!("Recorded {}: {name}", locard_engine::text::count(*frames, "frame"))),
                Some(why) if *frames == 0 => self.show_error(format!("{name}: {why}; nothing was recorded")),
                Some(why) => self.show_error(format!("{name}: {why}; the recording is complete up to there")),
            }
        }
        if status.pose_error != before.pose_error
            && let Some(why) = &status.pose_error
        {
            self.show_error(why.clone());
        }
        if status.message != before.message
            && let Some(text) = &status.message
        {
            self.show_message(text.clone());
        }
        self.poll_freezing(ctx);
        let Some(live) = &mut self.live else { return };
        let Some(copied) = live.copying.as_ref().and_then(BackgroundTask::take) else { return };
        live.copying = None;
        match copied.and_then(|copied| copied) {
            Ok(path) => self.show_message(format!("Saved: {}", path.display())),
            Err(why) => self.show_error(format!("Not saved: {why}")),
        }
    }

    /// Moves the project to the newest frame.
    fn show_newest(&mut self) {
        let Some(NewestFrame { frame, track, geometry, .. }) = self.live.as_ref().and_then(|live| live.newest.as_ref())
        else {
            return;
        };
        self.project.arrive(frame.index, frame.timestamp_s, track.clone(), geometry.clone());
        self.player.arrive(frame.index);
    }

    /// Shows the frozen recording once it is written.
    fn poll_freezing(&mut self, ctx: &egui::Context) {
        let Some(live) = &mut self.live else { return };
        let LiveState::Freezing(task) = &live.state else { return };
        let Some(done) = task.take() else { return };
        match done.and_then(|recording| recording) {
            Ok(recording) => {
                live.state = LiveState::Frozen;
                self.replace_recording(ctx, Arc::new(recording));
                self.player.step(isize::MAX);
            }
            Err(why) => {
                live.state = LiveState::Showing;
                self.player.playing = true;
                self.show_error(format!("Not frozen: {why}"));
            }
        }
    }

    /// Replaces the recording by another one of the same camera.
    fn replace_recording(&mut self, ctx: &egui::Context, recording: Arc<Recording>) {
        self.player = if recording.is_live() { Player::arriving() } else { Player::new(&recording.timestamps_s) };
        self.thumbnails = (!recording.is_live()).then(|| Thumbnails::new(Arc::clone(&recording), ctx).ok()).flatten();
        self.project.replace_recording(recording);
    }

    /// Writes the camera's last seconds into a new folder of `folder`, and shows them when done.
    pub fn freeze(&mut self, ctx: &egui::Context, folder: &Path) {
        let Some(live) = self.live.as_mut().filter(|live| matches!(live.state, LiveState::Showing)) else { return };
        let Some(until_s) = live.newest.as_ref().map(|newest| newest.frame.timestamp_s) else { return };
        let latest = live.feed.replay_buffer(until_s);
        let mut about = live.feed.about.clone();
        // The camera was just resumed, and none of its displayed frames have arrived yet.
        if latest.frames() == 0 {
            return;
        }
        let name = live.live_recording.name.clone();
        let (folder, draft, wake) = (folder.to_owned(), self.project.profile_text(Path::new("")), ctx.clone());
        let spawned = BackgroundTask::spawn(
            "write frozen",
            move || wake.request_repaint(),
            move || {
                about.profile = Some(draft().map_err(|error| error.to_string())?);
                let folder = FrozenFolder::create(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
                latest.write(&folder.path, &about).map_err(|error| error.to_string())?;
                let mut recording =
                    Recording::open(&folder.path, &OpenOptions::default()).map_err(|error| error.to_string())?;
                recording.name = format!("{name}{FROZEN}");
                // The project already has the profile, with later changes; only differences from
                // its own files are saved.
                recording.camera_profile = None;
                recording.guard = Some(Arc::new(folder));
                Ok(recording)
            },
        );
        match spawned {
            Ok(task) => {
                live.state = LiveState::Freezing(task);
                self.player.playing = false;
            }
            Err(error) => self.show_error(format!("the thread that freezes it could not be started: {error}")),
        }
    }

    /// Copies the displayed recording into a new folder.
    pub fn copy_recording(&mut self, ctx: &egui::Context, to: PathBuf) {
        let recording = Arc::clone(&self.project.shot().recording);
        let Some(live) = &mut self.live else { return };
        let wake = ctx.clone();
        let spawned = BackgroundTask::spawn(
            "copy recording",
            move || wake.request_repaint(),
            move || {
                let copied = if std::fs::read_dir(&to).is_ok_and(|mut entries| entries.next().is_some()) {
                    return Err(format!("{}: exists already; name a new folder", to.display()));
                } else {
                    copy_folder(&recording.path, &to)
                };
                copied.map(|()| to.clone()).map_err(|error| format!("{}: {error}", to.display()))
            },
        );
        match spawned {
            Ok(task) => live.copying = Some(task),
            Err(error) => self.show_error(format!("the thread that copies it could not be started: {error}")),
        }
    }

    /// Closes the camera and its recording. The last picture stays.
    pub fn close_camera(&mut self) {
        // Recorded frames may still have to be written.
        self.live.take().into_iter().for_each(drop_in_background);
        self.player.play(false);
    }

    /// Resumes the camera.
    pub fn go_live(&mut self, ctx: &egui::Context) {
        if !self.is_frozen() {
            return;
        }
        let Some(live) = &mut self.live else { return };
        (live.state, live.feed_version) = (LiveState::Showing, None);
        let live_recording = Arc::clone(&live.live_recording);
        self.replace_recording(ctx, live_recording);
        // A camera that has ended delivers no other frame.
        self.show_newest();
    }

    /// Records frames from now on into a new folder.
    pub fn record(&mut self, folder: PathBuf) {
        let Some(live) = &mut self.live else { return };
        let mut about = live.feed.about.clone();
        let spawned = self.project.profile_text(&folder.join("camera.toml"))()
            .map_err(|error| error.to_string())
            .and_then(|profile| {
                about.profile = Some(profile);
                let recorder = Recorder::create(&folder, &about).map_err(|error| error.to_string())?;
                RecorderThread::new(recorder).map_err(|error| error.to_string())
            });
        match spawned {
            Ok(writer) => {
                live.feed.record(writer);
                live.recording_folder = Some(folder);
            }
            Err(why) => self.show_error(why),
        }
    }

    pub fn stop_recording(&mut self) {
        if let Some(live) = &self.live {
            live.feed.stop_recording();
        }
    }
}

/// Copies a folder recursively.
fn copy_folder(from: &Path, to: &Path) -> std::io::Result<()> {
    std::fs::create_dir_all(to)?;
    for entry in std::fs::read_dir(from)? {
        let entry = entry?;
        let to = to.join(entry.file_name());
        if entry.file_type()?.is_dir() {
            copy_folder(&entry.path(), &to)?
        } else {
            _ = std::fs::copy(entry.path(), to)?
        }
    }
    Ok(())
}
