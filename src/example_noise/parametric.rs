//! The parametric field: the amplitudes of a model on normal noise in place of its atlas.
//!
//! Independent normal noise in Y', Cb and Cr is mixed to the correlation of the planes that the
//! atlas has at the resolution of chroma, and split into bands. Each band gets the variance of the
//! atlas's. Spectrum, covariance and dependence on content are the model's; the distribution is
//! normal. No residual of the calibration is in it, but tiles of the field repeat.

use std::sync::Arc;

use super::atlas::{AtlasFrame, CLASSES, TILE_PX, TileCandidate};
use super::bands::{ALL_BANDS, BANDS, FIRST_BAND, split};
use super::content::block_means;
use super::descriptor::{DESCRIPTOR_BLOCK_PX, DESCRIPTORS, DescriptorScale};
use super::{NoiseModel, ParametricField};
use crate::fit::cholesky::correlation_factor;
use crate::grey_image::GreyImage;
use crate::hash::pcg3d;

/// Side of the field's only frame, px.
const SIDE: usize = 1024;
const SEED: u32 = 0x9a1d;

impl NoiseModel {
    /// The model with normal noise in place of its atlas.
    pub fn parametric(&self) -> Arc<NoiseModel> {
        self.parametric.0.get_or_init(|| Arc::new(self.with_normal_atlas())).clone()
    }

    fn with_normal_atlas(&self) -> NoiseModel {
        let factor = self.numbers.chroma_factor();
        let white = |plane: u32| {
            let [across, down] = if plane == 0 { [1, 1] } else { factor };
            GreyImage::from_fn(SIDE / across, SIDE / down, |x, y| normal([x as u32, y as u32, SEED + plane]))
        };
        let [luma, mut blue, mut red] = [0, 1, 2].map(white);
        let [y_blue, blue_scale, y_red, blue_red, red_scale] =
            correlation_factor(self.plane_correlation()).map(|v| v as f32);
        // Scaled so that block means of white noise have variance 1 again.
        let reduced = block_means(&luma, factor);
        let root = ((factor[0] * factor[1]) as f32).sqrt();
        for ((y, blue), red) in reduced.values.iter().zip(&mut blue.values).zip(&mut red.values) {
            let (y, first, second) = (root * y, *blue, *red);
            *blue = y_blue * y + blue_scale * first;
            *red = y_red * y + blue_red * first + red_scale * second;
        }
        let planes = [luma, blue, red];
        let mut bands = planes.iter().enumerate().flat_map(|(plane, image)| split(image, plane));
        let bands: [GreyImage; ALL_BANDS] = std::array::from_fn(|b| {
            let mut band = bands.next().unwrap_or_else(|| GreyImage::uniform(0, 0, 0.0));
            let wanted = mean_square(self.frames.iter().map(|frame| &frame.bands[b]));
            let scale = (wanted / mean_square([&band].into_iter()).max(f64::MIN_POSITIVE)).sqrt() as f32;
            band.values.iter_mut().for_each(|v| *v *= scale);
            band
        });
        NoiseModel {
            numbers: self.numbers,
            sources: Vec::new(),
            frames: vec![AtlasFrame { bands }],
            candidates: quarters(factor),
            descriptor_scale: DescriptorScale::default(),
            parametric: ParametricField::default(),
        }
    }

