//! Particulars of a photograph that has been taken.

use glam::{DVec2, DVec3};

use super::error::PhotoError;
use super::exposure_controls::{ExposureControls, SeriesEntry};
use super::framing::Framing;
use super::particulars::{CameraSupport, Particulars, PhotoContent, SHARP_CIRCLE_SHARE, Subject, ViewParticulars};
use super::shoot::PhotoShoot;
use super::view::{PhotoView, ViewedObject, path_px};
use crate::camera::Opening;
use crate::camera::exposure::ExposureSettings;
use crate::camera::stops::{self, Step};
use crate::pixels::Pixels;
use crate::pose::Pose;
use crate::sink::photograph::{ExifNotes, log_date_time};

/// Smallest code value of a clipped channel: JPEG's rounding loses the last code.
const CLIPPED_CODE: u32 = 254;
/// Number of moments at which the subject's path is sampled.
const PATH_SAMPLES: u32 = 9;

/// A photograph that has been taken, with its settings.
pub struct TakenPhoto<'a> {
    pub dials: &'a ExposureControls,
    pub entry: &'a SeriesEntry,
    pub framing: &'a Framing,
    pub opening: Option<Opening>,
    pub pixels: &'a Pixels,
    pub notes: &'a ExifNotes,
}

impl PhotoShoot<'_> {
    /// Particulars of a photograph. `subject` is the name that the photographer gave.
    pub fn particulars(
        &self,
        photo: &TakenPhoto<'_>,
        subject: Option<&str>,
        number: u32,
    ) -> Result<Particulars, PhotoError> {
        let TakenPhoto { dials, entry, framing, opening, pixels, notes } = *photo;
        let time_s = self.frame.timestamp_s + framing.later_s;
        let track = &self.shot.recording.track;
        let pose = track.at(time_s).or_else(|_| track.at(self.frame.timestamp_s))?;
        let objects = self.shot.objects();
        let (geometry, scene) = (&framing.geometry, &self.shot.scene);
        let up = self.shot.up().unwrap_or_else(|| self.shot.camera_up());
        let view = PhotoView { geometry, pose, scene, objects: &objects, up, opening };
        let viewed = view.viewed_objects();
        let of_subject = view.subject(&viewed, subject);
        let subject = of_subject.map(|of_subject| Subject {
            motion_px: self.motion_px(photo, of_subject, time_s),
            clipped_share: clipped_share(pixels, of_subject.in_view.bounds_px),
            ..view.subject_particulars(of_subject, subject.is_some(), &viewed)
        });
        let circle_m = SHARP_CIRCLE_SHARE * 1e-3 * framing.film.diagonal_mm();
        let sharp = self.lens(entry).thin_lens(geometry)?.map(|lens| lens.sharpness(circle_m));
        let (width, height) = framing.size();
        let ExposureSettings { f_number, time_s: shutter_s, iso } = entry.settings;
        let particulars = ViewParticulars {
            recording: self.shot.recording.path.display().to_string(),
            frame: self.request.frame,
            width_px: width,
            height_px: height,
            focal_length_mm: notes.focal_length_mm,
            equivalent_mm: notes.equivalent_mm,
            f_number: stops::marked(&stops::f_numbers(Step::Third), f_number),
            shutter_s: stops::marked(&stops::shutter_times_s(Step::Third), shutter_s),
            iso: stops::marked(&stops::iso_speeds(Step::Third), iso),
            support: if self.request.hand_held { CameraSupport::HandHeld } else { CameraSupport::Tripod },
            exposure_deviation_ev: entry.settings.over_ev(dials.lux),
            clipped_share: clipped_share(pixels, [0.0, 0.0, f64::from(width), f64::from(height)]),
            focus_distance_m: Some(entry.focus_distance_m).filter(|distance_m| distance_m.is_finite()),
            sharp_from_m: sharp.map_or(0.0, |sharp| sharp.near_m),
            sharp_to_m: sharp.map(|sharp| sharp.far_m).filter(|far_m| far_m.is_finite()),
            subject,
            objects: viewed.into_iter().map(|viewed| viewed.in_view).collect(),
        };
        Ok(Particulars {
            number,
            taken: log_date_time(notes.taken_s),
            content: PhotoContent::View(Box::new(particulars)),
        })
    }

    /// Length of the subject's path while the shutter is open: by hand for the set time, on a
    /// tripod for the frame's own, px.
    fn motion_px(&self, photo: &TakenPhoto<'_>, subject: &ViewedObject, time_s: f64) -> Option<f64> {
        let open_s = if self.sums { photo.entry.settings.time_s } else { self.frame_exposure_s() };
        let centre_m = DVec3::from(subject.in_view.centre_m);
        let track = &self.shot.recording.track;
        let project = |pose: Pose| photo.framing.geometry.project(pose.transform_point(centre_m));
        let projections: Vec<Option<DVec2>> = (0..PATH_SAMPLES)
            .map(|n| f64::from(n) / f64::from(PATH_SAMPLES - 1) - 0.5)
            .map(|share| track.at(time_s + share * open_s).ok().and_then(project))
            .collect();
        path_px(&projections).filter(|_| self.shot.recording.kind.has_times())
    }
}

/// Share of the pixels with a clipped channel within bounds (left, top, right, bottom), px. 0 for
/// empty bounds.
fn clipped_share(pixels: &Pixels, bounds_px: [f64; 4]) -> f64 {
    let within = |at: f64, most: u32| at.clamp(0.0, f64::from(most)) as u32;
    let [left, right] = [bounds_px[0].floor(), bounds_px[2].ceil()].map(|x| within(x, pixels.width));
    let [top, bottom] = [bounds_px[1].floor(), bounds_px[3].ceil()].map(|y| within(y, pixels.height));
    let count = u64::from(right.saturating_sub(left)) * u64::from(bottom.saturating_sub(top));
    if count == 0 {
        return 0.0;
    }
    let is_clipped = |x: u32, y: u32| pixels.at(x, y).iter().any(|code| *code >= CLIPPED_CODE);
    let clipped = (top..bottom).map(|y| (left..right).filter(|&x| is_clipped(x, y)).count() as u64).sum::<u64>();
    clipped as f64 / count as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clipped_share_counts_pixels_within_bounds() {
        // 4 × 2 px, of which the first two of the upper row clip in one channel.
        let mut codes = vec![100; 24];
        (codes[0], codes[4]) = (255, 254);
        let pixels = Pixels::from_u8(4, 2, codes).unwrap();
        assert_eq!(clipped_share(&pixels, [0.0, 0.0, 4.0, 2.0]), 0.25);
        assert_eq!(clipped_share(&pixels, [0.0, 0.0, 2.0, 1.0]), 1.0);
        assert_eq!(clipped_share(&pixels, [2.0, 0.0, 9.0, 9.0]), 0.0);
        assert_eq!(clipped_share(&pixels, [0.0; 4]), 0.0);
    }
}
