//! Lens data of a stream, as one camera per frame.

use std::collections::VecDeque;
use std::sync::Arc;

use crate::camera::{Geometry, Intrinsics};
use crate::frame::FrameLens;
use crate::memo::Memo;
use crate::profile::Rig;
use crate::recording::{FrameCamera, is_representable};
use crate::stream::LensState;
use crate::text::fixed;

/// Capacity, whatever the time stamps are: a tracker of 1 kHz for four seconds.
const CAPACITY: usize = 4096;
/// Length of the history, seconds. Frames wait less for their poses.
const LENS_HISTORY_S: f64 = 4.0;
/// Smaller errors of the fitted distortion are not reported, px.
const REPORTED_ERROR_PX: f64 = 0.1;

/// Cameras over time, from a stream's lens data, for pictures of one size.
#[derive(Debug)]
struct LensHistory {
    size_px: (u32, u32),
    interval_s: f64,
    cameras: VecDeque<(f64, FrameCamera)>,
    /// Cameras by lens state: most poses repeat the state before.
    converted: Memo<Arc<LensState>, FrameCamera>,
}

/// Converts a stream's lens state to a camera, for pictures of a size, one every `interval_s`. Also
/// returns a remark for the user.
pub fn camera_of(state: &LensState, (width, height): (u32, u32), interval_s: f64) -> (FrameCamera, Option<String>) {
    let (lens, exposure) = (state.lens(), state.exposure());
    let by_angle = |angle_deg: f64| angle_deg / 360.0 * interval_s;
    let exposure_s = state.shutter_s().or(exposure.shutter_angle_deg.map(by_angle));
    let lens = FrameLens {
        f_number: lens.f_number,
        focus_distance_m: lens.focus_distance_m,
        exposure_s: exposure_s.filter(|s| *s > 0.0 && *s <= crate::camera::exposure::MAX_EXPOSURE_S),
        iso: exposure.iso,
    };
    match state.geometry(width, height) {
        Ok((geometry, error_px)) => {
            let remark = (error_px > REPORTED_ERROR_PX)
                .then(|| format!("its distortion is another model's: ours is off by up to {} px", fixed(error_px, 1)));
            (FrameCamera { geometry: Some(geometry), lens }, remark)
        }
        Err(why) => (FrameCamera { geometry: None, lens }, Some(why.to_string())),
    }
}

impl LensHistory {
    /// Adds the lens state of a pose. A time that is not later than the one before is ignored.
    fn add(&mut self, time_s: f64, state: &Arc<LensState>) {
        if !time_s.is_finite() || self.cameras.back().is_some_and(|(last_s, _)| time_s <= *last_s) {
            return;
        }
        let camera = self
            .converted
            .get_or_insert_with(Arc::clone(state), |state| camera_of(state, self.size_px, self.interval_s).0);
        self.cameras.push_back((time_s, camera));
        // Keeps one camera before the span.
        let is_old =
            |cameras: &VecDeque<(f64, FrameCamera)>| cameras.get(1).is_some_and(|(s, _)| time_s - s > LENS_HISTORY_S);
        while self.cameras.len() > CAPACITY || is_old(&self.cameras) {
            self.cameras.pop_front();
        }
    }

    /// The camera at a time: interpolated between the neighbours, or the nearest one at either end.
    fn at(&self, time_s: f64) -> Option<FrameCamera> {
        let after = self.cameras.partition_point(|(state_s, _)| *state_s < time_s);
        let before = after.checked_sub(1).and_then(|before| self.cameras.get(before));
        match (before, self.cameras.get(after)) {
            (Some((from_s, from)), Some((to_s, to))) => {
                Some(interpolate(from, to, (time_s - from_s) / (to_s - from_s).max(f64::MIN_POSITIVE)))
            }
            (before, after) => before.or(after).map(|(_, camera)| camera.clone()),
        }
    }
}

