//! The camera: lens, film, shutter, exposure, geometry, response and noise, as pure physics. No
//! GPU, no files.

pub mod accumulation;
mod aperture;
mod capture;
mod crop;
pub mod curved;
mod distortion;
pub mod exposure;
pub mod falloff;
mod film;
mod geometry;
pub mod grain;
mod intrinsics;
mod lens;
mod lens_map;
pub mod metering;
mod noise;
mod primaries;
pub mod projection;
mod response;
mod response_table;
pub mod stops;
mod thin_lens;

pub use aperture::Aperture;
pub use capture::{Capture, FilmOverride, SummedExposure};
pub use crop::Crop;
pub use distortion::{Distortion, LensModel};
pub use exposure::CameraExposure;
pub use film::{Film, FilmError, LensType};
pub use geometry::Geometry;
pub use intrinsics::Intrinsics;
pub use lens::{Lens, LensError, Opening};
pub use lens_map::{BoundMap, FitError, LensMap, MapSample, fit as fit_lens_map};
pub use noise::{NoiseBin, NoiseProfile, correlations, side_tap, variance_left};
pub use primaries::Primaries;
pub use response::{Curve, Levels, Response};
pub use response_table::ResponseTable;
pub use thin_lens::{Sharpness, ThinLens, ThinLensError};

use crate::frame::FrameLens;

/// Calibrated parameters of a camera, valid for all its frames.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Camera {
    pub geometry: Option<Geometry>,
    pub lens: Lens,
    pub exposure: CameraExposure,
    pub response: Response,
    pub noise: Option<NoiseProfile>,
    /// Parameters that individual frames override.
    #[serde(skip)]
    pub frame_overrides: FrameOverrides,
}

/// Camera parameters overridden by frames with a known lens ([`FrameLens`]).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameOverrides {
    /// Aperture diameter.
    pub opening: bool,
    pub focus: bool,
    /// Exposure time.
    pub exposure: bool,
}

impl Camera {
    /// The lens at a frame's time. A frame's aperture is used only with a known focus: focused at
    /// infinity, all near objects would be blurred.
    pub fn lens_in(&self, frame: &FrameLens) -> Lens {
        let mut lens = self.lens.clone();
        if let Some(focus_distance_m) = frame.focus_distance_m.filter(|_| self.frame_overrides.focus) {
            lens.focus_distance_m = Some(focus_distance_m);
        }
        let is_focused = lens.focus_distance_m.is_some();
        if let Some(f_number) = frame.f_number.filter(|_| self.frame_overrides.opening && is_focused) {
            (lens.f_number, lens.aperture_diameter_mm) = (Some(f_number), None);
        }
        lens
    }
}

#[cfg(test)]
mod tests {
    pub fn close(actual: f64, expected: f64, within: f64) {
        assert!((actual - expected).abs() <= within, "{actual} is not {expected}");
    }
}
