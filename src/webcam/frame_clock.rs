//! Converts drivers' time stamps to the monotonic clock.

use super::clock::wall_offset_s;
use super::driver::Stamp;
use crate::stream::ClockOffset;

/// Older stamps are implausible, seconds.
const MAX_AGE_S: f64 = 10.0;
/// A camera clock that differs from arrivals by more than this has jumped, seconds.
const MAX_CLOCK_STEP_S: f64 = 1.0;

/// The times of one camera's pictures. Each is later than the one before.
#[derive(Debug)]
pub struct FrameClock {
    offset: ClockOffset,
    /// The time of the last picture, s.
    last_s: f64,
    /// The last plausible stamp by the monotonic clock, or by one that the driver does not name, s.
    last_stamp_s: f64,
    /// Time from the last plausible stamp to the arrival, s.
    delay_s: f64,
    /// Pictures with an implausible stamp, whose time follows from their arrival.
    pub implausible: u64,
}

impl Default for FrameClock {
    fn default() -> Self {
        Self {
            offset: ClockOffset::default(),
            last_s: f64::NEG_INFINITY,
            last_stamp_s: f64::NEG_INFINITY,
            delay_s: 0.0,
            implausible: 0,
        }
    }
}

impl FrameClock {
    /// True for the stamp of a picture that was delivered before, or of an older one.
    pub fn is_repeated(&self, stamp: Stamp) -> bool {
        matches!(stamp, Stamp::Monotonic(time_s) | Stamp::UnnamedClock(time_s) if time_s <= self.last_stamp_s)
    }

    /// The time of a picture that arrived at a time, both in seconds of the monotonic clock.
    ///
    /// A stamp is implausible if it is later than the arrival, more than [`MAX_AGE_S`] earlier, or
    /// not later than the picture before. The time of such a picture is its arrival minus the delay
    /// of the last plausible stamp. A picture without a stamp, or with an implausible one of a
    /// clock that the driver does not name, has the time of its arrival.
    pub fn time_s(&mut self, stamp: Stamp, arrived_s: f64) -> f64 {
        self.with_wall_offset_s(stamp, arrived_s, wall_offset_s)
    }

    fn with_wall_offset_s(&mut self, stamp: Stamp, arrived_s: f64, wall_offset_s: impl Fn() -> f64) -> f64 {
        let last_s = self.last_s;
        let is_plausible = |time_s: f64| {
            let is_recent = (arrived_s - MAX_AGE_S..=arrived_s).contains(&time_s);
            is_recent && time_s > last_s
        };
        let stamped_s = match stamp {
            Stamp::Exact(time_s) => return time_s,
            Stamp::Missing => None,
            Stamp::Monotonic(time_s) => Some(time_s),
            Stamp::UnnamedClock(time_s) => Some(time_s).filter(|&time_s| is_plausible(time_s)),
            Stamp::Wall(time_s) => Some(time_s - wall_offset_s()),
            Stamp::Relative(time_s) => Some(self.relative_s(time_s, arrived_s)),
        };
        if let Stamp::Monotonic(time_s) | Stamp::UnnamedClock(time_s) = stamp
            && is_plausible(time_s)
        {
            self.last_stamp_s = time_s;
        }
        let time_s = match stamped_s {
            Some(time_s) if is_plausible(time_s) => {
                self.delay_s = arrived_s - time_s;
                time_s
            }
            Some(_) => {
                self.implausible += 1;
                (arrived_s - self.delay_s).max(self.last_s.next_up())
            }
            None => arrived_s,
        };
        self.last_s = time_s;
        time_s
    }

