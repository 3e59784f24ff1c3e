//! Report of a calibrated camera.

use std::fmt;

use super::calibration::CameraCalibration;
use super::missing::{distance, tilt_deg};
use super::parameter::Parameter;
use crate::calibrate::board::DetectedTarget;
use crate::params::Field;
use crate::text::{count, fixed, millimetres};

impl Parameter {
    /// Decimal places that show two digits of the standard deviation.
    pub fn digits(&self) -> usize {
        if self.sigma > 0.0 { (1.0 - self.sigma.log10().floor()).clamp(0.0, 8.0) as usize } else { 6 }
    }

    /// Value and standard deviation, with two digits of the latter.
    pub fn shown(&self) -> String {
        let digits = self.digits();
        format!("{} ± {}", fixed(self.value, digits), fixed(self.sigma, digits))
    }

    /// The profile's table of the parameter.
    pub fn table(&self) -> &'static str {
        if self.name.ends_with("_px") { "camera" } else { "camera.distortion" }
    }
}

impl CameraCalibration {
    /// Number of views and corners and the residual, in one line.
    pub fn origin(&self) -> String {
        let corners: usize = self.views.iter().map(|view| view.detection.corners_px.len()).sum();
        let board = match self.target {
            DetectedTarget::Chessboard(board) => format!("a board of {board} corners, {corners} in all"),
            DetectedTarget::Tags(tags) => format!("a board of {}, {corners} corners in all", count(tags, "tag")),
        };
        format!("{} of {board}: rms {} px", count(self.views.len(), "view"), fixed(self.rms_px, 3))
    }

    /// The parameters with their standard deviations, in one line.
    pub fn deviations(&self) -> String {
        let one = |parameter: &Parameter| format!("{} {}", parameter.name, parameter.shown());
        self.parameters.iter().map(one).collect::<Vec<_>>().join(", ")
    }

    /// A length in squares, in millimetres if the square's side is known.
    fn length(&self, squares: f64) -> String {
        match self.unit_mm {
            Some(mm) => millimetres(1e-3 * mm * squares),
            None => format!("{} squares", fixed(squares, 1)),
        }
    }
}

impl fmt::Display for CameraCalibration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "views      {}", self.origin())?;
        writeln!(f, "residuals  half of them below {} px", fixed(self.median_px, 3))?;
        writeln!(f, "camera.distortion.model = {}", self.geometry.distortion.model.to_value())?;
        for parameter in &self.parameters {
            writeln!(f, "{}.{} = {}", parameter.table(), parameter.name, parameter.shown())?;
        }
        for ((view, stand), residuals) in self.views.iter().zip(&self.stands).zip(&self.residuals_px) {
            let squares: f64 = residuals.iter().map(|r| r.length_squared()).sum();
            let rms = (squares / residuals.len().max(1) as f64).sqrt();
            let corners = view.detection.corners_px.len();
            let part =
                if corners < self.target.corners() { format!(" of {}", self.target.corners()) } else { String::new() };
            writeln!(
                f,
                "view       {}: {corners}{part} corners, rms {} px, tilted by {}°, {} away",
                view.name,
                fixed(rms, 2),
                fixed(tilt_deg(stand).length(), 0),
                self.length(distance(&view.detection, stand))
            )?;
        }
        for refused in &self.refused {
            writeln!(f, "refused    {}: {}", refused.name, refused.reason)?;
        }
        for missing in &self.missing {
            writeln!(f, "missing    {missing}")?;
        }
        for note in &self.notes {
            writeln!(f, "note       {note}")?;
        }
        Ok(())
    }
}
