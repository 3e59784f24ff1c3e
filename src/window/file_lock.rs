//! A lock on an open file, which the operating system releases however the program ends.

use std::fs::{File, TryLockError};
use std::io;

/// An exclusive lock. A process that is being started from another thread has a copy of the file
/// until its own program runs; closing this file alone would leave the lock with that copy. The
/// lock is therefore released explicitly.
#[derive(Debug)]
pub struct FileLock(pub File);

impl FileLock {
    /// Fails if another window holds the lock.
    pub fn of(file: File) -> Result<Self, TryLockError> {
        file.try_lock()?;
        Ok(Self(file))
    }

    /// Waits until no other window holds the lock.
    pub fn wait(file: File) -> io::Result<Self> {
        file.lock()?;
        Ok(Self(file))
    }
}

impl Drop for FileLock {
    fn drop(&mut self) {
        let _ = self.0.unlock();
    }
}
