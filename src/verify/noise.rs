//! Compares virtual pixels' noise with the camera's, in flat patches of a recording's own frames.
//!
//! Of frames spread over the recording, those with the most flat patches ([`super::flat_patches`])
//! are taken. A frame's patches are replaced by smooth surfaces, and the result is composited as an
//! object over the same frame by its own pose, with the shot's noise and format. Other effects are
//! off, except the exposure, which undoes the object's normalisation to the recording's gain. So
//! both pictures have the same content, the camera's noise in one and the virtual noise in the
//! other.
//!
//! Detectors ([`crate::measure::detectors`]) are trained to separate patches of both. Their floor
//! is the result for two random halves of the real patches.
//!
//! Colours of the object are those of its vertices, every second pixel, and not of a texture, whose
//! codes are whole numbers.
//!
//! Not modelled: texture, in which a camera's noise differs; noise that repeats in time; patches
//! whose chroma blocks are shared with their neighbours, where the grid is shifted by 8 px.

use std::fmt;
use std::sync::Arc;

use super::error::VerifyError;
use super::flat_patches::{CodePlanes, code_planes, flat_patches, patch_grid, patch_statistics, smoothed};
use super::frame_scene;
use super::noise_figures::{NoiseFigures, NoiseMeasurement, RealAndVirtual};
use super::noise_floor::luma_sigma;
use crate::coding::{BLOCK, PictureCoding};
use crate::compositor::Compositor;
use crate::frame::Frame;
use crate::gpu::Gpu;
use crate::measure::MeasureError;
use crate::measure::detectors::{
    DetectorClassifier, DetectorFamily, DetectorScore, MIN_PATCHES, PATCH_PX, PatchSource, SeparabilityOptions,
    find_repeats, separability,
};
use crate::pixels::{DepthMap, Pixels};
use crate::recording::Recording;
use crate::scene::Scene;
use crate::shot::Shot;
use crate::simulate::random::mix;

/// Number of frames whose patches are examined, spread over the recording. Those with the most flat
/// patches are composited, until there are enough patches.
const CANDIDATE_FRAMES: usize = 24;
const ENOUGH_PATCHES: usize = 240;
/// Largest number of patches of a frame.
const MAX_FRAME_PATCHES: usize = 48;
/// The floor needs two halves.
const MIN_REAL_PATCHES: usize = 2 * MIN_PATCHES;
/// Number of frames in which repeats are sought.
const REPEAT_FRAMES: usize = 2;
/// Distance of the object where depth is unknown, m.
const ASSUMED_DEPTH_M: f32 = 2.0;
/// Opacity of a covered pixel.
const COVERED: f32 = 0.999;
/// Margin of an area above its floor, besides two standard errors. Areas of equal classes vary by
/// 0.06 between recordings (docs/detectors.md), and the largest of eight is judged.
pub const AUC_MARGIN: f64 = 0.15;

/// Detectors that are trained. Repeats are counted instead ([`NoiseComparison::repeats`]).
const FAMILIES: [DetectorFamily; 4] = [
    DetectorFamily::ResidualMoments,
    DetectorFamily::Cooccurrences,
    DetectorFamily::BlockDct,
    DetectorFamily::Combined,
];

/// How well a detector separates virtual noise from the camera's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseScore {
    pub family: DetectorFamily,
    pub classifier: DetectorClassifier,
    /// Area under the ROC curve; 0.5 is chance, 1 complete separation.
    pub auc: f64,
    pub standard_error: f64,
    /// The area for two halves of the real patches.
    pub floor: f64,
}

impl NoiseScore {
    /// The area above the floor, or above chance if the floor is below it.
    pub fn excess(&self) -> f64 {
        self.auc - self.floor.max(0.5)
    }

    /// True if the detector separates virtual noise from real noise by more than chance.
    pub fn is_separated(&self) -> bool {
        self.excess() - 2.0 * self.standard_error > AUC_MARGIN
    }
}

