//! A corner to a fraction of a pixel.
//!
//! At a place p on an edge brightness changes across the edge alone, so its slope g is at right angles to p − q, q the
//! corner; elsewhere g is 0. The corner is the q with the least Σ w (g·(p − q))² (Förstner and Gülch 1987), w a Gaussian
//! around it. Noise of the slopes pulls q to the window's middle, which is why the window follows q until it rests.

use glam::{DMat2, DVec2};

use super::plane::Plane;

/// The window's half width as a share of the way to the nearest other corner: no other edge lies in it.
const SHARE: f64 = 0.45;
/// The widest half width as a share of the picture's width: a distorted edge is straight over that.
const WIDEST: f64 = 1.0 / 100.0;
/// And in px: it averages noise.
const WIDEST_PX: f64 = 11.0;
/// Narrower windows hold too few pixels, px.
const NARROWEST_PX: f64 = 2.5;
/// It rests when a step is below this, px.
const RESTS_PX: f64 = 1e-3;
/// Of the two directions in which edges run the weaker holds at least this share of the slopes.
const FLAT: f64 = 0.02;

/// The corner near a place, in a picture as it was taken. `nearest_px`: the way to the nearest other corner. `None` if it
/// leaves the window's middle half, or if there are no two edges.
pub fn refined(picture: &Plane, near: DVec2, nearest_px: f64) -> Option<DVec2> {
    let widest = WIDEST_PX.max(WIDEST * picture.width as f64);
    let half = (SHARE * nearest_px).clamp(NARROWEST_PX, widest);
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
        if moved < RESTS_PX {
            break;
        }
    }
    Some(at)
}

fn step(picture: &Plane, at: DVec2, half: f64) -> Option<DVec2> {
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
            let slope = picture.slope(x, y);
            let outer = DMat2::from_cols(slope * slope.x, slope * slope.y) * weight;
            sum += outer;
            across += outer * p;
        }
    }
    let trace = sum.x_axis.x + sum.y_axis.y;
    let determinant = sum.determinant();
    // λ₁λ₂ of λ₁ + λ₂: the weaker direction is about their ratio.
    (trace > 0.0 && determinant > FLAT * trace * trace * 0.25).then(|| at + sum.inverse() * across)
}
