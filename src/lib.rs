//! Locard puts virtual evidence into real footage so that it looks photographed there by the
//! same camera at the same moment.
//!
//! source → frame + pose → virtual layer → what the lens does → composite → what the sensor
//! does → sink. The folders follow that sentence; ARCHITECTURE.md tells the rest.

pub mod frame;
pub mod image;
pub mod params;
pub mod pose;

pub mod camera;

pub mod recording;
pub mod sink;
pub mod source;
pub mod tracking;

pub mod scene;

pub mod compositor;
pub mod effects;
pub mod gpu;
pub mod profile;
pub mod profile_noise;
pub mod render;
pub mod simulate;
