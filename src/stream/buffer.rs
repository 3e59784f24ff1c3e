//! Reorder buffer: items from the network, in the order of their own clock.
//!
//! Datagrams may arrive out of order. Each item waits a little for earlier ones, unless its
//! sequence number shows that there are none. An item that is older than a released one is late.
//!
//! A clock is followed as long as it advances like time. When it jumps, the second item in a row on
//! the new clock confirms it, and a new epoch begins. A single such item is an outlier. A smaller
//! step needs three consistent items in a row, which are held back until then. A step forward
//! continues the epoch. After a step back times repeat, so a new epoch begins.

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

/// An item with its times.
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

/// An item that left the buffer, in the order of its clock.
#[derive(Clone, Debug, PartialEq)]
pub struct ReleasedItem<T> {
    /// Number of jumps of the clock. Times ascend within an epoch.
    pub epoch: u32,
    /// The receiver's clock minus the item's, seconds, as estimated at the arrival.
    pub offset_s: f64,
    /// Number of items lost before this one, by the sequence numbers.
    pub missed: u32,
    pub timed: TimedItem<T>,
}

#[derive(Debug)]
struct QueuedItem<T> {
    epoch: u32,
    offset_s: f64,
    timed: TimedItem<T>,
}

/// Holds items back for `wait_s`, so that late ones can still be put in order.
#[derive(Debug)]
pub struct ReorderBuffer<T> {
    wait_s: f64,
    /// Ascending by epoch, then by time.
    waiting: VecDeque<QueuedItem<T>>,
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
            waiting: VecDeque::new(),
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
        let place = |queued: &QueuedItem<T>| (queued.epoch, queued.timed.time_s);
        let at = self.waiting.partition_point(|queued| place(queued) < (self.epoch, item.time_s));
        if self.waiting.get(at).is_some_and(|queued| place(queued) == (self.epoch, item.time_s)) {
            return PushOutcome::Repeated;
        }
        let offset_s = self.offset.estimate_s().unwrap_or_default();
        self.waiting.insert(at, QueuedItem { epoch: self.epoch, offset_s, timed: item });
        PushOutcome::Waits
    }

    /// The next item in order, once no earlier one can arrive or its wait has ended.
    pub fn pop(&mut self, now_s: f64) -> Option<ReleasedItem<T>> {
        let QueuedItem { epoch, timed: first, .. } = self.waiting.front()?;
        let follows = self.last.is_some_and(|last| is_next(last, *epoch, first.sequence));
        let waited = self.due_s().is_some_and(|due_s| now_s >= due_s);
        if !(follows || waited || *epoch != self.epoch || self.waiting.len() > BUFFER_CAPACITY) {
            return None;
        }
        let QueuedItem { epoch, offset_s, timed } = self.waiting.pop_front()?;
        let before = self.last.filter(|last| last.0 == epoch).and_then(|last| last.2);
        let gap = before.zip(timed.sequence).map_or(0, |(before, this)| this.wrapping_sub(before).wrapping_sub(1));
        self.last = Some((epoch, timed.time_s, timed.sequence));
        Some(ReleasedItem { epoch, offset_s, missed: if gap <= MAX_SEQUENCE_GAP { gap } else { 0 }, timed })
    }

    /// The earliest end of a wait, by the receiver's clock, seconds. The item is released then,
    /// after earlier ones.
    pub fn due_s(&self) -> Option<f64> {
        self.waiting.iter().map(|queued| queued.timed.arrived_s + self.wait_s).reduce(f64::min)
    }

    pub fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }
}

fn is_next((epoch, _, before): (u32, f64, Option<u32>), this_epoch: u32, this: Option<u32>) -> bool {
    epoch == this_epoch && before.zip(this).is_some_and(|(before, this)| before.wrapping_add(1) == this)
}

#[cfg(test)]
mod tests;
