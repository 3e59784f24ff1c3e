//! Files that are whole or not there.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use super::SinkError;

/// More partial files than this are not looked past.
const MOST_PARTIALS: usize = 1000;

/// A file that is not finished: hidden, in the same folder, so that renaming it is one step, under a name of this run
/// alone. Goes with the value unless it is finished.
#[derive(Debug)]
pub struct Partial {
    path: PathBuf,
    target: PathBuf,
    is_finished: bool,
}

impl Partial {
    /// Makes an empty file for what will be `target`. Its name holds the process' number, and one more where somebody
    /// has that already (another machine, on a disk they share); the extension stays last for programs that go by it.
    pub fn create(target: &Path) -> io::Result<(Self, File)> {
        let part = |part: Option<&std::ffi::OsStr>| part.unwrap_or_default().to_string_lossy().into_owned();
        let (stem, extension) = (part(target.file_stem()), part(target.extension()));
        let mut taken = 0;
        loop {
            let more = if taken > 0 { format!("-{taken}") } else { String::new() };
            let name = format!(".{stem}.partial-{}{more}.{extension}", std::process::id());
            let path = target.with_file_name(name);
            match File::create_new(&path) {
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists && taken < MOST_PARTIALS => taken += 1,
                made => return made.map(|file| (Self { path, target: target.to_owned(), is_finished: false }, file)),
            }
        }
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Gives the file its name; of several that come to this the last one stays, whole.
    pub fn finish(mut self) -> io::Result<()> {
        std::fs::rename(&self.path, &self.target)?;
        self.is_finished = true;
        Ok(())
    }
}

impl Drop for Partial {
    fn drop(&mut self) {
        if !self.is_finished {
            // That it cannot be removed is not what went wrong.
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

/// Lets `write` fill a file, which appears under its name when that succeeded; else what was there stays. A device or a
/// pipe is written to as it is, for a file in its place would be another thing.
pub fn write_atomically<E>(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> Result<(), E>,
) -> Result<(), SinkError>
where
    io::Error: From<E>,
{
    let fill = |file: File| {
        let mut writer = BufWriter::with_capacity(1 << 16, file);
        write(&mut writer)?;
        writer.flush()
    };
    let no_file = std::fs::metadata(path).is_ok_and(|there| !there.is_file() && !there.is_dir());
    let written = if no_file {
        File::options().write(true).open(path).and_then(fill)
    } else {
        Partial::create(path).and_then(|(partial, file)| fill(file).and_then(|()| partial.finish()))
    };
    written.map_err(|source| SinkError::Write { path: path.to_owned(), source })
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
        let full = |w: &mut BufWriter<File>| w.write_all(b"half").and(Err(io::ErrorKind::StorageFull.into()));
        let error = write_atomically(&path, full).unwrap_err().to_string();
        assert!(error.contains("a.png: cannot be written: the disk is full"), "{error}");
        assert_eq!(std::fs::read(&path).unwrap(), b"first");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn of_two_at_once_the_last_one_stays_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mkv");
        let (first, mut a) = Partial::create(&path).unwrap();
        let (second, mut b) = Partial::create(&path).unwrap();
        assert!(first.path() != second.path() && first.path().extension() == path.extension());
        a.write_all(b"one").unwrap();
        b.write_all(b"two").unwrap();
        second.finish().unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"two");
        first.finish().unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"one");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_device_stays_one() {
        let folder = tempfile::tempdir().unwrap();
        let full = folder.path().join("full");
        std::os::unix::fs::symlink("/dev/full", &full).unwrap();
        let error = write_atomically(&full, |w| w.write_all(b"x")).unwrap_err().to_string();
        assert!(error.contains("full: cannot be written: the disk is full"), "{error}");
        assert!(full.is_symlink());
        let null = folder.path().join("null");
        std::os::unix::fs::symlink("/dev/null", &null).unwrap();
        write_atomically(&null, |w| w.write_all(b"x")).unwrap();
        assert!(null.is_symlink());
    }
}
