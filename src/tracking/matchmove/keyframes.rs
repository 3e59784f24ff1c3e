//! Samples of animated values, interpolated.

use glam::{DQuat, DVec3};

/// A value at times, ascending. One sample without a time holds at all times.
#[derive(Clone, Debug, PartialEq)]
pub struct KeyframeSamples<T> {
    pub keys: Vec<(f64, T)>,
    /// Holds each value until the next sample.
    pub is_stepped: bool,
}

impl<T> KeyframeSamples<T> {
    pub fn constant(value: T) -> Self {
        Self { keys: vec![(0.0, value)], is_stepped: false }
    }
}

impl<T: Copy> KeyframeSamples<T> {
    /// The value at a time, held before the first sample and after the last. `None` without
    /// samples.
    pub fn at(&self, time: f64, interpolate: impl Fn(T, T, f64) -> T) -> Option<T> {
        let after = self.keys.partition_point(|key| key.0 <= time);
        let before = after.checked_sub(1).and_then(|i| self.keys.get(i)).copied();
        match (before, self.keys.get(after).copied()) {
            (Some((t0, a)), Some((t1, b))) if !self.is_stepped && t0 < time => {
                Some(interpolate(a, b, (time - t0) / (t1 - t0)))
            }
            (Some((_, value)), _) | (None, Some((_, value))) => Some(value),
            (None, None) => None,
        }
    }

    /// The times of animated values.
    pub fn times(&self) -> impl Iterator<Item = f64> {
        let keys: &[(f64, T)] = if self.keys.len() > 1 { &self.keys } else { &[] };
        keys.iter().map(|key| key.0)
    }
}

pub fn lerp(a: DVec3, b: DVec3, fraction: f64) -> DVec3 {
    a.lerp(b, fraction)
}

pub fn slerp(a: DQuat, b: DQuat, fraction: f64) -> DQuat {
    a.slerp(b, fraction)
}

/// Times in ascending order, each once.
pub fn ascending(times: impl IntoIterator<Item = f64>) -> Vec<f64> {
    let mut times: Vec<f64> = times.into_iter().collect();
    times.sort_by(f64::total_cmp);
    times.dedup();
    times
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_interpolated_held_or_stepped() {
        let mut samples = KeyframeSamples { keys: vec![(1.0, DVec3::ZERO), (3.0, DVec3::X)], is_stepped: false };
        let x = |samples: &KeyframeSamples<DVec3>, time| samples.at(time, lerp).unwrap().x;
        for (time, value) in [(0.0, 0.0), (1.0, 0.0), (2.5, 0.75), (3.0, 1.0), (9.0, 1.0)] {
            assert_eq!(x(&samples, time), value, "{time}");
        }
        samples.is_stepped = true;
        assert_eq!((x(&samples, 2.5), x(&samples, 3.0)), (0.0, 1.0));
        assert_eq!(KeyframeSamples::<DVec3> { keys: Vec::new(), is_stepped: false }.at(0.0, lerp), None);
        assert_eq!(ascending([2.0, 1.0, 2.0]), [1.0, 2.0]);
    }
}
