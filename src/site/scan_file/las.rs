//! LAS and LAZ: points of airborne and mobile scanners (ASPRS, *LAS Specification 1.4 - R15*).
//! Numbers are little-endian. A coordinate is a whole number times a scale plus an offset.
//!
//! Points marked as withheld, that is as deleted, are left out. +Z is up. Not read: colours,
//! classes, wave packets, and the coordinate system beyond [`super::las_units`].

use glam::DVec3;

use super::geometry_builder::GeometryBuilder;
use super::input::ScanReader;
use super::las_header::LasHeader;
use super::las_units::unit_warnings;
use super::{ScanError, ScanGeometry, laz};
use crate::text::count;

/// From this point format on, records have their fields in another order.
const FIRST_EXTENDED_FORMAT: u8 = 6;
/// Points per block of reading.
const BLOCK_POINTS: u64 = 8192;

pub(super) fn read(mut input: ScanReader<'_>) -> Result<ScanGeometry, ScanError> {
    let header = LasHeader::read(&mut input)?;
    let records = header.read_records(&mut input)?;
    let file = input.file;
    let mut points = LasPoints { header: &header, builder: GeometryBuilder::default(), withheld: 0 };
    points.builder.warnings = unit_warnings(&records);
    let max_points = if header.is_compressed {
        // Each point takes a bit at least; more is reserved as it comes.
        (input.length() - header.points_at).saturating_mul(8)
    } else {
        input.seek(header.points_at)?;
        input.check_count(header.points, u64::from(header.point_bytes), "points")?;
        header.points
    };
    points.builder.reserve(header.points, max_points);
    if header.is_compressed {
        laz::read_points(input, &header, &records, |block| points.add(block))?;
    } else {
        let mut block = Vec::new();
        let mut left = header.points;
        while left > 0 {
            let here = left.min(BLOCK_POINTS);
            block.resize((here * u64::from(header.point_bytes)) as usize, 0);
            input.fill(&mut block, "a block of points")?;
            points.add(&block);
            left -= here;
        }
    }
    let LasPoints { mut builder, withheld, .. } = points;
    if withheld > 0 {
        let points = count(withheld as usize, "point");
        builder.warnings.push(format!("left out {points} marked as withheld (deleted)"));
    }
    let geometry = builder.finish(file)?;
    Ok(ScanGeometry { metres_per_unit: Some(1.0), up: Some(DVec3::Z), ..geometry })
}

/// Takes uncompressed point records.
struct LasPoints<'a> {
    header: &'a LasHeader,
    builder: GeometryBuilder,
    withheld: u64,
}

impl LasPoints<'_> {
    fn add(&mut self, block: &[u8]) {
        let LasHeader { format, point_bytes, scale, offset, .. } = *self.header;
        // Both bits are in byte 15: of the class, or of the flags.
        let withheld_bit = if format < FIRST_EXTENDED_FORMAT { 0x80 } else { 0x04 };
        for point in block.chunks_exact(usize::from(point_bytes)) {
            if point[15] & withheld_bit != 0 {
                self.withheld += 1;
                continue;
            }
            let coordinate = |at: usize| f64::from(i32::from_le_bytes([0, 1, 2, 3].map(|n| point[at + n])));
            self.builder.push(DVec3::new(coordinate(0), coordinate(4), coordinate(8)) * scale + offset);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_data::{las_file as written, read_bytes, refusal};
    use glam::Vec3;

    use super::*;

    #[test]
    fn scale_and_offset_are_applied_before_the_origin_is_subtracted() {
        let read = read_bytes("a.las", &written(&[], &[[0, 0, 0], [1, -1, 100], [2500, 0, 0]])).unwrap();
        assert_eq!(read.origin, DVec3::new(500_000.0, 4_000_000.0, -10.0));
        let expected = [Vec3::ZERO, Vec3::new(0.001, -0.001, 1.0), Vec3::new(2.5, 0.0, 0.0)];
        for (expected, read) in expected.iter().zip(&read.positions) {
            assert!(expected.distance(*read) < 1e-8, "{read}");
        }
        assert_eq!((read.metres_per_unit, read.up), (Some(1.0), Some(DVec3::Z)));
        assert!(read.warnings.is_empty(), "{:?}", read.warnings);
    }

    #[test]
    fn withheld_points_are_left_out() {
        let mut file = written(&[], &[[0, 0, 0], [1, 1, 1]]);
        let last_class = file.len() - 28 + 15;
        file[last_class] = 0x82;
        let read = read_bytes("a.las", &file).unwrap();
        assert_eq!(read.positions.len(), 1);
        assert_eq!(read.warnings, ["left out 1 point marked as withheld (deleted)"]);
    }

    #[test]
    fn damaged_headers_and_cut_files_are_refused() {
        let whole = written(&[("LASF_Projection", 2112, b"PROJCS[]")], &[[0, 0, 0], [1, 1, 1]]);
        for length in 4..whole.len() {
            assert!(read_bytes("a.las", &whole[..length]).is_err(), "{length}");
        }
        let error = refusal("a.las", &whole[..whole.len() - 1]);
        assert!(error.contains("the number of points is 2, and the 55 bytes left hold at most 1"), "{error}");
        for (at, byte, said) in [
            (24, 2, "byte 24: the version is 2.2; expected 1.0 to 1.4"),
            (95, 9, "byte 94: the points start at byte 289 behind a header of 2531 bytes"),
            (104, 11, "byte 104: the point format is 11; expected 0 to 10"),
            (105, 27, "byte 105: a point has 27 bytes; format 1 needs at least 28"),
            (138, 0xff, "byte 131: the scale is"),
            (100, 2, "byte 289: the number of records is 2, which do not fit"),
            (104, 0x81, "header: it is compressed (LAZ), but the record of LASzip is missing"),
        ] {
            let mut file = whole.clone();
            file[at] = byte;
            let error = refusal("a.las", &file);
            assert!(error.contains(said), "{error}");
        }
        assert!(refusal("a.las", &written(&[], &[])).contains("holds no points"));
    }
}
