//! Poses over time.

pub mod covariance;
pub mod delay;
pub mod matchmove;
pub mod records;
pub mod smooth;
pub mod tum;
pub mod turn;

use delay::PoseMotion;
use glam::DQuat;

use crate::fit::quantile::upper_median;
use crate::pose::Pose;
use crate::text::fixed;

/// A pose this close counts as being at the requested time, seconds: sums of times since 1970 are
/// rounded by up to 2.4e-7 s each.
const ROUNDING_S: f64 = 1e-6;

/// Timestamped poses, ascending in time. A track is either complete or growing: the end of a
/// growing one is not final.
///
/// Lookups take times on the frames' clock. Only [`PoseTrack::poses`], [`PoseTrack::push`] and the
/// errors have times on the poses' clock.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PoseTrack {
    poses: Vec<(f64, Pose)>,
    /// Time on the poses' clock minus time on the frames' clock, seconds.
    clock_offset_s: f64,
    /// Longest gap across which [`PoseTrack::at`] interpolates, seconds.
    max_gap_s: f64,
    /// More poses may be added.
    grows: bool,
}

/// Reason why there is no pose.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum NoPose {
    #[error("the track holds no poses")]
    Empty,
    #[error("{} s lies before the first pose at {} s", fixed(*time_s, 6), fixed(*first_s, 6))]
    Before { time_s: f64, first_s: f64 },
    #[error("{} s lies after the last pose at {} s", fixed(*time_s, 6), fixed(*last_s, 6))]
    After { time_s: f64, last_s: f64 },
    /// The track is growing, and the pose may still be added.
    #[error("the pose at {} s has not arrived yet", fixed(*time_s, 6))]
    NotYet { time_s: f64 },
    #[error("{} s lies in a gap of {} s between poses", fixed(*time_s, 6), fixed(*gap_s, 3))]
    Gap { time_s: f64, gap_s: f64 },
}

/// Timestamps that do not ascend.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("pose {index} at {} s does not come after the one before it at {} s", fixed(*time_s, 6), fixed(*before_s, 6))]
pub struct NotAscending {
    pub index: usize,
    pub time_s: f64,
    pub before_s: f64,
}

/// Default of the longest interpolated gap, seconds: three times the median interval between poses,
/// and at least 0.1 s, in which a hand-held camera still moves smoothly.
pub fn default_max_gap_s(times_s: impl Iterator<Item = f64>) -> f64 {
    let times_s: Vec<f64> = times_s.collect();
    median_interval_s(&times_s).map_or(0.1, |interval_s| (3.0 * interval_s).max(0.1))
}

/// The median interval of ascending times, seconds; `None` for fewer than two.
pub fn median_interval_s(times_s: &[f64]) -> Option<f64> {
    upper_median(times_s.windows(2).map(|pair| pair[1] - pair[0]))
}

impl PoseTrack {
    /// A track of pairs (timestamp in seconds, pose), strictly ascending in time.
    pub fn new(poses: Vec<(f64, Pose)>, max_gap_s: f64) -> Result<Self, NotAscending> {
        for (i, pair) in poses.windows(2).enumerate() {
            // NaN is refused too: it does not compare.
            if pair[1].0.partial_cmp(&pair[0].0) != Some(std::cmp::Ordering::Greater) {
                return Err(NotAscending { index: i + 1, time_s: pair[1].0, before_s: pair[0].0 });
            }
        }
        Ok(Self { poses, clock_offset_s: 0.0, max_gap_s, grows: false })
    }

    /// The track of a camera at rest, within an hour of the time 0.
    pub fn at_rest(pose: Pose) -> Self {
        let poses = vec![(-3600.0, pose), (3600.0, pose)];
        Self { poses, clock_offset_s: 0.0, max_gap_s: f64::INFINITY, grows: false }
    }

    /// An empty track that gets its poses by [`PoseTrack::push`].
    pub fn growing(max_gap_s: f64) -> Self {
        Self { poses: Vec::new(), clock_offset_s: 0.0, max_gap_s, grows: true }
    }

    /// Sets the offset of a frame clock that is `clock_offset_s` behind that of the poses, seconds.
    pub fn with_clock_offset_s(self, clock_offset_s: f64) -> Self {
        Self { clock_offset_s, ..self }
    }

    /// Time on the poses' clock minus time on the frames' clock, seconds.
    pub fn clock_offset_s(&self) -> f64 {
        self.clock_offset_s
    }

