//! What a receiver has heard.

use std::collections::BTreeMap;
use std::fmt;
use std::net::{IpAddr, SocketAddr};

use crate::text::count;

/// Who sends: a machine, and which of its streams. A program that is started anew comes from another port, so the port
/// is no part of it.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Source {
    pub address: IpAddr,
    /// OpenTrackIO's `sourceId`.
    pub id: Option<String>,
    /// OpenTrackIO's `sourceNumber`, FreeD's camera.
    pub number: Option<u64>,
}

impl Source {
    /// Whether a person's words mean it: its id, with or without `urn:uuid:`, or its number.
    pub fn is_called(&self, name: &str) -> bool {
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

/// Why a datagram was left aside.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Heard {
    /// From another address than was asked for.
    OtherAddress,
    /// Of another source than was asked for, or than is followed.
    OtherSource,
    /// No packet of the protocol, or its checksum is wrong.
    NoPacket,
    /// A piece that belongs to nothing.
    Stray,
    /// A sample that cannot be read.
    NoSample,
    /// A sample without a place.
    NoPose,
    Late,
    Repeated,
    /// At a time far from those before and after it.
    OddTime,
}

impl fmt::Display for Heard {
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

/// Sources that are remembered by name; others are only counted.
const MOST_SOURCES: usize = 16;

/// Counts since listening began, and what is steady. Bounded, however long that is.
#[derive(Clone, Debug, Default)]
pub struct Report {
    pub datagrams: u64,
    pub bytes: u64,
    /// Poses that were given out.
    pub poses: u64,
    /// Poses that never came, by their numbers.
    pub lost: u64,
    /// Samples of which pieces never came.
    pub incomplete: u64,
    /// How often the clock jumped.
    pub jumps: u64,
    /// How often it was set anew by less than that.
    pub steps: u64,
    /// By how much it was set anew, or jumped, the last time, seconds.
    pub last_step_s: f64,
    /// How often another source was followed because the first fell silent.
    pub changes: u64,
    /// Datagrams and samples that were left aside, by reason.
    pub aside: BTreeMap<Heard, u64>,
    /// What was wrong with the last one that was unreadable.
    pub last_problem: Option<String>,
    /// Everyone who was heard, with the number of samples.
    pub sources: Vec<(Source, u64)>,
    /// The source that is followed, and where its last datagram came from.
    pub followed: Option<(Source, SocketAddr)>,
    /// The protocol's version, as the source says.
    pub version: Option<String>,
    /// From one pose to the next by their own clock, seconds: the mean of the recent ones.
    pub interval_s: Option<f64>,
    /// How unevenly they arrive, seconds: RFC 3550, section 6.4.1.
    pub jitter_s: f64,
    before: Option<(f64, f64)>,
}

impl Report {
    pub fn aside(&mut self, why: Heard) {
        *self.aside.entry(why).or_default() += 1;
    }

    pub fn count(&self, why: Heard) -> u64 {
        self.aside.get(&why).copied().unwrap_or(0)
    }

    /// What never came, and what was left aside, with why; "none" where that is nothing.
    pub fn drops(&self) -> String {
        let known = [(self.lost, "lost on the way"), (self.incomplete, "with pieces missing")];
        let aside = self.aside.iter().map(|(why, number)| (*number, why.to_string()));
        let all = known.into_iter().map(|(number, why)| (number, why.to_owned())).chain(aside);
        let told: Vec<String> = all.filter(|(number, _)| *number > 0).map(|(n, why)| format!("{n} {why}")).collect();
        if told.is_empty() { "none".to_owned() } else { told.join(", ") }
    }

    /// Why no pose came of what was heard, and what to do.
    pub fn silence(&self) -> String {
        let heard = match (self.datagrams, self.poses) {
            (0, _) => return "no packet came: is the sender on, and does it send there?".to_owned(),
            (_, 0) => format!("{} came, and no pose in them", count(self.datagrams as usize, "packet")),
            (_, poses) => format!("{} came until then", count(poses as usize, "pose")),
        };
        let dropped = self.drops();
        match (dropped.as_str(), &self.last_problem) {
            ("none", _) => heard,
            (_, Some(problem)) => format!("{heard}; dropped: {dropped} ({problem})"),
            (_, None) => format!("{heard}; dropped: {dropped}"),
        }
    }

    /// All of it in a line, once it is over.
    pub fn summary(&self) -> String {
        let mut line = format!(
            "{} in {}; dropped: {}",
            count(self.poses as usize, "pose"),
            count(self.datagrams as usize, "datagram"),
            self.drops()
        );
        let events = [
            (self.jumps, "its clock jumped"),
            (self.steps, "its clock was set anew"),
            (self.changes, "another source took over"),
        ];
        for (number, what) in events {
            if number > 0 {
                line += &format!("; {what} {}", count(number as usize, "time"));
            }
        }
        line
    }

    /// The clock was set anew by so many seconds.
    pub(super) fn stepped(&mut self, by_s: f64) {
        self.steps += 1;
        self.last_step_s = by_s;
    }

    /// The clock jumped by so many seconds.
    pub(super) fn jumped(&mut self, by_s: f64) {
        self.jumps += 1;
        self.last_step_s = by_s;
    }

    pub(super) fn heard(&mut self, source: &Source) {
        match self.sources.iter().position(|(known, _)| known == source) {
            Some(at) => self.sources[at].1 += 1,
            None if self.sources.len() < MOST_SOURCES => self.sources.push((source.clone(), 1)),
            None => {}
        }
    }

    /// A pose was given out, at its own time and its arrival's.
    pub(super) fn gave(&mut self, time_s: f64, arrived_s: f64, is_new_clock: bool) {
        self.poses += 1;
        let before = self.before.replace((time_s, arrived_s)).filter(|_| !is_new_clock);
        if let Some((time_before_s, arrived_before_s)) = before {
            let interval_s = time_s - time_before_s;
            let known = self.interval_s.get_or_insert(interval_s);
            *known += (interval_s - *known) / 16.0;
            let uneven_s = (arrived_s - arrived_before_s - interval_s).abs();
            self.jitter_s += (uneven_s - self.jitter_s) / 16.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn why_it_is_silent_is_told_by_what_was_heard() {
        let mut report = Report::default();
        assert_eq!(report.silence(), "no packet came: is the sender on, and does it send there?");
        report.datagrams = 3;
        (0..3).for_each(|_| report.aside(Heard::NoPacket));
        report.last_problem = Some("too short".to_owned());
        let told = "3 packets came, and no pose in them; dropped: 3 no packet of this protocol, or damaged (too short)";
        assert_eq!(report.silence(), told);
        report = Report { datagrams: 9, poses: 9, ..Report::default() };
        assert_eq!(report.silence(), "9 poses came until then");
    }

    #[test]
    fn what_was_dropped_is_told_by_reason() {
        let mut report = Report { poses: 7, datagrams: 12, ..Report::default() };
        assert_eq!(report.summary(), "7 poses in 12 datagrams; dropped: none");
        (0..3).for_each(|_| report.aside(Heard::NoPacket));
        report.aside(Heard::OtherSource);
        // One that turned out to be none.
        report.aside.insert(Heard::OddTime, 0);
        (report.lost, report.jumps) = (2, 1);
        assert_eq!(
            report.summary(),
            "7 poses in 12 datagrams; dropped: 2 lost on the way, 1 of another source, 3 no packet of this protocol, or \
             damaged; its clock jumped 1 time"
        );
    }
}
