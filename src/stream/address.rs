//! URLs of streams: `opentrackio://HOST:PORT?…` and `freed://HOST:PORT?…`.

use std::net::{IpAddr, Ipv4Addr, SocketAddr, ToSocketAddrs};
use std::ops::RangeInclusive;

use super::error::StreamError;
use super::packet::Encoding;

/// Protocol of a stream of poses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Protocol {
    OpenTrackIo,
    FreeD,
}

impl Protocol {
    const ALL: [(&'static str, Self); 2] = [("opentrackio://", Self::OpenTrackIo), ("freed://", Self::FreeD)];

    /// The protocol of a URL; `None` for other text.
    pub fn of(url: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|(scheme, _)| url.starts_with(scheme)).map(|(_, protocol)| protocol)
    }

    /// Default port of the protocol.
    pub fn default_port(self) -> u16 {
        match self {
            Self::OpenTrackIo => 55555,
            Self::FreeD => 40000,
        }
    }
}

/// Address and options for receiving.
#[derive(Clone, Debug, PartialEq)]
pub struct ListenOptions {
    pub protocol: Protocol,
    /// An address of this machine, or a multicast group.
    pub at: SocketAddr,
    /// Network interface for a multicast group, by this machine's address in it; the system's
    /// choice if `None`.
    pub interface: Option<Ipv4Addr>,
    /// Accepts datagrams from this address only.
    pub from: Option<IpAddr>,
    /// Accepts this source only: OpenTrackIO's `sourceId` or `sourceNumber`, FreeD's camera.
    pub source: Option<String>,
    /// Added to the time of every pose, seconds.
    pub delay_s: f64,
    /// Longest time that a pose waits for earlier ones, seconds.
    pub wait_s: f64,
}

/// Address and options for sending.
#[derive(Clone, Debug, PartialEq)]
pub struct StreamTarget {
    pub protocol: Protocol,
    pub at: SocketAddr,
    /// Network interface for a multicast group, by this machine's address in it; the system's
    /// choice if `None`.
    pub interface: Option<Ipv4Addr>,
    pub encoding: Encoding,
    /// OpenTrackIO's `sourceNumber`, FreeD's camera.
    pub number: u8,
    /// Time to live of multicast datagrams: 1 plus the number of routers that they may pass.
    pub ttl: u8,
}

const MAX_DELAY_S: f64 = 60.0;
const MAX_WAIT_S: f64 = 1.0;
const DEFAULT_WAIT_S: f64 = 0.02;

impl ListenOptions {
    pub fn parse(url: &str) -> Result<Self, StreamError> {
        let parts = UrlParts::of(url)?;
        let mut listen = Self {
            protocol: parts.protocol,
            at: parts.at,
            interface: None,
            from: None,
            source: None,
            delay_s: 0.0,
            wait_s: DEFAULT_WAIT_S,
        };
        for (key, value) in &parts.options {
            match *key {
                "interface" => listen.interface = Some(parts.interface(value)?),
                "from" => listen.from = Some(parts.value(key, value, "an address, as in from=192.168.0.5")?),
                "source" => listen.source = Some((*value).to_owned()).filter(|name| !name.is_empty()),
                "delay_s" => listen.delay_s = parts.seconds(key, value, -MAX_DELAY_S..=MAX_DELAY_S)?,
                "wait_s" => listen.wait_s = parts.seconds(key, value, 0.0..=MAX_WAIT_S)?,
                _ => return Err(parts.unknown(key, "interface, from, source, delay_s, wait_s")),
            }
        }
        Ok(listen)
    }
}

impl StreamTarget {
    pub fn parse(url: &str) -> Result<Self, StreamError> {
        let parts = UrlParts::of(url)?;
        let mut target = Self {
            protocol: parts.protocol,
            at: parts.at,
            interface: None,
            encoding: Encoding::Json,
            number: 1,
            ttl: 1,
        };
        if parts.at.ip().is_unspecified() || parts.at.port() == 0 {
            return Err(parts.problem("this is an address to listen at; sending needs one address and port".to_owned()));
        }
        for (key, value) in &parts.options {
            match (*key, *value) {
                ("interface", _) => target.interface = Some(parts.interface(value)?),
                ("encoding", "json") => target.encoding = Encoding::Json,
                ("encoding", "cbor") => target.encoding = Encoding::Cbor,
                ("encoding", _) => return Err(parts.refused(key, value, "json or cbor")),
                ("number", _) => target.number = parts.value(key, value, "a number from 0 to 255")?,
                ("ttl", _) => target.ttl = parts.value(key, value, "a number from 0 to 255")?,
                _ => return Err(parts.unknown(key, "interface, encoding, number, ttl")),
            }
        }
        Ok(target)
    }
}

struct UrlParts<'a> {
    url: &'a str,
    protocol: Protocol,
    at: SocketAddr,
    options: Vec<(&'a str, &'a str)>,
}

impl<'a> UrlParts<'a> {
    fn of(url: &'a str) -> Result<Self, StreamError> {
        let problem = |problem: String| StreamError::Address { url: url.to_owned(), problem };
        let accepted = "opentrackio://HOST:PORT or freed://HOST:PORT, as in opentrackio://127.0.0.1:55555";
        let scheme_and_rest = Protocol::ALL.into_iter().find_map(|(scheme, p)| Some((p, url.strip_prefix(scheme)?)));
        let (protocol, rest) =
            scheme_and_rest.ok_or_else(|| problem(format!("is not a stream: expected {accepted}")))?;
        let (place, query) = rest.split_once('?').unwrap_or((rest, ""));
        let at = address(place.trim_end_matches('/'), protocol.default_port())
            .map_err(|scheme_and_rest| problem(format!("{scheme_and_rest}; expected {accepted}")))?;
        if at.is_ipv6() && at.ip().is_multicast() {
            return Err(problem("groups are IPv4's, as in opentrackio://235.135.1.1:55555".to_owned()));
        }
        let options = query.split('&').filter(|option| !option.is_empty());
        let options = options.map(|option| option.split_once('=').unwrap_or((option, ""))).collect();
        Ok(Self { url, protocol, at, options })
    }

