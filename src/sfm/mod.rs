//! Structure from motion: camera poses and lens from a video or from photographs alone.
//!
//! The `colmap` program solves chosen frames (`keyframes`, `colmap`). The frames between are posed
//! by the landmarks of their neighbours (`resection`, `patch`). `gauge` gives the model a scale, an
//! up and a floor. docs/solve.md has the details.

mod colmap;
mod error;
mod footage;
mod gauge;
mod keyframes;
mod patch;
mod record;
mod report;
mod resection;
mod solution;
mod triangulation;

pub use colmap::version;
pub use error::{SolveError, SolveStage};
pub use footage::FootageFrames;
pub use gauge::{MeasuredDistance, ScaleSource, UpSource, WorldGauge};
pub use record::{new_folder, record};
pub use solution::{Solution, SolveOptions, SolvedFrame, solve};
