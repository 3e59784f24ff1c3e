//! Diagnoses why frames cannot be linked, from the middle frame and its neighbours.

use glam::DVec2;

use super::state::CameraState;
use crate::camera::Geometry;
use crate::fit::quantile::upper_median;
use crate::pixels::{DepthMap, Pixels};
use crate::recording::{Recording, RecordingError};
use crate::text::{fixed, number};

/// Pixel stride of the statistics along both axes.
const STRIDE_PX: u32 = 4;
/// Largest 8-bit code that counts as clipped to black, and smallest that counts as clipped to
/// white.
const BLACK_CODE: u8 = 2;
const WHITE_CODE: u8 = 253;
/// Largest clipped fraction of a picture with usable texture.
const MAX_CLIPPED_SHARE: f64 = 0.6;
/// Smallest standard deviation of a picture's brightness with usable texture, 8-bit codes.
const MIN_BRIGHTNESS_SIGMA: f64 = 3.0;
/// Smallest overlap of two pictures, as a fraction of the measured points.
const MIN_OVERLAP: f64 = 0.3;

/// Numbers of links.
pub struct LinkCounts {
    pub accepted: usize,
    pub tried: usize,
    pub required: usize,
}

/// The reason for which too few links were accepted. `apart`: distance of the linked frames. The
/// text has the median depth of the middle frame, by which a user can check its unit.
pub fn explain(
    recording: &Recording,
    geometry: &Geometry,
    states: &[Option<CameraState>],
    links: &LinkCounts,
    apart: usize,
) -> Result<String, RecordingError> {
    let middle = recording.frame_count() / 2;
    let LinkCounts { accepted, tried, required } = links;
    let message = format!("of {tried} links between frames {accepted} fit, and {required} are needed: ");
    let Some(frame) = recording.frames(middle..middle + 1)?.next().transpose()? else {
        return Ok(message + "there are no frames");
    };
    let percent = |share: f64| number((100.0 * share).round());
    let BrightnessStatistics { clipped_share: clipped, sigma } = brightness_statistics(&frame.pixels);
    if clipped > MAX_CLIPPED_SHARE {
        return Ok(
            message + &format!("{} % of the middle frame's pixels are clipped to white or black", percent(clipped))
        );
    }
    if sigma < MIN_BRIGHTNESS_SIGMA {
        let sigma = fixed(sigma, 1);
        return Ok(message + &format!("the middle frame lacks texture (its brightness varies by {sigma} of 255 codes)"));
    }
    let depths_m: Vec<f64> =
        frame.depth.iter().flat_map(|map| &map.depth_m).filter(|m| **m > 0.0).map(|m| f64::from(*m)).collect();
    let Some(depth) = frame.depth.as_ref().filter(|_| !depths_m.is_empty()) else {
        return Ok(message + "the middle frame has no depth");
    };
    let median_m = fixed(upper_median(depths_m).unwrap_or(0.0), 3);
    let unit = format!(
        "half of the middle frame's depth is beyond {median_m} m; if that is wrong, the depth unit is \
                        wrong"
    );
    let pair = states.get(middle).copied().flatten().zip(states.get(middle + apart).copied().flatten());
    let overlap = pair.and_then(|(here, there)| overlap(geometry, depth, &here, &there));
    Ok(match overlap.filter(|overlap| *overlap < MIN_OVERLAP) {
        Some(overlap) => format!(
            "{message}according to poses and depth, {} % of the middle frame is visible {apart} frames later, so the \
             pictures do not overlap; {unit}",
            percent(overlap)
        ),
        None => format!(
            "{message}according to poses and depth, the pictures overlap, so they lack texture, something large moves in \
             them, or poses or depth belong to another recording; {unit}"
        ),
    })
}

struct BrightnessStatistics {
    /// Fraction of the pixels that are clipped in all channels.
    clipped_share: f64,
    /// Standard deviation of the channels' mean, 8-bit codes.
    sigma: f64,
}

fn brightness_statistics(pixels: &Pixels) -> BrightnessStatistics {
    let (mut clipped, mut sum, mut squares, mut count) = (0.0, 0.0, 0.0, 0.0f64);
    for y in (0..pixels.height).step_by(STRIDE_PX as usize) {
        for x in (0..pixels.width).step_by(STRIDE_PX as usize) {
            let codes = pixels.eight_bits_at(x, y);
            let is_clipped =
                codes.iter().all(|code| *code >= WHITE_CODE) || codes.iter().all(|code| *code <= BLACK_CODE);
            let mean = codes.iter().map(|code| f64::from(*code)).sum::<f64>() / 3.0;
            (clipped, count) = (clipped + f64::from(u8::from(is_clipped)), count + 1.0);
            (sum, squares) = (sum + mean, squares + mean * mean);
        }
    }
    let count = count.max(1.0);
    BrightnessStatistics {
        clipped_share: clipped / count,
        sigma: (squares / count - (sum / count).powi(2)).max(0.0).sqrt(),
    }
}

/// Fraction of a frame's measured points that project into another frame. `None` without measured
/// points.
fn overlap(geometry: &Geometry, depth: &DepthMap, here: &CameraState, there: &CameraState) -> Option<f64> {
    let i = &geometry.intrinsics;
    let size = DVec2::new(i.width_px.into(), i.height_px.into());
    let there_from_here = there.world_from_camera.inverse() * here.world_from_camera;
    let (mut inside, mut count) = (0usize, 0usize);
    for y in (0..depth.height).step_by(STRIDE_PX as usize) {
        for x in (0..depth.width).step_by(STRIDE_PX as usize) {
            let z = f64::from(depth.depth_m[(y * depth.width + x) as usize]);
            let ray = geometry.depth_ray(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
            let Some(ray) = ray.filter(|_| z > 0.0) else { continue };
            let projected = geometry.project(there_from_here.transform_point3(z * ray));
            count += 1;
            inside += usize::from(projected.is_some_and(|at| at.cmpge(DVec2::ZERO).all() && at.cmplt(size).all()));
        }
    }
    (count > 0).then(|| inside as f64 / count as f64)
}
