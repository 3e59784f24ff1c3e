//! Radiance of the room's surfaces, also of those that are clipped in a frame.
//!
//! With automatic exposure a desk may be clipped in one frame and not in another. Observations in
//! frames throughout the recording are divided by their frame's gain and collected in cells of 2
//! cm:
//!
//!   R = median of light/gain,
//!
//! for each channel. A clipped observation is a lower bound, so the median is that of
//! right-censored values (Kaplan and Meier 1958). If most observations are clipped it is their
//! largest lower bound. Between cells R is interpolated linearly.
//!
//! Not modelled: glossy surfaces, whose radiance depends on the direction; texture finer than a
//! cell; light that changes during the recording.

use std::collections::HashMap;
use std::sync::LazyLock;

use glam::{DVec3, IVec3, Vec3};

use crate::fit::kaplan_meier::{CensoredSample, kaplan_meier};

/// Side of a cell, m.
const CELL_M: f64 = 0.02;
/// Minimum number of observations of a cell.
const MIN_OBSERVATIONS: usize = 3;

/// An observation of a surface in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceSample {
    pub at_m: DVec3,
    /// Linear red, green and blue, at the exposure of the reference frame.
    pub light: [f32; 3],
    /// True for clipped channels, whose light is a lower bound.
    pub is_clipped: [bool; 3],
}

/// Radiance of surfaces by position.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SurfaceRadiance {
    /// Linear red, green and blue at the exposure of the reference frame, or a lower bound of it.
    cells: HashMap<IVec3, [f32; 3]>,
}

/// Radiance that is computed for the first clipped pixel. No memo: `Supports` keeps it in one.
pub type LazyRadiance = LazyLock<SurfaceRadiance, Box<dyn FnOnce() -> SurfaceRadiance + Send>>;

impl SurfaceRadiance {
    pub fn of(samples: impl Iterator<Item = SurfaceSample>) -> Self {
        let mut by_cell: HashMap<IVec3, [Vec<CensoredSample>; 3]> = HashMap::new();
        for sample in samples.filter(|sample| sample.at_m.is_finite()) {
            let cell = by_cell.entry((sample.at_m / CELL_M).floor().as_ivec3()).or_default();
            for (c, values) in cell.iter_mut().enumerate() {
                values.push((sample.light[c], 1.0, sample.is_clipped[c]));
            }
        }
        by_cell.retain(|_, values| values[0].len() >= MIN_OBSERVATIONS);
        let median = |mut values: Vec<CensoredSample>| kaplan_meier(&mut values, 0.5).map_or(0.0, |(light, _)| light);
        Self { cells: by_cell.into_iter().map(|(cell, values)| (cell, values.map(median))).collect() }
    }

    pub fn is_empty(&self) -> bool {
        self.cells.is_empty()
    }

    /// A sampler for a sequence of positions that are mostly close to the one before.
    pub fn sampler(&self) -> RadianceSampler<'_> {
        RadianceSampler { of: self, cached: None }
    }
}

/// Interpolates radiance, with a cache of the last cells.
#[derive(Debug)]
pub struct RadianceSampler<'a> {
    of: &'a SurfaceRadiance,
    /// The lowest of the last eight cells, and their values. No memo: it is looked up for each
    /// pixel, where a lock costs more than the values.
    cached: Option<(IVec3, [Option<[f32; 3]>; 8])>,
}

impl RadianceSampler<'_> {
    /// Radiance at a position, or a lower bound of it, at the exposure of the reference frame, from
    /// the observed ones of the eight cells around it. `None` if none of them was observed.
    pub fn at(&mut self, at_m: DVec3) -> Option<[f32; 3]> {
        let place = at_m / CELL_M - 0.5;
        let (corner, share) = (place.floor().as_ivec3(), (place - place.floor()).as_vec3());
        let step = |n: i32| IVec3::new(n & 1, n >> 1 & 1, n >> 2);
        let cells = match self.cached {
            Some((of, cells)) if of == corner => cells,
            _ => std::array::from_fn(|n| self.of.cells.get(&(corner + step(n as i32))).copied()),
        };
        self.cached = Some((corner, cells));
        let (mut all, mut light) = (0.0, Vec3::ZERO);
        for (n, cell) in (0..).zip(cells) {
            let (Some(cell), step) = (cell, step(n)) else { continue };
            let axis_weight = |share: f32, step: i32| if step == 1 { share } else { 1.0 - share };
            let weight = axis_weight(share.x, step.x) * axis_weight(share.y, step.y) * axis_weight(share.z, step.z);
            all += weight;
            light += weight * Vec3::from(cell);
        }
        (all > 1e-6).then(|| (light / all).to_array())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(x_m: f64, light: [f32; 3], is_clipped: [bool; 3]) -> SurfaceSample {
        SurfaceSample { at_m: DVec3::new(x_m, 0.01, 0.01), light, is_clipped }
    }

    #[test]
    fn radiance_of_clipped_and_unclipped_frames_is_the_median_by_hand() {
        // Red is clipped in two frames of five, at 0.5 and 0.9, green in all of them, blue in none.
        let red = [(0.5, true), (0.9, true), (1.2, false), (1.25, false), (1.3, false)];
        let samples = red.iter().enumerate().map(|(n, (light, is_clipped))| {
            sample(0.01, [*light, 0.4 + 0.1 * n as f32, 0.2], [*is_clipped, true, false])
        });
        let radiance = SurfaceRadiance::of(samples).sampler().at(DVec3::splat(0.01)).unwrap();
        // The survival function falls by a third at each of the three unclipped values.
        assert_eq!(radiance, [1.25, 0.8, 0.2]);
    }

    #[test]
    fn radiance_between_two_cells_is_interpolated_and_of_too_few_samples_unknown() {
        let cell = |x_m: f64, light: f32, count: usize| (0..count).map(move |_| sample(x_m, [light; 3], [false; 3]));
        let surfaces = SurfaceRadiance::of(cell(0.01, 1.0, 3).chain(cell(0.03, 2.0, 3)).chain(cell(0.15, 9.0, 2)));
        let mut sampler = surfaces.sampler();
        let mut red_at = |x_m: f64| sampler.at(DVec3::new(x_m, 0.01, 0.01)).map(|light| light[0]);
        for (x_m, light) in [(0.01, 1.0), (0.015, 1.25), (0.025, 1.75), (0.045, 2.0), (-0.005, 1.0)] {
            assert!((red_at(x_m).unwrap() - light).abs() < 1e-5, "{x_m}");
        }
        assert_eq!([0.15, 0.3].map(red_at), [None; 2]);
        assert!(SurfaceRadiance::of(std::iter::empty()).is_empty() && !surfaces.is_empty());
    }
}
