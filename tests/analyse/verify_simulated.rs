//! Readings of `verify` for exact poses, and for poses with a known error.

use std::fs;
use std::ops::ControlFlow;

use crate::footage::opened;
use crate::gpu::gpu;
use glam::DQuat;
use locard::pose::Pose;
use locard::recording::write::{Line, trajectory};
use locard::simulate::{self, Detail, Flaws, Motion, Options, Simulation};
use locard::verify::{DisplacementSummary, VerificationPlan, verify};

const FOCAL_PX: f64 = 260.0;
const FPS: f64 = 30.0;
/// Number of frames between compared ones.
const GAP: usize = 4;

/// A camera at rest, as `site` in a folder of its own.
fn at_rest() -> tempfile::TempDir {
    let options = Options {
        width_px: 320,
        height_px: 240,
        focal_px: FOCAL_PX,
        samples: 8,
        frames: 9,
        fps: FPS,
        motion: Motion::Static,
        ..Options::default()
    };
    let detail = Detail { light_m: 0.15, ..Detail::for_focal_px(FOCAL_PX) };
    let folder = tempfile::tempdir().unwrap();
    let simulation = || Simulation::with_flaws_and_detail(&options, &Flaws::default(), detail, 2);
    simulate::write(&folder.path().join("site"), false, simulation, &mut |_, _| ControlFlow::Continue(())).unwrap();
    folder
}

/// Rotates the recorded camera about its down axis, so that the image moves by this distance in
/// [`GAP`] frames, px.
fn turn_poses(folder: &tempfile::TempDir, by_px: f64) {
    let track = opened(folder).recording.track.clone();
    let turned = |(time_s, pose): &(f64, Pose)| {
        let turn = DQuat::from_rotation_y(by_px / FOCAL_PX * time_s * FPS / GAP as f64);
        Line::new(
            *time_s,
            &Pose::from_camera_in_world(pose.position_in_world_m(), pose.world_from_camera_rotation() * turn),
        )
    };
    let lines: Vec<Line> = track.poses().iter().map(turned).collect();
    fs::write(folder.path().join("site/groundtruth.txt"), trajectory(&lines)).unwrap();
}

fn displaced(folder: &tempfile::TempDir) -> DisplacementSummary {
    let gpu = gpu();
    let verification = verify(&gpu, &opened(folder), VerificationPlan { every: GAP, gap: GAP }, |_, _| {}).unwrap();
    println!("{:?}", verification.displaced);
    verification.displaced.unwrap()
}

// Slow: frames are rendered as objects, and a simulated site is lit.
#[test]
fn verify_reads_zero_for_exact_poses_and_one_pixel_for_a_one_pixel_error() {
    let folder = at_rest();
    let exact = displaced(&folder);
    // A median of displacements is never 0, but its excess over the floor may be.
    assert!(exact.measured.0 > 0.03 && exact.floor.is_some(), "{exact:?}");
    assert!(exact.px.0 <= 2.0 * exact.sigma_px && exact.px.0 < 0.1, "{exact:?}");
    turn_poses(&folder, 1.0);
    let moved = displaced(&folder);
    assert!((moved.px.0 - 1.0).abs() < 0.1, "{moved:?}");
}
