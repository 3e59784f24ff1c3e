//! Index of a video's frames, so that decoding need not start at the beginning of the file.

use std::sync::atomic::{AtomicBool, Ordering};

/// Frames by their times in the file, and the keyframes among them.
#[derive(Debug)]
pub struct Index {
    /// Seconds a tick, as in `1/90000`.
    tick_s: String,
    /// Display time of each frame in ticks, ascending; the index is the frame's number.
    frames: Vec<i64>,
    /// Ticks and seconds, ascending. Some may not be shown.
    keyframes: Vec<(i64, f64)>,
    /// Set when the file turns out not to match its index.
    is_wrong: AtomicBool,
}

/// Times and kind of a packet.
#[derive(Clone, Copy, Debug)]
pub struct IndexEntry {
    pub ticks: i64,
    pub time_s: f64,
    pub is_keyframe: bool,
    pub is_shown: bool,
}

/// A position in a file from which a frame can be decoded.
#[derive(Clone, Debug, PartialEq)]
pub struct DecodingStart {
    /// A keyframe's time, seconds.
    pub time_s: f64,
    /// The requested frame's time in the file, in ticks of `tick_s` seconds.
    pub ticks: i64,
    pub tick_s: String,
}

impl Index {
    /// `None` if the times do not distinguish the frames.
    pub fn new(tick_s: &str, entries: &[IndexEntry]) -> Option<Self> {
        let mut frames: Vec<i64> = entries.iter().filter(|e| e.is_shown).map(|e| e.ticks).collect();
        frames.sort_unstable();
        let mut keyframes: Vec<_> = entries.iter().filter(|e| e.is_keyframe).map(|e| (e.ticks, e.time_s)).collect();
        keyframes.sort_unstable_by_key(|key| key.0);
        let is_tick = |text: &str| text.split('/').count() == 2 && text.split('/').all(|n| n.parse::<u32>().is_ok());
        let tells = frames.windows(2).all(|pair| pair[0] < pair[1]) && is_tick(tick_s);
        tells.then(|| Self { tick_s: tick_s.to_owned(), frames, keyframes, is_wrong: AtomicBool::new(false) })
    }

    /// Position to start from for a frame; `None` for the start of the file.
    ///
    /// It is the keyframe before the one that the frame depends on. Frames displayed before a
    /// keyframe may come after it in the file and depend on earlier data (open GOP), and intra
    /// refresh completes a picture only a round later.
    pub fn start(&self, frame: usize) -> Option<DecodingStart> {
        let ticks = *self.frames.get(frame)?;
        let before = self.keyframes.partition_point(|key| key.0 <= ticks);
        // The first keyframe is the file's start.
        let (_, time_s) = *self.keyframes.get(before.checked_sub(2).filter(|n| *n > 0)?)?;
        let is_right = time_s >= 0.0 && !self.is_wrong.load(Ordering::Relaxed);
        is_right.then(|| DecodingStart { time_s, ticks, tick_s: self.tick_s.clone() })
    }

    /// Decodes all later frames from the start of the file.
    pub fn distrust(&self) {
        self.is_wrong.store(true, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Twelve frames, a quarter of a second and 100 ticks each; every third is a keyframe. In the
    /// file, one in three is shown before the frame that precedes it.
    fn entries() -> Vec<IndexEntry> {
        let order = [0, 2, 1, 3, 5, 4, 6, 8, 7, 9, 11, 10];
        let entry =
            |n: i64| IndexEntry { ticks: 100 * n, time_s: 0.25 * n as f64, is_keyframe: n % 3 == 0, is_shown: true };
        order.map(entry).to_vec()
    }

    #[test]
    fn decoding_starts_one_keyframe_earlier() {
        let index = Index::new("1/400", &entries()).unwrap();
        let start = |frame| index.start(frame).map(|start| (start.time_s, start.ticks));
        // Before the second keyframe there is nothing to be saved.
        assert_eq!([0, 5, 12].map(start), [None; 3]);
        assert_eq!([6, 8, 9].map(start), [Some((0.75, 600)), Some((0.75, 800)), Some((1.5, 900))]);
        index.distrust();
        assert_eq!(start(9), None);
    }

    #[test]
    fn frames_that_are_not_shown_are_not_counted() {
        let mut hidden = entries();
        hidden[0].is_shown = false;
        assert_eq!(Index::new("1/400", &hidden).unwrap().start(8).unwrap().ticks, 900);
    }

    #[test]
    fn ambiguous_times_give_no_index() {
        let mut twice = entries();
        twice[1].ticks = 100;
        assert!(Index::new("1/400", &twice).is_none());
        for odd in ["", "1", "1/0x3", "1/2,evil", "a/b", "1/2/3"] {
            assert!(Index::new(odd, &entries()).is_none(), "{odd}");
        }
    }
}