    /// A picture is never delivered before it is taken, so the smallest differences between arrival
    /// and stamp are nearest to the offset of the camera's clock. The third smallest difference of
    /// the last seconds is used: up to two outliers do not move it.
    fn relative_s(&mut self, time_s: f64, arrived_s: f64) -> f64 {
        if !time_s.is_finite() {
            return f64::NAN;
        }
        let has_jumped = |estimate_s: f64| (arrived_s - time_s - estimate_s).abs() > MAX_CLOCK_STEP_S;
        if self.offset.estimate_s().is_some_and(has_jumped) {
            self.offset = ClockOffset::default();
        }
        self.offset.add(time_s, arrived_s);
        let offset_s = self.offset.estimate_s().unwrap_or(arrived_s - time_s);
        (time_s + offset_s).min(arrived_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn times(stamps: impl IntoIterator<Item = (Stamp, f64)>) -> (Vec<f64>, u64) {
        let mut clock = FrameClock::default();
        let times = stamps.into_iter().map(|(stamp, at_s)| clock.with_wall_offset_s(stamp, at_s, || 1e9)).collect();
        (times, clock.implausible)
    }

    #[test]
    fn plausible_stamps_are_kept_and_wall_clock_stamps_are_converted() {
        use Stamp::{Exact, Missing, Monotonic, Wall};
        let (times, implausible) = times([
            (Monotonic(99.5), 100.0),
            (Wall(1e9 + 100.5), 101.0),
            (Missing, 102.0),
            // A file's times are its own.
            (Exact(50.0), 103.0),
        ]);
        assert_eq!((times, implausible), (vec![99.5, 100.5, 102.0, 50.0], 0));
    }

    #[test]
    fn implausible_stamps_are_replaced_by_the_arrival_minus_the_last_delay() {
        use Stamp::{Monotonic, Wall};
        let (times, implausible) = times([
            (Monotonic(100.1), 100.0),
            (Monotonic(90.9), 101.0),
            (Wall(0.0), 102.0),
            (Monotonic(f64::NAN), 103.0),
            (Monotonic(103.5), 104.0),
            // Before the last one.
            (Monotonic(103.4), 105.0),
            (Wall(1e9 + 1e6), 106.0),
        ]);
        assert_eq!((times, implausible), (vec![100.0, 101.0, 102.0, 103.0, 103.5, 104.5, 105.5], 6));
    }

    #[test]
    fn stamps_of_an_unnamed_clock_are_used_where_they_are_plausible_and_never_counted() {
        use Stamp::UnnamedClock;
        let (times, implausible) = times([
            (UnnamedClock(99.98), 100.0),
            (UnnamedClock(101.5), 101.0),
            (UnnamedClock(7.0), 102.0),
            (UnnamedClock(102.96), 103.0),
        ]);
        assert_eq!((times, implausible), (vec![99.98, 101.0, 102.0, 102.96], 0));
    }

    #[test]
    fn stamp_is_repeated_up_to_the_last_one_of_its_clock() {
        use Stamp::{Monotonic, UnnamedClock, Wall};
        let mut clock = FrameClock::default();
        assert!(!clock.is_repeated(Monotonic(-5.0)));
        clock.time_s(UnnamedClock(99.5), 100.0);
        clock.time_s(Monotonic(f64::INFINITY), 100.1);
        for (stamp, is_repeated) in
            [(UnnamedClock(99.5), true), (Monotonic(99.4), true), (UnnamedClock(99.6), false), (Wall(1.0), false)]
        {
            assert_eq!(clock.is_repeated(stamp), is_repeated, "{stamp:?}");
        }
    }

    #[test]
    fn stamps_are_used_again_after_one_that_is_implausible() {
        // 120 Hz, 20 ms from the stamp to the arrival: longer than the interval.
        let taken_s = |i: u32| 100.0 + f64::from(i) / 120.0;
        let stamps = (0..60).map(|i| {
            let stamp_s = if i == 30 { taken_s(i) + 5.0 } else { taken_s(i) };
            (Stamp::Monotonic(stamp_s), taken_s(i) + 0.02)
        });
        let (times, implausible) = times(stamps);
        assert_eq!(implausible, 1);
        for (i, time_s) in (0..60).zip(times) {
            let tolerance_s = if i == 30 { 1e-9 } else { 0.0 };
            assert!((time_s - taken_s(i)).abs() <= tolerance_s, "{i}: {time_s}, {} is expected", taken_s(i));
        }
    }

    #[test]
    fn relative_clock_keeps_its_offset_over_a_stamp_that_is_no_number() {
        // The first arrivals are early; the later ones alone would give another offset.
        let stamps = (0..40).map(|i| {
            let taken_s = 100.0 + 0.1 * f64::from(i);
            let stamp_s = if i == 20 { f64::NAN } else { taken_s };
            (Stamp::Relative(stamp_s), taken_s + if i < 10 { 0.01 } else { 0.02 })
        });
        let (times, implausible) = times(stamps);
        assert_eq!(implausible, 1);
        for (i, time_s) in (0..40).zip(times) {
            let expected_s = 100.01 + 0.1 * f64::from(i);
            assert!((time_s - expected_s).abs() < 1e-9, "{i}: {time_s}, {expected_s} is expected");
        }
    }

    /// Pictures every 0.1 s, taken at the whole tenths, with arrivals held up by 10, 30 or 20 ms.
    fn delayed_stamp(i: u32) -> (f64, f64) {
        let taken_s = 100.0 + 0.1 * f64::from(i);
        (taken_s, taken_s + [0.01, 0.03, 0.02][i as usize % 3])
    }

    #[test]
    fn relative_stamps_follow_the_earliest_arrivals() {
        let stamps =
            (0..30).map(delayed_stamp).map(|(taken_s, arrived_s)| (Stamp::Relative(taken_s - 77.0), arrived_s));
        let (times, implausible) = times(stamps);
        assert_eq!(implausible, 0);
        for (i, time_s) in (0..30).zip(times).skip(9) {
            let expected_s = delayed_stamp(i).0 + 0.01;
            assert!((time_s - expected_s).abs() < 1e-9, "{i}: {time_s}, {expected_s} is expected");
        }
    }

    #[test]
    fn relative_clock_that_jumps_is_followed_at_once() {
        for (step_s, name) in [(-1000.0, "back"), (1000.0, "ahead"), (f64::NAN, "nowhere")] {
            let stamps = (0..60).map(|i| {
                let (taken_s, arrived_s) = delayed_stamp(i);
                let set_s = if i < 30 { 0.0 } else { step_s };
                (Stamp::Relative(taken_s + set_s), arrived_s)
            });
            let (times, _) = times(stamps);
            assert!(times.windows(2).all(|pair| pair[0] < pair[1]), "{name}: {times:?}");
            for (i, time_s) in (0..60).zip(times) {
                let (taken_s, arrived_s) = delayed_stamp(i);
                let expected_s = taken_s - 1e-9..=arrived_s;
                assert!(expected_s.contains(&time_s), "{name}, {i}: {time_s} of {taken_s} to {arrived_s}");
            }
        }
    }
}
