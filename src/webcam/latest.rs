//! A channel for the newest picture: each replaces the one before it.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Pictures that were never taken, and those whose time is doubtful.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Drops {
    /// Replaced by a newer one before they were taken: we are too slow.
    pub replaced: u64,
    /// Lost before they came, by the driver's count.
    pub dropped_frames: u64,
    /// Marked as damaged by the driver, or of another size than agreed.
    pub damaged: u64,
    /// Delivered with a time from their arrival, for an implausible stamp. No drops.
    pub arrival_timed: u64,
}

impl Drops {
    pub fn all(&self) -> u64 {
        self.replaced + self.dropped_frames + self.damaged
    }
}

#[derive(Debug)]
struct State<T> {
    item: Option<T>,
    /// User-facing reason for missing pictures.
    unavailable: Option<String>,
    ended: bool,
    drops: Drops,
}

#[derive(Debug)]
struct Shared<T> {
    state: Mutex<State<T>>,
    changed: Condvar,
}

impl<T> Shared<T> {
    fn lock(&self) -> MutexGuard<'_, State<T>> {
        // A panic under the lock leaves the state whole.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Result of [`LatestReceiver::take`].
#[derive(Debug, PartialEq, Eq)]
pub enum TakeOutcome<T> {
    New(T),
    /// Nothing came in time.
    Nothing,
    /// Nothing came, for a reason such as an unplugged camera. More may come later.
    Unavailable(String),
    /// Nothing will come any more.
    Ended,
}

/// The receiving end.
#[derive(Debug)]
pub struct LatestReceiver<T>(Arc<Shared<T>>);

/// The sending end. Dropping it ends the pictures.
#[derive(Debug)]
pub struct LatestSender<T>(Arc<Shared<T>>);

impl<T> LatestReceiver<T> {
    pub fn new() -> (LatestSender<T>, Self) {
        let state = State { item: None, unavailable: None, ended: false, drops: Drops::default() };
        let shared = Arc::new(Shared { state: Mutex::new(state), changed: Condvar::new() });
        (LatestSender(Arc::clone(&shared)), Self(shared))
    }

    /// Waits for the newest picture, at most until then.
    pub fn take(&self, until: Instant) -> TakeOutcome<T> {
        let mut state = self.0.lock();
        loop {
            if let Some(item) = state.item.take() {
                return TakeOutcome::New(item);
            }
            if state.ended {
                // The reason is given once.
                return state.unavailable.take().map_or(TakeOutcome::Ended, TakeOutcome::Unavailable);
            }
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return state.unavailable.clone().map_or(TakeOutcome::Nothing, TakeOutcome::Unavailable);
            }
            state = self.0.changed.wait_timeout(state, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    pub fn drops(&self) -> Drops {
        self.0.lock().drops
    }
}

impl<T> Drop for LatestReceiver<T> {
    fn drop(&mut self) {
        self.0.lock().ended = true;
        self.0.changed.notify_all();
    }
}

impl<T> LatestSender<T> {
    /// Replaces the picture in the channel.
    pub fn put(&self, item: T) {
        let mut state = self.0.lock();
        state.drops.replaced += u64::from(state.item.replace(item).is_some());
        state.unavailable = None;
        self.0.changed.notify_all();
    }

    pub fn count(&self, add: Drops) {
        let drops = &mut self.0.lock().drops;
        drops.replaced += add.replaced;
        drops.dropped_frames += add.dropped_frames;
        drops.damaged += add.damaged;
        drops.arrival_timed += add.arrival_timed;
    }

    /// Reports the reason for missing pictures; the next picture clears it.
    pub fn set_unavailable(&self, why: String) {
        self.0.lock().unavailable = Some(why);
        self.0.changed.notify_all();
    }

    /// True if the receiver was dropped.
    pub fn is_over(&self) -> bool {
        self.0.lock().ended
    }

    /// Waits for `time`, or until the receiver is dropped.
    pub fn wait(&self, time: Duration) {
        let state = self.0.lock();
        let _ = self.0.changed.wait_timeout_while(state, time, |state| !state.ended);
    }
}

impl<T> Drop for LatestSender<T> {
    fn drop(&mut self) {
        self.0.lock().ended = true;
        self.0.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn now<T>(receiver: &LatestReceiver<T>) -> TakeOutcome<T> {
        receiver.take(Instant::now())
    }

    #[test]
    fn the_newest_wins_and_the_others_are_counted() {
        let (sender, receiver) = LatestReceiver::new();
        assert_eq!(now(&receiver), TakeOutcome::Nothing);
        (1..=4).for_each(|i| sender.put(i));
        assert_eq!((now(&receiver), now(&receiver)), (TakeOutcome::New(4), TakeOutcome::Nothing));
        sender.count(Drops { dropped_frames: 2, damaged: 1, ..Drops::default() });
        assert_eq!(receiver.drops(), Drops { replaced: 3, dropped_frames: 2, damaged: 1, arrival_timed: 0 });
        assert_eq!(receiver.drops().all(), 6);
        sender.set_unavailable("unplugged".to_owned());
        assert_eq!(now(&receiver), TakeOutcome::Unavailable("unplugged".to_owned()));
        sender.put(5);
        assert_eq!((now(&receiver), now(&receiver)), (TakeOutcome::New(5), TakeOutcome::Nothing));
        // The last one is not lost by the end.
        sender.put(6);
        drop(sender);
        assert_eq!((now(&receiver), now(&receiver)), (TakeOutcome::New(6), TakeOutcome::Ended));
    }

    #[test]
    fn the_reason_of_an_end_is_given_before_it() {
        let (sender, receiver) = LatestReceiver::<()>::new();
        sender.set_unavailable("damaged".to_owned());
        drop(sender);
        assert_eq!(
            (now(&receiver), now(&receiver)),
            (TakeOutcome::Unavailable("damaged".to_owned()), TakeOutcome::Ended)
        );
    }
}
