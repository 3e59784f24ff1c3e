//! Reassembles samples from fragments, in bounded memory and time.
//!
//! Senders number fragments in two ways: all fragments of a sample have its number (as the
//! specification is read by Unreal Engine and by this program), or the number increases with each
//! fragment (SMPTE's reference sender). Two consecutive fragments that join show which. After lost
//! fragments the end of one sample may seem to join the beginning of another, so the second kind
//! needs two joins in a row, and a sender needs many joins to change its kind. Fragments of the
//! first kind may arrive in any order. Those of the second must arrive in order, because a number
//! may belong to two samples.

use std::collections::VecDeque;
use std::net::SocketAddr;

use super::packet::{Encoding, Packet};

/// Longest sample, bytes. The official ones have up to 5 KB.
pub const MAX_SAMPLE_BYTES: usize = 64 * 1024;
/// A sample is abandoned if it is incomplete after this time, seconds.
const ABANDON_AFTER_S: f64 = 0.5;
/// Largest number of incomplete samples of one sender.
const MAX_PARTIAL_SAMPLES: usize = 4;
/// Largest number of senders with incomplete samples; the one silent for longest is evicted. This
/// bounds memory: 16 · 4 · 64 KiB are 4 MiB.
const MAX_SENDERS: usize = 16;

/// Number of consecutive joins that prove that the number increases with each fragment.
const MIN_JOINS_NEXT: u32 = 2;
/// Number of consecutive joins that change a proven numbering.
const MIN_JOINS_CHANGE: u32 = 8;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Numbering {
    /// All fragments of a sample have one number.
    Same,
    /// The number increases with each fragment.
    Next,
}

/// A sample with missing fragments.
#[derive(Debug)]
struct Open {
    encoding: Encoding,
    /// Number of its first fragment.
    first: u16,
    began_s: f64,
    /// (offset, bytes), ascending, without overlap.
    fragments: Vec<(usize, Vec<u8>)>,
    /// Known once the last fragment has arrived.
    length: Option<usize>,
}

#[derive(Debug)]
struct SenderState {
    address: SocketAddr,
    /// `None` until proven.
    numbering: Option<Numbering>,
    /// Kind of the last joins, and their number in a row.
    evidence: Option<(Numbering, u32)>,
    open: VecDeque<Open>,
    /// The previous fragment: its number, its end, and the first number of its sample.
    previous: Option<(u16, usize, u16)>,
}

/// Outcome of a packet.
#[derive(Debug, PartialEq)]
pub enum Assembly {
    /// The packet completes a sample.
    Whole(Encoding, Vec<u8>),
    /// Fragments are missing, or it is not proven yet that these belong together.
    Open,
    /// Dropped: its beginning was lost, it overlaps another fragment, or its sample is too long.
    Stray,
}

/// Incomplete samples by sender; those that take too long are dropped.
#[derive(Debug, Default)]
pub struct Assembler {
    senders: VecDeque<SenderState>,
    /// Number of samples that were never completed.
    pub abandoned: u64,
}

impl Assembler {
    pub fn take(&mut self, from: SocketAddr, packet: &Packet, now_s: f64) -> Assembly {
        if packet.offset == 0 && packet.is_last {
            return Assembly::Whole(packet.encoding, packet.payload.to_vec());
        }
        let at = self.senders.iter().position(|sender| sender.address == from);
        let mut sender = at.and_then(|at| self.senders.remove(at)).unwrap_or_else(|| SenderState::new(from));
        let taken = sender.take(packet, now_s, &mut self.abandoned);
        self.senders.push_back(sender);
        if self.senders.len() > MAX_SENDERS {
            let silent = self.senders.pop_front();
            self.abandoned += silent.map_or(0, |sender| sender.open.len() as u64);
        }
        taken
    }

    /// Abandons samples that have been incomplete for too long.
    pub fn abandon_old(&mut self, now_s: f64) {
        self.abandoned += self.senders.iter_mut().map(|sender| sender.abandon_old(now_s)).sum::<u64>();
    }

    /// Number of buffered bytes.
    #[cfg(test)]
    fn buffered_bytes(&self) -> usize {
        self.senders.iter().flat_map(|s| &s.open).flat_map(|o| &o.fragments).map(|fragment| fragment.1.len()).sum()
    }
}

impl SenderState {
    fn new(address: SocketAddr) -> Self {
        Self { address, numbering: None, evidence: None, open: VecDeque::new(), previous: None }
    }

