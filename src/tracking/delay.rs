//! The delay between pictures and poses, from motion: what turns the camera moves the picture.
//!
//! From frame to frame the picture moves as if the camera turned by m, found in the pixels ([`turn`](super::turn)). Poses that are
//! read δ later than the frames say a turn p(δ) and a way t(δ). Past things at the distance Z that way moves the picture's middle
//! as a turn of q/Z does, q = (−t_y, t_x, 0). δ is where pictures and poses are most alike:
//!
//!   argmax over δ of √(1 − min over a, b ≥ 0 of Σ|m − a·p(δ) − b·q(δ)|² / Σ|m|²)
//!
//! Without a way, or with a = 0, that is the correlation of the two. A factor a does not move the maximum, so that a focal length
//! that is off does no harm. b = 1/Z is one number for the whole recording, which no scale of the poses changes. A camera that
//! rests tells nothing.
//!
//! Pictures that are stored turned by a quarter against the camera whose poses were recorded are alike by no delay. Then p and q
//! are turned about the optical axis by each quarter, and the result states by how much.

use glam::{DQuat, DVec3};

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

/// What the poses say of the camera between two times.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseMotion {
    /// Along its axis in the camera's axes, radians.
    pub turn: DVec3,
    /// How things that are far away move in the camera's axes because it travels, in any unit.
    pub shift: DVec3,
}

impl PoseMotion {
    /// The turn that moves the middle of the picture as the way does past things at a distance of 1.
    fn apparent_turn(&self) -> DVec3 {
        DVec3::new(-self.shift.y, self.shift.x, 0.0)
    }
}

/// What is added to a frame's time to get the poses'.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Delay {
    pub delay_s: f64,
    /// One standard deviation, seconds.
    pub sigma_s: f64,
    /// 1: the picture moves as the poses say.
    pub likeness: f64,
    /// The pictures' turn by the poses'. Far from 1, the focal length is wrong.
    pub ratio: f64,
    /// By how much the poses' camera is turned about its optical axis against the pictures, quarters of a turn.
    pub quarters: u32,
    /// Motions that were compared.
    pub motions: usize,
}

/// Why pictures and poses do not tell their delay.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum NoDelay {
    #[error("{found} motions from frame to frame are seen with poses at both ends; {LEAST_MOTIONS} are needed")]
    TooFew { found: usize },
    #[error("the picture hardly moves: as by a turn of {:.3}° from frame to frame", turn.to_degrees())]
    Still { turn: f64 },
    #[error("the picture does not move as the poses say: the likeness is {likeness:.2}, {LEAST_LIKENESS} is needed")]
    Unlike { likeness: f64 },
    #[error("the best delay, {:.0} ms, is at the end of what was searched, {:.0} ms", 1e3 * delay_s, 1e3 * reach_s)]
    AtEnd { delay_s: f64, reach_s: f64 },
    #[error("two delays are as likely, {:.0} ms and {:.0} ms: the motion repeats itself", 1e3 * first_s, 1e3 * second_s)]
    Ambiguous { first_s: f64, second_s: f64 },
}

/// Finds the delay within `reach_s`. `predicted` gives the motion between two times of the poses' clock; `None` where there is no
/// pose.
pub fn estimate(
    motions: &[Motion],
    predicted: impl Fn(f64, f64) -> Option<PoseMotion>,
    reach_s: f64,
) -> Result<Delay, NoDelay> {
    let upright = of_quarters(motions, &predicted, reach_s, 0);
    if !matches!(upright, Err(NoDelay::Unlike { .. })) {
        return upright;
    }
    let turned = (1..4).filter_map(|quarters| of_quarters(motions, &predicted, reach_s, quarters).ok());
    turned.max_by(|a, b| a.likeness.total_cmp(&b.likeness)).ok_or(()).or(upright)
}

/// The same for poses whose camera is turned by so many quarters about its optical axis.
fn of_quarters(
    motions: &[Motion],
    predicted: &impl Fn(f64, f64) -> Option<PoseMotion>,
    reach_s: f64,
    quarters: u32,
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
    let about_axis = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2 * f64::from(quarters));
    // Of each motion, at each delay.
    let sums = |delay_s: f64| -> Vec<Option<Sums>> {
        let of = |m: &Motion| {
            let moved = predicted(m.from_s + delay_s, m.to_s + delay_s)?;
            Some(Sums::of(m.turn, about_axis * moved.turn, about_axis * moved.apparent_turn()))
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
        let factors = summed(best, &weights, None).factors();
        let off: Vec<Option<f64>> = table[best].iter().map(|sums| Some(sums.as_ref()?.off(factors))).collect();
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
    let [ratio, _] = compared.factors();
    Ok(Delay { delay_s, sigma_s, likeness: alike, ratio, quarters, motions: compared.number })
}

/// Normal equations of m ≈ a·p + b·q over motions.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    mm: f64,
    mp: f64,
    mq: f64,
    pp: f64,
    pq: f64,
    qq: f64,
    number: usize,
}

