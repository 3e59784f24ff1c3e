//! Capture on a thread of its own: delivers the newest frame with its poses, for callers that
//! composite themselves.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::capture::{CaptureEvent, LiveCapture};
use super::error::LiveError;
use super::frame_queue::LiveCounts;
use super::intake::{Intake, LiveFrame, PictureOutcome};
use super::open::LiveInput;
use super::recorder_thread::RecorderThread;
use super::replay_buffer::ReplayBuffer;
use crate::recording::recorder::RecordingInfo;
use crate::shot::Shot;
use crate::tracking::PoseTrack;
use crate::webcam::{Drops, LatestReceiver, LatestSender, TakeOutcome, monotonic_s};

/// A frame and the pose track that it is composited with.
#[derive(Clone, Debug)]
pub struct TrackedFrame {
    pub frame: LiveFrame,
    pub track: PoseTrack,
}

/// State of the feed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FeedStatus {
    pub counts: LiveCounts,
    /// Dropped pictures of the camera. Frames that the caller is too slow for are counted in
    /// [`Feed::replaced`].
    pub drops: Drops,
    /// Pictures that were left out because the disk was too slow.
    pub not_recorded: u64,
    /// Number of frames of the recording in progress.
    pub recorded: Option<usize>,
    /// Reason why the camera delivers nothing for now.
    pub outage: Option<String>,
    /// Reason why there is no pose for now.
    pub no_pose_reason: Option<String>,
    /// Error that ended the pose source.
    pub pose_error: Option<String>,
    /// Last message of the pose source
    /// ([`PoseSource::take_message`](super::PoseSource::take_message)).
    pub message: Option<String>,
    /// The last completed recording: its number of frames, and the error if one ended it.
    pub finished: Option<(usize, Option<String>)>,
    /// The camera has ended.
    pub is_over: bool,
}

#[derive(Debug, Default)]
struct RecordRequest {
    record: Option<RecorderThread>,
    stop: bool,
}

#[derive(Debug)]
struct SharedState {
    shot: Shot,
    status: FeedStatus,
    request: RecordRequest,
}

/// A running camera, with its last ten seconds.
#[derive(Debug)]
pub struct Feed {
    /// Metadata of its recordings.
    pub about: RecordingInfo,
    frames: Option<LatestReceiver<TrackedFrame>>,
    shared: Arc<Mutex<SharedState>>,
    replay: Arc<Mutex<ReplayBuffer>>,
    thread: Option<JoinHandle<()>>,
}

fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    // A panic while the lock is held leaves no partial state.
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Feed {
    /// Starts a camera. The shot determines the span in which poses matter to a frame. `wake` is
    /// called on the thread when there is a frame or a change of state to report.
    pub fn start(input: LiveInput, shot: &Shot, wake: impl Fn() + Send + 'static) -> Result<Self, LiveError> {
        let about = input.about(None);
        let replay = Arc::<Mutex<ReplayBuffer>>::default();
        let intake = Intake::new(about.max_gap_s, input.max_wait_s(), None).with_replay_buffer(Arc::clone(&replay));
        let intake = intake.with_lens_track(input.lens_track(&shot.rig));
        let capture = LiveCapture::new(input.camera.start()?, input.poses);
        let (sender, frames) = LatestReceiver::new();
        let (status, request) = Default::default();
        let shared = Arc::new(Mutex::new(SharedState { shot: shot.clone(), status, request }));
        let thread_state = Arc::clone(&shared);
        let run = move || run(capture, intake, &thread_state, &sender, wake);
        let thread = std::thread::Builder::new().name("live".to_owned()).spawn(run).map_err(LiveError::Thread)?;
        Ok(Self { about, frames: Some(frames), shared, replay, thread: Some(thread) })
    }

    /// Replaces the shot.
    pub fn set_shot(&self, shot: &Shot) {
        lock(&self.shared).shot = shot.clone();
    }

    /// The newest frame that was not taken yet. Never blocks.
    pub fn take(&self) -> Option<TrackedFrame> {
        match self.frames.as_ref()?.take(Instant::now()) {
            TakeOutcome::New(frame) => Some(frame),
            TakeOutcome::Nothing | TakeOutcome::Unavailable(_) | TakeOutcome::Ended => None,
        }
    }

    /// Number of frames that were replaced by newer ones before they were taken.
    pub fn replaced(&self) -> u64 {
        self.frames.as_ref().map_or(0, |frames| frames.drops().replaced)
    }

    pub fn status(&self) -> FeedStatus {
        lock(&self.shared).status.clone()
    }

    /// The last ten seconds, up to a frame's time.
    pub fn replay_buffer(&self, until_s: f64) -> ReplayBuffer {
        lock(&self.replay).clone().until(until_s)
    }

    /// Starts a recording with the next picture. Frame numbers start at 0.
    pub fn record(&self, recorder: RecorderThread) {
        let mut shared = lock(&self.shared);
        shared.status.finished = None;
        shared.request = RecordRequest { record: Some(recorder), stop: false };
    }

    /// Ends the recording. [`FeedStatus::finished`] is set once it is complete.
    pub fn stop_recording(&self) {
        lock(&self.shared).request = RecordRequest { record: None, stop: true };
    }
}

