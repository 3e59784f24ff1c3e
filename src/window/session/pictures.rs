//! The pictures of a session: which is requested, which is displayed, and at which size.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

use eframe::egui;

use super::super::frame_renderer::{RenderKey, RenderOutputs, RenderResult};
use super::super::gpu_times::GpuTimes;
use super::super::obstacle::camera_text;
use super::super::player::Pace;
use super::Session;
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
    /// Pixels of the composite, 8 bits each.
    pub pixels: Arc<Pixels>,
}

/// Requested and displayed pictures.
#[derive(Debug, Default)]
pub(super) struct DisplayedPictures {
    /// Rendering has ended.
    ended: bool,
    /// The last requested picture, and that of the A/B variant.
    pub(super) requested: Option<RenderKey>,
    requested_variant: Option<RenderKey>,
    displayed: Option<DisplayedPicture>,
    outputs: RenderOutputs,
    requests_variant: bool,
    /// Time of the last change of the requested content.
    last_change: Option<Instant>,
    /// Render time at full size, s; 0 while unknown.
    full_size_s: f64,
    /// Completion times of pictures in the last second.
    finish_times: VecDeque<Instant>,
    finished: u64,
    times: GpuTimes,
    /// The device is lost, and all pictures with it.
    pub(super) is_lost: bool,
    /// Error of the last picture.
    pub(super) problem: Option<String>,
    /// The picture that was requested again after a device error.
    retried: Option<RenderKey>,
}

impl Session {
    /// The displayed frame.
    pub fn frame(&self) -> Option<&Arc<Frame>> {
        self.pictures.displayed.as_ref().map(|displayed| &displayed.frame)
    }

    /// Statistics of the displayed picture.
    pub fn stats(&self) -> Option<&FrameStats> {
        self.pictures.displayed.as_ref()?.stats.as_ref()
    }

    /// Requests code values with the pictures until the next frame of the window.
    pub fn request_codes(&mut self) {
        self.pictures.outputs.codes = true;
    }

    /// Requests GPU times with the pictures until the next frame of the window.
    pub fn request_times(&mut self) {
        self.pictures.outputs.times = true;
    }

    /// GPU time of each part of the latest pictures.
    pub fn times(&self) -> &GpuTimes {
        &self.pictures.times
    }

    /// Requests a picture of the A/B variant until the next frame of the window.
    pub fn request_variant(&mut self) {
        self.pictures.requests_variant = true;
    }

    fn variant_key(&self) -> Option<RenderKey> {
        Some(RenderKey {
            version: self.project.variant_version(),
            is_variant: true,
            is_approximate: false,
            ..self.pictures.requested?
        })
    }

    /// Code values of the displayed picture, if they were requested.
    pub fn codes(&self) -> Option<ShownCodes> {
        let displayed = self.pictures.displayed.as_ref()?;
        let pixels = Arc::clone(displayed.codes.as_ref()?);
        Some(ShownCodes { frame: Arc::clone(&displayed.frame), version: displayed.key.version, pixels })
    }

    /// Number of finished pictures.
    pub fn pictures(&self) -> u64 {
        self.pictures.finished
    }

    /// True if the graphics device is lost. Only a restart creates another.
    pub fn is_lost(&self) -> bool {
        self.pictures.is_lost
    }

    /// Number of pictures finished in the last second.
    pub fn pictures_per_s(&self) -> f64 {
        self.pictures.finish_times.len() as f64
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
        self.pictures.displayed.as_ref().map_or(1, |displayed| displayed.key.reduction)
    }

    /// Reduction factor of the next picture with new content. Playback of every frame is always at
    /// full size.
    fn reduction(&self) -> u32 {
        let recording = &self.project.shot().recording;
        if self.player.playing && self.player.pace == Pace::EveryFrame {
            1
        } else {
            reduction(self.pictures.full_size_s, recording.width.max(recording.height))
        }
    }

    /// True if the selected frame cannot be shown and another one is displayed.
    pub fn is_stale(&self) -> bool {
        let is_other =
            self.pictures.displayed.as_ref().is_some_and(|displayed| displayed.frame.index != self.player.frame());
        is_other && self.pictures.problem.is_some() && self.viewer.in_flight() == 0
    }

    /// True if the displayed picture has the current content, at any quality.
    pub fn is_shown(&self) -> bool {
        self.pictures.displayed.as_ref().is_some_and(|displayed| displayed.key.has_content_of(&self.current_key()))
    }

