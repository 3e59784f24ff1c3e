//! Display orientation of an MP4: the matrix in its track header. ffmpeg's options for it changed
//! between versions, so it is written into the finished file. Source: ISO/IEC 14496-12, 6.2.2 and
//! 8.3.2.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;

use crate::source::orientation::Orientation;

/// Writes the orientation of pictures of this size into the first track's header.
pub fn write(file: &Path, orientation: Orientation, size: (u32, u32)) -> io::Result<()> {
    let mut file = File::options().read(true).write(true).open(file)?;
    seek_matrix(&mut file)?;
    file.write_all(&matrix(orientation, size))
}

/// Copies the orientation of one file's first track into another file with pictures of the same
/// size.
pub fn copy(from: &Path, to: &Path) -> io::Result<()> {
    let mut source = File::open(from)?;
    seek_matrix(&mut source)?;
    let mut matrix = [0; MATRIX_BYTES];
    source.read_exact(&mut matrix)?;
    let mut file = File::options().read(true).write(true).open(to)?;
    seek_matrix(&mut file)?;
    file.write_all(&matrix)
}

/// Length of a display matrix: nine numbers of 32 bits.
const MATRIX_BYTES: usize = 36;

/// Moves to the display matrix of the first track.
fn seek_matrix(file: &mut File) -> io::Result<()> {
    let end = file.seek(SeekFrom::End(0))?;
    let (from, to) = find(file, b"moov", 0, end)?;
    let (from, to) = find(file, b"trak", from, to)?;
    let (from, _) = find(file, b"tkhd", from, to)?;
    file.seek(SeekFrom::Start(from))?;
    let mut version = [0];
    file.read_exact(&mut version)?;
    // Preceded by version and flags, times of 4 or 8 bytes, layer, group and volume.
    let at = from + if version[0] == 1 { 52 } else { 40 };
    file.seek(SeekFrom::Start(at)).map(drop)
}

/// Content range of a box, among the boxes from `at` to `end`.
fn find(file: &mut File, name: &[u8; 4], mut at: u64, end: u64) -> io::Result<(u64, u64)> {
    while at + 8 <= end {
        file.seek(SeekFrom::Start(at))?;
        let mut head = [0; 8];
        file.read_exact(&mut head)?;
        let [a, b, c, d, own @ ..] = head;
        let (length, content) = match u32::from_be_bytes([a, b, c, d]) {
            0 => (end - at, 8),
            1 => {
                let mut long = [0; 8];
                file.read_exact(&mut long)?;
                (u64::from_be_bytes(long), 16)
            }
            length => (length.into(), 8),
        };
        let next = at.saturating_add(length.max(content));
        if own == *name {
            return Ok((at + content, next.min(end)));
        }
        at = next;
    }
    Err(io::Error::other("ffmpeg wrote no track header to put the orientation in"))
}

/// The rows of `[x y 1] · [a b u; c d v; tx ty w]`: a, b, c, d, tx, ty as 16.16, u, v, w as 2.30
/// fixed point numbers.
fn matrix(orientation: Orientation, (width, height): (u32, u32)) -> Vec<u8> {
    let [a, b, c, d] = orientation.matrix();
    let [width, height] = [width, height].map(f64::from);
    let corners = [(0.0, 0.0), (width, 0.0), (0.0, height), (width, height)];
    // The displayed picture begins at the origin.
    let least = |of: &dyn Fn(f64, f64) -> f64| corners.iter().map(|(x, y)| of(*x, *y)).fold(f64::INFINITY, f64::min);
    let tx = -least(&|x, y| a * x + c * y);
    let ty = -least(&|x, y| b * x + d * y);
    let fixed = |value: f64| (value * 65536.0).round() as i32;
    let one = 1 << 30;
    let values = [fixed(a), fixed(b), 0, fixed(c), fixed(d), 0, fixed(tx), fixed(ty), one];
    values.into_iter().flat_map(i32::to_be_bytes).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotated_and_mirrored_pictures_have_the_standard_matrices() {
        let values_of = |orientation| -> Vec<i32> {
            let bytes = matrix(orientation, (96, 64));
            bytes.chunks_exact(4).map(|b| i32::from_be_bytes([b[0], b[1], b[2], b[3]])).collect()
        };
        let values = |rotation_deg| values_of(Orientation { is_mirrored: false, rotation_deg });
        let one = 1 << 30;
        // Clockwise: (x, y) is shown at (64 - y, x).
        assert_eq!(values(-90.0), [0, 65536, 0, -65536, 0, 0, 64 << 16, 0, one]);
        assert_eq!(values(90.0), [0, -65536, 0, 65536, 0, 0, 0, 96 << 16, one]);
        assert_eq!(values(180.0), [-65536, 0, 0, 0, -65536, 0, 96 << 16, 64 << 16, one]);
        let mirrored = |rotation_deg| values_of(Orientation { is_mirrored: true, rotation_deg });
        assert_eq!(mirrored(0.0), [-65536, 0, 0, 0, 65536, 0, 96 << 16, 0, one]);
        assert_eq!(mirrored(180.0), [65536, 0, 0, 0, -65536, 0, 0, 64 << 16, one]);
        // Transposed: (x, y) is shown at (y, x).
        assert_eq!(mirrored(90.0), [0, 65536, 0, 65536, 0, 0, 0, 0, one]);
    }
}
