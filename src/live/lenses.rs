//! What a stream says of its lens, as cameras at the frames' times.

use std::collections::VecDeque;
use std::sync::Arc;

use crate::camera::{Geometry, Intrinsics};
use crate::frame::FrameLens;
use crate::profile::Rig;
use crate::recording::{FrameCamera, can_say};
use crate::stream::LensState;
use crate::text::fixed;

/// What is kept, whatever the times say: a tracker of 1 kHz for four seconds.
const MOST: usize = 4096;
/// Frames wait no longer than this for their poses, seconds.
const KEPT_S: f64 = 4.0;
/// A distortion that is off by less is not worth a word, px.
const WELL_FITTED_PX: f64 = 0.1;

/// Cameras by time, as a stream says them, for pictures of one size.
#[derive(Debug)]
struct Said {
    size_px: (u32, u32),
    interval_s: f64,
    cameras: VecDeque<(f64, FrameCamera)>,
    /// The state that was made a camera last.
    last: Option<(Arc<LensState>, FrameCamera)>,
}

/// A camera of what a stream has said by now, for pictures of a size, one every `interval_s`; and what is to be told of it.
pub fn camera_of(state: &LensState, (width, height): (u32, u32), interval_s: f64) -> (FrameCamera, Option<String>) {
    let (lens, exposure) = (state.lens(), state.exposure());
    let by_angle = |angle_deg: f64| angle_deg / 360.0 * interval_s;
    let exposure_s = state.shutter_s().or(exposure.shutter_angle_deg.map(by_angle));
    let lens = FrameLens {
        f_number: lens.f_number,
        focus_distance_m: lens.focus_distance_m,
        exposure_s: exposure_s.filter(|s| *s > 0.0 && *s <= crate::camera::exposure::LONGEST_S),
        iso: exposure.iso,
    };
    match state.geometry(width, height) {
        Ok((geometry, off_px)) => {
            let told = (off_px > WELL_FITTED_PX)
                .then(|| format!("its distortion is another model's: ours is off by up to {} px", fixed(off_px, 1)));
            (FrameCamera { geometry: Some(geometry), lens }, told)
        }
        Err(why) => (FrameCamera { geometry: None, lens }, Some(why.to_string())),
    }
}

impl Said {
    /// What the stream said with a pose. Times that go back are left out.
    fn add(&mut self, time_s: f64, state: &Arc<LensState>) {
        if !time_s.is_finite() || self.cameras.back().is_some_and(|(last_s, _)| time_s <= *last_s) {
            return;
        }
        let camera = match self.last.as_ref().filter(|(last, _)| Arc::ptr_eq(last, state) || **last == **state) {
            Some((_, camera)) => camera.clone(),
            None => camera_of(state, self.size_px, self.interval_s).0,
        };
        self.last = Some((Arc::clone(state), camera.clone()));
        self.cameras.push_back((time_s, camera));
        // One before the span is kept.
        let is_old = |cameras: &VecDeque<(f64, FrameCamera)>| cameras.get(1).is_some_and(|(s, _)| time_s - s > KEPT_S);
        while self.cameras.len() > MOST || is_old(&self.cameras) {
            self.cameras.pop_front();
        }
    }

    /// At a time: between what was said before and after it, else what was said nearest to it.
    fn at(&self, time_s: f64) -> Option<FrameCamera> {
        let after = self.cameras.partition_point(|(said_s, _)| *said_s < time_s);
        let before = after.checked_sub(1).and_then(|before| self.cameras.get(before));
        match (before, self.cameras.get(after)) {
            (Some((from_s, from)), Some((to_s, to))) => {
                Some(between(from, to, (time_s - from_s) / (to_s - from_s).max(f64::MIN_POSITIVE)))
            }
            (before, after) => before.or(after).map(|(_, camera)| camera.clone()),
        }
    }
}

/// A lens on its way from one state to another: each number goes evenly.
fn between(from: &FrameCamera, to: &FrameCamera, share: f64) -> FrameCamera {
    if from == to {
        return to.clone();
    }
    let mix = |a: f64, b: f64| a + (b - a) * share;
    let of =
        |a: Option<f64>, b: Option<f64>| a.zip(b).map_or(if share < 0.5 { a } else { b }, |(a, b)| Some(mix(a, b)));
    let geometry = match (&from.geometry, &to.geometry) {
        (Some(a), Some(b)) => {
            let (i, j, d, e) = (&a.intrinsics, &b.intrinsics, &a.distortion, &b.distortion);
            let intrinsics = Intrinsics {
                fx_px: mix(i.fx_px, j.fx_px),
                fy_px: mix(i.fy_px, j.fy_px),
                cx_px: mix(i.cx_px, j.cx_px),
                cy_px: mix(i.cy_px, j.cy_px),
                film_width_mm: mix(i.film_width_mm, j.film_width_mm),
                ..j.clone()
            };
            let mut distortion = e.clone();
            (distortion.k1, distortion.k2, distortion.k3) = (mix(d.k1, e.k1), mix(d.k2, e.k2), mix(d.k3, e.k3));
            (distortion.p1, distortion.p2) = (mix(d.p1, e.p1), mix(d.p2, e.p2));
            Some(Geometry::new(intrinsics, distortion))
        }
        (a, b) => if share < 0.5 { a } else { b }.clone(),
    };
    let (a, b) = (&from.lens, &to.lens);
    // Film speed is switched, not turned.
    let iso = if share < 0.5 { a.iso } else { b.iso };
    let lens = FrameLens {
        f_number: of(a.f_number, b.f_number),
        focus_distance_m: of(a.focus_distance_m, b.focus_distance_m),
        exposure_s: of(a.exposure_s, b.exposure_s),
        iso,
    };
    FrameCamera { geometry, lens }
}

/// Which camera takes each frame: what the stream says, under what a person set.
#[derive(Debug)]
pub struct Lenses {
    said: Said,
    /// Follows the frames ([`Rig::follow_frames`]).
    rig: Rig,
    /// Until something is said.
    first: FrameCamera,
}

impl Lenses {
    /// For pictures of a size, one every `interval_s`. `first` is what is known before the first pose.
    pub fn new(size_px: (u32, u32), interval_s: f64, rig: Rig, first: FrameCamera) -> Self {
        Self { said: Said { size_px, interval_s, cameras: VecDeque::new(), last: None }, rig, first }
    }

    /// What the stream said with a pose of a time.
    pub fn add(&mut self, time_s: f64, state: &Arc<LensState>) {
        self.said.add(time_s, state);
    }

    /// From now on under what this rig sets.
    pub fn follow(&mut self, rig: &Rig) {
        if self.rig != *rig {
            self.rig = rig.clone();
        }
    }

    /// How long a frame is exposed, as far as it is said by now, seconds.
    pub fn exposure_s(&self, time_s: f64) -> Option<f64> {
        self.rig.left_of(self.said(time_s).lens).exposure_s
    }

    fn said(&self, time_s: f64) -> FrameCamera {
        self.said.at(time_s).unwrap_or_else(|| self.first.clone())
    }

    /// The camera with which a frame is composited, and that is recorded. Without a geometry where nobody has said one: it is
    /// the rig's own then.
    pub fn at(&self, time_s: f64) -> FrameCamera {
        let said = self.said(time_s);
        let own = said.geometry.or_else(|| self.first.geometry.clone());
        let used = own.as_ref().and_then(|own| self.rig.geometry_over(Some(own)));
        // What a person set is set again where it cannot be written.
        let geometry = used.filter(can_say).or(own);
        FrameCamera { geometry, lens: self.rig.left_of(said.lens) }
    }
}
