//! What was worked out and may be asked for again, and places told so exactly that equal ones are found equal.

use glam::DAffine3;

/// Places are told apart to a micrometre, directions to a millionth.
const STEPS_PER_UNIT: f64 = 1e6;

/// A place in whole steps, so that what is kept for it is exactly of it.
pub type Steps = [i64; 12];

pub fn steps(place: &DAffine3) -> Steps {
    place.to_cols_array().map(step)
}

pub fn from_steps(steps: &Steps) -> DAffine3 {
    DAffine3::from_cols_array(&steps.map(|step| step as f64 / STEPS_PER_UNIT))
}

pub fn step(length: f64) -> i64 {
    (length * STEPS_PER_UNIT).round() as i64
}

/// So many values by their keys, those that were used last.
#[derive(Debug)]
pub struct Kept<K, V> {
    most: usize,
    all: Vec<(K, V)>,
}

impl<K, V> Kept<K, V> {
    pub const fn new(most: usize) -> Self {
        Self { most, all: Vec::new() }
    }
}

impl<K: PartialEq, V: Clone> Kept<K, V> {
    /// What is kept for a key; it then counts as used last.
    pub fn found(&mut self, key: &K) -> Option<V> {
        let at = self.all.iter().position(|(kept, _)| kept == key)?;
        let known = self.all.remove(at);
        self.all.push(known);
        self.all.last().map(|(_, value)| value.clone())
    }

    pub fn keep(&mut self, key: K, value: V) {
        if self.all.len() == self.most {
            self.all.remove(0);
        }
        self.all.push((key, value));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_used_last_stays() {
        let mut kept = Kept::new(2);
        kept.keep(1, 'a');
        kept.keep(2, 'b');
        assert_eq!(kept.found(&1), Some('a'));
        kept.keep(3, 'c');
        assert_eq!([1, 2, 3].map(|key| kept.found(&key)), [Some('a'), None, Some('c')]);
    }

    #[test]
    fn a_place_comes_back_to_a_micrometre() {
        let place = DAffine3::from_translation(glam::DVec3::new(1.234_567_4, -2.0, 1e-7));
        assert_eq!(from_steps(&steps(&place)).translation, glam::DVec3::new(1.234_567, -2.0, 0.0));
    }
}
