//! Shape of the aperture, and uniformly distributed points on it.
//!
//! A shape is given by its outline ρ(θ) around the centre, as a fraction of the opening's radius.
//! Let A = ∫ ρ²/2 dθ. A point whose angle divides the area as u (∫₀^θ ρ²/2 = u·A) and whose radius
//! is √v·ρ(θ) is uniformly distributed over the shape if u and v are uniform.

use std::f64::consts::TAU;

use super::Opening;

/// Number of table entries over the angle.
const TABLE_SIZE: usize = 2048;

/// An outline, and the tables for sampling it uniformly.
#[derive(Clone, Debug, PartialEq)]
pub struct Aperture {
    /// ρ at `TABLE_SIZE` angles, evenly spaced, half a step from 0.
    outline: Vec<f64>,
    /// The share of the area before each angle. One more entry at the end, 1.
    share: Vec<f64>,
    variance: f64,
}

impl Aperture {
    /// An aperture with an outline: ρ (0..1) at an angle from the picture's x axis towards its y
    /// axis (downwards), rad.
    pub fn new(outline: impl Fn(f64) -> f64) -> Self {
        let outline: Vec<f64> = (0..TABLE_SIZE).map(|i| outline((i as f64 + 0.5) / TABLE_SIZE as f64 * TAU)).collect();
        let mut share = vec![0.0];
        let (mut area, mut second) = (0.0, 0.0);
        for rho in &outline {
            area += 0.5 * rho * rho;
            // ∫ r² dA of a sector is ρ⁴/4 dθ.
            second += 0.25 * rho.powi(4);
            share.push(area);
        }
        share.iter_mut().for_each(|s| *s /= area);
        Self { outline, share, variance: 0.5 * second / area }
    }

    /// The shape of a lens's opening: a circle, or a polygon with its corners on the circle.
    pub fn of(opening: &Opening) -> Self {
        if opening.blades == 0 {
            return Self::new(|_| 1.0);
        }
        let side = TAU / f64::from(opening.blades);
        Self::new(|angle| {
            let from_corner = (angle - opening.rotation_rad).rem_euclid(side);
            (0.5 * side).cos() / (from_corner - 0.5 * side).cos()
        })
    }

    /// Mean square distance from the centre along one axis, averaged over both axes, in squared
    /// radii. 1/4 for a circle.
    pub fn variance(&self) -> f64 {
        self.variance
    }

    /// The radius of an opening of this shape whose outline passes through the point. 0 at the
    /// centre.
    pub fn gauge(&self, [x, y]: [f64; 2]) -> f64 {
        // The outline is sampled in the middle of its steps.
        let at = y.atan2(x).rem_euclid(TAU) / TAU * TABLE_SIZE as f64 - 0.5 + TABLE_SIZE as f64;
        let [a, b] = [0, 1].map(|k| self.outline[(at as usize + k) % TABLE_SIZE]);
        x.hypot(y) / (a + at.fract() * (b - a))
    }

    /// The outline's smallest distance from the centre, in radii.
    pub fn apothem(&self) -> f64 {
        self.outline.iter().copied().fold(1.0, f64::min)
    }

    /// Maps a point of the unit square (u, v) to the shape, in radii.
    pub fn point(&self, u: f64, v: f64) -> [f64; 2] {
        let i = self.share.partition_point(|&s| s <= u).clamp(1, TABLE_SIZE) - 1;
        let width = self.share[i + 1] - self.share[i];
        let within = if width > 0.0 { (u - self.share[i]) / width } else { 0.5 };
        let angle = (i as f64 + within) / TABLE_SIZE as f64 * TAU;
        let radius = v.sqrt() * self.outline[i];
        [radius * angle.cos(), radius * angle.sin()]
    }

