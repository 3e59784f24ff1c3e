//! Errors of datagrams, samples, addresses and sockets.

use std::net::SocketAddr;

use crate::text::{quoted, reason};

/// A datagram that is not an OpenTrackIO packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, thiserror::Error)]
pub enum PacketError {
    #[error("shorter than the packet header of 16 bytes")]
    Short,
    #[error("does not begin with OTrk")]
    Identifier,
    #[error("its length differs from its header's")]
    Length,
    #[error("the checksum is wrong")]
    Checksum,
    #[error("encoded as neither JSON (1) nor CBOR (2)")]
    Encoding,
}

/// A payload that is not a sample, or bytes that are not a FreeD message.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SampleError {
    #[error("is not JSON: {0}")]
    Json(String),
    #[error("is not CBOR: {0}")]
    Cbor(String),
    #[error("{0} bytes follow the CBOR")]
    Rest(usize),
    #[error("is not a map of names to values")]
    NoMap,
    #[error("has the protocol {}, not OpenTrackIO", quoted(.0))]
    OtherProtocol(String),
    /// An invalid value: the path of its keys, and the accepted values.
    #[error("{key} is not {accepted}")]
    Value { key: String, accepted: &'static str },
    #[error("a FreeD D1 message has 29 bytes, not {0}")]
    FreedLength(usize),
    #[error("a FreeD message of type {0:02X}, not D1")]
    FreedType(u8),
    #[error("the checksum of a FreeD message is wrong")]
    FreedChecksum,
    #[error("{what} of {value} does not fit FreeD, whose range is -{max} to {max}")]
    FreedRange { what: &'static str, value: String, max: &'static str },
}

/// Why a stream could not be opened, or its data not be read.
#[derive(Debug, thiserror::Error)]
pub enum StreamError {
    #[error("{}: {problem}", quoted(url))]
    Address { url: String, problem: String },
    #[error("{at}: cannot listen there: {}", reason_of(source))]
    Bind { at: SocketAddr, source: std::io::Error },
    #[error("{at}: cannot send there: {}", reason_of(source))]
    Send { at: SocketAddr, source: std::io::Error },
    #[error("{at}: receiving failed: {}", reason_of(source))]
    Receive { at: SocketAddr, source: std::io::Error },
    #[error("the pose at {time_s} s cannot be sent: {source}")]
    Pose { time_s: f64, source: SampleError },
}

fn reason_of(error: &std::io::Error) -> String {
    use std::io::ErrorKind;
    match error.kind() {
        ErrorKind::AddrInUse => "the port is in use; end the other program, or take another port".to_owned(),
        ErrorKind::AddrNotAvailable => {
            "this machine has no such address; 127.0.0.1 is this machine alone, 0.0.0.0 all its networks".to_owned()
        }
        ErrorKind::PermissionDenied => "permission denied; use a port from 1024 on".to_owned(),
        ErrorKind::NetworkUnreachable | ErrorKind::HostUnreachable => {
            "there is no route to it; check the address, or give this machine's own by ?interface=ADDRESS".to_owned()
        }
        _ => reason(error),
    }
}
