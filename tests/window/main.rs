//! Tests of the window, operated as by a user.

#![cfg(feature = "window")]
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

#[path = "../common/filmed.rs"]
mod filmed;
#[path = "../common/fixture.rs"]
mod fixture;
#[path = "../common/footage.rs"]
mod footage;
#[path = "../common/gpu.rs"]
mod gpu;
#[path = "../common/window.rs"]
mod harness;
#[path = "../common/program.rs"]
mod program;
#[path = "../common/reduced.rs"]
mod reduced;
#[path = "../common/scan.rs"]
mod scan;
#[path = "../common/sheet.rs"]
mod sheet;
#[path = "../common/srgb.rs"]
mod srgb;
#[path = "../common/tier.rs"]
mod tier;

mod access;
mod analysing;
mod first_use;
mod handles;
mod lamps;
mod live;
mod matching;
mod notices;
mod opening;
mod persistence;
mod place;
mod scanned_site;
mod slopes;
mod small;
mod tuner;
