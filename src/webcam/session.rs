//! A camera's life, for every driver: opening, stalls, reopening after it was unplugged, drops and
//! times.
//!
//! A driver may block without end, so each capture has a thread of its own. The session waits for
//! its pictures, and leaves behind a thread that does not return.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, SyncSender};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::driver::{Driver, DriverPicture, DriverStream};
use super::error::CameraError;
use super::frame_clock::FrameClock;
use super::latest::{Drops, LatestSender};
use super::negotiation::{FormatRequest, NegotiatedFormat};
use super::picture::{Picture, PictureFormat};

/// Time limits of a driver.
#[derive(Clone, Copy, Debug)]
pub struct SessionLimits {
    /// Time from the start to the first picture. On macOS and Windows the stream begins then.
    pub first_picture: Duration,
    /// Longest time between two pictures. After it a camera counts as stalled.
    pub picture: Duration,
    /// Time from the call to the open camera. Media Foundation takes seconds.
    pub opening: Duration,
    /// Time between two attempts to reopen a camera.
    pub retry: Duration,
}

impl Default for SessionLimits {
    fn default() -> Self {
        Self {
            first_picture: Duration::from_secs(15),
            picture: Duration::from_secs(2),
            opening: Duration::from_secs(15),
            retry: Duration::from_millis(500),
        }
    }
}

/// Threads that may be blocked in the driver at once. With more of them the camera is not reopened.
pub const MAX_BLOCKED_THREADS: usize = 4;
/// How often a waiting session checks that its pictures are still taken.
const CHECK_EVERY: Duration = Duration::from_millis(100);

/// Runs a call into a driver. A panic becomes an error.
pub fn guarded<T>(call: impl FnOnce() -> T) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(call)).map_err(|_| "its driver failed".to_owned())
}

/// The camera that a capture's thread opens.
#[derive(Clone)]
struct Request {
    id: String,
    /// The camera's name, if it was open before: it is looked up first, for it may have another id.
    name: Option<String>,
    requested: FormatRequest,
}

/// A camera that was opened, with its present id.
struct Agreement {
    id: String,
    negotiated: NegotiatedFormat,
}

impl Request {
    /// The camera, for a message.
    fn camera(&self) -> String {
        self.name.as_ref().unwrap_or(&self.id).clone()
    }

    fn open(&self, driver: &dyn Driver) -> Result<(Box<dyn DriverStream>, Agreement), CameraError> {
        let id = match &self.name {
            Some(name) => driver.find(&self.id, name),
            None => Some(self.id.clone()),
        };
        let id = id.ok_or_else(|| CameraError::Unplugged { camera: self.camera() })?;
        let (capture, negotiated) = driver.open(&id, &self.requested)?;
        Ok((capture, Agreement { id, negotiated }))
    }
}

/// A report of a capture's thread.
enum Event {
    Opened(Agreement),
    Refused(CameraError),
    Sample(DriverPicture),
    /// The last picture came.
    Over,
    /// The capture has failed, and is being closed. Its thread ends afterwards.
    Failed(String),
}

/// A capture on its thread. Dropped, it lets the thread end after its next picture.
struct Worker {
    events: Receiver<Event>,
    /// Dropped without a message, the capture is closed again.
    start: SyncSender<()>,
    thread: JoinHandle<()>,
}

impl Worker {
    /// Opens a camera on a thread of its own. A thread that does not answer in time is added to
    /// `blocked`.
    fn open(
        driver: &Arc<dyn Driver>,
        request: &Request,
        limit: Duration,
        blocked: &mut Vec<JoinHandle<()>>,
    ) -> Result<(Self, Agreement), CameraError> {
        let (to_session, events) = mpsc::sync_channel(1);
        let (start, started) = mpsc::sync_channel(1);
        let (driver, of_thread) = (Arc::clone(driver), request.clone());
        let named = std::thread::Builder::new().name("capture".to_owned());
        let work = move || work(&*driver, &of_thread, &to_session, &started);
        let thread = named.spawn(work).map_err(CameraError::Thread)?;
        let worker = Self { events, start, thread };
        match worker.events.recv_timeout(limit) {
            Ok(Event::Opened(agreement)) => Ok((worker, agreement)),
            Ok(Event::Refused(error)) => Err(error),
            _ => {
                blocked.push(worker.thread);
                Err(CameraError::NoAnswer { camera: request.camera(), seconds: limit.as_secs_f64() })
            }
        }
    }
}

