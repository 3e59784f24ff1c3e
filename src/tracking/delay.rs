//! The delay between pictures and poses, from motion: what turns the camera moves the picture.
//!
//! From frame to frame the camera turns by m, found in the pixels ([`turn`](super::turn)). Poses that are read δ later than
//! the frames say p(δ). δ is where the two are most alike:
//!
//!   argmax over δ of Σ m·p(δ) / √(Σ|m|² Σ|p(δ)|²)
//!
//! A factor between the two does not move the maximum, so that neither a focal length that is off nor a camera that travels as
//! well does harm. One that only travels, or rests, tells nothing.

use glam::DVec3;

/// How far apart the clocks may be, seconds.
pub const REACH_S: f64 = 0.5;
/// Shifts that tell something.
const LEAST_MOTIONS: usize = 24;
/// Root mean square of the turn from frame to frame below which the camera rests, radians: half a pixel of 640 across 60°.
const LEAST_TURN: f64 = 1e-3;
/// Least likeness of the pictures' motion and the poses'.
const LEAST_LIKENESS: f64 = 0.7;
/// A second delay this far off that is nearly as likely makes the first one a guess.
const APART_S: f64 = 0.08;
const NEARLY: f64 = 0.97;
/// Rounds of weighing the motions, by 1 / (1 + |off|² / (FITS · median of |off|²)).
const ROUNDS: usize = 3;
const FITS: f64 = 4.0;
/// Parts of which each is left out once to see how sure the delay is.
const PARTS: usize = 8;

/// The camera's turn from one frame to the next, as the pictures tell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// The frames' times, seconds.
    pub from_s: f64,
    pub to_s: f64,
    /// Along its axis in the camera's axes, radians.
    pub turn: DVec3,
}

/// What is added to a frame's time to get the poses'.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Delay {
    pub delay_s: f64,
    /// One standard deviation, seconds.
    pub sigma_s: f64,
    /// 1: the picture moves as the poses say.
    pub likeness: f64,
    /// The pictures' motion by the poses'. Far from 1, the focal length is wrong or the camera travels.
    pub ratio: f64,
    /// Motions that were compared.
    pub motions: usize,
}

/// Why pictures and poses do not tell their delay.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum NoDelay {
    #[error("{found} motions from frame to frame are seen with poses at both ends; {LEAST_MOTIONS} are needed")]
    TooFew { found: usize },
    #[error("the camera hardly turns: {:.3}° from frame to frame", turn.to_degrees())]
    Still { turn: f64 },
    #[error("the picture does not move as the poses say: the likeness is {likeness:.2}, {LEAST_LIKENESS} is needed")]
    Unlike { likeness: f64 },
    #[error("the best delay, {:.0} ms, is at the end of what was searched, {:.0} ms", 1e3 * delay_s, 1e3 * reach_s)]
    AtEnd { delay_s: f64, reach_s: f64 },
    #[error("two delays are as likely, {:.0} ms and {:.0} ms: the motion repeats itself", 1e3 * first_s, 1e3 * second_s)]
    Ambiguous { first_s: f64, second_s: f64 },
}

