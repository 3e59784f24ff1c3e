//! Wang 2012, section 3.2: the diffusion operator, a picture of the aperture on a grid.
//!
//! The shape of radius r is filled with N = (R_K − r)/R_K · O. Its outline is drawn over that with
//! N·λ·r (discs of blur have bright rims). Both are smoothed by a separable Gaussian (1), and the
//! whole is divided by its sum, which cancels N and O. The fill is antialiased by the covered area
//! of each texel, and the outline is a pixel wide.

use std::f64::consts::{FRAC_PI_2, TAU};

use crate::camera::Opening;

crate::choices! {
    /// The shape over which the diffusion spreads light.
    pub enum Shape {
        /// The lens's polygon, or its circle.
        Lens = "lens",
        Star = "star",
        Heart = "heart",
    }
}

/// Rows per texel for filling.
const ROWS: usize = 8;
/// Corners that approximate a curve.
const CORNERS: u32 = 128;

/// N of Wang 3.2: the fill intensity of a shape of radius r, for a centre of intensity O. The
/// worked example's (36 − 30)/36 · 0.5 is a misprint for (36 − 6)/36 · 0.5.
pub fn fill_intensity(largest_radius_px: f64, radius_px: f64, intensity: f64) -> f64 {
    (largest_radius_px - radius_px) / largest_radius_px * intensity
}

impl Shape {
    /// Corners of the outline in the unit circle, on the picture's axes (y downwards). A star has
    /// as many points as the lens has blades, or 5. Without blades, star and heart stand upright at
    /// a rotation of 0.
    pub fn outline(self, opening: &Opening) -> Vec<[f64; 2]> {
        let on = |angle: f64, radius: f64| [radius * angle.cos(), radius * angle.sin()];
        let ring = |count: u32, first: f64| {
            (0..count).map(move |i| on(first + TAU * f64::from(i) / f64::from(count), 1.0)).collect()
        };
        let turned = opening.rotation_rad;
        match (self, opening.blades) {
            (Self::Lens, 0) => ring(CORNERS, 0.0),
            (Self::Lens, blades) => ring(blades, turned),
            (Self::Star, blades) => {
                let (points, first) = if blades == 0 { (5, turned - FRAC_PI_2) } else { (blades, turned) };
                // The pentagram's inner corners.
                let inner = (3.0 - 5f64.sqrt()) / 2.0;
                let corner = |i| on(first + TAU * f64::from(i) / f64::from(2 * points), [1.0, inner][i as usize % 2]);
                (0..2 * points).map(corner).collect()
            }
            (Self::Heart, _) => {
                let curve = |i: u32| {
                    let t = TAU * f64::from(i) / f64::from(CORNERS);
                    let up = 13.0 * t.cos() - 5.0 * (2.0 * t).cos() - 2.0 * (3.0 * t).cos() - (4.0 * t).cos();
                    [16.0 * t.sin().powi(3), -up]
                };
                let points: Vec<_> = (0..CORNERS).map(curve).collect();
                // Centred on half its height, as large as the unit circle allows.
                let (low, high) = points.iter().fold((0.0f64, 0.0f64), |(l, h), p| (l.min(p[1]), h.max(p[1])));
                let middle = 0.5 * (low + high);
                let size = points.iter().map(|p| p[0].hypot(p[1] - middle)).fold(0.0, f64::max);
                let (sin, cos) = turned.sin_cos();
                let turn = |[x, y]: [f64; 2]| [(x * cos - y * sin) / size, (x * sin + y * cos) / size];
                points.iter().map(|p| turn([p[0], p[1] - middle])).collect()
            }
        }
    }
}

/// Parameters of an operator besides its shape and radius.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OperatorParams {
    /// λ, 1/px.
    pub rim: f64,
    /// Standard deviation of the Gaussian.
    pub gaussian_px: f64,
    /// R_K.
    pub largest_radius_px: f64,
}

impl OperatorParams {
    /// Texels from an operator's radius to its sides.
    pub fn margin(&self) -> usize {
        (3.0 * self.gaussian_px).ceil() as usize + 2
    }

    /// Texels from the middle to the sides, for all operators.
    pub fn half_side(&self) -> usize {
        self.largest_radius_px.ceil() as usize + self.margin()
    }

