//! The laws of ARCHITECTURE.md, on real frames where they need them.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod common;
#[path = "common/gpu.rs"]
mod gpu;

use std::path::Path;

use locard::compositor::{Composited, Compositor, Job, Settings};
use locard::gpu::Gpu;
use locard::image::Codes;
use locard::params::Value;
use locard::profile::Rig;
use locard::recording::{OpenOptions, Recording};
use locard::scene::Scene;

/// The knife and the dagger on the desk of tum-fr1-rpy, real size.
const DESK: &str = r#"
version = 1
[[objects]]
model = "MODELS/knife.gltf"
size_m = 0.25
position_m = [0.45, 0.55, 0.75]
[[objects]]
model = "MODELS/dagger.gltf"
size_m = 0.3
position_m = [0.25, 0.35, 0.75]
rotation_deg = [0, 0, 50]
[light]
ambient = 0.6
"#;

struct Site {
    recording: Recording,
    rig: Rig,
    scene: Scene,
}

fn desk() -> Option<Site> {
    let folder = common::data("tum-fr1-rpy")?;
    let models = common::data("props")?;
    let temp = tempfile::tempdir().unwrap();
    let file = temp.path().join("scene.toml");
    std::fs::write(&file, DESK.replace("MODELS", models.to_str().unwrap())).unwrap();
    let recording = Recording::open(&folder, &OpenOptions::default()).unwrap();
    let mut rig = Rig::default();
    rig.read(Path::new("profiles/tum-fr1.toml"), &mut Settings::default()).unwrap();
    // The law must hold with everything on: noise and exposure as a user would have them.
    rig.read_text(NOISE, Path::new("noise"), &mut Settings::default()).unwrap();
    let scene = locard::scene::load(&file, recording.up).unwrap();
    Some(Site { recording, rig, scene })
}

const NOISE: &str = "version = 1\n[camera.exposure]\ntime_s = 0.016\n[camera.noise]\ncode = [0, 255]\n\
    sigma_r = [2, 4]\nsigma_g = [2, 3]\nsigma_b = [3, 4]\nchannel_correlation = [0.3, 0.2, 0.3]\nneighbour_correlation = [0.4, 0.4]\n";

fn settings() -> Settings {
    gpu::settings(&[("edge_blend", "impact", Value::Number(0.5))])
}

/// The frames of a range, through the same stream as the program's.
fn composite(
    gpu: &Gpu,
    site: &Site,
    settings: Settings,
    range: std::ops::Range<usize>,
    layers: bool,
) -> Vec<Composited> {
    let camera = site.rig.camera();
    let geometry = camera.geometry.clone().unwrap();
    let mut compositor = Compositor::new(gpu.clone(), camera, settings, site.scene.clone());
    let mut out = Vec::new();
    for frame in site.recording.frames(range).unwrap() {
        let job = Job {
            frame: frame.unwrap(),
            geometry: &geometry,
            track: &site.recording.track,
            time_offset_s: 0.0,
            interval_s: site.recording.frame_interval_s,
            want_layer: layers,
        };
        let pending = compositor.submit(job).unwrap();
        out.push(compositor.collect(pending).unwrap());
    }
    out
}

fn codes(codes: &Codes) -> &[u8] {
    match codes {
        Codes::U8(codes) => codes,
        Codes::U16(_) => panic!("8 bits expected"),
    }
}

#[test]
fn law_1_the_cameras_pixels_are_sacred() {
    let Some(site) = desk() else { return };
    let (mut touched, mut seen) = (0usize, 0usize);
    let done = composite(&gpu::gpu(), &site, settings(), 0..90, true);
    let frames = site.recording.frames(0..90).unwrap();
    for (done, frame) in done.iter().zip(frames) {
        let frame = frame.unwrap();
        let layer = done.layer.as_ref().unwrap();
        let pairs = codes(&done.pixels.codes).chunks_exact(3).zip(codes(&frame.pixels.codes).chunks_exact(3));
        for (i, (out, camera)) in pairs.enumerate() {
            if layer.rgba[i][3] == 0.0 {
                assert_eq!(out, camera, "frame {} pixel {i}", done.frame);
            } else {
                seen += 1;
                touched += usize::from(out != camera);
            }
        }
        for ((p, depth), velocity) in layer.rgba.iter().zip(&layer.depth_m).zip(&layer.velocity) {
            assert_eq!(p[3] > 0.0, *depth > 0.0, "depth is 0 exactly where A is 0");
            assert!(p[3] > 0.0 || *velocity == [0.0; 2]);
        }
    }
    // The objects must have been there for the law to mean anything.
    assert!(seen > 90 * 500 && touched > seen / 2, "{seen} mixed pixels, {touched} changed");
}