/// Finds the delay within `reach_s`. `predicted` gives the turn between two times of the poses' clock; `None` where there is no
/// pose.
pub fn estimate(
    motions: &[Motion],
    predicted: impl Fn(f64, f64) -> Option<DVec3>,
    reach_s: f64,
) -> Result<Delay, NoDelay> {
    let count = motions.len();
    let rms = (motions.iter().map(|m| m.turn.length_squared()).sum::<f64>() / count.max(1) as f64).sqrt();
    if count < LEAST_MOTIONS {
        return Err(NoDelay::TooFew { found: count });
    }
    if rms < LEAST_TURN {
        return Err(NoDelay::Still { turn: rms });
    }
    let mut intervals: Vec<f64> = motions.iter().map(|m| m.to_s - m.from_s).collect();
    intervals.sort_by(f64::total_cmp);
    let step_s = (intervals[count / 2] / 8.0).clamp(1e-3, reach_s / 8.0);
    let steps = (reach_s / step_s).ceil() as i64;
    // Of each motion, at each delay.
    let sums = |delay_s: f64| -> Vec<Option<Sums>> {
        let of = |m: &Motion| {
            let p = predicted(m.from_s + delay_s, m.to_s + delay_s)?;
            Some(Sums { both: m.turn.dot(p), seen: m.turn.length_squared(), told: p.length_squared(), number: 1 })
        };
        motions.iter().map(of).collect()
    };
    let table: Vec<Vec<Option<Sums>>> = (-steps..=steps).map(|n| sums(n as f64 * step_s)).collect();
    let summed = |n: usize, weights: &[f64], without: Option<usize>| -> Sums {
        let kept = table[n].iter().zip(weights).enumerate().filter(|(i, _)| Some(i * PARTS / count) != without);
        kept.filter_map(|(_, (sums, weight))| Some(sums.as_ref()?.times(*weight))).fold(Sums::default(), Sums::and)
    };
    let likeness = |weights: &[f64], without: Option<usize>| -> Vec<f64> {
        let rows: Vec<Sums> = (0..table.len()).map(|n| summed(n, weights, without)).collect();
        // A few motions are like anything.
        let most = rows.iter().map(|sums| sums.number).max().unwrap_or(0);
        let is_enough = |sums: &Sums| sums.number >= LEAST_MOTIONS / 2 && 4 * sums.number >= 3 * most;
        rows.iter().map(|sums| if is_enough(sums) { sums.likeness() } else { f64::NEG_INFINITY }).collect()
    };
    let at_s = |n: f64| (n - steps as f64) * step_s;
    // What does not fit, as where the camera travels past near things, is heard less.
    let mut weights = vec![1.0; count];
    for _ in 0..ROUNDS {
        let best = top(&likeness(&weights, None));
        let ratio = summed(best, &weights, None).ratio();
        let off: Vec<Option<f64>> = table[best].iter().map(|sums| Some(sums.as_ref()?.off(ratio))).collect();
        let mut sorted: Vec<f64> = off.iter().flatten().copied().collect();
        sorted.sort_by(f64::total_cmp);
        let usual = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0).max(f64::MIN_POSITIVE);
        weights = off.iter().map(|off| off.map_or(0.0, |off| 1.0 / (1.0 + off / (FITS * usual)))).collect();
    }
    let all = likeness(&weights, None);
    let best = top(&all);
    let compared = summed(best, &weights, None);
    if compared.number < LEAST_MOTIONS {
        return Err(NoDelay::TooFew { found: compared.number });
    }
    let alike = summed(best, &vec![1.0; count], None).likeness();
    if alike < LEAST_LIKENESS {
        return Err(NoDelay::Unlike { likeness: alike });
    }
    let delay_s = at_s(summit(&all, best));
    let is_inside =
        |n: usize| all.get(n.wrapping_sub(1)).zip(all.get(n + 1)).is_some_and(|(a, b)| a.min(*b).is_finite());
    if !is_inside(best) {
        return Err(NoDelay::AtEnd { delay_s, reach_s });
    }
    let is_summit = |n: &usize| is_inside(*n) && all[*n] >= all[n - 1] && all[*n] >= all[n + 1];
    let others = (0..all.len()).filter(is_summit).filter(|n| (at_s(*n as f64) - delay_s).abs() > APART_S);
    if let Some(second) = others.max_by(|a, b| all[*a].total_cmp(&all[*b])).filter(|n| all[*n] > NEARLY * all[best]) {
        return Err(NoDelay::Ambiguous { first_s: delay_s, second_s: at_s(second as f64) });
    }
    // Jackknife: Var = (n − 1)/n Σ (xᵢ − x̄)², xᵢ without part i.
    let without: Vec<f64> = (0..PARTS)
        .map(|part| {
            let all = likeness(&weights, Some(part));
            at_s(summit(&all, top(&all)))
        })
        .collect();
    let mean_s = without.iter().sum::<f64>() / PARTS as f64;
    let spread: f64 = without.iter().map(|x| (x - mean_s).powi(2)).sum();
    let sigma_s = (spread * (PARTS - 1) as f64 / PARTS as f64).sqrt();
    Ok(Delay { delay_s, sigma_s, likeness: alike, ratio: compared.ratio(), motions: compared.number })
}

/// Of motions seen and told.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    both: f64,
    seen: f64,
    told: f64,
    number: usize,
}

impl Sums {
    fn and(self, other: Self) -> Self {
        Self {
            both: self.both + other.both,
            seen: self.seen + other.seen,
            told: self.told + other.told,
            number: self.number + other.number,
        }
    }

    fn times(&self, weight: f64) -> Self {
        let Self { both, seen, told, number } = *self;
        Self { both: weight * both, seen: weight * seen, told: weight * told, number }
    }

    /// What the poses' turn is multiplied by to give the pictures'.
    fn ratio(&self) -> f64 {
        if self.told > 0.0 { self.both / self.told } else { 0.0 }
    }

    /// |m − ratio·p|² of one motion.
    fn off(&self, ratio: f64) -> f64 {
        (self.seen - 2.0 * ratio * self.both + ratio * ratio * self.told).max(0.0)
    }

