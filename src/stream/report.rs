//! Statistics of a receiver.

use std::collections::BTreeMap;
use std::fmt;
use std::net::{IpAddr, SocketAddr};

use crate::text::count;

/// A sender: a machine and one of its streams. The port is not part of it, because a restarted
/// program sends from another one.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Source {
    pub address: IpAddr,
    /// OpenTrackIO's `sourceId`.
    pub id: Option<String>,
    /// OpenTrackIO's `sourceNumber`, FreeD's camera.
    pub number: Option<u64>,
}

impl Source {
    /// True if a name from the user refers to this source: its id, with or without `urn:uuid:`, or
    /// its number.
    pub fn matches_name(&self, name: &str) -> bool {
        let bare = |text: &str| text.trim_start_matches("urn:uuid:").to_ascii_lowercase();
        let by_number = self.number.is_some_and(|number| number.to_string() == name);
        by_number || self.id.as_deref().is_some_and(|id| bare(id) == bare(name))
    }
}

impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(id) = &self.id {
            write!(f, "{} ", crate::text::quoted(id))?;
        }
        if let Some(number) = self.number {
            write!(f, "number {number} ")?;
        }
        write!(f, "from {}", self.address)
    }
}

/// Reason why a datagram was dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum DropReason {
    /// The packet is from another address than the requested one.
    OtherAddress,
    /// The sample is of another source than the requested or followed one.
    OtherSource,
    /// Not a packet of the protocol, or a wrong checksum.
    NoPacket,
    /// A fragment without its beginning.
    Stray,
    /// A sample that cannot be decoded.
    NoSample,
    /// A sample without a pose.
    NoPose,
    Late,
    Repeated,
    /// The sample's time is far from those before and after it.
    OddTime,
}

impl fmt::Display for DropReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::OtherAddress => "from another address",
            Self::OtherSource => "of another source",
            Self::NoPacket => "no packet of this protocol, or damaged",
            Self::Stray => "pieces without a beginning",
            Self::NoSample => "unreadable samples",
            Self::NoPose => "samples without a pose",
            Self::Late => "too late",
            Self::Repeated => "at the time of another",
            Self::OddTime => "at a time far from the others",
        })
    }
}

/// Largest number of sources that are listed.
const MAX_SOURCES: usize = 16;

/// Counts since the start, and current values. Bounded in size.
#[derive(Clone, Debug, Default)]
pub struct Report {
    pub datagrams: u64,
    pub bytes: u64,
    /// Released poses.
    pub poses: u64,
    /// Lost poses, by the sequence numbers.
    pub missed: u64,
    /// Samples with missing fragments.
    pub incomplete: u64,
    /// Number of jumps of the clock.
    pub jumps: u64,
    /// Number of smaller steps of the clock.
    pub steps: u64,
    /// The last step or jump, seconds.
    pub last_step_s: f64,
    /// Number of changes to another source because the first fell silent.
    pub changes: u64,
    /// Dropped datagrams and samples, by reason.
    pub dropped: BTreeMap<DropReason, u64>,
    /// Error of the last unreadable one.
    pub last_problem: Option<String>,
    /// All sources with their numbers of samples.
    pub sources: Vec<(Source, u64)>,
    /// The followed source, and the address of its last datagram.
    pub followed: Option<(Source, SocketAddr)>,
    /// The protocol version that the source states.
    pub version: Option<String>,
    /// Interval between poses by their own clock, seconds: a running mean.
    pub interval_s: Option<f64>,
    /// Jitter of the arrivals, seconds: RFC 3550, section 6.4.1.
    pub jitter_s: f64,
    before: Option<(f64, f64)>,
}

impl Report {
    pub fn count_drop(&mut self, why: DropReason) {
        *self.dropped.entry(why).or_default() += 1;
    }

    pub fn count(&self, why: DropReason) -> u64 {
        self.dropped.get(&why).copied().unwrap_or(0)
    }

    /// Lost and dropped poses by reason; "none" without any.
    pub fn drops(&self) -> String {
        let counts = [(self.missed, "lost on the way"), (self.incomplete, "with pieces missing")];
        let aside = self.dropped.iter().map(|(why, number)| (*number, why.to_string()));
        let all = counts.into_iter().map(|(number, why)| (number, why.to_owned())).chain(aside);
        let reasons: Vec<String> = all.filter(|(number, _)| *number > 0).map(|(n, why)| format!("{n} {why}")).collect();
        if reasons.is_empty() { "none".to_owned() } else { reasons.join(", ") }
    }

