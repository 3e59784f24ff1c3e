//! Undo history.

use std::sync::Arc;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Largest number of steps. Each has a few kilobytes.
const MAX_STEPS: usize = 500;

/// States of a value with the names of the changes. They are shared with a [`HistoryRecord`].
#[derive(Clone, Debug)]
pub struct History<T> {
    /// The first step is the opened state.
    steps: Vec<(String, Arc<T>)>,
    at: usize,
    /// The uncommitted change.
    uncommitted: Option<T>,
    /// Increases with every change of the steps or of the current one.
    revision: u64,
    /// True while changes extend the last step, during a slider drag.
    is_open: bool,
}

/// The steps of a history in a file, the oldest first.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
#[serde(bound(serialize = "T: Serialize", deserialize = "T: Deserialize<'de>"))]
pub struct HistoryRecord<T> {
    #[serde(serialize_with = "write_steps", deserialize_with = "read_steps")]
    pub steps: Vec<(String, Arc<T>)>,
    /// Index of the current step.
    pub at: usize,
}

fn write_steps<T: Serialize, S: Serializer>(steps: &[(String, Arc<T>)], to: S) -> Result<S::Ok, S::Error> {
    to.collect_seq(steps.iter().map(|(name, value)| (name, &**value)))
}

fn read_steps<'de, T: Deserialize<'de>, D: Deserializer<'de>>(from: D) -> Result<Vec<(String, Arc<T>)>, D::Error> {
    let steps = Vec::<(String, T)>::deserialize(from)?;
    Ok(steps.into_iter().map(|(name, value)| (name, Arc::new(value))).collect())
}

impl<T> Default for HistoryRecord<T> {
    fn default() -> Self {
        Self { steps: Vec::new(), at: 0 }
    }
}

impl<T> HistoryRecord<T> {
    /// Removes the older half of the steps before the current one, or else the newer half of the
    /// steps after it. Returns false if only the current one is left.
    pub fn halve(&mut self) -> bool {
        if self.at > 0 {
            let removed = self.at.div_ceil(2);
            self.steps.drain(..removed);
            self.at -= removed;
        } else if self.steps.len() > 1 {
            self.steps.truncate(self.steps.len() / 2);
        } else {
            return false;
        }
        true
    }
}

impl<T: Clone + PartialEq> History<T> {
    pub fn new(opened: T) -> Self {
        Self {
            steps: vec![("opened".to_owned(), Arc::new(opened))],
            at: 0,
            uncommitted: None,
            revision: 0,
            is_open: false,
        }
    }

    pub fn current(&self) -> &T {
        self.uncommitted.as_ref().unwrap_or(&self.steps[self.at].1)
    }

    /// The current step, without the uncommitted change.
    pub fn committed(&self) -> &T {
        &self.steps[self.at].1
    }

    /// Increases with every change of the steps or of the current one, not with an uncommitted
    /// change.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// True if there is an uncommitted change.
    pub fn has_uncommitted(&self) -> bool {
        self.uncommitted.is_some()
    }

    /// The newest `most` steps, or older ones if necessary to include the current step. An
    /// uncommitted change is not included. The values are shared, not copied.
    pub fn record(&self, max_steps: usize) -> HistoryRecord<T> {
        let first = self.steps.len().saturating_sub(max_steps).min(self.at);
        let last = self.steps.len().min(first + max_steps);
        HistoryRecord { steps: self.steps[first..last].to_vec(), at: self.at - first }
    }

    /// Appends recorded steps after the current one. A first step that equals it is not repeated.
    pub fn restore(&mut self, record: HistoryRecord<T>) {
        let HistoryRecord { mut steps, at } = record;
        let at = at.min(steps.len().saturating_sub(1));
        let is_repeated = steps.first().is_some_and(|(_, first)| *first == self.steps[self.at].1);
        if is_repeated {
            steps.remove(0);
        }
        if steps.is_empty() {
            return;
        }
        self.uncommitted = None;
        self.revision += 1;
        self.steps.drain(self.at + 1..);
        self.at = (self.steps.len() + at).saturating_sub(usize::from(is_repeated));
        self.steps.append(&mut steps);
        self.is_open = false;
    }

    /// Sets an uncommitted value. The steps stay as they are.
    pub fn set_uncommitted(&mut self, value: T) {
        self.uncommitted = Some(value);
    }

    /// Discards the uncommitted value.
    pub fn discard_uncommitted(&mut self) {
        self.uncommitted = None;
    }

    /// Commits the uncommitted value as a step. Returns false if it changes nothing.
    pub fn commit(&mut self, what: &str) -> bool {
        let Some(uncommitted) = self.uncommitted.take().filter(|uncommitted| *uncommitted != *self.steps[self.at].1)
        else {
            return false;
        };
        self.close();
        self.change(what, uncommitted);
        self.close();
        true
    }

