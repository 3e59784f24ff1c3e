//! Work in the background, one after the other: exports, photographs, snapshots, the footage analysed. Each is done with what was set when it was
//! begun, on a thread and a device of their own, so that the window goes on meanwhile.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::dials::by_dials;
use locard_engine::analyse::{Analysis, Interrupted, Progress, Stage};
use locard_engine::compositor::Target;
use locard_engine::export::{Export, ExportError, Inputs};
use locard_engine::gpu::{Gpu, GpuError};
use locard_engine::photo::{PhotoError, TakeError, Told, Wanted};
use locard_engine::shot::{Shot, ShotError};
use locard_engine::sink::folder::write_frame;
use locard_engine::text::{count, without_options};

/// What is to be done.
#[derive(Clone, Debug, PartialEq)]
pub enum Task {
    Export(Export),
    Photograph(Wanted),
    /// One frame as a PNG file.
    Snapshot {
        frame: usize,
        path: PathBuf,
        force: bool,
    },
    /// The recording as it was recorded, into a folder.
    Analyse(PathBuf),
}

/// How far it is.
#[derive(Clone, Debug, PartialEq)]
pub enum State {
    Waiting,
    Running {
        /// Of all, 0 to 1.
        share: f64,
        begun: Instant,
        /// Of an analysis.
        stage: Option<Stage>,
    },
    /// With what there is to say.
    Done(String),
    Failed(String),
    Cancelled,
}

impl State {
    pub fn is_over(&self) -> bool {
        !matches!(self, Self::Waiting | Self::Running { .. })
    }
}

/// One line of the queue.
#[derive(Clone, Debug)]
pub struct Entry {
    pub name: String,
    pub state: State,
    /// What was odd about it.
    pub notes: Vec<String>,
    /// By an analysis, until it is taken.
    pub found: Option<Box<Analysis>>,
    /// Off the list that is shown.
    pub is_hidden: bool,
    cancelled: Arc<AtomicBool>,
}

impl Entry {
    pub fn cancel(&mut self) {
        self.cancelled.store(true, Ordering::Release);
        if self.state == State::Waiting {
            self.state = State::Cancelled;
        }
    }
}

/// How much longer something takes that has come that far, if the rest goes on alike. Nothing is said before a second, or
/// before a hundredth is done.
pub fn left(share: f64, since: Duration) -> Option<Duration> {
    let told = share >= 0.01 && since >= Duration::from_secs(1);
    told.then(|| since.mul_f64(((1.0 - share) / share).max(0.0)))
}

struct Job {
    number: usize,
    shot: Box<Shot>,
    task: Task,
    cancelled: Arc<AtomicBool>,
}

enum News {
    State(State),
    Note(String),
    Found(Box<Analysis>),
}

/// The queue.
pub struct Jobs {
    pub entries: Vec<Entry>,
    jobs: Option<Sender<Job>>,
    news: Receiver<(usize, News)>,
    thread: Option<JoinHandle<()>>,
}

impl std::fmt::Debug for Jobs {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Jobs").field("entries", &self.entries).finish_non_exhaustive()
    }
}

impl Jobs {
    /// `wake` is called from the thread whenever there is something new.
    pub fn new(wake: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        let (jobs, to_do) = channel::<Job>();
        let (send, news) = channel();
        let thread = std::thread::Builder::new().name("export".to_owned()).spawn(move || {
            // Opened by the first that needs it: a window alone does with its own.
            let mut gpu: Option<Gpu> = None;
            for job in to_do {
                let tell = |news: News| {
                    // The window may be gone, and its jobs with it.
                    let _ = send.send((job.number, news));
                    wake();
                };
                let state =
                    if job.cancelled.load(Ordering::Acquire) { State::Cancelled } else { done(&job, &mut gpu, &tell) };
                // An error of the device is its later work's too.
                gpu = gpu.filter(|gpu| gpu.check().is_ok());
                tell(News::State(state));
            }
        })?;
        Ok(Self { entries: Vec::new(), jobs: Some(jobs), news, thread: Some(thread) })
    }

