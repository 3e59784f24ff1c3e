//! Cameras and trackers, and their recordings.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

#[path = "../common/mod.rs"]
mod common;
#[path = "../common/filmed.rs"]
mod filmed;
#[path = "../common/fixture.rs"]
mod fixture;
#[path = "../common/gpu.rs"]
mod gpu;
#[path = "../common/program.rs"]
mod program;
#[path = "../common/random.rs"]
mod random;
#[path = "../common/sheet.rs"]
mod sheet;
#[path = "../common/srgb.rs"]
mod srgb;
#[path = "../common/tier.rs"]
mod tier;

mod camera_program;
mod live;
mod recorder;
mod stream_program;
mod streams;
mod tracking_loss;
