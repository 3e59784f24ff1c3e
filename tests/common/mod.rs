//! Access to the real recordings.

use std::path::PathBuf;

/// Returns the path of a file or folder below `LOCARD_DATA`, for a test that needs it. If the
/// variable is unset, prints a line `skipped: ...`, which `scripts/test` lists, and returns `None`.
///
/// # Panics
/// If the variable is set and the path is missing, and in CI (`CI=true`) if it is unset.
pub fn data(rel: &str) -> Option<PathBuf> {
    find(rel, "skipped")
}

/// [`data`] for a test that checks other recordings too. If `LOCARD_DATA` is unset, prints a line
/// `left out: ...` instead.
///
/// # Panics
/// As [`data`].
#[allow(dead_code, reason = "some test binaries use it")]
pub fn data_if_any(rel: &str) -> Option<PathBuf> {
    find(rel, "left out")
}

fn find(rel: &str, consequence: &str) -> Option<PathBuf> {
    let Some(folder) = std::env::var_os("LOCARD_DATA") else {
        assert!(std::env::var("CI").as_deref() != Ok("true"), "LOCARD_DATA is not set, and CI needs the real data");
        eprintln!("{consequence}: LOCARD_DATA is not set, so there is no {rel}");
        return None;
    };
    let path = PathBuf::from(folder).join(rel);
    assert!(path.exists(), "LOCARD_DATA is set, but {} is missing", path.display());
    Some(path)
}
