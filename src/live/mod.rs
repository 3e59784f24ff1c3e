//! Frames composited as they come, and recorded so that the recording gives the same pictures.
//!
//! [`Waiting`] decides when a frame has its poses: pure, told the time. [`Live`] is a shot whose frames come one by one:
//! it records what it composites, and composites what it would read back. [`PoseSource`] is where poses come from.

mod encode;
mod error;
mod listening;
mod open;
mod playing;
mod source;
mod stage;
mod tagged;
mod track;
mod waiting;
mod writer;

pub use encode::{Encoded, encoded};
pub use error::LiveError;
pub use open::open_poses;
pub use playing::RecordedPoses;
pub use source::PoseSource;
pub use stage::{Came, Live, Shown, Submitted};
pub use track::{LiveTrack, PoseTaken, Tracking};
pub use waiting::{Counts, Ready, Waiting};
pub use writer::Writer;
