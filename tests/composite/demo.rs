//! The recording and the scene that come with the program.

use crate::flip::{PIXELS_PER_DEGREE, mean_flip};
use crate::gpu;
use crate::reduced::Reduction;
use crate::shot;
use crate::tier::{fast_or_full, is_full};
use locard::compositor::Composited;
use locard::params::Value;
use std::path::Path;

/// Half the resolution and no shadows in the fast tier; shadows are the same for every method.
fn demo_frame(frame: usize, method: &str) -> Composited {
    let recording = if is_full() { "recordings/demo".into() } else { Reduction::by(2).demo() };
    let mut shot = shot::open(&recording, None, Path::new("scenes/demo.toml"));
    shot.settings = gpu::settings(&[
        ("motion_blur", "method", Value::Text(method.to_owned())),
        ("noise", "scale", Value::Number(0.0)),
        ("shadow", "cast", Value::Bool(is_full())),
    ]);
    shot::composited(&gpu::gpu(), &shot, frame..frame + 1).remove(0)
}

// Slow: the reference renders each frame at many moments.
#[test]
fn velocity_filter_matches_the_reference_by_flip() {
    // In frame 31 the camera pans: 12 px of blur at full resolution; in frame 10 it shakes: 2 px.
    for &frame in fast_or_full(&[31][..], &[10, 31]) {
        let reference = demo_frame(frame, "reference");
        let (a, b) = (reference.layer.as_ref().unwrap(), demo_frame(frame, "velocity"));
        let layer = b.layer.as_ref().unwrap();
        let mask: Vec<bool> = a.rgba.iter().zip(&layer.rgba).map(|(p, q)| p[3] > 0.0 || q[3] > 0.0).collect();
        assert!(mask.iter().filter(|&&m| m).count() > fast_or_full(125, 500));
        let flip = mean_flip(&reference.pixels, &b.pixels, Some(&mask), PIXELS_PER_DEGREE);
        println!("frame {frame}: mean FLIP {flip:.4}");
        assert!(flip < 0.05, "frame {frame}: {flip}");
    }
}
