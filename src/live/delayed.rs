//! Poses whose clock differs from the camera's: a fixed delay, or one estimated from the pictures.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::time::Instant;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::delay_search::{DelayError, DelaySearch};
use super::error::LiveError;
use super::pose_source::PoseSource;
use crate::camera::Camera;
use crate::pixels::Pixels;
use crate::pose::Pose;
use crate::stream::LensState;
use crate::text::{count, fixed};
use crate::tracking::delay::{Delay, DelayFailure};
use crate::tracking::turn::ImagePyramid;

/// Time added to the time stamp of each pose.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
pub enum DelayMode {
    /// A fixed delay, seconds.
    #[serde(rename = "fixed")]
    Fixed(f64),
    /// The delay that fits the pictures best.
    #[serde(rename = "estimated", alias = "found")]
    Estimated,
}

impl Default for DelayMode {
    fn default() -> Self {
        Self::Fixed(0.0)
    }
}

/// Largest rate at which the applied delay changes, seconds per second of the poses' time. Objects
/// move a tenth faster or slower for a while, and never jump.
const MAX_SLEW_RATE: f64 = 0.1;
/// Capacities of the queue to the search thread, samples and pictures. Further samples are dropped:
/// on a slow machine the compared pictures are farther apart.
const QUEUE_CAPACITY: usize = 4096;
const MAX_QUEUED_PICTURES: usize = 4;

/// A delay that approaches its target at a limited rate.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct SlewedDelay {
    target_s: f64,
    current_s: f64,
    last_s: Option<f64>,
}

impl SlewedDelay {
    /// Converts a pose's time to the camera's clock. Keeps ascending times ascending.
    fn camera_time_s(&mut self, time_s: f64) -> f64 {
        let max_step_s = MAX_SLEW_RATE * self.last_s.map_or(0.0, |last_s| (time_s - last_s).max(0.0));
        self.current_s += (self.target_s - self.current_s).clamp(-max_step_s, max_step_s);
        self.last_s = Some(self.last_s.map_or(time_s, |last_s| last_s.max(time_s)));
        time_s + self.current_s
    }
}

enum DelaySample {
    /// The `Arc` counts the queued pictures.
    Picture(f64, ImagePyramid, Arc<()>),
    Pose(f64, Pose),
}

struct SearchThread {
    samples: SyncSender<DelaySample>,
    results: Receiver<Result<Delay, DelayError>>,
    queued_pictures: Arc<()>,
}

/// A pose source with shifted time stamps.
struct DelayedSource {
    source: Box<dyn PoseSource>,
    delay: SlewedDelay,
    /// Runs on a thread that ends when this is dropped.
    search: Option<SearchThread>,
    message: Option<String>,
    has_reported_failure: bool,
    /// Time stamps of the last returned poses: the camera's clock, and the source's.
    returned_s: Vec<[f64; 2]>,
}

/// Wraps a pose source so that its poses are delayed. An estimated delay needs the camera's
/// geometry.
pub fn delayed(
    source: Box<dyn PoseSource>,
    mode: DelayMode,
    camera: Option<&Camera>,
) -> Result<Box<dyn PoseSource>, LiveError> {
    if mode == DelayMode::Fixed(0.0) {
        return Ok(source);
    }
    if !source.has_own_clock() {
        return Err(LiveError::NoDelay);
    }
    let (delay, search) = match mode {
        DelayMode::Fixed(s) => (SlewedDelay { target_s: s, current_s: s, last_s: None }, None),
        DelayMode::Estimated => {
            let geometry =
                camera.and_then(|camera| camera.geometry.as_ref()).filter(|geometry| !geometry.needs_cube_map());
            let camera = geometry.ok_or(LiveError::DelayNeedsCamera)?.intrinsics.clone();
            (SlewedDelay::default(), Some(start_search(DelaySearch::new(camera, source.max_gap_s()))?))
        }
    };
    Ok(Box::new(DelayedSource {
        source,
        delay,
        search,
        message: None,
        has_reported_failure: false,
        returned_s: Vec::new(),
    }))
}