impl fmt::Display for NoiseScore {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let family = match self.family {
            DetectorFamily::ResidualMoments => "moments",
            DetectorFamily::Cooccurrences => "co-occurrences",
            DetectorFamily::BlockDct => "block DCT",
            DetectorFamily::CopyMove => "copy-move",
            DetectorFamily::FrameCorrelation => "frame correlation",
            DetectorFamily::Combined => "combined",
        };
        let classifier = match self.classifier {
            DetectorClassifier::Logistic => "logistic",
            DetectorClassifier::Boosted => "boosted",
        };
        write!(f, "{family}, {classifier}: {:.2} ± {:.2}, floor {:.2}", self.auc, self.standard_error, self.floor)
    }
}

/// Virtual noise beside the camera's.
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseComparison {
    pub frames: Vec<usize>,
    pub patches: usize,
    pub figures: NoiseFigures,
    /// Whether the frames have blocks ([`NoiseFigures::block_contrast`]).
    pub has_blocks: bool,
    /// Number of tiles whose noise repeats elsewhere in their frame, of [`Self::repeat_tiles`].
    pub repeats: RealAndVirtual,
    pub repeat_tiles: usize,
    /// Scores by family, two for each: those of both classifiers.
    pub scores: Vec<NoiseScore>,
}

impl NoiseComparison {
    pub fn mean_auc(&self) -> f64 {
        self.scores.iter().map(|score| score.auc).sum::<f64>() / self.scores.len().max(1) as f64
    }

    /// The detector farthest above its floor.
    pub fn strongest(&self) -> Option<&NoiseScore> {
        self.scores.iter().max_by(|a, b| a.excess().total_cmp(&b.excess()))
    }

    /// True if any detector separates virtual noise from the camera's.
    pub fn is_separated(&self) -> bool {
        self.scores.iter().any(NoiseScore::is_separated)
    }
}

/// Why noise was not compared.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
pub enum NoiseNotCompared {
    #[error("the camera's noise is unknown (`locard calibrate noise` or `locard analyse` measures it)")]
    Unknown,
    #[error("the effect `noise` is off")]
    Off,
    #[error("stopped before it was done")]
    Stopped,
    #[error(
        "{actual} flat patches of 32x32 pixels were found and {MIN_REAL_PATCHES} are needed; frames with plain, evenly \
         lit walls help"
    )]
    FewPatches { actual: usize },
    #[error("the detectors cannot be trained: {0}")]
    Detectors(MeasureError),
}

/// A frame, its composite, and the compared patches.
struct ComparedFrame {
    index: usize,
    real: Pixels,
    composite: Pixels,
    /// Left upper pixel of a block.
    origin_px: [usize; 2],
    patches: Vec<[usize; 2]>,
}

/// Compares the noise of a shot. `progress(done, of)` is called before each frame and at the end.
/// If it returns false, the comparison ends.
pub fn noise(
    gpu: &Gpu,
    verified: &Shot,
    mut progress: impl FnMut(usize, usize) -> bool,
) -> Result<Result<NoiseComparison, NoiseNotCompared>, VerifyError> {
    let Some(profile) = verified.camera().noise else { return Ok(Err(NoiseNotCompared::Unknown)) };
    if !verified.settings.is_on("noise") {
        return Ok(Err(NoiseNotCompared::Off));
    }
    let mut shot = verified.clone();
    shot.settings.plain();
    for (effect, is_on) in [("exposure", true), ("noise", true), ("format", verified.settings.is_on("format"))] {
        let _ = shot.settings.switch(effect, is_on);
    }
    let mut compositor = shot.compositor(gpu.clone());
    let candidates: Vec<usize> = shot.recording.spread_frames(CANDIDATE_FRAMES).collect();
    let steps = 2 * candidates.len() + 1;
    let mut statistics = Vec::new();
    let pictures = shot.recording.without_depth();
    for (done, index) in candidates.iter().enumerate() {
        if !progress(done, steps) {
            return Ok(Err(NoiseNotCompared::Stopped));
        }
        for frame in pictures.frames(*index..index + 1)? {
            let pixels = frame?.pixels;
            let planes = code_planes(&pixels);
            let coding = coding_of(&pictures, &pixels);
            let grid = patch_grid([planes[0].width, planes[0].height], block_origin_px(coding.as_deref()));
            statistics.push(patch_statistics(&planes, &grid));
        }
    }
    let flat = flat_patches(&statistics, |code| luma_sigma(&profile, code));
    let mut by_patches: Vec<_> = candidates.into_iter().zip(flat).filter(|(_, patches)| !patches.is_empty()).collect();
    by_patches.sort_by_key(|(_, patches)| std::cmp::Reverse(patches.len()));
    let (mut frames, mut patch_count) = (Vec::new(), 0);
    for (done, (index, patches)) in by_patches.into_iter().enumerate() {
        if patch_count >= ENOUGH_PATCHES {
            break;
        }
        if !progress(statistics.len() + done, steps) {
            return Ok(Err(NoiseNotCompared::Stopped));
        }
        if let Some(frame) = compared_frame(&mut shot, &mut compositor, index, patches)? {
            patch_count += frame.patches.len();
            frames.push(frame);
        }
    }
    if !progress(steps - 1, steps) {
        return Ok(Err(NoiseNotCompared::Stopped));
    }
    Ok(compare(&frames))
}

