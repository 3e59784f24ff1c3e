//! Delay between pictures and poses, by correlating their motion: a rotation of the camera moves
//! the picture.
//!
//! From frame to frame the picture moves like a camera rotation m, estimated from the pixels
//! ([`turn`](super::turn)). Poses sampled at a delay δ after the frames give a rotation p(δ) and a
//! translation t(δ). At a scene distance Z the translation moves the centre of the picture like a
//! rotation of q/Z, q = (−t_y, t_x, 0). The estimate is the δ with the highest correlation:
//!
//!   argmax over δ of √(1 − min over a, b ≥ 0 of Σ|m − a·p(δ) − b·q(δ)|² / Σ|m|²)
//!
//! Without translation, or with a = 0, that is the correlation of the two. A factor a does not move
//! the maximum, so a wrong focal length does no harm. b = 1/Z is one number for the whole
//! recording, which absorbs the scale of the poses. A resting camera gives no delay.
//!
//! Pictures that are stored rotated by a quarter turn relative to the tracked camera have no
//! correlation at any delay. Then p and q are rotated about the optical axis by each quarter turn,
//! and the result includes the rotation.

use crate::fit::quantile::upper_median;
use glam::{DQuat, DVec3};

/// Largest searched delay, seconds.
pub const MAX_SEARCHED_DELAY_S: f64 = 0.5;
/// Smallest number of motions.
const MIN_MOTIONS: usize = 24;
/// Smallest RMS rotation between frames of a moving camera, radians: half a pixel of 640 across
/// 60°.
const MIN_RMS_RAD: f64 = 1e-3;
/// Smallest accepted correlation.
const MIN_LIKENESS: f64 = 0.7;
/// The delay is ambiguous if another maximum at least this far away is nearly as high.
const MIN_SEPARATION_S: f64 = 0.08;
const AMBIGUITY_RATIO: f64 = 0.97;
/// Rounds of iteratively reweighted least squares, with the weights 1 / (1 + |residual|² /
/// (`RESIDUAL_SCALE` · median of |residual|²)).
const REWEIGHTING_ROUNDS: usize = 3;
const RESIDUAL_SCALE: f64 = 4.0;
/// Number of jackknife groups for the standard deviation.
const JACKKNIFE_GROUPS: usize = 8;

/// Rotation of the camera from one frame to the next, estimated from the pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameRotation {
    /// The frames' times, seconds.
    pub from_s: f64,
    pub to_s: f64,
    /// Rotation vector in the camera's axes, radians.
    pub turn: DVec3,
}

/// Motion of the camera between two times, from the poses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseMotion {
    /// Rotation vector in the camera's axes, radians.
    pub turn: DVec3,
    /// Shift of a static point in the camera's axes by the camera's translation, in any unit.
    pub shift: DVec3,
}

impl PoseMotion {
    /// The rotation with the same image motion at the centre as the translation at a scene distance
    /// of 1.
    fn apparent_turn(&self) -> DVec3 {
        DVec3::new(-self.shift.y, self.shift.x, 0.0)
    }
}

/// Delay: added to a frame's time it gives the poses' time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Delay {
    pub delay_s: f64,
    /// One standard deviation, seconds.
    pub sigma_s: f64,
    /// Correlation; 1 if the picture moves exactly as the poses.
    pub likeness: f64,
    /// Ratio of the pictures' rotation to the poses'. Far from 1 the focal length is wrong.
    pub ratio: f64,
    /// Rotation of the poses' camera about its optical axis relative to the pictures, quarter
    /// turns.
    pub quarters: u32,
    /// Number of compared motions.
    pub motions: usize,
}

/// Reason why the delay is not determined.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum DelayFailure {
    #[error("{actual} motions from frame to frame are seen with poses at both ends; {MIN_MOTIONS} are needed")]
    TooFew { actual: usize },
    #[error("the picture hardly moves: as by a rotation of {:.3}° from frame to frame", turn.to_degrees())]
    Still { turn: f64 },
    #[error("the picture's motion does not match the poses: the likeness is {likeness:.2}, {MIN_LIKENESS} is needed")]
    Unlike { likeness: f64 },
    #[error("the best delay, {:.0} ms, is at the end of the searched range, {:.0} ms", 1e3 * delay_s, 1e3 * reach_s)]
    AtEnd { delay_s: f64, reach_s: f64 },
    #[error("two delays are as likely, {:.0} ms and {:.0} ms: the motion repeats itself", 1e3 * first_s, 1e3 * second_s)]
    Ambiguous { first_s: f64, second_s: f64 },
}

