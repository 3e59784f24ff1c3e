//! Detectors of virtual pixels: can a classifier separate patches of virtual pixels from the
//! camera's?
//!
//! Patches of 32×32 px of both classes are described by features of several families. A classifier
//! is trained on some of them and scores the others. The area under its ROC curve (AUC) is the
//! probability that a virtual patch gets a higher score than a real one: 0.5 is chance, 1 complete
//! separation. Real patches against other real ones of the same recording are the floor; it differs
//! from 0.5 where the two differ in content.
//!
//! | [`DetectorFamily`] | file | sensitive to |
//! |---|---|---|
//! | `ResidualMoments` | `residual` | σ, covariance, tails |
//! | `Cooccurrences` | `cooccurrence` | dependence between neighbours |
//! | `BlockDct` | `block_dct` | JPEG, subsampled chroma |
//! | `CopyMove` | `copy_move` | noise that repeats in a picture |
//! | `FrameCorrelation` | `frame_correlation` | noise that repeats in time |
//!
//! Everything is a function of the pictures and the seed; nothing depends on threads or time.

pub mod auc;
mod block_dct;
mod boosted_trees;
mod cooccurrence;
mod copy_move;
mod cross_validation;
mod fft;
mod frame_correlation;
mod logistic;
mod patches;
mod residual;
#[cfg(test)]
mod synthetic;
#[cfg(test)]
mod tests;

use super::{MeasureError, check_mask, comparable};
use crate::pixels::Pixels;
use block_dct::CombFit;
use cooccurrence::CooccurrenceModel;
pub use copy_move::TileMatch;
pub use frame_correlation::{FrameCorrelation, frame_correlation};
pub use patches::PATCH_PX;
use patches::{DetectorPatch, cropped, patches, rgb_planes, ycbcr};

/// Fewest patches of a class, and of a pair of frames.
pub const MIN_PATCHES: usize = 50;

/// A picture of which patches are judged.
#[derive(Clone, Copy, Debug)]
pub struct PatchSource<'a> {
    pub pixels: &'a Pixels,
    /// One value per pixel, row by row: true where patches may lie. Everywhere without one.
    pub mask: Option<&'a [bool]>,
    /// The next frame of the same view, for [`DetectorFamily::FrameCorrelation`].
    pub next: Option<&'a Pixels>,
    /// Left upper pixel of any 8×8 block of the picture's JPEG; [0, 0] unless it was cropped. The
    /// patches lie on this grid.
    pub block_origin_px: [u32; 2],
}

impl<'a> PatchSource<'a> {
    /// All of a picture.
    pub fn new(pixels: &'a Pixels) -> Self {
        Self { pixels, mask: None, next: None, block_origin_px: [0, 0] }
    }
}

/// A family of features.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum DetectorFamily {
    /// Strength, correlation and shape of the noise residue.
    ResidualMoments,
    /// Co-occurrences of quantised differences of neighbours.
    Cooccurrences,
    /// Coefficients, zeros, block edges and quantiser of 8×8 transforms.
    BlockDct,
    /// Repeats of residue within the picture.
    CopyMove,
    /// Correlation with the next frame at the same pixels. Needs [`PatchSource::next`].
    FrameCorrelation,
    /// The features of all other requested families together.
    Combined,
}

impl DetectorFamily {
    /// Families that need single frames.
    pub const SINGLE_FRAME: [Self; 5] =
        [Self::ResidualMoments, Self::Cooccurrences, Self::BlockDct, Self::CopyMove, Self::Combined];
}

/// A kind of classifier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DetectorClassifier {
    /// Ridge logistic regression.
    Logistic,
    /// Gradient-boosted trees of three levels.
    Boosted,
}

impl DetectorClassifier {
    pub const ALL: [Self; 2] = [Self::Logistic, Self::Boosted];
}

