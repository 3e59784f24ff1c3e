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
use crate::stream::{Clock, LensState, Poses, Protocol, Report};
use crate::webcam::monotonic_s;

/// How far the sender's clock is from ours: by the pose that came fastest among those of the last seconds, for what is
/// late was held up on the way.
#[derive(Debug, Default)]
pub struct ClockOffset {
    epoch: Option<u32>,
    since_s: f64,
    /// Of this span and the one before, seconds.
    least_s: [Option<f64>; 2],
}

impl ClockOffset {
    /// Clocks of 50 ppm drift apart by half a millisecond in such a span, seconds.
    const SPAN_S: f64 = 10.0;

    /// Our time for a sender's, which has just come.
    pub fn ours(&mut self, epoch: u32, time_s: f64, arrived_s: f64) -> f64 {
        if self.epoch != Some(epoch) {
            *self = Self { epoch: Some(epoch), since_s: arrived_s, least_s: [None; 2] };
        }
        if arrived_s - self.since_s > Self::SPAN_S {
            self.since_s = arrived_s;
            self.least_s = [None, self.least_s[0]];
        }
        let offset_s = arrived_s - time_s;
        self.least_s[0] = Some(self.least_s[0].map_or(offset_s, |least| least.min(offset_s)));
        time_s + self.least_s.iter().flatten().fold(f64::INFINITY, |a, b| a.min(*b))
    }
}

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
        let (delay_s, at) = (poses.delay_s(), poses.address());
        let (sender, received) = sync_channel(1024);
        let (wanted, report) = (Arc::new(()), Arc::new(Mutex::new(Report::default())));
        let heard = Arc::clone(&report);
        let still = Arc::downgrade(&wanted);
        let listen = move || {
            let mut clock = ClockOffset::default();
            while still.strong_count() > 0 {
                let next = poses.next(Instant::now() + Duration::from_millis(200));
                lock(&heard).clone_from(poses.report());
                let item = match next {
                    Ok(None) => continue,
                    Ok(Some(tracked)) => {
                        // The delay is not the clock's.
                        let (now_s, time_s) = (monotonic_s(), tracked.time_s - delay_s);
                        let ours_s = match tracked.clock {
                            Clock::Arrival => now_s - (poses.seconds_now() - tracked.arrived_s),
                            _ => clock.ours(tracked.epoch, time_s, now_s),
                        };
                        Ok((ours_s + delay_s, tracked.pose, tracked.lens))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fastest_pose_tells_the_clock() {
        let mut offset = ClockOffset::default();
        // Sent at 100, 100.1, 100.2 by its clock, which is 95 s before ours; held up by 30, 5 and 50 ms.
        assert!((offset.ours(0, 100.0, 5.03) - 5.03).abs() < 1e-9);
        assert!((offset.ours(0, 100.1, 5.105) - 5.105).abs() < 1e-9);
        assert!((offset.ours(0, 100.2, 5.25) - 5.205).abs() < 1e-9);
        // The sender's clock falls behind by 1 ms; two spans later the old offset is forgotten.
        assert!((offset.ours(0, 110.3, 15.306) - 15.305).abs() < 1e-9);
        assert!((offset.ours(0, 121.0, 26.006) - 26.006).abs() < 1e-9);
        // Another clock.
        assert!((offset.ours(1, 7.0, 27.0) - 27.0).abs() < 1e-9);
    }
}
