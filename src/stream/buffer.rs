//! Reorder buffer: items from the network, in the order of their own clock.
//!
//! Datagrams may arrive out of order. Each item waits a little for earlier ones, unless its
//! sequence number shows that there are none. An item that is older than a released one is late.
//!
//! A clock is followed as long as it advances like time. When it jumps, the second item in a row on
//! the new clock confirms it, and a new epoch begins. A single such item is an outlier. A smaller
//! step needs three consistent items in a row, which are held back until then. A step forward
//! continues the epoch. After a step back times repeat, so a new epoch begins. Two fifths of the
//! file are its tests.

use std::collections::VecDeque;

use super::offset::{AHEAD_S, BEHIND_S, ClockOffset, MIN_CONSISTENT_SAMPLES};

/// Largest difference between the elapsed times of stamps and arrivals without a jump, seconds:
/// streams stutter, and poses may be sent faster than they were recorded.
const MAX_CLOCK_JUMP_S: f64 = 1.0;
/// Capacity: a second of the fastest tracker. Beyond it the first item is released early. With
/// samples of 64 KiB this is 16 MiB.
const BUFFER_CAPACITY: usize = 256;
/// A larger gap in the sequence numbers is not a loss but a restart.
const MAX_SEQUENCE_GAP: u32 = 1000;

#[derive(Clone, Debug, PartialEq)]
pub struct TimedItem<T> {
    /// Time stamp, seconds.
    pub time_s: f64,
    /// Arrival by the receiver's clock, seconds.
    pub arrived_s: f64,
    /// Sequence number, which increases by 1, if the sender counts.
    pub sequence: Option<u32>,
    pub item: T,
}

/// Outcome of an item.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PushOutcome {
    Waits,
    /// Dropped: a later one was already released.
    Late,
    /// Dropped: another one has the same time.
    Repeated,
    /// The time does not fit the clock; the next items decide.
    Odd,
    /// The clock was stepped by this many seconds. `odd` and `behind` are the numbers of earlier
    /// items, reported as odd or late, that are now accepted. `late` and `repeated` are the numbers
    /// of those, and of this item, that are dropped.
    Stepped {
        by_s: f64,
        odd: usize,
        behind: usize,
        late: usize,
        repeated: usize,
    },
    /// The clock jumped by this many seconds: this item and the odd one before it begin a new
    /// epoch. If both have the same time, this item is dropped as repeated.
    Jumped {
        by_s: f64,
        is_repeated: bool,
    },
}

