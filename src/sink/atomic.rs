//! Files that are either complete or absent.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use super::SinkError;
use crate::cleanup::{MadeFolder, Undo, Unfinished};

/// Where an output goes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// A file, there or not yet, without a link in its last part: what a link leads to is written, and the link stays.
    File(PathBuf),
    /// A device or a pipe. It is written to directly, since a file in its place would be something else.
    Stream,
}

/// Links that lead to links, as many as Linux follows.
const MOST_LINKS: usize = 40;

impl Place {
    pub fn of(path: &Path) -> io::Result<Self> {
        if std::fs::metadata(path).is_ok_and(|there| !there.is_file() && !there.is_dir()) {
            return Ok(Self::Stream);
        }
        let mut at = path.to_owned();
        for _ in 0..MOST_LINKS {
            // `/dev/stdout` and the like: another file under that name would not be the one that is open.
            if cfg!(target_os = "linux") && at.starts_with("/proc") {
                return Err(io::Error::other("it leads to a file that is open already; name that file"));
            }
            match std::fs::read_link(&at) {
                Ok(to) => at = at.parent().unwrap_or(Path::new("")).join(to),
                Err(_) => return Ok(Self::File(at)),
            }
        }
        Err(io::Error::other("its links lead in a circle"))
    }
}

/// Refuses to replace a file that may not be written: renaming another over it would not ask.
pub fn not_protected(file: &Path) -> io::Result<()> {
    match std::fs::metadata(file) {
        Ok(there) if there.permissions().readonly() => {
            Err(io::Error::other("it is write-protected; name another file, or allow writing"))
        }
        _ => Ok(()),
    }
}

/// The folder of a file; `None` for the current one.
pub(super) fn folder_of(file: &Path) -> Option<&Path> {
    file.parent().filter(|folder| !folder.as_os_str().is_empty())
}

/// An unfinished file: hidden, in the same folder (so that renaming it is one step), with a name unique to this run. It
/// is deleted with the value unless finished, and when the program is ended.
#[derive(Debug)]
pub struct Partial {
    file: NamedTempFile,
    target: PathBuf,
    unfinished: Unfinished,
}

impl Partial {
    /// Makes an empty file that will become `path`, or what a link of that name leads to. The extension stays last, for
    /// programs that depend on it.
    pub fn create(path: &Path) -> io::Result<Self> {
        let Place::File(target) = Place::of(path)? else {
            return Err(io::Error::other("it is a pipe or a device; name a file"));
        };
        not_protected(&target)?;
        let part = |part: Option<&std::ffi::OsStr>| part.unwrap_or_default().to_string_lossy().into_owned();
        let (prefix, suffix) =
            (format!(".{}.partial-", part(path.file_stem())), format!(".{}", part(path.extension())));
        let mut builder = tempfile::Builder::new();
        builder.prefix(&prefix).suffix(&suffix);
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // Like any file: subject to the umask.
            builder.permissions(std::fs::Permissions::from_mode(0o666));
        }
        let folder = folder_of(&target).unwrap_or(Path::new("."));
        let (file, unfinished) = Unfinished::begin(|| {
            let file = builder.tempfile_in(folder)?;
            let path = file.path().to_owned();
            let undo: Undo = Box::new(move || _ = std::fs::remove_file(path));
            Ok::<_, io::Error>((file, undo))
        })?;
        Ok(Self { file, target, unfinished })
    }

    pub fn path(&self) -> &Path {
        self.file.path()
    }

    pub fn file(&mut self) -> &mut File {
        self.file.as_file_mut()
    }

    /// Gives the file its name. An existing file is replaced, by one that the same people may read and write, or, without
    /// `replace`, causes the error [`io::ErrorKind::AlreadyExists`]. If several replace it, the last one stays, complete.
    pub fn finish(self, replace: bool) -> io::Result<()> {
        let Self { file, target, unfinished } = self;
        unfinished.finish(|| {
            if let Some(there) = std::fs::metadata(&target).ok().filter(|there| replace && there.is_file()) {
                std::fs::set_permissions(file.path(), there.permissions())?;
            }
            let named = if replace { file.persist(&target) } else { file.persist_noclobber(&target) };
            named.map(drop).map_err(|error| error.error)
        })
    }
}

