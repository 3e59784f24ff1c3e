//! Light meter: brightness of a picture, and the settings chosen by an exposure mode.
//!
//! Not modelled: spatial weighting (the whole picture has equal weight) and automatic film speed.

use super::Response;
use super::exposure::{ExposureSettings, scene_ev};
use super::stops::{self, Step, Stop};
use crate::pixels::{Pixels, luma_709};

/// Exposure mode: which of aperture and time the camera chooses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// The camera chooses both.
    Program,
    /// The user sets the aperture, the camera the time.
    AperturePriority,
    /// The user sets the time, the camera the aperture.
    ShutterPriority,
    /// The user sets both; the camera reports the deviation.
    Manual,
}

/// Error of an unknown mode.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{actual} is not a mode; expected p (program), a (aperture priority), s (shutter priority), m (manual)")]
pub struct ModeError {
    pub actual: String,
}

/// The range of a camera's settings, exact values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// The widest opening: the smallest f-number.
    pub widest_f_number: f64,
    pub narrowest_f_number: f64,
    pub shortest_s: f64,
    pub longest_s: f64,
    /// Maximum hand-held time. The program line stays below it if possible.
    pub hand_held_s: f64,
}

/// The settings chosen by a mode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeteredSettings {
    pub settings: ExposureSettings,
    /// Remaining overexposure, stops. Within a sixth if the camera could choose from its series,
    /// more at the end of the range or without a free setting.
    pub over_ev: f64,
}

/// A meter's measurements of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PictureLight {
    /// Mean luminance in linear light, 0 to 1 (ITU-R BT.709 weights).
    pub mean: f64,
    /// The share of pixels with a clipped channel, whose light is underestimated by the mean. 0 to
    /// 1.
    pub clipped: f64,
}

impl PictureLight {
    /// Measures camera pixels. All 0 for an empty picture.
    pub fn of(pixels: &Pixels, response: &Response) -> Self {
        let max_code = pixels.max_code();
        let light = response.table(max_code);
        let at = |code: u32| light.get(code as usize).copied().unwrap_or(1.0);
        let (mut sum, mut clipped) = (0.0, 0u64);
        for y in 0..pixels.height {
            for x in 0..pixels.width {
                let [r, g, b] = pixels.at(x, y);
                sum += luma_709([at(r), at(g), at(b)]);
                clipped += u64::from(r.max(g).max(b) >= max_code);
            }
        }
        let count = (u64::from(pixels.width) * u64::from(pixels.height)).max(1) as f64;
        Self { mean: sum / count, clipped: clipped as f64 / count }
    }
}

impl std::str::FromStr for Mode {
    type Err = ModeError;

    /// Parses p, a, s, m (also Av and Tv), in either case.
    fn from_str(text: &str) -> Result<Self, ModeError> {
        Ok(match text.trim().to_ascii_lowercase().as_str() {
            "p" | "program" => Self::Program,
            "a" | "av" => Self::AperturePriority,
            "s" | "tv" => Self::ShutterPriority,
            "m" | "manual" => Self::Manual,
            _ => return Err(ModeError { actual: format!("\"{text}\"") }),
        })
    }
}

impl Mode {
    pub const ALL: [Self; 4] = [Self::Program, Self::AperturePriority, Self::ShutterPriority, Self::Manual];

