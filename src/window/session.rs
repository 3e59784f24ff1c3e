//! A recording that is open: what a person edits, where it stands, and its pictures as they are decoded and composited.

mod live;
mod past;

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

use eframe::egui;
use eframe::egui_wgpu::RenderState;

use self::live::Live;
pub use self::live::{FROZEN, Told};
pub use self::past::PAST_S;
use super::maker::{Finished, Made, Wants};
use super::obstacle::camera_text;
use super::player::{Pace, Player};
use super::project::Project;
use super::thumbnails::Thumbnails;
use super::times::Times;
use super::viewer::Viewer;
use locard_engine::compositor::FrameStats;
use locard_engine::frame::Frame;
use locard_engine::pixels::Pixels;
use locard_engine::shot::ShotError;
use locard_engine::text::without_options;

/// A picture that takes longer than this at full size is made smaller while something changes, so that it takes about
/// so long as the second; but not so small that its longer side has fewer pixels.
const SLOW_S: f64 = 0.08;
const WANTED_S: f64 = 0.05;
const LEAST_PX: u32 = 640;
/// When nothing has changed for so long, the picture is made at full size.
const QUIET: Duration = Duration::from_millis(250);

/// A picture that is shown.
#[derive(Debug)]
struct Now {
    made: Made,
    frame: Arc<Frame>,
    /// `None` where it could not be composited.
    stats: Option<FrameStats>,
    codes: Option<Arc<Pixels>>,
}

/// The code values of the picture that is shown.
#[derive(Clone, Debug)]
pub struct ShownCodes {
    pub frame: Arc<Frame>,
    /// The project's when it was begun.
    pub version: u64,
    /// Of the composite, 8 bits each.
    pub pixels: Arc<Pixels>,
}

/// A recording that is open.
pub struct Session {
    pub project: Project,
    pub player: Player,
    pub viewer: Viewer,
    /// `None` where no thread can be had for them.
    pub thumbnails: Option<Thumbnails>,
    /// Nothing more is made.
    ended: bool,
    /// The picture that was begun last, and the last one of what is compared with.
    begun: Option<Made>,
    begun_other: Option<Made>,
    now: Option<Now>,
    wants: Wants,
    wants_other: bool,
    /// When something new was last wanted.
    changed: Option<Instant>,
    /// What pictures at full size take, seconds; 0 as long as that is not known.
    full_s: f64,
    /// When it was last asked which frame is due, while it plays.
    clock: Option<Instant>,
    /// When pictures of the last second were finished.
    finished: VecDeque<Instant>,
    pictures: u64,
    times: Times,
    /// The device is gone, and with it every picture.
    is_lost: bool,
    /// Why the picture that was made last is none.
    picture_problem: Option<String>,
    /// The picture that was tried again, because the device failed at it.
    tried_again: Option<Made>,
    /// What was told last.
    message: Option<Message>,
    /// A camera in place of a recording.
    live: Option<Live>,
}

/// What was done, or went wrong.
#[derive(Debug)]
struct Message {
    text: String,
    is_wrong: bool,
    /// The project's version and the frame when it was told: it goes when something else is done.
    told_at: (u64, usize),
    /// By the window's clock, once it was shown.
    since_s: Option<f64>,
}

/// A message that was told a moment ago.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NewMessage<'a> {
    pub text: &'a str,
    pub is_wrong: bool,
}

/// As long as this a message can be read, whatever is done.
const READ_S: f64 = 4.0;

impl Session {
    pub fn new(window: RenderState, ctx: &egui::Context, project: Project) -> Result<Self, String> {
        let wake = ctx.clone();
        let viewer = Viewer::new(window, move || wake.request_repaint())
            .map_err(|e| format!("no thread can be had to decode and draw with: {e}"))?;
        let thumbnails = Thumbnails::new(project.shot().recording.clone(), ctx).ok();
        let player = Player::new(&project.shot().recording.timestamps_s);
        let warnings = project.shot().recording.warnings.join("; ");
        let mut session = Self {
            project,
            player,
            viewer,
            thumbnails,
            ended: false,
            begun: None,
            begun_other: None,
            now: None,
            wants: Wants::default(),
            wants_other: false,
            changed: None,
            full_s: 0.0,
            clock: None,
            finished: VecDeque::new(),
            pictures: 0,
            times: Times::default(),
            is_lost: false,
            picture_problem: None,
            tried_again: None,
            message: None,
            live: None,
        };
        if !warnings.is_empty() {
            session.say(warnings);
        }
        Ok(session)
    }

