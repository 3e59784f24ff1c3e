//! Tests of the poses of live frames.

use super::*;
use glam::{DQuat, DVec3};

fn at(x: f64) -> Pose {
    Pose::from_camera_in_world(DVec3::new(x, 0.0, 0.0), DQuat::from_rotation_y(0.1 * x))
}

#[test]
fn motion_is_extrapolated_and_late_poses_are_rejected() {
    let mut t = LiveTrack::new(0.1);
    assert_eq!(t.finalize(0.005, [0.0, 0.01]), Tracking::Lost);
    // 2 m/s.
    for i in 2..=5 {
        assert_eq!(t.add(0.01 * f64::from(i), &at(0.02 * f64::from(i))), PoseOutcome::Added);
    }
    assert_eq!(t.finalize(0.035, [0.03, 0.04]), Tracking::Tracked);
    assert_eq!(t.finalize(0.08, [0.06, 0.09]), Tracking::Predicted);
    let x = |t: &LiveTrack, time_s| t.track().at(time_s).unwrap().position_in_world_m().x;
    // The motion decays: 0.1 + 2 · 0.1 · (1 − e^(−0.4)) at 0.09 s, linear until there.
    let expected = 0.1 + 0.2 * (1.0 - (-0.4f64).exp()) * 0.75;
    assert!((x(&t, 0.08) - expected).abs() < 1e-4 && t.track().covers(0.06, 0.09).is_ok());
    let turn = t.track().at(0.08).unwrap().world_from_camera_rotation();
    assert!(turn.angle_between(DQuat::from_rotation_y(0.1 * expected)) < 1e-5);
    assert_eq!(t.add(0.08, &at(0.17)), PoseOutcome::Late);
    assert_eq!(t.add(0.10, &at(0.2)), PoseOutcome::Added);
    assert_eq!(t.add(f64::NAN, &at(0.2)), PoseOutcome::Implausible);
    // Each pose of the track is returned once for the recording.
    assert_eq!(t.take_unrecorded().len(), t.track().poses().len());
    assert!(t.take_unrecorded().is_empty());
}

#[test]
fn implausible_motion_is_rejected_until_enough_time_has_passed() {
    let mut t = LiveTrack::new(0.1);
    assert_eq!(t.add(1.0, &at(0.0)), PoseOutcome::Added);
    // 3 m in 5 ms, and a turn of 0.9 rad.
    assert_eq!(t.add(1.005, &at(3.0)), PoseOutcome::Implausible);
    assert_eq!(
        t.add(1.01, &Pose::from_camera_in_world(DVec3::ZERO, DQuat::from_rotation_y(0.9))),
        PoseOutcome::Implausible
    );
    assert_eq!((t.take_message(), t.add(1.015, &at(0.1))), (None, PoseOutcome::Added));
    let message = t.take_message().unwrap();
    assert!(
        message.starts_with("a pose was dropped as implausible: 3 m and ") && message.contains("0.005 s"),
        "{message}"
    );
    // The tracker is elsewhere from now on.
    assert_eq!(t.add(1.02, &at(6.0)), PoseOutcome::Implausible);
    assert_eq!(t.add(1.13, &at(6.0)), PoseOutcome::Added);
}

#[test]
fn first_pose_far_away_is_replaced_by_consistent_poses() {
    // No pose's time is at the gap's very end, where rounding would decide.
    let mut t = LiveTrack::new(0.105);
    assert_eq!(t.add(1.0, &at(1e9)), PoseOutcome::Added);
    assert_eq!(t.add(1.01, &at(0.01)), PoseOutcome::Implausible);
    // It is undecided which of the two is the outlier.
    assert_eq!(t.take_message(), None);
    // Nothing is interpolated between the two places.
    assert_eq!(t.add(1.02, &at(0.02)), PoseOutcome::Late);
    let message = t.take_message().unwrap();
    let expected = "the first pose is left out as implausible: 2 consistent poses 1000000000 m and ";
    assert!(message.starts_with(expected) && message.ends_with("away after 0.020 s"), "{message}");
    let taken: Vec<_> = (3..=15).map(|i| t.add(1.0 + 0.01 * f64::from(i), &at(0.01 * f64::from(i)))).collect();
    assert_eq!(taken.iter().filter(|taken| **taken == PoseOutcome::Added).count(), 5, "{taken:?}");
    assert!(t.track().at(1.05).is_err() && t.take_message().is_none());
    assert!((t.track().at(1.13).unwrap().position_in_world_m().x - 0.13).abs() < 1e-9);
}