    /// True if the displayed picture has the current content at full quality and nothing is in
    /// flight.
    pub fn is_settled(&self) -> bool {
        let is_shown = self.pictures.displayed.as_ref().is_some_and(|displayed| displayed.key == self.current_key());
        is_shown && self.viewer.in_flight() == 0
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
        (self.pictures.outputs, self.pictures.requests_variant) = (RenderOutputs::default(), false);
        // A picture in flight wakes the window when it is finished.
        if self.pictures.requested.is_some_and(|requested| requested.is_reduced()) && !self.player.playing {
            ctx.request_repaint_after(FULL_SIZE_DELAY);
        }
        if let Some(due_s) = self.player.due_in_s().filter(|_| self.viewer.in_flight() == 0) {
            ctx.request_repaint_after(Duration::from_secs_f64(due_s.max(0.001)));
        }
    }

    pub(super) fn take_finished(&mut self) {
        let instant = Instant::now();
        loop {
            match self.viewer.take() {
                Ok(Some(RenderResult { key, frame, picture, elapsed })) => {
                    let (stats, codes, is_approximate) = match picture {
                        Ok(picture) => {
                            if !key.is_variant {
                                self.pictures.problem = None;
                                self.pictures.times.add(key.reduction, picture.times);
                            }
                            (Some(picture.stats), picture.codes, picture.is_approximate)
                        }
                        Err(error) => {
                            self.pictures.is_lost |=
                                matches!(&error, ShotError::Gpu { source, .. } if source.is_lost());
                            self.pictures.problem = Some(camera_text(&error));
                            // A failure for lack of time or memory may succeed at the second
                            // attempt.
                            let is_devices = matches!(&error, ShotError::Gpu { .. });
                            if is_devices && !self.pictures.is_lost && self.pictures.retried != Some(key) {
                                (self.pictures.retried, self.pictures.requested) = (Some(key), None);
                            }
                            // An error of the window's own thread ends with this picture.
                            self.pictures.is_lost |=
                                self.viewer.gpu().take_failure().is_some_and(|failure| failure.is_lost());
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
                    if self.pictures.requested == Some(key) {
                        self.pictures.requested = Some(shown);
                    }
                    self.pictures.displayed = Some(DisplayedPicture { key: shown, frame, stats, codes });
                    self.pictures.finish_times.push_back(instant);
                    self.pictures.finished += 1;
                    // The first picture includes creating pipelines, and a still picture waits for
                    // its shadows.
                    if key.reduction == 1 && self.pictures.finished > 1 && (key.is_approximate || self.player.playing) {
                        let elapsed_s = elapsed.as_secs_f64();
                        self.pictures.full_size_s = if self.pictures.full_size_s == 0.0 {
                            elapsed_s
                        } else {
                            0.5 * (self.pictures.full_size_s + elapsed_s)
                        };
                    }
                }
                Ok(None) => break,
                Err(why) => return self.end(&format!("drawing has ended ({why})")),
            }
        }
        self.pictures.finish_times.retain(|finished| instant.duration_since(*finished).as_secs_f64() < 1.0);
    }

    fn end(&mut self, why: &str) {
        self.pictures.ended = true;
        self.pictures.problem.get_or_insert_with(|| format!("{why}: save your work and open it again"));
    }

    /// Requests the picture of the due frame if its content is new.
    fn request_next(&mut self) -> bool {
        let current_key = self.current_key();
        let lacks_codes =
            self.pictures.outputs.codes && self.is_settled() && self.stats().is_some() && self.codes().is_none();
        let requested = self.pictures.requested.filter(|requested| requested.has_content_of(&current_key));
        let is_quiet = !self.player.playing
            && self.pictures.last_change.is_none_or(|last_change| last_change.elapsed() >= FULL_SIZE_DELAY);
        let was_reduced =
            requested.is_some_and(|requested| requested.is_reduced()) && is_quiet && self.viewer.in_flight() == 0;
        if self.pictures.ended || self.pictures.is_lost || requested.is_some() && !lacks_codes && !was_reduced {
            return false;
        }
        // Waits for the first frame of a camera.
        if self.is_live() && self.newest().is_none() {
            return false;
        }
        let reduction = if requested.is_some() { 1 } else { self.reduction() };
        if requested.is_none() {
            self.pictures.last_change = Some(Instant::now());
        }
        // During playback, shadows follow after the first picture.
        let is_approximate = requested.is_none() && !self.player.playing;
        let key = RenderKey { reduction, is_approximate, ..current_key };
        self.viewer.begin(key, self.project.shot().clone(), self.newest(), self.pictures.outputs);
        self.pictures.requested = Some(key);
        true
    }

    /// Requests a picture of the A/B variant for the last requested frame.
    fn request_variant_picture(&mut self) {
        let Some(variant_key) = self
            .variant_key()
            .filter(|_| self.pictures.requests_variant && !self.pictures.ended && !self.pictures.is_lost)
        else {
            return;
        };
        if self.pictures.requested_variant == Some(variant_key) {
            return;
        }
        if let Some(shot) = self.project.variant_shot() {
            self.viewer.begin(variant_key, shot, self.newest(), RenderOutputs::default());
            self.pictures.requested_variant = Some(variant_key);
        }
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
    use super::reduction;

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
