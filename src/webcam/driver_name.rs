//! The drivers, by their names.

use std::fmt;

use serde::{Deserialize, Serialize};

/// The drivers, by the names that `--driver` takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum DriverName {
    /// Video4Linux.
    V4l2,
    /// The nokhwa crate: Media Foundation, AVFoundation, Video4Linux.
    Nokhwa,
    /// A video file in place of a camera.
    Played,
}

impl DriverName {
    /// The drivers of cameras on this system, the default first.
    pub const AVAILABLE: &'static [Self] = if !cfg!(feature = "camera") {
        &[]
    } else if cfg!(target_os = "linux") {
        &[Self::V4l2, Self::Nokhwa]
    } else {
        &[Self::Nokhwa]
    };

    pub fn name(self) -> &'static str {
        match self {
            Self::V4l2 => "v4l2",
            Self::Nokhwa => "nokhwa",
            Self::Played => "played",
        }
    }

    /// A driver of cameras, by its name.
    pub fn of_name(name: &str) -> Option<Self> {
        [Self::V4l2, Self::Nokhwa].into_iter().find(|driver| driver.name() == name)
    }

    /// Splits `DRIVER:CAMERA`. Any other text is a camera without a driver.
    pub fn split(text: &str) -> (Option<Self>, &str) {
        let parts = text.split_once(':').and_then(|(name, camera)| Some((Self::of_name(name)?, camera)));
        parts.map_or((None, text), |(driver, camera)| (Some(driver), camera))
    }
}

impl fmt::Display for DriverName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn camera_text_is_split_at_a_drivers_name_alone() {
        assert_eq!(DriverName::split("nokhwa:0"), (Some(DriverName::Nokhwa), "0"));
        assert_eq!(DriverName::split("v4l2:/dev/video1"), (Some(DriverName::V4l2), "/dev/video1"));
        for text in ["0", "C:\\video.mp4", "played:x", "a:b"] {
            assert_eq!(DriverName::split(text), (None, text));
        }
    }
}
