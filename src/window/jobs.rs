//! The job queue: exports, photographs, snapshots and analyses, one after another. Each job uses
//! the settings at the time it was queued, and runs on a thread and device of its own, so that the
//! window stays responsive.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::time::{Duration, Instant};

use super::dials::options_as_dials;
use super::task::BackgroundTask;
use locard_engine::analyse::{Analysis, AnalysisStage, Interrupted, Progress};
use locard_engine::compositor::Target;
use locard_engine::export::{Export, ExportError, Inputs};
use locard_engine::gpu::{Gpu, GpuError};
use locard_engine::label::SourceLabel;
use locard_engine::photo::{PhotoError, PhotoEvent, PhotoRequest, TakeError};
use locard_engine::shot::{Shot, ShotError};
use locard_engine::sink::folder::write_frame;
use locard_engine::text::{count, without_options};

/// A kind of job.
#[derive(Clone, Debug, PartialEq)]
pub enum JobKind {
    Export(Export),
    Photograph(PhotoRequest),
    /// One frame as a PNG file.
    Snapshot {
        frame: usize,
        path: PathBuf,
        force: bool,
    },
    /// Analyses the recording as recorded, into a folder.
    Analyse(PathBuf),
}

/// Progress of a job.
#[derive(Clone, Debug, PartialEq)]
pub enum JobState {
    Waiting,
    Running {
        /// Completed share, 0 to 1.
        progress: f64,
        begun: Instant,
        /// Stage of an analysis.
        stage: Option<AnalysisStage>,
    },
    /// The job has ended with a message.
    Done(String),
    Failed(String),
    Cancelled,
}

impl JobState {
    pub fn is_over(&self) -> bool {
        !matches!(self, Self::Waiting | Self::Running { .. })
    }
}

/// One line of the queue.
#[derive(Clone, Debug)]
pub struct JobEntry {
    pub name: String,
    pub state: JobState,
    /// Warnings.
    pub notes: Vec<String>,
    /// Result of an analysis, until it is taken.
    pub analysis: Option<Box<Analysis>>,
    /// Removed from the displayed list.
    pub is_hidden: bool,
    cancelled: Arc<AtomicBool>,
}

impl JobEntry {
    pub fn cancel(&mut self) {
        self.cancelled.store(true, Ordering::Release);
        if self.state == JobState::Waiting {
            self.state = JobState::Cancelled;
        }
    }
}

/// Remaining time by linear extrapolation. `None` in the first second and below one percent.
pub fn remaining_time(progress: f64, since: Duration) -> Option<Duration> {
    let is_known = progress >= 0.01 && since >= Duration::from_secs(1);
    is_known.then(|| since.mul_f64(((1.0 - progress) / progress).max(0.0)))
}

struct QueuedJob {
    number: usize,
    shot: Box<Shot>,
    kind: JobKind,
    cancelled: Arc<AtomicBool>,
}

enum JobEvent {
    State(JobState),
    Note(String),
    Analysis(Box<Analysis>),
}

/// The job queue.
pub struct Jobs {
    pub entries: Vec<JobEntry>,
    jobs: Option<Sender<QueuedJob>>,
    events: BackgroundTask<(usize, JobEvent)>,
}

impl std::fmt::Debug for Jobs {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Jobs").field("entries", &self.entries).finish_non_exhaustive()
    }
}

impl Jobs {
    /// `wake` is called from the thread for every event.
    pub fn new(wake: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        let (jobs, queue) = channel::<QueuedJob>();
        let events = BackgroundTask::stream("export", wake, move |reporter| {
            // Opened by the first job that needs it; without jobs the window's device suffices.
            let mut gpu: Option<Gpu> = None;
            for queued in queue {
                // The window may be gone.
                let send_event = |event: JobEvent| _ = reporter.send((queued.number, event));
                let state = if queued.cancelled.load(Ordering::Acquire) {
                    JobState::Cancelled
                } else {
                    run(&queued, &mut gpu, &send_event)
                };
                // A device with an error would also fail later jobs.
                gpu = gpu.filter(|gpu| gpu.check().is_ok());
                send_event(JobEvent::State(state));
            }
        })?;
        Ok(Self { entries: Vec::new(), jobs: Some(jobs), events: events.joined() })
    }

    /// Queues a job with a snapshot of the shot. Returns its index among the entries.
    pub fn add(&mut self, name: String, shot: &Shot, kind: JobKind) -> usize {
        let cancelled = Arc::new(AtomicBool::new(false));
        let number = self.entries.len();
        let queued = QueuedJob { number, shot: Box::new(shot.clone()), kind, cancelled: Arc::clone(&cancelled) };
        let sent = self.jobs.as_ref().is_some_and(|jobs| jobs.send(queued).is_ok());
        let state =
            if sent { JobState::Waiting } else { JobState::Failed("the thread that exports has ended".to_owned()) };
        self.entries.push(JobEntry { name, state, notes: Vec::new(), analysis: None, is_hidden: false, cancelled });
        number
    }

