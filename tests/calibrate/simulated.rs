//! Calibration of the simulated camera, whose noise is known.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::LazyLock;

use crate::tier;
use locard::calibrate::noise::from_scenes;
use locard::calibrate::{NoiseCalibration, NoiseOptions};
use locard::camera::NoiseProfile;
use locard::compositor::Settings;
use locard::pixels::{Codes, Pixels};
use locard::profile::Rig;
use locard::simulate::{Detail, Motion, Options, Simulation, StaticScenes, static_scenes};

/// From almost dark to overexposed, so that each bin is covered by some scene.
const GAINS: [f64; 4] = [0.1, 0.35, 1.0, 2.2];

const CRUDE: Detail = Detail { texture_m: 0.05, light_m: 0.4 };

/// [`scenes_of`] with unscaled noise, shared by two tests.
static SCENES: LazyLock<(StaticScenes, Vec<Vec<Pixels>>)> = LazyLock::new(|| scenes_of(1.0));

/// Ten frames of each scene.
fn scenes_of(noise_scale: f64) -> (StaticScenes, Vec<Vec<Pixels>>) {
    let size = Options {
        width_px: tier::fast_or_full(256, 320),
        height_px: tier::fast_or_full(192, 240),
        focal_px: 260.0,
        ..Options::default()
    };
    let options = Options { motion: Motion::Static, noise_scale, ..size };
    let truth = if tier::is_full() {
        static_scenes(&options, &GAINS, 10).unwrap()
    } else {
        // The site's light is coarse: it is no part of the claim, and takes most of the time.
        Simulation::with_detail(&Options { frames: 1, ..options }, CRUDE, 2).unwrap().static_scenes(&GAINS, 10)
    };
    let frames = truth.scenes.iter().map(|scene| scene.frames.clone()).collect();
    (truth, frames)
}

/// Largest relative error of a profile's σ, over the bins with 4,000 independent samples in a
/// calibration.
fn worst(profile: &NoiseProfile, calibration: &NoiseCalibration, truth: &NoiseProfile) -> f64 {
    let compared =
        calibration.bins.iter().enumerate().flat_map(|(channel, bins)| bins.iter().map(move |bin| (channel, bin)));
    let good: Vec<_> = compared.filter(|(_, bin)| bin.independent_count >= 4000.0).collect();
    assert!(good.len() >= 36, "only {} of 48 bins have 4,000 independent samples:\n{calibration}", good.len());
    let error = |(channel, code): (usize, f64)| (profile.sigma(channel, code) / truth.sigma(channel, code) - 1.0).abs();
    good.into_iter().map(|(channel, bin)| error((channel, bin.code))).fold(0.0, f64::max)
}

#[test]
fn simulated_camera_is_recovered() {
    // At 0.4 σ is 0.5 to 1.7 codes: rounding matters.
    for (noise_scale, scenes) in [(1.0, &*SCENES), (0.4, &scenes_of(0.4))] {
        let (truth, frames) = scenes;
        let calibration = from_scenes(frames, &NoiseOptions::default()).unwrap();
        let worst = worst(&calibration.profile, &calibration, &truth.noise);
        println!("noise × {noise_scale}: largest relative error of σ {worst:.4}");
        assert!(worst < 0.05, "noise × {noise_scale}: {worst}\n{calibration}");
        let profile = &calibration.profile;
        // Rounding noise is independent and was subtracted.
        assert!(profile.channel_correlation.iter().all(|c| (c - 0.45).abs() < 0.01), "{profile:?}");
        assert!(profile.neighbour_correlation.iter().all(|c| (c - 0.6).abs() < 0.01), "{profile:?}");
    }
}

fn save(pixels: &Pixels, path: &Path) {
    let Codes::U8(codes) = &pixels.codes else { panic!("8 bits expected") };
    image::save_buffer(path, codes, pixels.width, pixels.height, image::ColorType::Rgb8).unwrap();
}

#[test]
fn program_recovers_the_simulated_camera_from_folders() {
    let (truth, frames) = &*SCENES;
    let temp = tempfile::tempdir().unwrap();
    let folders: Vec<PathBuf> = (0..GAINS.len()).map(|scene| temp.path().join(format!("scene-{scene}"))).collect();
    for (folder, frames) in folders.iter().zip(frames) {
        std::fs::create_dir(folder).unwrap();
        frames.iter().enumerate().for_each(|(i, frame)| save(frame, &folder.join(format!("{i}.png"))));
    }
    let profile = temp.path().join("camera.toml");
    let locard = |arguments: &[&str], paths: &[&Path]| {
        let output = Command::new(env!("CARGO_BIN_EXE_locard")).args(arguments).args(paths).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    let mut paths: Vec<&Path> = folders.iter().map(PathBuf::as_path).collect();
    paths.extend([Path::new("--output"), &profile]);
    let table = locard(&["calibrate", "noise", "--no-example"], &paths);
    assert!(table.starts_with("4 scenes, 40 frames;"), "{table}");

    let mut rig = Rig::default();
    rig.read(&profile, &mut Settings::default()).unwrap();
    let calibration = from_scenes(frames, &NoiseOptions::default()).unwrap();
    let worst = worst(rig.noise.as_ref().unwrap(), &calibration, &truth.noise);
    assert!(worst < 0.05, "{worst}\n{table}");
    assert!(locard(&["inspect"], &[&profile]).contains("16 bins"));
}

#[test]
fn profile_of_the_simulated_camera_round_trips() {
    let mut rig = Rig::default();
    rig.read(Path::new("profiles/simulated.toml"), &mut Settings::default()).unwrap();
    let simulation = Simulation::with_detail(&Options::default(), CRUDE, 2).unwrap();
    let camera = rig.camera();
    assert_eq!(camera.geometry.as_ref(), Some(simulation.geometry()));
    assert_eq!(camera.exposure.time_s, Some(simulation.options().exposure_time_s));
    let (noise, truth) = (camera.noise.unwrap(), simulation.sensor.profile());
    for (channel, bins) in noise.bins.iter().enumerate() {
        for bin in bins {
            let error = bin.sigma / truth.sigma(channel, bin.code) - 1.0;
            assert!(error.abs() < 0.05, "{channel} {bin:?}: {error}");
        }
    }
}
