//! Frames in any order. One after the other costs least: those that follow are decoded ahead.

use std::sync::Arc;

use crate::frame::Frame;
use crate::recording::{FramesBeside, Recording, RecordingError};

/// So many frames are decoded and thrown away rather than begun anew at the one that is wanted.
const SKIPPED: usize = 8;

/// Decodes a recording's frames.
pub struct Reader {
    recording: Arc<Recording>,
    /// The frame that was decoded last.
    held: Option<Arc<Frame>>,
    /// What follows, with the number of its first frame.
    stream: Option<(usize, FramesBeside)>,
}

impl Reader {
    pub fn new(recording: Arc<Recording>) -> Self {
        Self { recording, held: None, stream: None }
    }

    pub fn is_of(&self, recording: &Arc<Recording>) -> bool {
        Arc::ptr_eq(&self.recording, recording)
    }

    /// A frame. Waits for it.
    pub fn frame(&mut self, frame: usize) -> Result<Arc<Frame>, RecordingError> {
        if let Some(held) = self.held.as_ref().filter(|held| held.index == frame) {
            return Ok(Arc::clone(held));
        }
        let count = self.recording.frame_count();
        let running = self.stream.take().filter(|(next, _)| (*next..=*next + SKIPPED).contains(&frame));
        let (at, mut frames) = match running {
            Some(running) => running,
            None => (frame, self.recording.frames_beside(frame..count)?),
        };
        let missing = RecordingError::Range { start: frame, end: frame, count };
        let decoded = Arc::new(frames.nth(frame - at).unwrap_or(Err(missing))?);
        self.stream = Some((frame + 1, frames));
        self.held = Some(Arc::clone(&decoded));
        Ok(decoded)
    }
}
