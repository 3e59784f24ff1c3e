//! The light of the room by the recording itself: how bright matt white is at a place, what was
//! seen around it, and lamps that were not seen, by how they light what was.
//!
//! Frames' points with measured depth make surfaces ([`voxels`]) and a panorama ([`panorama`])
//! around a point in free space ([`free_space`]) over the largest support ([`support`]). Lamps and
//! their shares of the light follow from how bright the surfaces are ([`lamp_search`],
//! [`lamp_fit`]). The white level scales all of it ([`mod@white_level`]), or says why it cannot be
//! claimed; then the light is even, as bright as the camera's exposure says ([`exposure`]). Unseen
//! directions of the panorama are filled so that it gives the white level ([`fill`]). After Debevec
//! 1998 and Weber & Cipolla 2001, in spirit.
//!
//! Not modelled: windows and other lights with an extent, lamps whose light is coloured by shades,
//! light that changes, another white level at another place.

mod bounce;
mod exposure;
mod fill;
mod free_space;
mod gather;
mod known_lamps;
mod lamp_fit;
mod lamp_search;
mod lamp_solution;
mod occupancy;
mod panorama;
mod room_light;
mod sample;
mod support;
mod surfaces;
#[cfg(test)]
mod test_room;
mod up_direction;
mod voxels;
mod white_level;

use glam::DVec3;

pub use gather::{CoarseDepth, LightInputs};
pub use known_lamps::KnownLamps;
pub use lamp_fit::MAX_LAMPS;
pub use panorama::{HEIGHT, WIDTH};
pub use room_light::{ASSUMED_LAMP_DIAMETER_M, LampEstimate, RoomLight};
pub use voxels::{Voxel, Voxels};
pub use white_level::WHITE_REFLECTANCE;

use super::registration_result::RegistrationError;
use super::times::{self, Times};
use crate::scene::world_from_panorama;
use exposure::{ExposureLevel, MeteredFrame, exposure_level};
use gather::FrameSamples;
use lamp_solution::{LampSolution, LampVerdict, PlaceLight, solve};
use panorama::{PanoramaBuilder, PartialPanorama, direction, seen_share};
use sample::relative_luminance;
use white_level::{Patch, WhiteLevel, patches, white_level, white_level_by_lamps};

/// Surfaces by which lamps are sought, at most.
const MOST: usize = 60_000;
/// A lamp is cut out of the panorama so far around it, cosine of 8°, where it is brighter than this
/// multiple of even light.
const CUT: f64 = 0.990;
const BRIGHTER: f32 = 3.0;
/// Fewer frames see too little of how a room is lit: the interval is wider by a factor, each way.
const FEW: usize = 8;
const LOOSE_BY_FEW: f64 = 1.5;

/// Or why nothing can be said. `given`: lamps that a person has seen, in place of those that are
/// sought.
pub fn of_recording(
    inputs: &LightInputs<'_>,
    given: Option<&KnownLamps<'_>>,
    times: &mut Times,
) -> Result<Result<RoomLight, String>, RegistrationError> {
    if !inputs.recording.has_depth() {
        return Ok(Err("no depth was measured".to_owned()));
    }
    if inputs.model.geometry.sees_around() {
        return Ok(Err("the picture does not fit a plane in front of the camera".to_owned()));
    }
    let (views, survey) = inputs.survey(times)?;
    // An analysis keeps the up that it found.
    let is_guess = inputs.recording.up.is_none() && given.is_none();
    let up = if is_guess { up_direction::refined_up(&survey, inputs.up) } else { inputs.up };
    let Some(place) = times.of(times::LIGHT, || place(&views, &survey, up)) else {
        return Ok(Err("no frame with a pose has depth that shows surfaces".to_owned()));
    };
    drop(views);
    let centre = free_space::centre(&survey, up, place);
    let map_from_world = world_from_panorama(up).conjugate();
    let (mut voxels, mut panorama) = (Voxels::default(), PanoramaBuilder::new(centre.as_vec3(), map_from_world));
    let mut metered = Vec::new();
    inputs.every(times, &mut |seen| {
        voxels.add(&seen.samples, seen.camera_at, seen.half);
        panorama.add(&seen.samples);
        metered.push(MeteredFrame::of(&seen, place));
    })?;
    Ok(times.of(times::LIGHT, || {
        let solid: Vec<DVec3> = voxels.solid().collect();
        let all = voxels.surfaces(2, inputs.threads);
        let (chosen, threads) = (&all[..all.len().min(MOST)], inputs.threads);
        let solved = match given {
            Some(given) => known_lamps::solve(chosen, &solid, up, threads, given)?,
            None => solve(chosen, &solid, place, up, threads),
        };
        let exposure = exposure_level(&metered);
        let (solved, level) = levelled(solved, given.is_some(), &all, (place, up), &exposure);
        let at = Location { place, centre, up, is_guess: inputs.recording.up.is_none() };
        let mut light = room_light(&at, &panorama.finish(), &solved, &level);
        if metered.len() < FEW {
            light.between = [light.between[0] / LOOSE_BY_FEW, light.between[1] * LOOSE_BY_FEW];
        }
        Ok(light)
    }))
}

