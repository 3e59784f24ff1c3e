//! Frames in order, each with what its neighbours saw: a depth map alone is torn at its edges, several agree.
//!
//! What a frame comes with depends on the recording alone, not on the range in which it is read. A frame that cannot be
//! read ends the stream where it is wanted itself; as a neighbour it is left out.

use std::collections::VecDeque;
use std::ops::Range;
use std::sync::Arc;

use super::{Frames, Recording, RecordingError};
use crate::frame::{Beside, Frame};

/// So many frames before and after a frame are looked at.
pub const EACH_WAY: usize = 3;

/// The frames of a range, in order, with their neighbours, as returned by [`Recording::frames_beside`].
#[derive(Debug)]
pub struct FramesBeside {
    recording: Recording,
    /// What is still to be given.
    range: Range<usize>,
    /// What is still to be read.
    reading: Range<usize>,
    frames: Frames,
    ready: VecDeque<Result<Frame, RecordingError>>,
    seen: VecDeque<Arc<Beside>>,
}

impl Recording {
    /// Like [`Recording::frames`]; each frame with depth comes with that of its neighbours.
    pub fn frames_beside(&self, range: Range<usize>) -> Result<FramesBeside, RecordingError> {
        let reading = match self.has_depth() && !range.is_empty() {
            true => range.start.saturating_sub(EACH_WAY)..range.end.saturating_add(EACH_WAY).min(self.frame_count()),
            false => range.clone(),
        };
        // What is wrong with the range itself is told of the range.
        let frames = self.frames(if range.end > self.frame_count() { range.clone() } else { reading.clone() })?;
        let (ready, seen) = (VecDeque::new(), VecDeque::new());
        Ok(FramesBeside { recording: self.clone(), range, reading, frames, ready, seen })
    }
}

impl FramesBeside {
    /// Reads the next frame.
    fn read(&mut self) {
        let index = self.reading.start;
        self.reading.start += 1;
        let is_wanted = self.range.contains(&index);
        match self.frames.next() {
            Some(Ok(frame)) => {
                if let Some(depth) = frame.depth.clone() {
                    let (pixels, timestamp_s) = (frame.pixels.clone(), frame.timestamp_s);
                    self.seen.push_back(Arc::new(Beside { index, timestamp_s, pixels, depth }));
                }
                if is_wanted {
                    self.ready.push_back(Ok(frame));
                }
            }
            Some(Err(error)) => {
                if is_wanted {
                    self.ready.push_back(Err(error));
                }
                self.go_on();
            }
            None => self.reading.end = self.reading.start,
        }
    }

    /// Begins anew after a frame that could not be read.
    fn go_on(&mut self) {
        match self.recording.frames(self.reading.clone()) {
            Ok(frames) => self.frames = frames,
            Err(error) => {
                self.ready.push_back(Err(error));
                self.reading.end = self.reading.start;
            }
        }
    }
}

impl Iterator for FramesBeside {
    type Item = Result<Frame, RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.range.is_empty() {
            return None;
        }
        let index = self.range.start;
        let ahead = if self.recording.has_depth() { EACH_WAY } else { 0 };
        while !self.reading.is_empty() && self.reading.start <= index + ahead {
            self.read();
        }
        let frame = self.ready.pop_front()?;
        self.range.start = if frame.is_ok() { index + 1 } else { self.range.end };
        let mut frame = match frame {
            Ok(frame) => frame,
            failed => return Some(failed),
        };
        self.seen.retain(|beside| beside.index + EACH_WAY >= index);
        let is_beside = |beside: &&Arc<Beside>| beside.index != index && beside.index <= index + EACH_WAY;
        if frame.depth.is_some() {
            frame.beside = self.seen.iter().filter(is_beside).cloned().collect();
        }
        Some(Ok(frame))
    }
}