    fn take(&mut self, packet: &Packet, now_s: f64, abandoned: &mut u64) -> Assembly {
        let offset = packet.offset as usize;
        let end = offset.saturating_add(packet.payload.len());
        // An empty fragment carries no information, and any number of them would fit.
        if end > MAX_SAMPLE_BYTES || packet.payload.is_empty() {
            return Assembly::Stray;
        }
        let joined = self.previous.filter(|(_, end, _)| *end == offset && offset > 0);
        let kind = match joined {
            Some((number, ..)) if number == packet.sequence => Some(Numbering::Same),
            Some((number, ..)) if number.wrapping_add(1) == packet.sequence => Some(Numbering::Next),
            _ => None,
        };
        kind.into_iter().for_each(|kind| self.learn(kind));
        let is_proven = self.numbering.is_some();
        let first = match (self.numbering.or(kind), joined) {
            (Some(Numbering::Same), _) => packet.sequence,
            _ if offset == 0 => packet.sequence,
            (Some(Numbering::Next), Some((number, _, first))) if number.wrapping_add(1) == packet.sequence => first,
            _ => {
                self.previous = None;
                return Assembly::Stray;
            }
        };
        self.previous = Some((packet.sequence, end, first));

        *abandoned += self.abandon_old(now_s);
        let at = self.open.iter().position(|open| open.first == first && open.encoding == packet.encoding);
        let at = at.unwrap_or_else(|| {
            if self.open.len() == MAX_PARTIAL_SAMPLES {
                self.open.pop_front();
                *abandoned += 1;
            }
            let new = Open { encoding: packet.encoding, first, began_s: now_s, fragments: Vec::new(), length: None };
            self.open.push_back(new);
            self.open.len() - 1
        });
        let open = &mut self.open[at];
        if !open.add(offset, packet.payload, packet.is_last) {
            return Assembly::Stray;
        }
        if !open.is_whole() {
            return Assembly::Open;
        }
        let fragments = self.open.remove(at).into_iter().flat_map(|open| open.fragments);
        if !is_proven {
            // The fragments may be of two samples. The next sample shows how they are numbered.
            return Assembly::Open;
        }
        Assembly::Whole(packet.encoding, fragments.flat_map(|fragment| fragment.1).collect())
    }

    /// Returns the number of abandoned samples.
    fn abandon_old(&mut self, now_s: f64) -> u64 {
        let begun = self.open.len();
        self.open.retain(|open| now_s - open.began_s <= ABANDON_AFTER_S);
        (begun - self.open.len()) as u64
    }

    /// Adds the evidence of a join.
    fn learn(&mut self, kind: Numbering) {
        let previous = self.evidence.filter(|(previous, _)| *previous == kind).map_or(0, |(_, joins)| joins);
        let joins = previous.saturating_add(1);
        self.evidence = Some((kind, joins));
        let needed = match (self.numbering, kind) {
            (None, Numbering::Same) => 1,
            (None, Numbering::Next) => MIN_JOINS_NEXT,
            (Some(_), _) => MIN_JOINS_CHANGE,
        };
        if joins >= needed {
            self.numbering = Some(kind);
        }
    }
}

impl Open {
    /// Returns true if the fragment was inserted.
    fn add(&mut self, offset: usize, bytes: &[u8], is_last: bool) -> bool {
        let end = offset + bytes.len();
        let after = self.fragments.partition_point(|fragment| fragment.0 < offset);
        let is_free = after.checked_sub(1).is_none_or(|i| self.fragments[i].0 + self.fragments[i].1.len() <= offset)
            && self.fragments.get(after).is_none_or(|next| end <= next.0)
            && self.length.is_none_or(|length| end <= length && !is_last)
            && (!is_last || after == self.fragments.len());
        if is_free {
            self.fragments.insert(after, (offset, bytes.to_vec()));
            self.length = self.length.or(is_last.then_some(end));
        }
        is_free
    }

    fn is_whole(&self) -> bool {
        self.length == Some(self.fragments.iter().map(|fragment| fragment.1.len()).sum())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn from(port: u16) -> SocketAddr {
        SocketAddr::from(([127, 0, 0, 1], port))
    }

    fn fragment(sequence: u16, offset: u32, is_last: bool, payload: &[u8]) -> Packet<'_> {
        Packet { encoding: Encoding::Json, sequence, offset, is_last, payload }
    }

    fn whole(text: &str) -> Assembly {
        Assembly::Whole(Encoding::Json, text.into())
    }

    #[test]
    fn fragments_with_one_number_are_joined_in_any_order() {
        let mut a = Assembler::default();
        // The first two consecutive fragments determine the numbering.
        assert_eq!(a.take(from(1), &fragment(5, 0, false, b"ab"), 0.0), Assembly::Open);
        assert_eq!(a.take(from(1), &fragment(5, 2, false, b"cd"), 0.0), Assembly::Open);
        // Another sender with the same number, and a repeated fragment.
        assert_eq!(a.take(from(2), &fragment(5, 0, false, b"xy"), 0.0), Assembly::Open);
        assert_eq!(a.take(from(1), &fragment(5, 2, false, b"cd"), 0.0), Assembly::Stray);
        assert_eq!(a.take(from(1), &fragment(5, 4, true, b"e"), 0.0), whole("abcde"));
        assert_eq!(a.take(from(1), &fragment(6, 4, true, b"E"), 0.1), Assembly::Open);
        assert_eq!(a.take(from(1), &fragment(6, 0, false, b"AB"), 0.1), Assembly::Open);
        assert_eq!(a.take(from(1), &fragment(6, 2, false, b"CD"), 0.1), whole("ABCDE"));
        assert_eq!((a.abandoned, a.buffered_bytes()), (0, 2));
    }

