//! Durations of the parts of an analysis. They differ from run to run, so they are stored in a file
//! of their own beside it.

use std::borrow::Cow;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;
use std::time::{Duration, Instant};

use crate::sink::atomic::write_atomically;
use crate::source::file;

/// File of the durations, beside an analysis' other files.
pub const FILE: &str = "times.txt";
/// Largest accepted file, bytes, and largest number of its lines.
const MAX_FILE_BYTES: u64 = 1 << 14;
const MAX_PARTS: usize = 64;

pub const READING: &str = "waiting for pictures";
pub const CLOCKS: &str = "clocks, readout and the camera's place";
pub const LINKS: &str = "links between all frames";
pub const GRAPH: &str = "pose graph";
pub const AGAIN: &str = "links once more, by refined poses";
pub const DEPTH: &str = "depth's clock";
pub const DEPTHS: &str = "each frame's depth";
pub const GAIN: &str = "gain";
pub const EXPOSURE: &str = "exposure";
pub const NOISE: &str = "noise";
pub const EXAMPLE_NOISE: &str = "examples of noise";
pub const SHARPNESS: &str = "sharpness";
pub const SURFACES: &str = "surfaces of the room";
pub const LIGHT: &str = "light";

/// Wall time by part, in the order in which the parts began.
#[derive(Clone, Debug, Default)]
pub struct Times {
    parts: Vec<(Cow<'static, str>, Duration)>,
}

impl Times {
    pub fn add(&mut self, part: &'static str, took: Duration) {
        match self.parts.iter_mut().find(|(name, _)| *name == part) {
            Some((_, sum)) => *sum += took,
            None => self.parts.push((part.into(), took)),
        }
    }

    /// Runs `work` and adds its duration to a part.
    pub fn of<T>(&mut self, part: &'static str, work: impl FnOnce() -> T) -> T {
        let begun = Instant::now();
        let done = work();
        self.add(part, begun.elapsed());
        done
    }

    /// Each part once.
    pub fn parts(&self) -> &[(Cow<'static, str>, Duration)] {
        &self.parts
    }

    /// Writes the durations beside an analysis. Errors are ignored.
    pub fn keep(&self, folder: &Path) {
        let mut text =
            "# How long the last run took, by part, s. What an interrupted run had done before is not in it.\n"
                .to_owned();
        for (part, took) in &self.parts {
            let _ = writeln!(text, "{:.3} {part}", took.as_secs_f64());
        }
        let _ = write_atomically(&folder.join(FILE), true, |out| out.write_all(text.as_bytes()));
    }

    /// Reads the durations beside an analysis; `None` without a valid file.
    pub fn read(folder: &Path) -> Option<Self> {
        let text = file::read_text(&folder.join(FILE), MAX_FILE_BYTES).ok()?;
        let part = |line: &str| {
            let (seconds, part) = line.split_once(' ')?;
            let took = Duration::try_from_secs_f64(seconds.parse().ok()?).ok()?;
            Some((Cow::Owned(part.to_owned()), took))
        };
        let lines = text.lines().filter(|line| !line.starts_with('#')).take(MAX_PARTS);
        let parts = lines.map(part).collect::<Option<Vec<_>>>()?;
        (!parts.is_empty()).then_some(Self { parts })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_of_one_part_are_summed() {
        let mut times = Times::default();
        for (part, ms) in [(LINKS, 30), (READING, 5), (LINKS, 12)] {
            times.add(part, Duration::from_millis(ms));
        }
        assert_eq!(times.of(GRAPH, || 7), 7);
        let expected = [(LINKS.into(), Duration::from_millis(42)), (READING.into(), Duration::from_millis(5))];
        assert_eq!(times.parts()[..2], expected);
        assert_eq!(times.parts()[2].0, GRAPH);
    }

    #[test]
    fn written_durations_are_read_back_and_invalid_files_are_ignored() {
        let folder = tempfile::tempdir().unwrap();
        assert!(Times::read(folder.path()).is_none());
        let mut times = Times::default();
        times.add(LINKS, Duration::from_millis(1500));
        times.add(READING, Duration::from_millis(20));
        times.keep(folder.path());
        assert_eq!(Times::read(folder.path()).unwrap().parts(), times.parts());
        for wrong in ["", "nonsense\n", "-1 a part\n", "1e999 a part\n"] {
            std::fs::write(folder.path().join(FILE), wrong).unwrap();
            assert!(Times::read(folder.path()).is_none(), "{wrong}");
        }
    }
}
