//! Printed tags: a sheet of them out, and from pictures of it where the camera stood.
//!
//! `board` says which tags stand where, `sheet` draws one to print. In a picture `detect` finds tags and `refine` their
//! corners to a few hundredths of a pixel; `solve` gives the pose that explains the corners through the camera's own
//! projection. `sight` is what one picture says, both poses where a flat tag allows two; `continuity` chooses between them
//! from the pictures around it; `track` does that for a video. docs/track.md says more.

mod board;
mod continuity;
mod detect;
mod family;
mod grey;
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
pub use continuity::{Chosen, along, chosen, expected};
pub use detect::{DetectError, Detector, Found, Tags};
pub use family::Family;
pub use grey::Grey;
pub use print::{pdf, picture, png};
pub use recorded::{Parts, RecordError, check, record};
pub use refine::{refined, refined_of_any_lens};
pub use rolling::rolled;
pub use sheet::{Mark, Paper, Rect, Sheet};
pub use sight::{Lost, Sight, repeated};
pub use solve::{Corners, Solved, solved};
pub use track::{Searcher, Track, TrackError, also, track};