/// The coding of a frame's picture, stated by its file or estimated.
fn coding_of(recording: &Recording, pixels: &Pixels) -> Option<Arc<PictureCoding>> {
    pixels.coding.clone().or_else(|| recording.estimated_coding())
}

/// Left upper pixel of a block of a coding.
fn block_origin_px(coding: Option<&PictureCoding>) -> [usize; 2] {
    let origin = coding.and_then(|coding| Some(coding.quantization.as_ref()?.origin)).unwrap_or_default();
    origin.map(|origin| origin.rem_euclid(BLOCK as i32) as usize)
}

/// Composites a frame's smoothed content over it. `None` without a pose or covered patches.
fn compared_frame(
    shot: &mut Shot,
    compositor: &mut Compositor,
    index: usize,
    flat: Vec<[usize; 2]>,
) -> Result<Option<ComparedFrame>, VerifyError> {
    let frame = shot.read(index)?;
    let coding = coding_of(&shot.recording, &frame.pixels);
    let origin_px = block_origin_px(coding.as_deref());
    let planes = code_planes(&frame.pixels);
    let content = smoothed(&planes, &patch_grid([planes[0].width, planes[0].height], origin_px));
    let Some(scene) = content_scene(shot, &frame, &content) else { return Ok(None) };
    compositor.set_scene(scene.clone());
    shot.scene = Arc::new(scene);
    let Some(made) = shot.frames(compositor, index..index + 1, true, 1)?.next().transpose()? else { return Ok(None) };
    let Some(layer) = made.layer else { return Ok(None) };
    let is_covered = |[left, top]: &[usize; 2]| {
        let start = |row: usize| (top + row) * planes[0].width + left;
        (0..PATCH_PX).all(|row| layer.rgba[start(row)..start(row) + PATCH_PX].iter().all(|p| p[3] > COVERED))
    };
    let covered: Vec<[usize; 2]> = flat.into_iter().filter(is_covered).collect();
    let patches = evenly_chosen(&covered, MAX_FRAME_PATCHES);
    if patches.is_empty() {
        return Ok(None);
    }
    let real = Pixels { coding, ..Pixels::clone(&frame.pixels) };
    Ok(Some(ComparedFrame { index, real, composite: made.pixels, origin_px, patches }))
}

