//! Frames composited as they come, and recorded so that the recording gives the same pictures.
//!
//! [`Waiting`] decides when a frame has its poses: pure, told the time. [`Intake`] records what goes out, and gives out what
//! it would read back. [`Live`] composites that, frame by frame; [`Feed`] has a camera watched by a thread for whoever
//! composites himself. [`PoseSource`] is where poses come from.

mod asked;
mod delay_search;
mod delayed;
mod encode;
mod error;
mod feed;
mod fitting;
mod intake;
mod latest;
mod lenses;
mod listening;
mod motion;
mod open;
mod playing;
mod presence;
mod source;
mod stage;
mod tagged;
mod track;
mod waiting;
mod watched;
mod writer;

pub use asked::{Asked, LiveFrom};
pub use delay_search::{DelaySearch, Unknown};
pub use delayed::{Added, delayed};
pub use encode::{Encoded, encoded};
pub use error::LiveError;
pub use feed::{Feed, Seen, Status};
pub use intake::{Arrived, Came, Intake};
pub use latest::Latest;
pub use lenses::Lenses;
pub use open::{Opened, StreamLens, open, open_poses, profiled};
pub use playing::RecordedPoses;
pub use source::PoseSource;
pub use stage::{Live, Shown, Submitted};
pub use track::{LiveTrack, PoseTaken, Tracking};
pub use waiting::{Counts, Ready, Waiting};
pub use watched::{Next, Watched};
pub use writer::Writer;
