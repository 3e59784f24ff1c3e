//! Files that are whole or not there.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use super::SinkError;

/// The name that a file has until it is finished: hidden, in the same folder, so that renaming
/// it is one step; the extension stays last for programs that go by it.
pub fn partial_path(path: &Path) -> PathBuf {
    let part = |part: Option<&std::ffi::OsStr>| part.unwrap_or_default().to_string_lossy().into_owned();
    path.with_file_name(format!(".{}.partial.{}", part(path.file_stem()), part(path.extension())))
}

/// Lets `write` fill a file under its partial name and renames it when that succeeded; removes it otherwise.
pub fn write_atomically<E>(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> Result<(), E>,
) -> Result<(), SinkError>
where
    io::Error: From<E>,
{
    let partial = partial_path(path);
    let written = File::create(&partial).and_then(|file| {
        let mut writer = BufWriter::with_capacity(1 << 16, file);
        write(&mut writer)?;
        writer.flush()
    });
    written.and_then(|()| std::fs::rename(&partial, path)).map_err(|source| {
        let _ = std::fs::remove_file(&partial);
        SinkError::Write { path: path.to_owned(), source }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_what_was_there_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        write_atomically(&path, |w| w.write_all(b"first")).unwrap();
        let fails = |w: &mut BufWriter<File>| w.write_all(b"half").and(Err(io::Error::other("cut")));
        let error = write_atomically(&path, fails).unwrap_err();
        assert!(error.to_string().ends_with("a.png: cannot be written: cut"), "{error}");
        assert_eq!(std::fs::read(&path).unwrap(), b"first");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_disk_is_said() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        std::os::unix::fs::symlink("/dev/full", partial_path(&path)).unwrap();
        let error = write_atomically(&path, |w| w.write_all(b"x")).unwrap_err().to_string();
        assert!(error.ends_with("a.png: cannot be written: the disk is full"), "{error}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
