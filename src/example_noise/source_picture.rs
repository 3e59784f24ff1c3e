//! Properties of the pictures of a calibration by which a picture of another camera, or of another
//! setting, is distinguished. They do not change the noise.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::NoiseModel;
use crate::coding::PictureCoding;

/// Largest ratio of a quantisation step to those of the calibration. Cameras scale their tables by
/// content, so that steps vary within a recording.
const MAX_STEP_RATIO: f64 = 1.5;
/// Largest difference of steps by the rounding of scaled tables.
const MAX_ROUNDING: u16 = 1;

/// Size and quantisation of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SourcePicture {
    /// Width and height of the whole picture, px, also if only a part of it is used.
    pub size_px: [usize; 2],
    /// `None` without quantised DCT coefficients.
    pub steps: Option<StepRanges>,
}

/// Smallest and largest quantisation steps of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StepRanges {
    pub luma: [u16; 2],
    /// Over Cb and Cr.
    pub chroma: [u16; 2],
}

impl SourcePicture {
    pub fn new(size_px: [usize; 2], coding: &PictureCoding) -> Self {
        let range = |tables: &[[u16; 64]]| {
            let steps = || tables.iter().flatten().copied();
            [steps().min().unwrap_or(1), steps().max().unwrap_or(1)]
        };
        let steps = coding.quantization.as_ref().map(|quantization| StepRanges {
            luma: range(&quantization.steps[..1]),
            chroma: range(&quantization.steps[1..]),
        });
        Self { size_px, steps }
    }
}

/// A picture that differs from a model's pictures more than those of one camera and setting do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PictureMismatch {
    /// Size of the model's first picture, px.
    pub model_size_px: [usize; 2],
    /// Smallest and largest quantisation steps of the model's pictures.
    pub model_steps: Option<[u16; 2]>,
    pub picture: SourcePicture,
}

impl NoiseModel {
    /// The model whose pictures have these sizes, px, in order: the calibration used parts of them.
    #[must_use]
    pub fn with_picture_sizes(mut self, sizes_px: impl IntoIterator<Item = [usize; 2]>) -> Self {
        for (source, size_px) in self.sources.iter_mut().zip(sizes_px) {
            source.picture = source.picture.map(|picture| SourcePicture { size_px, ..picture });
        }
        self
    }

    /// The mismatch of a picture whose size is that of none of the model's pictures, or whose
    /// quantisation steps are outside of [`MAX_STEP_RATIO`] times the range of the model's. `None`
    /// also for a model from a file that does not state its pictures.
    pub fn mismatch(&self, picture: SourcePicture) -> Option<PictureMismatch> {
        mismatch(self.sources.iter().filter_map(|source| source.picture), picture)
    }
}

fn mismatch(sources: impl Iterator<Item = SourcePicture>, picture: SourcePicture) -> Option<PictureMismatch> {
    let sources: Vec<SourcePicture> = sources.collect();
    let first = sources.first()?;
    let is_of_size = sources.iter().any(|source| source.size_px == picture.size_px);
    let steps: Vec<StepRanges> = sources.iter().filter_map(|source| source.steps).collect();
    let differs = |of: fn(&StepRanges) -> u16| {
        let range = steps.iter().map(of).min().zip(steps.iter().map(of).max());
        picture.steps.as_ref().map(of).zip(range).is_some_and(|(step, range)| is_outside(step, range))
    };
    let has_other_steps =
        differs(|s| s.luma[0]) || differs(|s| s.luma[1]) || differs(|s| s.chroma[0]) || differs(|s| s.chroma[1]);
    (!is_of_size || has_other_steps).then(|| PictureMismatch {
        model_size_px: first.size_px,
        model_steps: steps.iter().copied().map(StepRanges::range).reduce(joined),
        picture,
    })
}

impl StepRanges {
    /// Over all planes.
    fn range(self) -> [u16; 2] {
        joined(self.luma, self.chroma)
    }
}

fn joined(a: [u16; 2], b: [u16; 2]) -> [u16; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
}

