//! Exposure controls of the virtual camera, and the settings of each photograph of a series.

use super::error::{PhotoError, refused};
use super::request::{Bracket, PhotoRequest};
use crate::camera::exposure::ExposureSettings;
use crate::camera::metering::{Limits, Mode, meter};
use crate::camera::stops::{self, Step};
use crate::shot::{DEFAULT_ISO, PartialExposure};

/// Settings of one photograph.
pub struct SeriesEntry {
    pub settings: ExposureSettings,
    /// Remaining overexposure that no setting could correct, stops.
    pub over_ev: f64,
    pub focus_distance_m: f64,
}

/// The user's settings under an exposure mode.
pub struct ExposureControls {
    pub mode: Mode,
    pub set: ExposureSettings,
    pub lux: f64,
    pub compensation_ev: f64,
    pub limits: Limits,
    pub focus_distance_m: f64,
    /// True if the shutter time is limited by the length of the recording.
    hand_held: bool,
}

/// Shutter times of a series, in stops from its middle.
const SERIES_STOPS: std::ops::RangeInclusive<i32> = -3..=3;

impl ExposureControls {
    pub fn new(request: &PhotoRequest, taken: PartialExposure, lux: f64, limits: Limits) -> Result<Self, PhotoError> {
        let by_settings = match (request.f_number, request.time_s) {
            (Some(_), Some(_)) => Mode::Manual,
            (Some(_), None) => Mode::AperturePriority,
            (None, Some(_)) => Mode::ShutterPriority,
            (None, None) => Mode::Program,
        };
        let mode = request.mode.unwrap_or(by_settings);
        let chooses = |name: &str, setting: Option<f64>, modes: [Mode; 2], other: &str| match setting {
            Some(_) if modes.contains(&mode) => refused(format!(
                "--mode {} chooses the {name} itself: leave --{name} out, or take --mode {other} or m",
                mode.letter()
            )),
            _ => Ok(()),
        };
        chooses("aperture", request.f_number, [Mode::Program, Mode::ShutterPriority], "a")?;
        chooses("shutter", request.time_s, [Mode::Program, Mode::AperturePriority], "s")?;
        let needs = |setting: Option<f64>, modes: [Mode; 2], name: &str| {
            if modes.contains(&mode) && setting.is_none() {
                return refused(format!("--mode {} needs --{name}", mode.letter()));
            }
            Ok(setting.unwrap_or(1.0))
        };
        let gone_through = match request.bracket {
            Some(Bracket::Aperture) if request.f_number.is_some() => Some("aperture"),
            Some(Bracket::Iso) if request.iso.is_some() => Some("iso"),
            _ => None,
        };
        if let Some(name) = gone_through {
            return refused(format!("--bracket {name} goes through all of them: leave --{name} out"));
        }
        // The bracketed setting starts at a usual value.
        let varied = |own: Bracket, setting: Option<f64>, usual: f64| match request.bracket {
            Some(bracket) if bracket == own => setting.or(Some(usual)),
            _ => setting,
        };
        let f_number = varied(Bracket::Aperture, request.f_number, 8f64.sqrt());
        let time_s = varied(Bracket::Shutter, request.time_s, limits.hand_held_s);
        let set = ExposureSettings {
            f_number: needs(f_number, [Mode::AperturePriority, Mode::Manual], "aperture")?,
            time_s: needs(time_s, [Mode::ShutterPriority, Mode::Manual], "shutter")?,
            iso: request.iso.or(taken.iso).unwrap_or(DEFAULT_ISO),
        };
        Ok(Self {
            mode,
            set: set.exact(),
            lux,
            compensation_ev: request.compensation_ev,
            limits,
            focus_distance_m: f64::INFINITY,
            hand_held: request.hand_held,
        })
    }

    fn metered(&self, mode: Mode, set: ExposureSettings) -> SeriesEntry {
        let metered = meter(mode, self.lux, set, self.compensation_ev, &self.limits);
        SeriesEntry { settings: metered.settings, over_ev: metered.over_ev, focus_distance_m: self.focus_distance_m }
    }

