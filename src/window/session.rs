//! An open recording: the edited project, the playback position, and the decoded and composited
//! pictures.

mod frozen_folder;
mod live;
mod messages;
mod pictures;
mod recent_frames;

use std::time::Instant;

use eframe::egui;
use eframe::egui_wgpu::RenderState;

use self::live::LiveCamera;
pub use self::live::{FROZEN, LiveStatus};
use self::messages::StatusMessage;
use self::pictures::DisplayedPictures;
pub use self::recent_frames::RECENT_S;
use super::player::Player;
use super::project::Project;
use super::thumbnails::Thumbnails;
use super::viewer::Viewer;
use locard_engine::shot::ShotError;

/// An open recording.
pub struct Session {
    pub project: Project,
    pub player: Player,
    pub viewer: Viewer,
    /// `None` if no thread could be started for them.
    pub thumbnails: Option<Thumbnails>,
    pictures: DisplayedPictures,
    /// Last update of the playback clock.
    last_tick: Option<Instant>,
    /// The last message.
    message: Option<StatusMessage>,
    /// A live camera that replaces the recording.
    live: Option<LiveCamera>,
}

impl Session {
    pub fn new(window: RenderState, ctx: &egui::Context, project: Project) -> Result<Self, String> {
        let wake = ctx.clone();
        let viewer = Viewer::new(window, move || wake.request_repaint())
            .map_err(|e| format!("the thread for decoding and drawing could not be started: {e}"))?;
        let thumbnails = Thumbnails::new(project.shot().recording.clone(), ctx).ok();
        let player = Player::new(&project.shot().recording.timestamps_s);
        let warnings = project.shot().recording.warnings.join("; ");
        let mut session = Self {
            project,
            player,
            viewer,
            thumbnails,
            pictures: DisplayedPictures::default(),
            last_tick: None,
            message: None,
            live: None,
        };
        if !warnings.is_empty() {
            session.show_message(warnings);
        }
        Ok(session)
    }

    /// Why no frame is displayed yet.
    pub fn placeholder(&self) -> &'static str {
        let camera = self.live_status().filter(|_| self.is_live() && self.newest().is_none());
        placeholder_text(camera.map(|camera| camera.status.is_over), self.pictures.problem.is_some())
    }

    /// True if the camera of the frame is unknown or incomplete, for lack of a profile.
    pub fn lacks_camera(&self) -> bool {
        let camera = self.project.shot().geometry_at(self.player.frame());
        matches!(camera, Err(ShotError::NoCamera { .. } | ShotError::IncompleteCamera { .. }))
    }

    /// Takes finished work. Called first in a frame of the window; never blocks.
    pub fn poll(&mut self, ctx: &egui::Context) {
        self.take_finished();
        self.poll_camera(ctx);
        self.expire_message(ctx);
        // Polling makes the device report its loss. Without it, egui's own drawing would panic.
        let gpu = self.viewer.gpu();
        self.pictures.is_lost |= gpu.poll().and(gpu.check()).is_err_and(|failure| failure.is_lost());
        if let Some(Err(why)) = self.thumbnails.as_mut().map(|thumbnails| thumbnails.upload(ctx)) {
            self.show_error(format!("The time line lacks pictures: {why}"));
        }
    }

    fn advance_clock(&mut self) {
        if !self.player.playing {
            self.last_tick = None;
            return;
        }
        let instant = Instant::now();
        let passed_s = self.last_tick.map_or(0.0, |before| instant.duration_since(before).as_secs_f64());
        self.last_tick = Some(instant);
        let is_requested = self.pictures.requested.is_some_and(|requested| requested.frame == self.player.frame());
        self.player.advance(passed_s, is_requested);
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

#[cfg(test)]
mod tests {
    use super::placeholder_text;

    #[test]
    fn placeholder_text_matches_the_reason() {
        assert_eq!(placeholder_text(Some(true), false), "The video has ended without a picture");
        assert_eq!(placeholder_text(Some(false), false), "Waiting for the camera's first picture");
        assert_eq!(placeholder_text(None, true), "This frame cannot be shown");
        assert_eq!(placeholder_text(None, false), "The first picture is being made");
    }
}
