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
//!
//! A quarter of the file is its tests.

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
    pub at: DVec3,
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
            at: voxel.at,
            normal: voxel.normal,
            light: voxel.median.map(|light| f64::from(light) / relative),
            is_bound: voxel.is_bound.contains(&true),
            parts: voxel.light.map(|light| light.map(|light| light.map(|channel| f64::from(channel) / relative))),
            code: voxel.code.map(f64::from),
            brightest: f64::from(voxel.brightest) / relative,
        }
    }

    fn saturation(&self) -> f64 {
        let most = self.code.into_iter().fold(0.0, f64::max);
        (most - self.code.into_iter().fold(f64::INFINITY, f64::min)) / most.max(1e-4)
    }
}

/// The reason for which a white level is not claimed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Unclaimed {
    TooFew,
    Coloured { saturation: f64 },
    Ground,
    Scrap,
    Varies { growth: f64 },
    Differs { factor: f64 },
    Disagrees { factor: f64 },
}

impl fmt::Display for Unclaimed {
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
    pub unclaimed: Option<Unclaimed>,
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
            upward.iter().copied().filter(|patch| patch.at.distance(place) < radius_m).collect()
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
    fn refusal(&self, exposure: f64) -> Option<Unclaimed> {
        let disagreement = (self.level() / exposure).ln().abs().exp();
        let agrees = if self.is_bound { MAX_DISAGREEMENT_CLIPPED } else { MAX_DISAGREEMENT };
        match self {
            Self { saturation, .. } if *saturation > MAX_SATURATION => {
                Some(Unclaimed::Coloured { saturation: *saturation })
            }
            Self { is_bound: false, share, .. } if *share > MAX_SHARE => Some(Unclaimed::Ground),
            Self { is_bound: false, share, .. } if *share < MIN_SHARE => Some(Unclaimed::Scrap),
            Self { growth, .. } if *growth > MAX_GROWTH => Some(Unclaimed::Varies { growth: *growth }),
            Self { is_bound: false, disparity, .. } if *disparity > MAX_DISPARITY => {
                Some(Unclaimed::Differs { factor: *disparity })
            }
            _ if disagreement > agrees => Some(Unclaimed::Disagrees { factor: disagreement }),
            _ => None,
        }
    }

    /// W and its interval, if there is no refusal.
    fn claim(&self, exposure: f64) -> (f64, [f64; 2]) {
        let (level, least) = (self.level(), self.luminance / MAX_REFLECTANCE);
        if self.is_bound {
            return (exposure.clamp(level, MAX_OVER_CLIPPED * level), [least, MAX_INTERVAL_OVER_CLIPPED * level]);
        }
        let off = (level / exposure).ln();
        let white = (level.ln() - EXPOSURE_WEIGHT * off).exp();
        let [down, upwards] = [DOWNWARD_SIGMA_LN, UPWARD_SIGMA_LN].map(|ln| ln.hypot(DISAGREEMENT_SHARE * off).exp());
        (white, [least.max(white / down), white * upwards])
    }
}

