//! Exposure: brightness of a picture, and settings for a correct one.
//!
//! The scene needs EV_s (9), the settings give EV_c (10). ΔEV = EV_s − EV_c is how many stops too
//! bright the picture is: above 0 over-exposed, below under-exposed. (The paper takes its absolute
//! value, with which nothing could be under-exposed.) A correct exposure puts 18 % grey at 0.18 of
//! linear light. EV_s includes the film speed, so that at equal light a faster film needs a shorter
//! time; to compare scenes, use ISO 100.
//!
//! Not modelled: flash, filters, light lost in the lens (T-stops), film's reciprocity failure.

use super::stops::{self, Step};

/// Maximum exposure time, seconds.
pub const MAX_EXPOSURE_S: f64 = 60.0;

/// Largest assumed exposure time, s. Phones and depth cameras expose for 1/60 s or less in lit
/// rooms, at 10 frames a second as at 30, so that half of a long interval is too much blur.
const MAX_ASSUMED_EXPOSURE_S: f64 = 1.0 / 60.0;

/// Exposure time of frames without any information: a shutter angle of 180°, at most 1/60 s.
pub fn assumed_exposure_s(interval_s: f64) -> f64 {
    (0.5 * interval_s).min(MAX_ASSUMED_EXPOSURE_S)
}

crate::params! {
    /// Exposure time and sensitivity of the sensor.
    pub struct CameraExposure in "camera.exposure" at Depth {
        "shutter time: exposure time of each row; 0 is an instant; none: from the recording"
        time_s: Option<f64> = None, "s", 0.0..=MAX_EXPOSURE_S, by_ratio;
        "exposure as a part of the frame interval instead of time_s; 360 is all of it"
        shutter_angle_deg: Option<f64> = None, "deg", 0.0..=360.0;
        "film speed at which the noise was measured"
        iso as "ISO" at Mix: Option<f64> = None, "1", 1.0..=1000000.0, by_ratio;
    }
}

/// C of vSLRcam (9), the calibration of meters for incident light, lx·s·ISO (ISO 2720).
pub const METER_CONSTANT: f64 = 250.0;
/// The paper's value for rooms, lux.
pub const INDOORS_LX: f64 = 500.0;
/// The linear light of a correctly exposed grey card.
pub const MIDDLE_GREY: f64 = 0.18;

/// A camera's settings, exact values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExposureSettings {
    /// Focal length divided by the opening's diameter, above 0.
    pub f_number: f64,
    /// Seconds, above 0.
    pub time_s: f64,
    /// Film speed, above 0.
    pub iso: f64,
}

/// EV_s required by the scene, vSLRcam (9): log2(E·i_s/C). NaN or infinite if E or i_s is not above
/// 0.
pub fn scene_ev(illuminance_lx: f64, iso: f64) -> f64 {
    (illuminance_lx * iso / METER_CONSTANT).log2()
}

/// The illuminance at which [`scene_ev`] is `ev` for that film speed, lux.
pub fn illuminance_lx(ev: f64, iso: f64) -> f64 {
    ev.exp2() * METER_CONSTANT / iso
}

impl ExposureSettings {
    /// EV_c of the settings, vSLRcam (10): log2(a²/t).
    pub fn ev(&self) -> f64 {
        (self.f_number * self.f_number / self.time_s).log2()
    }

    /// ΔEV = EV_s − EV_c under an illuminance: stops over-exposed, negative under-exposed.
    pub fn over_ev(&self, illuminance_lx: f64) -> f64 {
        scene_ev(illuminance_lx, self.iso) - self.ev()
    }

    /// The illuminance of a scene estimated from its picture, lux. `mean_light` is the picture's
    /// mean in linear light. A mean of 18 % is a correct exposure, ΔEV = 0; twice that is one stop
    /// over. The scene is assumed to be grey on average, as by every reflected-light meter. `None`
    /// for a black picture.
    pub fn illuminance_of_picture_lx(&self, mean_light: f64) -> Option<f64> {
        let ev = self.ev() + (mean_light / MIDDLE_GREY).log2();
        Some(illuminance_lx(ev, self.iso)).filter(|lx| lx.is_finite() && *lx > 0.0)
    }

    /// The inverse: the linear light of a grey scene under an illuminance. Above 1 it clips.
    pub fn mean_light(&self, illuminance_lx: f64) -> f64 {
        MIDDLE_GREY * photographic_gain(self.over_ev(illuminance_lx))
    }

    /// Replaces every engraved number by its exact value.
    pub fn exact(&self) -> Self {
        Self {
            f_number: stops::exact(&stops::f_numbers(Step::Third), self.f_number),
            time_s: stops::exact(&stops::shutter_times_s(Step::Third), self.time_s),
            iso: stops::exact(&stops::iso_speeds(Step::Third), self.iso),
        }
    }
}

impl std::fmt::Display for ExposureSettings {
    /// For example "f/5.6, 1/125 s, ISO 400".
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (aperture, time) = (stops::format_f_number(self.f_number), stops::format_shutter_s(self.time_s));
        write!(f, "{aperture}, {time}, {}", stops::format_iso(self.iso))
    }
}