    /// Adds a change and discards undone steps. While the last step is open, changes of the same
    /// name extend it; [`History::close`] ends that.
    pub fn change(&mut self, what: &str, to: T) {
        self.uncommitted = None;
        if to == *self.current() {
            return;
        }
        self.revision += 1;
        self.steps.truncate(self.at + 1);
        match self.steps.last_mut() {
            Some((name, value)) if self.is_open && self.at > 0 && name == what => *value = Arc::new(to),
            _ => {
                self.steps.push((what.to_owned(), Arc::new(to)));
                if self.steps.len() > MAX_STEPS {
                    self.steps.remove(1);
                }
                self.at = self.steps.len() - 1;
            }
        }
        self.is_open = true;
    }

    /// Removes the last step if it is open and has that name. Returns false otherwise.
    pub fn remove_open_step(&mut self, what: &str) -> bool {
        let is_it = self.is_open && self.at > 0 && self.at + 1 == self.steps.len() && self.steps[self.at].0 == what;
        if is_it {
            self.steps.pop();
            self.at -= 1;
            self.revision += 1;
            self.is_open = false;
        }
        is_it
    }

    /// Changes all steps alike, for a change that the user did not make.
    pub fn change_all(&mut self, change: impl Fn(&mut T)) {
        self.revision += 1;
        let steps = self.steps.iter_mut().map(|(_, value)| Arc::make_mut(value));
        steps.chain(&mut self.uncommitted).for_each(change);
    }

    /// Ends the open step: the next change is a new one.
    pub fn close(&mut self) {
        self.is_open = false;
    }

    /// Undoes a step. Returns its name, or `None` at the first step.
    pub fn undo(&mut self) -> Option<&str> {
        self.discard_uncommitted();
        self.close();
        self.at = self.at.checked_sub(1)?;
        self.revision += 1;
        Some(&self.steps[self.at + 1].0)
    }

    /// Redoes the last undone step.
    pub fn redo(&mut self) -> Option<&str> {
        self.discard_uncommitted();
        self.close();
        let (name, _) = self.steps.get(self.at + 1)?;
        self.at += 1;
        self.revision += 1;
        Some(name)
    }

    /// Moves to a step by its index in [`History::names`].
    pub fn go_to(&mut self, step: usize) {
        self.discard_uncommitted();
        self.close();
        self.at = step.min(self.steps.len() - 1);
        self.revision += 1;
    }

    /// The names of all steps, the oldest first, and the index of the current one.
    pub fn names(&self) -> (impl ExactSizeIterator<Item = &str>, usize) {
        (self.steps.iter().map(|(name, _)| name.as_str()), self.at)
    }

    pub fn can_undo(&self) -> bool {
        self.at > 0
    }

