//! Detection of calibration targets in a picture: a chessboard's inner corners, or the corners of
//! printed tags, with their positions on the board.
//!
//! `detector` detects either. `chessboard` assembles `corners` into a `grid` and refines each
//! (`refine`). `tag_board` detects tags by `tags`.

mod chessboard;
mod corners;
mod detection;
mod detector;
mod grid;
mod refine;
mod tag_board;

pub use chessboard::{ChessboardError, find_chessboard};
pub use detection::{BoardDetection, ChessboardSize, DetectedTarget};
pub use detector::{BoardDetector, TargetChoice};
pub use tag_board::{NotOnPlane, TagsError};
