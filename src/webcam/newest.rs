//! A channel for the newest picture: each replaces the one before it.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Pictures that were never taken, and those whose time is doubtful.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Drops {
    /// Replaced by a newer one before they were taken: we are too slow.
    pub replaced: u64,
    /// Lost before they came, by the driver's count.
    pub lost: u64,
    /// Marked as damaged by the driver, or of another size than agreed.
    pub damaged: u64,
    /// Delivered with a time from their arrival, for an implausible stamp. No drops.
    pub arrival_timed: u64,
}

impl Drops {
    pub fn all(&self) -> u64 {
        self.replaced + self.lost + self.damaged
    }
}

#[derive(Debug)]
struct State<T> {
    item: Option<T>,
    /// User-facing reason for missing pictures.
    gone: Option<String>,
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

/// Result of [`Newest::take`].
#[derive(Debug, PartialEq, Eq)]
pub enum TakeOutcome<T> {
    New(T),
    /// Nothing came in time.
    Nothing,
    /// Nothing came, for a reason such as an unplugged camera. More may come later.
    Gone(String),
    /// Nothing will come any more.
    Ended,
}

/// The receiving end.
#[derive(Debug)]
pub struct Newest<T>(Arc<Shared<T>>);

/// The sending end. Dropping it ends the pictures.
#[derive(Debug)]
pub struct Putter<T>(Arc<Shared<T>>);

impl<T> Newest<T> {
    pub fn new() -> (Putter<T>, Self) {
        let state = State { item: None, gone: None, ended: false, drops: Drops::default() };
        let shared = Arc::new(Shared { state: Mutex::new(state), changed: Condvar::new() });
        (Putter(Arc::clone(&shared)), Self(shared))
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
                return state.gone.take().map_or(TakeOutcome::Ended, TakeOutcome::Gone);
            }
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return state.gone.clone().map_or(TakeOutcome::Nothing, TakeOutcome::Gone);
            }
            state = self.0.changed.wait_timeout(state, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    pub fn drops(&self) -> Drops {
        self.0.lock().drops
    }
}

impl<T> Drop for Newest<T> {
    fn drop(&mut self) {
        self.0.lock().ended = true;
        self.0.changed.notify_all();
    }
}

impl<T> Putter<T> {
    /// Replaces the picture in the channel.
    pub fn put(&self, item: T) {
        let mut state = self.0.lock();
        state.drops.replaced += u64::from(state.item.replace(item).is_some());
        state.gone = None;
        self.0.changed.notify_all();
    }

    pub fn count(&self, add: Drops) {
        let drops = &mut self.0.lock().drops;
        drops.replaced += add.replaced;
        drops.lost += add.lost;
        drops.damaged += add.damaged;
        drops.arrival_timed += add.arrival_timed;
    }

    /// Reports the reason for missing pictures; the next picture clears it.
    pub fn gone(&self, why: String) {
        self.0.lock().gone = Some(why);
        self.0.changed.notify_all();
    }

    /// True if the receiver was dropped.
    pub fn is_over(&self) -> bool {
        self.0.lock().ended
    }

    /// Waits for `time`, or until the receiver is dropped.
    pub fn rest(&self, time: Duration) {
        let state = self.0.lock();
        let _ = self.0.changed.wait_timeout_while(state, time, |state| !state.ended);
    }
}

impl<T> Drop for Putter<T> {
    fn drop(&mut self) {
        self.0.lock().ended = true;
        self.0.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn now<T>(newest: &Newest<T>) -> TakeOutcome<T> {
        newest.take(Instant::now())
    }

    #[test]
    fn the_newest_wins_and_the_others_are_counted() {
        let (putter, newest) = Newest::new();
        assert_eq!(now(&newest), TakeOutcome::Nothing);
        (1..=4).for_each(|i| putter.put(i));
        assert_eq!((now(&newest), now(&newest)), (TakeOutcome::New(4), TakeOutcome::Nothing));
        putter.count(Drops { lost: 2, damaged: 1, ..Drops::default() });
        assert_eq!(newest.drops(), Drops { replaced: 3, lost: 2, damaged: 1, arrival_timed: 0 });
        assert_eq!(newest.drops().all(), 6);
        putter.gone("unplugged".to_owned());
        assert_eq!(now(&newest), TakeOutcome::Gone("unplugged".to_owned()));
        putter.put(5);
        assert_eq!((now(&newest), now(&newest)), (TakeOutcome::New(5), TakeOutcome::Nothing));
        // The last one is not lost by the end.
        putter.put(6);
        drop(putter);
        assert_eq!((now(&newest), now(&newest)), (TakeOutcome::New(6), TakeOutcome::Ended));
    }

    #[test]
    fn the_reason_of_an_end_is_given_before_it() {
        let (putter, newest) = Newest::<()>::new();
        putter.gone("damaged".to_owned());
        drop(putter);
        assert_eq!((now(&newest), now(&newest)), (TakeOutcome::Gone("damaged".to_owned()), TakeOutcome::Ended));
    }
}
