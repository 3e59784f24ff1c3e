//! Sends poses as a stream.

use std::hash::{DefaultHasher, Hash, Hasher};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};

use ciborium::value::Value;
use socket2::{Domain, Protocol as Transport, Socket, Type};

use super::address::{Protocol, StreamTarget};
use super::error::{SampleError, StreamError};
use super::freed::D1;
use super::lens::LensState;
use super::packet::packets;
use super::sample::{Sample, map, rational};
use super::transforms::transform_of;
use crate::pose::Pose;

/// The OpenTrackIO version that is written.
const VERSION: [u64; 3] = [1, 0, 1];
/// Interval at which static data are repeated, seconds of the stream's time, for receivers that
/// join later.
const STATIC_INTERVAL_S: f64 = 1.0;

/// Sends poses to one address. It neither waits nor reads a clock.
pub struct Sender {
    socket: UdpSocket,
    target: StreamTarget,
    /// Hash that identifies the source.
    source: u64,
    rate_hz: f64,
    lens: Option<LensState>,
    sequence: u32,
    /// Time of the last static data.
    last_static_s: Option<f64>,
}

impl Sender {
    /// Opens a sender to `opentrackio://HOST:PORT?…` or `freed://HOST:PORT?…`; docs/streams.md has
    /// the options. The source's id is derived from `name`. Poses are sent at about `rate_hz`;
    /// FreeD transmits neither the rate nor a lens.
    pub fn open(url: &str, name: &str, rate_hz: f64, lens: Option<LensState>) -> Result<Self, StreamError> {
        let target = StreamTarget::parse(url)?;
        let socket = bind(&target).map_err(|source| StreamError::Send { at: target.at, source })?;
        let mut hasher = DefaultHasher::new();
        name.hash(&mut hasher);
        Ok(Self { socket, target, source: hasher.finish(), rate_hz, lens, sequence: 0, last_static_s: None })
    }

    pub fn target(&self) -> &StreamTarget {
        &self.target
    }

    /// Checks that a pose at a time, seconds, can be represented.
    pub fn check(&self, time_s: f64, pose: &Pose) -> Result<(), StreamError> {
        let checked = match self.target.protocol {
            Protocol::FreeD => D1::of_pose(self.target.number, pose).map(drop),
            Protocol::OpenTrackIo => check_representable(time_s, pose),
        };
        checked.map_err(|source| StreamError::Pose { time_s, source })
    }

    /// Sends a pose at a time, seconds from 0 on. A pose that cannot be represented is an error and
    /// is not sent.
    pub fn send(&mut self, time_s: f64, pose: &Pose) -> Result<(), StreamError> {
        let datagrams = self.datagrams(time_s, pose).map_err(|source| StreamError::Pose { time_s, source })?;
        for datagram in datagrams {
            let sent = self.socket.send_to(&datagram, self.target.at);
            sent.map_err(|source| StreamError::Send { at: self.target.at, source })?;
        }
        self.sequence = self.sequence.wrapping_add(1);
        Ok(())
    }

    fn datagrams(&mut self, time_s: f64, pose: &Pose) -> Result<Vec<Vec<u8>>, SampleError> {
        match self.target.protocol {
            Protocol::FreeD => Ok(vec![D1::of_pose(self.target.number, pose)?.bytes().to_vec()]),
            Protocol::OpenTrackIo => {
                let bytes = self.sample(time_s, pose)?.encode(self.target.encoding)?;
                // A packet has the lower half of the counter.
                Ok(packets(self.target.encoding, self.sequence as u16, &bytes))
            }
        }
    }

    fn sample(&mut self, time_s: f64, pose: &Pose) -> Result<Sample, SampleError> {
        check_representable(time_s, pose)?;
        let (mut seconds, mut nanoseconds) = (time_s.floor(), (1e9 * time_s.fract()).round());
        if nanoseconds >= 1e9 {
            (seconds, nanoseconds) = (seconds + 1.0, 0.0);
        }
        let is_with_static_data = self
            .last_static_s
            .is_none_or(|last_static_s| !(0.0..STATIC_INTERVAL_S).contains(&(time_s - last_static_s)));
        if is_with_static_data {
            self.last_static_s = Some(time_s);
        }
        let mut sample = Sample::default();
        let version = Value::Array(VERSION.map(Value::from).to_vec());
        sample.set(&["protocol"], map([("name", "OpenTrackIO".into()), ("version", version)]));
        sample.set(&["sampleId"], urn(self.source, 1 + u64::from(self.sequence)));
        sample.set(&["sourceId"], urn(self.source, 0));
        sample.set(&["sourceNumber"], u64::from(self.target.number));
        sample.set(&["timing", "mode"], "internal");
        let stamp = map([("seconds", (seconds as u64).into()), ("nanoseconds", (nanoseconds as u64).into())]);
        sample.set(&["timing", "sampleTimestamp"], stamp);
        sample.set(&["timing", "sampleRate"], rational(self.rate_hz));
        sample.set(&["timing", "sequenceNumber"], u64::from(self.sequence));
        sample.set(&["transforms"], transform_of(pose));
        if let Some(lens) = &self.lens {
            lens.write(&mut sample, is_with_static_data);
        }
        Ok(sample)
    }
}

fn check_representable(time_s: f64, pose: &Pose) -> Result<(), SampleError> {
    let refused = |key: &str, accepted| Err(SampleError::Value { key: key.to_owned(), accepted });
    // The schema allows 48 bits of seconds.
    if !(0.0..281_474_976_710_655.0).contains(&time_s) {
        return refused("the time", "a number of seconds from 0 to 2^48");
    }
    if !(pose.rotation.is_finite() && pose.translation_m.is_finite()) {
        return refused("the pose", "made of finite numbers");
    }
    Ok(())
}

/// A custom UUID (RFC 9562, version 8) from a source and a number.
fn urn(source: u64, number: u64) -> String {
    let (a, b) = (source >> 32, (source >> 16) & 0xFFFF);
    let (c, d) = (0x8000 | (source & 0xFFF), 0x8000 | ((source >> 12) & 0xF));
    format!("urn:uuid:{a:08x}-{b:04x}-{c:04x}-{d:04x}-{:012x}", number & 0xFFFF_FFFF_FFFF)
}

fn bind(target: &StreamTarget) -> std::io::Result<UdpSocket> {
    let socket = Socket::new(Domain::for_address(target.at), Type::DGRAM, Some(Transport::UDP))?;
    let any: IpAddr = match target.at {
        SocketAddr::V4(at) if at.ip().is_multicast() => {
            socket.set_multicast_ttl_v4(target.ttl.into())?;
            let interface = target.interface.unwrap_or(Ipv4Addr::UNSPECIFIED);
            socket.set_multicast_if_v4(&interface)?;
            interface.into()
        }
        SocketAddr::V4(at) if at.ip().is_loopback() => Ipv4Addr::LOCALHOST.into(),
        SocketAddr::V4(_) => Ipv4Addr::UNSPECIFIED.into(),
        SocketAddr::V6(at) if at.ip().is_loopback() => Ipv6Addr::LOCALHOST.into(),
        SocketAddr::V6(_) => Ipv6Addr::UNSPECIFIED.into(),
    };
    socket.bind(&SocketAddr::from((any, 0)).into())?;
    Ok(socket.into())
}
