//! How bright a frame's scene is, and with which settings the frame was taken.

use super::{Shot, ShotError};
use crate::camera::exposure::ExposureSettings;
use crate::camera::metering::{Limits, PictureLight};
use crate::profile::Rig;

/// The default film speed: EVs are usually given for it.
pub const USUAL_ISO: f64 = 100.0;

/// Aperture, time (seconds) and film speed, as far as they are known.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Known {
    pub f_number: Option<f64>,
    pub time_s: Option<f64>,
    pub iso: Option<f64>,
}

impl Known {
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
        named.into_iter().filter(|(known, _)| known.is_none()).map(|(_, name)| name).collect()
    }
}

/// The light on the scene, and how it is known.
#[derive(Clone, Copy, Debug)]
pub struct SceneLight {
    pub lux: f64,
    /// `None` if the light was given.
    pub picture: Option<PictureLight>,
}

impl Shot {
    /// The settings with which a frame was taken, as opened. `Given::sets` overrides the picture's own data, which
    /// overrides profiles.
    pub fn taken(&self, frame: usize) -> Known {
        let said = self.recording.exposure.get(frame).copied().unwrap_or_default();
        let photo = said.photo;
        let recorded = Known { f_number: photo.f_number, time_s: photo.time_s.or(said.time_s), iso: photo.iso };
        self.said_by(&self.by_sets, frame).or(recorded).or(self.said_by(&self.by_profile, frame))
    }

    /// An instant or a pinhole does not count as an exposure.
    fn said_by(&self, rig: &Rig, frame: usize) -> Known {
        let time_s = rig.exposure.time_s.filter(|t| *t > 0.0);
        // If a diameter was given instead, the lens converts it.
        let geometry = rig.geometry_over(self.recording.geometry_at_frame(frame));
        let lens = geometry.and_then(|geometry| rig.lens.thin_lens(&geometry).ok().flatten());
        let f_number = rig.lens.f_number.or(lens.map(|lens| lens.f_number()));
        Known { f_number, time_s, iso: rig.exposure.iso }
    }

    /// The light on a frame's scene: as given (lux), or else from its picture and the settings with which it was taken.
    pub fn scene_light(&self, frame: usize, lux: Option<f64>) -> Result<SceneLight, ShotError> {
        if let Some(lux) = lux {
            return Ok(SceneLight { lux, picture: None });
        }
        let taken = self.taken(frame);
        let settings = taken.settings().ok_or_else(|| ShotError::NoLight { frame, missing: taken.missing() })?;
        let picture = PictureLight::of(&self.read(frame)?.pixels, &self.rig.response);
        let lux = settings.illuminance_of_picture_lx(picture.mean).ok_or(ShotError::Black { frame })?;
        Ok(SceneLight { lux, picture: Some(picture) })
    }

    /// The range of a camera that takes a frame anew: a usual lens's, extended by the person's own aperture.
    pub fn limits(&self, frame: usize, f_number: Option<f64>) -> Limits {
        let mut limits = Limits::default();
        if let Some(f_number) = f_number {
            limits.widest_f_number = limits.widest_f_number.min(f_number);
            limits.narrowest_f_number = limits.narrowest_f_number.max(f_number);
        }
        match self.given_geometry_at(frame) {
            Some(geometry) => {
                // The focal length on 35 mm film, by the longer side of the picture.
                let i = &geometry.intrinsics;
                limits.for_focal_length(36.0 * i.fx_px / f64::from(i.width_px.max(i.height_px)))
            }
            None => limits,
        }
    }
}
