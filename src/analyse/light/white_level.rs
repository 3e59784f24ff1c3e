//! The white level W of a place: light of upward-facing matt white with reflectance 1, or the
//! reason for which it cannot be claimed.
//!
//! The brightest upward-facing surfaces near the place are taken for white, whose reflectance is
//! about 0.8: paper reflects 0.75 to 0.9, white paint 0.65 to 0.85. Their top is the 98 % quantile
//! of luminance by Kaplan and Meier, because clipped channels are lower bounds. A gate compares
//! them with the properties of white surfaces and with the camera's exposure (AE). If it rejects
//! them, W follows from the exposure alone, with an interval of a factor of two each way.
//!
//! Claim, unclipped: ln W = 0.85·ln(top/0.8) + 0.15·ln AE. Clipped: AE between top/0.8 and 1.4
//! times that. Not modelled: grey surfaces that agree with the exposure are mistaken for white;
//! light that varies within the radius.

use std::fmt;

use glam::DVec3;

use super::exposure::ExposureLevel;
use super::sample::relative_luminance;
use super::voxels::{SIDE_M, Voxel};
use crate::fit::kaplan_meier::{CensoredSample, kaplan_meier};
use crate::fit::quantile::upper_median;

/// Quantile of the room's reflectances that counts as white if the lamps are known.
const WHITE_QUANTILE: f64 = 0.995;
/// Quantiles of the white level's interval.
const WHITE_INTERVAL_QUANTILES: [f64; 2] = [0.99, 0.999];
/// Factor that widens the interval each way.
const INTERVAL_FACTOR: f64 = 1.1;
/// Minimum number of upward-facing voxels; with fewer, all others are used too.
const MIN_UPWARD_VOXELS: usize = 400;
/// Smallest light of a used surface by that at the place. In shadow, at a distance or at grazing
/// angles, errors of a lamp's position have the largest effect on the reflectance.
const MIN_RELATIVE_LIGHT: f64 = 0.5;
/// Largest factor between the white level that lamps imply and the exposure's.
const LAMPS_AGREE: f64 = 2.0;
/// Reflectance of the brightest neutral surfaces, and the largest of any matt surface.
pub const WHITE_REFLECTANCE: f64 = 0.8;
const MAX_REFLECTANCE: f64 = 0.9;
/// Radii around the place, in turn, until one contains enough upward-facing area.
const RADII_M: [f64; 3] = [0.8, 1.2, 2.0];
const MIN_AREA_M2: f64 = 0.27;
/// Smallest cosine with up of an upward-facing normal.
const MIN_UPWARD_COS: f64 = 0.8;
/// Quantile of luminance that is the top.
const TOP_QUANTILE: f64 = 0.98;
/// Smallest luminance of surfaces that belong to the top, by the top.
const MIN_TOP_SHARE: f64 = 0.75;
/// Largest saturation of the top by the frames' own white balance: white under warm lamps is below,
/// wood above.
const MAX_SATURATION: f64 = 0.42;
/// Smallest and largest fraction of the upward-facing area in an unclipped top.
const MIN_SHARE: f64 = 0.05;
const MAX_SHARE: f64 = 0.5;
/// Largest ratio of the top within 1.5 times the radius to the top within the radius.
const WIDER_RADIUS: f64 = 1.5;
const MAX_GROWTH: f64 = 1.4;
/// Largest ratio of an unclipped top's luminance between parts of the frames:
/// e^[`UPWARD_SIGMA_LN`].
const MAX_DISPARITY: f64 = 1.35;
/// Smallest area seen in both parts, m².
const MIN_SHARED_M2: f64 = 0.01;
/// Largest factor between top/0.8 and the exposure, unclipped and clipped.
const MAX_DISAGREEMENT: f64 = 1.5;
const MAX_DISAGREEMENT_CLIPPED: f64 = 2.0;
/// Weight of the exposure in an unclipped claim.
const EXPOSURE_WEIGHT: f64 = 0.15;
/// Uncertainty of an unclipped claim, ln: downwards, upwards, and by the disagreement
/// with the exposure.
const DOWNWARD_SIGMA_LN: f64 = 0.15;
const UPWARD_SIGMA_LN: f64 = 0.3;
const DISAGREEMENT_SHARE: f64 = 0.4;
/// Largest factors over a clipped top: of the claim, and of the end of its interval.
const MAX_OVER_CLIPPED: f64 = 1.4;
const MAX_INTERVAL_OVER_CLIPPED: f64 = 1.6;
/// Largest W of an unclaimed level by the exposure, and the factor of its interval.
const MAX_RAISE: f64 = 1.5;
const UNCLAIMED_FACTOR: f64 = 2.0;
/// Surfaces that give the light's colour: smallest cosine with up, largest saturation, smallest
/// brightness by the top, smallest area, and the area at which their weight equals that of the
/// exposure's neutral.
const MIN_COLOUR_COS: f64 = 0.5;
const MAX_COLOUR_SATURATION: f64 = 0.25;
const MIN_COLOUR_BRIGHTNESS: f64 = 0.7;
const MIN_COLOUR_M2: f64 = 0.009;
const COLOUR_HALF_WEIGHT_M2: f64 = 0.09;

