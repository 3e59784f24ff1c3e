//! The room's light in an analysis: numbers in `analysis.toml`, the panorama as a Radiance file.

use std::path::Path;
use std::sync::Arc;

use glam::{DVec3, Vec3};
use image::codecs::hdr::HdrEncoder;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::inputs::hex;
use super::light::{HEIGHT, LampEstimate, RoomLight, WIDTH};
use crate::scene::{self, EnvironmentMap, Lighting, PointLight, world_from_panorama};
use crate::text::fixed;

/// `[light]`. Linear light, red, green and blue: 1 is the light of matt white at the camera's
/// white.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LightFindings {
    /// Whether the white level is claimed. Otherwise it follows from the camera's exposure alone,
    /// and the light is even.
    #[serde(default)]
    pub claimed: bool,
    /// The reason for which it is not claimed, or for which the light is unknown.
    pub why: Option<String>,
    /// The place of the white level, the centre of environment.hdr in free space over it, and
    /// the direction of up.
    pub place_m: Option<[f64; 3]>,
    pub middle_m: Option<[f64; 3]>,
    pub up: Option<[f64; 3]>,
    /// Whether up was estimated: the cameras' own up, refined by level surfaces.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub guessed_up: bool,
    /// Fractions of all directions, and of those above the horizon, that were seen.
    #[serde(alias = "seen")]
    pub coverage: Option<f64>,
    #[serde(alias = "seen_above")]
    pub coverage_above: Option<f64>,
    /// Light of upward-facing matt white at the place, that is the irradiance from above by π, and
    /// its interval as factors.
    pub white_level: Option<[f64; 3]>,
    pub between: Option<[f64; 2]>,
    /// Relative reduction of the residual without lamps by the lamps.
    pub explained: Option<f64>,
    /// Relative reduction of the residual without lamps in one half of the frames by the other
    /// half's lamp; the smaller of the two.
    pub halves_explain: Option<f64>,
    /// Angle between the lamps of the two halves.
    pub halves_deg: Option<f64>,
    /// The reason for which no lamp is claimed.
    pub no_lamp: Option<String>,
    /// The reason for which environment.hdr is even light.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub no_panorama: Option<String>,
    /// SHA-256 of environment.hdr, hexadecimal.
    pub panorama: Option<String>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lamps: Vec<LampEstimate>,
}

/// Largest accepted coordinate of a lamp, m, and largest light at 1 m. The sun through a window has
/// about 10⁴.
const MAX_COORDINATE_M: f64 = 1e4;
const MAX_SHOWN: f64 = 1e6;
/// Largest accepted lamp diameter, m.
const MAX_DIAMETER_M: f64 = 100.0;

/// Rounds to four decimals, for readability.
fn short<const N: usize>(values: [f64; N]) -> [f64; N] {
    values.map(|value| format!("{value:.4}").parse().unwrap_or(value))
}

impl LightFindings {
    pub fn of(result: &Result<RoomLight, String>, around: Option<&EnvironmentFit>) -> Self {
        let light = result.as_ref().ok();
        let [coverage, coverage_above] =
            [|l: &RoomLight| l.coverage, |l: &RoomLight| l.coverage_above].map(|of| light.map(|l| short([of(l)])[0]));
        let lamp = |lamp: &LampEstimate| LampEstimate {
            at_m: short(lamp.at_m),
            shown_at_1_m: short(lamp.shown_at_1_m),
            diameter_m: lamp.diameter_m,
        };
        Self {
            claimed: light.is_some_and(|light| light.unclaimed.is_none()),
            why: result.as_ref().map_or_else(|why| Some(why.clone()), |light| light.unclaimed.clone()),
            place_m: light.map(|light| short(light.place_m)),
            middle_m: light.map(|light| short(light.middle_m)),
            up: light.map(|light| light.up),
            guessed_up: light.is_some_and(|light| light.is_up_guessed),
            coverage,
            coverage_above,
            white_level: light.map(|light| short(light.white_level)),
            between: light.map(|light| short(light.between)),
            explained: light.map(|light| short([light.explained])[0]),
            halves_explain: light.and_then(|light| light.halves_explain).map(|share| short([share])[0]),
            halves_deg: light.and_then(|light| light.halves_deg).map(|deg| short([deg])[0]),
            no_lamp: light.and_then(|light| light.no_lamp.clone()),
            no_panorama: light.and_then(|light| light.no_panorama.clone()),
            panorama: around.map(EnvironmentFit::fingerprint),
            lamps: light.map_or(Vec::new(), |light| light.lamps.iter().map(lamp).collect()),
        }
    }

