//! The room's light as an analysis keeps it: numbers in `analysis.toml`, the panorama as a Radiance file.

use std::path::Path;
use std::sync::Arc;

use glam::{DVec3, Vec3};
use image::codecs::hdr::HdrEncoder;
use serde::{Deserialize, Serialize};

use super::light::{FoundLamp, HEIGHT, RoomLight, WIDTH};
use crate::scene::{self, EnvironmentMap, Lighting, PointLight, upright};
use crate::words::fixed;

/// How wide a lamp is taken to be that nobody saw, m: between a bulb in its shade and a panel in the ceiling.
pub const FOUND_LAMP_M: f64 = 0.25;

/// `[light]`. Linear light, red, green and blue: 1 is white matt that shows as the camera's white.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FoundLight {
    /// Why nothing is known.
    pub why: Option<String>,
    /// The place around which environment.hdr is, and what was taken for up.
    pub middle_m: Option<[f64; 3]>,
    pub up: Option<[f64; 3]>,
    /// The recording does not say where up is: it is what cameras had above them.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub guessed_up: bool,
    /// The share of all directions, and of those above the horizon, of which anything was seen.
    pub seen: Option<f64>,
    pub seen_above: Option<f64>,
    /// What white matt that looks up shows there: the irradiance from above by π, and factors between which it lies.
    pub upward: Option<[f64; 3]>,
    pub between: Option<[f64; 2]>,
    /// Of what no lamp leaves unexplained, the share that lamps explain.
    pub explained: Option<f64>,
    /// Of what no lamp leaves unexplained in one half of the frames, the share that the other half's lamp explains; the lesser.
    pub halves_explain: Option<f64>,
    /// How far apart the two halves see the lamp.
    pub halves_deg: Option<f64>,
    /// Why no lamp is claimed.
    pub no_lamp: Option<String>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lamps: Vec<FoundLamp>,
}

/// Numbers that people read have so many digits.
fn short<const N: usize>(values: [f64; N]) -> [f64; N] {
    values.map(|value| format!("{value:.4}").parse().unwrap_or(value))
}

impl FoundLight {
    pub fn of(found: &Result<RoomLight, String>) -> Self {
        let light = found.as_ref().ok();
        let [seen, seen_above] = [|l: &RoomLight| l.seen_share, |l: &RoomLight| l.seen_above_share]
            .map(|of| light.map(|l| short([of(l)])[0]));
        let lamp = |lamp: &FoundLamp| FoundLamp { at_m: short(lamp.at_m), shown_at_1_m: short(lamp.shown_at_1_m) };
        Self {
            why: found.as_ref().err().cloned(),
            middle_m: light.map(|light| short(light.middle_m)),
            up: light.map(|light| light.up),
            guessed_up: light.is_some_and(|light| light.is_up_guessed),
            seen,
            seen_above,
            upward: light.map(|light| short(light.upward)),
            between: light.map(|light| short(light.between)),
            explained: light.map(|light| short([light.explained])[0]),
            halves_explain: light.and_then(|light| light.halves_explain).map(|share| short([share])[0]),
            halves_deg: light.and_then(|light| light.halves_deg).map(|deg| short([deg])[0]),
            no_lamp: light.and_then(|light| light.no_lamp.clone()),
            lamps: light.map_or(Vec::new(), |light| light.lamps.iter().map(lamp).collect()),
        }
    }

    /// With its panorama. `None` where nothing is known, or nothing that makes sense.
    pub fn lighting(&self, around: &Environment) -> Option<Lighting> {
        let up = DVec3::from(self.up?).try_normalize()?;
        let map_from_world = upright(up).conjugate().as_quat().normalize();
        let point = |lamp: &FoundLamp| PointLight {
            position_in_world_m: lamp.at_m.into(),
            color: Vec3::from_array(lamp.shown_at_1_m.map(|v| v.max(0.0) as f32)),
            diameter_m: FOUND_LAMP_M as f32,
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
                intensity: 1.0,
            }),
        })
    }

    /// A line for each, with the name of what it is about.
    pub fn lines(&self) -> Vec<(&'static str, String)> {
        let (Some(upward), Some([low, high])) = (self.upward, self.between) else {
            let why = self.why.as_deref().unwrap_or("nothing can be said");
            return vec![("light", format!("unknown: {why}"))];
        };
        let all = |values: [f64; 3]| values.map(|v| fixed(v, 2)).join(", ");
        let percent = |share: Option<f64>| fixed(100.0 * share.unwrap_or_default(), 0);
        let mut lines = vec![(
            "light",
            format!(
                "white matt that looks up shows {} (times {} to {}); {} % of all directions seen, {} % of those above{}",
                all(upward),
                fixed(low, 2),
                fixed(high, 2),
                percent(self.seen),
                percent(self.seen_above),
                if self.guessed_up { "; up is what the cameras had above them" } else { "" }
            ),
        )];
        let halves = self.halves_deg.zip(self.halves_explain).map_or(String::new(), |(deg, share)| {
            format!(
                "; halves of the frames {}° apart, each explains {} % of the other or more",
                fixed(deg, 1),
                percent(Some(share))
            )
        });
        for lamp in &self.lamps {
            let (at, shown) = (all(lamp.at_m), all(lamp.shown_at_1_m));
            lines.push(("lamp", format!("at {at} m, shows {shown} at 1 m{halves}")));
        }
        lines.extend(self.no_lamp.iter().map(|why| ("lamp", format!("none claimed: {why}"))));
        lines
    }
}

/// A panorama as its file has it, which keeps eight bits of each number.
#[derive(Clone, Debug, PartialEq)]
pub struct Environment {
    pub width: u32,
    pub height: u32,
    pub rgb: Arc<Vec<[f32; 3]>>,
    /// The file.
    pub hdr: Arc<[u8]>,
}

impl Environment {
    pub fn of(rgb: &[[f32; 3]]) -> Option<Self> {
        let pixels: Vec<_> = rgb.iter().map(|light| image::Rgb(*light)).collect();
        let mut hdr = Vec::new();
        HdrEncoder::new(&mut hdr).encode(&pixels, WIDTH, HEIGHT).ok()?;
        let (width, height, rgb) = scene::panorama_of(&hdr).ok()?;
        Some(Self { width, height, rgb: Arc::new(rgb), hdr: hdr.into() })
    }

    pub fn read(file: &Path) -> Result<Self, String> {
        /// Larger is none of ours, bytes.
        const MOST: u64 = 1 << 22;
        let hdr = crate::source::file::read(file, MOST).map_err(|error| crate::words::reason(&error))?;
        let (width, height, rgb) = scene::panorama_of(&hdr)?;
        Ok(Self { width, height, rgb: Arc::new(rgb), hdr: hdr.into() })
    }
}
