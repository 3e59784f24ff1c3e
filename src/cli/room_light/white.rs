//! The light corrected by neutral surfaces of known reflectance that a person points at.

use anyhow::{Result, anyhow};
use glam::Vec3;

use crate::cli::pick::{of_view, triple, view};
use locard_engine::analyse::WHITE;
use locard_engine::scene::Lighting;
use locard_engine::scene::document::{Color, LightTable};
use locard_engine::shot::{ReferencePick, Shot, White};
use locard_engine::words::{fixed, number};

/// How far the factor is believed, ln: white things reflect 0.7 to 0.9, and light found at a place is off by as much again
/// (docs/light.md). Several things that differ by more are believed so far.
const BELIEVED: f64 = 0.17;

/// Reflectances of matt surfaces that are accepted: black cloth reflects 0.03, fresh snow 0.9.
const REFLECTANCES: [f64; 2] = [0.02, 0.95];

/// From `FRAME:X,Y` or `FRAME:X,Y=REFLECTANCE`.
pub fn parse(text: &str) -> Result<ReferencePick, String> {
    let (at, reflectance) = match text.split_once('=') {
        None => (text, WHITE),
        Some((at, reflectance)) => {
            let is_accepted = |value: &f64| (REFLECTANCES[0]..=REFLECTANCES[1]).contains(value);
            let [least, most] = REFLECTANCES;
            let value = reflectance.trim().parse().ok().filter(is_accepted);
            (at, value.ok_or_else(|| format!("{text}: accepted is a reflectance of {least} to {most}"))?)
        }
    };
    let view = view(at, "FRAME:X,Y, as in 30:320,300, or with what it reflects, as in 30:320,300=0.3")?;
    Ok(ReferencePick { view, reflectance })
}

/// A correction of all light: one factor, and the colour of geometric mean 1 that is left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Correction {
    pub scale: f64,
    pub tint: [f64; 3],
}

