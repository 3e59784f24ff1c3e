//! The light made as bright as white matt things say at which a person points.

use anyhow::{Result, anyhow};
use glam::Vec3;

use crate::cli::pick::{of_view, triple, view};
use locard_engine::analyse::WHITE;
use locard_engine::scene::Lighting;
use locard_engine::scene::document::LightTable;
use locard_engine::shot::{Shot, View, White};
use locard_engine::words::fixed;

/// How far the factor is believed, ln: white things reflect 0.7 to 0.9, and light found at a place is off by as much again
/// (docs/light.md). Several things that differ by more are believed so far.
const BELIEVED: f64 = 0.17;

pub fn parse(text: &str) -> Result<View, String> {
    view(text, "FRAME:X,Y, as in 30:320,300")
}

/// The factor by which all light is multiplied, and lines about it. Several things have the geometric mean of their factors. `upward`: what
/// white matt shows that looks up; `between`: factors between which the footage says that the light lies.
pub fn factor(
    shot: &Shot,
    views: &[View],
    lighting: &Lighting,
    upward: Vec3,
    between: Option<[f64; 2]>,
) -> Result<(f64, Vec<(&'static str, String)>)> {
    let whites = shot.white_at(views, lighting).map_err(|(n, error)| anyhow!(error).context(named(&views[n])))?;
    let mut lines: Vec<_> = views.iter().zip(&whites).map(|(view, white)| ("white", about(view, white))).collect();
    let (factor, [low, high]) = together(&whites.iter().map(|white| white.factor).collect::<Vec<_>>());
    let times = |by: f64| fixed(by, 2);
    lines.push(("factor", format!("{} on all light, between {} and {}", times(factor), times(low), times(high))));
    let upward = upward.to_array().map(|light| fixed(factor * f64::from(light), 2)).join(", ");
    lines.push(("light", format!("white matt that looks up shows {upward} now")));
    if let Some([least, most]) = between.filter(|[least, most]| high < *least || low > *most) {
        let said = format!("{} to {}", times(least), times(most));
        lines.push((
            "odd",
            format!("the footage says times {said}: is it white, matt, and in the light that was found?"),
        ));
    }
    Ok((factor, lines))
}

fn named(view: &View) -> String {
    format!("--white {}", of_view(view))
}

/// One factor for all, and between what it is believed.
fn together(factors: &[f64]) -> (f64, [f64; 2]) {
    let ln = || factors.iter().map(|factor| factor.ln());
    let mean = ln().sum::<f64>() / factors.len().max(1) as f64;
    let off = ln().map(|ln| (ln - mean).abs()).fold(BELIEVED, f64::max);
    (mean.exp(), [mean - off, mean + off].map(f64::exp))
}

fn about(view: &View, white: &White) -> String {
    let colours = |light: [f64; 3]| light.map(|v| fixed(v, 2)).join(", ");
    let expected = white.comes.light().to_array().map(|v| WHITE * f64::from(v));
    let hidden = white.comes.lamps.iter().enumerate().filter(|(_, (by, seen))| *seen == 0.0 && by.max_element() > 0.0);
    let hidden: Vec<String> = hidden.map(|(n, _)| format!("lamp {}", n + 1)).collect();
    let hidden =
        if hidden.is_empty() { String::new() } else { format!("; {} is hidden from there", hidden.join(", ")) };
    format!(
        "{} at {} m shows {}, by what was found {}: times {}{hidden}",
        of_view(view),
        triple(white.point_m),
        colours(white.shown),
        colours(expected),
        fixed(white.factor, 2)
    )
}

/// All light of a scene's table, by its own keys.
pub fn multiply(light: &mut LightTable, factor: f64) {
    let times = |intensity: Option<f64>| Some(rounded(intensity.unwrap_or(1.0) * factor));
    light.environment_intensity = times(light.environment_intensity);
    light.lamp.iter_mut().for_each(|lamp| lamp.intensity = times(lamp.intensity));
}

/// As many digits as a person reads.
fn rounded(intensity: f64) -> f64 {
    format!("{intensity:.4}").parse().unwrap_or(intensity)
}

#[cfg(test)]
mod tests {
    use super::*;
    use locard_engine::scene::document::LampTable;

    #[test]
    fn several_things_have_their_geometric_mean_and_are_believed_as_far_as_they_differ() {
        let (factor, [low, high]) = together(&[1.2]);
        assert!((factor - 1.2).abs() < 1e-12 && (high / factor - BELIEVED.exp()).abs() < 1e-9, "{low} {high}");
        // √(0.8 · 1.8) = 1.2, and from 0.8 to 1.8.
        let (factor, [low, high]) = together(&[0.8, 1.8]);
        assert!((factor - 1.2).abs() < 1e-9 && (low - 0.8).abs() < 1e-9 && (high - 1.8).abs() < 1e-9, "{low} {high}");
    }

    #[test]
    fn panorama_and_lamps_are_multiplied_by_their_keys() {
        let lamp = LampTable { at_m: [0.0; 3], color: None, intensity: None, diameter_m: None };
        let mut light = LightTable {
            environment: Some("a.hdr".to_owned()),
            environment_intensity: Some(0.5),
            lamp: vec![lamp.clone(), LampTable { intensity: Some(2.0), ..lamp }],
            ..LightTable::default()
        };
        multiply(&mut light, 1.1);
        let lamps: Vec<_> = light.lamp.iter().map(|lamp| lamp.intensity).collect();
        assert_eq!((light.environment_intensity, lamps), (Some(0.55), vec![Some(1.1), Some(2.2)]));
    }

    #[test]
    fn a_place_names_its_frame() {
        let place = parse("30:320,300.5").unwrap();
        assert_eq!((place.frame, of_view(&place)), (30, "30:320,300.5".to_owned()));
        for wrong in ["", "320,300", "a:1,2", "3:1", "3:1,2,3", "-1:2,3"] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }
}
