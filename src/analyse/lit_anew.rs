//! The light of a room once more, with lamps at which a person pointed.
//!
//! An analysis keeps no surfaces. So they are looked at again, by its poses, gains and clocks, as they were for it; what takes time
//! there, the search for lamps, falls away.

use glam::DVec3;

use super::artefact::Analysis;
use super::eye::Eye;
use super::found_light::{Environment, FoundLight};
use super::light::{Given, Known, of_recording};
use super::registered::{RegistrationError, recorded};
use super::times::Times;
use crate::camera::Response;
use crate::recording::Recording;

/// In place of what was found: its light with lamps at these places, world axes, m, and its panorama; or why nothing can be said.
/// `recording` follows the analysis already.
pub fn lit_anew(
    recording: &Recording,
    response: &Response,
    analysis: &Analysis,
    seen: &[DVec3],
    threads: usize,
) -> Result<Result<(FoundLight, Environment), String>, RegistrationError> {
    let was = analysis.findings.light.as_ref();
    let Some(up) = was.and_then(|light| DVec3::from(light.up?).try_normalize()) else {
        return Ok(Err("nothing was found of the room's light".to_owned()));
    };
    let eye = Eye::new(analysis.findings.camera.clone());
    let found: Vec<DVec3> = was
        .iter()
        .flat_map(|light| &light.lamps)
        .filter(|lamp| !lamp.is_bounce())
        .map(|lamp| lamp.at_m.into())
        .collect();
    // Maps of a recording that follows refined poses say their time themselves.
    let later_s = if analysis.track.is_some() { 0.0 } else { analysis.findings.registration.depth_later_s };
    let known = Known {
        recording,
        eye: &eye,
        response,
        states: &recorded(recording, 0.0),
        later_s,
        gains: &analysis.gains,
        up,
        threads,
    };
    let given = Given { seen, found: &found };
    let light = of_recording(&known, Some(&given), &mut Times::default())?;
    let Ok(panorama) = light.as_ref().map(|light| Environment::of(&light.panorama)) else {
        return Ok(Err(light.err().unwrap_or_default()));
    };
    let around = panorama.ok_or_else(|| "its panorama cannot be written".to_owned());
    Ok(around.map(|around| (FoundLight::of(&light, Some(&around)), around)))
}
