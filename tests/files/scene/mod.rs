//! Scenes: what they accept, what they refuse, and what becomes of real files.

mod damaged;
mod files;
mod lighting;
mod models;
mod refused;
mod scene_files;
