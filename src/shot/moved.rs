//! How far the picture of a surface moves while the shutter is open.

use glam::DVec2;

use super::{Shot, Surface, SurfaceError};
use crate::compositor::exposure_time_s;
use crate::frame::Frame;

impl Shot {
    /// The way of a surface's picture while the row that it lies in is exposed, px of the recorded picture. The surface is
    /// at rest, the camera moves.
    pub fn moved_px(&self, frame: &Frame, at_px: DVec2, surface: &Surface) -> Result<DVec2, SurfaceError> {
        let geometry = self.geometry_at(frame.index).map_err(Box::new)?;
        let exposure_s = exposure_time_s(&self.camera(), &self.settings, frame, self.interval_s(frame.index));
        let time_s = frame.timestamp_s + self.recording.time_offset_s + geometry.row_time_s(at_px.y);
        let track = &self.recording.track;
        // Where poses begin or end within the exposure, the half that is known tells.
        let (begin, end) = (track.at(time_s - 0.5 * exposure_s), track.at(time_s + 0.5 * exposure_s));
        let middle = track.at(time_s);
        let (begin, end, share) = match (begin, end, middle) {
            (Ok(begin), Ok(end), _) => (begin, end, 1.0),
            (Ok(begin), Err(_), Ok(middle)) => (begin, middle, 2.0),
            (Err(_), Ok(end), Ok(middle)) => (middle, end, 2.0),
            (Err(error), _, _) | (_, Err(error), _) => return Err(error.into()),
        };
        let seen = |pose: crate::pose::Pose| geometry.project(pose.transform_point(surface.point_m));
        let unseen = || SurfaceError::NoRay { at_px: at_px.to_array() };
        let (from, to) = (seen(begin).ok_or_else(unseen)?, seen(end).ok_or_else(unseen)?);
        Ok(share * geometry.way_px(from, to))
    }
}
