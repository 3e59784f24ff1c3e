//! Poses whose clock is not the camera's: a delay that is told, or found in the pictures while they come.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::time::Instant;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::delay_search::{DelaySearch, Unknown};
use super::error::LiveError;
use super::source::PoseSource;
use crate::camera::Camera;
use crate::pixels::Pixels;
use crate::pose::Pose;
use crate::stream::LensState;
use crate::text::{count, fixed};
use crate::tracking::delay::{Delay, NoDelay};
use crate::tracking::turn::Reduced;

/// What is added to the time of each pose.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Added {
    /// So much, seconds.
    Told(f64),
    /// What fits the pictures.
    Found,
}

impl Default for Added {
    fn default() -> Self {
        Self::Told(0.0)
    }
}

/// The delay that is used follows the one that is wanted by so much of the poses' time: evidence goes a tenth faster or slower
/// for a while, and never jumps.
const SLEW: f64 = 0.1;
/// What is on its way to the search at once, and how many pictures of it. What is more is left out of it: a slow machine
/// compares pictures that are farther apart.
const MOST: usize = 4096;
const MOST_PICTURES: usize = 4;

/// The delay that is in use.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Following {
    wanted_s: f64,
    used_s: f64,
    last_s: Option<f64>,
}

impl Following {
    /// The time by the camera's clock of a pose. Times that ascend do so again.
    fn ours(&mut self, time_s: f64) -> f64 {
        let most_s = SLEW * self.last_s.map_or(0.0, |last_s| (time_s - last_s).max(0.0));
        self.used_s += (self.wanted_s - self.used_s).clamp(-most_s, most_s);
        self.last_s = Some(self.last_s.map_or(time_s, |last_s| last_s.max(time_s)));
        time_s + self.used_s
    }
}

enum Seen {
    /// With what counts those that wait.
    Picture(f64, Reduced, Arc<()>),
    Pose(f64, Pose),
}

struct Search {
    seen: SyncSender<Seen>,
    found: Receiver<Result<Delay, Unknown>>,
    waiting: Arc<()>,
}

/// A source's poses at other times.
struct Delayed {
    source: Box<dyn PoseSource>,
    following: Following,
    /// On a thread of its own, which ends with this.
    search: Option<Search>,
    told: Option<String>,
    has_refused: bool,
    /// The times of the poses that were given last: ours, and theirs.
    given: Vec<[f64; 2]>,
}

/// Delays the poses of a source. The camera's geometry is needed to find the delay.
pub fn delayed(
    source: Box<dyn PoseSource>,
    added: Added,
    camera: Option<&Camera>,
) -> Result<Box<dyn PoseSource>, LiveError> {
    if added == Added::Told(0.0) {
        return Ok(source);
    }
    if !source.has_clock() {
        return Err(LiveError::NoDelay);
    }
    let (following, search) = match added {
        Added::Told(s) => (Following { wanted_s: s, used_s: s, last_s: None }, None),
        Added::Found => {
            let geometry =
                camera.and_then(|camera| camera.geometry.as_ref()).filter(|geometry| !geometry.sees_around());
            let camera = geometry.ok_or(LiveError::DelayNeedsCamera)?.intrinsics.clone();
            (Following::default(), Some(begin(DelaySearch::new(camera, source.max_gap_s()))?))
        }
    };
    Ok(Box::new(Delayed { source, following, search, told: None, has_refused: false, given: Vec::new() }))
}

fn begin(mut search: DelaySearch) -> Result<Search, LiveError> {
    let (seen, coming) = sync_channel(MOST);
    let (tell, found) = sync_channel(MOST);
    let look = move || {
        for seen in coming {
            let result = match seen {
                Seen::Picture(time_s, picture, _waits) => search.picture(time_s, picture),
                Seen::Pose(time_s, pose) => {
                    search.pose(time_s, &pose);
                    None
                }
            };
            if let Some(Err(TrySendError::Disconnected(_))) = result.map(|result| tell.try_send(result)) {
                return;
            }
        }
    };
    std::thread::Builder::new().name("delay".to_owned()).spawn(look).map_err(LiveError::Thread)?;
    Ok(Search { seen, found, waiting: Arc::new(()) })
}