/// The factor on linear light for ΔEV stops: 2^ΔEV.
pub fn photographic_gain(over_ev: f64) -> f64 {
    over_ev.exp2()
}

/// vSLRcam (11) as printed, on display values (0 to 1, not linear light): new = old + 0.2·ΔEV, with
/// the signed ΔEV, so that five stops span black to white. Clamped to 0 to 1.
pub fn additive(display_value: f64, over_ev: f64) -> f64 {
    (display_value + 0.2 * over_ev).clamp(0.0, 1.0)
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use crate::camera::tests::close;
    use proptest::prelude::*;

    pub fn set(f_number: f64, time_s: f64, iso: f64) -> ExposureSettings {
        ExposureSettings { f_number, time_s, iso }
    }

    #[test]
    fn scene_and_settings_ev_match_hand_calculation() {
        // vSLRcam (9): 500 lx · 100 / 250 = 200, log2 = 7.6439
        close(scene_ev(INDOORS_LX, 100.0), 7.643_856, 1e-6);
        // Two stops of film speed are two EV.
        close(scene_ev(INDOORS_LX, 400.0), 9.643_856, 1e-6);
        // 81920 lx · 100 / 250 = 2^15: sunlight.
        close(scene_ev(81920.0, 100.0), 15.0, 1e-12);
        close(illuminance_lx(15.0, 100.0), 81920.0, 1e-8);
        // vSLRcam (10), sunny 16: log2(256·125) = 14.966 by the marks, 15 exactly.
        let sunny = set(16.0, 1.0 / 125.0, 100.0);
        close(sunny.ev(), 15.0, 0.05);
        close(sunny.ev(), 14.965_784, 1e-6);
        close(sunny.exact().ev(), 15.0, 1e-12);
        close(set(1.0, 1.0, 100.0).ev(), 0.0, 1e-12);
    }

    #[test]
    fn assumed_exposure_is_half_an_interval_up_to_a_sixtieth() {
        assert_eq!((assumed_exposure_s(0.02), assumed_exposure_s(0.1)), (0.01, 1.0 / 60.0));
    }

    #[test]
    fn overexposure_is_positive() {
        // The paper's figure 11, in a room of 500 lx at ISO 100: f/4 at 1/60 is under-exposed.
        let under = set(4.0, 1.0 / 60.0, 100.0).over_ev(INDOORS_LX);
        close(under, 7.643_856 - 9.906_891, 1e-6);
        // One stop wider, twice the time, twice the speed: each is one stop brighter.
        close(set(8f64.sqrt(), 1.0 / 60.0, 100.0).over_ev(INDOORS_LX) - under, 1.0, 1e-12);
        close(set(4.0, 1.0 / 30.0, 100.0).over_ev(INDOORS_LX) - under, 1.0, 1e-12);
        close(set(4.0, 1.0 / 60.0, 200.0).over_ev(INDOORS_LX) - under, 1.0, 1e-12);
        close(set(1.4, 1.0 / 15.0, 400.0).over_ev(INDOORS_LX), 4.766_112, 1e-6);
    }

    #[test]
    fn gain_and_additive_correction_match_hand_calculation() {
        assert_eq!([0.0, 1.0, -2.0].map(photographic_gain), [1.0, 2.0, 0.25]);
        // vSLRcam (11): five stops over turn black white, five under white black.
        assert_eq!((additive(0.0, 5.0), additive(1.0, -5.0)), (1.0, 0.0));
        close(additive(0.5, 1.5), 0.8, 1e-12);
        close(additive(0.5, -1.5), 0.2, 1e-12);
        assert_eq!((additive(0.9, 1.0), additive(0.37, 0.0)), (1.0, 0.37));
    }

    #[test]
    fn illuminance_of_a_picture_round_trips() {
        // A grey mean at sunny 16: E = 250 · 2^15 / 100.
        let sunny = set(16.0, 1.0 / 128.0, 100.0);
        close(sunny.illuminance_of_picture_lx(0.18).unwrap(), 81920.0, 1e-6);
        // f/4.8 at 1/125 s, ISO 400: 250 · 2880/400 = 1800 lx; half the light means half of it.
        let door = set(4.8, 1.0 / 125.0, 400.0);
        close(door.illuminance_of_picture_lx(0.18).unwrap(), 1800.0, 1e-9);
        close(door.illuminance_of_picture_lx(0.09).unwrap(), 900.0, 1e-9);
        close(door.mean_light(900.0), 0.09, 1e-12);
        for black in [0.0, -0.1, f64::NAN] {
            assert_eq!(door.illuminance_of_picture_lx(black), None);
        }
    }

    proptest! {
        #[test]
        fn mean_light_round_trips_through_illuminance(a in 1.0f64..32.0, t in 1e-4f64..10.0, iso in 100.0f64..25600.0, mean in 0.001f64..1.0) {
            let s = set(a, t, iso);
            let lux = s.illuminance_of_picture_lx(mean).unwrap();
            prop_assert!((s.mean_light(lux) / mean - 1.0).abs() < 1e-9);
        }
    }
}
