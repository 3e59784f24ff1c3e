//! The light of a room, as it was found.

use serde::{Deserialize, Serialize};

/// Assumed diameter of an unseen lamp, m: between a shaded bulb and a ceiling panel.
pub const ASSUMED_LAMP_DIAMETER_M: f64 = 0.25;

/// A lamp, as if it shone evenly into all directions: as bright at the place as it is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LampEstimate {
    /// World axes, m.
    pub at_m: [f64; 3],
    /// What a white matt surface that faces it shows at 1 m, linear: red, green, blue.
    pub shown_at_1_m: [f64; 3],
    /// Diameter, m; larger than [`ASSUMED_LAMP_DIAMETER_M`] for bounce light.
    #[serde(default = "lamp_m")]
    pub diameter_m: f64,
}

fn lamp_m() -> f64 {
    ASSUMED_LAMP_DIAMETER_M
}

impl LampEstimate {
    /// Whether it is the bounce light of a lamp at the same place.
    pub fn is_bounce(&self) -> bool {
        self.diameter_m > ASSUMED_LAMP_DIAMETER_M
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RoomLight {
    /// Where the white level is known: on the largest support.
    pub place_m: [f64; 3],
    /// The panorama's centre, in free space over it.
    pub middle_m: [f64; 3],
    pub up: [f64; 3],
    /// Whether up was estimated: the cameras' own up, refined by level surfaces.
    pub is_up_guessed: bool,
    /// Of all directions, and of those above the horizon.
    pub seen_share: f64,
    pub seen_above_share: f64,
    /// Row by row, without the lamps.
    pub panorama: Vec<[f32; 3]>,
    /// Why it is even light instead of what was seen.
    pub no_panorama: Option<String>,
    pub lamps: Vec<LampEstimate>,
    /// What white matt that looks up shows at the place, and factors between which it lies.
    pub white_level: [f64; 3],
    pub between: [f64; 2],
    /// Why that is not claimed.
    pub unclaimed: Option<String>,
    /// By how much the lamps lower what is left unexplained, as a share of it.
    pub explained: f64,
    /// Of what no lamp leaves unexplained in one half of the frames, the share that the other
    /// half's lamp explains; the lesser.
    pub halves_explain: Option<f64>,
    /// How far apart the two halves see the lamp, degrees.
    pub halves_deg: Option<f64>,
    /// Why no lamp is claimed.
    pub no_lamp: Option<String>,
}