impl PushOutcome {
    /// A step with the outcomes of its items.
    fn stepped(by_s: f64, odd: usize, items: &[Self]) -> Self {
        let count = |what| items.iter().filter(|taken| **taken == what).count();
        Self::Stepped { by_s, odd, behind: 0, late: count(Self::Late), repeated: count(Self::Repeated) }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct ReleasedItem<T> {
    /// Number of jumps of the clock. Times ascend within an epoch.
    pub epoch: u32,
    /// The receiver's clock minus the item's, seconds, as estimated at the arrival.
    pub offset_s: f64,
    /// Number of items lost before this one, by the sequence numbers.
    pub lost: u32,
    pub held: TimedItem<T>,
}

#[derive(Debug)]
struct Queued<T> {
    epoch: u32,
    offset_s: f64,
    held: TimedItem<T>,
}

#[derive(Debug)]
pub struct ReorderBuffer<T> {
    wait_s: f64,
    /// Ascending by epoch, then by time.
    held: VecDeque<Queued<T>>,
    /// Time stamp and arrival of the newest item on the current clock.
    newest: Option<(f64, f64)>,
    epoch: u32,
    /// Offset of the current epoch's clock.
    offset: ClockOffset,
    odd: Option<TimedItem<T>>,
    /// Consecutive items whose stamps are ahead.
    ahead: Vec<TimedItem<T>>,
    /// Consecutive items, ascending, since the clock ran backwards.
    behind: Vec<TimedItem<T>>,
    /// True if all items since the clock was set forward are ahead: they are sent faster than they
    /// were recorded.
    runs_ahead: bool,
    /// Epoch, time stamp and sequence number of the last released item.
    last: Option<(u32, f64, Option<u32>)>,
}

impl<T> ReorderBuffer<T> {
    /// Items wait for earlier ones at most this long, seconds.
    pub fn new(wait_s: f64) -> Self {
        Self {
            wait_s,
            held: VecDeque::new(),
            newest: None,
            epoch: 0,
            offset: ClockOffset::default(),
            odd: None,
            ahead: Vec::new(),
            behind: Vec::new(),
            runs_ahead: false,
            last: None,
        }
    }

    pub fn push(&mut self, item: TimedItem<T>) -> PushOutcome {
        let continues = |(time_s, arrived_s): (f64, f64)| {
            let off_s = (item.time_s - time_s) - (item.arrived_s - arrived_s);
            off_s.abs() <= MAX_CLOCK_JUMP_S
        };
        let in_doubt = self.ahead.last().map(|last| (last.time_s, last.arrived_s));
        if self.newest.is_none_or(continues) || in_doubt.is_some_and(continues) {
            self.odd = None;
            return self.push_continuing(item);
        }
        let proven = self.odd.take().filter(|odd| continues((odd.time_s, odd.arrived_s)));
        let Some(first) = proven else {
            self.odd = Some(item);
            return PushOutcome::Odd;
        };
        let before_s = self.offset.estimate_s();
        self.begin_epoch();
        self.offset = ClockOffset::default();
        self.insert(first);
        let taken = self.insert(item);
        let by_s = before_s.zip(self.offset.estimate_s()).map_or(0.0, |(before_s, now_s)| before_s - now_s);
        match taken {
            PushOutcome::Waits => PushOutcome::Jumped { by_s, is_repeated: false },
            PushOutcome::Repeated => PushOutcome::Jumped { by_s, is_repeated: true },
            other => other,
        }
    }

    fn begin_epoch(&mut self) {
        self.epoch = self.epoch.wrapping_add(1);
        self.newest = None;
        self.ahead.clear();
        self.behind.clear();
        self.runs_ahead = false;
    }

    /// True if an item was sent after the last released one but is stamped before it, or continues
    /// such items. Without sequence numbers an item that was overtaken is indistinguishable;
    /// [`ReorderBuffer::push_behind`] distinguishes the two.
    fn runs_backwards(&self, item: &TimedItem<T>) -> bool {
        let Some((epoch, time_s, sequence)) = self.last else { return false };
        let is_behind =
            |(time_s, arrived_s): (f64, f64)| (item.time_s - time_s) - (item.arrived_s - arrived_s) < -BEHIND_S;
        // `None` without sequence numbers. They may wrap or restart.
        let follows = |before: Option<u32>| {
            let back = before.zip(item.sequence).map(|(before, this)| before.wrapping_sub(this));
            back.map(|back| back > MAX_SEQUENCE_GAP)
        };
        let is_behind = self.newest.is_some_and(is_behind);
        // The step may be shorter than the time between the items that show it.
        let goes_on =
            |last: &TimedItem<T>| is_behind && item.time_s > last.time_s && follows(last.sequence).unwrap_or(true);
        self.behind.last().is_some_and(goes_on)
            || epoch == self.epoch && item.time_s < time_s && follows(sequence).unwrap_or(is_behind)
    }

    /// Adds an item for which the clock ran backwards. The third in a row begins a new epoch.
    fn push_behind(&mut self, item: TimedItem<T>) -> PushOutcome {
        self.ahead.clear();
        if self.behind.last().is_some_and(|last| item.time_s <= last.time_s) {
            self.behind.clear();
        }
        self.behind.push(item);
        let [first, .., last] = self.behind.as_slice() else { return PushOutcome::Late };
        if self.behind.len() < MIN_CONSISTENT_SAMPLES {
            return PushOutcome::Late;
        }
        // Overtaken items arrive all at once, those of a clock at their own pace.
        let span_s = last.time_s - first.time_s;
        let is_at_pace = (last.arrived_s - first.arrived_s - span_s).abs() < 0.5 * span_s;
        if first.sequence.is_none() && !is_at_pace {
            self.behind.remove(0);
            return PushOutcome::Late;
        }
        let proven = std::mem::take(&mut self.behind);
        self.begin_epoch();
        let by_s = self.offset.restart(proven.iter().map(|item| (item.time_s, item.arrived_s)));
        let behind = proven.len() - 1;
        proven.into_iter().for_each(|item| _ = self.queue(item));
        PushOutcome::Stepped { by_s, odd: 0, behind, late: 0, repeated: 0 }
    }

    /// True if an item's stamp is ahead of all items before it and of the newest one.
    fn is_ahead(&self, item: &TimedItem<T>) -> bool {
        let steps = |(time_s, arrived_s)| (item.time_s - time_s) - (item.arrived_s - arrived_s) > AHEAD_S;
        self.newest.is_some_and(steps) && self.offset.is_ahead(item.time_s, item.arrived_s)
    }

    /// Adds an item of the current clock.
    fn push_continuing(&mut self, item: TimedItem<T>) -> PushOutcome {
        if self.runs_backwards(&item) {
            return self.push_behind(item);
        }
        self.behind.clear();
        if !self.is_ahead(&item) {
            self.ahead.clear();
            self.runs_ahead = false;
            return self.insert(item);
        }
        if self.runs_ahead {
            self.offset.restart([(item.time_s, item.arrived_s)].into_iter());
            return self.queue(item);
        }
        self.ahead.push(item);
        if self.ahead.len() < MIN_CONSISTENT_SAMPLES {
            return PushOutcome::Odd;
        }
        let by_s = self.offset.restart(self.ahead.iter().map(|item| (item.time_s, item.arrived_s)));
        self.runs_ahead = true;
        let proven = std::mem::take(&mut self.ahead);
        let odd = proven.len() - 1;
        let taken: Vec<PushOutcome> = proven.into_iter().map(|item| self.queue(item)).collect();
        PushOutcome::stepped(by_s, odd, &taken)
    }

    fn insert(&mut self, item: TimedItem<T>) -> PushOutcome {
        let step_s = self.offset.add(item.time_s, item.arrived_s);
        let taken = self.queue(item);
        step_s.map_or(taken, |step_s| PushOutcome::stepped(-step_s, 0, &[taken]))
    }

    fn queue(&mut self, item: TimedItem<T>) -> PushOutcome {
        if let Some((epoch, time_s, _)) = self.last
            && epoch == self.epoch
            && item.time_s <= time_s
        {
            return if item.time_s == time_s { PushOutcome::Repeated } else { PushOutcome::Late };
        }
        if self.newest.is_none_or(|(time_s, _)| item.time_s > time_s) {
            self.newest = Some((item.time_s, item.arrived_s));
        }
        let place = |queued: &Queued<T>| (queued.epoch, queued.held.time_s);
        let at = self.held.partition_point(|queued| place(queued) < (self.epoch, item.time_s));
        if self.held.get(at).is_some_and(|queued| place(queued) == (self.epoch, item.time_s)) {
            return PushOutcome::Repeated;
        }
        let offset_s = self.offset.estimate_s().unwrap_or_default();
        self.held.insert(at, Queued { epoch: self.epoch, offset_s, held: item });
        PushOutcome::Waits
    }

    /// The next item in order, once no earlier one can arrive or its wait has ended.
    pub fn pop(&mut self, now_s: f64) -> Option<ReleasedItem<T>> {
        let Queued { epoch, held: first, .. } = self.held.front()?;
        let follows = self.last.is_some_and(|last| is_next(last, *epoch, first.sequence));
        let waited = self.due_s().is_some_and(|due_s| now_s >= due_s);
        if !(follows || waited || *epoch != self.epoch || self.held.len() > BUFFER_CAPACITY) {
            return None;
        }
        let Queued { epoch, offset_s, held } = self.held.pop_front()?;
        let before = self.last.filter(|last| last.0 == epoch).and_then(|last| last.2);
        let gap = before.zip(held.sequence).map_or(0, |(before, this)| this.wrapping_sub(before).wrapping_sub(1));
        self.last = Some((epoch, held.time_s, held.sequence));
        Some(ReleasedItem { epoch, offset_s, lost: if gap <= MAX_SEQUENCE_GAP { gap } else { 0 }, held })
    }

    /// The earliest end of a wait, by the receiver's clock, seconds. The item is released then,
    /// after earlier ones.
    pub fn due_s(&self) -> Option<f64> {
        self.held.iter().map(|queued| queued.held.arrived_s + self.wait_s).reduce(f64::min)
    }

    pub fn is_empty(&self) -> bool {
        self.held.is_empty()
    }
}

fn is_next((epoch, _, before): (u32, f64, Option<u32>), this_epoch: u32, this: Option<u32>) -> bool {
    epoch == this_epoch && before.zip(this).is_some_and(|(before, this)| before.wrapping_add(1) == this)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn held(time_s: f64, arrived_s: f64, sequence: Option<u32>) -> TimedItem<()> {
        TimedItem { time_s, arrived_s, sequence, item: () }
    }

    fn out(buffer: &mut ReorderBuffer<()>, now_s: f64) -> Vec<(u32, f64, u32)> {
        std::iter::from_fn(|| buffer.pop(now_s)).map(|r| (r.epoch, r.held.time_s, r.lost)).collect()
    }

    #[test]
    fn items_in_order_do_not_wait_and_overtaken_ones_are_reordered() {
        let mut b = ReorderBuffer::new(0.02);
        assert_eq!(b.push(held(5.00, 0.00, Some(1))), PushOutcome::Waits);
        // The very first item waits: it is unknown whether it is the first.
        assert_eq!(out(&mut b, 0.00), []);
        assert_eq!(b.due_s(), Some(0.02));
        assert_eq!(out(&mut b, 0.02), [(0, 5.00, 0)]);
        assert_eq!(b.push(held(5.01, 0.03, Some(2))), PushOutcome::Waits);
        assert_eq!(out(&mut b, 0.03), [(0, 5.01, 0)]);
        // 4 overtakes 3.
        b.push(held(5.03, 0.04, Some(4)));
        assert_eq!(out(&mut b, 0.045), []);
        b.push(held(5.02, 0.05, Some(3)));
        assert_eq!(out(&mut b, 0.05), [(0, 5.02, 0), (0, 5.03, 0)]);
        // 5 is lost: 6 waits for it and is then released.
        b.push(held(5.05, 0.06, Some(6)));
        assert_eq!(out(&mut b, 0.07), []);
        assert_eq!(out(&mut b, 0.08), [(0, 5.05, 1)]);
        // 5 arrives after all; 6 arrives twice.
        assert_eq!(b.push(held(5.04, 0.09, Some(5))), PushOutcome::Late);
        assert_eq!(b.push(held(5.05, 0.09, Some(6))), PushOutcome::Repeated);
        assert!(b.is_empty());
    }

    #[test]
    fn clock_jump_begins_an_epoch_and_a_single_odd_time_does_not() {
        let mut b = ReorderBuffer::new(0.0);
        b.push(held(100.0, 0.0, None));
        assert_eq!(b.push(held(7.0, 0.1, None)), PushOutcome::Odd);
        assert_eq!(b.push(held(100.2, 0.2, None)), PushOutcome::Waits);
        assert_eq!(out(&mut b, 0.2), [(0, 100.0, 0), (0, 100.2, 0)]);
        // Back by 90 s, continuing from there.
        assert_eq!(b.push(held(10.0, 0.3, None)), PushOutcome::Odd);
        assert!(
            matches!(b.push(held(10.1, 0.4, None)), PushOutcome::Jumped { by_s, is_repeated: false } if (by_s + 90.3).abs() < 1e-9)
        );
        assert_eq!(out(&mut b, 0.4), [(1, 10.0, 0), (1, 10.1, 0)]);
        // Silence for an hour, on both clocks: no jump.
        assert_eq!(b.push(held(3610.5, 3600.8, None)), PushOutcome::Waits);
    }

    #[test]
    fn second_item_at_the_same_time_confirms_a_jump() {
        let mut b = ReorderBuffer::new(0.0);
        b.push(held(100.0, 0.0, None));
        assert_eq!(b.push(held(10.0, 0.1, None)), PushOutcome::Odd);
        assert!(matches!(b.push(held(10.0, 0.11, None)), PushOutcome::Jumped { is_repeated: true, .. }));
        assert_eq!(out(&mut b, 0.2), [(0, 100.0, 0), (1, 10.0, 0)]);
    }

    /// A range of items at 100 Hz on a clock 95 s ahead, each released on arrival.
    fn steady(b: &mut ReorderBuffer<()>, numbers: std::ops::Range<u32>) {
        for i in numbers {
            let sent_s = 0.01 * f64::from(i);
            assert_eq!(b.push(held(sent_s + 95.0, sent_s, Some(i))), PushOutcome::Waits);
            let released = std::iter::from_fn(|| b.pop(sent_s + 1.0)).last().unwrap();
            assert!((released.held.time_s + released.offset_s - sent_s).abs() < 1e-9, "{released:?}");
        }
    }

    #[test]
    fn single_stamp_ahead_is_odd_and_changes_nothing_after_it() {
        let mut b = ReorderBuffer::new(0.02);
        steady(&mut b, 0..200);
        assert_eq!(b.push(held(2.0 + 95.1, 2.0, Some(200))), PushOutcome::Odd);
        steady(&mut b, 201..300);
    }

    #[test]
    fn items_sent_faster_than_recorded_are_all_released() {
        for interval_s in [0.02, 0.1, 0.5] {
            let (mut b, mut times) = (ReorderBuffer::new(0.02), Vec::new());
            for i in 0..300 {
                b.push(held(interval_s * f64::from(i), 0.001 * f64::from(i), Some(i)));
                times.extend(out(&mut b, 0.001 * f64::from(i)));
            }
            times.extend(out(&mut b, 9.0));
            assert_eq!(times.len(), 300, "{interval_s}");
        }
    }

    #[test]
    fn clock_set_forward_is_followed_with_the_third_item() {
        let mut b = ReorderBuffer::new(0.02);
        steady(&mut b, 0..200);
        let ahead = |i: u32| held(0.01 * f64::from(i) + 95.2, 0.01 * f64::from(i), Some(i));
        assert_eq!((b.push(ahead(200)), b.push(ahead(201))), (PushOutcome::Odd, PushOutcome::Odd));
        let taken = b.push(ahead(202));
        assert!(
            matches!(taken, PushOutcome::Stepped { by_s, odd: 2, late: 0, repeated: 0, .. } if (by_s - 0.2).abs() < 1e-9),
            "{taken:?}"
        );
        let out: Vec<_> = std::iter::from_fn(|| b.pop(2.02)).map(|r| r.held.time_s + r.offset_s).collect();
        assert!(out.iter().zip([2.0, 2.01, 2.02]).all(|(a, b)| (a - b).abs() < 1e-9) && out.len() == 3, "{out:?}");
    }

    /// Outcome of poses at 100 Hz, late by up to 3 ms, as the clock is stepped.
    struct Step {
        lost: usize,
        /// Released with the time of another.
        mistimed: usize,
        /// Index (from 1) of the sample at which the step is reported, and the reported step,
        /// seconds.
        reported: Option<(u32, f64)>,
    }

    fn stepped(by_s: f64, is_numbered: bool) -> Step {
        let mut buffer = ReorderBuffer::new(0.02);
        let (mut given, mut mistimed, mut reported) = (0, 0, None);
        let mut random = 1_u32;
        for i in 0..600 {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let sent_s = 0.01 * f64::from(i);
            let arrived_s = sent_s + 0.003 * f64::from(random >> 8) / f64::from(1 << 24);
            let time_s = sent_s + 95.0 + if i >= 200 { by_s } else { 0.0 };
            let sequence = is_numbered.then_some(i);
            match buffer.push(TimedItem { time_s, arrived_s, sequence, item: sent_s }) {
                PushOutcome::Stepped { by_s, .. } | PushOutcome::Jumped { by_s, .. } => {
                    reported = reported.or(Some((i - 199, by_s)))
                }
                _ => {}
            }
            let now_s = if i == 599 { 99.0 } else { arrived_s };
            for released in std::iter::from_fn(|| buffer.pop(now_s)) {
                given += 1;
                let off_s = released.held.time_s + released.offset_s - released.held.item;
                mistimed += usize::from(off_s.abs() > 0.005);
            }
        }
        Step { lost: 600 - given, mistimed, reported }
    }

    #[test]
    fn clock_step_loses_and_mistimes_no_pose() {
        for is_numbered in [true, false] {
            // Without numbers a step as long as the wait resembles overtaken items.
            let small_s = if is_numbered { -0.03 } else { -0.05 };
            for by_s in [-3.0, -0.5, -0.05, small_s, 0.1, 2.0] {
                let Step { lost, mistimed, reported } = stepped(by_s, is_numbered);
                assert_eq!((lost, mistimed), (0, 0), "{by_s} s, numbered: {is_numbered}");
                let (sample, told_s) = reported.unwrap();
                assert!(sample <= 3 && (told_s - by_s).abs() < 0.004, "{by_s} s: {told_s} s with sample {sample}");
            }
        }
    }

    #[test]
    fn overtaken_items_are_late_and_cause_no_step() {
        let mut b = ReorderBuffer::new(0.02);
        let unnumbered = |sent_s: f64, arrived_s: f64| held(sent_s + 95.0, arrived_s, None);
        for i in 0..50 {
            b.push(unnumbered(0.01 * f64::from(i), 0.01 * f64::from(i)));
            out(&mut b, 0.01 * f64::from(i));
        }
        // Sent in between, delayed by 0.2 s, and delivered at once.
        for i in 0..10 {
            let taken = b.push(unnumbered(0.305 + 0.01 * f64::from(i), 0.5 + 0.0001 * f64::from(i)));
            assert_eq!(taken, PushOutcome::Late);
        }
        assert_eq!(b.push(unnumbered(0.51, 0.51)), PushOutcome::Waits);
        assert_eq!(b.epoch, 0);
        // The same with sequence numbers.
        let mut b = ReorderBuffer::new(0.02);
        steady(&mut b, 0..200);
        for i in 150..160 {
            assert_eq!(
                b.push(held(0.01 * f64::from(i) + 95.0, 2.0 + 0.01 * f64::from(i - 150), Some(i))),
                PushOutcome::Late
            );
        }
        assert_eq!(b.epoch, 0);
    }

    #[test]
    fn items_dropped_at_a_clock_step_are_counted() {
        // Set forward, with one repeated item.
        let mut b = ReorderBuffer::new(0.02);
        steady(&mut b, 0..200);
        let ahead = |i: u32| held(0.01 * f64::from(i) + 95.2, 0.01 * f64::from(i), Some(i));
        let taken = [200, 200, 201].map(|i| b.push(ahead(i)))[2];
        assert!(matches!(taken, PushOutcome::Stepped { odd: 2, late: 0, repeated: 1, .. }), "{taken:?}");
        assert_eq!(out(&mut b, 9.0).len(), 2);
    }

    proptest! {
        /// For any input: times ascend within an epoch, and few items are buffered.
        #[test]
        fn times_ascend(items in prop::collection::vec((0u8..40, any::<bool>(), 0u32..30), 0..400)) {
            let mut b = ReorderBuffer::new(0.02);
            let mut last = (0, f64::NEG_INFINITY);
            for (i, (step, jumps, sequence)) in items.into_iter().enumerate() {
                let now_s = 0.01 * i as f64;
                let time_s = now_s + 0.01 * f64::from(step) + if jumps { 50.0 } else { 0.0 };
                b.push(held(time_s, now_s, (sequence > 3).then_some(sequence)));
                for released in std::iter::from_fn(|| b.pop(now_s)) {
                    let next = (released.epoch, released.held.time_s);
                    prop_assert!(next > last, "{next:?} after {last:?}");
                    last = next;
                }
                prop_assert!(b.held.len() <= 4, "{}", b.held.len());
            }
        }
    }

    #[test]
    fn full_buffer_releases_early() {
        let mut b = ReorderBuffer::new(1e9);
        for i in 0..5000 {
            b.push(held(1e-4 * f64::from(i), 1e-4 * f64::from(i), None));
            while b.pop(0.0).is_some() {}
            assert!(b.held.len() <= BUFFER_CAPACITY);
        }
        assert_eq!(b.held.len(), BUFFER_CAPACITY);
    }
}
