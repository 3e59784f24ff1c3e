//! The packets of OpenTrackIO over UDP: a header of 16 bytes, then a sample or a piece of one.
//!
//! | bytes | content, most significant byte first |
//! |---|---|
//! | 0 to 3 | `OTrk` |
//! | 4 | reserved |
//! | 5 | encoding: 1 JSON, 2 CBOR |
//! | 6, 7 | sequence number |
//! | 8 to 11 | offset of the piece in the sample |
//! | 12, 13 | the upper bit: it is the last piece; the others: its length |
//! | 14, 15 | Fletcher-16 over the header before it and the piece |
//!
//! After OpenTrackIO 1.0.1 (opentrackio.org) and SMPTE's reference sender, which agree.

use super::PacketError;

const HEADER_BYTES: usize = 16;
const IDENTIFIER: &[u8; 4] = b"OTrk";
const LAST_FLAG: u16 = 0x8000;

/// Longest fragment that is sent: an Ethernet frame carries 1500 bytes, of which IP takes 20, UDP 8
/// and the header 16.
pub const MAX_PAYLOAD_BYTES: usize = 1500 - 20 - 8 - HEADER_BYTES;

/// Encoding of a sample, by the field of the header.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Encoding {
    #[default]
    Json,
    Cbor,
}

/// One datagram with a verified checksum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Packet<'a> {
    pub encoding: Encoding,
    pub sequence: u16,
    /// Position of the fragment in the sample, bytes.
    pub offset: u32,
    pub is_last: bool,
    pub payload: &'a [u8],
}

impl<'a> Packet<'a> {
    pub fn parse(bytes: &'a [u8]) -> Result<Self, PacketError> {
        let (header, payload) = bytes.split_first_chunk::<HEADER_BYTES>().ok_or(PacketError::Short)?;
        if !header.starts_with(IDENTIFIER) {
            return Err(PacketError::Identifier);
        }
        let pair = |at: usize| u16::from_be_bytes([header[at], header[at + 1]]);
        let length = pair(12);
        if usize::from(length & !LAST_FLAG) != payload.len() {
            return Err(PacketError::Length);
        }
        // Fletcher-16 adds modulo 255. Unreal Engine adds modulo 256.
        let is_whole = |modulus| fletcher16(&[&header[..14], payload], modulus) == pair(14);
        if !is_whole(255) && !is_whole(256) {
            return Err(PacketError::Checksum);
        }
        let encoding = match header[5] {
            1 => Encoding::Json,
            2 => Encoding::Cbor,
            _ => return Err(PacketError::Encoding),
        };
        let offset = u32::from_be_bytes([header[8], header[9], header[10], header[11]]);
        Ok(Self { encoding, sequence: pair(6), offset, is_last: length & LAST_FLAG != 0, payload })
    }
}

/// Splits a sample into datagrams, in order, all with the sample's sequence number. An empty sample
/// gives none.
pub fn packets(encoding: Encoding, sequence: u16, sample: &[u8]) -> Vec<Vec<u8>> {
    let count = sample.len().div_ceil(MAX_PAYLOAD_BYTES);
    let datagram = |(i, piece): (usize, &[u8])| {
        let mut bytes = Vec::with_capacity(HEADER_BYTES + piece.len());
        bytes.extend_from_slice(IDENTIFIER);
        bytes.extend_from_slice(&[0, if encoding == Encoding::Json { 1 } else { 2 }]);
        bytes.extend_from_slice(&sequence.to_be_bytes());
        bytes.extend_from_slice(&((i * MAX_PAYLOAD_BYTES) as u32).to_be_bytes());
        let last = if i + 1 == count { LAST_FLAG } else { 0 };
        bytes.extend_from_slice(&(piece.len() as u16 | last).to_be_bytes());
        let checksum = fletcher16(&[&bytes, piece], 255);
        bytes.extend_from_slice(&checksum.to_be_bytes());
        bytes.extend_from_slice(piece);
        bytes
    };
    sample.chunks(MAX_PAYLOAD_BYTES).enumerate().map(datagram).collect()
}