fn is_outside(step: u16, (min, max): (u16, u16)) -> bool {
    let exceeds = |a: u16, b: u16| a > b.saturating_add(MAX_ROUNDING) && f64::from(a) > MAX_STEP_RATIO * f64::from(b);
    exceeds(step, max) || exceeds(min, step)
}

/// A clause about both pictures.
impl fmt::Display for PictureMismatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [width, height] = self.model_size_px;
        write!(f, "the noise model was made from pictures of {width}x{height} px")?;
        if let Some([min, max]) = self.model_steps {
            write!(f, ", quantised by steps of {min} to {max}")?;
        }
        let [width, height] = self.picture.size_px;
        write!(f, "; these are {width}x{height} px")?;
        if let Some([min, max]) = self.picture.steps.map(StepRanges::range) {
            write!(f, " with {min} to {max}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coding::{BlockQuantization, ChromaSampling, Decoder, YcbcrColor};

    const SIZE: [usize; 2] = [640, 480];

    fn picture(luma: [u16; 2], chroma: [u16; 2]) -> SourcePicture {
        SourcePicture { size_px: SIZE, steps: Some(StepRanges { luma, chroma }) }
    }

    fn is_of_camera(sources: &[SourcePicture], picture: SourcePicture) -> bool {
        mismatch(sources.iter().copied(), picture).is_none()
    }

    #[test]
    fn steps_of_a_coding_are_those_of_its_tables() {
        let tables = [[2; 64], [3; 64], std::array::from_fn(|i| 5 + i as u16)];
        let quantization = Some(BlockQuantization { steps: tables, origin: [0, 0] });
        let coding = PictureCoding {
            color: YcbcrColor::JFIF,
            chroma: Some(ChromaSampling::FULL),
            quantization,
            decoder: Decoder::ZuneJpeg,
        };
        assert_eq!(SourcePicture::new(SIZE, &coding), picture([2, 2], [3, 68]));
        assert_eq!(SourcePicture::new(SIZE, &PictureCoding::UNROUNDED).steps, None);
    }

    #[test]
    fn steps_that_vary_within_a_calibration_are_of_its_camera() {
        // A camera that scales its tables by 1 to 3.
        let sources = [picture([10, 40], [20, 60]), picture([30, 120], [60, 180])];
        for (scale, expected) in [(10, true), (20, true), (7, true), (6, false), (45, true), (46, false)] {
            let scaled = |step: u16| step * scale / 10;
            let picture = picture([scaled(10), scaled(40)], [scaled(20), scaled(60)]);
            assert_eq!(is_of_camera(&sources, picture), expected, "{scale}");
        }
        // Chroma alone.
        assert!(!is_of_camera(&sources, picture([10, 40], [20, 300])));
    }

    #[test]
    fn rounding_of_small_steps_is_no_mismatch() {
        let sources = [picture([1, 10], [1, 10])];
        assert!(is_of_camera(&sources, picture([2, 12], [2, 12])));
        assert!(!is_of_camera(&sources, picture([3, 12], [3, 12])));
    }

    #[test]
    fn another_size_is_a_mismatch_and_the_message_has_both() {
        let sources = [picture([2, 10], [2, 9])];
        let larger = SourcePicture { size_px: [512, 512], ..sources[0] };
        assert!(is_of_camera(&[larger, sources[0]], sources[0]));
        let text = mismatch([larger].into_iter(), picture([4, 30], [5, 48])).unwrap().to_string();
        assert_eq!(
            text,
            "the noise model was made from pictures of 512x512 px, quantised by steps of 2 to 10; these are 640x480 px \
             with 4 to 48"
        );
        let plain = SourcePicture { size_px: SIZE, steps: None };
        let text = mismatch([SourcePicture { size_px: [8, 8], ..plain }].into_iter(), plain).unwrap().to_string();
        assert_eq!(text, "the noise model was made from pictures of 8x8 px; these are 640x480 px");
    }

    #[test]
    fn model_that_does_not_state_its_pictures_has_no_mismatch() {
        assert!(is_of_camera(&[], picture([1, 2], [1, 2])));
        // Whether both are quantised is compared by the coding.
        assert!(is_of_camera(&[SourcePicture { size_px: SIZE, steps: None }], picture([1, 2], [1, 2])));
    }
}
