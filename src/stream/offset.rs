//! Offset between a sender's clock and the receiver's, from time stamps and arrivals.
//!
//! A sample that is delayed on the way arrives late, never early, so the smallest difference
//! between arrival and stamp is closest to the offset. A single wrong stamp could make it smaller
//! still. So the third smallest difference of the last seconds is used, with which two others are
//! consistent. If the sender's clock is set, all differences shift; the estimate follows once the
//! shift lasts.

/// Length of a span, seconds: clocks of 50 ppm drift apart by half a millisecond in it. Samples of
/// the current and the previous span are used.
const SPAN_S: f64 = 10.0;
/// Number of consistent samples that an estimate needs.
pub const MIN_CONSISTENT_SAMPLES: usize = 3;
/// Number of samples after which the offset is settled. Before that, delayed samples are still
/// common among the smallest.
const SETTLED: u32 = 10;
/// A stamp is ahead if its sample would have arrived this long before it was taken, seconds.
pub const AHEAD_S: f64 = 0.03;
/// The clock was set back if all samples are behind by more than this for [`BEHIND_FOR_S`],
/// seconds. Detected sooner if stamps repeat ([`super::buffer`]).
pub const BEHIND_S: f64 = 0.02;
/// Networks delay samples for less than this, seconds.
const BEHIND_FOR_S: f64 = 1.0;

/// The smallest numbers so far, ascending; infinite if there are fewer.
#[derive(Clone, Copy, Debug)]
struct Smallest([f64; MIN_CONSISTENT_SAMPLES]);

impl Smallest {
    const NONE: Self = Self([f64::INFINITY; MIN_CONSISTENT_SAMPLES]);

    fn add(&mut self, number: f64) {
        let at = self.0.partition_point(|smaller| *smaller <= number);
        if at < MIN_CONSISTENT_SAMPLES {
            self.0[at..].rotate_right(1);
            self.0[at] = number;
        }
    }

    /// The largest of them; `None` without any.
    fn consistent(&self) -> Option<f64> {
        self.0.iter().rev().copied().find(|number| number.is_finite())
    }
}

/// Estimate of the offset: the receiver's time minus the sender's, seconds.
#[derive(Clone, Debug)]
pub struct ClockOffset {
    samples: u32,
    since_s: f64,
    /// The current and the previous span.
    spans: [Smallest; 2],
    /// Start of the period in which all samples are behind, and the smallest differences in it.
    behind: Option<(f64, Smallest)>,
}

impl Default for ClockOffset {
    fn default() -> Self {
        Self { samples: 0, since_s: f64::NEG_INFINITY, spans: [Smallest::NONE; 2], behind: None }
    }
}

impl ClockOffset {
    /// `None` before the first sample.
    pub fn estimate_s(&self) -> Option<f64> {
        let mut all = self.spans[0];
        self.spans[1].0.into_iter().for_each(|number| all.add(number));
        all.consistent()
    }

    /// True if a stamp is ahead of the estimate from earlier samples.
    pub fn is_ahead(&self, time_s: f64, arrived_s: f64) -> bool {
        let is_less = |estimate_s| arrived_s - time_s < estimate_s - AHEAD_S;
        self.samples >= SETTLED && self.estimate_s().is_some_and(is_less)
    }

    /// Adds a sample. Returns the step, seconds, if the sender's clock turns out to have been set
    /// back.
    pub fn add(&mut self, time_s: f64, arrived_s: f64) -> Option<f64> {
        let offset_s = arrived_s - time_s;
        if arrived_s - self.since_s > SPAN_S {
            (self.since_s, self.spans) = (arrived_s, [Smallest::NONE, self.spans[0]]);
        }
        self.samples = self.samples.saturating_add(1);
        let estimate_s = self.estimate_s();
        self.spans[0].add(offset_s);
        let estimate_s = estimate_s.filter(|estimate_s| offset_s > estimate_s + BEHIND_S);
        let Some(estimate_s) = estimate_s else {
            self.behind = None;
            return None;
        };
        let (since_s, smallest) = self.behind.get_or_insert((arrived_s, Smallest::NONE));
        smallest.add(offset_s);
        if arrived_s - *since_s < BEHIND_FOR_S || smallest.0[MIN_CONSISTENT_SAMPLES - 1].is_infinite() {
            return None;
        }
        let step_s = smallest.consistent().map(|now_s| now_s - estimate_s);
        *self = Self { spans: [*smallest, Smallest::NONE], since_s: arrived_s, behind: None, ..*self };
        step_s
    }

