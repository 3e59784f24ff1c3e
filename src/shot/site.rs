//! The scan of a scene in a recording.

use std::ops::{ControlFlow, Range};
use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::unit::unit_m;
use super::{FramePoint, Shot, ShotError, SurfaceError};
use crate::camera::{Geometry, Intrinsics};
use crate::frame::Frame;
use crate::grey_image::GreyImage;
use crate::pose::Pose;
use crate::recording::Recording;
use crate::scene::{Scene, SceneError, SitePlacement, read_scan};
use crate::site::alignment::RayPair;
use crate::site::refinement::{self, NoRefinement, PosePrior, SiteRefinement, SiteView};
use crate::site::{ScannedSite, SiteScan};
use crate::tracking::PoseTrack;

/// Frames that a refinement reads.
const REFINEMENT_FRAMES: usize = 24;
/// Frames in which the coverage by a scan is tested, and the reduction of their pictures.
const COVERAGE_FRAMES: usize = 5;
const COVERAGE_REDUCTION: u32 = 8;
/// Partners of each frame.
const PARTNERS: usize = 3;
/// Least distance between the cameras of a pair, m.
const MIN_BASELINE_M: f64 = 0.05;
/// Largest angle between the cameras of a pair, rad.
const MAX_PAIR_ANGLE_RAD: f64 = 0.5;

impl Shot {
    /// Gives the recording the scan of a scene without the scene itself, for an analysis.
    pub fn set_site_of(&mut self, scene: &Scene) -> Result<(), ShotError> {
        let recording = Arc::make_mut(&mut self.recording);
        recording.rescale(unit_m(scene, self.opened_unit_m));
        // Frames without measured depth of a recording that has some are left out of an analysis.
        if !recording.has_measured_depth() {
            set_site_of(recording, scene, None)?;
        }
        Arc::make_mut(&mut self.recorded).set_site(recording.site().cloned());
        self.register_depth();
        Ok(())
    }

    /// A live frame with the depth of the scan. Frames of files get theirs when they are read.
    pub(crate) fn with_live_depth(&self, frame: Frame, geometry: &Geometry, track: &PoseTrack) -> Frame {
        let Some(site) = self.recording.site().filter(|_| self.recording.is_live() && frame.depth.is_none()) else {
            return frame;
        };
        let depth = site.depth_at_time(geometry, track, frame.timestamp_s).ok().map(Arc::new);
        Frame { depth, ..frame }
    }

    /// A pair for the alignment of a scan: a position in a frame, and the point of the scan there,
    /// m.
    pub fn ray_pair(&self, view: &FramePoint, point_m: DVec3) -> Result<RayPair, SurfaceError> {
        let camera = self.posed_camera(view.frame)?;
        let Intrinsics { width_px: width, height_px: height, .. } = camera.geometry().intrinsics;
        let size = DVec2::new(f64::from(width), f64::from(height));
        if !(view.at_px.cmpge(DVec2::ZERO).all() && view.at_px.cmple(size).all()) {
            return Err(SurfaceError::Outside { at_px: view.at_px.to_array(), width, height });
        }
        let no_ray = || SurfaceError::NoRay { at_px: view.at_px.to_array() };
        let ray = camera.ray(view.at_px).ok_or_else(no_ray)?;
        let beside = camera.ray(view.at_px + DVec2::X).ok_or_else(no_ray)?;
        let px_per_rad = ray.direction.angle_between(beside.direction).recip();
        Ok(RayPair { point_m, origin_m: ray.origin_m, direction: ray.direction, px_per_rad })
    }

    /// Fraction of the picture that a scan covers, the largest of a few frames of a range; `None`
    /// if none has a pose and a camera.
    pub fn site_coverage(&self, site: &ScannedSite, range: Range<usize>) -> Option<f64> {
        let stride = range.len().div_ceil(COVERAGE_FRAMES).max(1);
        let covered = |frame: usize| {
            let pose = self.recording.pose_at_frame(frame).ok()?;
            let camera = self.known_geometry_at(frame)?;
            let Intrinsics { width_px, height_px, .. } = camera.intrinsics;
            let small = camera.resized((width_px / COVERAGE_REDUCTION).max(1), (height_px / COVERAGE_REDUCTION).max(1));
            let map = site.depth(&small, |_| pose, 0.0);
            let surface_px = map.depth_m.iter().filter(|z| **z > 0.0).count();
            Some(surface_px as f64 / map.depth_m.len().max(1) as f64)
        };
        range.step_by(stride).filter_map(covered).reduce(f64::max)
    }

