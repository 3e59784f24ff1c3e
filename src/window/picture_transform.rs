//! Mapping between the picture and the screen.

use eframe::egui::{Pos2, Rect, Vec2};

/// Placement of the picture on the screen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PictureTransform {
    pub rect: Rect,
    /// Points per pixel of the picture.
    pub scale: f32,
}

impl PictureTransform {
    /// Pixel of the picture at a point of the screen.
    pub fn picture_px(&self, at: Pos2) -> Vec2 {
        (at - self.rect.min) / self.scale
    }

    /// Point of the screen at a pixel of the picture.
    pub fn screen(&self, at_px: Vec2) -> Pos2 {
        self.rect.min + at_px * self.scale
    }
}
