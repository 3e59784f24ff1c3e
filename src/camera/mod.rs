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

/// A camera: what is measured once and holds for all its frames.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Camera {
    pub geometry: Option<Geometry>,
    pub lens: Lens,
    pub exposure: CameraExposure,
    pub response: Response,
    pub noise: Option<NoiseProfile>,
}

#[cfg(test)]
mod tests {
    pub fn close(found: f64, expected: f64, within: f64) {
        assert!((found - expected).abs() <= within, "{found} is not {expected}");
    }
}