    /// Correlation of the atlas's planes at the resolution of chroma: Y'–Cb, Y'–Cr, Cb–Cr.
    fn plane_correlation(&self) -> [f64; 3] {
        let factor = self.numbers.chroma_factor();
        let mut products = [[0.0; 3]; 3];
        for frame in &self.frames {
            let plane = |plane: usize| {
                let bands = &frame.bands[FIRST_BAND[plane]..FIRST_BAND[plane] + BANDS[plane]];
                let mut sum = bands[0].clone();
                for band in &bands[1..] {
                    sum.values.iter_mut().zip(&band.values).for_each(|(sum, v)| *sum += v);
                }
                if plane == 0 { block_means(&sum, factor) } else { sum }
            };
            let planes = [0, 1, 2].map(plane);
            for (a, line) in planes.iter().zip(&mut products) {
                for (b, sum) in planes.iter().zip(line) {
                    *sum += a.values.iter().zip(&b.values).map(|(a, b)| f64::from(a * b)).sum::<f64>();
                }
            }
        }
        [[0, 1], [0, 2], [1, 2]].map(|[a, b]| {
            let norm = (products[a][a] * products[b][b]).sqrt();
            if norm > 0.0 { products[a][b] / norm } else { 0.0 }
        })
    }
}

fn mean_square<'a>(images: impl Iterator<Item = &'a GreyImage>) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for image in images {
        sum += image.values.iter().map(|v| f64::from(v * v)).sum::<f64>();
        count += image.values.len();
    }
    sum / count.max(1) as f64
}

/// Normal noise of variance 1 at a counter (Box and Muller 1958).
fn normal(at: [u32; 3]) -> f32 {
    let [radius, angle, _] = pcg3d(at).map(|word| (f64::from(word) + 0.5) / (f64::from(u32::MAX) + 1.0));
    ((-2.0 * radius.ln()).sqrt() * (std::f64::consts::TAU * angle).cos()) as f32
}

/// Tiles of the frame's quarters, one class each, all with the same descriptor.
fn quarters(factor: [usize; 2]) -> [Vec<TileCandidate>; CLASSES] {
    let half = SIDE / 2;
    let steps = |axis: usize| (0..=half - TILE_PX).step_by(DESCRIPTOR_BLOCK_PX * factor[axis]);
    std::array::from_fn(|class| {
        let first = [class % 2, class / 2].map(|part| part * half);
        let place = |x: usize, y: usize| [(first[0] + x) as u32, (first[1] + y) as u32];
        let tiles = steps(1).flat_map(|y| steps(0).map(move |x| place(x, y)));
        tiles.map(|at| TileCandidate { frame: 0, at, descriptor: [0.0; DESCRIPTORS] }).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::example_noise::persistence::FrameKeys;
    use crate::example_noise::synthesis::NoiseContent;
    use crate::example_noise::tests::model;

    #[test]
    fn parametric_field_has_the_variances_of_the_bands_and_planes_and_is_normal() {
        let example = model([2, 1]);
        let field = example.parametric();
        for b in 0..ALL_BANDS {
            let [a, b] = [&example, &*field].map(|m| mean_square(m.frames.iter().map(|frame| &frame.bands[b])));
            assert!((b / a - 1.0).abs() < 1e-3, "{a} {b}");
        }
        let correlation = [&example, &*field].map(NoiseModel::plane_correlation);
        for (a, b) in correlation[0].iter().zip(correlation[1]) {
            // 1024 × 512 samples.
            assert!((a - b).abs() < 0.1, "{correlation:?}");
        }
        let grey = [(); 3].map(|()| GreyImage::uniform(320, 320, 128.0));
        let content = NoiseContent { rgb: &grey, share: None, factor: None };
        let noise = field.noise(&content, &FrameKeys::single([1, 2, 3]));
        let [luma, again] =
            [noise, field.noise(&content, &FrameKeys::single([1, 2, 4]))].map(|planes| planes[0].values.clone());
        let moment = |p: i32| luma.iter().map(|v| f64::from(*v).powi(p)).sum::<f64>() / luma.len() as f64;
        // σ of the fourth moment's ratio by 100,000 samples: 0.02 for white noise.
        assert!((moment(4) / moment(2).powi(2) - 3.0).abs() < 0.2, "{}", moment(4) / moment(2).powi(2));
        let product = luma.iter().zip(&again).map(|(a, b)| f64::from(a * b)).sum::<f64>() / luma.len() as f64;
        assert!((product / moment(2)).abs() < 0.05, "two frames correlate by {}", product / moment(2));
    }
}
