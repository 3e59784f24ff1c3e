//! The thin lens: image distance, angle of view, and circle of confusion.
//!
//! With the opening's diameter D = f/a and the image distance v, vSLRcam (8) is
//!
//!   c = D · (d_o − d_s)/d_o · f/(d_s − f)                          (8)
//!     = D · f·d_s/(d_s − f) · (d_o − d_s)/(d_o·d_s)                 expanded by d_s
//!     = D · v · (1/d_s − 1/d_o)                                     with (2)
//!
//! In this form a focus at infinity is no special case, and a calibrated camera needs no focal
//! length. In a picture `width` pixels wide, v · width / film width is its fx, so the circle is fx
//! · D · (1/d_s − 1/d_o) pixels.
//!
//! Not modelled: the thickness of real lenses (their distances are measured from the principal
//! planes, here from a single one), diffraction, aberrations, and deviations of real f-numbers from
//! their nominal values.

use super::Intrinsics;
use crate::text::number;

/// A lens with an opening and a focus. Distances are measured from the lens along its axis, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThinLens {
    focal_length_m: f64,
    diameter_m: f64,
    focus_distance_m: f64,
}

/// Depth of field, metres from the lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sharpness {
    pub near_m: f64,
    /// Infinite if focused at the hyperfocal distance or beyond.
    pub far_m: f64,
}

impl Sharpness {
    /// The total depth of field, metres.
    pub fn depth_m(&self) -> f64 {
        self.far_m - self.near_m
    }
}

/// Errors of impossible settings.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ThinLensError {
    #[error("a focal length of {} mm: expected a finite number above 0", number(*found_mm))]
    FocalLength { found_mm: f64 },
    #[error("an f-number of {}: expected a finite number above 0", number(*actual))]
    FNumber { actual: f64 },
    #[error("an opening of {} mm: expected a finite number from 0 (a pinhole)", number(*found_mm))]
    Diameter { found_mm: f64 },
    #[error(
        "a focus distance of {} m lies within the focal length of {1} m, where no picture forms behind the \
         lens; expected more than {1} m, up to infinity",
        number(*found_m), number(to_tenths_of_mm(*focal_length_m))
    )]
    FocusInsideFocalLength { found_m: f64, focal_length_m: f64 },
    #[error("an image distance of {} mm: expected a finite number above 0", number(*found_mm))]
    ImageDistance { found_mm: f64 },
}

fn to_tenths_of_mm(length_m: f64) -> f64 {
    (1e4 * length_m).round() / 1e4
}

fn finite_above_zero(value: f64) -> bool {
    value.is_finite() && value > 0.0
}

impl ThinLens {
    /// A lens from its focal length (m), f-number and focus distance (m, up to infinity).
    pub fn new(focal_length_m: f64, f_number: f64, focus_distance_m: f64) -> Result<Self, ThinLensError> {
        if !finite_above_zero(f_number) {
            return Err(ThinLensError::FNumber { actual: f_number });
        }
        Self::with_diameter(focal_length_m, focal_length_m / f_number, focus_distance_m)
    }

    /// Like [`ThinLens::new`], with the diameter of the aperture instead (m); 0 is a pinhole.
    pub fn with_diameter(focal_length_m: f64, diameter_m: f64, focus_distance_m: f64) -> Result<Self, ThinLensError> {
        if !finite_above_zero(focal_length_m) {
            return Err(ThinLensError::FocalLength { found_mm: 1e3 * focal_length_m });
        }
        if !(diameter_m.is_finite() && diameter_m >= 0.0) {
            return Err(ThinLensError::Diameter { found_mm: 1e3 * diameter_m });
        }
        // NaN does not compare, and is refused too.
        if !matches!(focus_distance_m.partial_cmp(&focal_length_m), Some(std::cmp::Ordering::Greater)) {
            return Err(ThinLensError::FocusInsideFocalLength { found_m: focus_distance_m, focal_length_m });
        }
        Ok(Self { focal_length_m, diameter_m, focus_distance_m })
    }

    /// The focal length of a lens with a known image distance v (m), as in a calibrated camera,
    /// when focused at d: (2) solved for f, f = v·d/(v + d). It is always shorter than d.
    pub fn focal_length_behind_m(image_distance_m: f64, focus_distance_m: f64) -> f64 {
        image_distance_m / (1.0 + image_distance_m / focus_distance_m)
    }

