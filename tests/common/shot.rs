//! Recordings with a scene in them, as the program opens and composites them.

#![allow(dead_code, reason = "each test file uses some of it")]

use std::ops::Range;
use std::path::Path;

use locard::compositor::{Composited, IN_FLIGHT};
use locard::gpu::Gpu;
use locard::recording::OpenOptions;
use locard::shot::{Given, Shot};

/// A recording with a scene, by a profile where the recording has none of its own.
pub fn open(recording: &Path, profile: Option<&str>, scene: &Path) -> Shot {
    let given = Given { profile: profile.map(Into::into), scene: Some(scene.to_owned()), ..Given::default() };
    Shot::open(recording, &OpenOptions::default(), &given).unwrap()
}

/// The recording that comes with the program.
pub fn demo(scene: &str) -> Shot {
    open(Path::new("recordings/demo"), None, Path::new(scene))
}

/// Frames with their layers, by a compositor of their own.
pub fn composited(gpu: &Gpu, shot: &Shot, range: Range<usize>) -> Vec<Composited> {
    let mut compositor = shot.compositor(gpu.clone());
    shot.frames(&mut compositor, range, true, IN_FLIGHT).unwrap().map(Result::unwrap).collect()
}
