//! Options of a live camera and its poses, as the arguments of `locard live`. Serialized, so that a
//! camera that is reopened gets the same options.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::delayed::DelayMode;
use crate::coding::{ColorMatrix, ColorRange};
use crate::tracking::smooth::MAX_TIME_CONSTANT_S;
use crate::webcam::{DriverName, Layout};

/// Options of a camera and its pose source. All are optional.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(default)]
pub struct LiveOptions {
    /// Camera driver; the system's default if `None`.
    pub driver: Option<DriverName>,
    /// Width and height, px; the profile's if `None`, or 640x480 without a profile.
    pub size: Option<(u32, u32)>,
    /// Frame rate, Hz; 30 if `None`.
    pub rate_hz: Option<f64>,
    pub layout: Option<Layout>,
    pub range: Option<ColorRange>,
    pub matrix: Option<ColorMatrix>,
    pub delay: DelayMode,
    /// Time constant of the smoothing of poses from tags, seconds; no smoothing if `None`.
    pub smooth_s: Option<f64>,
}

/// Names of a camera and of its pose source, with their options.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct LiveSpec {
    pub camera: String,
    pub poses: String,
    #[serde(default, alias = "asked")]
    pub options: LiveOptions,
}

impl LiveSpec {
    pub fn new(camera: &str, poses: &str) -> Self {
        Self { camera: camera.to_owned(), poses: poses.to_owned(), options: LiveOptions::default() }
    }

    /// Makes the paths of existing files absolute, independent of the working directory.
    pub fn absolute(self) -> Self {
        let absolute_path = |path: &str| {
            if !Path::new(path).exists() {
                return path.to_owned();
            }
            std::path::absolute(path).map_or_else(|_| path.to_owned(), |path| path.display().to_string())
        };
        let poses = match self.poses.split_once(':') {
            Some((kind @ ("tags" | "file"), path)) => format!("{kind}:{}", absolute_path(path)),
            _ => self.poses.clone(),
        };
        Self { camera: absolute_path(&self.camera), poses, ..self }
    }

    /// Name for display.
    pub fn name(&self) -> String {
        let name = Path::new(&self.camera).file_name().unwrap_or(self.camera.as_ref());
        format!("camera {}", name.to_string_lossy())
    }
}

/// Largest accepted delay, seconds. Larger ones indicate unrelated clocks.
const MAX_DELAY_S: f64 = 60.0;

impl LiveOptions {
    /// Parses `WIDTHxHEIGHT`, such as `640x480`.
    pub fn parse_size(text: &str) -> Result<(u32, u32), String> {
        let side = |text: &str| text.parse().ok().filter(|side| (16..=16384).contains(side));
        let sides = text.split_once('x').and_then(|(w, h)| Some((side(w)?, side(h)?)));
        sides.ok_or_else(|| "expected WIDTHxHEIGHT, as in 640x480".to_owned())
    }

    pub fn parse_rate_hz(text: &str) -> Result<f64, String> {
        let rate = text.parse().ok().filter(|rate| (0.1..=1000.0).contains(rate));
        rate.ok_or_else(|| "expected a number from 0.1 to 1000".to_owned())
    }

    pub fn parse_delay(text: &str) -> Result<DelayMode, String> {
        let fixed = || text.parse().ok().filter(|s: &f64| s.abs() <= MAX_DELAY_S).map(DelayMode::Fixed);
        let added = if text == "auto" { Some(DelayMode::Estimated) } else { fixed() };
        added.ok_or_else(|| "expected seconds from -60 to 60, or auto".to_owned())
    }

    /// Parses a time constant, seconds.
    pub fn parse_time_constant_s(text: &str) -> Result<f64, String> {
        let tau_s = text.parse().ok().filter(|tau_s| *tau_s >= 1e-3 && *tau_s <= MAX_TIME_CONSTANT_S);
        tau_s.ok_or_else(|| format!("expected seconds from 0.001 to {MAX_TIME_CONSTANT_S}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_with_absolute_paths_is_independent_of_the_working_directory() {
        let from = LiveSpec::new("Cargo.toml", "tags:src/lib.rs").absolute();
        let here = std::env::current_dir().unwrap();
        assert_eq!(from.camera, here.join("Cargo.toml").display().to_string());
        assert_eq!(from.poses, format!("tags:{}", here.join("src/lib.rs").display()));
        assert_eq!(from.name(), "camera Cargo.toml");
        let from = LiveSpec::new("0", "opentrackio://:7").absolute();
        assert_eq!((from.name().as_str(), from.poses.as_str()), ("camera 0", "opentrackio://:7"));
    }

    #[test]
    fn spec_round_trips_and_one_without_options_is_read() {
        let options = LiveOptions {
            driver: Some(DriverName::Nokhwa),
            size: Some((1280, 720)),
            rate_hz: Some(29.97),
            layout: Some(Layout::Nv12),
            range: Some(ColorRange::Full),
            matrix: Some(ColorMatrix::Bt709),
            delay: DelayMode::Fixed(-0.04),
            smooth_s: Some(0.05),
        };
        let from = LiveSpec { options, ..LiveSpec::new("0", "tags") };
        let text = serde_json::to_string(&from).unwrap();
        assert_eq!(serde_json::from_str::<LiveSpec>(&text).unwrap(), from);
        let older: LiveSpec = serde_json::from_str(r#"{"camera": "0", "poses": "tags"}"#).unwrap();
        assert_eq!(older, LiveSpec::new("0", "tags"));
    }

    #[test]
    fn options_are_parsed_or_refused_with_the_accepted_range() {
        assert_eq!(LiveOptions::parse_size("1280x720"), Ok((1280, 720)));
        assert_eq!(
            [LiveOptions::parse_delay("auto"), LiveOptions::parse_delay("-0.04")],
            [Ok(DelayMode::Estimated), Ok(DelayMode::Fixed(-0.04))]
        );
        assert_eq!(
            (LiveOptions::parse_rate_hz("29.97"), LiveOptions::parse_time_constant_s("0.05")),
            (Ok(29.97), Ok(0.05))
        );
        for refused in [
            LiveOptions::parse_size("8x8").unwrap_err(),
            LiveOptions::parse_rate_hz("0").unwrap_err(),
            LiveOptions::parse_delay("61").unwrap_err(),
            LiveOptions::parse_time_constant_s("0").unwrap_err(),
            LiveOptions::parse_time_constant_s("NaN").unwrap_err(),
        ] {
            assert!(refused.contains("expected"), "{refused}");
        }
    }
}
