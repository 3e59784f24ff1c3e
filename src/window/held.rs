//! Where a window keeps its work. It writes a file of its own, and holds a lock on another one beside it for as long as it lives.
//! The system releases that lock however the program ends, once nothing that it was just starting has a copy of the file. So work
//! whose lock is free was left behind.
//!
//! The lock holds the number of the window's process. Threads of the lowest priority, as Mesa's that writes its cache, get no
//! turn on a loaded machine, and keep the lock of a process that has ended for many seconds: then its work is moved to a place
//! of the window that finds it.

use std::fs::{self, File, TryLockError};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use locard_engine::source::file;

/// The two files of a window's work.
#[derive(Debug)]
pub struct Place {
    pub work: PathBuf,
    pub lock: PathBuf,
    held: Held,
}

/// A lock on an open file. A process that is being started from another thread has a copy of the file until it runs its own
/// program, and closing ours alone would leave the lock to it.
#[derive(Debug)]
struct Held(File);

impl Held {
    fn of(file: File) -> Result<Self, TryLockError> {
        file.try_lock()?;
        Ok(Self(file))
    }
}

impl Drop for Held {
    fn drop(&mut self) {
        let _ = self.0.unlock();
    }
}

impl Place {
    /// A place of its own in a folder.
    pub fn make(folder: &Path) -> io::Result<Self> {
        fs::create_dir_all(folder)?;
        let since = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos());
        let name = format!("{since:x}-{}", std::process::id());
        let lock = folder.join(format!("{name}.lock"));
        let held = Held::of(File::options().write(true).create_new(true).open(&lock)?)?;
        Ok(Self { work: folder.join(format!("{name}.json")), lock, held }.signed())
    }

    /// What somebody left there; `None` where a window still holds it.
    pub fn left(work: PathBuf) -> Option<Self> {
        let lock = work.with_extension("lock");
        let file = File::options().write(true).create(true).truncate(false).open(&lock).ok()?;
        let Ok(held) = Held::of(file) else {
            return has_ended(&lock).then(|| Self::taken_over(&work)).flatten();
        };
        // Whoever had it may have removed it just now.
        work.exists().then(|| Self { work, lock, held }.signed())
    }

    /// Whoever comes second finds nothing.
    fn taken_over(work: &Path) -> Option<Self> {
        let place = Self::make(work.parent()?).ok()?;
        if fs::rename(work, &place.work).is_ok() {
            let _ = fs::remove_file(work.with_extension("lock"));
            return Some(place);
        }
        place.remove();
        None
    }

    /// With the number of this process. Without it the lock has to be waited for, no more.
    fn signed(mut self) -> Self {
        let _ = self.held.0.set_len(0).and_then(|()| write!(self.held.0, "{}", std::process::id()));
        self
    }

    pub fn remove(&self) {
        let _ = fs::remove_file(&self.work);
        // Cut off in the middle of being written.
        let begins = self.work.file_stem().map(|name| format!(".{}.partial-", name.to_string_lossy()));
        let entries = self.work.parent().and_then(|folder| fs::read_dir(folder).ok());
        for entry in entries.into_iter().flatten().flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            if begins.as_ref().is_some_and(|begins| name.starts_with(begins)) {
                let _ = fs::remove_file(entry.path());
            }
        }
        let _ = fs::remove_file(&self.lock);
    }
}

/// Whether the process that holds a lock has ended, and is only being cleared away. Known on Linux alone.
fn has_ended(lock: &Path) -> bool {
    const MOST: u64 = 4096;
    let process = file::read_text(lock, MOST).ok().and_then(|text| text.parse::<u32>().ok());
    let stat = process.and_then(|process| file::read_text(Path::new(&format!("/proc/{process}/stat")), MOST).ok());
    // proc_pid_stat(5): the state follows the name, which stands in parentheses.
    let state = stat.as_deref().and_then(|stat| stat.rsplit(')').next()?.trim_start().chars().next());
    cfg!(target_os = "linux") && matches!(state, Some('Z' | 'X'))
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use std::process::Command;

    use super::*;

    #[test]
    fn a_lock_is_let_go_though_a_process_that_is_being_started_has_a_copy_of_its_file() {
        let temp = tempfile::tempdir().unwrap();
        let place = Place::make(temp.path()).unwrap();
        fs::write(&place.work, "left").unwrap();
        let (work, copy) = (place.work.clone(), place.held.0.try_clone().unwrap());
        assert!(Place::left(work.clone()).is_none());
        drop(place);
        assert!(Place::left(work).is_some());
        drop(copy);
    }

    #[test]
    fn work_of_a_process_that_is_only_being_cleared_away_is_moved() {
        let temp = tempfile::tempdir().unwrap();
        let mut ended = Command::new("true").spawn().unwrap();
        // Both are held; until somebody waits for it, a process that has ended is still listed.
        let [theirs, mine] = [ended.id(), std::process::id()].map(|process| {
            let place = Place::make(temp.path()).unwrap();
            fs::write(&place.work, process.to_string()).unwrap();
            fs::write(&place.lock, process.to_string()).unwrap();
            place
        });
        while !has_ended(&theirs.lock) {
            std::thread::yield_now();
        }
        let left = Place::left(theirs.work.clone()).unwrap();
        assert!(left.work != theirs.work && !theirs.work.exists() && !theirs.lock.exists());
        assert_eq!(fs::read_to_string(&left.work).unwrap(), ended.id().to_string());
        // It is this window's now, and that of a process that lives stays where it is.
        assert!(Place::left(left.work.clone()).is_none() && Place::left(theirs.work).is_none());
        assert!(Place::left(mine.work.clone()).is_none() && mine.work.exists());
        // Taken over twice, it is signed anew.
        drop(left);
        ended.wait().unwrap();
        drop(mine.held);
        assert!(Place::left(mine.work).is_some_and(|place| !has_ended(&place.lock)));
    }
}