/// The sum of the bytes in the lower byte, the sum of those sums in the upper one (Fletcher 1982).
fn fletcher16(parts: &[&[u8]], modulus: u32) -> u16 {
    let (mut sum, mut sums) = (0u32, 0u32);
    for byte in parts.iter().copied().flatten() {
        sum = (sum + u32::from(*byte)) % modulus;
        sums = (sums + sum) % modulus;
    }
    (sums << 8 | sum) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fletcher_checksum_matches_known_values() {
        // The algorithm's usual examples: "abcde" is C8F0, "abcdef" 2057, "abcdefgh" 0627.
        for (text, sum) in [("abcde", 0xC8F0), ("abcdef", 0x2057), ("abcdefgh", 0x0627)] {
            assert_eq!(fletcher16(&[text.as_bytes()], 255), sum, "{text}");
        }
        // 255 is 0 modulo 255 and -1 modulo 256.
        assert_eq!((fletcher16(&[&[255, 1]], 255), fletcher16(&[&[255, 1]], 256)), (0x0101, 0xFF00));
    }

    #[test]
    fn packet_matches_the_specified_bytes() {
        // Its checksum, of 4F 54 72 6B 00 01 00 07 00 00 00 00 80 02 and 7B 7D. Sums of the bytes:
        // 79, 163, 22, 129, 129, 130, 130, 137, 137, 137, 137, 137, 10, 12, 135, 5. Sums of these:
        // 79, 242, 9, 138, 12, 142, 17, 154, 36, 173, 55, 192, 202, 214, 94, 99.
        let sent = packets(Encoding::Json, 7, b"{}");
        let header = [0x4F, 0x54, 0x72, 0x6B, 0, 1, 0, 7, 0, 0, 0, 0, 0x80, 2];
        assert_eq!(sent.len(), 1);
        assert_eq!(sent[0][..14], header);
        assert_eq!(sent[0][14..16], [99, 5]);
        assert_eq!(&sent[0][16..], b"{}");
        let packet = Packet::parse(&sent[0]).unwrap();
        let expected = Packet { encoding: Encoding::Json, sequence: 7, offset: 0, is_last: true, payload: b"{}" };
        assert_eq!(packet, expected);
    }

    #[test]
    fn long_sample_is_split_into_datagrams_that_fit() {
        let sample: Vec<u8> = (0..2 * MAX_PAYLOAD_BYTES + 1).map(|i| i as u8).collect();
        let sent = packets(Encoding::Cbor, 0xFFFF, &sample);
        assert!(sent.iter().all(|bytes| bytes.len() <= 1472));
        let parsed: Vec<_> = sent.iter().map(|bytes| Packet::parse(bytes).unwrap()).collect();
        let fragments: Vec<_> = parsed.iter().map(|p| (p.sequence, p.offset, p.is_last, p.payload.len())).collect();
        let n = MAX_PAYLOAD_BYTES;
        assert_eq!(fragments, [(0xFFFF, 0, false, n), (0xFFFF, n as u32, false, n), (0xFFFF, 2 * n as u32, true, 1)]);
        assert!(packets(Encoding::Json, 1, b"").is_empty());
    }

    #[test]
    fn damaged_packets_are_refused_with_the_cause() {
        let sent = packets(Encoding::Json, 7, b"{}").remove(0);
        assert_eq!(Packet::parse(&sent[..15]), Err(PacketError::Short));
        assert_eq!(Packet::parse(&sent[..17]), Err(PacketError::Length));
        assert_eq!(Packet::parse(&[&sent[..], b" "].concat()), Err(PacketError::Length));
        for at in 0..sent.len() {
            let mut damaged = sent.clone();
            damaged[at] ^= 0x10;
            assert!(Packet::parse(&damaged).is_err(), "byte {at}");
        }
        let otherwise = |byte: u8| {
            let mut bytes = sent.clone();
            bytes[5] = byte;
            let sum = fletcher16(&[&bytes[..14], &bytes[16..]], 255).to_be_bytes();
            bytes[14..16].copy_from_slice(&sum);
            bytes
        };
        assert_eq!(Packet::parse(&otherwise(3)), Err(PacketError::Encoding));
        assert_eq!(Packet::parse(&otherwise(2)).unwrap().encoding, Encoding::Cbor);
    }

    #[test]
    fn checksum_of_unreal_engine_is_accepted() {
        let mut bytes = packets(Encoding::Json, 7, b"{\"a\":1}").remove(0);
        let sum = fletcher16(&[&bytes[..14], &bytes[16..]], 256).to_be_bytes();
        assert_ne!(bytes[14..16], sum);
        bytes[14..16].copy_from_slice(&sum);
        assert!(Packet::parse(&bytes).is_ok());
    }
}
