//! A frame at a fraction of its size: for fast previews of frames that take long at full size.

use std::sync::Arc;

use super::{Shot, ShotError};
use crate::camera::{Capture, Crop, NoiseBin, NoiseProfile, correlations, variance_left};
use crate::compositor::{Compositor, Job, Pending, Target};
use crate::frame::Frame;
use crate::parallel::{over_rows, processors};
use crate::pixels::{Codes, DepthMap, Pixels};

/// A frame of which each pixel is the mean of a square of camera pixels.
#[derive(Clone, Debug)]
pub struct ReducedFrame {
    frame: Frame,
    /// Side of the squares, px. The remainder at the right and at the bottom is cut off.
    reduction: u32,
}

impl ReducedFrame {
    /// Reduces a frame by a factor of 1 or more, limited so that a pixel remains.
    pub fn new(frame: &Frame, reduction: u32) -> Self {
        let reduction = reduction.clamp(1, frame.pixels.width.min(frame.pixels.height).max(1));
        let (width, height) = (frame.pixels.width / reduction, frame.pixels.height / reduction);
        let codes = match &frame.pixels.codes {
            Codes::U8(codes) => Codes::U8(means(codes, frame.pixels.width, (width, height), reduction)),
            Codes::U16(codes) => Codes::U16(means(codes, frame.pixels.width, (width, height), reduction)),
        };
        let depth = frame.depth.as_ref().map(|depth| Arc::new(reduced_depth(depth, reduction)));
        let pixels = Pixels::uncoded(width, height, codes);
        let Frame { index, timestamp_s, exposure, opacity, .. } = *frame;
        // A preview uses the frame's own depth alone.
        let alone = Frame::new(index, timestamp_s, pixels);
        Self { frame: Frame { depth, exposure, opacity, ..alone }, reduction }
    }

    pub fn reduction(&self) -> u32 {
        self.reduction
    }
}

impl Shot {
    /// Like [`Shot::submit`], at the reduced size. Lengths in pixels, the lens and the noise are
    /// scaled; details finer than a pixel are lost.
    pub fn submit_reduced(
        &self,
        compositor: &mut Compositor,
        ReducedFrame { frame, reduction }: &ReducedFrame,
        target: Target<'_>,
    ) -> Result<Pending, ShotError> {
        self.update_compositor(compositor);
        let index = frame.index;
        let recorded = self.geometry_at(index)?;
        let framed = Crop { left_px: 0.0, top_px: 0.0, step: f64::from(*reduction) };
        let (width, height) = (frame.pixels.width, frame.pixels.height);
        let picture = framed.geometry(&recorded, width, height, recorded.intrinsics.film_width_mm);
        let mut camera = self.camera();
        camera.noise = camera.noise.map(|noise| mean_noise(noise, *reduction));
        let (track, interval_s) = (&self.recording.track, self.interval_s(index));
        let frame = self.with_live_depth(frame.clone(), &picture, track);
        let job = Job::of_frame(frame, &camera, &self.settings, &picture, track, interval_s)?;
        let capture = Capture { recorded, framed, enlargement: f64::from(*reduction).recip(), ..job.capture };
        let job = Job { capture, ..job };
        compositor
            .submit(job, &camera, &self.settings, target)
            .map_err(|source| ShotError::Submit { frame: index, source })
    }
}

/// Noise of the mean of `by`² pixels: σ / `by`, and more if neighbours are correlated. The
/// correlation of the means themselves is ignored.
fn mean_noise(noise: NoiseProfile, reduction: u32) -> NoiseProfile {
    let weights = vec![1.0 / reduction as f32; reduction as usize];
    let [x, y] = noise.neighbour_correlation.map(|neighbour| variance_left(&weights, &correlations(neighbour)));
    let left = (x * y).sqrt();
    let bins = noise.bins.map(|bins| bins.into_iter().map(|bin| NoiseBin { sigma: left * bin.sigma, ..bin }).collect());
    NoiseProfile { bins, neighbour_correlation: [0.0; 2], ..noise }
}

/// Means of squares, rounded to the nearest integer.
fn means<T>(codes: &[T], width: u32, size: (u32, u32), reduction: u32) -> Vec<T>
where
    T: Copy + Default + Send + Sync + Into<u32> + TryFrom<u32>,
{
    let (row, side, squares) = (3 * width as usize, reduction as usize, size.0 as usize);
    let mut out = vec![T::default(); 3 * squares * size.1 as usize];
    over_rows(&mut out, 3 * squares, processors(), |y, means| {
        let mut sums = vec![0u64; 3 * squares];
        for codes in codes[y * side * row..].chunks(row).take(side) {
            for (sum, square) in sums.chunks_exact_mut(3).zip(codes.chunks(3 * side)) {
                for pixel in square.chunks_exact(3) {
                    sum.iter_mut().zip(pixel).for_each(|(sum, code)| *sum += u64::from((*code).into()));
                }
            }
        }
        let count = u64::from(reduction) * u64::from(reduction);
        for (mean, sum) in means.iter_mut().zip(sums) {
            // The mean of codes is in the range of codes.
            *mean =
                u32::try_from((sum + count / 2) / count).ok().and_then(|mean| mean.try_into().ok()).unwrap_or_default();
        }
    });
    out
}

/// The depth in the middle of each square: a mean would lie on no surface.
fn reduced_depth(depth: &DepthMap, reduction: u32) -> DepthMap {
    let (width, height) = (depth.width / reduction, depth.height / reduction);
    let middle = |at: u32| (at * reduction + reduction / 2) as usize;
    let row = |y: u32| middle(y) * depth.width as usize;
    let depth_m = (0..height)
        .flat_map(|y| (0..width).map(move |x| (x, y)))
        .map(|(x, y)| depth.depth_m[row(y) + middle(x)])
        .collect();
    DepthMap { width, height, depth_m, timestamp_s: depth.timestamp_s }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reduced_frame_has_mean_codes_and_sampled_depths() {
        // Two rows of five pixels: the fifth column is cut off.
        let codes: Vec<u8> = [10, 20, 30, 40, 99, 50, 60, 71, 80, 99].iter().flat_map(|c| [*c, 2 * *c, 255]).collect();
        // (10 + 20 + 50 + 60) / 4 = 35; (30 + 40 + 71 + 80) / 4 = 55.25; the second channel is
        // twice that: 110.5 is 111.
        assert_eq!(means(&codes, 5, (2, 1), 2), [35, 70, 255, 55, 111, 255]);
        let depth_m = (0..20).map(|n| n as f32).collect();
        let depth = DepthMap { width: 5, height: 4, depth_m, timestamp_s: 3.0 };
        let reduced = reduced_depth(&depth, 2);
        assert_eq!((reduced.width, reduced.height, reduced.timestamp_s), (2, 2, 3.0));
        assert_eq!(reduced.depth_m, [6.0, 8.0, 16.0, 18.0]);
    }
}
