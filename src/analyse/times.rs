//! How long the parts of an analysis took: no part of it, since it differs from run to run.

use std::time::{Duration, Instant};

pub const READING: &str = "waiting for pictures";
pub const CLOCKS: &str = "clocks, readout and the camera's place";
pub const LINKS: &str = "links between all frames";
pub const GRAPH: &str = "pose graph";
pub const AGAIN: &str = "links once more, by refined poses";
pub const DEPTH: &str = "depth's clock";
pub const DEPTHS: &str = "each frame's depth";
pub const GAIN: &str = "gain";
pub const EXPOSURE: &str = "exposure";
pub const SHARPNESS: &str = "sharpness";
pub const LIGHT: &str = "light";

/// Wall time by part, in the order in which the parts began.
#[derive(Clone, Debug, Default)]
pub struct Times {
    parts: Vec<(&'static str, Duration)>,
}

impl Times {
    pub fn add(&mut self, part: &'static str, took: Duration) {
        match self.parts.iter_mut().find(|(name, _)| *name == part) {
            Some((_, sum)) => *sum += took,
            None => self.parts.push((part, took)),
        }
    }

    /// Does what is a part's, and adds how long that took.
    pub fn of<T>(&mut self, part: &'static str, work: impl FnOnce() -> T) -> T {
        let begun = Instant::now();
        let done = work();
        self.add(part, begun.elapsed());
        done
    }

    /// Each part once.
    pub fn parts(&self) -> &[(&'static str, Duration)] {
        &self.parts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_that_comes_again_is_one() {
        let mut times = Times::default();
        for (part, ms) in [(LINKS, 30), (READING, 5), (LINKS, 12)] {
            times.add(part, Duration::from_millis(ms));
        }
        assert_eq!(times.of(GRAPH, || 7), 7);
        assert_eq!(times.parts()[..2], [(LINKS, Duration::from_millis(42)), (READING, Duration::from_millis(5))]);
        assert_eq!(times.parts()[2].0, GRAPH);
    }
}
