//! Trajectory of the simulated camera.

use std::f64::consts::TAU;

use glam::{DQuat, DVec3};

use crate::camera::LensModel;
use crate::pose::Pose;
use crate::tracking::{NotAscending, PoseTrack};

use super::{Motion, Options};

/// Interval of the written poses, seconds. Between them the camera moves as in
/// [`Pose::interpolate`], so the written track is the exact truth.
pub const INTERVAL_S: f64 = 0.005;
/// Extension of the track before the first and after the last frame, seconds.
const MARGIN_S: f64 = 0.1;
/// Time of the first frame, seconds.
pub const START_S: f64 = 1.0;

/// Angular speed of the motion `pan` about the vertical at speed 1, radians per second.
pub const PAN_RAD_PER_S: f64 = 1.0;
/// Speed of the motion `dolly` at speed 1, metres per second.
pub const DOLLY_M_PER_S: f64 = 0.6;

/// The middle of the middle row's exposure of a frame, in seconds, rounded to microseconds.
pub fn timestamp_s(options: &Options, frame: usize) -> f64 {
    ((START_S + frame as f64 / options.fps) * 1e6).round() / 1e6
}

/// The camera's poses every [`INTERVAL_S`], from before the first row of the first frame to after
/// the last row of the last, extended by `more_s` on both sides.
pub fn track(options: &Options, more_s: f64) -> Result<PoseTrack, NotAscending> {
    let shutter_s = 0.5 * (options.readout_time_s + options.exposure_time_s);
    let before = ((MARGIN_S + more_s + shutter_s) / INTERVAL_S).ceil();
    let duration_s = f64::from(options.frames.saturating_sub(1)) / options.fps;
    let steps = (2.0 * before + (duration_s / INTERVAL_S).ceil()) as usize;
    let pose = |i: usize| {
        let steps = i as f64 - before;
        // Rounded to microseconds, without the error of repeated addition.
        let time_s = ((START_S + steps * INTERVAL_S) * 1e6).round() / 1e6;
        (time_s, pose(options, time_s - START_S, duration_s))
    };
    PoseTrack::new((0..=steps).map(pose).collect(), 2.0 * INTERVAL_S)
}

/// Quintic smoothstep: 0 before `from`, 1 after `to`, continuous speed and acceleration.
fn ease(from: f64, to: f64, x: f64) -> f64 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * t * (t * (6.0 * t - 15.0) + 10.0)
}

/// Hand tremor: incommensurate frequencies, weaker at higher frequencies.
fn tremor(time_s: f64, phase: f64) -> f64 {
    [(1.1, 1.0), (2.3, 0.6), (4.1, 0.32), (7.3, 0.16), (9.7, 0.08)]
        .iter()
        .map(|(hz, weight)| weight * (TAU * hz * time_s + phase * (1.0 + hz)).sin())
        .sum()
}

/// A camera position around the origin: azimuth and distance on the ground, and height.
fn position_m(azimuth_deg: f64, distance_m: f64, height_m: f64) -> DVec3 {
    let (s, c) = azimuth_deg.to_radians().sin_cos();
    DVec3::new(distance_m * c, distance_m * s, height_m)
}

/// Target of the camera: just beyond the evidence.
const TARGET_M: DVec3 = DVec3::new(-0.03, 0.08, 0.06);

fn looking_at(eye: DVec3, target: DVec3) -> Pose {
    // In every motion the eye is to the side of the target, so a view always exists.
    Pose::look_at(eye, target, DVec3::Z).unwrap_or(Pose::IDENTITY)
}

/// `pose` rotated in the camera's own axes: right, down and clockwise, radians.
fn turned(pose: Pose, right: f64, down: f64, roll: f64) -> Pose {
    let turn = DQuat::from_rotation_y(right) * DQuat::from_rotation_x(-down) * DQuat::from_rotation_z(roll);
    Pose::from_camera_in_world(pose.position_in_world_m(), pose.world_from_camera_rotation() * turn)
}

/// The pose `time_s` after the first frame of a recording that is `duration_s` long. A 360° camera
/// is held upright.
fn pose(options: &Options, time_s: f64, duration_s: f64) -> Pose {
    let pose = trajectory_pose(options, time_s, duration_s);
    if options.lens == LensModel::Equirectangular {
        let (eye, ahead) = (pose.position_in_world_m(), pose.world_from_camera_rotation() * DVec3::Z);
        return looking_at(eye, eye + DVec3::new(ahead.x, ahead.y, 0.0));
    }
    pose
}

fn trajectory_pose(options: &Options, time_s: f64, duration_s: f64) -> Pose {
    let rest = looking_at(position_m(-82.0, 1.15, 1.32), TARGET_M);
    match options.motion {
        Motion::Static => rest,
        Motion::Pan => {
            let angle = PAN_RAD_PER_S * options.speed * (time_s - 0.5 * duration_s);
            // About the world's vertical, positive to the right.
            let turn = DQuat::from_rotation_z(-angle) * rest.world_from_camera_rotation();
            Pose::from_camera_in_world(rest.position_in_world_m(), turn)
        }
        Motion::Dolly => {
            let way = DOLLY_M_PER_S * options.speed * (time_s - 0.5 * duration_s);
            let right = rest.world_from_camera_rotation() * DVec3::X;
            Pose::from_camera_in_world(rest.position_in_world_m() + right * way, rest.world_from_camera_rotation())
        }
        Motion::Handheld => {
            let progress = time_s / duration_s.max(1e-6);
            let walk = ease(-0.25, 1.1, progress);
            let eye = position_m(-104.0 + 66.0 * walk, 1.2 - 0.1 * walk, 1.4 - 0.2 * walk);
            let strength = options.speed;
            let bob = DVec3::new(tremor(time_s, 3.0), tremor(time_s, 4.0), tremor(time_s, 5.0)) * 0.004 * strength;
            // The camera swings aside and whips back, then half of that again: the fast turns that
            // cause blur.
            let whip =
                0.13 * ease(0.05, 0.3, progress) - 0.26 * ease(0.36, 0.51, progress) + 0.13 * ease(0.6, 0.9, progress);
            turned(
                looking_at(eye + bob, TARGET_M + bob),
                strength * (whip + 0.006 * tremor(time_s, 0.3)),
                strength * 0.006 * tremor(time_s, 1.7),
                strength * 0.004 * tremor(time_s, 2.9),
            )
        }
    }
}
