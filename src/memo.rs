//! Memoized results: values of pure functions by their keys, the least recently used evicted first.
//! All data that is kept to save its computation is kept in a [`Memo`], except where a sentence
//! ("No memo: …") gives the reason.
//!
//! A key holds all that its value depends on, exactly. Where that is much, it is a
//! [`Digest`](crate::digest::Digest). Keys are compared one after another: a memo is for values
//! that take far longer to compute than some hundred comparisons.

use std::ops::Deref;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Values by their keys. Clones of a value are handed out, so that large ones stand in an `Arc`.
#[derive(Debug)]
pub struct Memo<K, V> {
    /// Largest sum of costs. The newest value stays whatever it costs.
    budget: usize,
    /// Cost of a value.
    cost: fn(&V) -> usize,
    /// The most recently used last.
    entries: Mutex<Vec<(K, V)>>,
}

impl<K, V> Memo<K, V> {
    /// A memo of at most `capacity` values.
    pub const fn new(capacity: usize) -> Self {
        assert!(capacity > 0, "a memo without entries");
        Self { budget: capacity, cost: |_| 1, entries: Mutex::new(Vec::new()) }
    }

    /// Evicts when the total size exceeds `bytes`. `size_bytes` returns the size of a value.
    pub const fn with_budget(bytes: usize, size_bytes: fn(&V) -> usize) -> Self {
        Self { budget: bytes, cost: size_bytes, entries: Mutex::new(Vec::new()) }
    }

    /// Keeps every value.
    pub const fn unbounded() -> Self {
        Self::new(usize::MAX)
    }

    /// The most recently used value with its key, for a preview of another key's value.
    pub fn latest(&self) -> Option<(K, V)>
    where
        K: Clone,
        V: Clone,
    {
        self.entries().last().cloned()
    }

    /// A thread that panicked left no entry half-written.
    fn entries(&self) -> MutexGuard<'_, Vec<(K, V)>> {
        self.entries.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The clone has the same values.
impl<K: Clone, V: Clone> Clone for Memo<K, V> {
    fn clone(&self) -> Self {
        Self { budget: self.budget, cost: self.cost, entries: Mutex::new(self.entries().clone()) }
    }
}

/// Keeps the latest value alone.
impl<K, V> Default for Memo<K, V> {
    fn default() -> Self {
        Self::new(1)
    }
}

impl<K: PartialEq, V: Clone> Memo<K, V> {
    /// The value of a key, which then counts as most recently used.
    pub fn get(&self, key: &K) -> Option<V> {
        used(&mut self.entries(), key)
    }

    /// Returns the value that is kept: the first one of a key.
    pub fn insert(&self, key: K, value: V) -> V {
        let mut entries = self.entries();
        if let Some(existing) = used(&mut entries, &key) {
            return existing;
        }
        entries.push((key, value.clone()));
        let mut excess = entries.iter().map(|(_, value)| (self.cost)(value)).sum::<usize>().saturating_sub(self.budget);
        while excess > 0 && entries.len() > 1 {
            let (_, evicted) = entries.remove(0);
            excess = excess.saturating_sub((self.cost)(&evicted));
        }
        value
    }

    /// The value of a key, computed if it is missing. The memo is not locked during the
    /// computation: two threads may compute the same value, and the first one stays.
    pub fn get_or_insert_with(&self, key: K, compute: impl FnOnce(&K) -> V) -> V {
        self.get(&key).unwrap_or_else(|| {
            let value = compute(&key);
            self.insert(key, value)
        })
    }

