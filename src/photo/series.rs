//! Takes a photograph or a series, from the request to the files.

use std::path::{Path, PathBuf};
use std::time::Duration;

use super::error::{PhotoError, refused};
use super::exposure_controls::{ExposureControls, SeriesEntry};
use super::framing::Framing;
use super::log::{MIN_LENGTH_PX, MIN_SUBJECT_SHARE};
use super::particulars::{Particulars, PhotoContent};
use super::plan::PhotoPlan;
use super::record::{next_number, write_record};
use super::request::{Bracket, PhotoRequest};
use super::sheet::{contact_sheet, thumbnail};
use super::shoot::PhotoShoot;
use super::shoot_particulars::TakenPhoto;
use super::take::{Photograph, TakeError};
use crate::camera::Opening;
use crate::camera::metering::PictureLight;
use crate::depth::{Rays, consensus_at_frame};
use crate::gpu::{Gpu, GpuError};
use crate::label::SourceLabel;
use crate::pixels::Pixels;
use crate::provenance::{InputDigests, SettingsRecord, WorkRecord, input_files};
use crate::shot::{Note, Shot};
use crate::sink::SinkError;
use crate::sink::mark::VisibleMark;
use crate::sink::photograph::{self, ExifNotes};
use crate::sink::sdr::{ToneMapping, needs_tone_mapping};

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

/// A photograph that was taken again.
#[derive(Clone, Debug, PartialEq)]
pub struct RetakenPhoto {
    pub pixels: Pixels,
    pub content: PhotoContent,
}

/// Receiver of events; an error ends the work.
type EventSender<'a> = &'a mut dyn FnMut(PhotoEvent) -> Result<(), TakeError>;

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
        let plan = PhotoPlan::new(self, &shot)?;
        plan.check_outputs(self, &shot)?;
        let send: EventSender<'_> =
            &mut |event: PhotoEvent| if report(event) { Ok(()) } else { Err(TakeError::Cancelled) };
        let mut session = PhotoSession::begin(self, plan, shot, device, send)?;
        let shoot = &session.shoot;
        let mut work = WorkRecord::begun(&shoot.shot, &shoot.compositor.gpu().info);
        work.settings = self.settings_record(&shoot.shot);
        let mut input_digests = Some(InputDigests::start(input_files(&shoot.shot)));
        let label = self.labelled.then(|| SourceLabel::composite(&shoot.shot.recording.path).of_frame(self.frame));
        let mut sheet = Vec::new();
        let photographs = session.series.len();
        for n in 0..photographs {
            let path = self.path_of(&(n + 1).to_string());
            let number = self.number.map_or_else(|| next_number(&path), |first| first.saturating_add(n as u32));
            let SessionPhoto { pixels, notes, particulars, settings } = session.take(n, number, send)?;
            if let Some(digests) = input_digests.take() {
                while !digests.is_finished() {
                    send(PhotoEvent::Taking { number: n + 1, of: photographs, share: 1.0 })?;
                    std::thread::park_timeout(DIGEST_POLL);
                }
                work.inputs = digests.finish().map_err(|(path, source)| SinkError::Read { path, source })?;
            }
            photograph::write(&path, &pixels, Some(&notes), label.as_ref(), self.force)?;
            write_record(&path, &particulars, work.clone())?;
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

    /// The settings of a shot with those of this request.
    pub fn settings_record(&self, shot: &Shot) -> SettingsRecord {
        SettingsRecord { mark: self.mark.clone(), unlabelled: !self.labelled, ..SettingsRecord::of(shot) }
    }

    /// Takes the photograph at `path` again, which this request or one of its series made. Nothing
    /// is written, and output files are not checked.
    pub fn retake(
        &self,
        path: &Path,
        shot: Shot,
        device: impl FnOnce() -> Result<Gpu, GpuError>,
    ) -> Result<RetakenPhoto, PhotoError> {
        let plan = PhotoPlan::new(self, &shot)?;
        let send: EventSender<'_> = &mut |_| Ok(());
        let mut session = PhotoSession::begin(self, plan, shot, device, send)?;
        let Some(n) = (0..session.series.len()).find(|n| self.path_of(&(n + 1).to_string()) == path) else {
            return refused(format!("{}: is no photograph that this command makes", path.display()));
        };
        let SessionPhoto { pixels, particulars, .. } = session.take(n, 0, send)?;
        Ok(RetakenPhoto { pixels, content: particulars.content })
    }
}

/// A checked request on a device, which takes the photographs of its series.
struct PhotoSession<'a> {
    shoot: PhotoShoot<'a>,
    dials: ExposureControls,
    subject: Option<String>,
    series: Vec<SeriesEntry>,
    framings: Vec<Framing>,
    /// True if an effect acts on the real part, for which the recording has no depth.
    is_flat: bool,
    /// True after the warning that a flat real part stays sharp.
    has_warned: bool,
}

/// A photograph of a session.
struct SessionPhoto {
    pixels: Pixels,
    notes: ExifNotes,
    particulars: Particulars,
    settings: String,
}

