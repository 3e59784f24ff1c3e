//! A receiver with a socket.

use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

use socket2::{Domain, Protocol as Transport, Socket, Type};

use super::address::ListenOptions;
use super::error::StreamError;
use super::lens::LensState;
use super::receive::{Receiver, StreamPose};
use super::report::Report;

/// Requested size of the socket's receive buffer, bytes. The system may grant less.
const RECEIVE_BUFFER_BYTES: usize = 1 << 20;
/// Longest UDP datagram, bytes.
const MAX_DATAGRAM_BYTES: usize = 65536;

/// Poses from the network. Between two calls the system buffers arriving datagrams. A thread, if
/// any, is the caller's.
pub struct Poses {
    socket: UdpSocket,
    at: SocketAddr,
    receiver: Receiver,
    began: Instant,
    bytes: Vec<u8>,
}

impl Poses {
    /// Listens at `opentrackio://HOST:PORT?…` or `freed://HOST:PORT?…`; docs/streams.md has the
    /// options. Without a host only this machine can send. Port 0 is any free one
    /// ([`Poses::address`]).
    pub fn open(url: &str) -> Result<Self, StreamError> {
        let listen = ListenOptions::parse(url)?;
        let (socket, at) = bind(&listen).map_err(|source| StreamError::Bind { at: listen.at, source })?;
        let receiver = Receiver::new(listen);
        Ok(Self { socket, at, receiver, began: Instant::now(), bytes: vec![0; MAX_DATAGRAM_BYTES] })
    }

    /// The bound address.
    pub fn address(&self) -> SocketAddr {
        self.at
    }

    /// The next pose in the order of its sender's clock. Blocks until the deadline at most; `None`
    /// if there is none by then.
    pub fn next(&mut self, deadline: Instant) -> Result<Option<StreamPose>, StreamError> {
        loop {
            let now = Instant::now();
            if let Some(tracked) = self.receiver.next(self.seconds(now)) {
                return Ok(Some(tracked));
            }
            if now >= deadline {
                return Ok(None);
            }
            let due = self.receiver.due_s().map(|s| self.began + Duration::from_secs_f64(s.max(0.0)));
            let until = due.map_or(deadline, |due| due.min(deadline));
            // A timeout of 0 would wait without end.
            let wait = until.saturating_duration_since(now).max(Duration::from_micros(100));
            let failed = |source| StreamError::Receive { at: self.at, source };
            self.socket.set_read_timeout(Some(wait)).map_err(failed)?;
            match self.socket.recv_from(&mut self.bytes) {
                Ok((length, from)) => {
                    let now_s = self.seconds(Instant::now());
                    self.receiver.take(&self.bytes[..length], from, now_s);
                }
                Err(error) if is_transient(&error) => {}
                Err(error) => return Err(failed(error)),
            }
        }
    }

    /// Statistics so far.
    pub fn report(&self) -> &Report {
        self.receiver.report()
    }

    /// Lens data received so far.
    pub fn lens(&self) -> &LensState {
        self.receiver.lens()
    }

    /// The requested delay, added to the time of every pose, seconds.
    pub fn delay_s(&self) -> f64 {
        self.receiver.delay_s()
    }

    /// The present time by the clock of [`StreamPose::arrived_s`].
    pub fn seconds_now(&self) -> f64 {
        self.seconds(Instant::now())
    }

    fn seconds(&self, at: Instant) -> f64 {
        at.saturating_duration_since(self.began).as_secs_f64()
    }
}

/// A timeout; or, on some systems, an unreachable peer that was sent to, or a datagram that was too
/// long.
fn is_transient(error: &std::io::Error) -> bool {
    use std::io::ErrorKind;
    matches!(
        error.kind(),
        ErrorKind::WouldBlock
            | ErrorKind::TimedOut
            | ErrorKind::Interrupted
            | ErrorKind::ConnectionReset
            | ErrorKind::ConnectionRefused
    )
}

fn bind(listen: &ListenOptions) -> std::io::Result<(UdpSocket, SocketAddr)> {
    let socket = Socket::new(Domain::for_address(listen.at), Type::DGRAM, Some(Transport::UDP))?;
    // A larger buffer loses fewer datagrams while the program is busy. A smaller grant is not an
    // error.
    let _ = socket.set_recv_buffer_size(RECEIVE_BUFFER_BYTES);
    match listen.at {
        SocketAddr::V4(at) if at.ip().is_multicast() => {
            // Other programs may listen to the group, too.
            socket.set_reuse_address(true)?;
            // Bound to the group, the socket receives nothing else. Not possible on Windows.
            let bound = if cfg!(windows) { Ipv4Addr::UNSPECIFIED } else { *at.ip() };
            socket.bind(&SocketAddr::from((bound, at.port())).into())?;
            socket.join_multicast_v4(at.ip(), &listen.interface.unwrap_or(Ipv4Addr::UNSPECIFIED))?;
        }
        at => socket.bind(&at.into())?,
    }
    let socket = UdpSocket::from(socket);
    let at = socket.local_addr()?;
    Ok((socket, at))
}
