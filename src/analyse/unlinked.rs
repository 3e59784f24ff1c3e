//! Why frames cannot be linked, as far as the one in the middle and its neighbours tell.

use glam::DVec2;

use super::robust::median;
use super::state::State;
use crate::camera::Geometry;
use crate::pixels::{DepthMap, Pixels};
use crate::recording::{Recording, RecordingError};
use crate::text::{fixed, number};

/// Every so many pixels are looked at, each way.
const EVERY: u32 = 4;
/// Codes of 8 bits that are clipped: these and those beyond.
const BLACK: u8 = 2;
const WHITE: u8 = 253;
/// A picture of which more is clipped, or whose brightness has a smaller standard deviation, codes, has nothing that could be found
/// again; in one of which less is seen from the frame beside it, too little is.
const MOST_CLIPPED: f64 = 0.6;
const LEAST_SIGMA: f64 = 3.0;
const LEAST_SHARED: f64 = 0.3;

/// Of so many links so many fit, and more are needed; `apart` frames lie between those that were linked. Half of the middle frame's
/// depth tells whether its unit can be right.
pub fn unlinked(
    recording: &Recording,
    geometry: &Geometry,
    states: &[Option<State>],
    (fit, tried, needed): (usize, usize, usize),
    apart: usize,
) -> Result<String, RecordingError> {
    let middle = recording.frame_count() / 2;
    let told = format!("of {tried} links between frames {fit} fit, and {needed} are needed: ");
    let Some(frame) = recording.frames(middle..middle + 1)?.next().transpose()? else {
        return Ok(told + "there is no frame");
    };
    let percent = |share: f64| number((100.0 * share).round());
    let (clipped, sigma) = looks(&frame.pixels);
    if clipped > MOST_CLIPPED {
        return Ok(told + &format!("{} % of the middle frame's pixels are clipped to white or black", percent(clipped)));
    }
    if sigma < LEAST_SIGMA {
        let sigma = fixed(sigma, 1);
        return Ok(told + &format!("the middle frame lacks texture (its brightness varies by {sigma} of 255 codes)"));
    }
    let mut known: Vec<f64> =
        frame.depth.iter().flat_map(|map| &map.depth_m).filter(|m| **m > 0.0).map(|m| f64::from(*m)).collect();
    let Some(depth) = frame.depth.as_ref().filter(|_| !known.is_empty()) else {
        return Ok(told + "the middle frame has no depth");
    };
    let usual = fixed(median(&mut known), 3);
    let unit = format!("half of the middle frame's depth is beyond {usual} m; if that is wrong, so is depth's unit");
    let beside = states.get(middle).copied().flatten().zip(states.get(middle + apart).copied().flatten());
    let shared = beside.and_then(|(here, there)| shared(geometry, depth, &here, &there));
    Ok(match shared.filter(|shared| *shared < LEAST_SHARED) {
        Some(shared) => format!(
            "{told}by poses and depth {} % of the middle frame is seen {apart} frames later, so the pictures do not overlap; {unit}",
            percent(shared)
        ),
        None => format!(
            "{told}by poses and depth the pictures overlap, so they lack texture, something large moves in them, or poses or depth are \
             another recording's; {unit}"
        ),
    })
}

/// The share of a picture that is clipped, and its brightness' standard deviation, codes of 8 bits.
fn looks(pixels: &Pixels) -> (f64, f64) {
    let (mut clipped, mut sum, mut squares, mut count) = (0.0, 0.0, 0.0, 0.0f64);
    for y in (0..pixels.height).step_by(EVERY as usize) {
        for x in (0..pixels.width).step_by(EVERY as usize) {
            let codes = pixels.eight_bits_at(x, y);
            let is_clipped = codes.iter().all(|code| *code >= WHITE) || codes.iter().all(|code| *code <= BLACK);
            let mean = codes.iter().map(|code| f64::from(*code)).sum::<f64>() / 3.0;
            (clipped, count) = (clipped + f64::from(u8::from(is_clipped)), count + 1.0);
            (sum, squares) = (sum + mean, squares + mean * mean);
        }
    }
    let count = count.max(1.0);
    (clipped / count, (squares / count - (sum / count).powi(2)).max(0.0).sqrt())
}

/// The share of a frame's measured points that another one's picture holds. `None` where nothing was measured.
fn shared(geometry: &Geometry, depth: &DepthMap, here: &State, there: &State) -> Option<f64> {
    let i = &geometry.intrinsics;
    let size = DVec2::new(i.width_px.into(), i.height_px.into());
    let there_from_here = there.world_from_camera.inverse() * here.world_from_camera;
    let (mut inside, mut count) = (0usize, 0usize);
    for y in (0..depth.height).step_by(EVERY as usize) {
        for x in (0..depth.width).step_by(EVERY as usize) {
            let z = f64::from(depth.depth_m[(y * depth.width + x) as usize]);
            let ray = geometry.depth_ray(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
            let Some(ray) = ray.filter(|_| z > 0.0) else { continue };
            let seen = geometry.project(there_from_here.transform_point3(z * ray));
            count += 1;
            inside += usize::from(seen.is_some_and(|at| at.cmpge(DVec2::ZERO).all() && at.cmplt(size).all()));
        }
    }
    (count > 0).then(|| inside as f64 / count as f64)
}
