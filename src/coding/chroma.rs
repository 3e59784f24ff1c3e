//! Chroma samples of pixels: means of rendered pixels, and samples recovered from decoded ones.
//!
//! A decoder that interpolates makes pixels o = U s of samples s. Means of such pixels are not the
//! samples that they came from, so a picture that is coded again would blur with each generation.
//! The least-squares solution s = (UᵀU)⁻¹Uᵀ o returns them up to the rounding of codes. U is the
//! same at every sample, so its inverse is a filter with taps that fall off geometrically; for
//! JPEG's weights ¾ and ¼ they are ⅔ (−⅓)^k at the k-th pixel pair from the sample.

use super::{ChromaSampling, ChromaSiting, Decoder, SamplePlane, swscale};

/// Samples on either side of its own that a recovered sample depends on. Taps beyond are below
/// 10⁻⁴.
const RECOVERY_RADIUS: usize = 8;

/// Weights along one axis from pixels to a chroma sample.
#[derive(Clone, Debug, PartialEq)]
pub struct ChromaFilter {
    /// Pixels for each sample: 1 or 2.
    pub factor: u32,
    /// Offset of the first weight's pixel from the sample's first pixel, px.
    pub first: i32,
    /// They add up to 1.
    pub weights: Vec<f32>,
}

impl ChromaFilter {
    /// The mean of the pixels about a sample's position.
    pub fn mean(factor: u32, siting: ChromaSiting) -> Self {
        match (factor, siting) {
            (1, _) => Self { factor, first: 0, weights: vec![1.0] },
            (_, ChromaSiting::Centered) => Self { factor, first: 0, weights: vec![0.5, 0.5] },
            (_, ChromaSiting::Cosited) => Self { factor, first: -1, weights: vec![0.25, 0.5, 0.25] },
        }
    }

    /// The least-squares inverse of a decoder's interpolation.
    pub fn recovery(factor: u32, decoder: Decoder, axis: usize) -> Self {
        if factor == 1 {
            return Self::mean(1, ChromaSiting::Centered);
        }
        // Weights of samples relative to the pixel pair's own, for the first and second pixel.
        let phases: [Vec<(isize, f64)>; 2] = match decoder {
            Decoder::Nearest | Decoder::Unrounded => return Self::mean(factor, ChromaSiting::Centered),
            Decoder::ZuneJpeg | Decoder::Libjpeg => [vec![(0, 0.75), (-1, 0.25)], vec![(0, 0.75), (1, 0.25)]],
            Decoder::Swscale { siting } => [0, 1].map(|pixel| {
                let position = swscale::position(pixel, factor, siting[axis]);
                (-3..4).map(|sample| (sample, swscale::kernel(position - sample as f64))).collect()
            }),
        };
        Self::inverse(&phases)
    }

    /// Inverse by the frequency response: with U₀ and U₁ of the first and second pixels, the taps
    /// of each are those of conj(Uᵢ) / (|U₀|² + |U₁|²).
    fn inverse(phases: &[Vec<(isize, f64)>; 2]) -> Self {
        const FREQUENCIES: usize = 64;
        let radius = RECOVERY_RADIUS as isize;
        let mut weights = vec![0.0; 2 * (2 * RECOVERY_RADIUS + 1)];
        for frequency in 0..FREQUENCIES {
            let angle = std::f64::consts::TAU * frequency as f64 / FREQUENCIES as f64;
            let responses = phases.each_ref().map(|taps| {
                taps.iter().fold([0.0, 0.0], |sum: [f64; 2], &(at, weight)| {
                    let phase = angle * at as f64;
                    [sum[0] + weight * phase.cos(), sum[1] + weight * phase.sin()]
                })
            });
            let power: f64 = responses.iter().map(|r| r[0] * r[0] + r[1] * r[1]).sum();
            for at in -radius..=radius {
                let phase = angle * at as f64;
                for (pixel, response) in responses.iter().enumerate() {
                    let value = (response[0] * phase.cos() - response[1] * phase.sin()) / power;
                    weights[(2 * (at + radius)) as usize + pixel] += value / FREQUENCIES as f64;
                }
            }
        }
        let sum: f64 = weights.iter().sum();
        let weights = weights.into_iter().map(|weight| (weight / sum) as f32).collect();
        Self { factor: 2, first: -2 * radius as i32, weights }
    }

