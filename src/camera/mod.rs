//! The camera: lens, film, shutter, exposure, geometry, response and noise, as pure physics. No GPU, no files.

pub mod accumulation;
mod aperture;
mod capture;
pub mod curved;
mod distortion;
pub mod exposure;
pub mod falloff;
mod film;
mod framed;
mod geometry;
pub mod grain;
mod lens;
pub mod metering;
mod noise;
pub mod projection;
mod response;
pub mod stops;
mod thin_lens;

pub use aperture::Aperture;
pub use capture::{Capture, FilmUsed, Summed};
pub use distortion::{Distortion, LensModel};
pub use exposure::CameraExposure;
pub use film::{Film, FilmError, LensType};
pub use framed::Framed;
pub use geometry::{Geometry, Intrinsics};
pub use lens::{Lens, LensError, Opening};
pub use noise::{NoiseBin, NoiseProfile, correlations, side_tap, variance_left};
pub use response::{Curve, Response};
pub use thin_lens::{Sharpness, ThinLens, ThinLensError};

use crate::frame::FrameLens;

/// A camera: what is measured once and holds for all its frames.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Camera {
    pub geometry: Option<Geometry>,
    pub lens: Lens,
    pub exposure: CameraExposure,
    pub response: Response,
    pub noise: Option<NoiseProfile>,
    /// What of it frames may say otherwise.
    #[serde(skip)]
    pub follows: Follows,
}

/// What a frame that knows its lens ([`FrameLens`]) says in place of the camera.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Follows {
    /// How wide it is open.
    pub opening: bool,
    pub focus: bool,
    /// How long it is open.
    pub exposure: bool,
}

impl Camera {
    /// The lens in a frame's moment. An opening counts only where it is known what is sharp: focused at infinity, all that
    /// is near would be blurred.
    pub fn lens_in(&self, frame: &FrameLens) -> Lens {
        let mut lens = self.lens.clone();
        if let Some(focus_distance_m) = frame.focus_distance_m.filter(|_| self.follows.focus) {
            lens.focus_distance_m = Some(focus_distance_m);
        }
        let is_focused = lens.focus_distance_m.is_some();
        if let Some(f_number) = frame.f_number.filter(|_| self.follows.opening && is_focused) {
            (lens.f_number, lens.aperture_diameter_mm) = (Some(f_number), None);
        }
        lens
    }
}

#[cfg(test)]
mod tests {
    pub fn close(found: f64, expected: f64, within: f64) {
        assert!((found - expected).abs() <= within, "{found} is not {expected}");
    }
}
