//! Samples put together from their pieces, in bounded memory and time.
//!
//! Senders number pieces in two ways: all pieces of a sample bear its number (as the specification is read by Unreal
//! Engine and by us), or each piece the next (SMPTE's reference sender). Two pieces in a row that join show which. After
//! lost pieces the end of one sample may seem to join the beginning of another, so the second kind needs two joins in a
//! row, and a sender does not change its kind before many. Of the first kind pieces may come in any order, of the second
//! in theirs alone, because a number may stand for two samples.

use std::collections::VecDeque;
use std::net::SocketAddr;

use super::packet::{Encoding, Packet};

/// Longest sample, bytes. The official ones have up to 5 KB.
pub const MOST_SAMPLE: usize = 64 * 1024;
/// A sample whose pieces have not come after this is given up, seconds.
const GIVEN_UP_S: f64 = 0.5;
/// Samples of one sender that wait for pieces at once.
const MOST_OPEN: usize = 4;
/// Senders whose pieces are put together at once; the one not heard for longest makes room. With the numbers above this
/// bounds memory: 16 · 4 · 64 KiB are 4 MiB.
const MOST_SENDERS: usize = 16;

/// So many joins in a row prove that a sender numbers the pieces of a sample one by one.
const PROVE_NEXT: u32 = 2;
/// So many joins in a row prove that a sender numbers pieces otherwise than was proven before.
const PROVE_CHANGE: u32 = 8;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Numbering {
    /// All pieces of a sample bear one number.
    Same,
    /// Each piece has the next.
    Next,
}

/// A sample of which pieces are missing.
#[derive(Debug)]
struct Open {
    encoding: Encoding,
    /// The number of its first piece.
    first: u16,
    began_s: f64,
    /// (offset, bytes), ascending, none over another.
    pieces: Vec<(usize, Vec<u8>)>,
    /// Known with the last piece.
    length: Option<usize>,
}

#[derive(Debug)]
struct Sender {
    address: SocketAddr,
    /// `None` until it is proven.
    numbering: Option<Numbering>,
    /// What the last joins showed, and how many in a row.
    evidence: Option<(Numbering, u32)>,
    open: VecDeque<Open>,
    /// The piece before: its number, its end, and the first number of its sample.
    before: Option<(u16, usize, u16)>,
}

/// What became of a packet.
#[derive(Debug, PartialEq)]
pub enum Assembly {
    /// It completes a sample.
    Whole(Encoding, Vec<u8>),
    /// More pieces are to come, or it is not proven yet that these belong together.
    Open,
    /// It belongs to nothing: its beginning was lost, it lies over another piece, or its sample is too long.
    Stray,
}

#[derive(Debug, Default)]
pub struct Assembler {
    senders: VecDeque<Sender>,
    /// Samples that were begun and never became whole.
    pub given_up: u64,
}

impl Assembler {
    pub fn take(&mut self, from: SocketAddr, packet: &Packet, now_s: f64) -> Assembly {
        if packet.offset == 0 && packet.is_last {
            return Assembly::Whole(packet.encoding, packet.payload.to_vec());
        }
        let at = self.senders.iter().position(|sender| sender.address == from);
        let mut sender = at.and_then(|at| self.senders.remove(at)).unwrap_or_else(|| Sender::new(from));
        let taken = sender.take(packet, now_s, &mut self.given_up);
        self.senders.push_back(sender);
        if self.senders.len() > MOST_SENDERS {
            let silent = self.senders.pop_front();
            self.given_up += silent.map_or(0, |sender| sender.open.len() as u64);
        }
        taken
    }

    /// Gives up samples that have waited for pieces for too long.
    pub fn give_up(&mut self, now_s: f64) {
        self.given_up += self.senders.iter_mut().map(|sender| sender.give_up(now_s)).sum::<u64>();
    }

    /// Bytes that wait for others.
    pub fn held_bytes(&self) -> usize {
        self.senders.iter().flat_map(|s| &s.open).flat_map(|o| &o.pieces).map(|piece| piece.1.len()).sum()
    }
}

impl Sender {
    fn new(address: SocketAddr) -> Self {
        Self { address, numbering: None, evidence: None, open: VecDeque::new(), before: None }
    }

