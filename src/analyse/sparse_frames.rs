//! Reads selected frames in order. Long gaps between them are not decoded.

use std::ops::Range;

use crate::frame::Frame;
use crate::recording::{Recording, RecordingError};

/// Longest gap that is decoded and discarded, frames. The reader restarts after longer ones.
const MAX_DECODED_GAP: usize = 8;

/// Reads the frames of ascending indices. The result can contain others in between.
pub fn frames(
    recording: &Recording,
    indices: impl Iterator<Item = usize>,
) -> impl Iterator<Item = Result<Frame, RecordingError>> {
    runs(indices).into_iter().flat_map(|run| -> Box<dyn Iterator<Item = _>> {
        match recording.frames(run) {
            Ok(frames) => Box::new(frames),
            Err(error) => Box::new(std::iter::once(Err(error))),
        }
    })
}

fn runs(indices: impl Iterator<Item = usize>) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for n in indices {
        match runs.last_mut() {
            Some(last) if n <= last.end + MAX_DECODED_GAP => last.end = n + 1,
            _ => runs.push(n..n + 1),
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_gaps_are_decoded_and_long_ones_are_not() {
        assert_eq!(runs([0, 2, 4, 13, 23, 25].into_iter()), [0..14, 23..26]);
        assert_eq!(runs(std::iter::empty()), []);
    }
}
