//! Folders of frozen recordings. A lock file beside each folder is held while a window uses it.

use std::fs::{self, OpenOptions};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use super::super::file_lock::FileLock;

/// Largest number of frozen recordings on disk, besides those in use.
const MAX_FROZEN_RECORDINGS: usize = 5;
/// Largest number of names tried for a new one.
const MAX_ATTEMPTS: u64 = 100;
const PREFIX: &str = "frozen-";

/// The folder of a frozen recording, which no other window removes while this exists.
#[derive(Debug)]
pub struct FrozenFolder {
    pub path: PathBuf,
    lock_file: PathBuf,
    _lock: FileLock,
}

impl FrozenFolder {
    /// Reserves a new name in a folder, and removes the oldest frozen recordings.
    pub fn create(folder: &Path) -> io::Result<Self> {
        fs::create_dir_all(folder)?;
        let numbers = numbers_in(folder)?;
        let unused: Vec<Self> =
            numbers.iter().filter_map(|number| Self::lock(folder, *number, OpenOptions::new().create(true))).collect();
        let excess = (unused.len() + 1).saturating_sub(MAX_FROZEN_RECORDINGS);
        unused.iter().take(excess).try_for_each(Self::remove)?;
        let first = numbers.last().map_or(1, |last| last + 1);
        // Another window may reserve the same name.
        (first..first + MAX_ATTEMPTS)
            .find_map(|number| Self::lock(folder, number, OpenOptions::new().create_new(true)))
            .ok_or_else(|| io::Error::other("no name is free for a frozen recording"))
    }

    /// `None` if another window holds the lock or its file cannot be opened.
    fn lock(folder: &Path, number: u64, options: &mut OpenOptions) -> Option<Self> {
        let path = folder.join(format!("{PREFIX}{number:06}"));
        let lock_file = path.with_extension("lock");
        let lock = FileLock::of(options.write(true).truncate(false).open(&lock_file).ok()?).ok()?;
        Some(Self { path, lock_file, _lock: lock })
    }

    fn remove(&self) -> io::Result<()> {
        accept_missing(fs::remove_dir_all(&self.path))?;
        accept_missing(fs::remove_file(&self.lock_file))
    }
}

/// Another window may have removed it first.
fn accept_missing(removed: io::Result<()>) -> io::Result<()> {
    removed.or_else(|error| if error.kind() == ErrorKind::NotFound { Ok(()) } else { Err(error) })
}

/// Sorted numbers of all frozen recordings, including those that are still being written.
fn numbers_in(folder: &Path) -> io::Result<Vec<u64>> {
    let names = fs::read_dir(folder)?.flatten().map(|entry| entry.path());
    let mut numbers: Vec<u64> =
        names.filter_map(|path| path.file_stem()?.to_str()?.strip_prefix(PREFIX)?.parse().ok()).collect();
    numbers.sort_unstable();
    numbers.dedup();
    Ok(numbers)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use locard_engine::recording::Recording;

    use super::*;

    #[test]
    fn oldest_unused_folders_are_removed() {
        let temp = tempfile::tempdir().unwrap();
        let create = || {
            let frozen = FrozenFolder::create(temp.path()).unwrap();
            fs::create_dir(&frozen.path).unwrap();
            frozen
        };
        let shown = create();
        let unused: Vec<PathBuf> = (0..MAX_FROZEN_RECORDINGS).map(|_| create().path).collect();
        assert!(unused.iter().all(|path| path.is_dir()));
        let newest = create();
        assert!(shown.path.is_dir() && !unused[0].exists() && unused[1].is_dir());
        let was_shown = shown.path.clone();
        drop((shown, newest));
        drop(create());
        assert!(!was_shown.exists() && !unused[1].exists() && unused[2].is_dir());
        assert_eq!(fs::read_dir(temp.path()).unwrap().count(), 2 * MAX_FROZEN_RECORDINGS);
    }

    #[test]
    fn folder_is_locked_while_a_clone_of_its_recording_exists() {
        let temp = tempfile::tempdir().unwrap();
        let folder = FrozenFolder::create(temp.path()).unwrap();
        let is_locked = || FrozenFolder::lock(temp.path(), 1, &mut OpenOptions::new()).is_none();
        let mut shown = Recording::open(Path::new("recordings/demo"), &Default::default()).unwrap();
        shown.guard = Some(Arc::new(folder));
        let mut exported = Arc::new(shown.clone());
        let tracked = Arc::clone(&exported);
        Arc::make_mut(&mut exported).name = "adopted".to_owned();
        drop((shown, tracked));
        assert!(is_locked());
        drop(exported);
        assert!(!is_locked());
    }

    #[test]
    fn folder_without_files_is_removed() {
        let temp = tempfile::tempdir().unwrap();
        let folder = FrozenFolder::create(temp.path()).unwrap();
        fs::remove_file(&folder.lock_file).unwrap();
        folder.remove().unwrap();
    }

    #[test]
    fn interrupted_recording_does_not_take_a_name() {
        let temp = tempfile::tempdir().unwrap();
        fs::create_dir_all(temp.path().join("frozen-000003/pictures")).unwrap();
        let first = FrozenFolder::create(temp.path()).unwrap();
        let second = FrozenFolder::create(temp.path()).unwrap();
        assert_eq!(
            [&first.path, &second.path].map(|path| path.file_name().unwrap()),
            ["frozen-000004", "frozen-000005"]
        );
    }
}
