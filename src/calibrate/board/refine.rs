//! Subpixel refinement of a corner.
//!
//! At a point p on an edge the gradient g is perpendicular to p − q, q the corner; elsewhere g is
//! 0. The corner is the q with the least Σ w (g·(p − q))² (Förstner and Gülch 1987), w a Gaussian
//! around it. Noise of the gradients biases q towards the window's centre, so the window is moved
//! to q until it converges.

use glam::{DMat2, DVec2};

use crate::grey_image::GreyImage;

/// Half width of the window as a share of the distance to the nearest other corner, so that it
/// contains no other edge.
const WINDOW_SHARE: f64 = 0.45;
/// Largest half width as a share of the picture's width: a distorted edge is straight over it.
const MAX_HALF_WIDTH_SHARE: f64 = 1.0 / 100.0;
/// Largest half width is at least this, px, to average noise.
const MAX_HALF_WIDTH_PX: f64 = 11.0;
/// Smallest half width, px: narrower windows contain too few pixels.
const MIN_HALF_WIDTH_PX: f64 = 2.5;
/// Convergence threshold of a step, px.
const CONVERGENCE_PX: f64 = 1e-3;
/// Smallest ratio of the structure tensor's eigenvalues, as 4 det / trace².
const MIN_EIGENVALUE_RATIO: f64 = 0.02;

/// Refines a corner in the original picture. `nearest_px` is the distance to the nearest other
/// corner. `None` if the corner leaves the central half of the window, or if there are no two
/// edges.
pub fn refine_corner(picture: &GreyImage, near: DVec2, nearest_px: f64) -> Option<DVec2> {
    let widest = MAX_HALF_WIDTH_PX.max(MAX_HALF_WIDTH_SHARE * picture.width as f64);
    let half = (WINDOW_SHARE * nearest_px).clamp(MIN_HALF_WIDTH_PX, widest);
    let mut at = near;
    for _ in 0..20 {
        if !picture.holds(at, half + 1.0) {
            return None;
        }
        let next = step(picture, at, half)?;
        let moved = next.distance(at);
        at = next;
        if at.distance(near) > 0.5 * half.max(4.0) {
            return None;
        }
        if moved < CONVERGENCE_PX {
            break;
        }
    }
    Some(at)
}

fn step(picture: &GreyImage, at: DVec2, half: f64) -> Option<DVec2> {
    let sigma = 0.5 * half;
    let (mut sum, mut across) = (DMat2::ZERO, DVec2::ZERO);
    let reach = half.ceil() as i64;
    let middle = (at.x.floor() as i64, at.y.floor() as i64);
    for y in middle.1 - reach..=middle.1 + reach {
        for x in middle.0 - reach..=middle.0 + reach {
            let p = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - at;
            if p.abs().max_element() > half {
                continue;
            }
            let weight = (-0.5 * p.length_squared() / (sigma * sigma)).exp();
            let slope = picture.gradient(x, y);
            let outer = DMat2::from_cols(slope * slope.x, slope * slope.y) * weight;
            sum += outer;
            across += outer * p;
        }
    }
    let trace = sum.x_axis.x + sum.y_axis.y;
    let determinant = sum.determinant();
    // λ₁λ₂ relative to ((λ₁ + λ₂)/2)²: about four times the ratio of the smaller to the larger
    // eigenvalue.
    (trace > 0.0 && determinant > MIN_EIGENVALUE_RATIO * trace * trace * 0.25).then(|| at + sum.inverse() * across)
}
