//! Recordings and analyses that several tests read, made once for each build of the program.
//!
//! A fixture lies in cargo's folder for tests, `target/tmp/fixtures/BUILD/NAME-KEY`: BUILD is the size and the time of
//! the program's file, KEY a hash of the arguments it was made with. Test binaries run side by side; a file lock lets
//! the first make the fixture and the others wait for it. Fixtures are read-only by agreement: a test that writes
//! copies one first (`program::copied`).

#![allow(dead_code, reason = "each test binary uses some of it")]

use std::fs::{self, File};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Fixtures of another build are removed after so long: a run of that build may still read them.
const FIXTURE_LIFETIME: Duration = Duration::from_secs(6 * 3600);

/// The folder of this build's fixtures.
fn folder_of_build() -> PathBuf {
    let program = fs::metadata(env!("CARGO_BIN_EXE_locard")).unwrap();
    let modified_s = program.modified().unwrap().duration_since(std::time::UNIX_EPOCH).unwrap();
    let build = format!("{}-{}", program.len(), modified_s.as_nanos());
    let all = Path::new(env!("CARGO_TARGET_TMPDIR")).join("fixtures");
    let folder = all.join(&build);
    if !folder.exists() {
        for old in fs::read_dir(&all).into_iter().flatten().flatten() {
            let age = old.metadata().and_then(|of| of.modified()).ok().and_then(|at| at.elapsed().ok());
            if age.is_some_and(|age| age > FIXTURE_LIFETIME) {
                let _ = fs::remove_dir_all(old.path());
            }
        }
        fs::create_dir_all(&folder).unwrap();
    }
    folder
}

/// The folder that `make` fills, made by whichever test asks first. `key` has everything that it depends on beside the
/// program.
pub fn once(name: &str, key: impl Hash, make: impl FnOnce(&Path)) -> PathBuf {
    let mut hasher = DefaultHasher::new();
    key.hash(&mut hasher);
    let folder = folder_of_build().join(format!("{name}-{:016x}", hasher.finish()));
    let lock = File::create(folder.with_extension("lock")).unwrap();
    lock.lock().unwrap();
    if !folder.exists() {
        let unfinished = folder.with_extension("unfinished");
        let _ = fs::remove_dir_all(&unfinished);
        fs::create_dir(&unfinished).unwrap();
        make(&unfinished);
        fs::rename(&unfinished, &folder).unwrap();
    }
    folder
}