/// The correction that the picks imply, and lines about it. Several picks have their geometric
/// mean. `upward`: what white matt that looks up shows; `between`: factors between which the
/// footage says that the light lies; `keeps_colours`: only the brightness is corrected.
pub fn correction(
    shot: &Shot,
    picks: &[ReferencePick],
    lighting: &Lighting,
    (upward, between): (Vec3, Option<[f64; 2]>),
    keeps_colours: bool,
) -> Result<(Correction, Vec<(&'static str, String)>)> {
    let whites = shot.white_at(picks, lighting).map_err(|(n, error)| anyhow!(error).context(named(&picks[n])))?;
    let mut lines: Vec<_> = picks.iter().zip(&whites).map(|(pick, white)| ("white", about(pick, white))).collect();
    let factors: Vec<[f64; 3]> = whites.iter().map(|white| white.factors).collect();
    let (correction, [low, high]) = together(&factors);
    let correction = if keeps_colours { correction.untinted() } else { correction };
    let Correction { scale, tint } = correction;
    let times = |by: f64| fixed(by, 2);
    let colours = tint.map(times).join(", ");
    lines.push((
        "factor",
        format!("{} on all light, between {} and {}; by colour {colours}", times(scale), times(low), times(high)),
    ));
    let upward = upward.to_array();
    let upward = [0, 1, 2].map(|c| fixed(scale * tint[c] * f64::from(upward[c]), 2)).join(", ");
    lines.push(("light", format!("white matt that looks up shows {upward} now")));
    if let Some([least, most]) = between.filter(|[least, most]| high < *least || low > *most) {
        let said = format!("{} to {}", times(least), times(most));
        lines.push((
            "odd",
            format!("the footage says times {said}: is it neutral, matt, and in the light that was found?"),
        ));
    }
    Ok((correction, lines))
}

fn named(pick: &ReferencePick) -> String {
    format!("--white {}", of_view(&pick.view))
}

/// The geometric mean of all, and between what its scale is believed.
fn together(factors: &[[f64; 3]]) -> (Correction, [f64; 2]) {
    let count = factors.len().max(1) as f64;
    let ln = |factors: &[f64; 3]| factors.iter().map(|factor| factor.ln()).sum::<f64>() / 3.0;
    let mean = factors.iter().map(ln).sum::<f64>() / count;
    let off = factors.iter().map(|factors| (ln(factors) - mean).abs()).fold(BELIEVED, f64::max);
    let tint = [0, 1, 2].map(|c| (factors.iter().map(|factors| factors[c].ln()).sum::<f64>() / count - mean).exp());
    (Correction { scale: mean.exp(), tint }, [mean - off, mean + off].map(f64::exp))
}

fn about(pick: &ReferencePick, white: &White) -> String {
    let colours = |light: [f64; 3]| light.map(|v| fixed(v, 2)).join(", ");
    let expected = white.comes.light().to_array().map(|v| pick.reflectance * f64::from(v));
    let hidden = white.comes.lamps.iter().enumerate().filter(|(_, (by, seen))| *seen == 0.0 && by.max_element() > 0.0);
    let hidden: Vec<String> = hidden.map(|(n, _)| format!("lamp {}", n + 1)).collect();
    let hidden =
        if hidden.is_empty() { String::new() } else { format!("; {} is hidden from there", hidden.join(", ")) };
    format!(
        "{} at {} m, which reflects {}, shows {}, by what was found {}: times {}{hidden}",
        of_view(&pick.view),
        triple(white.point_m),
        number(pick.reflectance),
        colours(white.shown),
        colours(expected),
        colours(white.factors)
    )
}

impl Correction {
    /// Its scale, by the keys of a scene's table; its tint in the lamps' colours.
    pub fn apply(&self, light: &mut LightTable) {
        let times = |intensity: Option<f64>| Some(rounded(intensity.unwrap_or(1.0) * self.scale));
        light.environment_intensity = times(light.environment_intensity);
        for lamp in &mut light.lamp {
            lamp.intensity = times(lamp.intensity);
            let color = lamp.color.map_or([1.0; 3], |color| Vec3::from(color).to_array().map(f64::from));
            lamp.color = Some(Color::Rgb([0, 1, 2].map(|c| rounded(color[c] * self.tint[c]))));
        }
    }

    /// A panorama in its tint.
    pub fn tinted(&self, rgb: &[[f32; 3]]) -> Vec<[f32; 3]> {
        rgb.iter().map(|light| [0, 1, 2].map(|c| (f64::from(light[c]) * self.tint[c]) as f32)).collect()
    }

    /// The same without its tint.
    pub fn untinted(self) -> Self {
        Self { tint: [1.0; 3], ..self }
    }
}

/// As many digits as a person reads.
fn rounded(value: f64) -> f64 {
    format!("{value:.4}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use locard_engine::scene::document::LampTable;

    #[test]
    fn several_picks_have_their_geometric_mean_and_are_believed_as_far_as_they_differ() {
        let (correction, [low, high]) = together(&[[1.2; 3]]);
        assert!((correction.scale - 1.2).abs() < 1e-12 && (high / 1.2 - BELIEVED.exp()).abs() < 1e-9, "{low} {high}");
        // √(0.8 · 1.8) = 1.2, and from 0.8 to 1.8.
        let (correction, [low, high]) = together(&[[0.8; 3], [1.8; 3]]);
        assert!((correction.scale - 1.2).abs() < 1e-9 && (low - 0.8).abs() < 1e-9 && (high - 1.8).abs() < 1e-9);
        // Red 2·8 and 1: of 2, 1 and 0.5 the scale is 1.
        let (Correction { scale, tint }, _) = together(&[[4.0, 1.0, 0.25], [1.0; 3]]);
        assert!((scale - 1.0).abs() < 1e-9 && (tint[0] - 2.0).abs() < 1e-9 && (tint[2] - 0.5).abs() < 1e-9, "{tint:?}");
    }

    #[test]
    fn correction_multiplies_intensities_and_tints_lamps_and_panorama() {
        let lamp = LampTable { at_m: [0.0; 3], color: None, intensity: None, diameter_m: None };
        let coloured = LampTable { color: Some(Color::Rgb([2.0, 1.0, 1.0])), intensity: Some(2.0), ..lamp.clone() };
        let mut light = LightTable {
            environment: Some("a.hdr".to_owned()),
            environment_intensity: Some(0.5),
            lamp: vec![lamp, coloured],
            ..LightTable::default()
        };
        let correction = Correction { scale: 1.1, tint: [2.0, 1.0, 0.5] };
        correction.apply(&mut light);
        let lamps: Vec<_> = light.lamp.iter().map(|lamp| (lamp.intensity, lamp.color)).collect();
        let expected = [(1.1, [2.0, 1.0, 0.5]), (2.2, [4.0, 1.0, 0.5])];
        assert_eq!(light.environment_intensity, Some(0.55));
        assert_eq!(lamps, expected.map(|(intensity, color)| (Some(intensity), Some(Color::Rgb(color)))));
        assert_eq!(correction.tinted(&[[1.0, 1.0, 1.0]]), [[2.0, 1.0, 0.5]]);
        assert_eq!(correction.untinted().tinted(&[[1.0, 2.0, 3.0]]), [[1.0, 2.0, 3.0]]);
    }

    #[test]
    fn pick_names_its_frame_and_may_say_what_it_reflects() {
        let pick = parse("30:320,300.5").unwrap();
        assert_eq!((pick.view.frame, of_view(&pick.view), pick.reflectance), (30, "30:320,300.5".to_owned(), 0.8));
        assert_eq!(parse("30:320,300=0.3").unwrap().reflectance, 0.3);
        for wrong in ["", "320,300", "a:1,2", "3:1", "3:1,2,3", "-1:2,3", "3:1,2=", "3:1,2=0", "3:1,2=1.2", "3:1,2=x"] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }
}
