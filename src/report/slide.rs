//! Slide of virtual objects over later frames: a frame's picture on its own depth, reprojected by
//! the poses into a later frame, against the real picture of that frame.
//!
//! Each pixel with depth is projected by the poses, row by row, and splatted to the four pixels
//! around with a depth test. Patches of the result are compared with the real picture by phase
//! correlation, which is robust against brightness and blur. Each reprojection begins at a real
//! picture, so errors from frame to frame do not accumulate.

use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::correction::{recorded, refined};
use super::rolling_camera::RollingCamera;
use super::strips::lacking;
use super::{ReportError, ReportSource};
use crate::depth::reprojected_at_frame;
use crate::fit::quantile::upper_median;
use crate::frame::Frame;
use crate::grey_image::GreyImage;
use crate::interpolation::bilinear_weights;
use crate::measure::displacement::{DisplacementOptions, displacements};
use crate::parallel::{over_rows, processors};
use crate::pose::Pose;

/// Distances to the later frames, frames.
pub const LATER: [usize; 4] = [5, 10, 20, 40];
/// Number of start frames, and the picture size above which there are two, px.
const START_FRAMES: usize = 6;
const LARGE_PICTURE_PX: usize = 1 << 20;
/// Side of a patch, much larger than the slides, px.
const PATCH_PX: usize = 64;
/// Smallest number of patches in a pair.
const MIN_PATCHES: usize = 4;
/// Relative tolerance of the depth test.
const DEPTH_TEST_TOLERANCE: f32 = 0.03;
/// Smallest splat weight of a valid pixel.
const MIN_SPLAT_WEIGHT: f64 = 0.25;

/// Lengths of the patches' slides between two frames, px.
#[derive(Clone, Debug, PartialEq)]
pub struct SlidePair {
    pub from: usize,
    pub later: usize,
    pub recorded_px: Vec<f64>,
    /// Slide by the refined poses; `None` where there are none.
    pub refined_px: Option<Vec<f64>>,
}

impl SlidePair {
    pub fn recorded_median_px(&self) -> Option<f64> {
        upper_median(self.recorded_px.iter().copied())
    }

    pub fn refined_median_px(&self) -> Option<f64> {
        upper_median(self.refined_px.iter().flatten().copied())
    }
}

/// Number of pairs that got worse by more than 0.1 px, number of all pairs, and the largest
/// increase, px. `None` without refined poses.
pub fn worse(slid: &[SlidePair]) -> Option<(usize, usize, f64)> {
    const MORE_PX: f64 = 0.1;
    let more = |slid: &SlidePair| Some(slid.refined_median_px()? - slid.recorded_median_px()?);
    let all: Vec<f64> = slid.iter().filter_map(more).collect();
    let largest = all.iter().copied().fold(0.0, f64::max);
    (!all.is_empty()).then(|| (all.iter().filter(|px| **px > MORE_PX).count(), all.len(), largest))
}

/// Slides from frames spread over the recording, or the reason for which there are none.
pub fn slides(source: &ReportSource<'_>) -> Result<Result<Vec<SlidePair>, &'static str>, ReportError> {
    if let Some(why) = lacking(source) {
        return Ok(Err(why));
    }
    let recording = source.recording;
    let count = recording.frame_count();
    let pixels = recording.width as usize * recording.height as usize;
    let starts = if pixels > LARGE_PICTURE_PX { 2 } else { START_FRAMES };
    let mut from: Vec<usize> = (0..starts).map(|k| k * count / starts).collect();
    from.dedup();
    let rays = rays(source);
    let mut slid = Vec::new();
    for start in from {
        let Some(first) = recording.frames(start..start + 1)?.next().transpose()? else { continue };
        let seen_by: Vec<FramePoints> = [Some(recorded(source)), refined(source)]
            .into_iter()
            .flatten()
            .enumerate()
            .filter_map(|(n, camera)| FramePoints::new(source, &first, &rays, camera, n > 0))
            .collect();
        let offsets: Vec<usize> = LATER.into_iter().filter(|later| start + later < count).collect();
        let mut tasks = Vec::new();
        for later in offsets {
            if let Some(frame) = recording.frames(start + later..start + later + 1)?.next().transpose()? {
                tasks.extend((0..seen_by.len()).map(|camera| ((frame.clone(), later, camera), Ok(Vec::new()))));
            }
        }
        over_rows(&mut tasks, 1, processors(), |_, slot| {
            let ((frame, _, camera), lengths) = &mut slot[0];
            *lengths = seen_by[*camera].slide_lengths(frame);
        });
        for ((_, later, camera), lengths) in tasks {
            let lengths_px = lengths?;
            match camera {
                0 => slid.push(SlidePair { from: start, later, recorded_px: lengths_px, refined_px: None }),
                _ => {
                    if let Some(pair) = slid.iter_mut().rfind(|pair| (pair.from, pair.later) == (start, later)) {
                        pair.refined_px = Some(lengths_px);
                    }
                }
            }
        }
    }
    // Pairs without a measurement by one of the tracks cannot be compared.
    slid.retain(|pair| !pair.recorded_px.is_empty() && pair.refined_px.as_ref().is_none_or(|px| !px.is_empty()));
    if slid.is_empty() { Ok(Err("no textured surface is seen again")) } else { Ok(Ok(slid)) }
}

/// Rays of unit depth, one per pixel; `None` where a pixel has none.
fn rays(source: &ReportSource<'_>) -> Vec<Option<DVec3>> {
    let (width, height) = (source.recording.width, source.recording.height);
    let places = (0..height).flat_map(|y| (0..width).map(move |x| DVec2::new(f64::from(x), f64::from(y)) + 0.5));
    places.map(|at| source.camera.unproject(at)).collect()
}

/// World points of a frame's pixels, by one track.
struct FramePoints<'a> {
    camera: RollingCamera<'a>,
    grey: GreyImage<f64>,
    /// One per pixel.
    points: Vec<Option<DVec3>>,
}