/// Estimates the delay within `reach_s`. `predicted` returns the motion between two times of the
/// poses' clock; `None` where there is no pose.
pub fn estimate(
    motions: &[FrameRotation],
    predicted: impl Fn(f64, f64) -> Option<PoseMotion>,
    reach_s: f64,
) -> Result<Delay, DelayFailure> {
    let upright = estimate_rotated(motions, &predicted, reach_s, 0);
    if !matches!(upright, Err(DelayFailure::Unlike { .. })) {
        return upright;
    }
    let turned = (1..4).filter_map(|quarters| estimate_rotated(motions, &predicted, reach_s, quarters).ok());
    turned.max_by(|a, b| a.likeness.total_cmp(&b.likeness)).ok_or(()).or(upright)
}

/// Estimates the delay for poses whose camera is rotated by a number of quarter turns about its
/// optical axis.
fn estimate_rotated(
    motions: &[FrameRotation],
    predicted: &impl Fn(f64, f64) -> Option<PoseMotion>,
    reach_s: f64,
    quarters: u32,
) -> Result<Delay, DelayFailure> {
    let count = motions.len();
    let rms = (motions.iter().map(|m| m.turn.length_squared()).sum::<f64>() / count.max(1) as f64).sqrt();
    if count < MIN_MOTIONS {
        return Err(DelayFailure::TooFew { actual: count });
    }
    if rms < MIN_RMS_RAD {
        return Err(DelayFailure::Still { turn: rms });
    }
    let interval_s = upper_median(motions.iter().map(|m| m.to_s - m.from_s)).unwrap_or(0.0);
    let step_s = (interval_s / 8.0).clamp(1e-3, reach_s / 8.0);
    let steps = (reach_s / step_s).ceil() as i64;
    let about_axis = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2 * f64::from(quarters));
    // For each motion, at a delay.
    let sums = |delay_s: f64| -> Vec<Option<DelayEquations>> {
        let equations = |m: &FrameRotation| {
            let moved = predicted(m.from_s + delay_s, m.to_s + delay_s)?;
            Some(DelayEquations::of(m.turn, about_axis * moved.turn, about_axis * moved.apparent_turn()))
        };
        motions.iter().map(equations).collect()
    };
    let table: Vec<Vec<Option<DelayEquations>>> = (-steps..=steps).map(|n| sums(n as f64 * step_s)).collect();
    let summed = |n: usize, weights: &[f64], without: Option<usize>| -> DelayEquations {
        let kept =
            table[n].iter().zip(weights).enumerate().filter(|(i, _)| Some(i * JACKKNIFE_GROUPS / count) != without);
        kept.filter_map(|(_, (sums, weight))| Some(sums.as_ref()?.times(*weight)))
            .fold(DelayEquations::default(), DelayEquations::and)
    };
    let likeness = |weights: &[f64], without: Option<usize>| -> Vec<f64> {
        let rows: Vec<DelayEquations> = (0..table.len()).map(|n| summed(n, weights, without)).collect();
        // A few motions correlate with anything.
        let max_number = rows.iter().map(|sums| sums.number).max().unwrap_or(0);
        let is_enough = |sums: &DelayEquations| sums.number >= MIN_MOTIONS / 2 && 4 * sums.number >= 3 * max_number;
        rows.iter().map(|sums| if is_enough(sums) { sums.likeness() } else { f64::NEG_INFINITY }).collect()
    };
    let at_s = |n: f64| (n - steps as f64) * step_s;
    // Outliers, such as motion past near objects, get a lower weight.
    let mut weights = vec![1.0; count];
    for _ in 0..REWEIGHTING_ROUNDS {
        let best = argmax(&likeness(&weights, None));
        let factors = summed(best, &weights, None).factors();
        let residual: Vec<Option<f64>> =
            table[best].iter().map(|sums| Some(sums.as_ref()?.residual(factors))).collect();
        let usual = upper_median(residual.iter().flatten().copied()).unwrap_or(0.0).max(f64::MIN_POSITIVE);
        weights = residual
            .iter()
            .map(|residual| residual.map_or(0.0, |residual| 1.0 / (1.0 + residual / (RESIDUAL_SCALE * usual))))
            .collect();
    }
    let all = likeness(&weights, None);
    let best = argmax(&all);
    let compared = summed(best, &weights, None);
    if compared.number < MIN_MOTIONS {
        return Err(DelayFailure::TooFew { actual: compared.number });
    }
    let alike = summed(best, &vec![1.0; count], None).likeness();
    if alike < MIN_LIKENESS {
        return Err(DelayFailure::Unlike { likeness: alike });
    }
    let delay_s = at_s(peak(&all, best));
    let is_inside =
        |n: usize| all.get(n.wrapping_sub(1)).zip(all.get(n + 1)).is_some_and(|(a, b)| a.min(*b).is_finite());
    if !is_inside(best) {
        return Err(DelayFailure::AtEnd { delay_s, reach_s });
    }
    let is_summit = |n: &usize| is_inside(*n) && all[*n] >= all[n - 1] && all[*n] >= all[n + 1];
    let others = (0..all.len()).filter(is_summit).filter(|n| (at_s(*n as f64) - delay_s).abs() > MIN_SEPARATION_S);
    if let Some(second) =
        others.max_by(|a, b| all[*a].total_cmp(&all[*b])).filter(|n| all[*n] > AMBIGUITY_RATIO * all[best])
    {
        return Err(DelayFailure::Ambiguous { first_s: delay_s, second_s: at_s(second as f64) });
    }
    // Jackknife: Var = (n − 1)/n Σ (xᵢ − x̄)², xᵢ without part i.
    let without: Vec<f64> = (0..JACKKNIFE_GROUPS)
        .map(|part| {
            let all = likeness(&weights, Some(part));
            at_s(peak(&all, argmax(&all)))
        })
        .collect();
    let mean_s = without.iter().sum::<f64>() / JACKKNIFE_GROUPS as f64;
    let spread: f64 = without.iter().map(|x| (x - mean_s).powi(2)).sum();
    let sigma_s = (spread * (JACKKNIFE_GROUPS - 1) as f64 / JACKKNIFE_GROUPS as f64).sqrt();
    let [ratio, _] = compared.factors();
    Ok(Delay { delay_s, sigma_s, likeness: alike, ratio, quarters, motions: compared.number })
}