/// A surface element of one voxel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch {
    pub position_m: DVec3,
    pub normal: DVec3,
    /// Linear light as it would be at the place, and whether any channel is a lower bound.
    pub light: [f64; 3],
    pub is_bound: bool,
    /// Light by the first half of the frames, by the second, and by all: 34 % quantiles by
    /// luminance, that is medians without the brightest third. `None` where too few frames saw it.
    pub parts: [Option<[f64; 3]>; 3],
    /// Linear light of the frames themselves, not divided by their gains.
    pub code: [f64; 3],
    /// Luminance of its brightest sample, as it would be at the place.
    pub brightest: f64,
}

/// Surfaces with their light normalised to that at the place. `relative`: light on a voxel by the
/// light at the place. Surfaces with little light are left out.
pub fn patches(voxels: &[Voxel], relative: impl Fn(&Voxel) -> f64) -> Vec<Patch> {
    let lit =
        voxels.iter().map(|voxel| (voxel, relative(voxel))).filter(|(_, relative)| *relative > MIN_RELATIVE_LIGHT);
    lit.map(|(voxel, relative)| Patch::of(voxel, relative)).collect()
}

impl Patch {
    /// `relative`: light on the voxel by the light at the place.
    pub fn of(voxel: &Voxel, relative: f64) -> Self {
        Self {
            position_m: voxel.position_m,
            normal: voxel.normal,
            light: voxel.median.map(|light| f64::from(light) / relative),
            is_bound: voxel.is_bound.contains(&true),
            parts: voxel.light.map(|light| light.map(|light| light.map(|channel| f64::from(channel) / relative))),
            code: voxel.code.map(f64::from),
            brightest: f64::from(voxel.brightest) / relative,
        }
    }

    fn saturation(&self) -> f64 {
        let max_code = self.code.into_iter().fold(0.0, f64::max);
        (max_code - self.code.into_iter().fold(f64::INFINITY, f64::min)) / max_code.max(1e-4)
    }
}

/// The reason for which a white level is not claimed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum WhiteLevelRefusal {
    TooFew,
    Coloured { saturation: f64 },
    Ground,
    Scrap,
    Varies { growth: f64 },
    Differs { factor: f64 },
    Disagrees { factor: f64 },
}

