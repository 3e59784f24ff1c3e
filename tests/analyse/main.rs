//! Analysis of footage, and simulated recordings with known flaws.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

#[path = "../common/columns.rs"]
mod columns;
#[path = "../common/mod.rs"]
mod common;
#[path = "../common/fixture.rs"]
mod fixture;
#[path = "../common/flip.rs"]
mod flip;
#[path = "../common/footage.rs"]
mod footage;
#[path = "../common/gpu.rs"]
mod gpu;
#[path = "../common/program.rs"]
mod program;
#[path = "../common/reduced.rs"]
mod reduced;
#[path = "../common/shot.rs"]
mod shot;
#[path = "../common/tier.rs"]
mod tier;

mod artefact;
mod clock;
mod evidence;
mod findings;
mod flaws;
mod light;
mod occlusion;
mod plain;
mod real_shadow;
mod registration;
mod report;
mod simulate;
mod simulate_flaws;
mod surfels;
mod truth;
mod validity;
mod verify_real;
mod verify_simulated;