    /// Begins something with a shot as it is now, after all that waits. Gives its place among the entries.
    pub fn add(&mut self, name: String, shot: &Shot, task: Task) -> usize {
        let cancelled = Arc::new(AtomicBool::new(false));
        let number = self.entries.len();
        let job = Job { number, shot: Box::new(shot.clone()), task, cancelled: Arc::clone(&cancelled) };
        let sent = self.jobs.as_ref().is_some_and(|jobs| jobs.send(job).is_ok());
        let state = if sent { State::Waiting } else { State::Failed("the thread that exports has ended".to_owned()) };
        self.entries.push(Entry { name, state, notes: Vec::new(), found: None, is_hidden: false, cancelled });
        number
    }

    /// Takes what is new. Gives the entries that are over since.
    pub fn take(&mut self) -> Vec<usize> {
        let mut over = Vec::new();
        loop {
            let (number, news) = match self.news.try_recv() {
                Ok(news) => news,
                Err(TryRecvError::Empty) => return over,
                Err(TryRecvError::Disconnected) => {
                    // It has ended in the middle of something.
                    for (number, entry) in
                        self.entries.iter_mut().enumerate().filter(|(_, entry)| !entry.state.is_over())
                    {
                        entry.state = State::Failed("the thread that exports has ended".to_owned());
                        over.push(number);
                    }
                    return over;
                }
            };
            let Some(entry) = self.entries.get_mut(number) else { continue };
            match news {
                News::State(state) => {
                    over.extend(state.is_over().then_some(number));
                    entry.state = state;
                }
                News::Note(note) => entry.notes.push(note),
                News::Found(found) => entry.found = Some(found),
            }
        }
    }

    /// Whether anything is still to be done.
    pub fn is_busy(&self) -> bool {
        self.entries.iter().any(|entry| !entry.state.is_over())
    }

    pub fn cancel_all(&mut self) {
        self.entries.iter_mut().for_each(Entry::cancel);
    }
}

