//! Takes a photograph or a series, from the request to the files.

use std::path::PathBuf;
use std::time::Duration;

use super::MOTION_EFFECT;
use super::error::{PhotoError, refused};
use super::exposure_controls::{ExposureControls, SeriesEntry};
use super::framing::Framing;
use super::record::{next_number, record_path, write_record};
use super::request::{Bracket, Focus, PhotoRequest};
use super::sheet::{contact_sheet, thumbnail};
use super::shoot::PhotoShoot;
use super::shoot_particulars::TakenPhoto;
use super::take::{Photograph, TakeError};
use super::target::{aim, subject_name};
use crate::camera::exposure::INDOORS_LX;
use crate::camera::metering::PictureLight;
use crate::camera::{Geometry, Opening};
use crate::depth::{Rays, consensus_at_frame, measured_from};
use crate::export::Inputs;
use crate::gpu::{Gpu, GpuError};
use crate::label::SourceLabel;
use crate::profile::Rig;
use crate::provenance::{InputDigests, WorkRecord, input_files};
use crate::recording::Recording;
use crate::shot::{DEFAULT_ISO, Note, Shot};
use crate::sink::{SinkError, check_file, photograph};

/// Time between two checks whether the inputs are digested.
const DIGEST_POLL: Duration = Duration::from_millis(30);

/// Events while photographs are taken.
#[derive(Clone, Debug, PartialEq)]
pub enum PhotoEvent {
    Warning(String),
    /// Progress of photograph `number` (from 1) of a series.
    Taking {
        number: usize,
        of: usize,
        share: f64,
    },
    /// A written file, and its exposure settings (empty for a contact sheet).
    Written {
        path: PathBuf,
        settings: String,
    },
}

