//! Recordings of a live camera, whose frames are still to come.

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;

use super::frame_camera::FrameCamera;
use super::parts::Pictures;
use super::{Recording, native};
use crate::camera::{Geometry, Response};
use crate::frame::FrameExposure;
use crate::source::presentation::Presentation;
use crate::tracking::PoseTrack;

impl Recording {
    /// A recording of a live camera before its first frame, to which profile, scene and settings
    /// can already be applied. It has 8 bits; frames and poses are supplied by the caller.
    pub fn live(name: &str, width: u32, height: u32, interval_s: f64, up: Option<DVec3>) -> Self {
        Self {
            name: name.to_owned(),
            path: Path::new(name).to_owned(),
            kind: &native::FORMAT,
            up,
            has_floor: false,
            width,
            height,
            bits: 8,
            timestamps_s: Arc::default(),
            opacity: Arc::default(),
            frame_interval_s: interval_s,
            has_even_intervals: true,
            track: PoseTrack::default(),
            metres_per_unit: 1.0,
            geometry: None,
            camera_profile: None,
            exposure: Arc::default(),
            warnings: Vec::new(),
            description_files: Vec::new(),
            geometries: Arc::default(),
            landmarks: Arc::default(),
            has_frame_cameras: true,
            registration_cameras: None,
            pictures: Arc::new(Pictures::Stills(Vec::new())),
            estimated_coding: Arc::default(),
            presentation: Presentation::default(),
            response: Response::default(),
            depth: None,
            site: None,
            depth_later_s: 0.0,
            surfels: Arc::default(),
            surfels_unit_m: 1.0,
            guard: None,
        }
    }

    /// True if the frames come from a live camera, so that none can be read again.
    pub fn is_live(&self) -> bool {
        matches!(&*self.pictures, Pictures::Stills(files) if files.is_empty())
    }

    /// Sets the expected camera and exposure before the first frame.
    pub fn expect(&mut self, FrameCamera { geometry, lens }: &FrameCamera) {
        if geometry.is_some() {
            self.geometries = [geometry.clone()].into();
        }
        if lens.exposure_s.is_some() {
            self.exposure = [FrameExposure { time_s: lens.exposure_s, ..FrameExposure::default() }].into();
        }
    }

    /// Sets the number, time and camera of the newest frame, and the poses known so far. Frames are
    /// numbered from 0; a number that is not larger restarts. Without a camera, the previous one
    /// stays.
    pub fn push_live_frame(&mut self, frame: usize, timestamp_s: f64, track: PoseTrack, camera: Option<Geometry>) {
        // The consumer may have skipped frames.
        let mut timestamps_s = self.timestamps_s[..frame.min(self.timestamps_s.len())].to_vec();
        timestamps_s.resize(frame + 1, timestamp_s);
        (self.timestamps_s, self.track) = (timestamps_s.into(), track);
        if camera.is_some() {
            self.geometries = [camera].into();
        }
    }
}
