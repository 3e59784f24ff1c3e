//! Things to undo when the program is ended midway: files without their final names, incomplete
//! folders, child processes.
//!
//! The list is global because signals are: ending the program undoes the whole list, whatever the
//! threads are doing.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Undoes one thing.
pub type Undo = Box<dyn FnOnce() + Send>;

struct UndoList {
    begun: u64,
    undo: BTreeMap<u64, Undo>,
}

static LIST: Mutex<UndoList> = Mutex::new(UndoList { begun: 0, undo: BTreeMap::new() });

fn list() -> MutexGuard<'static, UndoList> {
    // A panic under the lock leaves the list intact.
    LIST.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A step that is undone when this is dropped, or by [`undo_all`], unless it was finished.
#[derive(Debug)]
pub struct UndoGuard {
    number: u64,
}

impl UndoGuard {
    /// Makes a thing and registers its undo in one step: the program cannot be ended between the
    /// two.
    pub fn begin<T, E>(make: impl FnOnce() -> Result<(T, Undo), E>) -> Result<(T, Self), E> {
        let mut list = list();
        let (made, undo) = make()?;
        list.begun += 1;
        let number = list.begun;
        list.undo.insert(number, undo);
        Ok((made, Self { number }))
    }

    /// Takes the step that finishes the thing, such as giving a file its name. The program cannot
    /// be ended in the middle of it. If the step fails, the thing is undone.
    pub fn finish<T, E>(self, step: impl FnOnce() -> Result<T, E>) -> Result<T, E> {
        let mut list = list();
        let done = step();
        let undo = list.undo.remove(&self.number);
        if let (Err(_), Some(undo)) = (&done, undo) {
            undo();
        }
        done
    }
}

impl Drop for UndoGuard {
    fn drop(&mut self) {
        let mut list = list();
        if let Some(undo) = list.undo.remove(&self.number) {
            undo();
        }
    }
}

/// A folder for output, made with those above it. Unless kept, the ones that were not there before
/// are removed again, as far as they are empty.
#[derive(Debug)]
pub struct MadeFolder(UndoGuard);

impl MadeFolder {
    pub fn make(folder: &Path) -> io::Result<Self> {
        let begun = UndoGuard::begin(|| {
            let is_missing = |at: &&Path| !at.as_os_str().is_empty() && !at.is_dir();
            let missing: Vec<&Path> = folder.ancestors().take_while(is_missing).collect();
            // Only folders made here are removed again. `new/../mine` may name one that was there
            // before.
            let mut made: Vec<PathBuf> = Vec::new();
            for at in missing.into_iter().rev() {
                match std::fs::create_dir(at) {
                    Ok(()) => made.push(at.to_owned()),
                    Err(_) if at.is_dir() => {}
                    Err(error) => {
                        remove_folders(&made);
                        return Err(error);
                    }
                }
            }
            let undo: Undo = Box::new(move || remove_folders(&made));
            Ok(((), undo))
        });
        Ok(Self(begun?.1))
    }

    pub fn keep(self) {
        let _ = self.0.finish(|| Ok::<_, ()>(()));
    }
}

/// Removes folders, each within the one before it, as far as they are empty.
fn remove_folders(folders: &[PathBuf]) {
    let _ = folders.iter().rev().try_for_each(std::fs::remove_dir);
}

/// Undoes everything, newest first. While the returned value lives, nothing can be begun or
/// finished, so that the program can end.
#[must_use]
pub fn undo_all() -> impl Sized {
    let mut list = list();
    while let Some((_, undo)) = list.undo.pop_last() {
        undo();
    }
    list
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU32, Ordering};

    use super::*;

    #[test]
    fn a_made_folder_stays_if_it_is_kept_or_not_empty() {
        let temp = tempfile::tempdir().unwrap();
        let folder = temp.path().join("a/b");
        drop(MadeFolder::make(&folder).unwrap());
        assert!(!temp.path().join("a").exists() && temp.path().exists());
        let made = MadeFolder::make(&folder).unwrap();
        std::fs::write(temp.path().join("a/mine"), "").unwrap();
        drop(made);
        assert!(!folder.exists() && temp.path().join("a/mine").exists());
        MadeFolder::make(&folder).unwrap().keep();
        drop(MadeFolder::make(&folder).unwrap());
        assert!(folder.exists());
    }

    #[test]
    fn made_folder_removes_only_folders_that_it_made() {
        let temp = tempfile::tempdir().unwrap();
        let of_user = temp.path().join("mine");
        std::fs::create_dir(&of_user).unwrap();
        drop(MadeFolder::make(&temp.path().join("new/../mine")).unwrap());
        assert!(of_user.is_dir() && !temp.path().join("new").exists());
        // The name of the second is too long for a file system.
        let too_long = temp.path().join("new").join("n".repeat(300));
        MadeFolder::make(&too_long).unwrap_err();
        assert!(!temp.path().join("new").exists());
    }

    #[test]
    fn unfinished_steps_are_undone_once() {
        let undone = Arc::new(AtomicU32::new(0));
        let begin = || {
            let undone = Arc::clone(&undone);
            let undo: Undo = Box::new(move || _ = undone.fetch_add(1, Ordering::SeqCst));
            UndoGuard::begin(|| Ok::<_, ()>(((), undo))).unwrap().1
        };
        begin().finish(|| Ok::<_, ()>(())).unwrap();
        assert_eq!(undone.load(Ordering::SeqCst), 0);
        drop(begin());
        assert_eq!(undone.load(Ordering::SeqCst), 1);
        begin().finish(|| Err::<(), _>(())).unwrap_err();
        assert_eq!(undone.load(Ordering::SeqCst), 2);
    }
}
