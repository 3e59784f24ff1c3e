//! Evidence that coefficients are multiples of a quantisation step.

use super::annex_k::{LUMINANCE, scaled};
use super::dct::BLOCK_LEN;

/// Spread of decoded coefficients about multiples of their step; rounding of samples to whole codes
/// alone makes 0.29.
const SPREAD: f32 = 0.4;
/// Share of coefficients that lie anywhere.
const OUTLIERS: f32 = 0.1;

/// Steps of a scaled table, and how likely.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScaledTable {
    /// Scale of annex K's table.
    pub scale: f64,
    pub log_likelihood: f64,
}

/// Σ cos(2π F/q) over coefficients beyond the zero bin, in standard deviations of the sum for
/// coefficients that lie anywhere: √(n/2). Coefficients in the zero bin are near a multiple in any
/// smooth picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CombSum {
    cosines: f64,
    count: usize,
}

impl CombSum {
    pub fn of(coefficients: impl Iterator<Item = f32>, step: u16) -> Self {
        let step = f32::from(step);
        let mut sum = Self::default();
        for multiple in coefficients.map(|value| value / step).filter(|multiple| multiple.abs() > 0.5) {
            sum.cosines += f64::from(cosine_of_turns(multiple));
            sum.count += 1;
        }
        sum
    }

    pub fn add(&mut self, other: Self) {
        self.cosines += other.cosines;
        self.count += other.count;
    }

    pub fn score(&self) -> f64 {
        if self.count == 0 { 0.0 } else { self.cosines / (self.count as f64 / 2.0).sqrt() }
    }
}

/// cos(2π turns), within 0.002: by Bhaskara I's formula.
fn cosine_of_turns(turns: f32) -> f32 {
    let half_turns = 2.0 * (turns - turns.round()).abs();
    // cos(π t) = (1 − 4 t²) / (1 + t²) for t up to ½; symmetric about it.
    let near = |t: f32| (1.0 - 4.0 * t * t) / (1.0 + t * t);
    if half_turns <= 0.5 { near(half_turns) } else { -near(1.0 - half_turns) }
}

/// Log likelihood of coefficients as multiples of a step, against a smooth density. Those in the
/// zero bin only count against the step. 0 for a step of 1.
pub fn log_likelihood(coefficients: impl Iterator<Item = f32>, step: u16) -> f64 {
    if step <= 1 {
        return 0.0;
    }
    let q = f32::from(step);
    let peak = q / (SPREAD * std::f32::consts::TAU.sqrt());
    coefficients
        .map(|value| {
            let multiple = (value / q).round();
            let away = (value - multiple * q) / SPREAD;
            let density = peak * (-0.5 * away * away).exp();
            let term = ((1.0 - OUTLIERS) * density + OUTLIERS).ln();
            f64::from(if multiple == 0.0 { term.min(0.0) } else { term })
        })
        .sum()
}

/// Log likelihoods of the steps that a family of scaled tables has at each frequency, each computed
/// once.
pub struct StepLikelihoods<'a> {
    blocks: &'a [[f32; BLOCK_LEN]],
    by_step: Vec<Vec<Option<f64>>>,
}

impl<'a> StepLikelihoods<'a> {
    pub fn new(blocks: &'a [[f32; BLOCK_LEN]]) -> Self {
        Self { blocks, by_step: vec![vec![None; 256]; BLOCK_LEN] }
    }

    pub fn of(&mut self, frequency: usize, step: u16) -> f64 {
        let blocks = self.blocks;
        let slot = &mut self.by_step[frequency][usize::from(step.min(255))];
        *slot.get_or_insert_with(|| log_likelihood(blocks.iter().map(|block| block[frequency]), step))
    }

    /// The most likely scale of annex K's luminance table. Scales of equal tables are equally
    /// likely; theirs is the middle one.
    pub fn best_scale(&mut self, scales: &[f64]) -> Option<ScaledTable> {
        let likelihoods: Vec<f64> = scales
            .iter()
            .map(|&scale| {
                let steps = scaled(&LUMINANCE, scale);
                steps.iter().enumerate().map(|(frequency, &step)| self.of(frequency, step)).sum()
            })
            .collect();
        let log_likelihood = likelihoods.iter().copied().fold(f64::MIN, f64::max);
        let best: Vec<f64> =
            scales.iter().zip(&likelihoods).filter(|(_, l)| **l >= log_likelihood - 1e-6).map(|(s, _)| *s).collect();
        best.get(best.len() / 2).map(|&scale| ScaledTable { scale, log_likelihood })
    }

    /// A table with single steps that differ by 1 where that is more likely by `margin`.
    pub fn adjusted(&mut self, mut steps: [u16; BLOCK_LEN], margin: f64) -> [u16; BLOCK_LEN] {
        for (frequency, step) in steps.iter_mut().enumerate() {
            let own = self.of(frequency, *step);
            let beside = [*step - 1, *step + 1].into_iter().filter(|step| *step >= 1);
            let best = beside.map(|step| (self.of(frequency, step), step)).max_by(|a, b| a.0.total_cmp(&b.0));
            if let Some((likelihood, other)) = best
                && likelihood > own + margin
            {
                *step = other;
            }
        }
        steps
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cosine_is_near_the_exact_one() {
        for i in -300..300 {
            let turns = i as f32 / 100.0;
            let exact = (std::f32::consts::TAU * turns).cos();
            assert!((cosine_of_turns(turns) - exact).abs() < 0.002, "{turns}");
        }
    }

    #[test]
    fn step_multiples_are_distinguished() {
        let noisy = |step: f32| (1..200).map(move |i| (i % 17 - 8) as f32 * step + (i % 7 - 3) as f32 * 0.1);
        // 186 of the 199 values lie beyond the zero bin, where the cosine's mean is 0.9.
        assert!(CombSum::of(noisy(4.0), 4).score() > 15.0);
        assert!(CombSum::of(noisy(4.0), 3).score() < 3.0);
        assert!(log_likelihood(noisy(4.0), 4) > 100.0);
        assert!(log_likelihood(noisy(4.0), 4) > log_likelihood(noisy(4.0), 2));
        assert!(log_likelihood(noisy(4.0), 5) < 0.0);
        assert_eq!(log_likelihood(noisy(4.0), 1), 0.0);
    }
}
