//! Frames that wait for their poses: pure, told the time.

use std::collections::VecDeque;

use super::presence::Presence;
use super::track::{LiveTrack, PoseTaken, Tracking};
use crate::pose::Pose;
use crate::tracking::PoseTrack;
use crate::tracking::tum::Line;

/// Frames that wait at once. Beyond it the first goes out.
const MOST: usize = 8;
/// Poses are kept so long behind the frame that goes out, seconds.
const KEPT_S: f64 = 2.0;

/// What became of frames and poses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    pub tracked: u64,
    pub predicted: u64,
    pub lost: u64,
    pub poses: u64,
    /// Poses that came when frames had been composited without them.
    pub late: u64,
    /// Poses with numbers that are not finite.
    pub odd: u64,
}

/// A frame that need not wait any longer.
#[derive(Clone, Debug, PartialEq)]
pub struct Ready<F> {
    pub frame: F,
    pub tracking: Tracking,
    /// The share of the virtual layer that is seen in it, 0 to 1; of a frame without a pose 1, for nothing is drawn.
    pub presence: f64,
    /// How long it waited, seconds.
    pub waited_s: f64,
}

#[derive(Debug)]
struct Held<F> {
    frame: F,
    at_s: f64,
    /// From when to when poses matter to it.
    needs_s: [f64; 2],
    came_s: f64,
    due_s: f64,
}

/// Frames in order, and the poses that come for them. Frames' and poses' times are of one clock; `now_s` is of any, as
/// long as it does not go back.
#[derive(Debug)]
pub struct Waiting<F> {
    track: LiveTrack,
    /// A frame waits at most so long, seconds.
    patience_s: f64,
    held: VecDeque<Held<F>>,
    presence: Presence,
    counts: Counts,
}

impl<F> Waiting<F> {
    pub fn new(max_gap_s: f64, patience_s: f64) -> Self {
        let track = LiveTrack::new(max_gap_s);
        Self { track, patience_s, held: VecDeque::new(), presence: Presence::default(), counts: Counts::default() }
    }

    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// The poses as they are when a frame is ready: what is added later does not change them for it.
    pub fn track(&self) -> &PoseTrack {
        self.track.track()
    }

    /// The poses to be recorded, each once.
    pub fn take_new(&mut self) -> Vec<Line> {
        self.track.take_new()
    }

    /// Takes the pending message for the user, if any.
    pub fn told(&mut self) -> Option<String> {
        self.track.told()
    }

    pub fn pose(&mut self, time_s: f64, pose: &Pose) -> PoseTaken {
        let taken = self.track.add(time_s, pose);
        *match taken {
            PoseTaken::Added => &mut self.counts.poses,
            PoseTaken::Late => &mut self.counts.late,
            PoseTaken::Odd => &mut self.counts.odd,
        } += 1;
        // The camera may be gone while poses come.
        if self.held.is_empty() {
            self.track.trim(time_s - 2.0 * KEPT_S);
        }
        taken
    }

    /// Adds a pose for a frame at its time, carried on from the last one by how the pictures move: it counts where no real one
    /// comes in time.
    pub fn carry(&mut self, time_s: f64, pose: &Pose) {
        self.track.carry(time_s, pose);
    }

    /// Adds a frame at a time, which needs the poses so long before and after it. Frames come in the order of their times.
    pub fn frame(&mut self, frame: F, at_s: f64, (before_s, after_s): (f64, f64), now_s: f64) {
        let needs_s = [at_s - before_s, at_s + after_s];
        // What looks on to the next frame's pose needs that one, and not a prediction of it that would take its place.
        let patience_s = if after_s > before_s { self.patience_s.max(after_s) } else { self.patience_s };
        self.held.push_back(Held { frame, at_s, needs_s, came_s: now_s, due_s: now_s + patience_s });
    }