/// Linear interpolation of all lens parameters.
fn interpolate(from: &FrameCamera, to: &FrameCamera, fraction: f64) -> FrameCamera {
    if from == to {
        return to.clone();
    }
    let lerp = |a: f64, b: f64| a + (b - a) * fraction;
    let lerp_known =
        |a: Option<f64>, b: Option<f64>| a.zip(b).map_or(if fraction < 0.5 { a } else { b }, |(a, b)| Some(lerp(a, b)));
    let geometry = match (&from.geometry, &to.geometry) {
        (Some(a), Some(b)) => {
            let (i, j, d, e) = (&a.intrinsics, &b.intrinsics, &a.distortion, &b.distortion);
            let intrinsics = Intrinsics {
                fx_px: lerp(i.fx_px, j.fx_px),
                fy_px: lerp(i.fy_px, j.fy_px),
                cx_px: lerp(i.cx_px, j.cx_px),
                cy_px: lerp(i.cy_px, j.cy_px),
                film_width_mm: lerp(i.film_width_mm, j.film_width_mm),
                ..j.clone()
            };
            let mut distortion = e.clone();
            (distortion.k1, distortion.k2, distortion.k3) = (lerp(d.k1, e.k1), lerp(d.k2, e.k2), lerp(d.k3, e.k3));
            (distortion.p1, distortion.p2) = (lerp(d.p1, e.p1), lerp(d.p2, e.p2));
            Some(Geometry::new(intrinsics, distortion))
        }
        (a, b) => if fraction < 0.5 { a } else { b }.clone(),
    };
    let (a, b) = (&from.lens, &to.lens);
    // Film speed is switched, not turned.
    let iso = if fraction < 0.5 { a.iso } else { b.iso };
    let lens = FrameLens {
        f_number: lerp_known(a.f_number, b.f_number),
        focus_distance_m: lerp_known(a.focus_distance_m, b.focus_distance_m),
        exposure_s: lerp_known(a.exposure_s, b.exposure_s),
        iso,
    };
    FrameCamera { geometry, lens }
}

/// The camera of each frame: the stream's lens data, overridden by the rig's settings.
#[derive(Debug)]
pub struct LensTrack {
    history: LensHistory,
    /// Follows the frames ([`Rig::follow_frames`]).
    rig: Rig,
    /// Used until the stream sends lens data.
    first: FrameCamera,
}

impl LensTrack {
    /// A track for pictures of a size, one every `interval_s`. `first` is used before the first
    /// lens data.
    pub fn new(size_px: (u32, u32), interval_s: f64, rig: Rig, first: FrameCamera) -> Self {
        Self {
            history: LensHistory { size_px, interval_s, cameras: VecDeque::new(), converted: Memo::default() },
            rig,
            first,
        }
    }

    /// Adds the lens state that a stream sent with a pose.
    pub fn add(&mut self, time_s: f64, state: &Arc<LensState>) {
        self.history.add(time_s, state);
    }

    /// Sets the rig, whose settings override the stream's.
    pub fn set_rig(&mut self, rig: &Rig) {
        if self.rig != *rig {
            self.rig = rig.clone();
        }
    }

    /// Exposure time of a frame according to the data so far, seconds.
    pub fn exposure_s(&self, time_s: f64) -> Option<f64> {
        self.rig.effective_lens(self.stream_camera(time_s).lens).exposure_s
    }

    fn stream_camera(&self, time_s: f64) -> FrameCamera {
        self.history.at(time_s).unwrap_or_else(|| self.first.clone())
    }

    /// The camera that a frame is composited and recorded with. Without lens data its geometry is
    /// `None`: the rig's geometry is used.
    pub fn at(&self, time_s: f64) -> FrameCamera {
        let streamed = self.stream_camera(time_s);
        let own = streamed.geometry.or_else(|| self.first.geometry.clone());
        let used = own.as_ref().and_then(|own| self.rig.geometry_over(Some(own)));
        // A setting of the rig that cannot be recorded is applied again by the reader.
        let geometry = used.filter(is_representable).or(own);
        FrameCamera { geometry, lens: self.rig.effective_lens(streamed.lens) }
    }
}