    /// Appends a pose. One that is not later than the last is refused, and the track is unchanged.
    pub fn push(&mut self, time_s: f64, pose: Pose) -> Result<(), NotAscending> {
        let before_s = self.poses.last().map_or(f64::NEG_INFINITY, |last| last.0);
        if time_s.is_nan() || time_s <= before_s {
            return Err(NotAscending { index: self.poses.len(), time_s, before_s });
        }
        self.poses.push((time_s, pose));
        Ok(())
    }

    /// Drops the poses that are not needed for times from `from_s` on: those before it, except the
    /// last one.
    pub fn trim(&mut self, from_s: f64) {
        let from_s = from_s + self.clock_offset_s;
        let after = self.poses.partition_point(|pose| pose.0 <= from_s);
        self.poses.drain(..after.saturating_sub(1));
    }

    /// Marks the track complete: later times fail with `After` instead of `NotYet`.
    pub fn finish(&mut self) {
        self.grows = false;
    }

    /// Checks that every time in the closed interval has a pose. The error is that of the first
    /// time without one.
    pub fn covers(&self, from_s: f64, to_s: f64) -> Result<(), NoPose> {
        let [from_s, to_s] = [from_s, to_s].map(|time_s| time_s + self.clock_offset_s);
        self.at_pose_time(from_s)?;
        let first = self.poses.partition_point(|pose| pose.0 <= from_s).saturating_sub(1);
        for pair in self.poses[first..].windows(2).take_while(|pair| pair[0].0 + ROUNDING_S < to_s) {
            let gap_s = pair[1].0 - pair[0].0;
            if gap_s > self.max_gap_s && pair[1].0 - ROUNDING_S > from_s {
                return Err(NoPose::Gap { time_s: pair[0].0.max(from_s), gap_s });
            }
        }
        self.at_pose_time(to_s).map(drop)
    }

    /// Longest gap across which poses are interpolated, seconds.
    pub fn max_gap_s(&self) -> f64 {
        self.max_gap_s
    }

    /// The poses by their own clock.
    pub fn poses(&self) -> &[(f64, Pose)] {
        &self.poses
    }

    /// The poses by the frames' clock.
    pub fn poses_in_frame_time(&self) -> impl Iterator<Item = (f64, Pose)> {
        self.poses.iter().map(|(time_s, pose)| (time_s - self.clock_offset_s, *pose))
    }

    /// Multiplies the translations by `factor`.
    pub fn scaled(&self, factor: f64) -> Self {
        let scaled = |pose: &Pose| Pose::new(pose.rotation, factor * pose.translation_m);
        Self { poses: self.poses.iter().map(|(t, pose)| (*t, scaled(pose))).collect(), ..*self }
    }

    /// The poses in another world: `camera_from_other = camera_from_world · world_from_other`.
    pub fn in_world(&self, world_from_other: &Pose) -> Self {
        let moved = |pose: &Pose| {
            let rotation = pose.rotation * world_from_other.rotation;
            Pose::new(rotation, pose.transform_point(world_from_other.translation_m))
        };
        Self { poses: self.poses.iter().map(|(t, pose)| (*t, moved(pose))).collect(), ..*self }
    }

    /// The track of a camera rotated in place; `turn` converts its axes to the rotated ones.
    pub fn turned(&self, turn: DQuat) -> Self {
        let turned = |pose: &Pose| Pose::new(turn * pose.rotation, turn * pose.translation_m);
        Self { poses: self.poses.iter().map(|(t, pose)| (*t, turned(pose))).collect(), ..*self }
    }

    /// The pose at a time: an exact one, or interpolated between its two neighbours. Where
    /// interpolation is not possible (at the track's ends, in a gap), a pose within a microsecond
    /// also counts.
    pub fn at(&self, time_s: f64) -> Result<Pose, NoPose> {
        self.at_pose_time(time_s + self.clock_offset_s)
    }

    fn at_pose_time(&self, time_s: f64) -> Result<Pose, NoPose> {
        let after = self.poses.partition_point(|p| p.0 <= time_s);
        let before = after.checked_sub(1).map(|i| self.poses[i]);
        let next = self.poses.get(after).copied();
        match (before, next) {
            (Some((t0, a)), _) if t0 == time_s => Ok(a),
            (Some((t0, a)), Some((t1, b))) if t1 - t0 <= self.max_gap_s => {
                Ok(a.interpolate(&b, (time_s - t0) / (t1 - t0)))
            }
            (Some((t0, a)), _) if time_s - t0 < ROUNDING_S => Ok(a),
            (_, Some((t1, b))) if t1 - time_s < ROUNDING_S => Ok(b),
            (Some((t0, _)), Some((t1, _))) => Err(NoPose::Gap { time_s, gap_s: t1 - t0 }),
            (None, Some((first_s, _))) => Err(NoPose::Before { time_s, first_s }),
            (_, None) if self.grows && !time_s.is_nan() => Err(NoPose::NotYet { time_s }),
            (Some((last_s, _)), None) => Err(NoPose::After { time_s, last_s }),
            (None, None) => Err(NoPose::Empty),
        }
    }