impl Delayed {
    fn take(&mut self, found: Result<Delay, Unknown>) {
        match found {
            Ok(Delay { delay_s, sigma_s, likeness, motions, .. }) => {
                // What is added to a frame's time to get the poses' is taken from theirs.
                self.following.wanted_s = -delay_s;
                self.told = Some(format!(
                    "the poses' delay is found: --delay {} ± {} s, by {}, likeness {}",
                    fixed(-delay_s, 4),
                    fixed(sigma_s, 4),
                    count(motions, "motion"),
                    fixed(likeness, 2)
                ));
            }
            Err(why) if !self.has_refused => {
                self.has_refused = true;
                let help = match why {
                    Unknown::NoDelay(NoDelay::Still { .. }) => "; turn the camera about",
                    Unknown::NoDelay(NoDelay::AtEnd { .. }) => "; begin nearer to it, by the stream's delay_s",
                    _ => "",
                };
                self.told = Some(format!("the poses' delay is not found yet, and is taken for 0: {why}{help}"));
            }
            Err(_) => {}
        }
    }
}

impl PoseSource for Delayed {
    fn picture(&mut self, time_s: f64, pixels: &Pixels) {
        self.source.picture(time_s, pixels);
        if let Some(search) = &self.search {
            if Arc::strong_count(&search.waiting) <= MOST_PICTURES
                && let Some(picture) = Reduced::new(pixels)
            {
                let _ = search.seen.try_send(Seen::Picture(time_s, picture, Arc::clone(&search.waiting)));
            }
            let found: Vec<_> = search.found.try_iter().collect();
            found.into_iter().for_each(|found| self.take(found));
        }
    }

    fn poses(&mut self, until_s: f64) -> Result<Vec<(f64, Pose)>, LiveError> {
        let mut poses = self.source.poses(until_s - self.following.used_s)?;
        self.given.clear();
        for (time_s, pose) in &mut poses {
            let theirs_s = *time_s;
            if let Some(search) = &self.search {
                let _ = search.seen.try_send(Seen::Pose(*time_s, *pose));
            }
            *time_s = self.following.ours(*time_s);
            self.given.push([*time_s, theirs_s]);
        }
        Ok(poses)
    }

