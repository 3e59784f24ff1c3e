//! The plane around a pixel of a depth map.
//!
//! On a plane n·X = d the depth z along the ray r (X = z·r) satisfies 1/z = (n/d)·r: it is linear
//! in the ray. So the plane is the linear least-squares fit of 1/z over the pixels around. Errors
//! of structured-light and stereo sensors, which are uniform in 1/z, get the right weights. Pixels
//! of other surfaces are weighted down by Tukey's biweight, iteratively, beginning with those whose
//! depth is near that of the picked pixel.
//!
//! Not modelled: curved surfaces. Within the neighbourhood they are approximated by planes.

use glam::{DMat3, DVec2, DVec3};

use crate::fit::quantile::{SIGMA_PER_MAD, upper_median};
use crate::pixels::DepthMap;

/// Radius of the neighbourhood, as a share of the picture's width.
const RADIUS_SHARE: f64 = 1.0 / 40.0;
/// Largest number of samples along each axis.
const MAX_SAMPLES_A_SIDE: i32 = 41;
/// Largest relative difference of a pixel's depth from the picked one's in the first fit.
const FIRST_TOLERANCE: f64 = 0.06;
/// Reweighting iterations.
const REWEIGHTINGS: usize = 8;
/// Tukey's constant: 95 % efficient for normal errors.
const TUKEY: f64 = 4.685;
/// Smallest number of a plane's pixels.
const MIN_PIXELS: usize = 12;

/// A plane in the camera's axes, as an affine function of the picture: the inverse depth.
#[derive(Clone, Copy, Debug)]
pub struct InverseDepthPlane {
    /// n/d, so that 1/z = (n/d)·ray.
    pub inverse_depth: DVec3,
    /// Standard deviation of 1/z, 1/m.
    pub sigma: f64,
    /// Share of the pixels around that lie on the plane.
    pub share: f64,
}

impl InverseDepthPlane {
    /// Intersection with a ray in the camera's axes; `None` if it lies behind the ray's origin.
    pub fn intersect(&self, origin: DVec3, along: DVec3) -> Option<DVec3> {
        // n·X = d is (n/d)·X = 1.
        let t = (1.0 - self.inverse_depth.dot(origin)) / self.inverse_depth.dot(along);
        (t > 0.0 && t.is_finite()).then(|| origin + t * along)
    }

    /// Fits the plane to the surface at a position of a map, px. `ray` returns the ray of
    /// a position, with length 1 by the map's convention of depth.
    pub fn around(depth: &DepthMap, at_px: DVec2, ray: impl Fn(DVec2) -> Option<DVec3>) -> Option<Self> {
        let radius = (RADIUS_SHARE * f64::from(depth.width)).max(4.0);
        let step = ((2.0 * radius / f64::from(MAX_SAMPLES_A_SIDE)).ceil() as i32).max(1);
        let reach = (radius / f64::from(step)) as i32;
        let (x0, y0) = (at_px.x as i32, at_px.y as i32);
        let mut points: Vec<(DVec3, f64, f64)> = Vec::new();
        for (dx, dy) in (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dx * step, dy * step))) {
            let (x, y) = (x0 + dx, y0 + dy);
            if x < 0 || y < 0 || x >= depth.width as i32 || y >= depth.height as i32 {
                continue;
            }
            let z = f64::from(depth.depth_m[y as usize * depth.width as usize + x as usize]);
            let at = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            if let (true, Some(ray)) = (z > 0.0 && z.is_finite(), ray(at)) {
                points.push((ray, z.recip(), at.distance(at_px)));
            }
        }
        // The picked surface is that of the nearest measured pixel.
        let picked = points.iter().min_by(|a, b| a.2.total_cmp(&b.2)).filter(|nearest| nearest.2 <= 0.25 * radius)?.1;
        let mut weights: Vec<f64> =
            points.iter().map(|(_, w, _)| f64::from((w / picked - 1.0).abs() < FIRST_TOLERANCE)).collect();
        let mut fitted = None;
        for _ in 0..REWEIGHTINGS {
            let plane = least_squares(&points, &weights)?;
            let residuals: Vec<f64> = points.iter().map(|(ray, w, _)| (plane.dot(*ray) - w).abs()).collect();
            let on = residuals.iter().zip(&weights).filter(|(_, weight)| **weight > 0.0).map(|(r, _)| *r);
            // Robust σ from the median of absolute residuals; at least the rounding error of 32-bit
            // depth.
            let sigma = (SIGMA_PER_MAD * upper_median(on)?).max(1e-6 * picked);
            weights = residuals.iter().map(|r| (1.0 - (r / (TUKEY * sigma)).powi(2)).max(0.0).powi(2)).collect();
            fitted = Some((plane, sigma));
        }
        let (inverse_depth, sigma) = fitted?;
        let on = weights.iter().filter(|weight| **weight > 0.0).count();
        (on >= MIN_PIXELS).then(|| Self { inverse_depth, sigma, share: on as f64 / points.len() as f64 })
    }
}

