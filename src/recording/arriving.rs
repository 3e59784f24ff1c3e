//! A recording whose frames are still to come.

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;

use super::parts::Pictures;
use super::{Recording, own};
use crate::tracking::PoseTrack;

impl Recording {
    /// A recording of our own format without a frame, for what has to be known before the first one comes: camera,
    /// scene and settings are put to it. 8 bits; frames and poses are the caller's.
    pub fn arriving(name: &str, width: u32, height: u32, interval_s: f64, up: Option<DVec3>) -> Self {
        Self {
            name: name.to_owned(),
            path: Path::new(name).to_owned(),
            kind: &own::FORMAT,
            up,
            width,
            height,
            bits: 8,
            timestamps_s: Arc::default(),
            frame_interval_s: interval_s,
            has_even_intervals: true,
            track: PoseTrack::default(),
            metres_per_unit: 1.0,
            time_offset_s: 0.0,
            geometry: None,
            camera_profile: None,
            exposure: Arc::default(),
            warnings: Vec::new(),
            described_by: Vec::new(),
            geometries: Arc::default(),
            given_cameras: None,
            pictures: Arc::new(Pictures::Stills(Vec::new())),
            depth: None,
        }
    }
}