    /// The frame that is shown.
    pub fn frame(&self) -> Option<&Arc<Frame>> {
        self.now.as_ref().map(|now| &now.frame)
    }

    /// Why no frame is shown yet.
    pub fn lacking(&self) -> &'static str {
        let camera = self.told().filter(|_| self.is_live() && self.newest().is_none());
        without_picture(camera.map(|told| told.status.is_over), self.picture_problem.is_some())
    }

    /// What is known of the picture that is shown.
    pub fn stats(&self) -> Option<&FrameStats> {
        self.now.as_ref()?.stats.as_ref()
    }

    /// From now on until the window's next frame code values come with the pictures.
    pub fn want_codes(&mut self) {
        self.wants.codes = true;
    }

    /// From now on until the window's next frame the GPU's times come with the pictures.
    pub fn want_times(&mut self) {
        self.wants.times = true;
    }

    /// The GPU's time for each part of the pictures that came last.
    pub fn times(&self) -> &Times {
        &self.times
    }

    /// From now on until the window's next frame a picture of what is compared with is made, too.
    pub fn want_other(&mut self) {
        self.wants_other = true;
    }

    fn wanted_other(&self) -> Option<Made> {
        Some(Made { version: self.project.other_version(), is_other: true, is_rough: false, ..self.begun? })
    }

    /// The code values of the picture that is shown, if somebody wanted them.
    pub fn codes(&self) -> Option<ShownCodes> {
        let now = self.now.as_ref()?;
        let pixels = Arc::clone(now.codes.as_ref()?);
        Some(ShownCodes { frame: Arc::clone(&now.frame), version: now.made.version, pixels })
    }

    /// Pictures that were finished.
    pub fn pictures(&self) -> u64 {
        self.pictures
    }

    /// Whether the graphics device is gone. Only a new start brings another.
    pub fn is_lost(&self) -> bool {
        self.is_lost
    }

    /// Whether the camera of the frame is unknown or incomplete: a profile is missing.
    pub fn lacks_camera(&self) -> bool {
        let camera = self.project.shot().geometry_at(self.player.frame());
        matches!(camera, Err(ShotError::NoCamera { .. } | ShotError::PartOfCamera { .. }))
    }

    /// Pictures that were finished in the last second.
    pub fn pictures_per_s(&self) -> f64 {
        self.finished.len() as f64
    }

    /// Tells what was done.
    pub fn say(&mut self, text: impl Into<String>) {
        self.tell(&text.into(), false);
    }

    pub fn said(&self) -> Option<&str> {
        self.message.as_ref().filter(|message| !message.is_wrong).map(|message| message.text.as_str())
    }

    /// Tells what is wrong.
    pub fn wrong(&mut self, text: impl Into<String>) {
        self.tell(&text.into(), true);
    }

    fn tell(&mut self, text: &str, is_wrong: bool) {
        let told_at = (self.project.version(), self.player.frame());
        self.message = Some(Message { text: without_options(text), is_wrong, told_at, since_s: None });
    }

    /// The message that was told last, as long as it is new at a time of the window's clock.
    pub fn new_message(&self, now_s: f64) -> Option<NewMessage<'_>> {
        let message = self.message.as_ref()?;
        let is_new = message.since_s.is_none_or(|since_s| now_s - since_s < READ_S);
        is_new.then_some(NewMessage { text: &message.text, is_wrong: message.is_wrong })
    }

    /// Takes away a message that has been read, once something else is done.
    fn forget(&mut self, ctx: &egui::Context) {
        let (now_s, done) = (ctx.input(|i| i.time), (self.project.version(), self.player.frame()));
        let Some(message) = &mut self.message else { return };
        let since_s = *message.since_s.get_or_insert(now_s);
        let left_s = READ_S - (now_s - since_s);
        if left_s > 0.0 {
            ctx.request_repaint_after(Duration::from_secs_f64(left_s));
        } else if message.told_at != done {
            self.message = None;
        }
    }

    pub fn problem(&self) -> Option<&str> {
        let told = self.message.as_ref().filter(|message| message.is_wrong).map(|message| message.text.as_str());
        let picture = self.picture_problem.as_deref();
        // What to do about a device that is gone says more than that a picture failed.
        let own = if self.is_lost { told.or(picture) } else { picture.or(told) };
        self.project.problem().or(own)
    }

    fn wanted(&self) -> Made {
        Made { frame: self.player.frame(), version: self.project.version(), is_other: false, by: 1, is_rough: false }
    }

    /// By which factor the picture that is shown is smaller than the camera's, because it had to come soon.
    pub fn reduced_by(&self) -> u32 {
        self.now.as_ref().map_or(1, |now| now.made.by)
    }

    /// The same for the next one, if it is new. What plays frame by frame is not in haste.
    fn reduction(&self) -> u32 {
        let recording = &self.project.shot().recording;
        match self.player.playing && self.player.pace == Pace::EveryFrame {
            true => 1,
            false => reduction(self.full_s, recording.width.max(recording.height)),
        }
    }

    /// Whether the picture that is shown is of another frame than the one that is chosen, which cannot be shown.
    pub fn is_stale(&self) -> bool {
        let is_other = self.now.as_ref().is_some_and(|now| now.frame.index != self.player.frame());
        is_other && self.picture_problem.is_some() && self.viewer.under_way() == 0
    }

    /// Whether the picture that is shown is that of all that is set now, be it rough.
    pub fn is_shown(&self) -> bool {
        self.now.as_ref().is_some_and(|now| now.made.shows_as(&self.wanted()))
    }

    /// Whether the picture that is shown is that of all that is set now, is whole, and nothing is under way.
    pub fn is_settled(&self) -> bool {
        let is_shown = self.now.as_ref().is_some_and(|now| now.made == self.wanted());
        is_shown && self.viewer.under_way() == 0
    }

    /// Takes what was made. To be called first in a frame of the window; never waits.
    pub fn take(&mut self, ctx: &egui::Context) {
        self.take_finished();
        self.take_arrived(ctx);
        self.forget(ctx);
        // A device says that it is lost when it is looked after; the window's own shapes would break off without it.
        let gpu = self.viewer.gpu();
        self.is_lost |= gpu.poll().and(gpu.check()).is_err_and(|failure| failure.is_lost());
        if let Some(thumbnails) = &mut self.thumbnails {
            thumbnails.work(ctx);
        }
    }

    /// Has made what is due now. To be called last in a frame of the window, so that what a person changed in it is made while
    /// it is painted; never waits.
    pub fn make(&mut self, ctx: &egui::Context) {
        self.keep_time();
        // What is dragged shows soonest where nothing else is under way; what plays is made ahead.
        let most = if self.player.playing { 2 } else { 1 };
        while self.viewer.under_way() < most && self.begin() {
            self.begin_other();
            if self.player.playing {
                self.player.advance(0.0, true);
            }
        }
        if self.viewer.under_way() == 0 {
            self.begin_other();
        }
        (self.wants, self.wants_other) = (Wants::default(), false);
        // A picture that is under way wakes the window when it is finished.
        if self.begun.is_some_and(|begun| begun.is_hasty()) && !self.player.playing {
            ctx.request_repaint_after(QUIET);
        }
        if let Some(due_s) = self.player.due_in_s().filter(|_| self.viewer.under_way() == 0) {
            ctx.request_repaint_after(Duration::from_secs_f64(due_s.max(0.001)));
        }
    }

    fn take_finished(&mut self) {
        let instant = Instant::now();
        loop {
            match self.viewer.take() {
                Ok(Some(Finished { made, frame, picture, took })) => {
                    let (stats, codes, is_rough) = match picture {
                        Ok(picture) => {
                            if !made.is_other {
                                self.picture_problem = None;
                                self.times.add(made.by, picture.times);
                            }
                            (Some(picture.stats), picture.codes, picture.is_rough)
                        }
                        Err(error) => {
                            self.is_lost |= matches!(&error, ShotError::Gpu { source, .. } if source.is_lost());
                            self.picture_problem = Some(camera_text(&error));
                            // What the device could not do for lack of time or memory may go the next time.
                            let is_devices = matches!(&error, ShotError::Gpu { .. });
                            if is_devices && !self.is_lost && self.tried_again != Some(made) {
                                (self.tried_again, self.begun) = (Some(made), None);
                            }
                            // What the window's own thread did wrong is over with this picture.
                            self.is_lost |= self.viewer.gpu().take_failure().is_some_and(|failure| failure.is_lost());
                            (None, None, false)
                        }
                    };
                    let Some(frame) = frame else {
                        self.player.play(false);
                        continue;
                    };
                    if made.is_other {
                        continue;
                    }
                    if let Some(live) = &mut self.live {
                        live.shown(frame.timestamp_s);
                    }
                    // Shadows that were known already are not rough.
                    let shown = Made { is_rough, ..made };
                    if self.begun == Some(made) {
                        self.begun = Some(shown);
                    }
                    self.now = Some(Now { made: shown, frame, stats, codes });
                    self.finished.push_back(instant);
                    self.pictures += 1;
                    // The first one makes pipelines, too, and one that stands waits for its shadows.
                    if made.by == 1 && self.pictures > 1 && (made.is_rough || self.player.playing) {
                        let took_s = took.as_secs_f64();
                        self.full_s = if self.full_s == 0.0 { took_s } else { 0.5 * (self.full_s + took_s) };
                    }
                }
                Ok(None) => break,
                Err(()) => return self.end("drawing has ended"),
            }
        }
        self.finished.retain(|finished| instant.duration_since(*finished).as_secs_f64() < 1.0);
    }

    fn end(&mut self, why: &str) {
        self.ended = true;
        self.picture_problem.get_or_insert_with(|| format!("{why}: save your work and open it again"));
    }

    fn keep_time(&mut self) {
        if !self.player.playing {
            self.clock = None;
            return;
        }
        let instant = Instant::now();
        let passed_s = self.clock.map_or(0.0, |before| instant.duration_since(before).as_secs_f64());
        self.clock = Some(instant);
        let is_begun = self.begun.is_some_and(|begun| begun.frame == self.player.frame());
        self.player.advance(passed_s, is_begun);
    }

    /// Begins the due frame's picture, if there is something new in it.
    fn begin(&mut self) -> bool {
        let wanted = self.wanted();
        let lacks_codes = self.wants.codes && self.is_settled() && self.stats().is_some() && self.codes().is_none();
        let begun = self.begun.filter(|begun| begun.shows_as(&wanted));
        let is_quiet = !self.player.playing && self.changed.is_none_or(|changed| changed.elapsed() >= QUIET);
        let was_hasty = begun.is_some_and(|begun| begun.is_hasty()) && is_quiet && self.viewer.under_way() == 0;
        if self.ended || self.is_lost || begun.is_some() && !lacks_codes && !was_hasty {
            return false;
        }
        // A camera's first frame is still to come.
        if self.is_live() && self.newest().is_none() {
            return false;
        }
        let by = if begun.is_some() { 1 } else { self.reduction() };
        if begun.is_none() {
            self.changed = Some(Instant::now());
        }
        // What plays has its shadows after its first picture.
        let is_rough = begun.is_none() && !self.player.playing;
        let made = Made { by, is_rough, ..wanted };
        self.viewer.begin(made, self.project.shot().clone(), self.newest(), self.wants);
        self.begun = Some(made);
        true
    }

    /// Begins a picture of what is compared with, of the frame that was begun last.
    fn begin_other(&mut self) {
        let Some(wanted) = self.wanted_other().filter(|_| self.wants_other && !self.ended && !self.is_lost) else {
            return;
        };
        if self.begun_other == Some(wanted) {
            return;
        }
        if let Some(shot) = self.project.other_shot() {
            self.viewer.begin(wanted, shot, self.newest(), Wants::default());
            self.begun_other = Some(wanted);
        }
    }
}