    pub fn can_redo(&self) -> bool {
        self.at + 1 < self.steps.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drag_is_one_step_and_a_new_change_discards_undone_steps() {
        let mut history = History::new(0);
        for value in 1..=5 {
            history.change("noise.scale", value);
        }
        history.change("noise.scale", 5);
        history.close();
        history.change("noise.scale", 6);
        history.change("blur", 7);
        assert_eq!(history.names().0.collect::<Vec<_>>(), ["opened", "noise.scale", "noise.scale", "blur"]);
        assert_eq!(history.undo(), Some("blur"));
        assert_eq!(history.undo(), Some("noise.scale"));
        assert_eq!(*history.current(), 5);
        assert_eq!(history.redo(), Some("noise.scale"));
        assert_eq!(*history.current(), 6);
        history.go_to(0);
        assert!(!history.can_undo() && history.can_redo() && history.undo().is_none());
        history.change("other", 9);
        assert!(!history.can_redo());
        assert_eq!(history.names().0.collect::<Vec<_>>(), ["opened", "other"]);
    }

    #[test]
    fn removed_open_step_leaves_no_trace() {
        let mut history = History::new(0);
        history.change("one", 1);
        history.close();
        assert!(!history.remove_open_step("one") && *history.current() == 1, "it is closed");
        history.change("two", 2);
        history.change("two", 3);
        assert!(
            !history.remove_open_step("one") && history.remove_open_step("two") && !history.remove_open_step("two")
        );
        assert_eq!((*history.current(), history.names().0.collect::<Vec<_>>()), (1, vec!["opened", "one"]));
        history.change("one", 4);
        assert_eq!(history.undo(), Some("one"), "what was before stays closed");
        assert_eq!(*history.current(), 1);
    }

    #[test]
    fn uncommitted_value_is_no_step_until_it_is_committed() {
        let mut history = History::new(0);
        history.change("one", 1);
        history.undo();
        history.set_uncommitted(7);
        history.set_uncommitted(8);
        assert!(*history.current() == 8 && history.can_redo() && history.names().0.len() == 2);
        // Discarding it keeps the undone steps.
        history.discard_uncommitted();
        assert!(*history.current() == 0 && history.can_redo());
        history.set_uncommitted(0);
        assert!(!history.commit("nothing") && history.can_redo());
        history.set_uncommitted(9);
        assert!(history.commit("moved") && *history.current() == 9);
        history.change("moved", 10);
        assert_eq!(history.names().0.collect::<Vec<_>>(), ["opened", "moved", "moved"]);
        history.set_uncommitted(11);
        assert_eq!(history.undo(), Some("moved"));
        assert_eq!(*history.current(), 9);
    }

    #[test]
    fn revision_grows_with_the_steps_and_not_with_an_uncommitted_change() {
        let mut history = History::new(0);
        let mut last = history.revision();
        let mut has_grown = |history: &History<i32>| std::mem::replace(&mut last, history.revision()) < last;
        history.set_uncommitted(7);
        history.discard_uncommitted();
        history.change("one", 0);
        assert!(!has_grown(&history));
        for value in 1..=2 {
            history.change("one", value);
            assert!(has_grown(&history), "also where an open step changes in place");
        }
        assert!(history.remove_open_step("one") && has_grown(&history));
        history.set_uncommitted(3);
        assert!(
            history.has_uncommitted() && history.commit("two") && !history.has_uncommitted() && has_grown(&history)
        );
        assert!(history.undo().is_some() && has_grown(&history));
        assert!(history.redo().is_some() && has_grown(&history));
        history.go_to(0);
        assert!(has_grown(&history));
        history.restore(HistoryRecord { steps: vec![("three".to_owned(), Arc::new(5))], at: 0 });
        assert!(has_grown(&history));
        history.change_all(|value| *value += 1);
        assert!(has_grown(&history));
    }

    #[test]
    fn record_restores_steps_with_undo_and_redo() {
        let mut history = History::new(0);
        for value in 1..=5 {
            history.change(&value.to_string(), value);
        }
        history.undo();
        history.set_uncommitted(9);
        let record = history.record(50);
        assert_eq!((record.steps.len(), record.at), (6, 4), "what is tried is no step");
        let mut restored = History::new(0);
        restored.restore(record.clone());
        let names = restored.names().0.map(str::to_owned).collect::<Vec<_>>();
        assert_eq!((names.join(" "), *restored.current()), ("opened 1 2 3 4 5".to_owned(), 4));
        assert_eq!(restored.redo(), Some("5"));
        assert_eq!(restored.undo(), Some("5"));
        assert_eq!(restored.undo(), Some("4"));
        // If the files were saved since then, the previous state remains a step.
        let mut saved = History::new(7);
        saved.restore(record);
        assert_eq!((saved.names().0.len(), *saved.current()), (7, 4));
        saved.restore(HistoryRecord::default());
        assert_eq!(*saved.current(), 4, "nothing was recorded");
    }

    #[test]
    fn record_shares_its_values_and_serializes_them_plainly() {
        let mut history = History::new(0);
        history.change("one", 1);
        let record = history.record(50);
        let shared = record.steps.iter().zip(&history.steps).all(|((_, one), (_, other))| Arc::ptr_eq(one, other));
        assert!(shared);
        // A change of all steps does not affect the record.
        history.change_all(|value| *value += 10);
        assert_eq!((*record.steps[1].1, *history.current()), (1, 11));
        let text = serde_json::to_string(&record).unwrap();
        assert_eq!(text, r#"{"steps":[["opened",0],["one",1]],"at":1}"#);
        assert_eq!(serde_json::from_str::<HistoryRecord<i32>>(&text).unwrap(), record);
    }

    #[test]
    fn record_is_bounded_and_includes_the_current_step() {
        let mut history = History::new(0);
        for value in 1..=100 {
            history.change(&value.to_string(), value);
        }
        let values = |record: &HistoryRecord<i32>| record.steps.iter().map(|(_, value)| **value).collect::<Vec<_>>();
        let newest = history.record(3);
        assert_eq!((values(&newest), newest.at), (vec![98, 99, 100], 2));
        history.go_to(10);
        let mut record = history.record(4);
        assert_eq!((values(&record), record.at), (vec![10, 11, 12, 13], 0));
        assert!(record.halve() && record.halve() && !record.halve());
        assert_eq!((values(&record), record.at), (vec![10], 0));
        let mut record = newest;
        assert!(record.halve() && *record.steps[record.at].1 == 100);
    }

    #[test]
    fn oldest_steps_are_dropped_and_the_opened_state_stays() {
        let mut history = History::new(0);
        for value in 1..=2 * MAX_STEPS {
            history.change(&value.to_string(), value);
        }
        assert_eq!((history.names().0.len(), *history.current()), (MAX_STEPS, 2 * MAX_STEPS));
        history.go_to(0);
        assert_eq!(*history.current(), 0);
    }
}
