//! The container of HEIC and AVIF pictures, as far as their size, rotation and colour. Their pixels
//! are decoded by another program. Source: ISO/IEC 14496-12 (boxes), ISO/IEC 23008-12 (HEIF).
//!
//! Not modelled: files of several top-level pictures (bursts), a primary picture that is smaller
//! than another one of the file, properties of several pictures that differ in rotation. A mirrored
//! picture is described as it is decoded.

use std::io::Read;
use std::path::Path;

use super::{SourceError, file as plain};

/// Brands of files that hold pictures. `msf1`, `hevc` and `avis` are sequences with a picture.
const BRANDS: [&[u8; 4]; 9] = [b"heic", b"heix", b"heim", b"heis", b"mif1", b"msf1", b"hevc", b"avif", b"avis"];
/// The descriptions of pictures are at the start of the file; longer ones are not read, bytes.
const MAX_META_BYTES: u64 = 1 << 24;

/// True if a file of the ISO base media format has one of these brands.
pub fn has_brand(start: &[u8], brands: &[&[u8; 4]]) -> bool {
    start.get(4..8) == Some(b"ftyp") && brands.iter().any(|brand| start.get(8..12) == Some(*brand))
}

/// True if a file begins as a HEIF picture.
pub fn is_picture(start: &[u8]) -> bool {
    has_brand(start, &BRANDS)
}

/// Properties of the largest picture of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HeifPicture {
    /// Size before the rotation, px.
    pub width: u32,
    pub height: u32,
    /// Bits of a channel.
    pub bits: u32,
    /// Counter-clockwise rotation that decoders apply, quarter turns.
    pub quarter_turns: u32,
}

/// Colour information of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum HeifColor {
    /// Code points of ITU-T H.273.
    Codes {
        primaries: u16,
        transfer: u16,
    },
    Icc(Vec<u8>),
}

/// The first colour information of a file. `None` without one, and for damaged files.
pub fn read_color(file: &Path) -> Option<HeifColor> {
    let mut bytes = Vec::new();
    plain::open(file).ok()?.take(MAX_META_BYTES).read_to_end(&mut bytes).ok()?;
    let content = boxes(properties(&bytes)?).find(|(name, _)| *name == b"colr")?.1;
    let (kind, content) = content.split_first_chunk::<4>()?;
    match kind {
        b"nclx" => {
            let number = |at: usize| Some(u16::from_be_bytes([*content.get(at)?, *content.get(at + 1)?]));
            Some(HeifColor::Codes { primaries: number(0)?, transfer: number(2)? })
        }
        b"prof" | b"rICC" => Some(HeifColor::Icc(content.to_vec())),
        _ => None,
    }
}

/// Reads the properties of a file's largest picture.
pub fn read(file: &Path) -> Result<HeifPicture, SourceError> {
    let failed = |source| SourceError::Read { file: file.to_owned(), source };
    let mut bytes = Vec::new();
    plain::open(file).map_err(failed)?.take(MAX_META_BYTES).read_to_end(&mut bytes).map_err(failed)?;
    parse(&bytes).ok_or_else(|| SourceError::content(file, "the HEIF picture is damaged: its size is missing"))
}

/// The boxes of the pictures' properties.
fn properties(bytes: &[u8]) -> Option<&[u8]> {
    // Version and flags precede the boxes of `meta`.
    let meta = boxes(bytes).find(|(name, _)| *name == b"meta")?.1.get(4..)?;
    let properties = boxes(meta).find(|(name, _)| *name == b"iprp")?.1;
    Some(boxes(properties).find(|(name, _)| *name == b"ipco")?.1)
}