/// Lets `write` fill a file, which appears under its name if that succeeds. Otherwise an existing file stays, as it
/// does if `replace` is not set. Folders that are missing are made, and removed again if it fails. See [`Place`] for
/// links, devices and pipes.
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
    let written = Place::of(path).and_then(|place| match place {
        Place::Stream => File::options().write(true).open(path).and_then(|mut file| fill(&mut file)),
        Place::File(at) => {
            let made = folder_of(&at).map(MadeFolder::make).transpose()?;
            let mut partial = Partial::create(path)?;
            fill(partial.file())?;
            partial.finish(replace)?;
            made.into_iter().for_each(MadeFolder::keep);
            Ok(())
        }
    });
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

    #[test]
    fn missing_folders_are_made_and_a_failed_write_leaves_none() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("new/inner/a.png");
        super::super::check_file(&path, false).unwrap();
        assert!(!folder.path().join("new").exists());
        write_atomically(&path, false, |_| Err(io::Error::other("cut"))).unwrap_err();
        assert!(!folder.path().join("new").exists());
        write_atomically(&path, false, |w| w.write_all(b"whole")).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"whole");
        let below_a_file = path.join("b.png");
        let error = super::super::check_file(&below_a_file, false).unwrap_err().to_string();
        assert!(error.contains("a.png is a file and no folder; choose another place"), "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn link_to_a_folder_that_is_gone_is_refused_before_the_work() {
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join("out");
        std::os::unix::fs::symlink(folder.path().join("unmounted"), &link).unwrap();
        let error = super::super::check_file(&link.join("a.png"), false).unwrap_err().to_string();
        assert!(error.contains("out is a link to a place that is gone"), "{error}");
    }

    /// A file that appears during the writing is also the user's.
    #[test]
    fn what_appears_during_the_work_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        let slow = |w: &mut BufWriter<&mut File>| std::fs::write(&path, "mine").and_then(|()| w.write_all(b"ours"));
        let error = write_atomically(&path, false, slow).unwrap_err().to_string();
        assert!(error.ends_with("a.json: exists already, and is kept (--force replaces it)"), "{error}");
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

    /// A scene that its owner has kept to themselves stays theirs when it is saved; what is protected stays at all.
    #[cfg(unix)]
    #[test]
    fn a_replaced_file_keeps_its_permissions_and_a_protected_one_is_kept() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.toml");
        std::fs::write(&path, "mine").unwrap();
        let set = |mode| std::fs::set_permissions(&path, std::fs::Permissions::from_mode(mode)).unwrap();
        set(0o640);
        write_atomically(&path, true, |w| w.write_all(b"new")).unwrap();
        assert_eq!(std::fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o640);
        set(0o440);
        let error = write_atomically(&path, true, |w| w.write_all(b"no")).unwrap_err().to_string();
        assert!(
            error
                .ends_with("scene.toml: cannot be written: it is write-protected; name another file, or allow writing")
        );
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[cfg(unix)]
    #[test]
    fn a_link_stays_and_what_it_leads_to_is_written() {
        use std::os::unix::fs::symlink;
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("far")).unwrap();
        std::fs::write(at("far/mine"), "mine").unwrap();
        // A chain, each link relative to its own folder.
        symlink("mine", at("far/near")).unwrap();
        symlink("far/near", at("link")).unwrap();
        let error = write_atomically(&at("link"), false, |w| w.write_all(b"x")).unwrap_err().to_string();
        assert!(error.ends_with("link: exists already, and is kept (--force replaces it)"), "{error}");
        write_atomically(&at("link"), true, |w| w.write_all(b"ours")).unwrap();
        assert!(at("link").is_symlink() && at("far/near").is_symlink());
        assert_eq!(std::fs::read_to_string(at("far/mine")).unwrap(), "ours");
        // A link to what is not there yet makes it.
        symlink("far/new", at("dangling")).unwrap();
        write_atomically(&at("dangling"), false, |w| w.write_all(b"new")).unwrap();
        assert!(at("dangling").is_symlink() && !at("far/new").is_symlink());
        assert_eq!(std::fs::read_to_string(at("far/new")).unwrap(), "new");
        symlink("circle", at("circle")).unwrap();
        let error = write_atomically(&at("circle"), true, |w| w.write_all(b"x")).unwrap_err().to_string();
        assert!(error.contains("its links lead in a circle") && at("circle").is_symlink(), "{error}");
    }

    /// What `/dev/stdout` is where a shell has opened a file.
    #[cfg(target_os = "linux")]
    #[test]
    fn a_link_to_an_open_file_is_refused() {
        use std::os::fd::AsRawFd;
        let folder = tempfile::tempdir().unwrap();
        let (path, link) = (folder.path().join("x.txt"), folder.path().join("link"));
        let file = File::create(&path).unwrap();
        std::os::unix::fs::symlink(format!("/proc/self/fd/{}", file.as_raw_fd()), &link).unwrap();
        let error = write_atomically(&link, true, |w| w.write_all(b"x")).unwrap_err().to_string();
        assert!(error.contains("link: cannot be written: it leads to a file that is open already"), "{error}");
        assert!(link.is_symlink() && std::fs::read(&path).unwrap().is_empty());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
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
