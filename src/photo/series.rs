//! Takes a photograph or a series, from the request to the files.

use std::path::PathBuf;
use std::time::Duration;

use super::error::{PhotoError, refused};
use super::exposure_controls::SeriesEntry;
use super::framing::Framing;
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
use crate::provenance::{InputDigests, WorkRecord, input_files};
use crate::shot::{Note, Shot};
use crate::sink::{SinkError, photograph};

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
        let plan = PhotoPlan::new(self, &shot)?;
        let mut send = |event: PhotoEvent| if report(event) { Ok(()) } else { Err(TakeError::Cancelled) };
        let mut warn = |text: String| send(PhotoEvent::Warning(text));
        plan.warnings.iter().cloned().try_for_each(&mut warn)?;
        let frame = shot.read_with_neighbours(index)?;
        plan.frame_warnings(self, &shot, &frame).into_iter().try_for_each(&mut warn)?;
        let PhotoPlan { recorded_geometry, camera, focal_length_m, subject, aim, mut dials, sums, .. } = plan;
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
