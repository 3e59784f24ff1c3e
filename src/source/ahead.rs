//! Work done ahead of its consumer on a few threads, with results in order.

use std::ops::Range;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread;

use super::SourceError;

/// Number of threads working ahead. Each keeps at most one result in hand and one in its channel.
const LANES: usize = 2;

/// The results of `work(i)` for each `i` of a range, in order. Worker `k` of n takes every n-th index from the k-th on,
/// so nothing needs sorting. The channels bound the memory. The workers stop when this is dropped.
#[derive(Debug)]
pub struct Ahead<T> {
    lanes: Vec<Receiver<T>>,
    taken: usize,
    count: usize,
}

impl<T: Send + 'static> Ahead<T> {
    pub fn new(range: Range<usize>, work: impl Fn(usize) -> T + Send + Sync + 'static) -> Result<Self, SourceError> {
        let count = range.len();
        let work = Arc::new(work);
        let mut lanes = Vec::new();
        for lane in 0..LANES.min(count) {
            let (sender, receiver) = sync_channel(1);
            let (work, indices) = (Arc::clone(&work), range.clone().skip(lane).step_by(LANES));
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
        Ok(Self { lanes, taken: 0, count })
    }
}

impl<T> Iterator for Ahead<T> {
    /// An error only if a worker panicked.
    type Item = Result<T, SourceError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.taken == self.count {
            return None;
        }
        let received = self.lanes.get(self.taken % LANES)?.recv();
        self.taken += 1;
        Some(received.map_err(|_| SourceError::DecoderDied))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn in_order_and_complete() {
        for range in [0..0, 3..4, 5..7, 10..31] {
            let got: Vec<usize> = Ahead::new(range.clone(), |i| i * i).unwrap().map(Result::unwrap).collect();
            assert_eq!(got, range.map(|i| i * i).collect::<Vec<_>>());
        }
    }

    #[test]
    fn runs_ahead_by_a_bounded_number() {
        let started = Arc::new(AtomicUsize::new(0));
        let count = Arc::clone(&started);
        let mut ahead = Ahead::new(0..1000, move |i| (count.fetch_add(1, Ordering::SeqCst), i).1).unwrap();
        for taken in 1..=100 {
            ahead.next().unwrap().unwrap();
            // The taken ones, one in each channel, one in each worker's hand.
            assert!(started.load(Ordering::SeqCst) <= taken + 2 * LANES + 1);
        }
    }

    #[test]
    fn a_panic_is_an_error_and_not_a_short_recording() {
        let ahead = Ahead::new(0..4, |i| assert!(i != 2)).unwrap();
        assert_eq!(ahead.filter(Result::is_err).count(), 1);
    }
}