    /// Rotation and translation of the camera between two times, in the camera's axes. `None` if
    /// either has no pose.
    pub fn motion_between(&self, from_s: f64, to_s: f64) -> Option<PoseMotion> {
        let (from, to) = (self.at(from_s).ok()?, self.at(to_s).ok()?);
        // world_from_to⁻¹ · world_from_from.
        let to_from_world = to.world_from_camera_rotation().inverse();
        Some(PoseMotion {
            turn: (to_from_world * from.world_from_camera_rotation()).to_scaled_axis(),
            shift: to_from_world * (from.position_in_world_m() - to.position_in_world_m()),
        })
    }

    /// Like [`PoseTrack::at`], but returns the nearest pose before the track's start, after its end
    /// and in a gap: for the ends of an exposure whose middle has a pose. `None` if empty.
    pub fn at_or_nearest(&self, time_s: f64) -> Option<Pose> {
        let time_s = time_s + self.clock_offset_s;
        if let Ok(pose) = self.at_pose_time(time_s) {
            return Some(pose);
        }
        let after = self.poses.partition_point(|p| p.0 <= time_s);
        let before = after.checked_sub(1).map(|i| self.poses[i]);
        let next = self.poses.get(after).copied();
        match (before, next) {
            (Some(a), Some(b)) => Some(if time_s - a.0 <= b.0 - time_s { a.1 } else { b.1 }),
            (Some(a), None) => Some(a.1),
            (None, Some(b)) => Some(b.1),
            (None, None) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn track() -> PoseTrack {
        let at = |x: f64| Pose::from_camera_in_world(DVec3::new(x, 0.0, 0.0), DQuat::IDENTITY);
        PoseTrack::new(vec![(1.0, at(0.0)), (2.0, at(1.0)), (9.0, at(2.0))], 1.5).unwrap()
    }

    #[test]
    fn track_interpolates_or_names_the_reason() {
        let t = track();
        assert!((t.at(1.25).unwrap().position_in_world_m().x - 0.25).abs() < 1e-12);
        assert!((t.at(9.0).unwrap().position_in_world_m().x - 2.0).abs() < 1e-12);
        assert!(matches!(t.at(0.5), Err(NoPose::Before { .. })));
        assert!(matches!(t.at(9.5), Err(NoPose::After { .. })));
        assert!(matches!(t.at(3.0), Err(NoPose::Gap { .. })));
        assert!(t.at(f64::NAN).is_err());
        assert_eq!(t.at_or_nearest(8.0).unwrap().position_in_world_m().x, 2.0);
    }

    #[test]
    fn camera_at_rest_has_its_pose_at_every_time_within_an_hour() {
        let pose = Pose::from_camera_in_world(DVec3::new(0.1, 0.2, 0.3), DQuat::from_rotation_x(3.0));
        let at_rest = PoseTrack::at_rest(pose);
        at_rest.covers(-3600.0, 3600.0).unwrap();
        for time_s in [-3600.0, -0.1, 0.0, 1.0 / 30.0, 3600.0] {
            let apart = at_rest.at(time_s).unwrap().position_in_world_m().distance(DVec3::new(0.1, 0.2, 0.3));
            assert!(apart < 1e-12, "{time_s}: {apart}");
        }
        assert!(matches!(at_rest.at(3601.0), Err(NoPose::After { .. })));
    }

    #[test]
    fn clock_offset_is_added_to_the_times_of_lookups() {
        let (own, offset) = (track(), track().with_clock_offset_s(0.5));
        // Binary fractions: the sums of times are exact.
        for time_s in [0.25, 0.5, 0.75, 1.5, 2.0, 8.5, 9.0] {
            assert_eq!(offset.at(time_s), own.at(time_s + 0.5), "{time_s}");
            assert_eq!(offset.at_or_nearest(time_s), own.at_or_nearest(time_s + 0.5), "{time_s}");
            assert_eq!(offset.covers(0.5, time_s), own.covers(1.0, time_s + 0.5), "{time_s}");
        }
        let mut trimmed = offset.clone();
        trimmed.trim(1.5);
        assert_eq!(trimmed.poses(), &own.poses()[1..]);
        let times_s: Vec<f64> = offset.poses_in_frame_time().map(|(time_s, _)| time_s).collect();
        assert_eq!(times_s, [0.5, 1.5, 8.5]);
        assert_eq!(offset.scaled(2.0).clock_offset_s(), 0.5);
    }

    #[test]
    fn rounded_times_still_match_a_pose() {
        let t = track();
        let x = |time_s: f64| t.at(time_s).unwrap().position_in_world_m().x;
        // The track's ends, and those of its gap from 2 s to 9 s.
        assert_eq!((x(1.0 - 5e-7), x(9.0 + 5e-7), x(2.0 + 5e-7), x(9.0 - 5e-7)), (0.0, 2.0, 1.0, 2.0));
        for wrong in [1.0 - 2e-6, 9.0 + 2e-6, 2.0 + 2e-6, 9.0 - 2e-6] {
            assert!(t.at(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn growing_track_reports_poses_not_there_yet() {
        let whole = track();
        let mut growing = PoseTrack::growing(1.5);
        assert_eq!(growing.at(1.0), Err(NoPose::NotYet { time_s: 1.0 }));
        for (time_s, pose) in whole.poses() {
            growing.push(*time_s, *pose).unwrap();
        }
        assert_eq!(growing.at(9.5), Err(NoPose::NotYet { time_s: 9.5 }));
        for time_s in [0.5, 1.0, 1.25, 3.0, 9.0, f64::NAN] {
            assert_eq!(format!("{:?}", growing.at(time_s)), format!("{:?}", whole.at(time_s)), "{time_s}");
        }
        let newest = growing.poses()[2].1;
        for wrong in [9.0, 8.0, f64::NAN] {
            assert!(growing.push(wrong, newest).is_err());
        }
        growing.finish();
        assert_eq!(growing, whole);
        assert_eq!(growing.at(9.5), Err(NoPose::After { time_s: 9.5, last_s: 9.0 }));
    }

    #[test]
    fn trimmed_track_serves_later_times() {
        let mut t = track();
        t.trim(1.5);
        assert_eq!(t, track());
        t.trim(2.0);
        assert_eq!(t.poses().len(), 2);
        assert_eq!(t.at(2.0), track().at(2.0));
        assert!(matches!(t.at(1.5), Err(NoPose::Before { .. })));
        t.trim(100.0);
        assert_eq!((t.poses().len(), t.at(9.0)), (1, track().at(9.0)));
        // A stream over hours keeps only the poses that its exposures need.
        let mut long = PoseTrack::growing(0.1);
        for i in 0..10_000 {
            let time_s = 0.005 * f64::from(i);
            long.push(time_s, Pose::IDENTITY).unwrap();
            long.trim(time_s - 0.1);
            assert!(long.poses().len() <= 22);
        }
    }

    #[test]
    fn interval_is_covered_or_the_gap_is_named() {
        let mut t = track();
        for (from_s, to_s) in [(1.0, 2.0), (1.2, 1.3), (2.0, 2.0), (9.0, 9.0), (1.0 - 5e-7, 2.0 + 5e-7)] {
            assert_eq!(t.covers(from_s, to_s), Ok(()), "{from_s} to {to_s}");
        }
        assert!(matches!(t.covers(0.5, 1.5), Err(NoPose::Before { .. })));
        for (from_s, to_s) in [(1.5, 3.0), (1.5, 9.0), (2.0, 9.0), (3.0, 9.0)] {
            assert!(matches!(t.covers(from_s, to_s), Err(NoPose::Gap { gap_s: 7.0, .. })), "{from_s} to {to_s}");
        }
        t.push(10.0, Pose::IDENTITY).unwrap();
        assert_eq!(t.covers(9.0, 10.0), Ok(()));
        assert!(matches!(t.covers(9.5, 10.5), Err(NoPose::After { .. })));
    }

    #[test]
    fn times_out_of_order_are_refused() {
        let p = Pose::IDENTITY;
        assert_eq!(PoseTrack::new(vec![(1.0, p), (1.0, p)], 1.0).unwrap_err().index, 1);
        assert!(PoseTrack::new(vec![(1.0, p), (f64::NAN, p)], 1.0).is_err());
    }
}
