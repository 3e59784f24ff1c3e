//! A file reader that reports its progress to another thread, which can cancel it.

use std::fs::File;
use std::io::{Error, Read, Result, Seek, SeekFrom};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Progress of reading a scan. Clones share it.
#[derive(Clone, Debug, Default)]
pub struct ReadingWatch(Arc<ReadingState>);

#[derive(Debug, Default)]
struct ReadingState {
    read_bytes: AtomicU64,
    length_bytes: AtomicU64,
    is_cancelled: AtomicBool,
}

impl ReadingWatch {
    /// Fraction of the file that was read, 0 to 1.
    pub fn progress(&self) -> f64 {
        let [read_bytes, length_bytes] =
            [&self.0.read_bytes, &self.0.length_bytes].map(|bytes| bytes.load(Ordering::Relaxed));
        (read_bytes as f64 / length_bytes.max(1) as f64).min(1.0)
    }

    /// Ends the reading with an error.
    pub fn cancel(&self) {
        self.0.is_cancelled.store(true, Ordering::Relaxed);
    }
}

/// A file that counts the bytes read from it.
#[derive(Debug)]
pub struct WatchedFile {
    file: File,
    watch: ReadingWatch,
}

impl WatchedFile {
    pub fn new(file: File, length_bytes: u64, watch: &ReadingWatch) -> Self {
        watch.0.length_bytes.store(length_bytes, Ordering::Relaxed);
        Self { file, watch: watch.clone() }
    }
}

impl Read for WatchedFile {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize> {
        let state = &self.watch.0;
        if state.is_cancelled.load(Ordering::Relaxed) {
            return Err(Error::other("the reading was cancelled"));
        }
        let count = self.file.read(buffer)?;
        state.read_bytes.fetch_add(count as u64, Ordering::Relaxed);
        Ok(count)
    }
}

impl Seek for WatchedFile {
    fn seek(&mut self, to: SeekFrom) -> Result<u64> {
        self.file.seek(to)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{read, read_watched};
    use super::*;

    #[test]
    fn watched_reading_reports_its_progress_and_can_be_cancelled() {
        let temp = tempfile::tempdir().unwrap();
        let path = temp.path().join("a.xyz");
        std::fs::write(&path, "1 2 3\n".repeat(100)).unwrap();
        let watch = ReadingWatch::default();
        assert_eq!(watch.progress(), 0.0);
        assert_eq!(read_watched(&path, &watch).unwrap(), read(&path).unwrap());
        assert_eq!(watch.progress(), 1.0);
        watch.cancel();
        let error = read_watched(&path, &watch).unwrap_err().to_string();
        assert!(error.contains("the reading was cancelled"), "{error}");
    }
}