    /// Reason why there is no pose, and a remedy.
    pub fn silence_reason(&self) -> String {
        let count_source = match (self.datagrams, self.poses) {
            (0, _) => return "no packet arrived: is the sender running, and does it use this address?".to_owned(),
            (_, 0) => format!("{} arrived, without a pose", count(self.datagrams as usize, "packet")),
            (_, poses) => format!("{} arrived until then", count(poses as usize, "pose")),
        };
        let dropped = self.drops();
        match (dropped.as_str(), &self.last_problem) {
            ("none", _) => count_source,
            (_, Some(problem)) => format!("{count_source}; dropped: {dropped} ({problem})"),
            (_, None) => format!("{count_source}; dropped: {dropped}"),
        }
    }

    /// Summary in one line, for the end.
    pub fn summary(&self) -> String {
        let mut line = format!(
            "{} in {}; dropped: {}",
            count(self.poses as usize, "pose"),
            count(self.datagrams as usize, "datagram"),
            self.drops()
        );
        let events = [
            (self.jumps, "its clock jumped"),
            (self.steps, "its clock was reset"),
            (self.changes, "another source took over"),
        ];
        for (number, what) in events {
            if number > 0 {
                line += &format!("; {what} {}", count(number as usize, "time"));
            }
        }
        line
    }

    /// Counts a step of the clock, seconds.
    pub(super) fn count_step(&mut self, by_s: f64) {
        self.steps += 1;
        self.last_step_s = by_s;
    }

    /// Counts a jump of the clock, seconds.
    pub(super) fn count_jump(&mut self, by_s: f64) {
        self.jumps += 1;
        self.last_step_s = by_s;
    }

    pub(super) fn count_source(&mut self, source: &Source) {
        match self.sources.iter().position(|(other, _)| other == source) {
            Some(at) => self.sources[at].1 += 1,
            None if self.sources.len() < MAX_SOURCES => self.sources.push((source.clone(), 1)),
            None => {}
        }
    }

    /// Counts a released pose, with its time stamp and its arrival.
    pub(super) fn count_pose(&mut self, time_s: f64, arrived_s: f64, is_new_clock: bool) {
        self.poses += 1;
        let before = self.before.replace((time_s, arrived_s)).filter(|_| !is_new_clock);
        if let Some((time_before_s, arrived_before_s)) = before {
            let interval_s = time_s - time_before_s;
            let mean_interval_s = self.interval_s.get_or_insert(interval_s);
            *mean_interval_s += (interval_s - *mean_interval_s) / 16.0;
            let uneven_s = (arrived_s - arrived_before_s - interval_s).abs();
            self.jitter_s += (uneven_s - self.jitter_s) / 16.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn silence_reason_follows_from_the_counts() {
        let mut report = Report::default();
        assert_eq!(report.silence_reason(), "no packet arrived: is the sender running, and does it use this address?");
        report.datagrams = 3;
        (0..3).for_each(|_| report.count_drop(DropReason::NoPacket));
        report.last_problem = Some("too short".to_owned());
        let message =
            "3 packets arrived, without a pose; dropped: 3 no packet of this protocol, or damaged (too short)";
        assert_eq!(report.silence_reason(), message);
        report = Report { datagrams: 9, poses: 9, ..Report::default() };
        assert_eq!(report.silence_reason(), "9 poses arrived until then");
    }

    #[test]
    fn drops_are_listed_by_reason() {
        let mut report = Report { poses: 7, datagrams: 12, ..Report::default() };
        assert_eq!(report.summary(), "7 poses in 12 datagrams; dropped: none");
        (0..3).for_each(|_| report.count_drop(DropReason::NoPacket));
        report.count_drop(DropReason::OtherSource);
        // One that turned out not to be odd.
        report.dropped.insert(DropReason::OddTime, 0);
        (report.missed, report.jumps) = (2, 1);
        assert_eq!(
            report.summary(),
            "7 poses in 12 datagrams; dropped: 2 lost on the way, 1 of another source, 3 no packet of this protocol, or \
             damaged; its clock jumped 1 time"
        );
    }
}
