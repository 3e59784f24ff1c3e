//! What is asked of a camera and of its poses, in the words of `locard live`. Kept, so that a camera that is opened again is
//! asked the same.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::delayed::Added;
use crate::source::video::{ColorMatrix, ColorRange};
use crate::tracking::smooth::LONGEST_S;
use crate::webcam::{DriverName, Layout};

/// What is asked for beyond a camera and a source; nothing need be.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(default)]
pub struct Asked {
    /// Of a camera; this system's default without it.
    pub driver: Option<DriverName>,
    /// Width and height, px; otherwise the profile's, or 640x480.
    pub size: Option<(u32, u32)>,
    /// Pictures a second; 30 without it.
    pub rate_hz: Option<f64>,
    pub layout: Option<Layout>,
    pub range: Option<ColorRange>,
    pub matrix: Option<ColorMatrix>,
    pub delay: Added,
    /// The time constant by which poses from tags are smoothed, seconds; not smoothed without it.
    pub smooth_s: Option<f64>,
}

/// A camera, where its poses come from, and what is asked of both.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct LiveFrom {
    pub camera: String,
    pub poses: String,
    #[serde(default)]
    pub asked: Asked,
}

impl LiveFrom {
    pub fn new(camera: &str, poses: &str) -> Self {
        Self { camera: camera.to_owned(), poses: poses.to_owned(), asked: Asked::default() }
    }

    /// With files named from the root on, so that it holds wherever it is read.
    pub fn absolute(self) -> Self {
        let whole = |path: &str| match Path::new(path).exists() {
            true => std::path::absolute(path).map_or_else(|_| path.to_owned(), |path| path.display().to_string()),
            false => path.to_owned(),
        };
        let poses = match self.poses.split_once(':') {
            Some((kind @ ("tags" | "file"), path)) => format!("{kind}:{}", whole(path)),
            _ => self.poses.clone(),
        };
        Self { camera: whole(&self.camera), poses, ..self }
    }

    /// What a person calls it.
    pub fn name(&self) -> String {
        let name = Path::new(&self.camera).file_name().unwrap_or(self.camera.as_ref());
        format!("camera {}", name.to_string_lossy())
    }
}

/// Longer delays belong to clocks that have nothing to do with each other, seconds.
const LONGEST_DELAY_S: f64 = 60.0;

impl Asked {
    /// `640x480`.
    pub fn size_of(text: &str) -> Result<(u32, u32), String> {
        let side = |text: &str| text.parse().ok().filter(|side| (16..=16384).contains(side));
        let sides = text.split_once('x').and_then(|(w, h)| Some((side(w)?, side(h)?)));
        sides.ok_or_else(|| format!("{text} is refused: accepted is WIDTHxHEIGHT, as in 640x480"))
    }

    pub fn rate_of(text: &str) -> Result<f64, String> {
        let rate = text.parse().ok().filter(|rate| (0.1..=1000.0).contains(rate));
        rate.ok_or_else(|| format!("{text} is refused: accepted is a number from 0.1 to 1000"))
    }

    pub fn delay_of(text: &str) -> Result<Added, String> {
        let told = || text.parse().ok().filter(|s: &f64| s.abs() <= LONGEST_DELAY_S).map(Added::Told);
        let added = if text == "auto" { Some(Added::Found) } else { told() };
        added.ok_or_else(|| format!("{text} is refused: accepted are seconds from -60 to 60, or auto"))
    }

    /// A time constant, seconds.
    pub fn smoothing_of(text: &str) -> Result<f64, String> {
        let tau_s = text.parse().ok().filter(|tau_s| *tau_s >= 1e-3 && *tau_s <= LONGEST_S);
        tau_s.ok_or_else(|| format!("{text} is refused: accepted are seconds from 0.001 to {LONGEST_S}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_choice_holds_wherever_it_is_read() {
        let from = LiveFrom::new("Cargo.toml", "tags:src/lib.rs").absolute();
        let here = std::env::current_dir().unwrap();
        assert_eq!(from.camera, here.join("Cargo.toml").display().to_string());
        assert_eq!(from.poses, format!("tags:{}", here.join("src/lib.rs").display()));
        assert_eq!(from.name(), "camera Cargo.toml");
        let from = LiveFrom::new("0", "opentrackio://:7").absolute();
        assert_eq!((from.name().as_str(), from.poses.as_str()), ("camera 0", "opentrackio://:7"));
    }

    #[test]
    fn all_that_is_asked_for_is_kept_and_older_lists_are_read() {
        let asked = Asked {
            driver: Some(DriverName::Nokhwa),
            size: Some((1280, 720)),
            rate_hz: Some(29.97),
            layout: Some(Layout::Nv12),
            range: Some(ColorRange::Full),
            matrix: Some(ColorMatrix::Bt709),
            delay: Added::Told(-0.04),
            smooth_s: Some(0.05),
        };
        let from = LiveFrom { asked, ..LiveFrom::new("0", "tags") };
        let text = serde_json::to_string(&from).unwrap();
        assert_eq!(serde_json::from_str::<LiveFrom>(&text).unwrap(), from);
        let older: LiveFrom = serde_json::from_str(r#"{"camera": "0", "poses": "tags"}"#).unwrap();
        assert_eq!(older, LiveFrom::new("0", "tags"));
    }

    #[test]
    fn what_a_person_types_is_read_or_refused_with_what_is_accepted() {
        assert_eq!(Asked::size_of("1280x720"), Ok((1280, 720)));
        assert_eq!([Asked::delay_of("auto"), Asked::delay_of("-0.04")], [Ok(Added::Found), Ok(Added::Told(-0.04))]);
        assert_eq!((Asked::rate_of("29.97"), Asked::smoothing_of("0.05")), (Ok(29.97), Ok(0.05)));
        for refused in [
            Asked::size_of("8x8").unwrap_err(),
            Asked::rate_of("0").unwrap_err(),
            Asked::delay_of("61").unwrap_err(),
            Asked::smoothing_of("0").unwrap_err(),
            Asked::smoothing_of("NaN").unwrap_err(),
        ] {
            assert!(refused.contains("is refused: accepted"), "{refused}");
        }
    }
}
