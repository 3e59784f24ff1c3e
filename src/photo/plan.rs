//! Checks a request before a device is opened and before anything is written.

use super::MOTION_EFFECT;
use super::error::{PhotoError, refused};
use super::exposure_controls::ExposureControls;
use super::framing::{Aim, Framing};
use super::record::record_path;
use super::request::{Bracket, Focus, PhotoRequest};
use super::target::{aim, subject_name};
use crate::camera::exposure::INDOORS_LX;
use crate::camera::{Camera, Geometry};
use crate::depth::measured_from;
use crate::export::Inputs;
use crate::frame::Frame;
use crate::profile::Rig;
use crate::recording::Recording;
use crate::shot::{DEFAULT_ISO, Shot};
use crate::sink::{check_file, photograph};

/// A checked request with the values that follow from it.
pub struct PhotoPlan {
    /// The recorded camera, with the film of the frame's Exif.
    pub recorded_geometry: Geometry,
    pub camera: Camera,
    pub focal_length_m: Option<f64>,
    /// Name of the subject.
    pub subject: Option<String>,
    pub aim: Aim,
    pub dials: ExposureControls,
    /// True if the recording's frames are summed during the exposure.
    pub sums: bool,
    /// Warnings about the request, the recording and the scene.
    pub warnings: Vec<String>,
    recorded_iso: Option<f64>,
}

impl PhotoPlan {
    /// Checks the request, but not its output files: [`PhotoPlan::check_outputs`].
    pub fn new(request: &PhotoRequest, shot: &Shot) -> Result<Self, PhotoError> {
        let index = request.frame;
        shot.check_poses(index..index.saturating_add(1))?;
        let recorded_exposure = shot.exposure_settings(index);
        let recorded_geometry = shot.geometry_at(index)?;
        let in_file_m = shot.recording.exposure.get(index).and_then(|e| e.photo.focal_length_m);
        let recorded_geometry = with_film(recorded_geometry, &shot.rig, in_file_m);
        if recorded_geometry.is_equirectangular() {
            return refused(
                "photographs from 360° pictures are not supported: composite into the recording, and crop the result"
                    .to_owned(),
            );
        }
        let camera = shot.camera();
        camera.lens.opening(&recorded_geometry)?;
        shot.settings.check(&camera, &recorded_geometry)?;
        let focal_length_m = request.focal_length_mm.map(|mm| 1e-3 * mm);
        let subject = subject_name(request, &shot.scene)?;
        let aim = aim(request, &shot.recording, &recorded_geometry, &shot.scene)?;
        check_framing(request, &recorded_geometry, focal_length_m, aim)?;
        let lux = match (request.lux, recorded_exposure.settings()) {
            (None, None) => None,
            _ => Some(shot.scene_light(index, request.lux)?.lux),
        };
        let mut limits = shot.limits(index, request.f_number);
        let sums = request.hand_held && shot.settings.is_on(MOTION_EFFECT);
        let max_shutter_s = if sums { max_shutter_s(&shot.recording, index) } else { f64::INFINITY };
        if let Some(time_s) = request.time_s.filter(|&time_s| time_s > max_shutter_s * 1.001) {
            return refused(format!(
                "--shutter {time_s}: the recording is too short around frame {index}; expected up to \
                 {max_shutter_s:.3} s, or a frame farther from its ends"
            ));
        }
        limits.longest_s = limits.longest_s.min(max_shutter_s);
        let dials = ExposureControls::new(request, recorded_exposure, lux.unwrap_or(INDOORS_LX), limits)?;
        let unknown_light = lux.is_none().then(|| {
            format!(
                "the brightness of the scene is neither in EXIF nor in a profile: {INDOORS_LX} lx is assumed (--lux \
                 sets it)"
            )
        });
        let of_request = unknown_light.into_iter().chain(dials.omission_warning(request.bracket));
        let warnings = of_request.chain(shot.recording.warnings.iter().chain(&shot.scene.warnings).cloned()).collect();
        let recorded_iso = recorded_exposure.iso;
        Ok(Self { recorded_geometry, camera, focal_length_m, subject, aim, dials, sums, warnings, recorded_iso })
    }