    fn problem(&self, problem: String) -> StreamError {
        StreamError::Address { url: self.url.to_owned(), problem }
    }

    fn refused(&self, key: &str, value: &str, accepted: &str) -> StreamError {
        self.problem(format!("{key}={value}: expected {accepted}"))
    }

    fn unknown(&self, key: &str, keys: &str) -> StreamError {
        self.problem(format!("there is no option {key}; known options: {keys}"))
    }

    fn value<T: std::str::FromStr>(&self, key: &str, value: &str, accepted: &str) -> Result<T, StreamError> {
        value.parse().map_err(|_| self.refused(key, value, accepted))
    }

    fn seconds(&self, key: &str, value: &str, range: RangeInclusive<f64>) -> Result<f64, StreamError> {
        let accepted = format!("a number of seconds from {} to {}", range.start(), range.end());
        let seconds: f64 = self.value(key, value, &accepted)?;
        range.contains(&seconds).then_some(seconds).ok_or_else(|| self.refused(key, value, &accepted))
    }

    fn interface(&self, value: &str) -> Result<Ipv4Addr, StreamError> {
        if !self.at.ip().is_multicast() {
            return Err(self.problem("interface is for groups, as in opentrackio://235.135.1.1:55555".to_owned()));
        }
        self.value("interface", value, "an address of this machine, as in interface=192.168.0.5")
    }
}

/// An address from `HOST:PORT`, `HOST` or `:PORT`. Without a host it is the loopback address, which
/// no network reaches. `*` is all networks of this machine.
fn address(place: &str, default_port: u16) -> Result<SocketAddr, String> {
    let bare_v6 = place.strip_prefix('[').and_then(|rest| rest.strip_suffix(']'));
    let (host, port) = match place.rsplit_once(':') {
        Some((host, port)) if bare_v6.is_none() => {
            (host, port.parse().map_err(|_| format!("the port {port}: expected a number from 0 to 65535"))?)
        }
        _ => (place, default_port),
    };
    match host {
        "" => return Ok(SocketAddr::from((Ipv4Addr::LOCALHOST, port))),
        "*" => return Ok(SocketAddr::from((Ipv4Addr::UNSPECIFIED, port))),
        _ => {}
    }
    let bare = host.trim_start_matches('[').trim_end_matches(']');
    if let Ok(ip) = bare.parse::<IpAddr>() {
        return Ok((ip, port).into());
    }
    let addresses = (bare, port).to_socket_addrs().map_err(|_| format!("the machine {host} is unknown"))?;
    // Names often resolve to an IPv6 address first, but trackers use IPv4.
    let addresses: Vec<SocketAddr> = addresses.collect();
    let v4 = addresses.iter().find(|at| at.is_ipv4());
    v4.or(addresses.first()).copied().ok_or_else(|| format!("{host} has no address"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_and_options_have_their_defaults() {
        let at = |url| ListenOptions::parse(url).unwrap().at.to_string();
        assert_eq!(at("opentrackio://"), "127.0.0.1:55555");
        assert_eq!(at("freed://"), "127.0.0.1:40000");
        assert_eq!(at("freed://:5001/"), "127.0.0.1:5001");
        assert_eq!(at("freed://*"), "0.0.0.0:40000");
        assert_eq!(at("opentrackio://235.135.1.7:1234"), "235.135.1.7:1234");
        assert_eq!(at("opentrackio://[::1]"), "[::1]:55555");
        assert_eq!(at("opentrackio://[::1]:9"), "[::1]:9");
        let all = "opentrackio://239.1.1.1?interface=127.0.0.1&from=10.0.0.2&source=3&delay_s=-0.1&wait_s=0";
        let listen = ListenOptions::parse(all).unwrap();
        assert_eq!(listen.interface, Some(Ipv4Addr::LOCALHOST));
        assert_eq!((listen.from, listen.source.as_deref()), (Some([10, 0, 0, 2].into()), Some("3")));
        assert_eq!((listen.delay_s, listen.wait_s), (-0.1, 0.0));
        let target = StreamTarget::parse("opentrackio://10.0.0.9?encoding=cbor&number=7").unwrap();
        assert_eq!((target.encoding, target.number, target.ttl), (Encoding::Cbor, 7, 1));
        assert_eq!((Protocol::of("freed://x"), Protocol::of("recordings/demo")), (Some(Protocol::FreeD), None));
    }

    #[test]
    fn refused_addresses_name_the_accepted_ones() {
        let cases = [
            ("http://x", "opentrackio://HOST:PORT"),
            ("freed://1.2.3.4:99999", "0 to 65535"),
            ("freed://?wait_s=-1", "from 0 to 1"),
            ("freed://?delay_s=NaN", "from -60 to 60"),
            ("freed://?form=1.2.3.4", "from, source"),
            ("freed://?from=me", "from=192.168.0.5"),
            ("freed://?interface=1.2.3.4", "groups"),
            ("freed://[ff02::1]", "IPv4"),
        ];
        for (url, accepted) in cases {
            let error = ListenOptions::parse(url).unwrap_err().to_string();
            assert!(error.contains(accepted), "{error}");
        }
        for (url, accepted) in [("freed://*", "one address"), ("opentrackio://?encoding=xml", "json or cbor")] {
            let error = StreamTarget::parse(url).unwrap_err().to_string();
            assert!(error.contains(accepted), "{error}");
        }
    }
}
