//! A camera's settings over the time of a video.

use std::path::PathBuf;

use crate::frame::PhotoSettings;

/// A camera's settings while it filmed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Telemetry {
    /// Ascending times.
    settings: Vec<Setting>,
    /// The file beside the video that the settings are from.
    pub sidecar: Option<PathBuf>,
}

/// A camera's settings at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setting {
    /// Time after the video file's start, s.
    pub at_s: f64,
    pub photo: PhotoSettings,
}

impl Telemetry {
    /// The settings nearest to a time after the file's start.
    pub fn at(&self, time_s: f64) -> PhotoSettings {
        let after = self.settings.partition_point(|setting| setting.at_s < time_s);
        let near = [after.checked_sub(1), Some(after)].into_iter().flatten().filter_map(|at| self.settings.get(at));
        let nearest = near.min_by(|a, b| (a.at_s - time_s).abs().total_cmp(&(b.at_s - time_s).abs()));
        nearest.map(|setting| setting.photo).unwrap_or_default()
    }

    /// The last time with settings, s after the file's start.
    pub fn end_s(&self) -> f64 {
        self.settings.last().map_or(0.0, |setting| setting.at_s)
    }

    /// `None` without settings.
    pub fn new(mut settings: Vec<Setting>, sidecar: Option<PathBuf>) -> Option<Self> {
        settings.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
        (!settings.is_empty()).then_some(Self { settings, sidecar })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn setting(at_s: f64, iso: f64) -> Setting {
        Setting { at_s, photo: PhotoSettings { iso: Some(iso), ..PhotoSettings::default() } }
    }

    #[test]
    fn nearest_settings_in_time_are_used() {
        let telemetry = Telemetry::new(vec![setting(1.0, 200.0), setting(0.0, 100.0)], None).unwrap();
        let iso = [-1.0, 0.4, 0.6, 9.0].map(|time_s| telemetry.at(time_s).iso.unwrap());
        assert_eq!((iso, telemetry.end_s()), ([100.0, 100.0, 200.0, 200.0], 1.0));
        assert_eq!(Telemetry::new(Vec::new(), None), None);
        assert_eq!(Telemetry::default().at(0.0), PhotoSettings::default());
    }
}