#[test]
fn late_pose_far_away_rejects_no_later_pose() {
    let mut t = LiveTrack::new(0.1);
    assert_eq!(t.add(1.0, &at(0.0)), PoseOutcome::Added);
    // Two consistent poses would outweigh one.
    for time_s in [0.98, 0.99, 1.0] {
        assert_eq!(t.add(time_s, &at(3.0)), PoseOutcome::Late);
    }
    assert_eq!((t.take_message(), t.add(1.01, &at(0.01))), (None, PoseOutcome::Added));
}

#[test]
fn relocated_camera_is_accepted_with_the_eleventh_pose() {
    let mut t = LiveTrack::new(0.1);
    for i in 0..100 {
        assert_eq!(t.add(0.01 * f64::from(i), &at(0.0)), PoseOutcome::Added);
    }
    // Outliers that do not agree with each other either.
    for (i, x) in [1e3, -1e3, 1e3, -1e3].into_iter().enumerate() {
        assert_eq!(t.add(1.0 + 0.01 * i as f64, &at(x)), PoseOutcome::Implausible);
    }
    assert_eq!(t.add(1.04, &at(0.0)), PoseOutcome::Added);
    let taken: Vec<_> = (0..11).map(|i| t.add(1.05 + 0.01 * f64::from(i), &at(1e3))).collect();
    assert!(taken[..10].iter().all(|taken| *taken == PoseOutcome::Implausible), "{taken:?}");
    assert_eq!(taken[10], PoseOutcome::Added);
    let message = t.take_message().unwrap();
    assert!(message.starts_with("the camera has moved abruptly: 11 consistent poses 1000 m and "), "{message}");
}

#[test]
fn abandoned_frame_stays_without_a_pose() {
    let mut t = LiveTrack::new(0.1);
    t.add(1.0, &at(0.0));
    t.add(1.02, &at(0.1));
    assert_eq!(t.finalize(1.115, [1.11, 1.12]), Tracking::Predicted);
    assert_eq!(t.finalize(1.295, [1.29, 1.30]), Tracking::Predicted);
    // 5 m/s that decay over a tenth of a second, then constant: 0.1 + 0.5 · (1 − 1/e).
    let x = |t: &LiveTrack, time_s| t.track().at(time_s).unwrap().position_in_world_m().x;
    assert!((x(&t, 1.12) - 0.41606).abs() < 1e-4 && (x(&t, 1.295) - 0.41606).abs() < 1e-5);
    assert_eq!(t.finalize(1.335, [1.33, 1.34]), Tracking::Lost);
    // A reader would interpolate across the frame from here.
    assert_eq!(t.add(1.36, &at(0.2)), PoseOutcome::Late);
    assert_eq!(t.add(1.5, &at(0.3)), PoseOutcome::Added);
    assert_eq!(t.add(1.51, &at(0.3)), PoseOutcome::Added);
    let whole = PoseTrack::new(t.track().poses().to_vec(), 0.1).unwrap();
    assert!(whole.at(1.335).is_err() && whole.at(1.505).is_ok());
    // The prediction afterwards is independent of the motion before the gap.
    assert_eq!(t.finalize(1.525, [1.52, 1.53]), Tracking::Predicted);
    assert!((x(&t, 1.53) - 0.3).abs() < 1e-9);
}
