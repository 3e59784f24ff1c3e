//! Fits the light of surfaces by lamps at given positions: ambient light, its gradient along up,
//! and each lamp's brightness.
//!
//!   B = ρ_m·(a + b(1 + n_z)/2 + Σ I_k·V·cos θ/d² + Σ J_k·mean(V·cos θ/d²))
//!
//! ρ_m is one reflectance for each material m, a bin of chroma. The last sum is bounce light,
//! averaged over positions around lamp k ([`bounce`](super::bounce)). Two steps alternate: ln ρ_m
//! is the median residual of ln B; a, b, I_k and J_k ≥ 0 follow from Gauss-Newton least squares of
//! ln B with Cauchy weights w = 1/(1 + (r/0.25)²). The score is the mean Cauchy loss. Not modelled:
//! other indirect light, except as ambient light; glossy surfaces.

use crate::fit::quantile::upper_median_in_place;
use glam::DVec3;

/// Scale of the Cauchy loss, ln.
const CAUCHY_SCALE_LN: f64 = 0.25;
/// Largest number of lamps.
pub const MAX_LAMPS: usize = 3;
/// Largest number of unknowns.
pub const MAX_UNKNOWNS: usize = 2 + 2 * MAX_LAMPS;
/// Width of a patch, m. Voxels of one material and one orientation are averaged over it, so that
/// texture is not mistaken for light.
pub const PATCH_M: f64 = 0.08;
/// Sweeps of Gauss-Seidel over the unknowns.
const GAUSS_SEIDEL_SWEEPS: usize = 60;

/// A surface patch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LitPoint {
    pub position_m: DVec3,
    pub normal: DVec3,
    /// ln of its light.
    pub ln: f64,
    pub material: usize,
}

/// Fitted light: linear, as the light of matt white.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LightFit {
    /// Uniform ambient light, and ambient light by the cosine with up.
    pub around: f64,
    pub above: f64,
    /// Light of white that faces each lamp at 1 m.
    pub lamps: [f64; MAX_LAMPS],
    /// Bounce light of each lamp, as if all of it came from the lamp's position.
    pub bounce: [f64; MAX_LAMPS],
}

/// The light of lamps at given positions, fitted to the surfaces. A lower score is a better fit.
#[derive(Clone, Debug, PartialEq)]
pub struct LampFit {
    pub light: LightFit,
    /// ln of each material's reflectance.
    pub reflectance: Vec<f64>,
    pub score: f64,
}

/// Row of the design matrix: light of a surface by a unit of each unknown.
pub type BasisRow = [f64; MAX_UNKNOWNS];

/// The row of a surface with ambient light only.
pub fn ambient(normal: DVec3, up: DVec3) -> BasisRow {
    let mut shares = [0.0; MAX_UNKNOWNS];
    (shares[0], shares[1]) = (1.0, 0.5 * (1.0 + normal.dot(up)));
    shares
}

/// Position and emission of a lamp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LampSource {
    pub position_m: DVec3,
    /// Axis of a panel with cosine emission; `None` for an isotropic bulb.
    pub along: Option<DVec3>,
}

/// Irradiance by an unoccluded lamp of unit brightness on a surface at `at`.
pub fn lamp_irradiance(at: DVec3, normal: DVec3, lamp: &LampSource) -> f64 {
    let to = lamp.position_m - at;
    let d2 = to.length_squared().max(1e-4);
    let share = normal.dot(to).max(0.0) / (d2 * d2.sqrt());
    match lamp.along {
        Some(along) => share * (-along.dot(to)).max(0.0) / d2.sqrt(),
        None => share,
    }
}

/// Sorts points by material, so that each material is a contiguous run.
pub fn sorted(mut points: Vec<LitPoint>) -> Vec<LitPoint> {
    points.sort_by_key(|point| point.material);
    points
}

/// Fits direct light. `points` are [`sorted`]; `shares`: one row for each. Columns: around, above,
/// `lamps`.
pub fn fit(points: &[LitPoint], shares: &[BasisRow], lamps: usize, rounds: usize) -> LampFit {
    fit_sources(points, shares, lamps, lamps, rounds)
}

/// Fits direct and bounce light. Columns: around, above, all direct, all bounce.
pub fn fit_with_bounce(points: &[LitPoint], shares: &[BasisRow], lamps: usize, rounds: usize) -> LampFit {
    fit_sources(points, shares, lamps, 2 * lamps, rounds)
}

