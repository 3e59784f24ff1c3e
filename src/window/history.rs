//! What was done, step by step, and back.

use std::sync::Arc;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Steps that are kept. Each is a few kilobytes.
const MOST: usize = 500;

/// States of a value, each with what led to it. They are shared with a [`Record`] of them.
#[derive(Clone, Debug)]
pub struct History<T> {
    /// The first is what was opened.
    steps: Vec<(String, Arc<T>)>,
    at: usize,
    /// The uncommitted change.
    tried: Option<T>,
    /// Grows with every change of the steps or of the current one.
    revision: u64,
    /// Whether the step that was made last still grows: a slider is being dragged.
    is_open: bool,
}

/// The steps of a history as a file keeps them, the oldest first.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
#[serde(bound(serialize = "T: Serialize", deserialize = "T: Deserialize<'de>"))]
pub struct Record<T> {
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

impl<T> Default for Record<T> {
    fn default() -> Self {
        Self { steps: Vec::new(), at: 0 }
    }
}

impl<T> Record<T> {
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
        Self { steps: vec![("opened".to_owned(), Arc::new(opened))], at: 0, tried: None, revision: 0, is_open: false }
    }

    pub fn now(&self) -> &T {
        self.tried.as_ref().unwrap_or(&self.steps[self.at].1)
    }

    /// The current step, without the uncommitted change.
    pub fn kept(&self) -> &T {
        &self.steps[self.at].1
    }

    /// Grows with every change of the steps or of the current one, and not with an uncommitted
    /// change.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// Whether there is an uncommitted change.
    pub fn is_trying(&self) -> bool {
        self.tried.is_some()
    }

    /// The newest `most` steps, or older ones where the current step would not be among them. An
    /// uncommitted change is no step. The values are shared, not copied.
    pub fn record(&self, most: usize) -> Record<T> {
        let first = self.steps.len().saturating_sub(most).min(self.at);
        let last = self.steps.len().min(first + most);
        Record { steps: self.steps[first..last].to_vec(), at: self.at - first }
    }

    /// Appends recorded steps after the current one. A first step that equals it is not repeated.
    pub fn restore(&mut self, record: Record<T>) {
        let Record { mut steps, at } = record;
        let at = at.min(steps.len().saturating_sub(1));
        let is_repeated = steps.first().is_some_and(|(_, first)| *first == self.steps[self.at].1);
        if is_repeated {
            steps.remove(0);
        }
        if steps.is_empty() {
            return;
        }
        self.tried = None;
        self.revision += 1;
        self.steps.drain(self.at + 1..);
        self.at = (self.steps.len() + at).saturating_sub(usize::from(is_repeated));
        self.steps.append(&mut steps);
        self.is_open = false;
    }

    /// What holds now, until it is kept or dropped. The steps stay as they are.
    pub fn try_on(&mut self, value: T) {
        self.tried = Some(value);
    }

    /// Takes back what was tried.
    pub fn drop_tried(&mut self) {
        self.tried = None;
    }

    /// Makes what was tried a step of its own. `false` where that changes nothing.
    pub fn keep_tried(&mut self, what: &str) -> bool {
        let Some(tried) = self.tried.take().filter(|tried| *tried != *self.steps[self.at].1) else { return false };
        self.close();
        self.change(what, tried);
        self.close();
        true
    }

    /// A change. What was undone before is forgotten. As long as the step is open, changes of the same name are one step;
    /// [`History::close`] ends it.
    pub fn change(&mut self, what: &str, to: T) {
        self.tried = None;
        if to == *self.now() {
            return;
        }
        self.revision += 1;
        self.steps.truncate(self.at + 1);
        match self.steps.last_mut() {
            Some((name, value)) if self.is_open && self.at > 0 && name == what => *value = Arc::new(to),
            _ => {
                self.steps.push((what.to_owned(), Arc::new(to)));
                if self.steps.len() > MOST {
                    self.steps.remove(1);
                }
                self.at = self.steps.len() - 1;
            }
        }
        self.is_open = true;
    }

    /// Takes the step away that is still open, if it has that name: it is as if it had not been begun. `false` without one.
    pub fn take_back(&mut self, what: &str) -> bool {
        let is_it = self.is_open && self.at > 0 && self.at + 1 == self.steps.len() && self.steps[self.at].0 == what;
        if is_it {
            self.steps.pop();
            self.at -= 1;
            self.revision += 1;
            self.is_open = false;
        }
        is_it
    }

    /// Changes every step alike, where it is not the person's doing.
    pub fn each(&mut self, change: impl Fn(&mut T)) {
        self.revision += 1;
        let steps = self.steps.iter_mut().map(|(_, value)| Arc::make_mut(value));
        steps.chain(&mut self.tried).for_each(change);
    }

    /// The next change is a step of its own.
    pub fn close(&mut self) {
        self.is_open = false;
    }

    /// Takes back a step. Gives its name, `None` where nothing is left to take back.
    pub fn undo(&mut self) -> Option<&str> {
        self.drop_tried();
        self.close();
        self.at = self.at.checked_sub(1)?;
        self.revision += 1;
        Some(&self.steps[self.at + 1].0)
    }

    /// Does again what was undone last.
    pub fn redo(&mut self) -> Option<&str> {
        self.drop_tried();
        self.close();
        let (name, _) = self.steps.get(self.at + 1)?;
        self.at += 1;
        self.revision += 1;
        Some(name)
    }

    /// Goes to a step by its place in [`History::names`].
    pub fn go_to(&mut self, step: usize) {
        self.drop_tried();
        self.close();
        self.at = step.min(self.steps.len() - 1);
        self.revision += 1;
    }

