//! Sharpness from straight edges in a picture: the blur of lens and sensor, as modelled by
//! `point_spread`.
//!
//! Light is additive, code values are not: the picture is decoded by the camera's response, and its
//! luminance is measured (measure/slanted.rs). An edge's result has the uncertainty of that edge.
//! Edges of one picture differ by more if some are out of focus, moving or curved, or if the lens
//! is softer in places. So several edges are combined with weights 1/(u² + τ²), τ² their variance
//! beyond their uncertainties u (DerSimonian and Laird 1986).

use crate::camera::Response;
use crate::grey_image::GreyImage;
use crate::measure::edge_profile::light_profile;
use crate::measure::slanted::{EdgeError, SlantedEdge, slanted_edge};
use crate::pixels::{Pixels, Rect, WEIGHTS_709};
use crate::text::fixed;

/// The profile's table and parameter of the blur.
pub const PARAMETER: (&str, &str) = ("point_spread", "sigma_px");
/// Largest accepted share of clipped pixels.
const MAX_CLIPPED_SHARE: f64 = 0.02;
/// Smallest step of an edge, 8-bit codes.
const MIN_STEP_CODES: f64 = 12.0;
/// Misfits above this are reported, as a share of the step.
const REPORTED_MISFIT: f64 = 0.02;
/// Motions across the edge above this are reported, px.
const REPORTED_MOTION_PX: f64 = 1.0;

/// Reason why an edge gives no sharpness.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
pub enum SharpnessError {
    #[error(
        "{percent:.0} % of the pixels are clipped, so the edge's profile is unknown there; choose an edge that is not \
         overexposed"
    )]
    Clipped { percent: f64 },
    #[error("too little contrast: both sides differ by {codes:.1} of 255 codes; {MIN_STEP_CODES} and more are needed")]
    Faint { codes: f64 },
    #[error(transparent)]
    Edge(#[from] EdgeError),
}

/// The light in which an edge is measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum EdgeLight {
    /// Luminance, or the channel with the smallest uncertainty if luminance shows no edge.
    #[default]
    Best,
    /// Red, green or blue alone: 0 to 2.
    Channel(usize),
}

impl EdgeLight {
    fn weights(self) -> [f64; 3] {
        match self {
            Self::Best => WEIGHTS_709,
            Self::Channel(channel) => [0, 1, 2].map(|c| f64::from(u8::from(c == channel))),
        }
    }
}

/// The profile of light across a region, by [`across`], as a share of the camera's full scale. It
/// also exists for a rejected edge.
pub fn edge_profile(picture: &Pixels, response: &Response, region: Rect, of: EdgeLight) -> Vec<[f64; 2]> {
    let (light, _) = light_of(picture, response, region, of.weights());
    light.map_or_else(Vec::new, |light| light_profile(&light, Rect::full(light.width as u32, light.height as u32)))
}

/// Measures the edge that crosses a region of a picture, in [`EdgeLight::Best`]. `moved_px` is the
/// motion during the exposure. Light is a share of the camera's full scale. An edge from yellow to
/// white shows in blue alone. Behind a colour filter array a channel is less sharp than luminance.
pub fn edge(
    picture: &Pixels,
    response: &Response,
    region: Rect,
    moved_px: [f64; 2],
) -> Result<SlantedEdge, SharpnessError> {
    edge_in(picture, response, region, moved_px, EdgeLight::Best)
}

/// Measures an edge in the chosen light.
pub fn edge_in(
    picture: &Pixels,
    response: &Response,
    region: Rect,
    moved_px: [f64; 2],
    of: EdgeLight,
) -> Result<SlantedEdge, SharpnessError> {
    let measured = |light| edge_of(picture, response, region, moved_px, light);
    let sigma = measured(of.weights());
    if of != EdgeLight::Best {
        return sigma;
    }
    sigma.or_else(|error| {
        let best = (0..3).filter_map(|channel| measured(EdgeLight::Channel(channel).weights()).ok());
        best.min_by(|a, b| a.uncertainty_px.total_cmp(&b.uncertainty_px)).ok_or(error)
    })
}

/// Measures an edge in the light Σ `weights` · (R, G, B).
fn edge_of(
    picture: &Pixels,
    response: &Response,
    region: Rect,
    moved_px: [f64; 2],
    weights: [f64; 3],
) -> Result<SlantedEdge, SharpnessError> {
    let region = region.intersection(&Rect::full(picture.width, picture.height));
    let (light, percent) = light_of(picture, response, region, weights);
    if percent > 100.0 * MAX_CLIPPED_SHARE {
        return Err(SharpnessError::Clipped { percent });
    }
    let Some(light) = light else {
        return Err(EdgeError::Small { width: region.width(), height: region.height() }.into());
    };
    let mut edge = slanted_edge(&light, Rect::full(region.width(), region.height()), moved_px)?;
    let codes = 255.0 * (response.encode(edge.bright) - response.encode(edge.dark.max(0.0)));
    if codes < MIN_STEP_CODES {
        return Err(SharpnessError::Faint { codes });
    }
    for end in &mut edge.line_px {
        *end = [end[0] + f64::from(region.x0), end[1] + f64::from(region.y0)];
    }
    Ok(edge)
}

