//! Files that are either complete or absent.

use std::fs::{File, Permissions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use super::SinkError;
use crate::unfinished::{Undo, Unfinished};

/// An unfinished file: hidden, in the same folder (so that renaming it is one step), with a name unique to this run. It
/// is deleted with the value unless finished, and when the program is ended.
#[derive(Debug)]
pub struct Partial {
    file: NamedTempFile,
    target: PathBuf,
    unfinished: Unfinished,
}

impl Partial {
    /// Makes an empty file that will become `target`. The extension stays last, for programs that depend on it.
    pub fn create(target: &Path) -> io::Result<Self> {
        let part = |part: Option<&std::ffi::OsStr>| part.unwrap_or_default().to_string_lossy().into_owned();
        let (prefix, suffix) =
            (format!(".{}.partial-", part(target.file_stem())), format!(".{}", part(target.extension())));
        let mut builder = tempfile::Builder::new();
        builder.prefix(&prefix).suffix(&suffix);
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // Like any file: subject to the umask.
            builder.permissions(Permissions::from_mode(0o666));
        }
        let folder = target.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let (file, unfinished) = Unfinished::begin(|| {
            let file = builder.tempfile_in(folder)?;
            let path = file.path().to_owned();
            let undo: Undo = Box::new(move || _ = std::fs::remove_file(path));
            Ok::<_, io::Error>((file, undo))
        })?;
        Ok(Self { file, target: target.to_owned(), unfinished })
    }

    pub fn path(&self) -> &Path {
        self.file.path()
    }

    pub fn file(&mut self) -> &mut File {
        self.file.as_file_mut()
    }

    /// Gives the file its name. An existing file is replaced or, without `replace`, causes the error
    /// [`io::ErrorKind::AlreadyExists`]. If several replace it, the last one stays, complete.
    pub fn finish(self, replace: bool) -> io::Result<()> {
        let Self { file, target, unfinished } = self;
        unfinished.finish(|| {
            let named = if replace { file.persist(&target) } else { file.persist_noclobber(&target) };
            named.map(drop).map_err(|error| error.error)
        })
    }
}

/// Lets `write` fill a file, which appears under its name if that succeeds. Otherwise an existing file stays, as it
/// does if `replace` is not set. A device or a pipe is written to directly, since a file in its place would be
/// something else.
pub fn write_atomically<E>(
    path: &Path,
    replace: bool,
    write: impl FnOnce(&mut BufWriter<&mut File>) -> Result<(), E>,
) -> Result<(), SinkError>
where
    io::Error: From<E>,
{
    let fill = |file: &mut File| {
        let mut writer = BufWriter::with_capacity(1 << 16, file);
        write(&mut writer)?;
        writer.flush()
    };
    let no_file = std::fs::metadata(path).is_ok_and(|there| !there.is_file() && !there.is_dir());
    let written = if no_file {
        File::options().write(true).open(path).and_then(|mut file| fill(&mut file))
    } else {
        Partial::create(path).and_then(|mut partial| fill(partial.file()).and_then(|()| partial.finish(replace)))
    };
    written.map_err(|source| SinkError::of_writing(path, source))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_what_was_there_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        write_atomically(&path, false, |w| w.write_all(b"first")).unwrap();
        let fails = |w: &mut BufWriter<&mut File>| w.write_all(b"half").and(Err(io::Error::other("cut")));
        let error = write_atomically(&path, true, fails).unwrap_err();
        assert!(error.to_string().ends_with("a.png: cannot be written: cut"), "{error}");
        let full = |w: &mut BufWriter<&mut File>| w.write_all(b"half").and(Err(io::ErrorKind::StorageFull.into()));
        let error = write_atomically(&path, true, full).unwrap_err().to_string();
        assert!(error.contains("a.png: cannot be written: the disk is full"), "{error}");
        assert_eq!(std::fs::read(&path).unwrap(), b"first");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    /// A file that appears during the writing is also the user's.
    #[test]
    fn what_appears_during_the_work_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        let slow = |w: &mut BufWriter<&mut File>| std::fs::write(&path, "mine").and_then(|()| w.write_all(b"ours"));
        let error = write_atomically(&path, false, slow).unwrap_err().to_string();
        assert!(error.ends_with("a.json: exists already; it is kept unless --force is given"), "{error}");
        assert_eq!(std::fs::read(&path).unwrap(), b"mine");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        write_atomically(&path, true, slow).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"ours");
    }

    #[test]
    fn of_two_at_once_the_last_one_stays_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mkv");
        let [mut first, mut second] = [(), ()].map(|()| Partial::create(&path).unwrap());
        assert!(first.path() != second.path() && first.path().extension() == path.extension());
        first.file().write_all(b"one").unwrap();
        second.file().write_all(b"two").unwrap();
        second.finish(true).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"two");
        first.finish(true).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"one");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[cfg(unix)]
    #[test]
    fn a_file_may_be_read_by_those_who_may_read_any_other() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let [ours, any] = ["ours", "any"].map(|name| folder.path().join(name));
        write_atomically(&ours, false, |w| w.write_all(b"x")).unwrap();
        std::fs::write(&any, "x").unwrap();
        let [ours, any] = [ours, any].map(|path| std::fs::metadata(path).unwrap().permissions().mode());
        assert_eq!(ours, any);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_device_stays_one() {
        let folder = tempfile::tempdir().unwrap();
        let full = folder.path().join("full");
        std::os::unix::fs::symlink("/dev/full", &full).unwrap();
        let error = write_atomically(&full, true, |w| w.write_all(b"x")).unwrap_err().to_string();
        assert!(error.contains("full: cannot be written: the disk is full"), "{error}");
        assert!(full.is_symlink());
        let null = folder.path().join("null");
        std::os::unix::fs::symlink("/dev/null", &null).unwrap();
        write_atomically(&null, true, |w| w.write_all(b"x")).unwrap();
        assert!(null.is_symlink());
    }
}
