//! Frames of a camera that were displayed in the last seconds, with their latency and tracking
//! state.

use std::collections::VecDeque;

use locard_engine::fit::quantile::upper_median;
use locard_engine::live::Tracking;

/// Length of the history, s.
pub const RECENT_S: f64 = 10.0;
/// Window of the median latency, s.
const LATENCY_WINDOW_S: f64 = 1.0;
/// Largest number of frames in flight, with a margin: failed pictures are not reported.
const MAX_PENDING_FRAMES: usize = 8;

/// A displayed frame, by the camera's clock, s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RecentFrame {
    pub taken_s: f64,
    /// Latency from capture to compositing.
    pub latency_s: f64,
    pub tracking: Tracking,
}

/// The displayed frames and those in flight. Callers pass the time.
#[derive(Clone, Debug, Default)]
pub struct RecentFrames {
    /// Frames in flight: capture time and tracking state.
    in_flight: VecDeque<(f64, Tracking)>,
    displayed: VecDeque<RecentFrame>,
}

impl RecentFrames {
    /// Adds a frame in flight.
    pub fn start(&mut self, taken_s: f64, tracking: Tracking) {
        self.in_flight.push_back((taken_s, tracking));
        if self.in_flight.len() > MAX_PENDING_FRAMES {
            self.in_flight.pop_front();
        }
    }

    /// Moves a frame from in flight to displayed. A frame that is composited again, after a change
    /// of settings, counts once.
    pub fn finish(&mut self, taken_s: f64, now_s: f64) {
        let Some(index) = self.in_flight.iter().position(|(taken_at_s, _)| *taken_at_s == taken_s) else { return };
        let (_, tracking) = self.in_flight[index];
        self.in_flight.drain(..=index);
        self.displayed.push_back(RecentFrame { taken_s, latency_s: now_s - taken_s, tracking });
        self.displayed.retain(|displayed| displayed.taken_s > taken_s - RECENT_S);
    }

    pub fn displayed(&self) -> impl Iterator<Item = &RecentFrame> {
        self.displayed.iter()
    }

    /// Median latency from capture to compositing over the last second, s.
    pub fn latency_s(&self, now_s: f64) -> Option<f64> {
        let last = self.displayed.iter().filter(|displayed| displayed.taken_s > now_s - LATENCY_WINDOW_S);
        upper_median(last.map(|displayed| displayed.latency_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn states(frames: &RecentFrames) -> Vec<(f64, Tracking)> {
        frames.displayed().map(|displayed| (displayed.taken_s, displayed.tracking)).collect()
    }

    #[test]
    fn each_frame_keeps_its_own_tracking_state() {
        let mut frames = RecentFrames::default();
        frames.start(1.0, Tracking::Tracked);
        frames.start(1.5, Tracking::Lost);
        frames.finish(1.0, 1.25);
        assert_eq!(states(&frames), [(1.0, Tracking::Tracked)]);
        frames.finish(1.5, 2.0);
        assert_eq!(states(&frames), [(1.0, Tracking::Tracked), (1.5, Tracking::Lost)]);
        // A repeated frame does not count again.
        frames.finish(1.5, 9.0);
        assert_eq!(states(&frames).len(), 2);
        assert_eq!(frames.latency_s(2.0), Some(0.5), "a quarter and a half");
        assert_eq!(frames.latency_s(3.0), None);
    }

    #[test]
    fn lost_and_old_frames_are_dropped() {
        let mut frames = RecentFrames::default();
        (0..1000).for_each(|n| frames.start(f64::from(n), Tracking::Lost));
        assert_eq!(frames.in_flight.len(), MAX_PENDING_FRAMES);
        frames.finish(0.0, 0.0);
        assert!(states(&frames).is_empty());
        for n in 1000..1100 {
            frames.start(f64::from(n), Tracking::Predicted);
            frames.finish(f64::from(n), f64::from(n));
        }
        assert_eq!(states(&frames).len(), 10);
    }
}