    /// Checks that the files of the photographs, and the sheet of a series, may be written.
    pub fn check_outputs(&self, request: &PhotoRequest, shot: &Shot) -> Result<(), PhotoError> {
        let count = self.dials.series(request.bracket).len();
        let inputs = Inputs::of(shot);
        let sheet = request.bracket.map(|_| request.path_of("sheet"));
        for path in (1..=count).map(|n| request.path_of(&n.to_string())).chain(sheet) {
            photograph::check(&path, request.force)?;
            check_file(&record_path(&path), true)?;
            inputs.check_file(&path)?;
        }
        Ok(())
    }

    /// Warnings about the frame's depth and the camera's noise.
    pub fn frame_warnings(&self, request: &PhotoRequest, shot: &Shot, frame: &Frame) -> Vec<String> {
        let mut warnings = Vec::new();
        let depth = frame.depth.as_ref().filter(|_| shot.settings.depth.occlusion);
        let measured = depth.map(|depth| measured_from(depth, &self.recorded_geometry, &shot.recording.track));
        if let Some(Err(why)) = measured {
            warnings.push(format!("real things do not occlude objects: {why}"));
        }
        let has_unknown_speed = self.camera.exposure.iso.or(self.recorded_iso).is_none();
        let needs_speed = request.iso.is_some() || request.bracket == Some(Bracket::Iso);
        if has_unknown_speed && self.camera.noise.is_some() && needs_speed {
            warnings.push(format!(
                "the film speed at which this camera's noise was measured is unknown (camera.exposure.iso): ISO \
                 {DEFAULT_ISO} is assumed"
            ));
        }
        if self.camera.noise.is_none() {
            let text = "this camera's noise is unknown: the photograph has only the recording's grain; measure the \
                        noise (`locard calibrate noise` from pictures of a scene at rest, with --moving from the \
                        recording itself)";
            warnings.push(text.to_owned());
        }
        warnings
    }
}

/// Checks that the recording covers the photograph's field of view.
fn check_framing(
    request: &PhotoRequest,
    recorded_geometry: &Geometry,
    focal_length_m: Option<f64>,
    aim: Aim,
) -> Result<(), PhotoError> {
    let (focus_m, checked_m) = match request.focus {
        Focus::Metres(distance_m) => (distance_m, focal_length_m),
        // The field of view depends on the focus, which is not known yet. A focus series
        // continues to infinity.
        Focus::Auto => (f64::INFINITY, focal_length_m.filter(|_| request.bracket == Some(Bracket::Focus))),
    };
    Framing::aimed(recorded_geometry, request.film, checked_m, focus_m, request.width_px, aim)?;
    Ok(())
}

/// Maximum shutter time, centred on a frame's time, with frames throughout, in seconds: at least
/// one interval, and unlimited if the frames' times are nominal.
fn max_shutter_s(recording: &Recording, frame: usize) -> f64 {
    let times = &recording.timestamps_s;
    let (Some(first), Some(at), Some(last)) = (times.first(), times.get(frame), times.last()) else { return 0.0 };
    let interval_s = recording.frame_interval_s;
    if recording.kind.has_times() { interval_s + 2.0 * (at - first).min(last - at) } else { f64::INFINITY }
}

/// The camera's geometry. If the film's width is not given otherwise, it is set so that the focal
/// length is that of the frame's Exif.
fn with_film(recorded: Geometry, rig: &Rig, focal_length_m: Option<f64>) -> Geometry {
    let Some(focal_length_m) = focal_length_m.filter(|_| !rig.gives_film_width()) else { return recorded };
    let Geometry { mut intrinsics, distortion, .. } = recorded;
    intrinsics.film_width_mm = 1e3 * focal_length_m * f64::from(intrinsics.width_px) / intrinsics.fx_px;
    Geometry::new(intrinsics, distortion)
}
