//! Recordings with a scene, opened and composited as by the program.

#![allow(dead_code, reason = "each test file uses some of it")]

use std::ops::Range;
use std::path::Path;

use locard::compositor::{Composited, IN_FLIGHT};
use locard::gpu::Gpu;
use locard::recording::OpenOptions;
use locard::shot::{Shot, ShotOptions};

/// Opens a recording with a scene, and with a profile if the recording has none.
pub fn open(recording: &Path, profile: Option<&str>, scene: &Path) -> Shot {
    let options =
        ShotOptions { profile: profile.map(Into::into), scene: Some(scene.to_owned()), ..ShotOptions::default() };
    Shot::open(recording, &OpenOptions::default(), &options).unwrap()
}

/// Opens the demonstration's recording with a scene.
pub fn demo(scene: &str) -> Shot {
    open(Path::new("recordings/demo"), None, Path::new(scene))
}

/// Composites a range of frames, with their layers, by a new compositor.
pub fn composited(gpu: &Gpu, shot: &Shot, range: Range<usize>) -> Vec<Composited> {
    let mut compositor = shot.compositor(gpu.clone());
    shot.frames(&mut compositor, range, true, IN_FLIGHT).unwrap().map(Result::unwrap).collect()
}
