//! What a depth sensor gets wrong, in numbers: as asked one by one, or of a sensor that was measured.

use super::flaws::{DepthSensorModel, Flaws};

/// Everything that is wrong with depth. All 0: nothing. Lengths in the map are px of one that is 640 wide.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DepthErrors {
    /// How far right of the sensor's camera its projector stands, m.
    pub projector_m: f64,
    /// How far left of the frames' camera the sensor's camera stands, of a map in the frames' view, m.
    pub moved_m: f64,
    /// The least light that makes depth, 1/m².
    pub faintest_per_m2: f64,
    /// How much wider near things are, each side, px.
    pub wider_px: f64,
    /// How far edges are torn, rms, px.
    pub torn_px: f64,
    /// The σ of what makes neighbours alike, px.
    pub grain_px: f64,
    /// Noise of 1/depth, rms, 1/m: for z² · n = σ of depth.
    pub noise_per_m: f64,
    /// Steps of 1/depth, 1/m.
    pub step_per_m: f64,
    /// Shares of lone pixels without depth, and with any.
    pub missing_share: f64,
    pub wrong_share: f64,
}

/// Kinect v1, in TUM RGB-D's fr1/rpy (18 to 90 of its maps) where nothing else is said.
///
/// A structured-light sensor measures disparity, d = f·b/z px, with f = 580 px and b = 75 mm, in steps of ⅛ px (Khoshelham and
/// Elberink 2012). So 1/z has steps of 0.125 / (580 · 0.075) = 2.87e-3 /m, and z of z² · 2.87 mm: the maps have 2.81 to 2.89 mm from
/// 0.8 to 3.5 m. Their σ is z² · 1.43 mm, steps included. A step's own is 2.87 / √12 = 0.83 mm, which leaves
/// √(1.43² − 0.83²) = 1.17 mm; planes in the maps have 1.3 to 1.7 mm, and residuals correlated by 0.58, 0.40, 0.26, 0.15 and 0 at 1, 2,
/// 3, 4 and 6 px.
const KINECT: DepthErrors = DepthErrors {
    projector_m: 0.075,
    // The colour camera stands 25 mm right of the infrared one. Holes left of near things are 17 to 23 px·m wide, times the
    // difference of 1/z, right of them 10: as 50 and 25 mm are, less what near things are wider.
    moved_m: 0.025,
    // Where red is below 2 % of the brightest, some 0.9 m away, 40 % have no depth, at 2 to 4 % 21 %, above 30 % 0.8 %.
    faintest_per_m2: 0.012,
    // Near things end 1 to 6 px beyond the picture's edges, 3.8 on average over the four sides; holes are 2 to 4 px narrower than
    // the shade.
    wider_px: 3.0,
    // Straight edges: 1.1 to 1.9 px rms by their direction, alike along them by 0.80, 0.62, 0.45, 0.30 and 0.1 at 1, 2, 3, 4, 6 px.
    torn_px: 1.5,
    grain_px: 2.2,
    noise_per_m: 1.17e-3,
    step_per_m: 2.87e-3,
    // Among whole neighbourhoods: 1.3e-4 and 3e-6.
    missing_share: 1.3e-4,
    wrong_share: 3e-6,
};

impl DepthErrors {
    pub fn is_any(&self) -> bool {
        Self { grain_px: 0.0, ..*self } != Self::default()
    }
}

impl Flaws {
    /// What depth has wrong.
    pub fn depth_errors(&self) -> DepthErrors {
        let of = match self.depth_sensor {
            Some(DepthSensorModel::Kinect) => KINECT,
            None => DepthErrors::default(),
        };
        let metres = |own_mm: Option<f64>, else_m: f64| own_mm.map_or(else_m, |mm| 1e-3 * mm);
        DepthErrors {
            projector_m: metres(self.depth_projector_mm, of.projector_m),
            moved_m: metres(self.depth_moved_mm, of.moved_m),
            faintest_per_m2: self.depth_faintest_per_m2.unwrap_or(of.faintest_per_m2),
            wider_px: self.depth_wider_px.unwrap_or(of.wider_px),
            torn_px: self.depth_torn_px.unwrap_or(of.torn_px),
            grain_px: self.depth_grain_px.unwrap_or(of.grain_px),
            // A depth off by n·z² is 1/z off by n.
            noise_per_m: metres(self.depth_noise_mm, of.noise_per_m),
            step_per_m: metres(self.depth_step_mm, of.step_per_m),
            missing_share: self.depth_missing_share.unwrap_or(of.missing_share),
            wrong_share: self.depth_wrong_share.unwrap_or(of.wrong_share),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sensor_has_its_numbers_but_for_those_that_are_given() {
        assert!(!Flaws { depth_grain_px: Some(2.0), ..Flaws::default() }.depth_errors().is_any());
        let kinect = Flaws { depth_sensor: Some(DepthSensorModel::Kinect), ..Flaws::default() };
        assert_eq!(kinect.depth_errors(), KINECT);
        let smooth = Flaws { depth_noise_mm: Some(0.0), depth_projector_mm: Some(-30.0), ..kinect };
        assert_eq!(smooth.depth_errors(), DepthErrors { noise_per_m: 0.0, projector_m: -0.03, ..KINECT });
        let alone = Flaws { depth_step_mm: Some(2.0), ..Flaws::default() }.depth_errors();
        assert_eq!(alone, DepthErrors { step_per_m: 2e-3, ..DepthErrors::default() });
    }

    #[test]
    fn a_kinects_steps_and_noise_are_those_of_an_eighth_of_a_pixel() {
        let step = 0.125 / (580.0 * 0.075);
        assert!((KINECT.step_per_m / step - 1.0).abs() < 2e-3);
        let whole = (KINECT.noise_per_m.powi(2) + step * step / 12.0).sqrt();
        assert!((whole / crate::depth::SENSOR_ERROR - 1.0).abs() < 0.01, "{whole}");
    }
}