fn fit_sources(points: &[LitPoint], shares: &[BasisRow], lamps: usize, sources: usize, rounds: usize) -> LampFit {
    // A constant number of unknowns is twice as fast.
    match sources {
        0 => fit_to::<2>(points, shares, lamps, rounds),
        1 => fit_to::<3>(points, shares, lamps, rounds),
        2 => fit_to::<4>(points, shares, lamps, rounds),
        3 => fit_to::<5>(points, shares, lamps, rounds),
        4 => fit_to::<6>(points, shares, lamps, rounds),
        _ => fit_to::<MAX_UNKNOWNS>(points, shares, lamps, rounds),
    }
}

/// Fits the first `COUNT` unknowns.
fn fit_to<const COUNT: usize>(points: &[LitPoint], shares: &[BasisRow], lamps: usize, rounds: usize) -> LampFit {
    let materials = points.last().map_or(0, |point| point.material + 1);
    let mut reflectance = vec![0.0; materials];
    let mut x = [0.0; MAX_UNKNOWNS];
    (x[0], x[1]) = (0.5, 0.5);
    // Initially each lamp is as bright as all other light together, without bounce light.
    for k in 2..2 + lamps {
        let mean = shares.iter().map(|s| s[k]).sum::<f64>() / shares.len().max(1) as f64;
        x[k] = if mean > 0.0 { 1.0 / mean } else { 0.0 };
    }
    let sum =
        |x: &[f64; MAX_UNKNOWNS], s: &BasisRow| x[..COUNT].iter().zip(s).map(|(x, s)| x * s).sum::<f64>().max(1e-9);
    let mut lit: Vec<f64> = shares.iter().map(|s| sum(&x, s)).collect();
    // ln of each point's reflectance, and a buffer for one material.
    let (mut residual_ln, mut of_material) = (vec![0.0; points.len()], Vec::new());
    let unlit = |lit: &[f64], residual_ln: &mut [f64]| {
        points
            .iter()
            .zip(lit)
            .zip(residual_ln)
            .for_each(|((point, lit), residual_ln)| *residual_ln = point.ln - lit.ln());
    };
    for _ in 0..rounds {
        unlit(&lit, &mut residual_ln);
        medians(points, &residual_ln, &mut reflectance, &mut of_material);
        let (mut normal, mut right) = ([[0.0; MAX_UNKNOWNS]; MAX_UNKNOWNS], [0.0; MAX_UNKNOWNS]);
        for (n, (point, s)) in points.iter().zip(shares).enumerate() {
            let off = residual_ln[n] - reflectance[point.material];
            let w = 1.0 / (1.0 + (off / CAUCHY_SCALE_LN).powi(2));
            let clamped_ratio = 1.0 + off.clamp(-1.0, 1.0);
            let per_lit = 1.0 / lit[n];
            let slope = s.map(|s| s * per_lit);
            for i in 0..COUNT {
                let of = w * slope[i];
                right[i] += of * clamped_ratio;
                for j in 0..=i {
                    normal[i][j] += of * slope[j];
                }
            }
        }
        not_negative(&normal, &right, COUNT, &mut x);
        // Reflectance and light have a common free factor. It is fixed by a mean light of 1.
        shares.iter().zip(&mut lit).for_each(|(s, lit)| *lit = sum(&x, s));
        let mean = lit.iter().sum::<f64>() / lit.len().max(1) as f64;
        x.iter_mut().for_each(|x| *x /= mean);
        lit.iter_mut().for_each(|lit| *lit /= mean);
    }
    unlit(&lit, &mut residual_ln);
    medians(points, &residual_ln, &mut reflectance, &mut of_material);
    let loss = |(point, residual_ln): (&LitPoint, &f64)| {
        (1.0 + ((residual_ln - reflectance[point.material]) / CAUCHY_SCALE_LN).powi(2)).ln()
    };
    let score = points.iter().zip(&residual_ln).map(loss).sum::<f64>() / points.len().max(1) as f64;
    let mut light = LightFit { around: x[0], above: x[1], ..LightFit::default() };
    let (direct, bounce) = x[2..COUNT].split_at(lamps);
    light.lamps[..direct.len()].copy_from_slice(direct);
    light.bounce[..bounce.len()].copy_from_slice(bounce);
    LampFit { light, reflectance, score }
}

