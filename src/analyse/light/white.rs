//! How bright the light is: reflectance and light share a factor, and the whitest things tell it.
//!
//! Of the reflectances of what looks up, each surface by its brightest spot, the 99.5th percentile is taken for 0.8, about what white
//! paint and paper reflect. Walls are left out: lamps hang near them, and an error in a lamp's place makes a wall's reflectance come out
//! as 1 and more. Where fewer than 400 surfaces look up, all count. Colour: what is bright
//! and nearly neutral as the camera shows it is neutral, or else the camera's white balance is right and the light is; neither is sure,
//! so that the light is half as coloured as those things. Where there are too few of them, it is white.

use super::quantile::{Known, quantile};

const SHARE: f64 = 0.995;
pub const WHITE: f64 = 0.8;
/// Shares between which the whitest things are, and how far white things lie from 0.8.
const BETWEEN: [f64; 2] = [0.99, 0.999];
const LOOSE: f64 = 1.1;
/// The fewest surfaces that look up, if they alone are to tell.
const FEWEST_UP: usize = 400;
/// Neutral is within this of grey, ln, and at least so bright by the whitest.
const NEUTRAL: f64 = 0.3;
const BRIGHT: f64 = 0.5;
const FEWEST: usize = 40;
/// How far things are believed, and the camera's white balance is not.
const SURE: f64 = 0.5;

/// A surface under a light of unknown scale.
#[derive(Clone, Copy, Debug)]
pub struct Lit {
    /// What it sends by what comes: of its brightest spot, luminance.
    pub brightest: f64,
    pub is_clipped: bool,
    pub looks_up: bool,
    /// By colour, and what it sends.
    pub albedo: [f64; 3],
    pub light: [f64; 3],
}

/// By what the light is multiplied, for each colour, and the factors between which that lies.
pub fn white(surfaces: &[Lit]) -> Option<([f64; 3], [f64; 2])> {
    let of_some = |some: &dyn Fn(&&Lit) -> bool| -> Vec<Known> {
        surfaces.iter().filter(some).map(|lit| (lit.brightest as f32, 1.0, lit.is_clipped)).collect()
    };
    let mut known = of_some(&|lit| lit.looks_up);
    if known.len() < FEWEST_UP {
        known = of_some(&|_| true);
    }
    let mut at = |share: f64| quantile(&mut known, share).map(|(value, _)| f64::from(value)).filter(|v| *v > 0.0);
    let (low, middle, high) = (at(BETWEEN[0])?, at(SHARE)?, at(BETWEEN[1])?);
    let mut colours: [Vec<f64>; 3] = Default::default();
    for lit in surfaces {
        let mean = lit.light.iter().sum::<f64>() / 3.0;
        let is_neutral = lit.light.iter().all(|v| *v > 0.0 && (v / mean).ln().abs() < NEUTRAL);
        if is_neutral && lit.brightest > BRIGHT * middle && !lit.is_clipped {
            let mean = lit.albedo.iter().sum::<f64>() / 3.0;
            (0..3).for_each(|c| colours[c].push((lit.albedo[c] / mean).ln()));
        }
    }
    let tint = colours.map(|mut values| {
        let half = values.len() / 2;
        if values.len() < FEWEST { 1.0 } else { (SURE * *values.select_nth_unstable_by(half, f64::total_cmp).1).exp() }
    });
    Some((tint.map(|tint| tint * middle / WHITE), [low / middle / LOOSE, high / middle * LOOSE]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_whitest_things_that_look_up_show_08_and_what_is_nearly_neutral_is_neutral() {
        // 1000 surfaces: ten of paper, which send 0.68 under a light of 1 in unknown units and are yellowish by a warm lamp.
        let lit = |albedo: f64| Lit {
            brightest: albedo,
            is_clipped: false,
            looks_up: true,
            albedo: [1.1 * albedo, albedo, 0.9 * albedo],
            light: [1.1 * albedo, albedo, 0.9 * albedo],
        };
        let mut all = vec![lit(0.3); 890];
        all.extend(vec![lit(0.5); 100]);
        all.extend(vec![lit(0.68); 10]);
        // Walls near a lamp seem whiter than anything.
        all.extend(vec![Lit { looks_up: false, ..lit(1.2) }; 40]);
        let (factors, [low, high]) = white(&all).unwrap();
        for (found, expected) in factors.iter().zip([1.1f64, 1.0, 0.9].map(|tint| 0.85 * tint.sqrt())) {
            assert!((found - expected).abs() < 1e-6, "{factors:?}");
        }
        assert!(low < 1.0 && high > 1.0);
        assert!(white(&[]).is_none());
    }
}