fn parse(bytes: &[u8]) -> Option<HeifPicture> {
    let properties = properties(bytes)?;
    let mut largest: Option<(u32, u32)> = None;
    let mut cropped = None;
    let (mut quarter_turns, mut is_mirrored, mut bits) = (0, false, 8);
    for (name, content) in boxes(properties) {
        match name {
            b"ispe" => {
                let number = |at: usize| Some(u32::from_be_bytes(content.get(at..at + 4)?.try_into().ok()?));
                let (width, height) = (number(4)?, number(8)?);
                let area = |(width, height): (u32, u32)| u64::from(width) * u64::from(height);
                if largest.is_none_or(|largest| area(largest) < area((width, height))) {
                    largest = Some((width, height));
                }
            }
            // Width and height as fractions. Encoders pad pictures to whole blocks.
            b"clap" => {
                let number = |at: usize| Some(u32::from_be_bytes(content.get(at..at + 4)?.try_into().ok()?));
                cropped = Some((number(0)?.checked_div(number(4)?)?, number(8)?.checked_div(number(12)?)?));
            }
            b"irot" => quarter_turns = u32::from(content.first()? & 3),
            b"imir" => is_mirrored = true,
            // Version and flags, the number of channels, the bits of each.
            b"pixi" => bits = bits.max(u32::from(*content.get(5)?)),
            _ => {}
        }
    }
    let (width, height) = largest.map(|size| cropped.unwrap_or(size))?;
    Some(if is_mirrored {
        let (width, height) = if quarter_turns % 2 == 1 { (height, width) } else { (width, height) };
        HeifPicture { width, height, bits, quarter_turns: 0 }
    } else {
        HeifPicture { width, height, bits, quarter_turns }
    })
}

/// Names and contents of successive boxes. Ends at damage.
fn boxes(mut bytes: &[u8]) -> impl Iterator<Item = (&[u8; 4], &[u8])> {
    std::iter::from_fn(move || {
        let (length, rest) = bytes.split_first_chunk::<4>()?;
        let (name, rest) = rest.split_first_chunk::<4>()?;
        let (head, length) = match u32::from_be_bytes(*length) {
            0 => (8, bytes.len()),
            1 => (16, usize::try_from(u64::from_be_bytes(*rest.first_chunk()?)).ok()?),
            length => (8, length as usize),
        };
        let content = bytes.get(head..length.min(bytes.len()))?;
        bytes = bytes.get(length..).unwrap_or_default();
        Some((name, content))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn bx(name: &[u8; 4], content: &[u8]) -> Vec<u8> {
        [&(content.len() as u32 + 8).to_be_bytes(), &name[..], content].concat()
    }

    fn file(properties: &[Vec<u8>]) -> Vec<u8> {
        let container = bx(b"ipco", &properties.concat());
        let meta = [&[0; 4][..], &bx(b"hdlr", &[0; 20]), &bx(b"iprp", &container)].concat();
        [bx(b"ftyp", b"heic\0\0\0\0"), bx(b"meta", &meta), bx(b"mdat", &[7; 9])].concat()
    }

    fn ispe(width: u32, height: u32) -> Vec<u8> {
        bx(b"ispe", &[&[0; 4][..], &width.to_be_bytes(), &height.to_be_bytes()].concat())
    }

    #[test]
    fn size_is_of_the_largest_picture_and_not_rotated() {
        let tiled = file(&[
            ispe(512, 512),
            ispe(4032, 3024),
            bx(b"irot", &[3]),
            bx(b"pixi", &[0, 0, 0, 0, 3, 10, 10, 10]),
            ispe(320, 240),
        ]);
        assert_eq!(parse(&tiled), Some(HeifPicture { width: 4032, height: 3024, bits: 10, quarter_turns: 3 }));
        let mirrored = file(&[ispe(40, 30), bx(b"irot", &[1]), bx(b"imir", &[0])]);
        assert_eq!(parse(&mirrored), Some(HeifPicture { width: 30, height: 40, bits: 8, quarter_turns: 0 }));
        let fractions: Vec<u8> = [40u32, 1, 58, 2, 0, 1, 0, 1].iter().flat_map(|n| n.to_be_bytes()).collect();
        let padded = file(&[ispe(64, 64), bx(b"clap", &fractions)]);
        assert_eq!(parse(&padded), Some(HeifPicture { width: 40, height: 29, bits: 8, quarter_turns: 0 }));
        assert_eq!(parse(&file(&[])), None);
    }

    proptest! {
        #[test]
        fn damaged_containers_never_panic(at in 0usize..120, value in any::<u8>(), length in 0usize..140) {
            let mut bytes = file(&[ispe(512, 512), bx(b"irot", &[1])]);
            let at = at % bytes.len();
            bytes[at] = value;
            bytes.truncate(length);
            let _ = parse(&bytes);
        }
    }
}
