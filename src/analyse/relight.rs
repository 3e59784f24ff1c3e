//! Estimates the light of a room again, with lamps that a user marked.
//!
//! An analysis stores no surfaces, so they are gathered again by its poses, gains and clocks. The
//! search for lamps, which takes most of the time, is not needed.

use glam::DVec3;

use super::artefact::Analysis;
use super::camera_model::CameraModel;
use super::light::{KnownLamps, LightInputs, of_recording};
use super::light_findings::{EnvironmentFit, LightFindings};
use super::registration_result::{RegistrationError, recorded};
use super::times::Times;
use crate::camera::Response;
use crate::recording::Recording;

/// The light with lamps at the positions `marked`, world axes, m, and its panorama; or the reason
/// for which it is unknown. The analysis must be applied to `recording`.
pub fn relight(
    recording: &Recording,
    response: &Response,
    analysis: &Analysis,
    marked: &[DVec3],
    threads: usize,
) -> Result<Result<(LightFindings, EnvironmentFit), String>, RegistrationError> {
    let was = analysis.findings.light.as_ref();
    let Some(up) = was.and_then(|light| DVec3::from(light.up?).try_normalize()) else {
        return Ok(Err("nothing was found of the room's light".to_owned()));
    };
    let model = CameraModel::new(analysis.findings.camera.clone());
    let lamps: Vec<DVec3> = was
        .iter()
        .flat_map(|light| &light.lamps)
        .filter(|lamp| !lamp.is_bounce())
        .map(|lamp| lamp.at_m.into())
        .collect();
    // A recording with refined poses applies the offset of depth's clock itself.
    let later_s = if analysis.track.is_some() { 0.0 } else { analysis.findings.registration.depth_later_s };
    let inputs = LightInputs {
        recording,
        model: &model,
        response,
        states: &recorded(recording, 0.0),
        later_s,
        gains: &analysis.gains,
        up,
        threads,
    };
    let known_lamps = KnownLamps { marked, estimated: &lamps };
    let light = of_recording(&inputs, Some(&known_lamps), &mut Times::default())?;
    let Ok(panorama) = light.as_ref().map(|light| EnvironmentFit::of(&light.panorama)) else {
        return Ok(Err(light.err().unwrap_or_default()));
    };
    let around = panorama.ok_or_else(|| "its panorama cannot be written".to_owned());
    Ok(around.map(|around| (LightFindings::of(&light, Some(&around)), around)))
}