    /// Refines the pose of a scan by the brightness of its surface in the frames. `on_progress` is
    /// called with a fraction, and cancels by [`ControlFlow::Break`].
    pub fn refined_site(
        &self,
        site: &ScannedSite,
        prior: PosePrior,
        on_progress: &mut dyn FnMut(f64) -> ControlFlow<()>,
    ) -> Result<Result<SiteRefinement, NoRefinement>, ShotError> {
        let recording = &self.recording;
        let posed: Vec<usize> =
            (0..recording.frame_count()).filter(|frame| recording.pose_at_frame(*frame).is_ok()).collect();
        let stride = posed.len().div_ceil(REFINEMENT_FRAMES).max(1);
        let mut views = Vec::new();
        for frame in posed.into_iter().step_by(stride) {
            if on_progress(0.0).is_break() {
                return Ok(Err(NoRefinement::Cancelled));
            }
            let camera = self.geometry_at(frame)?;
            let picture = recording.without_depth().frames(frame..frame + 1)?.next();
            let (Some(picture), Ok(camera_from_world)) = (picture, recording.pose_at_frame(frame)) else { continue };
            views.push(SiteView { luma: GreyImage::luma_601(&picture?.pixels), camera, camera_from_world });
        }
        Ok(refinement::refined(site, &views, &view_pairs(&views), prior, on_progress))
    }

    /// Applies the scene's scan to the recording, if it changed. A scan that cannot be read is a
    /// note.
    pub(super) fn follow_site(&mut self) {
        if self.has_site_of_scene() {
            return;
        }
        // A scan that an undone step restores is not read again.
        self.last_scan = self.recording.site().map(|site| Arc::clone(&site.scan)).or(self.last_scan.take());
        let last_scan = self.last_scan.as_ref();
        let recording = Arc::make_mut(&mut self.recording);
        self.site_problem = set_site_of(recording, &self.scene, last_scan).err().map(|error| error.to_string());
        if self.site_problem.is_some() {
            recording.set_site(None);
        }
        // This recording stays in the world of the recorded poses.
        let mut recorded = self.recorded.as_ref().clone();
        recorded.rescale(self.recording.metres_per_unit);
        recorded.set_site(self.recording.site().cloned());
        let site = set_site_of(&mut recorded, &self.scene, None).ok().and_then(|()| recorded.site().cloned());
        Arc::make_mut(&mut self.recorded).set_site(site);
        self.register_depth();
        self.room = Arc::default();
    }

    /// True if the recording has the scan of the scene, with the same pose.
    fn has_site_of_scene(&self) -> bool {
        match (self.recording.site(), &self.scene.site) {
            (Some(site), Some(placement)) => {
                site.scan.is_of(&placement.scan, placement.metres_per_unit)
                    && site.world_from_scan == placement.world_from_scan
            }
            (site, placement) => site.is_none() && placement.is_none(),
        }
    }
}

/// Each view with the next ones from other positions that look the same way.
fn view_pairs(views: &[SiteView]) -> Vec<(usize, usize)> {
    let mut pairs = Vec::new();
    for (n, view) in views.iter().enumerate() {
        let is_partner = |other: &SiteView| {
            let [a, b] = [view, other].map(|view| &view.camera_from_world);
            let baseline_m = a.position_in_world_m().distance(b.position_in_world_m());
            baseline_m > MIN_BASELINE_M && a.rotation.angle_between(b.rotation) < MAX_PAIR_ANGLE_RAD
        };
        let partners = (n + 1..views.len()).filter(|other| is_partner(&views[*other]));
        pairs.extend(partners.take(PARTNERS).map(|other| (n, other)));
    }
    pairs
}

/// Gives a recording the scan of a scene, in the recording's world. A scan that the recording has
/// already, and `last_scan`, are not read again.
pub fn set_site_of(
    recording: &mut Recording,
    scene: &Scene,
    last_scan: Option<&Arc<SiteScan>>,
) -> Result<(), SceneError> {
    let Some(SitePlacement { scan, metres_per_unit, world_from_scan }) = &scene.site else {
        recording.set_site(None);
        return Ok(());
    };
    let mut present = recording.site().map(|site| &site.scan).into_iter().chain(last_scan);
    let scan = match present.find(|present| present.is_of(scan, *metres_per_unit)) {
        Some(present) => Arc::clone(present),
        None => Arc::new(read_scan(scan, *metres_per_unit)?),
    };
    let world_from_scan = *world_from_scan;
    // world_from_gauge takes the scene's world to the recording's.
    let correction = world_from_gauge(recording, scene).unwrap_or(Pose::IDENTITY);
    let back = Pose::new(correction.rotation.conjugate(), correction.inverse_transform_point(DVec3::ZERO));
    recording.set_site(Some(ScannedSite::new(scan, world_from_scan).in_world(&back)));
    Ok(())
}

/// The transform from the world of a scene's gauge to the recording's; `None` if they are the same.
pub fn world_from_gauge(recording: &Recording, scene: &Scene) -> Option<Pose> {
    scene.gauge.and_then(|gauge| recording.correction_to_gauge(gauge.frame, gauge.time_s, &gauge.pose()?))
}