/// A capture's thread: finds the camera and opens it, waits for the start, and reports its pictures
/// until nobody receives them.
fn work(driver: &dyn Driver, request: &Request, events: &SyncSender<Event>, started: &Receiver<()>) {
    let broken = |problem| Err(CameraError::Driver { camera: request.camera(), problem });
    let mut capture: Box<dyn DriverStream> = match guarded(|| request.open(driver)).unwrap_or_else(broken) {
        Ok((capture, agreement)) => {
            if events.send(Event::Opened(agreement)).is_err() {
                return close(capture);
            }
            capture
        }
        Err(error) => return drop(events.send(Event::Refused(error))),
    };
    if started.recv().is_err() {
        return close(capture);
    }
    let last = loop {
        match guarded(|| capture.next()) {
            Ok(Ok(Some(sample))) => {
                if events.send(Event::Sample(sample)).is_err() {
                    return close(capture);
                }
            }
            Ok(Ok(None)) => break Event::Over,
            Ok(Err(problem)) | Err(problem) => break Event::Failed(problem),
        }
    };
    // Reported first: closing may block without end.
    let _ = events.send(last);
    close(capture);
}

fn close(capture: Box<dyn DriverStream>) {
    let _ = guarded(|| drop(capture));
}

/// A camera that is open, and delivers from [`CaptureSession::run`] on.
pub struct CaptureSession {
    driver: Arc<dyn Driver>,
    id: String,
    requested: FormatRequest,
    negotiated: NegotiatedFormat,
    limits: SessionLimits,
    worker: Option<Worker>,
    /// Threads that were left behind in the driver.
    blocked: Vec<JoinHandle<()>>,
    clock: FrameClock,
}

impl CaptureSession {
    pub fn open(
        driver: Arc<dyn Driver>,
        id: &str,
        requested: &FormatRequest,
        limits: SessionLimits,
    ) -> Result<(Self, NegotiatedFormat), CameraError> {
        let mut blocked = Vec::new();
        let request = Request { id: id.to_owned(), name: None, requested: *requested };
        let (worker, Agreement { id, negotiated }) = Worker::open(&driver, &request, limits.opening, &mut blocked)?;
        let session = Self {
            driver,
            id,
            requested: *requested,
            negotiated: negotiated.clone(),
            limits,
            worker: Some(worker),
            blocked,
            clock: FrameClock::default(),
        };
        Ok((session, negotiated))
    }

    /// Delivers until nobody takes pictures any more. A camera that stops is waited for, and
    /// reopened.
    pub fn run(mut self, sender: &LatestSender<Picture>) {
        while !sender.is_over() {
            let worker = self.worker.take().map_or_else(|| self.reopened(), Ok);
            match worker.and_then(|worker| self.deliver(worker, sender)) {
                Ok(()) => return,
                Err(problem) => sender.set_unavailable(problem),
            }
            if !self.driver.is_live() {
                return;
            }
            sender.wait(self.limits.retry);
        }
    }

