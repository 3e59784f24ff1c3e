//! Frames that are looked at, in order. What lies between is not decoded where it is much.

use std::ops::Range;

use crate::frame::Frame;
use crate::recording::{Recording, RecordingError};

/// So many frames are decoded and thrown away rather than begun anew after them.
const SKIPPED: usize = 8;

/// `wanted` ascends. Others may come between.
pub fn frames(
    recording: &Recording,
    wanted: impl Iterator<Item = usize>,
) -> impl Iterator<Item = Result<Frame, RecordingError>> {
    runs(wanted).into_iter().flat_map(|run| -> Box<dyn Iterator<Item = _>> {
        match recording.frames(run) {
            Ok(frames) => Box::new(frames),
            Err(error) => Box::new(std::iter::once(Err(error))),
        }
    })
}

fn runs(wanted: impl Iterator<Item = usize>) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for n in wanted {
        match runs.last_mut() {
            Some(last) if n <= last.end + SKIPPED => last.end = n + 1,
            _ => runs.push(n..n + 1),
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_few_frames_are_skipped_and_many_are_not_read() {
        assert_eq!(runs([0, 2, 4, 13, 23, 25].into_iter()), [0..14, 23..26]);
        assert_eq!(runs(std::iter::empty()), []);
    }
}
