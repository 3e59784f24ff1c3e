//! Calibration of the model: noisy frames, and the same view without noise.
//!
//! 1. Residual of a frame: its decoded planes minus those of the mean picture after
//!    [`registration`](super::registration), [filled](super::filling) where it is masked and split
//!    into [`bands`](super::bands).
//! 2. Amplitudes by [`regression`](super::regression) where nothing clips; they normalise the
//!    atlas.
//! 3. Four rounds of indirect inference: up to four of the pictures are synthesised, their
//!    residuals are fitted in the same way as the real ones, and the amplitudes move by the
//!    difference of both fits: by 0.8 of it in the first two rounds, then by 0.5, at most 1.5 for
//!    each coefficient. The table of [`latent`](super::latent) values moves at the same time. The
//!    amplitudes of the last two rounds are averaged.
//!
//! Where the masks leave edges out and the coding has a quantiser, each round synthesises a picture
//! twice: on its mean, and on plain content, the mean blurred by 12 px. Real surfaces have texture,
//! and the quantiser's error of faint texture is a part of real residuals. On a plain virtual
//! surface only noise passes the quantiser, and amplitudes fitted on texture alone leave most
//! blocks of a grey card without any coefficient. Without a quantiser, plain content would take
//! over the residuals of texture: its noise would be 1.4 times too strong.
//!
//! A mean of n frames that includes the frame itself lacks 1/n of the noise's variance;
//! [`CalibrationFrame::variance_gain`] restores it.

use super::atlas::{RESIDUAL_STEP, SourceFrame, UNCLIPPED, USABLE};
use super::bands::{ALL_BANDS, BANDS, FIRST_BAND, split};
use super::content::{FEATURES, FeatureScale, Features};
use super::filling::PlaneFilling;
use super::latent::{LatentStep, LatentTable, smoothed};
use super::masked_blur::MaskedBlur;
use super::model_coding::ModelCoding;
use super::path::{Planes, codes, content_planes, decoded_planes, padded, rgb_of_codes};
use super::persistence::FrameKeys;
use super::registration::correction;
use super::regression::{COEFFICIENTS, Coefficients, ENERGY_FLOOR, fit};
use super::source_picture::SourcePicture;
use super::synthesis::NoiseContent;
use super::{BandGains, ModelError, ModelNumbers, NoiseModel};
use crate::coding::PictureCoding;
use crate::grey_image::GreyImage;

/// Rounds of indirect inference, and the share of the difference by which each moves amplitudes.
const RATES: [f64; 4] = [0.8, 0.8, 0.5, 0.5];
/// Largest change of a coefficient in a round.
const MAX_CHANGE: f64 = 1.5;
/// Largest number of frames that a round synthesises, evenly spaced.
const ROUND_FRAMES: usize = 4;
/// Smallest distance of the pixels of a fit, px, and their largest number. Distances are odd, so
/// that pixels of all phases of the block grid are taken.
const MIN_FIT_STEP: usize = 3;
const MAX_FIT_PIXELS: usize = 100_000;
/// Distance of the pixels from which the features' scale is taken.
const SCALE_STEP: usize = 5;
/// Codes beyond these may be clipped.
const UNCLIPPED_RANGE: [f32; 2] = [10.0, 245.0];
/// Standard deviation of the blur before the lower limit, px.
const CLIPPING_BLUR_PX: f64 = 1.5;
/// Smallest share of unclipped pixels for fits without the clipped ones.
const MIN_UNCLIPPED_SHARE: f32 = 0.03;
/// Standard deviation of the blur of plain content, px: more than a block of the coding.
const PLAIN_BLUR_PX: f64 = 12.0;
/// Fewest frames of a mean picture.
const MIN_MEAN_FRAMES: usize = 4;