impl Drop for Jobs {
    fn drop(&mut self) {
        self.cancel_all();
        drop(self.jobs.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Why something was not done.
enum End {
    Cancelled,
    Failed(String),
}

impl From<ExportError> for End {
    fn from(error: ExportError) -> Self {
        if matches!(error, ExportError::Cancelled) {
            Self::Cancelled
        } else {
            Self::Failed(without_options(&error.to_string()))
        }
    }
}

impl From<PhotoError> for End {
    fn from(error: PhotoError) -> Self {
        match error {
            PhotoError::Take(TakeError::Cancelled) => Self::Cancelled,
            error => Self::Failed(by_dials(&error.to_string())),
        }
    }
}

impl From<ShotError> for End {
    fn from(error: ShotError) -> Self {
        Self::Failed(without_options(&error.to_string()))
    }
}

fn done(job: &Job, gpu: &mut Option<Gpu>, tell: &dyn Fn(News)) -> State {
    let begun = Instant::now();
    tell(News::State(State::Running { share: 0.0, begun, stage: None }));
    let goes_on_at = |share: f64, stage: Option<Stage>| {
        tell(News::State(State::Running { share, begun, stage }));
        !job.cancelled.load(Ordering::Acquire)
    };
    let goes_on = |share: f64| goes_on_at(share, None);
    let note = |text: String| tell(News::Note(by_dials(&text)));
    let done = match &job.task {
        Task::Export(export) => exported(&job.shot, export, gpu, &goes_on, &note),
        Task::Photograph(wanted) => photographed(&job.shot, wanted, gpu, &goes_on, &note),
        Task::Snapshot { frame, path, force } => snapped(&job.shot, *frame, path, *force, gpu),
        Task::Analyse(folder) => analysed(&job.shot, folder, &goes_on_at, &|found| tell(News::Found(found))),
    };
    match done {
        Ok(said) => State::Done(said),
        Err(End::Cancelled) => State::Cancelled,
        Err(End::Failed(why)) => State::Failed(why),
    }
}

fn opened(gpu: &mut Option<Gpu>) -> Result<Gpu, GpuError> {
    if gpu.is_none() {
        *gpu = Some(Gpu::open()?);
    }
    match gpu {
        Some(gpu) => Ok(gpu.clone()),
        None => Gpu::open(),
    }
}

fn exported(
    shot: &Shot,
    export: &Export,
    gpu: &mut Option<Gpu>,
    goes_on: &dyn Fn(f64) -> bool,
    note: &dyn Fn(String),
) -> Result<String, End> {
    shot.check(export.range.clone())?;
    export.check(&Inputs::of(shot))?;
    let odd = shot.notes(export.range.clone()).into_iter().chain(shot.standing_notes(export.range.clone()));
    odd.for_each(|odd| note(odd.to_string()));
    let gpu = opened(gpu).map_err(|error| End::Failed(error.to_string()))?;
    let mut compositor = shot.compositor(gpu);
    compositor.warnings().into_iter().for_each(note);
    let begun = Instant::now();
    let all = export.range.len();
    let mut drawn = 0;
    let done = export.run(shot, &mut compositor, |_| {
        drawn += 1;
        goes_on(drawn as f64 / all as f64)
    })?;
    done.notes().into_iter().for_each(|odd| note(odd.to_string()));
    Ok(format!("{} in {:.1} s", count(done.frames(), "frame"), begun.elapsed().as_secs_f64()))
}

fn photographed(
    shot: &Shot,
    wanted: &Wanted,
    gpu: &mut Option<Gpu>,
    goes_on: &dyn Fn(f64) -> bool,
    note: &dyn Fn(String),
) -> Result<String, End> {
    shot.check_files()?;
    let (mut said, mut written) = (Vec::new(), Vec::new());
    let mut reached = 0.0;
    let done = wanted.take(shot.clone(), || opened(gpu), &mut |told| {
        match told {
            Told::Warning(text) => note(text),
            Told::Taking { number, of, share } => reached = ((number - 1) as f64 + share) / of as f64,
            Told::Written { path, settings } => {
                written.push(path);
                said.extend((!settings.is_empty()).then_some(settings));
            }
        }
        goes_on(reached)
    });
    match done.map_err(End::from) {
        Ok(()) => Ok(said.join("; ")),
        Err(End::Failed(why)) => Err(End::Failed(format!("{why}{}", stays(&written)))),
        Err(cancelled) => Err(cancelled),
    }
}

/// What is there of a series that has failed.
fn stays(written: &[PathBuf]) -> String {
    let name = |path: &PathBuf| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    match written {
        [] => String::new(),
        [only] => format!(". {} is finished, and stays", name(only)),
        [first, .., last] => format!(". {} to {} are finished, and stay", name(first), name(last)),
    }
}

fn snapped(shot: &Shot, frame: usize, path: &Path, force: bool, gpu: &mut Option<Gpu>) -> Result<String, End> {
    shot.check(frame..frame + 1)?;
    Inputs::of(shot).check_file(path)?;
    let failed = |error: GpuError| End::Failed(error.to_string());
    let mut compositor = shot.compositor(opened(gpu).map_err(failed)?);
    let pending = shot.clone().picture(&mut compositor, frame, Target::Pixels)?;
    let done = compositor.collect(pending).map_err(failed)?;
    write_frame(path, &done.pixels, force).map_err(|error| End::Failed(without_options(&error.to_string())))?;
    Ok(format!("frame {frame}"))
}

fn analysed(
    shot: &Shot,
    folder: &Path,
    goes_on: &dyn Fn(f64, Option<Stage>) -> bool,
    found: &dyn Fn(Box<Analysis>),
) -> Result<String, End> {
    let told = &mut |Progress { done, of, stage }: Progress| {
        if goes_on(done as f64 / of as f64, Some(stage)) { Ok(()) } else { Err(Interrupted) }
    };
    shot.analyse(folder, told).map_err(|error| match error.is_interrupted() {
        true => End::Cancelled,
        false => End::Failed(without_options(&error.to_string())),
    })?;
    // As it is read when the recording is opened the next time.
    let there = Analysis::read(folder).map_err(|error| End::Failed(error.to_string()))?;
    let said = there.findings.lines().into_iter().map(|(name, text)| format!("{name} {text}"));
    let said = said.collect::<Vec<_>>().join("; ");
    found(Box::new(there));
    Ok(said)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_finished_of_a_series_is_told() {
        let paths = |n: usize| (1..=n).map(|n| PathBuf::from(format!("/a/s-{n}.png"))).collect::<Vec<_>>();
        let told = [0, 1, 3].map(|n| stays(&paths(n)));
        assert_eq!(told, ["", ". s-1.png is finished, and stays", ". s-1.png to s-3.png are finished, and stay"]);
    }

    #[test]
    fn the_rest_takes_as_long_as_what_is_done() {
        let s = Duration::from_secs;
        assert_eq!(left(0.25, s(10)), Some(s(30)));
        assert_eq!(left(1.0, s(10)), Some(s(0)));
        assert_eq!((left(0.0, s(10)), left(0.5, Duration::from_millis(10))), (None, None));
    }
}
