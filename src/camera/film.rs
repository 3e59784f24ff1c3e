//! Film and sensor formats, and lens types by their angle of view.

use std::fmt;
use std::str::FromStr;

/// The light-sensitive rectangle behind the lens: width and height in millimetres, 0.1 to 1000.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Film {
    width_mm: f64,
    height_mm: f64,
}

/// Names and manufacturers' sizes (mm). The first name is used for output.
const NAMED: [(&[&str], f64, f64); 7] = [
    (&["36x24", "full-frame", "35mm", "fx"], 36.0, 24.0),
    (&["aps-c", "aps-c-nikon", "nikon-dx", "dx"], 23.6, 15.7),
    (&["aps-c-canon", "canon-aps-c"], 22.3, 14.9),
    (&["micro-4/3", "micro-four-thirds", "mft", "m43", "4/3"], 17.3, 13.0),
    (&["1in", "1inch", "1\"", "1-inch"], 13.2, 8.8),
    (&["1/2.3in", "1/2.3\"", "1/2.3", "1/2.3-inch"], 6.17, 4.55),
    // Six centimetres is the width of the roll; the picture on it has 56 mm.
    (&["6x6", "medium-format"], 56.0, 56.0),
];

const SIDE_MM: std::ops::RangeInclusive<f64> = 0.1..=1000.0;

/// Error of an unknown film name.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "{actual} is not a film format; expected 36x24, aps-c (Nikon), aps-c-canon, micro-4/3, 1in, 1/2.3in, 6x6 (56x56 \
     mm) or any WIDTHxHEIGHT in mm, 0.1 to 1000 each"
)]
pub struct FilmError {
    pub actual: String,
}

impl Film {
    /// The 35 mm film that focal lengths are compared on, 36×24 mm.
    pub const FULL_FRAME: Self = Self { width_mm: 36.0, height_mm: 24.0 };

    /// A format of any size in millimetres. Fails outside 0.1 to 1000.
    pub fn new(width_mm: f64, height_mm: f64) -> Result<Self, FilmError> {
        let film = Self { width_mm, height_mm };
        let fits = SIDE_MM.contains(&width_mm) && SIDE_MM.contains(&height_mm);
        fits.then_some(film).ok_or_else(|| FilmError { actual: film.size() })
    }

    pub fn width_mm(&self) -> f64 {
        self.width_mm
    }

    pub fn height_mm(&self) -> f64 {
        self.height_mm
    }

    /// Corner to corner, millimetres: i_d of vSLRcam (1).
    pub fn diagonal_mm(&self) -> f64 {
        self.width_mm.hypot(self.height_mm)
    }

    /// Ratio of the diagonal of 36×24 mm to this one: 1.53 for Nikon's APS-C.
    pub fn crop_factor(&self) -> f64 {
        Self::FULL_FRAME.diagonal_mm() / self.diagonal_mm()
    }

    /// The focal length with the same diagonal angle of view on 36×24 mm, millimetres.
    pub fn equivalent_35mm(&self, focal_length_mm: f64) -> f64 {
        focal_length_mm * self.crop_factor()
    }

    /// The film in portrait orientation if `height > width`, otherwise in landscape.
    pub fn turned_for(&self, width_px: u32, height_px: u32) -> Self {
        let (long, short) = (self.width_mm.max(self.height_mm), self.width_mm.min(self.height_mm));
        let (width_mm, height_mm) = if height_px > width_px { (short, long) } else { (long, short) };
        Self { width_mm, height_mm }
    }

    fn size(&self) -> String {
        format!("{}x{}", self.width_mm, self.height_mm)
    }
}

impl fmt::Display for Film {
    /// The name if there is one, otherwise `WIDTHxHEIGHT`. Parsing it gives the same film.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let named = NAMED.iter().find(|(_, w, h)| (*w, *h) == (self.width_mm, self.height_mm));
        match named.and_then(|(names, ..)| names.first()) {
            Some(name) => f.write_str(name),
            None => f.write_str(&self.size()),
        }
    }
}

impl FromStr for Film {
    type Err = FilmError;

    fn from_str(text: &str) -> Result<Self, FilmError> {
        let refuse = || FilmError { actual: text.to_owned() };
        let plain = text.trim().to_ascii_lowercase().replace('×', "x");
        if let Some((_, width_mm, height_mm)) = NAMED.iter().find(|(names, ..)| names.contains(&plain.as_str())) {
            return Ok(Self { width_mm: *width_mm, height_mm: *height_mm });
        }
        let (width, height) = plain.trim_end_matches("mm").split_once('x').ok_or_else(refuse)?;
        let side = |t: &str| t.trim().parse().map_err(|_| refuse());
        Self::new(side(width)?, side(height)?).map_err(|_| refuse())
    }
}

