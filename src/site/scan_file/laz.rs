//! LAZ: points of LAS compressed by LASzip (Isenburg, *LASzip: lossless compression of LiDAR data*,
//! 2013).
//!
//! The decoder allocates by lengths that the file states. They are checked here before it starts.

use laz::las::selective::DecompressionSelection;
use laz::{LasZipDecompressor, LazItemType, LazVlr};

use super::ScanError;
use super::input::{REMEDY, ScanReader};
use super::las_header::{LasHeader, LasRecord};

const LASZIP_USER: &[u8] = LazVlr::USER_ID.as_bytes();
/// Compressor with layered chunks. The layers of a chunk are stored consecutively.
const LAYERED_COMPRESSOR: u16 = 3;
/// Chunks have a table for these compressors, and none for the first.
const POINTWISE_COMPRESSOR: u16 = 1;
/// Before the first chunk stands the position of the chunk table.
const TABLE_OFFSET_BYTES: u64 = 8;
/// The position of the table of a file that was written as a stream: it is at the file's end.
const AT_END: i64 = -1;
const BLOCK_POINTS: u64 = 4096;

/// Decompresses the points and hands them over in blocks of whole records.
pub(super) fn read_points(
    mut input: ScanReader<'_>,
    header: &LasHeader,
    records: &[LasRecord],
    mut add: impl FnMut(&[u8]),
) -> Result<(), ScanError> {
    let file = input.file;
    let damaged = |problem: String| ScanError::content(file, "compressed points", format!("{problem}; {REMEDY}"));
    let is_laszip = |record: &&LasRecord| record.user == LASZIP_USER && record.number == LazVlr::RECORD_ID;
    let Some(LasRecord { data, .. }) = records.iter().find(is_laszip) else {
        let problem = "it is compressed (LAZ), but the record of LASzip is missing; decompress it with `laszip`, or \
                       export it as LAS";
        return Err(ScanError::content(file, "header", problem));
    };
    let settings = LazVlr::from_buffer(data).map_err(|error| damaged(error.to_string()))?;
    let point_bytes = u64::from(header.point_bytes);
    if settings.items_size() != point_bytes {
        let actual = settings.items_size();
        return Err(damaged(format!("a compressed point has {actual} bytes, and {point_bytes} by the header")));
    }
    let compressor = data.first_chunk().map(|bytes| u16::from_le_bytes(*bytes)).unwrap_or_default();
    if compressor != POINTWISE_COMPRESSOR {
        check_chunk_table(&mut input, header)?;
    }
    if compressor == LAYERED_COMPRESSOR {
        check_layers(&mut input, header, layer_count(&settings))?;
    }
    input.seek(header.points_at)?;
    let fields = DecompressionSelection::base().decompress_z().decompress_flags();
    let decoder = LasZipDecompressor::selective(input.into_reader(), settings, fields);
    let mut decoder = decoder.map_err(|error| damaged(error.to_string()))?;
    let mut block = Vec::new();
    let mut done = 0;
    while done < header.points {
        let here = (header.points - done).min(BLOCK_POINTS);
        block.resize((here * point_bytes) as usize, 0);
        decoder.decompress_many(&mut block).map_err(|error| {
            let points = header.points;
            damaged(format!(
                "after {done} of {points} points, decompression failed ({error}): the file is cut off or damaged"
            ))
        })?;
        add(&block);
        done += here;
    }
    Ok(())
}

/// Checks the number of chunks, each of which holds at least its first point.
fn check_chunk_table(input: &mut ScanReader<'_>, header: &LasHeader) -> Result<(), ScanError> {
    input.seek(header.points_at)?;
    let mut table_at = i64::from_le_bytes(input.array("the position of the chunk table")?);
    if table_at == AT_END {
        input.seek(input.length() - TABLE_OFFSET_BYTES)?;
        table_at = i64::from_le_bytes(input.array("the position of the chunk table")?);
    }
    let table_at = u64::try_from(table_at).ok().filter(|at| (header.points_at..input.length()).contains(at));
    let Some(table_at) = table_at else {
        return Err(input.byte_error("the chunk table lies outside the file: it is cut off".to_owned()));
    };
    input.seek(table_at)?;
    input.array::<4>("the version of the chunk table")?;
    let chunks = u64::from(u32::from_le_bytes(input.array("the number of chunks")?));
    let max_chunks = (table_at - header.points_at) / u64::from(header.point_bytes);
    if chunks <= max_chunks {
        return Ok(());
    }
    Err(input.byte_error(format!("the number of chunks is {chunks}, and at most {max_chunks} fit into the file")))
}

