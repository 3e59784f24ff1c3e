//! The illuminance of a frame's scene, and the exposure settings of the frame.

use super::{Shot, ShotError};
use crate::camera::exposure::ExposureSettings;
use crate::camera::metering::{Limits, PictureLight};
use crate::profile::Rig;

/// Default film speed: exposure values are usually given for it.
pub const DEFAULT_ISO: f64 = 100.0;

/// Aperture, exposure time (s) and film speed, each if known.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PartialExposure {
    pub f_number: Option<f64>,
    pub time_s: Option<f64>,
    pub iso: Option<f64>,
}

impl PartialExposure {
    pub fn or(self, other: Self) -> Self {
        Self {
            f_number: self.f_number.or(other.f_number),
            time_s: self.time_s.or(other.time_s),
            iso: self.iso.or(other.iso),
        }
    }

    pub fn settings(self) -> Option<ExposureSettings> {
        let settings = ExposureSettings { f_number: self.f_number?, time_s: self.time_s?, iso: self.iso? };
        Some(settings.exact())
    }

    pub fn missing(self) -> Vec<&'static str> {
        let named = [(self.f_number, "the f-number"), (self.time_s, "the shutter time"), (self.iso, "the film speed")];
        named.into_iter().filter(|(value, _)| value.is_none()).map(|(_, name)| name).collect()
    }
}

/// The illuminance of the scene, and its source.
#[derive(Clone, Copy, Debug)]
pub struct SceneLight {
    pub lux: f64,
    /// `None` if the light was given.
    pub picture: Option<PictureLight>,
}

impl Shot {
    /// The exposure settings of a frame. `ShotOptions::sets` overrides the picture's metadata,
    /// which overrides profiles.
    pub fn exposure_settings(&self, frame: usize) -> PartialExposure {
        let exposure = self.recording.exposure.get(frame).copied().unwrap_or_default();
        let photo = exposure.photo;
        let recorded =
            PartialExposure { f_number: photo.f_number, time_s: photo.time_s.or(exposure.time_s), iso: photo.iso };
        let above = self.exposure_of_rig(&self.layers.rig_over_profiles(), frame);
        above.or(recorded).or(self.exposure_of_rig(self.layers.rig_of_profiles(), frame))
    }

    /// Exposure time 0 and a pinhole count as unknown.
    fn exposure_of_rig(&self, rig: &Rig, frame: usize) -> PartialExposure {
        let time_s = rig.exposure.time_s.filter(|t| *t > 0.0);
        // The lens converts an aperture diameter to an f-number.
        let geometry = rig.geometry_over(self.recording.geometry_at_frame(frame));
        let lens = geometry.and_then(|geometry| rig.lens.thin_lens(&geometry).ok().flatten());
        let f_number = rig.lens.f_number.or(lens.map(|lens| lens.f_number()));
        PartialExposure { f_number, time_s, iso: rig.exposure.iso }
    }

    /// The illuminance of a frame's scene: the given one (lux), or else estimated from its picture
    /// and its exposure settings.
    pub fn scene_light(&self, frame: usize, lux: Option<f64>) -> Result<SceneLight, ShotError> {
        if let Some(lux) = lux {
            return Ok(SceneLight { lux, picture: None });
        }
        let exposure = self.exposure_settings(frame);
        let settings = exposure.settings().ok_or_else(|| ShotError::NoLight { frame, missing: exposure.missing() })?;
        let picture = PictureLight::of(&self.read(frame)?.pixels, &self.rig.response);
        let lux = settings.illuminance_of_picture_lx(picture.mean).ok_or(ShotError::Black { frame })?;
        Ok(SceneLight { lux, picture: Some(picture) })
    }

    /// The exposure limits for re-exposing a frame: those of a usual lens, extended by the user's
    /// f-number.
    pub fn limits(&self, frame: usize, f_number: Option<f64>) -> Limits {
        let mut limits = Limits::default();
        if let Some(f_number) = f_number {
            limits.widest_f_number = limits.widest_f_number.min(f_number);
            limits.narrowest_f_number = limits.narrowest_f_number.max(f_number);
        }
        match self.known_geometry_at(frame) {
            Some(geometry) => {
                // The focal length on 35 mm film, by the longer side of the picture.
                let i = &geometry.intrinsics;
                limits.for_focal_length(36.0 * i.fx_px / f64::from(i.width_px.max(i.height_px)))
            }
            None => limits,
        }
    }
}
