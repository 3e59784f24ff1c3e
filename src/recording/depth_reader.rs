//! The depth of a recording's frames: measured, else rendered from a scan of the site.

use std::sync::Arc;

use super::Recording;
use super::depth::Depth;
use crate::camera::Geometry;
use crate::pixels::DepthMap;
use crate::site::ScannedSite;
use crate::source::SourceError;
use crate::tracking::PoseTrack;

/// Reads depth on any thread.
#[derive(Clone, Debug)]
pub struct DepthReader {
    size: (u32, u32),
    measured: Option<Arc<Depth>>,
    /// Added to the times of measured maps, s.
    later_s: f64,
    /// One per frame, or one for all.
    cameras: Arc<[Option<Geometry>]>,
    site: Option<ScannedSite>,
    track: PoseTrack,
    timestamps_s: Arc<[f64]>,
}

impl DepthReader {
    pub fn new(recording: &Recording) -> Self {
        Self {
            size: (recording.width, recording.height),
            measured: recording.depth.clone(),
            later_s: recording.depth_later_s,
            cameras: recording.cameras(),
            site: recording.site.clone(),
            track: recording.track.clone(),
            timestamps_s: Arc::clone(&recording.timestamps_s),
        }
    }

    /// Depth of a frame. `None` if none was measured, and there is no scan or no pose for it.
    pub fn read(&self, index: usize) -> Result<Option<DepthMap>, SourceError> {
        let camera = self.cameras.get(index).or(self.cameras.first()).and_then(Option::as_ref);
        let measured = self.measured.as_ref().map_or(Ok(None), |depth| depth.read(index, self.size, camera))?;
        let measured = measured.map(|map| DepthMap { timestamp_s: map.timestamp_s + self.later_s, ..map });
        Ok(measured.or_else(|| self.rendered(index, camera?)))
    }

    fn rendered(&self, index: usize, camera: &Geometry) -> Option<DepthMap> {
        let time_s = *self.timestamps_s.get(index)?;
        let is_of_frames = (camera.intrinsics.width_px, camera.intrinsics.height_px) == self.size;
        self.site.as_ref().filter(|_| is_of_frames)?.depth_at_time(camera, &self.track, time_s).ok()
    }
}
