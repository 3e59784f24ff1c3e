//! Exposure time of a recorded frame.

use super::Settings;
use crate::camera::Camera;
use crate::camera::exposure::assumed_exposure_s;
use crate::frame::FrameExposure;

/// Exposure time of each of a frame's rows, and its source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExposureTime {
    pub s: f64,
    pub source: ExposureSource,
}

/// Sources of a frame's exposure time, in order of precedence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExposureSource {
    /// Reported by a tracked camera, if the camera follows it and the settings do not overrule it.
    Tracked,
    /// The camera's shutter angle and the interval to the next frame.
    ShutterAngle,
    /// Recorded with the frame, unless the settings overrule it.
    Recorded,
    /// The camera's exposure time.
    Camera,
    /// Estimated from the frame's motion blur.
    MotionBlur,
    /// Assumed: a shutter angle of 180°, at most 1/60 s.
    Assumed,
}

impl ExposureTime {
    pub fn of_frame(camera: &Camera, settings: &Settings, frame: &FrameExposure, interval_s: f64) -> Self {
        let is_overruled = settings.overrule_recorded_exposure;
        let follows = camera.frame_overrides.exposure && !is_overruled;
        let by_angle_s = camera.exposure.shutter_angle_deg.map(|deg| deg / 360.0 * interval_s);
        let sources = [
            (ExposureSource::Tracked, frame.lens.exposure_s.filter(|_| follows)),
            (ExposureSource::ShutterAngle, by_angle_s),
            (ExposureSource::Recorded, frame.time_s.filter(|_| !is_overruled)),
            (ExposureSource::Camera, camera.exposure.time_s),
            (ExposureSource::MotionBlur, frame.blur_estimate_s),
        ];
        let first = sources.into_iter().find_map(|(source, s)| Some(Self { s: s?, source }));
        first.unwrap_or(Self { s: assumed_exposure_s(interval_s), source: ExposureSource::Assumed })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::FrameOverrides;
    use crate::frame::FrameLens;

    #[test]
    fn sources_precede_each_other_in_the_order_of_their_declaration() {
        let mut camera = Camera::default();
        (camera.exposure.time_s, camera.exposure.shutter_angle_deg) = (Some(0.03), Some(72.0));
        camera.frame_overrides = FrameOverrides { exposure: true, ..FrameOverrides::default() };
        let lens = FrameLens { exposure_s: Some(0.01), ..FrameLens::default() };
        let mut frame = FrameExposure { time_s: Some(0.02), blur_estimate_s: Some(0.04), lens, ..Default::default() };
        let mut settings = Settings::default();
        let resolved = |camera: &Camera, settings: &Settings, frame: &FrameExposure| {
            let ExposureTime { s, source } = ExposureTime::of_frame(camera, settings, frame, 0.1);
            (source, s)
        };
        assert_eq!(resolved(&camera, &settings, &frame), (ExposureSource::Tracked, 0.01));
        camera.frame_overrides.exposure = false;
        assert_eq!(resolved(&camera, &settings, &frame), (ExposureSource::ShutterAngle, 72.0 / 360.0 * 0.1));
        camera.exposure.shutter_angle_deg = None;
        assert_eq!(resolved(&camera, &settings, &frame), (ExposureSource::Recorded, 0.02));
        settings.overrule_recorded_exposure = true;
        camera.frame_overrides.exposure = true;
        assert_eq!(resolved(&camera, &settings, &frame), (ExposureSource::Camera, 0.03));
        camera.exposure.time_s = None;
        assert_eq!(resolved(&camera, &settings, &frame), (ExposureSource::MotionBlur, 0.04));
        frame.blur_estimate_s = None;
        assert_eq!(resolved(&camera, &settings, &frame), (ExposureSource::Assumed, 1.0 / 60.0));
        let short = ExposureTime::of_frame(&camera, &settings, &frame, 0.02);
        assert_eq!(short, ExposureTime { s: 0.01, source: ExposureSource::Assumed });
    }
}
