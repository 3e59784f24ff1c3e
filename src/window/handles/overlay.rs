//! The picture below the handles, and its mapping to the screen.

use eframe::egui::{Pos2, Rect, vec2};
use glam::DVec2;

use super::super::picture::{PictureOutput, PictureView};
use locard_engine::frame::Frame;

/// The picture that the handles are painted over.
pub struct Overlay<'a> {
    pub picture: &'a PictureOutput,
    pub view: &'a PictureView,
    /// The displayed frame.
    pub frame: &'a Frame,
    /// No other part of the window uses clicks and drags in the picture.
    pub is_free: bool,
    /// The handles are not painted: playback, or the camera's own picture.
    pub is_hidden: bool,
}

impl Overlay<'_> {
    /// Clip rectangle of the handles: it excludes the camera's own picture.
    pub fn clip(&self) -> Rect {
        let clip = if self.picture.camera.is_positive() { self.picture.composite } else { Rect::EVERYTHING };
        self.picture.painter.clip_rect().intersect(clip)
    }

    /// The part of the picture inside the clip rectangle.
    pub fn visible(&self) -> Rect {
        self.clip().intersect(self.picture.placed.rect)
    }

    /// Pixel of the picture at a point of the screen.
    pub fn px(&self, at: Pos2) -> DVec2 {
        let at = self.picture.placed.picture_px(at);
        DVec2::new(at.x.into(), at.y.into())
    }

    /// Point of the screen at a pixel of the picture.
    pub fn screen(&self, at_px: DVec2) -> DVec2 {
        let at = self.picture.placed.screen(vec2(at_px.x as f32, at_px.y as f32));
        DVec2::new(at.x.into(), at.y.into())
    }
}