/// A noisy frame, and the same view without noise.
#[derive(Clone, Debug, PartialEq)]
pub struct CalibrationFrame {
    /// R', G', B' codes without noise.
    pub mean: Planes,
    /// R', G', B' codes of the frame, interleaved.
    pub noisy: Vec<u8>,
    /// True where a pixel may be used: where nothing moves and, of single frames, where there is no
    /// texture.
    pub mask: Vec<bool>,
    /// Ratio of the noise's variance to that of the frame's difference from the mean.
    pub variance_gain: f32,
}

impl CalibrationFrame {
    /// Up to `count` frames of a camera at rest, evenly spaced, with the mean of all as the picture
    /// without noise. Frames are interleaved R'G'B' codes of the given size.
    pub fn at_rest(frames: &[Vec<u8>], size: [usize; 2], mask: &[bool], count: usize) -> Result<Vec<Self>, ModelError> {
        let n = frames.len();
        if n < MIN_MEAN_FRAMES {
            return Err(ModelError::TooFewFrames { count: n });
        }
        let length = 3 * size[0] * size[1];
        if let Some(frame) = frames.iter().position(|codes| codes.len() != length) {
            return Err(ModelError::Size { frame, actual: [frames[frame].len() / 3, 1], expected: size });
        }
        let mut sums = vec![0u32; length];
        for codes in frames {
            sums.iter_mut().zip(codes).for_each(|(sum, code)| *sum += u32::from(*code));
        }
        let of = |c: usize| sums.iter().skip(c).step_by(3).map(|&sum| sum as f32 / n as f32).collect();
        let mean: Planes = std::array::from_fn(|c| GreyImage { width: size[0], height: size[1], values: of(c) });
        let count = count.clamp(1, n);
        let frame = |i: usize| Self {
            mean: mean.clone(),
            noisy: frames[i * n / count].clone(),
            mask: mask.to_vec(),
            variance_gain: n as f32 / (n - 1) as f32,
        };
        Ok((0..count).map(frame).collect())
    }

    fn size(&self) -> [usize; 2] {
        [self.mean[0].width, self.mean[0].height]
    }
}

/// A frame with its coding. The quantisation can differ from frame to frame.
#[derive(Clone, Copy, Debug)]
pub struct CodedFrame<'a> {
    pub frame: &'a CalibrationFrame,
    pub coding: &'a PictureCoding,
}

/// A frame with the results that do not change during calibration.
#[derive(Clone)]
struct PreparedFrame<'a> {
    frame: &'a CalibrationFrame,
    coding: &'a PictureCoding,
    /// R', G', B' codes on which noise is synthesised.
    content: Planes,
    /// Standardised, at the resolution of luma and of chroma.
    features: [Features; 2],
    /// Means with smoothed dark values, for the table of latent values.
    smoothed: Planes,
    residuals: Planes,
    masked: PlaneFilling,
    bands: Vec<GreyImage>,
    usable: GreyImage,
    unclipped: GreyImage,
}

/// Residuals of a noisy picture in the coded planes.
fn residuals(noisy: &Planes, content: &Planes, mask: &[bool], coding: &PictureCoding) -> Result<Planes, ModelError> {
    let mut content = content.clone();
    for (content, noisy) in content.iter_mut().zip(noisy) {
        let correction = correction(noisy, content, mask);
        content.values.iter_mut().zip(&correction.values).for_each(|(v, c)| *v += c);
    }
    let mut planes = decoded_planes(noisy, coding)?;
    for (plane, content) in planes.iter_mut().zip(&content_planes(&content, coding)?) {
        plane.values.iter_mut().zip(&content.values).for_each(|(v, c)| *v -= c);
    }
    Ok(planes)
}

/// Bands of residuals. Masked ones are filled first: they may be much larger than noise, and the
/// bands of the pixels beside them would contain them.
fn all_bands(planes: &Planes, masked: &PlaneFilling) -> Vec<GreyImage> {
    let bands = |(index, plane): (usize, &GreyImage)| {
        let mut plane = plane.clone();
        masked.fill(&mut plane, index);
        split(&plane, index)
    };
    planes.iter().enumerate().flat_map(bands).collect()
}

