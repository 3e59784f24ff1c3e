//! Segments of a JPEG's header that describe its planes, and the coding that follows from them.
//! Sources: ITU-T T.81, annex B.2; Adobe's APP14 segment: ITU-T T.872, section 6.5.3.

use super::jpeg_marker::{is_frame, next_marker, unsupported};
use crate::coding::dct::{BLOCK_LEN, ZIGZAG};
use crate::coding::{BlockQuantization, ChromaSampling, ColorMatrix, Decoder, PictureCoding, YcbcrColor};

/// Quantisation steps by destination, row-major.
pub(super) type QuantizationTables = [Option<[u16; BLOCK_LEN]>; 4];

/// A frame header (SOF).
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct FrameHeader {
    /// Bits of a sample.
    pub bits: u8,
    /// Pixels, across and down.
    pub size: [usize; 2],
    pub planes: Vec<PlaneHeader>,
}

/// A plane of a frame header (T.81, B.2.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PlaneHeader {
    pub id: u8,
    /// Blocks per unit, across and down.
    pub sampling: [usize; 2],
    /// Destination of its quantisation table.
    pub quantization: u8,
}

impl FrameHeader {
    /// T.81, B.2.2. `None` if the segment is too short.
    pub fn parse(segment: &[u8]) -> Option<Self> {
        let (&[bits, h0, h1, w0, w1, count], rest) = segment.split_first_chunk()?;
        let parts = rest.get(..3 * usize::from(count))?.as_chunks().0;
        let plane = |&[id, sampling, quantization]: &[u8; 3]| PlaneHeader {
            id,
            sampling: [usize::from(sampling >> 4), usize::from(sampling & 15)],
            quantization,
        };
        let size = [[w0, w1], [h0, h1]].map(|side| usize::from(u16::from_be_bytes(side)));
        Some(Self { bits, size, planes: parts.iter().map(plane).collect() })
    }
}

/// T.81, B.2.4.1: precision and destination, then 64 values of one or two bytes. `None` if the
/// segment is damaged.
pub(super) fn parse_quantization(mut segment: &[u8], tables: &mut QuantizationTables) -> Option<()> {
    while let Some((&kind, rest)) = segment.split_first() {
        let is_wide = kind >> 4 > 0;
        let (values, behind) = rest.split_at_checked(if is_wide { 2 * BLOCK_LEN } else { BLOCK_LEN })?;
        let mut steps = [0; BLOCK_LEN];
        for (k, &at) in ZIGZAG.iter().enumerate() {
            steps[at] = if is_wide { u16::from_be_bytes([values[2 * k], values[2 * k + 1]]) } else { values[k].into() };
        }
        *tables.get_mut(usize::from(kind & 15))? = Some(steps);
        segment = behind;
    }
    Some(())
}

/// Coding of a picture whose JPEG file the `image` crate decodes. The error is why it cannot be
/// represented.
pub fn coding(bytes: &[u8]) -> Result<PictureCoding, String> {
    let truncated = || "its JPEG header is truncated or damaged".to_owned();
    let mut tables: QuantizationTables = [None; 4];
    let (mut frame, mut adobe_transform) = (None, None);
    let mut at = 0;
    loop {
        let marker = next_marker(bytes, &mut at).ok_or_else(truncated)?;
        if matches!(marker, 0x01 | 0xd0..=0xd8) {
            continue;
        }
        let length = bytes.get(at..at + 2).map_or(0, |l| usize::from(u16::from_be_bytes([l[0], l[1]])));
        let segment = bytes.get(at + 2..at + length).ok_or_else(truncated)?;
        at += length;
        match marker {
            _ if is_frame(marker) => {
                let parsed = FrameHeader::parse(segment).ok_or_else(truncated)?;
                if let Some(problem) = unsupported(marker, parsed.bits) {
                    return Err(problem);
                }
                frame = Some(parsed);
            }
            0xdb => parse_quantization(segment, &mut tables).ok_or_else(truncated)?,
            0xee => adobe_transform = segment.strip_prefix(b"Adobe").and_then(|rest| rest.get(6).copied()),
            0xda => break,
            0xd9 => return Err(truncated()),
            _ => {}
        }
    }
    of_header(&frame.ok_or_else(truncated)?, &tables, adobe_transform)
}

fn of_header(
    frame: &FrameHeader,
    tables: &QuantizationTables,
    adobe_transform: Option<u8>,
) -> Result<PictureCoding, String> {
    let steps = |plane: &PlaneHeader| {
        let table = tables.get(usize::from(plane.quantization)).copied().flatten();
        let steps = table.ok_or("has planes without a quantisation table")?;
        if steps.contains(&0) { Err("has a quantisation step of 0".to_owned()) } else { Ok(steps) }
    };
    let (chroma, color, steps) = match frame.planes.as_slice() {
        [luma] => (None, YcbcrColor::JFIF, [steps(luma)?; 3]),
        planes @ [luma, cb, cr] => {
            let is_rgb = adobe_transform == Some(0) || planes.iter().map(|plane| plane.id).eq(*b"RGB");
            let factor = factor(luma, cb, cr)?;
            if is_rgb && factor != [1, 1] {
                return Err("stores R'G'B' planes of different resolution".to_owned());
            }
            let matrix = if is_rgb { ColorMatrix::Rgb } else { ColorMatrix::Bt601 };
            let color = YcbcrColor { matrix, ..YcbcrColor::JFIF };
            (Some(ChromaSampling::centered(factor)), color, [steps(luma)?, steps(cb)?, steps(cr)?])
        }
        planes => return Err(format!("has {} planes; 1 (grey) or 3 are supported", planes.len())),
    };
    Ok(PictureCoding {
        color,
        chroma,
        quantization: Some(BlockQuantization { steps, origin: [0, 0] }),
        decoder: Decoder::ZuneJpeg,
    })
}

