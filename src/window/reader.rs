//! Frames in any order. One after the other costs least: those that follow are decoded ahead. One that must come soon comes
//! without its neighbours, unless they are at hand.

use std::sync::Arc;

use locard_engine::frame::Frame;
use locard_engine::recording::{FramesBeside, Recording, RecordingError};

/// So many frames are decoded and thrown away rather than begun anew at the one that is wanted.
const SKIPPED: usize = 8;

/// Decodes a recording's frames.
pub struct Reader {
    recording: Arc<Recording>,
    /// The frame that was decoded last, and whether it came without its neighbours.
    held: Option<(Arc<Frame>, bool)>,
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

    /// A frame. Waits for it. It `may_be_alone`, without its neighbours.
    pub fn frame(&mut self, frame: usize, may_be_alone: bool) -> Result<Arc<Frame>, RecordingError> {
        let is_it = |(held, is_alone): &&(Arc<Frame>, bool)| held.index == frame && (may_be_alone || !is_alone);
        if let Some((held, _)) = self.held.as_ref().filter(is_it) {
            return Ok(Arc::clone(held));
        }
        let count = self.recording.frame_count();
        let missing = RecordingError::Range { start: frame, end: frame, count };
        let is_near = |(next, _): &(usize, FramesBeside)| (*next..=*next + SKIPPED).contains(&frame);
        let running = self.stream.take_if(|running| !may_be_alone || is_near(running)).filter(is_near);
        if running.is_none() && may_be_alone {
            let decoded = self.recording.frames(frame..frame + 1)?.next().unwrap_or(Err(missing))?;
            let (decoded, is_alone) = (Arc::new(decoded), self.recording.has_depth());
            self.held = Some((Arc::clone(&decoded), is_alone));
            return Ok(decoded);
        }
        let (at, mut frames) = match running {
            Some(running) => running,
            None => (frame, self.recording.frames_beside(frame..count)?),
        };
        let decoded = Arc::new(frames.nth(frame - at).unwrap_or(Err(missing))?);
        self.stream = Some((frame + 1, frames));
        self.held = Some((Arc::clone(&decoded), false));
        Ok(decoded)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use locard_engine::recording::OpenOptions;
    use std::path::Path;

    #[test]
    fn what_must_come_soon_comes_alone_unless_its_neighbours_are_at_hand() {
        let recording = Arc::new(Recording::open(Path::new("recordings/demo"), &OpenOptions::default()).unwrap());
        let mut reader = Reader::new(recording);
        assert!(reader.frame(20, true).unwrap().beside.is_empty());
        let whole = reader.frame(20, false).unwrap();
        assert_eq!(whole.beside.len(), 6);
        // The same, and the next one, which follows.
        assert!(Arc::ptr_eq(&reader.frame(20, true).unwrap(), &whole));
        assert_eq!(reader.frame(21, true).unwrap().beside.len(), 6);
        // A jump; what was being decoded goes on.
        assert!(reader.frame(60, true).unwrap().beside.is_empty());
        assert_eq!(reader.frame(22, false).unwrap().beside.len(), 6);
        assert!(reader.frame(72, true).is_err() && reader.frame(72, false).is_err());
    }
}