/// Light of a region, and the percentage of clipped pixels.
fn light_of(picture: &Pixels, response: &Response, region: Rect, weights: [f64; 3]) -> (Option<GreyImage<f64>>, f64) {
    let region = region.intersection(&Rect::full(picture.width, picture.height));
    let (width, height) = (region.width() as usize, region.height() as usize);
    let (light, full) = (response.table(picture.max_code()), picture.max_code());
    let (mut values, mut clipped) = (Vec::with_capacity(width * height), 0usize);
    for (y, x) in (region.y0..region.y1).flat_map(|y| (region.x0..region.x1).map(move |x| (y, x))) {
        let codes = picture.at(x as u32, y as u32);
        clipped += usize::from(codes.contains(&full));
        values.push((0..3).map(|c| weights[c] * light[codes[c] as usize]).sum());
    }
    let percent = 100.0 * clipped as f64 / values.len().max(1) as f64;
    (GreyImage::new(width, height, values).filter(|grey| !grey.values.is_empty()), percent)
}

/// Combined result of several edges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CombinedSharpness {
    pub sigma_px: f64,
    /// One standard deviation.
    pub uncertainty_px: f64,
    /// Standard deviation between edges beyond their uncertainties.
    pub between_px: f64,
}

/// Combines edges. `None` without any.
pub fn combine(edges: &[SlantedEdge]) -> Option<CombinedSharpness> {
    // Limits the weight of an edge without noise.
    let squares: Vec<f64> = edges.iter().map(|e| e.uncertainty_px.max(1e-3).powi(2)).collect();
    let mean = |weights: &[f64]| {
        let sum: f64 = weights.iter().zip(edges).map(|(w, e)| w * e.sigma_px).sum();
        sum / weights.iter().sum::<f64>()
    };
    let weights: Vec<f64> = squares.iter().map(|u2| 1.0 / u2).collect();
    let (total, middle) = (weights.iter().sum::<f64>(), mean(&weights));
    let apart: f64 = weights.iter().zip(edges).map(|(w, e)| w * (e.sigma_px - middle).powi(2)).sum();
    let divisor = total - weights.iter().map(|w| w * w).sum::<f64>() / total;
    let between = if edges.len() > 1 { ((apart - (edges.len() as f64 - 1.0)) / divisor).max(0.0) } else { 0.0 };
    let weights: Vec<f64> = squares.iter().map(|u2| 1.0 / (u2 + between)).collect();
    (!edges.is_empty()).then(|| CombinedSharpness {
        sigma_px: mean(&weights),
        uncertainty_px: weights.iter().sum::<f64>().powf(-0.5),
        between_px: between.sqrt(),
    })
}

/// Remarks on the reliability of an edge.
pub fn notes(edge: &SlantedEdge, moved_px: [f64; 2]) -> Vec<String> {
    let mut notes = Vec::new();
    if edge.sigma_px == 0.0 {
        notes.push("the edge is as sharp as pixels show it, or sharper: the camera may sharpen".to_owned());
    }
    if edge.misfit > REPORTED_MISFIT {
        let percent = fixed(100.0 * edge.misfit, 1);
        notes.push(format!("not a clean step ({percent} % off): sharpened by the camera, or another response curve?"));
    }
    let across = (edge.normal[0] * moved_px[0] + edge.normal[1] * moved_px[1]).abs();
    if across > REPORTED_MOTION_PX {
        let across = fixed(across, 1);
        notes.push(format!("it moved by {across} px while the shutter was open: a frame at rest is more accurate"));
    }
    notes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn edge_of(sigma_px: f64, uncertainty_px: f64) -> SlantedEdge {
        SlantedEdge {
            line_px: [[0.0; 2]; 2],
            slant_deg: 5.0,
            normal: [1.0, 0.0],
            sigma_px,
            uncertainty_px,
            rise_10_90_px: None,
            dark: 0.1,
            bright: 0.5,
            noise: 0.01,
            misfit: 0.0,
            spread: Vec::new(),
            fitted: Vec::new(),
            pixels: 0,
        }
    }

    #[test]
    fn edges_that_agree_are_weighted_by_uncertainty_and_others_equally() {
        assert_eq!(combine(&[]), None);
        // (0.6/0.01² + 0.61/0.02²) / (1/0.01² + 1/0.02²) = (6000 + 1525) / 12500.
        let both = combine(&[edge_of(0.6, 0.01), edge_of(0.61, 0.02)]).unwrap();
        assert!((both.sigma_px - 7525.0 / 12500.0).abs() < 1e-12 && both.between_px == 0.0, "{both:?}");
        assert!((both.uncertainty_px - 12500f64.powf(-0.5)).abs() < 1e-12);
        // A hundred deviations apart: τ² is half the square of their distance, and both count
        // alike.
        let apart = combine(&[edge_of(0.5, 0.001), edge_of(0.9, 0.004)]).unwrap();
        assert!(
            (apart.sigma_px - 0.7).abs() < 1e-3 && (apart.between_px - 0.4 / 2f64.sqrt()).abs() < 1e-3,
            "{apart:?}"
        );
        assert!((apart.uncertainty_px - 0.2).abs() < 1e-3);
    }

    #[test]
    fn doubtful_edges_are_reported() {
        let mut edge = edge_of(0.0, 0.1);
        edge.misfit = 0.03;
        let notes = notes(&edge, [-2.0, 5.0]);
        assert_eq!(notes.len(), 3);
        assert!(notes[1].contains("3.0 %") && notes[2].contains("2.0 px"), "{notes:?}");
    }
}
