//! A receiver with a socket.

use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

use socket2::{Domain, Protocol as Transport, Socket, Type};

use super::address::Listen;
use super::error::StreamError;
use super::lens::LensState;
use super::receive::{Receiver, Tracked};
use super::report::Report;

/// What the system keeps for us while we are busy, bytes. It may give less.
const KEPT: usize = 1 << 20;
/// UDP has no longer datagrams.
const LONGEST: usize = 65536;

/// Poses from the network. Between two calls the system keeps what arrives; a thread of its own, if there is one, is the
/// caller's.
pub struct Poses {
    socket: UdpSocket,
    at: SocketAddr,
    receiver: Receiver,
    began: Instant,
    bytes: Vec<u8>,
}

impl Poses {
    /// Listens at `opentrackio://HOST:PORT?…` or `freed://HOST:PORT?…`; docs/streams.md has the options. Without a host
    /// no other machine is heard. Port 0 is any free one ([`Poses::address`]).
    pub fn open(url: &str) -> Result<Self, StreamError> {
        let listen = Listen::parse(url)?;
        let (socket, at) = bind(&listen).map_err(|source| StreamError::Bind { at: listen.at, source })?;
        let receiver = Receiver::new(listen);
        Ok(Self { socket, at, receiver, began: Instant::now(), bytes: vec![0; LONGEST] })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.at
    }

    /// The next pose in the order of its sender's clock. Waits for it until the deadline, whatever else arrives; `None`
    /// if none came.
    pub fn next(&mut self, deadline: Instant) -> Result<Option<Tracked>, StreamError> {
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
            // No wait at all would mean an endless one.
            let wait = until.saturating_duration_since(now).max(Duration::from_micros(100));
            let failed = |source| StreamError::Receive { at: self.at, source };
            self.socket.set_read_timeout(Some(wait)).map_err(failed)?;
            match self.socket.recv_from(&mut self.bytes) {
                Ok((length, from)) => {
                    let now_s = self.seconds(Instant::now());
                    self.receiver.take(&self.bytes[..length], from, now_s);
                }
                Err(error) if is_nothing(&error) => {}
                Err(error) => return Err(failed(error)),
            }
        }
    }

    /// What has been heard so far.
    pub fn report(&self) -> &Report {
        self.receiver.report()
    }

    /// What the stream has said of the lens so far.
    pub fn lens(&self) -> &LensState {
        self.receiver.lens()
    }

    /// Added to the time of every pose, seconds, as was asked for.
    pub fn delay_s(&self) -> f64 {
        self.receiver.delay_s()
    }

    /// Now, by the clock of [`Tracked::arrived_s`].
    pub fn seconds_now(&self) -> f64 {
        self.seconds(Instant::now())
    }

    fn seconds(&self, at: Instant) -> f64 {
        at.saturating_duration_since(self.began).as_secs_f64()
    }
}

/// Nothing came in time; or, on some systems, a program that we sent to is gone, or a datagram was too long.
fn is_nothing(error: &std::io::Error) -> bool {
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

fn bind(listen: &Listen) -> std::io::Result<(UdpSocket, SocketAddr)> {
    let socket = Socket::new(Domain::for_address(listen.at), Type::DGRAM, Some(Transport::UDP))?;
    // Fewer are lost while we are busy; that the system gives less is no failure.
    let _ = socket.set_recv_buffer_size(KEPT);
    match listen.at {
        SocketAddr::V4(at) if at.ip().is_multicast() => {
            // Other programs may listen to the group, too.
            socket.set_reuse_address(true)?;
            // Bound to the group, the socket hears nothing else. Windows cannot.
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
