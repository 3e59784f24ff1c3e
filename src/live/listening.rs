//! Poses of a stream, by the camera's clock.

use std::collections::VecDeque;
use std::net::SocketAddr;
use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use glam::DVec3;

use super::error::LiveError;
use super::source::PoseSource;
use crate::pose::Pose;
use crate::stream::{LensState, Poses, Protocol, Report};
use crate::text::fixed;
use crate::webcam::monotonic_s;

/// Poses that are kept while a lens is waited for.
const EARLY: usize = 256;
/// Without a pose for so long a stream is said to be silent, seconds.
const SILENT_S: f64 = 0.4;

/// A pose by our clock, and what was said of the lens by then.
type Heard = (f64, Pose, Arc<LensState>);

/// A stream, heard by a thread of its own.
pub struct Streamed {
    received: Receiver<Result<Heard, LiveError>>,
    /// What came while a lens was waited for.
    early: VecDeque<Result<Heard, LiveError>>,
    /// What was said with the poses that were given last.
    lenses: Vec<(f64, Arc<LensState>)>,
    says_lens: bool,
    url: String,
    /// Where it is heard.
    at: SocketAddr,
    /// When the last pose came, or it began to listen.
    last_s: f64,
    /// What was heard by now.
    report: Arc<Mutex<Report>>,
    /// How many steps of its clock were told.
    steps_told: u64,
    /// While it lives, the thread listens.
    _wanted: Arc<()>,
}

fn lock(report: &Mutex<Report>) -> MutexGuard<'_, Report> {
    // A panic under the lock leaves plain values.
    report.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Streamed {
    pub fn open(url: &str) -> Result<Self, LiveError> {
        let mut poses = Poses::open(url)?;
        let at = poses.address();
        let (sender, received) = sync_channel(1024);
        let (wanted, report) = (Arc::new(()), Arc::new(Mutex::new(Report::default())));
        let heard = Arc::clone(&report);
        let still = Arc::downgrade(&wanted);
        let listen = move || {
            while still.strong_count() > 0 {
                let next = poses.next(Instant::now() + Duration::from_millis(200));
                lock(&heard).clone_from(poses.report());
                let item = match next {
                    Ok(None) => continue,
                    Ok(Some(tracked)) => {
                        // Our clock minus the receiver's.
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
        std::thread::Builder::new().name("poses".to_owned()).spawn(listen).map_err(LiveError::Thread)?;
        Ok(Self {
            received,
            early: VecDeque::new(),
            lenses: Vec::new(),
            says_lens: Protocol::of(url) == Some(Protocol::OpenTrackIo),
            url: url.to_owned(),
            at,
            last_s: monotonic_s(),
            report,
            steps_told: 0,
            _wanted: wanted,
        })
    }
}

impl PoseSource for Streamed {
    fn poses(&mut self, _: f64) -> Result<Vec<(f64, Pose)>, LiveError> {
        let heard: Vec<Heard> = self.early.drain(..).chain(self.received.try_iter()).collect::<Result<_, _>>()?;
        if !heard.is_empty() {
            self.last_s = monotonic_s();
        }
        self.lenses = heard.iter().map(|(time_s, _, lens)| (*time_s, Arc::clone(lens))).collect();
        Ok(heard.into_iter().map(|(time_s, pose, _)| (time_s, pose)).collect())
    }
    fn says_lens(&self) -> bool {
        self.says_lens
    }
    fn lens(&self, time_s: f64) -> Option<Arc<LensState>> {
        self.lenses.iter().find(|(said_s, _)| *said_s == time_s).map(|(_, lens)| Arc::clone(lens))
    }
    fn first_lens(&mut self, (width, height): (u32, u32), until: Instant) -> Option<Arc<LensState>> {
        let mut known = None;
        while let Ok(item) = self.received.recv_timeout(until.saturating_duration_since(Instant::now())) {
            if let Ok((_, _, lens)) = &item {
                known = Some(Arc::clone(lens));
            }
            // The oldest are of no use to pictures that are still to come.
            if self.early.len() >= EARLY {
                self.early.pop_front();
            }
            self.early.push_back(item);
            if known.as_ref().is_some_and(|lens| lens.geometry(width, height).is_ok()) {
                break;
            }
        }
        known
    }
    fn told(&mut self) -> Option<String> {
        let (steps, by_s) = {
            let report = lock(&self.report);
            (report.steps + report.jumps, report.last_step_s)
        };
        // One that goes on so is told less and less often.
        if steps < (2 * self.steps_told).max(1) {
            return None;
        }
        self.steps_told = steps;
        Some(format!("the clock of {} was set anew, by {} s, and is followed", self.url, fixed(by_s, 3)))
    }
    fn lacks(&self) -> Option<String> {
        let silent_s = monotonic_s() - self.last_s;
        let (url, at) = (&self.url, self.at);
        (silent_s > SILENT_S).then(|| {
            let why = lock(&self.report).silence();
            format!(
                "{url}, heard at {at}, is silent for {silent_s:.1} s: {why} (`locard inspect {url}` says what comes)"
            )
        })
    }
    fn closing(&self) -> Option<String> {
        Some(format!("{}: {}", self.url, lock(&self.report).closing()))
    }
    fn up(&self) -> Option<DVec3> {
        Some(DVec3::Z)
    }
    /// A stage's origin lies on its floor.
    fn has_floor(&self) -> bool {
        true
    }
}
