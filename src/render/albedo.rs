//! How much light from all around a rough surface reflects in one bounce between its facets: the table that the shader
//! weights specular light by.

use glam::{DVec2, DVec3};

/// Steps of the table in each direction, as in shaders/raster.wgsl. With 16, interpolated values are off by 0.003 (root
/// mean square over all angles and roughnesses).
pub const STEPS: usize = 16;
const SAMPLES: u32 = 512;

/// Rows from roughness 0 to 1; within a row from grazing to perpendicular view in even steps of √cos. Entries: scale
/// and bias of F0 (Karis 2013, "Environment BRDF"), and the mean of their sum over all views, weighted by cos, which is
/// the same for a whole row.
pub fn table() -> Vec<[f32; 4]> {
    let step = |i: usize| i as f64 / (STEPS - 1) as f64;
    let mut table = Vec::with_capacity(STEPS * STEPS);
    for row in 0..STEPS {
        let roughness = step(row).max(0.03);
        let entries: Vec<_> = (0..STEPS).map(|i| scale_and_bias(step(i).powi(2).max(1e-3), roughness)).collect();
        let sum = |i: usize| entries[i].x + entries[i].y;
        // ∫ E 2μ dμ over the steps of √μ, with E linear between them.
        let mean: f64 = (1..STEPS).map(|i| 0.5 * (sum(i - 1) + sum(i)) * (step(i).powi(4) - step(i - 1).powi(4))).sum();
        table.extend(entries.iter().map(|e| [e.x as f32, e.y as f32, mean as f32, 0.0]));
    }
    table
}

/// Reflected share of uniform light as x·F0 + y, seen at this cosine: GGX with Smith's height-correlated shadowing and
/// Schlick's Fresnel term, as in the shader. Sampled by visible normals (Heitz 2018).
fn scale_and_bias(cos: f64, roughness: f64) -> DVec2 {
    let alpha = roughness * roughness;
    let view = DVec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
    let lambda = |c: f64| 0.5 * ((1.0 + alpha * alpha * (1.0 - c * c) / (c * c)).sqrt() - 1.0);
    let stretched = DVec3::new(alpha * view.x, 0.0, view.z).normalize();
    // The view lies in the xz plane, so y is perpendicular to it.
    let across = DVec3::Y;
    let along = stretched.cross(across);
    let mut sum = DVec2::ZERO;
    for i in 0..SAMPLES {
        // Hammersley's points.
        let radius = ((f64::from(i) + 0.5) / f64::from(SAMPLES)).sqrt();
        let angle = f64::from(i.reverse_bits()) * 2f64.powi(-32) * std::f64::consts::TAU;
        let (s, c) = angle.sin_cos();
        let (a, b) = (radius * c, radius * s);
        let up = 0.5 * (1.0 + stretched.z);
        let b = (1.0 - up) * (1.0 - a * a).max(0.0).sqrt() + up * b;
        let h = across * a + along * b + stretched * (1.0 - a * a - b * b).max(0.0).sqrt();
        let half = DVec3::new(alpha * h.x, alpha * h.y, h.z.max(0.0)).normalize();
        let v_h = view.dot(half);
        let towards_z = 2.0 * v_h * half.z - view.z;
        if towards_z > 0.0 {
            let weight = (1.0 + lambda(cos)) / (1.0 + lambda(cos) + lambda(towards_z));
            let fresnel = (1.0 - v_h.clamp(0.0, 1.0)).powi(5);
            sum += DVec2::new(1.0 - fresnel, fresnel) * weight;
        }
    }
    sum / f64::from(SAMPLES)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The same share by summing the BRDF times cos over a fine grid of directions.
    fn by_quadrature(cos: f64, roughness: f64) -> DVec2 {
        let a2 = roughness.powi(4);
        let view = DVec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
        let (rings, sectors) = (600, 1200);
        let mut sum = DVec2::ZERO;
        for i in 0..rings {
            let n_l = (f64::from(i) + 0.5) / f64::from(rings);
            for j in 0..sectors {
                let phi = (f64::from(j) + 0.5) / f64::from(sectors) * std::f64::consts::TAU;
                let s = (1.0 - n_l * n_l).sqrt();
                let towards = DVec3::new(s * phi.cos(), s * phi.sin(), n_l);
                let half = (view + towards).normalize();
                let d = a2 / (std::f64::consts::PI * (half.z * half.z * (a2 - 1.0) + 1.0).powi(2));
                let smith = |x: f64, y: f64| x * (y * y * (1.0 - a2) + a2).sqrt();
                let visibility = 0.5 / (smith(n_l, cos) + smith(cos, n_l));
                let fresnel = (1.0 - view.dot(half)).powi(5);
                sum += DVec2::new(1.0 - fresnel, fresnel) * (d * visibility * n_l);
            }
        }
        sum * (std::f64::consts::TAU / f64::from(rings * sectors))
    }

    #[test]
    fn sampling_agrees_with_quadrature() {
        for (cos, roughness) in [(1.0, 0.4), (0.6, 0.5), (0.3, 0.8), (1.0, 1.0)] {
            let (sampled, summed) = (scale_and_bias(cos, roughness), by_quadrature(cos, roughness));
            // 512 low-discrepancy points.
            assert!(sampled.abs_diff_eq(summed, 0.005), "{cos} {roughness}: {sampled} {summed}");
        }
    }

    #[test]
    fn a_mirror_loses_nothing_and_the_roughest_surface_most() {
        let table = table();
        assert_eq!(table.len(), STEPS * STEPS);
        let sum = |row: usize, i: usize| table[STEPS * row + i][0] + table[STEPS * row + i][1];
        assert!((sum(0, STEPS - 1) - 1.0).abs() < 1e-3);
        assert!((table[0][2] - 1.0).abs() < 0.01, "{:?}", table[0]);
        assert!((1..STEPS).all(|row| sum(row, STEPS - 1) <= sum(row - 1, STEPS - 1) + 1e-3));
        // Mean of the quadrature over views, for roughness 1.
        let mean: f64 =
            (0..20).map(|i| (f64::from(i) + 0.5) / 20.0).map(|mu| by_quadrature(mu, 1.0).element_sum() * mu).sum();
        assert!((f64::from(table[STEPS * STEPS - 1][2]) - mean / 10.0).abs() < 0.01);
    }
}
