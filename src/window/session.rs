//! An open recording: the edited project, the playback position, and the decoded and composited
//! pictures.

mod frozen_folder;
mod live;
mod messages;
mod recent_frames;

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

use eframe::egui;
use eframe::egui_wgpu::RenderState;

use self::frozen_folder::FrozenRecordings;
use self::live::LiveCamera;
pub use self::live::{FROZEN, LiveStatus};
use self::messages::Message;
pub use self::recent_frames::RECENT_S;
use super::frame_renderer::{RenderKey, RenderOutputs, RenderResult};
use super::gpu_times::GpuTimes;
use super::obstacle::camera_text;
use super::player::{Pace, Player};
use super::project::Project;
use super::thumbnails::Thumbnails;
use super::viewer::Viewer;
use locard_engine::compositor::FrameStats;
use locard_engine::frame::Frame;
use locard_engine::pixels::Pixels;
use locard_engine::shot::ShotError;

/// A picture that takes longer than this at full size is reduced during changes to take about
/// `TARGET_RENDER_S`. Its longer side does not fall below `MIN_REDUCED_SIDE_PX`.
const SLOW_RENDER_S: f64 = 0.08;
const TARGET_RENDER_S: f64 = 0.05;
const MIN_REDUCED_SIDE_PX: u32 = 640;
/// Time without changes after which the picture is rendered at full size.
const FULL_SIZE_DELAY: Duration = Duration::from_millis(250);

/// The displayed picture.
#[derive(Debug)]
struct DisplayedPicture {
    key: RenderKey,
    frame: Arc<Frame>,
    /// `None` if compositing failed.
    stats: Option<FrameStats>,
    codes: Option<Arc<Pixels>>,
}

/// Code values of the displayed picture.
#[derive(Clone, Debug)]
pub struct ShownCodes {
    pub frame: Arc<Frame>,
    /// Project version at the time of the request.
    pub version: u64,
    /// Of the composite, 8 bits each.
    pub pixels: Arc<Pixels>,
}

