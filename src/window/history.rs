//! What was done, step by step, and back.

/// Steps that are kept. Each is a few kilobytes.
const MOST: usize = 500;

/// States of a value, each with what led to it.
#[derive(Clone, Debug)]
pub struct History<T> {
    /// The first is what was opened.
    steps: Vec<(String, T)>,
    at: usize,
    /// What is being tried, and is no step yet.
    tried: Option<T>,
    /// Whether the step that was made last still grows: a slider is being dragged.
    is_open: bool,
}

impl<T: Clone + PartialEq> History<T> {
    pub fn new(opened: T) -> Self {
        Self { steps: vec![("opened".to_owned(), opened)], at: 0, tried: None, is_open: false }
    }

    pub fn now(&self) -> &T {
        self.tried.as_ref().unwrap_or(&self.steps[self.at].1)
    }

    /// What holds without what is being tried.
    pub fn kept(&self) -> &T {
        &self.steps[self.at].1
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
        let Some(tried) = self.tried.take().filter(|tried| *tried != self.steps[self.at].1) else { return false };
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
        self.steps.truncate(self.at + 1);
        match self.steps.last_mut() {
            Some((name, value)) if self.is_open && self.at > 0 && name == what => *value = to,
            _ => {
                self.steps.push((what.to_owned(), to));
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
            self.is_open = false;
        }
        is_it
    }

    /// Changes every step alike, where it is not the person's doing.
    pub fn each(&mut self, change: impl Fn(&mut T)) {
        self.steps.iter_mut().map(|(_, value)| value).chain(&mut self.tried).for_each(change);
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
        Some(&self.steps[self.at + 1].0)
    }

    /// Does again what was undone last.
    pub fn redo(&mut self) -> Option<&str> {
        self.drop_tried();
        self.close();
        let (name, _) = self.steps.get(self.at + 1)?;
        self.at += 1;
        Some(name)
    }

    /// Goes to a step by its place in [`History::names`].
    pub fn go_to(&mut self, step: usize) {
        self.drop_tried();
        self.close();
        self.at = step.min(self.steps.len() - 1);
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
