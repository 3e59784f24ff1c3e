//! Exposure: how bright a picture gets, and the settings that get it right.
//!
//! The scene asks for EV_s (9), the settings give EV_c (10); ΔEV = EV_s − EV_c is how many
//! stops brighter than right the picture is: above 0 over-exposed, below under-exposed. (The
//! paper takes its absolute value, with which nothing could be under-exposed.) "Right" puts
//! 18 % grey at 0.18 of linear light. EV_s contains the film speed, so that at equal light a
//! faster film asks for a shorter time; to compare scenes, take it at ISO 100.
//!
//! Not modelled: flash, filters, light lost in the lens (T-stops), film's reciprocity failure,
//! and what a meter looks at (it is given an illuminance, or the mean of a whole picture).

use super::stops::{self, Step, Stop};

crate::params! {
    /// How long and how sensitively the sensor looks.
    pub struct Exposure in "camera.exposure" {
        "how long each row gathers light; 0 is an instant; none: from the recording"
        time_s: Option<f64> = None, "s", 0.0..=60.0;
        "exposure as a part of the frame interval instead of time_s; 360 is all of it"
        shutter_angle_deg: Option<f64> = None, "deg", 0.0..=360.0;
        "film speed at which the noise was measured"
        iso: Option<f64> = None, "1", 1.0..=1000000.0;
    }
}

/// C of vSLRcam (9), the calibration of meters for incident light, lx·s·ISO (ISO 2720).
pub const METER_CONSTANT: f64 = 250.0;
/// What the paper takes for rooms, lux.
pub const INDOORS_LX: f64 = 500.0;
/// The linear light of a grey card that is exposed right.
pub const MIDDLE_GREY: f64 = 0.18;

/// What is set on a camera, exact values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Focal length over opening, above 0.
    pub f_number: f64,
    /// Seconds, above 0.
    pub time_s: f64,
    /// Film speed, above 0.
    pub iso: f64,
}

/// Who chooses aperture and time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// The camera chooses both.
    Program,
    /// The person sets the aperture, the camera the time.
    AperturePriority,
    /// The person sets the time, the camera the aperture.
    ShutterPriority,
    /// The person sets both; the camera says what it thinks of it.
    Manual,
}

/// A text that names no mode.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{found} is no mode; accepted are p (program), a (aperture priority), s (shutter priority), m (manual)")]
pub struct ModeError {
    pub found: String,
}

/// What the camera can be set to, exact values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// The widest opening, the smallest f-number.
    pub widest_f_number: f64,
    pub narrowest_f_number: f64,
    pub shortest_s: f64,
    pub longest_s: f64,
    /// The longest time that a hand holds still; the program line keeps to it while it can.
    pub hand_held_s: f64,
}

/// What a mode made of the light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Metered {
    pub settings: Settings,
    /// Stops brighter than wanted; within a sixth where the camera could choose from its
    /// series, more where the range ended or nothing was left to choose.
    pub over_ev: f64,
}

/// EV_s that the scene asks for, vSLRcam (9): log2(E·i_s/C). NaN or infinite where E or i_s is not above 0.
pub fn scene_ev(illuminance_lx: f64, iso: f64) -> f64 {
    (illuminance_lx * iso / METER_CONSTANT).log2()
}

/// The illuminance for which [`scene_ev`] is `ev` at that film speed, lux.
pub fn illuminance_lx(ev: f64, iso: f64) -> f64 {
    ev.exp2() * METER_CONSTANT / iso
}

impl Settings {
    /// EV_c that the settings give, vSLRcam (10): log2(a²/t).
    pub fn ev(&self) -> f64 {
        (self.f_number * self.f_number / self.time_s).log2()
    }

    /// ΔEV = EV_s − EV_c under an illuminance: stops over-exposed, negative under-exposed.
    pub fn over_ev(&self, illuminance_lx: f64) -> f64 {
        scene_ev(illuminance_lx, self.iso) - self.ev()
    }

    /// The illuminance of a scene from its picture, lux: `mean_light` is the picture's mean in
    /// linear light. A mean of 18 % was exposed right, ΔEV = 0; twice that is one stop over.
    /// It takes the scene for grey on average, as every reflected-light meter does. `None` for
    /// a black picture.
    pub fn illuminance_of_picture_lx(&self, mean_light: f64) -> Option<f64> {
        let ev = self.ev() + (mean_light / MIDDLE_GREY).log2();
        Some(illuminance_lx(ev, self.iso)).filter(|lx| lx.is_finite() && *lx > 0.0)
    }

    /// The other way round: the linear light of a grey scene under an illuminance; above 1 it clips.
    pub fn mean_light(&self, illuminance_lx: f64) -> f64 {
        MIDDLE_GREY * photographic_gain(self.over_ev(illuminance_lx))
    }

