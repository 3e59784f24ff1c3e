//! The light of the room by the recording itself: what was seen of it around the place that was looked at, and lamps that were
//! not seen, by how they light what was.
//!
//! Frames' points with measured depth make a panorama ([`panorama`]) and surfaces ([`voxels`]). Lamps, the light from around and
//! above and the surfaces' reflectances follow from how bright the surfaces are ([`search`], [`lit`]), with a factor that the
//! whitest things tell ([`white`]). Unseen directions of the panorama get the light from around, above the horizon that from
//! above besides: a surface then shows a + b(1 + n_z)/2 by them. After Debevec 1998 and Weber & Cipolla 2001, in spirit.
//!
//! Not modelled: windows and other lights with an extent, lamps whose light is coloured by shades, light that changes.

mod blocked;
mod found;
mod gather;
mod given;
mod lit;
#[cfg(test)]
mod lit_room;
mod panorama;
mod quantile;
mod sample;
mod search;
mod solved;
mod surfaces;
mod voxels;
mod white;

use glam::DVec3;

pub use found::{FoundLamp, RoomLight};
pub use gather::Known;
pub use given::Given;
pub use lit::MOST_LAMPS;
pub use panorama::{HEIGHT, WIDTH};
pub use white::WHITE;

use super::registered::RegistrationError;
use super::times::{self, Times};
use crate::scene::upright;
use panorama::{Seen, Splat, direction, seen_share, upward};
use solved::{Solved, solve};
use voxels::Voxels;

/// Surfaces that are looked at, at most.
const MOST: usize = 60_000;
/// A lamp is cut out of the panorama so far around it, cosine of 8°, where it is brighter than this multiple of what is around.
const CUT: f64 = 0.990;
const BRIGHTER: f32 = 3.0;
/// Fewer frames see too little of how a room is lit: of ten simulated sites two of them told 0.61 to 0.91 of the light, twelve 0.82 to
/// 1.28. So far the factors lie farther apart, each way.
const FEW: usize = 8;
const LOOSE_BY_FEW: f64 = 1.5;

/// Or why nothing can be said. `given`: lamps that a person has seen, in place of those that are sought.
pub fn of_recording(
    known: &Known<'_>,
    given: Option<&Given<'_>>,
    times: &mut Times,
) -> Result<Result<RoomLight, String>, RegistrationError> {
    if !known.recording.has_depth() {
        return Ok(Err("no depth was measured".to_owned()));
    }
    if known.eye.geometry.sees_around() {
        return Ok(Err("the picture does not fit a plane in front of the camera".to_owned()));
    }
    let Some(middle) = known.middle()? else {
        return Ok(Err("no frame with a pose has depth".to_owned()));
    };
    let map_from_world = upright(known.up).conjugate();
    let (mut voxels, mut splat) = (Voxels::default(), Splat::new(middle.as_vec3(), map_from_world));
    known.each(times, &mut |samples, eye, half| {
        voxels.add(samples, eye, half);
        splat.add(samples);
    })?;
    Ok(times.of(times::LIGHT, || {
        let solid: Vec<DVec3> = voxels.solid().collect();
        let (chosen, threads) = (voxels.chosen(MOST), known.threads);
        let solved = match given {
            Some(given) => given::solve(&chosen, &solid, middle, known.up, threads, given),
            None => solve(&chosen, &solid, middle, known.up, threads),
        }?;
        Ok(room_light(known, middle, &splat.finish(), solved))
    }))
}

fn room_light(known: &Known<'_>, middle: DVec3, seen: &Seen, solved: Solved) -> RoomLight {
    let up = known.up;
    let map_from_world = upright(up).conjugate();
    let unseen = |n: usize| {
        let above = f64::from(u8::from(direction(n).y > 0.0));
        [0, 1, 2].map(|c| (solved.around[c] + above * solved.above[c]) as f32)
    };
    let towards: Vec<DVec3> =
        solved.lamps.iter().map(|lamp| map_from_world * (lamp.at - middle).normalize_or_zero()).collect();
    let is_lamp = |n: usize, light: [f32; 3]| {
        let dark = unseen(n);
        towards.iter().any(|to| to.dot(direction(n)) > CUT) && (0..3).any(|c| light[c] > BRIGHTER * dark[c])
    };
    let texel = |(n, seen): (usize, &Option<[f32; 3]>)| seen.filter(|light| !is_lamp(n, *light)).unwrap_or(unseen(n));
    let rgb: Vec<[f32; 3]> = seen.iter().enumerate().map(texel).collect();
    let lamps: Vec<FoundLamp> = solved
        .lamps
        .iter()
        .zip(&solved.shown_at_1_m)
        .map(|(lamp, shown)| FoundLamp { at_m: lamp.at.to_array(), shown_at_1_m: *shown })
        .collect();
    let by_map = upward(&rgb);
    let shown = |lamp: &FoundLamp, c: usize| {
        let to = DVec3::from(lamp.at_m) - middle;
        lamp.shown_at_1_m[c] * up.dot(to).max(0.0) / to.length().powi(3).max(1e-6)
    };
    let upward = [0, 1, 2].map(|c| by_map[c] + lamps.iter().map(|lamp| shown(lamp, c)).sum::<f64>());
    let (seen_share, seen_above_share) = seen_share(seen);
    let [low, high] = solved.between;
    let loose = if known.states.iter().flatten().count() < FEW { LOOSE_BY_FEW } else { 1.0 };
    RoomLight {
        middle_m: middle.to_array(),
        up: up.to_array(),
        is_up_guessed: known.recording.up.is_none(),
        seen_share,
        seen_above_share,
        panorama: rgb,
        lamps,
        around: solved.around,
        above: solved.above,
        upward,
        between: [low / loose, high * loose],
        explained: solved.explained,
        halves_explain: solved.halves.map(|halves| halves.explained),
        halves_deg: solved.halves.map(|halves| halves.apart_deg),
        no_lamp: solved.no_lamp,
    }
}