    fn take(&mut self, packet: &Packet, now_s: f64, given_up: &mut u64) -> Assembly {
        let offset = packet.offset as usize;
        let end = offset.saturating_add(packet.payload.len());
        // An empty piece says nothing, and any number of them would fit.
        if end > MOST_SAMPLE || packet.payload.is_empty() {
            return Assembly::Stray;
        }
        let joined = self.before.filter(|(_, end, _)| *end == offset && offset > 0);
        let shown = match joined {
            Some((number, ..)) if number == packet.sequence => Some(Numbering::Same),
            Some((number, ..)) if number.wrapping_add(1) == packet.sequence => Some(Numbering::Next),
            _ => None,
        };
        shown.into_iter().for_each(|shown| self.learn(shown));
        let is_proven = self.numbering.is_some();
        let first = match (self.numbering.or(shown), joined) {
            (Some(Numbering::Same), _) => packet.sequence,
            _ if offset == 0 => packet.sequence,
            (Some(Numbering::Next), Some((number, _, first))) if number.wrapping_add(1) == packet.sequence => first,
            _ => {
                self.before = None;
                return Assembly::Stray;
            }
        };
        self.before = Some((packet.sequence, end, first));

        *given_up += self.give_up(now_s);
        let at = self.open.iter().position(|open| open.first == first && open.encoding == packet.encoding);
        let at = at.unwrap_or_else(|| {
            if self.open.len() == MOST_OPEN {
                self.open.pop_front();
                *given_up += 1;
            }
            let new = Open { encoding: packet.encoding, first, began_s: now_s, pieces: Vec::new(), length: None };
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
        let pieces = self.open.remove(at).into_iter().flat_map(|open| open.pieces);
        if !is_proven {
            // Its pieces may be of two samples. The next sample shows whether they are numbered so.
            return Assembly::Open;
        }
        Assembly::Whole(packet.encoding, pieces.flat_map(|piece| piece.1).collect())
    }

    /// Returns how many samples were given up.
    fn give_up(&mut self, now_s: f64) -> u64 {
        let begun = self.open.len();
        self.open.retain(|open| now_s - open.began_s <= GIVEN_UP_S);
        (begun - self.open.len()) as u64
    }

    /// Two pieces in a row joined, with numbers of this kind.
    fn learn(&mut self, shown: Numbering) {
        let before = self.evidence.filter(|(before, _)| *before == shown).map_or(0, |(_, joins)| joins);
        let joins = before.saturating_add(1);
        self.evidence = Some((shown, joins));
        let needed = match (self.numbering, shown) {
            (None, Numbering::Same) => 1,
            (None, Numbering::Next) => PROVE_NEXT,
            (Some(_), _) => PROVE_CHANGE,
        };
        if joins >= needed {
            self.numbering = Some(shown);
        }
    }
}

impl Open {
    /// Whether there was room for it.
    fn add(&mut self, offset: usize, bytes: &[u8], is_last: bool) -> bool {
        let end = offset + bytes.len();
        let after = self.pieces.partition_point(|piece| piece.0 < offset);
        let is_free = after.checked_sub(1).is_none_or(|i| self.pieces[i].0 + self.pieces[i].1.len() <= offset)
            && self.pieces.get(after).is_none_or(|next| end <= next.0)
            && self.length.is_none_or(|length| end <= length && !is_last)
            && (!is_last || after == self.pieces.len());
        if is_free {
            self.pieces.insert(after, (offset, bytes.to_vec()));
            self.length = self.length.or(is_last.then_some(end));
        }
        is_free
    }

    fn is_whole(&self) -> bool {
        self.length == Some(self.pieces.iter().map(|piece| piece.1.len()).sum())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn from(port: u16) -> SocketAddr {
        SocketAddr::from(([127, 0, 0, 1], port))
    }

    fn piece(sequence: u16, offset: u32, is_last: bool, payload: &[u8]) -> Packet<'_> {
        Packet { encoding: Encoding::Json, sequence, offset, is_last, payload }
    }

    fn whole(text: &str) -> Assembly {
        Assembly::Whole(Encoding::Json, text.into())
    }

    #[test]
    fn pieces_with_one_number_come_together_in_any_order() {
        let mut a = Assembler::default();
        // The first two in a row tell how they are numbered.
        assert_eq!(a.take(from(1), &piece(5, 0, false, b"ab"), 0.0), Assembly::Open);
        assert_eq!(a.take(from(1), &piece(5, 2, false, b"cd"), 0.0), Assembly::Open);
        // Another sender with the same number, and one piece twice.
        assert_eq!(a.take(from(2), &piece(5, 0, false, b"xy"), 0.0), Assembly::Open);
        assert_eq!(a.take(from(1), &piece(5, 2, false, b"cd"), 0.0), Assembly::Stray);
        assert_eq!(a.take(from(1), &piece(5, 4, true, b"e"), 0.0), whole("abcde"));
        assert_eq!(a.take(from(1), &piece(6, 4, true, b"E"), 0.1), Assembly::Open);
        assert_eq!(a.take(from(1), &piece(6, 0, false, b"AB"), 0.1), Assembly::Open);
        assert_eq!(a.take(from(1), &piece(6, 2, false, b"CD"), 0.1), whole("ABCDE"));
        assert_eq!((a.given_up, a.held_bytes()), (0, 2));
    }

    #[test]
    fn pieces_numbered_one_by_one_are_never_mixed() {
        let mut a = Assembler::default();
        // As SMPTE's reference sender numbers: sample n has the pieces n and n + 1. The first might be of two samples.
        assert_eq!(a.take(from(1), &piece(0xFFFE, 0, false, b"xy"), 0.0), Assembly::Open);
        assert_eq!(a.take(from(1), &piece(0xFFFF, 2, true, b"z"), 0.0), Assembly::Open);
        assert_eq!(a.take(from(1), &piece(0xFFFF, 0, false, b"ab"), 0.0), Assembly::Open);
        assert_eq!(a.take(from(1), &piece(0, 2, true, b"c"), 0.0), whole("abc"));
        assert_eq!(a.take(from(1), &piece(0, 0, false, b"AB"), 0.1), Assembly::Open);
        assert_eq!(a.take(from(1), &piece(1, 2, true, b"C"), 0.1), whole("ABC"));
        // The beginning of one is lost: its end bears the number of the next one's beginning.
        assert_eq!(a.take(from(1), &piece(2, 2, true, b"d"), 0.2), Assembly::Stray);
        assert_eq!(a.take(from(1), &piece(2, 0, false, b"ef"), 0.3), Assembly::Open);
        assert_eq!(a.take(from(1), &piece(3, 2, true, b"g"), 0.3), whole("efg"));
    }

    #[test]
    fn end_of_one_sample_never_joins_the_beginning_of_another() {
        // All pieces of a sample bear its number. The last of 6 is lost, and the first of 7.
        for heard in [0, 1, 9] {
            let mut a = Assembler::default();
            for sequence in 0..heard {
                assert_eq!(a.take(from(1), &piece(sequence, 0, false, b"ab"), 0.0), Assembly::Open);
                assert_eq!(a.take(from(1), &piece(sequence, 2, true, b"c"), 0.0), whole("abc"));
            }
            assert_eq!(a.take(from(1), &piece(heard, 0, false, b"AB"), 0.1), Assembly::Open);
            assert_eq!(a.take(from(1), &piece(heard + 1, 2, true, b"d"), 0.1), Assembly::Open, "{heard} before");
            assert_eq!(a.take(from(1), &piece(heard + 2, 0, false, b"ef"), 0.2), Assembly::Open);
            assert_eq!(a.take(from(1), &piece(heard + 2, 2, true, b"g"), 0.2), whole("efg"), "{heard} before");
        }
    }

    #[test]
    fn what_is_not_complete_in_time_is_given_up() {
        let mut a = Assembler::default();
        a.take(from(1), &piece(5, 0, false, b"ab"), 0.0);
        assert_eq!(a.take(from(1), &piece(6, 0, false, b"cd"), 1.0), Assembly::Open);
        assert_eq!((a.given_up, a.held_bytes()), (1, 2));
    }

    #[test]
    fn a_flood_of_pieces_is_bounded() {
        let mut a = Assembler::default();
        let long = vec![7; 16_000];
        for i in 0..20_000u32 {
            let offset = 16_000 * (i % 7);
            let _ = a.take(from((i % 997) as u16), &piece((i % 31) as u16, offset, false, &long), 0.0);
            assert!(a.held_bytes() <= MOST_SENDERS * MOST_OPEN * MOST_SAMPLE);
        }
        assert!(a.senders.len() <= MOST_SENDERS && a.given_up > 100);
        for offset in [MOST_SAMPLE as u32 - 1, u32::MAX] {
            assert_eq!(a.take(from(1), &piece(1, offset, true, b"ab"), 0.0), Assembly::Stray);
        }
        assert_eq!(a.take(from(1), &piece(1, 0, false, b""), 0.0), Assembly::Stray);
    }

    #[test]
    fn pieces_that_contradict_each_other_make_no_sample() {
        let mut a = Assembler::default();
        a.take(from(1), &piece(1, 0, false, b"abcd"), 0.0);
        a.take(from(1), &piece(1, 4, false, b"efgh"), 0.0);
        // Over what is there; an end before what is there.
        assert_eq!(a.take(from(1), &piece(1, 6, false, b"xx"), 0.0), Assembly::Stray);
        assert_eq!(a.take(from(1), &piece(1, 3, true, b"x"), 0.0), Assembly::Stray);
        assert_eq!(a.take(from(1), &piece(1, 8, true, b"i"), 0.0), whole("abcdefghi"));
    }
}