/// ln of each material's reflectance: the median over its points.
fn medians(points: &[LitPoint], residual_ln: &[f64], reflectance: &mut [f64], of_material: &mut Vec<f64>) {
    let mut from = 0;
    for of in points.chunk_by(|a, b| a.material == b.material) {
        of_material.clear();
        of_material.extend(&residual_ln[from..from + of.len()]);
        from += of.len();
        if let Some(median) = upper_median_in_place(of_material) {
            reflectance[of[0].material] = median;
        }
    }
}

/// Non-negative least squares by projected Gauss-Seidel. `normal`: lower triangle of the normal
/// matrix.
fn not_negative(
    normal: &[[f64; MAX_UNKNOWNS]; MAX_UNKNOWNS],
    right: &[f64; MAX_UNKNOWNS],
    count: usize,
    x: &mut [f64; MAX_UNKNOWNS],
) {
    /// Regularization of unobservable unknowns, by the diagonal.
    const DAMPING: f64 = 1e-9;
    for _ in 0..GAUSS_SEIDEL_SWEEPS {
        for i in 0..count {
            let others: f64 = (0..count).filter(|j| *j != i).map(|j| normal[i.max(j)][i.min(j)] * x[j]).sum();
            let diagonal = normal[i][i] * (1.0 + DAMPING) + 1e-12;
            x[i] = ((right[i] - others) / diagonal).max(0.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A floor of 2 × 2 m and the sides and the top of a box of 40 cm on it, of two materials.
    fn plane_and_box() -> Vec<LitPoint> {
        let mut points = Vec::new();
        let mut add = |at: DVec3, normal: DVec3, material: usize| {
            points.push(LitPoint { position_m: at, normal, ln: 0.0, material })
        };
        for i in 0..20 {
            for j in 0..20 {
                let at = DVec3::new(0.1 * f64::from(i) - 0.95, 0.1 * f64::from(j) - 0.95, 0.0);
                if at.x.abs() > 0.2 || at.y.abs() > 0.2 {
                    add(at, DVec3::Z, 0);
                }
            }
        }
        for i in 0..8 {
            for j in 0..8 {
                let (along, up) = (0.05 * f64::from(i) - 0.175, 0.05 * f64::from(j) + 0.025);
                for (x, y) in [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)] {
                    let normal = DVec3::new(x, y, 0.0);
                    add(0.2 * normal + along * DVec3::new(-y, x, 0.0) + up * DVec3::Z, normal, 1);
                }
                add(DVec3::new(along, up - 0.2, 0.4), DVec3::Z, 1);
            }
        }
        points
    }

    #[test]
    fn light_of_a_plane_and_a_box_is_recovered() {
        let lamp = LampSource { position_m: DVec3::new(0.7, -0.3, 1.8), along: None };
        let (around, above, shown) = (0.2, 0.1, 1.5);
        let mut points = plane_and_box();
        let mut shares = Vec::new();
        for point in &mut points {
            let mut s = ambient(point.normal, DVec3::Z);
            s[2] = lamp_irradiance(point.position_m, point.normal, &lamp);
            point.ln = [0.3f64, 0.6][point.material].ln() + (around * s[0] + above * s[1] + shown * s[2]).ln();
            shares.push(s);
        }
        // The alternation converges slowly; real rooms do not need this accuracy.
        let fit = fit(&points, &shares, 1, 3000);
        // Light and reflectance have a common free factor; everything else is determined.
        let light = fit.light;
        assert!((light.lamps[0] / light.around / (shown / around) - 1.0).abs() < 1e-3, "{light:?}");
        assert!((light.above / light.around / (above / around) - 1.0).abs() < 1e-2, "{light:?}");
        assert!((fit.reflectance[1] - fit.reflectance[0] - 2f64.ln()).abs() < 1e-4, "{:?}", fit.reflectance);
        assert!(fit.score < 1e-5, "{}", fit.score);
        // By hand: at 2 m straight below, 1 / 2²; a panel 60° off its axis gives half.
        let below = LampSource { position_m: DVec3::new(0.0, 0.0, 2.0), along: None };
        assert_eq!(lamp_irradiance(DVec3::ZERO, DVec3::Z, &below), 0.25);
        let aside = DVec3::new(2.0 * 60f64.to_radians().tan(), 0.0, 0.0);
        let panel = LampSource { along: Some(-DVec3::Z), ..below };
        let ratio = lamp_irradiance(aside, DVec3::Z, &panel) / lamp_irradiance(aside, DVec3::Z, &below);
        assert!((ratio - 0.5).abs() < 1e-9, "{ratio}");
    }
}