impl<'a> PhotoSession<'a> {
    fn begin(
        request: &'a PhotoRequest,
        plan: PhotoPlan,
        shot: Shot,
        device: impl FnOnce() -> Result<Gpu, GpuError>,
        send: EventSender<'_>,
    ) -> Result<Self, PhotoError> {
        let mut warn = |text: String| send(PhotoEvent::Warning(text));
        plan.warnings.iter().cloned().try_for_each(&mut warn)?;
        let frame = shot.read_with_neighbours(request.frame)?;
        plan.frame_warnings(request, &shot, &frame).into_iter().try_for_each(&mut warn)?;
        let PhotoPlan { recorded_geometry, camera, focal_length_m, subject, aim, mut dials, sums, .. } = plan;
        let is_flat = frame.depth.is_none() && shot.settings.acts_on_real();
        let compositor = shot.compositor(device()?);
        compositor.warnings().into_iter().try_for_each(&mut warn)?;
        let mean = PictureLight::of(&frame.pixels, &camera.response).mean;
        let track = &shot.recording.track;
        let rays = Rays::new(&recorded_geometry);
        let depth_m =
            frame.depth.as_ref().and_then(|map| consensus_at_frame(&frame, map, &rays, track, &camera.response));
        let mut shoot =
            PhotoShoot { request, shot, recorded_geometry, frame, depth_m, mean, camera, compositor, aim, sums };
        let (distance_m, nothing) = shoot.focus_distance_m(focal_length_m)?;
        nothing.map(str::to_owned).into_iter().try_for_each(&mut warn)?;
        dials.focus_distance_m = distance_m;
        if request.bracket == Some(Bracket::Focus) && dials.focus_distance_m.is_infinite() {
            return refused(
                "--bracket focus goes from half the focus distance to twice, and that is infinite here: give a \
                 distance, as in --focus 2"
                    .to_owned(),
            );
        }
        let series = dials.series(request.bracket);
        let framed = |entry: &SeriesEntry| {
            Framing::aimed(
                &shoot.recorded_geometry,
                request.film,
                focal_length_m,
                entry.focus_distance_m,
                request.width_px,
                aim,
            )
        };
        let framings = series.iter().map(framed).collect::<Result<Vec<_>, _>>()?;
        framings.first().and_then(small_width_warning).into_iter().try_for_each(&mut warn)?;
        Ok(Self { shoot, dials, subject, series, framings, is_flat, has_warned: false })
    }

    /// Takes photograph `n` (from 0) of the series. `number` is that in the photo log.
    fn take(&mut self, n: usize, number: u32, send: EventSender<'_>) -> Result<SessionPhoto, PhotoError> {
        let Self { shoot, dials, subject, series, framings, is_flat, has_warned } = self;
        let (entry, framing) = (&series[n], &framings[n]);
        let opening = shoot.lens(entry).opening(&framing.geometry)?;
        if *is_flat && !*has_warned && opening.is_some_and(|opening| blurs(&opening, framing)) {
            let text = "only virtual objects are out of focus: the recording has no depth here, and its part stays as \
                        sharp as it was recorded";
            send(PhotoEvent::Warning(text.to_owned()))?;
            *has_warned = true;
        }
        dials.exposure_warning(entry).into_iter().try_for_each(|text| send(PhotoEvent::Warning(text)))?;
        let report_progress = |share: f64| send(PhotoEvent::Taking { number: n + 1, of: series.len(), share }).is_ok();
        let Photograph { pixels, shows_objects } = shoot.take(dials, entry, framing, opening, report_progress)?;
        if !shows_objects && n == 0 {
            send(PhotoEvent::Warning(Note::NothingSeen.to_string()))?;
        }
        let notes = shoot.notes(dials, entry, framing);
        let photo = TakenPhoto { dials, entry, framing, opening, pixels: &pixels, notes: &notes };
        let particulars = shoot.particulars(&photo, subject.as_deref(), number)?;
        let settings = settings_text(entry, framing);
        // A photograph has no tags of other colours.
        let response = &shoot.camera.response;
        let pixels = match needs_tone_mapping(response) {
            true => ToneMapping::new(response, pixels.max_code()).apply(&pixels),
            false => pixels,
        };
        let pixels = match &shoot.request.mark {
            Some(text) => VisibleMark::new(text, pixels.width, pixels.height).apply(&pixels),
            None => pixels,
        };
        Ok(SessionPhoto { pixels, notes, particulars, settings })
    }
}

/// A warning about a picture in which an item of the least share is too short for a close-up.
fn small_width_warning(framing: &Framing) -> Option<String> {
    let (width_px, _) = framing.size();
    let min_px = MIN_LENGTH_PX / MIN_SUBJECT_SHARE;
    (f64::from(width_px) < min_px)
        .then(|| format!("the photograph is {width_px} px wide, a close-up needs {min_px:.0} px or more (`--width`)"))
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