    /// Checks that positions, brightness and diameters of lamps are plausible.
    pub fn check(&self) -> Result<(), String> {
        for (n, lamp) in self.lamps.iter().enumerate() {
            let is_near = lamp.at_m.iter().all(|v| v.abs() <= MAX_COORDINATE_M);
            let is_bright = lamp.shown_at_1_m.iter().all(|v| (0.0..=MAX_SHOWN).contains(v));
            if !(is_near && is_bright && (0.0..=MAX_DIAMETER_M).contains(&lamp.diameter_m)) {
                return Err(format!(
                    "light.lamps, lamp {}: at_m from -{MAX_COORDINATE_M} to {MAX_COORDINATE_M}, shown_at_1_m from 0 to {MAX_SHOWN} and \
                     diameter_m from 0 to {MAX_DIAMETER_M} are expected",
                    n + 1
                ));
            }
        }
        Ok(())
    }

    /// The lighting of a scene with the panorama; `None` without a valid up.
    pub fn lighting(&self, around: &EnvironmentFit) -> Option<Lighting> {
        let up = DVec3::from(self.up?).try_normalize()?;
        let map_from_world = world_from_panorama(up).conjugate().as_quat().normalize();
        let point = |lamp: &LampEstimate| PointLight {
            position_in_world_m: lamp.at_m.into(),
            color: Vec3::from_array(lamp.shown_at_1_m.map(|v| v.max(0.0) as f32)),
            diameter_m: lamp.diameter_m as f32,
            range_m: f32::INFINITY,
            spot: None,
        };
        Some(Lighting {
            suns: Vec::new(),
            points: self.lamps.iter().map(point).collect(),
            environment: scene::Environment::Map(EnvironmentMap {
                width: around.width,
                height: around.height,
                rgb: Arc::clone(&around.rgb),
                map_from_world,
                color: Vec3::ONE,
            }),
        })
    }

    /// One line per estimate, with its name.
    pub fn lines(&self) -> Vec<(&'static str, String)> {
        let (Some(white), Some([low, high])) = (self.white_level, self.between) else {
            let why = self.why.as_deref().unwrap_or("no reason was recorded");
            return vec![("light", format!("unknown: {why}"))];
        };
        let all = |values: [f64; 3]| values.map(|v| fixed(v, 2)).join(", ");
        let percent = |share: Option<f64>| fixed(100.0 * share.unwrap_or_default(), 0);
        let shows =
            format!("upward-facing matt white shows {} (times {} to {})", all(white), fixed(low, 2), fixed(high, 2));
        let about_up = if self.guessed_up { "; up follows from level surfaces" } else { "" };
        let light = match (self.claimed, &self.why) {
            (false, Some(why)) => format!(
                "not claimed: {why}; by the camera's exposure alone {shows}: point at white paper \
                 (`locard light --white FRAME:X,Y`){about_up}"
            ),
            _ => format!(
                "{shows}; {} % of all directions seen, {} % of those above{about_up}",
                percent(self.coverage),
                percent(self.coverage_above)
            ),
        };
        let mut lines = vec![("light", light)];
        lines.extend(
            self.no_panorama.iter().map(|why| ("panorama", format!("even light instead of the observed light: {why}"))),
        );
        let halves = self.halves_deg.zip(self.halves_explain).map_or(String::new(), |(deg, share)| {
            format!(
                "; halves of the frames {}° apart, each explains {} % of the other or more",
                fixed(deg, 1),
                percent(Some(share))
            )
        });
        for lamp in &self.lamps {
            let (at, shown) = (all(lamp.at_m), all(lamp.shown_at_1_m));
            lines.push(if lamp.is_bounce() {
                ("bounce", format!("of the lamp at {at} m, {} m wide, shows {shown} at 1 m", lamp.diameter_m))
            } else {
                ("lamp", format!("at {at} m, shows {shown} at 1 m{halves}"))
            });
        }
        lines.extend(self.no_lamp.iter().map(|why| ("lamp", format!("none claimed: {why}"))));
        lines
    }
}

