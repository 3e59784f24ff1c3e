//! Correction of the light by neutral surfaces of known reflectance that the user points at.

use anyhow::{Result, anyhow};
use glam::Vec3;

use crate::cli::pick::{of_view, triple, view};
use locard_engine::analyse::WHITE_REFLECTANCE;
use locard_engine::scene::{LightCorrection, Lighting};
use locard_engine::shot::{ReferencePick, Shot, WhiteReference};
use locard_engine::text::{fixed, number};

/// Accepted reflectances of matt surfaces: black cloth has 0.03, fresh snow 0.9.
const REFLECTANCE_RANGE: [f64; 2] = [0.02, 0.95];

/// Parses `FRAME:X,Y` or `FRAME:X,Y=REFLECTANCE`.
pub fn parse(text: &str) -> Result<ReferencePick, String> {
    let (at, reflectance) = match text.split_once('=') {
        None => (text, WHITE_REFLECTANCE),
        Some((at, reflectance)) => {
            let is_accepted = |value: &f64| (REFLECTANCE_RANGE[0]..=REFLECTANCE_RANGE[1]).contains(value);
            let [min, max] = REFLECTANCE_RANGE;
            let value = reflectance.trim().parse().ok().filter(is_accepted);
            (at, value.ok_or_else(|| format!("{text}: expected a reflectance of {min} to {max}"))?)
        }
    };
    let view = view(at, "FRAME:X,Y, as in 30:320,300, or with its reflectance, as in 30:320,300=0.3")?;
    Ok(ReferencePick { view, reflectance })
}

/// The correction from the picks, and lines about it. The factors of several picks are averaged
/// geometrically. `upward`: radiance of a white surface that faces up; `between`: range of factors
/// that the footage allows.
pub fn correction(
    shot: &Shot,
    picks: &[ReferencePick],
    lighting: &Lighting,
    (upward, between): (Vec3, Option<[f64; 2]>),
) -> Result<(LightCorrection, Vec<(&'static str, String)>)> {
    let whites =
        shot.white_references(picks, lighting).map_err(|(n, error)| anyhow!(error).context(named(&picks[n])))?;
    let mut lines: Vec<_> = picks.iter().zip(&whites).map(|(pick, white)| ("white", about(pick, white))).collect();
    let factors: Vec<[f64; 3]> = whites.iter().map(|white| white.factors).collect();
    let (correction, [low, high]) = LightCorrection::mean_of(&factors);
    let LightCorrection { scale, tint } = correction;
    let times = |by: f64| fixed(by, 2);
    let colours = tint.map(times).join(", ");
    lines.push((
        "factor",
        format!("{} on all light, between {} and {}; by colour {colours}", times(scale), times(low), times(high)),
    ));
    let upward = upward.to_array();
    let upward = [0, 1, 2].map(|c| fixed(scale * tint[c] * f64::from(upward[c]), 2)).join(", ");
    lines.push(("light", format!("upward-facing matt white shows {upward} now")));
    if let Some([min, max]) = between.filter(|[min, max]| high < *min || low > *max) {
        let message = format!("{} to {}", times(min), times(max));
        lines.push(("odd", format!("the footage implies {message}: is it neutral, matt, and in the estimated light?")));
    }
    Ok((correction, lines))
}

fn named(pick: &ReferencePick) -> String {
    format!("--white {}", of_view(&pick.view))
}

fn about(pick: &ReferencePick, white: &WhiteReference) -> String {
    let colours = |light: [f64; 3]| light.map(|v| fixed(v, 2)).join(", ");
    let expected = white.comes.light().to_array().map(|v| pick.reflectance * f64::from(v));
    let hidden = white
        .comes
        .lamps
        .iter()
        .enumerate()
        .filter(|(_, (by, visibility))| *visibility == 0.0 && by.max_element() > 0.0);
    let hidden: Vec<String> = hidden.map(|(n, _)| format!("lamp {}", n + 1)).collect();
    let hidden =
        if hidden.is_empty() { String::new() } else { format!("; {} is hidden from there", hidden.join(", ")) };
    format!(
        "{} at {} m with reflectance {} shows {}; estimated were {}: times {}{hidden}",
        of_view(&pick.view),
        triple(white.point_m),
        number(pick.reflectance),
        colours(white.shown),
        colours(expected),
        colours(white.factors)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pick_parses_frame_and_optional_reflectance() {
        let pick = parse("30:320,300.5").unwrap();
        assert_eq!((pick.view.frame, of_view(&pick.view), pick.reflectance), (30, "30:320,300.5".to_owned(), 0.8));
        assert_eq!(parse("30:320,300=0.3").unwrap().reflectance, 0.3);
        for wrong in ["", "320,300", "a:1,2", "3:1", "3:1,2,3", "-1:2,3", "3:1,2=", "3:1,2=0", "3:1,2=1.2", "3:1,2=x"] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }
}
