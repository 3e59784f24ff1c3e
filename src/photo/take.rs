//! Takes a photograph in tiles, so that only its pixels grow in memory with its size.

use std::borrow::Cow;

use crate::camera::{Camera, Capture, FilmOverride, Geometry, Opening, SummedExposure};
use crate::compositor::{Compositor, Job, RealDepth, Settings, SubmitError, Target};
use crate::depth::{DepthGrid, FAR_M, Rays, Surfaces, snap_to_planes};
use crate::effects::depth_of_field::MAX_CIRCLE_PX;
use crate::frame::{Frame, FrameExposure};
use crate::gpu::GpuError;
use crate::pixels::{Codes, Pixels, Rect, eight_bits};
use crate::tracking::PoseTrack;

use super::occlusion::seen_in;
use super::{Framing, RealPart};

/// Side of a tile, px: multisampled colour and depth take 48 bytes per pixel, 113 MB.
const TILE_PX: i32 = 1536;
/// Side of a tile including the margin for blur.
const MAX_DRAWN_TILE_PX: i32 = 1500;
const MIN_TILE_PX: i32 = 512;

/// Viewpoint and time of the photograph.
#[derive(Clone, Copy, Debug)]
pub struct Standpoint<'a> {
    /// The calibrated camera.
    pub camera: &'a Camera,
    pub settings: &'a Settings,
    /// The recording's geometry.
    pub recorded: &'a Geometry,
    pub track: &'a PoseTrack,
    /// Seconds to the next frame.
    pub interval_s: f64,
    pub frame: usize,
    pub timestamp_s: f64,
    /// The recording's frames summed in the real part. Empty if there is only one.
    pub summed: &'a [SummedExposure],
    /// The frame's exposure as recorded.
    pub exposure: FrameExposure,
    /// Opacity of the virtual layer in the frame.
    pub opacity: f64,
    /// The recorded picture's depth at the frame's time, metres, row by row, 0 where unknown. It
    /// occludes virtual objects, and determines the real part's depth of field.
    pub depth_m: Option<&'a [f32]>,
    /// Depth for occlusion in each of the summed frames
    /// ([`SummedFrameOcclusion`](super::SummedFrameOcclusion)), with its time in seconds relative
    /// to the frame's. If empty, `depth_m` is used.
    pub summed_occlusion: &'a [(f64, DepthGrid)],
}

/// Exposure of the photograph.
#[derive(Clone, Copy, Debug)]
pub struct PhotoExposure {
    /// `None` for a pinhole.
    pub opening: Option<Opening>,
    /// Duration of motion blur, seconds.
    pub time_s: f64,
    /// Exposure relative to the recording, stops.
    pub over_ev: f64,
    /// ISO speed relative to the speed at which the recording's noise was measured.
    pub iso_ratio: f64,
}

