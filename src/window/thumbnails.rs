//! Thumbnails of a recording for its time line, decoded on a background thread.

use std::sync::Arc;

use eframe::egui::{self, ColorImage, TextureHandle, TextureOptions};

use super::task::BackgroundTask;
use locard_engine::pixels::Pixels;
use locard_engine::recording::Recording;

/// Height in texels: enough for a display scale of 2.
const HEIGHT: u32 = 72;
/// Largest number of thumbnails.
const MAX_THUMBNAILS: usize = 40;

/// Thumbnails, decoded from coarse to fine.
pub struct Thumbnails {
    /// By frame, as far as they are decoded. No memo: all of them stay, and the nearest is shown.
    pictures: Vec<(usize, TextureHandle)>,
    decoded: BackgroundTask<(usize, ColorImage)>,
    /// Aspect ratio, width by height.
    aspect: f32,
}

impl Thumbnails {
    pub fn new(recording: Arc<Recording>, ctx: &egui::Context) -> std::io::Result<Self> {
        let wake = ctx.clone();
        let aspect = recording.width as f32 / recording.height as f32;
        let decoded = BackgroundTask::stream(
            "thumbnails",
            move || wake.request_repaint(),
            move |reporter| {
                for frame in coarse_to_fine(recording.frame_count()) {
                    let decoded = recording.frames(frame..frame + 1).ok().and_then(|mut frames| frames.next()?.ok());
                    // Decoding errors are reported where the frame itself is shown.
                    let Some(decoded) = decoded else { continue };
                    if reporter.control.is_cancelled() || !reporter.send((frame, downsample(&decoded.pixels))) {
                        return;
                    }
                }
            },
        )?;
        Ok(Self { pictures: Vec::new(), decoded: decoded.joined(), aspect })
    }

    pub fn aspect(&self) -> f32 {
        self.aspect
    }

    /// Uploads decoded thumbnails. The error is the message of a panic.
    pub fn upload(&mut self, ctx: &egui::Context) -> Result<(), String> {
        while let Some(decoded) = self.decoded.take() {
            let (frame, picture) = decoded?;
            let texture = ctx.load_texture(format!("frame {frame}"), picture, TextureOptions::LINEAR);
            self.pictures.push((frame, texture));
        }
        Ok(())
    }

    /// The thumbnail nearest to a frame.
    pub fn nearest(&self, frame: usize) -> Option<&TextureHandle> {
        self.pictures.iter().min_by_key(|(of, _)| of.abs_diff(frame)).map(|(_, texture)| texture)
    }
}

/// Evenly spaced frames of a recording, from coarse to fine.
fn coarse_to_fine(count: usize) -> Vec<usize> {
    let parts = MAX_THUMBNAILS.min(count).max(1);
    let mut order: Vec<usize> = (0..parts).collect();
    // Sorted by the lowest set bit of the index: halves, then quarters.
    order.sort_by_key(|n| (std::cmp::Reverse(if *n == 0 { u32::MAX } else { n.trailing_zeros() }), *n));
    order.into_iter().map(|n| n * count / parts).filter(|frame| *frame < count).collect()
}

/// Box-filtered reduction of code values.
fn downsample(pixels: &Pixels) -> ColorImage {
    let height = HEIGHT.min(pixels.height).max(1);
    let width = (pixels.width * height / pixels.height.max(1)).clamp(1, pixels.width.max(1));
    let max = f64::from(pixels.max_code());
    let covered = |n: u32, of: u32, all: u32| n * all / of..((n + 1) * all / of).max(n * all / of + 1);
    let mean = |x: u32, y: u32| {
        let (mut sum, mut count) = ([0.0; 3], 0.0);
        for row in covered(y, height, pixels.height) {
            for column in covered(x, width, pixels.width) {
                let codes = pixels.at(column, row);
                sum.iter_mut().zip(codes).for_each(|(sum, code)| *sum += f64::from(code));
                count += 1.0;
            }
        }
        let [r, g, b] = sum.map(|sum: f64| (255.0 * sum / count / max).round() as u8);
        egui::Color32::from_rgb(r, g, b)
    };
    let texels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| mean(x, y)).collect();
    ColorImage::new([width as usize, height as usize], texels)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thumbnails_are_evenly_spaced_and_box_filtered() {
        assert_eq!(coarse_to_fine(1), [0]);
        assert_eq!(coarse_to_fine(5), [0, 4, 2, 1, 3]);
        let many = coarse_to_fine(1000);
        assert_eq!((many.len(), many[0], many[1], many[2]), (40, 0, 800, 400));
        // Twice the displayed height: four pixels to a texel.
        let codes = |y: u32, x: u32| [(x % 2) as u8 * 10, (y % 2) as u8 * 20, 100];
        let all = (0..2 * HEIGHT).flat_map(|y| (0..4).flat_map(move |x| codes(y, x))).collect();
        let downsample = downsample(&Pixels::from_u8(4, 2 * HEIGHT, all).unwrap());
        assert_eq!(downsample.size, [2, HEIGHT as usize]);
        assert!(downsample.pixels.iter().all(|texel| *texel == egui::Color32::from_rgb(5, 10, 100)));
    }
}