/// Layers of a chunk.
fn layer_count(settings: &LazVlr) -> u64 {
    let layers = |item: LazItemType| match item {
        // XY and returns, Z, class, flags, intensity, angle, user, source, time.
        LazItemType::Point14 => 9,
        LazItemType::RGBNIR14 => 2,
        LazItemType::Byte14(bytes) => u64::from(bytes),
        _ => 1,
    };
    settings.items().iter().map(|item| layers(item.item_type())).sum()
}

/// Checks that the layers of all chunks lie in the file. A chunk is its first point, the number of
/// its points, the lengths of its layers, and the layers.
fn check_layers(input: &mut ScanReader<'_>, header: &LasHeader, layers: u64) -> Result<(), ScanError> {
    let mut chunk_at = header.points_at + TABLE_OFFSET_BYTES;
    let mut points = 0;
    while points < header.points {
        input.seek(chunk_at + u64::from(header.point_bytes))?;
        let here = u64::from(u32::from_le_bytes(input.array("the number of a chunk's points")?));
        let mut bytes = 0;
        for _ in 0..layers {
            bytes += u64::from(u32::from_le_bytes(input.array("the length of a layer")?));
        }
        if here == 0 || bytes > input.left() {
            let left = input.left();
            let problem = format!(
                "a chunk of {here} points has layers of {bytes} bytes, {left} are left: it is cut off or damaged"
            );
            return Err(input.byte_error(problem));
        }
        chunk_at = input.at() + bytes;
        points += here;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::test_data::las_file as written;
    use super::super::test_data::{read_bytes, refusal};
    use laz::laszip::LazVlrBuilder;
    use laz::{LasZipCompressor, LazItemRecordBuilder};
    use std::io::Cursor;

    const POINTS: i32 = 300;

    fn points() -> Vec<[i32; 3]> {
        (0..POINTS).map(|n| [10 * n, n * n, -n]).collect()
    }

    /// The points of an uncompressed file, compressed. Format 6 has layers.
    fn compressed(format: u8) -> Vec<u8> {
        let point_bytes = if format == 6 { 30 } else { 28 };
        let items = LazItemRecordBuilder::default_for_point_format_id(format, 0).unwrap();
        let settings = LazVlrBuilder::new(items).with_fixed_chunk_size(100).build();
        let mut data = Vec::new();
        settings.write_to(&mut data).unwrap();
        let mut file = written(&[("laszip encoded", 22204, &data)], &[]);
        file[104] = 0x80 | format;
        file[105] = point_bytes;
        file[107..111].copy_from_slice(&POINTS.to_le_bytes());
        let mut cursor = Cursor::new(file);
        cursor.set_position(cursor.get_ref().len() as u64);
        let mut compressor = LasZipCompressor::new(&mut cursor, settings).unwrap();
        for point in points() {
            let mut record = vec![0; point_bytes.into()];
            for (bytes, value) in record.chunks_exact_mut(4).zip(point) {
                bytes.copy_from_slice(&i32::to_le_bytes(value));
            }
            compressor.compress_one(&record).unwrap();
        }
        compressor.done().unwrap();
        drop(compressor);
        cursor.into_inner()
    }

    #[test]
    fn compressed_points_equal_the_uncompressed_ones() {
        let expected = read_bytes("a.las", &written(&[], &points())).unwrap();
        for format in [1, 6] {
            assert_eq!(read_bytes("a.laz", &compressed(format)).unwrap(), expected, "format {format}");
        }
    }

    #[test]
    fn cut_and_damaged_files_are_refused() {
        for format in [1, 6] {
            let whole = compressed(format);
            for length in (4..whole.len() - 20).step_by(7) {
                assert!(read_bytes("a.laz", &whole[..length]).is_err(), "format {format}, {length}");
            }
            let mut many = whole.clone();
            let points_at = u32::from_le_bytes([0, 1, 2, 3].map(|n| many[96 + n])) as usize;
            let table_at = u64::from_le_bytes([0, 1, 2, 3, 4, 5, 6, 7].map(|n| many[points_at + n])) as usize;
            many[table_at + 7] = 0xff;
            assert!(refusal("a.laz", &many).contains("the number of chunks is"));
            let mut long = whole;
            long[109] = 0xff;
            let error = refusal("a.laz", &long);
            assert!(error.contains("cut off or damaged") || error.contains("the file is cut off"), "{error}");
        }
        let mut wide = compressed(6);
        let layers_at = u32::from_le_bytes([0, 1, 2, 3].map(|n| wide[96 + n])) as usize + 8 + 30 + 4;
        wide[layers_at + 7] = 0xff;
        let error = refusal("a.laz", &wide);
        assert!(error.contains("a chunk of 100 points has layers of 42781"), "{error}");
    }
}
