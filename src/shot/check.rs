//! Checks of a shot before anything is drawn or written.

use std::ops::Range;

use super::{Shot, ShotError};
use crate::camera::{Curve, Geometry, Intrinsics, LensModel, ResponseTable};
use crate::params::{Params, Value};
use crate::profile::Rig;
use crate::recording::Recording;

impl Shot {
    /// Checks that a range of frames can be composited: cameras, lens, the needs of effects. Single
    /// frames may lack a pose, but not all of them.
    pub fn check(&self, range: Range<usize>) -> Result<(), ShotError> {
        self.check_files()?;
        let first = self.geometry_at(0)?;
        range.into_iter().try_for_each(|frame| self.geometry_at(frame).map(drop))?;
        let camera = self.camera();
        if camera.response.curve == Curve::Table && camera.response.table == ResponseTable::default() {
            return Err(ShotError::NoResponseTable);
        }
        // Refuses an impossible lens.
        camera.lens.opening(&first)?;
        let frames = self.recording.frame_count();
        let mut poses = (0..frames).map(|frame| self.recording.pose_at_frame(frame));
        if let (Some(Err(source)), true) = (poses.next(), poses.all(|pose| pose.is_err())) {
            return Err(ShotError::NoPoses { frames, source });
        }
        Ok(self.settings.check(&camera, &first)?)
    }

    /// Checks that no model is replaced by a stand-in box, and that no panorama is missing.
    pub fn check_files(&self) -> Result<(), ShotError> {
        match self.scene.missing.iter().find(|missing| missing.is_needed) {
            Some(missing) => Err(ShotError::MissingFile { problem: missing.problem.clone() }),
            None => Ok(()),
        }
    }

    /// Checks that every frame of a range has a pose.
    pub fn check_poses(&self, mut range: Range<usize>) -> Result<(), ShotError> {
        range.try_for_each(|frame| match self.recording.pose_at_frame(frame) {
            Ok(_) => Ok(()),
            Err(source) => Err(ShotError::NoPose { frame, source }),
        })
    }
}

/// The camera of a frame: the given values over the recording's own.
pub fn geometry(recording: &Recording, rig: &Rig, frame: usize) -> Result<Geometry, ShotError> {
    let own = recording.geometry_at_frame(frame);
    let Some(geometry) = rig.geometry_over(own) else {
        let path = recording.path.clone();
        return Err(if rig.gives_geometry() {
            ShotError::IncompleteCamera { path, missing: rig.missing_keys() }
        } else {
            ShotError::NoCamera { path }
        });
    };
    if geometry.is_equirectangular() || own.is_some_and(Geometry::is_equirectangular) {
        check_round(&geometry)?;
    }
    let Intrinsics { width_px, height_px, .. } = geometry.intrinsics;
    let (camera, frames) = ((width_px, height_px), (recording.width, recording.height));
    if camera != frames {
        return Err(ShotError::Size { camera, frames });
    }
    if geometry.distortion.model == LensModel::StMap {
        let map = rig.distortion.map.as_ref().ok_or(ShotError::NoLensMap)?;
        map.check(&geometry.intrinsics).map_err(|problem| ShotError::LensMap { problem })?;
    }
    match geometry.distortion.missing() {
        Some(name) => {
            let model = geometry.distortion.get("model").unwrap_or(Value::None);
            Err(ShotError::Coefficient { name, model })
        }
        None => Ok(geometry),
    }
}

/// Checks a 360° camera, and a camera that is given for a recording of 360° pictures.
fn check_round(geometry: &Geometry) -> Result<(), ShotError> {
    let Intrinsics { width_px, height_px, readout_time_s, .. } = geometry.intrinsics;
    if !geometry.is_equirectangular() {
        return Err(ShotError::PanoramaCamera);
    }
    if width_px != 2 * height_px {
        return Err(ShotError::PanoramaSize { width_px, height_px });
    }
    if readout_time_s > 0.0 {
        return Err(ShotError::PanoramaReadout { actual: readout_time_s });
    }
    Ok(())
}
