//! SHA-256 digests of a result's inputs, as keys of a [`Memo`](crate::memo::Memo).
//!
//! `digestible!` lists all fields of a struct: a struct with a field that is missing there does not
//! compile.

use std::ops::Range;
use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec2, DVec3, Vec2, Vec3};
use sha2::Digest as _;

/// SHA-256 of a value's fields.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Digest([u8; 32]);

impl Digest {
    pub fn of(value: &(impl Digestible + ?Sized)) -> Self {
        let mut digester = Digester::default();
        digester.add(value);
        digester.finish()
    }
}

/// Incremental digest. A clone continues from the same state.
#[derive(Clone, Debug, Default)]
pub struct Digester(sha2::Sha256);

impl Digester {
    pub fn add(&mut self, value: &(impl Digestible + ?Sized)) {
        value.digest(self);
    }

    /// Numbers without padding, and how many there are.
    pub fn add_numbers<T: bytemuck::NoUninit>(&mut self, values: &[T]) {
        self.add(&values.len());
        self.0.update(bytemuck::cast_slice::<T, u8>(values));
    }

    pub fn finish(self) -> Digest {
        Digest(self.0.finalize().into())
    }
}

/// A value with a digest over all of its fields.
pub trait Digestible {
    fn digest(&self, into: &mut Digester);
}

/// Implements [`Digestible`] for structs by all of their fields.
macro_rules! digestible {
    ($($name:ty { $($field:ident),* $(,)? })*) => {
        $(impl $crate::digest::Digestible for $name {
            fn digest(&self, into: &mut $crate::digest::Digester) {
                let Self { $($field),* } = self;
                $(into.add($field);)*
            }
        })*
    };
}

pub(crate) use digestible;

macro_rules! numbers {
    ($($name:ty),*) => {
        $(impl Digestible for $name {
            fn digest(&self, into: &mut Digester) {
                into.0.update(bytemuck::bytes_of(self));
            }
        })*
    };
}

numbers!(u8, u32, u64, usize, i64, f32, f64, Vec2, Vec3, DVec2, DVec3, DMat3, DAffine3);

impl Digestible for Digest {
    fn digest(&self, into: &mut Digester) {
        into.0.update(self.0);
    }
}

impl Digestible for bool {
    fn digest(&self, into: &mut Digester) {
        into.add(&u8::from(*self));
    }
}

impl<T: Digestible> Digestible for Option<T> {
    fn digest(&self, into: &mut Digester) {
        into.add(&self.is_some());
        if let Some(value) = self {
            into.add(value);
        }
    }
}

impl<T: Digestible> Digestible for [T] {
    fn digest(&self, into: &mut Digester) {
        into.add(&self.len());
        self.iter().for_each(|value| into.add(value));
    }
}

impl<T: Digestible> Digestible for Vec<T> {
    fn digest(&self, into: &mut Digester) {
        into.add(self.as_slice());
    }
}

impl<T: Digestible + ?Sized> Digestible for Arc<T> {
    fn digest(&self, into: &mut Digester) {
        into.add(&**self);
    }
}

impl<T: Digestible + ?Sized> Digestible for &T {
    fn digest(&self, into: &mut Digester) {
        into.add(*self);
    }
}

impl<T: Digestible> Digestible for Range<T> {
    fn digest(&self, into: &mut Digester) {
        let Self { start, end } = self;
        into.add(start);
        into.add(end);
    }
}

impl<A: Digestible, B: Digestible> Digestible for (A, B) {
    fn digest(&self, into: &mut Digester) {
        into.add(&self.0);
        into.add(&self.1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Lamp {
        at_m: Vec3,
        spot: Option<f32>,
        corners: Vec<f64>,
    }

    digestible! { Lamp { at_m, spot, corners } }

    fn digest(value: &impl Digestible) -> Digest {
        let mut digester = Digester::default();
        digester.add(value);
        digester.finish()
    }

    #[test]
    fn any_bit_of_any_field_changes_the_digest() {
        let lamp = |x: f32, spot, corners: &[f64]| Lamp { at_m: Vec3::new(x, 2.0, 3.0), spot, corners: corners.into() };
        let expected = digest(&lamp(1.0, None, &[5.0]));
        assert_eq!(expected, digest(&lamp(1.0, None, &[5.0])));
        for (n, other) in [
            lamp(1.0f32.next_up(), None, &[5.0]),
            lamp(1.0, Some(0.0), &[5.0]),
            lamp(1.0, None, &[5.0f64.next_up()]),
            lamp(1.0, None, &[5.0, 0.0]),
            lamp(1.0, None, &[]),
        ]
        .iter()
        .enumerate()
        {
            assert_ne!(expected, digest(other), "change {n}");
        }
    }

    #[test]
    fn where_a_list_ends_changes_the_digest() {
        let digest_of = |a: &[u32], b: &[u32]| {
            let mut digester = Digester::default();
            digester.add_numbers(a);
            digester.add_numbers(b);
            digester.finish()
        };
        assert_ne!(digest_of(&[1, 2], &[3]), digest_of(&[1], &[2, 3]));
        assert_ne!(digest(&(vec![1u32], vec![2u32])), digest(&(vec![1u32, 2], Vec::<u32>::new())));
    }
}
