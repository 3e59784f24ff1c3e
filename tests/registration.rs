//! The real desk as a virtual object, in the recording that it was made from.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod common;
#[path = "common/gpu.rs"]
mod gpu;

use std::path::Path;

use locard::camera::Geometry;
use locard::compositor::Settings;
use locard::measure::Grey;
use locard::measure::displacement::{DisplacementOptions, displacements};
use locard::profile::Rig;
use locard::recording::{OpenOptions, Recording};

/// Patches must be much larger than the displacements, which reach 10 px in a few frames.
const PATCH_PX: usize = 64;

/// Lengths of the displacements of all patches that the twin covers in these frames, px.
fn twin_displacements(frames: std::ops::Range<usize>) -> Option<Vec<f64>> {
    let folder = common::data("tum-fr1-rpy")?;
    let twin = common::data("twins/tum-fr1-rpy-020.glb")?;
    let recording = Recording::open(&folder, &OpenOptions::default()).unwrap();
    let mut rig = Rig::default();
    rig.read(Path::new("profiles/tum-fr1.toml"), &mut Settings::default()).unwrap();
    rig.intrinsics.readout_time_s = 0.0;
    let camera = rig.camera();
    let geometry: Geometry = camera.geometry.clone().unwrap();
    let scene = locard::scene::load(&twin, recording.up).unwrap();
    let gpu = gpu::gpu();
    let mut lengths = Vec::new();
    for frame in recording.frames(frames).unwrap() {
        let mut frame = frame.unwrap();
        frame.depth = None;
        let real = frame.pixels.clone();
        let mut settings = Settings::default();
        settings.plain();
        assert_eq!(geometry.intrinsics.readout_time_s, 0.0);
        let done = gpu::composite(&gpu, &camera, settings, scene.clone(), &recording.track, frame);
        let layer = done.layer.unwrap();
        let mask: Vec<bool> = layer.rgba.iter().map(|p| p[3] > 0.999).collect();
        let found = displacements(
            &Grey::luma(&real),
            &Grey::luma(&done.pixels),
            Some(&mask),
            &DisplacementOptions { patch_px: PATCH_PX, step_px: PATCH_PX / 2, ..Default::default() },
        )
        .unwrap();
        assert!(found.patches.len() > 5, "{} patches", found.patches.len());
        println!(
            "frame {}: median {:.3} px of {} patches",
            done.frame,
            found.median_length_px().unwrap(),
            found.patches.len()
        );
        lengths.extend(found.patches.iter().map(|p| p.displacement_px[0].hypot(p.displacement_px[1])));
    }
    Some(lengths)
}

fn median(mut lengths: Vec<f64>) -> f64 {
    lengths.sort_by(f64::total_cmp);
    lengths[lengths.len() / 2]
}

#[test]
fn the_twin_lies_on_its_own_frame() {
    let Some(lengths) = twin_displacements(20..21) else { return };
    let median = median(lengths);
    println!("frame 20: median displacement {median:.3} px");
    assert!(median <= 0.3, "{median}");
}

#[test]
fn the_twin_follows_the_camera() {
    let Some(lengths) = twin_displacements(22..31) else { return };
    let median = median(lengths);
    println!("frames 22 to 30: median displacement {median:.3} px");
    assert!(median <= 2.2, "{median}");
}
