//! Header of a LAS file, and its variable length records (LAS 1.4 R15).

use glam::DVec3;

use super::ScanError;
use super::input::{REMEDY, ScanReader};

/// The header of LAS 1.0 to 1.2, bytes, and that of 1.4.
const MIN_HEADER_BYTES: u16 = 227;
const HEADER_BYTES_1_4: u16 = 375;
/// Header of a variable length record, bytes.
const RECORD_HEADER_BYTES: u64 = 54;
const LAST_FORMAT: u8 = 10;
/// Bytes of the records of point formats 0 to 10, without extra bytes.
const MIN_POINT_BYTES: [u16; 11] = [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67];
/// Bits that LASzip sets in the number of the point format.
const COMPRESSION_BITS: u8 = 0xc0;
pub(super) struct LasHeader {
    /// Start of the points, bytes.
    pub points_at: u64,
    /// 0 to 10, without the bits of LASzip.
    pub format: u8,
    pub is_compressed: bool,
    pub point_bytes: u16,
    pub points: u64,
    pub scale: DVec3,
    pub offset: DVec3,
    header_bytes: u16,
    records: u32,
}

/// A variable length record.
pub(super) struct LasRecord {
    pub user: Vec<u8>,
    pub number: u16,
    pub data: Vec<u8>,
}

impl LasHeader {
    pub fn read(input: &mut ScanReader<'_>) -> Result<Self, ScanError> {
        input.seek(0)?;
        let bytes: [u8; MIN_HEADER_BYTES as usize] = input.array("the header")?;
        let u16_at = |at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
        let u32_at = |at: usize| u32::from_le_bytes([0, 1, 2, 3].map(|n| bytes[at + n]));
        let f64_at = |at: usize| f64::from_le_bytes([0, 1, 2, 3, 4, 5, 6, 7].map(|n| bytes[at + n]));
        let vector_at = |at: usize| DVec3::new(f64_at(at), f64_at(at + 8), f64_at(at + 16));
        let invalid =
            |location: &str, problem: String| ScanError::content(input.file, location, format!("{problem}; {REMEDY}"));
        let version = [bytes[24], bytes[25]];
        if version[0] != 1 || version[1] > 4 {
            let problem = format!("the version is {}.{}; expected 1.0 to 1.4", version[0], version[1]);
            return Err(invalid("byte 24", problem));
        }
        let (header_bytes, points_at) = (u16_at(94), u64::from(u32_at(96)));
        if header_bytes < MIN_HEADER_BYTES || points_at < u64::from(header_bytes) || points_at > input.length() {
            let problem = format!(
                "the points start at byte {points_at} behind a header of {header_bytes} bytes, in a file of {} bytes: \
                 it is cut off or damaged",
                input.length()
            );
            return Err(invalid("byte 94", problem));
        }
        let (format, point_bytes) = (bytes[104] & !COMPRESSION_BITS, u16_at(105));
        let Some(min_bytes) = MIN_POINT_BYTES.get(usize::from(format)) else {
            return Err(invalid("byte 104", format!("the point format is {format}; expected 0 to {LAST_FORMAT}")));
        };
        if point_bytes < *min_bytes {
            let problem = format!("a point has {point_bytes} bytes; format {format} needs at least {min_bytes}");
            return Err(invalid("byte 105", problem));
        }
        let (scale, offset) = (vector_at(131), vector_at(155));
        if !scale.is_finite() || !offset.is_finite() || scale.min_element() <= 0.0 {
            let problem =
                format!("the scale is {scale} and the offset {offset}; positive and finite numbers are needed");
            return Err(invalid("byte 131", problem));
        }
        let is_compressed = bytes[104] & COMPRESSION_BITS != 0;
        let [records, legacy_points] = [u32_at(100), u32_at(107)];
        let mut points = u64::from(legacy_points);
        if version[1] == 4 && header_bytes >= HEADER_BYTES_1_4 {
            input.seek(247)?;
            let long_count = u64::from_le_bytes(input.array("the number of points")?);
            points = if long_count > 0 { long_count } else { points };
        }
        Ok(Self { points_at, format, is_compressed, point_bytes, points, scale, offset, header_bytes, records })
    }

    /// The records between header and points.
    pub fn read_records(&self, input: &mut ScanReader<'_>) -> Result<Vec<LasRecord>, ScanError> {
        input.seek(u64::from(self.header_bytes))?;
        let mut records = Vec::new();
        for _ in 0..self.records {
            if input.at() + RECORD_HEADER_BYTES > self.points_at {
                return Err(input.byte_error(format!(
                    "the number of records is {}, which do not fit before the points",
                    self.records
                )));
            }
            let header: [u8; RECORD_HEADER_BYTES as usize] = input.array("the header of a record")?;
            let user = header[2..18].iter().copied().take_while(|byte| *byte != 0).collect();
            let [number, length] = [18, 20].map(|at| u16::from_le_bytes([header[at], header[at + 1]]));
            let mut data = vec![0; usize::from(length)];
            input.fill(&mut data, "a record")?;
            records.push(LasRecord { user, number, data });
        }
        Ok(records)
    }
}