/// The largest support at which a white level can be claimed, or else the largest.
fn place(views: &[FrameSamples], survey: &[Voxel], up: DVec3) -> Option<DVec3> {
    let patches: Vec<Patch> = survey.iter().map(|voxel| Patch::of(voxel, 1.0)).collect();
    let is_claimed = |place: &DVec3| {
        let metered: Vec<MeteredFrame> = views.iter().map(|view| MeteredFrame::of(view, *place)).collect();
        white_level(&patches, up, *place, &exposure_level(&metered)).unclaimed.is_none()
    };
    let places = support::places(survey, up);
    places.iter().copied().find(is_claimed).or(places.first().copied())
}

/// Where the light is known.
struct Location {
    /// On the support, and the panorama's centre over it.
    place: DVec3,
    centre: DVec3,
    up: DVec3,
    is_guess: bool,
}

/// The white level with lamps, or without them where it contradicts them and nobody has seen them.
fn levelled(
    solved: LampSolution,
    are_seen: bool,
    voxels: &[Voxel],
    (place, up): (DVec3, DVec3),
    exposure: &ExposureLevel,
) -> (LampSolution, WhiteLevel) {
    let patches = |solved: &LampSolution| patches(voxels, |voxel| solved.relative(voxel.at, voxel.normal, place));
    if solved.lamps.is_empty() {
        let level = white_level(&patches(&solved), up, place, exposure);
        return (solved, level);
    }
    if let Some(level) = white_level_by_lamps(&patches(&solved), up, place, exposure) {
        return (solved, level);
    }
    let why = "white as bright as it implies contradicts the camera's exposure".to_owned();
    let without = LampSolution::without_lamps(LampVerdict { no_lamp: Some(why), ..solved.verdict.clone() }, up);
    let level = white_level(&patches(&without), up, place, exposure);
    (if are_seen { solved } else { without }, level)
}

fn room_light(at: &Location, seen: &PartialPanorama, solved: &LampSolution, level: &WhiteLevel) -> RoomLight {
    let map_from_world = world_from_panorama(at.up).conjugate();
    let PlaceLight { ambient, lamps } = solved.at(at.place, level.white);
    let even = fill::even(ambient);
    let towards: Vec<DVec3> =
        lamps.iter().map(|lamp| map_from_world * (DVec3::from(lamp.at_m) - at.centre).normalize_or_zero()).collect();
    let is_lamp = |n: usize, light: &[f32; 3]| {
        towards.iter().any(|to| to.dot(direction(n)) > CUT) && (0..3).any(|c| light[c] > BRIGHTER * even[n][c])
    };
    let without_lamps: PartialPanorama =
        seen.iter().enumerate().map(|(n, light)| light.filter(|light| !is_lamp(n, light))).collect();
    let (seen_share, seen_above_share) = seen_share(seen);
    let luminance = relative_luminance(level.white);
    let between = level.between.map(|end| end / luminance);
    let by_lamps = [0, 1, 2].map(|c| (level.white[c] - ambient[c]).max(0.0));
    let filled = fill::filled(&without_lamps, ambient, by_lamps, between);
    let (panorama, no_panorama) = match (level.unclaimed, filled) {
        (Some(_), _) => (even, None),
        (None, Ok(panorama)) => (panorama, None),
        (None, Err(why)) => (even, Some(why)),
    };
    RoomLight {
        place_m: at.place.to_array(),
        middle_m: at.centre.to_array(),
        up: at.up.to_array(),
        is_up_guessed: at.is_guess,
        seen_share,
        seen_above_share,
        panorama,
        no_panorama,
        lamps,
        white_level: level.white,
        between,
        unclaimed: level.unclaimed.map(|why| why.to_string()),
        explained: solved.verdict.explained,
        halves_explain: solved.verdict.halves.map(|halves| halves.explained),
        halves_deg: solved.verdict.halves.map(|halves| halves.apart_deg),
        no_lamp: solved.verdict.no_lamp.clone(),
    }
}