/// A mask in the coded picture, 1 or 0.
fn coded_mask(mask: &[bool], size: [usize; 2], coding: &PictureCoding) -> GreyImage {
    let extent = coding.extent(size);
    GreyImage::from_fn(extent.padded[0], extent.padded[1], |x, y| {
        let at = [x.checked_sub(extent.before[0]), y.checked_sub(extent.before[1])];
        let [Some(x), Some(y)] = at else { return 0.0 };
        if x < size[0] && y < size[1] && mask[y * size[0] + x] { 1.0 } else { 0.0 }
    })
}

/// Usable pixels whose 3 × 3 neighbours are not clipped.
fn unclipped_mask(frame: &CalibrationFrame, noisy: &Planes) -> Vec<bool> {
    let blurred = frame.mean.each_ref().map(|plane| plane.blurred(CLIPPING_BLUR_PX));
    let [low, high] = UNCLIPPED_RANGE;
    let free = |i: usize| {
        (0..3).all(|c| {
            let noisy = noisy[c].values[i];
            blurred[c].values[i] > low && frame.mean[c].values[i] < high && noisy > 0.0 && noisy < 255.0
        })
    };
    let [width, height] = frame.size();
    let free = GreyImage::from_fn(width, height, |x, y| free(y * width + x));
    let around = |i: usize| {
        let (x, y) = ((i % width) as i64, (i / width) as i64);
        (-1..=1).all(|dy| (-1..=1).all(|dx| free.clamped(x + dx, y + dy)))
    };
    frame.mask.iter().enumerate().map(|(i, usable)| *usable && around(i)).collect()
}

/// Values of a frame at the places of a fit: features and one energy for each of the plane's bands.
struct FitSamples {
    rows: Vec<[f32; FEATURES]>,
    places: Vec<(usize, usize)>,
}