crate::choices! {
    /// The four types of lens (vSLRcam, section 2.1).
    pub enum LensType {
        /// More than 60° on the diagonal: shorter than 37 mm on 36×24.
        Wide = "wide",
        /// 40° to 60°, close to a person's field of attention.
        Normal = "normal",
        /// Less than 40°: longer than 59 mm on 36×24.
        Tele = "tele",
        /// Variable focal length.
        Zoom = "zoom",
    }
}

impl LensType {
    /// The type of a lens with these shortest and longest focal lengths on a film, by the diagonal
    /// angle of view at infinity. The limits of 40° and 60° are customary, not a standard.
    pub fn of(shortest_mm: f64, longest_mm: f64, film: &Film) -> Self {
        if longest_mm > shortest_mm {
            return Self::Zoom;
        }
        match (2.0 * (0.5 * film.diagonal_mm() / shortest_mm).atan()).to_degrees() {
            angle if angle > 60.0 => Self::Wide,
            angle if angle >= 40.0 => Self::Normal,
            _ => Self::Tele,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn film_names_round_trip() {
        for (names, w, h) in NAMED {
            for name in names {
                let film: Film = name.parse().unwrap();
                assert_eq!((film.width_mm(), film.height_mm()), (w, h), "{name}");
                assert_eq!(film.to_string(), names[0]);
            }
        }
        assert_eq!("23.5 × 15.6 mm".parse::<Film>().unwrap(), Film::new(23.5, 15.6).unwrap());
        assert_eq!("23.5x15.6".parse::<Film>().unwrap().to_string(), "23.5x15.6");
        assert_eq!("24x36".parse::<Film>().unwrap().to_string(), "24x36");
    }

    #[test]
    fn unknown_film_is_refused_with_the_accepted_names() {
        for text in ["", "x", "36", "36x", "36x0", "-36x24", "nanxnan", "infx24", "36x24x3", "aps", "2000x10"] {
            let error = text.parse::<Film>().unwrap_err().to_string();
            assert!(error.starts_with(text) && error.contains("aps-c-canon"), "{error}");
        }
        assert!(Film::new(0.0, 24.0).is_err());
    }

    #[test]
    fn diagonal_crop_factor_and_equivalent_worked_by_hand() {
        assert!((Film::FULL_FRAME.diagonal_mm() - 43.266_615).abs() < 1e-6);
        // 23.6² + 15.7² = 803.45, its root 28.3452; 43.2666 / 28.3452 = 1.52642
        let dx: Film = "aps-c".parse().unwrap();
        assert!((dx.crop_factor() - 1.526_42).abs() < 1e-5);
        assert!((dx.equivalent_35mm(29.0) - 44.266).abs() < 1e-3);
        // 56·√2 = 79.196: a normal lens of 80 mm sees as much as one of 43.7 mm on 36×24.
        assert!(("6x6".parse::<Film>().unwrap().equivalent_35mm(80.0) - 43.7056).abs() < 1e-3);
    }

    #[test]
    fn portrait_picture_rotates_the_film() {
        let film = Film::FULL_FRAME;
        assert_eq!(film.turned_for(1296, 1936).width_mm(), 24.0);
        assert_eq!(film.turned_for(1296, 1936).turned_for(1936, 1296), film);
    }

    #[test]
    fn lens_types_by_angle() {
        let film = Film::FULL_FRAME;
        for (mm, expected) in [
            (24.0, LensType::Wide),
            (35.0, LensType::Wide),
            (40.0, LensType::Normal),
            (50.0, LensType::Normal),
            (60.0, LensType::Tele),
            (200.0, LensType::Tele),
        ] {
            assert_eq!(LensType::of(mm, mm, &film), expected, "{mm} mm");
        }
        // 29 mm on the smaller APS-C is a normal lens.
        assert_eq!(LensType::of(29.0, 29.0, &"aps-c".parse().unwrap()), LensType::Normal);
        // The usual focal lengths on 36×24, scaled to other films.
        for (lens_type, [shortest_mm, longest_mm]) in [
            (LensType::Wide, [28.0, 28.0]),
            (LensType::Normal, [50.0, 50.0]),
            (LensType::Tele, [135.0, 135.0]),
            (LensType::Zoom, [28.0, 105.0]),
        ] {
            for film in [film, "aps-c".parse().unwrap(), "6x6".parse().unwrap()] {
                let crop = film.crop_factor();
                assert_eq!(LensType::of(shortest_mm / crop, longest_mm / crop, &film), lens_type);
            }
        }
    }

    proptest! {
        #[test]
        fn film_size_round_trips_through_text(w in 0.1f64..1000.0, h in 0.1f64..1000.0, text in "\\PC{0,20}") {
            let film = Film::new(w, h).unwrap();
            prop_assert_eq!(film.to_string().parse::<Film>().unwrap(), film);
            let _ = text.parse::<Film>();
        }
    }
}
