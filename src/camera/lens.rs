//! Lens parameters of a camera's profile, and the aperture used for rendering.

use super::Geometry;
use super::thin_lens::{ThinLens, ThinLensError};
use crate::text::number;

crate::params! {
    /// The known parameters of a lens. Without an aperture the camera is a pinhole.
    pub struct Lens in "camera.lens" at Effects {
        "diameter of the aperture; instead of f_number; 0 is a pinhole"
        aperture_diameter_mm: Option<f64> = None, "mm", 0.0..=500.0, by_ratio;
        "focal length over aperture diameter; instead of aperture_diameter_mm"
        f_number as "f-number": Option<f64> = None, "1", 0.5..=256.0, by_ratio;
        "focus distance; none: infinity"
        focus_distance_m: Option<f64> = None, "m", 0.01..=100000.0, by_ratio;
        "number of aperture blades: 0 for a circle, or 3 to 32"
        blades: u32 = 0, "1", 0.0..=32.0;
        "rotation of the blades: at 0 the middle of a side is on the right; positive values turn it downwards"
        blade_rotation_deg: f64 = 0.0, "deg", -360.0..=360.0 => blades isnt "0";
    }
}

/// The aperture of a camera, and its focus distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Opening {
    /// Diameter of the circle through the blades' corners, metres, above 0.
    pub diameter_m: f64,
    /// May be infinite.
    pub focus_distance_m: f64,
    /// 0 for a circle, otherwise 3 to 32.
    pub blades: u32,
    /// Angle from the picture's x axis to a corner, towards the y axis (downwards), rad.
    pub rotation_rad: f64,
}

/// An impossible lens.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LensError {
    #[error("camera.lens.blades = {actual}: expected 0 (a circle) or 3 to 32")]
    Blades { actual: u32 },
    #[error(
        "camera.lens.aperture_diameter_mm = {} and camera.lens.f_number = {} are both given: expected one of them (the \
         other = none)",
        number(*diameter_mm), number(*f_number)
    )]
    Both { diameter_mm: f64, f_number: f64 },
    #[error("camera.lens: {0}")]
    Thin(#[from] ThinLensError),
}

impl Opening {
    /// The signed diameter in pixels of the image of a point at a depth (m, up to infinity):
    /// vSLRcam (8) for a calibrated camera, fx · D · (1/d_s − 1/d_o). Negative in front of the
    /// focus plane.
    pub fn circle_px(&self, fx_px: f64, distance_m: f64) -> f64 {
        fx_px * self.diameter_m * (1.0 / self.focus_distance_m - 1.0 / distance_m)
    }
}

impl Lens {
    /// The thin lens of a calibrated picture. Its image distance v is fixed by fx (focusing does
    /// not change a calibrated fx), so its focal length is v·d/(v + d). That is less than d for
    /// every d, so no focus distance lies within it. `None` if neither opening nor f-number is
    /// given, or the opening is 0.
    pub fn thin_lens(&self, geometry: &Geometry) -> Result<Option<ThinLens>, LensError> {
        // An impossible value is reported even if the blades have no effect.
        if matches!(self.blades, 1 | 2 | 33..) {
            return Err(LensError::Blades { actual: self.blades });
        }
        let image_distance_m = ThinLens::calibrated_image_distance_m(&geometry.intrinsics);
        if !(image_distance_m.is_finite() && image_distance_m > 0.0) {
            return Err(ThinLensError::ImageDistance { found_mm: 1e3 * image_distance_m }.into());
        }
        let focus_distance_m = self.focus_distance_m.unwrap_or(f64::INFINITY);
        let focal_length_m = ThinLens::focal_length_behind_m(image_distance_m, focus_distance_m);
        Ok(match (self.aperture_diameter_mm, self.f_number) {
            (Some(diameter_mm), Some(f_number)) => return Err(LensError::Both { diameter_mm, f_number }),
            (None, None) | (Some(0.0), None) => None,
            (Some(diameter_mm), None) => {
                Some(ThinLens::with_diameter(focal_length_m, 1e-3 * diameter_mm, focus_distance_m)?)
            }
            (None, Some(f_number)) => Some(ThinLens::new(focal_length_m, f_number, focus_distance_m)?),
        })
    }