impl FitSamples {
    fn of(prepared: &[PreparedFrame<'_>], masks: &[&GreyImage], plane: usize, factor: [usize; 2]) -> Self {
        let factor = if plane == 0 { [1, 1] } else { factor };
        let (mut rows, mut places) = (Vec::new(), Vec::new());
        let pixels = prepared.iter().map(|frame| frame.features[plane.min(1)].0[0].values.len()).sum();
        let step = fit_step(pixels);
        for (f, (frame, mask)) in prepared.iter().zip(masks).enumerate() {
            let features = &frame.features[plane.min(1)];
            for y in (0..features.height()).step_by(step) {
                for x in (0..features.width()).step_by(step) {
                    let first = y * factor[1] * mask.width + x * factor[0];
                    let row = |j: usize| &mask.values[first + j * mask.width..][..factor[0]];
                    if (0..factor[1]).all(|j| row(j).iter().all(|&v| v > 0.5)) {
                        let at = y * features.width() + x;
                        rows.push(features.at(at));
                        places.push((f, at));
                    }
                }
            }
        }
        Self { rows, places }
    }
}

/// Distance along each axis between the pixels of a fit to a picture of `pixels` pixels, px.
fn fit_step(pixels: usize) -> usize {
    let mut step = MIN_FIT_STEP;
    while pixels / (step * step) > MAX_FIT_PIXELS {
        step += 2;
    }
    step
}

/// Fits all bands; `bands[i]` belongs to `prepared[i]`.
fn fit_all(
    prepared: &[PreparedFrame<'_>],
    bands: &[&[GreyImage]],
    masks: &[&GreyImage],
    factor: [usize; 2],
    initial: Option<&[Coefficients; ALL_BANDS]>,
) -> [Coefficients; ALL_BANDS] {
    let mut out = [[0.0; COEFFICIENTS]; ALL_BANDS];
    for plane in 0..3 {
        let samples = FitSamples::of(prepared, masks, plane, factor);
        for b in FIRST_BAND[plane]..FIRST_BAND[plane] + BANDS[plane] {
            let energy = |&(f, at): &(usize, usize)| f64::from(bands[f][b].values[at]).powi(2) + ENERGY_FLOOR;
            let energies: Vec<f64> = samples.places.iter().map(energy).collect();
            out[b] = fit(&samples.rows, &energies, initial.map(|initial| &initial[b]));
        }
    }
    out
}

fn to_f32(gains: &[Coefficients; ALL_BANDS]) -> BandGains {
    gains.map(|row| row.map(|v| v as f32))
}

/// Checks sizes and codings; returns the coding that all frames share.
fn checked(frames: &[CodedFrame<'_>]) -> Result<ModelCoding, ModelError> {
    let first = frames.first().ok_or(ModelError::NoFrames)?;
    let expected = first.frame.size();
    for (index, CodedFrame { frame, .. }) in frames.iter().enumerate() {
        let pixels = expected[0] * expected[1];
        let sizes = frame.mean.iter().all(|p| [p.width, p.height] == expected && p.values.len() == pixels);
        if !sizes || frame.noisy.len() != 3 * pixels || frame.mask.len() != pixels {
            return Err(ModelError::Size { frame: index, actual: frame.size(), expected });
        }
    }
    let shared = ModelCoding::of(first.coding).ok_or(ModelError::Grey)?;
    let extent = first.coding.extent(expected);
    let differs =
        |coded: &CodedFrame<'_>| shared.difference(coded.coding).is_some() || coded.coding.extent(expected) != extent;
    match frames.iter().position(differs) {
        Some(frame) => Err(ModelError::Coding { frame }),
        None => Ok(shared),
    }
}

fn feature_scale(raw: &[Features], usable: &[GreyImage]) -> FeatureScale {
    FeatureScale::of(std::array::from_fn(|f| {
        let of = |(features, usable): (&Features, &GreyImage)| -> Vec<f32> {
            let usable = features.0[f].values.iter().zip(&usable.values).filter(|(_, usable)| **usable > 0.5);
            usable.map(|(v, _)| *v).step_by(SCALE_STEP).collect()
        };
        raw.iter().zip(usable).flat_map(of).collect()
    }))
}

fn prepare<'a>(
    CodedFrame { frame, coding }: CodedFrame<'a>,
    features: Features,
    usable: GreyImage,
) -> Result<PreparedFrame<'a>, ModelError> {
    let noisy = rgb_of_codes(&frame.noisy, frame.size());
    let unclipped = coded_mask(&unclipped_mask(frame, &noisy), frame.size(), coding);
    let share = unclipped.values.iter().sum::<f32>() / unclipped.values.len().max(1) as f32;
    let unclipped = if share > MIN_UNCLIPPED_SHARE { unclipped } else { usable.clone() };
    let mut residuals = residuals(&noisy, &frame.mean, &frame.mask, coding)?;
    let gain = frame.variance_gain.sqrt();
    for v in residuals.iter_mut().flat_map(|plane| &mut plane.values) {
        // Files store residuals rounded to this step.
        *v = (*v * gain / RESIDUAL_STEP).round().clamp(-32767.0, 32767.0) * RESIDUAL_STEP;
    }
    let factor = coding.chroma_factor().map(|factor| factor as usize);
    let chroma = features.reduced(factor);
    let masked = PlaneFilling::new(&usable, factor);
    let bands = all_bands(&residuals, &masked);
    let smoothed = frame.mean.each_ref().map(smoothed);
    let features = [features, chroma];
    let content = frame.mean.clone();
    Ok(PreparedFrame { frame, coding, content, features, smoothed, residuals, masked, bands, usable, unclipped })
}

/// Content of a frame without texture where it is usable.
fn plain_content(frame: &CalibrationFrame) -> Planes {
    let blur = MaskedBlur::new(&frame.mask, frame.size(), PLAIN_BLUR_PX);
    frame.mean.each_ref().map(|plane| {
        let mut plain = blur.mean_of(|i| plane.values[i]);
        let usable = frame.mask.iter().zip(&plane.values);
        plain.values.iter_mut().zip(usable).filter(|(_, (usable, _))| !**usable).for_each(|(v, (_, own))| *v = *own);
        plain
    })
}

impl PreparedFrame<'_> {
    /// Combines the frame's residuals with other content.
    fn on_content(&self, content: &Planes, scale: &FeatureScale) -> Self {
        let features = scale.standardised(Features::of(&padded(content, self.coding)));
        let chroma = features.reduced(self.coding.chroma_factor().map(|factor| factor as usize));
        let smoothed = content.each_ref().map(smoothed);
        Self { content: content.clone(), features: [features, chroma], smoothed, ..self.clone() }
    }

