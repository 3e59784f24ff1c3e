//! Buffered reading of a file, with the position for errors and the length that caps allocations.

use std::io::{BufRead, BufReader, ErrorKind, Read, Seek, SeekFrom};
use std::path::Path;

use super::ScanError;
use super::watched_file::{ReadingWatch, WatchedFile};
use crate::source::file;

/// Next step for a file that is cut off or damaged.
pub(super) const REMEDY: &str = "copy the file again, or export it again";
/// Longest line of a text, bytes. A polygon's line has some ten bytes for each vertex.
const MAX_LINE_BYTES: u64 = 1 << 20;
const BUFFER_BYTES: usize = 1 << 16;

/// Buffered reader that counts lines and bytes.
pub(super) struct ScanReader<'a> {
    pub file: &'a Path,
    reader: BufReader<WatchedFile>,
    length: u64,
    at: u64,
    line: u64,
}

impl<'a> ScanReader<'a> {
    pub fn open(file: &'a Path, watch: &ReadingWatch) -> Result<Self, ScanError> {
        let opened = file::open(file).and_then(|opened| Ok((opened.metadata()?.len(), opened)));
        let (length, opened) = opened.map_err(|error| ScanError::read(file, error))?;
        if length == 0 {
            let problem = format!("it is empty (0 bytes); a laser scan or a mesh is needed: {REMEDY}");
            return Err(ScanError::unsupported(file, problem));
        }
        let reader = BufReader::with_capacity(BUFFER_BYTES, WatchedFile::new(opened, length, watch));
        Ok(Self { file, reader, length, at: 0, line: 0 })
    }

    /// Bytes of the file.
    pub fn length(&self) -> u64 {
        self.length
    }

    /// Bytes from the current position to the end.
    pub fn left(&self) -> u64 {
        self.length.saturating_sub(self.at)
    }

    /// The current position, bytes from the start.
    pub fn at(&self) -> u64 {
        self.at
    }

    /// The first bytes from the current position on, at most `count`. The position stays.
    pub fn peek(&mut self, count: usize) -> Result<&[u8], ScanError> {
        let start = self.reader.fill_buf().map_err(|error| ScanError::read(self.file, error))?;
        Ok(&start[..start.len().min(count)])
    }

    pub fn seek(&mut self, to: u64) -> Result<(), ScanError> {
        self.reader.seek(SeekFrom::Start(to)).map_err(|error| ScanError::read(self.file, error))?;
        self.at = to;
        Ok(())
    }

    /// The reader at the current position.
    pub fn into_reader(self) -> BufReader<WatchedFile> {
        self.reader
    }

    /// Reads exactly `N` bytes, which hold `name`.
    #[inline]
    pub fn array<const N: usize>(&mut self, name: &str) -> Result<[u8; N], ScanError> {
        if let Some(&bytes) = self.reader.buffer().first_chunk() {
            self.reader.consume(N);
            self.at += N as u64;
            return Ok(bytes);
        }
        let mut bytes = [0; N];
        self.fill(&mut bytes, name)?;
        Ok(bytes)
    }

    /// Fills `bytes`, which hold `name`.
    #[cold]
    pub fn fill(&mut self, bytes: &mut [u8], name: &str) -> Result<(), ScanError> {
        match self.reader.read_exact(bytes) {
            Ok(()) => {
                self.at += bytes.len() as u64;
                Ok(())
            }
            Err(error) if error.kind() == ErrorKind::UnexpectedEof => {
                let (needed, left) = (bytes.len(), self.left());
                Err(self.byte_error(format!("{name} needs {needed} bytes, {left} are left: the file is cut off")))
            }
            Err(error) => Err(ScanError::read(self.file, error)),
        }
    }

    /// Replaces `text` by the next line without its end. Returns `false` at the end of the file.
    pub fn next_line(&mut self, text: &mut Vec<u8>) -> Result<bool, ScanError> {
        text.clear();
        let read = self.reader.by_ref().take(MAX_LINE_BYTES).read_until(b'\n', text);
        let read = read.map_err(|error| ScanError::read(self.file, error))? as u64;
        self.at += read;
        self.line += u64::from(read > 0);
        if read == MAX_LINE_BYTES && text.last() != Some(&b'\n') {
            return Err(
                self.line_error(format!("the line is longer than {MAX_LINE_BYTES} bytes: it is not such a text"))
            );
        }
        while let Some(b'\n' | b'\r') = text.last() {
            text.pop();
        }
        Ok(read > 0)
    }

    /// Checks that `count` records of at least `min_bytes` each fit into the rest of the file.
    pub fn check_count(&self, count: u64, min_bytes: u64, records: &str) -> Result<(), ScanError> {
        let max_count = self.left() / min_bytes.max(1);
        if count <= max_count {
            return Ok(());
        }
        let left = self.left();
        let problem = format!(
            "the number of {records} is {count}, and the {left} bytes left hold at most {max_count}: the file is cut off"
        );
        Err(self.byte_error(problem))
    }

    /// An error at the current byte.
    pub fn byte_error(&self, problem: String) -> ScanError {
        ScanError::content(self.file, format_args!("byte {}", self.at), format_args!("{problem}; {REMEDY}"))
    }

    /// An error in the line read last.
    pub fn line_error(&self, problem: String) -> ScanError {
        ScanError::content(self.file, format_args!("line {}", self.line), format_args!("{problem}; {REMEDY}"))
    }
}

/// A decimal number of a text. Accepts `nan` and `inf`, which programs write for invalid points.
pub(super) fn number(word: &[u8]) -> Option<f64> {
    str::from_utf8(word).ok()?.parse().ok()
}

/// The words of a line, separated by white space.
pub(super) fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty())
}