impl fmt::Display for WhiteLevelRefusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooFew => write!(f, "too little upward-facing surface was seen near the place"),
            Self::Coloured { saturation } => {
                let percent = 100.0 * saturation;
                write!(f, "the brightest surfaces are coloured (saturation {percent:.0} %), as wood and warm light are")
            }
            Self::Ground => write!(f, "the ground itself is brightest, with nothing whiter on it"),
            Self::Scrap => write!(f, "the brightest area is too small"),
            Self::Varies { growth } => {
                write!(f, "the light varies: half as far again it is {growth:.1} times as bright")
            }
            Self::Differs { factor } => {
                write!(f, "parts of the frames show the brightest surfaces {factor:.1} times as bright as others do")
            }
            Self::Disagrees { factor } => {
                write!(f, "the brightest surfaces and the camera's exposure disagree by a factor of {factor:.1}")
            }
        }
    }
}

/// The white level of a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WhiteLevel {
    /// W, linear: red, green, blue.
    pub white: [f64; 3],
    /// Luminances between which it lies.
    pub between: [f64; 2],
    pub unclaimed: Option<WhiteLevelRefusal>,
}

/// The brightest upward-facing surfaces around a place.
#[derive(Clone, Copy, Debug, PartialEq)]
struct BrightestSurfaces {
    radius_m: f64,
    /// Luminance, and whether it is a lower bound.
    luminance: f64,
    is_bound: bool,
    saturation: f64,
    /// Share of the upward-facing surfaces.
    share: f64,
    growth: f64,
    /// Largest factor between two parts of the frames, in the median of the surfaces that both saw.
    disparity: f64,
}

/// The largest median factor by which two parts of the frames differ in the luminance of the same
/// surfaces; 1 where they share too few.
fn disparity(at_top: &[&Patch]) -> f64 {
    let factor = |a: &dyn Fn(&Patch) -> Option<[f64; 3]>, b: &dyn Fn(&Patch) -> Option<[f64; 3]>| {
        let ln = |patch: &&Patch| {
            let [a, b] = [a(patch)?, b(patch)?].map(|light| relative_luminance(light).max(1e-6));
            Some((a / b).ln())
        };
        let shared: Vec<f64> = at_top.iter().filter(|patch| !patch.is_bound).filter_map(ln).collect();
        if area_m2(shared.len()) < MIN_SHARED_M2 { 1.0 } else { upper_median(shared).map_or(1.0, |ln| ln.abs().exp()) }
    };
    let halves = factor(&|patch| patch.parts[0], &|patch| patch.parts[1]);
    let without_brightest = factor(&|patch| patch.parts[2], &|patch| Some(patch.light));
    halves.max(without_brightest)
}

impl BrightestSurfaces {
    /// `None` where too little faces up.
    fn of(patches: &[Patch], up: DVec3, place: DVec3) -> Option<Self> {
        let upward: Vec<&Patch> = patches.iter().filter(|patch| patch.normal.dot(up) > MIN_UPWARD_COS).collect();
        let within = |radius_m: f64| -> Vec<&Patch> {
            upward.iter().copied().filter(|patch| patch.position_m.distance(place) < radius_m).collect()
        };
        let is_enough = |patches: &Vec<&Patch>| area_m2(patches.len()) >= MIN_AREA_M2;
        let (radius_m, near) =
            RADII_M.iter().map(|radius_m| (*radius_m, within(*radius_m))).find(|(_, near)| is_enough(near))?;
        let (luminance, is_bound) = top_of(&near)?;
        let (wider, _) = top_of(&within(WIDER_RADIUS * radius_m))?;
        let bright = |patch: &&&Patch| patch.is_bound || relative_luminance(patch.light) > MIN_TOP_SHARE * luminance;
        let at_top: Vec<&Patch> = near.iter().filter(bright).copied().collect();
        let saturations = at_top.iter().map(|patch| if patch.is_bound { 0.0 } else { patch.saturation() });
        Some(Self {
            radius_m,
            luminance,
            is_bound,
            saturation: upper_median(saturations).unwrap_or(0.0),
            share: at_top.len() as f64 / near.len() as f64,
            growth: wider / luminance,
            disparity: disparity(&at_top),
        })
    }

