//! Sessions of a driver that stalls, fails, panics, and delivers wrong sizes and times.

use std::sync::mpsc::{self, Receiver, Sender};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use super::clock::monotonic_s;
use super::driver::{Driver, DriverPicture, DriverStream, Stamp};
use super::driver_name::DriverName;
use super::error::CameraError;
use super::latest::{Drops, LatestReceiver, TakeOutcome};
use super::list::CameraListing;
use super::negotiation::{AssumedColor, FormatRequest, NegotiatedFormat, TimeSource};
use super::open::{WebcamSource, listed};
use super::picture::{Layout, Picture, PictureFormat};
use super::session::{MAX_BLOCKED_THREADS, SessionLimits};
use crate::coding::{ColorMatrix, ColorRange};

const DELIVERED: PictureFormat = PictureFormat {
    layout: Layout::Grey,
    width: 2,
    height: 1,
    stride: 2,
    range: ColorRange::Full,
    matrix: ColorMatrix::Bt601,
};
/// No test waits for longer than this.
const DEADLINE: Duration = Duration::from_secs(20);
/// Limits that are never reached, so that only the driver's actions count.
const PATIENT: SessionLimits =
    SessionLimits { first_picture: DEADLINE, picture: DEADLINE, opening: DEADLINE, retry: Duration::ZERO };
const SHORT: Duration = Duration::from_millis(30);
const IMPATIENT: SessionLimits = SessionLimits { first_picture: SHORT, picture: SHORT, ..PATIENT };

