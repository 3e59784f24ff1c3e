//! The inputs of a work, digested while it is done.

use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use super::digests::{DigestedFile, digest_of};
use super::work::InputRecord;
use crate::shot::{AnalysisState, Shot};

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
