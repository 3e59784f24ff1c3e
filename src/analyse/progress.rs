//! Progress of an analysis.

use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use super::interrupted::Interrupted;

/// Frames of a pass that take about as long as the search for lamps, however many frames there are.
const SEARCH_FRAMES: usize = 150;
/// From one report by the clock to the next.
const TICK: Duration = Duration::from_millis(200);

/// Progress of an analysis, and the part of it that runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// Of `of`, about in proportion to the time that it takes.
    pub done: usize,
    pub of: usize,
    pub stage: Stage,
}

/// The parts of an analysis that a user waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    Path,
    Exposure,
    Sharpness,
    /// The steps of its search for lamps cannot be counted beforehand: its progress follows the clock.
    Light,
}

impl Stage {
    pub fn name(self) -> &'static str {
        match self {
            Self::Path => "camera path",
            Self::Exposure => "exposure",
            Self::Sharpness => "sharpness",
            Self::Light => "light",
        }
    }
}

/// The frames that an analysis looks at, by its passes over the recording.
#[derive(Clone, Copy, Debug)]
pub struct Passes {
    /// To find the camera's path.
    pub path: usize,
    /// To compare the frames' exposures.
    pub exposure: usize,
}

impl Passes {
    fn frames(self) -> usize {
        self.path + self.exposure
    }

    /// Sharpness takes about a twentieth of the time that the passes take.
    fn sharpness(self) -> usize {
        self.frames() / 20
    }

    /// The light takes as much to gather it, and its search for lamps.
    fn light(self) -> usize {
        self.frames() / 20 + SEARCH_FRAMES
    }

    fn of(self) -> usize {
        self.frames() + self.sharpness() + self.light()
    }

    /// The frames of [`Stage::Light`] after a time, where the passes took `passes_took`. They approach those of the whole
    /// stage: three quarters are done after the time that is expected.
    pub fn light_after(self, elapsed: Duration, passes_took: Duration) -> usize {
        let share_of_passes = self.light() as f64 / self.frames().max(1) as f64;
        let expected_s = (share_of_passes * passes_took.as_secs_f64()).max(1.0);
        let share = 1.0 - 0.25_f64.powf(elapsed.as_secs_f64() / expected_s);
        (share * self.light() as f64) as usize
    }

    /// After so many frames of a stage.
    pub fn progress(self, stage: Stage, frames: usize) -> Progress {
        let passes = self.frames();
        let done = match stage {
            Stage::Path => frames,
            Stage::Exposure => self.path + frames,
            Stage::Sharpness => passes,
            Stage::Light => passes + self.sharpness() + frames,
        };
        Progress { done, of: self.of(), stage }
    }
}

/// Works on a thread of its own, and reports on this one how long it has worked. The work ends before an interruption does.
pub fn by_the_clock<T: Send>(
    work: impl FnOnce() -> T + Send,
    told: &mut dyn FnMut(Duration) -> Result<(), Interrupted>,
) -> Result<T, Interrupted> {
    let begun = Instant::now();
    let work = Mutex::new(Some(work));
    let take = || work.lock().unwrap_or_else(PoisonError::into_inner).take().map(|work| work());
    let (sender, done) = channel();
    let (made, told) = std::thread::scope(|scope| {
        let working = std::thread::Builder::new().spawn_scoped(scope, move || drop(sender.send(take())));
        let mut so_far = Ok(());
        // A thread that cannot be spawned, or panics, hangs up; the scope propagates a panic.
        let made = loop {
            match done.recv_timeout(TICK) {
                Ok(made) => break made,
                Err(RecvTimeoutError::Timeout) => so_far = so_far.and_then(|()| told(begun.elapsed())),
                Err(RecvTimeoutError::Disconnected) => break None,
            }
        };
        drop(working);
        (made, so_far)
    });
    told?;
    // Where no thread could be had.
    made.or_else(take).ok_or(Interrupted)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_stages_are_part_of_the_whole() {
        let passes = Passes { path: 300, exposure: 100 };
        let at = |stage, frames| passes.progress(stage, frames).done;
        let order = [at(Stage::Path, 300), at(Stage::Exposure, 100), at(Stage::Sharpness, 0), at(Stage::Light, 0)];
        assert_eq!((order, passes.of()), ([300, 400, 400, 420], 590));
    }

    #[test]
    fn light_moves_on_all_the_while_and_never_ends_too_early() {
        let passes = Passes { path: 300, exposure: 100 };
        let after = |s: f64| passes.light_after(Duration::from_secs_f64(s), Duration::from_secs(40));
        // 170 frames take 17 s where 400 took 40.
        assert_eq!([0.0, 17.0, 34.0].map(after), [0, 127, 159]);
        assert!([10.0, 20.0, 30.0, 40.0].into_iter().all(|s| after(s + 10.0) > after(s)));
        let last = passes.progress(Stage::Light, after(1e6));
        assert_eq!((last.done, last.of), (590, 590));
    }

    #[test]
    fn work_by_the_clock_reports_while_it_works() {
        let mut reports = 0;
        let work = || std::thread::sleep(3 * TICK);
        by_the_clock(work, &mut |_| {
            reports += 1;
            Ok(())
        })
        .unwrap();
        assert!(reports > 0);
        assert_eq!(by_the_clock(|| 7, &mut |_| Ok(())), Ok(7));
        let interrupted = by_the_clock(|| std::thread::sleep(2 * TICK), &mut |_| Err(Interrupted));
        assert_eq!(interrupted, Err(Interrupted));
    }
}