/// A panorama with the precision of its file: eight bits per value and a common exponent.
#[derive(Clone, Debug, PartialEq)]
pub struct EnvironmentFit {
    pub width: u32,
    pub height: u32,
    pub rgb: Arc<Vec<[f32; 3]>>,
    /// The file.
    pub hdr: Arc<[u8]>,
}

impl EnvironmentFit {
    pub fn of(rgb: &[[f32; 3]]) -> Option<Self> {
        let pixels: Vec<_> = rgb.iter().map(|light| image::Rgb(*light)).collect();
        let mut hdr = Vec::new();
        HdrEncoder::new(&mut hdr).encode(&pixels, WIDTH, HEIGHT).ok()?;
        let (width, height, rgb) = scene::decode_panorama(&hdr).ok()?;
        Some(Self { width, height, rgb: Arc::new(rgb), hdr: hdr.into() })
    }

    /// SHA-256 of its file, hexadecimal.
    fn fingerprint(&self) -> String {
        hex(&Sha256::digest(&self.hdr))
    }

    /// Reads a file and checks its fingerprint.
    pub fn read(file: &Path, fingerprint: &str) -> Result<Self, String> {
        /// Largest accepted file, bytes.
        const MAX_FILE_BYTES: u64 = 1 << 22;
        let hdr = crate::source::file::read(file, MAX_FILE_BYTES).map_err(|error| crate::text::reason(&error))?;
        let (width, height, rgb) = scene::decode_panorama(&hdr)?;
        let read = Self { width, height, rgb: Arc::new(rgb), hdr: hdr.into() };
        if fingerprint != read.fingerprint() {
            return Err("it is not the panorama that was found: analyse the recording again, or give a scene its own \
                        (`locard light`)"
                .to_owned());
        }
        Ok(read)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panorama_with_another_fingerprint_is_refused() {
        let rgb = vec![[0.5f32; 3]; WIDTH * HEIGHT];
        let environment = EnvironmentFit::of(&rgb).unwrap();
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), &environment.hdr).unwrap();
        assert_eq!(EnvironmentFit::read(file.path(), &environment.fingerprint()), Ok(environment));
        let other = EnvironmentFit::of(&vec![[0.25f32; 3]; rgb.len()]).unwrap();
        let problem = EnvironmentFit::read(file.path(), &other.fingerprint()).unwrap_err();
        assert!(problem.contains("it is not the panorama that was found"), "{problem}");
    }

    #[test]
    fn implausible_lamps_are_refused() {
        let checked = |at_m: [f64; 3], shown: f64| {
            let lamps = vec![LampEstimate { at_m, shown_at_1_m: [1.0, shown, 1.0], diameter_m: 0.25 }];
            LightFindings { lamps, ..LightFindings::of(&Err("nothing".to_owned()), None) }.check()
        };
        assert!(checked([0.3, -2.0, 2.4], 5.0).is_ok() && checked([1e4, 0.0, 0.0], 0.0).is_ok());
        for (at_m, shown) in [([0.0, 1e300, 0.0], 1.0), ([0.0; 3], 1e300), ([0.0; 3], -0.1), ([f64::NAN; 3], 1.0)] {
            let problem = checked(at_m, shown).unwrap_err();
            assert!(problem.starts_with("light.lamps, lamp 1: at_m from -10000 to 10000"), "{problem}");
        }
    }
}
