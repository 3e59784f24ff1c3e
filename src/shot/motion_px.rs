//! Motion of a surface's image during the exposure.

use glam::DVec2;

use super::{Shot, Surface, SurfaceError};
use crate::frame::Frame;

impl Shot {
    /// Motion of a surface's image while its row is exposed, px of the recorded picture. The
    /// surface is at rest, the camera moves.
    pub fn motion_px(&self, frame: &Frame, at_px: DVec2, surface: &Surface) -> Result<DVec2, SurfaceError> {
        let geometry = self.geometry_at(frame.index).map_err(Box::new)?;
        let exposure_s = self.exposure_time(frame).s;
        let time_s = frame.timestamp_s + geometry.row_time_s(at_px.y);
        let track = &self.recording.track;
        // If the track begins or ends within the exposure, the other half is extrapolated.
        let (begin, end) = (track.at(time_s - 0.5 * exposure_s), track.at(time_s + 0.5 * exposure_s));
        let middle = track.at(time_s);
        let (begin, end, scale) = match (begin, end, middle) {
            (Ok(begin), Ok(end), _) => (begin, end, 1.0),
            (Ok(begin), Err(_), Ok(middle)) => (begin, middle, 2.0),
            (Err(_), Ok(end), Ok(middle)) => (middle, end, 2.0),
            (Err(error), _, _) | (_, Err(error), _) => return Err(error.into()),
        };
        let project = |pose: crate::pose::Pose| geometry.project(pose.transform_point(surface.plane.point_m));
        let no_ray = || SurfaceError::NoRay { at_px: at_px.to_array() };
        let (from, to) = (project(begin).ok_or_else(no_ray)?, project(end).ok_or_else(no_ray)?);
        Ok(scale * geometry.displacement_px(from, to))
    }
}