    /// Every engraved number replaced by what it stands for.
    pub fn exact(&self) -> Self {
        Self {
            f_number: stops::exact(&stops::f_numbers(Step::Third), self.f_number),
            time_s: stops::exact(&stops::shutter_times_s(Step::Third), self.time_s),
            iso: stops::exact(&stops::iso_speeds(Step::Third), self.iso),
        }
    }
}

impl std::fmt::Display for Settings {
    /// As in "f/5.6, 1/125 s, ISO 400".
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (aperture, time) = (stops::format_f_number(self.f_number), stops::format_shutter_s(self.time_s));
        write!(f, "{aperture}, {time}, {}", stops::format_iso(self.iso))
    }
}

/// By how much linear light is multiplied when a picture is ΔEV stops over: 2^ΔEV.
pub fn photographic_gain(over_ev: f64) -> f64 {
    over_ev.exp2()
}

/// vSLRcam (11) as printed, on display values (0 to 1, not linear light): new = old + 0.2·ΔEV,
/// with the signed ΔEV; ten stops span black to white and beyond. Kept within 0 to 1.
pub fn additive(display_value: f64, over_ev: f64) -> f64 {
    (display_value + 0.2 * over_ev).clamp(0.0, 1.0)
}

impl std::str::FromStr for Mode {
    type Err = ModeError;

    /// Reads p, a, s, m (also Av and Tv), in either case.
    fn from_str(text: &str) -> Result<Self, ModeError> {
        Ok(match text.trim().to_ascii_lowercase().as_str() {
            "p" | "program" => Self::Program,
            "a" | "av" => Self::AperturePriority,
            "s" | "tv" => Self::ShutterPriority,
            "m" | "manual" => Self::Manual,
            _ => return Err(ModeError { found: format!("\"{text}\"") }),
        })
    }
}

impl Mode {
    pub const ALL: [Self; 4] = [Self::Program, Self::AperturePriority, Self::ShutterPriority, Self::Manual];

    /// The letter on the wheel.
    pub fn letter(self) -> char {
        match self {
            Self::Program => 'p',
            Self::AperturePriority => 'a',
            Self::ShutterPriority => 's',
            Self::Manual => 'm',
        }
    }
}

impl Default for Limits {
    /// A usual lens on a usual camera: f/2.8 to f/22, 1/8000 s to 30 s, 1/60 s in the hand.
    fn default() -> Self {
        Self {
            widest_f_number: 8f64.sqrt(),
            narrowest_f_number: 512f64.sqrt(),
            shortest_s: (-13f64).exp2(),
            longest_s: 32.0,
            hand_held_s: (-6f64).exp2(),
        }
    }
}

impl Limits {
    /// Hand-held times follow a rule of thumb: one over the focal length on 36×24, in seconds.
    pub fn for_focal_length(self, equivalent_35mm: f64) -> Self {
        Self { hand_held_s: (1.0 / equivalent_35mm).clamp(self.shortest_s, self.longest_s), ..self }
    }

    fn f_numbers(&self) -> Vec<Stop> {
        within(stops::f_numbers(Step::Third), self.widest_f_number, self.narrowest_f_number)
    }

    fn times_s(&self) -> Vec<Stop> {
        within(stops::shutter_times_s(Step::Third), self.shortest_s, self.longest_s)
    }
}

fn within(mut series: Vec<Stop>, least: f64, most: f64) -> Vec<Stop> {
    // The limits themselves belong to it, however they were rounded.
    series.retain(|stop| stop.exact >= least * (1.0 - 1e-6) && stop.exact <= most * (1.0 + 1e-6));
    series
}

/// Chooses settings for an illuminance (lux, above 0): what the mode leaves to the camera, from
/// third stops within the limits; what it does not, and the film speed, as `set`.
/// `compensation_ev` stops brighter than right are wanted.
pub fn meter(mode: Mode, illuminance_lx: f64, set: Settings, compensation_ev: f64, limits: &Limits) -> Metered {
    // What the settings have to give for the picture to be as bright as wanted.
    let ev = scene_ev(illuminance_lx, set.iso) - compensation_ev;
    let time_for = |f_number: f64| {
        stops::nearest(&limits.times_s(), f_number * f_number / ev.exp2()).map_or(set.time_s, |stop| stop.exact)
    };
    let f_number_for = |time_s: f64| {
        stops::nearest(&limits.f_numbers(), (time_s * ev.exp2()).sqrt()).map_or(set.f_number, |stop| stop.exact)
    };
    let settings = match mode {
        Mode::Manual => set,
        Mode::AperturePriority => Settings { time_s: time_for(set.f_number), ..set },
        Mode::ShutterPriority => Settings { f_number: f_number_for(set.time_s), ..set },
        Mode::Program => {
            let f_number = f_number_for(program_time_s(ev, limits));
            Settings { f_number, time_s: time_for(f_number), ..set }
        }
    };
    Metered { settings, over_ev: settings.over_ev(illuminance_lx) - compensation_ev }
}