    /// [`Memo::get_or_insert_with`] for a computation that may fail. An error is not kept.
    pub fn get_or_try_insert_with<E>(&self, key: K, compute: impl FnOnce(&K) -> Result<V, E>) -> Result<V, E> {
        match self.get(&key) {
            Some(existing) => Ok(existing),
            None => compute(&key).map(|value| self.insert(key, value)),
        }
    }
}

/// The value of a key among entries, which becomes the last of them.
fn used<K: PartialEq, V: Clone>(entries: &mut [(K, V)], key: &K) -> Option<V> {
    let at = entries.iter().rposition(|(other, _)| other == key)?;
    entries[at..].rotate_left(1);
    entries.last().map(|(_, value)| value.clone())
}

/// A shared value as a part of a key: compared by its address, not by its content. It keeps the
/// value in memory, so that its address is not reused.
#[derive(Debug)]
pub struct ByAddress<T: ?Sized>(pub Arc<T>);

impl<T: ?Sized> Clone for ByAddress<T> {
    fn clone(&self) -> Self {
        Self(Arc::clone(&self.0))
    }
}

impl<T: ?Sized> PartialEq for ByAddress<T> {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

impl<T: ?Sized> Deref for ByAddress<T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn value_that_was_read_longest_ago_is_evicted() {
        let memo = Memo::new(2);
        memo.insert(1, 'a');
        memo.insert(2, 'b');
        assert_eq!(memo.get(&1), Some('a'));
        memo.insert(3, 'c');
        assert_eq!([1, 2, 3].map(|key| memo.get(&key)), [Some('a'), None, Some('c')]);
    }

    #[test]
    fn values_stay_within_the_budget_and_the_newest_one_always() {
        let memo = Memo::with_budget(10, |value: &usize| *value);
        for value in [4, 5, 1] {
            memo.insert(value, value);
        }
        assert_eq!([4, 5, 1].map(|key| memo.get(&key)), [Some(4), Some(5), Some(1)]);
        memo.insert(6, 6);
        assert_eq!([4, 5, 1, 6].map(|key| memo.get(&key)), [None, None, Some(1), Some(6)]);
        memo.insert(50, 50);
        assert_eq!([1, 6, 50].map(|key| memo.get(&key)), [None, None, Some(50)]);
    }

    #[test]
    fn a_value_is_computed_once_and_the_first_one_stays() {
        let memo = Memo::unbounded();
        let values = [memo.get_or_insert_with('a', |_| 1), memo.get_or_insert_with('a', |_| unreachable!())];
        assert_eq!((values, memo.insert('a', 2), memo.insert('b', 3)), ([1, 1], 1, 3));
        // A value that another one needs.
        assert_eq!(memo.get_or_insert_with('c', |_| 10 * memo.get_or_insert_with('d', |_| 4)), 40);
    }

    #[test]
    fn clone_has_the_same_values_and_budget_and_grows_alone() {
        let memo = Memo::with_budget(10, |value: &usize| *value);
        for value in [4, 5] {
            memo.insert(value, value);
        }
        let clone = memo.clone();
        assert_eq!([4, 5].map(|key| clone.get(&key)), [Some(4), Some(5)]);
        clone.insert(6, 6);
        assert_eq!([4, 5, 6].map(|key| clone.get(&key)), [None, None, Some(6)]);
        assert_eq!([4, 5, 6].map(|key| memo.get(&key)), [Some(4), Some(5), None]);
    }

    #[test]
    fn failed_computation_is_repeated() {
        let memo = Memo::default();
        assert_eq!(memo.get_or_try_insert_with(1, |_| Err("no")), Err("no"));
        assert_eq!(memo.get_or_try_insert_with(1, |_| Ok::<_, &str>('a')), Ok('a'));
        assert_eq!(memo.get_or_try_insert_with(1, |_| Err("no")), Ok('a'));
    }

    #[test]
    fn latest_value_is_the_last_one_used() {
        let memo = Memo::new(2);
        assert_eq!(memo.latest(), None);
        memo.insert(1, 'a');
        memo.insert(2, 'b');
        memo.get(&1);
        assert_eq!(memo.latest(), Some((1, 'a')));
    }

    #[test]
    fn values_at_two_addresses_differ_though_they_are_equal() {
        let [one, other] = [Arc::new(1), Arc::new(1)].map(ByAddress);
        assert!(one == one.clone() && one != other && *one == *other);
    }
}