impl PhotoRequest {
    /// Takes the requested photographs of a shot. All checks are made before a device is requested.
    /// Events are passed to `report`; if it returns `false`, the work ends with
    /// [`TakeError::Cancelled`], and written files are kept.
    pub fn take(
        &self,
        shot: Shot,
        device: impl FnOnce() -> Result<Gpu, GpuError>,
        report: &mut dyn FnMut(PhotoEvent) -> bool,
    ) -> Result<(), PhotoError> {
        let index = self.frame;
        shot.check_poses(index..index.saturating_add(1))?;
        let taken = shot.exposure_settings(index);
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
        let focal_length_m = self.focal_length_mm.map(|mm| 1e-3 * mm);
        let (given_m, checked_m) = match self.focus {
            Focus::Metres(distance_m) => (distance_m, focal_length_m),
            // The field of view depends on the focus, which is not known yet. A focus series
            // continues to infinity.
            Focus::Auto => (f64::INFINITY, focal_length_m.filter(|_| self.bracket == Some(Bracket::Focus))),
        };
        let subject = subject_name(self, &shot.scene)?;
        let aim = aim(self, &shot.recording, &recorded_geometry, &shot.scene)?;
        Framing::aimed(&recorded_geometry, self.film, checked_m, given_m, self.width_px, aim)?;
        let lux = match (self.lux, taken.settings()) {
            (None, None) => None,
            _ => Some(shot.scene_light(index, self.lux)?.lux),
        };
        let mut limits = shot.limits(index, self.f_number);
        let sums = self.hand_held && shot.settings.is_on(MOTION_EFFECT);
        let max_shutter_s = if sums { max_shutter_s(&shot.recording, index) } else { f64::INFINITY };
        if let Some(time_s) = self.time_s.filter(|&time_s| time_s > max_shutter_s * 1.001) {
            return refused(format!(
                "--shutter {time_s}: the recording is too short around frame {index}; expected up to \
                 {max_shutter_s:.3} s, or a frame farther from its ends"
            ));
        }
        limits.longest_s = limits.longest_s.min(max_shutter_s);
        let mut dials = ExposureControls::new(self, taken, lux.unwrap_or(INDOORS_LX), limits)?;
        let count = dials.series(self.bracket).len();
        let left_out = dials.omission_warning(self.bracket);
        let inputs = Inputs::of(&shot);
        for path in (1..=count).map(|n| self.path_of(&n.to_string())).chain(self.bracket.map(|_| self.path_of("sheet")))
        {
            photograph::check(&path, self.force)?;
            check_file(&record_path(&path), true)?;
            inputs.check_file(&path)?;
        }
        let mut send = |event: PhotoEvent| if report(event) { Ok(()) } else { Err(TakeError::Cancelled) };
        let mut warn = |text: String| send(PhotoEvent::Warning(text));
        if lux.is_none() {
            warn(format!(
                "the brightness of the scene is neither in EXIF nor in a profile: {INDOORS_LX} lx is assumed (--lux \
                 sets it)"
            ))?;
        }
        left_out.into_iter().try_for_each(&mut warn)?;
        shot.recording.warnings.iter().chain(&shot.scene.warnings).cloned().try_for_each(&mut warn)?;

        let frame = shot.read_with_neighbours(index)?;
        let depth = frame.depth.as_ref().filter(|_| shot.settings.depth.occlusion);
        if let Some(Err(why)) = depth.map(|depth| measured_from(depth, &recorded_geometry, &shot.recording.track)) {
            warn(format!("real things do not occlude objects: {why}"))?;
        }
        let unknown_speed = camera.exposure.iso.or(taken.iso).is_none();
        if unknown_speed && camera.noise.is_some() && (self.iso.is_some() || self.bracket == Some(Bracket::Iso)) {
            warn(format!(
                "the film speed at which this camera's noise was measured is unknown (camera.exposure.iso): ISO \
                 {DEFAULT_ISO} is assumed"
            ))?;
        }
        if camera.noise.is_none() {
            let text = "this camera's noise is unknown: the photograph has only the recording's grain; measure the \
                        noise (`locard calibrate noise` from pictures of a scene at rest, with --moving from the \
                        recording itself)";
            warn(text.to_owned())?;
        }
        let acts_on_real = shot.settings.acts_on_real();
        let compositor = shot.compositor(device()?);
        compositor.warnings().into_iter().try_for_each(&mut warn)?;
        let mean = PictureLight::of(&frame.pixels, &camera.response).mean;
        let track = &shot.recording.track;
        let rays = Rays::new(&recorded_geometry);
        let depth_m =
            frame.depth.as_ref().and_then(|map| consensus_at_frame(&frame, map, &rays, track, &camera.response));
        let mut work = WorkRecord::begun(&shot, &compositor.gpu().info);
        let input_digests = InputDigests::start(input_files(&shot));
        let mut shoot =
            PhotoShoot { request: self, shot, recorded_geometry, frame, depth_m, mean, camera, compositor, aim, sums };
        let (distance_m, nothing) = shoot.focus_distance_m(focal_length_m)?;
        nothing.map(str::to_owned).into_iter().try_for_each(&mut warn)?;
        dials.focus_distance_m = distance_m;
        if self.bracket == Some(Bracket::Focus) && dials.focus_distance_m.is_infinite() {
            return refused(
                "--bracket focus goes from half the focus distance to twice, and that is infinite here: give a \
                 distance, as in --focus 2"
                    .to_owned(),
            );
        }
        work.settings.unlabelled = !self.labelled;
        let mut input_digests = Some(input_digests);
        let label = self.labelled.then(|| SourceLabel::composite(&shoot.shot.recording.path).of_frame(index));
        let mut sheet = Vec::new();
        let mut has_warned = false;
        let series = dials.series(self.bracket);
        let framed = |entry: &SeriesEntry| {
            Framing::aimed(
                &shoot.recorded_geometry,
                self.film,
                focal_length_m,
                entry.focus_distance_m,
                self.width_px,
                aim,
            )
        };
        let framings = series.iter().map(framed).collect::<Result<Vec<_>, _>>()?;
        for (n, (entry, framing)) in series.iter().zip(framings).enumerate() {
            let mut warn = |text: String| send(PhotoEvent::Warning(text));
            let opening = shoot.lens(entry).opening(&framing.geometry)?;
            let flat = shoot.frame.depth.is_none() && acts_on_real;
            if flat && !has_warned && opening.is_some_and(|opening| blurs(&opening, &framing)) {
                let text = "only virtual objects are out of focus: the recording has no depth here, and its part stays \
                            as sharp as it was recorded";
                warn(text.to_owned())?;
                has_warned = true;
            }
            dials.exposure_warning(entry).into_iter().try_for_each(&mut warn)?;
            let report_progress =
                |share: f64| send(PhotoEvent::Taking { number: n + 1, of: series.len(), share }).is_ok();
            let Photograph { pixels, shows_objects } = shoot.take(&dials, entry, &framing, opening, report_progress)?;
            if !shows_objects && n == 0 {
                send(PhotoEvent::Warning(Note::NothingSeen.to_string()))?;
            }
            let path = self.path_of(&(n + 1).to_string());
            let notes = shoot.notes(&dials, entry, &framing);
            let number = self.number.map_or_else(|| next_number(&path), |first| first.saturating_add(n as u32));
            let photo = TakenPhoto { dials: &dials, entry, framing: &framing, opening, pixels: &pixels, notes: &notes };
            let particulars = shoot.particulars(&photo, subject.as_deref(), number)?;
            if let Some(digests) = input_digests.take() {
                while !digests.is_finished() {
                    send(PhotoEvent::Taking { number: n + 1, of: series.len(), share: 1.0 })?;
                    std::thread::park_timeout(DIGEST_POLL);
                }
                work.inputs = digests.finish().map_err(|(path, source)| SinkError::Read { path, source })?;
            }
            photograph::write(&path, &pixels, Some(&notes), label.as_ref(), self.force)?;
            write_record(&path, &particulars, Some(&work))?;
            let settings = settings_text(entry, &framing);
            let written = send(PhotoEvent::Written { path, settings: settings.replace('\n', ", ") });
            // After a single photograph nothing is left to cancel.
            if self.bracket.is_some() {
                written?;
                sheet.extend(thumbnail(&pixels).map(|small| (small, settings)));
            }
        }
        if self.bracket.is_some() {
            let path = self.path_of("sheet");
            photograph::write(&path, &contact_sheet(&sheet), None, label.as_ref(), self.force)?;
            let _ = send(PhotoEvent::Written { path, settings: String::new() });
        }
        Ok(())
    }
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
fn with_film(whole: Geometry, rig: &Rig, focal_length_m: Option<f64>) -> Geometry {
    let Some(focal_length_m) = focal_length_m.filter(|_| !rig.gives_film_width()) else { return whole };
    let Geometry { mut intrinsics, distortion, .. } = whole;
    intrinsics.film_width_mm = 1e3 * focal_length_m * f64::from(intrinsics.width_px) / intrinsics.fx_px;
    Geometry::new(intrinsics, distortion)
}

fn settings_text(entry: &SeriesEntry, framing: &Framing) -> String {
    let off =
        if entry.over_ev.abs() > 1.0 / 6.0 + 1e-6 { format!(", {:+.1} EV", entry.over_ev) } else { String::new() };
    let lens = format!("{:.1} mm", 1e3 * framing.focal_length_m);
    let focus = match framing.focus_distance_m {
        far if far.is_infinite() => "infinity".to_owned(),
        near => format!("{near:.2} m"),
    };
    format!("{}\n{lens} at {focus}{off}", entry.settings)
}

/// True if objects at half the focus distance or at infinity would be visibly blurred.
fn blurs(opening: &Opening, framing: &Framing) -> bool {
    let fx_px = framing.geometry.intrinsics.fx_px;
    let nearer = if framing.focus_distance_m.is_finite() { 0.5 * framing.focus_distance_m } else { 1.0 };
    [nearer, f64::INFINITY].into_iter().any(|distance_m| opening.circle_px(fx_px, distance_m).abs() > 1.5)
}
