//! Queue of frames that wait for their poses. No I/O; the time is an argument.

use std::collections::VecDeque;

use super::opacity_fade::OpacityFade;
use super::track::{LiveTrack, PoseOutcome, Tracking};
use crate::pose::Pose;
use crate::tracking::PoseTrack;
use crate::tracking::tum::Line;

/// Capacity of the queue. Beyond it the first frame is released.
const MAX_QUEUED_FRAMES: usize = 8;
/// Poses are kept for this long before the released frame, seconds.
const RETENTION_S: f64 = 2.0;

/// Numbers of frames and poses by outcome.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LiveCounts {
    pub tracked: u64,
    pub predicted: u64,
    pub untracked: u64,
    pub poses: u64,
    /// Poses that arrived after their frames had been composited.
    pub late: u64,
    /// Poses with non-finite numbers or implausible motion.
    pub implausible: u64,
}

/// A frame whose poses are final.
#[derive(Clone, Debug, PartialEq)]
pub struct ReleasedFrame<F> {
    pub frame: F,
    pub tracking: Tracking,
    /// Opacity of the frame's virtual layer, 0 to 1; 1 for a frame without a pose, in which nothing
    /// is drawn.
    pub opacity: f64,
    /// Time in the queue, seconds.
    pub waited_s: f64,
}

#[derive(Debug)]
struct QueuedFrame<F> {
    frame: F,
    at_s: f64,
    /// Span of time in which poses matter to the frame.
    span_s: [f64; 2],
    arrived_s: f64,
    due_s: f64,
}

/// Frames in order, and the poses that arrive for them. The times of frames and poses share a
/// clock. `now_s` may be of any monotonic clock.
#[derive(Debug)]
pub struct FrameQueue<F> {
    track: LiveTrack,
    /// Longest time that a frame waits, seconds.
    max_wait_s: f64,
    queue: VecDeque<QueuedFrame<F>>,
    fade: OpacityFade,
    counts: LiveCounts,
}

impl<F> FrameQueue<F> {
    pub fn new(max_gap_s: f64, max_wait_s: f64) -> Self {
        let track = LiveTrack::new(max_gap_s);
        Self { track, max_wait_s, queue: VecDeque::new(), fade: OpacityFade::default(), counts: LiveCounts::default() }
    }

    pub fn counts(&self) -> LiveCounts {
        self.counts
    }

    /// The pose track when a frame is released. Poses that are added later do not change it within
    /// the frame.
    pub fn track(&self) -> &PoseTrack {
        self.track.track()
    }

    /// Takes the poses to be recorded, each once.
    pub fn take_unrecorded(&mut self) -> Vec<Line> {
        self.track.take_unrecorded()
    }

    /// Takes the pending message for the user, if any.
    pub fn take_message(&mut self) -> Option<String> {
        self.track.take_message()
    }

    pub fn add_pose(&mut self, time_s: f64, pose: &Pose) -> PoseOutcome {
        let outcome = self.track.add(time_s, pose);
        *match outcome {
            PoseOutcome::Added => &mut self.counts.poses,
            PoseOutcome::Late => &mut self.counts.late,
            PoseOutcome::Implausible => &mut self.counts.implausible,
        } += 1;
        // The camera may be gone while poses arrive.
        if self.queue.is_empty() {
            self.track.trim(time_s - 2.0 * RETENTION_S);
        }
        outcome
    }

    /// Adds a dead-reckoned pose of a frame. It is used if no measured pose arrives in time.
    pub fn add_dead_reckoned(&mut self, time_s: f64, pose: &Pose) {
        self.track.add_dead_reckoned(time_s, pose);
    }

    /// Adds a frame, and how long before and after it poses matter, seconds. Frames arrive in the
    /// order of their times.
    pub fn push_frame(&mut self, frame: F, at_s: f64, (before_s, after_s): (f64, f64), now_s: f64) {
        let span_s = [at_s - before_s, at_s + after_s];
        // A frame that depends on the next frame's pose waits for it, because a prediction would
        // take its place.
        let max_wait_s = if after_s > before_s { self.max_wait_s.max(after_s) } else { self.max_wait_s };
        self.queue.push_back(QueuedFrame { frame, at_s, span_s, arrived_s: now_s, due_s: now_s + max_wait_s });
    }