    /// Warning if the mode could not achieve the exposure.
    pub fn exposure_warning(&self, entry: &SeriesEntry) -> Option<String> {
        let missed = self.mode != Mode::Manual && entry.over_ev.abs() > 0.5;
        missed.then(|| {
            let (stops, side, helps) = match entry.over_ev {
                over if over > 0.0 => (over, "too bright", "a smaller --iso helps"),
                over if self.hand_held => {
                    (-over, "too dark", "a larger --iso helps, or a frame further from the recording's ends")
                }
                over => (-over, "too dark", "a larger --iso helps"),
            };
            let Limits { shortest_s, longest_s, widest_f_number, narrowest_f_number, .. } = self.limits;
            format!(
                "{} is {stops:.1} stops {side}: the shutter can be open from {} to {}, the aperture {} to {}; {helps}",
                entry.settings,
                stops::format_shutter_s(shortest_s),
                stops::format_shutter_s(longest_s),
                stops::format_f_number(widest_f_number),
                stops::format_f_number(narrowest_f_number),
            )
        })
    }

    /// Warning about photographs of a series that are omitted.
    pub fn omission_warning(&self, bracket: Option<Bracket>) -> Option<String> {
        let Limits { shortest_s, longest_s, .. } = self.limits;
        let count = SERIES_STOPS.count();
        match bracket? {
            Bracket::Shutter => {
                let left_out = count.checked_sub(self.series(bracket).len()).filter(|n| *n > 0)?;
                Some(format!(
                    "{left_out} of {count} times are left out: shutters here are open from {} to {}",
                    stops::format_shutter_s(shortest_s),
                    stops::format_shutter_s(longest_s)
                ))
            }
            _ => None,
        }
    }

    /// The effective mode: a series of apertures or times is taken in their priority mode.
    pub fn mode_of(&self, bracket: Option<Bracket>) -> Mode {
        match (self.mode, bracket) {
            (Mode::Manual, _) => Mode::Manual,
            (_, Some(Bracket::Aperture)) => Mode::AperturePriority,
            (_, Some(Bracket::Shutter)) => Mode::ShutterPriority,
            (mode, _) => mode,
        }
    }

    /// The bracketed setting is fixed. In manual mode all others are, too; in other modes the
    /// camera compensates.
    pub fn series(&self, bracket: Option<Bracket>) -> Vec<SeriesEntry> {
        let manual = self.mode == Mode::Manual;
        let usual = self.metered(self.mode, self.set);
        let Some(bracket) = bracket else { return vec![usual] };
        let Limits { widest_f_number, narrowest_f_number, shortest_s, longest_s, .. } = self.limits;
        let full = |value: f64, min: f64, max: f64| (min * 0.999..=max * 1.001).contains(&value);
        match bracket {
            Bracket::Aperture => {
                let mode = self.mode_of(Some(bracket));
                let stops = stops::f_numbers(Step::Full).into_iter().map(|stop| stop.exact);
                let stops = stops.filter(|n| full(*n, widest_f_number, narrowest_f_number));
                stops.map(|f_number| self.metered(mode, ExposureSettings { f_number, ..self.set })).collect()
            }
            Bracket::Shutter => {
                let mode = self.mode_of(Some(bracket));
                let middle = if manual { self.set.time_s } else { usual.settings.time_s };
                let times = SERIES_STOPS.map(|stops| middle * f64::from(stops).exp2());
                let times = times.filter(|t| full(*t, shortest_s, longest_s));
                times.map(|time_s| self.metered(mode, ExposureSettings { time_s, ..self.set })).collect()
            }
            Bracket::Iso => {
                let speeds = stops::iso_speeds(Step::Full).into_iter().map(|stop| stop.exact);
                speeds.map(|iso| self.metered(self.mode, ExposureSettings { iso, ..self.set })).collect()
            }
            Bracket::Focus => (-3..=3)
                .map(|thirds| {
                    let focus_distance_m = self.focus_distance_m * (f64::from(thirds) / 3.0).exp2();
                    SeriesEntry { focus_distance_m, settings: usual.settings, over_ev: usual.over_ev }
                })
                .collect(),
        }
    }
}
