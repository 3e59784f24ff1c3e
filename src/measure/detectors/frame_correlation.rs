//! Correlation of the residues of two frames at the same pixels.
//!
//! The noise of a camera at rest is independent from frame to frame, but for fixed patterns (Chen,
//! Fridrich, Goljan and Lukáš 2008). Synthesised noise correlates where it repeats its source. The
//! residue is a frame minus a noise-free picture of the view, or minus its own Gaussian blur (σ = 2
//! px); then edges of the content correlate too, and should be left out by a mask.

use super::patches::{DetectorPatch, Planes, patches};
use super::residual::{correlation, high_pass};
use super::{MIN_PATCHES, PatchSource};
use crate::grey_image::GreyImage;
use crate::measure::{MeasureError, check_mask, comparable};
use crate::pixels::Pixels;

/// Mean correlation of two frames' residues over patches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameCorrelation {
    /// −1 to 1; 0 for independent noise.
    pub correlation: f64,
    /// Standard error by the scatter of the patches.
    pub standard_error: f64,
    /// Number of patches.
    pub patches: usize,
}

/// Correlation of the Y' residues of two frames at the same pixels, over patches of 32×32 px that
/// lie in the mask. `clean` is a noise-free picture of the same view, which must not contain the
/// two frames: the mean of J frames with both of them shifts the correlation by −1/(J − 1).
pub fn frame_correlation(
    frames: [&Pixels; 2],
    clean: Option<&Pixels>,
    mask: Option<&[bool]>,
) -> Result<FrameCorrelation, MeasureError> {
    let [first, second] = frames;
    comparable(first, second)?;
    check_mask(mask, first.width as usize * first.height as usize)?;
    let patches_of = |pixels| patches(&[PatchSource { mask, ..PatchSource::new(pixels) }]);
    let clean = match clean {
        Some(clean) => {
            comparable(first, clean)?;
            Some(patches_of(clean))
        }
        None => None,
    };
    let residues = |patches: &[DetectorPatch]| -> Vec<Vec<f64>> {
        let residue = |(i, patch): (usize, &DetectorPatch)| match &clean {
            Some(clean) => difference(&patch.ycbcr[0], &clean[i].ycbcr[0]),
            None => high_pass(&patch.ycbcr[0]),
        };
        patches.iter().enumerate().map(residue).collect()
    };
    let (first, second) = (residues(&patches_of(first)), residues(&patches_of(second)));
    let correlations: Vec<f64> = first.iter().zip(&second).map(|(a, b)| correlation(a, b)).collect();
    if correlations.len() < MIN_PATCHES {
        let patches = correlations.len();
        return Err(MeasureError::TooFewPatches { side: "the pair of frames", actual: patches, needed: MIN_PATCHES });
    }
    let count = correlations.len() as f64;
    let mean = correlations.iter().sum::<f64>() / count;
    let variance = correlations.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / (count - 1.0);
    let standard_error = (variance / count).sqrt();
    Ok(FrameCorrelation { correlation: mean, standard_error, patches: correlations.len() })
}

fn difference(a: &GreyImage, b: &GreyImage) -> Vec<f64> {
    a.values.iter().zip(&b.values).map(|(a, b)| f64::from(a - b)).collect()
}

/// Features of a patch and the same place in the next frame: the residues' correlations in Y', Cb
/// and Cr.
pub(super) fn features(ycbcr: &Planes, next: &Planes) -> Vec<f64> {
    ycbcr.iter().zip(next).map(|(a, b)| correlation(&high_pass(a), &high_pass(b))).collect()
}

#[cfg(test)]
mod tests {
    use super::super::synthetic::{Normals, grey_picture};
    use super::*;

    /// Two frames whose noise, of σ = 5 codes, has a common share of variance, and their mean.
    fn frames(common: f64) -> [Pixels; 3] {
        let mut normals = Normals::new(11);
        let content = |i: usize| 100.0 + 40.0 * ((i % 256) as f64 / 30.0).sin();
        let shared: Vec<f64> = (0..256 * 256).map(|_| normals.next()).collect();
        let mut frame = || {
            let noise = shared.iter().map(|s| 5.0 * (common.sqrt() * s + (1.0 - common).sqrt() * normals.next()));
            let values: Vec<f64> = noise.enumerate().map(|(i, noise)| content(i) + noise).collect();
            grey_picture(256, &values)
        };
        let (first, second) = (frame(), frame());
        [first, second, grey_picture(256, &(0..256 * 256).map(content).collect::<Vec<_>>())]
    }

    #[test]
    fn common_share_of_the_noise_is_the_correlation() {
        for share in [0.0, 0.2, 0.7] {
            let [first, second, clean] = frames(share);
            for clean in [None, Some(&clean)] {
                let result = frame_correlation([&first, &second], clean, None).unwrap();
                assert_eq!(result.patches, 64);
                assert!((result.correlation - share).abs() < 4.0 * result.standard_error + 0.01, "{share}: {result:?}");
                // One patch scatters by at most 1/√1024; white noise loses few degrees to the blur.
                assert!((0.001..0.006).contains(&result.standard_error), "{result:?}");
            }
        }
    }

    #[test]
    fn content_correlates_without_a_clean_picture_only() {
        let mut normals = Normals::new(12);
        let mut stripes = |sigma: f64| {
            let content = |i: usize| if i % 16 < 8 { 100.0 } else { 130.0 };
            let values: Vec<f64> = (0..256 * 256).map(|i| content(i) + sigma * normals.next()).collect();
            grey_picture(256, &values)
        };
        let (first, second, clean) = (stripes(5.0), stripes(5.0), stripes(0.0));
        let without = frame_correlation([&first, &second], None, None).unwrap();
        assert!(without.correlation > 0.5, "{without:?}");
        let with = frame_correlation([&first, &second], Some(&clean), None).unwrap();
        assert!(with.correlation.abs() < 4.0 * with.standard_error, "{with:?}");
    }

    #[test]
    fn unusable_frames_are_an_error() {
        let [first, second, _] = frames(0.0);
        let small = grey_picture(128, &vec![9.0; 128 * 128]);
        let sizes = frame_correlation([&first, &small], None, None);
        assert!(matches!(sizes, Err(MeasureError::Sizes { .. })));
        assert!(matches!(frame_correlation([&first, &second], Some(&small), None), Err(MeasureError::Sizes { .. })));
        assert!(matches!(frame_correlation([&first, &second], None, Some(&[true])), Err(MeasureError::Length { .. })));
        let few = frame_correlation([&small, &small], None, None);
        assert!(matches!(few, Err(MeasureError::TooFewPatches { actual: 16, needed: 50, .. })), "{few:?}");
    }
}