/// Neutral of the exposure, moved towards the median colour of bright, nearly neutral surfaces by
/// their area: those within a radius of the place, by a luminance of the brightest.
fn colour(patches: &[Patch], up: DVec3, place: DVec3, (radius_m, top): (f64, f64), neutral: [f64; 3]) -> [f64; 3] {
    let shows = |patch: &&Patch| {
        patch.at.distance(place) < radius_m
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
    let Some(top) = top else { return unclaimed(None, exposure, Unclaimed::TooFew) };
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
    let of = |faces: &dyn Fn(&&Patch) -> bool| -> Vec<CensoredSample> {
        patches.iter().filter(faces).map(|patch| (patch.brightest as f32, 1.0, patch.is_bound)).collect()
    };
    let mut values = of(&|patch| patch.normal.dot(up) > MIN_UPWARD_COS);
    if values.len() < MIN_UPWARD_VOXELS {
        values = of(&|_| true);
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
fn unclaimed(top: Option<&BrightestSurfaces>, exposure: &ExposureLevel, why: Unclaimed) -> WhiteLevel {
    let ExposureLevel { level, neutral } = *exposure;
    let white = top.map_or(level, |top| (top.luminance / MAX_REFLECTANCE).clamp(level, MAX_RAISE * level));
    let between = [level / UNCLAIMED_FACTOR, UNCLAIMED_FACTOR * white];
    WhiteLevel { white: coloured(neutral, white), between, unclaimed: Some(why) }
}

#[cfg(test)]
mod tests {
    use super::*;

    const EXPOSURE: ExposureLevel = ExposureLevel { level: 1.0, neutral: [1.0; 3] };

    fn patch(at: DVec3, light: f64) -> Patch {
        Patch {
            at,
            normal: DVec3::Z,
            light: [light; 3],
            is_bound: false,
            parts: [None; 3],
            code: [light; 3],
            brightest: light,
        }
    }

    /// 1000 voxels of 2 cm that face up within 0.5 m, of which `white` show 0.8 and the others 0.3,
    /// grey.
    fn desk(white: usize) -> Vec<Patch> {
        let at = |n: usize| DVec3::new(0.02 * (n % 25) as f64 - 0.25, 0.02 * (n / 25) as f64 - 0.4, 0.0);
        (0..1000).map(|n| patch(at(n), if n < white { 0.8 } else { 0.3 })).collect()
    }

    #[test]
    fn surfaces_in_deep_shadow_are_not_used_for_white() {
        // A desk of 0.8, of which 1 % lies in a shadow whose depth is overestimated by ten.
        let voxels: Vec<Voxel> = desk(1000).iter().map(|p| Voxel::of_surface(p.at, p.normal, [0.8; 3])).collect();
        let relative = |voxel: &Voxel| if voxel.at.x > 0.229 && voxel.at.y > 0.1 { 0.1 } else { 1.0 };
        let lit = patches(&voxels, relative);
        assert_eq!(lit.len(), 986);
        let level = white_level_by_lamps(&lit, DVec3::Z, DVec3::ZERO, &EXPOSURE).unwrap();
        assert!((relative_luminance(level.white) - 1.0).abs() < 1e-6, "{level:?}");
    }

    fn level(patches: &[Patch], exposure: &ExposureLevel) -> WhiteLevel {
        white_level(patches, DVec3::Z, DVec3::ZERO, exposure)
    }

    fn is_about(found: f64, expected: f64) -> bool {
        (found / expected - 1.0).abs() < 1e-5
    }

    #[test]
    fn paper_on_a_desk_is_claimed_with_its_interval() {
        let found = level(&desk(200), &EXPOSURE);
        assert_eq!(found.unclaimed, None);
        // It agrees with the exposure: 0.8 / 0.8, never below 0.8 / 0.9, up to e^0.3.
        assert!(found.white.iter().all(|white| is_about(*white, 1.0)), "{found:?}");
        assert!(is_about(found.between[0], 0.8 / 0.9) && is_about(found.between[1], 0.3f64.exp()), "{found:?}");
        // With an exposure of 1.4: 1.4^0.15, and 0.4·ln 1.4 widens the interval.
        let found = level(&desk(200), &ExposureLevel { level: 1.4, ..EXPOSURE });
        let (white, wide) = (1.4f64.powf(0.15), 0.3f64.hypot(0.4 * 1.4f64.ln()).exp());
        assert!(is_about(found.white[1], white) && is_about(found.between[1], white * wide), "{found:?}");
    }

    #[test]
    fn clipped_desk_follows_the_exposure_within_its_bounds() {
        let mut patches = desk(200);
        patches.iter_mut().take(200).for_each(|patch| patch.is_bound = true);
        for (exposure, white) in [(0.6, 1.0), (1.2, 1.2), (1.9, 1.4)] {
            let found = level(&patches, &ExposureLevel { level: exposure, ..EXPOSURE });
            assert!(found.unclaimed.is_none() && is_about(found.white[1], white), "{exposure}: {found:?}");
            assert!(is_about(found.between[0], 0.8 / 0.9) && is_about(found.between[1], 1.6), "{found:?}");
        }
    }

    #[test]
    fn each_refusal_has_its_reason() {
        let why =
            |patches: &[Patch], exposure: f64| level(patches, &ExposureLevel { level: exposure, ..EXPOSURE }).unclaimed;
        assert_eq!(why(&desk(200)[..600], 1.0), Some(Unclaimed::TooFew));
        assert_eq!(why(&desk(600), 1.0), Some(Unclaimed::Ground));
        assert_eq!(why(&desk(40), 1.0), Some(Unclaimed::Scrap));
        let wooden = desk(200).into_iter().map(|patch| Patch { code: [0.8, 0.6, 0.4], ..patch });
        assert_eq!(why(&wooden.collect::<Vec<_>>(), 1.0), Some(Unclaimed::Coloured { saturation: 0.5 }));
        // 1 m away, within 1.2 m: twice as bright.
        let beyond = (0..200).map(|n| patch(DVec3::new(1.0, 0.001 * f64::from(n), 0.0), 1.6));
        let sunlit = why(&desk(200).into_iter().chain(beyond).collect::<Vec<_>>(), 1.0);
        assert!(matches!(sunlit, Some(Unclaimed::Varies { growth }) if is_about(growth, 2.0)), "{sunlit:?}");
        // Both halves saw all 200, one of them twice as bright; or a third of the frames saw
        // specular reflections.
        let seen_as = |parts: [Option<[f64; 3]>; 3]| desk(200).into_iter().map(move |patch| Patch { parts, ..patch });
        for (parts, by) in [([0.6, 1.2, 0.8], 2.0), ([0.8, 0.8, 0.5], 1.6)] {
            let differing = why(&seen_as(parts.map(|light| Some([light; 3]))).collect::<Vec<_>>(), 1.0);
            assert!(matches!(differing, Some(Unclaimed::Differs { factor }) if is_about(factor, by)), "{differing:?}");
        }
        let alike = [0.75, 0.85, 0.8].map(|light| Some([light; 3]));
        assert_eq!(why(&seen_as(alike).collect::<Vec<_>>(), 1.0), None);
        let dark = why(&desk(200), 0.5);
        assert!(matches!(dark, Some(Unclaimed::Disagrees { factor }) if is_about(factor, 2.0)), "{dark:?}");
    }

    #[test]
    fn unclaimed_level_is_the_exposure_raised_to_the_largest_reflectance() {
        for (exposure, white) in [(2.0, 2.0), (0.7, 0.8 / 0.9), (0.5, 0.75)] {
            let neutral = ExposureLevel { level: exposure, neutral: [1.2, 1.0, 0.8] };
            let found = level(&desk(600), &neutral);
            assert!(found.unclaimed.is_some() && is_about(relative_luminance(found.white), white), "{found:?}");
            assert!(is_about(found.white[0] / found.white[1], 1.2), "{found:?}");
            assert!(is_about(found.between[0], exposure / 2.0) && is_about(found.between[1], 2.0 * white), "{found:?}");
        }
    }

    #[test]
    fn colour_is_weighted_by_the_area_of_neutral_surfaces() {
        // 225 voxels of 4 cm² are 0.09 m², half the weight: √(0.9/1) in red.
        let mut patches = desk(225);
        patches.iter_mut().take(225).for_each(|patch| patch.light[0] = 0.72);
        let found = level(&patches, &EXPOSURE);
        assert!(found.unclaimed.is_none() && is_about(found.white[0] / found.white[1], 0.9f64.sqrt()), "{found:?}");
        assert!(is_about(found.white[2], found.white[1]), "{found:?}");
    }

    #[test]
    fn known_lamps_use_the_whitest_surfaces_unless_the_exposure_contradicts() {
        // 20 of 1000 show 0.8 by their brightest spots: W = 1, moved by the exposure of 1.4 as a
        // claim is.
        let by_lamps = |exposure: f64| {
            white_level_by_lamps(&desk(20), DVec3::Z, DVec3::ZERO, &ExposureLevel { level: exposure, ..EXPOSURE })
        };
        let found = by_lamps(1.4).unwrap();
        let white = 1.4f64.powf(0.15);
        assert!(is_about(found.white[1], white) && found.unclaimed.is_none(), "{found:?}");
        assert!(is_about(found.between[0], 1.0 / 1.1) && is_about(found.between[1], 1.1 * white), "{found:?}");
        assert!(by_lamps(2.1).is_none() && by_lamps(0.49).is_none());
        // Clipped, they are lower bounds: the exposure counts up to 1.4 times them.
        let mut clipped = desk(20);
        clipped.iter_mut().take(20).for_each(|patch| patch.is_bound = true);
        for (level, white) in [(0.7, 1.0), (1.3, 1.3), (1.9, 1.4)] {
            let exposure = ExposureLevel { level, ..EXPOSURE };
            let found = white_level_by_lamps(&clipped, DVec3::Z, DVec3::ZERO, &exposure).unwrap();
            assert!(is_about(found.white[1], white) && is_about(found.between[1], 1.6), "{level}: {found:?}");
        }
    }
}