    /// The aperture used for rendering. `None` for a pinhole.
    pub fn opening(&self, geometry: &Geometry) -> Result<Option<Opening>, LensError> {
        let lens = self.thin_lens(geometry)?;
        let half_side = if self.blades == 0 { 0.0 } else { std::f64::consts::PI / f64::from(self.blades) };
        Ok(lens.map(|lens| Opening {
            diameter_m: lens.diameter_m(),
            focus_distance_m: lens.focus_distance_m(),
            blades: self.blades,
            rotation_rad: self.blade_rotation_deg.to_radians() + half_side,
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Distortion, Intrinsics};
    use proptest::prelude::*;

    fn camera() -> Geometry {
        // v = 525 · 6.4 / 640 = 5.25 mm.
        Geometry::new(Intrinsics { film_width_mm: 6.4, ..Default::default() }, Distortion::default())
    }

    #[test]
    fn lens_without_an_aperture_is_a_pinhole() {
        assert_eq!(Lens::default().opening(&camera()), Ok(None));
        let closed = Lens { aperture_diameter_mm: Some(0.0), focus_distance_m: Some(1.0), ..Default::default() };
        assert_eq!(closed.opening(&camera()), Ok(None));
        let focus_alone = Lens { focus_distance_m: Some(1.0), ..Default::default() };
        assert_eq!(focus_alone.opening(&camera()), Ok(None));
    }

    #[test]
    fn opening_by_f_number_and_diameter_matches_hand_calculation() {
        let lens = Lens { f_number: Some(2.0), focus_distance_m: Some(1.0), blades: 5, ..Default::default() };
        let opening = lens.opening(&camera()).unwrap().unwrap();
        // f = 5.25·1000/1005.25 = 5.222581 mm, D = f/2.
        assert!((opening.diameter_m - 0.002_611_291).abs() < 1e-9);
        assert_eq!(
            (opening.focus_distance_m, opening.blades, opening.rotation_rad),
            (1.0, 5, std::f64::consts::PI / 5.0)
        );
        // 525 px · 2.611291 mm · (1/1 − 1/2) / m.
        assert!((opening.circle_px(525.0, 2.0) - 0.685_463_8).abs() < 1e-6);
        assert!((opening.circle_px(525.0, 0.5) + 1.370_927_6).abs() < 1e-6);
        let thin = lens.thin_lens(&camera()).unwrap().unwrap();
        assert!((thin.f_number() - 2.0).abs() < 1e-12);

        let lens = Lens { aperture_diameter_mm: Some(20.0), blade_rotation_deg: 90.0, ..Default::default() };
        let opening = lens.opening(&camera()).unwrap().unwrap();
        assert_eq!((opening.diameter_m, opening.focus_distance_m), (0.02, f64::INFINITY));
        assert!((opening.rotation_rad - std::f64::consts::FRAC_PI_2).abs() < 1e-15);
    }

    #[test]
    fn impossible_lens_is_refused_with_the_accepted_range() {
        for blades in [1, 2, 33, u32::MAX] {
            // Also for a pinhole, whose blades are invisible.
            let error = Lens { blades, ..Default::default() }.opening(&camera()).unwrap_err().to_string();
            assert!(
                error.contains(&format!("blades = {blades}")) && error.contains("0 (a circle) or 3 to 32"),
                "{error}"
            );
        }
        for blades in [0, 3, 32] {
            assert!(Lens { blades, f_number: Some(2.0), ..Default::default() }.opening(&camera()).is_ok());
        }
        let both = Lens { f_number: Some(2.0), aperture_diameter_mm: Some(1.0), ..Default::default() };
        assert!(both.opening(&camera()).unwrap_err().to_string().contains("one of them"));
        let impossible = Lens { f_number: Some(0.0), ..Default::default() };
        assert!(impossible.opening(&camera()).unwrap_err().to_string().contains("f-number of 0"));
    }

    proptest! {
        #[test]
        fn opening_circle_equals_that_of_the_thin_lens(
            a in 0.5f64..64.0, d_s in 0.02f64..1e5, d_o in 0.05f64..1e4, film in 1.0f64..60.0, fx in 100.0f64..5000.0
        ) {
            let i = Intrinsics { film_width_mm: film, fx_px: fx, ..Default::default() };
            let geometry = Geometry::new(i, Distortion::default());
            let lens = Lens { f_number: Some(a), focus_distance_m: Some(d_s), ..Default::default() };
            let (thin, opening) = (lens.thin_lens(&geometry).unwrap().unwrap(), lens.opening(&geometry).unwrap().unwrap());
            let on_film = thin.circle_of_confusion_px(d_o, film, 640);
            let calibrated = opening.circle_px(fx, d_o);
            let largest = fx * opening.diameter_m * (1.0 / d_s + 1.0 / d_o);
            prop_assert!((on_film - calibrated).abs() <= 1e-9 * largest);
            prop_assert!((thin.fx_px(film, 640) / fx - 1.0).abs() < 1e-9, "focusing moved fx");
        }
    }
}