    /// Handles new events. Returns the entries that have ended since.
    pub fn take(&mut self) -> Vec<usize> {
        let mut ended = Vec::new();
        while let Some(taken) = self.events.take() {
            let (number, event) = match taken {
                Ok(event) => event,
                Err(why) => {
                    // The thread ended by a panic during a job.
                    let unfinished = self.entries.iter_mut().enumerate().filter(|(_, entry)| !entry.state.is_over());
                    for (number, entry) in unfinished {
                        entry.state = JobState::Failed(why.clone());
                        ended.push(number);
                    }
                    return ended;
                }
            };
            let Some(entry) = self.entries.get_mut(number) else { continue };
            match event {
                JobEvent::State(state) => {
                    ended.extend(state.is_over().then_some(number));
                    entry.state = state;
                }
                JobEvent::Note(note) => entry.notes.push(note),
                JobEvent::Analysis(analysis) => entry.analysis = Some(analysis),
            }
        }
        ended
    }

    /// True if any job is unfinished.
    pub fn is_busy(&self) -> bool {
        self.entries.iter().any(|entry| !entry.state.is_over())
    }

    pub fn cancel_all(&mut self) {
        self.entries.iter_mut().for_each(JobEntry::cancel);
    }
}

impl Drop for Jobs {
    fn drop(&mut self) {
        self.cancel_all();
        // The thread ends, and the drop of its task waits for it.
        drop(self.jobs.take());
    }
}

/// Why a job was not completed.
enum JobFailure {
    Cancelled,
    Failed(String),
}

impl From<ExportError> for JobFailure {
    fn from(error: ExportError) -> Self {
        if matches!(error, ExportError::Cancelled) {
            Self::Cancelled
        } else {
            Self::Failed(without_options(&error.to_string()))
        }
    }
}

impl From<PhotoError> for JobFailure {
    fn from(error: PhotoError) -> Self {
        match error {
            PhotoError::Take(TakeError::Cancelled) => Self::Cancelled,
            error => Self::Failed(options_as_dials(&error.to_string())),
        }
    }
}

impl From<ShotError> for JobFailure {
    fn from(error: ShotError) -> Self {
        Self::Failed(without_options(&error.to_string()))
    }
}

fn run(queued: &QueuedJob, gpu: &mut Option<Gpu>, send_event: &dyn Fn(JobEvent)) -> JobState {
    let begun = Instant::now();
    send_event(JobEvent::State(JobState::Running { progress: 0.0, begun, stage: None }));
    let report_stage = |progress: f64, stage: Option<AnalysisStage>| {
        send_event(JobEvent::State(JobState::Running { progress, begun, stage }));
        !queued.cancelled.load(Ordering::Acquire)
    };
    let report = |progress: f64| report_stage(progress, None);
    let note = |text: String| send_event(JobEvent::Note(options_as_dials(&text)));
    let done = match &queued.kind {
        JobKind::Export(export) => export_frames(&queued.shot, export, gpu, &report, &note),
        JobKind::Photograph(request) => take_photographs(&queued.shot, request, gpu, &report, &note),
        JobKind::Snapshot { frame, path, force } => take_snapshot(&queued.shot, *frame, path, *force, gpu),
        JobKind::Analyse(folder) => {
            analyse_recording(&queued.shot, folder, &report_stage, &|found| send_event(JobEvent::Analysis(found)))
        }
    };
    match done {
        Ok(summary) => JobState::Done(summary),
        Err(JobFailure::Cancelled) => JobState::Cancelled,
        Err(JobFailure::Failed(why)) => JobState::Failed(why),
    }
}

fn open_gpu(gpu: &mut Option<Gpu>) -> Result<Gpu, GpuError> {
    if gpu.is_none() {
        *gpu = Some(Gpu::open()?);
    }
    match gpu {
        Some(gpu) => Ok(gpu.clone()),
        None => Gpu::open(),
    }
}