    /// Opens the camera again under its present id. It must deliver the same format as before.
    fn reopened(&mut self) -> Result<Worker, String> {
        let name = &self.negotiated.name;
        self.blocked.retain(|thread| !thread.is_finished());
        if self.blocked.len() >= MAX_BLOCKED_THREADS {
            let count = self.blocked.len();
            return Err(format!("{name}: {count} attempts wait for its driver; unplug it, or restart the program"));
        }
        let request = Request { id: self.id.clone(), name: Some(name.clone()), requested: self.requested };
        let opened = Worker::open(&self.driver, &request, self.limits.opening, &mut self.blocked);
        let (worker, Agreement { id, negotiated }) = opened.map_err(|error| error.to_string())?;
        if negotiated.picture_format != self.negotiated.picture_format {
            let (now, before) = (negotiated.picture_format, self.negotiated.picture_format);
            return Err(format!("{name} delivers {now} now, but delivered {before} before"));
        }
        self.id = id;
        Ok(worker)
    }

    /// Puts a capture's pictures until nobody takes them, or the last one came.
    fn deliver(&mut self, worker: Worker, sender: &LatestSender<Picture>) -> Result<(), String> {
        let name = self.negotiated.name.clone();
        // A thread that has ended is noticed below.
        let _ = worker.start.send(());
        let mut last = Instant::now();
        let mut limit = self.limits.first_picture;
        let mut has_damaged = false;
        let mut is_first = true;
        while !sender.is_over() {
            match worker.events.recv_timeout(CHECK_EVERY.min(limit)) {
                // v4l2loopback delivers its last picture again to whoever opens it.
                Ok(Event::Sample(sample)) if is_first && self.clock.is_repeated(sample.stamp) => {}
                Ok(Event::Sample(sample)) => {
                    is_first = false;
                    has_damaged = !self.put(sample, sender);
                    if !has_damaged {
                        last = Instant::now();
                        limit = self.limits.picture;
                    }
                }
                Ok(Event::Over) => return Ok(()),
                Ok(Event::Failed(problem)) if self.driver.is_live() => {
                    self.wait_for_close(worker, sender);
                    return Err(format!("{name} stopped: {problem}"));
                }
                Ok(Event::Failed(problem)) => return Err(problem),
                Ok(Event::Opened(_) | Event::Refused(_)) | Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return Err(format!("{name} stopped: its driver failed")),
            }
            if self.driver.is_live() && last.elapsed() >= limit {
                self.blocked.push(worker.thread);
                let seconds = limit.as_secs_f64();
                let kind = if has_damaged { "undamaged picture" } else { "picture" };
                return Err(format!("{name} stopped: no {kind} came for {seconds} s"));
            }
        }
        Ok(())
    }

    /// Waits until a capture that failed is closed, as another one of the same camera may follow at
    /// once. A thread that does not end in time is left behind.
    fn wait_for_close(&mut self, worker: Worker, sender: &LatestSender<Picture>) {
        let begun = Instant::now();
        let limit = self.limits.picture;
        while !sender.is_over() {
            match worker.events.recv_timeout(CHECK_EVERY.min(limit)) {
                Err(RecvTimeoutError::Disconnected) => return,
                Err(RecvTimeoutError::Timeout) if begun.elapsed() >= limit => break,
                _ => {}
            }
        }
        self.blocked.push(worker.thread);
    }

    /// Puts an undamaged picture. Returns whether it did.
    fn put(&mut self, sample: DriverPicture, sender: &LatestSender<Picture>) -> bool {
        let DriverPicture { picture_format, bytes, stamp, arrived_s, exposure_s, dropped_frames, is_damaged } = sample;
        let layout_and_size =
            |picture_format: &PictureFormat| (picture_format.layout, picture_format.width, picture_format.height);
        let is_damaged = is_damaged
            || layout_and_size(&picture_format) != layout_and_size(&self.negotiated.picture_format)
            || !picture_format.is_complete(&bytes);
        let implausible = self.clock.implausible;
        let time_s = self.clock.time_s(stamp, arrived_s);
        let arrival_timed = self.clock.implausible - implausible;
        sender.count(Drops { dropped_frames, damaged: u64::from(is_damaged), arrival_timed, ..Drops::default() });
        if !is_damaged {
            sender.put(Picture { picture_format, bytes, time_s, exposure_s });
        }
        !is_damaged
    }
}
