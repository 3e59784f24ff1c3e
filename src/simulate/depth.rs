//! A depth sensor that differs from the frames' camera: fewer pixels, another position and lens,
//! another time of measurement, or measurement errors.

use glam::{DQuat, DVec3};

use super::depth_errors::DepthErrors;
use super::render::{self, SimulatedLens, SimulatedPicture, Snapshot};
use super::sensor_depth::measured;
use super::sensor_return::sensor_return;
use super::{FolderLayout, Options, SimulateError, Simulation};
use crate::camera::Geometry;
use crate::pose::Pose;
use crate::tracking::PoseTrack;

/// Width of a phone's depth maps, px.
const PHONE_WIDTH_PX: u32 = 256;
/// Focal length of a separate depth camera, as a factor on that of the frames' camera.
const DEPTH_FOCAL_FACTOR: f64 = 0.9;

/// Renders the depth alone.
#[derive(Debug)]
pub struct DepthSensor {
    lens: SimulatedLens,
    track: PoseTrack,
    pub geometry: Geometry,
    /// Position in the axes of the frames' camera, metres, of a separate depth camera.
    pub beside_m: Option<DVec3>,
    /// Delay of the measurement after the frame, s.
    later_s: f64,
}

impl DepthSensor {
    /// `None` if the depth map has the frames' own pixels.
    pub fn new(simulation: &Simulation) -> Result<Option<Self>, SimulateError> {
        let Options { width_px, height_px, depth_width_px, depth_beside_mm, layout, .. } = *simulation.options();
        let width = depth_width_px.or((layout == Some(FolderLayout::Stray)).then_some(PHONE_WIDTH_PX.min(width_px)));
        let later_s = simulation.flaws().depth_later_s;
        let is_exact = !simulation.flaws().depth_errors().is_any();
        if width.is_none() && depth_beside_mm.is_none() && later_s == 0.0 && is_exact {
            return Ok(None);
        }
        let width = width.unwrap_or(width_px);
        let share = f64::from(width) / f64::from(width_px);
        let height = (share * f64::from(height_px)).round().max(1.0) as u32;
        let Some(beside_mm) = depth_beside_mm else {
            let geometry = simulation.geometry().resized(width, height);
            let track = simulation.track().clone();
            return Ok(Some(Self {
                lens: SimulatedLens::new(geometry.clone())?,
                track,
                geometry,
                beside_m: None,
                later_s,
            }));
        };
        let focal_px = DEPTH_FOCAL_FACTOR * share * simulation.options().focal_px;
        let geometry = Geometry::pinhole(width, height, focal_px);
        // Left is towards negative x of the frames' camera.
        let at_m = DVec3::new(-1e-3 * beside_mm, 0.0, 0.0);
        let moved = |pose: &Pose| Pose::new(pose.rotation, pose.translation_m - at_m);
        let poses = simulation.track().poses().iter().map(|(time_s, pose)| (*time_s, moved(pose))).collect();
        let track = PoseTrack::new(poses, f64::INFINITY)?;
        Ok(Some(Self { lens: SimulatedLens::new(geometry.clone())?, track, geometry, beside_m: Some(at_m), later_s }))
    }

    /// The error-free measurement for a frame. Only the depth of the picture is meaningful.
    pub fn exact(&self, simulation: &Simulation, frame: usize) -> SimulatedPicture {
        let snapshot = self.snapshot(simulation, frame);
        render::shoot(&simulation.site, &self.lens, &self.track, &snapshot, simulation.threads)
    }

    /// The measurement with errors, derived from an [`Self::exact`] picture; `None` if there are no
    /// errors.
    pub fn measured(
        &self,
        simulation: &Simulation,
        frame: usize,
        exact: &SimulatedPicture,
    ) -> Option<SimulatedPicture> {
        let (flaws, snapshot) = (simulation.flaws(), self.snapshot(simulation, frame));
        let errors = Some(flaws.depth_errors()).filter(DepthErrors::is_any)?;
        let sensor_picture = render::map_central_rays(&self.lens, &self.track, &snapshot, simulation.threads, |ray| {
            sensor_return(&simulation.site, ray, &errors, self.beside_m.is_some())
        });
        Some(SimulatedPicture {
            depth_m: measured(exact, &sensor_picture, &errors, flaws.seed, frame as u64),
            ..exact.clone()
        })
    }

    fn snapshot(&self, simulation: &Simulation, frame: usize) -> Snapshot {
        Snapshot {
            timestamp_s: simulation.timestamp_s(frame) + self.later_s,
            exposure_time_s: 0.0,
            samples: 1,
            aperture_diameter_m: 0.0,
            ..simulation.snapshot(frame)
        }
    }
}

/// Rotation from the site's axes (z up) to those of a phone's world (y up).
pub fn phone_from_site() -> DQuat {
    DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2)
}