#[test]
fn law_2_a_range_alone_is_the_same_range_of_the_whole() {
    let Some(site) = desk() else { return };
    let gpu = gpu::gpu();
    let whole = composite(&gpu, &site, settings(), 30..55, false);
    let alone = composite(&gpu, &site, settings(), 40..50, false);
    for (a, b) in alone.iter().zip(&whole[10..20]) {
        assert_eq!(a.frame, b.frame);
        assert!(a.pixels == b.pixels, "frame {}", a.frame);
    }
    let mut other_seed = settings();
    other_seed.seed = 1;
    let other = composite(&gpu, &site, other_seed, 40..41, false);
    assert!(other[0].pixels != alone[0].pixels, "another seed is another pattern");
}

#[test]
fn law_3_neutral_is_identity() {
    let Some(mut site) = desk() else { return };
    let gpu = gpu::gpu();
    site.rig.exposure.time_s = Some(0.0);
    let mut plain = Settings::default();
    plain.plain();
    let plain = composite(&gpu, &site, plain, 20..24, false);
    let neutral = || {
        gpu::settings(&[
            ("noise", "scale", Value::Number(0.0)),
            ("edge_blend", "impact", Value::Number(0.0)),
            ("depth", "occlusion", Value::Bool(false)),
        ])
    };
    for (a, b) in composite(&gpu, &site, neutral(), 20..24, false).iter().zip(&plain) {
        assert!(a.pixels == b.pixels, "frame {}", a.frame);
    }
    // And a scene without objects is the recording itself.
    site.scene.objects.clear();
    let frames = site.recording.frames(20..24).unwrap();
    for (a, b) in composite(&gpu, &site, settings(), 20..24, false).iter().zip(frames) {
        assert!(a.pixels == b.unwrap().pixels);
    }
}

#[test]
fn occlusion_hides_what_lies_behind_the_desks_things() {
    let Some(site) = desk() else { return };
    let gpu = gpu::gpu();
    let covered = |on: bool| {
        let settings = gpu::settings(&[("depth", "occlusion", Value::Bool(on))]);
        let mut scene = site.scene.clone();
        // A metre below the desk's top.
        for part in scene.objects.iter_mut().flat_map(|o| &mut o.parts) {
            part.world_from_mesh.translation.z -= 1.0;
        }
        let site = Site {
            recording: Recording::open(&common::data("tum-fr1-rpy").unwrap(), &OpenOptions::default()).unwrap(),
            rig: site.rig.clone(),
            scene,
        };
        let done = composite(&gpu, &site, settings, 20..21, true);
        done[0].layer.as_ref().unwrap().rgba.iter().filter(|p| p[3] > 0.0).count()
    };
    let (hidden, open) = (covered(true), covered(false));
    assert!(open > 300, "{open}");
    assert!(hidden * 10 < open, "{hidden} of {open} pixels still show through the desk");
}

#[test]
fn law_7_what_is_missing_is_said_in_one_line() {
    let temp = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str], variables: &[(&str, &str)]| {
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_locard"))
            .args(arguments)
            .envs(variables.iter().copied())
            .output()
            .unwrap();
        let text = String::from_utf8(output.stderr).unwrap();
        let lines: Vec<_> = text.lines().filter(|l| l.starts_with("locard: ")).map(str::to_owned).collect();
        assert_eq!(output.status.code(), Some(2), "{text}");
        assert_eq!(lines.len(), 1, "{text}");
        lines[0].clone()
    };
    let out = temp.path().join("out");
    let video = temp.path().join("out.mp4");
    let demo = |out: &Path| {
        let out = out.to_str().unwrap().to_owned();
        ["composite", "recordings/demo", "--scene", "scenes/demo.toml", "--frames", "0..1", "-o"]
            .map(str::to_owned)
            .into_iter()
            .chain([out])
            .collect::<Vec<_>>()
    };
    let arguments = demo(&out);
    let arguments: Vec<_> = arguments.iter().map(String::as_str).collect();
    let no_driver = [("VK_ICD_FILENAMES", "/nowhere"), ("VK_DRIVER_FILES", "/nowhere"), ("WGPU_BACKEND", "vulkan")];
    let line = run(&arguments, &no_driver);
    assert!(line.contains("no graphics adapter") && line.contains("apt-get install"), "{line}");
    assert!(!out.exists());

    let arguments = demo(&video);
    let arguments: Vec<_> = arguments.iter().map(String::as_str).collect();
    let line = run(&arguments, &[("PATH", "/nowhere")]);
    assert!(line.contains("ffmpeg"), "{line}");
    assert!(!video.exists());
}