    /// W by the top alone.
    fn level(&self) -> f64 {
        self.luminance / WHITE_REFLECTANCE
    }

    /// The first reason against a claim, if there is one.
    fn refusal(&self, exposure: f64) -> Option<WhiteLevelRefusal> {
        let disagreement = (self.level() / exposure).ln().abs().exp();
        let agrees = if self.is_bound { MAX_DISAGREEMENT_CLIPPED } else { MAX_DISAGREEMENT };
        match self {
            Self { saturation, .. } if *saturation > MAX_SATURATION => {
                Some(WhiteLevelRefusal::Coloured { saturation: *saturation })
            }
            Self { is_bound: false, share, .. } if *share > MAX_SHARE => Some(WhiteLevelRefusal::Ground),
            Self { is_bound: false, share, .. } if *share < MIN_SHARE => Some(WhiteLevelRefusal::Scrap),
            Self { growth, .. } if *growth > MAX_GROWTH => Some(WhiteLevelRefusal::Varies { growth: *growth }),
            Self { is_bound: false, disparity, .. } if *disparity > MAX_DISPARITY => {
                Some(WhiteLevelRefusal::Differs { factor: *disparity })
            }
            _ if disagreement > agrees => Some(WhiteLevelRefusal::Disagrees { factor: disagreement }),
            _ => None,
        }
    }

    /// W and its interval, if there is no refusal.
    fn claim(&self, exposure: f64) -> (f64, [f64; 2]) {
        let (level, min_level) = (self.level(), self.luminance / MAX_REFLECTANCE);
        if self.is_bound {
            return (exposure.clamp(level, MAX_OVER_CLIPPED * level), [min_level, MAX_INTERVAL_OVER_CLIPPED * level]);
        }
        let off = (level / exposure).ln();
        let white = (level.ln() - EXPOSURE_WEIGHT * off).exp();
        let [down, upwards] = [DOWNWARD_SIGMA_LN, UPWARD_SIGMA_LN].map(|ln| ln.hypot(DISAGREEMENT_SHARE * off).exp());
        (white, [min_level.max(white / down), white * upwards])
    }
}

/// Neutral of the exposure, moved towards the median colour of bright, nearly neutral surfaces by
/// their area: those within a radius of the place, by a luminance of the brightest.
fn colour(patches: &[Patch], up: DVec3, place: DVec3, (radius_m, top): (f64, f64), neutral: [f64; 3]) -> [f64; 3] {
    let shows = |patch: &&Patch| {
        patch.position_m.distance(place) < radius_m
            && patch.normal.dot(up) > MIN_COLOUR_COS
            && !patch.is_bound
            && patch.saturation() < MAX_COLOUR_SATURATION
            && relative_luminance(patch.light) > MIN_COLOUR_BRIGHTNESS * top
    };
    let shown: Vec<&Patch> = patches.iter().filter(shows).collect();
    let area = area_m2(shown.len());
    if area < MIN_COLOUR_M2 {
        return neutral;
    }
    let ln = |c: usize| upper_median(shown.iter().map(|patch| patch.light[c].max(1e-3).ln())).unwrap_or(0.0);
    let weight = area / (area + COLOUR_HALF_WEIGHT_M2);
    let green = ln(1);
    [0, 1, 2].map(|c| (weight * (ln(c) - green) + (1.0 - weight) * neutral[c].ln()).exp())
}

fn area_m2(voxels: usize) -> f64 {
    voxels as f64 * SIDE_M * SIDE_M
}

fn top_of(patches: &[&Patch]) -> Option<(f64, bool)> {
    let value = |patch: &&Patch| (relative_luminance(patch.light) as f32, 1.0, patch.is_bound);
    let mut values: Vec<CensoredSample> = patches.iter().map(value).collect();
    kaplan_meier(&mut values, TOP_QUANTILE)
        .map(|(value, is_bound)| (f64::from(value), is_bound))
        .filter(|(value, _)| *value > 0.0)
}

