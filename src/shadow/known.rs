//! What this process has worked out, by all that it depends on, to the last bit.
//!
//! A compositor keeps what it worked out itself (`kept`). The next one of the same scene knows nothing yet: one for an export, a
//! photograph, a camera that was frozen. Here it finds what the others worked out.

use std::fmt::{self, Debug, Write};
use std::sync::{Arc, Mutex, PoisonError};

use sha2::{Digest, Sha256};

use super::kept::Kept;

/// A digest of what something depends on.
type Told = [u8; 32];

/// Tells what something depends on.
#[derive(Clone, Debug, Default)]
pub struct Telling(Sha256);

impl Telling {
    /// Numbers, and how many there are.
    pub fn all<T: bytemuck::NoUninit>(&mut self, values: &[T]) {
        self.0.update(values.len().to_le_bytes());
        self.0.update(bytemuck::cast_slice::<T, u8>(values));
    }

    /// Whether the same was told.
    #[cfg(test)]
    pub fn is(&self, other: &Self) -> bool {
        self.0.clone().finalize() == other.0.clone().finalize()
    }

    /// Something small: floating-point numbers are written so that they are read back the same.
    pub fn small(&mut self, value: &impl Debug) {
        // Nothing that is told here refuses.
        let _ = write!(self, "{value:?};");
    }
}

impl Write for Telling {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0.update(text.as_bytes());
        Ok(())
    }
}

/// So many values, those that were used last.
#[derive(Debug)]
pub struct Known<V>(Mutex<Kept<Told, Arc<V>>>);

impl<V> Known<V> {
    pub const fn new(most: usize) -> Self {
        Self(Mutex::new(Kept::new(most)))
    }

    /// The value that depends on what was told, and on nothing else. Two threads that ask at once may both make it.
    pub fn of(&self, telling: Telling, make: impl FnOnce() -> V) -> Arc<V> {
        let told = telling.0.finalize().into();
        if let Some(known) = self.kept().found(&told) {
            return known;
        }
        let made = Arc::new(make());
        self.kept().keep(told, made.clone());
        made
    }

    /// A thread that panicked left nothing half-done.
    fn kept(&self) -> std::sync::MutexGuard<'_, Kept<Told, Arc<V>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_is_made_once_and_a_bit_makes_another() {
        let known = Known::new(8);
        let told = |numbers: &[f32], small: f32| {
            let mut telling = Telling::default();
            telling.all(numbers);
            telling.small(&small);
            telling
        };
        let first = known.of(told(&[1.0, 2.0], 3.0), || 1);
        let again = known.of(told(&[1.0, 2.0], 3.0), || unreachable!("it is known"));
        assert!(Arc::ptr_eq(&first, &again));
        let next = f32::from_bits(2.0f32.to_bits() + 1);
        let others = [told(&[1.0, next], 3.0), told(&[1.0, 2.0], 3.0f32.next_up()), told(&[1.0], 3.0)];
        for (n, other) in others.into_iter().enumerate() {
            assert_eq!(*known.of(other, || n + 2), n + 2);
        }
    }
}
