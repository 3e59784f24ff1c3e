//! Scenes: what they accept, what they refuse, and what becomes of real files.

#![expect(clippy::unwrap_used, reason = "a test may panic")]

#[path = "../common/mod.rs"]
mod common;

mod damaged;
mod files;
mod helper;
mod lighting;
mod models;
mod refused;
mod scene_files;
