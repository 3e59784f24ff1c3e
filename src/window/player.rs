//! Playback position and pace.

use std::ops::Range;

/// Playback pace.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pace {
    /// The recording's clock times a factor. Late frames are dropped and counted.
    Recorded(f64),
    /// Every frame, as fast as possible.
    EveryFrame,
    /// Live: only the newest frame of the camera exists.
    Arriving,
}

/// Playback state. It has no clock of its own: `advance` gets the elapsed time.
#[derive(Clone, Debug)]
pub struct Player {
    /// Timestamps of the frames, seconds, ascending.
    timestamps_s: Vec<f64>,
    frame: usize,
    pub playing: bool,
    pub pace: Pace,
    /// The loop.
    range: Range<usize>,
    /// Playback time on the recording's clock, seconds.
    time_s: f64,
    /// Frames that were due while playing and not composited.
    pub dropped: usize,
}

impl Player {
    /// Paused at the first frame. The recording has at least one frame.
    pub fn new(timestamps_s: &[f64]) -> Self {
        let time_s = timestamps_s.first().copied().unwrap_or(0.0);
        let range = 0..timestamps_s.len().max(1);
        let pace = Pace::Recorded(1.0);
        Self { timestamps_s: timestamps_s.to_vec(), frame: 0, playing: false, pace, range, time_s, dropped: 0 }
    }

    /// A playing live view.
    pub fn arriving() -> Self {
        Self { playing: true, pace: Pace::Arriving, ..Self::new(&[]) }
    }

    /// Sets a camera's newest frame.
    pub fn arrive(&mut self, frame: usize) {
        self.frame = frame;
    }

    pub fn frame(&self) -> usize {
        self.frame
    }

    pub fn count(&self) -> usize {
        self.timestamps_s.len()
    }

    pub fn range(&self) -> Range<usize> {
        self.range.clone()
    }

    /// Sets the loop, at least one frame.
    pub fn set_range(&mut self, range: Range<usize>) {
        let start = range.start.min(self.count().saturating_sub(1));
        self.range = start..range.end.clamp(start + 1, self.count().max(start + 1));
    }

    pub fn play(&mut self, playing: bool) {
        if playing && !self.playing {
            self.dropped = 0;
            if !self.range.contains(&self.frame) {
                self.seek(self.range.start);
            }
        }
        self.playing = playing;
    }

    /// Goes to a frame, at most the last one.
    pub fn seek(&mut self, frame: usize) {
        self.frame = frame.min(self.count().saturating_sub(1));
        self.time_s = self.timestamps_s.get(self.frame).copied().unwrap_or(0.0);
    }

    /// Steps by frames and pauses.
    pub fn step(&mut self, by: isize) {
        self.playing = false;
        self.seek(self.frame.saturating_add_signed(by));
    }

    /// Advances by the elapsed time to the frame that is due now. `is_begun`: compositing of the
    /// previous due frame has begun.
    pub fn advance(&mut self, seconds: f64, is_begun: bool) {
        if !self.playing || self.count() < 2 {
            return;
        }
        let next = if self.frame + 1 < self.range.end { self.frame + 1 } else { self.range.start };
        match self.pace {
            Pace::Arriving => {}
            Pace::EveryFrame => {
                if is_begun {
                    self.seek(next);
                }
            }
            Pace::Recorded(speed) => {
                self.time_s += seconds * speed;
                let end_s = self.end_s();
                if self.time_s >= end_s {
                    let start_s = self.timestamps_s[self.range.start];
                    self.dropped += (self.range.end - 1).saturating_sub(self.frame);
                    self.frame = self.range.start;
                    // Long stalls of the machine are not caught up.
                    self.time_s = start_s + (self.time_s - end_s).min(0.5 * (end_s - start_s).max(0.0));
                }
                let due = self.timestamps_s[self.range.clone()].partition_point(|t| *t <= self.time_s);
                let due = (self.range.start + due).saturating_sub(1).max(self.frame);
                self.dropped += (due - self.frame).saturating_sub(1) + usize::from(due > self.frame && !is_begun);
                self.frame = due;
            }
        }
    }

    /// Seconds until the next frame is due; `None` if the pace does not depend on time or playback
    /// is paused.
    pub fn due_in_s(&self) -> Option<f64> {
        let Pace::Recorded(speed) = self.pace else { return None };
        if !self.playing || self.count() < 2 {
            return None;
        }
        let next = self.frame + 1;
        let due_s = if next < self.range.end { self.timestamps_s[next] } else { self.end_s() };
        Some(((due_s - self.time_s) / speed).max(0.0))
    }

    /// End of the last frame of the loop, seconds.
    fn end_s(&self) -> f64 {
        let times = &self.timestamps_s[self.range.clone()];
        let (first, last) = (times[0], times[times.len() - 1]);
        let interval_s = if times.len() > 1 { (last - first) / (times.len() - 1) as f64 } else { 1.0 / 30.0 };
        last + interval_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn player() -> Player {
        let times: Vec<f64> = (0..10).map(|i| 5.0 + 0.1 * f64::from(i)).collect();
        Player::new(&times)
    }

    #[test]
    fn recorded_pace_counts_dropped_frames() {
        let mut player = player();
        player.advance(1.0, true);
        assert_eq!(player.frame(), 0, "it rests");
        player.play(true);
        player.advance(0.11, true);
        assert_eq!((player.frame(), player.dropped), (1, 0));
        player.advance(0.05, true);
        assert_eq!((player.frame(), player.dropped), (1, 0));
        // Frames 2 and 3 were skipped between two calls.
        player.advance(0.25, true);
        assert_eq!((player.frame(), player.dropped), (4, 2));
        // Compositing of frame 4 had not begun.
        player.advance(0.1, false);
        assert_eq!((player.frame(), player.dropped), (5, 3));
        // Wraps around, from 5.51 to 6.01.
        player.advance(0.5, true);
        assert_eq!(player.frame(), 0);
    }

    #[test]
    fn playback_beyond_the_loop_returns_into_it() {
        let mut player = player();
        player.set_range(0..3);
        player.play(true);
        player.seek(9);
        // The end of the loop was 0.65 s ago; at most half of the loop is caught up.
        player.advance(0.05, true);
        assert_eq!((player.frame(), player.dropped), (1, 0));
    }

    #[test]
    fn every_frame_pace_skips_none_and_wraps_in_the_loop() {
        let mut player = player();
        player.pace = Pace::EveryFrame;
        player.set_range(3..6);
        player.play(true);
        let mut frames = vec![player.frame()];
        for _ in 0..4 {
            player.advance(1e-3, false);
            player.advance(1e-3, true);
            frames.push(player.frame());
        }
        assert_eq!(frames, [3, 4, 5, 3, 4]);
        player.step(-10);
        assert!(player.frame() == 0 && !player.playing);
        player.set_range(40..50);
        assert_eq!(player.range(), 9..10);
        player.seek(99);
        assert_eq!(player.frame(), 9);
    }
}
