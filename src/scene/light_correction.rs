//! A correction of all light of a scene, by neutral surfaces of known reflectance.

use glam::Vec3;

use super::document::{Color, LightTable};

/// Uncertainty of the scale, ln: white surfaces reflect 0.7 to 0.9, and light estimated at a place
/// has an error of the same size (docs/light.md).
const SCALE_UNCERTAINTY_LN: f64 = 0.17;

/// A scale, and a tint with geometric mean 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightCorrection {
    pub scale: f64,
    pub tint: [f64; 3],
}

impl LightCorrection {
    /// The geometric mean of each surface's factors (red, green, blue), and the interval of the
    /// scale, which contains every surface's own.
    pub fn mean_of(factors: &[[f64; 3]]) -> (Self, [f64; 2]) {
        let count = factors.len().max(1) as f64;
        let ln = |factors: &[f64; 3]| factors.iter().map(|factor| factor.ln()).sum::<f64>() / 3.0;
        let mean = factors.iter().map(ln).sum::<f64>() / count;
        let off = factors.iter().map(|factors| (ln(factors) - mean).abs()).fold(SCALE_UNCERTAINTY_LN, f64::max);
        let tint = [0, 1, 2].map(|c| (factors.iter().map(|factors| factors[c].ln()).sum::<f64>() / count - mean).exp());
        (Self { scale: mean.exp(), tint }, [mean - off, mean + off].map(f64::exp))
    }

    /// Multiplies the light of a scene file: the scale goes into intensities, the tint into
    /// colours.
    pub fn apply(&self, light: &mut LightTable) {
        let scaled = |intensity: Option<f64>| Some(rounded(intensity.unwrap_or(1.0) * self.scale));
        let tinted = |color: Option<Color>, scale: f64| {
            let color = color.map_or([1.0; 3], |color| Vec3::from(color).to_array().map(f64::from));
            Some(Color::Rgb([0, 1, 2].map(|c| rounded(scale * color[c] * self.tint[c]))))
        };
        if light.environment.is_some() {
            light.environment_intensity = scaled(light.environment_intensity);
            light.environment_color = tinted(light.environment_color, 1.0);
        }
        if light.ambient.is_some() {
            light.ambient = tinted(light.ambient, self.scale);
        }
        for sun in &mut light.sun {
            (sun.intensity, sun.color) = (scaled(sun.intensity), tinted(sun.color, 1.0));
        }
        for lamp in &mut light.lamp {
            (lamp.intensity, lamp.color) = (scaled(lamp.intensity), tinted(lamp.color, 1.0));
        }
    }
}

/// Rounded to four significant digits.
fn rounded(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::document::{LampTable, SunTable};

    #[test]
    fn correction_by_several_surfaces_is_their_geometric_mean_within_their_spread() {
        let (correction, [low, high]) = LightCorrection::mean_of(&[[1.2; 3]]);
        assert!(
            (correction.scale - 1.2).abs() < 1e-12 && (high / 1.2 - SCALE_UNCERTAINTY_LN.exp()).abs() < 1e-9,
            "{low} {high}"
        );
        // √(0.8 · 1.8) = 1.2, and from 0.8 to 1.8.
        let (correction, [low, high]) = LightCorrection::mean_of(&[[0.8; 3], [1.8; 3]]);
        assert!((correction.scale - 1.2).abs() < 1e-9 && (low - 0.8).abs() < 1e-9 && (high - 1.8).abs() < 1e-9);
        // Red 2·8 and 1: of 2, 1 and 0.5 the scale is 1.
        let (LightCorrection { scale, tint }, _) = LightCorrection::mean_of(&[[4.0, 1.0, 0.25], [1.0; 3]]);
        assert!((scale - 1.0).abs() < 1e-9 && (tint[0] - 2.0).abs() < 1e-9 && (tint[2] - 0.5).abs() < 1e-9, "{tint:?}");
    }

    #[test]
    fn correction_multiplies_intensities_and_tints_colours() {
        let lamp = LampTable { at_m: [0.0; 3], color: None, intensity: None, diameter_m: None };
        let coloured = LampTable { color: Some(Color::Rgb([2.0, 1.0, 1.0])), intensity: Some(2.0), ..lamp.clone() };
        let sun =
            SunTable { towards: [0.0, 0.0, 1.0], color: Some(Color::Grey(0.5)), intensity: None, diameter_deg: None };
        let mut light = LightTable {
            environment: Some("a.hdr".to_owned()),
            environment_intensity: Some(0.5),
            sun: vec![sun],
            lamp: vec![lamp, coloured],
            ..LightTable::default()
        };
        let correction = LightCorrection { scale: 1.1, tint: [2.0, 1.0, 0.5] };
        correction.apply(&mut light);
        assert_eq!(light.environment_intensity, Some(0.55));
        assert_eq!((light.environment_color, light.ambient), (Some(Color::Rgb([2.0, 1.0, 0.5])), None));
        assert_eq!((light.sun[0].intensity, light.sun[0].color), (Some(1.1), Some(Color::Rgb([1.0, 0.5, 0.25]))));
        let lamps: Vec<_> = light.lamp.iter().map(|lamp| (lamp.intensity, lamp.color)).collect();
        let expected = [(1.1, [2.0, 1.0, 0.5]), (2.2, [4.0, 1.0, 0.5])];
        assert_eq!(lamps, expected.map(|(intensity, color)| (Some(intensity), Some(Color::Rgb(color)))));
        // A panorama in cd/m² has a small factor.
        let mut bright = LightTable { environment_intensity: Some(0.00004), ..light.clone() };
        LightCorrection { scale: 1.2, tint: [1.0; 3] }.apply(&mut bright);
        assert_eq!(bright.environment_intensity, Some(0.000048));
        // Uniform light has no intensity of its own.
        let mut even = LightTable { ambient: Some(Color::Grey(0.5)), ..LightTable::default() };
        correction.apply(&mut even);
        assert_eq!((even.ambient, even.environment_intensity), (Some(Color::Rgb([1.1, 0.55, 0.275])), None));
    }
}
