//! Views of a board that are taken from a camera by themselves, on a thread of their own.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use locard_engine::calibrate::board::{BoardDetector, TargetChoice};
use locard_engine::calibrate::geometry::{CameraCalibration, Coverage, LensOptions, ViewCollector, ViewOutcome};
use locard_engine::camera::Response;
use locard_engine::frame::Frame;
use locard_engine::webcam::{Newest, Putter, Taken};

/// So many views are taken at least, as by `locard calibrate camera --camera`.
const WANTED: usize = 20;
/// How often it is looked whether somebody ends it, where no frame comes.
const LOOKED_EVERY: Duration = Duration::from_millis(100);

/// How far it is.
#[derive(Clone, Debug)]
pub struct Told {
    pub views: usize,
    pub wanted: usize,
    pub coverage: Coverage,
    /// What was made of the last frame.
    pub look: Option<ViewOutcome>,
    /// What to do next, for somebody who holds the board; and all that is missing, most needed first.
    pub hint: Option<String>,
    pub missing: Vec<String>,
    /// The views are being fitted.
    pub is_fitting: bool,
}

#[derive(Debug)]
struct Shared {
    told: Told,
    ends: bool,
    result: Option<Result<CameraCalibration, String>>,
}

/// A frame with the one before it, by which it is told whether the board rests. Where looking at a frame takes longer than the
/// camera needs for the next, those in between are left out, and two that are looked at in turn say nothing of that.
type Pair = (Option<Arc<Frame>>, Arc<Frame>);

/// A thread that looks at a camera's frames. Dropped, it ends.
#[derive(Debug)]
pub struct Views {
    putter: Putter<Pair>,
    before: Option<Arc<Frame>>,
    shared: Arc<Mutex<Shared>>,
    size: (u32, u32),
    last_s: f64,
}

fn lock(shared: &Mutex<Shared>) -> MutexGuard<'_, Shared> {
    // A panic under the lock leaves plain values.
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Views {
    /// Of frames of this size. `wake` is called from the thread when there is something to be told.
    pub fn begin(size: (u32, u32), response: &Response, wake: impl Fn() + Send + 'static) -> Result<Self, String> {
        let search = BoardDetector::new(&TargetChoice::Any, response).map_err(|error| error.to_string())?;
        let taking = ViewCollector::new(size, WANTED, LensOptions::default());
        let (putter, newest) = Newest::new();
        let shared = Arc::new(Mutex::new(Shared { told: told(&taking, None), ends: false, result: None }));
        let of_thread = Arc::clone(&shared);
        let work = move || watch(&newest, search, taking, &of_thread, wake);
        let thread = std::thread::Builder::new().name("views".to_owned());
        thread.spawn(work).map_err(|error| format!("no thread can be started that looks for a board: {error}"))?;
        Ok(Self { putter, before: None, shared, size, last_s: f64::NEG_INFINITY })
    }

    /// The camera's newest frame. One that is known already, or has another size, is left out.
    pub fn look(&mut self, frame: &Arc<Frame>) {
        if frame.timestamp_s > self.last_s && (frame.pixels.width, frame.pixels.height) == self.size {
            self.last_s = frame.timestamp_s;
            let before = self.before.replace(Arc::clone(frame));
            self.putter.put((before, Arc::clone(frame)));
        }
    }

    /// No more views are taken: what there is is fitted.
    pub fn end(&self) {
        lock(&self.shared).ends = true;
    }

    pub fn told(&self) -> Told {
        lock(&self.shared).told.clone()
    }

    /// The camera, or why the views give none; once they are fitted.
    pub fn take(&self) -> Option<Result<CameraCalibration, String>> {
        lock(&self.shared).result.take()
    }
}

fn told(taking: &ViewCollector, look: Option<ViewOutcome>) -> Told {
    Told {
        views: taking.views().len(),
        wanted: taking.wanted(),
        coverage: taking.coverage(),
        look,
        hint: taking.hint(),
        missing: taking.missing().iter().map(ToString::to_string).collect(),
        is_fitting: false,
    }
}

fn watch(
    newest: &Newest<Pair>,
    mut search: BoardDetector,
    mut taking: ViewCollector,
    shared: &Mutex<Shared>,
    wake: impl Fn(),
) {
    let mut looked_s = f64::NEG_INFINITY;
    while !taking.missing().is_empty() && !lock(shared).ends {
        match newest.take(Instant::now() + LOOKED_EVERY) {
            Taken::New((before, frame)) => {
                for frame in before.into_iter().chain([frame]) {
                    if frame.timestamp_s <= looked_s {
                        continue;
                    }
                    let seen = search.find(&frame.pixels).ok();
                    let look = taking.add(frame.timestamp_s, &format!("frame {}", frame.index), seen);
                    lock(shared).told = told(&taking, Some(look));
                    looked_s = frame.timestamp_s;
                }
                wake();
            }
            Taken::Nothing | Taken::Gone(_) => {}
            // Nobody waits for it any more.
            Taken::Ended => return,
        }
    }
    lock(shared).told.is_fitting = true;
    wake();
    let result = taking.calibrated().map_err(|error| error.to_string());
    lock(shared).result = Some(result);
    wake();
}
