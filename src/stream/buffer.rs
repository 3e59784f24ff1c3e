//! What came over the network, in the order of its own clock.
//!
//! Datagrams overtake each other. Each item waits a little for those before it, unless its number says that there are
//! none. What comes after a later one was given out is late. A clock is believed as long as it goes on as time does; when
//! it jumps, the second item in a row on the new clock proves it, and a new epoch begins. A single one is only odd. A
//! smaller step needs three items in a row that bear it out; until then they are held back. A step forward goes on within
//! the epoch. After a step back times repeat, so that a new epoch begins.

use std::collections::VecDeque;

use super::offset::{AHEAD_S, BEHIND_S, ClockOffset, MIN_CONSISTENT_SAMPLES};

/// A clock may be off from arrivals by this between two items, seconds: streams stutter, and poses may be sent faster
/// than they were recorded.
const JUMP_S: f64 = 1.0;
/// Items that wait at once: a second of the fastest tracker. Beyond it the first goes out early. With samples of 64 KiB
/// this is 16 MiB.
const MOST: usize = 256;
/// More numbers than this are not lost but counted anew.
const MOST_LOST: u32 = 1000;

#[derive(Clone, Debug, PartialEq)]
pub struct Held<T> {
    /// By its own clock, seconds.
    pub time_s: f64,
    /// By ours, seconds.
    pub arrived_s: f64,
    /// Rises by 1 from item to item, if its sender counts.
    pub sequence: Option<u32>,
    pub item: T,
}

/// What became of an item.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Taken {
    Waits,
    /// After a later one was given out: dropped.
    Late,
    /// At the time of another: dropped.
    Repeated,
    /// Its clock is elsewhere; the next items will tell.
    Odd,
    /// The clock was set anew, by so many seconds. Of those before it that were odd, or late, so many belong to it. Of
    /// these and the item itself, so many are late or repeated.
    Stepped {
        by_s: f64,
        odd: usize,
        behind: usize,
        late: usize,
        repeated: usize,
    },
    /// The clock has jumped, by so many seconds: this item and the odd one before it begin a new epoch. If both have
    /// the same time, this item is dropped as repeated.
    Jumped {
        by_s: f64,
        is_repeated: bool,
    },
}

