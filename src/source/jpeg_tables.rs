//! JPEG pictures without Huffman tables, as cameras deliver them: the standard's typical tables
//! apply (ITU-T T.81, annex K.3; Microsoft's AVI "MJPG" requires them). The decoder does not have
//! them, so they are put in.

use std::borrow::Cow;
use std::sync::LazyLock;

use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;

const START: [u8; 2] = [0xff, 0xd8];
const TABLES: u8 = 0xc4;
const SCAN: u8 = 0xda;

/// The segments with the standard's tables. The encoder has no others. No memo: constant
/// tables.
static STANDARD: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let mut file = Vec::new();
    let encoded = JpegEncoder::new(&mut file).encode(&[0; 3], 1, 1, ExtendedColorType::Rgb8);
    let tables = segments(&file).filter(|(marker, _)| *marker == TABLES);
    match encoded {
        Ok(()) => tables.flat_map(|(_, bytes)| bytes.to_vec()).collect(),
        Err(_) => Vec::new(),
    }
});

/// The markers before the scan, each with its whole segment. Ends where the file is damaged.
fn segments(file: &[u8]) -> impl Iterator<Item = (u8, &[u8])> {
    let mut rest = file.strip_prefix(&START).unwrap_or_default();
    std::iter::from_fn(move || {
        let [0xff, marker, high, low, ..] = *rest else { return None };
        let (segment, behind) = rest.split_at_checked(2 + usize::from(u16::from_be_bytes([high, low])))?;
        rest = if marker == SCAN { &[] } else { behind };
        Some((marker, segment))
    })
}

/// The file with the standard's tables, if it has none.
pub fn with_tables(file: &[u8]) -> Cow<'_, [u8]> {
    if segments(file).any(|(marker, _)| marker == TABLES) || !file.starts_with(&START) {
        return Cow::Borrowed(file);
    }
    Cow::Owned([&START, STANDARD.as_slice(), &file[START.len()..]].concat())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_tables_are_inserted_and_nothing_else() {
        let mut file = Vec::new();
        let codes: Vec<u8> = (0..16 * 16 * 3u32).map(|i| (i * 7 % 251) as u8).collect();
        JpegEncoder::new(&mut file).encode(&codes, 16, 16, ExtendedColorType::Rgb8).unwrap();
        assert_eq!(with_tables(&file), file);
        // T.81, table K.3: the first table is for luminance's DC, with 12 codes of the lengths 2 to
        // 9.
        let head = [0xff, 0xc4, 0, 31, 0, 0, 1, 5, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 1, 2, 3, 4];
        assert!(STANDARD.starts_with(&head) && STANDARD.len() == 33 + 33 + 183 + 183, "{}", STANDARD.len());
        let mut bare = START.to_vec();
        let rest: usize = segments(&file).map(|(_, segment)| segment.len()).sum::<usize>() + 2;
        segments(&file).filter(|(marker, _)| *marker != TABLES).for_each(|(_, segment)| bare.extend(segment));
        bare.extend(&file[rest..]);
        assert!(bare.len() < file.len() && with_tables(&bare).len() == file.len());
        assert_eq!(with_tables(&with_tables(&bare)), with_tables(&bare));
        for damaged in [&file[..1], &file[..30], &[], b"\xff\xd8\xff\xc4\xff\xff"] {
            let _ = with_tables(damaged);
        }
    }
}
