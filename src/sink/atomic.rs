//! Files that are either complete or absent.

use std::collections::{BTreeSet, HashSet};
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use super::SinkError;
use crate::cleanup::{MadeFolder, Undo, UndoGuard};

/// Destination of an output.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Destination {
    /// A file, existing or not, with symbolic links in its last component resolved: the target is
    /// written, and the link stays.
    File(PathBuf),
    /// A device or a pipe. It is written to directly, since it cannot be replaced by a file.
    Stream,
}

/// Maximum length of a chain of symbolic links, as in Linux.
const MAX_SYMLINKS: usize = 40;

impl Destination {
    pub fn of(path: &Path) -> io::Result<Self> {
        if std::fs::metadata(path).is_ok_and(|there| !there.is_file() && !there.is_dir()) {
            return Ok(Self::Stream);
        }
        let mut at = path.to_owned();
        for _ in 0..MAX_SYMLINKS {
            // `/dev/stdout` and the like: another file under that name would not be the open one.
            if cfg!(target_os = "linux") && at.starts_with("/proc") {
                return Err(io::Error::other(if at == path {
                    "cannot write below /proc; choose another folder"
                } else {
                    "it leads to a file that is open already; name that file"
                }));
            }
            match std::fs::read_link(&at) {
                Ok(to) => at = at.parent().unwrap_or(Path::new("")).join(to),
                Err(_) => return Ok(Self::File(at)),
            }
        }
        Err(io::Error::other("its links lead in a circle"))
    }
}

/// Refuses a write-protected file, which renaming another over it would replace.
pub fn check_not_protected(file: &Path) -> io::Result<()> {
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

/// Between the name of a file and the random characters of its unfinished file.
const PARTIAL_MARK: &str = ".partial-";

/// An unfinished file: hidden, in the same folder (so that renaming is atomic), with a unique name.
/// It is deleted when dropped unless finished, and when the program is terminated.
#[derive(Debug)]
pub struct Partial {
    file: NamedTempFile,
    target: PathBuf,
    unfinished: UndoGuard,
}

impl Partial {
    /// Creates an empty file that will become `path`, or the target of a symbolic link. The
    /// extension stays last, for programs that depend on it.
    pub fn create(path: &Path) -> io::Result<Self> {
        let Destination::File(target) = Destination::of(path)? else {
            return Err(io::Error::other("it is a pipe or a device; name a file"));
        };
        check_not_protected(&target)?;
        let part = |part: Option<&std::ffi::OsStr>| part.unwrap_or_default().to_string_lossy().into_owned();
        let (prefix, suffix) =
            (format!(".{}{PARTIAL_MARK}", part(path.file_stem())), format!(".{}", part(path.extension())));
        let mut builder = tempfile::Builder::new();
        builder.prefix(&prefix).suffix(&suffix);
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // Like any file: subject to the umask.
            builder.permissions(std::fs::Permissions::from_mode(0o666));
        }
        let folder = folder_of(&target).unwrap_or(Path::new("."));
        let (file, unfinished) = UndoGuard::begin(|| {
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

    /// Renames the file to its final name. An existing file is replaced with its permissions kept,
    /// or, without `replace`, causes the error [`io::ErrorKind::AlreadyExists`]. If several replace
    /// it, the last one stays, complete.
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

/// Unfinished versions of these files, left by runs that were killed. The caller makes sure that no
/// other run is writing the files.
pub fn stale_partials<'a>(files: impl IntoIterator<Item = &'a Path>) -> Vec<PathBuf> {
    // Beside the target of a link, under the link's name.
    let place = |file: &Path| match Destination::of(file) {
        Ok(Destination::File(target)) => Some(target.with_file_name(file.file_name()?)),
        _ => None,
    };
    let places: HashSet<PathBuf> = files.into_iter().filter_map(place).collect();
    let folders: BTreeSet<&Path> = places.iter().filter_map(|place| place.parent()).collect();
    let mut stale = Vec::new();
    for folder in folders {
        let listed = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        for entry in std::fs::read_dir(listed).into_iter().flatten().flatten() {
            let name = entry.file_name();
            let target = name.to_str().and_then(target_of_partial);
            stale.extend(target.filter(|target| places.contains(&folder.join(target))).map(|_| folder.join(&name)));
        }
    }
    stale.sort();
    stale
}

/// Name of the file that an unfinished file of this name was to become.
fn target_of_partial(name: &str) -> Option<String> {
    let (stem, rest) = name.strip_prefix('.')?.rsplit_once(PARTIAL_MARK)?;
    let (_, extension) = rest.split_once('.')?;
    Some(if extension.is_empty() { stem.to_owned() } else { format!("{stem}.{extension}") })
}

/// Writes a file with `write`; it gets its name on success. Otherwise an existing file is kept, as
/// it is if `replace` is not set. Missing folders are created, and removed again on failure. See
/// [`Destination`] for links, devices and pipes.
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
    let written = Destination::of(path).and_then(|place| match place {
        Destination::Stream => File::options().write(true).open(path).and_then(|mut file| fill(&mut file)),
        Destination::File(at) => {
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
    fn failed_write_keeps_the_existing_file_and_leaves_no_other() {
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
    fn missing_folders_are_created_and_removed_after_a_failure() {
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

    #[test]
    fn unfinished_files_of_killed_runs_are_listed_by_their_targets() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let targets = ["a.png", "a b", "a.record.json"].map(at);
        let leave_unfinished = |target: &PathBuf| {
            let partial = Partial::create(target).unwrap().path().to_owned();
            std::fs::write(&partial, "").unwrap();
            partial
        };
        let mut left: Vec<PathBuf> = targets.iter().map(leave_unfinished).collect();
        left.sort();
        leave_unfinished(&at("b.png"));
        assert_eq!(stale_partials(targets.iter().map(PathBuf::as_path)), left);
    }

    /// A file that appears during the writing belongs to the user.
    #[test]
    fn file_that_appears_during_writing_is_kept() {
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
    fn concurrent_writes_leave_the_last_one_complete() {
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
    fn new_file_has_default_permissions() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let [ours, any] = ["ours", "any"].map(|name| folder.path().join(name));
        write_atomically(&ours, false, |w| w.write_all(b"x")).unwrap();
        std::fs::write(&any, "x").unwrap();
        let [ours, any] = [ours, any].map(|path| std::fs::metadata(path).unwrap().permissions().mode());
        assert_eq!(ours, any);
    }

    /// A file with restricted permissions keeps them when replaced; a write-protected one is kept.
    #[cfg(unix)]
    #[test]
    fn replaced_file_keeps_permissions_and_a_protected_one_is_kept() {
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
    fn symlink_is_kept_and_its_target_written() {
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
        // A dangling link creates its target.
        symlink("far/new", at("dangling")).unwrap();
        write_atomically(&at("dangling"), false, |w| w.write_all(b"new")).unwrap();
        assert!(at("dangling").is_symlink() && !at("far/new").is_symlink());
        assert_eq!(std::fs::read_to_string(at("far/new")).unwrap(), "new");
        symlink("circle", at("circle")).unwrap();
        let error = write_atomically(&at("circle"), true, |w| w.write_all(b"x")).unwrap_err().to_string();
        assert!(error.contains("its links lead in a circle") && at("circle").is_symlink(), "{error}");
    }

    /// Target of `/dev/stdout` with a file opened by a shell.
    #[cfg(target_os = "linux")]
    #[test]
    fn symlink_to_an_open_file_is_refused() {
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
    fn device_is_not_replaced() {
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