/// Normal equations of m ≈ a·p + b·q over motions.
#[derive(Clone, Copy, Debug, Default)]
struct DelayEquations {
    mm: f64,
    mp: f64,
    mq: f64,
    pp: f64,
    pq: f64,
    qq: f64,
    number: usize,
}

impl DelayEquations {
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

    /// Least-squares a and b, neither below 0. If the translation is collinear with the rotation,
    /// the rotation explains everything.
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
        if self.residual(turn) <= self.residual(way) { turn } else { way }
    }

    /// |m − a·p − b·q|².
    fn residual(&self, [a, b]: [f64; 2]) -> f64 {
        let left =
            self.mm - 2.0 * (a * self.mp + b * self.mq) + a * a * self.pp + 2.0 * a * b * self.pq + b * b * self.qq;
        left.max(0.0)
    }

    fn likeness(&self) -> f64 {
        if self.mm > 0.0 { (1.0 - self.residual(self.factors()) / self.mm).max(0.0).sqrt() } else { 0.0 }
    }
}

fn argmax(values: &[f64]) -> usize {
    (0..values.len()).max_by(|a, b| values[*a].total_cmp(&values[*b])).unwrap_or(0)
}

/// Position of the maximum, refined by a parabola through its neighbours.
fn peak(values: &[f64], argmax: usize) -> f64 {
    let Some((before, after)) = values.get(argmax.wrapping_sub(1)).zip(values.get(argmax + 1)) else {
        return argmax as f64;
    };
    let bend = before - 2.0 * values[argmax] + after;
    if bend.is_finite() && bend < 0.0 {
        argmax as f64 + (0.5 * (before - after) / bend).clamp(-0.5, 0.5)
    } else {
        argmax as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const INTERVAL_S: f64 = 1.0 / 30.0;

    /// Orientation of a hand-held camera, radians about each axis: sines without a common period.
    fn hand_turn(time_s: f64) -> DVec3 {
        let sway = |a: f64, b: f64, c: f64| {
            0.05 * (a * time_s).sin() + 0.02 * (b * time_s + 1.0).sin() + 0.01 * (c * time_s).cos()
        };
        DVec3::new(sway(2.1, 5.3, 11.7), sway(1.7, 4.1, 13.3), 0.5 * sway(3.3, 6.1, 9.7))
    }

    fn motions(count: usize, of: impl Fn(f64) -> DVec3) -> Vec<FrameRotation> {
        let at_s = |i: usize| i as f64 * INTERVAL_S;
        (0..count)
            .map(|i| FrameRotation { from_s: at_s(i), to_s: at_s(i + 1), turn: of(at_s(i + 1)) - of(at_s(i)) })
            .collect()
    }

    fn turned(turn: DVec3) -> Option<PoseMotion> {
        Some(PoseMotion { turn, shift: DVec3::ZERO })
    }

    fn by_poses(from_s: f64, to_s: f64) -> Option<PoseMotion> {
        turned(hand_turn(to_s) - hand_turn(from_s))
    }

    #[test]
    fn known_delay_is_estimated_despite_a_factor_and_outliers() {
        for delay_s in [-0.213, -0.0371, 0.0, 0.008, 0.4] {
            let mut camera_motions = motions(90, |t| 1.1 * hand_turn(t + delay_s));
            // The camera moves past a near object.
            camera_motions.iter_mut().step_by(9).for_each(|m| m.turn += DVec3::new(0.0, 0.01, 0.0));
            let delay = estimate(&camera_motions, by_poses, MAX_SEARCHED_DELAY_S).unwrap();
            assert!((delay.delay_s - delay_s).abs() < 5e-4, "{delay_s}: {delay:?}");
            assert!(delay.sigma_s < 2e-3 && (delay.ratio - 1.1).abs() < 0.02, "{delay:?}");
            assert_eq!(delay.motions, 90);
        }
    }

    /// Position of a camera that walks and sways 1.5 m from the scene, m.
    fn walked(time_s: f64) -> DVec3 {
        let bob = |a: f64, b: f64| 0.08 * (a * time_s).sin() + 0.03 * (b * time_s + 0.4).sin();
        DVec3::new(bob(3.1, 8.3), bob(4.7, 7.1), 0.3 * time_s)
    }

    #[test]
    fn delay_of_a_translating_camera_is_estimated() {
        let by_poses = |from_s: f64, to_s: f64| {
            let shift = walked(from_s) - walked(to_s);
            Some(PoseMotion { turn: 0.1 * (hand_turn(to_s) - hand_turn(from_s)), shift })
        };
        for delay_s in [-0.12, 0.0, 0.05] {
            let at = |t: f64| {
                let shift = -walked(t + delay_s) / 1.5;
                0.1 * hand_turn(t + delay_s) + DVec3::new(-shift.y, shift.x, 0.0)
            };
            let delay = estimate(&motions(90, at), by_poses, MAX_SEARCHED_DELAY_S).unwrap();
            assert!((delay.delay_s - delay_s).abs() < 1e-3 && delay.likeness > 0.98, "{delay_s}: {delay:?}");
            // The rotation alone does not correlate.
            let turn_alone = |from_s, to_s| by_poses(from_s, to_s).and_then(|moved| turned(moved.turn));
            assert!(matches!(
                estimate(&motions(90, at), turn_alone, MAX_SEARCHED_DELAY_S),
                Err(DelayFailure::Unlike { .. })
            ));
        }
    }

    #[test]
    fn quarter_turn_of_stored_pictures_is_detected() {
        for quarters in 0..4u32 {
            let stored = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2 * f64::from(quarters));
            let delay =
                estimate(&motions(90, |t| stored * hand_turn(t + 0.04)), by_poses, MAX_SEARCHED_DELAY_S).unwrap();
            assert_eq!(delay.quarters, quarters);
            assert!((delay.delay_s - 0.04).abs() < 5e-4, "{quarters}: {delay:?}");
        }
    }

    #[test]
    fn delay_is_estimated_from_partly_overlapping_poses() {
        let camera_motions = motions(90, |t| hand_turn(t + 0.05));
        let ended = |from_s: f64, to_s: f64| by_poses(from_s, to_s).filter(|_| from_s > 1.0 && to_s < 2.5);
        let delay = estimate(&camera_motions, ended, MAX_SEARCHED_DELAY_S).unwrap();
        assert!((delay.delay_s - 0.05).abs() < 2e-3 && (40..46).contains(&delay.motions), "{delay:?}");
        assert_eq!(
            estimate(&camera_motions, |_, _| None, MAX_SEARCHED_DELAY_S),
            Err(DelayFailure::TooFew { actual: 0 })
        );
        assert_eq!(
            estimate(&camera_motions[..23], by_poses, MAX_SEARCHED_DELAY_S),
            Err(DelayFailure::TooFew { actual: 23 })
        );
    }

    #[test]
    fn undetermined_delays_are_refused() {
        let still = estimate(&motions(90, |t| 0.01 * hand_turn(t)), by_poses, MAX_SEARCHED_DELAY_S);
        assert!(matches!(still, Err(DelayFailure::Still { .. })), "{still:?}");
        let other = |t: f64| DVec3::new(0.05 * (7.0 * t).sin(), 0.05 * (9.1 * t).cos(), 0.0);
        let unlike = estimate(&motions(90, other), by_poses, MAX_SEARCHED_DELAY_S);
        assert!(matches!(unlike, Err(DelayFailure::Unlike { .. })), "{unlike:?}");
        // Five oscillations a second.
        let sway = |t: f64| DVec3::new(0.0, 0.05 * (31.4 * t).sin(), 0.0);
        let again = estimate(&motions(90, sway), |from, to| turned(sway(to) - sway(from)), MAX_SEARCHED_DELAY_S);
        assert!(matches!(again, Err(DelayFailure::Ambiguous { .. })), "{again:?}");
        let slow = |t: f64| DVec3::new(0.0, (-(t - 1.5).powi(2)).exp(), 0.0);
        let far =
            estimate(&motions(90, |t| slow(t + 0.7)), |from, to| turned(slow(to) - slow(from)), MAX_SEARCHED_DELAY_S);
        assert!(matches!(far, Err(DelayFailure::AtEnd { .. })), "{far:?}");
    }
}
