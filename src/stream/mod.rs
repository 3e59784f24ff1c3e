//! Camera poses over the network: OpenTrackIO 1.0.1 and FreeD D1, in both directions.
//!
//! A [`Receiver`] takes datagrams and returns poses in the order of their own clock. It has no
//! socket and reads no clock, so that tests, fuzzers and replays drive it alike. [`Poses`] is a
//! receiver with a socket, [`Sender`] its counterpart. Memory is bounded for any input.
//! docs/streams.md has all conventions.

mod address;
mod assemble;
mod buffer;
mod error;
pub mod freed;
mod lens;
mod offset;
mod open_lens;
mod packet;
mod poses;
mod receive;
mod report;
mod sample;
mod send;
mod timing;
mod transforms;

pub use address::{ListenOptions, Protocol, StreamTarget};
pub use assemble::{Assembler, Assembly};
pub use buffer::{PushOutcome, ReleasedItem, ReorderBuffer, TimedItem};
pub use error::{PacketError, SampleError, StreamError};
pub use lens::{LensState, StreamLensError};
pub use offset::ClockOffset;
pub use open_lens::OpenLens;
pub use packet::{Encoding, MAX_PAYLOAD_BYTES, Packet, packets};
pub use poses::Poses;
pub use receive::{Message, Receiver, StreamPose};
pub use report::{DropReason, Report, Source};
pub use sample::Sample;
pub use send::Sender;
pub use timing::{Clock, clock};
pub use transforms::{Angles, pose_of, transform_of};