fn start_search(mut search: DelaySearch) -> Result<SearchThread, LiveError> {
    let (samples, queued_samples) = sync_channel(QUEUE_CAPACITY);
    let (results_sender, results) = sync_channel(QUEUE_CAPACITY);
    let run = move || {
        for sample in queued_samples {
            let result = match sample {
                DelaySample::Picture(time_s, picture, _waits) => search.add_picture(time_s, picture),
                DelaySample::Pose(time_s, pose) => {
                    search.add_pose(time_s, &pose);
                    None
                }
            };
            if let Some(Err(TrySendError::Disconnected(_))) = result.map(|result| results_sender.try_send(result)) {
                return;
            }
        }
    };
    std::thread::Builder::new().name("delay".to_owned()).spawn(run).map_err(LiveError::Thread)?;
    Ok(SearchThread { samples, results, queued_pictures: Arc::new(()) })
}

impl DelayedSource {
    fn apply(&mut self, estimate: Result<Delay, DelayError>) {
        match estimate {
            Ok(Delay { delay_s, sigma_s, likeness, motions, .. }) => {
                // The estimate is added to a frame's time to get the poses' time, so it is
                // subtracted from the poses' time.
                self.delay.target_s = -delay_s;
                self.message = Some(format!(
                    "the poses' delay is estimated: --delay {} ± {} s, by {}, correlation {}",
                    fixed(-delay_s, 4),
                    fixed(sigma_s, 4),
                    count(motions, "motion"),
                    fixed(likeness, 2)
                ));
            }
            Err(why) if !self.has_reported_failure => {
                self.has_reported_failure = true;
                let help = match why {
                    DelayError::NoDelay(DelayFailure::Still { .. }) => "; rotate the camera",
                    DelayError::NoDelay(DelayFailure::AtEnd { .. }) => {
                        "; set the stream's delay_s closer to the true delay"
                    }
                    _ => "",
                };
                self.message = Some(format!("the poses' delay is not found yet, and 0 is assumed: {why}{help}"));
            }
            Err(_) => {}
        }
    }
}

impl PoseSource for DelayedSource {
    fn add_picture(&mut self, time_s: f64, pixels: &Pixels) {
        self.source.add_picture(time_s, pixels);
        if let Some(search) = &self.search {
            if Arc::strong_count(&search.queued_pictures) <= MAX_QUEUED_PICTURES
                && let Some(picture) = ImagePyramid::new(pixels)
            {
                let _ =
                    search.samples.try_send(DelaySample::Picture(time_s, picture, Arc::clone(&search.queued_pictures)));
            }
            let estimates: Vec<_> = search.results.try_iter().collect();
            estimates.into_iter().for_each(|estimate| self.apply(estimate));
        }
    }

    fn take_poses(&mut self, until_s: f64) -> Result<Vec<(f64, Pose)>, LiveError> {
        let mut poses = self.source.take_poses(until_s - self.delay.current_s)?;
        self.returned_s.clear();
        for (time_s, pose) in &mut poses {
            let source_s = *time_s;
            if let Some(search) = &self.search {
                let _ = search.samples.try_send(DelaySample::Pose(*time_s, *pose));
            }
            *time_s = self.delay.camera_time_s(*time_s);
            self.returned_s.push([*time_s, source_s]);
        }
        Ok(poses)
    }

    fn has_lens_data(&self) -> bool {
        self.source.has_lens_data()
    }
    fn lens(&self, time_s: f64) -> Option<Arc<LensState>> {
        self.source.lens(self.returned_s.iter().find(|[camera_s, _]| *camera_s == time_s)?[1])
    }
    fn wait_for_lens(&mut self, size_px: (u32, u32), until: Instant) -> Option<Arc<LensState>> {
        self.source.wait_for_lens(size_px, until)
    }
    fn up(&self) -> Option<DVec3> {
        self.source.up()
    }
    fn has_floor(&self) -> bool {
        self.source.has_floor()
    }
    fn max_gap_s(&self) -> f64 {
        self.source.max_gap_s()
    }
    fn no_pose_reason(&self) -> Option<String> {
        self.source.no_pose_reason()
    }
    fn summary(&self) -> Option<String> {
        self.source.summary()
    }
    fn has_latency(&self) -> bool {
        self.source.has_latency()
    }
    // Covariances are not forwarded: the sources that have them (tags) have no delay.
    fn take_message(&mut self) -> Option<String> {
        self.message.take().or_else(|| self.source.take_message())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Distortion, Geometry, Intrinsics, LensModel};