    /// Pixel of the i-th weight for a sample; a plane's pixels repeat beyond its ends.
    fn pixel(&self, sample: usize, i: usize, length: usize) -> usize {
        let at = (self.factor as usize * sample) as isize + self.first as isize + i as isize;
        at.clamp(0, length as isize - 1) as usize
    }
}

/// Filters across and down that make chroma samples from pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct ChromaFilters([ChromaFilter; 2]);

impl ChromaFilters {
    /// The filter for rendered pixels.
    pub fn mean(chroma: ChromaSampling) -> Self {
        Self([0, 1].map(|axis| ChromaFilter::mean(chroma.factor[axis], chroma.siting[axis])))
    }

    /// The filter for pixels that the decoder made.
    pub fn recovery(chroma: ChromaSampling, decoder: Decoder) -> Self {
        Self([0, 1].map(|axis| ChromaFilter::recovery(chroma.factor[axis], decoder, axis)))
    }

    /// Across and down.
    pub fn axes(&self) -> &[ChromaFilter; 2] {
        &self.0
    }

    /// Subsamples a plane at luma's resolution. Its sides must be multiples of the factors.
    pub fn apply(&self, plane: &SamplePlane<f32>) -> SamplePlane<f32> {
        let [across, down] = &self.0;
        let narrow = if across.weights.len() == 1 {
            plane.clone()
        } else {
            SamplePlane::new(plane.width / across.factor as usize, plane.height, |x, y| {
                let term = |(i, weight): (usize, &f32)| weight * plane.at(across.pixel(x, i, plane.width), y);
                across.weights.iter().enumerate().map(term).sum()
            })
        };
        if down.weights.len() == 1 {
            return narrow;
        }
        SamplePlane::new(narrow.width, narrow.height / down.factor as usize, |x, y| {
            let term = |(i, weight): (usize, &f32)| weight * narrow.at(x, down.pixel(y, i, narrow.height));
            down.weights.iter().enumerate().map(term).sum()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recovery_of_jpegs_interpolation_has_the_derived_taps() {
        let filter = ChromaFilter::recovery(2, Decoder::ZuneJpeg, 0);
        // Of the pixel pair k to the right the second pixel's, of that to the left the first's.
        for k in 0..6 {
            let expected = 2.0 / 3.0 * (-1.0f32 / 3.0).powi(k);
            let right = filter.weights[(2 * k - filter.first + 1) as usize];
            let left = filter.weights[(-2 * k - filter.first) as usize];
            assert!((right - expected).abs() < 1e-4 && (left - expected).abs() < 1e-4, "{k}: {left} {right}");
            let other = filter.weights[(2 * k - filter.first + 2) as usize];
            assert!(other.abs() < 1e-4, "{k}: {other}");
        }
    }

    #[test]
    fn recovery_returns_the_samples_of_swscales_interpolation() {
        let siting = [ChromaSiting::Centered; 2];
        let samples: Vec<f64> = (0..40).map(|i| f64::from(i * i * 7 % 31)).collect();
        let pixel = |at: usize| {
            let position = swscale::position(at, 2, siting[0]);
            let weigh = |i: usize| samples[i] * swscale::kernel(position - i as f64);
            (0..samples.len()).map(weigh).sum::<f64>() as f32
        };
        let plane = SamplePlane::new(80, 1, |x, _| pixel(x));
        let across = ChromaFilter::recovery(2, Decoder::Swscale { siting }, 0);
        let down = ChromaFilter::mean(1, ChromaSiting::Centered);
        let recovered = ChromaFilters([across, down]).apply(&plane);
        for (actual, expected) in recovered.samples.iter().zip(&samples).take(30).skip(10) {
            assert!((f64::from(*actual) - expected).abs() < 0.01, "{actual} {expected}");
        }
    }
}
