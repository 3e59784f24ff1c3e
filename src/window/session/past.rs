//! The pictures of a camera that were shown in the last seconds, each with what was known of its own frame.

use std::collections::VecDeque;

use locard_engine::live::Tracking;

/// How much of the past is told of, seconds.
pub const PAST_S: f64 = 10.0;
/// Figures are those of the last second.
const LAST_S: f64 = 1.0;
/// Frames whose pictures are under way at once, and some more: of a picture that fails nothing is heard.
const MOST_UNDER_WAY: usize = 8;

/// A picture of the past, by the camera's clock, seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shown {
    pub taken_s: f64,
    /// From when it was taken until it was composited.
    pub latency_s: f64,
    pub tracking: Tracking,
}

/// See above. It is told the time.
#[derive(Clone, Debug, Default)]
pub struct Past {
    /// Frames that were begun: when they were taken, and how they were tracked.
    begun: VecDeque<(f64, Tracking)>,
    shown: VecDeque<Shown>,
}

impl Past {
    /// The picture of a frame is begun.
    pub fn begin(&mut self, taken_s: f64, tracking: Tracking) {
        self.begun.push_back((taken_s, tracking));
        if self.begun.len() > MOST_UNDER_WAY {
            self.begun.pop_front();
        }
    }

    /// The picture of a frame is composited. One that is shown again counts once: what is changed beneath the pointer shows
    /// the same frame anew.
    pub fn show(&mut self, taken_s: f64, now_s: f64) {
        let Some(at) = self.begun.iter().position(|(begun_s, _)| *begun_s == taken_s) else { return };
        let (_, tracking) = self.begun[at];
        self.begun.drain(..=at);
        self.shown.push_back(Shown { taken_s, latency_s: now_s - taken_s, tracking });
        self.shown.retain(|shown| shown.taken_s > taken_s - PAST_S);
    }

    pub fn shown(&self) -> impl Iterator<Item = &Shown> {
        self.shown.iter()
    }

    /// From when pictures were taken until they were composited, seconds: the median of the last second.
    pub fn latency_s(&self, now_s: f64) -> Option<f64> {
        let last = self.shown.iter().filter(|shown| shown.taken_s > now_s - LAST_S);
        let mut latencies: Vec<f64> = last.map(|shown| shown.latency_s).collect();
        latencies.sort_by(f64::total_cmp);
        latencies.get(latencies.len() / 2).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(past: &Past) -> Vec<(f64, Tracking)> {
        past.shown().map(|shown| (shown.taken_s, shown.tracking)).collect()
    }

    #[test]
    fn a_picture_has_its_own_tracking_though_a_newer_one_is_under_way() {
        let mut past = Past::default();
        past.begin(1.0, Tracking::Tracked);
        past.begin(1.5, Tracking::Lost);
        past.show(1.0, 1.25);
        assert_eq!(told(&past), [(1.0, Tracking::Tracked)]);
        past.show(1.5, 2.0);
        assert_eq!(told(&past), [(1.0, Tracking::Tracked), (1.5, Tracking::Lost)]);
        // Shown anew, it is no other one.
        past.show(1.5, 9.0);
        assert_eq!(told(&past).len(), 2);
        assert_eq!(past.latency_s(2.0), Some(0.5), "a quarter and a half");
        assert_eq!(past.latency_s(3.0), None);
    }

    #[test]
    fn pictures_that_never_come_are_forgotten_and_so_is_what_is_long_past() {
        let mut past = Past::default();
        (0..1000).for_each(|n| past.begin(f64::from(n), Tracking::Lost));
        assert_eq!(past.begun.len(), MOST_UNDER_WAY);
        past.show(0.0, 0.0);
        assert!(told(&past).is_empty());
        for n in 1000..1100 {
            past.begin(f64::from(n), Tracking::Predicted);
            past.show(f64::from(n), f64::from(n));
        }
        assert_eq!(told(&past).len(), 10);
    }
}
