//! Poses as they come over the network: OpenTrackIO 1.0.1 and FreeD D1, both ways.
//!
//! A [`Receiver`] takes datagrams and gives poses in the order of their own clock. It has no socket and reads no clock,
//! so that a test, a fuzzer and a replay drive it alike. [`Poses`] is a receiver with a socket, [`Sender`] the other
//! end. Memory is bounded whatever comes in. docs/streams.md has every convention.

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

pub use address::{Listen, Protocol, Target};
pub use assemble::{Assembler, Assembly};
pub use buffer::{Buffer, Held, Released, Taken};
pub use error::{PacketError, SampleError, StreamError};
pub use lens::{LensError, LensState};
pub use offset::ClockOffset;
pub use open_lens::OpenLens;
pub use packet::{Encoding, MOST_PAYLOAD, Packet, packets};
pub use poses::Poses;
pub use receive::{Message, Receiver, Tracked};
pub use report::{Heard, Report, Source};
pub use sample::Sample;
pub use send::Sender;
pub use timing::{Clock, clock};
pub use transforms::{Angles, pose_of, transform_of};
