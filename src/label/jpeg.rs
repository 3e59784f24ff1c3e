//! XMP in JPEG files: a segment APP1. Source: XMP Specification Part 3, 1.1.3; ITU-T T.81, B.1.

const SEGMENT_NAME: &[u8] = b"http://ns.adobe.com/xap/1.0/\0";

/// A JPEG with a packet behind its segments APP0 and APP1 (JFIF, Exif). A file that is no JPEG, or
/// a packet beyond the largest segment, stays out: the file is returned as it is.
pub fn with_packet(jpeg: &[u8], packet: &str) -> Vec<u8> {
    let length = 2 + SEGMENT_NAME.len() + packet.len();
    let (Ok(length), true) = (u16::try_from(length), jpeg.starts_with(b"\xff\xd8")) else { return jpeg.to_vec() };
    let mut at = 2;
    while let Some([0xff, 0xe0 | 0xe1, high, low]) = jpeg.get(at..at + 4) {
        at += 2 + usize::from(u16::from_be_bytes([*high, *low]));
    }
    let (head, rest) = jpeg.split_at(at.min(jpeg.len()));
    [head, b"\xff\xe1", &length.to_be_bytes(), SEGMENT_NAME, packet.as_bytes(), rest].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packet_follows_the_other_application_segments() {
        let jpeg = b"\xff\xd8\xff\xe0\0\x04ab\xff\xe1\0\x03c\xff\xdb\0\x02rest";
        let expected = [
            &b"\xff\xd8\xff\xe0\0\x04ab\xff\xe1\0\x03c\xff\xe1\0\x23"[..],
            b"http://ns.adobe.com/xap/1.0/\0<x/>\xff\xdb\0\x02rest",
        ];
        assert_eq!(with_packet(jpeg, "<x/>"), expected.concat());
        assert_eq!(with_packet(b"no jpeg", "<x/>"), b"no jpeg");
        assert_eq!(with_packet(jpeg, &"x".repeat(70_000)), jpeg, "beyond a segment");
        // A segment that is longer than the file.
        assert!(with_packet(b"\xff\xd8\xff\xe0\xff\xff", "<x/>").ends_with(b"<x/>"));
    }
}