    #[test]
    fn fragments_with_increasing_numbers_are_never_mixed() {
        let mut a = Assembler::default();
        // The numbering of SMPTE's reference sender: sample n has the fragments n and n + 1. The
        // first could be of two samples.
        assert_eq!(a.take(from(1), &fragment(0xFFFE, 0, false, b"xy"), 0.0), Assembly::Open);
        assert_eq!(a.take(from(1), &fragment(0xFFFF, 2, true, b"z"), 0.0), Assembly::Open);
        assert_eq!(a.take(from(1), &fragment(0xFFFF, 0, false, b"ab"), 0.0), Assembly::Open);
        assert_eq!(a.take(from(1), &fragment(0, 2, true, b"c"), 0.0), whole("abc"));
        assert_eq!(a.take(from(1), &fragment(0, 0, false, b"AB"), 0.1), Assembly::Open);
        assert_eq!(a.take(from(1), &fragment(1, 2, true, b"C"), 0.1), whole("ABC"));
        // The beginning of a sample is lost: its end has the number of the next one's beginning.
        assert_eq!(a.take(from(1), &fragment(2, 2, true, b"d"), 0.2), Assembly::Stray);
        assert_eq!(a.take(from(1), &fragment(2, 0, false, b"ef"), 0.3), Assembly::Open);
        assert_eq!(a.take(from(1), &fragment(3, 2, true, b"g"), 0.3), whole("efg"));
    }

    #[test]
    fn end_of_one_sample_never_joins_the_beginning_of_another() {
        // All fragments of a sample have its number. The last of 6 is lost, and the first of 7.
        for earlier_count in [0, 1, 9] {
            let mut a = Assembler::default();
            for sequence in 0..earlier_count {
                assert_eq!(a.take(from(1), &fragment(sequence, 0, false, b"ab"), 0.0), Assembly::Open);
                assert_eq!(a.take(from(1), &fragment(sequence, 2, true, b"c"), 0.0), whole("abc"));
            }
            assert_eq!(a.take(from(1), &fragment(earlier_count, 0, false, b"AB"), 0.1), Assembly::Open);
            assert_eq!(
                a.take(from(1), &fragment(earlier_count + 1, 2, true, b"d"), 0.1),
                Assembly::Open,
                "{earlier_count} before"
            );
            assert_eq!(a.take(from(1), &fragment(earlier_count + 2, 0, false, b"ef"), 0.2), Assembly::Open);
            assert_eq!(
                a.take(from(1), &fragment(earlier_count + 2, 2, true, b"g"), 0.2),
                whole("efg"),
                "{earlier_count} before"
            );
        }
    }

    #[test]
    fn incomplete_sample_is_abandoned_in_time() {
        let mut a = Assembler::default();
        a.take(from(1), &fragment(5, 0, false, b"ab"), 0.0);
        assert_eq!(a.take(from(1), &fragment(6, 0, false, b"cd"), 1.0), Assembly::Open);
        assert_eq!((a.abandoned, a.buffered_bytes()), (1, 2));
    }

    #[test]
    fn flood_of_fragments_is_bounded() {
        let mut a = Assembler::default();
        let long = vec![7; 16_000];
        for i in 0..20_000u32 {
            let offset = 16_000 * (i % 7);
            let _ = a.take(from((i % 997) as u16), &fragment((i % 31) as u16, offset, false, &long), 0.0);
            assert!(a.buffered_bytes() <= MAX_SENDERS * MAX_PARTIAL_SAMPLES * MAX_SAMPLE_BYTES);
        }
        assert!(a.senders.len() <= MAX_SENDERS && a.abandoned > 100);
        for offset in [MAX_SAMPLE_BYTES as u32 - 1, u32::MAX] {
            assert_eq!(a.take(from(1), &fragment(1, offset, true, b"ab"), 0.0), Assembly::Stray);
        }
        assert_eq!(a.take(from(1), &fragment(1, 0, false, b""), 0.0), Assembly::Stray);
    }

    #[test]
    fn contradicting_fragments_give_no_sample() {
        let mut a = Assembler::default();
        a.take(from(1), &fragment(1, 0, false, b"abcd"), 0.0);
        a.take(from(1), &fragment(1, 4, false, b"efgh"), 0.0);
        // An overlap; an end before existing data.
        assert_eq!(a.take(from(1), &fragment(1, 6, false, b"xx"), 0.0), Assembly::Stray);
        assert_eq!(a.take(from(1), &fragment(1, 3, true, b"x"), 0.0), Assembly::Stray);
        assert_eq!(a.take(from(1), &fragment(1, 8, true, b"i"), 0.0), whole("abcdefghi"));
    }
}