/// Why the composite of a photograph was not finished.
#[derive(Debug, thiserror::Error)]
pub enum TakeError {
    #[error(transparent)]
    Submit(#[from] SubmitError),
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// Cancelled by the caller.
    #[error("cancelled")]
    Cancelled,
}

/// The finished photograph.
#[derive(Clone, Debug)]
pub struct Photograph {
    /// 8 bits.
    pub pixels: Pixels,
    /// True if any object is in front of the camera.
    pub shows_objects: bool,
}

/// Composites the compositor's scene into the real part and exposes both. `report_progress`
/// receives the finished share; if it returns `false`, the work ends.
pub fn take(
    compositor: &mut Compositor,
    standpoint: &Standpoint<'_>,
    framing: &Framing,
    real: RealPart,
    exposed: &PhotoExposure,
    mut report_progress: impl FnMut(f64) -> bool,
) -> Result<Photograph, TakeError> {
    let (width, height) = framing.size();
    let alone = SummedExposure { time_s: 0.0, exposure_s: exposed.time_s, weight: 1.0 };
    let capture = Capture {
        region: Rect::full(width, height),
        whole: true,
        exposure_time_s: exposed.time_s,
        opening: exposed.opening,
        summed: if standpoint.summed.is_empty() { vec![alone] } else { standpoint.summed.to_vec() },
        over_ev: exposed.over_ev,
        noise_left: real.noise_left,
        film: Some(FilmOverride { speed: exposed.iso_ratio, width_mm: framing.film.width_mm() }),
        recorded: standpoint.recorded.clone(),
        framed: framing.framed,
        enlargement: framing.enlargement(),
    };
    let mut pixels = real.pixels;
    // The largest visible circle of confusion follows from the measured depths alone.
    let measured_m = standpoint.depth_m;
    let nearest_m = measured_m.into_iter().flatten().copied().filter(|z| *z > 0.0).fold(f32::INFINITY, f32::min);
    let largest_circle_px = exposed.opening.map_or(0.0, |opening| {
        let circle = |z: f64| opening.circle_px(framing.geometry.intrinsics.fx_px, z).abs();
        circle(f64::from(nearest_m)).max(circle(f64::INFINITY))
    });
    let is_measured = measured_m.is_some();
    let depth_m = real_depth_m(compositor, standpoint);
    let grid = depth_m.as_deref().filter(|_| largest_circle_px > 0.0 || standpoint.settings.depth.occlusion).and_then(
        |depth_m| {
            let recorded = &standpoint.recorded.intrinsics;
            let depth = (depth_m, is_measured);
            DepthGrid::new(&pixels, recorded, depth, &framing.framed, &standpoint.camera.response)
        },
    );
    let reach_px = 0.5 * largest_circle_px.min(f64::from(width.max(height)) / 4.0).min(f64::from(MAX_CIRCLE_PX));
    let surfaces =
        grid.as_ref().filter(|_| largest_circle_px > 0.0 && is_measured).map(|grid| Surfaces::new(grid, reach_px));
    let tile_px = match &surfaces {
        Some(_) => (MAX_DRAWN_TILE_PX - (2.5 * reach_px) as i32 - 64).clamp(MIN_TILE_PX, TILE_PX),
        None => TILE_PX,
    };
    let mut out = vec![0u8; 3 * width as usize * height as usize];
    let tiles = tiles(width, height, tile_px);
    let mut shows_objects = false;
    for (n, &region) in tiles.iter().enumerate() {
        let mut report_progress = |share: f64| report_progress((n as f64 + share) / tiles.len() as f64);
        if !report_progress(0.0) {
            return Err(TakeError::Cancelled);
        }
        let before = copied(&pixels, region);
        let frame = Frame {
            exposure: standpoint.exposure,
            opacity: standpoint.opacity,
            ..Frame::new(standpoint.frame, standpoint.timestamp_s + framing.later_s, pixels)
        };
        let job = Job {
            frame,
            picture: &framing.geometry,
            capture: Capture { region, ..capture.clone() },
            real: RealDepth::Known {
                grid: grid.as_ref(),
                surfaces: surfaces.as_ref(),
                moments: standpoint.summed_occlusion,
            },
            track: standpoint.track,
            interval_s: standpoint.interval_s,
            want_layer: false,
        };
        let pending = compositor.submit(job, standpoint.camera, standpoint.settings, Target::Pixels)?;
        let mut is_wanted = true;
        compositor.await_parts(&pending, |share| is_wanted &= report_progress(share))?;
        if !is_wanted {
            return Err(TakeError::Cancelled);
        }
        let composited = compositor.collect(pending)?;
        shows_objects |= composited.stats.objects_in_sight;
        pixels = composited.pixels;
        develop(&mut pixels, before, region, &mut out);
    }
    Ok(Photograph { pixels: Pixels::uncoded(width, height, Codes::U8(out)), shows_objects })
}

/// The recorded picture's depth at the frame's time, with the objects' support planes and proxies.
fn real_depth_m<'a>(compositor: &Compositor, standpoint: &Standpoint<'a>) -> Option<Cow<'a, [f32]>> {
    let size = &standpoint.recorded.intrinsics;
    let whole = Rect::full(size.width_px, size.height_px);
    let (track, time_s) = (standpoint.track, standpoint.timestamp_s);
    let mut depth_m = standpoint.depth_m.map(Cow::from);
    let planes = compositor.support_planes();
    if let (Some(measured_m), Ok(pose), false) = (&mut depth_m, track.at(time_s), planes.is_empty()) {
        snap_to_planes(measured_m.to_mut(), &Rays::new(standpoint.recorded), &pose, whole, &planes);
    }
    let proxies = compositor.proxies();
    if !proxies.is_empty() {
        let far = || Cow::from(vec![FAR_M; size.width_px as usize * size.height_px as usize]);
        let all_m = depth_m.get_or_insert_with(far).to_mut();
        proxies.rasterize(all_m, whole, |point| seen_in(standpoint.recorded, track, time_s, point));
    }
    depth_m
}