/// Luma samples for each chroma sample.
fn factor(luma: &PlaneHeader, cb: &PlaneHeader, cr: &PlaneHeader) -> Result<[u32; 2], String> {
    let shown = |plane: &PlaneHeader| format!("{}×{}", plane.sampling[0], plane.sampling[1]);
    let refused = || {
        let [y, b, r] = [luma, cb, cr].map(shown);
        format!("has sampling factors {y}, {b}, {r}; supported are equal ones, or luma of 1 or 2 and chroma of 1")
    };
    if cb.sampling != cr.sampling {
        return Err(refused());
    }
    if luma.sampling == cb.sampling && !luma.sampling.contains(&0) {
        return Ok([1, 1]);
    }
    match (luma.sampling, cb.sampling) {
        ([across @ 1..=2, down @ 1..=2], [1, 1]) => Ok([across as u32, down as u32]),
        _ => Err(refused()),
    }
}

#[cfg(test)]
mod tests {
    use image::ExtendedColorType;
    use image::codecs::jpeg::JpegEncoder;
    use proptest::prelude::*;

    use super::*;
    use crate::coding::jpeg_writer::JpegPlanes;

    fn steps(first: u16) -> [u16; BLOCK_LEN] {
        std::array::from_fn(|i| first + i as u16)
    }

    fn file(factor: [u8; 2], planes: usize, adobe: Option<u8>) -> Vec<u8> {
        let tables = [steps(1), steps(100), steps(200)];
        let blocks = vec![vec![[0; BLOCK_LEN]; 4]; planes];
        JpegPlanes { size: [16, 16], factor, steps: &tables[..planes], blocks: &blocks, adobe }.file()
    }

    #[test]
    fn coding_has_the_files_tables_and_sampling() {
        for factor in [[1, 1], [2, 1], [1, 2], [2, 2]] {
            let coding = coding(&file(factor, 3, None)).unwrap();
            assert_eq!(coding.chroma, Some(ChromaSampling::centered(factor.map(u32::from))));
            assert_eq!((coding.color, coding.decoder), (YcbcrColor::JFIF, Decoder::ZuneJpeg));
            assert_eq!(coding.quantization.unwrap().steps, [steps(1), steps(100), steps(200)]);
        }
        let grey = coding(&file([1, 1], 1, None)).unwrap();
        assert_eq!((grey.chroma, grey.quantization.unwrap().steps), (None, [steps(1); 3]));
    }

    /// T.81, table K.1, is the encoder's at quality 50: its second row begins with 12 12 14 19.
    #[test]
    fn standard_table_is_read_in_rows() {
        let mut file = Vec::new();
        JpegEncoder::new_with_quality(&mut file, 50).encode(&[9; 3], 1, 1, ExtendedColorType::Rgb8).unwrap();
        let luma = coding(&file).unwrap().quantization.unwrap().steps[0];
        assert_eq!((&luma[..4], &luma[8..12], luma[63]), (&[16, 11, 10, 16][..], &[12, 12, 14, 19][..], 99));
    }

    #[test]
    fn adobe_segment_marks_rgb() {
        let matrix = |adobe| coding(&file([1, 1], 3, adobe)).unwrap().color.matrix;
        assert_eq!((matrix(Some(0)), matrix(Some(1))), (ColorMatrix::Rgb, ColorMatrix::Bt601));
        assert!(coding(&file([2, 1], 3, Some(0))).unwrap_err().contains("different resolution"));
    }

    #[test]
    fn other_files_are_refused_with_a_reason() {
        let plain = file([2, 1], 3, None);
        let frame = plain.windows(2).position(|pair| pair == [0xff, 0xc0]).unwrap();
        let with = |offset: usize, value: u8| {
            let mut changed = plain.clone();
            changed[frame + offset] = value;
            coding(&changed).unwrap_err()
        };
        // Precision; sampling of luma and of Cb; number of planes; table of Cr; marker.
        assert!(with(4, 12).contains("more than 8 bits"));
        assert!(with(11, 0x31).contains("sampling factors 3×1, 1×1, 1×1"));
        assert!(with(14, 0x21).contains("sampling factors 2×1, 2×1, 1×1"));
        assert!(with(9, 2).contains("has 2 planes"));
        assert!(with(18, 3).contains("without a quantisation table"));
        assert!(with(1, 0xc9).contains("arithmetic"));
        assert!(coding(&file([1, 1], 3, None)[..100]).unwrap_err().contains("truncated"));
    }

    proptest! {
        #[test]
        fn arbitrary_bytes_never_panic(start in 0usize..400, bytes in prop::collection::vec(any::<u8>(), 0..40)) {
            let mut file = file([2, 2], 3, Some(1));
            let start = start.min(file.len());
            let end = (start + bytes.len()).min(file.len());
            file.splice(start..end, bytes);
            let _ = coding(&file);
        }
    }
}
