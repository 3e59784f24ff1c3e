//! What a camera is calibrated from, in a picture: a chessboard's inner corners or printed tags' corners, with their places
//! on the board.
//!
//! `search` looks for either. A `chessboard` is a `grid` of `corners`, each `refine`d; `printed` tags are found by `tags`.

mod chessboard;
mod corners;
mod grid;
mod plane;
mod printed;
mod refine;
mod search;
mod seen;

pub use chessboard::{NoBoard, find};
pub use plane::Plane;
pub use printed::{NoTags, Slanted};
pub use search::{Search, Wanted};
pub use seen::{Board, Seen, Target};
