//! Tests of the estimate of exposure times.

use glam::DAffine3;

use super::*;
use crate::camera::Geometry;
use crate::fit::twist;

fn sample(frame: usize, exposure_ms: f64) -> ExposureSample {
    ExposureSample { frame, exposure_s: 1e-3 * exposure_ms, clarity: 1.0 }
}

#[test]
fn one_exposure_is_one_run_with_the_median() {
    let times_ms = [10.0, 10.2, 9.8, 10.1, 25.0, 9.9, 10.0];
    let all: Vec<ExposureSample> = times_ms.iter().enumerate().map(|(n, ms)| sample(8 * n, *ms)).collect();
    let runs = runs(&all, 60);
    assert_eq!(runs.len(), 1, "a single outlier is no run: {runs:?}");
    // Deviations: 0, .2, .2, .1, 15, .1, 0: median 0.1 ms; 1.2533 · 1.4826 · 0.1 / √7 is
    // 0.0702; with 0.1 and 0.1 ms systematic.
    assert_eq!((runs[0].from, runs[0].to, runs[0].exposure_s, runs[0].samples), (0, 60, 0.01, 7));
    assert!((runs[0].sigma_s - 1.5798e-4).abs() < 1e-7, "{}", runs[0].sigma_s);
}

#[test]
fn frames_that_differ_by_more_than_a_fifth_are_a_run() {
    let row = |longer: f64| -> Vec<ExposureRun> {
        let interval = |n: usize| 10.0 * if (4..8).contains(&n) { longer } else { 1.0 } + 0.1 * (n % 3) as f64;
        let all: Vec<ExposureSample> = (0..12).map(|n| sample(8 * n + 2, interval(n))).collect();
        runs(&all, 100)
    };
    assert_eq!(row(1.15).len(), 1);
    let runs = row(2.0);
    let ends: Vec<(usize, usize)> = runs.iter().map(|run| (run.from, run.to)).collect();
    // Halfway between the frames 26 and 34, 58 and 66.
    assert_eq!(ends, [(0, 30), (30, 62), (62, 100)]);
    assert!((runs[1].exposure_s - 0.0201).abs() < 1e-4 && (runs[2].exposure_s - 0.0101).abs() < 1e-4);
}

#[test]
fn scattered_samples_are_one_run() {
    // A plain floor at 1/60 s. With a fixed cost per run, frames 9 to 15 would be a run of 28
    // ms.
    let times_ms = [19.1, 18.3, 20.8, 19.0, 28.8, 18.3, 27.8, 12.4, 17.8, 16.3, 17.3];
    let all: Vec<ExposureSample> = times_ms.iter().enumerate().map(|(n, ms)| sample(2 * n, *ms)).collect();
    let floor_runs = runs(&all, 24);
    assert_eq!((floor_runs.len(), floor_runs[0].exposure_s), (1, 0.0183));
    // Another floor: with a fixed cost, runs of 15.5 and 19.1 ms.
    let times_ms = [15.5, 14.6, 16.5, 14.9, 14.0, 24.5, 9.8, 18.1, 15.8, 18.8, 25.8, 19.1];
    let others: Vec<ExposureSample> = times_ms.iter().enumerate().map(|(n, ms)| sample(2 * n, *ms)).collect();
    assert_eq!(runs(&others, 24).len(), 1);
    // Samples that alternate between 1 and 2: the scatter by successive differences.
    let steps = [1.0, 2.0, 1.0, 2.0, 1.0].map(|ms: f64| 10.0 * ms);
    let all: Vec<ExposureSample> = steps.iter().enumerate().map(|(n, ms)| sample(n, *ms)).collect();
    assert!((successive_scatter(&all) - 1.4826 * 2f64.ln() / 2f64.sqrt()).abs() < 1e-12);
}

#[test]
fn minimum_of_a_parabola_is_found_between_grid_points() {
    let grid = ExposureGrid { step_s: 0.001, count: 36 };
    let curve = |at: f64| BlurCurve {
        values: (0..36).map(|s| 0.01 + 0.001 * (f64::from(s) - at).powi(2)).collect(),
        patches: 10,
        flow_difference_px_s: 400.0,
    };
    let (exposure_s, clarity) = minimum(&[curve(12.3)], grid).unwrap();
    assert!((exposure_s - 0.0123).abs() < 1e-9);
    // At 0 it is 0.01 + 0.15129, at 12 it is 0.01009.
    assert!((clarity - (0.16129 - 0.01009) / 0.01009).abs() < 1e-9, "{clarity}");
    assert_eq!(minimum(&[curve(50.0)], grid), None, "longer than the grid");
    assert_eq!(minimum(&[], grid), None);
}

#[test]
fn acceleration_is_the_difference_of_both_neighbours_motions() {
    let moving = |x: f64| {
        Some(CameraState { world_from_camera: DAffine3::IDENTITY, twist: twist::twist(DVec3::X * x, DVec3::ZERO) })
    };
    let states = [moving(0.0), moving(1.0), moving(3.0), None, moving(4.0), moving(5.0), moving(6.0)];
    // 3 m/s more within 0.2 s; the neighbours of the last but one are too far apart.
    let changes = accelerations(&states, &[0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 1.4], 0.25);
    let along_x: Vec<f64> = changes.iter().map(|acceleration| acceleration[0]).collect();
    assert!((along_x[1] - 15.0).abs() < 1e-9);
    assert_eq!([along_x[0], along_x[2], along_x[4], along_x[5], along_x[6]], [0.0; 5]);
}

#[test]
fn frames_are_compared_only_if_their_motion_differs() {
    let model = CameraModel::new(Geometry::pinhole(640, 480, 520.0));
    let turning = |rate: f64| {
        Some(CameraState { world_from_camera: DAffine3::IDENTITY, twist: twist::twist(DVec3::ZERO, DVec3::Y * rate) })
    };
    assert_eq!(plan(&model, &[turning(1.0); 40]), []);
    assert_eq!(plan(&model, &[None; 40]), []);
    let response = Response::default();
    let shutter = ShutterEstimator::new(&model, &response, None, &[turning(1.0); 40], &[0.0; 40], 0.033, 1);
    assert!(shutter.evidence().exposure_runs(40).unwrap_err().contains("too even"));
    // One frame of forty moves: it is compared with its neighbours, and they with it.
    let mut states = [turning(0.0); 40];
    states[20] = turning(1.0);
    let jobs = plan(&model, &states);
    let own = jobs.iter().find(|job| job.0 == 20).unwrap();
    assert_eq!(own.1, [0, 6, 10], "those 20, 14 and 10 frames away");
    assert!(jobs.iter().all(|job| job.0 == 20 || job.1 == [20]), "{jobs:?}");
    // The first ten are turned by 40°: another view.
    for state in states.iter_mut().take(10).flatten() {
        state.world_from_camera = DAffine3::from_rotation_y(40f64.to_radians());
    }
    let jobs = plan(&model, &states);
    assert_eq!(jobs.iter().find(|job| job.0 == 20).unwrap().1, [10, 13, 15]);
}