/// A frame as an object with content in place of its picture. Without measured depth it is at an
/// arbitrary distance, which does not matter to the frame's own view.
fn content_scene(shot: &Shot, frame: &Frame, content: &CodePlanes) -> Option<Scene> {
    let mut scene = match frame.depth {
        Some(_) => frame_scene(shot, frame)?,
        None => {
            let Pixels { width, height, .. } = *frame.pixels;
            let depth_m = vec![ASSUMED_DEPTH_M; width as usize * height as usize];
            let depth = DepthMap { width, height, depth_m, timestamp_s: frame.timestamp_s };
            frame_scene(shot, &Frame { depth: Some(Arc::new(depth)), ..frame.clone() })?
        }
    };
    let response = shot.camera().response;
    let (width, height) = (content[0].width, content[0].height);
    for vertex in scene.meshes.iter_mut().flat_map(|mesh| &mut Arc::make_mut(mesh).vertices) {
        let [x, y] = [(vertex.uv0[0], width), (vertex.uv0[1], height)].map(|(at, side)| (at * side as f32) as usize);
        let pixel = y.min(height - 1) * width + x.min(width - 1);
        for (color, plane) in vertex.color.iter_mut().zip(content) {
            *color *= response.decode(f64::from(plane.values[pixel]).clamp(0.0, 255.0) / 255.0) as f32;
        }
    }
    scene.materials.iter_mut().for_each(|material| material.base_color_texture = None);
    scene.textures.clear();
    Some(scene)
}

/// At most `count` of the values, evenly spaced.
fn evenly_chosen<T: Copy>(values: &[T], count: usize) -> Vec<T> {
    let chosen = count.min(values.len());
    (0..chosen).map(|n| values[n * values.len() / chosen]).collect()
}

/// True in the patches of a picture.
fn patch_mask(pixels: &Pixels, patches: &[[usize; 2]]) -> Vec<bool> {
    let width = pixels.width as usize;
    let mut mask = vec![false; width * pixels.height as usize];
    for [left, top] in patches {
        (0..PATCH_PX).for_each(|row| mask[(top + row) * width + left..][..PATCH_PX].fill(true));
    }
    mask
}

/// Divides the patches into random halves whose sizes differ by at most 1. Patches of each half, by
/// frame.
fn random_halves(frames: &[ComparedFrame]) -> [Vec<Vec<[usize; 2]>>; 2] {
    let number =
        |frame: &ComparedFrame, [x, y]: [usize; 2]| mix(mix(frame.index as u64 + 1) ^ mix((x as u64) << 32 | y as u64));
    let mut all: Vec<(usize, [usize; 2])> =
        frames.iter().enumerate().flat_map(|(n, frame)| frame.patches.iter().map(move |at| (n, *at))).collect();
    all.sort_by_key(|(n, at)| number(&frames[*n], *at));
    let mut halves = [0; 2].map(|_| vec![Vec::new(); frames.len()]);
    all.into_iter().enumerate().for_each(|(i, (n, at))| halves[i % 2][n].push(at));
    halves
}

fn compare(frames: &[ComparedFrame]) -> Result<NoiseComparison, NoiseNotCompared> {
    let patches = frames.iter().map(|frame| frame.patches.len()).sum();
    if patches < MIN_REAL_PATCHES {
        return Err(NoiseNotCompared::FewPatches { actual: patches });
    }
    let mut measurement = NoiseMeasurement::default();
    for frame in frames {
        let (real, composite) = (code_planes(&frame.real), code_planes(&frame.composite));
        frame.patches.iter().for_each(|at| measurement.add(&real, &composite, *at));
    }
    let failed = NoiseNotCompared::Detectors;
    let (repeats, repeat_tiles) = count_repeats(frames).map_err(failed)?;
    let is_quantized = |frame: &ComparedFrame| frame.real.coding.as_ref().is_some_and(|c| c.quantization.is_some());
    Ok(NoiseComparison {
        frames: frames.iter().map(|frame| frame.index).collect(),
        patches,
        figures: measurement.figures(),
        has_blocks: frames.iter().any(is_quantized),
        repeats,
        repeat_tiles,
        scores: scores(frames).map_err(failed)?,
    })
}

/// Areas of all detectors, with their floors.
fn scores(frames: &[ComparedFrame]) -> Result<Vec<NoiseScore>, MeasureError> {
    let all: Vec<Vec<bool>> = frames.iter().map(|frame| patch_mask(&frame.real, &frame.patches)).collect();
    let halves = random_halves(frames).map(|half| -> Vec<Vec<bool>> {
        frames.iter().zip(&half).map(|(frame, patches)| patch_mask(&frame.real, patches)).collect()
    });
    let options = SeparabilityOptions { families: FAMILIES.to_vec(), ..SeparabilityOptions::default() };
    let detection = separability(&sources(frames, &all, false), &sources(frames, &all, true), &options)?;
    let [first, second] = &halves;
    let floor = separability(&sources(frames, first, false), &sources(frames, second, false), &options)?;
    let score = |(score, floor): (&DetectorScore, &DetectorScore)| NoiseScore {
        family: score.family,
        classifier: score.classifier,
        auc: score.auc,
        standard_error: score.standard_error,
        floor: floor.auc,
    };
    Ok(detection.iter().zip(&floor).map(score).collect())
}