    /// The operator of a radius, `2 · half_side + 1` texels wide and high. They sum to 1.
    pub fn operator(&self, outline: &[[f64; 2]], radius_px: f64) -> Vec<f64> {
        let half = self.half_side();
        let side = 2 * half + 1;
        // In texels: corners, not centres, are on whole numbers.
        let corners: Vec<_> = outline.iter().map(|p| p.map(|c| c * radius_px + half as f64 + 0.5)).collect();
        let n = fill_intensity(self.largest_radius_px, radius_px, 1.0);
        // At R_K itself N is 0; it cancels anyway.
        let n = if n > 0.0 { n } else { 1.0 };
        let mut texels = vec![0.0; side * side];
        fill(&mut texels, side, &corners, n);
        draw(&mut texels, side, &corners, n * self.rim * radius_px);
        let texels = smoothed(&smoothed(&texels, side, self.gaussian_px), side, self.gaussian_px);
        let sum: f64 = texels.iter().sum();
        if sum > 1e-9 {
            return texels.iter().map(|t| t / sum).collect();
        }
        // In focus, light stays where it is.
        (0..side * side).map(|i| if i == half * side + half { 1.0 } else { 0.0 }).collect()
    }
}

fn edges(corners: &[[f64; 2]]) -> impl Iterator<Item = ([f64; 2], [f64; 2])> {
    corners.iter().copied().zip(corners.iter().copied().cycle().skip(1))
}

/// Adds each texel's share of the polygon: rows between crossings, even-odd.
fn fill(texels: &mut [f64], side: usize, corners: &[[f64; 2]], intensity: f64) {
    for row in 0..side * ROWS {
        let y = (row as f64 + 0.5) / ROWS as f64;
        let mut crossings: Vec<f64> = edges(corners)
            .filter(|(a, b)| (a[1] <= y) != (b[1] <= y))
            .map(|(a, b)| a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]))
            .collect();
        crossings.sort_by(f64::total_cmp);
        for span in crossings.chunks_exact(2) {
            for x in (span[0].max(0.0) as usize)..=(span[1].max(0.0) as usize).min(side - 1) {
                let covered = span[1].min(x as f64 + 1.0) - span[0].max(x as f64);
                texels[row / ROWS * side + x] += intensity * covered.max(0.0) / ROWS as f64;
            }
        }
    }
}

/// Adds the outline, a texel wide.
fn draw(texels: &mut [f64], side: usize, corners: &[[f64; 2]], intensity: f64) {
    for (a, b) in edges(corners) {
        let length = (b[0] - a[0]).hypot(b[1] - a[1]);
        let stamps = (8.0 * length).ceil().max(1.0);
        for k in 0..stamps as usize {
            let along = (k as f64 + 0.5) / stamps;
            let [x, y] = [0, 1].map(|c| a[c] + along * (b[c] - a[c]) - 0.5);
            for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
                let (u, v) = (x.floor() + dx, y.floor() + dy);
                let share = (1.0 - (x - u).abs()) * (1.0 - (y - v).abs());
                if let Some(texel) = texels.get_mut(v.max(0.0) as usize * side + u.max(0.0) as usize) {
                    *texel += intensity * share * length / stamps;
                }
            }
        }
    }
}

