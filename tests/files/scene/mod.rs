//! Scenes: accepted, refused and real files.

mod damaged;
mod files;
mod forgiven;
mod lighting;
mod models;
mod refused;
mod rest_pose;
mod scene_files;
