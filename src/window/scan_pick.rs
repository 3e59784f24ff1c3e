//! Clicks in the picture on points that a scan shows, too.

use glam::DVec2;

use locard_engine::frame::Frame;
use locard_engine::shot::{FramePoint, Shot};

/// Picks a position in a frame for a pair with a point of the scan.
#[derive(Clone, Copy, Debug, Default)]
pub struct ScanPick {
    /// The clicked position, until the other point of the pair is picked.
    pub view: Option<FramePoint>,
}

impl ScanPick {
    /// Takes a click. It replaces a position that awaits its point of the scan.
    pub fn click(&mut self, shot: &Shot, frame: &Frame, at_px: DVec2) -> Result<Option<String>, String> {
        let view = FramePoint { frame: frame.index, at_px };
        // A position without a ray cannot be aligned.
        shot.ray_pair(&view, glam::DVec3::ZERO).map_err(|error| error.to_string())?;
        self.view = Some(view);
        Ok(None)
    }

    /// Instruction for the click.
    pub fn prompt(&self) -> &'static str {
        match self.view {
            Some(_) => "Now the same point in the scan. Esc ends it",
            None => "Click a point that the scan shows, too, such as a corner. Esc ends it",
        }
    }
}
