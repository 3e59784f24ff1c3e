//! A camera with keyframes, as camera files contain it.

use glam::{DQuat, DVec3};

use super::axes::{CameraPlacement, file_from_world};
use crate::pose::Pose;
use crate::tracking::median_interval_s;

/// Unit of the keyframes' times.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KeyframeClock {
    /// Numbers of frames.
    FrameNumbers,
    /// Seconds from the first frame.
    Seconds,
}

/// Frames on a file's clock.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameNumbering {
    /// Number of the recording's first frame.
    pub first_frame: f64,
    /// Frames per second of keyframes in seconds, if they are at a constant rate. Otherwise they
    /// are at the frames' own times.
    pub fps: Option<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraKeyframe {
    /// Time by the file's clock.
    pub at: f64,
    pub placement: CameraPlacement,
}

/// The contents of a camera file.
#[derive(Clone, Debug, PartialEq)]
pub struct AnimatedCamera {
    pub clock: KeyframeClock,
    /// Strictly ascending in time.
    pub keyframes: Vec<CameraKeyframe>,
    /// Up in the file's world: y or z.
    pub up: DVec3,
    pub warnings: Vec<String>,
}

impl AnimatedCamera {
    /// The trajectory on the clock of frames with these timestamps. With the recording's `up`, the
    /// file's world is rotated to it, by the inverse of the rotation of an export.
    pub fn trajectory(&self, timestamps_s: &[f64], clock: FrameNumbering, up: Option<DVec3>) -> Vec<(f64, Pose)> {
        // The file's own world, unless it is rotated.
        let to_file = up.map_or(DQuat::IDENTITY, |up| file_from_world(self.up).conjugate() * file_from_world(up));
        let time_s = |at: f64| match (self.clock, clock.fps) {
            (KeyframeClock::Seconds, None) => timestamps_s.first().copied().unwrap_or_default() + at,
            (KeyframeClock::Seconds, Some(fps)) => time_of_frame_s(timestamps_s, at * fps),
            (KeyframeClock::FrameNumbers, _) => time_of_frame_s(timestamps_s, at - clock.first_frame),
        };
        let mut poses: Vec<(f64, Pose)> = Vec::new();
        for keyframe in &self.keyframes {
            let time_s = time_s(keyframe.at);
            // Frames with equal timestamps share a pose.
            if poses.last().is_none_or(|before| before.0 < time_s) {
                poses.push((time_s, keyframe.placement.pose(to_file)));
            }
        }
        poses
    }
}

/// The time of a fractional frame index; beyond the ends at the median interval.
fn time_of_frame_s(timestamps_s: &[f64], index: f64) -> f64 {
    let interval_s = median_interval_s(timestamps_s).unwrap_or(1.0);
    let (Some(first_s), Some(last_s)) = (timestamps_s.first(), timestamps_s.last()) else { return index };
    let last = (timestamps_s.len() - 1) as f64;
    if index <= 0.0 {
        return first_s + index * interval_s;
    }
    if index >= last {
        return last_s + (index - last) * interval_s;
    }
    let before = index.floor() as usize;
    let fraction = index - index.floor();
    timestamps_s[before] + fraction * (timestamps_s[before + 1] - timestamps_s[before])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frame_numbers_become_timestamps() {
        let times_s = [10.0, 10.5, 12.0];
        for (index, time_s) in [(0.0, 10.0), (1.0, 10.5), (1.5, 11.25), (2.0, 12.0), (-1.0, 8.5), (3.0, 13.5)] {
            assert_eq!(time_of_frame_s(&times_s, index), time_s, "{index}");
        }
    }

    #[test]
    fn trajectory_is_in_the_recordings_world_and_on_its_clock() {
        let pose = Pose::look_at(DVec3::new(1.0, -2.0, 1.5), DVec3::ZERO, DVec3::Z).unwrap();
        let up = DVec3::Z;
        let placement = CameraPlacement::of_pose(&pose, file_from_world(up));
        let clock = FrameNumbering { first_frame: 1001.0, fps: None };
        let mut camera = AnimatedCamera {
            clock: KeyframeClock::FrameNumbers,
            keyframes: vec![CameraKeyframe { at: 1001.0, placement }, CameraKeyframe { at: 1003.0, placement }],
            up: DVec3::Y,
            warnings: Vec::new(),
        };
        let poses = camera.trajectory(&[5.0, 5.1, 5.3], clock, Some(up));
        assert_eq!((poses[0].0, poses[1].0), (5.0, 5.3));
        assert!(poses[0].1.translation_m.distance(pose.translation_m) < 1e-12);
        let own = camera.trajectory(&[5.0, 5.1, 5.3], clock, None);
        assert!(own[0].1.position_in_world_m().distance(placement.position_m) < 1e-12);
        (camera.clock, camera.keyframes[0].at, camera.keyframes[1].at) = (KeyframeClock::Seconds, 0.0, 0.25);
        let poses = camera.trajectory(&[5.0, 5.1, 5.3], clock, Some(up));
        assert_eq!((poses[0].0, poses[1].0), (5.0, 5.25));
        let even = FrameNumbering { fps: Some(8.0), ..clock };
        let poses = camera.trajectory(&[5.0, 5.1, 5.3], even, Some(up));
        assert_eq!((poses[0].0, poses[1].0), (5.0, 5.3));
        // A file whose world has z up is rotated the other way, too.
        camera.up = DVec3::Z;
        camera.keyframes[0].placement = CameraPlacement::of_pose(&pose, DQuat::IDENTITY);
        let poses = camera.trajectory(&[5.0], clock, Some(up));
        assert!(poses[0].1.translation_m.distance(pose.translation_m) < 1e-12);
    }
}
