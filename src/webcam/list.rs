//! The cameras of this machine.

use std::fmt;

use super::driver_name::DriverName;
use super::picture::Layout;
use crate::text::fixed;

/// A size in which a camera gives pictures.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraMode {
    /// Four letters by which its driver names the layout.
    pub code: String,
    /// `None` if it is not read here.
    pub layout: Option<Layout>,
    /// Smallest and largest, px; mostly the same.
    pub sizes: [(u32, u32); 2],
    /// Pictures a second, the slowest and the fastest of each step first to last.
    pub rates_hz: Vec<f64>,
}

impl fmt::Display for CameraMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.layout {
            Some(layout) => write!(f, "{layout} ")?,
            None => write!(f, "{} ", self.code)?,
        }
        let [min, max] = self.sizes;
        write!(f, "{}x{}", min.0, min.1)?;
        if min != max {
            write!(f, " to {}x{}", max.0, max.1)?;
        }
        let rates: Vec<String> = self.rates_hz.iter().map(|rate| fixed(*rate, 2)).collect();
        match rates.as_slice() {
            [] => Ok(()),
            rates => write!(f, " at {} Hz", rates.join(", ")),
        }
    }
}

/// A camera, or a device that may be one.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraListing {
    pub driver: DriverName,
    /// The number by which `--camera` selects it.
    pub number: usize,
    /// Device of the camera, or the system's description of it.
    pub place: String,
    pub name: String,
    /// Modes of the camera, or the reason why they are unknown.
    pub modes: Result<Vec<CameraMode>, String>,
}