    fn likeness(&self) -> f64 {
        if self.told > 0.0 { self.both / (self.seen * self.told).sqrt() } else { 0.0 }
    }
}

fn top(values: &[f64]) -> usize {
    (0..values.len()).max_by(|a, b| values[*a].total_cmp(&values[*b])).unwrap_or(0)
}

/// Where the parabola through the largest value and its neighbours is highest.
fn summit(values: &[f64], top: usize) -> f64 {
    let Some((before, after)) = values.get(top.wrapping_sub(1)).zip(values.get(top + 1)) else { return top as f64 };
    let bend = before - 2.0 * values[top] + after;
    if bend.is_finite() && bend < 0.0 {
        top as f64 + (0.5 * (before - after) / bend).clamp(-0.5, 0.5)
    } else {
        top as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const INTERVAL_S: f64 = 1.0 / 30.0;

    /// Where a hand-held camera looks, radians about each axis: sines that never meet again.
    fn held(time_s: f64) -> DVec3 {
        let sway = |a: f64, b: f64, c: f64| {
            0.05 * (a * time_s).sin() + 0.02 * (b * time_s + 1.0).sin() + 0.01 * (c * time_s).cos()
        };
        DVec3::new(sway(2.1, 5.3, 11.7), sway(1.7, 4.1, 13.3), 0.5 * sway(3.3, 6.1, 9.7))
    }

    fn motions(count: usize, of: impl Fn(f64) -> DVec3) -> Vec<Motion> {
        let at_s = |i: usize| i as f64 * INTERVAL_S;
        (0..count).map(|i| Motion { from_s: at_s(i), to_s: at_s(i + 1), turn: of(at_s(i + 1)) - of(at_s(i)) }).collect()
    }

    fn by_poses(from_s: f64, to_s: f64) -> Option<DVec3> {
        Some(held(to_s) - held(from_s))
    }

    #[test]
    fn a_known_delay_is_found_through_a_factor_and_what_does_not_fit() {
        for delay_s in [-0.213, -0.0371, 0.0, 0.008, 0.4] {
            let mut seen = motions(90, |t| 1.1 * held(t + delay_s));
            // The camera travels past something near.
            seen.iter_mut().step_by(9).for_each(|m| m.turn += DVec3::new(0.0, 0.01, 0.0));
            let found = estimate(&seen, by_poses, REACH_S).unwrap();
            assert!((found.delay_s - delay_s).abs() < 5e-4, "{delay_s}: {found:?}");
            assert!(found.sigma_s < 2e-3 && (found.ratio - 1.1).abs() < 0.02, "{found:?}");
            assert_eq!(found.motions, 90);
        }
    }

    #[test]
    fn poses_that_end_are_no_worse_than_few_motions() {
        let seen = motions(90, |t| held(t + 0.05));
        let ended = |from_s: f64, to_s: f64| by_poses(from_s, to_s).filter(|_| from_s > 1.0 && to_s < 2.5);
        let found = estimate(&seen, ended, REACH_S).unwrap();
        assert!((found.delay_s - 0.05).abs() < 2e-3 && (40..46).contains(&found.motions), "{found:?}");
        assert_eq!(estimate(&seen, |_, _| None, REACH_S), Err(NoDelay::TooFew { found: 0 }));
        assert_eq!(estimate(&seen[..23], by_poses, REACH_S), Err(NoDelay::TooFew { found: 23 }));
    }

    #[test]
    fn what_tells_nothing_is_refused() {
        let still = estimate(&motions(90, |t| 0.01 * held(t)), by_poses, REACH_S);
        assert!(matches!(still, Err(NoDelay::Still { .. })), "{still:?}");
        let other = |t: f64| DVec3::new(0.05 * (7.0 * t).sin(), 0.05 * (9.1 * t).cos(), 0.0);
        let unlike = estimate(&motions(90, other), by_poses, REACH_S);
        assert!(matches!(unlike, Err(NoDelay::Unlike { .. })), "{unlike:?}");
        // Five sways a second.
        let sway = |t: f64| DVec3::new(0.0, 0.05 * (31.4 * t).sin(), 0.0);
        let again = estimate(&motions(90, sway), |from, to| Some(sway(to) - sway(from)), REACH_S);
        assert!(matches!(again, Err(NoDelay::Ambiguous { .. })), "{again:?}");
        let slow = |t: f64| DVec3::new(0.0, (-(t - 1.5).powi(2)).exp(), 0.0);
        let far = estimate(&motions(90, |t| slow(t + 0.7)), |from, to| Some(slow(to) - slow(from)), REACH_S);
        assert!(matches!(far, Err(NoDelay::AtEnd { .. })), "{far:?}");
    }
}
