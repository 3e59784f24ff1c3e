//! Corrections of the recorded poses by the refined ones, frame by frame.

use glam::{DAffine3, DVec2, DVec3};

use super::ReportSource;
use super::rolling_camera::RollingCamera;
use crate::fit::quantile::upper_median;
use crate::fit::twist;
use crate::pose::Pose;
use crate::recording::RecordingError;

/// Correction of a frame: recorded_from_refined, in the recorded camera's axes (right, down,
/// forward).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Correction {
    pub frame: usize,
    pub turn_deg: DVec3,
    pub way_mm: DVec3,
    /// Displacement of points at `depth_m` in the picture, mean over it, px.
    pub picture_px: f64,
}

/// The corrections of all frames with both poses. `depth_m`: typical depth.
pub fn corrections(source: &ReportSource<'_>, depth_m: f64) -> Vec<Correction> {
    let Some(refined) = refined(source) else { return Vec::new() };
    let recorded = recorded(source);
    let frame_correction = |(frame, time_s): (usize, &f64)| {
        let (was, now) = (recorded.pose(*time_s)?, refined.pose(*time_s)?);
        Some(correction(frame, source, &was, &now, depth_m))
    };
    source.recording.timestamps_s.iter().enumerate().filter_map(frame_correction).collect()
}

pub fn recorded<'a>(source: &ReportSource<'a>) -> RollingCamera<'a> {
    RollingCamera { track: &source.recording.track, geometry: source.camera }
}

/// `None` if the recorded poses were kept.
pub fn refined<'a>(source: &ReportSource<'a>) -> Option<RollingCamera<'a>> {
    let track = source.analysis.refined()?;
    Some(RollingCamera { track, geometry: &source.analysis.findings.camera })
}

fn correction(frame: usize, source: &ReportSource<'_>, was: &Pose, now: &Pose, depth_m: f64) -> Correction {
    let world_from_camera = |pose: &Pose| {
        DAffine3::from_rotation_translation(pose.world_from_camera_rotation(), pose.position_in_world_m())
    };
    let by = world_from_camera(was).inverse() * world_from_camera(now);
    let turn = twist::rotation_vector(&twist::log(&by));
    let size = DVec2::new(source.camera.intrinsics.width_px.into(), source.camera.intrinsics.height_px.into());
    let places = (0..9).map(|n| size * DVec2::new(f64::from(n % 3) + 0.5, f64::from(n / 3) + 0.5) / 3.0);
    let moved = |at: DVec2| {
        let there = by.transform_point3(source.camera.unproject(at)? * depth_m);
        Some((source.camera.project(there)? - at).length())
    };
    let moved: Vec<f64> = places.filter_map(moved).collect();
    Correction {
        frame,
        turn_deg: DVec3::from_array(turn.to_array().map(f64::to_degrees)),
        way_mm: 1e3 * by.translation,
        picture_px: moved.iter().sum::<f64>() / moved.len().max(1) as f64,
    }
}

/// The median depth of the recording's middle frame, m; `None` without depth.
pub fn usual_depth_m(source: &ReportSource<'_>) -> Result<Option<f64>, RecordingError> {
    let middle = source.recording.frame_count() / 2;
    let Some(frame) = source.recording.frames(middle..middle + 1)?.next().transpose()? else { return Ok(None) };
    let depths_m = frame.depth.iter().flat_map(|map| &map.depth_m).copied().filter(|z| *z > 0.0);
    Ok(upper_median(depths_m).map(f64::from))
}