    fn source(&self) -> SourceFrame {
        let [r, g, b] = padded(&self.frame.mean, self.coding);
        let code = |v: f32| v.round().clamp(0.0, 255.0) as u8;
        let pixels = r.values.iter().zip(&g.values).zip(&b.values);
        let flag = |(usable, unclipped): (&f32, &f32)| {
            (if *usable > 0.5 { USABLE } else { 0 }) | (if *unclipped > 0.5 { UNCLIPPED } else { 0 })
        };
        SourceFrame {
            size: [r.width, r.height],
            content: pixels.map(|((r, g), b)| [code(*r), code(*g), code(*b)]).collect(),
            residuals: self
                .residuals
                .each_ref()
                .map(|plane| plane.values.iter().map(|v| (v / RESIDUAL_STEP).round() as i16).collect()),
            flags: self.usable.values.iter().zip(&self.unclipped.values).map(flag).collect(),
            picture: Some(SourcePicture::new(self.frame.size(), self.coding)),
        }
    }
}

/// Calibrates a model of frames with one coding.
pub fn calibrate(frames: &[CalibrationFrame], coding: &PictureCoding, seed: u32) -> Result<NoiseModel, ModelError> {
    let coded: Vec<CodedFrame<'_>> = frames.iter().map(|frame| CodedFrame { frame, coding }).collect();
    calibrate_coded(&coded, seed)
}

