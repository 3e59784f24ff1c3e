//! What several test files share.

use std::path::PathBuf;

/// A file or folder of the real data that `LOCARD_DATA` names; `None`, said aloud, where the variable is unset.
///
/// # Panics
/// Where the variable is set but the path is missing, and where it is unset in CI.
pub fn data(rel: &str) -> Option<PathBuf> {
    let Some(folder) = std::env::var_os("LOCARD_DATA") else {
        assert!(std::env::var("CI").as_deref() != Ok("true"), "LOCARD_DATA is not set, and CI needs the real data");
        eprintln!("skipped: LOCARD_DATA is not set, so there is no {rel}");
        return None;
    };
    let path = PathBuf::from(folder).join(rel);
    assert!(path.exists(), "LOCARD_DATA is set, but {} is missing", path.display());
    Some(path)
}
