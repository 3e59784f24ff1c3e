//! A PNG sequence whose names sort in frame order.

use std::path::{Path, PathBuf};

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

use super::atomic::write_atomically;
use super::{Sink, SinkError, SinkOptions, of_image};
use crate::cleanup::MadeFolder;
use crate::pixels::{Codes, Pixels};

/// The file name of a frame.
pub fn frame_name(frame_index: usize) -> String {
    format!("frame_{frame_index:06}.png")
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

/// Writes one frame as a PNG file.
pub fn write_frame(path: &Path, pixels: &Pixels, force: bool) -> Result<(), SinkError> {
    let (bytes, color): (&[u8], _) = match &pixels.codes {
        Codes::U8(codes) => (codes, ExtendedColorType::Rgb8),
        Codes::U16(codes) => (bytemuck::cast_slice(codes), ExtendedColorType::Rgb16),
    };
    write_atomically(path, force, |writer| {
        PngEncoder::new_with_quality(writer, CompressionType::Fast, FilterType::Adaptive)
            .write_image(bytes, pixels.width, pixels.height, color)
            .map_err(of_image)
    })
}

impl Sink for FolderSink {
    fn write(&mut self, frame_index: usize, pixels: &Pixels) -> Result<(), SinkError> {
        self.options.check(frame_index, pixels)?;
        write_frame(&self.folder.join(frame_name(frame_index)), pixels, self.options.force)
    }

    fn finish(self: Box<Self>) -> Result<(), SinkError> {
        self.made.keep();
        Ok(())
    }
}