impl Drop for Feed {
    /// Completes the recording in progress.
    fn drop(&mut self) {
        self.frames = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Poll interval for poses while no frame waits, seconds.
const IDLE_POLL_S: f64 = 0.02;
/// Longest poll interval while a frame waits for its poses, seconds.
const POSE_POLL_S: f64 = 0.005;

fn run(
    mut capture: LiveCapture,
    mut intake: Intake,
    shared: &Mutex<SharedState>,
    sender: &LatestSender<TrackedFrame>,
    wake: impl Fn(),
) {
    let mut last_s = f64::NEG_INFINITY;
    let mut status = FeedStatus::default();
    while !sender.is_over() && !status.is_over {
        let request = std::mem::take(&mut lock(shared).request);
        if request.stop {
            intake.stop_recording();
        }
        if request.record.is_some() || intake.is_recorded() {
            status.finished = end_recording(&mut intake).or(status.finished);
            status.recorded = None;
        }
        if let Some(recorder) = request.record {
            intake.record(recorder);
            status.finished = None;
        }
        let wait_s = intake.due_s().map_or(IDLE_POLL_S, |due_s| (due_s - monotonic_s()).clamp(0.0, POSE_POLL_S));
        match capture.next(Instant::now() + Duration::from_secs_f64(wait_s)) {
            CaptureEvent::Picture(decoded) => {
                let (picture, pixels) = *decoded;
                let shot = lock(shared).shot.clone();
                intake.set_rig(&shot.rig);
                // Without a camera geometry nothing is drawn, and poses do not matter.
                let within_s = |frame: &_| shot.poses_within_s(frame).unwrap_or_default();
                let outcome = intake.add_picture(&picture, pixels, within_s, monotonic_s());
                status.not_recorded += u64::from(outcome == PictureOutcome::NotRecorded);
                last_s = picture.time_s;
            }
            CaptureEvent::Nothing => {}
            CaptureEvent::Ended => status.is_over = intake.due_s().is_none(),
        }
        if status.pose_error.is_none() {
            status.pose_error = intake.take_poses(&mut capture, last_s).err().map(|error| error.to_string());
        }
        status.message = capture.take_message().or(status.message);
        let mut has_frames = false;
        while let Some(frame) = intake.next(monotonic_s()) {
            sender.put(TrackedFrame { frame, track: intake.track().clone() });
            has_frames = true;
        }
        let failure = intake.recorder().and_then(RecorderThread::failure);
        if let Some(error) = failure {
            let frames = intake.end_recording().map_or(0, |(frames, _)| frames);
            (status.finished, status.recorded) = (Some((frames, Some(error.to_string()))), None);
        } else if intake.recorder().is_some() {
            status.recorded = Some(intake.frames());
        }
        (status.counts, status.drops) = (intake.counts(), capture.drops());
        status.no_pose_reason = capture.no_pose_reason();
        status.outage = capture.outage().map(str::to_owned);
        let mut shared = lock(shared);
        let is_changed = shared.status.outage != status.outage
            || shared.status.pose_error != status.pose_error
            || shared.status.message != status.message
            || shared.status.finished != status.finished
            || status.is_over;
        shared.status.clone_from(&status);
        drop(shared);
        if has_frames || is_changed {
            wake();
        }
    }
    let finished = end_recording(&mut intake);
    if finished.is_some() {
        let status = &mut lock(shared).status;
        (status.finished, status.recorded) = (finished, None);
        wake();
    }
}

/// Ends the recording in progress.
fn end_recording(intake: &mut Intake) -> Option<(usize, Option<String>)> {
    let (frames, error) = intake.end_recording()?;
    Some((frames, error.map(|error| error.to_string())))
}
