//! Sharpness from straight edges in a picture: the blur of lens and sensor, as `point_spread` draws it.
//!
//! Light adds, code values do not: the picture is decoded by the camera's response, and the luminance measured
//! (measure/slanted.rs). What one edge gives has the uncertainty of that edge. Edges of one picture differ by more where
//! some lie out of focus, move or are round, or the lens is softer at one place. So several are put together with weights
//! 1/(u² + τ²), τ² their variance beyond what their uncertainties u explain (DerSimonian and Laird 1986).

use crate::camera::Response;
use crate::measure::Grey;
use crate::measure::across::across;
use crate::measure::slanted::{EdgeError, SlantedEdge, slanted_edge};
use crate::pixels::{Pixels, Rect};
use crate::text::fixed;

/// The table and parameter that the width is for.
pub const PARAMETER: (&str, &str) = ("point_spread", "sigma_px");
/// Luminance of linear R, G, B (BT.709).
const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];
/// This share of clipped pixels is borne.
const CLIPPED: f64 = 0.02;
/// A fainter step is made of too few code values.
const FEWEST_CODES: f64 = 12.0;
/// Misfits beyond this are told, as a share of the step.
const ODD: f64 = 0.02;
/// Movements beyond this share of the blur are told.
const MOVES: f64 = 1.0;

/// Why an edge tells nothing of sharpness.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
pub enum SharpnessError {
    #[error(
        "{percent:.0} % of the pixels are as bright as the camera can say: how the light goes on there is not known; choose an \
         edge that is not overexposed"
    )]
    Clipped { percent: f64 },
    #[error("too little contrast: both sides differ by {codes:.1} of 255 codes; {FEWEST_CODES} and more are needed")]
    Faint { codes: f64 },
    #[error(transparent)]
    Edge(#[from] EdgeError),
}

/// Of which light an edge is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Of {
    /// The luminance, or, where that shows no edge, the channel that shows it best.
    #[default]
    Best,
    /// Red, green or blue alone: 0 to 2.
    Channel(usize),
}

impl Of {
    fn weights(self) -> [f64; 3] {
        match self {
            Self::Best => LUMINANCE,
            Self::Channel(channel) => [0, 1, 2].map(|c| f64::from(u8::from(c == channel))),
        }
    }
}

/// The profile of light across a region, by [`across`], as a share of the camera's full scale. It
/// also exists for an edge that is refused.
pub fn seen(picture: &Pixels, response: &Response, region: Rect, of: Of) -> Vec<[f64; 2]> {
    let (light, _) = light_of(picture, response, region, of.weights());
    light.map_or_else(Vec::new, |light| across(&light, Rect::full(light.width as u32, light.height as u32)))
}

/// Measures the edge that crosses a region of a picture. `moved_px`: its way while the shutter was open. Light is a share of
/// the camera's full scale. Yellow before white is an edge of blue alone. Behind a mosaic of colour filters a channel is less sharp than the luminance.
pub fn edge(
    picture: &Pixels,
    response: &Response,
    region: Rect,
    moved_px: [f64; 2],
) -> Result<SlantedEdge, SharpnessError> {
    edge_in(picture, response, region, moved_px, Of::Best)
}

/// The same, of the light that is chosen.
pub fn edge_in(
    picture: &Pixels,
    response: &Response,
    region: Rect,
    moved_px: [f64; 2],
    of: Of,
) -> Result<SlantedEdge, SharpnessError> {
    let measured = |light| edge_of(picture, response, region, moved_px, light);
    let found = measured(of.weights());
    if of != Of::Best {
        return found;
    }
    found.or_else(|error| {
        let best = (0..3).filter_map(|channel| measured(Of::Channel(channel).weights()).ok());
        best.min_by(|a, b| a.uncertainty_px.total_cmp(&b.uncertainty_px)).ok_or(error)
    })
}

