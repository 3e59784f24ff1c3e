//! What several tests share.

use std::path::PathBuf;

/// A file or folder of the real data, in the folder that `LOCARD_DATA` names.
///
/// `None`, with a line that says so, where that is not set; a panic where CI is true or the
/// variable is set and the data is missing.
#[allow(dead_code)]
pub fn data(relative: &str) -> Option<PathBuf> {
    let Some(folder) = std::env::var_os("LOCARD_DATA") else {
        assert!(
            std::env::var("CI").as_deref() != Ok("true"),
            "LOCARD_DATA must name the folder of the real data in CI"
        );
        eprintln!("skipped: LOCARD_DATA is not set, so {relative} cannot be found");
        return None;
    };
    let path = PathBuf::from(folder).join(relative);
    assert!(path.exists(), "{} is missing", path.display());
    Some(path)
}
