//! Random access to frames. Sequential access is cheapest, since the following frames are decoded
//! ahead. An urgent frame is decoded without its neighbours unless they are available.

use std::sync::Arc;

use locard_engine::frame::Frame;
use locard_engine::memo::Memo;
use locard_engine::recording::{FramesWithNeighbours, Recording, RecordingError};

/// Largest number of frames to skip in a running stream; beyond it a new stream is opened.
const MAX_SKIPPED_FRAMES: usize = 8;

/// Decodes a recording's frames.
pub struct Reader {
    recording: Arc<Recording>,
    /// Decoded frames, by index and by whether they lack their neighbours.
    decoded: Memo<(usize, bool), Arc<Frame>>,
    /// The running stream with the index of its next frame.
    stream: Option<(usize, FramesWithNeighbours)>,
}

impl Reader {
    pub fn new(recording: Arc<Recording>) -> Self {
        Self { recording, decoded: Memo::default(), stream: None }
    }

    pub fn is_of(&self, recording: &Arc<Recording>) -> bool {
        Arc::ptr_eq(&self.recording, recording)
    }

    /// Decodes a frame and blocks until it is available. `may_be_alone`: its neighbours are not
    /// required.
    pub fn frame(&mut self, frame: usize, may_be_alone: bool) -> Result<Arc<Frame>, RecordingError> {
        let alone = || self.decoded.get(&(frame, true)).filter(|_| may_be_alone);
        if let Some(decoded) = self.decoded.get(&(frame, false)).or_else(alone) {
            return Ok(decoded);
        }
        let count = self.recording.frame_count();
        let missing = RecordingError::Range { start: frame, end: frame, count };
        let is_near = |(next, _): &(usize, FramesWithNeighbours)| (*next..=*next + MAX_SKIPPED_FRAMES).contains(&frame);
        let running = self.stream.take_if(|running| !may_be_alone || is_near(running)).filter(is_near);
        if running.is_none() && may_be_alone {
            let decoded = self.recording.frames(frame..frame + 1)?.next().unwrap_or(Err(missing))?;
            let is_alone = self.recording.has_depth();
            return Ok(self.decoded.insert((frame, is_alone), Arc::new(decoded)));
        }
        let (at, mut frames) = match running {
            Some(running) => running,
            None => (frame, self.recording.frames_with_neighbours(frame..count)?),
        };
        let decoded = Arc::new(frames.nth(frame - at).unwrap_or(Err(missing))?);
        self.stream = Some((frame + 1, frames));
        Ok(self.decoded.insert((frame, false), decoded))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use locard_engine::recording::OpenOptions;
    use std::path::Path;

    #[test]
    fn urgent_frame_lacks_neighbours_unless_they_are_available() {
        let recording = Arc::new(Recording::open(Path::new("recordings/demo"), &OpenOptions::default()).unwrap());
        let mut reader = Reader::new(recording);
        assert!(reader.frame(20, true).unwrap().neighbours.is_empty());
        let whole = reader.frame(20, false).unwrap();
        assert_eq!(whole.neighbours.len(), 6);
        // The same frame, and its successor.
        assert!(Arc::ptr_eq(&reader.frame(20, true).unwrap(), &whole));
        assert_eq!(reader.frame(21, true).unwrap().neighbours.len(), 6);
        // After a jump the stream continues.
        assert!(reader.frame(60, true).unwrap().neighbours.is_empty());
        assert_eq!(reader.frame(22, false).unwrap().neighbours.len(), 6);
        assert!(reader.frame(72, true).is_err() && reader.frame(72, false).is_err());
    }
}
