//! Calibration of camera and lens, printed tags, and the measures themselves.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

#[path = "../common/mod.rs"]
mod common;
#[path = "../common/filmed.rs"]
mod filmed;
#[path = "../common/fixture.rs"]
mod fixture;
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

mod example_noise;
mod lens;
mod lens_by_tags;
mod live;
mod measure;
mod noise;
mod picked;
mod simulated;
#[cfg(unix)]
mod solve;
mod tags;
mod textureless;
mod track;
