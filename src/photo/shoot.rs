//! Photographs a frame of a recording.

use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use super::error::PhotoError;
use super::exposure_controls::{ExposureControls, SeriesEntry};
use super::focus::distance_m;
use super::framing::{Aim, Framing};
use super::occlusion::SummedFrameOcclusion;
use super::real::{RealPart, shutter_weights};
use super::request::{Focus, PhotoRequest};
use super::take::{self, PhotoExposure, Photograph, Standpoint};
use crate::camera::exposure::ExposureSettings;
use crate::camera::metering::Mode;
use crate::camera::stops::{self, Step};
use crate::camera::{Camera, Geometry, Lens, Opening, SummedExposure};
use crate::compositor::{Compositor, ExposureTime, Target};
use crate::frame::Frame;
use crate::pixels::Rect;
use crate::shot::{DEFAULT_ISO, Shot};
use crate::sink::photograph::ExifNotes;
use crate::text::short;

/// Timestamps from this value on (2001-09-09) are seconds since 1970.
const MIN_EPOCH_TIME_S: f64 = 1e9;

/// A shot and the frame to photograph.
pub struct PhotoShoot<'a> {
    pub request: &'a PhotoRequest,
    pub shot: Shot,
    pub recorded_geometry: Geometry,
    pub frame: Frame,
    /// The frame's depth at its time, metres, row by row, 0 where unknown.
    pub depth_m: Option<Vec<f32>>,
    /// Mean of the frame's linear light.
    pub mean: f64,
    pub camera: Camera,
    pub compositor: Compositor,
    pub aim: Aim,
    /// True if the recording's frames are summed during the exposure.
    pub sums: bool,
}