/// Of the light that R, G and B give with these weights.
fn edge_of(
    picture: &Pixels,
    response: &Response,
    region: Rect,
    moved_px: [f64; 2],
    weights: [f64; 3],
) -> Result<SlantedEdge, SharpnessError> {
    let region = region.intersection(&Rect::full(picture.width, picture.height));
    let (seen, percent) = light_of(picture, response, region, weights);
    if percent > 100.0 * CLIPPED {
        return Err(SharpnessError::Clipped { percent });
    }
    let Some(seen) = seen else {
        return Err(EdgeError::Small { width: region.width(), height: region.height() }.into());
    };
    let mut found = slanted_edge(&seen, Rect::full(region.width(), region.height()), moved_px)?;
    let codes = 255.0 * (response.encode(found.bright) - response.encode(found.dark.max(0.0)));
    if codes < FEWEST_CODES {
        return Err(SharpnessError::Faint { codes });
    }
    for end in &mut found.line_px {
        *end = [end[0] + f64::from(region.x0), end[1] + f64::from(region.y0)];
    }
    Ok(found)
}

/// The light of a region, and how many percent of its pixels are clipped.
fn light_of(picture: &Pixels, response: &Response, region: Rect, weights: [f64; 3]) -> (Option<Grey>, f64) {
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
    (Grey::new(width, height, values).filter(|grey| !grey.values.is_empty()), percent)
}

/// What several edges say together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Together {
    pub sigma_px: f64,
    /// One standard deviation.
    pub uncertainty_px: f64,
    /// The standard deviation of the edges about each other, beyond their uncertainties.
    pub between_px: f64,
}

/// Puts edges together. `None` without any.
pub fn together(edges: &[SlantedEdge]) -> Option<Together> {
    // An edge without noise is no better than others beyond measure.
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
    (!edges.is_empty()).then(|| Together {
        sigma_px: mean(&weights),
        uncertainty_px: weights.iter().sum::<f64>().powf(-0.5),
        between_px: between.sqrt(),
    })
}

/// What a person should know before trusting an edge.
pub fn notes(edge: &SlantedEdge, moved_px: [f64; 2]) -> Vec<String> {
    let mut notes = Vec::new();
    if edge.sigma_px == 0.0 {
        notes.push("the edge is as sharp as pixels show it, or sharper: the camera may sharpen".to_owned());
    }
    if edge.misfit > ODD {
        let percent = fixed(100.0 * edge.misfit, 1);
        notes.push(format!(
            "its profile is no blurred step: it lies {percent} % of the step beside one (sharpening in the camera, or another \
             response curve?)"
        ));
    }
    let across = (edge.normal[0] * moved_px[0] + edge.normal[1] * moved_px[1]).abs();
    if across > MOVES {
        let across = fixed(across, 1);
        notes.push(format!("it moved by {across} px while the shutter was open: a frame at rest tells more"));
    }
    notes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(sigma_px: f64, uncertainty_px: f64) -> SlantedEdge {
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
    fn edges_that_agree_count_by_their_uncertainty_and_others_alike() {
        assert_eq!(together(&[]), None);
        // (0.6/0.01² + 0.61/0.02²) / (1/0.01² + 1/0.02²) = (6000 + 1525) / 12500.
        let both = together(&[found(0.6, 0.01), found(0.61, 0.02)]).unwrap();
        assert!((both.sigma_px - 7525.0 / 12500.0).abs() < 1e-12 && both.between_px == 0.0, "{both:?}");
        assert!((both.uncertainty_px - 12500f64.powf(-0.5)).abs() < 1e-12);
        // A hundred deviations apart: τ² is half the square of their distance, and both count alike.
        let apart = together(&[found(0.5, 0.001), found(0.9, 0.004)]).unwrap();
        assert!(
            (apart.sigma_px - 0.7).abs() < 1e-3 && (apart.between_px - 0.4 / 2f64.sqrt()).abs() < 1e-3,
            "{apart:?}"
        );
        assert!((apart.uncertainty_px - 0.2).abs() < 1e-3);
    }

    #[test]
    fn what_is_odd_is_told() {
        let mut edge = found(0.0, 0.1);
        edge.misfit = 0.03;
        let notes = notes(&edge, [-2.0, 5.0]);
        assert_eq!(notes.len(), 3);
        assert!(notes[1].contains("3.0 %") && notes[2].contains("2.0 px"), "{notes:?}");
    }
}