/// Wang (1) along rows, transposed: applied twice it covers both axes and restores the orientation.
fn smoothed(texels: &[f64], side: usize, sigma: f64) -> Vec<f64> {
    let reach = (3.0 * sigma).ceil() as i64;
    let coefficient = |i: i64| if sigma > 0.0 { (-0.5 * (i as f64 / sigma).powi(2)).exp() } else { 1.0 };
    let coefficients: Vec<f64> = (-reach..=reach).map(coefficient).collect();
    let sum: f64 = coefficients.iter().sum();
    let mut out = vec![0.0; side * side];
    for (i, texel) in texels.iter().enumerate().filter(|(_, t)| **t != 0.0) {
        let (x, y) = ((i % side) as i64, i / side);
        for (to, c) in (x - reach..=x + reach).zip(&coefficients) {
            if to >= 0 && to < side as i64 {
                out[to as usize * side + y] += texel * c / sum;
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    const PARAMS: OperatorParams = OperatorParams { rim: 0.0, gaussian_px: 0.0, largest_radius_px: 12.0 };

    fn opening(blades: u32, rotation_rad: f64) -> Opening {
        Opening { diameter_m: 1.0, focus_distance_m: 1.0, blades, rotation_rad }
    }

    fn at(make: &OperatorParams, operator: &[f64], x: i64, y: i64) -> f64 {
        let half = make.half_side() as i64;
        operator[((y + half) * (2 * half + 1) + x + half) as usize]
    }

    #[test]
    fn fill_intensity_matches_the_papers_example() {
        // Q = 0.6, R = 10: r = 6; R_K = 36, O = 0.5: N = 30/36 · 0.5.
        let radius = 10.0 * 0.6;
        assert!((fill_intensity(36.0, radius, 0.5) - 0.416_667).abs() < 1e-6);
    }

    #[test]
    fn operator_of_a_square_matches_hand_computed_values() {
        // Corners at 45°, sides of 2·5 px: 121 texels, 81 of them whole, 36 halves, 4 quarters;
        // area 100.
        let outline = Shape::Lens.outline(&opening(4, TAU / 8.0));
        let operator = PARAMS.operator(&outline, 5.0 * 2f64.sqrt());
        assert!((at(&PARAMS, &operator, 0, 0) - 0.01).abs() < 1e-9);
        assert!((at(&PARAMS, &operator, 5, 0) - 0.005).abs() < 1e-9);
        assert!((at(&PARAMS, &operator, -5, -5) - 0.0025).abs() < 1e-9);
        assert!(at(&PARAMS, &operator, 6, 0).abs() < 1e-12);
        // With λ = 0.1 and r = 5√2 the outline adds 0.7071 along 40 px, on the centres of the
        // texels that it crosses: sum 128.28.
        let make = OperatorParams { rim: 0.1, ..PARAMS };
        let rimmed = make.operator(&outline, 5.0 * 2f64.sqrt());
        let sum = 100.0 + 0.1 * 50f64.sqrt() * 40.0;
        assert!((at(&make, &rimmed, 0, 0) - 1.0 / sum).abs() < 1e-6);
        assert!((at(&make, &rimmed, 5, 0) - (0.5 + 0.1 * 50f64.sqrt()) / sum).abs() < 1e-6);
        // σ = 1: the Gaussian's coefficients 1, e^-0.5, e^-2, e^-4.5 around the middle; far inside
        // nothing changes.
        let make = OperatorParams { gaussian_px: 1.0, ..PARAMS };
        let soft = make.operator(&outline, 5.0 * 2f64.sqrt());
        assert!((at(&make, &soft, 0, 0) - 0.01).abs() < 1e-9);
        let (c1, c2, c3) = ((-0.5f64).exp(), (-2f64).exp(), (-4.5f64).exp());
        let all = 1.0 + 2.0 * (c1 + c2 + c3);
        // One texel outside: half a texel at a distance of 1, whole ones at 2 and 3.
        assert!((at(&make, &soft, 6, 0) - 0.01 * (0.5 * c1 + c2 + c3) / all).abs() < 1e-9);
    }

    #[test]
    fn operator_of_every_shape_sums_to_1_and_lies_within_its_circle() {
        let make = OperatorParams { rim: 0.05, gaussian_px: 0.0, largest_radius_px: 12.0 };
        for (shape, blades) in [
            (Shape::Lens, 0),
            (Shape::Lens, 3),
            (Shape::Lens, 5),
            (Shape::Lens, 32),
            (Shape::Star, 0),
            (Shape::Star, 6),
            (Shape::Heart, 0),
        ] {
            let outline = shape.outline(&opening(blades, 0.3));
            for radius in [0.0, 0.2, 1.0, 6.3, 12.0] {
                let operator = make.operator(&outline, radius);
                assert!((operator.iter().sum::<f64>() - 1.0).abs() < 1e-9, "{shape:?} {radius}");
                let half = make.half_side() as i64;
                let side = 2 * half + 1;
                for (i, value) in operator.iter().enumerate().filter(|(_, v)| **v > 1e-12) {
                    let (x, y) = (i as i64 % side - half, i as i64 / side - half);
                    let away = (x as f64).hypot(y as f64);
                    assert!(away < radius + 2f64.sqrt() && *value > 0.0, "{shape:?} {radius}: {x} {y}");
                }
            }
        }
    }

    #[test]
    fn operators_of_star_and_heart_have_their_features() {
        let whole = |shape: Shape, blades| {
            let outline = shape.outline(&opening(blades, 0.0));
            let operator = PARAMS.operator(&outline, 12.0);
            let top = operator.iter().fold(0.0f64, |m, &v| m.max(v));
            (operator, top)
        };
        let (star, top) = whole(Shape::Star, 0);
        // One point upwards (y downwards), none downwards, dents between. The pentagram's area is
        // 1.12257 r².
        assert!(at(&PARAMS, &star, 0, -9) > 0.9 * top && at(&PARAMS, &star, 0, 9) < 0.1 * top);
        assert!((1.0 / top / 144.0 - 1.122_57).abs() < 0.01, "{}", 1.0 / top / 144.0);
        let (heart, top) = whole(Shape::Heart, 0);
        // Its point down, a notch above, two lobes.
        assert!(at(&PARAMS, &heart, 0, 7) > 0.9 * top && at(&PARAMS, &heart, 0, -8) < 0.1 * top);
        assert!(at(&PARAMS, &heart, 6, -8) > 0.9 * top && at(&PARAMS, &heart, -6, -8) > 0.9 * top);
        assert!((at(&PARAMS, &heart, 5, 3) - at(&PARAMS, &heart, -5, 3)).abs() < 1e-9);
    }
}
