//! Prefetching: work is done ahead of its consumer on a few threads, with results in order.

use std::fmt;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread;

use super::SourceError;

/// Number of worker threads. Each has at most one result in hand and one in its channel.
const WORKERS: usize = 2;

/// The results of `work(i)` for each `i` of a range, in order. Worker `k` of n takes every n-th
/// index from the k-th on, so the results need no sorting. The channels bound the memory. The
/// workers stop when this is dropped. A single result is computed on the consumer's thread.
pub struct Ahead<T> {
    lanes: Vec<Receiver<T>>,
    single: Option<Box<dyn FnOnce() -> T + Send>>,
    taken: usize,
    count: usize,
}

impl<T> fmt::Debug for Ahead<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Ahead").field("taken", &self.taken).field("count", &self.count).finish_non_exhaustive()
    }
}

impl<T: Send + 'static> Ahead<T> {
    pub fn new(range: Range<usize>, work: impl Fn(usize) -> T + Send + Sync + 'static) -> Result<Self, SourceError> {
        let count = range.len();
        if count == 1 {
            let single: Box<dyn FnOnce() -> T + Send> = Box::new(move || work(range.start));
            return Ok(Self { lanes: Vec::new(), single: Some(single), taken: 0, count });
        }
        let work = Arc::new(work);
        let mut lanes = Vec::new();
        for lane in 0..WORKERS.min(count) {
            let (sender, receiver) = sync_channel(1);
            let (work, indices) = (Arc::clone(&work), range.clone().skip(lane).step_by(WORKERS));
            let run = move || {
                for i in indices {
                    if sender.send(work(i)).is_err() {
                        break;
                    }
                }
            };
            thread::Builder::new().name(format!("decode {lane}")).spawn(run).map_err(SourceError::Thread)?;
            lanes.push(receiver);
        }
        Ok(Self { lanes, single: None, taken: 0, count })
    }
}

impl<T> Iterator for Ahead<T> {
    /// An error only if a worker panicked.
    type Item = Result<T, SourceError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.taken == self.count {
            return None;
        }
        let done = match self.single.take() {
            Some(single) => catch_unwind(AssertUnwindSafe(single)).ok(),
            None => self.lanes.get(self.taken % WORKERS)?.recv().ok(),
        };
        self.taken += 1;
        Some(done.ok_or(SourceError::DecoderDied))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn results_are_ordered_and_complete() {
        for range in [0..0, 3..4, 5..7, 10..31] {
            let got: Vec<usize> = Ahead::new(range.clone(), |i| i * i).unwrap().map(Result::unwrap).collect();
            assert_eq!(got, range.map(|i| i * i).collect::<Vec<_>>());
        }
    }

    #[test]
    fn prefetch_is_bounded() {
        let started = Arc::new(AtomicUsize::new(0));
        let count = Arc::clone(&started);
        let mut ahead = Ahead::new(0..1000, move |i| (count.fetch_add(1, Ordering::SeqCst), i).1).unwrap();
        for taken in 1..=100 {
            ahead.next().unwrap().unwrap();
            // The taken ones, one in each channel, one in each worker's hand.
            assert!(started.load(Ordering::SeqCst) <= taken + 2 * WORKERS + 1);
        }
    }

    #[test]
    fn worker_panic_is_an_error() {
        for range in [0..4, 2..3] {
            let ahead = Ahead::new(range, |i| assert!(i != 2)).unwrap();
            assert_eq!(ahead.filter(Result::is_err).count(), 1);
        }
    }

    #[test]
    fn one_result_needs_no_thread() {
        let here = std::thread::current().id();
        let on = |range| Ahead::new(range, |_| std::thread::current().id()).unwrap().map(Result::unwrap);
        assert!(on(3..4).eq([here]));
        assert!(on(3..5).all(|there| there != here));
    }
}