    /// The letter on the mode dial.
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
    /// A usual lens on a usual camera: f/2.8 to f/22, 1/8000 s to 30 s, 1/60 s hand-held.
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
    /// Sets the longest hand-held time by a rule of thumb: one over the focal length on 36×24, in
    /// seconds.
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

fn within(mut series: Vec<Stop>, min: f64, max: f64) -> Vec<Stop> {
    // Includes the limits themselves despite rounding.
    series.retain(|stop| stop.exact >= min * (1.0 - 1e-6) && stop.exact <= max * (1.0 + 1e-6));
    series
}

/// Chooses settings for an illuminance (lux, above 0), from third stops within the limits. Settings
/// that the mode does not choose, and the film speed, stay as `set`. `compensation_ev` is the
/// requested overexposure, stops.
pub fn meter(
    mode: Mode,
    illuminance_lx: f64,
    set: ExposureSettings,
    compensation_ev: f64,
    limits: &Limits,
) -> MeteredSettings {
    // The EV of settings that give the requested brightness.
    let ev = scene_ev(illuminance_lx, set.iso) - compensation_ev;
    let time_for = |f_number: f64| {
        stops::nearest(&limits.times_s(), f_number * f_number / ev.exp2()).map_or(set.time_s, |stop| stop.exact)
    };
    let f_number_for = |time_s: f64| {
        stops::nearest(&limits.f_numbers(), (time_s * ev.exp2()).sqrt()).map_or(set.f_number, |stop| stop.exact)
    };
    let settings = match mode {
        Mode::Manual => set,
        Mode::AperturePriority => ExposureSettings { time_s: time_for(set.f_number), ..set },
        Mode::ShutterPriority => ExposureSettings { f_number: f_number_for(set.time_s), ..set },
        Mode::Program => {
            let f_number = f_number_for(program_time_s(ev, limits));
            ExposureSettings { f_number, time_s: time_for(f_number), ..set }
        }
    };
    MeteredSettings { settings, over_ev: settings.over_ev(illuminance_lx) - compensation_ev }
}

/// The program line: in the dark the widest aperture, and the time that it requires. From the light
/// at which the camera can be hand-held, additional light is shared between both, stop by stop.
fn program_time_s(ev: f64, limits: &Limits) -> f64 {
    let widest = 2.0 * limits.widest_f_number.log2();
    let spare_ev = ev - widest + limits.hand_held_s.log2();
    if spare_ev <= 0.0 {
        return (widest - ev).exp2();
    }
    // At the shortest time, the aperture takes the rest.
    (limits.hand_held_s * (-0.5 * spare_ev).exp2()).max(limits.shortest_s)
}

/// The film speed that would make manual settings correct, from third stops of ISO 100 to 25600,
/// and the remaining deviation.
pub fn iso_for(illuminance_lx: f64, set: ExposureSettings, compensation_ev: f64) -> MeteredSettings {
    let exact_iso = set.iso * (compensation_ev - set.over_ev(illuminance_lx)).exp2();
    let iso = stops::nearest(&stops::iso_speeds(Step::Third), exact_iso).map_or(set.iso, |stop| stop.exact);
    let settings = ExposureSettings { iso, ..set };
    MeteredSettings { settings, over_ev: settings.over_ev(illuminance_lx) - compensation_ev }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Curve;
    use crate::camera::exposure::{illuminance_lx, tests::set};
    use crate::camera::tests::close;
    use proptest::prelude::*;

    #[test]
    fn picture_light_matches_hand_calculation() {
        // Half of a linear picture at 51/255 = 0.2, half at full red: 0.5·0.2 + 0.5·0.2126.
        let linear = Response { curve: Curve::Linear, ..Default::default() };
        let pixels = Pixels::from_u8(2, 1, vec![51, 51, 51, 255, 0, 0]).unwrap();
        let light = PictureLight::of(&pixels, &linear);
        close(light.mean, 0.2063, 1e-12);
        assert_eq!(light.clipped, 0.5);
        // sRGB code 118 is a grey card's 18 %, in 16 bits too.
        let grey = PictureLight::of(&Pixels::from_u8(1, 1, vec![118; 3]).unwrap(), &Response::default());
        close(grey.mean, 0.1812, 1e-4);
        let deep = Pixels::from_u16(1, 1, vec![118 * 257; 3]).unwrap();
        close(PictureLight::of(&deep, &Response::default()).mean, grey.mean, 1e-12);
        let none = PictureLight::of(&Pixels::from_u8(0, 0, vec![]).unwrap(), &linear);
        assert_eq!(none, PictureLight { mean: 0.0, clipped: 0.0 });
    }

    #[test]
    fn mode_settings_match_hand_calculation() {
        let limits = Limits::default();
        // EV 12 at ISO 100: f/8 needs 64/4096 = 1/64 s, marked 1/60.
        let lux = illuminance_lx(12.0, 100.0);
        let a = meter(Mode::AperturePriority, lux, set(8.0, 1.0, 100.0), 0.0, &limits);
        assert_eq!(a.settings, set(8.0, 1.0 / 64.0, 100.0));
        assert_eq!(a.settings.to_string(), "f/8, 1/60 s, ISO 100");
        close(a.over_ev, 0.0, 1e-9);
        // 1/256 s needs √16 = f/4.
        let s = meter(Mode::ShutterPriority, lux, set(1.0, 1.0 / 256.0, 100.0), 0.0, &limits);
        close(s.settings.f_number, 4.0, 1e-12);
        // Program: AV 3 and TV 6 are 9; the 3 EV above are shared: AV 4.5 (4.33 or 4.67 in thirds).
        let p = meter(Mode::Program, lux, set(1.0, 1.0, 100.0), 0.0, &limits).settings;
        close(2.0 * p.f_number.log2(), 4.5, 0.17);
        close(p.ev(), 12.0, 1e-9);
        // In the dark (EV 5): f/2.8 and 1/4 s.
        let p = meter(Mode::Program, illuminance_lx(5.0, 100.0), set(1.0, 1.0, 100.0), 0.0, &limits);
        assert_eq!(p.settings.to_string(), "f/2.8, 1/4 s, ISO 100");
        // Manual keeps the settings and reports: EV 9 settings in EV 12 light.
        let m = meter(Mode::Manual, lux, set(8.0, 0.125, 100.0), 0.0, &limits);
        assert_eq!(m.settings, set(8.0, 0.125, 100.0));
        close(m.over_ev, 3.0, 1e-9);
        // One stop of compensation is one stop longer, and still as requested.
        let plus = meter(Mode::AperturePriority, lux, set(8.0, 1.0, 100.0), 1.0, &limits);
        close(plus.settings.time_s, 1.0 / 32.0, 1e-12);
        close(plus.over_ev, 0.0, 1e-9);
        close(plus.settings.over_ev(lux), 1.0, 1e-9);
    }

    #[test]
    fn deviation_beyond_the_range_is_reported() {
        let limits = Limits::default();
        // EV 3 with 1/256 s: f/2.8 is the widest, which is for EV 11: 8 stops under.
        let dark = illuminance_lx(3.0, 100.0);
        let s = meter(Mode::ShutterPriority, dark, set(4.0, 1.0 / 256.0, 100.0), 0.0, &limits);
        close(s.settings.f_number, 8f64.sqrt(), 1e-12);
        close(s.over_ev, -8.0, 1e-9);
        // EV 20 at f/2.8: 1/8000 s is for EV 16, 4 over.
        let bright = illuminance_lx(20.0, 100.0);
        close(meter(Mode::AperturePriority, bright, set(8f64.sqrt(), 1.0, 100.0), 0.0, &limits).over_ev, 4.0, 1e-9);
        // ISO 100 settings for EV 15 in EV 13 light: ISO 400 makes them correct.
        let lux = illuminance_lx(13.0, 100.0);
        let m = iso_for(lux, set(16.0, 1.0 / 128.0, 100.0), 0.0);
        close(m.settings.iso, 400.0, 1e-9);
        close(m.over_ev, 0.0, 1e-9);
        // There is no film slower than ISO 100.
        close(iso_for(lux, set(1.0, 1.0, 100.0), 0.0).over_ev, 13.0, 1e-9);
        close(Limits::default().for_focal_length(200.0).hand_held_s, 0.005, 1e-12);
    }

    #[test]
    fn modes_are_parsed_by_their_letters() {
        for mode in Mode::ALL {
            assert_eq!(mode.letter().to_string().parse(), Ok(mode));
        }
        assert_eq!("Av".parse(), Ok(Mode::AperturePriority));
        assert!("auto".parse::<Mode>().unwrap_err().to_string().contains("p (program)"));
    }

    proptest! {
        #[test]
        fn program_mode_is_correct_within_its_range(ev in -1.9f64..21.9, hand in 0.001f64..1.0) {
            // f/2.8 and 32 s are EV −2, f/22 and 1/8192 s EV 22.
            let limits = Limits { hand_held_s: hand, ..Limits::default() };
            let lux = illuminance_lx(ev, 100.0);
            let metered = meter(Mode::Program, lux, set(4.0, 0.01, 100.0), 0.0, &limits);
            prop_assert!(metered.over_ev.abs() <= 1.0 / 6.0 + 1e-9, "{metered:?}");
        }
    }
}
