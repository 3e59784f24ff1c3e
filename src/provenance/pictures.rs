//! Reads the pictures of an output again, and compares pictures.

use std::ffi::OsString;
use std::io::Read;
use std::path::Path;

use super::digests::bytes_digest;
use super::record::{OutputKind, OutputRecord};
use crate::pixels::{Codes, Pixels, Rect};
use crate::program::{self, ProgramError, Running};
use crate::source::{SourceError, ffmpeg, still};
use crate::text::count;

/// Why a picture of an output cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum StoredPictureError {
    #[error(transparent)]
    Source(#[from] SourceError),
    #[error(transparent)]
    Program(#[from] ProgramError),
    #[error("{}: ffmpeg gave {bytes} bytes for picture {number}; expected {expected}", path.display())]
    Size { path: std::path::PathBuf, number: usize, bytes: usize, expected: usize },
}

/// Reads picture `number` (counted from 0 in the output) of an output that stores digested codes;
/// its file name in a folder is `file`.
pub fn read_picture(
    output: &Path,
    record: &OutputRecord,
    file: Option<&str>,
    number: usize,
) -> Result<Pixels, StoredPictureError> {
    if record.kind != OutputKind::Video {
        return Ok(still::read_pixels(&record.picture_file(output, file))?);
    }
    let format = if record.bits == 16 { "rgb48le" } else { "rgb24" };
    let select = format!("select=eq(n\\,{number})");
    let options = ["-vf", &select, "-frames:v", "1", "-f", "rawvideo", "-pix_fmt", format, "-"];
    let start = ["-v", "error", "-noautorotate"].map(OsString::from).into_iter();
    let arguments: Vec<_> = start.chain(ffmpeg::input(output)).chain(options.map(OsString::from)).collect();
    let bytes = program::output("ffmpeg", &arguments)?.written;
    let length = bytes.len();
    let pixels = if record.bits == 16 {
        let codes = bytes.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])).collect();
        Pixels::from_u16(record.width, record.height, codes)
    } else {
        Pixels::from_u8(record.width, record.height, bytes)
    };
    let pixels_count = u64::from(record.width).saturating_mul(u64::from(record.height));
    let expected = pixels_count.saturating_mul(u64::from(3 * record.bits / 8)) as usize;
    pixels.ok_or_else(|| StoredPictureError::Size { path: output.to_owned(), number, bytes: length, expected })
}

/// Digests of all pictures of a lossless video, in order, with their numbers. `on_picture` ends it
/// by `false`.
pub fn video_digests(
    output: &Path,
    record: &OutputRecord,
    mut on_picture: impl FnMut(usize, String) -> bool,
) -> Result<(), StoredPictureError> {
    let format = if record.bits == 16 { "rgb48le" } else { "rgb24" };
    let options = ["-f", "rawvideo", "-pix_fmt", format, "-vsync", "passthrough", "-"].map(OsString::from);
    let start = ["-v", "error", "-noautorotate"].map(OsString::from).into_iter();
    let arguments: Vec<_> = start.chain(ffmpeg::input(output)).chain(options).collect();
    let mut running = Running::start("ffmpeg", &arguments)?;
    let Some(mut frames) = running.take_stdout() else { return Ok(()) };
    let length = 3 * record.width as usize * record.height as usize * record.bits as usize / 8;
    let mut bytes = vec![0; length];
    let mut number = 0;
    while frames.read_exact(&mut bytes).is_ok() {
        if !on_picture(number, bytes_digest(&bytes)) {
            return Ok(());
        }
        number += 1;
    }
    drop(frames);
    running.finish()?;
    Ok(())
}

/// How far two pictures differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PictureDifference {
    /// The largest difference of a code value.
    pub max_codes: u32,
    /// 99 % of the pixels with a difference differ by at most this.
    pub p99_codes: u32,
    /// Number of pixels with a difference.
    pub pixels: usize,
    /// Bounds of the pixels with a difference.
    pub bounds: Rect,
}

impl std::fmt::Display for PictureDifference {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Rect { x0, y0, x1, y1 } = self.bounds;
        write!(
            f,
            "by up to {} in {}, 99 % of them by at most {}, in columns {x0}..{x1}, rows {y0}..{y1}",
            count(self.max_codes as usize, "code"),
            count(self.pixels, "pixel"),
            count(self.p99_codes as usize, "code"),
        )
    }
}

/// Compares two pictures of one size and depth: `Ok(None)` if they are equal. `Err` with the two
/// sizes if those differ.
pub fn difference(a: &Pixels, b: &Pixels) -> Result<Option<PictureDifference>, String> {
    let shape = |pixels: &Pixels| format!("{}x{} with codes to {}", pixels.width, pixels.height, pixels.max_code());
    match (&a.codes, &b.codes) {
        _ if (a.width, a.height) != (b.width, b.height) => {}
        (Codes::U8(left), Codes::U8(right)) => return Ok(compare(left, right, a.width)),
        (Codes::U16(left), Codes::U16(right)) => return Ok(compare(left, right, a.width)),
        _ => {}
    }
    Err(format!("{} and {}", shape(a), shape(b)))
}

fn compare<T: Copy + Into<i32>>(a: &[T], b: &[T], width: u32) -> Option<PictureDifference> {
    let mut codes = Vec::new();
    let mut bounds: Option<Rect> = None;
    for (i, (a, b)) in a.chunks_exact(3).zip(b.chunks_exact(3)).enumerate() {
        let largest =
            a.iter().zip(b).map(|(a, b)| ((*a).into() - (*b).into()).unsigned_abs()).max().unwrap_or_default();
        if largest == 0 {
            continue;
        }
        codes.push(largest);
        let (x, y) = ((i % width as usize) as i32, (i / width as usize) as i32);
        let pixel = Rect::new(x, y, x + 1, y + 1);
        bounds = Some(
            bounds.map_or(pixel, |all| Rect::new(all.x0.min(x), all.y0.min(y), all.x1.max(x + 1), all.y1.max(y + 1))),
        );
    }
    codes.sort_unstable();
    let p99_codes = *codes.get((99 * codes.len()).div_ceil(100).saturating_sub(1))?;
    Some(PictureDifference { max_codes: *codes.last()?, p99_codes, pixels: codes.len(), bounds: bounds? })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn difference_has_largest_code_count_and_bounds() {
        let a = Pixels::from_u8(3, 2, (0..18).collect()).unwrap();
        assert_eq!(difference(&a, &a), Ok(None));
        let mut codes: Vec<u8> = (0..18).collect();
        codes[4] += 2; // pixel (1, 0)
        codes[17] -= 5; // pixel (2, 1)
        let b = Pixels::from_u8(3, 2, codes).unwrap();
        let expected = PictureDifference { max_codes: 5, p99_codes: 5, pixels: 2, bounds: Rect::new(1, 0, 3, 2) };
        assert_eq!(difference(&a, &b), Ok(Some(expected)));
        let text = "by up to 5 codes in 2 pixels, 99 % of them by at most 5 codes, in columns 1..3, rows 0..2";
        assert_eq!(expected.to_string(), text);
        let deep = Pixels::from_u16(3, 2, vec![0; 18]).unwrap();
        assert_eq!(difference(&a, &deep).unwrap_err(), "3x2 with codes to 255 and 3x2 with codes to 65535");
    }
}