impl PhotoShoot<'_> {
    /// Focus distance, and a warning about it.
    pub fn focus_distance_m(&mut self, focal_length_m: Option<f64>) -> Result<(f64, Option<&'static str>), PhotoError> {
        if let Focus::Metres(distance_m) = self.request.focus {
            return Ok((distance_m, None));
        }
        let pending = self.shot.submit(
            &mut self.compositor,
            self.frame.clone(),
            &self.recorded_geometry,
            Target::Pixels,
            true,
        )?;
        let layer = self.compositor.collect(pending)?.layer.unwrap_or_default();
        let framed = |f| {
            Framing::aimed(
                &self.recorded_geometry,
                self.request.film,
                f,
                f64::INFINITY,
                self.request.width_px,
                self.aim,
            )
        };
        // A lens with too wide a view at infinity may fit once it is focused.
        let framing = framed(focal_length_m).or_else(|_| framed(None))?;
        let (width, height) = framing.size();
        let corner = framing.framed.source_px(glam::DVec2::new(f64::from(width), f64::from(height)));
        let visible = Rect::new(
            framing.framed.left_px as i32,
            framing.framed.top_px as i32,
            corner.x.round() as i32,
            corner.y.round() as i32,
        );
        Ok(match distance_m(&layer, self.depth_m.as_deref(), visible) {
            Some(found_m) => (found_m, None),
            None => (f64::INFINITY, Some("there is nothing to focus on: infinity is sharp; set a distance (--focus)")),
        })
    }

    pub fn lens(&self, entry: &SeriesEntry) -> Lens {
        Lens {
            f_number: Some(entry.settings.f_number),
            aperture_diameter_mm: None,
            focus_distance_m: Some(entry.focus_distance_m).filter(|d| d.is_finite()),
            ..self.shot.rig.lens.clone()
        }
    }

    /// Exposure time of the photographed frame itself, seconds.
    pub fn frame_exposure_s(&self) -> f64 {
        self.exposure_time(&self.frame).s
    }

    fn exposure_time(&self, frame: &Frame) -> ExposureTime {
        let interval_s = self.shot.recording.frame_interval_s;
        ExposureTime::of_frame(&self.camera, &self.shot.settings, &frame.exposure, interval_s)
    }

    pub fn take(
        &mut self,
        dials: &ExposureControls,
        entry: &SeriesEntry,
        framing: &Framing,
        opening: Option<Opening>,
        report_progress: impl FnMut(f64) -> bool,
    ) -> Result<Photograph, PhotoError> {
        let (index, shot, recording) = (self.request.frame, &self.shot, &self.shot.recording);
        let has_times = recording.kind.has_times();
        let (range, weights) = if has_times && self.sums {
            let (times, interval_s) = (&recording.timestamps_s, recording.frame_interval_s);
            shutter_weights(times, interval_s, index, entry.settings.time_s)
        } else {
            (index..index + 1, vec![1.0])
        };
        let mut frames = Vec::with_capacity(weights.len());
        let (mut summed, mut summed_occlusion) = (Vec::new(), Vec::new());
        if range.len() == 1 {
            frames.push((1.0, self.frame.pixels.clone()));
        } else {
            let by_depth = self.frame.depth.as_ref().filter(|_| shot.settings.depth.occlusion);
            let (proxies, planes) = (self.compositor.proxies(), self.compositor.support_planes());
            let by_depth = by_depth.map(|depth| {
                SummedFrameOcclusion::new(
                    &self.recorded_geometry,
                    &recording.track,
                    framing,
                    &self.camera.response,
                    (depth, &proxies, &planes),
                )
            });
            for (frame, weight) in recording.frames_with_neighbours(range)?.zip(weights) {
                let frame = frame?;
                let time_s = frame.timestamp_s - self.frame.timestamp_s;
                summed_occlusion.extend(by_depth.as_ref().and_then(|occlusion| Some((time_s, occlusion.of(&frame)?))));
                let exposure_s = self.exposure_time(&frame).s;
                summed.push(SummedExposure { time_s, exposure_s, weight });
                frames.push((weight, frame.pixels));
            }
        }
        let response = &shot.rig.response;
        // Relative to the frame itself, which was metered.
        let gain = if self.mean > 0.0 { entry.settings.mean_light(dials.lux) / self.mean } else { 1.0 };
        // The recording's own settings leave its light unchanged, despite rounding.
        let gain = if (gain - 1.0).abs() < 1e-9 { 1.0 } else { gain };
        let neighbours = self.camera.noise.as_ref().map_or([0.0; 2], |noise| noise.neighbour_correlation);
        let real = RealPart::new(&frames, response, &framing.framed, framing.size(), neighbours);
        drop(frames);
        let measured_at = shot.rig.exposure.iso.or(shot.exposure_settings(index).iso).unwrap_or(DEFAULT_ISO);
        let exposed = PhotoExposure {
            opening,
            time_s: match (has_times, self.sums) {
                (false, _) => 0.0,
                (true, true) => entry.settings.time_s,
                // On a tripod the real part is a single frame, so virtual objects are blurred as in
                // it.
                (true, false) => self.exposure_time(&self.frame).s,
            },
            over_ev: gain.log2(),
            iso_ratio: entry.settings.iso / measured_at,
        };
        let standpoint = Standpoint {
            camera: &self.camera,
            settings: &shot.settings,
            recorded: &self.recorded_geometry,
            track: &recording.track,
            interval_s: recording.frame_interval_s,
            frame: index,
            timestamp_s: self.frame.timestamp_s,
            exposure: self.frame.exposure,
            opacity: self.frame.opacity,
            summed: &summed,
            depth_m: self.depth_m.as_deref(),
            summed_occlusion: &summed_occlusion,
        };
        Ok(take::take(&mut self.compositor, &standpoint, framing, real, &exposed, report_progress)?)
    }

    pub fn notes(&self, dials: &ExposureControls, entry: &SeriesEntry, framing: &Framing) -> ExifNotes {
        let ExposureSettings { f_number, time_s, iso } = entry.settings;
        let focal_length_mm = 1e3 * framing.focal_length_m;
        let clock_s = Some(self.frame.timestamp_s).filter(|t| *t >= MIN_EPOCH_TIME_S);
        let recorded_s = self.frame.exposure.photo.taken_s.or(clock_s);
        let now_s = || SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64());
        let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        ExifNotes {
            // The engraved values, as written by a camera.
            f_number: stops::marked(&stops::f_numbers(Step::Third), f_number),
            time_s: stops::marked(&stops::shutter_times_s(Step::Third), time_s),
            iso: stops::marked(&stops::iso_speeds(Step::Third), iso),
            focal_length_mm,
            equivalent_mm: framing.film.equivalent_35mm(focal_length_mm),
            focus_distance_m: entry.focus_distance_m,
            compensation_ev: dials.compensation_ev,
            program: match dials.mode_of(self.request.bracket) {
                Mode::Manual => 1,
                Mode::Program => 2,
                Mode::AperturePriority => 3,
                Mode::ShutterPriority => 4,
            },
            taken_s: recorded_s.unwrap_or_else(now_s),
            orientation: self.shot.recording.presentation().orientation,
            description: format!(
                "frame {} of {} at {} s",
                self.request.frame,
                name(&self.shot.recording.path),
                short(self.frame.timestamp_s)
            ),
        }
    }
}
