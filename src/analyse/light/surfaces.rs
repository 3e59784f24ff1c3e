//! Input of the lamp search: well-observed surfaces with their materials, and the volume in which
//! lamps are searched.
//!
//! A material is a bin of chroma, ln of red by green and of blue by green. Bins with few surfaces
//! are left out.

use crate::fit::quantile::lower_quantile;
use std::collections::BTreeMap;

use glam::DVec3;

use super::lamp_fit::{LitPoint, PATCH_M, sorted};
use super::lamp_search::SearchVolume;
use super::sample::mean_channel;
use super::voxels::Voxel;

/// Width of a chroma bin, ln.
const BIN_LN: f64 = 0.2;
/// Smallest number of patches of a material.
const MIN_PATCHES_PER_MATERIAL: usize = 12;
/// Smallest channel of usable light; darker surfaces are dominated by noise.
const MIN_LIGHT: f64 = 0.004;
/// Search volume: horizontal margin around the surfaces, and smallest and largest height over the
/// lowest of them, m.
const MARGIN_M: f64 = 1.6;
const MAX_HEIGHT_M: f64 = 3.2;
const MIN_HEIGHT_M: f64 = 0.4;

/// Smallest number of voxels in a patch.
const MIN_VOXELS_PER_PATCH: usize = 3;

type ChromaBin = [i32; 2];
/// Position, normal and ln of light of a voxel.
type PatchSample = (DVec3, DVec3, f64);

/// The light that is fitted.
#[derive(Clone, Copy, Debug)]
pub enum LightChannel {
    Luminance,
    Colour(usize),
}

/// Patches by the light of one half of the frames (0, 1) or of all (2).
pub fn lit_points(voxels: &[Voxel], by: usize, of: LightChannel) -> Vec<LitPoint> {
    let mut patches: BTreeMap<(ChromaBin, [i32; 3], usize), Vec<PatchSample>> = BTreeMap::new();
    for voxel in voxels.iter().filter(|voxel| !voxel.is_clipped) {
        let Some(light) = voxel.light[by] else { continue };
        let [r, g, b] = light.map(f64::from);
        if r.min(g).min(b) > MIN_LIGHT {
            let ln = match of {
                LightChannel::Luminance => f64::from(mean_channel(light)).ln(),
                LightChannel::Colour(c) => f64::from(light[c]).ln(),
            };
            let bin = [(r / g).ln(), (b / g).ln()].map(|v| (v / BIN_LN).round() as i32);
            let cell = (voxel.position_m / PATCH_M).floor().as_ivec3().to_array();
            let n = voxel.normal;
            let axis = (0..3).max_by(|i, j| n[*i].abs().total_cmp(&n[*j].abs())).unwrap_or(2);
            let towards = 2 * axis + usize::from(n[axis] > 0.0);
            patches.entry((bin, cell, towards)).or_default().push((voxel.position_m, n, ln));
        }
    }
    let mut materials: BTreeMap<ChromaBin, Vec<LitPoint>> = BTreeMap::new();
    for ((bin, ..), of) in patches.iter().filter(|(_, of)| of.len() >= MIN_VOXELS_PER_PATCH) {
        let share = 1.0 / of.len() as f64;
        let at = of.iter().map(|voxel| voxel.0).sum::<DVec3>() * share;
        let normal = of.iter().map(|voxel| voxel.1).sum::<DVec3>().normalize_or_zero();
        let ln = of.iter().map(|voxel| voxel.2).sum::<f64>() * share;
        materials.entry(*bin).or_default().push(LitPoint { position_m: at, normal, ln, material: 0 });
    }
    let kept = materials.into_values().filter(|points| points.len() >= MIN_PATCHES_PER_MATERIAL);
    let numbered = |(n, points): (usize, Vec<LitPoint>)| points.into_iter().map(move |p| LitPoint { material: n, ..p });
    sorted(kept.enumerate().flat_map(numbered).collect())
}

/// The volume around the surfaces in which lamps are searched.
pub fn search_volume(solid: &[DVec3], up: DVec3) -> SearchVolume {
    let between = |of: &dyn Fn(&DVec3) -> f64, low: f64, high: f64| {
        let mut values: Vec<f64> = solid.iter().map(of).collect();
        let mut at = |share: f64| lower_quantile(&mut values, share).unwrap_or(0.0);
        (at(low), at(high))
    };
    let mut low = DVec3::ZERO;
    let mut high = DVec3::ZERO;
    for axis in 0..3 {
        let (l, h) = between(&|p| p[axis], 0.02, 0.98);
        (low[axis], high[axis]) = (l - MARGIN_M, h + MARGIN_M);
    }
    // The axis nearest to up.
    let axis = (0..3).max_by(|a, b| up[*a].abs().total_cmp(&up[*b].abs())).unwrap_or(2);
    let (l, h) = between(&|p| p[axis], 0.02, 0.98);
    if up[axis] > 0.0 {
        (low[axis], high[axis]) = (l + MIN_HEIGHT_M, l + MAX_HEIGHT_M);
    } else {
        (low[axis], high[axis]) = (h - MAX_HEIGHT_M, h - MIN_HEIGHT_M);
    }
    SearchVolume { low, high, up }
}
