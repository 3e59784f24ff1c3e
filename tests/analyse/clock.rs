//! The delay between pictures and poses of simulated cameras that travel, turn by 90° or are held
//! upright.

use std::sync::OnceLock;

use glam::DVec3;
use locard::camera::Intrinsics;
use locard::pixels::Pixels;
use locard::pose::Pose;
use locard::simulate::{DOLLY_M_PER_S, Detail, Flaws, Motion, Options, PAN_RAD_PER_S, Simulation, Snapshot};
use locard::tracking::PoseTrack;
use locard::tracking::delay::{self, Delay, DelayFailure, MAX_SEARCHED_DELAY_S, estimate};
use locard::tracking::turn::ImagePyramid;

const INTERVAL_S: f64 = 1.0 / 30.0;
const FRAMES: usize = 60;
/// Delay of the poses' clock, s.
const LATE_S: f64 = 0.031;

/// Pictures of a camera on a straight path or a turn, with poses delayed by [`LATE_S`]. `at` is the
/// position on the path, m, or the angle, rad.
struct Clip {
    pictures: Vec<Pixels>,
    camera: Intrinsics,
    track: PoseTrack,
}

/// Simulates four frames, a second apart: the path that clips are cut from.
fn simulate(motion: Motion) -> Simulation {
    let options = Options {
        width_px: 160,
        height_px: 120,
        focal_px: 130.0,
        frames: 4,
        fps: 1.0,
        readout_time_s: 0.0,
        k1: 0.0,
        k2: 0.0,
        p1: 0.0,
        p2: 0.0,
        motion,
        ..Options::default()
    };
    let detail = Detail { light_m: 0.2, ..Detail::for_focal_px(options.focal_px) };
    Simulation::with_flaws_and_detail(&options, &Flaws::default(), detail, 2).unwrap()
}

/// Returns the simulation of a motion. Lighting its site takes most of a test's time, so tests
/// share it.
fn simulation(motion: Motion) -> &'static Simulation {
    static PAN: OnceLock<Simulation> = OnceLock::new();
    static DOLLY: OnceLock<Simulation> = OnceLock::new();
    let shared = if motion == Motion::Pan { &PAN } else { &DOLLY };
    shared.get_or_init(|| simulate(motion))
}

impl Clip {
    fn new(motion: Motion, at: impl Fn(f64) -> f64) -> Self {
        let simulation = simulation(motion);
        let speed = if motion == Motion::Pan { PAN_RAD_PER_S } else { DOLLY_M_PER_S };
        let on_way_s = |time_s: f64| simulation.timestamp_s(0) + 1.5 + at(time_s) / speed;
        let picture = |n: usize| {
            let snapshot = Snapshot {
                timestamp_s: on_way_s(n as f64 * INTERVAL_S),
                exposure_time_s: 0.0,
                samples: 4,
                ..simulation.snapshot(0)
            };
            let clean = simulation.sensor.clean(&simulation.shoot(&snapshot), 1.0);
            let codes = simulation.sensor.sense(&clean, 160, n as u64, 2);
            Pixels::from_u8(160, 120, codes).unwrap()
        };
        let pose = |n: i32| {
            let time_s = 0.01 * f64::from(n);
            (time_s + LATE_S, simulation.track().at(on_way_s(time_s)).unwrap())
        };
        let track = PoseTrack::new((-60..260).map(pose).collect(), 0.1).unwrap();
        let camera = simulation.geometry().intrinsics.clone();
        Self { pictures: (0..FRAMES).map(picture).collect(), camera, track }
    }

    /// The same pictures stored rotated by 90°.
    fn upright(mut self) -> Self {
        let turned = |pixels: &Pixels| {
            let (width, height) = (pixels.height, pixels.width);
            // The right of the stored picture is the top of the scene.
            let at = |x: u32, y: u32| pixels.eight_bits_at(y, width - 1 - x);
            let codes = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).flat_map(|(x, y)| at(x, y)).collect();
            Pixels::from_u8(width, height, codes).unwrap()
        };
        self.pictures = self.pictures.iter().map(turned).collect();
        let i = &self.camera;
        self.camera = Intrinsics {
            width_px: i.height_px,
            height_px: i.width_px,
            fx_px: i.fy_px,
            fy_px: i.fx_px,
            cx_px: f64::from(i.height_px) - i.cy_px,
            cy_px: i.cx_px,
            ..i.clone()
        };
        self
    }

    fn delay(&self) -> Result<Delay, DelayFailure> {
        let reduced: Vec<ImagePyramid> =
            self.pictures.iter().map(|pixels| ImagePyramid::new(pixels).unwrap()).collect();
        let motion = |n: usize| {
            let (from_s, to_s) = (n as f64 * INTERVAL_S, (n + 1) as f64 * INTERVAL_S);
            let turn: DVec3 = reduced[n].rotation_to(&reduced[n + 1], &self.camera)?;
            Some(delay::FrameRotation { from_s, to_s, turn })
        };
        let motions: Vec<delay::FrameRotation> = (0..FRAMES - 1).filter_map(motion).collect();
        let delay = estimate(&motions, |from_s, to_s| self.track.motion_between(from_s, to_s), MAX_SEARCHED_DELAY_S);
        println!("{} motions: {delay:?}", motions.len());
        delay
    }
}

/// Irregular hand motion.
fn sway(time_s: f64) -> f64 {
    0.22 * (2.3 * time_s).sin() + 0.07 * (6.1 * time_s + 0.5).sin() + 0.02 * (11.3 * time_s).sin()
}

/// From −45° to 45° within a second.
fn quarter_turn(time_s: f64) -> f64 {
    let t = (time_s - 0.4).clamp(0.0, 1.0);
    std::f64::consts::FRAC_PI_2 * (t * t * t * (t * (6.0 * t - 15.0) + 10.0) - 0.5)
}

fn is_late(delay: &Delay, within_s: f64) {
    assert!((delay.delay_s - LATE_S).abs() < within_s, "{delay:?}");
}

// Slow: a simulated site is lit.
#[test]
fn delay_of_a_simulated_translation_is_found() {
    let clip = Clip::new(Motion::Dolly, sway);
    let delay = clip.delay().unwrap();
    is_late(&delay, 0.005);
    assert_eq!(delay.quarters, 0);
}

// Slow: a simulated site is lit.
#[test]
fn delay_of_a_simulated_turn_by_90_degrees_is_found() {
    is_late(&Clip::new(Motion::Pan, quarter_turn).delay().unwrap(), 0.005);
}

// Slow: a simulated site is lit.
#[test]
fn delay_of_pictures_stored_rotated_by_90_degrees_is_found() {
    let delay = Clip::new(Motion::Pan, sway).upright().delay().unwrap();
    is_late(&delay, 0.005);
    assert!(delay.quarters % 2 == 1, "{delay:?}");
}

/// Poses of a camera on another path.
// Slow: a simulated site is lit.
#[test]
fn pictures_that_contradict_the_poses_have_no_delay() {
    let clip = Clip::new(Motion::Dolly, sway);
    let other = |time_s: f64| DVec3::new(0.2 * (7.0 * time_s).cos(), 0.1 * (3.3 * time_s).sin(), 0.0);
    let pose =
        |n: i32| (0.01 * f64::from(n), Pose::from_camera_in_world(other(0.01 * f64::from(n)), glam::DQuat::IDENTITY));
    let track = PoseTrack::new((-60..260).map(pose).collect(), 0.1).unwrap();
    assert!(Clip { track, ..clip }.delay().is_err());
}
