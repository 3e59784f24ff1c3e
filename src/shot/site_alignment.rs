//! The place of a scan in a scene, by picked pairs of points: steps of `locard site` and of the
//! window.

use std::sync::Arc;

use glam::DVec3;

use super::{FramePoint, Shot, SurfaceError};
use crate::pose::Pose;
use crate::scene::document::Up;
use crate::scene::{SceneFile, SiteTable};
use crate::site::alignment::{Alignment, AlignmentError, AlignmentOptions, RayPair};
use crate::site::refinement::PosePrior;
use crate::site::{ScannedSite, SiteScan};
use crate::text::count;

/// Smallest fraction of a picture that a scan in its place covers.
const MIN_COVERAGE: f64 = 0.01;

/// A position in a frame, and the point of the scan there, in the scan's unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PickedPair {
    pub view: FramePoint,
    pub point: DVec3,
}

/// The place of a scan by pairs.
#[derive(Clone, Debug)]
pub struct SiteByPairs {
    pub world_from_scan: Pose,
    /// Factor on the recording's unit, if the scale was to be found.
    pub unit_factor: Option<f64>,
    pub prior: PosePrior,
    pub alignment: Alignment,
}

/// Why pairs give no place.
#[derive(Debug, thiserror::Error)]
pub enum PairAlignmentError {
    #[error(transparent)]
    Pair(#[from] SurfaceError),
    #[error(transparent)]
    Alignment(#[from] AlignmentError),
}

/// Why a scan gives no length of the recording's unit.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SiteScaleError {
    #[error("a {0} recording is in metres")]
    Metric(String),
    #[error("the scene's objects were placed with another unit; use a new scene file")]
    PlacedObjects,
}

impl std::fmt::Display for SiteByPairs {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Alignment { errors_px, sigma_m, sigma_rad, sigma_scale, .. } = &self.alignment;
        let pairs = count(errors_px.len(), "pair");
        write!(f, "within {:.0} mm and {:.2}° (1 σ), by {pairs}", 1e3 * sigma_m, sigma_rad.to_degrees())?;
        match self.unit_factor {
            Some(_) => write!(f, "; the unit within {:.1} %", 100.0 * sigma_scale),
            None => Ok(()),
        }
    }
}

impl Shot {
    /// The place of a scan by pairs, and the length of the recording's unit if `finds_scale`.
    pub fn site_by_pairs(
        &self,
        scan: &SiteScan,
        pairs: &[PickedPair],
        finds_scale: bool,
    ) -> Result<SiteByPairs, PairAlignmentError> {
        let rays = pairs.iter().map(|pair| self.ray_pair(&pair.view, pair.point * scan.metres_per_unit));
        let rays: Vec<RayPair> = rays.collect::<Result<_, _>>()?;
        let ups = scan.up.zip(self.up()).map(|(scan, world)| [scan, world]);
        let alignment = Alignment::of_pairs(&rays, &AlignmentOptions { ups, finds_scale })?;
        let transform = alignment.world_from_scan;
        // Positions in the world grow with its unit.
        let world_from_scan = Pose::new(transform.rotation, transform.translation_m / transform.scale);
        let sigma_m = alignment.sigma_m / transform.scale;
        let center = rays.iter().map(|ray| ray.point_m).sum::<DVec3>() / rays.len() as f64;
        let center_m = Some(world_from_scan.transform_point(center));
        let prior = PosePrior { sigma_m: sigma_m.max(1e-3), sigma_rad: alignment.sigma_rad.max(1e-3), center_m };
        let unit_factor = finds_scale.then(|| transform.scale.recip());
        Ok(SiteByPairs { world_from_scan, unit_factor, prior, alignment })
    }

    /// Sets the length of the recording's unit by a scan, here and in the scene file. Returns it,
    /// m.
    pub fn set_unit_of_site(&mut self, scene: &mut SceneFile, unit_factor: f64) -> Result<f64, SiteScaleError> {
        if self.recording.kind.is_metric() {
            return Err(SiteScaleError::Metric(self.recording.kind.to_string()));
        }
        if !scene.objects.is_empty() {
            return Err(SiteScaleError::PlacedObjects);
        }
        let unit_m = unit_factor * self.recording.metres_per_unit;
        scene.metres_per_unit = Some(unit_m);
        scene.gauge = None;
        Arc::make_mut(&mut self.recording).rescale(unit_m);
        Ok(unit_m)
    }

    /// Advice if hardly any frame shows a scan.
    pub fn site_doubt(&self, site: &ScannedSite) -> Option<&'static str> {
        let coverage = self.site_coverage(site, 0..self.recording.frame_count());
        coverage.is_some_and(|covered| covered < MIN_COVERAGE).then_some(
            "hardly any frame shows the scan: check the pairs, and its unit (--scan-unit 0.001 for millimetres)",
        )
    }

    /// Writes the place of a scan into a scene file, with the world in which it is given, and the
    /// scan's up if the scene has none. `scan`: the file, relative to the scene file. Returns an up
    /// that was written.
    pub fn put_site(
        &self,
        scene: &mut SceneFile,
        site: &ScannedSite,
        scan: String,
        metres_per_unit: Option<f64>,
        gauge_frame: Option<usize>,
    ) -> Option<[f64; 3]> {
        let pose = site.world_from_scan;
        scene.site = Some(SiteTable {
            scan,
            metres_per_unit,
            position_m: Some(pose.translation_m.to_array()),
            quaternion: Some(pose.rotation.to_array()),
        });
        if scene.gauge.is_none() {
            let posed = || (0..self.recording.frame_count()).find(|frame| self.recording.pose_at_frame(*frame).is_ok());
            scene.gauge = gauge_frame.or_else(posed).and_then(|frame| self.gauge(frame));
        }
        let (None, None, Some(up)) = (scene.up, self.recording.up, site.scan.up) else { return None };
        let up = (pose.rotation * up).to_array();
        scene.up = Some(Up::Direction(up));
        Some(up)
    }

    /// Keeps a scan that was read, so that a scene that names it does not read it again.
    pub fn keep_scan(&mut self, scan: Arc<SiteScan>) {
        self.last_scan = Some(scan);
    }
}
