//! Frames in order, each with the depth of its neighbours: a single depth map has irregular edges,
//! the consensus of several does not.
//!
//! A frame's neighbours depend on the recording alone, not on the range in which it is read. An
//! unreadable frame ends the stream if it was requested; as a neighbour it is skipped.

use std::collections::VecDeque;
use std::ops::Range;
use std::sync::Arc;

use super::{Frames, Recording, RecordingError};
use crate::frame::{Frame, NeighbourFrame};

/// Number of neighbours before and after a frame.
pub const NEIGHBOURS_EACH_WAY: usize = 3;

/// The frames of a range, in order, with their neighbours, as returned by
/// [`Recording::frames_with_neighbours`].
#[derive(Debug)]
pub struct FramesWithNeighbours {
    recording: Recording,
    /// Frames to return.
    range: Range<usize>,
    /// Frames to read, neighbours included.
    reading: Range<usize>,
    frames: Frames,
    ready: VecDeque<Result<Frame, RecordingError>>,
    window: VecDeque<Arc<NeighbourFrame>>,
}

impl Recording {
    /// Frames to composite: like [`Recording::frames`], with the depth of the neighbours for each
    /// frame that has depth, and with [`Recording::estimated_coding`] for each without a coding.
    pub fn frames_with_neighbours(&self, range: Range<usize>) -> Result<FramesWithNeighbours, RecordingError> {
        let reading = if self.has_depth() && !range.is_empty() {
            range.start.saturating_sub(NEIGHBOURS_EACH_WAY)
                ..range.end.saturating_add(NEIGHBOURS_EACH_WAY).min(self.frame_count())
        } else {
            range.clone()
        };
        // Errors of the range refer to the requested range.
        let frames = self.frames(if range.end > self.frame_count() { range.clone() } else { reading.clone() })?;
        let frames = if range.is_empty() { frames } else { frames.with_coding(self.estimated_coding()) };
        Ok(FramesWithNeighbours {
            recording: self.clone(),
            range,
            reading,
            frames,
            ready: VecDeque::new(),
            window: VecDeque::new(),
        })
    }
}

impl FramesWithNeighbours {
    /// Reads the next frame.
    fn read(&mut self) {
        let index = self.reading.start;
        self.reading.start += 1;
        let is_wanted = self.range.contains(&index);
        match self.frames.next() {
            Some(Ok(frame)) => {
                if let Some(depth) = frame.depth.clone() {
                    let (pixels, timestamp_s) = (frame.pixels.clone(), frame.timestamp_s);
                    self.window.push_back(Arc::new(NeighbourFrame { index, timestamp_s, pixels, depth }));
                }
                if is_wanted {
                    self.ready.push_back(Ok(frame));
                }
            }
            Some(Err(error)) => {
                if is_wanted {
                    self.ready.push_back(Err(error));
                }
                self.restart();
            }
            None => self.reading.end = self.reading.start,
        }
    }

    /// Restarts decoding after an unreadable frame.
    fn restart(&mut self) {
        match self.recording.frames(self.reading.clone()) {
            Ok(frames) => self.frames = frames.with_coding(self.recording.estimated_coding()),
            Err(error) => {
                self.ready.push_back(Err(error));
                self.reading.end = self.reading.start;
            }
        }
    }
}

impl Iterator for FramesWithNeighbours {
    type Item = Result<Frame, RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.range.is_empty() {
            return None;
        }
        let index = self.range.start;
        let ahead = if self.recording.has_depth() { NEIGHBOURS_EACH_WAY } else { 0 };
        while !self.reading.is_empty() && self.reading.start <= index + ahead {
            self.read();
        }
        let frame = self.ready.pop_front()?;
        self.range.start = if frame.is_ok() { index + 1 } else { self.range.end };
        let mut frame = match frame {
            Ok(frame) => frame,
            failed => return Some(failed),
        };
        self.window.retain(|beside| beside.index + NEIGHBOURS_EACH_WAY >= index);
        let is_beside =
            |beside: &&Arc<NeighbourFrame>| beside.index != index && beside.index <= index + NEIGHBOURS_EACH_WAY;
        if frame.depth.is_some() {
            frame.neighbours = self.window.iter().filter(is_beside).cloned().collect();
        }
        Some(Ok(frame))
    }
}
