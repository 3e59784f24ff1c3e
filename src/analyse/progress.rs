//! Progress of an analysis.

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
    /// Its search for lamps takes a time of its own, without a report in between.
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
    /// Sharpness and light take about a quarter of the time that the passes take.
    fn of(self) -> usize {
        (5 * (self.path + self.exposure)).div_ceil(4)
    }

    /// After so many frames of a stage.
    pub fn progress(self, stage: Stage, frames: usize) -> Progress {
        let passes = self.path + self.exposure;
        let done = match stage {
            Stage::Path => frames,
            Stage::Exposure => self.path + frames,
            Stage::Sharpness => passes,
            Stage::Light => passes + passes / 20,
        };
        Progress { done, of: self.of(), stage }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_stages_are_part_of_the_whole() {
        let passes = Passes { path: 300, exposure: 100 };
        let at = |stage, frames| passes.progress(stage, frames).done;
        let order = [at(Stage::Path, 300), at(Stage::Exposure, 100), at(Stage::Sharpness, 0), at(Stage::Light, 0)];
        assert_eq!((order, passes.of()), ([300, 400, 400, 420], 500));
    }
}