    /// The next frame whose poses have arrived, or whose deadline has passed.
    pub fn next(&mut self, now_s: f64) -> Option<ReleasedFrame<F>> {
        let first = self.queue.front()?;
        if !(self.track.reaches(first.span_s[1]) || now_s >= first.due_s || self.queue.len() > MAX_QUEUED_FRAMES) {
            return None;
        }
        let QueuedFrame { frame, at_s, span_s, arrived_s, .. } = self.queue.pop_front()?;
        // The next frame may have a longer exposure.
        self.track.trim(span_s[0] - RETENTION_S);
        let tracking = self.track.finalize(at_s, span_s);
        *match tracking {
            Tracking::Tracked => &mut self.counts.tracked,
            Tracking::Predicted => &mut self.counts.predicted,
            Tracking::Lost => &mut self.counts.untracked,
        } += 1;
        let since_measured_s = (tracking != Tracking::Lost).then(|| self.track.since_measured_s(at_s));
        let opacity = self.fade.next(at_s, since_measured_s, self.track.confidence(at_s));
        let opacity = since_measured_s.map_or(1.0, |_| opacity);
        Some(ReleasedFrame { frame, tracking, opacity, waited_s: (now_s - arrived_s).max(0.0) })
    }

    /// Deadline of the first frame.
    pub fn due_s(&self) -> Option<f64> {
        self.queue.front().map(|first| first.due_s)
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
    fn frame_with_its_own_pose_does_not_wait() {
        let mut w = FrameQueue::new(0.1, 0.0);
        for i in 0..6 {
            let t = f64::from(i) / 30.0;
            w.push_frame(i, t, (0.008, 0.008), t);
            w.add_pose(t, &pose(t));
            let ready = w.next(t).unwrap();
            assert_eq!((ready.frame, ready.tracking, ready.opacity), (i, Tracking::Tracked, 1.0));
            assert!(w.track().covers(t, t + 0.008).is_ok());
        }
        // Predicted poses do not displace measured ones.
        assert_eq!((w.counts().late, w.counts().poses), (0, 6));
        // A frame that depends on the next frame's pose waits for it.
        w.push_frame(6, 0.2, (0.008, 1.0 / 30.0), 0.2);
        w.add_pose(0.2, &pose(0.2));
        assert_eq!(w.next(0.21), None);
        w.add_pose(0.24, &pose(0.24));
        assert_eq!(w.next(0.24).unwrap().tracking, Tracking::Tracked);
    }

    #[test]
    fn poses_without_frames_are_trimmed() {
        let mut w: FrameQueue<()> = FrameQueue::new(0.1, 0.05);
        for i in 0..10_000 {
            w.add_pose(0.01 * f64::from(i), &pose(0.0));
        }
        assert!((400..410).contains(&w.track().poses().len()), "{}", w.track().poses().len());
    }

    #[test]
    fn frame_is_released_with_its_poses_or_at_its_deadline() {
        let mut w = FrameQueue::new(0.1, 0.05);
        w.add_pose(9.99, &pose(0.0));
        w.push_frame('a', 10.01, (0.01, 0.01), 0.0);
        assert_eq!((w.next(0.01), w.due_s()), (None, Some(0.05)));
        w.add_pose(10.01, &pose(0.1));
        assert_eq!(w.next(0.02), None);
        w.add_pose(10.03, &pose(0.2));
        assert_eq!(
            w.next(0.03),
            Some(ReleasedFrame { frame: 'a', tracking: Tracking::Tracked, opacity: 1.0, waited_s: 0.03 })
        );
        w.push_frame('b', 10.05, (0.01, 0.01), 0.04);
        assert_eq!(w.next(0.08), None);
        assert_eq!(w.next(0.1).map(|ready| ready.tracking), Some(Tracking::Predicted));
        w.push_frame('c', 11.01, (0.01, 0.01), 1.0);
        assert_eq!(w.next(1.1).map(|ready| ready.tracking), Some(Tracking::Lost));
        assert_eq!(
            w.counts(),
            LiveCounts { tracked: 1, predicted: 1, untracked: 1, poses: 3, late: 0, implausible: 0 }
        );
    }

    #[test]
    fn full_queue_releases_its_first_frame() {
        let mut w = FrameQueue::new(0.1, 1e9);
        let mut out = 0;
        for i in 0..100 {
            w.push_frame(i, f64::from(i), (0.0, 0.01), 0.0);
            out += std::iter::from_fn(|| w.next(0.0)).count();
        }
        assert_eq!(out, 100 - MAX_QUEUED_FRAMES);
    }

    #[test]
    fn evidence_fades_before_a_known_gap() {
        let mut w = FrameQueue::new(0.1, 0.05);
        let times_s = (0..10).chain(80..100).map(|i| 0.01 * f64::from(i));
        let even = |x: f64| Pose::from_camera_in_world(DVec3::new(x, 0.0, 1.0), DQuat::IDENTITY);
        times_s.for_each(|time_s| assert_eq!(w.add_pose(time_s, &even(time_s)), PoseOutcome::Added));
        let mut released = Vec::new();
        for i in 1..29 {
            let at_s = f64::from(i) / 30.0;
            w.push_frame(at_s, at_s, (0.005, 0.005), at_s);
            while let Some(ready) = w.next(at_s) {
                // No frame waits: the next poses are known.
                assert_eq!(ready.frame, at_s);
                let x = w.track().at(at_s).map(|pose| pose.position_in_world_m().x);
                released.push((ready.tracking, ready.opacity, x.ok()));
            }
        }
        assert_eq!(released.len(), 28);
        let tracked = |n: &usize| released[*n].0 == Tracking::Tracked;
        assert!((0..2).chain(23..28).all(|n| tracked(&n)) && !(2..23).any(|n| tracked(&n)), "{released:?}");
        // The last pose is at 0.09 s: full opacity until 0.19 s, 0 from 0.39 s on. Then it fades in
        // from 0.
        assert!(released[..5].iter().all(|(_, opacity, _)| *opacity == 1.0), "{released:?}");
        let falling: Vec<f64> = released[5..11].iter().map(|released| (600.0 * released.1).round()).collect();
        assert_eq!(falling, [570.0, 470.0, 370.0, 270.0, 170.0, 70.0]);
        assert_eq!([23, 24].map(|n| (600.0 * released[n].1).round()), [100.0, 200.0]);
        // 1 m/s that decays over a tenth of a second, constant from 0.19 s on.
        let rests = 0.09 + 0.1 * (1.0 - (-1.0f64).exp());
        assert!(
            released[6..11].iter().all(|released| released.2.is_some_and(|x| (x - rests).abs() < 1e-9)),
            "{released:?}"
        );
        assert!(
            released[13..23].iter().all(|released| (released.0, released.1) == (Tracking::Lost, 1.0)),
            "{released:?}"
        );
        assert_eq!(w.counts().late, 0);
    }

    proptest! {
        /// With dropped, late or lost poses: each frame's poses equal those of the whole recorded
        /// track.
        #[test]
        fn poses_of_a_frame_equal_those_of_the_recording(
            events in prop::collection::vec((0u8..5, 0.0f64..0.4, 0u8..10), 1..200)
        ) {
            let mut w = FrameQueue::new(0.1, 0.04);
            let (mut lines, mut released) = (Vec::new(), Vec::new());
            let (mut now_s, mut next_pose_s) = (0.0, 0.0);
            for (kind, step, late) in events {
                now_s += if kind == 4 { step } else { 0.03 * step };
                match kind {
                    0 => w.push_frame(now_s, now_s, (0.012, 0.012), now_s),
                    // A source may have poses in advance.
                    1 | 2 => while next_pose_s < now_s - 0.01 * f64::from(late) + if late == 9 { 0.5 } else { 0.0 } {
                        w.add_pose(next_pose_s, &pose(next_pose_s));
                        next_pose_s += 0.008;
                    },
                    // Dead reckoning from the picture.
                    3 => {
                        w.add_dead_reckoned(now_s, &pose(now_s + 0.01 * step));
                        w.push_frame(now_s, now_s, (0.012, 0.012), now_s);
                    }
                    // A tracker that pauses.
                    _ => next_pose_s = now_s,
                }
                while let Some(ready) = w.next(now_s) {
                    let at = |t: &PoseTrack, k: i32| t.at_or_nearest(ready.frame + 0.003 * f64::from(k));
                    let poses: Vec<_> = (-4..=4).map(|k| at(w.track(), k)).collect();
                    released.push((ready.frame, w.track().at(ready.frame).is_ok(), poses));
                    lines.extend(w.take_unrecorded());
                }
            }
            lines.extend(w.take_unrecorded());
            let track = PoseTrack::new(lines.iter().map(|line| (line.time_s, line.pose())).collect(), 0.1).unwrap();
            for (frame, has_pose, poses) in released {
                prop_assert_eq!(track.at(frame).is_ok(), has_pose, "{}", frame);
                for (k, pose) in (-4..=4).zip(poses).filter(|_| has_pose) {
                    prop_assert_eq!(track.at_or_nearest(frame + 0.003 * f64::from(k)), pose, "{} {}", frame, k);
                }
            }
        }
    }
}