    /// The image distance of a calibrated camera, metres: v = fx · film width / picture width.
    pub fn calibrated_image_distance_m(intrinsics: &Intrinsics) -> f64 {
        1e-3 * intrinsics.film_width_mm * intrinsics.fx_px / f64::from(intrinsics.width_px)
    }

    pub fn focal_length_m(&self) -> f64 {
        self.focal_length_m
    }

    /// Diameter of the aperture, a_d of vSLRcam (4), metres; 0 for a pinhole.
    pub fn diameter_m(&self) -> f64 {
        self.diameter_m
    }

    /// May be infinite.
    pub fn focus_distance_m(&self) -> f64 {
        self.focus_distance_m
    }

    /// Focal length over diameter: 28 mm through 10 mm is f/2.8 (vSLRcam, section 2.1). Infinite
    /// for a pinhole.
    pub fn f_number(&self) -> f64 {
        self.focal_length_m / self.diameter_m
    }

    /// Distance from lens to film, vSLRcam (2): d_i = f·d_s/(d_s − f), metres. It grows as the
    /// focus gets closer.
    pub fn image_distance_m(&self) -> f64 {
        self.focal_length_m / (1.0 - self.focal_length_m / self.focus_distance_m)
    }

    /// The angle of view of an extent of the film, vSLRcam (1) and (3), rad. The film's diagonal
    /// (width, height) gives the diagonal (horizontal, vertical) angle of view. It narrows as the
    /// focus gets closer.
    pub fn angle_of_view_rad(&self, extent_mm: f64) -> f64 {
        2.0 * (0.5e-3 * extent_mm / self.image_distance_m()).atan()
    }

    /// fx of this lens's picture, px. As the focus gets closer it grows, by (3), as the angle of
    /// view narrows.
    pub fn fx_px(&self, film_width_mm: f64, width_px: u32) -> f64 {
        self.image_distance_m() * f64::from(width_px) / (1e-3 * film_width_mm)
    }

    /// Signed diameter on the film of the image of a point at a distance, vSLRcam (8), metres.
    /// Negative in front of the focus plane (where the image of the aperture is inverted), positive
    /// behind. The distance may be infinite.
    pub fn circle_of_confusion_m(&self, distance_m: f64) -> f64 {
        self.diameter_m * self.image_distance_m() * (1.0 / self.focus_distance_m - 1.0 / distance_m)
    }

    /// The signed diameter in pixels of a picture.
    #[cfg(test)]
    pub fn circle_of_confusion_px(&self, distance_m: f64, film_width_mm: f64, width_px: u32) -> f64 {
        self.circle_of_confusion_m(distance_m) * f64::from(width_px) / (1e-3 * film_width_mm)
    }