impl<'a> FramePoints<'a> {
    fn new(
        source: &ReportSource<'a>,
        frame: &Frame,
        rays: &[Option<DVec3>],
        camera: RollingCamera<'a>,
        is_refined: bool,
    ) -> Option<Self> {
        let mut map = frame.depth.clone()?;
        if is_refined {
            Arc::make_mut(&mut map).timestamp_s += source.analysis.findings.registration.depth_later_s;
        }
        let depth = reprojected_at_frame(camera.geometry, &map, camera.track, frame.timestamp_s)?;
        let poses = camera.rows(frame.timestamp_s)?;
        let width = frame.pixels.width as usize;
        let point = |(i, z): (usize, &f32)| {
            let ray = rays.get(i).copied().flatten().filter(|_| *z > 0.0)?;
            Some(poses.get(i / width)?.inverse_transform_point(ray * f64::from(*z)))
        };
        let points = depth.iter().enumerate().map(point).collect();
        Some(Self { camera, grey: GreyImage::luma_709(&frame.pixels), points })
    }

    /// Lengths of the patches' slides in another frame, px; empty for too few patches.
    fn slide_lengths(&self, frame: &Frame) -> Result<Vec<f64>, ReportError> {
        let Some(poses) = self.camera.rows(frame.timestamp_s) else { return Ok(Vec::new()) };
        let (made, mask) = self.reproject(&poses);
        let options = DisplacementOptions { patch_px: PATCH_PX, step_px: PATCH_PX / 2, ..Default::default() };
        let patches = displacements(&GreyImage::luma_709(&frame.pixels), &made, Some(&mask), &options)?.patches;
        if patches.len() < MIN_PATCHES {
            return Ok(Vec::new());
        }
        Ok(patches.iter().map(|patch| patch.displacement_px[0].hypot(patch.displacement_px[1])).collect())
    }

    /// The picture reprojected by the poses of a frame's rows, and the mask of its valid pixels.
    fn reproject(&self, poses: &[Pose]) -> (GreyImage<f64>, Vec<bool>) {
        let (width, height) = (self.grey.width, self.grey.height);
        let shares = |at: DVec2| {
            let (x, y) = ((at.x - 0.5).floor(), (at.y - 0.5).floor());
            let (fx, fy) = (at.x - 0.5 - x, at.y - 0.5 - y);
            let corners = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)];
            let pixel_and_share = move |((dx, dy), share): ((f64, f64), f64)| {
                let (x, y) = (x + dx, y + dy);
                let is_inside = x >= 0.0 && y >= 0.0 && x < width as f64 && y < height as f64;
                is_inside.then(|| (y as usize * width + x as usize, share))
            };
            corners.into_iter().zip(bilinear_weights([fx, fy])).filter_map(pixel_and_share)
        };
        let project = |point: &Option<DVec3>| self.camera.project_by_rows(poses, (*point)?);
        let places: Vec<Option<(DVec2, f32)>> =
            self.points.iter().map(|point| project(point).map(|(at, z)| (at, z as f32))).collect();
        let mut nearest = vec![f32::MAX; width * height];
        for (at, z) in places.iter().flatten() {
            for (i, _) in shares(*at) {
                nearest[i] = nearest[i].min(*z);
            }
        }
        let (mut sums, mut weights) = (vec![0.0; width * height], vec![0.0; width * height]);
        for (place, value) in places.iter().zip(&self.grey.values) {
            let Some((at, z)) = place else { continue };
            for (i, share) in shares(*at).filter(|(i, _)| *z <= nearest[*i] * (1.0 + DEPTH_TEST_TOLERANCE)) {
                sums[i] += share * value;
                weights[i] += share;
            }
        }
        let values = sums.iter().zip(&weights).map(|(sum, w)| if *w > 0.0 { sum / w } else { 0.0 }).collect();
        (GreyImage { width, height, values }, weights.iter().map(|w| *w > MIN_SPLAT_WEIGHT).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_that_got_worse_are_counted() {
        let slid = |was: f64, now: Option<f64>| SlidePair {
            from: 0,
            later: 5,
            recorded_px: vec![9.0, was, 0.0],
            refined_px: now.map(|px| vec![px]),
        };
        let all = [slid(1.0, Some(0.2)), slid(0.3, Some(0.35)), slid(0.2, Some(0.55)), slid(7.0, None)];
        let (worse_, of, largest_px) = worse(&all).unwrap();
        assert_eq!((worse_, of), (1, 3));
        assert!((largest_px - 0.35).abs() < 1e-12);
        assert_eq!(worse(&all[3..]), None);
        assert_eq!((all[3].recorded_median_px(), all[3].refined_median_px()), (Some(7.0), None));
    }
}
