//! What the handles are drawn over, and where places of the picture are on the screen.

use eframe::egui::{Pos2, Rect, vec2};
use glam::DVec2;

use super::super::picture::{Seen, View};
use locard_engine::frame::Frame;

/// The picture that the handles are in.
pub struct Over<'a> {
    pub seen: &'a Seen,
    pub view: &'a View,
    /// The one that is shown.
    pub frame: &'a Frame,
    /// Clicks and drags are for nothing else.
    pub is_free: bool,
    /// Nothing is drawn over the picture: it plays, or it is the camera's own.
    pub is_hidden: bool,
}

impl Over<'_> {
    /// Where is drawn over the picture: nothing over the camera's own.
    pub fn clip(&self) -> Rect {
        let clip = if self.seen.camera.is_positive() { self.seen.composite } else { Rect::EVERYTHING };
        self.seen.painter.clip_rect().intersect(clip)
    }

    /// The part of the picture that is seen there.
    pub fn visible(&self) -> Rect {
        self.clip().intersect(self.seen.placed.rect)
    }

    /// A place of the screen in the picture, px.
    pub fn px(&self, at: Pos2) -> DVec2 {
        let at = self.seen.placed.picture_px(at);
        DVec2::new(at.x.into(), at.y.into())
    }

    /// A place of the picture, px, on the screen.
    pub fn screen(&self, at_px: DVec2) -> DVec2 {
        let at = self.seen.placed.screen(vec2(at_px.x as f32, at_px.y as f32));
        DVec2::new(at.x.into(), at.y.into())
    }
}