/// The frames, or their composites, with masks.
fn sources<'a>(frames: &'a [ComparedFrame], masks: &'a [Vec<bool>], is_composite: bool) -> Vec<PatchSource<'a>> {
    let source = |(frame, mask): (&'a ComparedFrame, &'a Vec<bool>)| PatchSource {
        pixels: if is_composite { &frame.composite } else { &frame.real },
        mask: Some(mask),
        next: None,
        block_origin_px: frame.origin_px.map(|origin| origin as u32),
    };
    frames.iter().zip(masks).map(source).collect()
}

/// Numbers of tiles that repeat, and of all tiles of one side, in the frames with the most patches.
fn count_repeats(frames: &[ComparedFrame]) -> Result<(RealAndVirtual, usize), MeasureError> {
    let mut largest: Vec<&ComparedFrame> = frames.iter().filter(|frame| frame.patches.len() > 1).collect();
    largest.sort_by_key(|frame| std::cmp::Reverse(frame.patches.len()));
    let (mut repeats, mut tiles) = (RealAndVirtual::default(), 0);
    for frame in largest.into_iter().take(REPEAT_FRAMES) {
        let mask = patch_mask(&frame.real, &frame.patches);
        let count = |pixels: &Pixels| -> Result<f64, MeasureError> {
            let block_origin_px = frame.origin_px.map(|origin| origin as u32);
            let source = PatchSource { pixels, mask: Some(&mask), next: None, block_origin_px };
            Ok(find_repeats(&source)?.iter().filter(|tile| tile.is_repeat()).count() as f64)
        };
        repeats.real += count(&frame.real)?;
        repeats.virtual_ += count(&frame.composite)?;
        tiles += frame.patches.len();
    }
    Ok((repeats, tiles))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn score(auc: f64, floor: f64) -> NoiseScore {
        let (family, classifier) = (DetectorFamily::Combined, DetectorClassifier::Boosted);
        NoiseScore { family, classifier, auc, standard_error: 0.03, floor }
    }

    #[test]
    fn area_is_judged_by_its_excess_over_floor_and_chance() {
        // Above 0.55 + 0.15 + 0.06.
        assert!(score(0.77, 0.55).is_separated() && !score(0.75, 0.55).is_separated());
        // A floor below chance does not count.
        assert!(!score(0.70, 0.30).is_separated());
        assert!((score(0.70, 0.30).excess() - 0.2).abs() < 1e-12);
    }

    #[test]
    fn halves_of_patches_are_disjoint_and_choices_are_spread() {
        let empty = Pixels::from_u8(0, 0, Vec::new()).unwrap();
        let frame = |index: usize, count: usize| ComparedFrame {
            index,
            real: empty.clone(),
            composite: empty.clone(),
            origin_px: [0; 2],
            patches: (0..count).map(|n| [32 * (n % 3), 32 * (n / 3)]).collect(),
        };
        let frames = [frame(4, 9), frame(7, 6)];
        let [first, second] = random_halves(&frames);
        assert_eq!([&first, &second].map(|half| half.iter().map(Vec::len).sum::<usize>()), [8, 7]);
        for ((first, second), frame) in first.into_iter().zip(second).zip(&frames) {
            let mut all = [first, second].concat();
            all.sort_by_key(|[x, y]| (*y, *x));
            assert_eq!(all, frame.patches);
        }
        assert_eq!(evenly_chosen(&[0, 1, 2, 3, 4, 5, 6], 3), [0, 2, 4]);
        assert_eq!(evenly_chosen(&[7, 8], 3), [7, 8]);
    }
}