/// Next action of a capture.
enum Step {
    Deliver(DriverPicture),
    Fail(&'static str),
    /// Fails, and closing the capture blocks until the test drops its end.
    FailAndBlock(&'static str),
    Panic,
    End,
}

/// Action of a call of `Driver::open`.
enum Opening {
    /// Follows the steps; without one it blocks. The sender signals that the capture is closed.
    Steps(Receiver<Step>, Sender<()>, PictureFormat),
    Refuse,
    Panic,
}

/// Each call blocks until the test sends its action.
struct TestDriver {
    openings: Mutex<Receiver<Opening>>,
    ids: Mutex<Receiver<Option<&'static str>>>,
    opened: Sender<String>,
    is_live: bool,
}

struct TestCapture {
    steps: Receiver<Step>,
    closed: Sender<()>,
    closing_blocks: bool,
}

impl Drop for TestCapture {
    fn drop(&mut self) {
        while self.closing_blocks && self.steps.recv().is_ok() {}
        let _ = self.closed.send(());
    }
}

impl DriverStream for TestCapture {
    fn next(&mut self) -> Result<Option<DriverPicture>, String> {
        match self.steps.recv() {
            Ok(Step::Deliver(sample)) => Ok(Some(sample)),
            Ok(Step::Fail(problem)) => Err(problem.to_owned()),
            Ok(Step::FailAndBlock(problem)) => {
                self.closing_blocks = true;
                Err(problem.to_owned())
            }
            Ok(Step::Panic) => panic!("a driver's assertion"),
            Ok(Step::End) | Err(_) => Ok(None),
        }
    }
}

impl Driver for TestDriver {
    fn cameras(&self) -> Result<Vec<CameraListing>, CameraError> {
        let opening = self.openings.lock().unwrap().recv();
        assert!(!matches!(opening, Ok(Opening::Panic)), "a driver's assertion");
        Ok(Vec::new())
    }

    fn find(&self, _: &str, _: &str) -> Option<String> {
        self.ids.lock().unwrap().recv().ok().flatten().map(str::to_owned)
    }

    fn open(&self, id: &str, _: &FormatRequest) -> Result<(Box<dyn DriverStream>, NegotiatedFormat), CameraError> {
        let opening = self.openings.lock().unwrap().recv();
        let _ = self.opened.send(id.to_owned());
        match opening {
            Ok(Opening::Steps(steps, closed, picture_format)) => {
                let negotiated = NegotiatedFormat {
                    driver: DriverName::Nokhwa,
                    name: "eye".to_owned(),
                    picture_format,
                    rate_hz: None,
                    times: TimeSource::Driver,
                    has_exposure: false,
                    assumed: AssumedColor::default(),
                    warnings: Vec::new(),
                };
                Ok((Box::new(TestCapture { steps, closed, closing_blocks: false }), negotiated))
            }
            Ok(Opening::Panic) => panic!("a driver's assertion"),
            Ok(Opening::Refuse) | Err(_) => Err(CameraError::Busy { camera: "eye".to_owned() }),
        }
    }

    fn is_live(&self) -> bool {
        self.is_live
    }
}

/// The test's ends of a driver.
struct Controls {
    openings: Sender<Opening>,
    ids: Sender<Option<&'static str>>,
    opened: Receiver<String>,
}

impl Controls {
    fn new(is_live: bool) -> (Arc<TestDriver>, Self) {
        let (openings, of_driver) = mpsc::channel();
        let (ids, ids_of_driver) = mpsc::channel();
        let (to_test, opened) = mpsc::channel();
        let driver =
            TestDriver { openings: Mutex::new(of_driver), ids: Mutex::new(ids_of_driver), opened: to_test, is_live };
        (Arc::new(driver), Self { openings, ids, opened })
    }

    /// Prepares a capture. Returns its steps, and a receiver that is notified when it is closed.
    fn capture(&self, picture_format: PictureFormat) -> (Sender<Step>, Receiver<()>) {
        let (steps, of_capture) = mpsc::channel();
        let (to_test, closed) = mpsc::channel();
        self.openings.send(Opening::Steps(of_capture, to_test, picture_format)).unwrap();
        (steps, closed)
    }
}

/// A camera that delivers, its first capture's ends, and its driver's.
fn started(limits: SessionLimits) -> (LatestReceiver<Picture>, (Sender<Step>, Receiver<()>), Controls) {
    let (driver, controls) = Controls::new(true);
    let capture = controls.capture(DELIVERED);
    let camera = WebcamSource::open(driver, "0", &FormatRequest::default(), limits).unwrap();
    assert_eq!(controls.opened.recv().unwrap(), "0");
    (camera.start().unwrap(), capture, controls)
}

fn sample(code: u8) -> DriverPicture {
    let now_s = monotonic_s();
    DriverPicture {
        picture_format: DELIVERED,
        bytes: vec![code; 2],
        stamp: Stamp::Monotonic(now_s),
        arrived_s: now_s,
        exposure_s: None,
        dropped_frames: 0,
        is_damaged: false,
    }
}

fn picture(newest: &LatestReceiver<Picture>) -> Picture {
    let deadline = Instant::now() + DEADLINE;
    loop {
        match newest.take(deadline) {
            TakeOutcome::New(picture) => return picture,
            TakeOutcome::Unavailable(_) if Instant::now() < deadline => {}
            other => panic!("{other:?}; a picture is expected"),
        }
    }
}

/// The first code of the next picture.
fn code(newest: &LatestReceiver<Picture>) -> u8 {
    picture(newest).bytes[0]
}

/// Waits for the report that the camera is gone.
fn gone(newest: &LatestReceiver<Picture>) -> String {
    let deadline = Instant::now() + DEADLINE;
    while Instant::now() < deadline {
        match newest.take(Instant::now() + Duration::from_millis(5)) {
            TakeOutcome::Unavailable(why) => return why,
            TakeOutcome::Nothing => {}
            other => panic!("{other:?}; a camera that is gone is expected"),
        }
    }
    panic!("nothing is reported");
}

/// Waits for a report that differs from the one before.
fn gone_after(newest: &LatestReceiver<Picture>, before: &str) -> String {
    let deadline = Instant::now() + DEADLINE;
    while Instant::now() < deadline {
        let why = gone(newest);
        if why != before {
            return why;
        }
    }
    panic!("{before}: nothing else is reported");
}

fn open_error(opening: Option<Opening>, limits: SessionLimits) -> String {
    let (driver, controls) = Controls::new(true);
    opening.into_iter().for_each(|opening| controls.openings.send(opening).unwrap());
    WebcamSource::open(driver, "0", &FormatRequest::default(), limits).err().unwrap().to_string()
}

#[test]
fn stalled_camera_is_reported_and_reopened_and_its_thread_left_behind() {
    let (newest, (steps, closed), controls) = started(IMPATIENT);
    steps.send(Step::Deliver(sample(1))).unwrap();
    assert_eq!(code(&newest), 1);
    let stalled = gone(&newest);
    assert_eq!(stalled, "eye stopped: no picture came for 0.03 s");
    let (again, _closed) = controls.capture(DELIVERED);
    again.send(Step::Deliver(sample(2))).unwrap();
    controls.ids.send(Some("0")).unwrap();
    assert_eq!(code(&newest), 2);
    // The old capture returns at last: its picture is dropped, and it is closed.
    assert!(closed.try_recv().is_err());
    steps.send(Step::Deliver(sample(3))).unwrap();
    assert!(closed.recv_timeout(DEADLINE).is_ok());
    again.send(Step::Deliver(sample(4))).unwrap();
    assert_eq!(code(&newest), 4);
}

#[test]
fn first_picture_has_a_limit_of_its_own() {
    let (newest, (steps, _closed), _controls) = started(SessionLimits { first_picture: DEADLINE, ..IMPATIENT });
    assert_eq!(newest.take(Instant::now() + 3 * SHORT), TakeOutcome::Nothing);
    steps.send(Step::Deliver(sample(1))).unwrap();
    assert_eq!(code(&newest), 1);
    assert_eq!(gone(&newest), "eye stopped: no picture came for 0.03 s");
}

#[test]
fn camera_that_delivers_damaged_pictures_alone_is_reported() {
    let (newest, (steps, _closed), _controls) = started(IMPATIENT);
    let deadline = Instant::now() + DEADLINE;
    let why = loop {
        let damaged = DriverPicture { is_damaged: true, ..sample(1) };
        let _ = steps.send(Step::Deliver(damaged));
        match newest.take(Instant::now() + Duration::from_millis(5)) {
            TakeOutcome::Unavailable(why) => break why,
            TakeOutcome::Nothing if Instant::now() < deadline => {}
            other => panic!("{other:?}; a camera that is gone is expected"),
        }
    };
    assert_eq!(why, "eye stopped: no undamaged picture came for 0.03 s");
    assert!(newest.drops().damaged > 0);
}

#[test]
fn failure_is_reported_though_closing_blocks() {
    let (newest, (steps, _closed), _controls) = started(SessionLimits { first_picture: DEADLINE, ..IMPATIENT });
    steps.send(Step::FailAndBlock("it was unplugged")).unwrap();
    assert_eq!(gone(&newest), "eye stopped: it was unplugged");
    // A file.
    let (driver, controls) = Controls::new(false);
    let (steps, _closed) = controls.capture(DELIVERED);
    steps.send(Step::FailAndBlock("frame 3 is damaged")).unwrap();
    let newest = WebcamSource::open(driver, "a.mkv", &FormatRequest::default(), PATIENT).unwrap().start().unwrap();
    assert_eq!(newest.take(Instant::now() + DEADLINE), TakeOutcome::Unavailable("frame 3 is damaged".to_owned()));
    assert_eq!(newest.take(Instant::now() + DEADLINE), TakeOutcome::Ended);
}

#[test]
fn unplugged_camera_is_waited_for_and_found_under_another_id() {
    let (newest, (steps, _closed), controls) = started(PATIENT);
    steps.send(Step::Fail("it was unplugged")).unwrap();
    let stopped = gone(&newest);
    assert_eq!(stopped, "eye stopped: it was unplugged");
    controls.ids.send(None).unwrap();
    let unplugged = gone_after(&newest, &stopped);
    assert_eq!(unplugged, "eye is unplugged");
    // It is back, but another program was faster.
    controls.openings.send(Opening::Refuse).unwrap();
    controls.ids.send(Some("7")).unwrap();
    assert!(gone_after(&newest, &unplugged).contains("another program uses it"));
    let (again, _closed) = controls.capture(DELIVERED);
    again.send(Step::Deliver(sample(5))).unwrap();
    controls.ids.send(Some("8")).unwrap();
    assert_eq!(code(&newest), 5);
    assert_eq!(controls.opened.iter().take(2).collect::<Vec<_>>(), ["7", "8"]);
}

#[test]
fn camera_that_returns_with_another_format_is_not_used() {
    let (newest, (steps, _closed), controls) = started(PATIENT);
    steps.send(Step::Fail("it was unplugged")).unwrap();
    let stopped = gone(&newest);
    let (_again, closed) = controls.capture(PictureFormat { width: 4, stride: 4, ..DELIVERED });
    controls.ids.send(Some("0")).unwrap();
    let why = gone_after(&newest, &stopped);
    assert_eq!(why, "eye delivers 4x1 grey (full range) now, but delivered 2x1 grey (full range) before");
    assert!(closed.recv_timeout(DEADLINE).is_ok());
}

#[test]
fn panic_in_a_driver_is_reported_and_the_camera_reopened() {
    let (newest, (steps, closed), controls) = started(PATIENT);
    steps.send(Step::Panic).unwrap();
    assert_eq!(gone(&newest), "eye stopped: its driver failed");
    assert!(closed.recv_timeout(DEADLINE).is_ok());
    let (again, _closed) = controls.capture(DELIVERED);
    again.send(Step::Deliver(sample(6))).unwrap();
    controls.ids.send(Some("0")).unwrap();
    assert_eq!(code(&newest), 6);
}

#[test]
fn camera_that_does_not_open_is_an_error() {
    let silent = SessionLimits { opening: Duration::from_millis(30), ..PATIENT };
    let error = open_error(None, silent);
    assert_eq!(error, "0: its driver has not answered for 0.03 s; unplug it, or end the program that uses it");
    assert_eq!(open_error(Some(Opening::Panic), PATIENT), "0: its driver failed");
    assert!(open_error(Some(Opening::Refuse), PATIENT).contains("another program uses it"));
    // A list that does not come.
    let (driver, _controls) = Controls::new(true);
    let error = listed(DriverName::Nokhwa, driver, silent).unwrap_err().to_string();
    assert!(error.starts_with("the driver nokhwa: its driver has not answered for 0.03 s"), "{error}");
    let (driver, controls) = Controls::new(true);
    controls.openings.send(Opening::Panic).unwrap();
    let error = listed(DriverName::Nokhwa, driver, PATIENT).unwrap_err().to_string();
    assert_eq!(error, "the driver nokhwa: its driver failed");
}

#[test]
fn threads_blocked_in_a_driver_are_bounded() {
    let (newest, first, controls) = started(IMPATIENT);
    let mut captures = vec![first];
    while captures.len() < MAX_BLOCKED_THREADS {
        captures.push(controls.capture(DELIVERED));
        controls.ids.send(Some("0")).unwrap();
        assert_eq!(controls.opened.recv_timeout(DEADLINE).as_deref(), Ok("0"));
    }
    let stalled = "eye stopped: no picture came for 0.03 s";
    let bounded = gone_after(&newest, stalled);
    assert_eq!(bounded, "eye: 4 attempts wait for its driver; unplug it, or restart the program");
    // One of them returns.
    captures[0].0.send(Step::End).unwrap();
    let (spare, _closed) = controls.capture(DELIVERED);
    spare.send(Step::Deliver(sample(9))).unwrap();
    controls.ids.send(Some("0")).unwrap();
    assert_eq!(code(&newest), 9);
}

#[test]
fn wrong_sizes_and_damaged_pictures_are_counted_and_not_delivered() {
    let (newest, (steps, _closed), _controls) = started(PATIENT);
    let lying = DriverPicture { picture_format: PictureFormat { height: 2, ..DELIVERED }, ..sample(1) };
    let damaged = DriverPicture { is_damaged: true, dropped_frames: 3, ..sample(2) };
    let short = DriverPicture { bytes: vec![7], ..sample(3) };
    // Of a length that fits no stride.
    let odd = DriverPicture { picture_format: PictureFormat { stride: 0, ..DELIVERED }, ..sample(4) };
    let samples = [lying, damaged, short, odd, sample(5)];
    samples.into_iter().for_each(|sample| steps.send(Step::Deliver(sample)).unwrap());
    assert_eq!(code(&newest), 5);
    assert_eq!(newest.drops(), Drops { dropped_frames: 3, damaged: 4, ..Drops::default() });
}

#[test]
fn picture_that_is_delivered_again_after_a_reopening_is_left_out() {
    let (newest, (steps, _closed), controls) = started(PATIENT);
    let first = sample(1);
    let stamp = first.stamp;
    steps.send(Step::Deliver(first)).unwrap();
    assert_eq!(code(&newest), 1);
    steps.send(Step::Fail("it was unplugged")).unwrap();
    gone(&newest);
    let (again, _closed) = controls.capture(DELIVERED);
    again.send(Step::Deliver(DriverPicture { stamp, ..sample(1) })).unwrap();
    again.send(Step::Deliver(sample(2))).unwrap();
    controls.ids.send(Some("0")).unwrap();
    assert_eq!(code(&newest), 2);
}

#[test]
fn times_that_jump_are_replaced_by_arrivals_and_counted() {
    let (newest, (steps, _closed), _controls) = started(PATIENT);
    let mut last_s = f64::NEG_INFINITY;
    for (i, jump_s) in [0.0, 5.0, -60.0, f64::NAN, f64::INFINITY, 0.0].into_iter().enumerate() {
        let sample = sample(i as u8);
        let arrived_s = sample.arrived_s;
        steps.send(Step::Deliver(DriverPicture { stamp: Stamp::Monotonic(arrived_s + jump_s), ..sample })).unwrap();
        let picture = picture(&newest);
        assert_eq!((picture.bytes[0], picture.time_s), (i as u8, arrived_s));
        assert!(picture.time_s > last_s);
        last_s = picture.time_s;
    }
    assert_eq!(newest.drops(), Drops { arrival_timed: 4, ..Drops::default() });
}

#[test]
fn file_ends_after_its_last_picture_or_its_first_error() {
    for (step, is_error) in [(Step::End, false), (Step::Fail("frame 3 is damaged"), true)] {
        let (driver, controls) = Controls::new(false);
        let (steps, _closed) = controls.capture(DELIVERED);
        steps.send(step).unwrap();
        let newest = WebcamSource::open(driver, "a.mkv", &FormatRequest::default(), PATIENT).unwrap().start().unwrap();
        if is_error {
            assert_eq!(
                newest.take(Instant::now() + DEADLINE),
                TakeOutcome::Unavailable("frame 3 is damaged".to_owned())
            );
        }
        assert_eq!(newest.take(Instant::now() + DEADLINE), TakeOutcome::Ended);
    }
}

#[test]
fn capture_is_closed_when_nobody_takes_its_pictures() {
    let (newest, (steps, closed), _controls) = started(PATIENT);
    steps.send(Step::Deliver(sample(1))).unwrap();
    assert_eq!(code(&newest), 1);
    drop(newest);
    // The session ends by itself; the capture ends with the picture that it waits for.
    while closed.recv_timeout(Duration::from_millis(5)).is_err() {
        let _ = steps.send(Step::Deliver(sample(2)));
    }
    // A camera that was never started.
    let (driver, controls) = Controls::new(true);
    let (_steps, closed) = controls.capture(DELIVERED);
    drop(WebcamSource::open(driver, "0", &FormatRequest::default(), PATIENT).unwrap());
    assert!(closed.recv_timeout(DEADLINE).is_ok());
}