    /// The next frame whose poses are there, or that has waited.
    pub fn next(&mut self, now_s: f64) -> Option<Ready<F>> {
        let first = self.held.front()?;
        if !(self.track.reaches(first.needs_s[1]) || now_s >= first.due_s || self.held.len() > MOST) {
            return None;
        }
        let Held { frame, at_s, needs_s, came_s, .. } = self.held.pop_front()?;
        // The next frame may have been exposed for longer.
        self.track.trim(needs_s[0] - KEPT_S);
        let tracking = self.track.settle(at_s, needs_s);
        *match tracking {
            Tracking::Tracked => &mut self.counts.tracked,
            Tracking::Predicted => &mut self.counts.predicted,
            Tracking::Lost => &mut self.counts.lost,
        } += 1;
        let since_real_s = (tracking != Tracking::Lost).then(|| self.track.since_real_s(at_s));
        let share = self.presence.next(at_s, since_real_s, self.track.trust(at_s));
        let presence = since_real_s.map_or(1.0, |_| share);
        Some(Ready { frame, tracking, presence, waited_s: (now_s - came_s).max(0.0) })
    }

    /// When the next frame will have waited.
    pub fn due_s(&self) -> Option<f64> {
        self.held.front().map(|held| held.due_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};
    use proptest::prelude::*;

    fn pose(x: f64) -> Pose {
        Pose::from_camera_in_world(DVec3::new(x, x * x, 1.0), DQuat::from_rotation_z(x))
    }

    #[test]
    fn a_pose_that_comes_with_its_picture_is_enough() {
        let mut w = Waiting::new(0.1, 0.0);
        for i in 0..6 {
            let t = f64::from(i) / 30.0;
            w.frame(i, t, (0.008, 0.008), t);
            w.pose(t, &pose(t));
            let ready = w.next(t).unwrap();
            assert_eq!((ready.frame, ready.tracking, ready.presence), (i, Tracking::Tracked, 1.0));
            assert!(w.track().covers(t, t + 0.008).is_ok());
        }
        // Those that are predicted take no real one's place.
        assert_eq!((w.counts().late, w.counts().poses), (0, 6));
        // What looks on to the next frame waits for its pose.
        w.frame(6, 0.2, (0.008, 1.0 / 30.0), 0.2);
        w.pose(0.2, &pose(0.2));
        assert_eq!(w.next(0.21), None);
        w.pose(0.24, &pose(0.24));
        assert_eq!(w.next(0.24).unwrap().tracking, Tracking::Tracked);
    }

    #[test]
    fn poses_without_frames_do_not_pile_up() {
        let mut w: Waiting<()> = Waiting::new(0.1, 0.05);
        for i in 0..10_000 {
            w.pose(0.01 * f64::from(i), &pose(0.0));
        }
        assert!((400..410).contains(&w.track().poses().len()), "{}", w.track().poses().len());
    }

    #[test]
    fn a_frame_goes_when_its_poses_are_there_or_it_has_waited() {
        let mut w = Waiting::new(0.1, 0.05);
        w.pose(9.99, &pose(0.0));
        w.frame('a', 10.01, (0.01, 0.01), 0.0);
        assert_eq!((w.next(0.01), w.due_s()), (None, Some(0.05)));
        w.pose(10.01, &pose(0.1));
        assert_eq!(w.next(0.02), None);
        w.pose(10.03, &pose(0.2));
        assert_eq!(
            w.next(0.03),
            Some(Ready { frame: 'a', tracking: Tracking::Tracked, presence: 1.0, waited_s: 0.03 })
        );
        w.frame('b', 10.05, (0.01, 0.01), 0.04);
        assert_eq!(w.next(0.08), None);
        assert_eq!(w.next(0.1).map(|ready| ready.tracking), Some(Tracking::Predicted));
        w.frame('c', 11.01, (0.01, 0.01), 1.0);
        assert_eq!(w.next(1.1).map(|ready| ready.tracking), Some(Tracking::Lost));
        assert_eq!(w.counts(), Counts { tracked: 1, predicted: 1, lost: 1, poses: 3, late: 0, odd: 0 });
    }

    #[test]
    fn no_more_frames_wait_than_may() {
        let mut w = Waiting::new(0.1, 1e9);
        let mut out = 0;
        for i in 0..100 {
            w.frame(i, f64::from(i), (0.0, 0.01), 0.0);
            out += std::iter::from_fn(|| w.next(0.0)).count();
        }
        assert_eq!(out, 100 - MOST);
    }

    #[test]
    fn before_a_gap_that_is_known_evidence_fades_too() {
        let mut w = Waiting::new(0.1, 0.05);
        let known = (0..10).chain(80..100).map(|i| 0.01 * f64::from(i));
        let even = |x: f64| Pose::from_camera_in_world(DVec3::new(x, 0.0, 1.0), DQuat::IDENTITY);
        known.for_each(|time_s| assert_eq!(w.pose(time_s, &even(time_s)), PoseTaken::Added));
        let mut seen = Vec::new();
        for i in 1..29 {
            let at_s = f64::from(i) / 30.0;
            w.frame(at_s, at_s, (0.005, 0.005), at_s);
            while let Some(ready) = w.next(at_s) {
                // Nothing is waited for: what comes next is known.
                assert_eq!(ready.frame, at_s);
                let x = w.track().at(at_s).map(|pose| pose.position_in_world_m().x);
                seen.push((ready.tracking, ready.presence, x.ok()));
            }
        }
        assert_eq!(seen.len(), 28);
        let tracked = |n: &usize| seen[*n].0 == Tracking::Tracked;
        assert!((0..2).chain(23..28).all(|n| tracked(&n)) && !(2..23).any(|n| tracked(&n)), "{seen:?}");
        // The last pose is at 0.09 s: all of it until 0.19 s, nothing from 0.39 s on. Then it rises from nothing.
        assert!(seen[..5].iter().all(|(_, presence, _)| *presence == 1.0), "{seen:?}");
        let falling: Vec<f64> = seen[5..11].iter().map(|seen| (600.0 * seen.1).round()).collect();
        assert_eq!(falling, [570.0, 470.0, 370.0, 270.0, 170.0, 70.0]);
        assert_eq!([23, 24].map(|n| (600.0 * seen[n].1).round()), [100.0, 200.0]);
        // 1 m/s that die away for a tenth of a second, and still from 0.19 s on.
        let rests = 0.09 + 0.1 * (1.0 - (-1.0f64).exp());
        assert!(seen[6..11].iter().all(|seen| seen.2.is_some_and(|x| (x - rests).abs() < 1e-9)), "{seen:?}");
        assert!(seen[13..23].iter().all(|seen| (seen.0, seen.1) == (Tracking::Lost, 1.0)), "{seen:?}");
        assert_eq!(w.counts().late, 0);
    }

    proptest! {
        /// Whatever is dropped, late or lost: each frame's poses are those of the whole track that was recorded.
        #[test]
        fn what_a_frame_saw_is_what_the_recording_gives(
            events in prop::collection::vec((0u8..5, 0.0f64..0.4, 0u8..10), 1..200)
        ) {
            let mut w = Waiting::new(0.1, 0.04);
            let (mut lines, mut seen) = (Vec::new(), Vec::new());
            let (mut now_s, mut next_pose_s) = (0.0, 0.0);
            for (kind, step, late) in events {
                now_s += if kind == 4 { step } else { 0.03 * step };
                match kind {
                    0 => w.frame(now_s, now_s, (0.012, 0.012), now_s),
                    // A source may know them beforehand.
                    1 | 2 => while next_pose_s < now_s - 0.01 * f64::from(late) + if late == 9 { 0.5 } else { 0.0 } {
                        w.pose(next_pose_s, &pose(next_pose_s));
                        next_pose_s += 0.008;
                    },
                    // The picture says where it went.
                    3 => {
                        w.carry(now_s, &pose(now_s + 0.01 * step));
                        w.frame(now_s, now_s, (0.012, 0.012), now_s);
                    }
                    // A tracker that pauses.
                    _ => next_pose_s = now_s,
                }
                while let Some(ready) = w.next(now_s) {
                    let at = |t: &PoseTrack, k: i32| t.at_or_nearest(ready.frame + 0.003 * f64::from(k));
                    let poses: Vec<_> = (-4..=4).map(|k| at(w.track(), k)).collect();
                    seen.push((ready.frame, w.track().at(ready.frame).is_ok(), poses));
                    lines.extend(w.take_new());
                }
            }
            lines.extend(w.take_new());
            let track = PoseTrack::new(lines.iter().map(|line| (line.time_s, line.pose())).collect(), 0.1).unwrap();
            for (frame, has_pose, poses) in seen {
                prop_assert_eq!(track.at(frame).is_ok(), has_pose, "{}", frame);
                for (k, pose) in (-4..=4).zip(poses).filter(|_| has_pose) {
                    prop_assert_eq!(track.at_or_nearest(frame + 0.003 * f64::from(k)), pose, "{} {}", frame, k);
                }
            }
        }
    }
}
