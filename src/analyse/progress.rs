//! Progress of an analysis.

use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use super::interrupted::Interrupted;

/// Duration of the search for lamps, in frames of a pass. It does not depend on the length of the
/// recording.
const LAMP_SEARCH_FRAMES: usize = 150;
/// Interval of the reports in [`with_timed_progress`].
const REPORT_INTERVAL: Duration = Duration::from_millis(200);

/// Progress of an analysis, and its current stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// Out of `of`, about proportional to time.
    pub done: usize,
    pub of: usize,
    pub stage: AnalysisStage,
}

/// The stages of an analysis that are shown to a user.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AnalysisStage {
    Path,
    Exposure,
    Sharpness,
    /// The number of steps of its lamp search is not known beforehand. Its progress follows elapsed
    /// time.
    Light,
}

impl AnalysisStage {
    pub fn name(self) -> &'static str {
        match self {
            Self::Path => "camera path",
            Self::Exposure => "exposure",
            Self::Sharpness => "sharpness",
            Self::Light => "light",
        }
    }
}

/// Numbers of frames that the passes over the recording process.
#[derive(Clone, Copy, Debug)]
pub struct Passes {
    /// Registration.
    pub path: usize,
    /// Comparison of frames for gain and exposure.
    pub exposure: usize,
}

impl Passes {
    fn frames(self) -> usize {
        self.path + self.exposure
    }

    /// Sharpness takes about a twentieth of the time of the passes.
    fn sharpness(self) -> usize {
        self.frames() / 20
    }

    /// Gathering the light takes a twentieth as well; then lamps are searched.
    fn light(self) -> usize {
        self.frames() / 20 + LAMP_SEARCH_FRAMES
    }

    fn of(self) -> usize {
        self.frames() + self.sharpness() + self.light()
    }

    /// Estimated progress of [`AnalysisStage::Light`] in frames, if the passes took `passes_took`.
    /// It approaches the whole stage exponentially, with three quarters at the expected duration.
    pub fn light_after(self, elapsed: Duration, passes_took: Duration) -> usize {
        let share_of_passes = self.light() as f64 / self.frames().max(1) as f64;
        let expected_s = (share_of_passes * passes_took.as_secs_f64()).max(1.0);
        let share = 1.0 - 0.25_f64.powf(elapsed.as_secs_f64() / expected_s);
        (share * self.light() as f64) as usize
    }

    /// The progress after a number of frames of a stage.
    pub fn progress(self, stage: AnalysisStage, frames: usize) -> Progress {
        let passes = self.frames();
        let done = match stage {
            AnalysisStage::Path => frames,
            AnalysisStage::Exposure => self.path + frames,
            AnalysisStage::Sharpness => passes,
            AnalysisStage::Light => passes + self.sharpness() + frames,
        };
        Progress { done, of: self.of(), stage }
    }
}

/// Runs `work` on a thread of its own, and calls `report` with the elapsed time on this one. After
/// an interruption it still waits for `work` to end.
pub fn with_timed_progress<T: Send>(
    work: impl FnOnce() -> T + Send,
    report: &mut dyn FnMut(Duration) -> Result<(), Interrupted>,
) -> Result<T, Interrupted> {
    let begun = Instant::now();
    let work = Mutex::new(Some(work));
    let take = || work.lock().unwrap_or_else(PoisonError::into_inner).take().map(|work| work());
    let (sender, done) = channel();
    let (made, report) = std::thread::scope(|scope| {
        let working = std::thread::Builder::new().spawn_scoped(scope, move || drop(sender.send(take())));
        let mut so_far = Ok(());
        // A thread that cannot be spawned, or panics, hangs up; the scope propagates a panic.
        let made = loop {
            match done.recv_timeout(REPORT_INTERVAL) {
                Ok(made) => break made,
                Err(RecvTimeoutError::Timeout) => so_far = so_far.and_then(|()| report(begun.elapsed())),
                Err(RecvTimeoutError::Disconnected) => break None,
            }
        };
        drop(working);
        (made, so_far)
    });
    report?;
    // If no thread could be spawned, the work runs here.
    made.or_else(take).ok_or(Interrupted)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn total_includes_the_last_stages() {
        let passes = Passes { path: 300, exposure: 100 };
        let at = |stage, frames| passes.progress(stage, frames).done;
        let order = [
            at(AnalysisStage::Path, 300),
            at(AnalysisStage::Exposure, 100),
            at(AnalysisStage::Sharpness, 0),
            at(AnalysisStage::Light, 0),
        ];
        assert_eq!((order, passes.of()), ([300, 400, 400, 420], 590));
    }

    #[test]
    fn light_progress_is_monotonic_and_ends_at_the_total() {
        let passes = Passes { path: 300, exposure: 100 };
        let after = |s: f64| passes.light_after(Duration::from_secs_f64(s), Duration::from_secs(40));
        // 170 frames take 17 s where 400 took 40.
        assert_eq!([0.0, 17.0, 34.0].map(after), [0, 127, 159]);
        assert!([10.0, 20.0, 30.0, 40.0].into_iter().all(|s| after(s + 10.0) > after(s)));
        let last = passes.progress(AnalysisStage::Light, after(1e6));
        assert_eq!((last.done, last.of), (590, 590));
    }

    #[test]
    fn timed_progress_reports_during_the_work() {
        let mut reports = 0;
        let work = || std::thread::sleep(3 * REPORT_INTERVAL);
        with_timed_progress(work, &mut |_| {
            reports += 1;
            Ok(())
        })
        .unwrap();
        assert!(reports > 0);
        assert_eq!(with_timed_progress(|| 7, &mut |_| Ok(())), Ok(7));
        let interrupted = with_timed_progress(|| std::thread::sleep(2 * REPORT_INTERVAL), &mut |_| Err(Interrupted));
        assert_eq!(interrupted, Err(Interrupted));
    }
}
