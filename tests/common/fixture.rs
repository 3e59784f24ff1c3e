//! Recordings and analyses shared by several tests, made once per build of the program.
//!
//! A fixture is a folder `target/tmp/fixtures/BUILD/NAME-KEY`. BUILD is the size and modification
//! time of the program's file. KEY is a hash of the arguments and input files of its maker, and of
//! the source of the maker and of tests/common. Test processes run in parallel; a file lock lets
//! the first make a fixture while the others wait. Fixtures are read-only by convention: a test
//! that writes into one copies it first (`program::copied`).

#![allow(dead_code, reason = "each test binary uses some of it")]

use std::fs::{self, File};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::panic::Location;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Minimum age at which fixtures of another build are removed. A run of that build may still read
/// younger ones.
const FIXTURE_LIFETIME: Duration = Duration::from_secs(6 * 3600);

/// Returns the folder of this build's fixtures, and removes old ones of other builds when it is
/// new.
fn folder_of_build() -> PathBuf {
    let program = fs::metadata(env!("CARGO_BIN_EXE_locard")).unwrap();
    let since_epoch = program.modified().unwrap().duration_since(std::time::UNIX_EPOCH).unwrap();
    let build = format!("{}-{}", program.len(), since_epoch.as_nanos());
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

/// Hashes the paths and contents of a file, or of all files below a folder.
fn hash_files(hasher: &mut DefaultHasher, path: &Path) {
    path.hash(hasher);
    if path.is_dir() {
        let mut inner: Vec<PathBuf> = fs::read_dir(path).unwrap().map(|entry| entry.unwrap().path()).collect();
        inner.sort();
        inner.iter().for_each(|path| hash_files(hasher, path));
    } else {
        fs::read(path).unwrap().hash(hasher);
    }
}

/// Returns the folder of a fixture. The first caller fills it with `make`. `key` holds the
/// arguments of `make`, `inputs` the files and folders that it reads, from the repository's root.
/// The code of `make` must be in the caller's file, in tests/common or in the program.
#[track_caller]
pub fn once(name: &str, inputs: &[&str], key: impl Hash, make: impl FnOnce(&Path)) -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut hasher = DefaultHasher::new();
    key.hash(&mut hasher);
    let sources = [Location::caller().file(), "tests/common"];
    for path in inputs.iter().chain(&sources) {
        hash_files(&mut hasher, &root.join(path));
    }
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