impl Sums {
    fn of(m: DVec3, p: DVec3, q: DVec3) -> Self {
        Self { mm: m.dot(m), mp: m.dot(p), mq: m.dot(q), pp: p.dot(p), pq: p.dot(q), qq: q.dot(q), number: 1 }
    }

    fn and(self, other: Self) -> Self {
        Self {
            mm: self.mm + other.mm,
            mp: self.mp + other.mp,
            mq: self.mq + other.mq,
            pp: self.pp + other.pp,
            pq: self.pq + other.pq,
            qq: self.qq + other.qq,
            number: self.number + other.number,
        }
    }

    fn times(&self, weight: f64) -> Self {
        let Self { mm, mp, mq, pp, pq, qq, number } = *self;
        Self {
            mm: weight * mm,
            mp: weight * mp,
            mq: weight * mq,
            pp: weight * pp,
            pq: weight * pq,
            qq: weight * qq,
            number,
        }
    }

    /// a and b, neither below 0, with which the poses explain most. Of a way that goes with the turn, the turn explains all.
    fn factors(&self) -> [f64; 2] {
        const ALONG: f64 = 1e-6;
        let alone = |m: f64, own: f64| if own > 0.0 { (m / own).max(0.0) } else { 0.0 };
        let determinant = self.pp * self.qq - self.pq * self.pq;
        if determinant > ALONG * self.pp * self.qq {
            let a = (self.mp * self.qq - self.mq * self.pq) / determinant;
            let b = (self.mq * self.pp - self.mp * self.pq) / determinant;
            if a >= 0.0 && b >= 0.0 {
                return [a, b];
            }
        }
        let (turn, way) = ([alone(self.mp, self.pp), 0.0], [0.0, alone(self.mq, self.qq)]);
        if self.off(turn) <= self.off(way) { turn } else { way }
    }

    /// |m − a·p − b·q|².
    fn off(&self, [a, b]: [f64; 2]) -> f64 {
        let left =
            self.mm - 2.0 * (a * self.mp + b * self.mq) + a * a * self.pp + 2.0 * a * b * self.pq + b * b * self.qq;
        left.max(0.0)
    }

    fn likeness(&self) -> f64 {
        if self.mm > 0.0 { (1.0 - self.off(self.factors()) / self.mm).max(0.0).sqrt() } else { 0.0 }
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

    fn turned(turn: DVec3) -> Option<PoseMotion> {
        Some(PoseMotion { turn, shift: DVec3::ZERO })
    }

    fn by_poses(from_s: f64, to_s: f64) -> Option<PoseMotion> {
        turned(held(to_s) - held(from_s))
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

    /// A camera that walks 1.5 m from things and sways: where it is, m.
    fn walked(time_s: f64) -> DVec3 {
        let bob = |a: f64, b: f64| 0.08 * (a * time_s).sin() + 0.03 * (b * time_s + 0.4).sin();
        DVec3::new(bob(3.1, 8.3), bob(4.7, 7.1), 0.3 * time_s)
    }

    #[test]
    fn delay_of_a_camera_that_mostly_travels_is_found() {
        let by_poses = |from_s: f64, to_s: f64| {
            let shift = walked(from_s) - walked(to_s);
            Some(PoseMotion { turn: 0.1 * (held(to_s) - held(from_s)), shift })
        };
        for delay_s in [-0.12, 0.0, 0.05] {
            let at = |t: f64| {
                let shift = -walked(t + delay_s) / 1.5;
                0.1 * held(t + delay_s) + DVec3::new(-shift.y, shift.x, 0.0)
            };
            let found = estimate(&motions(90, at), by_poses, REACH_S).unwrap();
            assert!((found.delay_s - delay_s).abs() < 1e-3 && found.likeness > 0.98, "{delay_s}: {found:?}");
            // By the turn alone the two are unlike.
            let turn_alone = |from_s, to_s| by_poses(from_s, to_s).and_then(|moved| turned(moved.turn));
            assert!(matches!(estimate(&motions(90, at), turn_alone, REACH_S), Err(NoDelay::Unlike { .. })));
        }
    }

    #[test]
    fn pictures_stored_a_quarter_turned_are_told_with_their_delay() {
        for quarters in 0..4u32 {
            let stored = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2 * f64::from(quarters));
            let found = estimate(&motions(90, |t| stored * held(t + 0.04)), by_poses, REACH_S).unwrap();
            assert_eq!(found.quarters, quarters);
            assert!((found.delay_s - 0.04).abs() < 5e-4, "{quarters}: {found:?}");
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
        let again = estimate(&motions(90, sway), |from, to| turned(sway(to) - sway(from)), REACH_S);
        assert!(matches!(again, Err(NoDelay::Ambiguous { .. })), "{again:?}");
        let slow = |t: f64| DVec3::new(0.0, (-(t - 1.5).powi(2)).exp(), 0.0);
        let far = estimate(&motions(90, |t| slow(t + 0.7)), |from, to| turned(slow(to) - slow(from)), REACH_S);
        assert!(matches!(far, Err(NoDelay::AtEnd { .. })), "{far:?}");
    }
}
