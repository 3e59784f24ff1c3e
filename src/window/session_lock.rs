//! Files that hold a window's unsaved work: a recovery file, and a lock file that stays locked for
//! as long as the window lives ([`FileLock`]). A recovery file whose lock is free has therefore
//! been left behind.
//!
//! The lock file contains the process ID of its window. On a loaded machine, threads of lowest
//! priority (such as the one in Mesa that writes its cache) are not scheduled and keep the lock of
//! an exited process for many seconds. In that case the recovery file is moved into the files of
//! the window that finds it.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use super::file_lock::FileLock;
use locard_engine::source::file;

/// The recovery file and lock file of a window.
#[derive(Debug)]
pub struct SessionFiles {
    pub work_file: PathBuf,
    pub lock_file: PathBuf,
    lock_guard: FileLock,
}

impl SessionFiles {
    /// Creates the files of a window in a folder.
    pub fn create(folder: &Path) -> io::Result<Self> {
        fs::create_dir_all(folder)?;
        let since = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos());
        let name = format!("{since:x}-{}", std::process::id());
        let lock_file = folder.join(format!("{name}.lock"));
        let lock_guard = FileLock::of(File::options().write(true).create_new(true).open(&lock_file)?)?;
        Ok(Self { work_file: folder.join(format!("{name}.json")), lock_file, lock_guard }.with_process_id())
    }

    /// Takes over a recovery file that was left behind; `None` while a window still holds its lock.
    pub fn adopt(work_file: PathBuf) -> Option<Self> {
        let lock_file = work_file.with_extension("lock");
        let file = File::options().write(true).create(true).truncate(false).open(&lock_file).ok()?;
        let Ok(lock_guard) = FileLock::of(file) else {
            return owner_has_exited(&lock_file).then(|| Self::move_orphan(&work_file)).flatten();
        };
        // The previous owner may have just removed it.
        work_file.exists().then(|| Self { work_file, lock_file, lock_guard }.with_process_id())
    }

    /// Moves the recovery file of an exited process. Fails for the second of two windows that try.
    fn move_orphan(work_file: &Path) -> Option<Self> {
        let files = Self::create(work_file.parent()?).ok()?;
        if fs::rename(work_file, &files.work_file).is_ok() {
            let _ = fs::remove_file(work_file.with_extension("lock"));
            return Some(files);
        }
        files.remove();
        None
    }

    /// Writes the process ID into the lock file. If that fails, other windows can only wait for the
    /// lock.
    fn with_process_id(mut self) -> Self {
        let _ = self.lock_guard.0.set_len(0).and_then(|()| write!(self.lock_guard.0, "{}", std::process::id()));
        self
    }

    pub fn remove(&self) {
        let _ = fs::remove_file(&self.work_file);
        // Files whose writing was interrupted.
        let partial_prefix = self.work_file.file_stem().map(|name| format!(".{}.partial-", name.to_string_lossy()));
        let entries = self.work_file.parent().and_then(|folder| fs::read_dir(folder).ok());
        for entry in entries.into_iter().flatten().flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            if partial_prefix.as_ref().is_some_and(|partial_prefix| name.starts_with(partial_prefix)) {
                let _ = fs::remove_file(entry.path());
            }
        }
        let _ = fs::remove_file(&self.lock_file);
    }
}

/// True if the process that holds the lock has exited and only awaits cleanup. Linux only.
fn owner_has_exited(lock_file: &Path) -> bool {
    const MAX_BYTES: u64 = 4096;
    let process = file::read_text(lock_file, MAX_BYTES).ok().and_then(|text| text.parse::<u32>().ok());
    let stat = process.and_then(|process| file::read_text(Path::new(&format!("/proc/{process}/stat")), MAX_BYTES).ok());
    // proc_pid_stat(5): the state follows the name, which is in parentheses.
    let state = stat.as_deref().and_then(|stat| stat.rsplit(')').next()?.trim_start().chars().next());
    cfg!(target_os = "linux") && matches!(state, Some('Z' | 'X'))
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use std::process::Command;

    use super::*;

    #[test]
    fn lock_is_released_although_a_child_process_has_a_copy_of_the_file() {
        let temp = tempfile::tempdir().unwrap();
        let files = SessionFiles::create(temp.path()).unwrap();
        fs::write(&files.work_file, "left").unwrap();
        let (work_file, copy) = (files.work_file.clone(), files.lock_guard.0.try_clone().unwrap());
        assert!(SessionFiles::adopt(work_file.clone()).is_none());
        drop(files);
        assert!(SessionFiles::adopt(work_file).is_some());
        drop(copy);
    }

    #[test]
    fn work_of_an_exited_process_is_moved_although_its_lock_is_held() {
        let temp = tempfile::tempdir().unwrap();
        let mut ended = Command::new("true").spawn().unwrap();
        // Both locks are held. An exited process remains listed until its parent waits for it.
        let [theirs, mine] = [ended.id(), std::process::id()].map(|process| {
            let files = SessionFiles::create(temp.path()).unwrap();
            fs::write(&files.work_file, process.to_string()).unwrap();
            fs::write(&files.lock_file, process.to_string()).unwrap();
            files
        });
        while !owner_has_exited(&theirs.lock_file) {
            std::thread::yield_now();
        }
        let left = SessionFiles::adopt(theirs.work_file.clone()).unwrap();
        assert!(left.work_file != theirs.work_file && !theirs.work_file.exists() && !theirs.lock_file.exists());
        assert_eq!(fs::read_to_string(&left.work_file).unwrap(), ended.id().to_string());
        // It belongs to this window now. The file of a live process stays in place.
        assert!(
            SessionFiles::adopt(left.work_file.clone()).is_none() && SessionFiles::adopt(theirs.work_file).is_none()
        );
        assert!(SessionFiles::adopt(mine.work_file.clone()).is_none() && mine.work_file.exists());
        // A second takeover writes the process ID again.
        drop(left);
        ended.wait().unwrap();
        drop(mine.lock_guard);
        assert!(SessionFiles::adopt(mine.work_file).is_some_and(|files| !owner_has_exited(&files.lock_file)));
    }
}