/// The program line: in the dark the opening is as wide as it goes and the time as long as it
/// takes; from where a hand holds still on, further light is shared between both, stop by stop.
fn program_time_s(ev: f64, limits: &Limits) -> f64 {
    let widest = 2.0 * limits.widest_f_number.log2();
    let spare_ev = ev - widest + limits.hand_held_s.log2();
    if spare_ev <= 0.0 {
        return (widest - ev).exp2();
    }
    limits.hand_held_s * (-0.5 * spare_ev).exp2()
}

/// The film speed that would make manual settings right, from third stops of ISO 100 to 25600,
/// with what is left over or under then.
pub fn iso_for(illuminance_lx: f64, set: Settings, compensation_ev: f64) -> Metered {
    let wanted = set.iso * (compensation_ev - set.over_ev(illuminance_lx)).exp2();
    let iso = stops::nearest(&stops::iso_speeds(Step::Third), wanted).map_or(set.iso, |stop| stop.exact);
    let settings = Settings { iso, ..set };
    Metered { settings, over_ev: settings.over_ev(illuminance_lx) - compensation_ev }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn close(found: f64, expected: f64, within: f64) {
        assert!((found - expected).abs() <= within, "{found} is not {expected}");
    }

    fn set(f_number: f64, time_s: f64, iso: f64) -> Settings {
        Settings { f_number, time_s, iso }
    }

    #[test]
    fn ev_of_scene_and_settings_worked_by_hand() {
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
    fn over_is_positive_and_brighter() {
        // The paper's figure 11 in a room of 500 lx at ISO 100: f/4 at 1/60 is under-exposed.
        let under = set(4.0, 1.0 / 60.0, 100.0).over_ev(INDOORS_LX);
        close(under, 7.643_856 - 9.906_891, 1e-6);
        // One stop wider, twice the time, twice the speed: each one stop brighter.
        close(set(8f64.sqrt(), 1.0 / 60.0, 100.0).over_ev(INDOORS_LX) - under, 1.0, 1e-12);
        close(set(4.0, 1.0 / 30.0, 100.0).over_ev(INDOORS_LX) - under, 1.0, 1e-12);
        close(set(4.0, 1.0 / 60.0, 200.0).over_ev(INDOORS_LX) - under, 1.0, 1e-12);
        close(set(1.4, 1.0 / 15.0, 400.0).over_ev(INDOORS_LX), 4.766_112, 1e-6);
    }

    #[test]
    fn gain_and_additive() {
        assert_eq!([0.0, 1.0, -2.0].map(photographic_gain), [1.0, 2.0, 0.25]);
        // vSLRcam (11): five stops over turn black white, five under white black.
        assert_eq!((additive(0.0, 5.0), additive(1.0, -5.0)), (1.0, 0.0));
        close(additive(0.5, 1.5), 0.8, 1e-12);
        close(additive(0.5, -1.5), 0.2, 1e-12);
        assert_eq!((additive(0.9, 1.0), additive(0.37, 0.0)), (1.0, 0.37));
    }

    #[test]
    fn illuminance_from_a_picture_and_back() {
        // A grey mean at sunny 16: E = 250 · 2^15 / 100.
        let sunny = set(16.0, 1.0 / 128.0, 100.0);
        close(sunny.illuminance_of_picture_lx(0.18).unwrap(), 81920.0, 1e-6);
        // f/4.8 at 1/125 s, ISO 400: 250 · 2880/400 = 1800 lx; at half the grey half of it.
        let door = set(4.8, 1.0 / 125.0, 400.0);
        close(door.illuminance_of_picture_lx(0.18).unwrap(), 1800.0, 1e-9);
        close(door.illuminance_of_picture_lx(0.09).unwrap(), 900.0, 1e-9);
        close(door.mean_light(900.0), 0.09, 1e-12);
        for black in [0.0, -0.1, f64::NAN] {
            assert_eq!(door.illuminance_of_picture_lx(black), None);
        }
    }

    #[test]
    fn modes_worked_by_hand() {
        let limits = Limits::default();
        // EV 12 at ISO 100: f/8 wants 64/4096 = 1/64 s, marked 1/60.
        let lux = illuminance_lx(12.0, 100.0);
        let a = meter(Mode::AperturePriority, lux, set(8.0, 1.0, 100.0), 0.0, &limits);
        assert_eq!(a.settings, set(8.0, 1.0 / 64.0, 100.0));
        assert_eq!(a.settings.to_string(), "f/8, 1/60 s, ISO 100");
        close(a.over_ev, 0.0, 1e-9);
        // 1/256 s wants √16 = f/4.
        let s = meter(Mode::ShutterPriority, lux, set(1.0, 1.0 / 256.0, 100.0), 0.0, &limits);
        close(s.settings.f_number, 4.0, 1e-12);
        // Program: AV 3 and TV 6 are 9; the 3 EV above are shared: AV 4.5 (4.33 or 4.67 in thirds).
        let p = meter(Mode::Program, lux, set(1.0, 1.0, 100.0), 0.0, &limits).settings;
        close(2.0 * p.f_number.log2(), 4.5, 0.17);
        close(p.ev(), 12.0, 1e-9);
        // In the dark (EV 5): f/2.8 and 1/4 s.
        let p = meter(Mode::Program, illuminance_lx(5.0, 100.0), set(1.0, 1.0, 100.0), 0.0, &limits);
        assert_eq!(p.settings.to_string(), "f/2.8, 1/4 s, ISO 100");
        // Manual stays and says: EV 9 settings under EV 12 light.
        let m = meter(Mode::Manual, lux, set(8.0, 0.125, 100.0), 0.0, &limits);
        assert_eq!(m.settings, set(8.0, 0.125, 100.0));
        close(m.over_ev, 3.0, 1e-9);
        // One stop of compensation is one stop longer, and still as wanted.
        let plus = meter(Mode::AperturePriority, lux, set(8.0, 1.0, 100.0), 1.0, &limits);
        close(plus.settings.time_s, 1.0 / 32.0, 1e-12);
        close(plus.over_ev, 0.0, 1e-9);
        close(plus.settings.over_ev(lux), 1.0, 1e-9);
    }

    #[test]
    fn beyond_the_range_the_rest_is_said() {
        let limits = Limits::default();
        // EV 3 with 1/256 s: f/2.8 is the widest, which is for EV 11: 8 stops under.
        let dark = illuminance_lx(3.0, 100.0);
        let s = meter(Mode::ShutterPriority, dark, set(4.0, 1.0 / 256.0, 100.0), 0.0, &limits);
        close(s.settings.f_number, 8f64.sqrt(), 1e-12);
        close(s.over_ev, -8.0, 1e-9);
        // EV 20 at f/2.8: 1/8000 s is for EV 16, 4 over.
        let bright = illuminance_lx(20.0, 100.0);
        close(meter(Mode::AperturePriority, bright, set(8f64.sqrt(), 1.0, 100.0), 0.0, &limits).over_ev, 4.0, 1e-9);
        // ISO 100 settings for EV 15 under EV 13: ISO 400 makes them right.
        let lux = illuminance_lx(13.0, 100.0);
        let m = iso_for(lux, set(16.0, 1.0 / 128.0, 100.0), 0.0);
        close(m.settings.iso, 400.0, 1e-9);
        close(m.over_ev, 0.0, 1e-9);
        // Nothing is slower than ISO 100.
        close(iso_for(lux, set(1.0, 1.0, 100.0), 0.0).over_ev, 13.0, 1e-9);
        close(Limits::default().for_focal_length(200.0).hand_held_s, 0.005, 1e-12);
    }

    #[test]
    fn modes_by_their_letters() {
        for mode in Mode::ALL {
            assert_eq!(mode.letter().to_string().parse(), Ok(mode));
        }
        assert_eq!("Av".parse(), Ok(Mode::AperturePriority));
        assert!("auto".parse::<Mode>().unwrap_err().to_string().contains("p (program)"));
    }

    proptest! {
        #[test]
        fn the_program_is_right_wherever_its_range_reaches(ev in -1.9f64..21.9, hand in 0.001f64..1.0) {
            // f/2.8 and 32 s are EV −2, f/22 and 1/8192 s EV 22.
            let limits = Limits { hand_held_s: hand, ..Limits::default() };
            let lux = illuminance_lx(ev, 100.0);
            let metered = meter(Mode::Program, lux, set(4.0, 0.01, 100.0), 0.0, &limits);
            prop_assert!(metered.over_ev.abs() <= 1.0 / 6.0 + 1e-9, "{metered:?}");
        }

        #[test]
        fn a_picture_gives_its_light_back(a in 1.0f64..32.0, t in 1e-4f64..10.0, iso in 100.0f64..25600.0, mean in 0.001f64..1.0) {
            let s = set(a, t, iso);
            let lux = s.illuminance_of_picture_lx(mean).unwrap();
            prop_assert!((s.mean_light(lux) / mean - 1.0).abs() < 1e-9);
        }
    }
}