fn export_frames(
    shot: &Shot,
    export: &Export,
    gpu: &mut Option<Gpu>,
    report: &dyn Fn(f64) -> bool,
    note: &dyn Fn(String),
) -> Result<String, JobFailure> {
    shot.check(export.range.clone())?;
    export.check(&Inputs::of(shot))?;
    let warnings = shot.notes(export.range.clone()).into_iter().chain(shot.support_gap_notes(export.range.clone()));
    warnings.for_each(|warning| note(warning.to_string()));
    let gpu = open_gpu(gpu).map_err(|error| JobFailure::Failed(error.to_string()))?;
    let mut compositor = shot.compositor(gpu);
    compositor.warnings().into_iter().for_each(note);
    let begun = Instant::now();
    let all = export.range.len();
    let mut drawn = 0;
    let done = export.run(shot, &mut compositor, |_| {
        drawn += 1;
        report(drawn as f64 / all as f64)
    })?;
    done.notes().into_iter().for_each(|warning| note(warning.to_string()));
    Ok(format!("{} in {:.1} s", count(done.frames(), "frame"), begun.elapsed().as_secs_f64()))
}

fn take_photographs(
    shot: &Shot,
    request: &PhotoRequest,
    gpu: &mut Option<Gpu>,
    report: &dyn Fn(f64) -> bool,
    note: &dyn Fn(String),
) -> Result<String, JobFailure> {
    shot.check_files()?;
    let (mut summary, mut written) = (Vec::new(), Vec::new());
    let mut reached = 0.0;
    let done = request.take(shot.clone(), || open_gpu(gpu), &mut |event| {
        match event {
            PhotoEvent::Warning(text) => note(text),
            PhotoEvent::Taking { number, of, share } => reached = ((number - 1) as f64 + share) / of as f64,
            PhotoEvent::Written { path, settings } => {
                written.push(path);
                summary.extend((!settings.is_empty()).then_some(settings));
            }
        }
        report(reached)
    });
    match done.map_err(JobFailure::from) {
        Ok(()) => Ok(summary.join("; ")),
        Err(JobFailure::Failed(why)) => Err(JobFailure::Failed(format!("{why}{}", finished_files(&written)))),
        Err(cancelled) => Err(cancelled),
    }
}

/// The files of an interrupted series that were finished.
fn finished_files(written: &[PathBuf]) -> String {
    let name = |path: &PathBuf| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    match written {
        [] => String::new(),
        [only] => format!(". {} is finished and kept", name(only)),
        [first, .., last] => format!(". {} to {} are finished and kept", name(first), name(last)),
    }
}

fn take_snapshot(
    shot: &Shot,
    frame: usize,
    path: &Path,
    force: bool,
    gpu: &mut Option<Gpu>,
) -> Result<String, JobFailure> {
    shot.check(frame..frame + 1)?;
    Inputs::of(shot).check_file(path)?;
    let failed = |error: GpuError| JobFailure::Failed(error.to_string());
    let mut compositor = shot.compositor(open_gpu(gpu).map_err(failed)?);
    let pending = shot.picture(&mut compositor, frame, Target::Pixels)?;
    let done = compositor.collect(pending).map_err(failed)?;
    let tags = shot.recording.presentation().color_tags();
    let label = SourceLabel::composite(&shot.recording.path).of_frame(frame);
    write_frame(path, &done.pixels, tags, Some(&label), force)
        .map_err(|error| JobFailure::Failed(without_options(&error.to_string())))?;
    Ok(format!("frame {frame}"))
}

fn analyse_recording(
    shot: &Shot,
    folder: &Path,
    report: &dyn Fn(f64, Option<AnalysisStage>) -> bool,
    take_analysis: &dyn Fn(Box<Analysis>),
) -> Result<String, JobFailure> {
    let report_progress = &mut |Progress { done, of, stage }: Progress| {
        if report(done as f64 / of as f64, Some(stage)) { Ok(()) } else { Err(Interrupted) }
    };
    shot.analyse(folder, report_progress).map_err(|error| {
        if error.is_interrupted() {
            JobFailure::Cancelled
        } else {
            JobFailure::Failed(without_options(&error.to_string()))
        }
    })?;
    // Read in the same way as when the recording is opened.
    let analysis = Analysis::read(folder).map_err(|error| JobFailure::Failed(error.to_string()))?;
    let summary = analysis.findings.summary();
    take_analysis(Box::new(analysis));
    Ok(summary)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn message_of_a_failed_series_lists_its_finished_files() {
        let paths = |n: usize| (1..=n).map(|n| PathBuf::from(format!("/a/s-{n}.png"))).collect::<Vec<_>>();
        let messages = [0, 1, 3].map(|n| finished_files(&paths(n)));
        assert_eq!(messages, ["", ". s-1.png is finished and kept", ". s-1.png to s-3.png are finished and kept"]);
    }

    #[test]
    fn remaining_time_is_extrapolated_linearly() {
        let s = Duration::from_secs;
        assert_eq!(remaining_time(0.25, s(10)), Some(s(30)));
        assert_eq!(remaining_time(1.0, s(10)), Some(s(0)));
        assert_eq!((remaining_time(0.0, s(10)), remaining_time(0.5, Duration::from_millis(10))), (None, None));
    }
}