/// Calibrates a model. `seed` selects the noise of the rounds; equal inputs give equal models.
pub fn calibrate_coded(frames: &[CodedFrame<'_>], seed: u32) -> Result<NoiseModel, ModelError> {
    calibrate_on(frames, seed, false)
}

/// Like [`calibrate_coded`], and on plain content if there is a quantiser. The masks leave edges
/// out.
pub fn calibrate_smooth_places(frames: &[CodedFrame<'_>], seed: u32) -> Result<NoiseModel, ModelError> {
    calibrate_on(frames, seed, frames.iter().any(|frame| frame.coding.quantization.is_some()))
}

fn calibrate_on(frames: &[CodedFrame<'_>], seed: u32, with_plain: bool) -> Result<NoiseModel, ModelError> {
    let shared = checked(frames)?;
    let factor = shared.chroma.factor.map(|factor| factor as usize);
    let raw: Vec<Features> = frames.iter().map(|f| Features::of(&padded(&f.frame.mean, f.coding))).collect();
    let usable = |f: &CodedFrame<'_>| coded_mask(&f.frame.mask, f.frame.size(), f.coding);
    let usable: Vec<GreyImage> = frames.iter().map(usable).collect();
    if usable.iter().flat_map(|mask| &mask.values).all(|&v| v < 0.5) {
        return Err(ModelError::TooFewTiles { actual: [0; 4] });
    }
    let mut scale = feature_scale(&raw, &usable);
    let plain: Vec<Planes> = frames.iter().filter(|_| with_plain).map(|coded| plain_content(coded.frame)).collect();
    if with_plain {
        let features: Vec<Features> =
            frames.iter().zip(&plain).map(|(coded, plain)| Features::of(&padded(plain, coded.coding))).collect();
        scale = scale.reaching_down_to(&feature_scale(&features, &usable));
    }
    let prepared = frames.iter().zip(raw).zip(usable);
    let prepared = prepared.map(|((frame, raw), usable)| prepare(*frame, scale.standardised(raw), usable));
    let prepared: Vec<PreparedFrame<'_>> = prepared.collect::<Result<_, _>>()?;

    let real: Vec<&[GreyImage]> = prepared.iter().map(|p| p.bands.as_slice()).collect();
    let clear: Vec<&GreyImage> = prepared.iter().map(|p| &p.unclipped).collect();
    let mut gains = fit_all(&prepared, &real, &clear, factor, None);
    let atlas_gains = to_f32(&gains);
    let numbers = ModelNumbers {
        scale,
        gains: atlas_gains,
        atlas_gains,
        latent: LatentTable::default(),
        coding: shared,
        frame_correlation: 0.0,
    };
    let mut model = NoiseModel::new(numbers, prepared.iter().map(|p| p.source()).collect())?;

    let every = prepared.len().div_ceil(ROUND_FRAMES);
    let textured: Vec<PreparedFrame<'_>> = prepared.into_iter().step_by(every).collect();
    let plain = textured.iter().zip(plain.iter().step_by(every)).map(|(p, plain)| p.on_content(plain, &scale));
    let plain: Vec<PreparedFrame<'_>> = plain.collect();
    let prepared: Vec<PreparedFrame<'_>> = textured.into_iter().chain(plain).collect();
    let real: Vec<&[GreyImage]> = prepared.iter().map(|p| p.bands.as_slice()).collect();
    let whole: Vec<&GreyImage> = prepared.iter().map(|p| &p.usable).collect();
    let target = fit_all(&prepared, &real, &whole, factor, None);
    let mut previous = gains;
    for (round, rate) in RATES.into_iter().enumerate() {
        let mut step = LatentStep::default();
        let mut synthesised = Vec::with_capacity(prepared.len());
        for (f, p) in prepared.iter().enumerate() {
            let codes = synthesise(&model, &p.content, p.coding, [seed, round as u32, f as u32])?;
            for (i, _) in p.frame.mask.iter().enumerate().filter(|(_, usable)| **usable) {
                for c in 0..3 {
                    step.add(c, p.smoothed[c].values[i], p.frame.noisy[3 * i + c], codes[3 * i + c]);
                }
            }
            let noisy = rgb_of_codes(&codes, p.frame.size());
            synthesised.push(all_bands(&residuals(&noisy, &p.content, &p.frame.mask, p.coding)?, &p.masked));
        }
        let bands: Vec<&[GreyImage]> = synthesised.iter().map(Vec::as_slice).collect();
        let got = fit_all(&prepared, &bands, &whole, factor, Some(&target));
        previous = gains;
        let gain = gains.iter_mut().flatten();
        for ((gain, target), got) in gain.zip(target.iter().flatten()).zip(got.iter().flatten()) {
            *gain += (rate * (target - got)).clamp(-MAX_CHANGE, MAX_CHANGE);
        }
        model.numbers.gains = to_f32(&gains);
        step.apply(&mut model.numbers.latent);
    }
    gains.iter_mut().flatten().zip(previous.iter().flatten()).for_each(|(v, before)| *v = 0.5 * (*v + before));
    model.numbers.gains = to_f32(&gains);
    Ok(model)
}

/// A picture of the camera's content with noise, as the camera would have coded and decoded it:
/// latent values, noise in the coded planes, coding, decoder. Interleaved R'G'B' codes.
pub fn synthesise(
    model: &NoiseModel,
    clean: &Planes,
    coding: &PictureCoding,
    key: [u32; 3],
) -> Result<Vec<u8>, ModelError> {
    let content = padded(clean, coding);
    let noise = model.noise(&NoiseContent { rgb: &content, share: None, factor: None }, &FrameKeys::single(key));
    let mut planes = content_planes(&model.numbers.latent.latent(clean), coding)?;
    for (plane, noise) in planes.iter_mut().zip(noise) {
        plane.values.iter_mut().zip(&noise.values).for_each(|(v, n)| *v += n);
    }
    Ok(codes(planes, coding, [clean[0].width, clean[0].height]))
}