    /// The range in which circles stay within `circle_m` on the film (Lemme p.32-34): (8) solved
    /// for the distance, 1/d = 1/d_s ± c/(D·v). A pinhole is sharp everywhere.
    pub fn sharpness(&self, circle_m: f64) -> Sharpness {
        let by = circle_m / (self.diameter_m * self.image_distance_m());
        let focus = 1.0 / self.focus_distance_m;
        let far = focus - by;
        Sharpness { near_m: 1.0 / (focus + by), far_m: if far > 0.0 { 1.0 / far } else { f64::INFINITY } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Film;
    use crate::camera::tests::close;
    use proptest::prelude::*;

    #[test]
    fn f_number_of_the_paper() {
        close(ThinLens::with_diameter(0.028, 0.010, 3.0).unwrap().f_number(), 2.8, 1e-12);
        close(ThinLens::new(0.028, 2.8, 3.0).unwrap().diameter_m(), 0.010, 1e-15);
    }

    #[test]
    fn image_distance_and_angle_of_view_match_hand_calculation() {
        // vSLRcam (2): 0.05 · 1 / 0.95 = 0.0526316
        let near = ThinLens::new(0.05, 8.0, 1.0).unwrap();
        close(near.image_distance_m(), 0.052_631_579, 1e-9);
        let far = ThinLens::new(0.05, 8.0, f64::INFINITY).unwrap();
        assert_eq!(far.image_distance_m(), 0.05);
        // vSLRcam (1): 50 mm on 36×24 sees 46.8° diagonally, 39.6° horizontally, 27.0° vertically.
        let film = Film::FULL_FRAME;
        close(far.angle_of_view_rad(film.diagonal_mm()).to_degrees(), 46.793, 1e-3);
        close(far.angle_of_view_rad(film.width_mm()).to_degrees(), 39.598, 1e-3);
        close(far.angle_of_view_rad(film.height_mm()).to_degrees(), 26.991, 1e-3);
        // vSLRcam (3), focused at 1 m: 2·atan(43.2666·0.95/100) = 44.69°, narrower.
        close(near.angle_of_view_rad(film.diagonal_mm()).to_degrees(), 44.688, 1e-3);
        // fx follows: 1936 px over 36 mm at 52.6316 mm.
        close(near.fx_px(36.0, 1936), 2830.409, 1e-3);
    }

    #[test]
    fn circle_of_confusion_matches_the_steps_of_the_paper() {
        // f = 50 mm, f/2.5 (opening 20 mm), focused at 2 m, point at 4 m.
        let lens = ThinLens::new(0.05, 2.5, 2.0).unwrap();
        let opening = 0.05 / 2.5;
        let on_focus_plane = opening * (4.0 - 2.0) / 4.0; // (4) and (5): 10 mm
        close(on_focus_plane, 0.010, 1e-15);
        let scale = lens.image_distance_m() / 2.0; // (6): v/d_s = 0.0256410
        close(scale, 0.05 / (2.0 - 0.05), 1e-15); // (7): f/(d_s − f)
        close(lens.circle_of_confusion_m(4.0), 2.564_102_6e-4, 1e-11); // (8)
        close(lens.circle_of_confusion_m(4.0), on_focus_plane * scale, 1e-15);
        // Signed: at 1 m it is −20 mm · 1/1 · 0.0256410, in front of the focus plane.
        close(lens.circle_of_confusion_m(1.0), -5.128_205_1e-4, 1e-11);
        assert_eq!(lens.circle_of_confusion_m(2.0), 0.0);
        // 0.25641 mm of 36 mm on 640 px.
        close(lens.circle_of_confusion_px(4.0, 36.0, 640), 4.558_404_6, 1e-6);
        // The limit at infinity: D·f/(d_s − f).
        close(lens.circle_of_confusion_m(f64::INFINITY), 0.02 * 0.05 / 1.95, 1e-15);
        // Focused at infinity: c = −D·f/d_o.
        let infinite = ThinLens::new(0.05, 2.5, f64::INFINITY).unwrap();
        close(infinite.circle_of_confusion_m(4.0), -2.5e-4, 1e-15);
        assert_eq!(infinite.circle_of_confusion_m(f64::INFINITY), 0.0);
    }

    #[test]
    fn sharpness_matches_hand_calculation_up_to_the_hyperfocal_distance() {
        // Hyperfocal distance: 50² / (8 · 0.03) + 50 = 10466.67 mm.
        let lens = ThinLens::new(0.05, 8.0, 5.0).unwrap();
        let hyperfocal = 0.05 * 0.05 / (8.0 * 3e-5) + 0.05;
        // d(H − f)/(H + d − 2f) = 5·10.416667/15.366667 and d(H − f)/(H − d) = 5·10.416667/5.466667
        let limits = lens.sharpness(3e-5);
        close(limits.near_m, 3.389_371, 1e-6);
        close(limits.far_m, 9.527_439, 1e-6);
        close(limits.depth_m(), 6.138_068, 1e-6);
        // Lemme p.34: the near side is r = g·Δs·(g − f)/(a·f + Δs·(g − f)), where a is the
        // opening's diameter.
        let (g, f, a, s) = (5.0, 0.05, 0.05 / 8.0, 3e-5);
        close(5.0 - limits.near_m, g * s * (g - f) / (a * f + s * (g - f)), 1e-12);
        // Focused there, it is sharp from half that distance to infinity.
        let there = ThinLens::new(0.05, 8.0, hyperfocal * (1.0 + 1e-12)).unwrap().sharpness(3e-5);
        close(there.near_m, 0.5 * hyperfocal, 1e-6);
        assert_eq!(there.far_m, f64::INFINITY);
        // Focused at infinity: sharp from H − f on.
        let infinite = ThinLens::new(0.05, 8.0, f64::INFINITY).unwrap().sharpness(3e-5);
        close(infinite.near_m, hyperfocal - 0.05, 1e-9);
        assert_eq!(infinite.far_m, f64::INFINITY);
        // A pinhole is sharp everywhere.
        let pinhole = ThinLens::with_diameter(0.05, 0.0, 5.0).unwrap();
        assert_eq!(pinhole.sharpness(3e-5), Sharpness { near_m: 0.0, far_m: f64::INFINITY });
        assert_eq!(pinhole.circle_of_confusion_m(1.0), 0.0);
    }

    #[test]
    fn calibrated_camera_keeps_its_image_distance() {
        let i = Intrinsics { width_px: 640, fx_px: 525.0, film_width_mm: 6.4, ..Default::default() };
        let v = ThinLens::calibrated_image_distance_m(&i);
        close(v, 0.005_25, 1e-15);
        // f = 5.25 · 1000 / 1005.25 mm
        let f = ThinLens::focal_length_behind_m(v, 1.0);
        close(f, 0.005_222_581, 1e-9);
        close(ThinLens::new(f, 2.0, 1.0).unwrap().image_distance_m(), v, 1e-15);
        assert_eq!(ThinLens::focal_length_behind_m(v, f64::INFINITY), v);
    }

    #[test]
    fn impossible_settings_are_refused_with_the_reason() {
        for focus in [0.05, 0.049, 0.0, -1.0, f64::NAN] {
            let error = ThinLens::new(0.05, 8.0, focus).unwrap_err().to_string();
            assert!(error.contains("within the focal length of 0.05 m") && error.contains("more than 0.05"), "{error}");
        }
        assert!(ThinLens::new(0.05, 8.0, 0.050_001).is_ok());
        for f_number in [0.0, -2.0, f64::NAN, f64::INFINITY] {
            let error = ThinLens::new(0.05, f_number, 1.0).unwrap_err();
            assert!(matches!(error, ThinLensError::FNumber { .. }), "{error}");
        }
        assert!(matches!(ThinLens::new(0.0, 8.0, 1.0), Err(ThinLensError::FocalLength { .. })));
        assert!(matches!(ThinLens::with_diameter(0.05, -0.1, 1.0), Err(ThinLensError::Diameter { .. })));
    }

    proptest! {
        #[test]
        fn the_symmetric_form_is_equation_8(f in 0.004f64..0.3, a in 0.7f64..64.0, gap in 0.01f64..100.0, d_o in 0.05f64..1e4) {
            let d_s = f + gap;
            let lens = ThinLens::new(f, a, d_s).unwrap();
            let eq8 = (f / a) * (d_o - d_s) / d_o * f / (d_s - f);
            let largest = (f / a) * f / (d_s - f) * (1.0 + d_s / d_o);
            prop_assert!((lens.circle_of_confusion_m(d_o) - eq8).abs() <= 1e-11 * largest);
            // In pixels it is fx · D · (1/d_s − 1/d_o), D = f/a.
            let px = lens.fx_px(36.0, 1920) * lens.diameter_m() * (1.0 / d_s - 1.0 / d_o);
            prop_assert!((lens.circle_of_confusion_px(d_o, 36.0, 1920) - px).abs() <= 1e-9 * largest * 1e5);
        }

        #[test]
        fn circle_at_the_depth_of_field_limits_is_the_limit(f in 0.004f64..0.3, a in 0.7f64..64.0, gap in 0.01f64..100.0, c in 1e-6f64..1e-4) {
            let lens = ThinLens::new(f, a, f + gap).unwrap();
            let limits = lens.sharpness(c);
            prop_assert!((lens.circle_of_confusion_m(limits.near_m) + c).abs() < 1e-7 * c.max(1e-5));
            if limits.far_m.is_finite() && limits.far_m < 1e6 {
                prop_assert!((lens.circle_of_confusion_m(limits.far_m) - c).abs() < 1e-7 * c.max(1e-5));
            }
        }
    }
}