/// Choice of detectors and folds.
#[derive(Clone, Debug, PartialEq)]
pub struct SeparabilityOptions {
    pub families: Vec<DetectorFamily>,
    /// Number of folds, 2 to 10.
    pub folds: usize,
    /// Order in which groups of patches are assigned to folds.
    pub seed: u64,
}

impl Default for SeparabilityOptions {
    fn default() -> Self {
        Self { families: DetectorFamily::SINGLE_FRAME.to_vec(), folds: 5, seed: 0 }
    }
}

/// How well a detector separates virtual from real patches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DetectorScore {
    pub family: DetectorFamily,
    pub classifier: DetectorClassifier,
    /// Area under the ROC curve, cross-validated, 0 to 1; 0.5 is chance. Below 0.5 by more than a
    /// few standard errors the folds differ in content.
    pub auc: f64,
    /// Of the area, for independent patches (Hanley and McNeil 1982). The area of equal classes
    /// scatters up to 1.7 times as much with about 100 patches a side, because the classifiers vary
    /// too.
    pub standard_error: f64,
    pub real_patches: usize,
    pub virtual_patches: usize,
}

/// The scores of all requested detectors, family by family, for each the classifiers of
/// [`DetectorClassifier::ALL`].
///
/// Pictures may have any sizes and depths of bits; codes are compared on the 8-bit scale. The n-th
/// real and the n-th virtual picture are taken for the same view: patches at the same place of both
/// are in the same fold. Classes of equal content are compared fairly; otherwise content counts as
/// a difference. The cost is that of the Fourier transforms of [`DetectorFamily::CopyMove`], one of
/// 512×512 px per patch.
///
/// # Errors
/// Masks and next frames of other sizes than their pictures, fewer than [`MIN_PATCHES`] patches of
/// a class, patches too unevenly spread for the folds, options out of range, a missing next frame.
pub fn separability(
    real: &[PatchSource],
    virtual_: &[PatchSource],
    options: &SeparabilityOptions,
) -> Result<Vec<DetectorScore>, MeasureError> {
    if !(2..=10).contains(&options.folds) {
        return Err(MeasureError::Option { what: "folds", actual: options.folds as f64, accepted: "2 to 10" });
    }
    let uses_next = options.families.contains(&DetectorFamily::FrameCorrelation);
    real.iter().chain(virtual_).try_for_each(|source| check_source(source, uses_next))?;
    let classes = [ClassPatches::new(real), ClassPatches::new(virtual_)];
    for (side, class) in ["the real side", "the virtual side"].into_iter().zip(&classes) {
        let (actual, needed) =
            (class.patches.len(), MIN_PATCHES.max(cross_validation::MIN_FOLD_PATCHES * options.folds));
        if actual < needed {
            return Err(MeasureError::TooFewPatches { side, actual, needed });
        }
    }
    let cells: Vec<_> = classes.iter().flat_map(|class| &class.patches).map(|p| (p.picture, p.cell)).collect();
    let [real_patches, virtual_patches] = [0, 1].map(|class: usize| classes[class].patches.len());
    let is_virtual: Vec<bool> = (0..cells.len()).map(|i| i >= real_patches).collect();
    let fold_of = cross_validation::grouped_folds(&cells, &is_virtual, options.folds, options.seed)
        .ok_or(MeasureError::Nothing("the patches cannot be divided into folds with both classes; use fewer folds"))?;
    let mut scores = Vec::new();
    let mut combined = vec![Vec::new(); cells.len()];
    let mut families = options.families.clone();
    families.sort();
    families.dedup();
    for family in families {
        let samples = if family == DetectorFamily::Combined {
            std::mem::take(&mut combined)
        } else {
            let samples = family_features(family, &classes);
            combined.iter_mut().zip(&samples).for_each(|(all, sample)| all.extend(sample));
            samples
        };
        for classifier in DetectorClassifier::ALL {
            let area = cross_validation::cross_validated_auc(&samples, &is_virtual, &fold_of, classifier)
                .ok_or(MeasureError::Nothing("a classifier has no finite scores"))?;
            let (auc, standard_error) = (area.area, area.standard_error);
            scores.push(DetectorScore { family, classifier, auc, standard_error, real_patches, virtual_patches });
        }
    }
    Ok(scores)
}

