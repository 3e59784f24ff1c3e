//! Raw R, G, B values, frame after frame, without a header; 16-bit values are little-endian.

use std::io::{Error, Write};
use std::path::{Path, PathBuf};

use super::{Sink, SinkError, SinkOptions, little_endian};
use crate::pixels::Pixels;

/// Writes frames to a pipe or a file.
#[derive(Debug)]
pub struct RawSink<W> {
    writer: W,
    /// `None` for the standard output.
    path: Option<PathBuf>,
    options: SinkOptions,
}

impl<W: Write> RawSink<W> {
    pub fn new(writer: W, options: &SinkOptions) -> Self {
        Self { writer, path: None, options: options.clone() }
    }

    /// Sets the path for error messages.
    pub fn named(self, path: &Path) -> Self {
        Self { path: Some(path.to_owned()), ..self }
    }

    fn failed(&self, source: Error) -> SinkError {
        match self.path.clone() {
            Some(path) => SinkError::Write { path, source },
            None => SinkError::Stdout { source },
        }
    }
}

impl<W: Write> Sink for RawSink<W> {
    fn write(&mut self, frame_index: usize, pixels: &Pixels) -> Result<(), SinkError> {
        self.options.check(frame_index, pixels)?;
        self.writer.write_all(&little_endian(&pixels.codes)).map_err(|source| self.failed(source))
    }

    fn finish(mut self: Box<Self>) -> Result<(), SinkError> {
        self.writer.flush().map_err(|source| self.failed(source))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain() -> SinkOptions {
        let presentation = crate::source::presentation::Presentation::default();
        SinkOptions {
            force: false,
            fps: 30.0,
            times_s: None,
            presentation,
            lossless: false,
            codec: None,
            soundtrack: None,
            label: None,
            width: 1,
            height: 1,
            bits: 8,
        }
    }

    #[test]
    fn raw_values_are_little_endian() {
        let options = SinkOptions { width: 2, height: 1, bits: 16, ..plain() };
        let mut written = Vec::new();
        let mut sink = Box::new(RawSink::new(&mut written, &options));
        sink.write(0, &Pixels::from_u16(2, 1, vec![1, 0x0203, 0, 0, 0, 0xfffe]).unwrap()).unwrap();
        let error = sink.write(1, &Pixels::from_u8(2, 1, vec![0; 6]).unwrap()).unwrap_err().to_string();
        assert_eq!(error, "frame 1 is 2x1 with 8 bits; 2x1 with 16 bits was announced");
        sink.finish().unwrap();
        assert_eq!(written, [1, 0, 3, 2, 0, 0, 0, 0, 0, 0, 0xfe, 0xff]);
    }

    #[test]
    fn closed_pipe_is_an_error() {
        let options = plain();
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let mut sink = RawSink::new(writer, &options);
        let error = sink.write(0, &Pixels::from_u8(1, 1, vec![1, 2, 3]).unwrap()).unwrap_err().to_string();
        assert_eq!(error, "standard output: the reader has closed it");
    }
}