    /// Each step's name, the oldest first, and the place of the one that holds now.
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
    fn a_drag_is_one_step_and_a_new_change_forgets_what_was_undone() {
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
        assert_eq!(*history.now(), 5);
        assert_eq!(history.redo(), Some("noise.scale"));
        assert_eq!(*history.now(), 6);
        history.go_to(0);
        assert!(!history.can_undo() && history.can_redo() && history.undo().is_none());
        history.change("other", 9);
        assert!(!history.can_redo());
        assert_eq!(history.names().0.collect::<Vec<_>>(), ["opened", "other"]);
    }

    #[test]
    fn a_step_that_is_taken_back_was_never_begun() {
        let mut history = History::new(0);
        history.change("one", 1);
        history.close();
        assert!(!history.take_back("one") && *history.now() == 1, "it is closed");
        history.change("two", 2);
        history.change("two", 3);
        assert!(!history.take_back("one") && history.take_back("two") && !history.take_back("two"));
        assert_eq!((*history.now(), history.names().0.collect::<Vec<_>>()), (1, vec!["opened", "one"]));
        history.change("one", 4);
        assert_eq!(history.undo(), Some("one"), "what was before stays closed");
        assert_eq!(*history.now(), 1);
    }

    #[test]
    fn what_is_tried_is_no_step_until_it_is_kept() {
        let mut history = History::new(0);
        history.change("one", 1);
        history.undo();
        history.try_on(7);
        history.try_on(8);
        assert!(*history.now() == 8 && history.can_redo() && history.names().0.len() == 2);
        // Dropped, all is as it was: what was undone can be done again.
        history.drop_tried();
        assert!(*history.now() == 0 && history.can_redo());
        history.try_on(0);
        assert!(!history.keep_tried("nothing") && history.can_redo());
        history.try_on(9);
        assert!(history.keep_tried("moved") && *history.now() == 9);
        history.change("moved", 10);
        assert_eq!(history.names().0.collect::<Vec<_>>(), ["opened", "moved", "moved"]);
        history.try_on(11);
        assert_eq!(history.undo(), Some("moved"));
        assert_eq!(*history.now(), 9);
    }

    #[test]
    fn revision_grows_with_the_steps_and_not_with_an_uncommitted_change() {
        let mut history = History::new(0);
        let mut last = history.revision();
        let mut has_grown = |history: &History<i32>| std::mem::replace(&mut last, history.revision()) < last;
        history.try_on(7);
        history.drop_tried();
        history.change("one", 0);
        assert!(!has_grown(&history));
        for value in 1..=2 {
            history.change("one", value);
            assert!(has_grown(&history), "also where an open step changes in place");
        }
        assert!(history.take_back("one") && has_grown(&history));
        history.try_on(3);
        assert!(history.is_trying() && history.keep_tried("two") && !history.is_trying() && has_grown(&history));
        assert!(history.undo().is_some() && has_grown(&history));
        assert!(history.redo().is_some() && has_grown(&history));
        history.go_to(0);
        assert!(has_grown(&history));
        history.restore(Record { steps: vec![("three".to_owned(), Arc::new(5))], at: 0 });
        assert!(has_grown(&history));
        history.each(|value| *value += 1);
        assert!(has_grown(&history));
    }

    #[test]
    fn a_record_restores_steps_with_undo_and_redo() {
        let mut history = History::new(0);
        for value in 1..=5 {
            history.change(&value.to_string(), value);
        }
        history.undo();
        history.try_on(9);
        let record = history.record(50);
        assert_eq!((record.steps.len(), record.at), (6, 4), "what is tried is no step");
        let mut restored = History::new(0);
        restored.restore(record.clone());
        let names = restored.names().0.map(str::to_owned).collect::<Vec<_>>();
        assert_eq!((names.join(" "), *restored.now()), ("opened 1 2 3 4 5".to_owned(), 4));
        assert_eq!(restored.redo(), Some("5"));
        assert_eq!(restored.undo(), Some("5"));
        assert_eq!(restored.undo(), Some("4"));
        // The files were saved since: the state before stays a step.
        let mut saved = History::new(7);
        saved.restore(record);
        assert_eq!((saved.names().0.len(), *saved.now()), (7, 4));
        saved.restore(Record::default());
        assert_eq!(*saved.now(), 4, "nothing was recorded");
    }

    #[test]
    fn a_record_shares_its_values_and_is_written_as_plain_ones() {
        let mut history = History::new(0);
        history.change("one", 1);
        let record = history.record(50);
        let shared = record.steps.iter().zip(&history.steps).all(|((_, one), (_, other))| Arc::ptr_eq(one, other));
        assert!(shared);
        // A change in every step leaves the record as it was.
        history.each(|value| *value += 10);
        assert_eq!((*record.steps[1].1, *history.now()), (1, 11));
        let text = serde_json::to_string(&record).unwrap();
        assert_eq!(text, r#"{"steps":[["opened",0],["one",1]],"at":1}"#);
        assert_eq!(serde_json::from_str::<Record<i32>>(&text).unwrap(), record);
    }

    #[test]
    fn a_record_is_bounded_and_keeps_the_step_that_holds() {
        let mut history = History::new(0);
        for value in 1..=100 {
            history.change(&value.to_string(), value);
        }
        let values = |record: &Record<i32>| record.steps.iter().map(|(_, value)| **value).collect::<Vec<_>>();
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
    fn the_oldest_steps_go_and_what_was_opened_stays() {
        let mut history = History::new(0);
        for value in 1..=2 * MOST {
            history.change(&value.to_string(), value);
        }
        assert_eq!((history.names().0.len(), *history.now()), (MOST, 2 * MOST));
        history.go_to(0);
        assert_eq!(*history.now(), 0);
    }
}