    #[test]
    fn changed_delay_is_approached_without_a_jump() {
        let mut delay = SlewedDelay::default();
        assert_eq!(delay.camera_time_s(5.0), 5.0);
        delay.target_s = -0.08;
        // After 0.1 s the delay has changed by a hundredth of a second.
        assert!((delay.camera_time_s(5.1) - 5.09).abs() < 1e-12);
        let mut last_s = 5.09;
        for i in 1..100 {
            let time_s = 5.1 + 0.01 * f64::from(i);
            let camera_s = delay.camera_time_s(time_s);
            assert!((0.009 - 1e-9..0.01 + 1e-9).contains(&(camera_s - last_s)), "{camera_s} {last_s}");
            last_s = camera_s;
        }
        assert_eq!(delay.current_s, -0.08);
        // A late pose does not turn the clock back.
        delay.target_s = 0.0;
        assert_eq!(delay.camera_time_s(3.0), 2.92);
        assert!((delay.camera_time_s(6.1) - 6.021).abs() < 2e-3);
    }

    /// A source of one pose per hundredth of a second, by its own clock.
    struct Steady {
        next: u32,
        has_own_clock: bool,
    }

    impl PoseSource for Steady {
        fn take_poses(&mut self, until_s: f64) -> Result<Vec<(f64, Pose)>, LiveError> {
            let mut poses = Vec::new();
            while 0.01 * f64::from(self.next) <= until_s + 1e-9 {
                poses.push((0.01 * f64::from(self.next), Pose::IDENTITY));
                self.next += 1;
            }
            Ok(poses)
        }
        fn up(&self) -> Option<DVec3> {
            None
        }
        fn has_own_clock(&self) -> bool {
            self.has_own_clock
        }
    }

    fn steady(has_own_clock: bool) -> Box<Steady> {
        Box::new(Steady { next: 0, has_own_clock })
    }

    fn times_s(source: &mut dyn PoseSource, until_s: f64) -> Vec<f64> {
        source.take_poses(until_s).unwrap().into_iter().map(|(time_s, _)| time_s).collect()
    }

    #[test]
    fn fixed_delay_is_added_to_each_pose() {
        let mut shifted = delayed(steady(true), DelayMode::Fixed(0.5), None).unwrap();
        let times_s = times_s(&mut *shifted, 1.0);
        // The source was queried until 0.5 s of its own clock.
        assert_eq!((times_s.len(), times_s[0]), (51, 0.5));
        assert!((times_s[50] - 1.0).abs() < 1e-9);
    }

    /// Poses of [`Steady`], each with a different focal length, mm.
    struct Zooming(Steady);

    impl Zooming {
        fn focal_length_mm(n: u32) -> f64 {
            20.0 + f64::from(n)
        }
    }

    impl PoseSource for Zooming {
        fn take_poses(&mut self, until_s: f64) -> Result<Vec<(f64, Pose)>, LiveError> {
            self.0.take_poses(until_s)
        }
        fn lens(&self, time_s: f64) -> Option<Arc<LensState>> {
            let n = (0..self.0.next).find(|n| 0.01 * f64::from(*n) == time_s)?;
            let focal_length_mm = Some(Self::focal_length_mm(n));
            Some(Arc::new(LensState { focal_length_mm, ..LensState::default() }))
        }
        fn up(&self) -> Option<DVec3> {
            None
        }
    }