/// An open recording.
pub struct Session {
    pub project: Project,
    pub player: Player,
    pub viewer: Viewer,
    /// `None` if no thread could be started for them.
    pub thumbnails: Option<Thumbnails>,
    /// Rendering has ended.
    ended: bool,
    /// The last requested picture, and that of the A/B variant.
    requested: Option<RenderKey>,
    requested_variant: Option<RenderKey>,
    displayed: Option<DisplayedPicture>,
    outputs: RenderOutputs,
    requests_variant: bool,
    /// Time of the last change of the requested content.
    last_change: Option<Instant>,
    /// Render time at full size, s; 0 while unknown.
    full_size_s: f64,
    /// Last update of the playback clock.
    last_tick: Option<Instant>,
    /// Completion times of pictures in the last second.
    finish_times: VecDeque<Instant>,
    pictures: u64,
    times: GpuTimes,
    /// The device is lost, and all pictures with it.
    is_lost: bool,
    /// Error of the last picture.
    picture_problem: Option<String>,
    /// The picture that was requested again after a device error.
    retried: Option<RenderKey>,
    /// The last message.
    message: Option<Message>,
    /// A live camera that replaces the recording.
    live: Option<LiveCamera>,
    frozen: FrozenRecordings,
}

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
            requested: None,
            requested_variant: None,
            displayed: None,
            outputs: RenderOutputs::default(),
            requests_variant: false,
            last_change: None,
            full_size_s: 0.0,
            last_tick: None,
            finish_times: VecDeque::new(),
            pictures: 0,
            times: GpuTimes::default(),
            is_lost: false,
            picture_problem: None,
            retried: None,
            message: None,
            live: None,
            frozen: FrozenRecordings::default(),
        };
        if !warnings.is_empty() {
            session.show_message(warnings);
        }
        Ok(session)
    }

    /// The displayed frame.
    pub fn frame(&self) -> Option<&Arc<Frame>> {
        self.displayed.as_ref().map(|displayed| &displayed.frame)
    }

    /// Why no frame is displayed yet.
    pub fn placeholder(&self) -> &'static str {
        let camera = self.live_status().filter(|_| self.is_live() && self.newest().is_none());
        placeholder_text(camera.map(|camera| camera.status.is_over), self.picture_problem.is_some())
    }

    /// Statistics of the displayed picture.
    pub fn stats(&self) -> Option<&FrameStats> {
        self.displayed.as_ref()?.stats.as_ref()
    }

    /// Requests code values with the pictures until the next frame of the window.
    pub fn request_codes(&mut self) {
        self.outputs.codes = true;
    }

    /// Requests GPU times with the pictures until the next frame of the window.
    pub fn request_times(&mut self) {
        self.outputs.times = true;
    }

    /// GPU time of each part of the latest pictures.
    pub fn times(&self) -> &GpuTimes {
        &self.times
    }

    /// Requests a picture of the A/B variant until the next frame of the window.
    pub fn request_variant(&mut self) {
        self.requests_variant = true;
    }

    fn variant_key(&self) -> Option<RenderKey> {
        Some(RenderKey {
            version: self.project.variant_version(),
            is_variant: true,
            is_approximate: false,
            ..self.requested?
        })
    }

    /// Code values of the displayed picture, if they were requested.
    pub fn codes(&self) -> Option<ShownCodes> {
        let displayed = self.displayed.as_ref()?;
        let pixels = Arc::clone(displayed.codes.as_ref()?);
        Some(ShownCodes { frame: Arc::clone(&displayed.frame), version: displayed.key.version, pixels })
    }

    /// Number of finished pictures.
    pub fn pictures(&self) -> u64 {
        self.pictures
    }

    /// True if the graphics device is lost. Only a restart creates another.
    pub fn is_lost(&self) -> bool {
        self.is_lost
    }

    /// True if the camera of the frame is unknown or incomplete, for lack of a profile.
    pub fn lacks_camera(&self) -> bool {
        let camera = self.project.shot().geometry_at(self.player.frame());
        matches!(camera, Err(ShotError::NoCamera { .. } | ShotError::PartOfCamera { .. }))
    }

    /// Number of pictures finished in the last second.
    pub fn pictures_per_s(&self) -> f64 {
        self.finish_times.len() as f64
    }

    fn current_key(&self) -> RenderKey {
        RenderKey {
            frame: self.player.frame(),
            version: self.project.version(),
            is_variant: false,
            reduction: 1,
            is_approximate: false,
        }
    }

    /// Reduction factor of the displayed picture.
    pub fn reduced_by(&self) -> u32 {
        self.displayed.as_ref().map_or(1, |displayed| displayed.key.reduction)
    }

    /// Reduction factor of the next picture with new content. Playback of every frame is always at
    /// full size.
    fn reduction(&self) -> u32 {
        let recording = &self.project.shot().recording;
        if self.player.playing && self.player.pace == Pace::EveryFrame {
            1
        } else {
            reduction(self.full_size_s, recording.width.max(recording.height))
        }
    }

    /// True if the selected frame cannot be shown and another one is displayed.
    pub fn is_stale(&self) -> bool {
        let is_other = self.displayed.as_ref().is_some_and(|displayed| displayed.frame.index != self.player.frame());
        is_other && self.picture_problem.is_some() && self.viewer.in_flight() == 0
    }

    /// True if the displayed picture has the current content, at any quality.
    pub fn is_shown(&self) -> bool {
        self.displayed.as_ref().is_some_and(|displayed| displayed.key.has_content_of(&self.current_key()))
    }

    /// True if the displayed picture has the current content at full quality and nothing is in
    /// flight.
    pub fn is_settled(&self) -> bool {
        let is_shown = self.displayed.as_ref().is_some_and(|displayed| displayed.key == self.current_key());
        is_shown && self.viewer.in_flight() == 0
    }

    /// Takes finished work. Called first in a frame of the window; never blocks.
    pub fn poll(&mut self, ctx: &egui::Context) {
        self.take_finished();
        self.poll_camera(ctx);
        self.expire_message(ctx);
        // Polling makes the device report its loss. Without it, egui's own drawing would panic.
        let gpu = self.viewer.gpu();
        self.is_lost |= gpu.poll().and(gpu.check()).is_err_and(|failure| failure.is_lost());
        if let Some(Err(why)) = self.thumbnails.as_mut().map(|thumbnails| thumbnails.upload(ctx)) {
            self.show_error(format!("The time line lacks pictures: {why}"));
        }
    }

    /// Requests due pictures. Called last in a frame of the window, so that rendering overlaps with
    /// painting; never blocks.
    pub fn request_pictures(&mut self, ctx: &egui::Context) {
        self.advance_clock();
        // During drags only one picture is in flight, for low latency; playback renders ahead.
        let max_in_flight = if self.player.playing { 2 } else { 1 };
        while self.viewer.in_flight() < max_in_flight && self.request_next() {
            self.request_variant_picture();
            if self.player.playing {
                self.player.advance(0.0, true);
            }
        }
        if self.viewer.in_flight() == 0 {
            self.request_variant_picture();
        }
        (self.outputs, self.requests_variant) = (RenderOutputs::default(), false);
        // A picture in flight wakes the window when it is finished.
        if self.requested.is_some_and(|requested| requested.is_reduced()) && !self.player.playing {
            ctx.request_repaint_after(FULL_SIZE_DELAY);
        }
        if let Some(due_s) = self.player.due_in_s().filter(|_| self.viewer.in_flight() == 0) {
            ctx.request_repaint_after(Duration::from_secs_f64(due_s.max(0.001)));
        }
    }

    fn take_finished(&mut self) {
        let instant = Instant::now();
        loop {
            match self.viewer.take() {
                Ok(Some(RenderResult { key, frame, picture, elapsed })) => {
                    let (stats, codes, is_approximate) = match picture {
                        Ok(picture) => {
                            if !key.is_variant {
                                self.picture_problem = None;
                                self.times.add(key.reduction, picture.times);
                            }
                            (Some(picture.stats), picture.codes, picture.is_approximate)
                        }
                        Err(error) => {
                            self.is_lost |= matches!(&error, ShotError::Gpu { source, .. } if source.is_lost());
                            self.picture_problem = Some(camera_text(&error));
                            // A failure for lack of time or memory may succeed at the second
                            // attempt.
                            let is_devices = matches!(&error, ShotError::Gpu { .. });
                            if is_devices && !self.is_lost && self.retried != Some(key) {
                                (self.retried, self.requested) = (Some(key), None);
                            }
                            // An error of the window's own thread ends with this picture.
                            self.is_lost |= self.viewer.gpu().take_failure().is_some_and(|failure| failure.is_lost());
                            (None, None, false)
                        }
                    };
                    let Some(frame) = frame else {
                        self.player.play(false);
                        continue;
                    };
                    if key.is_variant {
                        continue;
                    }
                    if let Some(live) = &mut self.live {
                        live.frame_displayed(frame.timestamp_s);
                    }
                    // Cached shadows are not approximate.
                    let shown = RenderKey { is_approximate, ..key };
                    if self.requested == Some(key) {
                        self.requested = Some(shown);
                    }
                    self.displayed = Some(DisplayedPicture { key: shown, frame, stats, codes });
                    self.finish_times.push_back(instant);
                    self.pictures += 1;
                    // The first picture includes creating pipelines, and a still picture waits for
                    // its shadows.
                    if key.reduction == 1 && self.pictures > 1 && (key.is_approximate || self.player.playing) {
                        let elapsed_s = elapsed.as_secs_f64();
                        self.full_size_s =
                            if self.full_size_s == 0.0 { elapsed_s } else { 0.5 * (self.full_size_s + elapsed_s) };
                    }
                }
                Ok(None) => break,
                Err(why) => return self.end(&format!("drawing has ended ({why})")),
            }
        }
        self.finish_times.retain(|finished| instant.duration_since(*finished).as_secs_f64() < 1.0);
    }

    fn end(&mut self, why: &str) {
        self.ended = true;
        self.picture_problem.get_or_insert_with(|| format!("{why}: save your work and open it again"));
    }

    fn advance_clock(&mut self) {
        if !self.player.playing {
            self.last_tick = None;
            return;
        }
        let instant = Instant::now();
        let passed_s = self.last_tick.map_or(0.0, |before| instant.duration_since(before).as_secs_f64());
        self.last_tick = Some(instant);
        let is_requested = self.requested.is_some_and(|requested| requested.frame == self.player.frame());
        self.player.advance(passed_s, is_requested);
    }

    /// Requests the picture of the due frame if its content is new.
    fn request_next(&mut self) -> bool {
        let current_key = self.current_key();
        let lacks_codes = self.outputs.codes && self.is_settled() && self.stats().is_some() && self.codes().is_none();
        let requested = self.requested.filter(|requested| requested.has_content_of(&current_key));
        let is_quiet =
            !self.player.playing && self.last_change.is_none_or(|last_change| last_change.elapsed() >= FULL_SIZE_DELAY);
        let was_reduced =
            requested.is_some_and(|requested| requested.is_reduced()) && is_quiet && self.viewer.in_flight() == 0;
        if self.ended || self.is_lost || requested.is_some() && !lacks_codes && !was_reduced {
            return false;
        }
        // Waits for the first frame of a camera.
        if self.is_live() && self.newest().is_none() {
            return false;
        }
        let reduction = if requested.is_some() { 1 } else { self.reduction() };
        if requested.is_none() {
            self.last_change = Some(Instant::now());
        }
        // During playback, shadows follow after the first picture.
        let is_approximate = requested.is_none() && !self.player.playing;
        let key = RenderKey { reduction, is_approximate, ..current_key };
        self.viewer.begin(key, self.project.shot().clone(), self.newest(), self.outputs);
        self.requested = Some(key);
        true
    }

    /// Requests a picture of the A/B variant for the last requested frame.
    fn request_variant_picture(&mut self) {
        let Some(variant_key) = self.variant_key().filter(|_| self.requests_variant && !self.ended && !self.is_lost)
        else {
            return;
        };
        if self.requested_variant == Some(variant_key) {
            return;
        }
        if let Some(shot) = self.project.variant_shot() {
            self.viewer.begin(variant_key, shot, self.newest(), RenderOutputs::default());
            self.requested_variant = Some(variant_key);
        }
    }
}

