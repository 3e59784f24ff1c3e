//! Directional albedo of a rough surface in uniform light, single-scattering: the lookup table that
//! weights specular light in the shader.

use std::sync::LazyLock;

use glam::{DVec2, DVec3};

/// Table size in each direction, as in shaders/raster.wgsl. With 16, interpolated values have an
/// error of 0.003 (root mean square over all angles and roughnesses).
pub const TABLE_SIZE: usize = 16;
const SAMPLES_PER_ENTRY: u32 = 512;

/// Rows from roughness 0 to 1; within a row from grazing to perpendicular view in equal steps of
/// √cos. Entries: scale and bias of F0 (Karis 2013, "Environment BRDF"), and the mean of their sum
/// over all views, weighted by cos, which is constant in a row. Computed once: it takes as long as
/// a small picture.
pub fn table() -> &'static [[f32; 4]] {
    // No memo: a constant.
    static TABLE: LazyLock<Vec<[f32; 4]>> = LazyLock::new(computed_table);
    &TABLE
}

fn computed_table() -> Vec<[f32; 4]> {
    let step = |i: usize| i as f64 / (TABLE_SIZE - 1) as f64;
    let mut table = Vec::with_capacity(TABLE_SIZE * TABLE_SIZE);
    for row in 0..TABLE_SIZE {
        let roughness = step(row).max(0.03);
        let entries: Vec<_> = (0..TABLE_SIZE).map(|i| scale_and_bias(step(i).powi(2).max(1e-3), roughness)).collect();
        let sum = |i: usize| entries[i].x + entries[i].y;
        // ∫ E 2μ dμ over the steps of √μ, with E linear between them.
        let mean: f64 =
            (1..TABLE_SIZE).map(|i| 0.5 * (sum(i - 1) + sum(i)) * (step(i).powi(4) - step(i - 1).powi(4))).sum();
        table.extend(entries.iter().map(|e| [e.x as f32, e.y as f32, mean as f32, 0.0]));
    }
    table
}

/// Reflected share of uniform light as x·F0 + y, for a view at this cosine: GGX with Smith's
/// height-correlated shadowing and Schlick's Fresnel term, as in the shader. Sampled by visible
/// normals (Heitz 2018).
fn scale_and_bias(cos: f64, roughness: f64) -> DVec2 {
    let alpha = roughness * roughness;
    let view = DVec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
    let lambda = |c: f64| 0.5 * ((1.0 + alpha * alpha * (1.0 - c * c) / (c * c)).sqrt() - 1.0);
    let stretched = DVec3::new(alpha * view.x, 0.0, view.z).normalize();
    // The view lies in the xz plane, so y is perpendicular to it.
    let across = DVec3::Y;
    let along = stretched.cross(across);
    let mut sum = DVec2::ZERO;
    for i in 0..SAMPLES_PER_ENTRY {
        // Hammersley points.
        let radius = ((f64::from(i) + 0.5) / f64::from(SAMPLES_PER_ENTRY)).sqrt();
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
    sum / f64::from(SAMPLES_PER_ENTRY)
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
    fn sampled_albedo_matches_quadrature() {
        for (cos, roughness) in [(1.0, 0.4), (0.6, 0.5), (0.3, 0.8), (1.0, 1.0)] {
            let (sampled, summed) = (scale_and_bias(cos, roughness), by_quadrature(cos, roughness));
            // 512 low-discrepancy points.
            assert!(sampled.abs_diff_eq(summed, 0.005), "{cos} {roughness}: {sampled} {summed}");
        }
    }

    #[test]
    fn mirror_has_albedo_one_and_the_roughest_surface_the_least() {
        let table = table();
        assert_eq!(table.len(), TABLE_SIZE * TABLE_SIZE);
        let sum = |row: usize, i: usize| table[TABLE_SIZE * row + i][0] + table[TABLE_SIZE * row + i][1];
        assert!((sum(0, TABLE_SIZE - 1) - 1.0).abs() < 1e-3);
        assert!((table[0][2] - 1.0).abs() < 0.01, "{:?}", table[0]);
        assert!((1..TABLE_SIZE).all(|row| sum(row, TABLE_SIZE - 1) <= sum(row - 1, TABLE_SIZE - 1) + 1e-3));
        // Mean of the quadrature over views, for roughness 1.
        let mean: f64 =
            (0..20).map(|i| (f64::from(i) + 0.5) / 20.0).map(|mu| by_quadrature(mu, 1.0).element_sum() * mu).sum();
        assert!((f64::from(table[TABLE_SIZE * TABLE_SIZE - 1][2]) - mean / 10.0).abs() < 0.01);
    }
}
