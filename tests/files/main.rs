//! Input and output: recordings, scenes, pictures, and the command line.

#![allow(clippy::unwrap_used, clippy::type_complexity, reason = "tests")]

#[path = "../../fuzz/bodies.rs"]
mod bodies;
#[path = "../common/mod.rs"]
mod common;
#[path = "../common/files.rs"]
mod files;
#[path = "../common/fixture.rs"]
mod fixture;
#[path = "../common/gpu.rs"]
mod gpu;
#[path = "../common/models.rs"]
mod models;
#[path = "../common/program.rs"]
mod program;
#[path = "../common/shot.rs"]
mod shot;
#[path = "../common/tier.rs"]
mod tier;

mod cli;
mod export;
mod fuzz_seeds;
mod imperfect;
mod kit;
mod motion_jpeg;
mod outputs;
mod photo_log;
mod photogrammetry;
mod pixels;
mod place;
mod provenance;
mod recordings;
mod safety;
mod scan_files;
mod scans;
mod scene;
mod seeking;
#[cfg(feature = "sign")]
mod sign;
mod telemetry;
mod video_out;