/// The tiles of a picture that lie in the mask, each with the place whose residue correlates with
/// it most. Fails with fewer than 2 tiles.
pub fn find_repeats(source: &PatchSource) -> Result<Vec<TileMatch>, MeasureError> {
    check_source(source, false)?;
    let tiles = patches(&[*source]);
    if tiles.len() < 2 {
        return Err(MeasureError::TooFewPatches { side: "the picture", actual: tiles.len(), needed: 2 });
    }
    Ok(copy_move::matches(source, &tiles.iter().collect::<Vec<_>>()))
}

fn check_source(source: &PatchSource, uses_next: bool) -> Result<(), MeasureError> {
    check_mask(source.mask, source.pixels.width as usize * source.pixels.height as usize)?;
    match source.next {
        Some(next) => comparable(source.pixels, next),
        None if uses_next => Err(MeasureError::Nothing("a picture has no next frame to correlate with")),
        None => Ok(()),
    }
}

/// The patches of one class.
struct ClassPatches<'a> {
    sources: &'a [PatchSource<'a>],
    patches: Vec<DetectorPatch>,
}

impl<'a> ClassPatches<'a> {
    fn new(sources: &'a [PatchSource<'a>]) -> Self {
        Self { sources, patches: patches(sources) }
    }

    /// Each picture with its patches.
    fn by_picture(&self) -> impl Iterator<Item = (&PatchSource<'a>, Vec<&DetectorPatch>)> {
        self.sources
            .iter()
            .enumerate()
            .map(|(picture, source)| (source, self.patches.iter().filter(|patch| patch.picture == picture).collect()))
    }
}

/// The features of all patches of both classes, finite.
fn family_features(family: DetectorFamily, classes: &[ClassPatches; 2]) -> Vec<Vec<f64>> {
    let all = || classes.iter().flat_map(|class| &class.patches);
    let mut samples: Vec<Vec<f64>> = match family {
        DetectorFamily::ResidualMoments => all().map(|patch| residual::features(&patch.rgb)).collect(),
        DetectorFamily::Cooccurrences => {
            let model = CooccurrenceModel::new(all().map(|patch| &patch.ycbcr));
            all().map(|patch| model.features(&patch.ycbcr)).collect()
        }
        DetectorFamily::BlockDct => {
            let blocks: Vec<_> = all().map(|patch| block_dct::transform(&patch.ycbcr)).collect();
            let combs = CombFit::new(blocks.iter().flat_map(|planes| &planes[0]));
            all().zip(&blocks).map(|(patch, blocks)| block_dct::features(&patch.ycbcr, blocks, &combs)).collect()
        }
        DetectorFamily::CopyMove => {
            let pictures = classes.iter().flat_map(ClassPatches::by_picture);
            let tiles = pictures.flat_map(|(source, patches)| copy_move::matches(source, &patches));
            tiles.map(|tile| copy_move::features(&tile)).collect()
        }
        DetectorFamily::FrameCorrelation => {
            let pictures = classes.iter().flat_map(ClassPatches::by_picture);
            let features = |(source, patches): (&PatchSource, Vec<&DetectorPatch>)| -> Vec<Vec<f64>> {
                let Some(next) = source.next.map(rgb_planes) else { return vec![Vec::new(); patches.len()] };
                let features = |patch: &&DetectorPatch| {
                    let planes = [0, 1, 2].map(|channel: usize| cropped(&next[channel], patch.origin_px));
                    frame_correlation::features(&patch.ycbcr, &ycbcr(&planes))
                };
                patches.iter().map(features).collect()
            };
            pictures.flat_map(features).collect()
        }
        DetectorFamily::Combined => vec![Vec::new(); all().count()],
    };
    samples.iter_mut().flatten().filter(|value| !value.is_finite()).for_each(|value| *value = 0.0);
    samples
}
