//! The estimated light of a room.

use serde::{Deserialize, Serialize};

/// Assumed diameter of an unseen lamp, m: between a shaded bulb and a ceiling panel.
pub const ASSUMED_LAMP_DIAMETER_M: f64 = 0.25;

/// An isotropic lamp that is as bright at the place as the estimated one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LampEstimate {
    /// World axes, m.
    pub at_m: [f64; 3],
    /// Light of a white matt surface that faces the lamp at 1 m, linear: red, green, blue.
    pub shown_at_1_m: [f64; 3],
    /// Diameter, m; larger than [`ASSUMED_LAMP_DIAMETER_M`] for bounce light.
    #[serde(default = "lamp_m")]
    pub diameter_m: f64,
}

fn lamp_m() -> f64 {
    ASSUMED_LAMP_DIAMETER_M
}

impl LampEstimate {
    /// True if this is the bounce light of a lamp at the same place.
    pub fn is_bounce(&self) -> bool {
        self.diameter_m > ASSUMED_LAMP_DIAMETER_M
    }
}

/// White level, panorama and lamps of a room, in the axes of its recording, m.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RoomLight {
    /// The place of the white level, on the largest support.
    pub place_m: [f64; 3],
    /// The panorama's centre, in free space over it.
    pub middle_m: [f64; 3],
    pub up: [f64; 3],
    /// Whether up was estimated: the cameras' own up, refined by level surfaces.
    pub is_up_guessed: bool,
    /// Fraction of all directions that was seen, and of those above the horizon.
    pub coverage: f64,
    pub coverage_above: f64,
    /// Row by row, without the lamps.
    pub panorama: Vec<[f32; 3]>,
    /// The reason for which the panorama is even light.
    pub no_panorama: Option<String>,
    pub lamps: Vec<LampEstimate>,
    /// Light of upward-facing matt white at the place, and its interval as factors.
    pub white_level: [f64; 3],
    pub between: [f64; 2],
    /// The reason for which the white level is not claimed.
    pub unclaimed: Option<String>,
    /// Relative reduction of the residual without lamps by the lamps.
    pub explained: f64,
    /// Relative reduction of the residual without lamps in one half of the frames by the other
    /// half's lamp; the smaller of the two.
    pub halves_explain: Option<f64>,
    /// Angle between the lamps of the two halves, degrees.
    pub halves_deg: Option<f64>,
    /// The reason for which no lamp is claimed.
    pub no_lamp: Option<String>,
}
