//! The recording and the scene that come with the program.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

#[path = "common/gpu.rs"]
mod gpu;

use std::path::Path;

use locard::compositor::{Composited, Settings};
use locard::measure::flip::{PIXELS_PER_DEGREE, mean_flip};
use locard::params::Value;
use locard::profile::Rig;
use locard::recording::{OpenOptions, Recording};

fn demo_frame(frame: usize, method: &str) -> Composited {
    let recording = Recording::open(Path::new("recordings/demo"), &OpenOptions::default()).unwrap();
    let mut rig = Rig::default();
    rig.read(recording.camera_profile.as_deref().unwrap(), &mut Settings::default()).unwrap();
    let scene = locard::scene::load(Path::new("scenes/demo.toml"), recording.up).unwrap();
    let settings = gpu::settings(&[
        ("motion_blur", "method", Value::Text(method.to_owned())),
        ("noise", "scale", Value::Number(0.0)),
    ]);
    let frame = recording.frames(frame..frame + 1).unwrap().next().unwrap().unwrap();
    gpu::composite(&gpu::gpu(), &rig.camera(), settings, scene, &recording.track, frame)
}

#[test]
fn the_velocity_filter_looks_like_many_samples() {
    // In frame 31 the camera pans: 12 px of blur; in frame 10 it shakes: 2 px.
    for frame in [10, 31] {
        let reference = demo_frame(frame, "reference");
        let (a, b) = (reference.layer.as_ref().unwrap(), demo_frame(frame, "velocity"));
        let layer = b.layer.as_ref().unwrap();
        let mask: Vec<bool> = a.rgba.iter().zip(&layer.rgba).map(|(p, q)| p[3] > 0.0 || q[3] > 0.0).collect();
        assert!(mask.iter().filter(|&&m| m).count() > 500);
        let flip = mean_flip(&reference.pixels, &b.pixels, Some(&mask), PIXELS_PER_DEGREE).unwrap();
        println!("frame {frame}: mean FLIP {flip:.4}");
        assert!(flip < 0.05, "frame {frame}: {flip}");
    }
}
