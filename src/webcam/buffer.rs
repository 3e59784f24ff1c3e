//! The rows in a buffer whose driver states neither their stride nor the length of a JPEG file.

use super::picture::{Layout, PictureFormat};
use crate::source::jpeg_end;

/// Some drivers round buffers up to whole memory pages, bytes.
const PAGE: usize = 4096;
/// Longest padding of a row, bytes: rows begin at multiples of it at most.
const MAX_ROW_PADDING: usize = 256;

/// Cuts a buffer to its picture and finds the stride.
///
/// Rows without padding are tried first, then rows that divide the buffer evenly, then padding
/// behind the last row. For any other length the stride is 0, and
/// [`Picture::pixels`](super::Picture::pixels) reports the buffer as damaged. So it does with a
/// JPEG file that has no end, which is left as it is.
pub fn fit(picture_format: PictureFormat, mut bytes: Vec<u8>) -> (PictureFormat, Vec<u8>) {
    if picture_format.layout == Layout::Mjpeg {
        let length = jpeg_end::length(&bytes).unwrap_or(bytes.len());
        bytes.truncate(length);
        return (picture_format, bytes);
    }
    let Some(stride) = stride(&picture_format, bytes.len()) else {
        return (PictureFormat { stride: 0, ..picture_format }, bytes);
    };
    bytes.truncate(stride * rows(&picture_format));
    (PictureFormat { stride, ..picture_format }, bytes)
}

/// Rows of all planes.
fn rows(picture_format: &PictureFormat) -> usize {
    let height = picture_format.height as usize;
    if picture_format.layout == Layout::Nv12 { height + height.div_ceil(2) } else { height }
}

fn stride(picture_format: &PictureFormat, length: usize) -> Option<usize> {
    let (rows, row) = (rows(picture_format), picture_format.layout.row_bytes(picture_format.width));
    let whole = rows * row;
    if length == whole {
        return Some(row);
    }
    let is_stride = |stride: usize| {
        // YUYV and the second plane of NV12 hold pairs of bytes.
        let is_aligned = !matches!(picture_format.layout, Layout::Yuyv | Layout::Nv12) || stride.is_multiple_of(2);
        is_aligned && (row..=row + MAX_ROW_PADDING).contains(&stride)
    };
    if rows > 0 && length.is_multiple_of(rows) && is_stride(length / rows) {
        return Some(length / rows);
    }
    (length == whole.next_multiple_of(PAGE)).then_some(row)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coding::{ColorMatrix, ColorRange};
    use crate::webcam::Picture;

    fn fitted(layout: Layout, (width, height): (u32, u32), length: usize) -> (usize, usize) {
        let (range, matrix) = (ColorRange::Limited, ColorMatrix::Bt601);
        let picture_format = PictureFormat { layout, width, height, stride: 0, range, matrix };
        let (picture_format, bytes) = fit(picture_format, vec![128; length]);
        let is_whole = picture_format.stride > 0;
        let picture = Picture { picture_format, bytes, time_s: 0.0, exposure_s: None };
        assert_eq!(picture.pixels().is_ok(), is_whole, "{layout} {width}x{height} of {length} bytes");
        (picture_format.stride, picture.bytes.len())
    }

    #[test]
    fn stride_follows_from_length_and_height() {
        let vga = (640, 480);
        assert_eq!(fitted(Layout::Yuyv, vga, 614_400), (1280, 614_400));
        assert_eq!(fitted(Layout::Yuyv, vga, 480 * 1344), (1344, 480 * 1344));
        assert_eq!(fitted(Layout::Nv12, vga, 720 * 640), (640, 720 * 640));
        assert_eq!(fitted(Layout::Nv12, vga, 720 * 704), (704, 720 * 704));
        assert_eq!(fitted(Layout::Rgb, (2, 2), 14), (7, 14));
        assert_eq!(fitted(Layout::Grey, (5, 3), 24), (8, 24));
        // 153,600 bytes in 38 pages.
        assert_eq!(fitted(Layout::Yuyv, (320, 240), 38 * 4096), (640, 153_600));
    }

    #[test]
    fn buffers_of_any_other_length_are_damaged() {
        let vga = (640, 480);
        for length in [0, 1, 614_399, 614_401, 480 * 1281, 480 * 2560, 614_400 + 4096] {
            assert_eq!(fitted(Layout::Yuyv, vga, length), (0, length));
        }
        for length in [640 * 480, 720 * 641] {
            assert_eq!(fitted(Layout::Nv12, vga, length), (0, length));
        }
    }
}
