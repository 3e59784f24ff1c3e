//! Pictures: rendering, the camera's optics and sensor, and footage that must stay unchanged.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

#[path = "../common/board.rs"]
mod board;
#[path = "../common/mod.rs"]
mod common;
#[path = "../common/fixture.rs"]
mod fixture;
#[path = "../common/flip.rs"]
mod flip;
#[path = "../common/gpu.rs"]
mod gpu;
#[path = "../common/kinect.rs"]
mod kinect;
#[path = "../common/marks.rs"]
mod marks;
#[path = "../common/models.rs"]
mod models;
#[path = "../common/program.rs"]
mod program;
#[path = "../common/random.rs"]
mod random;
#[path = "../common/reduced.rs"]
mod reduced;
#[path = "../common/scan.rs"]
mod scan;
#[path = "../common/shot.rs"]
mod shot;
#[path = "../common/site.rs"]
mod site;
#[path = "../common/srgb.rs"]
mod srgb;
#[path = "../common/tier.rs"]
mod tier;

mod coded;
mod compositor;
mod cycles;
mod demo;
mod depth_of_field;
mod effects;
mod every_effect;
mod golden;
mod indirect_light;
mod laws;
mod layers;
mod lens_effects;
mod panoramas;
mod photo;
mod photo_focus;
mod photo_scene;
mod pictures;
mod projections;
mod real;
mod receiver;
mod reused_compositor;
mod scanned_site;
mod sensor_occlusion;
mod shaders;
mod shading;
mod shadow;
mod shots;
mod slr;
mod stages;
mod stand_in;