/// Solves the normal equations of 1/z = p·ray; `None` if the rays span no plane.
fn least_squares(points: &[(DVec3, f64, f64)], weights: &[f64]) -> Option<DVec3> {
    let (mut matrix, mut right, mut count) = (DMat3::ZERO, DVec3::ZERO, 0);
    for ((ray, inverse, _), weight) in points.iter().zip(weights).filter(|(_, weight)| **weight > 0.0) {
        let scaled = *ray * *weight;
        matrix += DMat3::from_cols(scaled * ray.x, scaled * ray.y, scaled * ray.z);
        right += scaled * *inverse;
        count += 1;
    }
    let solved = matrix.inverse() * right;
    (count >= MIN_PIXELS && solved.is_finite()).then_some(solved)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rays of a pinhole of 100 px over 160 × 120 px.
    fn ray(at: DVec2) -> Option<DVec3> {
        Some(DVec3::new((at.x - 80.0) / 100.0, (at.y - 60.0) / 100.0, 1.0))
    }

    fn map(depth: impl Fn(f64, f64) -> f64) -> DepthMap {
        let places = (0..120).flat_map(|y| (0..160).map(move |x| (f64::from(x) + 0.5, f64::from(y) + 0.5)));
        DepthMap {
            width: 160,
            height: 120,
            depth_m: places.map(|(x, y)| depth(x, y) as f32).collect(),
            timestamp_s: 0.0,
        }
    }

    #[test]
    fn plane_fit_ignores_another_surface_and_gaps() {
        // Tilted by 45° about x: y = z − 2. Right of column 84, another surface is in front of it
        // at 1 m.
        let on_plane = |y: f64| 2.0 / (1.0 - (y - 60.0) / 100.0);
        let depth = map(|x, y| {
            if x > 84.0 {
                1.0
            } else if (x as i32 + y as i32) % 3 == 0 {
                0.0
            } else {
                on_plane(y)
            }
        });
        let at = DVec2::new(82.0, 50.0);
        let plane = InverseDepthPlane::around(&depth, at, ray).unwrap();
        let z = plane.inverse_depth.dot(ray(at).unwrap()).recip();
        assert!((z - on_plane(50.0)).abs() < 1e-5, "{z}");
        let normal = plane.inverse_depth.normalize();
        assert!(normal.abs_diff_eq(DVec3::new(0.0, -0.5f64.sqrt(), 0.5f64.sqrt()), 1e-5), "{normal}");
        assert!(plane.share > 0.5 && plane.share < 0.95, "{}", plane.share);
        // The surface in front faces the camera.
        let front = InverseDepthPlane::around(&depth, DVec2::new(86.0, 50.0), ray).unwrap();
        assert!(front.inverse_depth.abs_diff_eq(DVec3::Z, 1e-5), "{}", front.inverse_depth);
        // A map without measured depth has no plane.
        assert!(InverseDepthPlane::around(&map(|_, _| 0.0), at, ray).is_none());
    }
}
