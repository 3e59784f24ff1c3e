//! A photograph, tile by tile, so that memory does not grow with its size but for its pixels.

use crate::camera::{Geometry, Opening};
use crate::compositor::{Compositor, Job, Part, SubmitError, seen_at_frame};
use crate::effects::Photograph;
use crate::frame::{Frame, FrameExposure};
use crate::gpu::GpuError;
use crate::image::{Codes, DepthMap, Pixels, Rect};
use crate::tracking::PoseTrack;

use super::{Framing, Real, surfaces};

/// Side of a tile, px: multisampled colour and geometry take 64 bytes a pixel, 150 MB.
const TILE_PX: i32 = 1536;
/// Of a tile with all that is blurred into it, and of the least tile.
const DRAWN_PX: i32 = 1900;
const LEAST_TILE_PX: i32 = 512;

/// Where and when it is taken.
#[derive(Clone, Copy, Debug)]
pub struct Site<'a> {
    /// The recording's camera.
    pub recorded: &'a Geometry,
    pub track: &'a PoseTrack,
    pub time_offset_s: f64,
    /// To the next frame, seconds.
    pub interval_s: f64,
    pub frame: usize,
    pub timestamp_s: f64,
    /// What the recording says of the frame's exposure.
    pub exposure: FrameExposure,
    /// What hides virtual things, and what the real part's depth of field goes by.
    pub depth: Option<&'a DepthMap>,
}

/// How it is exposed.
#[derive(Clone, Copy, Debug)]
pub struct Exposed {
    /// None for a pinhole.
    pub opening: Option<Opening>,
    /// How long what moves is blurred, seconds.
    pub time_s: f64,
    /// Stops brighter than the recording.
    pub over_ev: f64,
    /// Film speed over that at which the recording's noise was measured.
    pub iso_ratio: f64,
}

#[derive(Debug, thiserror::Error)]
pub enum TakeError {
    #[error(transparent)]
    Submit(#[from] SubmitError),
    #[error(transparent)]
    Gpu(#[from] GpuError),
}

/// Puts the compositor's scene into the real part, which is exposed already. 8 bits.
pub fn take(
    compositor: &mut Compositor,
    site: &Site<'_>,
    framing: &Framing,
    real: Real,
    exposed: &Exposed,
) -> Result<Pixels, TakeError> {
    let (width, height) = framing.size();
    let photograph = Photograph {
        over_ev: exposed.over_ev,
        iso_ratio: exposed.iso_ratio,
        film_width_mm: framing.film.width_mm(),
        enlargement: framing.enlargement(),
        noise_left: real.noise_left,
    };
    let seen = |depth| seen_at_frame(site.recorded, depth, site.track, site.time_offset_s, site.timestamp_s);
    let depth_m = site.depth.and_then(seen);
    let mut pixels = real.pixels;
    // For how far circles can be seen to reach it takes no more than the depths that were measured.
    let least_m = depth_m.iter().flatten().copied().filter(|z| *z > 0.0).fold(f32::INFINITY, f32::min);
    let circles_px = exposed.opening.map_or(0.0, |opening| {
        let circle = |z: f64| opening.circle_px(framing.geometry.intrinsics.fx_px, z).abs();
        circle(f64::from(least_m)).max(circle(f64::INFINITY))
    });
    let blurred = depth_m.as_deref().filter(|_| circles_px > 0.0);
    let reach_px = 0.5 * circles_px.min(f64::from(width.max(height)) / 4.0);
    let surfaces = blurred.and_then(|depth_m| {
        surfaces::made(&pixels, &site.recorded.intrinsics, depth_m, framing, compositor.response(), reach_px)
    });
    let tile_px = match &surfaces {
        Some(_) => (DRAWN_PX - (2.5 * reach_px) as i32 - 64).clamp(LEAST_TILE_PX, TILE_PX),
        None => TILE_PX,
    };
    for region in tiles(width, height, tile_px) {
        let frame = Frame {
            index: site.frame,
            timestamp_s: site.timestamp_s,
            pixels,
            depth: None,
            exposure: site.exposure,
        };
        let part = Part {
            region,
            photograph,
            opening: exposed.opening,
            exposure_time_s: exposed.time_s,
            recorded: site.recorded,
            framed: framing.framed,
            depth_m: depth_m.as_deref(),
            surfaces: surfaces.as_ref(),
        };
        let pending = compositor.submit(Job {
            frame,
            geometry: &framing.geometry,
            track: site.track,
            time_offset_s: site.time_offset_s,
            interval_s: site.interval_s,
            want_layer: false,
            photograph: Some(part),
        })?;
        pixels = compositor.collect(pending)?.pixels;
    }
    Ok(in_8_bits(pixels))
}

fn tiles(width: u32, height: u32, most_px: i32) -> Vec<Rect> {
    // As equal as they can be.
    let cuts = |side: u32| {
        let count = (side as i32 + most_px - 1) / most_px;
        (0..=count).map(move |n| (i64::from(side) * i64::from(n) / i64::from(count.max(1))) as i32)
    };
    let (columns, rows): (Vec<i32>, Vec<i32>) = (cuts(width).collect(), cuts(height).collect());
    let of_row = |y: &[i32]| columns.windows(2).map(|x| Rect::new(x[0], y[0], x[1], y[1])).collect::<Vec<_>>();
    rows.windows(2).flat_map(of_row).collect()
}

fn in_8_bits(pixels: Pixels) -> Pixels {
    let codes = match pixels.codes {
        Codes::U16(codes) => codes.into_iter().map(|code| ((u32::from(code) + 128) / 257) as u8).collect(),
        Codes::U8(codes) => codes,
    };
    Pixels { codes: Codes::U8(codes), ..pixels }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_each_pixel_once() {
        for (width, height) in [(16, 16), (1536, 1537), (6000, 4000)] {
            let tiles = tiles(width, height, TILE_PX);
            let area: u64 = tiles.iter().map(|t| u64::from(t.width()) * u64::from(t.height())).sum();
            assert_eq!(area, u64::from(width) * u64::from(height));
            let all = tiles.iter().fold(Rect::new(0, 0, 0, 0), |all, tile| all.union(tile));
            assert_eq!(all, Rect::full(width, height));
            assert!(tiles.iter().all(|t| t.width() <= TILE_PX as u32 && t.height() <= TILE_PX as u32));
        }
    }

    #[test]
    fn codes_of_8_bits_come_back() {
        let codes: Vec<u16> = (0..=255).map(|c| c * 257).collect();
        let pixels = in_8_bits(Pixels { width: 256, height: 1, codes: Codes::U16(codes) });
        assert_eq!(pixels.codes, Codes::U8((0..=255).collect()));
    }
}
