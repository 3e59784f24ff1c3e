//! Where the picture lies on the screen.

use eframe::egui::{Pos2, Rect, Vec2};

/// Where the picture lies on the screen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placed {
    pub rect: Rect,
    /// Points to a picture's pixel.
    pub scale: f32,
}

impl Placed {
    /// A place on the screen in the picture, px.
    pub fn picture_px(&self, at: Pos2) -> Vec2 {
        (at - self.rect.min) / self.scale
    }

    /// A place in the picture, px, on the screen.
    pub fn screen(&self, at_px: Vec2) -> Pos2 {
        self.rect.min + at_px * self.scale
    }
}