    /// Points on rings of equal area per point: uniform and symmetric even for few points. `counts`
    /// has the number of points of each ring, from the centre; even numbers keep point symmetry.
    pub fn rings(&self, counts: &[u32]) -> Vec<[f64; 2]> {
        let all = f64::from(counts.iter().sum::<u32>());
        let mut inside = 0.0;
        let mut points = Vec::new();
        for (ring, &count) in counts.iter().enumerate() {
            let v = (inside + 0.5 * f64::from(count)) / all;
            inside += f64::from(count);
            // Rings are rotated relative to each other.
            let turned = 0.5 * (ring % 2) as f64 + 0.05 * ring as f64 * f64::from(count);
            points.extend((0..count).map(|i| self.point(((f64::from(i) + turned) / f64::from(count)).fract(), v)));
        }
        points
    }

    /// A point of a low-discrepancy sequence: any subsequence is evenly distributed (Roberts 2018,
    /// "The Unreasonable Effectiveness of Quasirandom Sequences", R₂).
    pub fn sequence(&self, index: u32) -> [f64; 2] {
        const PLASTIC: f64 = 1.324_717_957_244_746;
        let i = f64::from(index) + 0.5;
        self.point((i / PLASTIC).fract(), (i / (PLASTIC * PLASTIC)).fract())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    fn blades(blades: u32, rotation_rad: f64) -> Aperture {
        Aperture::of(&Opening { diameter_m: 1.0, focus_distance_m: 1.0, blades, rotation_rad })
    }

    fn moments(points: &[[f64; 2]]) -> ([f64; 2], f64) {
        let n = points.len() as f64;
        let mean = [0, 1].map(|c| points.iter().map(|p| p[c]).sum::<f64>() / n);
        (mean, points.iter().map(|p| p[0] * p[0] + p[1] * p[1]).sum::<f64>() / (2.0 * n))
    }

    #[test]
    fn few_points_have_the_centroid_and_variance_of_the_shape() {
        assert!((blades(0, 0.0).variance() - 0.25).abs() < 1e-12);
        // A square in the unit circle has sides of √2 and variance √2²/12.
        assert!((blades(4, 0.3).variance() - 1.0 / 6.0).abs() < 1e-5);
        for n in [0, 3, 5, 6, 9] {
            let aperture = blades(n, 0.2);
            for points in [aperture.rings(&[4, 10, 18]), (0..4000).map(|i| aperture.sequence(i)).collect()] {
                let (mean, variance) = moments(&points);
                assert!(mean[0].hypot(mean[1]) < 0.04, "{n} blades, {}: {mean:?}", points.len());
                assert!((variance / aperture.variance() - 1.0).abs() < 0.05, "{n} blades, {}", points.len());
            }
        }
    }

    #[test]
    fn points_are_uniform_in_the_polygon() {
        // A pentagon with a corner to the right: half of its points are on either side of y = 0,
        // and all within its sides.
        let points: Vec<_> = (0..20_000).map(|i| blades(5, 0.0).sequence(i)).collect();
        let below = points.iter().filter(|p| p[1] > 0.0).count() as f64 / 20_000.0;
        assert!((below - 0.5).abs() < 0.01, "{below}");
        let apothem = (PI / 5.0).cos();
        for k in 0..5 {
            let middle = PI / 5.0 + f64::from(k) * TAU / 5.0;
            let reach = points.iter().map(|p| p[0] * middle.cos() + p[1] * middle.sin()).fold(0.0, f64::max);
            assert!(reach < apothem + 1e-3 && reach > apothem - 0.02, "side {k}: {reach}");
        }
        let farthest = points.iter().map(|p| p[0]).fold(0.0, f64::max);
        assert!(farthest > 0.97, "no corner to the right: {farthest}");
        // The inner half of the outline contains a quarter of the area.
        let inner = points.iter().filter(|p| {
            let side = TAU / 5.0;
            let from = p[1].atan2(p[0]).rem_euclid(side) - 0.5 * side;
            p[0].hypot(p[1]) * from.cos() < 0.5 * apothem
        });
        let share = inner.count() as f64 / 20_000.0;
        assert!((share - 0.25).abs() < 0.01, "{share}");
    }
}
