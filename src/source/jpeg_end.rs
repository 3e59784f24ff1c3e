//! The length of a JPEG file in a longer buffer (ITU-T T.81, annex B.1.1 and B.2.1).

const START: u8 = 0xd8;
const END: u8 = 0xd9;
const SCAN: u8 = 0xda;

/// Bytes from the start marker to behind the end marker. End markers inside a segment (a thumbnail)
/// are skipped. `None` if the file is damaged or has no end marker.
pub fn length(buffer: &[u8]) -> Option<usize> {
    if buffer.get(..2)? != [0xff, START] {
        return None;
    }
    let mut at = 2;
    loop {
        let marker = marker(buffer, &mut at)?;
        match marker {
            END => return Some(at),
            START => return None,
            // Markers without a segment: TEM, RST.
            0x01 | 0xd0..=0xd7 => {}
            _ => {
                let bytes: [u8; 2] = buffer.get(at..at + 2)?.try_into().ok()?;
                let length = usize::from(u16::from_be_bytes(bytes));
                at += length;
                if length < 2 {
                    return None;
                }
                if marker == SCAN {
                    at = scan_end(buffer, at)?;
                }
            }
        }
    }
}

/// The marker at a place, which is moved behind it. Fill bytes may stand before it.
fn marker(buffer: &[u8], at: &mut usize) -> Option<u8> {
    if *buffer.get(*at)? != 0xff {
        return None;
    }
    let fill = buffer[*at..].iter().take_while(|byte| **byte == 0xff).count();
    *at += fill + 1;
    buffer.get(*at - 1).copied()
}

/// End of the entropy-coded data that begins at `from`: the next marker other than a restart.
fn scan_end(buffer: &[u8], from: usize) -> Option<usize> {
    let pairs = buffer.get(from..)?.windows(2);
    let is_end = |pair: &[u8]| pair[0] == 0xff && !matches!(pair[1], 0x00 | 0xd0..=0xd7 | 0xff);
    pairs.into_iter().position(is_end).map(|at| from + at)
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::ExtendedColorType;
    use image::codecs::jpeg::JpegEncoder;

    fn jpeg(seed: u32) -> Vec<u8> {
        let mut file = Vec::new();
        let codes: Vec<u8> = (0..48 * 32 * 3u32).map(|i| (i.wrapping_mul(2_654_435_761 + seed) >> 24) as u8).collect();
        JpegEncoder::new_with_quality(&mut file, 95).encode(&codes, 48, 32, ExtendedColorType::Rgb8).unwrap();
        file
    }

    #[test]
    fn padding_and_the_rest_of_an_older_file_are_cut_off() {
        for seed in 0..20 {
            let file = jpeg(seed);
            assert_eq!(length(&file), Some(file.len()));
            for tail in [&[0; 7][..], &[0xff; 3], &file[9..], &jpeg(seed + 1)] {
                assert_eq!(length(&[&file, tail].concat()), Some(file.len()));
            }
        }
    }

    #[test]
    fn thumbnail_in_a_segment_does_not_end_the_file() {
        let (file, thumbnail) = (jpeg(1), jpeg(2));
        let size = (2 + thumbnail.len() as u16).to_be_bytes();
        let whole = [&file[..2], &[0xff, 0xff, 0xe1], &size, &thumbnail, &file[2..]].concat();
        assert_eq!(length(&[&whole[..], &[0; 99]].concat()), Some(whole.len()));
    }

    #[test]
    fn file_that_is_cut_has_no_length_at_any_cut() {
        let file = jpeg(3);
        for cut in 0..file.len() {
            assert_eq!(length(&file[..cut]), None, "{cut}");
        }
        // Segments of impossible length, and a start marker inside.
        for damaged in [&b"\xff\xd8\xff\xe0\x00\x01\xff\xd9"[..], b"\xff\xd8\x00\xff\xd9", b"\xff\xd8\xff\xd8\xff\xd9"]
        {
            assert_eq!(length(damaged), None);
        }
        assert_eq!(length(b"\xff\xd8\xff\xd9\x00"), Some(4));
    }
}
