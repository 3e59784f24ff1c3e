//! Error model of a depth sensor: individual parameters, or those of a measured sensor.

use super::flaws::{DepthSensorModel, Flaws};

/// Parameters of all depth errors; all 0: none. Lengths in the map are px of a map that is 640
/// wide.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DepthErrors {
    /// Projector position, right of the sensor's camera, m.
    pub projector_m: f64,
    /// Sensor camera position, left of the frames' camera, of a map registered to the frames' view,
    /// m.
    pub camera_offset_m: f64,
    /// Smallest return that gives a depth, 1/m².
    pub min_return_per_m2: f64,
    /// Dilation of near surfaces, each side, px.
    pub dilation_px: f64,
    /// Displacement of depth edges, rms, px.
    pub edge_jitter_px: f64,
    /// σ of the Gaussian that correlates neighbouring errors, px.
    pub correlation_px: f64,
    /// Noise of 1/depth, rms, 1/m: n gives depth a σ of z² · n.
    pub noise_per_m: f64,
    /// Quantization step of 1/depth, 1/m.
    pub step_per_m: f64,
    /// Share of isolated pixels without depth.
    pub dropout_share: f64,
    pub outlier_share: f64,
}

/// Kinect v1. Figures are from TUM RGB-D's fr1/rpy (18 to 90 of its maps) unless stated otherwise.
///
/// A structured-light sensor measures disparity, d = f·b/z px, with f = 580 px and b = 75 mm, in
/// steps of ⅛ px (Khoshelham and Elberink 2012). So 1/z has steps of 0.125 / (580 · 0.075) =
/// 2.87e-3 /m, and z steps of z² · 2.87 mm: the maps have 2.81 to 2.89 mm from 0.8 to 3.5 m. Their
/// σ is z² · 1.43 mm, steps included. The steps' own σ is 2.87 / √12 = 0.83 mm, which leaves
/// √(1.43² − 0.83²) = 1.17 mm; planes in the maps have 1.3 to 1.7 mm, and residuals correlated by
/// 0.58, 0.40, 0.26, 0.15 and 0 at 1, 2, 3, 4 and 6 px.
const KINECT: DepthErrors = DepthErrors {
    projector_m: 0.075,
    // The colour camera is 25 mm right of the infrared one. Holes left of near objects are 17 to 23
    // px·m wide, times the difference of 1/z; right of them 10. Baselines of 50 and 25 mm give
    // this, minus the dilation of near objects.
    camera_offset_m: 0.025,
    // Where red is below 2 % of the maximum, about 0.9 m away, 40 % have no depth; at 2 to 4 %, 21
    // %; above 30 %, 0.8 %.
    min_return_per_m2: 0.012,
    // Near objects extend 1 to 6 px beyond the picture's edges, 3.8 on average over the four sides;
    // holes are 2 to 4 px narrower than the projector's shadow.
    dilation_px: 3.0,
    // Straight edges: 1.1 to 1.9 px rms, depending on direction; correlation along the edge 0.80,
    // 0.62, 0.45, 0.30 and 0.1 at 1, 2, 3, 4 and 6 px.
    edge_jitter_px: 1.5,
    correlation_px: 2.2,
    noise_per_m: 1.17e-3,
    step_per_m: 2.87e-3,
    // Within otherwise complete neighbourhoods: 1.3e-4 and 3e-6.
    dropout_share: 1.3e-4,
    outlier_share: 3e-6,
};

impl DepthErrors {
    pub fn is_any(&self) -> bool {
        Self { correlation_px: 0.0, ..*self } != Self::default()
    }
}

impl Flaws {
    /// The sensor's errors, overridden by the parameters that are given.
    pub fn depth_errors(&self) -> DepthErrors {
        let of = match self.depth_sensor {
            Some(DepthSensorModel::Kinect) => KINECT,
            None => DepthErrors::default(),
        };
        let metres = |own_mm: Option<f64>, else_m: f64| own_mm.map_or(else_m, |mm| 1e-3 * mm);
        DepthErrors {
            projector_m: metres(self.depth_projector_mm, of.projector_m),
            camera_offset_m: metres(self.depth_moved_mm, of.camera_offset_m),
            min_return_per_m2: self.depth_faintest_per_m2.unwrap_or(of.min_return_per_m2),
            dilation_px: self.depth_wider_px.unwrap_or(of.dilation_px),
            edge_jitter_px: self.depth_torn_px.unwrap_or(of.edge_jitter_px),
            correlation_px: self.depth_grain_px.unwrap_or(of.correlation_px),
            // An error of n·z² in depth is an error of n in 1/z.
            noise_per_m: metres(self.depth_noise_mm, of.noise_per_m),
            step_per_m: metres(self.depth_step_mm, of.step_per_m),
            dropout_share: self.depth_missing_share.unwrap_or(of.dropout_share),
            outlier_share: self.depth_wrong_share.unwrap_or(of.outlier_share),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_parameters_override_those_of_the_sensor() {
        assert!(!Flaws { depth_grain_px: Some(2.0), ..Flaws::default() }.depth_errors().is_any());
        let kinect = Flaws { depth_sensor: Some(DepthSensorModel::Kinect), ..Flaws::default() };
        assert_eq!(kinect.depth_errors(), KINECT);
        let smooth = Flaws { depth_noise_mm: Some(0.0), depth_projector_mm: Some(-30.0), ..kinect };
        assert_eq!(smooth.depth_errors(), DepthErrors { noise_per_m: 0.0, projector_m: -0.03, ..KINECT });
        let alone = Flaws { depth_step_mm: Some(2.0), ..Flaws::default() }.depth_errors();
        assert_eq!(alone, DepthErrors { step_per_m: 2e-3, ..DepthErrors::default() });
    }

    #[test]
    fn kinect_steps_and_noise_match_an_eighth_pixel_disparity_step() {
        let step = 0.125 / (580.0 * 0.075);
        assert!((KINECT.step_per_m / step - 1.0).abs() < 2e-3);
        let whole = (KINECT.noise_per_m.powi(2) + step * step / 12.0).sqrt();
        assert!((whole / crate::depth::SENSOR_ERROR - 1.0).abs() < 0.01, "{whole}");
    }
}
