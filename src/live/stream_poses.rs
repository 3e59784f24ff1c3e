//! Poses of a network stream, converted to the camera's clock.

use std::collections::VecDeque;
use std::net::SocketAddr;
use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use glam::DVec3;

use super::error::LiveError;
use super::pose_source::PoseSource;
use crate::pose::Pose;
use crate::stream::{LensState, Poses, Protocol, Report};
use crate::text::fixed;
use crate::webcam::monotonic_s;

/// Capacity for poses that arrive while the first lens data is awaited.
const EARLY_CAPACITY: usize = 256;
/// A stream counts as silent after this time without a pose, seconds.
const SILENCE_S: f64 = 0.4;

/// A pose by the monotonic clock, with the lens state at that time.
type LensedPose = (f64, Pose, Arc<LensState>);

/// A stream that is received on a thread of its own.
pub struct StreamPoses {
    received: Receiver<Result<LensedPose, LiveError>>,
    /// Received while the first lens data was awaited.
    early: VecDeque<Result<LensedPose, LiveError>>,
    /// Lens states of the last returned poses.
    lenses: Vec<(f64, Arc<LensState>)>,
    has_lens_data: bool,
    url: String,
    /// Local address that receives the stream.
    local_address: SocketAddr,
    /// Arrival of the last pose, or the start.
    last_s: f64,
    /// Statistics of the receiver.
    report: Arc<Mutex<Report>>,
    /// Number of clock steps at the last message.
    reported_steps: u64,
    /// The thread ends when this is dropped.
    _alive: Arc<()>,
}

fn lock(report: &Mutex<Report>) -> MutexGuard<'_, Report> {
    // A panic while the lock is held leaves no partial state.
    report.lock().unwrap_or_else(PoisonError::into_inner)
}

impl StreamPoses {
    pub fn open(url: &str) -> Result<Self, LiveError> {
        let mut poses = Poses::open(url)?;
        let local_address = poses.address();
        let (sender, received) = sync_channel(1024);
        let (alive, report) = (Arc::new(()), Arc::new(Mutex::new(Report::default())));
        let thread_report = Arc::clone(&report);
        let is_alive = Arc::downgrade(&alive);
        let receive = move || {
            while is_alive.strong_count() > 0 {
                let next = poses.next(Instant::now() + Duration::from_millis(200));
                lock(&thread_report).clone_from(poses.report());
                let item = match next {
                    Ok(None) => continue,
                    Ok(Some(tracked)) => {
                        // The monotonic clock minus the receiver's.
                        let receiver_s = monotonic_s() - poses.seconds_now();
                        let ours_s = tracked.time_s + tracked.offset_s + receiver_s;
                        Ok((ours_s, tracked.pose, tracked.lens))
                    }
                    Err(error) => Err(error.into()),
                };
                let is_last = item.is_err();
                if sender.send(item).is_err() || is_last {
                    return;
                }
            }
        };
        std::thread::Builder::new().name("poses".to_owned()).spawn(receive).map_err(LiveError::Thread)?;
        Ok(Self {
            received,
            early: VecDeque::new(),
            lenses: Vec::new(),
            has_lens_data: Protocol::of(url) == Some(Protocol::OpenTrackIo),
            url: url.to_owned(),
            local_address,
            last_s: monotonic_s(),
            report,
            reported_steps: 0,
            _alive: alive,
        })
    }
}

impl PoseSource for StreamPoses {
    fn take_poses(&mut self, _: f64) -> Result<Vec<(f64, Pose)>, LiveError> {
        let received: Vec<LensedPose> =
            self.early.drain(..).chain(self.received.try_iter()).collect::<Result<_, _>>()?;
        if !received.is_empty() {
            self.last_s = monotonic_s();
        }
        self.lenses = received.iter().map(|(time_s, _, lens)| (*time_s, Arc::clone(lens))).collect();
        Ok(received.into_iter().map(|(time_s, pose, _)| (time_s, pose)).collect())
    }
    fn has_lens_data(&self) -> bool {
        self.has_lens_data
    }
    fn lens(&self, time_s: f64) -> Option<Arc<LensState>> {
        self.lenses.iter().find(|(lens_s, _)| *lens_s == time_s).map(|(_, lens)| Arc::clone(lens))
    }
    fn wait_for_lens(&mut self, (width, height): (u32, u32), until: Instant) -> Option<Arc<LensState>> {
        let mut latest = None;
        while let Ok(item) = self.received.recv_timeout(until.saturating_duration_since(Instant::now())) {
            if let Ok((_, _, lens)) = &item {
                latest = Some(Arc::clone(lens));
            }
            // The oldest poses are of no use to future pictures.
            if self.early.len() >= EARLY_CAPACITY {
                self.early.pop_front();
            }
            self.early.push_back(item);
            if latest.as_ref().is_some_and(|lens| lens.geometry(width, height).is_ok()) {
                break;
            }
        }
        latest
    }
    fn take_message(&mut self) -> Option<String> {
        let (steps, by_s) = {
            let report = lock(&self.report);
            (report.steps + report.jumps, report.last_step_s)
        };
        // Repeated steps are reported at doubling counts.
        if steps < (2 * self.reported_steps).max(1) {
            return None;
        }
        self.reported_steps = steps;
        Some(format!("the clock of {} was reset by {} s, and is followed", self.url, fixed(by_s, 3)))
    }
    fn no_pose_reason(&self) -> Option<String> {
        let silent_s = monotonic_s() - self.last_s;
        let (url, local_address) = (&self.url, self.local_address);
        (silent_s > SILENCE_S).then(|| {
            let why = lock(&self.report).silence_reason();
            format!(
                "{url}, received at {local_address}, has been silent for {silent_s:.1} s: {why} (`locard inspect \
                 {url}` shows what arrives)"
            )
        })
    }
    fn summary(&self) -> Option<String> {
        Some(format!("{}: {}", self.url, lock(&self.report).summary()))
    }
    fn up(&self) -> Option<DVec3> {
        Some(DVec3::Z)
    }
    /// A stage's origin lies on its floor.
    fn has_floor(&self) -> bool {
        true
    }
}
