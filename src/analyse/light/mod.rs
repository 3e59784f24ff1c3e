//! Estimates the room's light from the recording: the white level at a place, a panorama around it,
//! and lamps outside the pictures, by their light on visible surfaces.
//!
//! Frames' points with measured depth make surfaces ([`voxels`]) and a panorama ([`panorama`])
//! around a point in free space ([`free_space`]) over the largest support ([`support`]). Positions
//! and brightness of lamps follow from the light of the surfaces ([`lamp_search`], [`lamp_fit`]).
//! The white level scales all of it ([`mod@white_level`]). If it cannot be claimed, the light is
//! even and follows the camera's exposure ([`exposure`]). Unseen directions of the panorama are
//! filled so that it has the white level ([`fill`]). After Debevec 1998 and Weber & Cipolla 2001,
//! in spirit.
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
use panorama::{PanoramaBuilder, PartialPanorama, coverage, direction};
use sample::relative_luminance;
use white_level::{Patch, WhiteLevel, patches, white_level, white_level_by_lamps};

/// Largest number of surfaces in the lamp search.
const MAX_SURFACES: usize = 60_000;
/// Lamps are removed from the panorama: cosine of the radius, 8°, and smallest brightness by even
/// light.
const LAMP_RADIUS_COS: f64 = 0.990;
const MIN_LAMP_BRIGHTNESS: f32 = 3.0;
/// Minimum number of frames for the usual interval of the white level. With fewer frames it is
/// wider by a factor, each way.
const MIN_FRAMES: usize = 8;
const SPARSE_FRAMES_INTERVAL_RATIO: f64 = 1.5;

/// The room's light, or the reason for which it is unknown. Lamps that a user marked
/// (`known_lamps`) replace the lamp search.
pub fn of_recording(
    inputs: &LightInputs<'_>,
    known_lamps: Option<&KnownLamps<'_>>,
    times: &mut Times,
) -> Result<Result<RoomLight, String>, RegistrationError> {
    if !inputs.recording.has_depth() {
        return Ok(Err("no depth was measured".to_owned()));
    }
    if inputs.model.geometry.needs_cube_map() {
        return Ok(Err("the picture does not fit a plane in front of the camera".to_owned()));
    }
    let (views, survey) = inputs.survey(times)?;
    // With marked lamps up is that of an earlier analysis.
    let is_guess = inputs.recording.up.is_none() && known_lamps.is_none();
    let up = if is_guess { up_direction::refined_up(&survey, inputs.up) } else { inputs.up };
    let Some(place) = times.of(times::LIGHT, || place(&views, &survey, up)) else {
        return Ok(Err("no frame with a pose has depth that shows surfaces".to_owned()));
    };
    drop(views);
    let centre = free_space::centre(&survey, up, place);
    let map_from_world = world_from_panorama(up).conjugate();
    let (mut voxels, mut panorama) = (Voxels::default(), PanoramaBuilder::new(centre.as_vec3(), map_from_world));
    let mut metered = Vec::new();
    inputs.every(times, &mut |view| {
        voxels.add(&view.samples, view.camera_at, view.half);
        panorama.add(&view.samples);
        metered.push(MeteredFrame::of(&view, place));
    })?;
    Ok(times.of(times::LIGHT, || {
        let solid: Vec<DVec3> = voxels.solid().collect();
        let all = voxels.surfaces(2, inputs.threads);
        let (chosen, threads) = (&all[..all.len().min(MAX_SURFACES)], inputs.threads);
        let solved = match known_lamps {
            Some(known_lamps) => known_lamps::solve(chosen, &solid, up, threads, known_lamps)?,
            None => solve(chosen, &solid, place, up, threads),
        };
        let exposure = exposure_level(&metered);
        let (solved, level) = levelled(solved, known_lamps.is_some(), &all, (place, up), &exposure);
        let at = Location { place, centre, up, is_guess: inputs.recording.up.is_none() };
        let mut light = room_light(&at, &panorama.finish(), &solved, &level);
        if metered.len() < MIN_FRAMES {
            light.between =
                [light.between[0] / SPARSE_FRAMES_INTERVAL_RATIO, light.between[1] * SPARSE_FRAMES_INTERVAL_RATIO];
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

/// The place at which the light is estimated.
struct Location {
    /// Position on the support.
    place: DVec3,
    /// The panorama's centre, over the place.
    centre: DVec3,
    up: DVec3,
    /// Whether up was estimated.
    is_guess: bool,
}

/// The white level with lamps. Without them if it contradicts them and they are not marked by a
/// user.
fn levelled(
    solved: LampSolution,
    are_seen: bool,
    voxels: &[Voxel],
    (place, up): (DVec3, DVec3),
    exposure: &ExposureLevel,
) -> (LampSolution, WhiteLevel) {
    let patches =
        |solved: &LampSolution| patches(voxels, |voxel| solved.relative(voxel.position_m, voxel.normal, place));
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

fn room_light(at: &Location, partial: &PartialPanorama, solved: &LampSolution, level: &WhiteLevel) -> RoomLight {
    let map_from_world = world_from_panorama(at.up).conjugate();
    let PlaceLight { ambient, lamps } = solved.at(at.place, level.white);
    let even = fill::even(ambient);
    let towards: Vec<DVec3> =
        lamps.iter().map(|lamp| map_from_world * (DVec3::from(lamp.at_m) - at.centre).normalize_or_zero()).collect();
    let is_lamp = |n: usize, light: &[f32; 3]| {
        towards.iter().any(|to| to.dot(direction(n)) > LAMP_RADIUS_COS)
            && (0..3).any(|c| light[c] > MIN_LAMP_BRIGHTNESS * even[n][c])
    };
    let without_lamps: PartialPanorama =
        partial.iter().enumerate().map(|(n, light)| light.filter(|light| !is_lamp(n, light))).collect();
    let (coverage, coverage_above) = coverage(partial);
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
        coverage,
        coverage_above,
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