    #[test]
    fn lens_of_a_delayed_pose_is_that_of_the_original_pose() {
        let zooming = Zooming(*steady(true));
        let mut shifted = delayed(Box::new(zooming), DelayMode::Fixed(0.5), None).unwrap();
        let times_s = times_s(&mut *shifted, 1.0);
        assert_eq!(times_s.len(), 51);
        for (n, time_s) in (0..).zip(times_s) {
            let lens = shifted.lens(time_s).unwrap_or_else(|| panic!("no lens at {time_s} s"));
            assert_eq!(lens.focal_length_mm, Some(Zooming::focal_length_mm(n)), "at {time_s} s");
        }
    }

    fn source_with(delay: SlewedDelay, search: Option<SearchThread>) -> DelayedSource {
        DelayedSource {
            source: steady(true),
            delay,
            search,
            message: None,
            has_reported_failure: false,
            returned_s: Vec::new(),
        }
    }

    #[test]
    fn estimated_delay_is_subtracted_from_the_poses_and_reported() {
        let delay = SlewedDelay::default();
        let mut source = source_with(delay, None);
        let delay = Delay { delay_s: 0.08, sigma_s: 0.001, likeness: 0.9, ratio: 1.0, quarters: 0, motions: 90 };
        source.apply(Ok(delay));
        let message = source.take_message().unwrap();
        assert!(message.starts_with("the poses' delay is estimated: --delay -0.0800 ± 0.0010 s"), "{message}");
        // After a second the whole delay is applied.
        times_s(&mut source, 1.0);
        let after_s = times_s(&mut source, 1.5);
        assert!((source.delay.current_s + 0.08).abs() < 1e-12 && (after_s[0] - 0.93).abs() < 1e-9, "{after_s:?}");
    }

    #[test]
    fn undetermined_delay_is_reported_once() {
        let delay = SlewedDelay::default();
        let mut source = source_with(delay, None);
        let why = DelayError::Uncertain { sigma_s: 0.05 };
        source.apply(Err(why));
        assert!(
            source
                .take_message()
                .unwrap()
                .contains("is not found yet, and 0 is assumed: it is known only within ± 50 ms")
        );
        source.apply(Err(why));
        assert_eq!(source.take_message(), None);
    }

    #[test]
    fn delay_of_tag_poses_and_of_panoramas_is_refused() {
        assert!(matches!(delayed(steady(false), DelayMode::Fixed(0.1), None), Err(LiveError::NoDelay)));
        assert!(delayed(steady(false), DelayMode::Fixed(0.0), None).is_ok());
        assert!(matches!(delayed(steady(true), DelayMode::Estimated, None), Err(LiveError::DelayNeedsCamera)));
        let intrinsics = Intrinsics { width_px: 640, height_px: 320, ..Intrinsics::default() };
        let camera = |model| {
            let geometry = Geometry::new(intrinsics.clone(), Distortion { model, ..Distortion::default() });
            Camera { geometry: Some(geometry), ..Camera::default() }
        };
        let around = delayed(steady(true), DelayMode::Estimated, Some(&camera(LensModel::Equirectangular)));
        assert!(matches!(around, Err(LiveError::DelayNeedsCamera)));
        assert!(delayed(steady(true), DelayMode::Estimated, Some(&camera(LensModel::Opencv))).is_ok());
    }

    #[test]
    fn search_queue_holds_few_pictures() {
        let (samples, queued_samples) = sync_channel(QUEUE_CAPACITY);
        let (_, results) = sync_channel(1);
        let search = Some(SearchThread { samples, results, queued_pictures: Arc::new(()) });
        let delay = SlewedDelay::default();
        let mut busy = source_with(delay, search);
        let pixels = Pixels::from_u8(64, 48, vec![7; 3 * 64 * 48]).unwrap();
        (0..50).for_each(|n| busy.add_picture(f64::from(n), &pixels));
        assert_eq!(queued_samples.try_iter().count(), MAX_QUEUED_PICTURES);
        // The queue was drained, so further pictures fit.
        (50..100).for_each(|n| busy.add_picture(f64::from(n), &pixels));
        assert_eq!(queued_samples.try_iter().count(), MAX_QUEUED_PICTURES);
    }
}
