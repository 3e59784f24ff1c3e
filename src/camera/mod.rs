//! The camera: geometry, shutter, response and noise, as pure physics. No GPU, no files.

mod distortion;
mod geometry;
mod noise;
mod response;

pub use distortion::Distortion;
pub use geometry::{Geometry, Intrinsics};
pub use noise::{NoiseBin, NoiseProfile};
pub use response::{Curve, Response};

crate::params! {
    /// The lens, where it is known.
    pub struct Lens in "camera.lens" {
        "diameter of the opening; instead of f_number"
        aperture_diameter_mm: Option<f64> = None, "mm", 0.0..=500.0;
        "focal length over diameter; instead of aperture_diameter_mm"
        f_number: Option<f64> = None, "1", 0.5..=256.0;
        "distance that is sharp"
        focus_distance_m: Option<f64> = None, "m", 0.01..=100000.0;
        "number of aperture blades, 0 for a circle"
        blades: u32 = 0, "1", 0.0..=32.0;
    }
}

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

/// A camera: what is measured of it once and holds for all its frames.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Camera {
    pub geometry: Option<Geometry>,
    pub lens: Lens,
    pub exposure: Exposure,
    pub response: Response,
    pub noise: Option<NoiseProfile>,
}