/// Index ranges of the rows in a picture's codes.
fn rows(width: u32, region: Rect) -> impl Iterator<Item = std::ops::Range<usize>> {
    let place = move |x: i32, y: i32| 3 * (y as usize * width as usize + x as usize);
    (region.y0..region.y1).map(move |y| place(region.x0, y)..place(region.x1, y))
}

fn copied(pixels: &Pixels, region: Rect) -> Codes {
    let rows = rows(pixels.width, region);
    match &pixels.codes {
        Codes::U8(c) => Codes::U8(rows.flat_map(|row| c[row].iter().copied()).collect()),
        Codes::U16(c) => Codes::U16(rows.flat_map(|row| c[row].iter().copied()).collect()),
    }
}

/// Copies a finished region out of the picture, in 8 bits, and restores the pixels there, because
/// the neighbouring tiles' blur reads them.
fn develop(pixels: &mut Pixels, before: Codes, region: Rect, out: &mut [u8]) {
    let columns = 3 * region.width() as usize;
    for (n, row) in rows(pixels.width, region).enumerate() {
        let put_back = n * columns..(n + 1) * columns;
        match (&mut pixels.codes, &before) {
            (Codes::U16(codes), Codes::U16(before)) => {
                let eight = codes[row.clone()].iter().copied().map(eight_bits);
                out[row.clone()].iter_mut().zip(eight).for_each(|(out, code)| *out = code);
                codes[row].copy_from_slice(&before[put_back]);
            }
            (Codes::U8(codes), Codes::U8(before)) => {
                out[row.clone()].copy_from_slice(&codes[row.clone()]);
                codes[row].copy_from_slice(&before[put_back]);
            }
            _ => {}
        }
    }
}

fn tiles(width: u32, height: u32, most_px: i32) -> Vec<Rect> {
    // The tiles are as equal as possible.
    let cuts = |side: u32| {
        let count = (side as i32 + most_px - 1) / most_px;
        (0..=count).map(move |n| (i64::from(side) * i64::from(n) / i64::from(count.max(1))) as i32)
    };
    let (columns, rows): (Vec<i32>, Vec<i32>) = (cuts(width).collect(), cuts(height).collect());
    let of_row = |y: &[i32]| columns.windows(2).map(|x| Rect::new(x[0], y[0], x[1], y[1])).collect::<Vec<_>>();
    rows.windows(2).flat_map(of_row).collect()
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
    fn developed_region_is_8_bit_and_the_rest_is_restored() {
        let recorded: Vec<u16> = (0..3 * 4 * 2).collect();
        let region = Rect::new(1, 0, 3, 2);
        let mut pixels = Pixels::uncoded(4, 2, Codes::U16(recorded.clone()));
        let before = copied(&pixels, region);
        pixels.codes = Codes::U16((0..24).map(|c| c * 257).collect());
        let mut out = vec![0; 24];
        develop(&mut pixels, before, region, &mut out);
        let expected: Vec<u8> = (0..24).map(|i| if (1..3).contains(&(i / 3 % 4)) { i } else { 0 }).collect();
        assert_eq!(out, expected);
        let Codes::U16(codes) = pixels.codes else { panic!("16 bits stay") };
        assert!((0..24).all(|i| (codes[i] == recorded[i]) == ((1..3).contains(&(i / 3 % 4)) || i == 0)));
    }
}
