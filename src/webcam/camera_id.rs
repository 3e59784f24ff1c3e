//! Identifiers of cameras on the command line.

use std::path::Path;

/// The number of a camera, by its number, its device's path, or a link to that as in
/// /dev/v4l/by-id.
pub fn number(text: &str) -> Option<usize> {
    let of_device = |path: &Path| {
        path.strip_prefix("/dev").ok()?.to_str()?.strip_prefix("video").and_then(|name| name.parse().ok())
    };
    let of_link = || of_device(&std::fs::read_link(text).and_then(|_| std::fs::canonicalize(text)).ok()?);
    text.parse().ok().or_else(|| of_device(Path::new(text))).or_else(of_link)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_are_named_by_number_or_device() {
        assert_eq!(
            ["0", "/dev/video12", "video.mp4", "/dev/null", "x"].map(number),
            [Some(0), Some(12), None, None, None]
        );
    }
}
