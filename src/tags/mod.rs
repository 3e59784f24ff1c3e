//! Printed tags: prints a board of them, and estimates the camera's pose from pictures of it.
//!
//! `board` is the layout of the tags, `sheet` a board to print. `detect` finds the tags of a
//! picture, and `refine` locates their corners to a few hundredths of a pixel. `solve` computes the
//! pose (PnP) through the camera's own projection. `sight` is the result of one picture, with both
//! poses where a flat tag is ambiguous; `continuity` resolves the ambiguity from neighbouring
//! pictures. `track` processes a video. docs/track.md has the details.

mod aruco;
mod board;
mod continuity;
mod detect;
mod family;
mod luma_codes;
mod print;
mod recorded;
mod refine;
mod report;
mod rolling;
mod sheet;
mod sight;
mod solve;
mod track;

pub use board::{Board, BoardError, Tag};
pub use continuity::{ChosenPose, choose_along, choose_pose, extrapolated_pose};
pub use detect::{DetectError, DetectedTag, DetectedTags, Detector};
pub use family::Family;
pub use luma_codes::LumaCodes;
pub use print::{pdf, picture, png};
pub use recorded::{RecordingInputs, new_folder, record};
pub use refine::{refine_corners, refine_corners_without_lens};
pub use rolling::correct_rolling_shutter;
pub use sheet::{Paper, Sheet, SheetMark, SheetRect};
pub use sight::{BoardPose, PoseFailure, repeated_message};
pub use solve::{Corners, PoseSolution, solve_pose};
pub use track::{BoardTracker, Track, TrackError, other_family_message, track};
