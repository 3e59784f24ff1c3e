//! Automatic collection of board views from a live camera, on a background thread.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::super::task::{BackgroundTask, Reporter};
use locard_engine::calibrate::board::{BoardDetector, TargetChoice};
use locard_engine::calibrate::geometry::{CameraCalibration, Coverage, LensOptions, ViewCollector, ViewOutcome};
use locard_engine::camera::Response;
use locard_engine::frame::Frame;
use locard_engine::webcam::{LatestReceiver, LatestSender, TakeOutcome};

/// Number of views to collect, as in `locard calibrate camera --camera`.
const TARGET_VIEWS: usize = 20;
/// Interval between checks for the end while no frame arrives.
const END_CHECK_INTERVAL: Duration = Duration::from_millis(100);

/// Status of the collection.
#[derive(Clone, Debug)]
pub struct CollectionStatus {
    pub views: usize,
    pub min_views: usize,
    pub coverage: Coverage,
    /// Result of the last frame.
    pub look: Option<ViewOutcome>,
    /// Next instruction for the user.
    pub hint: Option<String>,
    /// Missing views, most needed first.
    pub missing: Vec<String>,
    /// The views are being fitted.
    pub is_fitting: bool,
}

#[derive(Debug)]
struct SharedViews {
    status: CollectionStatus,
    ends: bool,
}

/// A frame with its predecessor, for the detection of motion. When detection is slower than the
/// camera, frames are skipped, and consecutively processed frames are not neighbours.
type FramePair = (Option<Arc<Frame>>, Arc<Frame>);

/// Handle of the collecting thread, which ends when this is dropped.
#[derive(Debug)]
pub struct ViewCollection {
    putter: LatestSender<FramePair>,
    before: Option<Arc<Frame>>,
    shared: Arc<Mutex<SharedViews>>,
    task: BackgroundTask<Result<CameraCalibration, String>>,
    size: (u32, u32),
    last_s: f64,
}

fn lock(shared: &Mutex<SharedViews>) -> MutexGuard<'_, SharedViews> {
    // A panic under the lock leaves plain values.
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

impl ViewCollection {
    /// Starts for frames of a size. `wake` is called from the thread when the status changes.
    pub fn begin(size: (u32, u32), response: &Response, wake: impl Fn() + Send + 'static) -> Result<Self, String> {
        let search = BoardDetector::new(&TargetChoice::Any, response).map_err(|error| error.to_string())?;
        let taking = ViewCollector::new(size, TARGET_VIEWS, LensOptions::default());
        let (putter, newest) = LatestReceiver::new();
        let shared = Arc::new(Mutex::new(SharedViews { status: status(&taking, None), ends: false }));
        let of_thread = Arc::clone(&shared);
        let work = move |reporter: &Reporter<'_, _>| watch(&newest, search, taking, &of_thread, reporter);
        let task = BackgroundTask::stream("views", wake, work);
        let task = task.map_err(|error| format!("the thread that detects boards could not be started: {error}"))?;
        Ok(Self { putter, before: None, shared, task, size, last_s: f64::NEG_INFINITY })
    }

    /// Passes the camera's newest frame to the thread. Known frames and frames of another size are
    /// skipped.
    pub fn process(&mut self, frame: &Arc<Frame>) {
        if frame.timestamp_s > self.last_s && (frame.pixels.width, frame.pixels.height) == self.size {
            self.last_s = frame.timestamp_s;
            let before = self.before.replace(Arc::clone(frame));
            self.putter.put((before, Arc::clone(frame)));
        }
    }

    /// Ends the collection and fits the views.
    pub fn end(&self) {
        lock(&self.shared).ends = true;
    }

    pub fn status(&self) -> CollectionStatus {
        lock(&self.shared).status.clone()
    }

    /// The calibrated camera or an error, once the views are fitted.
    pub fn take(&self) -> Option<Result<CameraCalibration, String>> {
        self.task.take().map(|result| result.flatten())
    }
}

fn status(taking: &ViewCollector, look: Option<ViewOutcome>) -> CollectionStatus {
    CollectionStatus {
        views: taking.views().len(),
        min_views: taking.min_views(),
        coverage: taking.coverage(),
        look,
        hint: taking.hint(),
        missing: taking.missing().iter().map(ToString::to_string).collect(),
        is_fitting: false,
    }
}

fn watch(
    newest: &LatestReceiver<FramePair>,
    mut search: BoardDetector,
    mut taking: ViewCollector,
    shared: &Mutex<SharedViews>,
    reporter: &Reporter<'_, Result<CameraCalibration, String>>,
) {
    let mut last_processed_s = f64::NEG_INFINITY;
    while !taking.missing().is_empty() && !lock(shared).ends {
        match newest.take(Instant::now() + END_CHECK_INTERVAL) {
            TakeOutcome::New((before, frame)) => {
                for frame in before.into_iter().chain([frame]) {
                    if frame.timestamp_s <= last_processed_s {
                        continue;
                    }
                    let detection = search.find(&frame.pixels).ok();
                    let look = taking.add(frame.timestamp_s, &format!("frame {}", frame.index), detection);
                    lock(shared).status = status(&taking, Some(look));
                    last_processed_s = frame.timestamp_s;
                }
                reporter.wake();
            }
            TakeOutcome::Nothing | TakeOutcome::Unavailable(_) => {}
            // The handle was dropped.
            TakeOutcome::Ended => return,
        }
    }
    lock(shared).status.is_fitting = true;
    reporter.wake();
    reporter.send(taking.calibrated().map_err(|error| error.to_string()));
}
