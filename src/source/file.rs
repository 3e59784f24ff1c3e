//! Opens files without hanging or exhausting memory: only plain files, up to a size limit.

use std::fs::File;
use std::io::{self, Read, Seek};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Largest text of people and programs, bytes: ten hours of poses at 200 per second.
pub const MAX_TEXT_BYTES: u64 = 1 << 30;
/// Largest description, scene or profile, bytes: TOML written by hand. Its parser takes up to 80
/// bytes of memory per byte of text.
pub const MAX_DOCUMENT_BYTES: u64 = 1 << 22;
/// Largest document with an entry for each frame, bytes, written by programs.
pub const MAX_LISTING_BYTES: u64 = 1 << 24;

/// First line of a Git LFS pointer file (Git LFS, *specification*).
const LFS_POINTER: &[u8] = b"version https://git-lfs.github.com/spec/";
/// Largest pointer file, bytes.
const MAX_LFS_POINTER: u64 = 1024;

/// Opens a plain file. Refuses a named pipe, which would wait for a writer, a device, which may be
/// endless, and a Git LFS pointer file.
pub fn open(path: &Path) -> io::Result<File> {
    // Checked before opening, since opening a pipe blocks; and again after, since the file may have
    // been replaced.
    plain(&std::fs::metadata(path)?)?;
    let mut file = File::open(path)?;
    let metadata = file.metadata()?;
    plain(&metadata)?;
    if metadata.len() < MAX_LFS_POINTER {
        refuse_lfs_pointer(&mut file)?;
    }
    Ok(file)
}

fn refuse_lfs_pointer(file: &mut File) -> io::Result<()> {
    let mut start = Vec::new();
    file.take(LFS_POINTER.len() as u64).read_to_end(&mut start)?;
    if start == LFS_POINTER {
        return Err(io::Error::other(LfsPointer));
    }
    file.rewind()
}

#[derive(Debug, thiserror::Error)]
#[error("it is a Git LFS pointer, not the file itself; fetch that with `git lfs pull`")]
struct LfsPointer;

/// True if the error is that of a Git LFS pointer file.
pub fn is_lfs_pointer(error: &io::Error) -> bool {
    error.get_ref().is_some_and(|inner| inner.is::<LfsPointer>())
}

fn plain(metadata: &std::fs::Metadata) -> io::Result<()> {
    match (metadata.is_file(), metadata.is_dir()) {
        (true, _) => Ok(()),
        (_, true) => Err(io::ErrorKind::IsADirectory.into()),
        _ => Err(io::Error::other("it is a pipe or a device; a plain file is needed")),
    }
}

/// Identifies the state of a file on disk.
#[derive(Clone, Debug, PartialEq)]
pub struct FileStamp {
    pub file: PathBuf,
    modified: Option<SystemTime>,
    length: Option<u64>,
}

impl FileStamp {
    pub fn of(file: &Path) -> Self {
        let data = std::fs::metadata(file).ok();
        let modified = data.as_ref().and_then(|m| m.modified().ok());
        Self { file: file.to_owned(), modified, length: data.map(|m| m.len()) }
    }

    /// A file may be missing both times.
    pub fn is_fresh(&self) -> bool {
        *self == Self::of(&self.file)
    }
}

/// The content of a plain file of at most `max_bytes` bytes.
pub fn read(path: &Path, max_bytes: u64) -> io::Result<Vec<u8>> {
    let file = open(path)?;
    let refused = |length: u64| Err(io::Error::other(format!("it holds {length} bytes; at most {max_bytes} are read")));
    let length = file.metadata()?.len();
    if length > max_bytes {
        return refused(length);
    }
    let mut bytes = Vec::with_capacity(length as usize);
    // It may grow while being read.
    file.take(max_bytes + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > max_bytes { refused(bytes.len() as u64) } else { Ok(bytes) }
}

/// Like [`read`], for UTF-8.
pub fn read_text(path: &Path, max_bytes: u64) -> io::Result<String> {
    String::from_utf8(read(path, max_bytes)?).map_err(|_| io::ErrorKind::InvalidData.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn file_over_the_size_limit_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a");
        std::fs::write(&file, "12345").unwrap();
        assert_eq!(read(&file, 5).unwrap(), b"12345");
        assert!(read(&file, 4).unwrap_err().to_string().contains("holds 5 bytes; at most 4"));
        // A sparse file of 6 GB that takes no space on the disk. None of it is read.
        std::fs::OpenOptions::new().write(true).open(&file).unwrap().set_len(6 << 30).unwrap();
        assert!(read(&file, 1 << 20).unwrap_err().to_string().contains("6442450944 bytes"));
        std::fs::write(&file, [0xff]).unwrap();
        assert_eq!(read_text(&file, 9).unwrap_err().kind(), io::ErrorKind::InvalidData);
        assert_eq!(read(folder.path(), 9).unwrap_err().kind(), io::ErrorKind::IsADirectory);
    }

    #[test]
    fn lfs_pointer_is_refused_with_the_command_that_fetches_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.glb");
        let text = "version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 123456\n";
        std::fs::write(&file, text).unwrap();
        let error = read(&file, 1 << 20).unwrap_err();
        assert!(is_lfs_pointer(&error) && !is_lfs_pointer(&io::Error::other("another")));
        let error = error.to_string();
        assert!(error.contains("Git LFS pointer") && error.contains("`git lfs pull`"), "{error}");
        // A file that only mentions Git LFS is read.
        let other = format!("# {text}");
        std::fs::write(&file, &other).unwrap();
        assert_eq!(read_text(&file, 1 << 20).unwrap(), other);
    }

    #[cfg(unix)]
    #[test]
    fn pipes_and_devices_are_refused_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let (pipe, zero) = (folder.path().join("pipe"), folder.path().join("zero"));
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        std::os::unix::fs::symlink("/dev/zero", &zero).unwrap();
        for path in [pipe, zero] {
            assert!(read(&path, 9).unwrap_err().to_string().contains("a pipe or a device"), "{}", path.display());
        }
    }
}
