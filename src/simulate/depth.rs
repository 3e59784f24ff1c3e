//! A depth sensor that is not the frames' camera: with fewer pixels, beside it with a lens of its own, at a moment of its own, or
//! with errors.

use glam::{DQuat, DVec3};

use super::depth_errors::DepthErrors;
use super::measured::measured;
use super::render::{self, Lens, Picture, Snapshot};
use super::returned::returned;
use super::{Layout, Options, SimulateError, Simulation};
use crate::camera::Geometry;
use crate::pose::Pose;
use crate::tracking::PoseTrack;

/// Width of a phone's depth pictures.
const PHONE_PX: u32 = 256;
/// How much wider a camera of its own sees, as a factor on its focal length.
const WIDER: f64 = 0.9;

/// Takes depth alone.
#[derive(Debug)]
pub struct DepthSensor {
    lens: Lens,
    track: PoseTrack,
    pub geometry: Geometry,
    /// Where it stands in the axes of the frames' camera, if it is a camera of its own, metres.
    pub beside_m: Option<DVec3>,
    /// How much later than a frame it measures, s.
    later_s: f64,
}

impl DepthSensor {
    /// `None` if the frames' own pixels have depth.
    pub fn new(simulation: &Simulation) -> Result<Option<Self>, SimulateError> {
        let Options { width_px, height_px, depth_width_px, depth_beside_mm, layout, .. } = *simulation.options();
        let width = depth_width_px.or((layout == Some(Layout::Stray)).then_some(PHONE_PX.min(width_px)));
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
            return Ok(Some(Self { lens: Lens::new(geometry.clone())?, track, geometry, beside_m: None, later_s }));
        };
        let focal_px = WIDER * share * simulation.options().focal_px;
        let geometry = Geometry::pinhole(width, height, focal_px);
        // To the left is where the frames' camera has negative x.
        let at_m = DVec3::new(-1e-3 * beside_mm, 0.0, 0.0);
        let moved = |pose: &Pose| Pose::new(pose.rotation, pose.translation_m - at_m);
        let poses = simulation.track().poses().iter().map(|(time_s, pose)| (*time_s, moved(pose))).collect();
        let track = PoseTrack::new(poses, f64::INFINITY)?;
        Ok(Some(Self { lens: Lens::new(geometry.clone())?, track, geometry, beside_m: Some(at_m), later_s }))
    }

    /// What it would measure with a frame, of which only the depth counts, if it had no errors.
    pub fn exact(&self, simulation: &Simulation, frame: usize) -> Picture {
        let snapshot = self.snapshot(simulation, frame);
        render::shoot(&simulation.site, &self.lens, &self.track, &snapshot, simulation.threads)
    }

    /// What it measures in place of an [`Self::exact`] picture; `None` if it has no errors.
    pub fn measured(&self, simulation: &Simulation, frame: usize, exact: &Picture) -> Option<Picture> {
        let (flaws, snapshot) = (simulation.flaws(), self.snapshot(simulation, frame));
        let errors = Some(flaws.depth_errors()).filter(DepthErrors::is_any)?;
        let seen = render::by_rays(&self.lens, &self.track, &snapshot, simulation.threads, |ray| {
            returned(&simulation.site, ray, &errors, self.beside_m.is_some())
        });
        Some(Picture { depth_m: measured(exact, &seen, &errors, flaws.seed, frame as u64), ..exact.clone() })
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

/// Takes the site's axes (z up) to those of a phone's world (y up).
pub fn phone_from_site() -> DQuat {
    DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2)
}
