//! A PNG sequence whose names sort in frame order.

use std::io::Write;
use std::path::{Path, PathBuf};

use super::atomic::write_atomically;
use super::{Sink, SinkError, SinkOptions, of_image};
use crate::cleanup::MadeFolder;
use crate::pixels::Pixels;
use crate::source::presentation::ColorTags;

/// The file name of a frame.
pub fn frame_name(frame_index: usize) -> String {
    format!("frame_{frame_index:06}.png")
}

/// Length of a PNG's signature and first chunk.
const IHDR_END_BYTES: usize = 8 + 25;

/// Writes `frame_000012.png` and so on, each either complete or absent. With `force` a frame
/// replaces only the file of its own name, so ranges rendered separately can share a folder.
#[derive(Debug)]
pub struct FolderSink {
    folder: PathBuf,
    made: MadeFolder,
    options: SinkOptions,
}

impl FolderSink {
    pub fn open(folder: &Path, options: &SinkOptions) -> Result<Self, SinkError> {
        let failed = |source| SinkError::Write { path: folder.to_owned(), source };
        Ok(Self {
            folder: folder.to_owned(),
            made: MadeFolder::make(folder).map_err(failed)?,
            options: options.clone(),
        })
    }
}

/// Writes one frame as a PNG file, with the chunk of its colour tags if it has any.
pub fn write_frame(path: &Path, pixels: &Pixels, color_tags: Option<ColorTags>, force: bool) -> Result<(), SinkError> {
    write_atomically(path, force, |writer| {
        let Some(ColorTags { primaries, transfer }) = color_tags else {
            return pixels.write_png(writer).map_err(of_image);
        };
        let mut png = Vec::new();
        pixels.write_png(&mut png).map_err(of_image)?;
        // R'G'B' of full range. Source: PNG specification (third edition), 11.3.2.6.
        let chunk = [b"cICP", &[primaries, transfer, 0, 1][..]].concat();
        let length = (chunk.len() as u32 - 4).to_be_bytes();
        let (header, rest) = png.split_at(IHDR_END_BYTES);
        for part in [header, &length, &chunk, &crc32fast::hash(&chunk).to_be_bytes(), rest] {
            writer.write_all(part)?;
        }
        Ok(())
    })
}

impl Sink for FolderSink {
    fn write(&mut self, frame_index: usize, pixels: &Pixels) -> Result<(), SinkError> {
        self.options.check(frame_index, pixels)?;
        let tags = self.options.presentation.color_tags();
        write_frame(&self.folder.join(frame_name(frame_index)), pixels, tags, self.options.force)
    }

    fn finish(self: Box<Self>) -> Result<(), SinkError> {
        self.made.keep();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tagged_png_has_its_chunk_before_the_pixels_and_reads_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hlg.png");
        let pixels = Pixels::from_u16(2, 1, vec![1, 2, 3, 65_535, 256, 7]).unwrap();
        let hlg = ColorTags { primaries: 9, transfer: 18 };
        write_frame(&path, &pixels, Some(hlg), false).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(&bytes[IHDR_END_BYTES..][..12], b"\0\0\0\x04cICP\x09\x12\0\x01");
        // The decoder checks the checksum of each chunk.
        let decoder = image::codecs::png::PngDecoder::new(std::io::Cursor::new(&bytes)).unwrap();
        assert_eq!(
            image::DynamicImage::from_decoder(decoder).unwrap().into_rgb16().into_raw(),
            [1, 2, 3, 65_535, 256, 7]
        );
    }
}
