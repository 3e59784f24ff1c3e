//! SHA-256 digests of files and pictures.

use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use sha2::{Digest, Sha256};

use super::InputRecord;
use crate::pixels::Pixels;
use crate::shot::{AnalysisState, Shot};
use crate::sink::little_endian;
use crate::source::file;
use crate::text::hex;

/// Length of a block that is read at once, bytes.
const BLOCK_BYTES: usize = 1 << 20;

/// Length and digest of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DigestedFile {
    pub bytes: u64,
    pub sha256: String,
}

/// Digests a file.
pub fn file_digest(path: &Path) -> io::Result<DigestedFile> {
    digest_of(path, &AtomicBool::new(false))
}

/// Digests a file, or fails with [`io::ErrorKind::Interrupted`] once `is_cancelled` is set.
fn digest_of(path: &Path, is_cancelled: &AtomicBool) -> io::Result<DigestedFile> {
    let (mut file, mut sha, mut bytes) = (file::open(path)?, Sha256::new(), 0);
    let mut block = vec![0; BLOCK_BYTES];
    while !is_cancelled.load(Ordering::Relaxed) {
        let length = match file.read(&mut block) {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            length => length?,
        };
        if length == 0 {
            return Ok(DigestedFile { bytes, sha256: hex(&sha.finalize()) });
        }
        sha.update(&block[..length]);
        bytes += length as u64;
    }
    Err(io::ErrorKind::Interrupted.into())
}

/// Digest of a picture's code values.
pub fn pixels_digest(pixels: &Pixels) -> String {
    bytes_digest(&little_endian(&pixels.codes))
}

pub fn bytes_digest(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

/// Files that a shot reads, with their roles.
pub fn input_files(shot: &Shot) -> Vec<(&'static str, PathBuf)> {
    let recording = shot.recording.files().map(|file| ("recording", file.to_owned()));
    let profiles = shot.profiles().iter().map(|file| ("profile", file.clone()));
    let scene = shot.scene.files.iter().map(|file| ("scene", file.clone()));
    let mut files: Vec<_> = recording.chain(profiles).chain(scene).collect();
    if let AnalysisState::Used(folder, _) = &shot.analysis {
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
        let mut of_analysis: Vec<PathBuf> = entries.filter(|path| path.is_file()).collect();
        of_analysis.sort();
        files.extend(of_analysis.into_iter().map(|file| ("analysis", file)));
    }
    // A profile may be one of the recording's own files.
    let mut paths = std::collections::HashSet::new();
    files.retain(|(_, path)| paths.insert(path.clone()));
    files
}

/// Digests of all inputs, or the file that could not be read.
pub type DigestedInputs = Result<Vec<InputRecord>, (PathBuf, io::Error)>;

/// Digests of input files, computed on a thread of their own while frames are composited, or at the
/// end if there is no thread. Dropping it ends the thread.
#[derive(Debug)]
pub struct InputDigests {
    is_cancelled: Arc<AtomicBool>,
    files: Arc<Vec<(&'static str, PathBuf)>>,
    thread: Option<JoinHandle<DigestedInputs>>,
}

impl InputDigests {
    /// Starts on files with their roles.
    pub fn start(files: Vec<(&'static str, PathBuf)>) -> Self {
        let (is_cancelled, files) = (Arc::new(AtomicBool::new(false)), Arc::new(files));
        let (flag, own) = (Arc::clone(&is_cancelled), Arc::clone(&files));
        let thread = std::thread::Builder::new().name("input digests".to_owned()).spawn(move || digests(&own, &flag));
        Self { is_cancelled, files, thread: thread.ok() }
    }

    /// True if [`InputDigests::finish`] returns at once.
    pub fn is_finished(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Waits for the digests. On failure, the file that could not be read.
    pub fn finish(mut self) -> DigestedInputs {
        let ended = self.thread.take().and_then(|thread| thread.join().ok());
        ended.unwrap_or_else(|| digests(&self.files, &self.is_cancelled))
    }
}

fn digests(files: &[(&'static str, PathBuf)], is_cancelled: &AtomicBool) -> DigestedInputs {
    let digest = |(role, path): &(&str, PathBuf)| match digest_of(path, is_cancelled) {
        Ok(DigestedFile { bytes, sha256 }) => {
            Ok(InputRecord { role: (*role).to_owned(), path: path.clone(), bytes, sha256 })
        }
        Err(error) => Err((path.clone(), error)),
    };
    files.iter().map(digest).collect()
}

impl Drop for InputDigests {
    fn drop(&mut self) {
        self.is_cancelled.store(true, Ordering::Relaxed);
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// FIPS 180-2, appendix B.1: the digest of "abc".
    const ABC: &str = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";

    #[test]
    fn digests_match_the_published_example() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("abc");
        std::fs::write(&path, "abc").unwrap();
        assert_eq!(file_digest(&path).unwrap(), DigestedFile { bytes: 3, sha256: ABC.to_owned() });
        assert_eq!(pixels_digest(&Pixels::from_u8(1, 1, b"abc".to_vec()).unwrap()), ABC);
        // Little-endian: 0x6261 is "ab".
        let deep = Pixels::from_u16(1, 1, vec![0x6261, 0x0063, 0]).unwrap();
        assert_eq!(pixels_digest(&deep), hex(&Sha256::digest(b"abc\0\0\0")));
    }

    #[test]
    fn missing_input_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let (there, gone) = (folder.path().join("abc"), folder.path().join("gone"));
        std::fs::write(&there, "abc").unwrap();
        let digests = InputDigests::start(vec![("scene", there.clone())]).finish().unwrap();
        let expected = InputRecord { role: "scene".to_owned(), path: there, bytes: 3, sha256: ABC.to_owned() };
        assert_eq!(digests, [expected]);
        let (path, _) = InputDigests::start(vec![("scene", gone.clone())]).finish().unwrap_err();
        assert_eq!(path, gone);
    }
}
