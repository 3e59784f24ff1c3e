//! A PNG sequence whose names sort in frame order.

use std::io::Write;
use std::path::{Path, PathBuf};

use super::atomic::write_atomically;
use super::{Sink, SinkError, SinkOptions, of_image};
use crate::cleanup::MadeFolder;
use crate::label::{Chunk, SourceLabel, with_chunks, xmp_chunk};
use crate::pixels::Pixels;
use crate::source::presentation::ColorTags;

/// The file name of a frame.
pub fn frame_name(frame_index: usize) -> String {
    format!("frame_{frame_index:06}.png")
}

/// The frame of a file name; `None` for names of other files.
pub fn frame_of_name(name: &str) -> Option<usize> {
    let number = name.strip_prefix("frame_")?.strip_suffix(".png")?;
    number.bytes().all(|byte| byte.is_ascii_digit()).then(|| number.parse().ok())?
}

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

/// Writes one frame as a PNG file, with its colour tags and its label if it has any.
pub fn write_frame(
    path: &Path,
    pixels: &Pixels,
    color_tags: Option<ColorTags>,
    label: Option<&SourceLabel>,
    force: bool,
) -> Result<(), SinkError> {
    // R'G'B' of full range.
    let colors = color_tags.map(|ColorTags { primaries, transfer }| (*b"cICP", vec![primaries, transfer, 0, 1]));
    let chunks: Vec<Chunk> = colors.into_iter().chain(label.map(|label| xmp_chunk(&label.xmp()))).collect();
    write_atomically(path, force, |writer| {
        if chunks.is_empty() {
            return pixels.write_png(writer).map_err(of_image);
        }
        let mut png = Vec::new();
        pixels.write_png(&mut png).map_err(of_image)?;
        writer.write_all(&with_chunks(&png, &chunks))
    })
}

impl Sink for FolderSink {
    fn write(&mut self, frame_index: usize, pixels: &Pixels) -> Result<(), SinkError> {
        self.options.check(frame_index, pixels)?;
        let tags = self.options.presentation.color_tags();
        let label = self.options.label.as_ref().map(|label| label.of_frame(frame_index));
        write_frame(&self.folder.join(frame_name(frame_index)), pixels, tags, label.as_ref(), self.options.force)
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
    fn tagged_and_labelled_png_reads_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hlg.png");
        let pixels = Pixels::from_u16(2, 1, vec![1, 2, 3, 65_535, 256, 7]).unwrap();
        let hlg = ColorTags { primaries: 9, transfer: 18 };
        let label = SourceLabel::composite(Path::new("night")).of_frame(3);
        write_frame(&path, &pixels, Some(hlg), Some(&label), false).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert!(bytes.windows(8).any(|window| window == b"cICP\x09\x12\0\x01"));
        assert!(bytes.windows(16).any(|window| window == b"locard:frame=\"3\""));
        // The decoder checks the checksum of each chunk.
        let decoder = image::codecs::png::PngDecoder::new(std::io::Cursor::new(&bytes)).unwrap();
        assert_eq!(
            image::DynamicImage::from_decoder(decoder).unwrap().into_rgb16().into_raw(),
            [1, 2, 3, 65_535, 256, 7]
        );
    }
}
