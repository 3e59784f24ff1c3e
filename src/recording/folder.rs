//! Storage of a recording in progress: pictures and lists in a folder, each synced to disk before
//! others refer to it.

use std::fs::{File, OpenOptions};
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

pub const PICTURES: &str = "frames";

/// The lists of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum List {
    Poses,
    Exposure,
    /// Written once the covariance of a pose is known.
    Covariance,
    /// Written if a tracking system reports the lens.
    Cameras,
    Frames,
}

impl List {
    /// All lists in writing order: a listed frame has all its data.
    pub const ALL: [Self; 5] = [Self::Poses, Self::Exposure, Self::Covariance, Self::Cameras, Self::Frames];

    pub fn file_name(self) -> &'static str {
        match self {
            Self::Frames => "frames.txt",
            Self::Poses => "poses.txt",
            Self::Exposure => "exposure.txt",
            Self::Covariance => "covariance.txt",
            Self::Cameras => "cameras.txt",
        }
    }
}

/// Destination of a recording: a folder, or in tests a full disk.
pub trait Store {
    /// Writes a new file. A partial file is removed on failure.
    fn file(&mut self, name: &Path, bytes: &[u8]) -> io::Result<()>;
    /// Removes a written file.
    fn remove(&mut self, name: &Path) -> io::Result<()>;
    /// Appends whole lines to each of [`List::ALL`], and returns once they are on disk. Lists are
    /// created with their first lines. On failure, none of the lines is kept.
    fn append(&mut self, lines: [&str; 5]) -> io::Result<()>;
    /// Returns once all files are on disk.
    fn sync(&mut self) -> io::Result<()>;
}

/// A folder on a disk.
#[derive(Debug)]
pub struct Folder {
    path: PathBuf,
    /// Files in the order of [`List::ALL`], with their lengths.
    lists: [(Option<File>, u64); 5],
    unsynced: Vec<File>,
}

impl Folder {
    /// Storage in an existing folder.
    pub fn new(path: &Path) -> io::Result<Self> {
        Ok(Self { path: path.to_owned(), lists: Default::default(), unsynced: Vec::new() })
    }

    fn write(&mut self, lines: [&str; 5]) -> io::Result<()> {
        for ((list, (file, _)), lines) in List::ALL.into_iter().zip(&mut self.lists).zip(lines) {
            if lines.is_empty() {
                continue;
            }
            let is_new = file.is_none();
            let file = match file {
                Some(file) => file,
                None => file.insert(File::create_new(self.path.join(list.file_name()))?),
            };
            file.write_all(lines.as_bytes())?;
            file.sync_data()?;
            if is_new && cfg!(unix) {
                File::open(&self.path)?.sync_all()?;
            }
        }
        Ok(())
    }
}

impl Store for Folder {
    fn file(&mut self, name: &Path, bytes: &[u8]) -> io::Result<()> {
        let path = self.path.join(name);
        let mut file = OpenOptions::new().write(true).create_new(true).open(&path)?;
        if let Err(error) = file.write_all(bytes) {
            drop(file);
            let _ = std::fs::remove_file(&path);
            return Err(error);
        }
        self.unsynced.push(file);
        Ok(())
    }

    fn remove(&mut self, name: &Path) -> io::Result<()> {
        std::fs::remove_file(self.path.join(name))
    }

    fn append(&mut self, lines: [&str; 5]) -> io::Result<()> {
        let written = self.write(lines);
        for ((file, length), lines) in self.lists.iter_mut().zip(lines) {
            if written.is_ok() {
                *length += lines.len() as u64;
            } else if let Some(file) = file {
                file.set_len(*length)?;
                file.seek(SeekFrom::Start(*length))?;
            }
        }
        written
    }

    fn sync(&mut self) -> io::Result<()> {
        let has_new = !self.unsynced.is_empty();
        for file in self.unsynced.drain(..) {
            file.sync_data()?;
        }
        // Syncs the directory entries of new files. Not every system supports this.
        if has_new && cfg!(unix) {
            for folder in [self.path.join(PICTURES), self.path.clone()] {
                File::open(folder)?.sync_all()?;
            }
        }
        Ok(())
    }
}