/// Text in place of a picture. `is_over`: whether a camera without a first frame has ended; `None`
/// if there is a frame. `has_failed`: rendering failed.
fn placeholder_text(is_over: Option<bool>, has_failed: bool) -> &'static str {
    match is_over {
        Some(true) => "The video has ended without a picture",
        Some(false) => "Waiting for the camera's first picture",
        None if has_failed => "This frame cannot be shown",
        None => "The first picture is being made",
    }
}

/// Reduction factor, a power of two, for a render time at full size.
fn reduction(full_size_s: f64, side_px: u32) -> u32 {
    let mut by = 1;
    while full_size_s > SLOW_RENDER_S
        && full_size_s / f64::from(by * by) > TARGET_RENDER_S
        && side_px / (2 * by) >= MIN_REDUCED_SIDE_PX
    {
        by *= 2;
    }
    by
}

#[cfg(test)]
mod tests {
    use super::{placeholder_text, reduction};

    #[test]
    fn placeholder_text_matches_the_reason() {
        assert_eq!(placeholder_text(Some(true), false), "The video has ended without a picture");
        assert_eq!(placeholder_text(Some(false), false), "Waiting for the camera's first picture");
        assert_eq!(placeholder_text(None, true), "This frame cannot be shown");
        assert_eq!(placeholder_text(None, false), "The first picture is being made");
    }

    #[test]
    fn fast_or_small_pictures_are_not_reduced() {
        assert_eq!(reduction(0.0, 3840), 1, "not known yet");
        assert_eq!(reduction(0.07, 3840), 1);
        assert_eq!(reduction(3.0, 640), 1);
        // A quarter of 0.19 s is below 0.05 s, a quarter of 0.21 s is not.
        assert_eq!(reduction(0.19, 3840), 2);
        assert_eq!(reduction(0.21, 3840), 4);
        assert_eq!(reduction(9.0, 3840), 4, "960 px; 480 are too few");
    }
}