    fn says_lens(&self) -> bool {
        self.source.says_lens()
    }
    fn lens(&self, time_s: f64) -> Option<Arc<LensState>> {
        self.source.lens(self.given.iter().find(|[ours_s, _]| *ours_s == time_s)?[1])
    }
    fn first_lens(&mut self, size_px: (u32, u32), until: Instant) -> Option<Arc<LensState>> {
        self.source.first_lens(size_px, until)
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
    fn lacks(&self) -> Option<String> {
        self.source.lacks()
    }
    fn closing(&self) -> Option<String> {
        self.source.closing()
    }
    fn are_awaited(&self) -> bool {
        self.source.are_awaited()
    }
    // What has a delay has no covariances: poses of tags are the pictures' own.
    fn told(&mut self) -> Option<String> {
        self.told.take().or_else(|| self.source.told())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Distortion, Geometry, Intrinsics, LensModel};

    #[test]
    fn a_delay_that_changes_is_followed_without_a_jump() {
        let mut following = Following::default();
        assert_eq!(following.ours(5.0), 5.0);
        following.wanted_s = -0.08;
        // 0.1 s later: by a hundredth of a second.
        assert!((following.ours(5.1) - 5.09).abs() < 1e-12);
        let mut last_s = 5.09;
        for i in 1..100 {
            let time_s = 5.1 + 0.01 * f64::from(i);
            let ours_s = following.ours(time_s);
            assert!((0.009 - 1e-9..0.01 + 1e-9).contains(&(ours_s - last_s)), "{ours_s} {last_s}");
            last_s = ours_s;
        }
        assert_eq!(following.used_s, -0.08);
        // One that came late does not turn time back.
        following.wanted_s = 0.0;
        assert_eq!(following.ours(3.0), 2.92);
        assert!((following.ours(6.1) - 6.021).abs() < 2e-3);
    }

    /// A pose every hundredth of a second, by its own clock.
    struct Steady {
        next: u32,
        has_clock: bool,
    }

    impl PoseSource for Steady {
        fn poses(&mut self, until_s: f64) -> Result<Vec<(f64, Pose)>, LiveError> {
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
        fn has_clock(&self) -> bool {
            self.has_clock
        }
    }

    fn steady(has_clock: bool) -> Box<Steady> {
        Box::new(Steady { next: 0, has_clock })
    }

    fn times_s(source: &mut dyn PoseSource, until_s: f64) -> Vec<f64> {
        source.poses(until_s).unwrap().into_iter().map(|(time_s, _)| time_s).collect()
    }

    #[test]
    fn what_is_told_is_added_to_each_pose_and_asked_for_beforehand() {
        let mut late = delayed(steady(true), Added::Told(0.5), None).unwrap();
        let times_s = times_s(&mut *late, 1.0);
        // By its own clock until 0.5 s.
        assert_eq!((times_s.len(), times_s[0]), (51, 0.5));
        assert!((times_s[50] - 1.0).abs() < 1e-9);
    }

    /// Poses of [`Steady`], each with a focal length of its own, mm.
    struct Zooming(Steady);

    impl Zooming {
        fn focal_length_mm(n: u32) -> f64 {
            20.0 + f64::from(n)
        }
    }

    impl PoseSource for Zooming {
        fn poses(&mut self, until_s: f64) -> Result<Vec<(f64, Pose)>, LiveError> {
            self.0.poses(until_s)
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
    fn lens_of_a_delayed_pose_is_the_one_that_came_with_it() {
        let zooming = Zooming(*steady(true));
        let mut late = delayed(Box::new(zooming), Added::Told(0.5), None).unwrap();
        let times_s = times_s(&mut *late, 1.0);
        assert_eq!(times_s.len(), 51);
        for (n, time_s) in (0..).zip(times_s) {
            let lens = late.lens(time_s).unwrap_or_else(|| panic!("no lens at {time_s} s"));
            assert_eq!(lens.focal_length_mm, Some(Zooming::focal_length_mm(n)), "at {time_s} s");
        }
    }

    fn delayed_by(following: Following, search: Option<Search>) -> Delayed {
        Delayed { source: steady(true), following, search, told: None, has_refused: false, given: Vec::new() }
    }

    #[test]
    fn what_is_found_is_taken_from_the_poses_and_told() {
        let following = Following::default();
        let mut found = delayed_by(following, None);
        let delay = Delay { delay_s: 0.08, sigma_s: 0.001, likeness: 0.9, ratio: 1.0, quarters: 0, motions: 90 };
        found.take(Ok(delay));
        let told = found.told().unwrap();
        assert!(told.starts_with("the poses' delay is found: --delay -0.0800 ± 0.0010 s"), "{told}");
        // A second later it is followed whole.
        times_s(&mut found, 1.0);
        let after_s = times_s(&mut found, 1.5);
        assert!((found.following.used_s + 0.08).abs() < 1e-12 && (after_s[0] - 0.93).abs() < 1e-9, "{after_s:?}");
    }

    #[test]
    fn that_it_is_not_found_is_told_once() {
        let following = Following::default();
        let mut lost = delayed_by(following, None);
        let why = Unknown::Unsure { sigma_s: 0.05 };
        lost.take(Err(why));
        assert!(lost.told().unwrap().contains("is not found yet, and is taken for 0: it is known within ± 50 ms only"));
        lost.take(Err(why));
        assert_eq!(lost.told(), None);
    }

    #[test]
    fn poses_of_the_pictures_themselves_and_pictures_all_around_have_no_delay() {
        assert!(matches!(delayed(steady(false), Added::Told(0.1), None), Err(LiveError::NoDelay)));
        assert!(delayed(steady(false), Added::Told(0.0), None).is_ok());
        assert!(matches!(delayed(steady(true), Added::Found, None), Err(LiveError::DelayNeedsCamera)));
        let intrinsics = Intrinsics { width_px: 640, height_px: 320, ..Intrinsics::default() };
        let of = |model| {
            let geometry = Geometry::new(intrinsics.clone(), Distortion { model, ..Distortion::default() });
            Camera { geometry: Some(geometry), ..Camera::default() }
        };
        let around = delayed(steady(true), Added::Found, Some(&of(LensModel::Equirectangular)));
        assert!(matches!(around, Err(LiveError::DelayNeedsCamera)));
        assert!(delayed(steady(true), Added::Found, Some(&of(LensModel::Opencv))).is_ok());
    }

    #[test]
    fn few_pictures_wait_for_the_search() {
        let ((seen, coming), (_, found)) = (sync_channel(MOST), sync_channel(1));
        let search = Some(Search { seen, found, waiting: Arc::new(()) });
        let following = Following::default();
        let mut busy = delayed_by(following, search);
        let pixels = Pixels::from_u8(64, 48, vec![7; 3 * 64 * 48]).unwrap();
        (0..50).for_each(|n| busy.picture(f64::from(n), &pixels));
        assert_eq!(coming.try_iter().count(), MOST_PICTURES);
        // They are looked at, and others come.
        (50..100).for_each(|n| busy.picture(f64::from(n), &pixels));
        assert_eq!(coming.try_iter().count(), MOST_PICTURES);
    }
}