/// `tint` at a luminance.
fn coloured(tint: [f64; 3], luminance: f64) -> [f64; 3] {
    tint.map(|channel| channel * luminance / relative_luminance(tint))
}

/// The white level at a place.
pub fn white_level(patches: &[Patch], up: DVec3, place: DVec3, exposure: &ExposureLevel) -> WhiteLevel {
    let top = BrightestSurfaces::of(patches, up, place);
    let Some(top) = top else { return unclaimed(None, exposure, WhiteLevelRefusal::TooFew) };
    if let Some(why) = top.refusal(exposure.level) {
        return unclaimed(Some(&top), exposure, why);
    }
    let (white, between) = top.claim(exposure.level);
    let tint = colour(patches, up, place, (top.radius_m, top.luminance), exposure.neutral);
    WhiteLevel { white: coloured(tint, white), between, unclaimed: None }
}

/// The white level with known lamps. They explain the relative light of surfaces, so the whitest
/// surfaces of the whole room are used, each by its brightest sample. `None` if the result
/// contradicts the exposure: a lamp is wrong.
pub fn white_level_by_lamps(
    patches: &[Patch],
    up: DVec3,
    place: DVec3,
    exposure: &ExposureLevel,
) -> Option<WhiteLevel> {
    let face_samples = |faces: &dyn Fn(&&Patch) -> bool| -> Vec<CensoredSample> {
        patches.iter().filter(faces).map(|patch| (patch.brightest as f32, 1.0, patch.is_bound)).collect()
    };
    let mut values = face_samples(&|patch| patch.normal.dot(up) > MIN_UPWARD_COS);
    if values.len() < MIN_UPWARD_VOXELS {
        values = face_samples(&|_| true);
    }
    let mut level = |share: f64| {
        kaplan_meier(&mut values, share).map(|(value, is_bound)| (f64::from(value) / WHITE_REFLECTANCE, is_bound))
    };
    let (whitest, is_bound) = level(WHITE_QUANTILE)?;
    let [low, high] = [level(WHITE_INTERVAL_QUANTILES[0])?.0, level(WHITE_INTERVAL_QUANTILES[1])?.0];
    let off = (whitest / exposure.level).ln();
    if !(whitest > 0.0 && off.abs() < LAMPS_AGREE.ln()) {
        return None;
    }
    let (white, farthest) = if is_bound {
        (exposure.level.clamp(whitest, MAX_OVER_CLIPPED * whitest), MAX_INTERVAL_OVER_CLIPPED * whitest)
    } else {
        ((whitest.ln() - EXPOSURE_WEIGHT * off).exp(), 0.0)
    };
    let tint = colour(patches, up, place, (f64::INFINITY, WHITE_REFLECTANCE * white), exposure.neutral);
    let between = [
        (low / INTERVAL_FACTOR).min(white / INTERVAL_FACTOR),
        (high * INTERVAL_FACTOR).max(white * INTERVAL_FACTOR).max(farthest),
    ];
    Some(WhiteLevel { white: coloured(tint, white), between, unclaimed: None })
}

/// The white level by the exposure, raised if the brightest surface would exceed the largest
/// reflectance.
fn unclaimed(top: Option<&BrightestSurfaces>, exposure: &ExposureLevel, why: WhiteLevelRefusal) -> WhiteLevel {
    let ExposureLevel { level, neutral } = *exposure;
    let white = top.map_or(level, |top| (top.luminance / MAX_REFLECTANCE).clamp(level, MAX_RAISE * level));
    let between = [level / UNCLAIMED_FACTOR, UNCLAIMED_FACTOR * white];
    WhiteLevel { white: coloured(neutral, white), between, unclaimed: Some(why) }
}

#[cfg(test)]
mod tests;