/// Why there is no picture. `is_over`: whether a camera that has given no frame has ended; `None`
/// where there is a frame. `has_failed`: its picture could not be made.
fn without_picture(is_over: Option<bool>, has_failed: bool) -> &'static str {
    match is_over {
        Some(true) => "The video has ended without a picture",
        Some(false) => "Waiting for the camera's first picture",
        None if has_failed => "This frame cannot be shown",
        None => "The first picture is being made",
    }
}

/// The factor, a power of two, by which pictures that take so long at full size are made smaller.
fn reduction(full_s: f64, side_px: u32) -> u32 {
    let mut by = 1;
    while full_s > SLOW_S && full_s / f64::from(by * by) > WANTED_S && side_px / (2 * by) >= LEAST_PX {
        by *= 2;
    }
    by
}

#[cfg(test)]
mod tests {
    use super::{reduction, without_picture};

    #[test]
    fn a_picture_is_promised_only_where_it_comes() {
        assert_eq!(without_picture(Some(true), false), "The video has ended without a picture");
        assert_eq!(without_picture(Some(false), false), "Waiting for the camera's first picture");
        assert_eq!(without_picture(None, true), "This frame cannot be shown");
        assert_eq!(without_picture(None, false), "The first picture is being made");
    }

    #[test]
    fn what_is_quick_or_small_is_never_made_smaller() {
        assert_eq!(reduction(0.0, 3840), 1, "not known yet");
        assert_eq!(reduction(0.07, 3840), 1);
        assert_eq!(reduction(3.0, 640), 1);
        // A quarter of 0.19 s is less than 0.05 s, of 0.21 s it is not.
        assert_eq!(reduction(0.19, 3840), 2);
        assert_eq!(reduction(0.21, 3840), 4);
        assert_eq!(reduction(9.0, 3840), 4, "960 px; 480 are too few");
    }
}