    /// Restarts with samples of a clock that was set. Returns the step, seconds.
    pub fn restart(&mut self, samples: impl Iterator<Item = (f64, f64)>) -> f64 {
        let before_s = self.estimate_s();
        let settled = self.samples;
        *self = Self::default();
        samples.for_each(|(time_s, arrived_s)| _ = self.add(time_s, arrived_s));
        self.samples = settled;
        before_s.zip(self.estimate_s()).map_or(0.0, |(before_s, now_s)| before_s - now_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A number of samples at 100 Hz whose clock is 95 s ahead, delayed by 1 ms, from a start time
    /// on.
    fn steady(offset: &mut ClockOffset, from_s: f64, count: u32) {
        for i in 0..count {
            let sent_s = from_s + 0.01 * f64::from(i);
            assert_eq!(offset.add(sent_s + 95.0, sent_s + 0.001), None);
        }
    }

    #[track_caller]
    fn is_near(offset: &ClockOffset, expected_s: f64) {
        let found_s = offset.estimate_s().unwrap();
        assert!((found_s - expected_s).abs() < 1e-9, "{found_s}, {expected_s} is expected");
    }

    #[test]
    fn offset_is_the_third_smallest_difference() {
        let mut offset = ClockOffset::default();
        assert_eq!(offset.estimate_s(), None);
        // Delayed by 30, 5, 50, 6 and 7 ms.
        for (late_s, expected_s) in [(0.03, 0.03), (0.005, 0.03), (0.05, 0.05), (0.006, 0.03), (0.007, 0.007)] {
            offset.add(100.0, 5.0 + late_s);
            is_near(&offset, -95.0 + expected_s);
        }
    }

    #[test]
    fn old_samples_are_forgotten_after_two_spans() {
        let mut offset = ClockOffset::default();
        steady(&mut offset, 0.0, 10);
        // The sender's clock falls behind by 1 ms.
        for (at_s, expected_s) in [(10.5, 0.001), (10.6, 0.001), (10.7, 0.001), (21.0, 0.002)] {
            offset.add(at_s + 95.0, at_s + 0.002);
            is_near(&offset, -95.0 + expected_s);
        }
    }

    #[test]
    fn two_wrong_stamps_do_not_change_the_estimate() {
        let mut offset = ClockOffset::default();
        steady(&mut offset, 0.0, 200);
        assert!(offset.is_ahead(2.0 + 95.1, 2.001) && !offset.is_ahead(2.0 + 95.02, 2.001));
        for ahead_s in [0.02, 0.1] {
            offset.add(2.0 + 95.0 + ahead_s, 2.001);
        }
        is_near(&offset, -95.0 + 0.001);
    }

    #[test]
    fn clock_set_back_is_followed_after_a_second() {
        let mut offset = ClockOffset::default();
        steady(&mut offset, 0.0, 200);
        let steps: Vec<(u32, f64)> = (0..150)
            .filter_map(|i| {
                let sent_s = 2.0 + 0.01 * f64::from(i);
                Some((i, offset.add(sent_s + 95.0 - 0.3, sent_s + 0.001)?))
            })
            .collect();
        assert!(matches!(steps.as_slice(), [(100 | 101, step_s)] if (step_s - 0.3).abs() < 1e-9), "{steps:?}");
        is_near(&offset, -94.7 + 0.001);
        // A network that delays everything for a shorter time is not a step.
        let mut offset = ClockOffset::default();
        steady(&mut offset, 0.0, 200);
        for i in 0..90 {
            assert_eq!(offset.add(2.0 + 0.01 * f64::from(i) + 95.0, 2.3 + 0.01 * f64::from(i)), None);
        }
        steady(&mut offset, 2.9, 200);
        is_near(&offset, -95.0 + 0.001);
    }

    #[test]
    fn clock_set_forward_is_followed_on_restart() {
        let mut offset = ClockOffset::default();
        steady(&mut offset, 0.0, 200);
        let step_s = offset.restart((0..3).map(|i| (2.0 + 0.01 * f64::from(i) + 95.2, 2.001 + 0.01 * f64::from(i))));
        assert!((step_s - 0.2).abs() < 1e-9, "{step_s}");
        is_near(&offset, -95.2 + 0.001);
    }
}