impl Taken {
    /// Of a step and of what became of its items.
    fn stepped(by_s: f64, odd: usize, items: &[Self]) -> Self {
        let count = |what| items.iter().filter(|taken| **taken == what).count();
        Self::Stepped { by_s, odd, behind: 0, late: count(Self::Late), repeated: count(Self::Repeated) }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct Released<T> {
    /// How often the clock had jumped. Times ascend within an epoch.
    pub epoch: u32,
    /// Our clock minus the item's own, seconds, as known when it came.
    pub offset_s: f64,
    /// Items that never came before this one, by their numbers.
    pub lost: u32,
    pub held: Held<T>,
}

#[derive(Debug)]
struct Queued<T> {
    epoch: u32,
    offset_s: f64,
    held: Held<T>,
}

#[derive(Debug)]
pub struct Buffer<T> {
    wait_s: f64,
    /// Ascending by epoch, then time.
    held: VecDeque<Queued<T>>,
    /// Own time, arrival of the newest item on the clock as it goes.
    newest: Option<(f64, f64)>,
    epoch: u32,
    /// Of this epoch's clock.
    offset: ClockOffset,
    odd: Option<Held<T>>,
    /// Items in a row whose stamps are ahead.
    ahead: Vec<Held<T>>,
    /// Items in a row, ascending, at whose start the clock ran backwards.
    behind: Vec<Held<T>>,
    /// Whether all have been since the clock was set forward: they are sent faster than they were recorded.
    runs_ahead: bool,
    /// Epoch, own time, number.
    last: Option<(u32, f64, Option<u32>)>,
}

impl<T> Buffer<T> {
    /// Items wait at most so long for those before them, seconds.
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

    pub fn push(&mut self, item: Held<T>) -> Taken {
        let continues = |(time_s, arrived_s): (f64, f64)| {
            let off_s = (item.time_s - time_s) - (item.arrived_s - arrived_s);
            off_s.abs() <= JUMP_S
        };
        let in_doubt = self.ahead.last().map(|last| (last.time_s, last.arrived_s));
        if self.newest.is_none_or(continues) || in_doubt.is_some_and(continues) {
            self.odd = None;
            return self.push_continuing(item);
        }
        let proven = self.odd.take().filter(|odd| continues((odd.time_s, odd.arrived_s)));
        let Some(first) = proven else {
            self.odd = Some(item);
            return Taken::Odd;
        };
        let before_s = self.offset.estimate_s();
        self.begin_epoch();
        self.offset = ClockOffset::default();
        self.insert(first);
        let taken = self.insert(item);
        let by_s = before_s.zip(self.offset.estimate_s()).map_or(0.0, |(before_s, now_s)| before_s - now_s);
        match taken {
            Taken::Waits => Taken::Jumped { by_s, is_repeated: false },
            Taken::Repeated => Taken::Jumped { by_s, is_repeated: true },
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

    /// Whether an item was sent after the last one that was given out, and is stamped before it, or goes on from such ones.
    /// Where nothing is numbered, one that was overtaken looks alike; [`Buffer::push_behind`] tells the two apart.
    fn runs_backwards(&self, item: &Held<T>) -> bool {
        let Some((epoch, time_s, sequence)) = self.last else { return false };
        let is_behind =
            |(time_s, arrived_s): (f64, f64)| (item.time_s - time_s) - (item.arrived_s - arrived_s) < -BEHIND_S;
        // `None` where nothing is numbered. Numbers may wrap, or begin anew.
        let follows = |before: Option<u32>| {
            let back = before.zip(item.sequence).map(|(before, this)| before.wrapping_sub(this));
            back.map(|back| back > MOST_LOST)
        };
        let is_behind = self.newest.is_some_and(is_behind);
        // The step may be shorter than the time between the items that show it.
        let goes_on = |last: &Held<T>| is_behind && item.time_s > last.time_s && follows(last.sequence).unwrap_or(true);
        self.behind.last().is_some_and(goes_on)
            || epoch == self.epoch && item.time_s < time_s && follows(sequence).unwrap_or(is_behind)
    }

    /// Takes an item for which the clock ran backwards. The third in a row begins a new epoch.
    fn push_behind(&mut self, item: Held<T>) -> Taken {
        self.ahead.clear();
        if self.behind.last().is_some_and(|last| item.time_s <= last.time_s) {
            self.behind.clear();
        }
        self.behind.push(item);
        let [first, .., last] = self.behind.as_slice() else { return Taken::Late };
        if self.behind.len() < MIN_CONSISTENT_SAMPLES {
            return Taken::Late;
        }
        // Those that were overtaken come all at once, those of a clock that goes on at their own pace.
        let span_s = last.time_s - first.time_s;
        let is_at_pace = (last.arrived_s - first.arrived_s - span_s).abs() < 0.5 * span_s;
        if first.sequence.is_none() && !is_at_pace {
            self.behind.remove(0);
            return Taken::Late;
        }
        let proven = std::mem::take(&mut self.behind);
        self.begin_epoch();
        let by_s = self.offset.restart(proven.iter().map(|item| (item.time_s, item.arrived_s)));
        let behind = proven.len() - 1;
        proven.into_iter().for_each(|item| _ = self.queue(item));
        Taken::Stepped { by_s, odd: 0, behind, late: 0, repeated: 0 }
    }

    /// Whether an item's stamp is ahead of all before it and of the newest one.
    fn is_ahead(&self, item: &Held<T>) -> bool {
        let steps = |(time_s, arrived_s)| (item.time_s - time_s) - (item.arrived_s - arrived_s) > AHEAD_S;
        self.newest.is_some_and(steps) && self.offset.is_ahead(item.time_s, item.arrived_s)
    }

    /// An item of the clock as it goes.
    fn push_continuing(&mut self, item: Held<T>) -> Taken {
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
            return Taken::Odd;
        }
        let by_s = self.offset.restart(self.ahead.iter().map(|item| (item.time_s, item.arrived_s)));
        self.runs_ahead = true;
        let proven = std::mem::take(&mut self.ahead);
        let odd = proven.len() - 1;
        let taken: Vec<Taken> = proven.into_iter().map(|item| self.queue(item)).collect();
        Taken::stepped(by_s, odd, &taken)
    }

    fn insert(&mut self, item: Held<T>) -> Taken {
        let step_s = self.offset.add(item.time_s, item.arrived_s);
        let taken = self.queue(item);
        step_s.map_or(taken, |step_s| Taken::stepped(-step_s, 0, &[taken]))
    }

    fn queue(&mut self, item: Held<T>) -> Taken {
        if let Some((epoch, time_s, _)) = self.last
            && epoch == self.epoch
            && item.time_s <= time_s
        {
            return if item.time_s == time_s { Taken::Repeated } else { Taken::Late };
        }
        if self.newest.is_none_or(|(time_s, _)| item.time_s > time_s) {
            self.newest = Some((item.time_s, item.arrived_s));
        }
        let place = |queued: &Queued<T>| (queued.epoch, queued.held.time_s);
        let at = self.held.partition_point(|queued| place(queued) < (self.epoch, item.time_s));
        if self.held.get(at).is_some_and(|queued| place(queued) == (self.epoch, item.time_s)) {
            return Taken::Repeated;
        }
        let offset_s = self.offset.estimate_s().unwrap_or_default();
        self.held.insert(at, Queued { epoch: self.epoch, offset_s, held: item });
        Taken::Waits
    }

    /// The next item in order, once nothing can come before it or it has waited.
    pub fn pop(&mut self, now_s: f64) -> Option<Released<T>> {
        let Queued { epoch, held: first, .. } = self.held.front()?;
        let follows = self.last.is_some_and(|last| is_next(last, *epoch, first.sequence));
        let waited = self.due_s().is_some_and(|due_s| now_s >= due_s);
        if !(follows || waited || *epoch != self.epoch || self.held.len() > MOST) {
            return None;
        }
        let Queued { epoch, offset_s, held } = self.held.pop_front()?;
        let before = self.last.filter(|last| last.0 == epoch).and_then(|last| last.2);
        let gap = before.zip(held.sequence).map_or(0, |(before, this)| this.wrapping_sub(before).wrapping_sub(1));
        self.last = Some((epoch, held.time_s, held.sequence));
        Some(Released { epoch, offset_s, lost: if gap <= MOST_LOST { gap } else { 0 }, held })
    }

    /// When one of them will have waited, by our clock, seconds. It goes out then, after those before it.
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

    fn held(time_s: f64, arrived_s: f64, sequence: Option<u32>) -> Held<()> {
        Held { time_s, arrived_s, sequence, item: () }
    }

    fn out(buffer: &mut Buffer<()>, now_s: f64) -> Vec<(u32, f64, u32)> {
        std::iter::from_fn(|| buffer.pop(now_s)).map(|r| (r.epoch, r.held.time_s, r.lost)).collect()
    }

    #[test]
    fn what_is_in_order_does_not_wait_and_what_was_overtaken_is_put_back() {
        let mut b = Buffer::new(0.02);
        assert_eq!(b.push(held(5.00, 0.00, Some(1))), Taken::Waits);
        // The first of all waits: nobody knows whether it is the first.
        assert_eq!(out(&mut b, 0.00), []);
        assert_eq!(b.due_s(), Some(0.02));
        assert_eq!(out(&mut b, 0.02), [(0, 5.00, 0)]);
        assert_eq!(b.push(held(5.01, 0.03, Some(2))), Taken::Waits);
        assert_eq!(out(&mut b, 0.03), [(0, 5.01, 0)]);
        // 4 overtakes 3.
        b.push(held(5.03, 0.04, Some(4)));
        assert_eq!(out(&mut b, 0.045), []);
        b.push(held(5.02, 0.05, Some(3)));
        assert_eq!(out(&mut b, 0.05), [(0, 5.02, 0), (0, 5.03, 0)]);
        // 5 is lost: 6 waits for it, and then goes.
        b.push(held(5.05, 0.06, Some(6)));
        assert_eq!(out(&mut b, 0.07), []);
        assert_eq!(out(&mut b, 0.08), [(0, 5.05, 1)]);
        // 5 comes after all; 6 comes twice.
        assert_eq!(b.push(held(5.04, 0.09, Some(5))), Taken::Late);
        assert_eq!(b.push(held(5.05, 0.09, Some(6))), Taken::Repeated);
        assert!(b.is_empty());
    }

    #[test]
    fn a_clock_that_jumps_begins_an_epoch_and_a_single_odd_time_does_not() {
        let mut b = Buffer::new(0.0);
        b.push(held(100.0, 0.0, None));
        assert_eq!(b.push(held(7.0, 0.1, None)), Taken::Odd);
        assert_eq!(b.push(held(100.2, 0.2, None)), Taken::Waits);
        assert_eq!(out(&mut b, 0.2), [(0, 100.0, 0), (0, 100.2, 0)]);
        // Back by 90 s, and on from there.
        assert_eq!(b.push(held(10.0, 0.3, None)), Taken::Odd);
        assert!(
            matches!(b.push(held(10.1, 0.4, None)), Taken::Jumped { by_s, is_repeated: false } if (by_s + 90.3).abs() < 1e-9)
        );
        assert_eq!(out(&mut b, 0.4), [(1, 10.0, 0), (1, 10.1, 0)]);
        // Silence for an hour, on both clocks: no jump.
        assert_eq!(b.push(held(3610.5, 3600.8, None)), Taken::Waits);
    }

    #[test]
    fn second_item_at_the_same_time_proves_a_jump_too() {
        let mut b = Buffer::new(0.0);
        b.push(held(100.0, 0.0, None));
        assert_eq!(b.push(held(10.0, 0.1, None)), Taken::Odd);
        assert!(matches!(b.push(held(10.0, 0.11, None)), Taken::Jumped { is_repeated: true, .. }));
        assert_eq!(out(&mut b, 0.2), [(0, 100.0, 0), (1, 10.0, 0)]);
    }

    /// 100 Hz on a clock 95 s ahead, from one number to another, each given out as it comes.
    fn steady(b: &mut Buffer<()>, numbers: std::ops::Range<u32>) {
        for i in numbers {
            let sent_s = 0.01 * f64::from(i);
            assert_eq!(b.push(held(sent_s + 95.0, sent_s, Some(i))), Taken::Waits);
            let released = std::iter::from_fn(|| b.pop(sent_s + 1.0)).last().unwrap();
            assert!((released.held.time_s + released.offset_s - sent_s).abs() < 1e-9, "{released:?}");
        }
    }

    #[test]
    fn single_stamp_ahead_is_odd_and_changes_nothing_after_it() {
        let mut b = Buffer::new(0.02);
        steady(&mut b, 0..200);
        assert_eq!(b.push(held(2.0 + 95.1, 2.0, Some(200))), Taken::Odd);
        steady(&mut b, 201..300);
    }

    #[test]
    fn items_sent_faster_than_recorded_are_all_given_out() {
        for interval_s in [0.02, 0.1, 0.5] {
            let (mut b, mut times) = (Buffer::new(0.02), Vec::new());
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
        let mut b = Buffer::new(0.02);
        steady(&mut b, 0..200);
        let ahead = |i: u32| held(0.01 * f64::from(i) + 95.2, 0.01 * f64::from(i), Some(i));
        assert_eq!((b.push(ahead(200)), b.push(ahead(201))), (Taken::Odd, Taken::Odd));
        let taken = b.push(ahead(202));
        assert!(
            matches!(taken, Taken::Stepped { by_s, odd: 2, late: 0, repeated: 0, .. } if (by_s - 0.2).abs() < 1e-9),
            "{taken:?}"
        );
        let out: Vec<_> = std::iter::from_fn(|| b.pop(2.02)).map(|r| r.held.time_s + r.offset_s).collect();
        assert!(out.iter().zip([2.0, 2.01, 2.02]).all(|(a, b)| (a - b).abs() < 1e-9) && out.len() == 3, "{out:?}");
    }

    /// What becomes of poses at 100 Hz, late by up to 3 ms, as the clock is set anew by so much.
    struct Step {
        lost: usize,
        /// Given out at the time of another.
        misdated: usize,
        /// The sample of the new clock with which the step is returned, from 1 on, and by how much it was, seconds.
        told: Option<(u32, f64)>,
    }

    fn stepped(by_s: f64, is_numbered: bool) -> Step {
        let mut buffer = Buffer::new(0.02);
        let (mut given, mut misdated, mut told) = (0, 0, None);
        let mut random = 1_u32;
        for i in 0..600 {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let sent_s = 0.01 * f64::from(i);
            let arrived_s = sent_s + 0.003 * f64::from(random >> 8) / f64::from(1 << 24);
            let time_s = sent_s + 95.0 + if i >= 200 { by_s } else { 0.0 };
            let sequence = is_numbered.then_some(i);
            match buffer.push(Held { time_s, arrived_s, sequence, item: sent_s }) {
                Taken::Stepped { by_s, .. } | Taken::Jumped { by_s, .. } => told = told.or(Some((i - 199, by_s))),
                _ => {}
            }
            let now_s = if i == 599 { 99.0 } else { arrived_s };
            for released in std::iter::from_fn(|| buffer.pop(now_s)) {
                given += 1;
                let off_s = released.held.time_s + released.offset_s - released.held.item;
                misdated += usize::from(off_s.abs() > 0.005);
            }
        }
        Step { lost: 600 - given, misdated, told }
    }

    #[test]
    fn no_pose_is_lost_or_misdated_when_the_clock_is_set_anew() {
        for is_numbered in [true, false] {
            // Without numbers a step by as much as items wait looks like items that were overtaken.
            let small_s = if is_numbered { -0.03 } else { -0.05 };
            for by_s in [-3.0, -0.5, -0.05, small_s, 0.1, 2.0] {
                let Step { lost, misdated, told } = stepped(by_s, is_numbered);
                assert_eq!((lost, misdated), (0, 0), "{by_s} s, numbered: {is_numbered}");
                let (sample, told_s) = told.unwrap();
                assert!(sample <= 3 && (told_s - by_s).abs() < 0.004, "{by_s} s: {told_s} s with sample {sample}");
            }
        }
    }

    #[test]
    fn items_that_were_overtaken_are_late_and_no_step() {
        let mut b = Buffer::new(0.02);
        let unnumbered = |sent_s: f64, arrived_s: f64| held(sent_s + 95.0, arrived_s, None);
        for i in 0..50 {
            b.push(unnumbered(0.01 * f64::from(i), 0.01 * f64::from(i)));
            out(&mut b, 0.01 * f64::from(i));
        }
        // Sent in between, held up by 0.2 s, and delivered at once.
        for i in 0..10 {
            let taken = b.push(unnumbered(0.305 + 0.01 * f64::from(i), 0.5 + 0.0001 * f64::from(i)));
            assert_eq!(taken, Taken::Late);
        }
        assert_eq!(b.push(unnumbered(0.51, 0.51)), Taken::Waits);
        assert_eq!(b.epoch, 0);
        // Their numbers say as much.
        let mut b = Buffer::new(0.02);
        steady(&mut b, 0..200);
        for i in 150..160 {
            assert_eq!(b.push(held(0.01 * f64::from(i) + 95.0, 2.0 + 0.01 * f64::from(i - 150), Some(i))), Taken::Late);
        }
        assert_eq!(b.epoch, 0);
    }

    #[test]
    fn what_is_dropped_as_the_clock_steps_is_told() {
        // Set forward, and one comes twice.
        let mut b = Buffer::new(0.02);
        steady(&mut b, 0..200);
        let ahead = |i: u32| held(0.01 * f64::from(i) + 95.2, 0.01 * f64::from(i), Some(i));
        let taken = [200, 200, 201].map(|i| b.push(ahead(i)))[2];
        assert!(matches!(taken, Taken::Stepped { odd: 2, late: 0, repeated: 1, .. }), "{taken:?}");
        assert_eq!(out(&mut b, 9.0).len(), 2);
    }

    proptest! {
        /// Whatever comes: within an epoch times ascend, and little is held.
        #[test]
        fn times_ascend(items in prop::collection::vec((0u8..40, any::<bool>(), 0u32..30), 0..400)) {
            let mut b = Buffer::new(0.02);
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
    fn no_more_is_held_than_may_be() {
        let mut b = Buffer::new(1e9);
        for i in 0..5000 {
            b.push(held(1e-4 * f64::from(i), 1e-4 * f64::from(i), None));
            while b.pop(0.0).is_some() {}
            assert!(b.held.len() <= MOST);
        }
        assert_eq!(b.held.len(), MOST);
    }
}
